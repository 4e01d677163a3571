"""Second process, which draws pictures or compiles while the first does other work.

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
    from collections.abc import Callable, Iterator, Sequence
    from multiprocessing.connection import Connection

# How far the priority of tasks beside a run is lowered.
_PATIENCE = 5

# Second processes at work within each `second_processes`; empty outside.
_helpers: list[list[Helper]] = []

# Second processes that have not been ended.
_at_work: set[Helper] = set()


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
    return sys.platform == "linux" and _cores() > 1


def _cores() -> int:
    return len(os.sched_getaffinity(0))


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


def shared(tasks: Sequence[Callable[[], bytes]], *, alone: bool = False) -> list[bytes]:
    """Return the results of tasks in order; a second process does some on a free core.

    This process and a second one each take the next task when they have finished one,
    so that long tasks should come first. Tasks that fail in the second process are done
    in this one.

    tasks : at most 255.
    alone : whether other second processes have no work now.
    """
    busy = 0 if alone else len(_at_work)
    if not _helpers or len(tasks) < 2 or _cores() < 2 + busy:
        return [task() for task in tasks]
    reads, writes = os.pipe()
    os.write(writes, bytes(range(len(tasks))))
    os.close(writes)

    def done() -> dict[int, bytes]:
        numbers = iter(lambda: os.read(reads, 1), b"")
        return {number[0]: tasks[number[0]]() for number in numbers}

    def work(_: bytes) -> Iterator[bytes]:
        # Sent when the first process has no more tasks, and waits for the results.
        return iter([bytes([k]) + result for k, result in done().items()])

    helper = Helper(lambda: None, work)
    _helpers[-1].append(helper)
    contents = helper.send(b"")
    results = done()
    os.close(reads)
    results |= {content[0]: content[1:] for content in contents}
    helper.end()
    return [results[k] if k in results else task() for k, task in enumerate(tasks)]


def beside(tasks: Sequence[Callable[[], object]]) -> Callable[[], bool] | None:
    """Start tasks in a second process at low priority, for their effects on files.

    Returns
    -------
    function or None
        Whether the second process has ended. Where one is at work already, no other is
        started, and the function is for the former. None where a second process is not
        possible.
    """
    if not _helpers:
        return None
    for earlier in _helpers[-1]:
        if not earlier.has_ended():
            return earlier.has_ended

    def work(_: bytes) -> Iterator[bytes]:
        os.nice(_PATIENCE)
        for task in tasks:
            task()
        return iter([b"done"])

    helper = Helper(lambda: None, work)
    _helpers[-1].append(helper)
    helper.send(b"")
    return helper.has_ended


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
        _at_work.add(self)
        other.close()
        self.done = False

    def send(self, order: bytes) -> Iterator[bytes]:
        """Send the task `order`; return an iterator over the results as they arrive.

        The iterator ends early if the second process fails.
        """
        with contextlib.suppress(OSError):
            self._line.send_bytes(order)
        return self._contents()

    def has_ended(self) -> bool:
        """Whether the second process has sent a result, or has failed."""
        try:
            return self._line.poll()
        except OSError:
            return True

    def _contents(self) -> Iterator[bytes]:
        with contextlib.suppress(EOFError, OSError):
            while content := self._line.recv_bytes():
                yield content
            self.done = True

    def end(self) -> None:
        """Kill the second process."""
        _at_work.discard(self)
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
