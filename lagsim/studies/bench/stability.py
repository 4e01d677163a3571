"""Where each method holds and where it fails: a map over steps and a parameter.

First what is run (methods, steps, values, how long), then the runs and the borders that
they find, then what stability.csv and stability.json say of them.
"""

from __future__ import annotations

import contextlib
import math
from dataclasses import dataclass, field
from itertools import pairwise
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from lagsim.errors import InputError, LagsimError, Problem
from lagsim.mechanics.equilibrium import (
    Mode,
    NoEquilibriumError,
    find_equilibrium,
    modes,
    named,
)
from lagsim.mechanics.structure import structure
from lagsim.methods import method as method_named
from lagsim.methods import names
from lagsim.outputs.manifest import head
from lagsim.outputs.table import table_of
from lagsim.plan.making import method_refusal
from lagsim.run.interrupt import Interrupt
from lagsim.studies.bench.trial import FAILS, KICK, SEED, Cell, Subject
from lagsim.studies.step_bounds import predicted

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence

    from lagsim.run.session import Case

    CaseAt = Callable[[float | None], Case]

# Cells of a strip, and of a map: steps, values of the parameter.
STRIP = 48
MAP = (24, 16)
# Runs that find a border, besides.
SEARCH = 14
# The range of steps: from this part of the smallest border predicted to so many times
# the largest, but not wider than the third.
BELOW, ABOVE, WIDEST = 0.1, 1.6, 1e3
# Without a border, in parts of the fastest period, or of the run.
OF_PERIOD = (0.02, 1.0)
OF_RUN = (1e-4, 0.1)

# Steps of a run: so many, or what the model lasts, within what all of it may cost.
STEPS, MOST_STEPS, LEAST_STEPS = 10_000, 40_000, 400
# Operations, worth about 10 s; a step and its row cost so many besides those of its
# evaluations, which a few steps tell.
BUDGET = 1e10
OVERHEAD = 1000
PILOT = 20
# A switch costs about a million, and there may be one in every ten steps.
SWITCHING = 100_000
# The same of one in time, and those are counted: a long step takes in many of them.
ARC = 1_000_000

# Why there is no map of a model with laws.
UNSTEADY = (
    "the model has constraints that come and go: a stability limit belongs to one "
    "set of equations, and these change during the run"
)
INSTEAD = "`lagsim bench` compares methods on such a model, for each step"


@dataclass(frozen=True)
class Wish:
    """What is asked for.

    Attributes
    ----------
    methods
        Only these; None for all that apply.
    steps
        Smallest and largest; None for a choice from the model.
    name, values
        Of the parameter that varies.
    strip, map
        How many cells.
    """

    methods: tuple[str, ...] | None = None
    steps: tuple[float, float] | None = None
    name: str | None = None
    between: tuple[float, float] | None = None
    strip: int = STRIP
    map: tuple[int, int] = MAP


class Refused(NamedTuple):
    """A method that does not apply."""

    method: str
    reason: str


def methods_for(
    case: Case, wish: Wish
) -> tuple[tuple[str, ...], tuple[str, ...], list[Refused]]:
    """Give those of fixed steps, those of chosen steps, and those that refuse.

    Raises
    ------
    InputError
        Where one that was asked for cannot be looked at, or the model has laws.
    """
    if case.equations.laws:
        raise InputError([Problem("no-stability", UNSTEADY, hint=INSTEAD)])
    found: dict[bool, list[str]] = {False: [], True: []}
    refused = []
    problems = []
    kind = structure(case.equations)
    for name in wish.methods or names():
        module = method_named(name)
        reason = method_refusal(name, case.equations, kind)
        if reason:
            text = f"`{name}` cannot handle this model: {reason}"
            problems.append(Problem("method-refused", text))
            refused.append(Refused(name, reason))
        elif module.ADAPTIVE and wish.name is None:
            text = (
                f"`{name}` chooses its steps: it has no stability limit on a given step"
            )
            hint = "use --vary to see how its work changes with a parameter"
            problems.append(Problem("adaptive-method", text, hint=hint))
        else:
            found[bool(module.ADAPTIVE)].append(name)
    if wish.methods is not None and problems:
        raise InputError(problems)
    return tuple(found[False]), tuple(found[True]), refused


def runs_for(
    subject: Subject, name: str, steps: list[float], count: int
) -> tuple[int, int]:
    """Give the least and the largest number of steps that each of `count` runs has."""
    pilot = subject.run(name, steps[len(steps) // 2], PILOT, None)
    evaluations = (pilot.evaluations or PILOT) / PILOT
    n = len(subject.equations.q)
    solving = (2 * n) ** 3 if method_named(name).NEEDS not in ((), ("power",)) else 0
    cost = evaluations * (subject.evaluation() + 50) + OVERHEAD + solving
    cost += SWITCHING if subject.switches else 0
    cost += ARC * subject.arcs * steps[-1]
    affordable = int(BUDGET / (count * cost))
    return (
        max(LEAST_STEPS, min(STEPS, affordable)),
        max(LEAST_STEPS, min(MOST_STEPS, affordable)),
    )


def spaced(between: tuple[float, float], count: int) -> Iterator[float]:
    """Give values from the first to the second: by a factor where both are above 0."""
    first, last = between
    if first > 0.0 and last > 0.0:
        for k in np.linspace(math.log10(first), math.log10(last), count):
            yield float(f"{10.0**k:.6g}")
    else:
        yield from (float(f"{x:.6g}") for x in np.linspace(first, last, count))


def usual_value(case: Case, name: str | None) -> float | None:
    """Give the value that the file gives a parameter."""
    known = {p.name: p.value for p in case.equations.model.parameters}
    return None if name is None else known[name]


def subjects_at_ends(
    case_at: CaseAt, values: list[float | None], interrupt: Interrupt | None
) -> Iterator[Subject]:
    """Give the model at both ends of the parameter's range, where it can be had."""
    for value in (values[0], values[-1]):
        if value is not None:
            with contextlib.suppress(LagsimError):
                yield Subject(case_at(value), interrupt)


def steps_for(
    subjects: list[Subject], methods: tuple[str, ...], wish: Wish
) -> list[float]:
    """Give the steps of the cells: those asked for, or around the borders predicted."""
    ranges = [_range(subject, methods) for subject in subjects]
    low, high = min(a for a, _ in ranges), max(b for _, b in ranges)
    between = wish.steps or (max(low, high / WIDEST), high)
    count = wish.strip if wish.name is None else wish.map[0]
    return list(spaced(between, count)) if methods else []


def _range(subject: Subject, methods: tuple[str, ...]) -> tuple[float, float]:
    """Give the range of steps around the borders predicted."""
    span = 10.0 * subject.span
    borders = [
        border
        for name in methods
        for eigenvalues in (subject.at_start, subject.along)
        if (border := predicted(method_named(name).amplification, eigenvalues, span))
    ]
    if borders:
        high = ABOVE * max(borders)
        return max(BELOW * min(borders), high / WIDEST), high
    fastest = float(np.max(np.abs(subject.along), initial=0.0))
    if fastest * subject.span > 1.0:
        low, high = (part * 2.0 * math.pi / fastest for part in OF_PERIOD)
        return low, high
    return OF_RUN[0] * subject.span, OF_RUN[1] * subject.span


# A border is known to three digits; around one that is predicted more is looked at.
DIGITS = 2e-4
AROUND = (0.99, 1.01)


@dataclass(frozen=True, slots=True)
class Border:
    """Where a method ceases to hold, at one value of the parameter.

    Attributes
    ----------
    found : float or None
        To three digits; None where there is none in the range.
    at_start, along : float or None
        Predicted from the eigenvalues at the start, and along the motion.
    note : str
        Why none was found.
    """

    method: str
    value: float | None
    found: float | None
    at_start: float | None
    along: float | None
    note: str = ""


@dataclass(frozen=True)
class Rest:
    """What is known about an equilibrium.

    Attributes
    ----------
    at : dict or None
        Its coordinates.
    reason : str
        Why there is none.
    is_start : bool
        The start is one.
    modes : tuple of Mode
        About it; or of linear equations wherever they are.
    """

    at: dict[str, float] | None
    reason: str
    is_start: bool
    modes: tuple[Mode, ...]


@dataclass
class Stability:
    """What is run of one model, and what has been found.

    Attributes
    ----------
    methods, adaptive : tuple of str
        Of fixed steps, and those that choose their steps.
    steps : list of float
        The steps of the cells.
    values : list of float or None
        Of the parameter.
    usual : float or None
        Its value in the file.
    runs : dict
        By method, the least and the largest number of steps of a run.
    """

    subject: Subject
    methods: tuple[str, ...]
    adaptive: tuple[str, ...]
    refused: list[Refused]
    steps: list[float]
    values: list[float | None]
    usual: float | None
    runs: dict[str, tuple[int, int]]
    rest: Rest
    cells: list[Cell] = field(default_factory=list)
    borders: list[Border] = field(default_factory=list)
    interrupted: bool = False

    def of(self, method: str) -> list[Cell]:
        """Give the cells of a method, in order."""
        return [cell for cell in self.cells if cell.method == method]


def measure(
    case_at: CaseAt,
    wish: Wish,
    *,
    interrupt: Interrupt | None = None,
    progress: Callable[[float], None] | None = None,
) -> Stability:
    """Run a model by each method over the range of steps; find the borders.

    Parameters
    ----------
    case_at
        Gives the model at a value of the parameter; with None as the file has it.

    Raises
    ------
    InputError
    """
    interrupt = interrupt or Interrupt()
    with interrupt.raised():  # there is nothing yet to be kept
        found = _asked(case_at, wish, interrupt)
    work = _Work(found, interrupt, progress)
    interrupt.cut(lambda: work.columns(case_at))
    order = [*found.methods, *found.adaptive]
    found.cells.sort(key=lambda cell: order.index(cell.method))
    found.borders.sort(key=lambda border: order.index(border.method))
    found.interrupted = interrupt.asked
    return found


def _asked(case_at: CaseAt, wish: Wish, interrupt: Interrupt) -> Stability:
    """Find out what there is to be run."""
    case = case_at(None)
    subject = Subject(case, interrupt)
    fixed, adaptive, refused = methods_for(case, wish)
    values: list[float | None] = [None]
    if wish.between is not None:
        values = list(spaced(wish.between, wish.map[1]))
    subjects = [subject, *subjects_at_ends(case_at, values, interrupt)]
    steps = steps_for(subjects, fixed, wish)
    count = len(values) * len(fixed) * (len(steps) + SEARCH)
    runs = {name: runs_for(subject, name, steps, count) for name in fixed}
    return Stability(
        subject, fixed, adaptive, refused, steps, values,
        usual_value(case, wish.name), runs, _rest(subject),
    )  # fmt: skip


class _Work:
    """The runs, one after the other."""

    def __init__(
        self,
        found: Stability,
        interrupt: Interrupt,
        progress: Callable[[float], None] | None,
    ) -> None:
        self.found, self.interrupt, self.progress = found, interrupt, progress
        each = len(found.methods) * (len(found.steps) + SEARCH) + len(found.adaptive)
        self.total, self.done = max(1, len(found.values) * each), 0

    @property
    def pressed(self) -> bool:
        return self.interrupt.asked

    def columns(self, case_at: CaseAt) -> None:
        """Run every method at every value of the parameter."""
        for value in self.found.values:
            if self.pressed:
                return
            subject = self.found.subject
            if value is not None:
                try:
                    subject = Subject(case_at(value), self.interrupt)
                except LagsimError as fault:
                    self._without(value, fault)
                    continue
            for name in self.found.methods:
                self._strip(subject, name, value)
            for name in self.found.adaptive:
                self._cells(subject, name, [None], value)

    def _without(self, value: float, fault: LagsimError) -> None:
        reason, found = _reason(fault), self.found
        for name in found.methods:
            found.borders.append(Border(name, value, None, None, None, reason))
        for name in (*found.methods, *found.adaptive):
            found.cells += [
                Cell(name, step, value, FAILS, None, None, reason=reason)
                for step in (found.steps if name in found.methods else [None])
            ]

    def _cells(
        self,
        subject: Subject,
        name: str,
        steps: Sequence[float | None],
        value: float | None,
    ) -> list[Cell]:
        """Run a method with steps; what is cut short does not count."""
        cells = []
        for step in steps:
            if not self.pressed:
                cells.append(self._cell(subject, name, step, value))
                self._count(1)
        if not self.pressed:
            self.found.cells += cells
        return cells

    def _strip(self, subject: Subject, name: str, value: float | None) -> None:
        cells = self._cells(subject, name, self.found.steps, value)
        if self.pressed:
            return
        amplification = method_named(name).amplification
        top = self.found.steps[-1]
        span = top * self.length(subject, name, top)
        at_start, along = (
            predicted(amplification, eigenvalues, span)
            for eigenvalues in (subject.at_start, subject.along)
        )
        counted = self.done
        border, note = self._border(subject, cells, {at_start, along})
        self._count(counted + SEARCH - self.done)
        if not self.pressed:
            more = Border(name, value, border, at_start, along, note)
            self.found.borders.append(more)

    def _border(
        self, subject: Subject, cells: list[Cell], expected: set[float | None]
    ) -> tuple[float | None, str]:
        """Bisect between the first cell that does not hold and the one before it.

        Around a border that is expected cells are added: what lies past it may be
        narrower than those of the map.
        """
        method, value = cells[0].method, cells[0].value
        first, last = _step_of(cells[0]), _step_of(cells[-1])
        if not cells[0].stable:
            return None, f"does not hold at {first:.3g} s either"
        extra = [part * step for step in expected if step for part in AROUND]
        more = [
            self._cell(subject, method, step, value)
            for step in extra
            if first < step < last
        ]
        for before, after in pairwise(sorted([*cells, *more], key=_step_of)):
            if not after.stable:
                low, high = _step_of(before), _step_of(after)
                while high / low > 1.0 + DIGITS and not self.pressed:
                    middle = math.sqrt(low * high)
                    self._count(1)
                    if self._cell(subject, method, middle, value).stable:
                        low = middle
                    else:
                        high = middle
                return high, ""
        return None, f"holds up to {last:.3g} s"

    def _cell(
        self, subject: Subject, name: str, step: float | None, value: float | None
    ) -> Cell:
        steps = 0 if step is None else self.length(subject, name, step)
        try:
            return subject.run(name, step, steps, value)
        except InputError as fault:
            return Cell(name, step, value, FAILS, None, None, reason=_reason(fault))

    def length(self, subject: Subject, name: str, step: float) -> int:
        """Give how many steps a run takes."""
        least, most = self.found.runs[name]
        return min(most, max(least, math.ceil(subject.span / step)))

    def _count(self, cells: int) -> None:
        self.done += cells
        if self.progress is not None:
            self.progress(min(1.0, self.done / self.total))


def _reason(fault: LagsimError) -> str:
    return fault.problems[0].text if isinstance(fault, InputError) else str(fault)


def _step_of(cell: Cell) -> float:
    assert cell.step is not None
    return cell.step


def _rest(subject: Subject) -> Rest:
    """Look for an equilibrium, and the modes about it."""
    e, start = subject.equations, subject.endless.start
    linearisation = subject.linearisation
    if linearisation is None:
        return Rest(None, subject.unknown, is_start=False, modes=())
    try:
        q = find_equilibrium(e, linearisation, start.t, start.q, subject.size)
    except NoEquilibriumError as fault:
        linear: tuple[Mode, ...] = ()
        if structure(e).linear and not subject.unknown:
            linear = modes(linearisation.at(start.t, start.q, start.v))
        return Rest(None, str(fault), is_start=False, modes=linear)
    about = linearisation.at(start.t, q, np.zeros_like(q))
    change = float(np.max(np.abs(q - subject.case.start.q), initial=0.0))
    at_rest = not np.any(subject.case.start.v)
    near = change <= 1e-9 * float(np.max(np.abs(q), initial=0.0))
    return Rest(named(e.q, q), "", is_start=bool(near and at_rest), modes=modes(about))


TABLE = "stability.csv"
MANIFEST = "stability.json"

MEASURED = ("verdict", "growth", "evaluations", "rejections", "smallest_step")


def table(cells: Iterable[Cell], name: str | None) -> bytes:
    """Give the content of stability.csv."""
    varied = [] if name is None else ["value"]
    shown = ["method", "step", *varied, *MEASURED, "duration"]
    rows = ([getattr(cell, key) for key in shown] for cell in cells)
    return table_of([name or key if key == "value" else key for key in shown], rows)


def document(found: Stability, wish: Wish, files: Sequence[str]) -> dict[str, Any]:
    """Give the content of stability.json; keys are only ever added."""
    subject = found.subject
    return {
        **head(subject.equations.model),
        "complete": not found.interrupted,
        "vary": None
        if wish.name is None
        else {"name": wish.name, "values": found.values},
        "steps": found.steps,
        "runs": {
            "steps": {m: {"least": a, "most": b} for m, (a, b) in found.runs.items()},
            "duration": subject.span,
            "perturbation": {
                "energy": KICK,
                "of": "the energy of the motion, put into the velocities so that every "
                "mode takes part",
                "seed": SEED,
            },
            "energy": subject.energy,
        },
        "borders": _borders(found, wish.name),
        "eigenvalues": _eigenvalues(subject),
        **_rest_and_modes(found.rest, subject.equations.q),
        "refused": [refused._asdict() for refused in found.refused],
        "cells": [_entry(cell, wish.name) for cell in found.cells],
        "files": list(files),
    }


def _entry(cell: Cell, name: str | None) -> dict[str, Any]:
    row: dict[str, Any] = {"method": cell.method, "step": cell.step}
    if name is not None:
        row[name] = cell.value
    row |= {key: getattr(cell, key) for key in MEASURED}
    return row | {"duration": cell.duration, "reason": cell.reason}


def prediction(border: Border) -> float | None:
    """Give the smaller of the borders at the start and along the motion."""
    known = [x for x in (border.at_start, border.along) if x is not None]
    return min(known) if known else None


def _borders(found: Stability, name: str | None) -> dict[str, Any]:
    """Give them by method: one mapping, or a list over the parameter's values."""
    by_method: dict[str, Any] = {}
    for border in found.borders:
        entry: dict[str, Any] = {} if name is None else {name: border.value}
        entry |= {
            "found": None if border.found is None else float(f"{border.found:.4g}"),
            "predicted": prediction(border),
            "predicted_at_start": border.at_start,
            "predicted_along": border.along,
            "note": border.note,
        }
        if name is None:
            by_method[border.method] = entry
        else:
            by_method.setdefault(border.method, []).append(entry)
    return by_method


def _eigenvalues(subject: Subject) -> dict[str, Any]:
    def pairs(values: Any) -> list[list[float]]:
        return [[float(x.real), float(x.imag)] for x in values]

    return {
        "at_start": pairs(subject.at_start),
        "along": pairs(subject.along),
        "states": subject.states,
        "unknown": subject.unknown or None,
    }


def _rest_and_modes(rest: Rest, names: Sequence[str]) -> dict[str, Any]:
    equilibrium: dict[str, Any] = {
        "coordinates": rest.at,
        "is_start": rest.is_start,
        "reason": rest.reason or None,
    }
    return {
        "equilibrium": rest.at,
        "equilibrium_is_start": equilibrium["is_start"],
        "equilibrium_reason": equilibrium["reason"],
        "modes": [_mode(mode, names) for mode in rest.modes],
    }


def _mode(mode: Mode, names: Sequence[str]) -> dict[str, Any]:
    return {
        "frequency": mode.frequency,
        "angular_frequency": mode.eigenvalue.imag,
        "period": mode.period,
        "damping_ratio": mode.damping_ratio + 0.0,
        "eigenvalue": [mode.eigenvalue.real, mode.eigenvalue.imag],
        "shape": dict(zip(names, map(float, mode.shape.real + 0.0), strict=True)),
        "shape_imaginary": dict(
            zip(names, map(float, mode.shape.imag + 0.0), strict=True)
        ),
    }


def fastest_period(subject: Subject) -> float | None:
    """Give the period of the fastest oscillation, at the start or along the motion."""
    for values in (subject.at_start, subject.along):
        fastest = float(np.max(np.abs(values.imag), initial=0.0))
        if fastest * subject.span > 1e-3:
            return 2.0 * math.pi / fastest
    return None
