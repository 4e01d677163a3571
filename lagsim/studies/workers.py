"""Pieces of work, computed by processes of this machine or of other machines.

A process works on one piece at a time, so that the piece of a process that dies is
known. A process ends when its parent ends, for whatever reason. Workers ignore the
signals of the terminal: when the parent closes the pipe between them, a run under way
ends in order.
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
from lagsim.codes.known import USAGE
from lagsim.errors import unusable
from lagsim.run.interrupt import Interrupt, noting

if TYPE_CHECKING:
    from collections.abc import Callable, Generator, Iterable, Iterator, Sequence

Piece = TypeVar("Piece")
Found = TypeVar("Found")

# Returns a context manager of a crew of a given size, such as `processes`.
Workers: TypeAlias = "Callable[[int], contextlib.AbstractContextManager[Crew]]"

# Time limits for the orderly end of a piece after a request, in s: of elapsed time, and
# of processor time in which the worker writes no file, such as during a compilation. A
# worker takes longer on a machine with other work.
GRACE_SECONDS = 10.0
LEAVE_SECONDS = 0.5
# Interval between two checks for an interrupt.
GLANCE_SECONDS = 0.1
# Time for which this process works alone, to measure the time of an item and to compile
# functions that the others load from the cache.
ALONE_SECONDS = 0.5
# Other processes are started if the remaining work takes longer than this.
WORTH_SECONDS = 5.0
# The duration of a piece of several items, and the number of pieces for each process.
PIECE_SECONDS = 0.5
PIECES = 4
# Resolution of the clock.
SHORTEST_SECONDS = 1e-6

# Interrupt of a worker process, set when the parent requests an end. The signal, where
# there is one, interrupts work that can be left out, such as pictures.
_ASKED = Interrupt()
_PROMPT = getattr(signal, "SIGUSR1", None)


class Died:
    """Result of a piece whose process ended before the piece was complete."""

    reason = (
        "its process ended before it had a result: was it killed, or out of memory?"
    )


class Crew(NamedTuple):
    """Workers for at most `most` pieces at a time.

    Attributes
    ----------
    submit : callable
        Starts a call in a worker, and returns the future of the call.
    most : int
        The largest number of pieces at a time.
    stop : callable
        Requests all workers to complete their pieces early, and to end.
    """

    submit: Callable[..., Future[Any]]
    most: int
    stop: Callable[[], None]


def cores() -> int:
    """Return the number of processor cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


class _Process(ProcessPoolExecutor):
    """Executor with one worker process, in which the user's script is not executed.

    The functions that a worker runs are in lagsim. With the executor of the standard
    library, a script without `if __name__ == "__main__"` would be executed again in
    each worker.
    """

    def submit(self, *arguments: Any, **keywords: Any) -> Future[Any]:
        """Submit a call to the worker process, which starts at the first call."""
        main = sys.modules["__main__"]
        sys.modules["__main__"] = ModuleType("__main__")
        try:
            return super().submit(*arguments, **keywords)
        finally:
            sys.modules["__main__"] = main


@contextlib.contextmanager
def processes(most: int) -> Iterator[Crew]:
    """Context manager: a crew of new processes, which inherit no threads or locks.

    Each process has its own executor, so that the death of a process breaks no other.

    most : the number of processes.
    """
    context = multiprocessing.get_context("spawn")
    child_end, own_end = context.Pipe(duplex=False)
    last: dict[_Process, Future[Any]] = {}

    def submit(*call: Any) -> Future[Any]:
        for process, future in last.items():
            if future.done() and future.exception() is None:
                with contextlib.suppress(BrokenExecutor):
                    last[process] = process.submit(*call)
                    return last[process]
        process = _Process(1, context, _enlist, (child_end,))
        last[process] = process.submit(*call)
        return last[process]

    try:
        yield Crew(submit, most, own_end.close)
    finally:
        own_end.close()
        for process in last:
            process.shutdown(cancel_futures=True)
        child_end.close()


@contextlib.contextmanager
def shared_processes(most: int) -> Iterator[Workers]:
    """Context manager: processes that several studies use in turn.

    It yields a function that a study calls in place of `processes` to have a crew. The
    processes start at the first call, and keep the functions that they compile from one
    study to the next.

    most : the number of processes.
    """
    with processes(most) as crew:
        yield lambda _most: contextlib.nullcontext(crew)


def _enlist(stop: connection.Connection) -> None:
    """Initialise a worker process: signals, garbage collector, and a watching thread.

    stop : the pipe whose closure ends the process.
    """
    for kind in (signal.SIGINT, signal.SIGTERM):
        signal.signal(kind, signal.SIG_IGN)
    if _PROMPT is not None:
        signal.signal(_PROMPT, _ASKED.prompt)
    gc.disable()  # see `cli.entry`; pending work collects garbage
    threading.Thread(target=_watch, args=(stop,), daemon=True).start()


def _watch(stop: connection.Connection) -> None:
    """End the work of this process, and then the process, when `stop` is closed."""
    parent = multiprocessing.parent_process()
    assert parent is not None
    if parent.sentinel not in connection.wait([parent.sentinel, stop]):
        _ASKED.stop()
        if _PROMPT is not None:
            signal.pthread_kill(threading.main_thread().ident or 0, _PROMPT)
        _wait_for_writers(parent.sentinel)
    files.remove_passing()
    os._exit(1)


def _wait_for_writers(parent: int) -> None:
    """Wait while files are being written, for GRACE_SECONDS at most.

    The wait ends earlier if the parent process ends, whose handle is `parent`.
    """
    until, keeping = time.monotonic() + GRACE_SECONDS, time.process_time()
    while time.monotonic() < until and time.process_time() < keeping + LEAVE_SECONDS:
        if connection.wait([parent], GLANCE_SECONDS):
            return
        keeping = time.process_time() if noting() else keeping


def _done(work: Callable[[Piece, Interrupt], Found], piece: Piece) -> Found:
    return work(piece, _ASKED)


def completed_pieces(
    work: Callable[[Piece, Interrupt], Found],
    pieces: Iterable[Piece],
    most: int,
    interrupt: Interrupt,
    workers: Workers = processes,
) -> Generator[tuple[int, Found | Died], None, None]:
    """Compute all pieces; yield index and result of each when it is complete.

    If a process dies, its piece is computed again after all others; a piece whose
    process dies twice has the result `Died`. After an interrupt no piece is started,
    and pieces under way end in order.

    Parameters
    ----------
    work : callable
        A function at the top level of a module, called with a piece and an interrupt.
        It must not raise.
    pieces : iterable
    most : int
        The largest number of pieces at a time; with 1 this process computes them.
    interrupt : Interrupt
    workers : callable
        Function that returns a context manager of a crew of a given size.
    """
    left = deque(enumerate(pieces))
    if most == 1 and workers is processes:
        while left and not interrupt.requested:
            number, piece = left.popleft()
            yield number, work(piece, interrupt)
        return
    out: dict[Future[Found], tuple[int, Piece]] = {}
    lost: set[int] = set()
    stopped = False
    with workers(min(most, len(left))) as crew:
        while out or (left and not interrupt.requested):
            while left and not interrupt.requested and len(out) < crew.most:
                number, piece = left.popleft()
                out[crew.submit(_done, work, piece)] = number, piece
            done, _ = wait(out, GLANCE_SECONDS, FIRST_COMPLETED)
            if interrupt.requested and not stopped:
                crew.stop()
                stopped = True
            for future in done:
                number, piece = out.pop(future)
                try:
                    yield number, future.result()
                except (BrokenExecutor, CancelledError):
                    if number in lost and not interrupt.requested:
                        yield number, Died()
                    else:
                        lost.add(number)
                        left.append((number, piece))


# Computes items in their order, and yields the results of some at a time.
Made: TypeAlias = "Callable[[Sequence[Piece], Interrupt], Iterator[Sequence[Found]]]"


def in_batches(
    compute: Made[Piece, Found],
    items: Sequence[Piece],
    most: int,
    interrupt: Interrupt,
    *,
    requested: bool,
    workers: Workers = processes,
) -> Iterator[Sequence[tuple[Piece, Found | Died]]]:
    """Compute many short items; yield lists of items with their results.

    This process computes the first items, or all. Pieces of the others are sent to
    further processes, and the items of a process that dies are then sent one by one.
    After an interrupt the items without a result are left out.

    Parameters
    ----------
    compute : callable
        Function of items and an interrupt that yields results in the order of the
        items. It can be pickled, and must not raise.
    items : sequence
    most : int
        The largest number of pieces at a time; with 1 this process computes all.
    requested : bool
        Whether this number was requested; else further processes start only if these
        save time.
    workers : callable
        Function that returns a context manager of a crew, such as `processes`.
    """
    others = 0 if most == 1 and workers is processes else most
    # The processor time of this process alone.
    done, began, lasted = 0, time.process_time(), 0.0
    for results in compute(items, interrupt):
        yield [*zip(items[done : done + len(results)], results, strict=True)]
        done += len(results)
        lasted = max(time.process_time() - began, SHORTEST_SECONDS)
        to_come = (len(items) - done) * lasted / max(1, done)
        worth = lasted > ALONE_SECONDS and to_come > WORTH_SECONDS
        if others and (worth or requested):
            break
    left = items[done:]
    if left and not interrupt.requested:
        size = min(PIECE_SECONDS * done / lasted, len(left) / (PIECES * others))
        yield from _by_others(
            compute, left, max(1, int(size)), others, interrupt, workers
        )


def _by_others(
    compute: Made[Piece, Found],
    items: Sequence[Piece],
    size: int,
    most: int,
    interrupt: Interrupt,
    workers: Workers,
) -> Iterator[Sequence[tuple[Piece, Found | Died]]]:
    """Yield items with their results, computed by workers in pieces of `size` items.

    The other arguments are those of `in_batches`.
    """
    parts = [items[k : k + size] for k in range(0, len(items), size)]
    lost: list[Piece] = []
    for k, results in completed_pieces(
        partial(_listed, compute), parts, most, interrupt, workers
    ):
        if isinstance(results, Died):
            lost += parts[k]
        else:
            yield [*zip(parts[k], results, strict=False)]  # fewer after an interrupt
    if size > 1 and lost:
        yield from _by_others(compute, lost, 1, most, interrupt, workers)
    elif lost:
        yield [(item, Died()) for item in lost]


def _listed(
    compute: Made[Piece, Found], items: Sequence[Piece], interrupt: Interrupt
) -> list[Found]:
    return [x for results in compute(items, interrupt) for x in results]


@contextlib.contextmanager
def machines(address: str) -> Iterator[tuple[Workers, int]]:
    """Context manager: the workers of a Dask scheduler, and their number of cores.

    Raises
    ------
    InputError
        If Dask is not installed, or there is no scheduler with workers at the address.
    """
    try:
        from distributed import Client
    except ImportError:
        text = "--dask needs dask.distributed, which is not installed"
        raise unusable(USAGE, text, hint="pip install 'lagsim[dask]'") from None
    try:
        client = Client(address)
    except (OSError, ValueError) as error:
        text = f"there is no Dask scheduler at {address}: {error}"
        hint = "`dask scheduler` prints its address, such as tcp://10.0.0.5:8786"
        raise unusable(USAGE, text, hint=hint) from None

    @contextlib.contextmanager
    def workers(most: int) -> Iterator[Crew]:
        executor = client.get_executor(pure=False)
        yield Crew(executor.submit, most, partial(executor.shutdown, wait=False))

    with client:
        cores = sum(client.ncores().values())
        if not cores:
            text = f"the Dask scheduler at {address} has no workers"
            raise unusable(USAGE, text, hint="begin some: `dask worker`")
        yield workers, cores
