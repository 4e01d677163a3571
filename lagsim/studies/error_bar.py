"""The error of a run, estimated by the difference from a repeat by other means.

A local error says little of the motion: the estimate is the difference of two whole
runs, so that it knows how errors grow on the way. A repeat with the same steps would
have the same blind spots: what one step passes over, and what a step at the bound of
stability is off by, is then no difference. So it is made at a hundredth of the
tolerance, and in steps that are forced to be others: none is longer than a part of the
output step, nor, where the method is the same, than a part of the run's own; and by
another method where something might hide from this one's steps. Where the tolerance is
as tight as any, the repeat's is looser. The counts of both runs are compared: a repeat
that has made the run's own steps is no estimate, and another is made.

The repeat costs a few times the run. Costs are counted in operations, never in seconds,
so that a rerun gives the same result: every repeat may cost some times the run; and all
of them together, with what is repeated besides, no more than an allowance that the run
itself sets.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

import numpy as np

from lagsim.language.evaluate import BALANCED, evaluate
from lagsim.plan.plan import ANY
from lagsim.run.arc import SERIES
from lagsim.run.error import LOST, ErrorBar, Failed
from lagsim.run.interrupt import MOST_STEPS
from lagsim.run.observers import Observer
from lagsim.run.observers.monitors import Checkpoints
from lagsim.run.system.functions import in_groups, joined, largest_beside
from lagsim.run.system.localized import is_localized_in_time
from lagsim.run.trajectory import Outcome
from lagsim.tolerances import (
    FLAT_RANGE,
    MOTION_ROUNDOFF,
    NO_MOTION,
    SAME_ROW,
    UNIT_ROUNDOFF,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

    from lagsim.language.arrays import Floats
    from lagsim.mechanics.equations import Equations, Instant
    from lagsim.plan.plan import Plan
    from lagsim.run.interrupt import Interrupt
    from lagsim.run.session import Case, Session
    from lagsim.run.system import System
    from lagsim.run.trajectory import Trajectory

# What moves by a million times its error does not rest.
RESOLVED_BY = 1e-6


def ranges(
    names: tuple[str, ...],
    checkpoints: Checkpoints,
    again: Checkpoints,
    extents: Mapping[str, tuple[float, float]],
) -> Floats:
    """Return the ranges (n,) over all rows of both runs, and over the repeat's steps.

    Rows may be few, or show an oscillation always in the same phase.
    """
    low = np.fmin(checkpoints.low, again.low)
    high = np.fmax(checkpoints.high, again.high)
    for k, name in enumerate(names):
        if name in extents:
            low[k] = np.fmin(low[k], extents[name][0])
            high[k] = np.fmax(high[k], extents[name][1])
    return np.asarray(high - low)


def beside(equations: Equations, start: Instant, found: Floats) -> Floats:
    """Return the largest range (n,) of other coordinates, each in the unit of its own.

    As far as its inertia may be moved by it: of a heavier body no more than that body's
    own range, so that what is light does not hide behind it; of a lighter one less, as
    the roots of the masses. Where units differ, whichever is less.
    """
    return largest_beside(_roots(equations, start), found)


def linked(equations: Equations, start: Instant, found: Floats) -> Floats:
    """Return `beside` (n,) of the coordinates that constraints link with each."""
    labels = joined(len(found), [row.A.entries for row in equations.rows])
    return in_groups(labels, _roots(equations, start), found)


def _roots(equations: Equations, start: Instant) -> Floats:
    """Give the roots of the diagonal of M at the start (n,)."""
    values = {p.name: p.value for p in equations.model.parameters} | {"t": start.t}
    values |= dict(zip(equations.q, start.q, strict=True))
    values |= dict(zip(equations.velocities, start.v, strict=True))
    diagonal = evaluate(equations.graph, equations.inertias, values)
    return np.sqrt(np.fmax(diagonal, 0.0))


def hardly_moving(
    found: Floats, moving: Floats, errors: Floats, scales: Floats
) -> list[int]:
    """Return the indices of coordinates that may be at rest but for rounding.

    All else moves by far more than its error, or than the millionth of what moves
    beside it, and what could push it need not be asked.
    """
    slow = (found <= NO_MOTION * moving) | (errors > RESOLVED_BY * scales)
    return list(map(int, np.flatnonzero(slow)))


def is_at_rest(found: Floats, largest: Floats, held: Floats) -> bool:
    """Tell whether nothing moves but by rounding, of values or of forces."""
    return bool(np.all(found <= np.fmax(MOTION_ROUNDOFF * largest, BALANCED * held)))


def scales_of(
    found: Floats, moving: Floats, linked: Floats, largest: Floats, held: Floats
) -> tuple[Floats, Floats]:
    """Return the scales of errors (n,), and the ranges below which there is no horizon.

    Parameters
    ----------
    found, moving, linked, largest, held
        Of each coordinate the range, the motion beside it, that of what it is linked
        with, the largest value, and how far it would move if nothing held it.
    """
    scales = np.fmax(found, FLAT_RANGE * moving)
    at_rest = found <= BALANCED * held
    for size in (largest, linked):
        scales = np.where(found > MOTION_ROUNDOFF * size, scales, np.fmax(scales, size))
    scales = np.where(at_rest, np.fmax(scales, held), scales)
    still = np.fmax(NO_MOTION * moving, BALANCED * held / LOST)
    return scales, np.fmax(still, MOTION_ROUNDOFF * largest / LOST)


# How much tighter the repeat's tolerance is, how much where that does not come to its
# end, the least that means anything, and the loosest that a repeat is made at: loose
# ones may both be far off, and alike.
TIGHTER = 100.0
LOOSER = 3.0
TIGHTEST = 1e-14
LOOSEST = 1e-6
# That of the repeat of a method without error control.
FREE_RTOL = 1e-13
# A method whose steps are exact, whatever their length.
EXACT = "exponential"
# The longest step of a repeat, as a part of the output step (not a ratio of small whole
# numbers: looks fall elsewhere in each row), and of the steps of the same method.
WITHIN = 0.75**0.5
GOLDEN = (5.0**0.5 - 1.0) / 2.0
# Operations that a repeat may always take to keep its steps short.
SHORT = 2e7
# Evaluations in a step with rows in it, of what repeats most runs.
PER_STEP = 15.0
# Of a series: it is evaluated once, and once more where rounding is carried.
SERIES_STEP = 2.0

# Operations that a repeat may take without being asked for: about 2 s.
BUDGET = 2e9
# No repeat takes more than so many times the run, or so many operations: one that does
# has encountered something that the run has not.
MOST_TIMES = 20.0
ALWAYS = 2e8
# All that judges a run takes no more than so many times the run, and so many operations
# besides: about 2 s, where constraints are solved by loops 10 s.
WHOLE_TIMES = 10.0
WHOLE = 1e9
# Evaluations and columns of a row cost about this much besides their operations.
OVERHEAD = 20
# A series takes about so many times the operations of the rates that it is made of.
SERIES_LENGTH = 50
# What an arc costs besides its steps, as it is begun in Python: a millisecond. It
# counts for less, since a repeat may have to go through switches that the run missed:
# through 2000 of them, at least.
ARC = 1e5
# And through so many times those of the run.
MOST_ARCS = 3.0


def cost(system: System, method: str) -> float:
    """Return the cost of an evaluation, in operations."""
    operations = float(system.operations)
    if system.plan.method == SERIES and method != SERIES:
        operations /= SERIES_LENGTH
    return operations + OVERHEAD


def own_cost(system: System, trajectory: Trajectory) -> float:
    """Return the cost of the evaluations of a run, in operations."""
    return trajectory.statistics.evaluations * cost(system, system.plan.method)


class Repeat(NamedTuple):
    """Other means of integration: a session, and the evaluations in a step."""

    session: Session
    per_step: float = PER_STEP

    @property
    def evaluation(self) -> float:
        """What an evaluation costs, in operations, as all prices are."""
        return cost(self.session.system, self.session.plan.method)

    @property
    def step(self) -> float:
        """What a step costs."""
        return self.per_step * self.evaluation

    def limited(self, most: int) -> Repeat:
        """Return the same with a limit on steps; an arc counts as some of them."""
        arc = ARC / self.step if most < MOST_STEPS else 0.0
        way = self.session._replace(most_steps=most, arc_steps=arc)
        return self._replace(session=way)

    def made(
        self,
        kept: Checkpoints,
        allowance: Allowance,
        judge: Callable[[Session], Judge] | None,
        **more: Any,
    ) -> tuple[Trajectory, Judge | None]:
        """Run it, charge the allowance; return the trajectory, and what judges it."""
        own = None if judge is None else judge(self.session)
        found = self.session.run([kept, *([own] if own else [])], **more)
        allowance.take(self, found)
        return found, own


class Allowance:
    """The budget of operations left for the verification of a run."""

    def __init__(self, system: System, trajectory: Trajectory) -> None:
        arcs = ARC * trajectory.statistics.arcs
        self.left = WHOLE_TIMES * (own_cost(system, trajectory) + arcs) + WHOLE

    def steps(self, other: Repeat, system: System, trajectory: Trajectory) -> int:
        """Return the number of steps that a repeat of a run by `system` may take."""
        own = own_cost(system, trajectory)
        most = min(BUDGET, max(MOST_TIMES * own, ALWAYS))
        most += MOST_ARCS * ARC * trajectory.statistics.arcs
        return int(min(most, self.left) / other.step)

    def most(self, other: Repeat, steps: int) -> int:
        """Return the number of steps that may be taken, out of so many."""
        return min(steps, int(self.left / other.step))

    def take(self, other: Repeat, trajectory: Trajectory) -> None:
        """Charge the cost of a run by such means."""
        made = trajectory.statistics
        price = made.evaluations * other.evaluation + ARC * made.arcs
        self.left = max(0.0, self.left - price)


def has_same_steps(
    plan: Plan, trajectory: Trajectory, other: Plan, repeated: Trajectory
) -> bool:
    """Tell whether a repeat took the same steps as the run, and says nothing of it.

    Their number and the shortest of them, to the last bit, tell all others.
    """
    mine, theirs = trajectory.statistics, repeated.statistics
    return plan.method == other.method and (
        mine.steps,
        mine.rejections,
        mine.smallest_step,
    ) == (theirs.steps, theirs.rejections, theirs.smallest_step)


def by_other_means(session: Session, trajectory: Trajectory) -> Iterator[Repeat]:
    """Return other means of integration, the best first."""

    def way(plan: Plan, longest: float) -> Session:
        return session._replace(plan=plan, longest_step=longest)

    plan, system, settings = session.plan, session.system, session.case.settings
    steps = max(trajectory.statistics.steps, 1)
    mean = (trajectory.end - trajectory.start) / steps
    within = WITHIN * settings.output_step
    if plan.rtol is None and plan.method == EXACT:
        tight = replace(plan, method=ANY, rtol=TIGHTEST, step=None)
        yield Repeat(way(tight, _affordable(within, system, ANY, trajectory)))
        assert plan.step is not None
        others = replace(plan, step=GOLDEN * plan.step)
        yield Repeat(way(others, within), 1.0)
        return
    if plan.rtol is None:
        free = _free(session.case)
        within = _affordable(within, free.system, free.plan.method, trajectory)
        yield Repeat(free._replace(longest_step=within))
        return
    same = GOLDEN * min(mean, settings.output_step)
    per_step = SERIES_STEP if plan.method == SERIES else PER_STEP
    for tighter in (tightened(plan, TIGHTER), tightened(plan, LOOSER)):
        alike = plan.method == SERIES and (
            _sees_all(system) or not _has_room(plan, tighter)
        )
        if plan.method != ANY and not alike:
            longest = _affordable(within, system, ANY, trajectory)
            yield Repeat(way(replace(tighter, method=ANY), longest))
        if plan.method == ANY or alike or plan.method != SERIES:
            longest = _affordable(same, system, plan.method, trajectory)
            if not _is_tighter(plan, tighter):
                longest = min(longest, GOLDEN * mean)
            yield Repeat(way(tighter, longest), per_step)
    # Shorter than half of the run's steps cannot be the same.
    yield Repeat(way(tightened(plan, TIGHTER), GOLDEN * GOLDEN * mean), per_step)


def _sees_all(system: System) -> bool:
    """Tell whether a series misses no feature of a model, whatever its steps.

    Then other steps are other means enough, and no second method has to be linked.
    """
    return not system.indicators and not is_localized_in_time(system.equations)


def _has_room(plan: Plan, tighter: Plan) -> bool:
    """Tell whether the repeat's tolerance leaves another method room to be better."""
    if not plan.rtol or not tighter.rtol:
        return True
    return tighter.rtol > TIGHTEST and _is_tighter(plan, tighter)


def _is_tighter(plan: Plan, other: Plan) -> bool:
    """Tell whether the tolerance of a repeat is less than that of the run."""
    return not plan.rtol or (other.rtol or 0.0) < plan.rtol


def tightened(plan: Plan, times: float) -> Plan:
    """Give the plan of a repeat: its tolerance is never nearly that of the run."""
    rtol = plan.rtol or 0.0
    if rtol:
        rtol = min(max(rtol / times, TIGHTEST), LOOSEST)
        assert plan.rtol is not None
        if max(rtol / plan.rtol, plan.rtol / rtol) < (1.0 - 1e-9) * LOOSER:
            rtol = LOOSER * plan.rtol
    factor = rtol / plan.rtol if plan.rtol else 1.0 / times
    atol = None if plan.atol is None else plan.atol * min(factor, 1.0)
    return replace(plan, rtol=rtol, atol=atol)


def _free(case: Case) -> Session:
    """Return the session that repeats a method without error control."""
    free = case.asking(method=ANY, formulation="auto", rtol=FREE_RTOL, atol=None)
    return free.ready()._replace(case=case)


def _affordable(
    longest: float, system: System, method: str, trajectory: Trajectory
) -> float:
    """Give a longest step with which steps alone cost no more than they may."""
    span = trajectory.end - trajectory.start
    most = min(max(2.0 * own_cost(system, trajectory), SHORT), BUDGET / 2.0)
    return max(longest, span * PER_STEP * cost(system, method) / most)


# Rows of the repeat, at least: ranges are taken from them, too.
LEAST_ROWS = 64
# Two repeats agree by far where they are apart by this part of what the run is off.
ALIKE = 1e-4


class Judge(Observer, Protocol):
    """Observer that validates the rows of a repeat."""

    def fault(self, trajectory: Trajectory) -> str:
        """Return why the rows are not valid, or ""."""


def repeat(
    session: Session,
    trajectory: Trajectory,
    checkpoints: Checkpoints,
    *,
    always: bool = False,
    judge: Callable[[Session], Judge] | None = None,
    allowance: Allowance | None = None,
    interrupt: Interrupt | None = None,
    progress: Callable[[float], None] | None = None,
) -> ErrorBar | str:
    """Give the error bar of a run, or why there is none.

    Parameters
    ----------
    session, trajectory, checkpoints
        Of the run.
    always
        Whatever it costs.
    judge
        Gives what judges a repeat; one that fails says nothing, and another is made.
    allowance
        What is left for the judging of the run; by default as much as there ever is.
    progress
        Called with the fraction of the repeat that is done.
    """
    if len(checkpoints.rows) < 2:
        return "there are too few rows to compare"
    system, case = session.system, session.case
    evaluations = trajectory.statistics.evaluations
    expected = 2.0 * evaluations * cost(system, session.plan.method)
    if expected > BUDGET and not always:
        return (
            f"a repeat would take about {expected:.1e} operations "
            "(--error-bar always makes it)"
        )
    allowance = allowance or Allowance(system, trajectory)
    found = Failed("no other method can repeat the run")
    for other in by_other_means(session, trajectory):
        way, again = _spaced(other, checkpoints)
        most = MOST_STEPS if always else allowance.steps(way, system, trajectory)
        repeated, own = way.limited(most).made(
            again, allowance, judge, interrupt=interrupt, progress=progress
        )
        plan = way.session.plan
        if repeated.outcome is Outcome.INTERRUPTED:
            return "the repeat was interrupted"
        fault = own.fault(repeated) if own else ""
        if fault:
            text = f"a repeat by {plan.method} is not valid itself: {fault}"
            found = Failed(text)
            continue
        if has_same_steps(session.plan, trajectory, plan, repeated):
            found = Failed(f"a repeat by {plan.method} took the same steps as the run")
            continue
        if _is_comparable(trajectory, repeated):
            runs = trajectory, repeated
            return _compared(case, runs, plan, checkpoints, again)
        where = f"{plan.method} ended at t = {repeated.end:.6g}"
        found = Failed(f"a repeat did not finish: {where}")
    return found


def is_outlier(
    session: Session,
    trajectory: Trajectory,
    checkpoints: Checkpoints,
    bar: ErrorBar,
    *,
    judge: Callable[[Session], Judge] | None = None,
    allowance: Allowance | None = None,
    interrupt: Interrupt | None = None,
) -> bool:
    """Tell whether the run, and not its repeat, is wrong: by a third one.

    Two that are tighter agree better by far where the run has passed over something; by
    as much as their tolerances differ where motions part exponentially.
    """
    other = next(by_other_means(session, trajectory), None)
    if other is None:
        return False
    other, third = _spaced(other, checkpoints)
    way, allowance = other.session, allowance or Allowance(session.system, trajectory)
    longest = GOLDEN * GOLDEN * way.longest_step
    way = way._replace(plan=tightened(way.plan, TIGHTER), longest_step=longest)
    other = other._replace(session=way)
    other = other.limited(allowance.steps(other, session.system, trajectory))
    made, own = other.made(third, allowance, judge, interrupt=interrupt)
    if own and own.fault(made):
        return False
    found = third.numbered
    alike = [np.abs(found[k] - row) for k, row in bar.repeated.items() if k in found]
    if len(alike) < len(bar.repeated):
        return False
    n = len(session.case.equations.q)
    apart = np.max(np.array(alike)[:, 1 : 1 + n], axis=0)
    return bool(np.max(bar.lost_by(apart)) < ALIKE * np.max(bar.lost))


def _is_comparable(trajectory: Trajectory, repeated: Trajectory) -> bool:
    """Tell whether a repeat reached the end of the run, or an end of its own."""
    if repeated.outcome.complete:
        return True
    span = trajectory.end - trajectory.start
    return repeated.end >= trajectory.end - SAME_ROW * span


def _spaced(other: Repeat, checkpoints: Checkpoints) -> tuple[Repeat, Checkpoints]:
    """Return other means with output rows of a repeat, and the observer of these."""
    count, case = len(checkpoints.rows), other.session.case
    finer = -(-LEAST_ROWS // count) if checkpoints.stride == 1 else 1
    spacing = checkpoints.stride * case.settings.output_step / finer
    fine = other.session.asking(output_step=spacing)
    kept = Checkpoints(len(case.equations.q), fine.case.settings, finer)
    return other._replace(session=fine), kept


def _compared(
    case: Case,
    runs: tuple[Trajectory, Trajectory],
    plan: Plan,
    checkpoints: Checkpoints,
    again: Checkpoints,
) -> ErrorBar:
    """Return the error bar by rows of the same numbers, and by the ends."""
    equations, start = case.equations, case.start
    n = len(equations.q)
    rows, others = [], []
    repeats = again.numbered
    for k, row in checkpoints.numbered.items():
        other = repeats.get(k)
        if other is not None:
            rows.append(row)
            others.append(other)
    assert checkpoints.last is not None
    assert again.last is not None
    run, repeated = runs
    apart = abs(run.end - repeated.end)
    alike = run.outcome is repeated.outcome and apart < case.settings.output_step
    if alike and checkpoints.last[0] > rows[-1][0]:
        rows.append(checkpoints.last)
        others.append(again.last)
    mine, theirs = np.array(rows), np.array(others)
    errors = np.abs(theirs[:, 1:] - mine[:, 1:])
    errors = np.fmax(errors, UNIT_ROUNDOFF * _largest(mine[:, 1:]))
    # Times are rounded, too, also those at which forces step.
    late = UNIT_ROUNDOFF * _largest(mine[:, :1] * mine[:, 1 + n :])
    errors[:, :n] = np.fmax(errors[:, :n], late)
    own = checkpoints.high - checkpoints.low
    sizes = ranges(equations.q, checkpoints, again, repeated.extents)
    # Where the two are apart, the repeat's motion is another one; it counts only where
    # the run has hardly moved.
    parted_ways = np.max(errors[:, :n], axis=0) > LOST * sizes
    parted_ways &= own > LOST * sizes
    sizes = np.where(parted_ways, own, sizes)
    moving = beside(equations, start, sizes)
    mechanism = linked(equations, start, sizes)
    largest = np.max(np.abs(mine[:, 1 : 1 + n]), axis=0)
    held = np.zeros(n)
    scales, still = scales_of(sizes, moving, mechanism, largest, held)
    which = hardly_moving(sizes, moving, np.max(errors[:, :n], axis=0), scales)
    if which:
        from lagsim.run.held import could_push

        held = could_push(equations, mine, which, case.settings.output_step).reach
        scales, still = scales_of(sizes, moving, mechanism, largest, held)
    return ErrorBar(
        method=plan.method,
        rtol=plan.rtol,
        names=equations.q,
        times=mine[:, 0],
        errors=errors[:, :n],
        scales=scales,
        still=still,
        rates=errors[:, n:],
        repeated=repeats,
        parted="" if alike else _parted(run, repeated, plan),
        rests=is_at_rest(sizes, largest, held),
    )


def _largest(values: Floats) -> Floats:
    """Give the largest sizes up to each row (k, n)."""
    return np.asarray(np.maximum.accumulate(np.abs(values), axis=0))


def _parted(run: Trajectory, repeated: Trajectory, plan: Plan) -> str:
    """Return the text on two runs that ended differently, or ""."""
    if not (run.outcome.complete and repeated.outcome.complete):
        return ""
    return (
        f"it ended with `{run.outcome.word}` at t = {run.end:.9g}, and a repeat by "
        f"{plan.method} with `{repeated.outcome.word}` at t = {repeated.end:.9g}"
    )
