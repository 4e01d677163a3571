"""Pieces of work, handed one by one to processes of this machine or of others.

A process has one piece at a time, so it is known what one that dies had. It goes when
its parent goes, however that ends, and leaves signals to it: when the parent closes the
line between them, runs under way come to an end in order.
"""

from __future__ import annotations

import contextlib
import gc
import multiprocessing
import os
import signal
import sys
import threading
import time
from collections import deque
from concurrent.futures import (
    FIRST_COMPLETED,
    BrokenExecutor,
    CancelledError,
    Executor,
    ProcessPoolExecutor,
    wait,
)
from functools import partial
from multiprocessing import connection
from types import ModuleType
from typing import TYPE_CHECKING, Any, Generic, NamedTuple, TypeAlias, TypeVar

from lagsim import files
from lagsim.errors import InputError, Problem
from lagsim.run.interrupt import Interrupt, noting

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator
    from concurrent.futures import Future

Piece = TypeVar("Piece")
Found = TypeVar("Found")

# Gives a crew of so many, such as `processes`.
Hired: TypeAlias = "Callable[[int], contextlib.AbstractContextManager[Crew]]"

# How long a piece may take to end in order once it has been asked to: its pictures are
# drawn, its files synced; and where it keeps nothing, as while it is compiled.
GRACE_SECONDS = 10.0
LEAVE_SECONDS = 0.5
# How often an interrupt is looked for.
GLANCE_SECONDS = 0.1

# That of a process of workers: asked where the parent wants an end. The signal, where
# there is one, cuts what may be cut, such as pictures.
_ASKED = Interrupt()
_PROMPT = getattr(signal, "SIGUSR1", None)


class Died:
    """What comes instead of a result where the process ended that was to give it."""

    reason = (
        "its process ended before it had a result: was it killed, or out of memory?"
    )


class Crew(NamedTuple):
    """Who takes pieces: at most `most` at a time; `stop` asks for an end in order."""

    executor: Executor
    most: int
    stop: Callable[[], None]


def cores() -> int:
    """Give how many processes this one may keep busy."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


class _Processes(ProcessPoolExecutor):
    """Processes that do not run the script again that this one is running.

    They look for work in lagsim alone; a script without `if __name__ == "__main__"`
    would begin again in each.
    """

    def submit(self, *arguments: Any, **keywords: Any) -> Future[Any]:
        """Hand out a call; processes begin here."""
        main = sys.modules["__main__"]
        sys.modules["__main__"] = ModuleType("__main__")
        try:
            return super().submit(*arguments, **keywords)
        finally:
            sys.modules["__main__"] = main


@contextlib.contextmanager
def processes(most: int) -> Iterator[Crew]:
    """Give processes of this machine, fresh ones: none inherits threads or locks."""
    context = multiprocessing.get_context("spawn")
    theirs, ours = context.Pipe(duplex=False)
    executor = _Processes(most, context, _enlist, (theirs,))
    try:
        yield Crew(executor, most, ours.close)
    finally:
        ours.close()
        executor.shutdown(cancel_futures=True)
        theirs.close()


def _enlist(stop: connection.Connection) -> None:
    """Begin a process of workers."""
    for kind in (signal.SIGINT, signal.SIGTERM):
        signal.signal(kind, signal.SIG_IGN)
    if _PROMPT is not None:
        signal.signal(_PROMPT, _ASKED.prompt)
    gc.disable()  # see `cli.entry`; work collects what it has left
    threading.Thread(target=_watch, args=(stop,), daemon=True).start()


def _watch(stop: connection.Connection) -> None:
    """End what this process does when it is to stop, and then the process."""
    parent = multiprocessing.parent_process()
    assert parent is not None
    if parent.sentinel not in connection.wait([parent.sentinel, stop]):
        _ASKED.stop()
        if _PROMPT is not None:
            signal.pthread_kill(threading.main_thread().ident or 0, _PROMPT)
        _wait_for_what_is_kept(parent.sentinel)
    files.remove_passing()
    os._exit(1)


def _wait_for_what_is_kept(parent: int) -> None:
    """Wait while something is kept, for a time; or until the parent goes."""
    now = keeping = time.monotonic()
    until = now + GRACE_SECONDS
    while now < min(until, keeping + LEAVE_SECONDS):
        if connection.wait([parent], GLANCE_SECONDS):
            return
        now = time.monotonic()
        keeping = now if noting() else keeping


def _done(work: Callable[[Piece, Interrupt], Found], piece: Piece) -> Found:
    return work(piece, _ASKED)


def spread(
    work: Callable[[Piece, Interrupt], Found],
    pieces: Iterable[Piece],
    most: int,
    interrupt: Interrupt,
    hired: Hired = processes,
) -> Iterator[tuple[int, Found | Died]]:
    """Do all pieces; give number and result of each as it is done.

    Where a process dies, and others with it, each piece that was under way is done
    again by a process of its own: the one that dies once more is reported so. After an
    interrupt no piece is begun, and those under way end in order.

    Parameters
    ----------
    work
        A function of a module, of a piece and an interrupt; it raises nothing.
    most
        So many pieces at a time; one at a time is done by this process.
    """
    left, suspects = deque(enumerate(pieces)), deque[tuple[int, Piece]]()
    if most == 1 and hired is processes:
        while left and not interrupt.asked:
            number, piece = left.popleft()
            yield number, work(piece, interrupt)
    while (left or suspects) and not interrupt.asked:
        queue, alone = (suspects, True) if suspects else (left, False)
        with hired(1 if alone else min(most, len(left))) as crew:
            shift = _Shift(work, crew, queue, interrupt)
            yield from shift.results()
        if alone and not interrupt.asked:
            yield from ((number, Died()) for number, _ in shift.lost)
        else:
            suspects += shift.lost


class _Shift(Generic[Piece, Found]):
    """What a crew does until a process of it dies, or all is done.

    Attributes
    ----------
    lost : list
        Number and piece of what was under way when a process died.
    """

    def __init__(
        self,
        work: Callable[[Piece, Interrupt], Found],
        crew: Crew,
        queue: deque[tuple[int, Piece]],
        interrupt: Interrupt,
    ) -> None:
        self.work, self.crew, self.queue = work, crew, queue
        self.interrupt = interrupt
        self.lost: list[tuple[int, Piece]] = []
        self._out: dict[Future[Found], tuple[int, Piece]] = {}

    def results(self) -> Iterator[tuple[int, Found]]:
        """Give what is found, as it comes."""
        self._hand_out()
        stopped = False
        while self._out:
            done, _ = wait(self._out, GLANCE_SECONDS, FIRST_COMPLETED)
            if self.interrupt.asked and not stopped:
                self.crew.stop()
                stopped = True
            for future in done:
                number, piece = self._out.pop(future)
                try:
                    yield number, future.result()
                except (BrokenExecutor, CancelledError):
                    self.lost.append((number, piece))
            self._hand_out()

    def _hand_out(self) -> None:
        while not (self.lost or self.interrupt.asked) and self.queue:
            if len(self._out) == self.crew.most:
                return
            number, piece = self.queue.popleft()
            try:
                future = self.crew.executor.submit(_done, self.work, piece)
            except BrokenExecutor:
                self.lost.append((number, piece))
                return
            self._out[future] = number, piece


@contextlib.contextmanager
def machines(address: str) -> Iterator[tuple[Hired, int]]:
    """Give who works for the scheduler at an address, and at how many runs at a time.

    Raises
    ------
    InputError
        Where Dask is not there, or nobody answers.
    """
    try:
        from distributed import Client
    except ImportError:
        text = "--dask needs dask.distributed, which is not installed"
        raise InputError(
            [Problem("usage", text, hint="pip install 'lagsim[dask]'")]
        ) from None
    try:
        client = Client(address)
    except (OSError, ValueError) as error:
        text = f"there is no Dask scheduler at {address}: {error}"
        hint = "`dask scheduler` prints its address, such as tcp://10.0.0.5:8786"
        raise InputError([Problem("usage", text, hint=hint)]) from None

    @contextlib.contextmanager
    def hired(most: int) -> Iterator[Crew]:
        executor = client.get_executor(pure=False)
        yield Crew(executor, most, partial(executor.shutdown, wait=False))

    with client:
        cores = sum(client.ncores().values())
        if not cores:
            text = f"the Dask scheduler at {address} has no workers"
            raise InputError([Problem("usage", text, hint="begin some: `dask worker`")])
        yield hired, cores
