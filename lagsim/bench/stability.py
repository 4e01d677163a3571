"""Where each method holds and where it fails: a map over steps and a parameter."""

from __future__ import annotations

import contextlib
import math
from dataclasses import dataclass, field
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lagsim.bench.borders import predicted
from lagsim.bench.trial import FAILS, Cell, Subject
from lagsim.equilibrium import (
    Mode,
    NoEquilibriumError,
    find_equilibrium,
    modes,
    named,
)
from lagsim.errors import InputError, LagsimError, Problem
from lagsim.methods import method as method_named
from lagsim.methods import names
from lagsim.structure import structure

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from lagsim.bench.solving import Scene
    from lagsim.interrupt import Interrupt

    SceneAt = Callable[[float | None], Scene]

# Cells of a strip, and of a map: steps, values of the parameter.
STRIP = 48
MAP = (24, 16)
# Runs that find a border, besides.
SEARCH = 14
# A border is known to three digits.
DIGITS = 2e-4
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


@dataclass(frozen=True)
class Wish:
    """What is asked for.

    Attributes
    ----------
    methods
        Only these; None for all that apply.
    steps
        Smallest and largest; None for a choice from the scene.
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


class Refused(NamedTuple):
    """A method that does not apply."""

    method: str
    reason: str


class NotMadeError(LagsimError):
    """There is nothing to look at (exit 3)."""

    exit_code = 3


@dataclass
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
    """Everything found out about one scene.

    Attributes
    ----------
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
    rest: Rest
    methods: tuple[str, ...]
    adaptive: tuple[str, ...]
    steps: list[float]
    values: list[float | None]
    usual: float | None
    runs: dict[str, tuple[int, int]]
    cells: list[Cell] = field(default_factory=list)
    borders: list[Border] = field(default_factory=list)
    refused: list[Refused] = field(default_factory=list)
    interrupted: bool = False

    def of(self, method: str) -> list[Cell]:
        """Give the cells of a method, in order."""
        return [cell for cell in self.cells if cell.method == method]


def measure(
    scene_at: SceneAt,
    wish: Wish,
    *,
    interrupt: Interrupt | None = None,
    progress: Callable[[float], None] | None = None,
) -> Stability:
    """Run a scene by each method over the range of steps; find the borders.

    Parameters
    ----------
    scene_at
        Gives the scene at a value of the parameter; with None as the file has it.

    Raises
    ------
    InputError
    """
    scene = scene_at(None)
    subject = Subject(scene, interrupt)
    fixed, adaptive, refused = _methods(scene, wish)
    values: list[float | None] = [None]
    if wish.between is not None:
        values = list(spaced(wish.between, wish.map[1]))
    subjects = [subject, *_ends(scene_at, values, interrupt)]
    steps = _steps(subjects, fixed, wish)
    count = len(values) * len(fixed) * (len(steps) + SEARCH)
    runs = {name: _runs(subject, name, steps, BUDGET / count) for name in fixed}
    found = Stability(
        subject, _rest(subject), fixed, adaptive, steps, values,
        _usual(scene, wish.name), runs, refused=refused,
    )  # fmt: skip
    work = _Work(found, interrupt, progress, count + len(values) * len(adaptive))
    for value in values:
        if work.pressed:
            break
        work.column(scene_at, subject, value)
    found.interrupted = work.pressed
    order = {name: k for k, name in enumerate((*fixed, *adaptive))}
    found.cells.sort(key=lambda cell: order[cell.method])
    found.borders.sort(key=lambda border: order[border.method])
    return found


class _Work:
    """The runs, one after the other."""

    def __init__(
        self,
        found: Stability,
        interrupt: Interrupt | None,
        progress: Callable[[float], None] | None,
        total: int,
    ) -> None:
        self.found, self.interrupt, self.progress = found, interrupt, progress
        self.total, self.done = total, 0

    @property
    def pressed(self) -> bool:
        return self.interrupt is not None and self.interrupt.signal is not None

    def column(self, scene_at: SceneAt, usual: Subject, value: float | None) -> None:
        """Run every method at one value of the parameter."""
        found = self.found
        subject = usual
        if value is not None:
            try:
                subject = Subject(scene_at(value), self.interrupt)
            except LagsimError as fault:
                self._without(value, fault)
                return
        for name in found.methods:
            if self.pressed:
                return
            self._strip(subject, name, value)
        for name in found.adaptive:
            if self.pressed:
                return
            cell = self._cell(subject, name, None, value)
            found.cells += [] if self.pressed else [cell]
            self._count(1)

    def _without(self, value: float, fault: LagsimError) -> None:
        reason = str(fault)
        if isinstance(fault, InputError):
            reason = fault.problems[0].text
        for name in self.found.methods:
            self.found.cells += [
                Cell(name, step, value, FAILS, None, None, reason=reason)
                for step in self.found.steps
            ]
            self.found.borders.append(Border(name, value, None, None, None, reason))
        self.found.cells += [
            Cell(name, None, value, FAILS, None, None, reason=reason)
            for name in self.found.adaptive
        ]

    def _strip(self, subject: Subject, name: str, value: float | None) -> None:
        cells = []
        for step in self.found.steps:
            cell = self._cell(subject, name, step, value)
            if self.pressed:
                return
            cells.append(cell)
            self._count(1)
        self.found.cells += cells
        border, note = self._border(subject, name, cells)
        self._count(SEARCH)
        if self.pressed:
            return
        amplification = method_named(name).amplification
        top = self.found.steps[-1]
        span = top * self.length(subject, name, top)
        at_start, along = (
            predicted(amplification, eigenvalues, span)
            for eigenvalues in (subject.at_start, subject.along)
        )
        self.found.borders.append(Border(name, value, border, at_start, along, note))

    def _border(
        self, subject: Subject, name: str, cells: list[Cell]
    ) -> tuple[float | None, str]:
        """Bisect between the first cell that does not hold and the one before it."""
        if not cells[0].stable:
            return None, f"it does not hold at {cells[0].step:.3g} either"
        for before, after in pairwise(cells):
            assert before.step is not None and after.step is not None
            if not after.stable:
                low, high = before.step, after.step
                while high / low > 1.0 + DIGITS and not self.pressed:
                    middle = math.sqrt(low * high)
                    if self._cell(subject, name, middle, before.value).stable:
                        low = middle
                    else:
                        high = middle
                return high, ""
        return None, f"it holds up to {cells[-1].step:.3g}"

    def _cell(
        self, subject: Subject, name: str, step: float | None, value: float | None
    ) -> Cell:
        steps = 0
        if step is not None:
            steps = self.length(subject, name, step)
        try:
            return subject.run(name, step, steps, value)
        except InputError as fault:
            reason = fault.problems[0].text
            return Cell(name, step, value, FAILS, None, None, reason=reason)

    def length(self, subject: Subject, name: str, step: float) -> int:
        """Give how many steps a run takes."""
        least, most = self.found.runs[name]
        return min(most, max(least, math.ceil(subject.span / step)))

    def _count(self, cells: int) -> None:
        self.done += cells
        if self.progress is not None:
            self.progress(min(1.0, self.done / max(1, self.total)))


def _methods(
    scene: Scene, wish: Wish
) -> tuple[tuple[str, ...], tuple[str, ...], list[Refused]]:
    """Give those of fixed steps, those of chosen steps, and those that refuse.

    Raises
    ------
    InputError
        Where one that was asked for cannot be looked at.
    """
    found: dict[bool, list[str]] = {False: [], True: []}
    refused = []
    problems = []
    kind = structure(scene.equations)
    for name in wish.methods or names():
        module = method_named(name)
        reason = module.refusal(kind)
        if reason:
            text = f"`{name}` cannot handle this model: {reason}"
            problems.append(Problem("method-refused", text))
            refused.append(Refused(name, reason))
        elif module.ADAPTIVE and wish.name is None:
            text = f"`{name}` chooses its steps: there is no border of them"
            hint = "--vary shows how its work changes with a parameter"
            problems.append(Problem("adaptive-method", text, hint=hint))
        else:
            found[bool(module.ADAPTIVE)].append(name)
    if wish.methods is not None and problems:
        raise InputError(problems)
    return tuple(found[False]), tuple(found[True]), refused


def _runs(
    subject: Subject, name: str, steps: list[float], budget: float
) -> tuple[int, int]:
    """Give the least and the largest number of steps that a run may cost."""
    pilot = subject.run(name, steps[len(steps) // 2], PILOT, None)
    evaluations = (pilot.evaluations or PILOT) / PILOT
    n = len(subject.equations.q)
    solving = (2 * n) ** 3 if method_named(name).NEEDS not in ((), ("power",)) else 0
    cost = evaluations * (subject.evaluation() + 50) + OVERHEAD + solving
    affordable = int(budget / cost)
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


def _usual(scene: Scene, name: str | None) -> float | None:
    known = {p.name: p.value for p in scene.equations.model.parameters}
    return None if name is None else known[name]


def _ends(
    scene_at: SceneAt, values: list[float | None], interrupt: Interrupt | None
) -> Iterator[Subject]:
    """Give the scene at both ends of the parameter's range, where it can be had."""
    for value in (values[0], values[-1]):
        if value is not None:
            with contextlib.suppress(LagsimError):
                yield Subject(scene_at(value), interrupt)


def _steps(
    subjects: list[Subject], methods: tuple[str, ...], wish: Wish
) -> list[float]:
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


def _rest(subject: Subject) -> Rest:
    """Look for an equilibrium, and the modes about it."""
    e, start, linearisation = subject.equations, subject.start, subject.linearisation
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
    change = float(np.max(np.abs(q - subject.scene.start.q), initial=0.0))
    at_rest = not np.any(subject.scene.start.v)
    near = change <= 1e-9 * float(np.max(np.abs(q), initial=0.0))
    return Rest(named(e.q, q), "", is_start=bool(near and at_rest), modes=modes(about))
