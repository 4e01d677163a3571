"""Second process, which compiles kernels and draws pictures beside the first.

LLVM works in one thread at a time, and so does matplotlib. The second process hands
its contents over by a pipe; what it has not made, the first makes itself; so it does
all where there is no second core or no `fork`.
"""

from __future__ import annotations

import contextlib
import os
import signal
import sys
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from multiprocessing.connection import Connection

# Those at work, within each `helped`; empty where nobody may be sent.
_helpers: list[list[Helper]] = []


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
        import multiprocessing

        context = multiprocessing.get_context("fork")
        self._line, other = context.Pipe()

        def serve() -> None:
            self._line.close()
            _serve(other, ready, work)

        self._process = context.Process(target=serve)
        self._process.start()
        other.close()
        self.done = False

    def give(self, order: bytes) -> Iterator[bytes]:
        """Tell it what to work on; return what it makes, as far as it comes."""
        with contextlib.suppress(OSError):
            self._line.send_bytes(order)
        return self._contents()

    def _contents(self) -> Iterator[bytes]:
        with contextlib.suppress(EOFError, OSError):
            while content := self._line.recv_bytes():
                yield content
            self.done = True

    def end(self) -> None:
        """Let it end, whatever it is at."""
        self._line.close()
        self._process.kill()
        self._process.join()


def _serve(
    line: Connection,
    ready: Callable[[], None],
    work: Callable[[bytes], Iterator[bytes]],
) -> None:
    """Serve one order in the second process; what fails is left to the first."""
    # Signals are the first one's, and so is the pipe where it hears of them.
    signal.set_wakeup_fd(-1)
    for kind in (signal.SIGINT, signal.SIGTERM):
        signal.signal(kind, signal.SIG_DFL)
    with contextlib.suppress(Exception):
        ready()
        for content in work(line.recv_bytes()):
            line.send_bytes(content)
        line.send_bytes(b"")
