"""Links, rods, trees, strings and bodies: time of each stage, with exponents."""

from __future__ import annotations

import json
import math
import sys

from link_chain import chain
from measure import Table, peak, workspace
from rod_chain import rod_chain
from snake import snake

LINKS = (10, 40, 100, 200, 400)
RODS = (100, 1000, 3000, 10_000)
SNAKES = (7, 14, 28, 56, 100)
BODIES = (50, 100, 200, 500, 1000)
STRINGS = (200, 500, 1000, 2000, 4000)
STAGES = ("read", "derive, examine", "plan", "compile", "run", "evaluation")
# One process for each number, whose cache is empty. CPU of the process, not the clock.
MEASURE = """
import json, sys, time
import numpy as np
from lagsim.model.reader import read_file
from lagsim.run.session import open_case
from lagsim.program.signatures import FUNCTION
laps = [time.process_time()]
def lap():
    laps.append(time.process_time())
model = read_file(sys.argv[1]); lap()
case = open_case(model); lap()
plan = case.plan(); lap()
session = case.ready(plan); lap()
session.run([]); lap()
runner = session.system.link(plan.method)
call = runner.engine.function("derivative", *FUNCTION)
y = np.concatenate([case.start.q, case.start.v + 0.1])
arrays = y, session.system.p.flat, np.zeros_like(y)
addresses = [array.ctypes.data for array in arrays]
least = float("inf")
for turn in range(30):
    began, made = time.process_time(), 0
    while made < 2 or time.process_time() - began < 0.02:
        call(0.0, *addresses)
        made += 1
    least = min(least, (time.process_time() - began) / made)
print(json.dumps([*(b - a for a, b in zip(laps, laps[1:])), least]))
"""


def measured(scene, n):
    """Return the seconds of each of STAGES, and the peak memory in MB."""
    with workspace() as folder:
        model = folder / "model.yaml"
        model.write_text(scene(n))
        command = [sys.executable, "-c", MEASURE, str(model)]
        megabytes, done = peak(command, LAGSIM_CACHE=folder / "cache")
    return [*json.loads(done.output.splitlines()[-1]), megabytes]


def one(n):
    """Return n: the number of bodies is the size."""
    return n


def table(title, scene, sizes, turns, number=one):
    """Measure a scene at all sizes; return a table with the least time of each stage.

    scene : size -> model text.
    number : size -> the number of bodies or pairs, of which times are powers; their
        exponents are in the last column.
    """
    found = {n: [] for n in sizes}
    for _ in range(turns):
        for n in sizes:
            found[n].append(measured(scene, n))
    least = {n: [min(x) for x in zip(*runs, strict=True)] for n, runs in found.items()}
    rows = []
    for k, stage in enumerate((*STAGES, "memory, MB")):
        values = [least[n][k] for n in sizes]
        scale = 1e6 if stage == "evaluation" else 1.0
        # The last decade or so: below it, what does not depend on the number counts.
        first = len(sizes) // 2 - 1
        span = math.log(number(sizes[-1]) / number(sizes[first]))
        exponent = math.log(values[-1] / values[first]) / span
        unit = stage if k == len(STAGES) else f"{stage}, {'us' if scale > 1 else 's'}"
        shown = [f"{value * scale:.3g}" for value in values]
        rows.append([unit, *shown, f"{exponent:.2f}"])
    head = ["CPU", *map(str, sizes), f"exponent, {sizes[first]} to {sizes[-1]}"]
    return Table(title, head, rows, [f"Least of {turns}, in processes of their own."])


def links(n):
    """Return the model text of n links over a twentieth of a second."""
    return chain(n, 0.05)


def rods(n):
    """Return the model text of n rods over a few steps."""
    return rod_chain(n, 0.001, 0.001)


ATTRACTING = """
parameters:
  n: {n}
  G: 1
  eps: 0.05
  m(i = 1..n): 1/n + 0.1*i/n^2
coordinates: {{x(1..n): {{}}, y(1..n): {{}}, z(1..n): {{}}}}
energy:
  kinetic: sum(i = 1..n, m(i)*(x_dot(i)^2 + y_dot(i)^2 + z_dot(i)^2))/2
  potential: "sum(i = 1..n, sum(j = i+1..n,
    -G*m(i)*m(j)/sqrt((x(i) - x(j))^2 + (y(i) - y(j))^2 + (z(i) - z(j))^2 + eps^2)))"
initial:
  x(i = 1..n): cos(2.4*i)*sqrt(i/n)
  y(i = 1..n): sin(2.4*i)*sqrt(i/n)
  z(i = 1..n): 0.3*cos(7.1*i)
  x_dot(i = 1..n): -0.7*sin(2.4*i)*sqrt(i/n)
  y_dot(i = 1..n): 0.7*cos(2.4*i)*sqrt(i/n)
simulation: {{duration: 0.5, output_step: 0.05}}
"""


def bodies(n):
    """Return the model text of n bodies that attract each other, over half a second."""
    return ATTRACTING.format(n=n)


STRING = """
parameters: {{n: {n}, k: 100, m: 1}}
coordinates: {{u(1..n): {{}}}}
energy:
  kinetic: sum(i = 1..n, m*u_dot(i)^2/2)
  potential: k*(u(1)^2 + u(n)^2)/2 + sum(i = 1..n-1, k*(u(i+1) - u(i))^2/2)
initial: {{u(i = 1..n): 0.1*sin(pi*i/(n+1))}}
simulation: {{duration: 0.02}}
output: {{columns: []}}
"""


def string(n):
    """Return the model text of n masses on springs, with 1,000 rows in 0.02 s."""
    return STRING.format(n=n)


def pairs(n):
    """Return the number of pairs of n bodies."""
    return n * (n - 1) / 2


def tables(turns):
    """Return the tables of the report."""
    few = max(1, turns // 10)
    return [
        table("Links in angles, in number", links, LINKS, few),
        table("Rods in Cartesian coordinates, in number", rods, RODS, few),
        table("Links in space, on frames, in number", snake, SNAKES, few),
        table("Strings of masses, in number", string, STRINGS, few),
        table("Bodies that attract; exponents in pairs", bodies, BODIES, few, pairs),
    ]
