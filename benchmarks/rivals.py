"""lagsim beside heyoka, scipy's DOP853 and SUNDIALS' IDA, on six scenes.

    pip install .[benchmarks]
    python benchmarks/rivals.py [--scenes kepler,andrews] [--method taylor]
    python benchmarks/rivals.py --draw

writes results-rivals.md and results-rivals.json here and docs/speed.png; with --draw
anew from what was measured. Every rival gets its equations from
lagsim's graph. The reference is heyoka's in quadruple precision, checked against itself
at another tolerance; errors are the greatest of any coordinate or velocity in any row,
against its range.
"""

from __future__ import annotations

import argparse
import json
import platform
import subprocess
import sys
import time
from dataclasses import dataclass, field
from importlib.metadata import version

import numpy as np
from measure import HERE, MODELS, Table, cost_at

DECADES = [float(f"1e-{k}") for k in range(4, 15)]
KEPT = HERE / "results-rivals.json"
REPORTED = (1e-8, 1e-12)
# Past this a rival is tried no tighter.
LONG_SECONDS = 2.0
# heyoka compiles itself anew for every tolerance, and without loops (compact mode off),
# which is faster, for most of a minute where there are this many operations: then at
# fewer tolerances.
MANY_NODES = 1000
FEWER_DECADES = [1e-8, 1e-10, 1e-12, 1e-14]
QUADRUPLE = (1e-25, 1e-22)


@dataclass(frozen=True)
class Case:
    """A scene and the options that differ from the model's own."""

    title: str
    model: str
    options: dict = field(default_factory=dict)


HOW = """\
- Least of several, warm, one solver after the other at each tolerance; compile time
  apart.
- lagsim: every row with all its columns (accelerations, energies, lambda), and
  projected onto the constraints. Rivals: the states of the same rows alone.
- heyoka: batch size 1, compact mode off (on, it compiles faster and runs slower);
  constrained scenes as index 1, unprojected. It compiles for each tolerance, when it
  first meets a scene for 0.1 (Kepler) to 50 s (ten links), and keeps that.
- IDA: residual and Jacobian compiled from the same graph, called through Python.
- scipy: the same compiled right-hand side through ctypes.
- Reference: heyoka in quadruple precision."""

KEPLER = {"duration": "200*pi", "output_step": "pi/5"}
CASES = (
    Case("elastic pendulum", "elastic-pendulum"),
    Case("double pendulum", "double-pendulum"),
    Case("Kepler, 100 orbits", "kepler", KEPLER),
    Case("ten links, angles", "chain-angles"),
    Case("Andrews' mechanism", "andrews"),
    Case("ten rods, Cartesian", "chain-cartesian"),
)


class Judge:
    """The reference of a scene and what errors are against it."""

    def __init__(self, equations, start, times):
        from rival_heyoka import Heyoka

        tight, other = (
            Heyoka(equations, start, times, tolerance, compact=True, quadruple=True)
            .solve()
            .rows
            for tolerance in QUADRUPLE
        )
        self.rows = tight
        ranges = np.ptp(tight, axis=0)[1:]
        self.scales = np.where(ranges > 0, ranges, np.inf)
        self.agreement = self.error(other)

    def error(self, rows):
        count = len(self.scales)
        apart = np.abs(rows[:, 1 : 1 + count] - self.rows[:, 1:])
        return float(np.max(apart / self.scales))


def measured(case, method):
    """Measure everything on one scene; gives a JSON document."""
    from rival_heyoka import equations_of

    from lagsim.model.reader import read_file
    from lagsim.run.session import open_case
    from lagsim.studies.bench.scipy_solvers import Scipy
    from lagsim.studies.bench.solutions import state_sizes
    from lagsim.studies.bench.solving import Own, Patience, least

    model = read_file(str(MODELS / f"{case.model}.yaml"), options=case.options)
    scene = open_case(model)
    own = Own(scene, "dop853")
    patience = Patience(60.0)
    rows = own.solve(1e-12, patience).rows
    times, sizes = rows[:, 0], state_sizes(own, rows)
    parameters = {p.name: p.value for p in model.parameters}
    theirs = equations_of(scene, own.plan, parameters)
    start = [*scene.start.q, *scene.start.v]
    judge = Judge(theirs, start, times)
    scipy = Scipy(own, "scipy:DOP853", times, sizes)
    candidates = {
        "lagsim": lambda rtol: ours(scene, method, rtol),
        "scipy DOP853": lambda rtol: (lambda: scipy.solve(rtol, patience), 0.0, ""),
        "heyoka": heyoka_maker(scene, own, theirs, start, times),
        **idas(scene, own, rows, sizes),
    }
    points = {name: [] for name in candidates}
    dropped = set()
    for rtol in DECADES:
        for name, make in candidates.items():
            if name in dropped or (made := make(rtol)) is None:
                continue
            solve, compile_seconds, how = made
            solve()
            solved = least(solve)
            if solved.seconds > LONG_SECONDS:
                dropped.add(name)
            if solved.rows is not None:
                points[name].append(
                    {
                        "tolerance": rtol,
                        "error": judge.error(solved.rows),
                        "seconds": solved.seconds,
                        "compile_seconds": compile_seconds,
                        "how": how,
                    }
                )
    return {
        "title": case.title,
        "agreement": judge.agreement,
        "rows": len(times),
        "columns_seconds": columns_seconds(own, rows),
        "points": points,
    }


def ours(scene, method, rtol):
    """Give lagsim with a method, or its own choice where that refuses, ready."""
    from lagsim.errors import InputError
    from lagsim.studies.bench.solving import Own, Patience

    try:
        own = Own(scene, method, "auto", rtol)
    except InputError:
        own = Own(scene, "auto", "auto", rtol)
    value = rtol if own.setting == "rtol" else own.plan.step
    patience = Patience(60.0)
    return (lambda: own.solve(value, patience)), own.compile_seconds, own.method


def heyoka_maker(scene, own, theirs, start, times):
    """Give heyoka's maker; None from it where compiling would take too long."""
    from rival_heyoka import Heyoka

    g = scene.equations.graph
    many = len(g.cone(own.plan.elimination.motion()[0])) > MANY_NODES

    def make(rtol):
        if many and rtol not in FEWER_DECADES:
            return None
        ready = Heyoka(theirs, start, times, rtol, compact=False)
        return ready.solve, ready.compile_seconds, ""

    return make


def idas(scene, own, rows, sizes):
    """Give IDA's makers, where there are constraints."""
    if not scene.equations.rows:
        return {}
    from rival_ida import FORMS, Ida, Problem

    def maker(form):
        problem = Problem(scene, form, rows[0], own.names)

        def make(rtol):
            return Ida(problem, rows[:, 0], sizes, rtol).solve, 0.0, ""

        return make

    return {f"IDA, {form}": maker(form) for form in FORMS}


def columns_seconds(own, rows):
    """Give what lagsim's columns of all rows cost: rivals give states alone."""
    states = np.ascontiguousarray(rows[:, : 1 + own.system.size])
    runner = own.system.link(own.method)
    times = []
    for _ in range(20):
        began = time.perf_counter()
        runner.tabulate(states)
        times.append(time.perf_counter() - began)
    return min(times)


def by_tolerance(results):
    """Give the table of times and errors at the tolerances reported."""
    head = ["scene", "solver"]
    for tolerance in REPORTED:
        head += [f"ms at {tolerance:.0e}", "error"]
    rows = []
    for result in results:
        for name, points in result["points"].items():
            row = [result["title"], name]
            for tolerance in REPORTED:
                at = [p for p in points if p["tolerance"] == tolerance]
                row += (
                    [f"{at[0]['seconds'] * 1e3:.3g}", f"{at[0]['error']:.1e}"]
                    if at
                    else ["-", "-"]
                )
            rows.append(row)
    return Table("At equal tolerances", head, rows, [])


def by_error(results):
    """Give the table of times at equal errors, and the ratios."""
    head = ["scene", "error", "lagsim, ms", "best rival, ms", "lagsim / rival"]
    head += ["lagsim without columns / rival"]
    rows = []
    for result in results:
        reached = tightest(result)
        # Where one of the two does not get there: where both do.
        for error in sorted({max(error, reached) for error in REPORTED}, reverse=True):
            costs = {}
            for name, points in result["points"].items():
                curve = [(p["error"], p["seconds"]) for p in points]
                cost = cost_at(curve, error)
                if cost is not None:
                    costs[name] = cost
            rows.append(compared(result, error, costs))
    return Table("At equal errors", head, rows, [])


def tightest(result):
    """Give the least error that both lagsim and heyoka reach."""
    return max(
        min((p["error"] for p in result["points"][name]), default=0.0)
        for name in ("lagsim", "heyoka")
    )


def compared(result, error, costs):
    own = costs.pop("lagsim", None)
    shown = [result["title"], f"{error:.0e}", f"{own * 1e3:.3g}" if own else "never"]
    if not costs:
        return [*shown, "none gets there", "", ""]
    name = min(costs, key=costs.get)
    shown.append(f"{name}: {costs[name] * 1e3:.3g}")
    if own is None:
        return [*shown, "", ""]
    bare = own - result["columns_seconds"]
    return [*shown, f"{own / costs[name]:.2f}", f"{bare / costs[name]:.2f}"]


def document(results):
    """Give what was measured, on what and when: all that page and chart say."""
    from lagsim.studies.bench.machine import machine, today
    from lagsim.version import __version__

    packages = ("numpy", "llvmlite", "scipy", "heyoka", "scikit-sundae")
    versions = {"python": platform.python_version()}
    return {
        "lagsim": __version__,
        "versions": versions | {name: version(name) for name in packages},
        "machine": machine(),
        "date": today(),
        "scenes": results,
    }


def report(found):
    """Give the page."""
    from lagsim.studies.bench.machine import stamp

    results = found["scenes"]
    about = [f"{stamp(found)}."]
    worst = max(r["agreement"] for r in results)
    about.append(f"At two tolerances the reference agrees with itself to {worst:.0e}.")
    lines = "\n".join(f"- {line}" for line in about)
    tables = [by_error(results), by_tolerance(results)]
    return "\n".join([f"# Rivals\n\n{HOW}\n{lines}\n", *(t.markdown() for t in tables)])


def main():
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--scenes", help="model names; default all")
    options.add_argument("--method", default="auto", help="lagsim's; default auto")
    options.add_argument("--one", help=argparse.SUPPRESS)
    options.add_argument("--draw", action="store_true", help="measure nothing")
    given = options.parse_args()
    if given.draw:
        write(json.loads(KEPT.read_text(encoding="utf-8")))
        return
    if given.one:
        case = next(c for c in CASES if c.model == given.one)
        print(json.dumps(measured(case, given.method)))
        return
    wanted = given.scenes.split(",") if given.scenes else [c.model for c in CASES]
    results = []
    for model in wanted:
        # Each in a process of its own: what one rival leaves behind slows no other.
        command = [sys.executable, __file__, "--one", model, "--method", given.method]
        done = subprocess.run(command, stdout=subprocess.PIPE, check=True)
        results.append(json.loads(done.stdout))
        print(f"{model} measured", file=sys.stderr, flush=True)
    found = document(results)
    KEPT.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    write(found)


def write(found):
    """Write the page and draw the chart."""
    from rivals_chart import chart

    (HERE / "results-rivals.md").write_text(report(found), encoding="utf-8")
    (HERE.parent / "docs" / "speed.png").write_bytes(chart(found))


if __name__ == "__main__":
    main()
