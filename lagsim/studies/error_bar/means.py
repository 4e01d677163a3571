"""Other means of making a run again: whether they differ from its own, and their cost.

The cost is counted in operations, so that a rerun is judged alike. Every repeat may
cost some times the run; and all of them together, with what is made anew, no more than
an allowance that the run itself sets.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

from lagsim.plan.plan import ANY
from lagsim.run.states import SERIES
from lagsim.run.system.sleepers import timed

if TYPE_CHECKING:
    from collections.abc import Iterator

    from lagsim.plan.plan import Plan
    from lagsim.run.session import Case, Session
    from lagsim.run.system import System
    from lagsim.run.trajectory import Trajectory

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
# has met with something that the run has not.
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
    """Give about how many operations an evaluation takes, whatever goes with it."""
    operations = float(system.operations)
    if system.plan.method == SERIES and method != SERIES:
        operations /= SERIES_LENGTH
    return operations + OVERHEAD


def own_cost(system: System, trajectory: Trajectory) -> float:
    """Give what the evaluations of a run took."""
    return trajectory.statistics.evaluations * cost(system, system.plan.method)


class Price(NamedTuple):
    """What a step by some means costs, and an arc, in operations."""

    system: System
    method: str
    per_step: float

    @property
    def step(self) -> float:
        """Of a step."""
        return self.per_step * cost(self.system, self.method)

    @property
    def arc(self) -> float:
        """Of an arc, in steps."""
        return ARC / self.step

    def of(self, trajectory: Trajectory) -> float:
        """Of a run."""
        made = trajectory.statistics
        return made.evaluations * cost(self.system, self.method) + ARC * made.arcs


class Allowance:
    """What is left for the judging of a run."""

    def __init__(self, system: System, trajectory: Trajectory) -> None:
        arcs = ARC * trajectory.statistics.arcs
        self.left = WHOLE_TIMES * (own_cost(system, trajectory) + arcs) + WHOLE

    def steps(self, price: Price, system: System, trajectory: Trajectory) -> int:
        """Give how many steps a repeat of a run by `system` may make."""
        own = own_cost(system, trajectory)
        most = min(BUDGET, max(MOST_TIMES * own, ALWAYS))
        most += MOST_ARCS * ARC * trajectory.statistics.arcs
        return int(min(most, self.left) / price.step)

    def most(self, price: Price, steps: int) -> int:
        """Give how many of so many steps may be made."""
        return min(steps, int(self.left / price.step))

    def take(self, price: Price, trajectory: Trajectory) -> None:
        """Take what a run by such means has cost."""
        self.left = max(0.0, self.left - price.of(trajectory))


class Repeat(NamedTuple):
    """Other means of making a run, and the evaluations that a step takes."""

    session: Session
    per_step: float = PER_STEP

    @property
    def price(self) -> Price:
        """What it costs."""
        return Price(self.session.system, self.session.plan.method, self.per_step)


def has_same_steps(
    plan: Plan, trajectory: Trajectory, other: Plan, repeated: Trajectory
) -> bool:
    """Tell whether a repeat has made the very steps of a run: it is then the run.

    Their number and the shortest of them, to the last bit, tell all others.
    """
    mine, theirs = trajectory.statistics, repeated.statistics
    return plan.method == other.method and (
        mine.steps,
        mine.rejections,
        mine.smallest_step,
    ) == (theirs.steps, theirs.rejections, theirs.smallest_step)


def by_other_means(session: Session, trajectory: Trajectory) -> Iterator[Repeat]:
    """Give the ways to make a run again, the best first."""

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
    """Tell whether nothing in a scene can hide from a series, whatever its steps.

    Then other steps are other means enough, and no second method has to be linked.
    """
    return not system.sleepers and not timed(system.equations)


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
    """Give what repeats a method without error control."""
    free = case.asking(method=ANY, formulation="auto", rtol=FREE_RTOL, atol=None)
    return free.ready()._replace(case=case)


def _affordable(
    longest: float, system: System, method: str, trajectory: Trajectory
) -> float:
    """Give a longest step with which steps alone cost no more than they may."""
    span = trajectory.end - trajectory.start
    most = min(max(2.0 * own_cost(system, trajectory), SHORT), BUDGET / 2.0)
    return max(longest, span * PER_STEP * cost(system, method) / most)
