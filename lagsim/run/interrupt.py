"""An end that is asked for in order, so that nothing computed is lost."""

from __future__ import annotations

import contextlib
import signal
import threading
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator


class Interrupt:
    """Ends runs in order: notes SIGINT and SIGTERM instead of raising.

    Attributes
    ----------
    signal : int or None
        What the user has sent.
    """

    def __init__(self) -> None:
        self.signal: int | None = None
        self._stopped = False

    @property
    def asked(self) -> bool:
        """Whether somebody wants an end."""
        return self._stopped or self.signal is not None

    def stop(self) -> None:
        """Ask for an end, as one does who takes rows and can take no more."""
        self._stopped = True

    @contextlib.contextmanager
    def noted(self) -> Iterator[Interrupt]:
        """Note the signals while the context lasts (in the main thread only).

        A signal that the caller had ignored stays so: `nohup`, `trap '' INT`, or the
        `&` of a shell script.
        """
        if threading.current_thread() is not threading.main_thread():
            yield self
            return
        kinds = [k for k in (signal.SIGINT, signal.SIGTERM) if not ignored(k)]
        before = [signal.signal(kind, self._note) for kind in kinds]
        try:
            yield self
        finally:
            for kind, handler in zip(kinds, before, strict=True):
                signal.signal(kind, handler)

    def _note(self, number: int, _frame: object) -> None:
        self.signal = number


def ignored(kind: signal.Signals) -> bool:
    """Tell whether whoever started this program has it ignore a signal."""
    return signal.getsignal(kind) is signal.SIG_IGN
