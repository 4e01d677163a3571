"""Savings by each reduction: one scene with and without the reduction, side by side."""

from __future__ import annotations

import time
from dataclasses import replace
from itertools import pairwise

import numpy as np
from measure import MODELS, Table, alternate, ms, ratio
from rod_chain import rod_chain

from lagsim.model.reader import read, read_file
from lagsim.run.observers import Keep
from lagsim.run.session import open_case


class Scene:
    """A model in one formulation, to be integrated again and again, with its table."""

    def __init__(self, model, formulation, *, change=None, **options):
        began = time.perf_counter()
        texts = {name: str(value) for name, value in options.items()}
        if "\n" in model:
            read_model = read(model, "model.yaml", options=texts)
        else:
            path = MODELS / f"{model}.yaml"
            read_model = read_file(str(path), options=texts)
        case = open_case(read_model, read_model.settings({"formulation": formulation}))
        plan = replace(case.plan(), **(change or {}))
        self.planned = time.perf_counter() - began
        self.session = case.ready(plan)

    def run(self):
        """Integrate, and keep the rows."""
        self.keep = Keep()
        self.trajectory = self.session.run([self.keep])

    def columns(self):
        """Return the table of the last run."""
        return self.keep.table[:, : self.session.system.columns.table]


def difference(scene, other):
    """Return the largest difference of a column, relative to the size of the column."""
    a, b = scene.columns(), other.columns()
    sizes = np.maximum(np.max(np.abs(b), axis=0), 1e-6 * np.max(np.abs(b)))
    return float(np.max(np.max(np.abs(a - b), axis=0) / sizes))


def compared(name, scenes, turns):
    """Return the table's rows for one comparison, the full formulation first."""
    times = alternate({key: scene.run for key, scene in scenes.items()}, turns)
    full = next(iter(scenes))
    lines = []
    for key, scene in scenes.items():
        counts = scene.trajectory.statistics
        lines.append(
            [
                name if key == full else "",
                key,
                *ms(times[key]),
                str(counts.evaluations),
                "" if key == full else ratio(times[full], times[key]),
                "" if key == full else f"{difference(scene, scenes[full]):.1e}",
                f"{scene.planned * 1e3:.3g}",
            ]
        )
    return lines


def pulling(n):
    """Return the model text of n masses that attract each other: M dense, constant."""
    names = [f"x{k}" for k in range(n)]
    kinetic = " + ".join(f"{a}_dot^2" for a in names)
    mean = " + ".join(f"{a}_dot" for a in names)
    pull = " + ".join(f"({a} - {b})^2" for a, b in pairwise(names))
    lines = [
        "coordinates:",
        *(f"  {a}: {{}}" for a in names),
        f'energy: {{kinetic: "({kinetic})/2 + ({mean})^2/{n}", potential: "{pull}"}}',
        "initial:",
        *(f"  {a}: {k % 3}" for k, a in enumerate(names)),
        "simulation: {duration: 5, output_step: 0.1}",
    ]
    return "\n".join(lines) + "\n"


def comparisons():
    """Return the scenes to compare: title -> name of the formulation -> scene."""
    found = {}
    for name, model in {
        "elastic pendulum on a curve": "elastic-pendulum-curve",
        "3 rods, Cartesian": rod_chain(3, 2.0),
        "5 rods, Cartesian": rod_chain(5, 1.5),
        "10 rods, Cartesian": rod_chain(10, 1.0),
    }.items():
        found[name] = {
            "projection": Scene(model, "full"),
            "elimination": Scene(model, "elimination"),
        }
    text = pulling(40)
    found["40 masses, M constant, loops"] = {
        "factored each time": Scene(text, "full", change={"constant": 0}),
        "factored once": Scene(text, "full"),
    }
    return found


def tables(turns):
    """Measure all comparisons; return the table of the report in a list."""
    rows = []
    for name, scenes in comparisons().items():
        rows += compared(name, scenes, turns)
    head = [
        f"integration and columns, warm, {turns} turns", "", "least, ms", "median, ms",
        "evaluations", "times faster", "columns differ by", "read and planned in, ms",
    ]  # fmt: skip
    notes = [
        "Default tolerances. Columns are compared against their own size, all of them.",
        "`auto` takes what has the smaller count of operations; the plan gives both.",
    ]
    return [Table("What structure saves", head, rows, notes)]
