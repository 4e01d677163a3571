"""Writing a million rows: time and memory."""

from __future__ import annotations

import sys

from measure import LAGSIM, MODELS, Table, alternate, peak, workspace

MANY, FEW, COLUMNS = 10**6, 10**4, 15

# Random doubles need 16 or 17 digits, as computed ones do.
WRITE = f"""
import sys, time
from pathlib import Path
import numpy as np
from lagsim.outputs.table import TableWriter
random = np.random.default_rng(1)
blocks = [random.standard_normal((2000, {COLUMNS})) for _ in range(5)]
began = time.perf_counter()
writer = TableWriter(Path(sys.argv[1]), [f"c{{k}}" for k in range({COLUMNS})])
for k in range(int(sys.argv[2]) // 2000):
    writer.add(blocks[k % 5])
writer.close()
print(time.perf_counter() - began)
"""


def tables(turns):
    """Measure tables of many rows; return the table of the report in a list."""
    found = {}
    with workspace() as folder:

        def write(count):
            command = [sys.executable, "-c", WRITE, folder / "table.csv", count]
            found.setdefault(("write", count), []).append(peak(command))

        def run(count, *options):
            name = "run, plots" if not options else "run"
            command = [LAGSIM, "run", MODELS / "elastic-pendulum-forced.yaml"]
            command += ["--duration", "100", "--output-step", repr(100 / count)]
            command += ["-q", "-o", folder / "out", *options]
            done = peak(command, LAGSIM_CACHE=folder / "cache")
            found.setdefault((name, count), []).append(done)

        run(FEW)  # compiles, which takes memory of its own
        found.clear()
        alternate(
            {
                "few": lambda: write(FEW),
                "many": lambda: write(MANY),
                "run few": lambda: run(FEW, "--no-plots"),
                "run many": lambda: run(MANY, "--no-plots"),
                "plots few": lambda: run(FEW),
                "plots many": lambda: run(MANY),
            },
            max(2, turns // 5),
            warm=0,
        )
        with (folder / "out" / "trajectory.csv").open() as file:
            columns = file.readline().count(",") + 1

    def row(text, name, goals=("", "")):
        few, many = found[name, FEW], found[name, MANY]
        if name == "write":
            seconds = min(float(done.output) for _, done in many)
        else:
            seconds = min(done.seconds for _, done in many)
        memory = [max(megabytes for megabytes, _ in runs) for runs in (few, many)]
        return [
            text,
            f"{seconds:.3g}{goals[0]}",
            f"{memory[0]:.0f}",
            f"{memory[1]:.0f}",
            f"{memory[1] - memory[0]:+.0f}{goals[1]}",
        ]

    goals = ("; goal 5", "; goal within 50")
    rows = [
        row(f"`TableWriter`, {COLUMNS} columns of random doubles", "write", goals),
        row(f"`lagsim run --no-plots`, {columns} columns", "run"),
        row(f"`lagsim run`, {columns} columns", "run, plots"),
    ]
    head = ["10^6 rows", "least, s", "MB for 10^4 rows", "MB for 10^6", "more, MB"]
    return [Table("A million rows", head, rows, ["Memory: the process's peak."])]
