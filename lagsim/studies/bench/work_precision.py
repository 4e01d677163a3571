"""Work-precision: what each method costs for the error it makes, on one scene."""

from __future__ import annotations

import math
from collections import defaultdict
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lagsim.methods import names
from lagsim.run.observers.ledger import Ledger
from lagsim.studies.bench.front import pareto
from lagsim.studies.bench.reference import index_one, make_reference, state_sizes
from lagsim.studies.bench.scipy_solvers import NAMES as SCIPY
from lagsim.studies.bench.scipy_solvers import Scipy
from lagsim.studies.bench.scipy_solvers import refusal as scipy_refusal
from lagsim.studies.bench.shown import DRIFT
from lagsim.studies.bench.solving import (
    GivenUpError,
    Own,
    Patience,
    asking,
    formulations,
    least,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from lagsim.run.interrupt import Interrupt
    from lagsim.run.session import Case
    from lagsim.studies.bench.reference import Reference
    from lagsim.studies.bench.solving import Solved, Solver

# A solve may last this long, and what `auto` takes for the tightest may take this many
# times: past it, a curve has left the picture.
PATIENCE_SECONDS = 1.0
PATIENCE_TIMES = 30.0

TOLERANCES = (1e-3, 1e-13)
# Fixed steps begin at so many rows, and are halved this often at most ...
LARGEST_STEP = 16
MOST_HALVINGS = 20
# ... or until two halvings do not halve an error that is this small: it is rounding.
STALLED = 1e-6

# Steps too long for a scene may take longest: so many that are too slow end a curve
# that has not begun.
GIVE_UPS = 4

TOO_SLOW = "too slow"

# The errors of state and lambda, energy drift, constraint residual.
Measured = tuple[float | None, float | None, float | None, float | None]
NOTHING: Measured = (None, None, None, None)


@dataclass(frozen=True, slots=True)
class Entry:
    """One solve: a row of the table."""

    method: str
    formulation: str
    setting: str
    value: float
    seconds: float | None
    evaluations: int | None
    error: float | None
    error_lambda: float | None
    energy_drift: float | None
    constraint_residual: float | None
    outcome: str
    chosen: bool
    reason: str = ""

    @property
    def curve(self) -> tuple[str, str]:
        """What it is a point of."""
        return self.method, self.formulation

    @property
    def counts(self) -> bool:
        """Whether it is an answer that others are to be compared with."""
        known = self.error is not None and self.error < 1.0
        return known and self.formulation != DRIFT

    def cost(self, of: str) -> float:
        """Give `seconds` or `evaluations` of a solve that has an answer."""
        cost = self.seconds if of == "seconds" else self.evaluations
        assert cost is not None
        return float(cost)


@dataclass(frozen=True)
class Wish:
    """What is asked for.

    Attributes
    ----------
    methods
        Only these, ours or `scipy:NAME`; None for all.
    tolerances, steps
        Loosest and tightest; steps None for a choice from the scene.
    """

    methods: tuple[str, ...] | None = None
    tolerances: tuple[float, float] = TOLERANCES
    steps: tuple[float, float] | None = None

    def wants(self, name: str) -> bool:
        """Tell whether a method is asked for."""
        return self.methods is None or name in self.methods


class Curve(NamedTuple):
    """A solver and the settings it is to be swept over."""

    solver: Solver
    values: list[float]


class Refused(NamedTuple):
    """A method, in a formulation, that does not apply; `auto` stands for all."""

    method: str
    formulation: str
    reason: str


@dataclass(frozen=True)
class WorkPrecision:
    """Everything measured on one scene.

    Attributes
    ----------
    refused : list of Refused
    compile_seconds : dict
        What making each curve's solver ready took.
    interrupted : bool
        The user ended it; the curves measured so far are whole.
    """

    reference: Reference
    entries: list[Entry]
    refused: list[Refused]
    compile_seconds: dict[tuple[str, str], float]
    interrupted: bool

    def solved(self) -> list[int]:
        """Give the entries that have an answer."""
        return [k for k, e in enumerate(self.entries) if e.error is not None]

    def front(self, of: str) -> list[int]:
        """Give the entries that none beats in error and `seconds` or `evaluations`.

        Errors that the reference cannot tell apart count as equal. Those as large as
        the range are no answer, and rows that drift off the constraints are not one
        that `auto` might give.
        """
        solved = [k for k in self.solved() if self.entries[k].counts]
        floor = self.reference.floor
        points = [
            (max(e.error or 0.0, floor), e.cost(of))
            for e in (self.entries[k] for k in solved)
        ]
        return [solved[k] for k in pareto(points)]

    def curves(self) -> dict[tuple[str, str], list[Entry]]:
        """Give the entries of each method and formulation, from loose to tight."""
        found = defaultdict(list)
        for entry in self.entries:
            found[entry.curve].append(entry)
        return dict(found)


def measure(
    case: Case,
    wish: Wish,
    *,
    interrupt: Interrupt | None = None,
    progress: Callable[[float], None] | None = None,
) -> WorkPrecision:
    """Solve the scene by everything that applies, at every setting.

    Raises
    ------
    NoReferenceError
    GivenUpError
        Interrupted before anything was measured.
    """
    reference = make_reference(case, interrupt)
    auto = Auto(case, decades(wish.tolerances))
    refused: list[Refused] = []
    curves = list(_curves(case, wish, reference, auto, refused))
    total = sum(len(values) for _, values in curves) or 1
    patience = Patience(_patience(auto), interrupt)
    done = 0
    entries: list[Entry] = []
    seconds: dict[tuple[str, str], float] = {}
    for solver, values in curves:
        if patience.pressed:
            break
        curve = solver.method, solver.formulation
        seconds[curve] = solver.compile_seconds
        sweep = _Sweep(solver, auto, reference, patience)
        chosen = auto.chosen.get(curve, {})
        for value in values:
            done += 1
            if patience.pressed or (sweep.over and value not in chosen):
                continue
            entries.append(sweep.entry(value))
            if progress is not None:
                progress(done / total)
    return WorkPrecision(
        reference, entries, refused, seconds, interrupted=patience.pressed
    )


class Auto:
    """What `auto` takes at each tolerance."""

    def __init__(self, case: Case, tolerances: Sequence[float]) -> None:
        self.case = case
        self.tolerances = tolerances
        self.chosen: dict[tuple[str, str], dict[float, float]] = defaultdict(dict)
        for rtol in tolerances:
            plan = asking(case, rtol=rtol).plan()
            value = plan.rtol if plan.step is None else plan.step
            assert value is not None
            self.chosen[plan.method, plan.formulation][value] = rtol
        self._solvers: dict[tuple[str, str], Own] = {}

    def solver(self, curve: tuple[str, str], value: float) -> Own | None:
        """Give what `auto` makes of the scene, where that is this; None elsewhere."""
        rtol = self.chosen.get(curve, {}).get(value)
        if rtol is None:
            return None
        if curve not in self._solvers:
            self._solvers[curve] = Own(self.case, "auto", "auto", rtol)
        return self._solvers[curve]


def _patience(auto: Auto) -> float:
    """Give the seconds that a solve may last."""
    curve, values = next(reversed(auto.chosen.items()))
    value = min(values)
    own = auto.solver(curve, value)
    assert own is not None
    try:
        seconds = own.solve(value, Patience(10 * PATIENCE_SECONDS)).seconds
    except GivenUpError:
        seconds = PATIENCE_SECONDS
    return max(PATIENCE_SECONDS, PATIENCE_TIMES * seconds)


class _Sweep:
    """One solver, from loose to tight, until that makes no more sense."""

    def __init__(
        self, solver: Solver, auto: Auto, reference: Reference, patience: Patience
    ) -> None:
        self.solver, self.auto = solver, auto
        self.reference, self.patience = reference, patience
        self.errors: list[float] = []
        self._given_up = 0

    @property
    def over(self) -> bool:
        """Whether tighter settings would show nothing new."""
        if self._given_up >= (1 if self.errors else GIVE_UPS):
            return True
        if self.solver.setting != "step" or len(self.errors) < 3:
            return False
        before = min(self.errors[:-2])
        return before < STALLED and 2 * min(self.errors[-2:]) > before

    def entry(self, value: float) -> Entry:
        curve = self.solver.method, self.solver.formulation
        own = self.auto.solver(curve, value)
        solver = own or self.solver
        try:
            solved = least(lambda: solver.solve(value, self.patience))
        except GivenUpError:
            self._given_up += 1
            return self._gap(value, chosen=own is not None)
        measured = self._measured(solved)
        if measured[0] is not None:
            self.errors.append(measured[0])
        return Entry(
            *curve,
            self.solver.setting,
            value,
            solved.seconds,
            solved.evaluations,
            *measured,
            solved.outcome,
            own is not None,
            solved.reason,
        )

    def _gap(self, value: float, *, chosen: bool) -> Entry:
        solver = self.solver
        reason = f"given up after {self.patience.seconds:.2g} s"
        return Entry(
            solver.method,
            solver.formulation,
            solver.setting,
            value,
            None,
            None,
            *NOTHING,
            TOO_SLOW,
            chosen,
            reason,
        )

    def _measured(self, solved: Solved) -> Measured:
        rows = solved.rows
        if rows is None:
            return NOTHING
        error, of_lambda = self.reference.errors(rows, solved.events)
        if not math.isfinite(error):
            return NOTHING
        ledger = Ledger(self.reference.columns)
        ledger.add(rows)
        return error, of_lambda, ledger.energy_drift, ledger.constraint_residual


def decades(between: tuple[float, float]) -> list[float]:
    """Give tolerances from the first to the second, both included, ten times apart.

    About ten times, where the ends are not powers of ten from each other.
    """
    first, last = (math.log10(x) for x in between)
    count = round(abs(last - first))
    return [float(f"{10**x:.6g}") for x in np.linspace(first, last, count + 1)]


def halvings(between: tuple[float, float]) -> list[float]:
    """Give steps from the first down to the second, each half the one before."""
    first, last = between
    count = max(0, math.floor(math.log2(first / last) + 1e-9))
    return [first / 2**k for k in range(count + 1)]


def _curves(
    case: Case, wish: Wish, reference: Reference, auto: Auto, refused: list[Refused]
) -> Iterator[Curve]:
    """Give everything that applies; what does not goes to `refused`."""
    tolerances = decades(wish.tolerances)
    largest = LARGEST_STEP * case.settings.output_step
    largest = min(largest, case.settings.duration / 2)
    steps = halvings(wish.steps or (largest, largest / 2**MOST_HALVINGS))
    for name in names():
        if not wish.wants(name):
            continue
        solvers, reasons = formulations(case, name)
        refused += [Refused(name, *why) for why in reasons.items()]
        for own in solvers:
            values = tolerances if own.setting == "rtol" else steps
            more = auto.chosen.get((own.method, own.formulation), {})
            yield Curve(own, sorted({*values, *more}, reverse=True))
    wanted = [name for name in SCIPY if wish.wants(name)]
    if not wanted:
        return
    own = index_one(case)
    if refusal := scipy_refusal(own):
        refused += [Refused(name, "auto", refusal) for name in wanted]
        return
    rows = reference.rows
    sizes = state_sizes(own, rows)
    for name in wanted:
        yield Curve(Scipy(own, name, rows[:, 0], sizes), tolerances)
