"""A file with one letter changed has a fault at a place, or is another model.

A change without either effect was ignored in silence; any other exception is a fault of
lagsim.
"""

from __future__ import annotations

import re
from dataclasses import replace

import pytest

from lagsim.errors import InputError
from lagsim.model.reader import read

FILE = """
parameters: {n: 3, l: 1/n, m(1..n): [1, 1, 2], k(i = 1..n): 100*i, J: [0.1, 0.2, 0.3]}
modes: {held: 1, u: 0}
coordinates: {q(1..n): {}, G: {components: xy}, p: {components: xyz}, a: {}}
states: {s: {rate: G.x - s}}
tables:
  load: {points: [[0, 0], [10, 1]], interpolation: linear, outside: hold}
  road: {points: [[0, 0], [1, 1], [2, 0]], interpolation: cubic, outside: repeat}
definitions:
  x(0): 0
  x(i = 1..n): x(i-1) + l*sin(q(i))
  high: sum(i = 1..n, m(i)*x(i))
  far: max(i = 1..n, x(i))
  w: omega(arm)
frames:
  arm: {axis: [0, 3, 4], angle: a}
  hand: {on: arm, axis: [4, 0, 3], angle: 2*a}
gravity: [0, 0, -9.81]
bodies:
  b: {mass: 2, at: p, frame: hand, inertia: J, shape: {box: [1, 0.5, 0.2]}}
energy:
  kinetic: bodies + sum(i = 1..n, q_dot(i)^2)/2 + dot(G_dot, G_dot)/2
  potential: bodies + sum(i = 1..n, k(i)*q(i)^2)/2 + dot(G, G)
forces: {q(2): load(t) - road(t), G: [u, 2], w: [0, 0, 0.1]}
constraints:
  rod: {relation: norm(p) = 1}
  sling: {relation: G_dot.y = 0, when: held > 0}
  brake: {relation: G_dot.x = 0, limit: 0.5 + 0.1*abs(s)}
  floor: {relation: G.y >= -3, restitution: 0.8, friction: 0.3, slip: G_dot.x}
events:
  release: {at: G.x >= 7, set: {held: 0}, once: true}
  sample: {every: 0.01, set: {u: max(-20, min(20, G.x))}}
initial:
  q(1..n): [0.1, 0.2, 0.3]
  q(3): 0.5
  q_dot(1): 1
  G: [0.5, 1]
  p: [1, 0, 0]
  a: 0.1
  s: {steady: 0}
simulation: {duration: 1, output_step: 0.01, rtol: 1e-9, until: G.x <= -5}
scene:
  points: {o: [0, 0, 0], c: p, e(i = 1..n): [x(i), 0, 0]}
  links: [[o, c], {points: [o, e(1)], as: spring}, [e(1..n)]]
  shapes: {ball: {sphere: 0.1, at: c}, push: {arrow: [1, 0, 0], at: c, scale: 0.1}}
output:
  columns: [x, high]
  reactions: [far]
  plots: [{x: t, y: [high, far]}]
  sections: {cut: {at: G.x = 0, direction: up, plot: [G.x, q(2)]}, st: {every: 0.2}}
"""
WORDS = [m.span() for m in re.finditer(r"[A-Za-z]\w*|\d+(\.\d+)?(e-\d+)?", FILE)]


def content(text):
    """Return all data of a model except the digest of the file."""
    model = read(text, "model.yaml")
    g = model.graph
    leaves = {n: g.payload(n) for n in range(len(g.ops)) if not g.args[n]}
    return repr((replace(model, sha256="", graph=None), g.ops, g.args, leaves))


@pytest.mark.slow
def test_each_word_counts():
    base = content(FILE)
    assert content(f"{FILE}# what changes nothing\n") == base
    dropped, placed = [], True
    for start, end in WORDS:
        last = FILE[end - 1]
        # Of the same length, so that places stay.
        other = str((int(last) + 1) % 10) if last.isdecimal() else "zq"[last == "z"]
        text = FILE[: end - 1] + other + FILE[end:]
        try:
            if content(text) == base:
                dropped.append((FILE.count("\n", 0, start), FILE[start:end]))
        except InputError as fault:
            placed &= all(p.line for p in fault.problems)
    assert not dropped
    assert placed
