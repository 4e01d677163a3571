"""The error of a run, estimated by the difference from a repeat by other means.

A local error says little of the motion: the estimate is the difference of two whole
runs, so that it knows how errors grow on the way. The error of a coordinate is measured
by its range; where it rests but for rounding, by its value, by the motion of what
constraints link with it, or by how far the forces on it would take it.

A repeat with the same steps would have the same blind spots: what one step passes over,
and what a step at the bound of stability is off by, is then no difference. So it is
made at a hundredth of the tolerance, and in steps that are forced to be others: none is
longer than a part of the output step, nor, where the method is the same, than a part of
the run's own; and by another method where something might hide from this one's steps.
Where the tolerance is as tight as any, the repeat's is looser. The counts of both runs
are compared: a repeat that has made the run's own steps is no estimate, and another is
made.

The repeat costs a few times the run. Costs are counted in operations, never in seconds,
so that a rerun gives the same result: every repeat may cost some times the run; and all
of them together, with what is repeated besides, no more than an allowance that the run
itself sets.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lagsim.plan.plan import ANY
from lagsim.run.arc import SERIES
from lagsim.run.error import LOST, ErrorBar, Failed
from lagsim.run.interrupt import MOST_STEPS
from lagsim.run.observers.monitors import Checkpoints
from lagsim.run.system.functions import in_groups, joined, largest_beside
from lagsim.run.system.localized import is_localized_in_time
from lagsim.run.trajectory import Outcome
from lagsim.studies.alarms import Evidence, fault, inertia_roots
from lagsim.tolerances import (
    FLAT_RANGE,
    FORCE_ROUNDOFF,
    MOTION_ROUNDOFF,
    NO_MOTION,
    SAME_ROW,
    TIGHTEST_RTOL,
    UNIT_ROUNDOFF,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from lagsim.language.arrays import Floats
    from lagsim.plan.plan import Plan
    from lagsim.run.interrupt import Interrupt
    from lagsim.run.session import Case, Session
    from lagsim.run.system import System
    from lagsim.run.trajectory import Trajectory

# What moves by a million times its error does not rest.
RESOLVED_BY = 1e-6


def _scales(
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
    for size in (largest, linked):
        scales = np.where(found > MOTION_ROUNDOFF * size, scales, np.fmax(scales, size))
    scales = np.where(found <= FORCE_ROUNDOFF * held, np.fmax(scales, held), scales)
    still = np.fmax(NO_MOTION * moving, FORCE_ROUNDOFF * held / LOST)
    return scales, np.fmax(still, MOTION_ROUNDOFF * largest / LOST)


def compared(
    case: Case,
    runs: tuple[Trajectory, Trajectory],
    plan: Plan,
    checkpoints: Checkpoints,
    again: Checkpoints,
) -> ErrorBar:
    """Return the error bar of a run by a repeat: rows of the same numbers, and ends.

    Parameters
    ----------
    runs, checkpoints, again
        The run and its repeat, and the rows of each.
    plan
        Of the repeat.
    """
    equations, start, n = case.equations, case.start, len(case.equations.q)
    run, repeated = runs
    repeats = again.numbered
    pairs = [(x, repeats[k]) for k, x in checkpoints.numbered.items() if k in repeats]
    apart = abs(run.end - repeated.end)
    alike = run.outcome is repeated.outcome and apart < case.settings.output_step
    assert checkpoints.last is not None
    assert again.last is not None
    if alike and checkpoints.last[0] > pairs[-1][0][0]:
        pairs.append((checkpoints.last, again.last))
    mine, theirs = np.array(pairs).swapaxes(0, 1)
    errors = np.abs(theirs[:, 1:] - mine[:, 1:])
    errors = np.fmax(errors, UNIT_ROUNDOFF * _largest(mine[:, 1:]))
    # Times are rounded, too, also those at which forces step.
    late = UNIT_ROUNDOFF * _largest(mine[:, :1] * mine[:, 1 + n :])
    errors[:, :n] = np.fmax(errors[:, :n], late)
    own, worst = checkpoints.high - checkpoints.low, np.max(errors[:, :n], axis=0)
    sizes = _ranges(equations.q, repeated, checkpoints, again)
    # Where the two are apart, the repeat's motion is another one; it counts only where
    # the run has hardly moved.
    sizes = np.where((worst > LOST * sizes) & (own > LOST * sizes), own, sizes)
    roots = inertia_roots(equations, start)
    labels = joined(n, [row.A.entries for row in equations.rows])
    moving, linked = largest_beside(roots, sizes), in_groups(labels, roots, sizes)
    largest, held = np.max(np.abs(mine[:, 1 : 1 + n]), axis=0), np.zeros(n)
    scales, still = _scales(sizes, moving, linked, largest, held)
    # All else moves by far more than its error, or than a part of what moves beside it.
    slow = (sizes <= NO_MOTION * moving) | (worst > RESOLVED_BY * scales)
    if slow.any():
        from lagsim.run.held import could_push

        which = np.flatnonzero(slow).tolist()
        held = could_push(equations, mine, which, case.settings.output_step).reach
        scales, still = _scales(sizes, moving, linked, largest, held)
    rounding = np.fmax(MOTION_ROUNDOFF * largest, FORCE_ROUNDOFF * held)
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
        rests=bool(np.all(sizes <= rounding)),
    )


def _ranges(
    names: tuple[str, ...],
    repeated: Trajectory,
    checkpoints: Checkpoints,
    again: Checkpoints,
) -> Floats:
    """Return the ranges (n,) over all rows of both runs, and over the repeat's steps.

    Rows may be few, or show an oscillation always in the same phase.
    """
    nothing = np.nan, np.nan
    steps = np.array([repeated.extents.get(name, nothing) for name in names]).T
    low = np.fmin.reduce([checkpoints.low, again.low, steps[0]])
    high = np.fmax.reduce([checkpoints.high, again.high, steps[1]])
    return np.asarray(high - low)


def _largest(values: Floats) -> Floats:
    """Return the largest sizes up to each row (k, n)."""
    return np.asarray(np.maximum.accumulate(np.abs(values), axis=0))


def _parted(run: Trajectory, repeated: Trajectory, plan: Plan) -> str:
    """Return the text on two runs that ended differently, or ""."""
    if not (run.outcome.complete and repeated.outcome.complete):
        return ""
    return (
        f"it ended with `{run.outcome.word}` at t = {run.end:.9g}, and a repeat by "
        f"{plan.method} with `{repeated.outcome.word}` at t = {repeated.end:.9g}"
    )


# How much tighter the repeat's tolerance is, how much where that does not come to its
# end, and the loosest that a repeat is made at: loose ones may both be far off, and
# alike.
TIGHTER, LOOSER = 100.0, 3.0
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
# through 2000 of them, at least; and through so many times those of the run.
ARC = 1e5
MOST_ARCS = 3.0

# Rows of the repeat, at least: ranges are taken from them, too.
LEAST_ROWS = 64
# Two repeats agree by far where they are apart by this part of what the run is off.
ALIKE = 1e-4


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
        """The cost of an evaluation, in operations."""
        return cost(self.session.system, self.session.plan.method)

    @property
    def step(self) -> float:
        """The cost of a step, in operations."""
        return self.per_step * self.evaluation

    def limited(self, most: int) -> Session:
        """Return the session with a limit on steps; an arc counts as some of them."""
        arc = ARC / self.step if most < MOST_STEPS else 0.0
        return self.session._replace(most_steps=most, arc_steps=arc)


class Allowance:
    """The budget of operations left for the verification of a run."""

    def __init__(self, system: System, trajectory: Trajectory) -> None:
        arcs = ARC * trajectory.statistics.arcs
        self.left = WHOLE_TIMES * (own_cost(system, trajectory) + arcs) + WHOLE

    def steps(self, other: Repeat, operations: float = math.inf) -> int:
        """Return the number of steps that so many operations allow, or what is left."""
        return int(min(operations, self.left) / other.step)

    def take(self, other: Repeat, trajectory: Trajectory) -> None:
        """Charge the cost of a run by such means."""
        made = trajectory.statistics
        price = made.evaluations * other.evaluation + ARC * made.arcs
        self.left = max(0.0, self.left - price)


def by_other_means(session: Session, trajectory: Trajectory) -> Iterator[Repeat]:
    """Return other means of integration, the best first."""
    plan, system, settings = session.plan, session.system, session.case.settings
    span = trajectory.end - trajectory.start

    def way(plan: Plan, longest: float, session: Session = session) -> Session:
        """Return a session with steps as long as they must be to be affordable."""
        own = own_cost(session.system, trajectory)
        most = min(max(2.0 * own, SHORT), BUDGET / 2.0)
        price = PER_STEP * cost(session.system, plan.method)
        longest = max(longest, span * price / most)
        return session._replace(plan=plan, longest_step=longest)

    mean = span / max(trajectory.statistics.steps, 1)
    within = WITHIN * settings.output_step
    if plan.rtol is None and plan.method == EXACT:
        yield Repeat(
            way(replace(plan, method=ANY, rtol=TIGHTEST_RTOL, step=None), within)
        )
        assert plan.step is not None
        others = replace(plan, step=GOLDEN * plan.step)
        yield Repeat(session._replace(plan=others, longest_step=within), 1.0)
        return
    if plan.rtol is None:
        free = session.case.asking(
            method=ANY, formulation="auto", rtol=FREE_RTOL, atol=None
        ).ready()
        found = way(free.plan, within, free)
        yield Repeat(found._replace(case=session.case))
        return
    same = GOLDEN * min(mean, settings.output_step)
    per_step = SERIES_STEP if plan.method == SERIES else PER_STEP
    # A series that misses no feature of the model, whatever its steps, has other means
    # enough in other steps.
    sees_all = not system.indicators and not is_localized_in_time(system.equations)
    for tighter in (tightened(plan, TIGHTER), tightened(plan, LOOSER)):
        is_tighter = not plan.rtol or (tighter.rtol or 0.0) < plan.rtol
        # The tolerance may leave another method no room to be better.
        room = not plan.rtol or ((tighter.rtol or 0.0) > TIGHTEST_RTOL and is_tighter)
        alike = plan.method == SERIES and (sees_all or not room)
        if plan.method != ANY and not alike:
            yield Repeat(way(replace(tighter, method=ANY), within))
        if plan.method == ANY or alike or plan.method != SERIES:
            found = way(tighter, same)
            if not is_tighter:
                longest = min(found.longest_step, GOLDEN * mean)
                found = found._replace(longest_step=longest)
            yield Repeat(found, per_step)
    # Shorter than half of the run's steps cannot be the same.
    shortest = tightened(plan, TIGHTER)
    found = session._replace(plan=shortest, longest_step=GOLDEN * GOLDEN * mean)
    yield Repeat(found, per_step)


def tightened(plan: Plan, times: float) -> Plan:
    """Return the plan of a repeat: its tolerance is never nearly that of the run."""
    rtol = plan.rtol or 0.0
    if rtol:
        rtol = min(max(rtol / times, TIGHTEST_RTOL), LOOSEST)
        assert plan.rtol is not None
        if max(rtol / plan.rtol, plan.rtol / rtol) < (1.0 - 1e-9) * LOOSER:
            rtol = LOOSER * plan.rtol
    factor = rtol / plan.rtol if plan.rtol else 1.0 / times
    atol = None if plan.atol is None else plan.atol * min(factor, 1.0)
    return replace(plan, rtol=rtol, atol=atol)


class Repeats:
    """The repeats of a run, within its allowance.

    Parameters
    ----------
    run
        The run, at its end.
    checkpoints
        Its rows that are compared.
    allowance
        What is left for its verification; by default as much as there ever is.
    """

    def __init__(
        self,
        run: Evidence,
        checkpoints: Checkpoints,
        allowance: Allowance | None = None,
        interrupt: Interrupt | None = None,
    ) -> None:
        self.run, self.checkpoints, self.interrupt = run, checkpoints, interrupt
        self.system, self.trajectory = run.session.system, run.trajectory
        self.allowance = allowance or Allowance(self.system, self.trajectory)

    def error_bar(
        self,
        *,
        always: bool = False,
        progress: Callable[[float], None] | None = None,
    ) -> ErrorBar | str:
        """Return the error bar of the run, or why there is none.

        Parameters
        ----------
        always
            Whatever it costs.
        progress
            Called with the fraction of the repeat that is done.
        """
        if len(self.checkpoints.rows) < 2:
            return "there are too few rows to compare"
        session, trajectory = self.run.session, self.trajectory
        evaluations = trajectory.statistics.evaluations
        expected = 2.0 * evaluations * cost(self.system, session.plan.method)
        if expected > BUDGET and not always:
            return (
                f"a repeat would take about {expected:.1e} operations "
                "(--error-bar always makes it)"
            )
        found = Failed("no other method can repeat the run")
        for other in by_other_means(session, trajectory):
            own, again = self._made(other, always=always, progress=progress)
            repeated, plan = own.trajectory, own.plan
            if repeated.outcome is Outcome.INTERRUPTED:
                return "the repeat was interrupted"
            if wrong := fault(own):
                text = f"a repeat by {plan.method} is not valid itself: {wrong}"
                found = Failed(text)
            elif plan.method == session.plan.method and (
                _steps(repeated) == _steps(trajectory)
            ):
                text = f"a repeat by {plan.method} took the same steps as the run"
                found = Failed(text)
            elif repeated.outcome.complete or self._reached(repeated.end):
                runs = trajectory, repeated
                return compared(session.case, runs, plan, self.checkpoints, again)
            else:
                where = f"{plan.method} ended at t = {repeated.end:.6g}"
                found = Failed(f"a repeat did not finish: {where}")
        return found

    def is_outlier(self) -> bool:
        """Return whether the run, and not its repeat, is wrong: by a third one.

        Two that are tighter agree better by far where the run has passed over
        something; by as much as their tolerances differ where motions part
        exponentially.
        """
        bar, session = self.run.bar, self.run.session
        assert not isinstance(bar, str)
        other = next(by_other_means(session, self.trajectory), None)
        if other is None:
            return False
        way = other.session
        longest = GOLDEN * GOLDEN * way.longest_step
        way = way._replace(plan=tightened(way.plan, TIGHTER), longest_step=longest)
        own, third = self._made(other._replace(session=way))
        if fault(own):
            return False
        found, n = third.numbered, len(session.case.equations.q)
        if not bar.repeated.keys() <= found.keys():
            return False
        alike = [np.abs(found[k] - row) for k, row in bar.repeated.items()]
        apart = np.max(np.array(alike)[:, 1 : 1 + n], axis=0)
        return bool(np.max(bar.lost_by(apart)) < ALIKE * np.max(bar.lost))

    def _made(
        self,
        other: Repeat,
        *,
        always: bool = False,
        progress: Callable[[float], None] | None = None,
    ) -> tuple[Evidence, Checkpoints]:
        """Run other means, charge their cost; return what judges them, and rows."""
        rows, case = self.checkpoints, other.session.case
        finer = -(-LEAST_ROWS // len(rows.rows)) if rows.stride == 1 else 1
        spacing = rows.stride * case.settings.output_step / finer
        other = other._replace(session=other.session.asking(output_step=spacing))
        settings = other.session.case.settings
        again = Checkpoints(len(case.equations.q), settings, finer)
        most = MOST_STEPS
        if not always:
            own = own_cost(self.system, self.trajectory)
            operations = min(BUDGET, max(MOST_TIMES * own, ALWAYS))
            operations += MOST_ARCS * ARC * self.trajectory.statistics.arcs
            most = self.allowance.steps(other, operations)
        limited = other.limited(most)
        evidence = Evidence(limited)
        found = limited.run(
            [again, evidence], interrupt=self.interrupt, progress=progress
        )
        self.allowance.take(other, found)
        return evidence.end(found, "a repeat has none"), again

    def _reached(self, end: float) -> bool:
        """Return whether a time is that of the end of the run, or past it."""
        run = self.trajectory
        return end >= run.end - SAME_ROW * (run.end - run.start)


def _steps(trajectory: Trajectory) -> tuple[float | None, ...]:
    """Return counts, and the shortest step to the last bit, that tell all steps."""
    made = trajectory.statistics
    return made.steps, made.rejections, made.smallest_step
