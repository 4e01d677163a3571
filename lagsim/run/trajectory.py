"""Result of a run (outcome, counts, events), and the base class of event sources.

A `Source` pauses or ends arcs and returns a `Decision`, which the run carries out.
"""

from __future__ import annotations

from enum import Enum
from typing import TYPE_CHECKING, Any, NamedTuple, cast

from lagsim.codes import known
from lagsim.notes import Caution
from lagsim.run.interrupt import MOST_STEPS

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from lagsim.codes.known import ErrorCode, WarningCode
    from lagsim.language.arrays import Floats
    from lagsim.notes import Choice, Event
    from lagsim.run.arc import Arc
    from lagsim.run.event_store import EventList


class Outcome(Enum):
    """Outcome of a run: a word, or the code of its failure."""

    DONE = "done"
    UNTIL = "until"
    INTERRUPTED = "interrupted"
    STEP_TOO_SMALL = known.STEP_TOO_SMALL
    TOO_MANY_STEPS = known.TOO_MANY_STEPS
    NOT_FINITE = known.VALUES_NOT_FINITE
    PROJECTION_FAILED = known.PROJECTION_FAILED
    NEWTON_FAILED = known.NEWTON_FAILED
    CONSTRAINT_JUMPS = known.CONSTRAINT_JUMPS
    SWITCHES_ACCUMULATE = known.SWITCHES_ACCUMULATE
    NO_ANSWER = known.NO_ANSWER
    PARADOX = known.PARADOX
    STATE_JUMPS = known.STATE_JUMPS
    LAW_OUT_OF_RANGE = known.LAW_OUT_OF_RANGE
    EVENTS_CHATTER = known.EVENTS_CHATTER
    TABLE_ENDS = known.TABLE_ENDS
    UNDETERMINED_SLIDERS = known.UNDETERMINED_SLIDERS

    @property
    def failed(self) -> bool:
        """Whether the run ended early, and not by an interrupt."""
        return not self.complete and self is not Outcome.INTERRUPTED

    @property
    def word(self) -> str:
        """Name of the outcome in run.json; `failed` for all failures."""
        return "failed" if self.failed else str(self.value)

    @property
    def failure(self) -> dict[str, Any] | None:
        """Entry of run.json for a failure: code, number, advice; or None."""
        if not self.failed:
            return None
        from lagsim.codes import failure

        return failure(cast("ErrorCode", self.value))

    @property
    def advice(self) -> str:
        """Advice on a failure; empty if the run did not fail."""
        found = self.failure
        return found["hint"] if found else ""

    @property
    def complete(self) -> bool:
        """Whether the run reached its end time or its `until` condition."""
        return self in (Outcome.DONE, Outcome.UNTIL)


class Statistics(NamedTuple):
    """Operation counts of a run, and its smallest step.

    Attributes
    ----------
    steps, rejections : int
        Numbers of accepted and of rejected steps.
    evaluations : int
        Number of evaluations of y', or of its series.
    factorisations : int
        Number of factorisations of matrices.
    smallest_step : float or None
        Size of the smallest step; None if there were only a few steps.
    arcs : int
        Number of arcs; an arc is counted at its start.
    """

    steps: int = 0
    rejections: int = 0
    evaluations: int = 0
    factorisations: int = 0
    smallest_step: float | None = None
    arcs: int = 0


class Trajectory(NamedTuple):
    """Result of a run, without its rows, which were passed to the observers.

    Attributes
    ----------
    outcome : Outcome
        How the run ended.
    reason : str
        The reason why the run ended, as text.
    start, end : float
        Time at the start, and the time reached.
    rows : int
        Number of rows.
    statistics : Statistics
        Counts of operations.
    events : sequence of Event
        At most the first 10,000 events.
    listed : EventList or None
        Has received all events.
    event_counts : mapping of str to int
        Number of events of each kind, listed in `events` or not.
    warnings, choices
        The cautions, and the choices made during the run.
    extents : mapping
        Least and greatest value of components of the state over the steps, by name, if
        they were recorded.
    largest_energy : float
        Largest kinetic energy, or change of the potential energy, at the ends of steps.
    """

    outcome: Outcome
    reason: str
    start: float
    end: float
    rows: int
    statistics: Statistics
    events: Sequence[Event] = ()
    listed: EventList | None = None
    event_counts: Mapping[str, int] = {}
    warnings: Sequence[Caution] = ()
    choices: Sequence[Choice] = ()
    extents: Mapping[str, tuple[float, float]] = {}
    largest_energy: float = 0.0


class Turn(Enum):
    """Continuation of a run after a decision: go on, begin another arc, or settle."""

    NONE = "the arc goes on"
    ARC = "another arc begins, in the same modes"
    SETTLE = "the instant is settled, then another arc begins"


class Located(NamedTuple):
    """The event function of a mode whose zero has ended an arc.

    Attributes
    ----------
    surface, law : int
        The index of the switching surface or of the law; -1 for none.
    off : float
        Largest distance of the surface's expression from its level, by the error of
        the time located; negative where the expression jumps past its level.
    begins : bool
        Whether the run begins, before which there is no arc.
    """

    surface: int = -1
    law: int = -1
    off: float = 0.0
    begins: bool = False


NOWHERE = Located()
STARTED = Located(begins=True)


class Ending(NamedTuple):
    """End of a run.

    Attributes
    ----------
    outcome : Outcome
        How the run ends.
    about : str
        A text on the cause: constraints, switches, a mode.
    """

    outcome: Outcome
    about: str = ""


def quoted(names: Iterable[str]) -> str:
    """Return names for a message: quoted, separated by commas, without duplicates."""
    return ", ".join(f"`{name}`" for name in dict.fromkeys(names))


class JumpImpulses(NamedTuple):
    """The impulses that laws and equalities transmit in a jump of velocities.

    Attributes
    ----------
    laws : ndarray, shape (L,)
        Impulses of the laws: contacts, friction, limits, freewheels.
    rows : ndarray, shape (E,)
        Impulses of equalities, in a model whose events give impulses; else empty.
    """

    laws: Floats
    rows: Floats


class Decision(NamedTuple):
    """Decision of a source of events.

    Attributes
    ----------
    events, cautions, choices
        Records to be added to the result of the run.
    arc : Arc or None
        Arc that replaces the current one.
    numbers
        New values of fields of the state's header, by their names in
        `methods.parts.state`.
    sizes : ndarray, shape (size,), or None
        New magnitudes of the components of the state.
    y : ndarray, shape (size,), or None
        State after a jump.
    rows : ndarray, shape (1, k), or None
        Columns just before the jump, to be written as a row.
    impulses : JumpImpulses or None
        The impulses transmitted in the jump.
    ending : Ending or None
        Reason to end the run.
    turn : Turn
        Continuation of the run.
    located : Located
        The event function that has ended the arc, where the instant is settled.
    """

    events: tuple[Event, ...] = ()
    cautions: tuple[Caution, ...] = ()
    choices: tuple[Choice, ...] = ()
    arc: Arc | None = None
    numbers: Mapping[str, float] = {}
    sizes: Floats | None = None
    y: Floats | None = None
    rows: Floats | None = None
    impulses: JumpImpulses | None = None
    ending: Ending | None = None
    turn: Turn = Turn.NONE
    located: Located = NOWHERE

    def after(self, first: Decision) -> Decision:
        """Return this decision for a jump at the time of the jump of `first`.

        The row before the jump is taken from `first`, and the impulses of both are
        added.
        """
        if first.rows is None:
            return self
        given = self.impulses or first.impulses
        if self.impulses is not None and first.impulses is not None:
            laws, rows = self.impulses.laws, self.impulses.rows
            given = JumpImpulses(laws + first.impulses.laws, rows + first.impulses.rows)
        return self._replace(rows=first.rows, impulses=given)


GO_ON = Decision()


class Source:
    """Source of events that pause or end arcs, and of the modes after the events.

    A source may store data about past events. A source returns all changes in a
    `Decision`.
    """

    _warned: frozenset[str] = frozenset()

    def once(
        self, code: WarningCode, text: str, about: str = ""
    ) -> tuple[Caution, ...]:
        """Return a caution, or () if one with this code and subject was returned.

        code, text : the code and the text of the caution.
        about : its subject, such as the name of a law.
        """
        if f"{code} {about}" in self._warned:
            return ()
        self._warned |= {f"{code} {about}"}
        return (Caution(code, text),)

    def times(self, arc: Arc) -> Iterable[float]:  # noqa: ARG002
        """Return times known in advance at which the arc ends; inf for no such time."""
        return ()

    def set_out(self, arc: Arc) -> Decision:  # noqa: ARG002
        """Prepare the source for an arc at its start; return a decision on the arc."""
        return GO_ON

    def passed(self, arc: Arc) -> Decision:  # noqa: ARG002
        """Return a decision with the events that the kernel passed without a return."""
        return GO_ON

    def pause_at(self, arc: Arc) -> int:  # noqa: ARG002
        """Return the number of steps after which `decide` is called next."""
        return MOST_STEPS

    def decide(self, arc: Arc, code: int) -> Decision | None:  # noqa: ARG002
        """Return the decision on a return code of the kernel.

        None where the code is handled by another source.
        """
        return None
