"""Laws in number: masses with dry friction, a column of balls; with exponents in n.

Whole commands, beside bare imports, and per evaluation and per impact.
"""

from __future__ import annotations

import json
import math
import sys
import tempfile
from itertools import pairwise
from pathlib import Path

from measure import LAGSIM, Table, alternate, process

FRICTION = """
name: friction-chain
parameters: {{n: {n}, k: 100, m: 1, L: 0.5}}
coordinates: {{x(1..n): {{}}}}
definitions:
  d(0): 0.5*sin(3*t)
  d(i = 1..n): x(i)
energy:
  kinetic: sum(i = 1..n, m*x_dot(i)^2/2)
  potential: sum(i = 1..n, k*(d(i) - d(i-1))^2/2)
constraints:
  rub(i = 1..n): {{relation: x_dot(i) = 0, limit: L}}
initial: {{x(i = 1..n): 0}}
simulation: {{duration: 5}}
output: {{columns: []}}
"""
COLUMN = """
name: column
parameters: {{n: {n}, g: 9.81, r: 0.05, e: 0.5, m: 1}}
coordinates: {{y(1..n): {{}}}}
definitions:
  low(0): -r
  low(i = 1..n): y(i)
energy:
  kinetic: sum(i = 1..n, m*y_dot(i)^2/2)
  potential: sum(i = 1..n, m*g*y(i))
constraints:
  c(i = 1..n): {{relation: low(i) - low(i-1) >= 2*r, restitution: e}}
initial: {{y(i = 1..n): 0.3 + 0.2*(i - 1)}}
simulation: {{duration: 2}}
output: {{columns: []}}
"""
LAWS = {
    "masses on springs with dry friction, 5 s": (
        FRICTION,
        "evaluation",
        (10, 20, 40, 80, 160, 400),
    ),
    "column of balls, dropped, 2 s": (COLUMN, "impact", (20, 40, 80, 160, 200)),
}


def tables(turns):
    """Measure both models at all sizes; return the tables."""
    with tempfile.TemporaryDirectory() as name:
        for title, (text, unit, sizes) in LAWS.items():
            yield _growth(Path(name), title, text, unit, sizes, max(2, turns // 10))


def _growth(folder, title, text, unit, sizes, turns):
    imports = [sys.executable, "-c", "import numpy"]
    commands = {"imports": lambda: process(imports).cpu}
    for n in sizes:
        model = folder / f"{unit}-{n}.yaml"
        model.write_text(text.format(n=n), encoding="utf-8")
        commands[str(n)] = _run(model, folder / f"{unit}-{n}")
    times = alternate(commands, turns)
    bare = times.pop("imports").least
    rows, each = [], []
    for n in sizes:
        count = _count(folder / f"{unit}-{n}", unit)
        least = times[str(n)].least
        each.append((least - bare) / count)
        shown = f"{least:.3g}", f"{times[str(n)].median:.3g}"
        rows.append([str(n), *shown, str(count), f"{1e6 * each[-1]:.3g}"])
    notes = [
        f"exponents of the time per {unit}: "
        + ", ".join(
            f"{math.log(y / x) / math.log(b / a):.2f} from {a} to {b}"
            for (x, y), (a, b) in zip(pairwise(each), pairwise(sizes), strict=True)
        )
    ]
    head = ["n", "processor s, least", "median", f"{unit}s", f"us per {unit}"]
    return Table(f"Laws in number: {title}", head, rows, notes)


def _run(model, out):
    options = ["--no-plots", "-q", "--error-bar", "never", "-o", out]
    return lambda: process([LAGSIM, "run", model, *options]).cpu


def _count(out, unit):
    """Return the count of evaluations of a run, or of its impacts."""
    if unit == "evaluation":
        found = json.loads((out / "run.json").read_text(encoding="utf-8"))
        return found["evaluations"]
    text = (out / "events.csv").read_text(encoding="utf-8")
    return sum(",impact," in line for line in text.splitlines())
