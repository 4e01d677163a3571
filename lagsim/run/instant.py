"""The record of one instant: all that the phases of `settle` hand on to each other.

A record is never changed: each phase returns the next one. The state (q, q', s) and the
modes of the arc are in the memory, which compiled functions read. `settle` writes the
state and the modes between two phases. Everything else that is known of an instant is
here, and nothing of it survives the instant: a record is handed on to the next call of
`settle` only where no time has passed.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from lagsim.run.events.records import NO_ACTS, NO_SURFACES, NOTHING
from lagsim.run.trajectory import NOWHERE

if TYPE_CHECKING:
    from lagsim.language.arrays import Floats
    from lagsim.notes import Caution, Event
    from lagsim.run.arc import Arc
    from lagsim.run.events.records import (
        ActsAt,
        Before,
        Due,
        LawsAt,
        LawState,
        SurfacesAt,
    )
    from lagsim.run.trajectory import Ending, Located


@dataclass(frozen=True)
class InstantRecord:
    """Frozen record of all that is known of one instant; phases return new records.

    Attributes
    ----------
    arc : Arc
        The arc, with the state, and the modes of the file, rows and surfaces.
    t : float
        The time of the instant, which all its events and rows have.
    located : Located
        The event function that has ended the arc.
    due : Due
        The events of the file that act next.
    acts, surfaces, laws
        The events that have acted, the surfaces, and the laws at this instant, see
        `run.events.records`; `laws` is None in a model without laws.
    stale : bool
        Whether the branches of t are to be selected again.
    before : Before or None
        The table row before the events act, in this call of `settle`; None where no
        velocity can jump.
    impacts : bool
        Whether velocities have jumped since conditions were decided.
    admissible : LawState or None
        The laws, where no closed row approaches; None where this is to be decided.
    rows : tuple of ndarray, shape (1, k)
        Rows of jumps that are to be written.
    stored_truth : bool
        Whether the truth of the conditions just before the instant is stored.
    after : ndarray, shape (1, k), or None
        The row after the last jump, which is written once time has advanced.
    events, cautions
        The entries of the run's lists, in the order in which they arose.
    ending : Ending or None
        The reason why the run ends here.
    """

    arc: Arc
    t: float
    located: Located = NOWHERE
    due: Due = NOTHING
    acts: ActsAt = NO_ACTS
    surfaces: SurfacesAt = NO_SURFACES
    laws: LawsAt | None = None
    stale: bool = True
    before: Before | None = None
    impacts: bool = False
    admissible: LawState | None = None
    rows: tuple[Floats, ...] = ()
    stored_truth: bool = False
    after: Floats | None = None
    events: tuple[Event, ...] = ()
    cautions: tuple[Caution, ...] = ()
    ending: Ending | None = None

    def replaced(self, **changes: Any) -> InstantRecord:
        """Return a copy of the record in which some fields have other values."""
        record = object.__new__(InstantRecord)
        fields = record.__dict__
        fields.update(self.__dict__)
        fields.update(changes)
        return record

    @classmethod
    def of(cls, **known: Any) -> InstantRecord:
        """Return the record with the fields `known`; all others have their defaults."""
        record = object.__new__(cls)
        record.__dict__.update(known)
        return record
