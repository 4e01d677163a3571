"""What a run gives: its outcome, its counts, its events."""

from __future__ import annotations

from enum import Enum
from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from lagsim.notes import Caution, Choice, Event


class Outcome(Enum):
    """How a run ended: as a word, or as the code of what kept it from its end."""

    DONE = "done"
    UNTIL = "until"
    INTERRUPTED = "interrupted"
    STEP_TOO_SMALL = "step-too-small"
    TOO_MANY_STEPS = "too-many-steps"
    NOT_FINITE = "values-not-finite"
    PROJECTION_FAILED = "projection-failed"
    NEWTON_FAILED = "newton-failed"
    CONSTRAINT_JUMPS = "constraint-jumps"
    SWITCHES_ACCUMULATE = "switches-accumulate"
    NO_ANSWER = "no-answer"
    PARADOX = "paradox"
    STATE_JUMPS = "state-jumps"

    @property
    def failed(self) -> bool:
        """Whether something kept the run from its end, but for a signal."""
        return not self.complete and self is not Outcome.INTERRUPTED

    @property
    def word(self) -> str:
        """What run.json says."""
        return "failed" if self.failed else str(self.value)

    @property
    def failure(self) -> dict[str, Any] | None:
        """What run.json says more of a failure: code, number, what to try."""
        if not self.failed:
            return None
        from lagsim.codes import failure

        return failure(self.value)

    @property
    def advice(self) -> str:
        """What to try where it failed."""
        found = self.failure
        return found["hint"] if found else ""

    @property
    def complete(self) -> bool:
        """Whether all that was asked for has been computed."""
        return self in (Outcome.DONE, Outcome.UNTIL)


class Statistics(NamedTuple):
    """Counts of the work done, and the smallest step; None after a few steps only.

    `arcs` are counted as they begin.
    """

    steps: int = 0
    rejections: int = 0
    evaluations: int = 0
    factorisations: int = 0
    smallest_step: float | None = None
    arcs: int = 0


class Trajectory(NamedTuple):
    """The result of a run; its rows have gone to the observers.

    `reason` says in words why it ended where it did; `end` is the time reached;
    `event_counts` how many events of each kind there were, listed in `events` or not;
    `choices` are those made on the way; `extents` the least and the greatest value of
    components of the state over the steps, where they were noted. `largest_energy` is
    the largest kinetic energy, or change of the potential, at the ends of steps.
    """

    outcome: Outcome
    reason: str
    start: float
    end: float
    rows: int
    statistics: Statistics
    events: Sequence[Event] = ()
    event_counts: Mapping[str, int] = {}
    warnings: Sequence[Caution] = ()
    choices: Sequence[Choice] = ()
    extents: Mapping[str, tuple[float, float]] = {}
    largest_energy: float = 0.0
