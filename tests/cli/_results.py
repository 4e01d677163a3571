"""Reading what a run has written."""

from __future__ import annotations

import csv
import io
import json
from pathlib import Path

import numpy as np


def table(folder):
    """Give the header, and the rows as floats, of a folder's table."""
    text = (Path(folder) / "trajectory.csv").read_bytes().decode()
    header, *rows = csv.reader(io.StringIO(text, newline=""))
    return header, np.array(rows, dtype=float)


def manifest(folder):
    return json.loads((Path(folder) / "run.json").read_bytes())


def names(folder):
    return sorted(path.name for path in Path(folder).iterdir())
