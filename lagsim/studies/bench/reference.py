"""The reference solution of a bench, and how far it is to be trusted.

Two solutions by different means, as tight as double precision allows. What they agree
to is what is known: errors below that are not reported. Where motions part
exponentially that is soon nothing, and errors are those of the rows before.
"""

from __future__ import annotations

import itertools
import time
from dataclasses import dataclass
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


def _by_own(case: Case, names: Iterable[str], patience: Patience) -> Iterator[Solution]:
    """Give solutions by methods that are there and can handle the model."""
    for name in names:
        try:
            own = Own(case, name)
        except InputError:
            continue
        yield from _solved(own, _values(own), patience)


def _values(own: Own) -> Sequence[float]:
    """Give tolerances, the tightest first, or steps, each half the one before."""
    if own.setting == "rtol":
        return TOLERANCES
    return [own.case.settings.output_step / 4 / 2**k for k in range(HALVINGS)]


def _others(case: Case, first: Solution, patience: Patience) -> Iterator[Solution]:
    """Give solutions by other methods; where there are none, by its own."""
    names = [name for name in SECOND if name != first.method]
    found = itertools.chain(
        _by_own(case, names, patience), _by_scipy(case, first, patience)
    )
    best = next(found, None)
    if best is not None:
        yield best
        yield from found
        return
    looser = [x for x in TOLERANCES if x > first.value]
    yield from _solved(Own(case, first.method), looser, patience)


def _by_scipy(case: Case, first: Solution, patience: Patience) -> Iterator[Solution]:
    own = index_one(case)
    if not scipy_refusal(own):
        sizes = state_sizes(own, first.rows)
        solver = Scipy(own, f"{PREFIX}DOP853", first.rows[:, 0], sizes)
        yield from _solved(solver, (LEAST_RTOL,), patience)


def index_one(case: Case) -> Own:
    """Give what has the right-hand side with lambda solved away, and nothing else."""
    return Own(case, "dop853", "drift" if case.equations.rows else "full")


def state_sizes(own: Own, rows: Floats) -> Floats:
    """Give the largest size of each component of y, none of them 0."""
    wanted = [*own.case.equations.q, *own.case.equations.velocities]
    wanted += [x.name for x in own.system.equations.works]
    sizes = [float(np.max(np.abs(rows[:, own.names.index(name)]))) for name in wanted]
    whole = max(sizes) or 1.0
    return np.array([size or whole for size in sizes])


def _solved(
    solver: Solver, values: Sequence[float], patience: Patience
) -> Iterator[Solution]:
    """Give the solution at the tightest possible tolerance, or for each step."""
    left = iter(values)
    for value in left:
        try:
            solved = solver.solve(value, patience)
        except GivenUpError:
            if solver.setting == "step":
                return
            # A little looser takes as long.
            next(left, None)
            continue
        if solved.rows is not None:
            how = f"{solver.method} at {solver.setting} {value:.3g}"
            rows, events = solved.rows, solved.events
            yield Solution(how, solver.method, value, solver.names, rows, events)
            if solver.setting == "rtol":
                return


def _between_rows(case: Case, first: Solution, patience: Patience) -> Floats:
    """Give rows between those asked for, too, for the ranges; they are as tight."""
    own = Own(case.asking(output_step=case.settings.duration / MOMENTS), first.method)
    for solution in _solved(own, (first.value,), patience):
        return np.concatenate((first.rows, solution.rows))
    return first.rows


@dataclass(frozen=True)
class Reference:
    """Rows that are known, and how well.

    Attributes
    ----------
    columns : tuple of str
        What the rows are made of.
    made, verified : str
        How the rows, and those they are compared with, were made.
    state, multipliers : list of int
        Their columns: q and q'; lambda.
    scales : (columns,)
        The range of each column.
    known : int
        So many rows are to be trusted.
    agreement : (columns,)
        Greatest difference of both over these rows, against the range.
    events
        What happened on the way, and when.
    """

    columns: tuple[str, ...]
    made: str
    verified: str
    rows: Floats
    state: list[int]
    multipliers: list[int]
    scales: Floats
    known: int
    agreement: Floats
    events: Sequence[Event] = ()

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
    def whole(self) -> bool:
        """True where all rows are known."""
        return self.horizon is None

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
        return self.whole and level in WHOLE, int(self.known / level), -self.floor

    def errors(
        self, rows: Floats, events: Sequence[Event] = ()
    ) -> tuple[float, float | None]:
        """Give the error of the state, and that of lambda, of rows that are known.

        nan where the times of the rows are others. `events` are those of their run.
        """
        count = min(self.known, len(rows))
        spacing = float(self.rows[min(1, len(self.rows) - 1), 0] - self.rows[0, 0])
        apart = np.abs(rows[:count, 0] - self.rows[:count, 0])
        same = apart <= SAME_STEP * abs(spacing)
        if count < self.known - 1 or not np.all(same[:-1]):
            return float("nan"), None
        velocities = self.state[len(self.state) // 2 :]
        apart = differences(
            rows[:count][same], self.rows[:count][same],
            (velocities, self.multipliers), (events, self.events),
        )  # fmt: skip
        found = np.max(apart, axis=0) / self.scales
        worst = float(np.max(found[self.state]))
        lam = found[self.multipliers]
        return worst, float(np.max(lam)) if len(lam) else None

    def record(self) -> dict[str, Any]:
        """Give what work_precision.json says of it."""
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
    now = time.perf_counter()
    patience.until = max(began + seconds, now + LEAST_SECONDS)
    motion = _between_rows(case, first, patience)
    best: Reference | None = None
    for second in _others(case, first, patience):
        found = compared(case.equations, first, second, motion)
        if best is None or found.rank > best.rank:
            best = found
        if progress is not None:
            progress(min(1.0, (time.perf_counter() - began) / seconds))
        if best.whole and best.floor <= GOOD:
            break
        patience.until = began + seconds
    if best is None:
        text = (
            f"nothing to measure errors against: {first.how} is the only solution found"
        )
        raise NoReferenceError(text)
    return best


def compared(
    e: Equations, first: Solution, second: Solution, motion: Floats | None = None
) -> Reference:
    """Give the first of two solutions as a reference; ranges are those of `motion`."""
    columns = first.columns
    state = [columns.index(name) for name in (*e.q, *e.velocities)]
    multipliers = [columns.index(name) for name in e.multipliers]
    count = min(len(first.rows), len(second.rows))
    scales = _scales(e, first.rows if motion is None else motion, state, multipliers)
    apart = differences(
        first.rows[:count], second.rows[:count],
        (state[len(e.q) :], multipliers), (first.events, second.events),
    )  # fmt: skip
    apart /= scales
    known = _known(np.max(apart[:, state], axis=1))
    return Reference(
        columns=columns,
        made=first.how,
        verified=second.how,
        rows=first.rows,
        state=state,
        multipliers=multipliers,
        scales=scales,
        known=known,
        agreement=np.max(apart[:known], axis=0),
        events=first.events,
    )


def _known(apart: Floats) -> int:
    """Give how many rows are known: all, where nothing better is known."""
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


def differences(
    rows: Floats,
    others: Floats,
    jumping: tuple[list[int], list[int]],
    events: tuple[Sequence[Event], Sequence[Event]],
) -> Floats:
    """Give how far apart each value is (k, columns); 0 where times alone are.

    Parameters
    ----------
    jumping
        The columns of velocities, which jump at impacts, and of multipliers, which jump
        at other events, too.
    events
        Of both runs.
    """
    apart = np.abs(rows - others)
    velocities, multipliers = jumping
    for columns, only in ((velocities, (IMPACT,)), (multipliers, ())):
        mine, theirs = (
            [e for e in run if e.kind in only or not only] for run in events
        )
        same = within(rows[:, 0], moved(mine, theirs))
        apart[np.ix_(np.flatnonzero(same), np.array(columns, int))] = 0.0
    return apart


def _scales(
    e: Equations, rows: Floats, state: list[int], multipliers: list[int]
) -> Floats:
    """Give the range of each column; inf for what is not compared.

    One that stays where it is, or only trembles, is measured by the largest of its
    unit, by its own size, or by that of its velocity or position.
    """
    ranges = np.ptp(rows, axis=0)
    sizes = np.maximum(np.max(np.abs(rows), axis=0), ranges)
    scales = np.full(len(sizes), np.inf)
    q, v = (np.array(x, int) for x in (state[: len(e.q)], state[len(e.q) :]))
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
