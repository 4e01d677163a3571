"""Signals that end the process: at any moment, in order where there is a moment for it.

Python calls its handlers between two of its own instructions. What stays long in one
(LLVM, LAPACK), or loses the exception that a handler raises, would never end; a thread
sees the signals as well, and ends the process where nothing else has.
"""

from __future__ import annotations

import contextlib
import os
import signal
import sys
import threading
import time
from typing import TYPE_CHECKING, NoReturn

from lagsim import files
from lagsim.run.interrupt import (
    AGAIN_SECONDS,
    ENDING,
    Terminated,
    exception_of,
    heard,
    ignored,
    noting,
)

if TYPE_CHECKING:
    from collections.abc import Iterator

# How long the end in order may take: after one signal, where nothing is to be kept, and
# after a second one.
GRACE_SECONDS = 0.7
SECOND_GRACE_SECONDS = 0.3
_GLANCE_SECONDS = 0.05


def again() -> None:
    """Raise what a signal has raised, where it came out as something else."""
    if heard:
        raise exception_of(heard[0])


def watch() -> None:
    """Have signals end this process, whatever it does."""
    sys.unraisablehook = _report_uncaught
    if sys.platform != "win32":  # where this takes a socket
        reads, writes = os.pipe()
        os.set_blocking(writes, False)
        signal.set_wakeup_fd(writes, warn_on_full_buffer=False)
        threading.Thread(target=_watch, args=(reads,), daemon=True).start()


def is_watched() -> bool:
    """Return whether this process runs nothing but the command line."""
    return sys.unraisablehook is _report_uncaught


@contextlib.contextmanager
def raised() -> Iterator[None]:
    """Turn signals into exceptions (in the main thread, where they are not ignored)."""

    def stop(number: int, _frame: object) -> NoReturn:
        heard.append(number)
        raise exception_of(number)

    heard.clear()
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {kind: signal.signal(kind, stop) for kind in ENDING if not ignored(kind)}
    try:
        yield
    finally:
        for kind, handler in before.items():
            signal.signal(kind, handler)


def _report_uncaught(raised: sys.UnraisableHookArgs) -> None:
    """Report an exception that is not caught; one of a signal comes again."""
    if raised.exc_type not in (KeyboardInterrupt, Terminated):
        sys.__unraisablehook__(raised)


def _watch(reads: int) -> None:
    """End the process where a signal has not ended it."""
    number = os.read(reads, 1)[0]
    import select

    first, again = time.monotonic(), False
    until = first + GRACE_SECONDS
    while True:
        now = time.monotonic()
        if noting() and not again:
            until = now + GRACE_SECONDS
        elif now > until:
            files.remove_passing()
            os._exit(128 + number)
        if select.select([reads], [], [], _GLANCE_SECONDS)[0]:
            number = os.read(reads, 1)[0]
            if not again and time.monotonic() > first + AGAIN_SECONDS:
                until, again = time.monotonic() + SECOND_GRACE_SECONDS, True
