"""Time limits of tests that wait for processes, and the output of hanging ones."""

from __future__ import annotations

import os
import signal
import subprocess
from typing import Any

# How many times longer than usual: for machines that are slow, or busy.
PATIENCE = float(os.environ.get("LAGSIM_TEST_PATIENCE", "1"))


def finished(process: subprocess.Popen[Any], seconds: float = 60.0) -> tuple[Any, Any]:
    """Return stdout and stderr of a process that is about to end.

    A process that does not end prints its stacks, and fails the test with all its
    output.
    """
    try:
        return process.communicate(timeout=PATIENCE * seconds)
    except subprocess.TimeoutExpired:
        process.send_signal(getattr(signal, "SIGABRT", signal.SIGTERM))
        try:
            out, err = process.communicate(timeout=PATIENCE * 10.0)
        except subprocess.TimeoutExpired:
            process.kill()
            out, err = process.communicate()
    raise AssertionError(f"no end within {PATIENCE * seconds:g} s\n{out!s}\n{err!s}")
