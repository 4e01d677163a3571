"""Runs at the times of a record, and their derivatives, by several processes.

Every process computes derivatives by some of the names for some of the records.
"""

from __future__ import annotations

import contextlib
import time
from typing import TYPE_CHECKING, Any, NamedTuple, Self

from lagsim.errors import LagsimError
from lagsim.run.interrupt import Interrupt
from lagsim.studies.fit.names import CLOCK
from lagsim.studies.sensitivities import Derivative, Sensitivities
from lagsim.studies.trial import UNUSABLE, Trial
from lagsim.studies.workers import Died, completed_pieces, cores, shared_processes

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping, Sequence
    from types import TracebackType

    from lagsim.language.arrays import Floats
    from lagsim.model.model import Model
    from lagsim.studies.fit.names import Varied
    from lagsim.studies.trials import Trials, Variant
    from lagsim.studies.workers import Workers

# Processor time of a Jacobian, in s, above which further processes are started.
WORTH_SECONDS = 0.5


class Setup(NamedTuple):
    """Settings that all runs of a fit share.

    Attributes
    ----------
    model : Model
    trials : Trials
    columns : tuple of str
        Columns of the runs to be compared and differentiated.
    method : str
    span : tuple of float
        Start and end of the runs.
    clocked : bool
        Whether `t0` is the difference of the clocks, not a parameter of the model.
    guesses : collection of str
        Start values that follow as the constraints require.
    """

    model: Model
    trials: Trials
    columns: tuple[str, ...]
    method: str
    span: tuple[float, float]
    clocked: bool
    guesses: Collection[str] = ()

    def clock(self, values: Mapping[str, float]) -> float:
        """Return the difference of the clocks of record and run; 0 by default.

        values : values of the names, among these `t0` if it is this difference.
        """
        return values.get(CLOCK, 0.0) if self.clocked else 0.0


class Recording(Sensitivities):
    """Runs with rows at the times of a record, and their derivatives.

    If `t0` is a name of the fit, it is the difference of the clocks of record and run,
    and no parameter of the model: data at time t are compared with the run at t - t0.

    Parameters
    ----------
    setup : Setup
    values : mapping of str to float
        Values of the names.
    times : ndarray, shape (k,)
        Times on the clock of the record.
    columns : sequence of str, optional
        Columns to be compared and differentiated, by default the columns of the setup.
    centre : Trial, optional
        The run at the values, if it is known.
    interrupt : Interrupt, optional
        Requests of an early end.
    """

    def __init__(
        self, setup: Setup, values: Mapping[str, float], times: Floats, *,
        columns: Sequence[str] | None = None, centre: Trial | None = None,
        interrupt: Interrupt | None = None,
    ) -> None:  # fmt: skip
        self.setup = setup
        super().__init__(
            setup.model, times=times, values=values, guesses=setup.guesses,
            columns=setup.columns if columns is None else columns,
            trials=setup.trials, method=setup.method, centre=centre,
            interrupt=interrupt,
        )  # fmt: skip

    def _variant(
        self, values: Mapping[str, float], guesses: Collection[str] = ()
    ) -> Variant:
        variant = super()._variant(values, guesses)
        if not self.setup.clocked:
            return variant
        at = dict(variant.values)
        clock = float(at.pop(CLOCK, 0.0))
        return variant._replace(values=at, times=self.times - clock)

    def trial(self, name: str, value: float, solved: bool) -> Trial:
        """Return the run in which the parameter or start value `name` is `value`.

        The run is unusable if t0 moves times of the data outside of the run.

        solved : see `Sensitivities.trial`.
        """
        if self.setup.clocked and name == CLOCK:
            low, high = self.times[0] - value, self.times[-1] - value
            if low < self.setup.span[0] or high > self.setup.span[1]:
                return Trial(UNUSABLE, "the times of the data are outside the run")
        return super().trial(name, value, solved)


class Task(NamedTuple):
    """Task of a worker: derivatives of the run of one record by one varied name.

    Attributes
    ----------
    setup, values, times, centre
        See `Recording`.
    name : Varied
    how : dict
        Options of `Sensitivities.by`.
    number : int
        Number of the record, from 0.
    """

    setup: Setup
    values: Mapping[str, float]
    times: Floats
    centre: Trial
    name: Varied
    how: Mapping[str, Any]
    number: int


def _differentiated(task: Task, interrupt: Interrupt) -> Derivative | LagsimError:
    """Compute the derivatives that a task requests; return a LagsimError, if any."""
    try:
        recording = Recording(
            task.setup, task.values, task.times, centre=task.centre,
            interrupt=interrupt,
        )  # fmt: skip
        return recording.by(task.name.name, scale=task.name.scale, **task.how)
    except LagsimError as error:
        return error


class Team:
    """Context manager: processes that compute the derivatives of a fit.

    Further processes begin when a Jacobian has taken long, or if their number is given.

    Parameters
    ----------
    jobs : int or None
        The number of processes; None for one on each core, where that saves time.
    """

    def __init__(self, jobs: int | None) -> None:
        self.most, self._in_parallel = jobs or cores(), jobs is not None
        self._workers: Workers | None = None
        self._stack = contextlib.ExitStack()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._workers = None
        self._stack.close()

    def derivatives(
        self,
        tasks: Sequence[Task],
        runs: Sequence[Recording],
        interrupt: Interrupt | None,
    ) -> list[Derivative]:
        """Return the derivatives of all tasks; fewer after an interrupt.

        runs : the recordings of this process, by the index of their record.
        """
        known: dict[int, Derivative | LagsimError | Died] = {}
        if self._in_parallel and self.most > 1 and len(tasks) > 1:
            interrupt = interrupt or Interrupt()
            self._workers = self._workers or self._stack.enter_context(
                shared_processes(self.most)
            )
            known |= completed_pieces(
                _differentiated, tasks, self.most, interrupt, self._workers
            )
        began, found = time.process_time(), list[Derivative]()
        for k, task in enumerate(tasks):
            if interrupt is not None and interrupt.requested:
                break
            one = known.get(k, Died())
            if isinstance(one, Died):
                run = runs[task.number]
                one = run.by(task.name.name, scale=task.name.scale, **task.how)
            if isinstance(one, LagsimError):
                raise one
            found.append(one)
        self._in_parallel |= time.process_time() - began > WORTH_SECONDS
        return found
