"""Chains of point masses on massless links, in angles; models new to the machine."""

from __future__ import annotations

import json
import re
import shutil
import sys
from itertools import count

from arm import arm
from link_chain import chain
from measure import LAGSIM, MODELS, Table, alternate, process, workspace

PREPARE = """
import json, sys, time
from lagsim.model.reader import read_file
from lagsim.run.session import open_case
from lagsim.program.system import System
from lagsim.native.link import engine
engine.target()
laps, last = {}, time.perf_counter()
def lap(name):
    global last
    now = time.perf_counter()
    laps[name], last = now - last, now
model = read_file(sys.argv[1]); lap("read")
case = open_case(model); lap("derive and examine")
plan = case.plan(); lap("plan")
system = System(case.equations, plan); lap("compile")
runner = system.link(plan.method); lap("kernels and linking")
print(json.dumps(laps))
"""


def prepare(model, folder):
    """Prepare a model in a new process with an empty cache; return its laps."""
    shutil.rmtree(folder / "cache", ignore_errors=True)
    command = [sys.executable, "-c", PREPARE, model]
    found = process(command, LAGSIM_CACHE=folder / "cache")
    return json.loads(found.output)


def ten(turns):
    """Measure making the ten-link chain ready."""
    laps = []
    with workspace() as folder:
        model = MODELS / "chain-angles.yaml"
        alternate({"": lambda: laps.append(prepare(model, folder))}, turns, warm=0)
    own = [name for name in laps[0] if name != "kernels and linking"]
    sums = [sum(lap[name] for name in own) for lap in laps]
    best = laps[sums.index(min(sums))]
    rows = [[name, f"{best[name] * 1e3:.3g}"] for name in own]
    rows.append(["**in all**", f"**{min(sums) * 1e3:.3g}**; goal 500"])
    kernels = f"{best['kernels and linking'] * 1e3:.3g}"
    rows.append(["the method's kernels, once per machine, and linking", kernels])
    head = [f"ten links, new process, no cache; least of {turns}", "ms"]
    return Table("Ten links: read, derive, compile", head, rows, [])


def forty(turns):
    """Measure the first second of the forty-link chain, cold and warm."""
    found = {"cold": [], "warm": []}
    with workspace() as folder:
        model = folder / "chain-40.yaml"
        model.write_text(chain(40, 1.0))
        command = [LAGSIM, "run", model, "--no-plots", "-q", "-o", folder / "out"]
        for _ in range(turns):
            shutil.rmtree(folder / "cache", ignore_errors=True)
            for name in ("cold", "warm"):
                run = process(command, LAGSIM_CACHE=folder / "cache")
                record = json.loads((folder / "out" / "run.json").read_text())
                found[name].append((run.seconds, record))
    best = {name: min(runs, key=lambda run: run[0]) for name, runs in found.items()}
    laps = best["cold"][1]["timings"]
    rows = [
        [
            name,
            f"{best['cold'][1]['timings'][name]:.3g}",
            f"{best['warm'][1]['timings'][name]:.3g}",
        ]
        for name in laps
    ]
    rows.append(
        [
            "**whole process**",
            f"**{best['cold'][0]:.3g}**; goal 10",
            f"**{best['warm'][0]:.3g}**",
        ]
    )
    record = best["cold"][1]
    notes = [
        f"{record['steps']} steps, {record['rejections']} rejected, "
        f"{record['evaluations']} evaluations; energy drift "
        f"{record['energy_drift']:.1e}; plan: "
        + ", ".join(choice["choice"] for choice in record["plan"])
        + "."
    ]
    head = [f"forty links, least of {turns}", "no cache, s", "warm, s"]
    return Table("Forty links: the first second", head, rows, notes)


def new(turns):
    """Measure whole runs of models that are new to the machine, kernels compiled."""
    texts = {
        "elastic pendulum": (MODELS / "elastic-pendulum.yaml").read_text(),
        "arm of seven joints, 1 s": arm(1.0),
        "chain of 40 links, 1 s": chain(40, 1.0),
    }
    goals = "1.2 more than again", "7", "6"
    numbers = count()
    with workspace() as folder:

        def run(text):
            model = folder / "model.yaml"
            model.write_text(text)
            command = [LAGSIM, "run", model, "--no-plots", "-q", "-o", folder / "out"]
            return process(command, LAGSIM_CACHE=folder / "cache").seconds

        def renamed(text):
            # Code is kept by the names of parameters.
            return run(re.sub(r"\bg\b", f"g{next(numbers)}", text))

        bare = [sys.executable, "-c", "import numpy, yaml, typer"]
        candidates = {"bare": lambda: process(bare).seconds}
        for name, text in texts.items():
            candidates[name] = lambda text=text: renamed(text)
            candidates[f"{name}, again"] = lambda text=text: run(text)
        times = alternate(candidates, turns)
    unit = times["bare"].least
    rows = [
        [
            name,
            f"{times[name].least / unit:.2f}; goal {goal}",
            f"{times[f'{name}, again'].least / unit:.2f}",
        ]
        for name, goal in zip(texts, goals, strict=True)
    ]
    head = [f"unit: {unit:.3g} s, bare imports; least of {turns}", "new", "again"]
    return Table("Models new to the machine, without plots", head, rows, [])


def tables(turns):
    """Return all tables of the report."""
    return [ten(turns), forty(max(2, turns // 5)), new(max(3, turns // 3))]
