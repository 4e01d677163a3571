"""One run of a session, on which all studies and the error bar depend.

`tried` makes the run, and `Trial` is its result: also that of a run that fails, that
has a start that is not admissible, or that takes too long. The limit of a run is a
number of steps, `Session.most_steps`, or a time, `Patience`. `Compiled` has sessions
whose functions serve later runs.
"""

from __future__ import annotations

import math
import time
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, cast

import numpy as np

from lagsim.errors import InputError, LagsimError
from lagsim.run.interrupt import Interrupt
from lagsim.run.observers import Keep, Moments
from lagsim.run.session import StartError
from lagsim.run.trajectory import Outcome, Statistics, Trajectory

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from lagsim.codes.known import ErrorCode
    from lagsim.language.arrays import Floats
    from lagsim.notes import Event
    from lagsim.plan.plan import Plan
    from lagsim.run.observers import Observer
    from lagsim.run.session import Case, Session

# Outcomes of trials besides the outcomes of runs.
INADMISSIBLE, UNUSABLE, TOO_SLOW = "inadmissible", "unusable", "too slow"
DIED = "died"
COMPLETE = tuple(x.word for x in Outcome if x.complete)
NO_ROWS = np.empty((0, 0))
NOT_BEGUN = Trajectory(Outcome.INTERRUPTED, "", math.nan, math.nan, 0, Statistics())


class Trial(NamedTuple):
    """Result of a run of a study: `trial.column("theta")` has the shape (k,).

    Attributes
    ----------
    outcome : str
        The outcome of the run (`done`, `until`, `failed`, `interrupted`), or
        `inadmissible`, `unusable`, `too slow`, `died` for a run without a result.
    reason : str
        The reason of the end.
    code : str
        The code of a failure or of an error, see `lagsim.codes`.
    columns : tuple of str
        Names of the columns of a row: those of the table, then others for plots.
    rows : ndarray, shape (k, columns)
        Rows of the run, or rows at the times of the variant; nan at a time past the
        end.
    trajectory : Trajectory
        The result without rows: events, numbers of steps and evaluations, end.
    seconds : float
        The time of the integration alone, in s.
    """

    outcome: str
    reason: str = ""
    code: ErrorCode | Literal[""] = ""
    columns: tuple[str, ...] = ()
    rows: Floats = NO_ROWS
    trajectory: Trajectory = NOT_BEGUN
    seconds: float = 0.0

    @property
    def complete(self) -> bool:
        """Whether the run reached its end, or the last of the times of its variant."""
        return self.outcome in COMPLETE

    @property
    def events(self) -> Sequence[Event]:
        """The events of the run, at most 10,000."""
        return self.trajectory.events

    @property
    def statistics(self) -> Statistics:
        """Numbers of steps and evaluations."""
        return self.trajectory.statistics

    @property
    def evaluations(self) -> int:
        """The number of evaluations of the right-hand side."""
        return self.trajectory.statistics.evaluations

    @property
    def end(self) -> float:
        """The time reached; nan for a run that has not begun."""
        return self.trajectory.end

    def column(self, name: str) -> Floats:
        """Return the column with a name, shape (k,).

        Raises
        ------
        KeyError
            If there is no such column, as in a run without a result.
        """
        if name not in self.columns:
            why = f"there is no column `{name}`"
            raise KeyError(why if self.columns else f"{self.outcome}: {self.reason}")
        return np.asarray(self.rows[:, self.columns.index(name)])


class GivenUpError(Exception):
    """A run has exceeded its time limit."""


class Patience:
    """Time limits of runs.

    Attributes
    ----------
    seconds : float
        The limit of one run, in s.
    until : float
        The time of `time.perf_counter` at which every run ends.
    """

    def __init__(self, seconds: float) -> None:
        self.seconds, self.until = seconds, math.inf
        self.begin()

    def begin(self) -> None:
        """Start the clock of a run, to which the limit `seconds` applies."""
        self._end = min(time.perf_counter() + self.seconds, self.until)

    @property
    def over(self) -> bool:
        """Whether the time for all runs has passed."""
        return time.perf_counter() > self.until

    def check(self, _fraction: float = 0.0) -> None:
        """Raise GivenUpError if a time limit has passed."""
        if time.perf_counter() > self._end:
            raise GivenUpError

    def given_up(self) -> Trial:
        """Return the result of a run that has exceeded its limit."""
        return Trial(TOO_SLOW, f"given up after {self.seconds:.2g} s")


class _Ended(Interrupt):
    """Request of an end, by another interrupt or because the last time has passed."""

    def __init__(self, other: Interrupt | None) -> None:
        super().__init__()
        self.other = other

    @property
    def requested(self) -> bool:
        """Whether an end has been requested."""
        return super().requested or (self.other is not None and self.other.requested)


def tried(
    session: Session,
    times: Floats | None = None,
    *,
    observer: Observer | None = None,
    interrupt: Interrupt | None = None,
    patience: Patience | None = None,
    progress: Callable[[float], None] | None = None,
    **records: Any,
) -> Trial:
    """Return the result of one run of a session.

    Parameters
    ----------
    times : ndarray, shape (k,), optional
        Times of the rows, see `trials.Variant`; by default the rows of the run.
    observer : Observer, optional
        Receives the rows of the run, of which the result then has none.
    interrupt : Interrupt, optional
        Requests of an early end.
    patience : Patience, optional
        The time limit of the run.
    progress : callable, optional
        Called with the fraction of the run that is done.
    **records
        Other arguments of `Session.run`: `corners`, `sections`, `listed`, `joined`.

    Examples
    --------
    >>> from lagsim.model.reader import read
    >>> from lagsim.run.session import open_case
    >>> model = read('''
    ... coordinates: {x: {}}
    ... energy: {kinetic: x_dot^2/2, potential: x^2/2}
    ... initial: {x: 1}
    ... simulation: {duration: 10}
    ... ''', "<model>")
    >>> session = open_case(model).ready()
    >>> tried(session, np.array([np.pi])).column("x").round(9)
    array([-1.])
    >>> tried(session._replace(most_steps=3)).code
    'too-many-steps'
    """
    names = session.columns.names
    if times is not None and not len(times):
        return Trial(Outcome.DONE.word, columns=names, rows=np.empty((0, len(names))))
    kept: Observer = observer or Keep()
    places, request = None, interrupt
    if times is not None:
        different, places = np.unique(times, return_inverse=True)
        request = _Ended(interrupt)
        kept = Moments(different, len(names), request)
        session = session.with_settings(moments=tuple(different.tolist()))
    if patience is not None:
        patience.begin()
        progress = patience.check
    began = time.perf_counter()
    try:
        found = session.run([kept], interrupt=request, progress=progress, **records)
    except GivenUpError:
        assert patience is not None
        return patience.given_up()
    seconds = time.perf_counter() - began
    rows = kept.table if isinstance(kept, Keep) else NO_ROWS
    if isinstance(kept, Moments):
        rows = kept.rows[places]
        if np.all(np.isfinite(rows[:, 0])):
            # The run has ended after the last of the times.
            found = found._replace(outcome=Outcome.DONE, reason="")
    outcome = found.outcome
    code = cast("ErrorCode", outcome.value) if outcome.failed else ""
    return Trial(outcome.word, found.reason, code, names, rows, found, seconds)


def refused_trial(error: LagsimError) -> Trial:
    """Return the result of a run that cannot begin, because of an error."""
    if isinstance(error, StartError):
        return Trial(INADMISSIBLE, str(error), error.code)
    reason = str(error)
    if isinstance(error, InputError):
        reason = "; ".join(problem.text for problem in error.problems)
    return Trial(UNUSABLE, reason, error.code)


class Compiled:
    """Sessions compiled for cases of one model, found by the functions they need.

    A session serves all cases whose parameters and settings need its functions.
    """

    def __init__(self) -> None:
        self.known: list[Session] = []

    def fitting(self, case: Case, plan: Plan) -> Session | None:
        """Return a session of `case` with functions compiled before; None if none fit.

        Parameters
        ----------
        plan : Plan
            The plan of the case.
        """
        for session in self.known:
            if session.case.model.graph is case.model.graph:
                found = session.bound(case, plan)
                if found is not None:
                    return found
        return None

    def compile(self, case: Case, plan: Plan, *, quick: bool = False) -> Session:
        """Compile a case by its plan; return the session, kept for later cases.

        quick : as for `Case.ready`.
        """
        self.known.append(case.ready(plan, quick=quick))
        return self.known[-1]

    def session(
        self, case: Case, plan: Plan | None = None, *, quick: bool = False
    ) -> Session:
        """Return the session of a case, compiled if no functions compiled before fit.

        Parameters
        ----------
        plan : Plan, optional
            The plan of the case, by default its own.
        quick : bool
            As for `Case.ready`.

        Raises
        ------
        InputError
            If the requested method or formulation cannot handle the model.
        """
        plan = plan or case.plan()
        return self.fitting(case, plan) or self.compile(case, plan, quick=quick)
