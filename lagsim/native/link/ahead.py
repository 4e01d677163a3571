"""Kernels that a second process compiles, while the first goes on with the model.

LLVM works in one thread at a time; half of a first run is its. The second process puts
what it has made into the cache, where the first finds it; where it has failed, or there
is no cache, no second core or no `fork`, the first makes it itself.
"""

from __future__ import annotations

import contextlib
import os
import signal
import sys
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

# By the key of what each of them makes; empty where nobody may be sent.
_sent: list[dict[str, int]] = []


@contextlib.contextmanager
def helped() -> Iterator[None]:
    """Let others be sent meanwhile.

    Only for a process that nobody else has a part in: of its threads, which may hold
    locks, the other one has none.
    """
    # Elsewhere what a system loads may not like it.
    if sys.platform != "linux" or len(os.sched_getaffinity(0)) < 2:
        yield
        return
    _sent.append({})
    try:
        yield
    finally:
        for key in list(_sent[-1]):
            wait(key)
        _sent.pop()


def send(key: str, make: Callable[[], None]) -> None:
    """Have something made and kept, if others may be sent."""
    if not _sent:
        return
    number = os.fork()
    if number:
        _sent[-1][key] = number
        return
    try:
        # Signals are the first one's, and so is the pipe where it hears of them.
        signal.set_wakeup_fd(-1)
        for kind in (signal.SIGINT, signal.SIGTERM):
            signal.signal(kind, signal.SIG_DFL)
        make()
    finally:
        os._exit(0)


def wait(key: str) -> bool:
    """Wait for whoever makes it; tell whether there was somebody."""
    number = _sent[-1].pop(key, 0) if _sent else 0
    if number:
        with contextlib.suppress(ChildProcessError):
            os.waitpid(number, 0)
    return number > 0
