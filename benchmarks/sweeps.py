"""Sweeps of the elastic pendulum: processor time of a run, whole, and of its parts."""

from __future__ import annotations

import gc
import time
from dataclasses import replace

from measure import MODELS, Table

MODEL, NAME, LOW, HIGH, RUNS = "elastic-pendulum", "K", 20.0, 40.0, 193
FOLLOWED = "l", 0.9, 1.1


def swept(axis, bars, *, ends=False):
    """Return a function that measures the processor seconds of a run of a sweep."""
    from lagsim.model.reader import read_file
    from lagsim.run.interrupt import Interrupt
    from lagsim.studies.attempts import ErrorBars
    from lagsim.studies.sweep.grid import SweepRows, grid_of
    from lagsim.studies.sweep.runs import Runs

    name, low, high = axis
    model = read_file(str(MODELS / f"{MODEL}.yaml"))
    values = [low + (high - low) * k / (RUNS - 1) for k in range(RUNS)]
    grid = grid_of(model, {name: values})
    found = SweepRows.of(model, grid, {}, ErrorBars(bars), ends=ends)
    batches = Runs(found.work).rows(range(RUNS), Interrupt())
    next(batches)  # compiles

    def run():
        nonlocal batches
        began = time.process_time()
        rows = next(batches, None)
        if rows is None:
            batches = Runs(found.work).rows(range(RUNS), Interrupt())
            next(batches)
            return run()
        return (time.process_time() - began) / len(rows)

    return run


def integration(rtol):
    """Return a function that measures the processor seconds of a single integration."""
    from lagsim.model.reader import read_file
    from lagsim.run.session import open_case
    from lagsim.studies.sweep.batches import LONG, Ensemble

    session = open_case(read_file(str(MODELS / f"{MODEL}.yaml"))).ready()
    ensemble = Ensemble(session.by(replace(session.plan, rtol=rtol)))
    start = session.case.start
    state = [*start.q, *start.v]

    def run():
        ensemble.begin(0, state)
        began = time.process_time()
        ensemble.arc.runner.advance(ensemble.arc.state, LONG, LONG)
        return time.process_time() - began

    return run


def tables(turns):
    """Measure sweeps and single integrations in turn; return the table in a list."""
    candidates = {
        f"{NAME} swept, rows and errors": swept((NAME, LOW, HIGH), "auto"),
        f"{NAME} swept, rows": swept((NAME, LOW, HIGH), "never"),
        f"{NAME} swept, `--ends`": swept((NAME, LOW, HIGH), "auto", ends=True),
        f"{FOLLOWED[0]} swept, which a start value follows": swept(FOLLOWED, "auto"),
        "integration with rows at rtol 1e-11": integration(1e-11),
        "integration with rows at rtol 1e-13": integration(1e-13),
    }
    found = {name: [] for name in candidates}
    gc.disable()
    for _ in range(turns):
        for name, run in candidates.items():
            found[name].append(run())
    gc.enable()
    rows = [
        [name, f"{1e3 * min(x):.3g}", f"{1e3 * sorted(x)[len(x) // 2]:.3g}"]
        for name, x in found.items()
    ]
    head = ["elastic pendulum, 36 s, 1801 rows", "ms", "median"]
    notes = ["Processor time of a run in one process; least, and median, of batches."]
    return [Table("Sweeps", head, rows, notes)]
