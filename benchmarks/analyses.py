"""Time modes, sensitivities and fits as whole commands, each beside a plain run.

The command and a run of its model are timed in turn. The bounds are goals for the
commands; they are compared with processor time, which depends less on other programs of
the machine than elapsed time.
"""

from __future__ import annotations

import json
import tempfile
from dataclasses import dataclass, field
from pathlib import Path

from measure import LAGSIM, MODELS, Table, Timed, process

CHAIN = """
name: chain-of-masses
parameters: {n: 100, k: 100, m: 1}
coordinates: {x(1..n): {unit: m}}
definitions:
  d(0): 0
  d(i = 1..n): x(i)
energy:
  kinetic: sum(i = 1..n, m*x_dot(i)^2/2)
  potential: sum(i = 1..n, k*(d(i) - d(i-1))^2/2)
initial: {x(i = 1..n): 0.01*i}
simulation: {duration: 10}
output: {columns: []}
"""
NAMES = ("l", "g", "K", "theta", "u")
# Largest ratio of `modes` to `run`, seconds of a fit, and runs of five names.
MODES, FIT, RUNS = 2.5, 2.5, 70


def tables(turns):
    """Measure all commands; return the tables."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        yield _modes(folder, turns)
        yield _sensitivities(folder, turns)
        yield _fit(folder, turns)


def _modes(folder, turns):
    model = folder / "chain.yaml"
    model.write_text(CHAIN, encoding="utf-8")
    quick = ["--no-plots", "-q", "-o"]
    commands = {
        "run --no-plots": [LAGSIM, "run", model, *quick, folder / "run"],
        "modes --no-plots": [LAGSIM, "modes", model, *quick, folder / "modes"],
    }
    times = _by_turns(commands, turns)
    run, modes = (x.cpu.least for x in times.values())
    notes = [f"modes / run: {modes / run:.3g}; at most {MODES} are expected"]
    return _table("Modes of a chain of 100 masses, whole commands", times, notes)


def _sensitivities(folder, turns):
    model, out = MODELS / "elastic-pendulum.yaml", folder / "sensitivities"
    plain = [LAGSIM, "run", model, "--no-plots", "-q", "--error-bar", "never"]
    commands = {
        "run": [*plain, "-o", folder / "plain"],
        "run --sensitivities": [
            *plain, "--sensitivities", ",".join(NAMES), "-o", out,
        ],
    }  # fmt: skip
    times = _by_turns(commands, turns)
    found = json.loads((out / "run.json").read_text(encoding="utf-8"))
    counts = {name: x["runs"] for name, x in found["sensitivities"].items()}
    listed = ", ".join(f"{name} {count}" for name, count in counts.items())
    notes = [
        f"{sum(counts.values()) + 1} runs, the middle one included: {listed}",
        f"at most {RUNS} are expected, and 41 where the first step serves",
    ]
    title = "Sensitivities of the elastic pendulum to five names, whole commands"
    return _table(title, times, notes)


def _fit(folder, turns):
    model, data = MODELS / "elastic-pendulum.yaml", folder / "measured"
    step = ["--duration", "10", "--output-step", "10/199"]
    process([LAGSIM, "run", model, *step, "--no-plots", "-q", "-o", data])
    varied = [x for name in ("l", "K", "g") for x in ("--vary", name)]
    command = [
        LAGSIM, "fit", model, data / "trajectory.csv", *varied,
        "--set", "l=1.01", "--set", "K=26", "--no-plots", "-q", "-o", folder / "fit",
    ]  # fmt: skip
    times = _by_turns({"fit": command}, turns)
    notes = [f"at most {FIT} s are expected"]
    return _table("Fit of three parameters to 200 points, whole command", times, notes)


@dataclass
class Command:
    """Elapsed and processor times of a command, one of each for every turn."""

    passed: Timed = field(default_factory=Timed)
    cpu: Timed = field(default_factory=Timed)


def _by_turns(commands, turns):
    """Run commands in turn, after one turn that is not counted."""
    times = {key: Command() for key in commands}
    for turn in range(-1, turns):
        for key, command in commands.items():
            done = process(command)
            if turn >= 0:
                times[key].passed.seconds.append(done.seconds)
                times[key].cpu.seconds.append(done.cpu)
    return times


def _table(title, times, notes):
    head = ["command", "s, least", "s, median", "processor s, least", "median"]
    rows = [
        [key, *(f"{s:.3g}" for x in (one.passed, one.cpu) for s in (x.least, x.median))]
        for key, one in times.items()
    ]
    return Table(title, head, rows, notes)
