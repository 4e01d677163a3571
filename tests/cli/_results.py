"""Reading of the files of a command, and calls of it in a process of its own."""

from __future__ import annotations

import csv
import io
import json
import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np

from tests.patience import PATIENCE
from tests.support import ROOT


def table(folder):
    """Return the header and the rows, as floats, of a folder's table."""
    text = (Path(folder) / "trajectory.csv").read_bytes().decode()
    header, *rows = csv.reader(io.StringIO(text, newline=""))
    return header, np.array(rows, dtype=float)


def document(*path):
    """Return a file of JSON."""
    return json.loads(Path(*path).read_bytes())


def manifest(folder):
    return document(folder, "run.json")


def names(folder):
    return sorted(path.name for path in Path(folder).iterdir())


def contents(folder):
    """Return the files of a folder: name -> bytes."""
    return {path.name: path.read_bytes() for path in Path(folder).iterdir()}


def started(*words, before=(), **around):
    """Start the command in a process of its own, with a changed environment.

    before : words before the command, such as those of a shell.
    around : the changes.
    """
    line = [*before, sys.executable, "-m", "lagsim", *map(str, words)]
    environment = os.environ | {"PYTHONPATH": str(ROOT), **around}
    return subprocess.Popen(
        line, stdout=subprocess.PIPE, stderr=subprocess.PIPE, env=environment
    )


def ended(*words, **around):
    """Call the command as a process of its own; return its code, stdout and stderr."""
    process = started(*words, **around)
    out, err = process.communicate(timeout=120 * PATIENCE)
    return process.returncode, out.decode(), err.decode()


def waited(happened, seconds=60.0):
    """Wait until `happened()` is true, at most `seconds`; return its value."""
    end = time.monotonic() + seconds * PATIENCE
    while not (found := happened()) and time.monotonic() < end:
        time.sleep(0.01)
    return found


class Terminal(io.TextIOWrapper):
    """A stdout that is a terminal."""

    def __init__(self) -> None:
        super().__init__(io.BytesIO(), encoding="utf-8", write_through=True)

    def isatty(self) -> bool:
        return True

    @property
    def shown(self) -> str:
        return self.buffer.getvalue().decode()
