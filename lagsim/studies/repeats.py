"""Repeats of a run by other means, their costs, and the budget of a run for these.

A repeat with the steps of the run would pass over the features that the run passed
over, and would share the error of steps at the bound of stability. The repeat is
therefore made at a hundredth of the tolerance and with other steps: none is longer than
a part of the output step or, for the method of the run, than a part of the steps of the
run. Another method is used where the steps of the run could hide a feature. If
the tolerance is the tightest, that of the repeat is looser.

A repeat costs a few times the run. Costs are counted in operations, not in seconds, so
that a rerun makes the same decisions. Each repeat has a limit relative to the run, and
all repeats and second attempts together have an allowance that depends on the run.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

from lagsim.notes import Choice
from lagsim.plan.method_choice import ANY
from lagsim.run.arc import SERIES
from lagsim.run.interrupt import MOST_STEPS
from lagsim.tolerances import TIGHTEST_RTOL

if TYPE_CHECKING:
    from collections.abc import Iterator

    from lagsim.plan.plan import Plan
    from lagsim.program.system import System
    from lagsim.run.session import Session
    from lagsim.run.trajectory import Trajectory
    from lagsim.studies.audit.finding import Finding
    from lagsim.studies.trial import Compiled

# Factor by which the tolerance of a repeat is tighter, the factor if that repeat does
# not finish, and the loosest tolerance of a repeat: with loose tolerances both runs can
# have large errors that are nearly equal.
TIGHTER, LOOSER = 100.0, 3.0
LOOSEST = 1e-6
# Tolerance of the repeat of a method without error control.
FREE_RTOL = 1e-13
# The longest step of a repeat relative to the output step (no ratio of small whole
# numbers, so that steps end elsewhere in each row), and to the steps of the run.
WITHIN = 0.75**0.5
GOLDEN = (5.0**0.5 - 1.0) / 2.0
# Operations that a repeat may always take to keep its steps short.
SHORT = 2e7
# Evaluations in a step with rows in it, for the method of most repeats.
PER_STEP = 15.0
# Evaluations in a step of a series: one, and one more for compensated rounding.
SERIES_STEP = 2.0

# Operations of a repeat with `--error-bar auto`, at most: about 2 s.
BUDGET = 2e9
# Limit of a repeat relative to the cost of the run, and limit in operations; the larger
# one holds. A repeat beyond it has met a feature that the run has not.
MOST_TIMES = 20.0
ALWAYS = 2e8
# The allowance of all repeats and second attempts: a multiple of the cost of the run,
# plus operations for about 2 s (10 s where constraints are solved by loops).
WHOLE_TIMES = 10.0
WHOLE = 1e9
# Cost of an evaluation, in operations, in addition to the operations of its nodes.
OVERHEAD = 20
# Operations of a series relative to the operations of the rates.
SERIES_LENGTH = 50
# Cost of the start of an arc, in operations. The true cost, a millisecond in Python, is
# higher, but a repeat must be able to pass switches that the run missed: at least 2000,
# and MOST_ARCS times as many arcs as the run.
ARC = 1e5
MOST_ARCS = 3.0

# Least number of rows of a repeat, which ranges are computed from.
LEAST_ROWS = 64
# Longest step of a second attempt relative to that of the repeat that contradicted the
# first attempt; no ratio of small whole numbers.
SHORTER = 0.3819660112501051
# Limit of the steps of a second attempt: MORE times the evaluations of the first, at
# PER_ATTEMPT in a step, plus AT_LEAST times its least number of steps; or ENOUGH.
MORE = 10
PER_ATTEMPT = 12
AT_LEAST = 3
ENOUGH = 20_000


def evaluation_cost(system: System, method: str) -> float:
    """Return the cost of one evaluation of y' by a method, in operations."""
    operations = float(system.operations)
    if system.plan.method == SERIES and method != SERIES:
        operations /= SERIES_LENGTH
    return operations + OVERHEAD


def own_cost(system: System, trajectory: Trajectory) -> float:
    """Return the cost of a run, in operations: the cost of its evaluations of y'."""
    return trajectory.statistics.evaluations * evaluation_cost(
        system, system.plan.method
    )


def excess(session: Session, trajectory: Trajectory) -> float:
    """Return the expected cost of a repeat, in operations, if above BUDGET; else 0.

    session, trajectory : the run.
    """
    expected = 2.0 * own_cost(session.system, trajectory)
    return expected if expected > BUDGET else 0.0


class Repeat(NamedTuple):
    """Alternative integration of a run, which serves to estimate the error of the run.

    Attributes
    ----------
    session : Session
        The session of the alternative integration.
    per_step : float
        Number of evaluations of y' in a step.
    """

    session: Session
    per_step: float = PER_STEP

    @property
    def evaluation(self) -> float:
        """The cost of an evaluation of y', in operations."""
        return evaluation_cost(self.session.system, self.session.plan.method)

    @property
    def step(self) -> float:
        """The cost of a step, in operations."""
        return self.per_step * self.evaluation

    def limited(self, most: int) -> Session:
        """Return the session with a limit on the number of steps.

        most : the largest number of steps, where each arc counts as several steps.
        """
        arc = ARC / self.step if most < MOST_STEPS else 0.0
        return self.session._replace(most_steps=most, arc_steps=arc)


class Allowance:
    """Budget of operations that repeats and second attempts of a run have left.

    Parameters
    ----------
    system : System
        The compiled system.
    trajectory : Trajectory
        The first run, on whose cost the budget depends.
    """

    def __init__(self, system: System, trajectory: Trajectory) -> None:
        arcs = ARC * trajectory.statistics.arcs
        self.left = WHOLE_TIMES * (own_cost(system, trajectory) + arcs) + WHOLE

    def steps(self, other: Repeat, operations: float = math.inf) -> int:
        """Return the number of steps of the repeat `other` within the remaining budget.

        operations : a second limit of the cost of these steps, in operations.
        """
        return int(min(operations, self.left) / other.step)

    def steps_beside(
        self, session: Session, trajectory: Trajectory, other: Repeat
    ) -> int:
        """Return the largest number of steps of the repeat `other` of a run.

        The cost is limited by the allowance, and relative to the cost of the run.

        session, trajectory : the run that is repeated.
        """
        own = own_cost(session.system, trajectory)
        operations = min(BUDGET, max(MOST_TIMES * own, ALWAYS))
        operations += MOST_ARCS * ARC * trajectory.statistics.arcs
        return self.steps(other, operations)

    def take(self, other: Repeat, trajectory: Trajectory) -> None:
        """Subtract the cost of the repeat `other` from the budget.

        trajectory : the result of the repeat.
        """
        made = trajectory.statistics
        price = made.evaluations * other.evaluation + ARC * made.arcs
        self.left = max(0.0, self.left - price)


def by_other_means(
    session: Session, trajectory: Trajectory, compiled: Compiled
) -> Iterator[Repeat]:
    """Yield alternative integrations of a run, the best first.

    Each has another method, formulation or tolerance than the run, and other steps.

    Parameters
    ----------
    session, trajectory
        The run.
    compiled : Compiled
        Sessions whose functions serve the repeat of a method without error control.
    """
    plan, system, settings = session.plan, session.system, session.case.settings
    span = trajectory.end - trajectory.start

    def way(plan: Plan, longest: float, session: Session = session) -> Session:
        """Return `session` with a plan, and with a largest step size for a repeat.

        plan : the plan of the repeat.
        longest : the largest step size requested, which is increased if the repeat
            would exceed BUDGET operations.
        """
        own = own_cost(session.system, trajectory)
        most = min(max(2.0 * own, SHORT), BUDGET / 2.0)
        price = PER_STEP * evaluation_cost(session.system, plan.method)
        longest = max(longest, span * price / most)
        return session._replace(plan=plan, longest_step=longest)

    mean = span / max(trajectory.statistics.steps, 1)
    within = WITHIN * settings.output_step
    if plan.rtol is None:
        case = session.case.with_settings(
            method=ANY, formulation="auto", rtol=FREE_RTOL, atol=None
        )
        free = compiled.session(case, quick=session.system.quick)
        found = way(free.plan, within, free)
        yield Repeat(found._replace(case=session.case))
        return
    same = GOLDEN * min(mean, settings.output_step)
    per_step = SERIES_STEP if plan.method == SERIES else PER_STEP
    # If no feature of the model can be missed, a series with other steps is independent
    # enough of the run.
    sees_all = not system.indicators
    for times in (TIGHTER, LOOSER):
        tighter = tightened(plan, times)
        is_tighter = not plan.rtol or (tighter.rtol or 0.0) < plan.rtol
        # At the tightest tolerance another method cannot be more accurate.
        room = not plan.rtol or ((tighter.rtol or 0.0) > TIGHTEST_RTOL and is_tighter)
        same_method = plan.method == SERIES and (sees_all or not room)
        if plan.method != ANY and not same_method:
            yield Repeat(way(replace(tighter, method=ANY), within))
        if plan.method == ANY or same_method or plan.method != SERIES:
            found = way(tighter, same)
            if not is_tighter:
                longest = min(found.longest_step, GOLDEN * mean)
                found = found._replace(longest_step=longest)
            yield Repeat(found, per_step)
    # Steps of less than half the steps of the run differ from these in any case.
    shortest = tightened(plan, TIGHTER)
    found = session._replace(plan=shortest, longest_step=GOLDEN * GOLDEN * mean)
    yield Repeat(found, per_step)


def tightened(plan: Plan, times: float) -> Plan:
    """Return the plan with a tolerance that is smaller by the factor `times`.

    The tolerance stays between the tightest and the loosest of repeats, and differs
    from that of the run by the factor LOOSER or more.
    """
    rtol = plan.rtol or 0.0
    if rtol:
        rtol = min(max(rtol / times, TIGHTEST_RTOL), LOOSEST)
        assert plan.rtol is not None
        if max(rtol / plan.rtol, plan.rtol / rtol) < (1.0 - 1e-9) * LOOSER:
            rtol = LOOSER * plan.rtol
    factor = rtol / plan.rtol if plan.rtol else 1.0 / times
    atol = None if plan.atol is None else plan.atol * min(factor, 1.0)
    return replace(plan, rtol=rtol, atol=atol)


def steps_of(trajectory: Trajectory) -> tuple[float | None, ...]:
    """Return the counts of steps and the shortest step of a run, to compare runs.

    Two runs with equal results are taken to have equal steps.
    """
    made = trajectory.statistics
    return made.steps, made.rejections, made.smallest_step


def second_session(
    other: Repeat,
    session: Session,
    trajectory: Trajectory,
    finding: Finding,
    allowance: Allowance,
) -> Session:
    """Return the session of a second attempt at a run, from a repeat by other means.

    It has another method, tolerance or formulation, or shorter steps.

    Parameters
    ----------
    other
        The repeat.
    session, trajectory
        The run that failed the audit.
    finding
        The reason.
    allowance
        The budget of operations that is left.
    """
    way, before = other.session, session.plan
    longest = SHORTER * way.longest_step
    least = (trajectory.end - trajectory.start) / longest
    worth = trajectory.statistics.evaluations / PER_ATTEMPT
    second = Repeat(way, PER_ATTEMPT)
    most = max(ENOUGH, int(MORE * worth + AT_LEAST * least))
    way = second.limited(max(1, min(most, allowance.steps(second))))
    rtol = "" if way.plan.rtol is None else f" at rtol {way.plan.rtol:.2g}"
    choice = Choice(
        f"repeated: {way.plan.method}{rtol}, steps up to {longest:.3g}",
        f"{before.method} fails from t = {finding.time:.9g} on: {finding.text}",
    )
    plan = replace(way.plan, choices=(*before.choices, choice))
    return way._replace(plan=plan, longest_step=longest)
