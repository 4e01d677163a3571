"""Work-precision: what each method costs for the error it makes, on one scene."""

from __future__ import annotations

import math
import time
from collections import defaultdict
from dataclasses import dataclass
from typing import TYPE_CHECKING

from lagsim.run.interrupt import Interrupt
from lagsim.run.observers.ledger import Ledger
from lagsim.studies.bench.front import pareto
from lagsim.studies.bench.reference import make_reference
from lagsim.studies.bench.shown import DRIFT
from lagsim.studies.bench.solving import GivenUpError, Patience, least
from lagsim.studies.bench.wanted import Auto, curves_of, decades

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from lagsim.run.session import Case
    from lagsim.studies.bench.reference import Reference
    from lagsim.studies.bench.solving import Solved
    from lagsim.studies.bench.wanted import Curve, Refused, Wish

# A solve may last this long, and what `auto` takes for the tightest may take this many
# times: past it, a curve has left the picture.
PATIENCE_SECONDS = 1.0
PATIENCE_TIMES = 30.0

# Steps are halved until two halvings do not halve an error that is this small: it is
# rounding.
STALLED = 1e-6

# Steps too long for a scene may take longest: so many that are too slow end a curve
# that has not begun.
GIVE_UPS = 4

TOO_SLOW, OUT_OF_TIME = "too slow", "out of time"
# Of the seconds for everything the part that the reference may take, how many times
# the share of another curve one that `auto` takes has, the least for a curve and the
# part for a solve.
OF_REFERENCE, OF_AUTO, LEAST_SECONDS, ONE = 0.3, 5.0, 0.2, 0.1

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
class WorkPrecision:
    """Everything measured on one scene.

    Attributes
    ----------
    refused : list of Refused
    compile_seconds : dict
        What making each curve's solver ready took.
    interrupted : bool
        The user ended it; the curves measured so far are whole.
    seconds : float
        What all took, of those that it might have taken.
    """

    reference: Reference
    entries: list[Entry]
    refused: list[Refused]
    compile_seconds: dict[tuple[str, str], float]
    interrupted: bool
    seconds: float
    budget: float

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
    began = time.perf_counter()
    told = progress or (lambda _fraction: None)
    interrupt = interrupt or Interrupt()
    refused: list[Refused] = []
    with interrupt.raised():  # there is nothing yet to be kept
        reference = make_reference(
            case, interrupt, OF_REFERENCE * wish.budget,
            lambda x: told(OF_REFERENCE * x),
        )  # fmt: skip
        auto = Auto(case, decades(wish.tolerances))
        told(OF_REFERENCE)
        curves = list(curves_of(case, wish, reference, auto, refused))
        longest = min(_patience(auto), ONE * wish.budget)
    # What `auto` takes comes first, with more time: it must be known.
    order = sorted(range(len(curves)), key=lambda k: curves[k].key not in auto.chosen)
    shares = [OF_AUTO if curves[k].key in auto.chosen else 1.0 for k in order]
    patience = Patience(longest, interrupt)
    entries: dict[int, list[Entry]] = {}
    for done, k in enumerate(order):
        if patience.pressed:
            break
        now = time.perf_counter()
        share = (began + wish.budget - now) * shares[done] / sum(shares[done:])
        patience.until = now + max(share, LEAST_SECONDS)
        sweep = _Sweep(curves[k], auto, reference, patience)
        entries[k] = []

        def swept(sweep: _Sweep = sweep, own: list[Entry] = entries[k]) -> None:
            for part, entry in sweep.entries():
                own.append(entry)
                so_far = sum(shares[:done]) + part * shares[done]  # noqa: B023  (called at once)
                told(OF_REFERENCE + (1.0 - OF_REFERENCE) * so_far / sum(shares))

        interrupt.cut(swept)
    if not patience.pressed:
        told(1.0)
    return WorkPrecision(
        reference=reference,
        entries=[entry for k in sorted(entries) for entry in entries[k]],
        refused=refused,
        compile_seconds={
            curves[k].key: curves[k].solver.compile_seconds for k in sorted(entries)
        },
        interrupted=patience.pressed,
        seconds=time.perf_counter() - began,
        budget=wish.budget,
    )


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
        self, curve: Curve, auto: Auto, reference: Reference, patience: Patience
    ) -> None:
        self.curve, self.auto = curve, auto
        self.solver = curve.solver
        self.reference, self.patience = reference, patience
        self.errors: list[float] = []
        self._given_up = 0

    def entries(self) -> Iterator[tuple[float, Entry]]:
        """Solve at one setting after the other; give the part done, too."""
        chosen = self.auto.chosen.get(self.curve.key, {})
        for done, value in enumerate(self.curve.values, start=1):
            if self.patience.pressed:
                return
            if value in chosen or not self.over:
                yield done / len(self.curve.values), self.entry(value)

    @property
    def over(self) -> bool:
        """Whether tighter settings would show nothing new, or nobody can wait."""
        if self._given_up and self.patience.over:
            return True
        if self._given_up >= (1 if self.errors else GIVE_UPS):
            return True
        if self.solver.setting != "step" or len(self.errors) < 3:
            return False
        before = min(self.errors[:-2])
        return before < STALLED and 2 * min(self.errors[-2:]) > before

    def entry(self, value: float) -> Entry:
        curve = self.curve.key
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
        outcome, reason = TOO_SLOW, f"given up after {self.patience.seconds:.2g} s"
        if self.patience.over:
            outcome, reason = OUT_OF_TIME, "its share of the time was used up"
        return Entry(
            *self.curve.key,
            self.solver.setting,
            value,
            None,
            None,
            *NOTHING,
            outcome,
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
