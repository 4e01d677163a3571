"""The parts of the record of one instant: events of the file, surfaces and laws.

Each is frozen data that a phase of `run.settle` receives and returns, see
`run.instant.InstantRecord`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Mapping

    from lagsim.language.arrays import Flags, Floats
    from lagsim.mechanics.equations import Acted
    from lagsim.mechanics.row_modes import RowModes
    from lagsim.run.events.kinematics import Kinematics
    from lagsim.run.events.surface_modes import Selected

    # The names of the located events that acted in one round, and the modes of the file
    # before these acts; for the first round of a phase `acts` the velocities, too.
    Round = tuple[tuple[str, ...], dict[str, float]]
    Visit = tuple[tuple[str, ...], dict[str, float], Floats]


class Due(NamedTuple):
    """Events of the file that are due.

    Attributes
    ----------
    periodic : frozenset of int
        The indices of periodic events.
    conditions : frozenset of int
        The indices of conditions of located events, and of `until` after the last.
    waiting : frozenset of int
        The indices of conditions whose truth is decided later, after the modes of laws
        are selected: where a law may hold a rate at 0 from now on, an expression such
        as `if(x_dot < 0, 1, 0)` depends on the mode.
    begun : Acted or None
        The acts at the start of the run, which have set their modes already.
    """

    periodic: frozenset[int] = frozenset()
    conditions: frozenset[int] = frozenset()
    waiting: frozenset[int] = frozenset()
    begun: Acted | None = None

    @property
    def acts(self) -> bool:
        """Whether any event acts, or `until` is true."""
        return bool(self.periodic or self.conditions)


NOTHING = Due()


class Before(NamedTuple):
    """Table row just before the time reached, and the velocity error there.

    Attributes
    ----------
    row : ndarray, shape (1, k)
        Columns of the table, dated at the time reached.
    off : ndarray, shape (n,)
        Newton step of the velocities onto the constraints: an error by drift, or one
        that stabilization reduces slowly, is not part of an impact.
    compared : bool
        Whether positions after the instant have been compared with the row.
    """

    row: Floats
    off: Floats
    compared: bool = False


class ActsAt(NamedTuple):
    """The events of the file that have acted at an instant.

    Attributes
    ----------
    counts : tuple of int
        The number of acts of each event.
    rounds : tuple of Round
        The rounds of acts at this instant, since the state has last jumped otherwise
        than by impulses of events. A round has the events that act together, and the
        modes of the file before these acts.
    visits : tuple of Visit
        A visit for each start of the phase `acts` at this instant. A repeated visit
        shows that acts and impacts form a cycle. Empty in models without impulses.
    is_over : bool
        Whether `until` has come true.
    waited : frozenset of int
        Conditions whose truth was decided after the laws and surfaces of this instant.
        A condition does not wait again if the motion satisfies it once more before time
        has passed: rounding leaves a step in the condition on its former side.
    """

    counts: tuple[int, ...] = ()
    rounds: tuple[Round, ...] = ()
    visits: tuple[Visit, ...] = ()
    is_over: bool = False
    waited: frozenset[int] = frozenset()


NO_ACTS = ActsAt()


class SurfacesAt(NamedTuple):
    """The switching surfaces at an instant.

    Attributes
    ----------
    levels : mapping of int to float
        The level of each surface that the state is on, by the last phase `sides`.
    located : int
        The surface that was located last, or -1.
    off : float
        The largest distance of the expression of surface `located` from its level;
        negative where the expression has jumped past its level.
    stopped : frozenset of int
        Corners of equalities at which velocities have been stopped.
    selected : Selected or None
        The parts of the modes of surfaces that the kernels do not read, by the last
        phase `sides`.
    shown : frozenset of int
        The surfaces at their levels whose sides only conditions and output depend on,
        and that have been decided at the instant, see `run.events.shown_sides`.
    """

    levels: Mapping[int, float] = {}
    located: int = -1
    off: float = 0.0
    stopped: frozenset[int] = frozenset()
    selected: Selected | None = None
    shown: frozenset[int] = frozenset()


NO_SURFACES = SurfacesAt()


class LawsAt(NamedTuple):
    """The laws at an instant.

    Attributes
    ----------
    mode : ndarray, shape (L,)
        The modes selected last; before the first selection, those of the arc that has
        ended. Listed events are differences of two selections.
    slid : frozenset of int
        Laws that slid in the arc that has ended.
    left : mapping of int to int
        How often each law that held has reached the limit of its multiplier.
    closed : frozenset of int
        Laws that count as closed whatever their gaps are, since they were located.
    rested : frozenset of str
        Contacts whose bounces have ended, which list no event `contact`.
    shared : tuple of (list of int, RowModes, list of int), or None
        Laws and their modes in the problem that the last phase `sides` has solved for
        surfaces and laws together, and the equalities that held in it; None without
        such a problem, and after impacts.
    """

    mode: Floats
    slid: frozenset[int] = frozenset()
    left: Mapping[int, int] = {}
    closed: frozenset[int] = frozenset()
    rested: frozenset[str] = frozenset()
    shared: tuple[list[int], RowModes, list[int]] | None = None


class LawState(NamedTuple):
    """State of the laws at an instant, by the last phase `velocities`.

    Attributes
    ----------
    here : Kinematics
        Gaps, rates and accelerations of the laws.
    striking : list of int
        The laws that are closed and can strike.
    steady : ndarray of bool, shape (L,), or None
        A mask of the laws whose motion no impact at this instant has changed, see
        `law_modes.steady_laws`; None if the modes of all laws are to be decided.
    """

    here: Kinematics
    striking: list[int]
    steady: Flags | None = None
