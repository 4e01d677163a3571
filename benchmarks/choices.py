"""Is `auto` near the Pareto front? lagsim bench over the shipped models.

    python benchmarks/choices.py [--charts DIR] [MODEL ...]
    python benchmarks/choices.py --draw DIR [MODEL ...]

By errors of 1e-6, 1e-9 and 1e-12: what the cheapest method costs, what `auto` costs,
both read off their curves. scipy's solvers are left out, but for the charts: a step of
theirs is a Python call, and none has ever been near. What charts show is kept in
charts/ here; --draw draws them anew from there.
"""

from __future__ import annotations

import argparse
import io
import json
import sys
from pathlib import Path

from measure import HERE, MODELS, Table, cost_at
from PIL import Image

from lagsim.methods import names
from lagsim.model.reader import read_file
from lagsim.run.session import open_case
from lagsim.studies.bench.chart import chart
from lagsim.studies.bench.document import document, read_document
from lagsim.studies.bench.reference import NoReferenceError
from lagsim.studies.bench.wanted import Wish
from lagsim.studies.bench.work_precision import measure

ERRORS = (1e-6, 1e-9, 1e-12)
GOAL = 2.0
KEPT = HERE / "charts"
# More digits of a time, or of an error, say nothing; and this a chart does not show.
DIGITS = 4
HIDDEN = ("reason", "error_lambda", "energy_drift", "constraint_residual")


def compared(found, error, of="seconds"):
    """Give the cheapest curve's name and cost, and auto's cost, at an error."""
    if found.reference.floor > error:
        return None
    costs = {}
    for (method, formulation), entries in found.curves().items():
        if method.startswith("scipy:"):
            continue
        cost = cost_at(points(entries, of), error)
        if cost is not None:
            costs[f"{method} ({formulation})"] = cost
    if not costs:
        return None
    best = min(costs, key=costs.get)
    chosen = [e for e in found.entries if e.chosen]
    chosen.sort(key=lambda e: -(e.error or 0.0))
    return best, costs[best], cost_at(points(chosen, of), error)


def points(entries, of):
    return [(e.error, e.cost(of)) for e in entries if e.counts]


def rows_of(model, charts=None):
    """Give the rows of the table for one model; draw its chart where one is wanted."""
    case = open_case(read_file(str(MODELS / f"{model}.yaml")))
    try:
        found = measure(case, Wish(methods=None if charts else names()))
    except NoReferenceError as why:
        return [[model, "", "", str(why), "", ""]]
    if charts:
        keep(model, found, case)
        draw(model, charts)
    return [row_of(model, found, error) for error in ERRORS]


def keep(model, found, case):
    """Keep what a chart shows."""
    content = document(case.equations.model, case.settings, found, [])
    content = {k: v for k, v in content.items() if k not in ("parameters", "files")}
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
    """Give the same with few digits."""
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
    drawn = chart(read_document(str(KEPT / f"{model}.json")))
    picture = Image.open(io.BytesIO(drawn)).convert("RGB")
    picture.quantize(48).save(folder / f"{model}.png", optimize=True)


def show(folder):
    """Let the page beside the folder show every chart in it, where there is one."""
    page = folder.parent / "charts.md"
    if not page.exists():
        return
    text, _, _ = page.read_text(encoding="utf-8").partition("\n![")
    shown = [f"![{p.stem}]({folder.name}/{p.name})" for p in sorted(folder.iterdir())]
    page.write_text(text + "\n" + "\n\n".join(shown) + "\n", encoding="utf-8")


def row_of(model, found, error):
    chosen = sorted({e.method for e in found.entries if e.chosen})
    result = compared(found, error)
    if result is None:
        floor = found.reference.floor
        why = "reached by none"
        if floor > error:
            why = f"not known: the reference is to {floor:.0e}"
        return [model, f"{error:.0e}", ", ".join(chosen), why, "", ""]
    best, least, own = result
    shown = [model, f"{error:.0e}", ", ".join(chosen), f"{best}: {least * 1e3:.3g}"]
    if own is None:
        return [*shown, "never", "**no**"]
    factor = own / least
    mark = f"**{factor:.2f}**" if factor > GOAL else f"{factor:.2f}"
    return [*shown, f"{own * 1e3:.3g}", mark]


def tables(_turns, models=(), charts=None):
    """Give the table."""
    rows = []
    for model in models or sorted(path.stem for path in MODELS.glob("*.yaml")):
        rows += rows_of(model, charts)
        print(*rows[-len(ERRORS) :], sep="\n", file=sys.stderr, flush=True)
    head = ["model", "error", "auto takes", "cheapest, ms", "auto, ms", "factor"]
    behind = sum(row[-1].startswith("**") for row in rows)
    missed = f"{behind} of {len(rows)} miss the goal of a factor {GOAL:g} (bold)."
    how = "Errors of state and velocities against their ranges, over all rows that the "
    how += "reference knows; costs read off the curves in logarithms."
    notes = [missed, how]
    return [Table("What `auto` takes, and the cheapest", head, rows, notes)]


if __name__ == "__main__":
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("models", nargs="*", metavar="MODEL")
    options.add_argument("--charts", type=Path, metavar="DIR")
    options.add_argument("--draw", type=Path, metavar="DIR", help="measure nothing")
    asked = options.parse_args()
    if asked.draw:
        for name in asked.models or sorted(path.stem for path in KEPT.glob("*.json")):
            draw(name, asked.draw)
        show(asked.draw)
        sys.exit()
    print(tables(0, asked.models, asked.charts)[0].markdown())
    if asked.charts:
        show(asked.charts)
