"""What a run gives: its outcome, its counts, its events."""

from __future__ import annotations

from enum import Enum
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from lagsim.notes import Caution, Choice, Event


class Outcome(Enum):
    """How a run ended; `word` is what run.json says, `advice` what to try."""

    DONE = "done", ""
    UNTIL = "until", ""
    STEP_TOO_SMALL = (
        "failed",
        """the motion runs into a singularity (a division by zero, a coordinate that
        loses its meaning) or is very stiff: look at the component named, stop before
        that time, choose other coordinates there, or loosen rtol""",
    )
    TOO_MANY_STEPS = (
        "failed",
        """the motion has much faster parts than the run is long: shorten the duration,
        or look for a stiffness or a frequency that is larger than it should be""",
    )
    NOT_FINITE = (
        "failed",
        """an energy, a force or a constraint has no finite value there (a root or a
        logarithm of something negative, a division by zero): check the expressions
        near this state""",
    )
    PROJECTION_FAILED = (
        "failed",
        """the constraints cannot all be met near this state: the mechanism is at a dead
        point or taken apart, or a fixed step is too large""",
    )
    NEWTON_FAILED = (
        "failed",
        """the motion runs into a singularity there, a force jumps, or a step is too
        large for how strongly the forces bend: look at this state""",
    )
    CONSTRAINT_JUMPS = (
        "failed",
        """a moving constraint may change its speed at once, not its position: join the
        pieces of its motion""",
    )
    SWITCHES_ACCUMULATE = (
        "failed",
        """no motion leads on from there: change the forces near their switches, or stop
        before that time""",
    )
    NO_ANSWER = (
        "failed",
        """the constraints contradict each other from there on, or no method follows the
        motion through what happens there: look at the scene around that time, or stop
        before it""",
    )
    PARADOX = (
        "failed",
        """friction and the bodies' inertia leave no motion there (Painleve): less
        friction, or a body that yields a little, would""",
    )
    STATE_JUMPS = (
        "failed",
        """positions never jump, and velocities only at an impact: the rows up to there
        stand. This is a fault of lagsim's: please report the model""",
    )
    INTERRUPTED = "interrupted", ""

    def __init__(self, word: str, advice: str) -> None:
        self.word = word
        self.advice = " ".join(advice.split())

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
    components of the state over the steps, where they were noted.
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
