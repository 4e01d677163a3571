"""Chains of rods in Cartesian coordinates: time per evaluation, and of a whole run."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace

from measure import LAGSIM, Table, alternate, process, workspace
from rod_chain import rod_chain

SIZES = (10, 30, 100, 300, 1000)
# Beyond these straight-line code compiles for minutes, and loops run for minutes.
LONGEST_CODE = 100
MOST_LOOPS = 100
WHOLE = 0.05  # seconds of motion of the whole runs
SECONDS = 0.1  # spent on a candidate at each of its turns


def evaluation(turns):
    """Measure the time of one y' by tape, by compiled code, and by loops."""
    rows = []
    for n in SIZES:
        calls, operations = candidates(n)
        times = alternate(calls, max(2, turns // 4))
        found = {name: f"{times[name].least * 1e6:.3g}" for name in calls}
        rows.append(
            [
                str(n),
                str(operations),
                *(found.get(name, "") for name in ("tape", "code", "loops")),
            ]
        )
    head = [
        f"rods, y' in microseconds, least of {max(2, turns // 4)}",
        "multiplications",
        "sparse elimination from a tape",
        "the same as compiled code",
        "dense loops with QR",
    ]
    return Table("Rods in Cartesian coordinates: one evaluation", head, rows, [])


def candidates(n):
    """Return name -> function that times one y', and the number of operations.

    n : the number of rods.
    """
    import time

    import numpy as np

    from lagsim.model.reader import read
    from lagsim.plan.plan import by_loops
    from lagsim.program.signatures import FUNCTION
    from lagsim.program.system import System
    from lagsim.run.session import open_case

    case = open_case(read(rod_chain(n, 1.0), "rods.yaml"))
    equations, start, plan = case.equations, case.start, case.plan()
    plans = {"tape": replace(plan, tape=True)}
    if n <= LONGEST_CODE:
        plans["code"] = replace(plan, tape=False)
    if n <= MOST_LOOPS:
        plans["loops"] = by_loops(plan)
    y = np.concatenate([start.q, start.v])

    def timed(chosen):
        runner = System(equations, chosen).link(chosen.method)
        runner.prepare()
        call = runner.engine.function("derivative", *FUNCTION)
        out = np.zeros(len(y))
        arrays = y, runner.system.p.flat, out

        def seconds():
            addresses = [array.ctypes.data for array in arrays]
            began, made = time.perf_counter(), 0
            while time.perf_counter() - began < SECONDS or made < 2:
                call(0.0, *addresses)
                made += 1
            return (time.perf_counter() - began) / made

        return seconds

    calls = {name: timed(chosen) for name, chosen in plans.items()}
    return calls, plan.elimination.operations


def whole(turns):
    """Measure whole runs by the command line, with a filled cache of kernels."""
    sizes = SIZES[-3:]
    columns = []
    with workspace() as folder:
        for n in sizes:
            model = folder / f"rods-{n}.yaml"
            model.write_text(rod_chain(n, WHOLE, WHOLE / 10))
            command = [LAGSIM, "run", model, "-q", "-o", folder / "out"]
            best = None
            for _ in range(max(2, turns // 10)):
                shutil.rmtree(folder / "out", ignore_errors=True)
                run = process(command, LAGSIM_CACHE=folder / "cache")
                if best is None or run.seconds < best[0]:
                    record = json.loads((folder / "out" / "run.json").read_text())
                    best = run.seconds, record
            columns.append(best)
    laps = columns[0][1]["timings"]
    rows = [[lap, *(f"{r['timings'][lap]:.3g}" for _, r in columns)] for lap in laps]
    rows.append(["**whole process**", *(f"**{s:.3g}**" for s, _ in columns)])
    rows += [
        [name, *(f"{record[key]:.3g}" for _, record in columns)]
        for name, key in (
            ("evaluations", "evaluations"),
            ("energy drift, J", "energy_drift"),
            ("largest constraint residual of its scale", "constraint_residual"),
        )
    ]
    head = [f"{WHOLE} s of motion, 11 rows; s", *(f"{n} rods" for n in sizes)]
    return Table("Rods in Cartesian coordinates: whole runs", head, rows, [])


def tables(turns):
    """Return the tables of single evaluations and of whole runs."""
    return [evaluation(turns), whole(turns)]
