"""Second process, which compiles kernels and draws pictures beside the first.

LLVM works in one thread at a time, and so does matplotlib. The second process hands
its contents over by a pipe; what it has not made, the first makes itself; so it does
all where there is no second core or no `fork`.
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
    from typing import BinaryIO

# Those at work, within each `helped`; empty where nobody may be sent.
_helpers: list[list[Helper]] = []
_LENGTH = struct.Struct("<q")


@contextlib.contextmanager
def helped() -> Iterator[None]:
    """Let others be sent meanwhile.

    Only for a process that nobody else has a part in: of its threads, which may hold
    locks, the other one has none.
    """
    if not is_possible():
        yield
        return
    _helpers.append([])
    try:
        yield
    finally:
        for helper in _helpers.pop():
            helper.end()


def is_possible() -> bool:
    """Whether there is a second core, and a system on which to fork is safe."""
    # Elsewhere what a system loads may not like it.
    return sys.platform == "linux" and len(os.sched_getaffinity(0)) > 1


def bring(make: Callable[[], bytes]) -> Callable[[], bytes]:
    """Have something made, if others may be sent; return what waits and gives it."""
    if not _helpers:
        return make
    helper = Helper(lambda: None, lambda _: iter([make()]))
    _helpers[-1].append(helper)
    contents = helper.give(b"")

    def brought() -> bytes:
        content = next(contents, None)
        helper.end()
        return make() if content is None else content

    return brought


class Helper:
    """Second process, which is prepared in advance and works on the task sent to it.

    Parameters
    ----------
    ready, work
        `work` is given what `give` was, and gives one content after the other.

    Attributes
    ----------
    done : bool
        Whether all of its contents have come.
    """

    def __init__(
        self, ready: Callable[[], None], work: Callable[[bytes], Iterator[bytes]]
    ) -> None:
        orders, self._orders = os.pipe()
        self._brought, brings = os.pipe()

        def serve() -> None:
            os.close(self._orders)
            os.close(self._brought)
            ready()
            with os.fdopen(orders, "rb") as line:
                order = _next(line)
            if order is None:
                return
            with os.fdopen(brings, "wb") as line:
                for content in work(order):
                    _put(line, content)
                _put(line, b"")

        self._number = _fork(serve)
        os.close(orders)
        os.close(brings)
        self.done = False

    def give(self, order: bytes) -> Iterator[bytes]:
        """Tell it what to work on; return what it makes, as far as it comes."""
        with (
            contextlib.suppress(BrokenPipeError),
            os.fdopen(self._orders, "wb") as line,
        ):
            self._orders = -1
            _put(line, order)
        return self._contents()

    def _contents(self) -> Iterator[bytes]:
        if self._brought < 0:  # it has been ended
            return
        with os.fdopen(self._brought, "rb") as line:
            self._brought = -1
            while content := _next(line):
                yield content
            self.done = content is not None

    def end(self) -> None:
        """Let it end, whatever it is at."""
        for line in (self._orders, self._brought):
            if line >= 0:
                os.close(line)
        self._orders = self._brought = -1
        if self._number:
            with contextlib.suppress(ProcessLookupError):
                os.kill(self._number, signal.SIGKILL)
            with contextlib.suppress(ChildProcessError):
                os.waitpid(self._number, 0)
        self._number = 0


def _put(line: BinaryIO, content: bytes) -> None:
    line.write(_LENGTH.pack(len(content)) + content)
    line.flush()


def _next(line: BinaryIO) -> bytes | None:
    """Next content that comes whole."""
    said = line.read(_LENGTH.size)
    if len(said) < _LENGTH.size:
        return None
    (length,) = _LENGTH.unpack(said)
    content = line.read(length)
    return content if len(content) == length else None


def _fork(work: Callable[[], None]) -> int:
    """Have another process do it, which ends then; return its number."""
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
