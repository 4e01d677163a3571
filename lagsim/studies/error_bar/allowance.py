"""What judging a run may cost: counted in operations, so that a rerun is judged alike.

Every repeat may cost some times the run; and all of them together, with what is made
anew, no more than an allowance that the run itself sets.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from lagsim.run.states import SERIES

if TYPE_CHECKING:
    from lagsim.run.system import System
    from lagsim.run.trajectory import Trajectory

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
