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
    Future,
    ProcessPoolExecutor,
    wait,
)
from functools import partial
from multiprocessing import connection
from types import ModuleType
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias, TypeVar

from lagsim import files
from lagsim.errors import unusable
from lagsim.run.interrupt import Interrupt, noting

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator

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
    """The result of a piece whose process ended before it had one."""

    reason = (
        "its process ended before it had a result: was it killed, or out of memory?"
    )


class Crew(NamedTuple):
    """Workers for at most `most` pieces at a time; `stop` asks for an end in order."""

    submit: Callable[..., Future[Any]]
    most: int
    stop: Callable[[], None]


def cores() -> int:
    """Give how many processes this one may keep busy."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


class _Process(ProcessPoolExecutor):
    """Worker process, which does not execute the user's script again.

    It looks for work in lagsim alone; a script without `if __name__ == "__main__"`
    would begin again in it.
    """

    def submit(self, *arguments: Any, **keywords: Any) -> Future[Any]:
        """Hand out a call; the process begins here."""
        main = sys.modules["__main__"]
        sys.modules["__main__"] = ModuleType("__main__")
        try:
            return super().submit(*arguments, **keywords)
        finally:
            sys.modules["__main__"] = main


@contextlib.contextmanager
def processes(most: int) -> Iterator[Crew]:
    """Give processes of this machine, fresh ones: none inherits threads or locks.

    Each is an executor of its own, so that one that dies takes nothing with it.
    """
    context = multiprocessing.get_context("spawn")
    theirs, ours = context.Pipe(duplex=False)
    last: dict[_Process, Future[Any]] = {}

    def submit(*call: Any) -> Future[Any]:
        for process, future in last.items():
            if future.done() and future.exception() is None:
                with contextlib.suppress(BrokenExecutor):
                    last[process] = process.submit(*call)
                    return last[process]
        process = _Process(1, context, _enlist, (theirs,))
        last[process] = process.submit(*call)
        return last[process]

    try:
        yield Crew(submit, most, ours.close)
    finally:
        ours.close()
        for process in last:
            process.shutdown(cancel_futures=True)
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

    Where a process dies, its piece is done again after all others: one that dies once
    more is reported so. After an interrupt no piece is begun, and those under way end
    in order.

    Parameters
    ----------
    work
        A function of a module, of a piece and an interrupt; it raises nothing.
    most
        So many pieces at a time; one at a time is done by this process.
    """
    left = deque(enumerate(pieces))
    if most == 1 and hired is processes:
        while left and not interrupt.asked:
            number, piece = left.popleft()
            yield number, work(piece, interrupt)
        return
    out: dict[Future[Found], tuple[int, Piece]] = {}
    lost: set[int] = set()
    stopped = False
    with hired(min(most, len(left))) as crew:
        while out or (left and not interrupt.asked):
            while left and not interrupt.asked and len(out) < crew.most:
                number, piece = left.popleft()
                out[crew.submit(_done, work, piece)] = number, piece
            done, _ = wait(out, GLANCE_SECONDS, FIRST_COMPLETED)
            if interrupt.asked and not stopped:
                crew.stop()
                stopped = True
            for future in done:
                number, piece = out.pop(future)
                try:
                    yield number, future.result()
                except (BrokenExecutor, CancelledError):
                    if number in lost and not interrupt.asked:
                        yield number, Died()
                    else:
                        lost.add(number)
                        left.append((number, piece))


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
        raise unusable("usage", text, hint="pip install 'lagsim[dask]'") from None
    try:
        client = Client(address)
    except (OSError, ValueError) as error:
        text = f"there is no Dask scheduler at {address}: {error}"
        hint = "`dask scheduler` prints its address, such as tcp://10.0.0.5:8786"
        raise unusable("usage", text, hint=hint) from None

    @contextlib.contextmanager
    def hired(most: int) -> Iterator[Crew]:
        executor = client.get_executor(pure=False)
        yield Crew(executor.submit, most, partial(executor.shutdown, wait=False))

    with client:
        cores = sum(client.ncores().values())
        if not cores:
            text = f"the Dask scheduler at {address} has no workers"
            raise unusable("usage", text, hint="begin some: `dask worker`")
        yield hired, cores
