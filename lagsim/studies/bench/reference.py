"""The reference solution of a bench, and how far it is to be trusted.

Two solutions by different means, as tight as double precision allows. What they agree
to is what is known: errors below that are not reported. Where motions part
exponentially that is soon nothing, and errors are those of the rows before.
"""

from __future__ import annotations

import contextlib
import itertools
import time
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from lagsim.errors import InputError, LagsimError
from lagsim.studies.bench.solving import (
    LEAST_RTOL,
    PREFIX,
    GivenUpError,
    Own,
    Patience,
    Scipy,
    Solver,
    scipy_refusal,
)
from lagsim.studies.comparison import IMPACT, moved, range_or_size, within
from lagsim.tolerances import FLAT_RANGE, SAME_STEP

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence

    from lagsim.language.arrays import Floats
    from lagsim.mechanics.equations import Equations
    from lagsim.notes import Event
    from lagsim.run.session import Case

# The first of these that a model lets through makes the reference ...
FIRST = ("taylor", "dop853")
# ... and the one of these that comes closest to it verifies it.
SECOND = ("taylor", "dop853", "kahan-li8", "gauss4", "radau", "rk4")
TOLERANCES = (1e-14, 1e-13, 1e-12, 1e-10, 1e-8, 1e-6)
# Fixed steps are halved this often, from a quarter of a row's spacing on, ...
HALVINGS = 10
# Ranges are those of the motion, not of rows that may lie a period apart.
MOMENTS = 4001
# An agreement this good ends the search for a better one.
GOOD = 1e-12
# One solve may take this part of the time for all of them, or so many seconds where
# there is little; as many there are for what verifies.
ONE, LEAST_SECONDS = 0.25, 5.0
SECONDS = 40.0

# Rows count as known while both agree to this part of each coordinate's range: to the
# first of these that holds for all rows ...
WHOLE = (1e-10, 1e-8, 1e-7)
# ... or else for more than a few of them: so many, or a part where rows are few.
LEVELS = (*WHOLE, 1e-6, 1e-4, 1e-2)
MANY, FEW = 50, 0.1


class NoReferenceError(LagsimError):
    """Nothing can be measured, for there is nothing to measure against (exit 3)."""

    exit_code = 3
    code = "no-reference"


class Solution(NamedTuple):
    """Rows, their columns, and how they were made."""

    how: str
    method: str
    value: float
    columns: tuple[str, ...]
    rows: Floats
    events: Sequence[Event] = ()


def _solved(
    solver: Solver, values: Sequence[float], patience: Patience
) -> Iterator[Solution]:
    """Return the solution at the tightest possible tolerance, or for each step."""
    fixed, left = solver.setting == "step", iter(values)
    for value in left:
        try:
            solved = solver.solve(value, patience)
        except GivenUpError:
            if fixed:
                return
            # A little looser takes as long.
            next(left, None)
            continue
        if solved.rows is not None:
            how = f"{solver.method} at {solver.setting} {value:.3g}"
            rows, events = solved.rows, solved.events
            yield Solution(how, solver.method, value, solver.names, rows, events)
            if not fixed:
                return


def _by_own(case: Case, names: Iterable[str], patience: Patience) -> Iterator[Solution]:
    """Return solutions by methods that are there and can handle the model."""
    steps = [case.settings.output_step / 4 / 2**k for k in range(HALVINGS)]
    for name in names:
        with contextlib.suppress(InputError):
            own = Own(case, name)
            values = TOLERANCES if own.setting == "rtol" else steps
            yield from _solved(own, values, patience)


def _others(case: Case, first: Solution, patience: Patience) -> Iterator[Solution]:
    """Return solutions by other methods; where there are none, by its own."""
    found = _by_own(case, (x for x in SECOND if x != first.method), patience)
    own = index_one(case)
    if not scipy_refusal(own):
        sizes = state_sizes(own, first.rows)
        solver = Scipy(own, f"{PREFIX}DOP853", first.rows[:, 0], sizes)
        found = itertools.chain(found, _solved(solver, (LEAST_RTOL,), patience))
    looser = [x for x in TOLERANCES if x > first.value]
    best = next(found, None)
    if best is None:
        yield from _solved(Own(case, first.method), looser, patience)
    else:
        yield from (best, *found)


def index_one(case: Case) -> Own:
    """Return what has the right-hand side with lambda solved away, and nothing else."""
    return Own(case, "dop853", "drift" if case.equations.rows else "full")


def state_sizes(own: Own, rows: Floats) -> Floats:
    """Return the largest size of each component of y, none of them 0."""
    wanted = [*own.case.equations.q, *own.case.equations.velocities]
    wanted += [x.name for x in own.system.equations.works]
    sizes = np.max(np.abs(rows[:, [own.names.index(x) for x in wanted]]), axis=0)
    return np.where(sizes > 0.0, sizes, np.max(sizes) or 1.0)


@dataclass(frozen=True)
class Reference:
    """Rows that are known, and how well.

    Attributes
    ----------
    columns : tuple of str
        Of the rows.
    made : str
        How they were made.
    state, multipliers : list of int
        Their columns: q and q'; lambda.
    scales : (columns,)
        The range of each column.
    events
        What happened on the way, and when.
    verified : str
        How the rows that they are compared with were made.
    known : int
        So many rows are to be trusted.
    agreement : (columns,)
        Greatest difference of both over these rows, against the range.
    """

    columns: tuple[str, ...]
    made: str
    rows: Floats
    state: list[int]
    multipliers: list[int]
    scales: Floats
    events: Sequence[Event] = ()
    verified: str = ""
    known: int = 0
    agreement: Floats = field(default_factory=lambda: np.zeros(0))

    @property
    def horizon(self) -> float | None:
        """Past this time nothing is known; None if all is."""
        last = self.known - 1
        return float(self.rows[last, 0]) if self.known < len(self.rows) else None

    @property
    def floor(self) -> float:
        """Errors below this cannot be resolved."""
        return float(np.max(self.agreement[self.state]))

    @property
    def trust(self) -> str:
        """Its accuracy and the time up to which it is known, in words."""
        text = f"{self.made}; {self.verified} agrees with it to {self.floor:.1g}"
        if self.horizon is not None:
            end = self.rows[-1, 0]
            text += (
                f" up to t = {self.horizon:.4g} of {end:.4g}, past which the motion "
                "is not known: errors are those of the rows before"
            )
        elif self.floor > LEVELS[-1]:
            text += ": the two disagree, and the errors mean little"
        elif self.floor > WHOLE[0]:
            text += ": smaller errors cannot be resolved"
        return text

    @property
    def rank(self) -> tuple[bool, int, float]:
        """A key that is larger for a better reference."""
        level = next((x for x in LEVELS if self.floor <= x), 1.0)
        whole = self.horizon is None and level in WHOLE
        return whole, int(self.known / level), -self.floor

    def apart(self, rows: Floats, count: int, events: Sequence[Event]) -> Floats:
        """Return how far off the first rows are (count, columns), as parts of ranges.

        Velocities jump at impacts, multipliers at all events: between the times at
        which both runs have one they are not off.
        """
        apart = np.abs(rows[:count] - self.rows[:count]) / self.scales
        velocities = self.state[len(self.state) // 2 :]
        for columns, only in ((velocities, (IMPACT,)), (self.multipliers, ())):
            mine, theirs = (
                [e for e in run if e.kind in only or not only]
                for run in (self.events, events)
            )
            same = within(rows[:count, 0], moved(mine, theirs))
            apart[np.ix_(np.flatnonzero(same), np.array(columns, int))] = 0.0
        return apart

    def against(self, second: Solution) -> Reference:
        """Return the reference that another solution verifies."""
        count = min(len(self.rows), len(second.rows))
        apart = self.apart(second.rows, count, second.events)
        known = _known(np.max(apart[:, self.state], axis=1))
        agreement = np.max(apart[:known], axis=0)
        return replace(self, verified=second.how, known=known, agreement=agreement)

    def errors(
        self, rows: Floats, events: Sequence[Event] = ()
    ) -> tuple[float, float | None]:
        """Return the error of the state, and that of lambda, of rows that are known.

        nan where the times of the rows are others. `events` are those of their run.
        """
        count = min(self.known, len(rows))
        spacing = float(self.rows[min(1, len(self.rows) - 1), 0] - self.rows[0, 0])
        late = np.abs(rows[:count, 0] - self.rows[:count, 0])
        same = late <= SAME_STEP * abs(spacing)
        if count < self.known - 1 or not np.all(same[:-1]):
            return float("nan"), None
        found = np.max(self.apart(rows, count, events)[same], axis=0)
        error, lam = float(np.max(found[self.state])), found[self.multipliers]
        return error, float(np.max(lam)) if len(lam) else None

    def record(self) -> dict[str, Any]:
        """Return what work_precision.json says of it."""
        named = {self.columns[c]: c for c in (*self.state, *self.multipliers)}
        scales = {name: float(self.scales[c]) for name, c in named.items()}
        return {
            "made": self.made,
            "verified": self.verified,
            "trust": self.trust,
            "floor": self.floor,
            "horizon": self.horizon,
            "rows": len(self.rows),
            "known_rows": self.known,
            "agreement": {name: float(self.agreement[c]) for name, c in named.items()},
            "scales": {name: x for name, x in scales.items() if np.isfinite(x)},
        }


def make_reference(
    case: Case,
    seconds: float = SECONDS,
    progress: Callable[[float], None] | None = None,
) -> Reference:
    """Solve as tightly as can be, by different means, and compare.

    Parameters
    ----------
    seconds
        That all of it may take; more only until there are two solutions at all.
    progress
        Is called with the part of them that is spent.

    Raises
    ------
    NoReferenceError
        Where no two solutions can be had.
    """
    began = time.perf_counter()
    patience = Patience(max(ONE * seconds, LEAST_SECONDS))
    first = next(_by_own(case, FIRST, patience), None)
    if first is None:
        text = "nothing to measure errors against: the motion cannot be solved to its "
        text += f"end at any tolerance in {patience.seconds:.3g} s"
        hint = "; `lagsim run` shows where it fails, --budget allows more time"
        raise NoReferenceError(text + hint)
    patience.until = max(began + seconds, time.perf_counter() + LEAST_SECONDS)
    # Rows between those asked for, as tight, are for the ranges.
    own = Own(case.asking(output_step=case.settings.duration / MOMENTS), first.method)
    between = next(_solved(own, (first.value,), patience), first)
    alone = unverified(case.equations, first, between.rows)
    best: Reference | None = None
    for second in _others(case, first, patience):
        found = alone.against(second)
        if best is None or found.rank > best.rank:
            best = found
        if progress is not None:
            progress(min(1.0, (time.perf_counter() - began) / seconds))
        if best.horizon is None and best.floor <= GOOD:
            break
        patience.until = began + seconds
    if best is None:
        text = (
            f"nothing to measure errors against: {first.how} is the only solution found"
        )
        raise NoReferenceError(text)
    return best


def unverified(e: Equations, first: Solution, between: Floats) -> Reference:
    """Return a solution as a reference, with ranges of its rows and those between."""
    state = [first.columns.index(name) for name in (*e.q, *e.velocities)]
    multipliers = [first.columns.index(name) for name in e.multipliers]
    scales = _scales(e, np.concatenate((first.rows, between)), state, multipliers)
    return Reference(
        first.columns, first.how, first.rows, state, multipliers, scales, first.events
    )


def _known(apart: Floats) -> int:
    """Return how many rows are known: all, where nothing better is known."""
    count = len(apart)
    known = {}
    for level in LEVELS:
        lost = np.flatnonzero(~(apart <= level))
        known[level] = int(lost[0]) if len(lost) else count
    if any(known[level] == count for level in WHOLE):
        return count
    enough = max(2.0, min(MANY, FEW * count))
    last = known[LEVELS[-1]]
    otherwise = last if last > 1 else count
    return next((k for k in known.values() if k >= enough), otherwise)


def _scales(
    e: Equations, rows: Floats, state: list[int], multipliers: list[int]
) -> Floats:
    """Return the range of each column; inf for what is not compared.

    One that stays where it is, or only trembles, is measured by the largest of its
    unit, by its own size, or by that of its velocity or position.
    """
    ranges = np.ptp(rows, axis=0)
    sizes = np.maximum(np.max(np.abs(rows), axis=0), ranges)
    scales = np.full(len(sizes), np.inf)
    q, v = np.array(state, int).reshape(2, -1)
    units = np.array([c.unit for c in e.model.coordinates])
    alike = [of[units == unit] for of in (q, v) for unit in set(units)]
    for columns in (*alike, *([column] for column in multipliers)):
        largest = np.max(sizes[columns]) or np.inf
        scales[columns] = range_or_size(ranges[columns], largest, FLAT_RANGE)
    duration = float(np.ptp(rows[:, 0])) or 1.0
    at, rates = scales[q], scales[v]
    scales[q] = np.where(np.isinf(at), rates * duration, at)
    scales[v] = np.where(np.isinf(rates), at / duration, rates)
    return scales
