"""Orderly interruption of a run by signals, without loss of computed rows.

`Horizon` predicts whether a run can reach its end at all.
"""

from __future__ import annotations

import contextlib
import itertools
import math
import signal
import threading
import time
from typing import TYPE_CHECKING

from lagsim.limits import STEPS

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator


# Default of the largest number of steps of a run.
MOST_STEPS = STEPS
# Number of steps before the first prediction of a run's end, doubled after each one;
# and number of times that are compared.
FIRST_CHECK, COMPARED = 1 << 13, 6
# Largest ratio of the times covered by successive doublings of the steps that counts as
# no progress: the ratio is larger if the steps grow as a power of the time below 4.
SLOWER = 1.2
# Rejections for each step of the last doubling beyond which steps do not converge.
REJECTED = 0.9


class Horizon:
    """Prediction of a time that the steps of a run approach but do not pass.

    Near t0, steps through sin(1/(t - t0)) are proportional to (t - t0)^2, so that each
    doubling of their number covers half of the time that the doubling before covered.
    For a motion whose frequency grows as exp(t), all doublings cover equal times. Where
    nearly each step is rejected once, as for a state off a singular configuration by
    rounding, the steps are equal and the error estimate is rounding: a prediction is
    made for these as well.

    Attributes
    ----------
    pause_at : int
        Number of steps at which the next prediction is due.
    """

    def __init__(self) -> None:
        self.pause_at = FIRST_CHECK
        self._times: list[float] = []
        self._rejected = 0

    def before(
        self, end: float, t: float, steps: int, rejected: int, most: int
    ) -> float | None:
        """Return the time before `end` that `most` steps will not pass, or None.

        Parameters
        ----------
        end : float
            End of the run.
        t, steps, rejected
            Current time, and numbers of steps and of rejected steps so far.
        most : int
            Largest number of steps of the run.
        """
        if steps < self.pause_at:
            return None
        self.pause_at *= 2
        mostly = rejected - self._rejected > REJECTED * 0.5 * steps
        self._rejected = rejected
        self._times = [*self._times[1 - COMPARED :], t]
        took = [b - a for a, b in itertools.pairwise(self._times)]
        if len(took) < COMPARED - 1 or min(took) <= 0.0:
            return None
        share = max(b / a for a, b in itertools.pairwise(took))
        if share > SLOWER and not mostly:
            return None
        doublings, left = max(0.0, math.log2(most / steps)), 0.0
        for k in range(1, 1 + math.ceil(doublings)):
            left += took[-1] * share**k
        return t + left if t + left < end else None


ENDING = (signal.SIGINT, signal.SIGTERM)
"""The signals that request an end."""

AGAIN_SECONDS = 0.2
"""Time after a signal, in s, within which a second one counts as a repetition.

`timeout` sends two signals.
"""

heard: list[int] = []
"""Signals since a command began; the exception of such a signal may be lost."""

_noting: list[Interrupt] = []


class Terminated(BaseException):
    """Exception raised by SIGTERM, so that unfinished files are removed."""


class Interrupt:
    """Request of an orderly end: records SIGINT and SIGTERM instead of raising.

    Attributes
    ----------
    signal : int or None
        Number of the first recorded signal.
    """

    def __init__(self) -> None:
        self.signal: int | None = None
        self._since = 0.0
        self._stopped = False
        self._raises = False

    @property
    def requested(self) -> bool:
        """Whether an end has been requested."""
        return self._stopped or self.signal is not None

    def stop(self) -> None:
        """Request an end of the run, as a store of rows does when it is full."""
        self._stopped = True

    def prompt(self, _number: int, _frame: object) -> None:
        """Handle a signal: raise KeyboardInterrupt within the context `raised`."""
        if self._raises:
            raise KeyboardInterrupt

    @contextlib.contextmanager
    def noted(self) -> Iterator[Interrupt]:
        """Record signals within the context (in the main thread only).

        A second signal raises an exception, for code that does not end by itself. A
        signal that is ignored by the calling program stays ignored: by `nohup`,
        `trap '' INT`, or the `&` of a shell script.
        """
        if threading.current_thread() is not threading.main_thread():
            yield self
            return
        kinds = [kind for kind in ENDING if not ignored(kind)]
        before = [signal.signal(kind, self._note) for kind in kinds]
        _noting.append(self)
        if heard:  # a signal whose exception was lost, since execution continues here
            self.signal, self._since = heard[0], time.monotonic()
        try:
            yield self
        finally:
            _noting.remove(self)
            for kind, handler in zip(kinds, before, strict=True):
                signal.signal(kind, handler)

    @contextlib.contextmanager
    def raised(self) -> Iterator[None]:
        """Raise exceptions on signals within the context.

        Use this for code whose early end loses no results.

        Raises
        ------
        KeyboardInterrupt, Terminated
            On entry, if an end has been requested before.
        """
        if self.requested:
            raise exception_of(self.signal)
        before, self._raises = self._raises, True
        try:
            yield
        finally:
            self._raises = before

    def cut(self, work: Callable[[], object]) -> bool:
        """Call `work` such that a signal ends it; return whether it finished.

        The work must be such that no result is lost if it ends early.
        """
        try:
            with self.raised():
                work()
        except (KeyboardInterrupt, Terminated):
            if not self.requested:
                raise
            return False
        return True

    def _note(self, number: int, _frame: object) -> None:
        now = time.monotonic()
        again = self.signal is not None and now > self._since + AGAIN_SECONDS
        if self.signal is None:
            self.signal, self._since = number, now
        if again or self._raises:
            raise exception_of(number)


def noting() -> bool:
    """Whether a context `Interrupt.noted` is active, which records signals."""
    return bool(_noting)


def exception_of(number: int | None) -> BaseException:
    """Return the exception for a signal number.

    Terminated for SIGTERM, else KeyboardInterrupt, also for None.
    """
    return Terminated() if number == signal.SIGTERM else KeyboardInterrupt()


def ignored(kind: signal.Signals) -> bool:
    """Whether the program was started with a signal ignored."""
    return signal.getsignal(kind) is signal.SIG_IGN
