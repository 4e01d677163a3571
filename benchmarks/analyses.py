"""Answers besides one motion: modes, sensitivities and fits as whole commands.

Each stands beside a run of the same model, by turns. The bounds are those that the
commands are to keep.
"""

from __future__ import annotations

import json
import tempfile
from pathlib import Path

from measure import LAGSIM, MODELS, Table, alternate, process

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
    times = alternate(
        {key: _called(command) for key, command in commands.items()}, turns
    )
    run, modes = times.values()
    rows = [_row(key, x) for key, x in times.items()]
    notes = [
        f"modes / run: {modes.least / run.least:.3g}; at most {MODES} are expected"
    ]
    head = ["command", "s, least", "s, median"]
    return Table("Modes of a chain of 100 masses, whole commands", head, rows, notes)


def _sensitivities(folder, turns):
    model, out = MODELS / "elastic-pendulum.yaml", folder / "sensitivities"
    plain = [LAGSIM, "run", model, "--no-plots", "-q", "--error-bar", "never"]
    commands = {
        "run": [*plain, "-o", folder / "plain"],
        "run --sensitivities": [
            *plain, "--sensitivities", ",".join(NAMES), "-o", out,
        ],
    }  # fmt: skip
    times = alternate({key: _called(x) for key, x in commands.items()}, turns)
    found = json.loads((out / "run.json").read_text(encoding="utf-8"))
    counts = {name: x["runs"] for name, x in found["sensitivities"].items()}
    listed = ", ".join(f"{name} {count}" for name, count in counts.items())
    notes = [
        f"{sum(counts.values()) + 1} runs, the middle one included: {listed}",
        f"at most {RUNS} are expected, and 41 where the first step serves",
    ]
    head = ["command", "s, least", "s, median"]
    rows = [_row(key, x) for key, x in times.items()]
    title = "Sensitivities of the elastic pendulum to five names, whole commands"
    return Table(title, head, rows, notes)


def _fit(folder, turns):
    model, data = MODELS / "elastic-pendulum.yaml", folder / "measured"
    step = ["--duration", "10", "--output-step", "10/199"]
    process([LAGSIM, "run", model, *step, "--no-plots", "-q", "-o", data])
    varied = [x for name in ("l", "K", "g") for x in ("--vary", name)]
    command = [
        LAGSIM, "fit", model, data / "trajectory.csv", *varied,
        "--set", "l=1.01", "--set", "K=26", "--no-plots", "-q", "-o", folder / "fit",
    ]  # fmt: skip
    times = alternate({"fit": _called(command)}, turns)
    notes = [f"at most {FIT} s are expected, on an idle machine"]
    head = ["command", "s, least", "s, median"]
    title = "Fit of three parameters to 200 points, whole command"
    return Table(title, head, [_row("fit", times["fit"])], notes)


def _called(command):
    """Return a function that runs a command and returns its seconds."""
    return lambda: process(command).seconds


def _row(name, times):
    return [name, f"{times.least:.3g}", f"{times.median:.3g}"]
