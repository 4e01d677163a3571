"""What a second process makes, while the first goes on: kernels, and pictures.

LLVM works in one thread at a time, and so does matplotlib. Kernels are put into the
cache, where the first finds them. What the second has not made, the first makes itself;
so it does all where there is no second core or no `fork`.
"""

from __future__ import annotations

import contextlib
import os
import signal
import struct
import sys
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

# By the key of what each of them makes; empty where nobody may be sent.
_sent: list[dict[str, int]] = []
_LENGTH = struct.Struct("<q")


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


def may_send() -> bool:
    """Tell whether others may be sent."""
    return bool(_sent)


def send(key: str, make: Callable[[], None]) -> None:
    """Have something made and kept, if others may be sent."""
    if _sent:
        _sent[-1][key] = _fork(make)


def bring(make: Callable[[], bytes]) -> Callable[[], bytes]:
    """Have something made, where others may be sent; give what waits and gives it."""
    reads, writes = os.pipe()

    def put() -> None:
        os.close(reads)
        content = make()
        with os.fdopen(writes, "wb") as line:
            line.write(_LENGTH.pack(len(content)) + content)

    number = _fork(put)
    os.close(writes)

    def brought() -> bytes:
        with os.fdopen(reads, "rb") as line:
            said, content = line.read(_LENGTH.size), line.read()
        _end(number)
        whole = len(said) == _LENGTH.size and _LENGTH.unpack(said)[0] == len(content)
        return content if whole else make()

    return brought


def _fork(work: Callable[[], None]) -> int:
    """Have another process do it, which ends then; give its number."""
    if number := os.fork():
        return number
    try:
        # Signals are the first one's, and so is the pipe where it hears of them.
        signal.set_wakeup_fd(-1)
        for kind in (signal.SIGINT, signal.SIGTERM):
            signal.signal(kind, signal.SIG_DFL)
        work()
    finally:
        os._exit(0)


def wait(key: str) -> bool:
    """Wait for whoever makes it; tell whether there was somebody."""
    number = _sent[-1].pop(key, 0) if _sent else 0
    if number:
        _end(number)
    return number > 0


def _end(number: int) -> None:
    with contextlib.suppress(ChildProcessError):
        os.waitpid(number, 0)
