"""Result of a run: outcome, counts, events; and the sources of events.

A `Source` pauses or ends arcs and answers with a `Decision`, on which the run acts.
"""

from __future__ import annotations

from enum import Enum
from math import inf
from typing import TYPE_CHECKING, Any, NamedTuple

from lagsim.notes import Caution
from lagsim.run.interrupt import MOST_STEPS

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from lagsim.language.arrays import Floats
    from lagsim.notes import Choice, Event
    from lagsim.run.arc import Arc


class Outcome(Enum):
    """Outcome of a run: a word, or the code of its failure."""

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
    LAW_OUT_OF_RANGE = "law-out-of-range"
    EVENTS_CHATTER = "events-chatter"
    TABLE_ENDS = "table-ends"
    UNDETERMINED_SLIDERS = "undetermined-sliders"

    @property
    def failed(self) -> bool:
        """Whether something kept the run from its end, but for a signal."""
        return not self.complete and self is not Outcome.INTERRUPTED

    @property
    def word(self) -> str:
        """Outcome in run.json."""
        return "failed" if self.failed else str(self.value)

    @property
    def failure(self) -> dict[str, Any] | None:
        """Entry of run.json for a failure: code, number, advice."""
        if not self.failed:
            return None
        from lagsim.codes import failure

        return failure(self.value)

    @property
    def advice(self) -> str:
        """Advice for a failure."""
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


class Turn(Enum):
    """Continuation of a run."""

    NONE = "the arc goes on"
    ARC = "another arc begins, in the mode that there is"
    MODE = "another arc begins, in a mode that has been set"
    MODES = "another arc begins, and all sources set their modes"


class Ending(NamedTuple):
    """End of a run; `about` names the constraints or switches that end it."""

    outcome: Outcome
    about: str = ""


def quoted(names: Iterable[str]) -> str:
    """Names as a message has them, each once."""
    return ", ".join(f"`{name}`" for name in dict.fromkeys(names))


class Decision(NamedTuple):
    """Decision of a source of events.

    Attributes
    ----------
    events, cautions, choices
        To be kept.
    arc : Arc or None
        Takes the place of the one that there was.
    numbers
        Of the state's header, by their names in `methods.parts.state`.
    sizes : ndarray or None
        What counts as the sizes of the components (size,).
    y : ndarray or None
        The state jumps to it.
    rows : ndarray or None
        Columns (1, k) to be shown from before it jumps.
    ending : Ending or None
        The run ends.
    turn : Turn
    ahead : float
        The arc that begins is looked at again at this time.
    """

    events: tuple[Event, ...] = ()
    cautions: tuple[Caution, ...] = ()
    choices: tuple[Choice, ...] = ()
    arc: Arc | None = None
    numbers: Mapping[str, float] = {}
    sizes: Floats | None = None
    y: Floats | None = None
    rows: Floats | None = None
    ending: Ending | None = None
    turn: Turn = Turn.NONE
    ahead: float = inf


GO_ON = Decision()


class Source:
    """Source of events, which pause or end arcs, and of the motion after them.

    It may remember what it has seen, and changes nothing else than the mode that it
    answers for.
    """

    _warned: frozenset[str] = frozenset()

    def once(self, code: str, text: str, about: str = "") -> tuple[Caution, ...]:
        """Warn, unless that has been done by this code, and about the same things."""
        if f"{code} {about}" in self._warned:
            return ()
        self._warned |= {f"{code} {about}"}
        return (Caution(code, text),)

    def begin(self, arc: Arc) -> Decision:  # noqa: ARG002
        """Set the mode at the state reached, where all of them are set."""
        return GO_ON

    def times(self, arc: Arc) -> Iterable[float]:  # noqa: ARG002
        """Return times known in advance at which an arc ends; inf where none is."""
        return ()

    def set_out(self, arc: Arc) -> Decision:  # noqa: ARG002
        """Prepare an arc that begins."""
        return GO_ON

    def passed(self, arc: Arc) -> Decision:  # noqa: ARG002
        """Take note of what the kernel has gone through by itself."""
        return GO_ON

    def ask_at(self, arc: Arc) -> int:  # noqa: ARG002
        """Return the number of steps after which `decide` is called next."""
        return MOST_STEPS

    def decide(self, arc: Arc, code: int) -> Decision | None:  # noqa: ARG002
        """Answer what the kernel has returned for; None where it is another's."""
        return None
