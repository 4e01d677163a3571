"""Distance of `auto` from the Pareto front of `lagsim bench`, over the shipped models.

    python benchmarks/choices.py [--charts DIR] [--budget SECONDS] [MODEL ...]
    python benchmarks/choices.py --draw DIR [MODEL ...]

For errors of 1e-6, 1e-9 and 1e-12: the costs of the cheapest method and of `auto`, both
from their work-precision curves, with and without the time to compile the model on a
machine that has not compiled it before. scipy's solvers are left out except in charts:
each of their steps is a Python call, and none was ever near the front. The data of
charts are stored in charts/ here; --draw draws the charts from these data.
"""

from __future__ import annotations

import argparse
import io
import json
import os
import sys
import tempfile
import time
from pathlib import Path

from measure import HERE, MODELS, Table, cost_at
from PIL import Image

from lagsim.methods import names
from lagsim.model.reader import read_file
from lagsim.run.session import open_case
from lagsim.studies.bench.chart import work_precision
from lagsim.studies.bench.work_precision import (
    BenchOptions,
    NoReferenceError,
    curves,
    is_answer,
    measure,
    read_document,
)

ERRORS = (1e-6, 1e-9, 1e-12)
GOAL = 2.0
# Seconds for each model; what is left out then stands in the chart.
BUDGET = 30.0
# Curves that cost more than this many times the cheapest are not compiled anew: the
# others compile in about the time that they do.
CLOSE = 4.0
KEPT = HERE / "charts"
CACHE = "LAGSIM_CACHE"
# The function that no kernel has, and every model's code.
MODELS_OWN = b"\0prepare\0"
# More digits of a time, or of an error, say nothing; and this a chart does not show.
DIGITS = 4
HIDDEN = ("reason", "error_lambda", "energy_drift", "constraint_residual")


def costs_at(found, error):
    """Return the cost in seconds of each curve of lagsim at an error."""
    costs = {}
    for curve, rows in curves(found["rows"]).items():
        if curve[0].startswith("scipy:") or found["reference"]["floor"] > error:
            continue
        cost = cost_at(points(rows), error)
        if cost is not None:
            costs[curve] = cost
    return costs


def own_cost(found, error):
    """Return the time of `auto` for an error, and its method and formulation.

    The time, in s, is interpolated between the tolerances that `auto` was run with.

    found : the document of a bench
    """
    chosen = [row for row in found["rows"] if row["chosen"]]
    chosen.sort(key=lambda row: -(row["error"] or 0.0))
    enough = [row for row in chosen if is_answer(row) and row["error"] <= error]
    first = [*enough, chosen[-1]][0]
    return cost_at(points(chosen), error), (first["method"], first["formulation"])


class Compiling:
    """Time to compile a model on a machine that has not compiled it before.

    The kernels of methods, which all models share, are compiled first into a separate
    cache, from which the functions of the model are then removed.
    """

    def __init__(self, case):
        self.case, self.known = case, {}

    def seconds(self, curve):
        """Return the seconds to compile for a curve: a method in a formulation."""
        if curve not in self.known:
            with tempfile.TemporaryDirectory() as folder:
                before = os.environ.get(CACHE)
                os.environ[CACHE] = folder
                try:
                    self.known[curve] = self._measured(curve, Path(folder))
                finally:
                    os.environ.pop(CACHE)
                    if before is not None:
                        os.environ[CACHE] = before
        return self.known[curve]

    def _measured(self, curve, folder):
        self._link(curve)
        for made in folder.rglob("*.object"):
            if MODELS_OWN in made.read_bytes():
                made.unlink()
        first = self._link(curve)
        return max(0.0, first - min(self._link(curve) for _ in range(2)))

    def _link(self, curve):
        from lagsim.studies.bench import Own

        began = time.perf_counter()
        Own(self.case, *curve)
        return time.perf_counter() - began


def points(rows):
    return [(row["error"], row["seconds"]) for row in rows if is_answer(row)]


def rows_of(model, charts=None, budget=BUDGET):
    """Return the table's rows for one model, one for each error.

    If the folder `charts` is given, its chart is drawn there.

    budget : seconds.
    """
    case = open_case(read_file(str(MODELS / f"{model}.yaml")))
    wish = BenchOptions(methods=None if charts else names(), budget=budget)
    try:
        found = measure(case, wish)
    except NoReferenceError as why:
        return [[model, "", "", str(why), *[""] * 4]]
    if charts:
        keep(model, found)
        draw(model, charts)
    compiling = Compiling(case)
    return [row_of(model, found, error, compiling) for error in ERRORS]


def keep(model, found):
    """Store the data of a model's chart in the folder of charts."""
    content = {k: v for k, v in found.items() if k != "parameters"}
    content["model"]["file"] = f"models/{model}.yaml"
    rows = [
        {k: v for k, v in row.items() if k not in HIDDEN} for row in content["rows"]
    ]
    KEPT.mkdir(exist_ok=True)
    lines = ",\n".join(json.dumps(row) for row in rounded(rows))
    text = json.dumps(content | {"rows": []})[: -len("[]}")]
    assert text.endswith('"rows": ')
    (KEPT / f"{model}.json").write_text(f"{text}[\n{lines}\n]}}\n", encoding="utf-8")


def rounded(value):
    """Return a JSON value with all floats rounded to a few digits."""
    if isinstance(value, float):
        return float(f"{value:.{DIGITS}g}")
    if isinstance(value, list):
        return [rounded(part) for part in value]
    if isinstance(value, dict):
        return {k: rounded(v) for k, v in value.items()}
    return value


def draw(model, folder):
    """Draw the chart of a model, in a palette of colours: a tenth of the bytes."""
    folder.mkdir(parents=True, exist_ok=True)
    drawn = work_precision(read_document(str(KEPT / f"{model}.json")))
    picture = Image.open(io.BytesIO(drawn)).convert("RGB")
    picture.quantize(48).save(folder / f"{model}.png", optimize=True)


def show(folder):
    """List all charts of a folder in the page beside it, if there is such a page."""
    page = folder.parent / "charts.md"
    if not page.exists():
        return
    text, _, _ = page.read_text(encoding="utf-8").partition("\n![")
    shown = [f"![{p.stem}]({folder.name}/{p.name})" for p in sorted(folder.iterdir())]
    page.write_text(text + "\n" + "\n\n".join(shown) + "\n", encoding="utf-8")


def row_of(model, found, error, compiling):
    chosen = sorted({row["method"] for row in found["rows"] if row["chosen"]})
    shown = [model, f"{error:.0e}", ", ".join(chosen)]
    costs = costs_at(found, error)
    if not costs:
        floor = found["reference"]["floor"]
        why = "reached by none"
        if floor > error:
            why = f"not known: the reference is to {floor:.0e}"
        return [*shown, why, *[""] * 4]
    best = min(costs, key=costs.get)
    own, curve = own_cost(found, error)
    shown.append(f"{best[0]} ({best[1]}): {costs[best] * 1e3:.3g}")
    if own is None:
        return [*shown, "never", "**no**", "", ""]
    first = {
        one: cost + compiling.seconds(one)
        for one, cost in costs.items()
        if cost <= CLOSE * costs[best]
    }
    least = min(first, key=first.get)
    ours = own + compiling.seconds(curve)
    shown += [f"{own * 1e3:.3g}", marked(own / costs[best])]
    shown.append(f"{least[0]} ({least[1]}): {first[least] * 1e3:.3g}")
    return [*shown, marked(ours / first[least])]


def marked(factor):
    """Return a factor as text; bold if it exceeds the goal."""
    return f"**{factor:.2f}**" if factor > GOAL else f"{factor:.2f}"


def tables(_turns, models=(), charts=None, budget=BUDGET):
    """Bench the models; return the table of the report in a list."""
    rows = []
    for model in models or sorted(path.stem for path in MODELS.glob("*.yaml")):
        began = time.perf_counter()
        rows += rows_of(model, charts, budget)
        print(*rows[-len(ERRORS) :], sep="\n", file=sys.stderr, flush=True)
        seconds = time.perf_counter() - began
        print(f"{model}: {seconds:.0f} s", file=sys.stderr, flush=True)
    head = ["model", "error", "auto takes", "cheapest, ms", "auto, ms", "factor"]
    head += ["cheapest with compilation, ms", "factor"]
    behind = sum("**" in row[5] for row in rows)
    new = sum("**" in row[7] for row in rows)
    missed = f"{behind} of {len(rows)} miss the goal of a factor {GOAL:g} (bold)"
    missed += f"; {new} with compilation."
    how = "Errors of state and velocities against their ranges, over all rows that the "
    how += "reference knows; costs read off the curves in logarithms."
    cold = "With compilation: of the model's functions; the methods' own kernels are "
    cold += "compiled once per machine, and not counted."
    return [
        Table("What `auto` takes, and the cheapest", head, rows, [missed, how, cold])
    ]


if __name__ == "__main__":
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("models", nargs="*", metavar="MODEL")
    options.add_argument("--charts", type=Path, metavar="DIR")
    options.add_argument("--budget", type=float, default=BUDGET, metavar="SECONDS")
    options.add_argument("--draw", type=Path, metavar="DIR", help="measure nothing")
    asked = options.parse_args()
    if asked.draw:
        for name in asked.models or sorted(path.stem for path in KEPT.glob("*.json")):
            draw(name, asked.draw)
        show(asked.draw)
        sys.exit()
    print(tables(0, asked.models, asked.charts, asked.budget)[0].markdown())
    if asked.charts:
        show(asked.charts)
