"""Comparing two results of a million rows: time and memory."""

from __future__ import annotations

import sys

from measure import LAGSIM, Table, peak, workspace

ROWS, COLUMNS = 10**6, 15

WRITE = f"""
import sys
from pathlib import Path
import numpy as np
from lagsim.outputs.table import TableWriter
for name, factor in (("golden.csv", 1.0), ("new.csv", 1.0 + 1e-12)):
    random = np.random.default_rng(1)
    names = ["t", *(f"c{{k}}" for k in range({COLUMNS - 1}))]
    writer = TableWriter(Path(sys.argv[1], name), names)
    for k in range({ROWS} // 2000):
        rows = random.standard_normal((2000, {COLUMNS})) * factor
        rows[:, 0] = np.arange(2000 * k, 2000 * (k + 1))
        writer.add(rows)
    writer.close()
"""


def tables(turns):
    """Measure `lagsim compare` on two large files; return the table in a list."""
    found = []
    with workspace() as folder:
        peak([sys.executable, "-c", WRITE, folder])
        files = [folder / "golden.csv", folder / "new.csv"]
        command = [LAGSIM, "compare", *files, "--rtol", "1e-9", "-q"]
        found = [peak(command) for _ in range(max(3, turns // 5))]
    seconds = min(done.seconds for _, done in found)
    memory = max(megabytes for megabytes, _ in found)
    row = [f"{ROWS} rows, {COLUMNS} columns, all cells different"]
    row += [f"{seconds:.3g}; goal 5", f"{memory:.0f}; goal 500"]
    head = ["`lagsim compare`", "least, s", "MB"]
    return [Table("Comparing", head, [row], ["Memory: the process's peak."])]
