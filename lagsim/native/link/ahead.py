"""What a second process makes, while the first goes on: kernels, and pictures.

LLVM works in one thread at a time, and so does matplotlib. Kernels are put into the
cache, where the first finds them; pictures are drawn by a `Helper`, which has loaded
matplotlib by then. What the second has not made, the first makes itself; so it does all
where there is no second core or no `fork`.
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

# By the key of what each of them makes; empty where nobody may be sent.
_sent: list[dict[str, int]] = []
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
    _sent.append({})
    try:
        yield
    finally:
        for key in list(_sent[-1]):
            wait(key)
        _sent.pop()


def is_possible() -> bool:
    """Tell whether there is a second core, and a system on which to fork is safe."""
    # Elsewhere what a system loads may not like it.
    return sys.platform == "linux" and len(os.sched_getaffinity(0)) > 1


def may_send() -> bool:
    """Tell whether others may be sent."""
    return bool(_sent)


def send(key: str, make: Callable[[], None]) -> None:
    """Have something made and kept, if others may be sent."""
    if _sent:
        _sent[-1][key] = _fork(make)


def bring(make: Callable[[], bytes]) -> Callable[[], bytes]:
    """Have something made, where others may be sent; give what waits and gives it."""
    helper = Helper(_nothing, lambda _: iter([make()]))
    contents = helper.give(b"")

    def brought() -> bytes:
        content = next(contents, None)
        helper.end()
        return make() if content is None else content

    return brought


class Helper:
    """Another process, which makes itself ready, and works when it is told on what.

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
        """Tell it what to work on; give what it makes, as far as it comes."""
        with (
            contextlib.suppress(BrokenPipeError),
            os.fdopen(self._orders, "wb") as line,
        ):
            self._orders = -1
            _put(line, order)
        return self._contents()

    def _contents(self) -> Iterator[bytes]:
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
        with contextlib.suppress(ProcessLookupError):
            os.kill(self._number, signal.SIGKILL)
        _end(self._number)


def _nothing() -> None:
    """Be ready at once."""


def _put(line: BinaryIO, content: bytes) -> None:
    line.write(_LENGTH.pack(len(content)) + content)
    line.flush()


def _next(line: BinaryIO) -> bytes | None:
    """Give the next content that comes whole."""
    said = line.read(_LENGTH.size)
    if len(said) < _LENGTH.size:
        return None
    (length,) = _LENGTH.unpack(said)
    content = line.read(length)
    return content if len(content) == length else None


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
