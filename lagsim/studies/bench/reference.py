"""What errors are measured against, and how far it is to be trusted.

Two solutions by different means, as tight as double precision allows. What they agree
to is what is known; where motions part exponentially that is soon nothing, and errors
are those of the rows before.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from lagsim.errors import InputError, LagsimError
from lagsim.studies.bench.scipy_solvers import PREFIX, Scipy
from lagsim.studies.bench.scipy_solvers import refusal as scipy_refusal
from lagsim.studies.bench.solving import GivenUpError, Own, Patience, Solver
from lagsim.studies.moved import IMPACT, moved, within

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from lagsim.language.arrays import Floats
    from lagsim.mechanics.equations import Equations
    from lagsim.notes import Event
    from lagsim.run.interrupt import Interrupt
    from lagsim.run.session import Case

# The first of these that a scene lets through makes the reference ...
FIRST = ("exponential", "taylor", "dop853")
# ... and the one of these that comes closest to it verifies it.
SECOND = ("taylor", "dop853", "kahan-li8", "gauss4", "radau", "rk4")
TOLERANCES = (1e-14, 1e-13, 1e-12)
SCIPY_TOLERANCE = 3e-14
# Fixed steps are halved this often, from a quarter of a row's spacing on, ...
HALVINGS = 10
# ... until an agreement this good ends the search.
GOOD = 1e-12
SECONDS = 5.0

# Rows count as known while both agree to this part of each coordinate's range.
TRUSTED = 1e-10
# A range that is this small beside others of its unit is that of rounding errors.
NOISE = 1e-11


class NoReferenceError(LagsimError):
    """Nothing can be measured, for there is nothing to measure against (exit 3)."""

    exit_code = 3


@dataclass(frozen=True, slots=True)
class Solution:
    """Rows, what their columns are, and how they were made."""

    how: str
    method: str
    columns: tuple[str, ...]
    rows: Floats
    events: Sequence[Event] = ()


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
        """Errors below this cannot be told."""
        return float(np.max(self.agreement[self.state]))

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


def make_reference(case: Case, interrupt: Interrupt | None = None) -> Reference:
    """Solve as tightly as can be, by different means, and compare.

    Raises
    ------
    NoReferenceError
        Where not two solutions can be had, or they have nothing in common.
    """
    patience = Patience(SECONDS, interrupt)
    first = next(_first(case, patience), None)
    if first is None:
        text = "nothing to measure errors against: the motion cannot be solved to its "
        text += "end as tightly as double precision allows"
        raise NoReferenceError(text)
    best: Reference | None = None
    for second in _verifiers(case, first, patience):
        found = _compared(case.equations, first, second)
        if best is None or (found.known, -found.floor) > (best.known, -best.floor):
            best = found
        if best.horizon is None and best.floor <= GOOD:
            break
    if best is None or best.known < 2:
        text = f"nothing to measure errors against: {first.how} is not confirmed"
        raise NoReferenceError(text)
    return best


def _compared(e: Equations, first: Solution, second: Solution) -> Reference:
    columns = first.columns
    state = [columns.index(name) for name in (*e.q, *e.velocities)]
    multipliers = [columns.index(name) for name in e.multipliers]
    count = min(len(first.rows), len(second.rows))
    a, b = first.rows[:count], second.rows[:count]
    scales = _scales(e, first.rows, state, multipliers)
    jumping = state[len(e.q) :], multipliers
    apart = differences(a, b, jumping, (first.events, second.events)) / scales
    lost = np.flatnonzero(np.max(apart[:, state], axis=1) > TRUSTED)
    known = int(lost[0]) if len(lost) else count
    agreement = np.max(apart[: max(known, 1)], axis=0)
    return Reference(
        columns=columns,
        made=first.how,
        verified=second.how,
        rows=first.rows,
        state=state,
        multipliers=multipliers,
        scales=scales,
        known=known,
        agreement=agreement,
        events=first.events,
    )


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


def _first(case: Case, patience: Patience) -> Iterator[Solution]:
    for name in FIRST:
        if own := _able(case, name):
            yield from _solved(own, TOLERANCES, patience)


def _able(case: Case, name: str) -> Own | None:
    """Give a method that is there and can handle the scene."""
    try:
        return Own(case, name)
    except InputError:
        return None


def _verifiers(case: Case, first: Solution, patience: Patience) -> Iterator[Solution]:
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
    wanted += ["work"] if own.system.has_work else []
    sizes = [float(np.max(np.abs(rows[:, own.names.index(name)]))) for name in wanted]
    whole = max(sizes) or 1.0
    return np.array([size or whole for size in sizes])


def _solved(
    solver: Solver, values: Sequence[float], patience: Patience
) -> Iterator[Solution]:
    """Give the solution at the tightest tolerance that can be met, or for each step."""
    for value in values:
        try:
            solved = solver.solve(value, patience)
        except GivenUpError:
            if patience.pressed:
                raise
            if solver.setting == "step":
                return
            continue
        if solved.rows is not None:
            how = f"{solver.method} at {solver.setting} {value:.3g}"
            rows, events = solved.rows, solved.events
            yield Solution(how, solver.method, solver.names, rows, events)
            if solver.setting == "rtol":
                return


def _steps(own: Own) -> list[float]:
    """Give steps for a method that has no tolerance, each half the one before."""
    return [own.case.settings.output_step / 4 / 2**k for k in range(HALVINGS)]


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
    duration = float(rows[-1, 0] - rows[0, 0]) or 1.0
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
