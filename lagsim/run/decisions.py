"""What helpers of a run find, for the run to act on; and what they have in common."""

from __future__ import annotations

from enum import Enum
from math import inf
from typing import TYPE_CHECKING, NamedTuple

from lagsim.run.pace import MOST_STEPS

if TYPE_CHECKING:
    from collections.abc import Mapping

    from lagsim.language.arrays import Floats
    from lagsim.notes import Caution, Choice, Event
    from lagsim.run.arc import Arc
    from lagsim.run.trajectory import Outcome


class Turn(Enum):
    """How a run goes on."""

    NONE = "the arc goes on"
    ARC = "another arc begins, in the mode that there is"
    MODE = "another arc begins, in a mode that has been set"
    MODES = "another arc begins, and all sources set their modes"


class Ending(NamedTuple):
    """How a run ends; `about` names the constraints or switches that end it."""

    outcome: Outcome
    about: str = ""


class Decision(NamedTuple):
    """What a source has found.

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
    """Something that pauses or ends arcs, and knows how the motion goes on.

    It may remember what it has seen, and changes nothing else than the mode that it
    answers for.
    """

    def begin(self, arc: Arc) -> Decision:  # noqa: ARG002
        """Set the mode at the state reached, where all of them are set."""
        return GO_ON

    def limit(self, arc: Arc) -> float:  # noqa: ARG002
        """Give the time at which an arc that begins ends at the latest."""
        return inf

    def set_out(self, arc: Arc) -> Decision:  # noqa: ARG002
        """Tell what an arc that begins has to know."""
        return GO_ON

    def ask_at(self, arc: Arc) -> int:  # noqa: ARG002
        """Give the number of steps after which it wants to be asked."""
        return MOST_STEPS

    def decide(self, arc: Arc, code: int) -> Decision | None:  # noqa: ARG002
        """Answer what the kernel has returned for; None where it is another's."""
        return None
