"""Work that has its time, in any thread and on any system.

sympy is asked for what it may take hours for, and cannot be told to stop. A second
thread raises in the one that works, between two instructions of Python.
"""

from __future__ import annotations

import contextlib
import ctypes
import threading
import time
from typing import TYPE_CHECKING

from lagsim import limits
from lagsim.derivation.endless import HINT
from lagsim.errors import InputError, Problem

if TYPE_CHECKING:
    from collections.abc import Iterator

# How often the time is looked at. An exception may be lost where something catches all;
# it comes again.
GLANCE_SECONDS = 0.25


class _TimeIsUp(BaseException):
    """Raised where the work has come to; no handler of `Exception` takes it."""


@contextlib.contextmanager
def its_time(seconds: float = limits.DERIVING_SECONDS) -> Iterator[None]:
    """Give the work of the context so much time of the processor.

    Raises
    ------
    InputError
        Where it is not done by then.
    """
    worker, lock, done = threading.get_ident(), threading.Lock(), threading.Event()
    until = time.process_time() + seconds

    def end() -> None:
        while not done.wait(GLANCE_SECONDS):
            with lock:
                if not done.is_set() and time.process_time() > until:
                    _raise_in(worker, _TimeIsUp)

    thread = threading.Thread(target=end, daemon=True)
    thread.start()
    try:
        try:
            yield
        finally:
            with lock:
                done.set()
                _raise_in(worker, None)  # what is not raised yet
    except _TimeIsUp:
        text = (
            f"the equations are not derived within {seconds:.3g} s, which is the limit"
        )
        raise InputError([Problem("too-long", text, None, HINT)]) from None


def _raise_in(thread: int, error: type[BaseException] | None) -> None:
    raised = ctypes.py_object(error) if error else None
    ctypes.pythonapi.PyThreadState_SetAsyncExc(ctypes.c_ulong(thread), raised)
