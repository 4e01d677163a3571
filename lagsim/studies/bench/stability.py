"""Where each method holds and where it fails: a map over steps and a parameter."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from lagsim.errors import InputError, LagsimError
from lagsim.mechanics.equilibrium import (
    Mode,
    NoEquilibriumError,
    find_equilibrium,
    modes,
    named,
)
from lagsim.mechanics.structure import structure
from lagsim.methods import method as method_named
from lagsim.run.interrupt import Interrupt
from lagsim.studies.bench.borders import predicted
from lagsim.studies.bench.scope import (
    SEARCH,
    methods_for,
    runs_for,
    spaced,
    steps_for,
    subjects_at_ends,
    usual_value,
)
from lagsim.studies.bench.trial import FAILS, Cell, Subject

if TYPE_CHECKING:
    from collections.abc import Callable

    from lagsim.studies.bench.scope import CaseAt, Refused, Wish

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


@dataclass(frozen=True)
class _Asked:
    """What is to be run.

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
    methods: tuple[str, ...]
    adaptive: tuple[str, ...]
    refused: list[Refused]
    steps: list[float]
    values: list[float | None]
    usual: float | None
    runs: dict[str, tuple[int, int]]


@dataclass(frozen=True)
class Stability(_Asked):
    """Everything found out about one scene."""

    rest: Rest
    cells: list[Cell]
    borders: list[Border]
    interrupted: bool

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
    """Run a scene by each method over the range of steps; find the borders.

    Parameters
    ----------
    case_at
        Gives the scene at a value of the parameter; with None as the file has it.

    Raises
    ------
    InputError
    """
    interrupt = interrupt or Interrupt()
    with interrupt.raised():  # there is nothing yet to be kept
        asked = _asked(case_at, wish, interrupt)
        rest = _rest(asked.subject)
    fixed, values = asked.methods, asked.values
    count = len(values) * len(fixed) * (len(asked.steps) + SEARCH)
    count += len(values) * len(asked.adaptive)
    work = _Work(asked, interrupt, progress, count)
    interrupt.cut(lambda: work.columns(case_at))
    order = {name: k for k, name in enumerate((*fixed, *asked.adaptive))}
    return Stability(
        **vars(asked),
        rest=rest,
        cells=sorted(work.cells, key=lambda cell: order[cell.method]),
        borders=sorted(work.borders, key=lambda border: order[border.method]),
        interrupted=work.pressed,
    )


def _asked(case_at: CaseAt, wish: Wish, interrupt: Interrupt) -> _Asked:
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
    return _Asked(
        subject, fixed, adaptive, refused, steps, values,
        usual_value(case, wish.name), runs,
    )  # fmt: skip


class _Work:
    """The runs, one after the other."""

    def __init__(
        self,
        asked: _Asked,
        interrupt: Interrupt,
        progress: Callable[[float], None] | None,
        total: int,
    ) -> None:
        self.asked, self.interrupt, self.progress = asked, interrupt, progress
        self.total, self.done = total, 0
        self.cells: list[Cell] = []
        self.borders: list[Border] = []

    @property
    def pressed(self) -> bool:
        return self.interrupt.asked

    def columns(self, case_at: CaseAt) -> None:
        """Run every method at every value of the parameter."""
        for value in self.asked.values:
            self._column(case_at, value)

    def _column(self, case_at: CaseAt, value: float | None) -> None:
        """Run every method at one value of the parameter."""
        subject = self.asked.subject
        if value is not None:
            try:
                subject = Subject(case_at(value), self.interrupt)
            except LagsimError as fault:
                self._without(value, fault)
                return
        for name in self.asked.methods:
            if self.pressed:
                return
            self._strip(subject, name, value)
        for name in self.asked.adaptive:
            if self.pressed:
                return
            cell = self._cell(subject, name, None, value)
            self.cells += [] if self.pressed else [cell]
            self._count(1)

    def _without(self, value: float, fault: LagsimError) -> None:
        reason = str(fault)
        if isinstance(fault, InputError):
            reason = fault.problems[0].text
        for name in self.asked.methods:
            self.cells += [
                Cell(name, step, value, FAILS, None, None, reason=reason)
                for step in self.asked.steps
            ]
            self.borders.append(Border(name, value, None, None, None, reason))
        self.cells += [
            Cell(name, None, value, FAILS, None, None, reason=reason)
            for name in self.asked.adaptive
        ]

    def _strip(self, subject: Subject, name: str, value: float | None) -> None:
        cells = []
        for step in self.asked.steps:
            cell = self._cell(subject, name, step, value)
            if self.pressed:
                return
            cells.append(cell)
            self._count(1)
        self.cells += cells
        amplification = method_named(name).amplification
        top = self.asked.steps[-1]
        span = top * self.length(subject, name, top)
        at_start, along = (
            predicted(amplification, eigenvalues, span)
            for eigenvalues in (subject.at_start, subject.along)
        )
        counted = self.done
        border, note = self._border(subject, cells, {at_start, along})
        self._count(counted + SEARCH - self.done)
        if not self.pressed:
            self.borders.append(Border(name, value, border, at_start, along, note))

    def _border(
        self, subject: Subject, cells: list[Cell], expected: set[float | None]
    ) -> tuple[float | None, str]:
        """Bisect between the first cell that does not hold and the one before it.

        Around a border that is expected cells are added: what lies past it may be
        narrower than those of the map.
        """
        first, last = cells[0], cells[-1]
        assert first.step is not None
        assert last.step is not None
        if not first.stable:
            return None, f"does not hold at {first.step:.3g} s either"
        extra = [part * step for step in expected if step for part in AROUND]
        more = [
            self._cell(subject, first.method, step, first.value)
            for step in extra
            if first.step < step < last.step
        ]
        for before, after in pairwise(sorted([*cells, *more], key=_step_of)):
            if not after.stable:
                low, high = _step_of(before), _step_of(after)
                while high / low > 1.0 + DIGITS and not self.pressed:
                    middle = math.sqrt(low * high)
                    self._count(1)
                    if self._cell(subject, first.method, middle, first.value).stable:
                        low = middle
                    else:
                        high = middle
                return high, ""
        return None, f"holds up to {last.step:.3g} s"

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
        least, most = self.asked.runs[name]
        return min(most, max(least, math.ceil(subject.span / step)))

    def _count(self, cells: int) -> None:
        self.done += cells
        if self.progress is not None:
            self.progress(min(1.0, self.done / max(1, self.total)))


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
