"""lagsim beside heyoka, scipy and SUNDIALS on six scenes; ensembles, bounces.

    pip install .[benchmarks]
    python benchmarks/rivals.py [--scenes kepler,andrews] [--method taylor]
    python benchmarks/rivals.py --draw

writes results-rivals.md and results-rivals.json here and docs/speed.png. With --scenes
only the named scenes are measured, and replace their stored results; with --draw all
files are written again from the stored results. The other solvers get the textbook's
equations (textbook.py), or lagsim's where those are shorter, in the same compiled form.
"""

from __future__ import annotations

import argparse
import copy
import importlib
import json
import math
import platform
import subprocess
import sys
import time
from dataclasses import dataclass, field, replace
from importlib.metadata import version
from statistics import median

import numpy as np
from measure import HERE, MODELS

KEPT = HERE / "results-rivals.json"
DECADES = [float(f"1e-{k}") for k in range(4, 16)]
# heyoka compiles itself anew for every tolerance, for seconds where the equations are
# long: then at fewer of them.
LONG_NODES = 100
FEWER_DECADES = [float(f"1e-{k}") for k in (6, 8, 10, 12, 13, 14)]
# Rounds of all candidates at a tolerance end after these seconds, or so many.
ROUNDS, SECONDS = 25, 1.0
FEWEST_ROUNDS = 3
# Successive runs of a solver in its turn, if they take no longer than BRIEF seconds:
# the first one begins with the data of the others in the processor's caches.
SUCCESSIVE, BRIEF = 3, 0.01
# Past this a rival is tried no tighter.
LONG_SECONDS = 0.4
QUADRUPLE = (1e-25, 1e-22)


@dataclass(frozen=True)
class Case:
    """A scene and the options that differ from the model's own.

    `starts` are added to the coordinates at the start, one run for each.
    """

    key: str
    title: str
    model: str
    options: dict = field(default_factory=dict)
    starts: tuple = (0.0,)


KEPLER = {"duration": "200*pi", "output_step": "pi/5"}
NEARBY = tuple(0.01 * k for k in range(10))
CASES = (
    Case("elastic-pendulum", "elastic pendulum", "elastic-pendulum"),
    Case("double-pendulum", "double pendulum", "double-pendulum", starts=NEARBY),
    Case("double-pendulum-5", "double pendulum, 5 s", "double-pendulum",
         {"duration": "5"}, NEARBY),
    Case("kepler", "Kepler, 100 orbits", "kepler", KEPLER),
    Case("chain-angles", "ten links, angles", "chain-angles"),
    Case("andrews", "Andrews' mechanism", "andrews"),
    Case("chain-cartesian", "ten rods, Cartesian", "chain-cartesian"),
)  # fmt: skip


# Measured by modules of their own.
OTHERS = {"ensemble": "ensembles", "bounces": "rival_mujoco"}
EVERY = (*(case.key for case in CASES), *OTHERS)


class Judge:
    """Reference solutions of a scene in quadruple precision, one for each start."""

    def __init__(self, equations, starts, times):
        from rival_heyoka import Heyoka

        tight, other = (
            [h.solve(start).rows for start in starts]
            for h in (
                Heyoka(equations, times, tolerance, compact=True, quadruple=True)
                for tolerance in QUADRUPLE
            )
        )
        self.rows = tight
        ranges = [np.ptp(rows, axis=0)[1:] for rows in tight]
        self.scales = [np.where(r > 0, r, np.inf) for r in ranges]
        self.agreement = max(self.error(rows, k) for k, rows in enumerate(other))

    def error(self, rows, k):
        """Return the largest error of all components and rows, relative to ranges.

        k : the index of the start.
        """
        count = len(self.scales[k])
        apart = np.abs(rows[:, 1 : 1 + count] - self.rows[k][:, 1:])
        return float(np.max(apart / self.scales[k]))


@dataclass
class Timed:
    """A solver at a tolerance, with its least time and its error for each start.

    `first` is the least time of the first run in a turn, which is from the first start.
    """

    solve: object
    about: dict
    best: list
    errors: list
    first: float = math.inf
    failed: bool = False


class Scene:
    """A case with its model, and all that is compiled once for every solver."""

    def __init__(self, case, method):
        from by_textbook import nodes_of
        from rival_heyoka import equations_by_textbook, equations_of, hy

        from lagsim.model.reader import read_file
        from lagsim.run.session import open_case
        from lagsim.studies.bench import Own, state_sizes
        from lagsim.studies.trial import Patience

        self.case, self.method, self.patience = case, method, Patience(60.0)
        model = read_file(str(MODELS / f"{case.model}.yaml"), options=case.options)
        self.scene = open_case(model)
        e = self.scene.equations
        self.names = [*e.q, *e.velocities]
        parameters = {p.name: p.value for p in model.parameters}
        own = Own(self.scene, "dop853", "auto", 1e-12)
        self.own, rows = own, own.solve(1e-12, self.patience).rows
        self.times, self.sizes = rows[:, 0], state_sizes(own, rows)[: len(self.names)]
        first = np.array([*self.scene.start.q, *self.scene.start.v])
        moved = np.array([1.0] * len(e.q) + [0.0] * len(e.velocities))
        self.starts = [first + by * moved for by in case.starts]
        exact = equations_by_textbook(case.model, e, parameters, hy.real128)
        self.judge = Judge(exact, self.starts, self.times)
        self.g, self.nodes = nodes_of(case.model, e.q, e.velocities, parameters)
        accelerations, _ = own.plan.elimination.motion()
        velocities = [e.graph.variable(v) for v in e.velocities]
        ours = e.graph.cone([*velocities, *accelerations])
        self.counts = {"textbook": len(self.g.cone(self.nodes)), "lagsim": len(ours)}
        self.theirs = equations_by_textbook(case.model, e, parameters)
        if self.counts["lagsim"] < self.counts["textbook"]:
            self.g, self.nodes = substituted(e.graph, [*velocities, *accelerations],
                                             parameters)  # fmt: skip
            self.theirs = equations_of(self.scene, own.plan, parameters)

    def moved(self, own, start):
        """Return a copy of one of lagsim's solvers with another start."""
        from lagsim.run.session import Session

        n = len(start) // 2
        case = own.session.case
        state = replace(case.start, q=start[:n].copy(), v=start[n:].copy())
        found = copy.copy(own)
        found.session = Session(case.at(state), own.plan, own.system)
        return found

    def ours(self, rtol):
        """Return a compiled solver of lagsim at a tolerance, and data about it.

        The method is `self.method`, or that of `auto` where this refuses the model.
        Runs are made in one memory as in a sweep, where a sweep does so for the model.
        """
        from lagsim.errors import InputError
        from lagsim.studies.bench import Own
        from lagsim.studies.sweep.batches import refusal

        try:
            own = Own(self.scene, self.method, "auto", rtol)
        except InputError:
            own = Own(self.scene, "auto", "auto", rtol)
        value = rtol if own.setting == "rtol" else own.plan.step
        plan = replace(own.plan, rtol=rtol if own.setting == "rtol" else None)
        session = own.session.by(plan)
        about = {
            "compile_seconds": own.compile_seconds,
            "how": own.method,
            "steps": session.run([]).statistics.steps,
        }
        if not refusal(session):
            return swept(session), about
        solvers = {bytes(s): self.moved(own, s) for s in self.starts}
        return (lambda s: solvers[bytes(s)].solve(value, self.patience)), about

    def heyoka(self, rtol):
        """Return a compiled solver of heyoka; None if compilation takes too long."""
        from rival_heyoka import Heyoka

        if min(self.counts.values()) > LONG_NODES and rtol not in FEWER_DECADES:
            return None
        ready = Heyoka(self.theirs, self.times, rtol)
        steps = ready.solve(self.starts[0]).evaluations
        about = {"compile_seconds": ready.compile_seconds, "steps": steps}
        return ready.solve, about | ready.counts

    def compiled(self, rtol):
        """Return the arguments that create the solvers of scipy and SUNDIALS."""
        return self.g, self.nodes, self.names, self.times, self.sizes, rtol

    def candidates(self):
        """Return name -> function from a tolerance to a solver and data about it."""
        from rival_scipy import Scipy
        from rival_sundials import Cvode, Library

        library = Library()
        makers = {
            "lagsim": self.ours,
            "heyoka": self.heyoka,
            "CVODE Adams": lambda rtol: (
                Cvode(library, *self.compiled(rtol)).solve, {}
            ),
            "scipy DOP853": lambda rtol: (
                Scipy(*self.compiled(rtol), by_odeint=False).solve, {}
            ),
            "scipy LSODA": lambda rtol: (
                Scipy(*self.compiled(rtol), by_odeint=True).solve, {}
            ),
        }  # fmt: skip
        return makers | self._idas()

    def _idas(self):
        if not self.scene.equations.rows:
            return {}
        from rival_ida import FORMS, Ida, Problem

        rows = self.own.solve(1e-12, self.patience).rows
        problems = {
            form: Problem(self.scene, form, rows[0], self.own.names) for form in FORMS
        }

        def maker(problem):
            return lambda rtol: (Ida(problem, self.times, self.sizes, rtol).solve, {})

        return {f"IDA, {form}": maker(problem) for form, problem in problems.items()}


def swept(session):
    """Return a solver that runs from given starts in one memory, as a sweep does."""
    from lagsim.studies.bench import solved
    from lagsim.studies.sweep.batches import Ensemble

    ensemble = Ensemble(session)

    def solve(start):
        began = time.perf_counter()
        table = ensemble.table(0, start)
        seconds = time.perf_counter() - began
        return solved(table, seconds, ensemble.arc.steps)

    return solve


def substituted(g, nodes, parameters):
    """Return nodes with parameters replaced by numbers."""
    numbers = {g.variable(k): g.constant(v) for k, v in parameters.items()}
    return g, g.substitute(nodes, numbers)


def measured(case, method):
    """Measure all solvers at all tolerances on one scene; return a JSON document."""
    scene = Scene(case, method)
    candidates = scene.candidates()
    points = {name: [] for name in candidates}
    dropped = set()
    for rtol in DECADES:
        ready = {}
        for name, make in candidates.items():
            if name not in dropped and (made := make(rtol)) is not None:
                ready[name] = first_round(scene, *made)
        rounds(scene, ready)
        for name, timed in ready.items():
            # A failure at a loose tolerance says nothing of tighter ones (heyoka).
            if median(timed.best) > LONG_SECONDS and not timed.failed:
                dropped.add(name)
            if not timed.failed:
                errors, seconds = median(timed.errors), median(timed.best)
                found = {"tolerance": rtol, "error": errors, "seconds": seconds}
                found["first_seconds"] = timed.first
                points[name].append(found | timed.about)
    return {
        "key": case.key,
        "title": case.title,
        "starts": len(case.starts),
        "agreement": scene.judge.agreement,
        "rows": len(scene.times),
        "columns_seconds": columns_seconds(scene),
        "nodes": scene.counts,
        "points": points,
    }


def first_round(scene, solve, about):
    """Run a candidate once from each start; return its times and errors.

    solve : start -> rows and seconds.
    about : data about the candidate.
    """
    timed = Timed(solve, about, [], [])
    for k, start in enumerate(scene.starts):
        solved = solve(start)
        timed.failed |= not len(solved.rows)
        timed.best.append(solved.seconds)
        good = len(solved.rows) > 0
        timed.errors.append(scene.judge.error(solved.rows, k) if good else 1.0)
    return timed


def rounds(scene, ready):
    """Time all solvers in turn; store the least times of each.

    ready : name -> `Timed`, changed in place.
    """
    began = time.perf_counter()
    spent = dict.fromkeys(ready, 0.0)
    for turn in range(ROUNDS):
        for name, timed in ready.items():
            if timed.failed or (turn >= FEWEST_ROUNDS and spent[name] > SECONDS / 4):
                continue
            for k, start in enumerate(scene.starts):
                for again in range(SUCCESSIVE):
                    seconds = timed.solve(start).seconds
                    timed.best[k] = min(timed.best[k], seconds)
                    if k == again == 0:
                        timed.first = min(timed.first, seconds)
                    spent[name] += seconds
                    if seconds > BRIEF:
                        break
        if turn >= FEWEST_ROUNDS and time.perf_counter() - began > SECONDS:
            break


def columns_seconds(scene):
    """Measure the seconds for lagsim's columns of all rows.

    They are subtracted in comparisons, since other solvers return states only.
    """
    own = scene.own
    rows = own.solve(1e-8, scene.patience).rows
    states = np.ascontiguousarray(rows[:, : 1 + own.system.size])
    runner = own.system.link(own.method)
    times = []
    for _ in range(20):
        began = time.perf_counter()
        runner.tabulate(states)
        times.append(time.perf_counter() - began)
    return min(times)


def document(results, others):
    """Return the JSON document of page and chart: results, versions, machine, date."""
    from lagsim.studies.bench import machine, today
    from lagsim.version import __version__

    packages = ("numpy", "llvmlite", "scipy", "heyoka", "scikit-sundae", "mujoco")
    versions = {"python": platform.python_version()}
    return {
        "lagsim": __version__,
        "versions": versions | {name: version(name) for name in packages},
        "machine": machine(),
        "date": today(),
        "scenes": results,
        **others,
    }


def main():
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--scenes", help="their keys; default all")
    options.add_argument("--method", default="auto", help="lagsim's; default auto")
    options.add_argument("--one", help=argparse.SUPPRESS)
    options.add_argument("--draw", action="store_true", help="measure nothing")
    given = options.parse_args()
    if given.draw:
        write(json.loads(KEPT.read_text(encoding="utf-8")))
        return
    if given.one:
        print(json.dumps(one(given.one, given.method)))
        return
    wanted = given.scenes.split(",") if given.scenes else EVERY
    for key in wanted:
        began = time.perf_counter()
        # Each in a process of its own: what one rival leaves behind slows no other.
        command = [sys.executable, __file__, "--one", key, "--method", given.method]
        done = subprocess.run(command, stdout=subprocess.PIPE, check=True)
        keep(key, json.loads(done.stdout))
        seconds = time.perf_counter() - began
        print(f"{key} measured in {seconds:.0f} s", file=sys.stderr, flush=True)


def one(key, method):
    """Measure one scene, or one of OTHERS, by its key; return a JSON document."""
    if key in OTHERS:
        return importlib.import_module(OTHERS[key]).measured()
    case = next(c for c in CASES if c.key == key)
    return measured(case, method)


def keep(key, result):
    """Add a result to the stored ones, and write all files again."""
    from lagsim.studies.bench import stamp

    known = json.loads(KEPT.read_text(encoding="utf-8")) if KEPT.exists() else {}
    scenes = {r["key"]: {"measured": stamp(known)} | r for r in known.get("scenes", ())}
    others = {name: known[name] for name in OTHERS if name in known}
    if key in OTHERS:
        others[key] = result
    else:
        scenes[key] = result | {"measured": stamp(document([], {}))}
    found = document([scenes[name] for name in EVERY if name in scenes], others)
    KEPT.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    write(found)


def write(found):
    """Write the page and draw the chart."""
    from rivals_chart import chart
    from rivals_page import page

    (HERE / "results-rivals.md").write_text(page(found), encoding="utf-8")
    if found["scenes"]:
        (HERE.parent / "docs" / "speed.png").write_bytes(chart(found))


if __name__ == "__main__":
    main()
