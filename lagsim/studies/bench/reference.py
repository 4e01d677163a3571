"""What errors are measured against, and how far it is to be trusted.

Two solutions by different means, as tight as double precision allows. What they agree
to is what is known: errors below that are not reported. Where motions part
exponentially that is soon nothing, and errors are those of the rows before.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from lagsim.errors import InputError, LagsimError
from lagsim.studies.bench.solving import (
    PREFIX,
    GivenUpError,
    Own,
    Patience,
    Scipy,
    Solver,
    scipy_refusal,
)
from lagsim.studies.comparison import IMPACT, moved, within

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from lagsim.language.arrays import Floats
    from lagsim.mechanics.equations import Equations
    from lagsim.notes import Event
    from lagsim.run.interrupt import Interrupt
    from lagsim.run.session import Case

# The first of these that a model lets through makes the reference ...
FIRST = ("taylor", "dop853")
# ... and the one of these that comes closest to it verifies it.
SECOND = ("taylor", "dop853", "kahan-li8", "gauss4", "radau", "rk4")
TOLERANCES = (1e-14, 1e-13, 1e-12, 1e-10, 1e-8, 1e-6)
SCIPY_TOLERANCE = 3e-14
# Fixed steps are halved this often, from a quarter of a row's spacing on, ...
HALVINGS = 10
# Ranges are those of the motion, not of rows that may lie a period apart.
MOMENTS = 4001


@dataclass(frozen=True, slots=True)
class Solution:
    """Rows, what their columns are, and how they were made."""

    how: str
    method: str
    value: float
    columns: tuple[str, ...]
    rows: Floats
    events: Sequence[Event] = ()


def tightest(case: Case, patience: Patience) -> Iterator[Solution]:
    """Give solutions, the tightest first."""
    for name in FIRST:
        if own := _able(case, name):
            yield from _solved(own, TOLERANCES, patience)


def _able(case: Case, name: str) -> Own | None:
    """Give a method that is there and can handle the model."""
    try:
        return Own(case, name)
    except InputError:
        return None


def others(case: Case, first: Solution, patience: Patience) -> Iterator[Solution]:
    """Give solutions by other methods; where there are none, by its own."""
    found = False
    for solution in _by_others(case, first, patience):
        found = True
        yield solution
    if not found and (own := _able(case, first.method)):
        steps = own.setting == "step"
        values = (
            _steps(own)[:1] if steps else [x for x in TOLERANCES if x > first.value]
        )
        yield from _solved(own, values, patience)


def _by_others(case: Case, first: Solution, patience: Patience) -> Iterator[Solution]:
    for name in SECOND:
        if name != first.method and (own := _able(case, name)):
            values = _steps(own) if own.setting == "step" else TOLERANCES
            yield from _solved(own, values, patience)
    yield from _by_scipy(case, first, patience)


def _by_scipy(case: Case, first: Solution, patience: Patience) -> Iterator[Solution]:
    own = index_one(case)
    if not scipy_refusal(own):
        sizes = state_sizes(own, first.rows)
        solver = Scipy(own, f"{PREFIX}DOP853", first.rows[:, 0], sizes)
        yield from _solved(solver, (SCIPY_TOLERANCE,), patience)


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
            if patience.pressed:
                raise
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


def _steps(own: Own) -> list[float]:
    """Give steps for a method that has no tolerance, each half the one before."""
    return [own.case.settings.output_step / 4 / 2**k for k in range(HALVINGS)]


def between_rows(case: Case, first: Solution, patience: Patience) -> Floats:
    """Give rows between those asked for, too, for the ranges; they are as tight."""
    between = case.asking(output_step=case.settings.duration / MOMENTS)
    if own := _able(between, first.method):
        for solution in _solved(own, (first.value,), patience):
            return np.concatenate((first.rows, solution.rows))
    return first.rows


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
# A range that is this small beside others of its unit is that of rounding errors.
NOISE = 1e-11


class NoReferenceError(LagsimError):
    """Nothing can be measured, for there is nothing to measure against (exit 3)."""

    exit_code = 3
    code = "no-reference"


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
        """Whether all rows are known."""
        return self.horizon is None

    @property
    def trust(self) -> str:
        """How far it is to be trusted, in words."""
        said = f"{self.made}; {self.verified} agrees with it to {self.floor:.1g}"
        if self.horizon is not None:
            end = self.rows[-1, 0]
            said += (
                f" up to t = {self.horizon:.4g} of {end:.4g}, past which the motion "
                "is not known: errors are those of the rows before"
            )
        elif self.floor > LEVELS[-1]:
            said += ": the two disagree, and the errors mean little"
        elif self.floor > WHOLE[0]:
            said += ": smaller errors cannot be resolved"
        return said

    def errors(
        self, rows: Floats, events: Sequence[Event] = ()
    ) -> tuple[float, float | None]:
        """Give the error of the state, and that of lambda, of rows that are known.

        nan where the times of the rows are others. `events` are those of their run.
        """
        count = min(self.known, len(rows))
        spacing = float(self.rows[min(1, len(self.rows) - 1), 0] - self.rows[0, 0])
        apart = np.abs(rows[:count, 0] - self.rows[:count, 0])
        same = apart <= 1e-9 * abs(spacing)
        if count < self.known - 1 or not np.all(same[:-1]):
            return float("nan"), None
        apart = self._apart(rows[:count][same], self.rows[:count][same], events)
        found = np.max(apart, axis=0) / self.scales
        worst = float(np.max(found[self.state]))
        lam = found[self.multipliers]
        return worst, float(np.max(lam)) if len(lam) else None

    def _apart(self, rows: Floats, others: Floats, events: Sequence[Event]) -> Floats:
        velocities = self.state[len(self.state) // 2 :]
        jumping = velocities, self.multipliers
        return differences(rows, others, jumping, (events, self.events))


def make_reference(
    case: Case,
    interrupt: Interrupt | None = None,
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
    patience = Patience(max(ONE * seconds, LEAST_SECONDS), interrupt)
    first = next(tightest(case, patience), None)
    if first is None:
        text = "nothing to measure errors against: the motion cannot be solved to its "
        text += f"end at any tolerance in {patience.seconds:.3g} s"
        hint = "; `lagsim run` shows where it fails, --budget allows more time"
        raise NoReferenceError(text + hint)
    now = time.perf_counter()
    patience.until = max(began + seconds, now + LEAST_SECONDS)
    motion = between_rows(case, first, patience)
    best: Reference | None = None
    for second in others(case, first, patience):
        found = _compared(case.equations, first, second, motion)
        if best is None or _rank(found) > _rank(best):
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


def _rank(found: Reference) -> tuple[bool, int, float]:
    """Give what is larger for a better reference."""
    level = next((x for x in LEVELS if found.floor <= x), 1.0)
    return found.whole and level in WHOLE, int(found.known / level), -found.floor


def _compared(
    e: Equations, first: Solution, second: Solution, motion: Floats | None = None
) -> Reference:
    columns = first.columns
    state = [columns.index(name) for name in (*e.q, *e.velocities)]
    multipliers = [columns.index(name) for name in e.multipliers]
    count = min(len(first.rows), len(second.rows))
    a, b = first.rows[:count], second.rows[:count]
    scales = _scales(e, first.rows if motion is None else motion, state, multipliers)
    jumping = state[len(e.q) :], multipliers
    apart = differences(a, b, jumping, (first.events, second.events)) / scales
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
    n = len(e.q)
    ranges = np.ptp(rows, axis=0)
    scales = np.full(rows.shape[1], np.inf)
    units = [c.unit for c in e.model.coordinates]
    duration = float(np.ptp(rows[:, 0])) or 1.0
    for columns in (state[:n], state[n:]):
        for unit in set(units):
            alike = [c for c, u in zip(columns, units, strict=True) if u == unit]
            _fill(scales, ranges, rows, alike)
    for q, v in zip(state[:n], state[n:], strict=True):
        if not np.isfinite(scales[q]) and np.isfinite(scales[v]):
            scales[q] = scales[v] * duration
        elif not np.isfinite(scales[v]) and np.isfinite(scales[q]):
            scales[v] = scales[q] / duration
    for column in multipliers:
        _fill(scales, ranges, rows, [column])
    return scales


def _fill(scales: Floats, ranges: Floats, rows: Floats, alike: list[int]) -> None:
    largest = float(max(np.max(np.abs(rows[:, alike])), np.max(ranges[alike])))
    for column in alike:
        wide = ranges[column] > NOISE * largest
        scale = ranges[column] if wide else largest
        if scale > 0.0:
            scales[column] = scale
