"""An end that is asked for in order, so that nothing computed is lost.

Besides, whether a run will ever come to its end.
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


# More steps than any run makes, unless it is told otherwise.
MOST_STEPS = STEPS
# Steps at which it is first asked whether a run comes to its end, then twice as many;
# and so many times are compared.
ASKED, COMPARED = 1 << 13, 6
# Twice the steps bring no more than so many times what half of them brought: of a
# frequency that grows as a power of the time, steps grow with a lower one than 4.
SLOWER = 1.2


class Horizon:
    """Time to which the steps lead: no number of steps passes it.

    Near t0, steps through sin(1/(t - t0)) are proportional to (t - t0)^2, so that each
    doubling of their number brings half of the time that the one before has brought.
    Where a motion turns ever faster, as exp(t), each doubling brings the same.

    Attributes
    ----------
    ask_at : int
        The steps after which it is asked next.
    """

    def __init__(self) -> None:
        self.ask_at = ASKED
        self._times: list[float] = []

    def before(self, end: float, t: float, steps: int, most: int) -> float | None:
        """Time before `end` that `most` steps will not pass, if there is one.

        Parameters
        ----------
        t, steps
            The time reached, and the steps made.
        """
        if steps < self.ask_at:
            return None
        self.ask_at *= 2
        self._times = [*self._times[1 - COMPARED :], t]
        took = [b - a for a, b in itertools.pairwise(self._times)]
        if len(took) < COMPARED - 1 or min(took) <= 0.0:
            return None
        share = max(b / a for a, b in itertools.pairwise(took))
        if share > SLOWER:
            return None
        doublings, left = max(0.0, math.log2(most / steps)), 0.0
        for k in range(1, 1 + math.ceil(doublings)):
            left += took[-1] * share**k
        return t + left if t + left < end else None


ENDING = (signal.SIGINT, signal.SIGTERM)
"""The signals that ask for an end."""

AGAIN_SECONDS = 0.2
"""A signal that comes so soon after another is the same wish: `timeout` sends two."""

heard: list[int] = []
"""The signals that were raised since a command began; one that raises may be lost."""

_noting: list[Interrupt] = []


class Terminated(BaseException):
    """SIGTERM, raised where it arrives so that what was begun is removed."""


class Interrupt:
    """Ends runs in order: notes SIGINT and SIGTERM instead of raising.

    Attributes
    ----------
    signal : int or None
        What the user has sent.
    """

    def __init__(self) -> None:
        self.signal: int | None = None
        self._since = 0.0
        self._stopped = False
        self._raises = False

    @property
    def asked(self) -> bool:
        """Whether an end has been requested."""
        return self._stopped or self.signal is not None

    def stop(self) -> None:
        """Ask for an end, as one does who takes rows and can take no more."""
        self._stopped = True

    def prompt(self, _number: int, _frame: object) -> None:
        """Raise, as the handler of a signal, where an end loses nothing."""
        if self._raises:
            raise KeyboardInterrupt

    @contextlib.contextmanager
    def noted(self) -> Iterator[Interrupt]:
        """Note the signals while the context lasts (in the main thread only).

        A second one raises, for what does not end in order. A signal that the caller
        had ignored stays so: `nohup`, `trap '' INT`, or the `&` of a shell script.
        """
        if threading.current_thread() is not threading.main_thread():
            yield self
            return
        kinds = [kind for kind in ENDING if not ignored(kind)]
        before = [signal.signal(kind, self._note) for kind in kinds]
        _noting.append(self)
        if heard:  # what it raised has come to nobody, or this were not reached
            self.signal, self._since = heard[0], time.monotonic()
        try:
            yield self
        finally:
            _noting.remove(self)
            for kind, handler in zip(kinds, before, strict=True):
                signal.signal(kind, handler)

    @contextlib.contextmanager
    def raised(self) -> Iterator[None]:
        """Let signals raise after all, where nothing is lost that they end.

        Raises
        ------
        KeyboardInterrupt, Terminated
            Here, where somebody has asked for an end before.
        """
        if self.asked:
            raise exception_of(self.signal)
        before, self._raises = self._raises, True
        try:
            yield
        finally:
            self._raises = before

    def cut(self, work: Callable[[], object]) -> bool:
        """Do what a noted signal may end without loss; return whether it was done."""
        try:
            with self.raised():
                work()
        except (KeyboardInterrupt, Terminated):
            if not self.asked:
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
    """Whether signals are noted: there is something to be kept."""
    return bool(_noting)


def exception_of(number: int | None) -> BaseException:
    """Return what a signal raises."""
    return Terminated() if number == signal.SIGTERM else KeyboardInterrupt()


def ignored(kind: signal.Signals) -> bool:
    """Whether whoever started this program has it ignore a signal."""
    return signal.getsignal(kind) is signal.SIG_IGN
