"""Second process, which draws pictures while the first process does other work.

Matplotlib works in one thread at a time, so a thread would not do. The second process
sends its results through a pipe; the first process computes results that have not been
sent, and all results where there is no second core or no `fork`.
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

# Second processes at work within each `second_processes`; empty outside.
_helpers: list[list[Helper]] = []


@contextlib.contextmanager
def second_processes() -> Iterator[None]:
    """Context manager: within it `start` may start second processes, where possible.

    Only for a process with a single thread: a fork copies locks, but not the threads
    that would release the locks. The processes are ended on exit.
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
    """Whether there is a second core, and a system on which a fork is safe."""
    # On other systems, loaded libraries may fail after a fork.
    return sys.platform == "linux" and len(os.sched_getaffinity(0)) > 1


def start(make: Callable[[], bytes]) -> Callable[[], bytes]:
    """Start `make` in a second process where possible; return its future result.

    Returns
    -------
    function
        Waits for the result and returns it. `make` itself where there is no second
        process; `make` is also called if the second process fails.
    """
    if not _helpers:
        return make
    helper = Helper(lambda: None, lambda _: iter([make()]))
    _helpers[-1].append(helper)
    contents = helper.send(b"")

    def result() -> bytes:
        content = next(contents, None)
        helper.end()
        return make() if content is None else content

    return result


class Helper:
    """Second process, started in advance, which works on one task sent to it.

    Parameters
    ----------
    ready : function
        Called in the second process before it receives the task.
    work : function
        From the bytes of the task, yields results one after the other.

    Attributes
    ----------
    done : bool
        Whether all results have been received.
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

    def send(self, order: bytes) -> Iterator[bytes]:
        """Send the task `order`; return an iterator over the results as they arrive.

        The iterator ends early if the second process fails.
        """
        with contextlib.suppress(OSError):
            self._line.send_bytes(order)
        return self._contents()

    def _contents(self) -> Iterator[bytes]:
        with contextlib.suppress(EOFError, OSError):
            while content := self._line.recv_bytes():
                yield content
            self.done = True

    def end(self) -> None:
        """Kill the second process."""
        self._line.close()
        self._process.kill()
        self._process.join()


def _serve(
    line: Connection,
    ready: Callable[[], None],
    work: Callable[[bytes], Iterator[bytes]],
) -> None:
    """Work on one task in the second process; an exception ends the results early.

    line : the connection to the first process.
    ready, work : see `Helper`.
    """
    # Signals are handled by the first process, and so is its wake-up pipe.
    signal.set_wakeup_fd(-1)
    for kind in (signal.SIGINT, signal.SIGTERM):
        signal.signal(kind, signal.SIG_DFL)
    with contextlib.suppress(Exception):
        ready()
        for content in work(line.recv_bytes()):
            line.send_bytes(content)
        line.send_bytes(b"")
