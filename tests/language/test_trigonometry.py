"""Sines and cosines in fewer terms: known identities, and equal values everywhere."""

from __future__ import annotations

import numpy as np
import pytest

from lagsim.language.evaluate import evaluate
from lagsim.language.forms import fewer_terms
from lagsim.language.graph import Graph
from lagsim.language.parser import parse
from tests.support import case_of

MOVING = ("a", "b", "c", "x")


def build(g: Graph, text: str) -> int:
    return parse(text).build(g, g.variable)


@pytest.mark.parametrize(
    ("long", "short"),
    [
        ("sin(a)^2 + cos(a)^2", "1"),
        ("k*(x*sin(a))*sin(a) + cos(a)*k*x*cos(a)", "k*x"),
        ("cos(a)*cos(b) + sin(a)*sin(b)", "cos(a - b)"),
        ("3*cos(a)*cos(b) - sin(a)*sin(b)*3", "3*cos(a + b)"),
        ("sin(a)*cos(b) + cos(a)*sin(b)", "sin(a + b)"),
        ("sin(a)*cos(b) - cos(a)*sin(b)", "sin(a - b)"),
        ("sin(b)*cos(a) - cos(b)*sin(a)", "-sin(a - b)"),
        # Angles of one body against another, and differences that vanish.
        ("cos(a)*cos(a + b) + sin(a)*sin(a + b)", "cos(b)"),
        ("sin(a + b)*cos(a) - cos(a + b)*sin(a)", "sin(b)"),
        # Three turns, one after the other.
        (
            "cos(c)*(cos(a)*cos(b) - sin(a)*sin(b)) - sin(c)*sin(a + b)",
            "cos(a + b + c)",
        ),
        ("(cos(a)*x + sin(a))^2 + (sin(a)*x - cos(a))^2", "x*x + 1"),
    ],
)
def test_identities(long, short):
    g = Graph()
    [found] = fewer_terms(g, [build(g, long)], MOVING)
    expected = build(g, short)
    assert len(g.cone([found])) <= len(g.cone([expected]))
    for seed in range(3):
        at = np.random.default_rng(seed).uniform(-2.0, 2.0, 5)
        state = dict(zip("abcxk", at, strict=True))
        one, other = evaluate(g, [found, expected], state)
        assert one == pytest.approx(other, rel=1e-14, abs=1e-14)


def test_what_would_be_long_stays():
    g = Graph()
    x = "+".join(f"{k}*sin({k}*a)" for k in range(1, 150))
    node = build(g, f"({x})*({x.replace('sin', 'cos')})")
    assert fewer_terms(g, [node], MOVING) == [node]


@pytest.mark.parametrize("seed", range(20))
def test_values_are_the_same(seed):
    random = np.random.default_rng(seed)
    leaves = ["sin(a)", "cos(a)", "sin(b)", "cos(b)", "cos(a - c)", "sin(c)", "x", "k"]

    def some(depth):
        if depth == 0:
            return str(random.choice(leaves))
        one, other = some(depth - 1), some(depth - 1)
        return f"({one}){random.choice(['+', '-', '*', '*'])}({other})"

    pairs = ((some(2), some(2)) for _ in range(3))
    text = " + ".join(
        f"(({p})*sin(a) + ({q})*cos(b))^2 + (({p})*cos(a) - ({q})*sin(b))^2"
        for p, q in pairs
    )
    g = Graph()
    node = build(g, text)
    [found] = fewer_terms(g, [node], MOVING)
    for _ in range(5):
        state = dict(zip("abcxk", random.uniform(-2.0, 2.0, 5), strict=True))
        old, new = evaluate(g, [node, found], state)
        # Some hundred terms of size 4^4 at most, each off by some roundings.
        assert new == pytest.approx(old, rel=1e-12, abs=1e-11)


def test_a_double_pendulum_is_as_short_as_in_textbooks():
    e = case_of("double-pendulum").equations
    g = e.graph
    cone = g.cone([*e.mass_entries.values(), *e.f])
    turns = sorted(g.ops[n] for n in cone if g.ops[n] in ("sin", "cos"))
    # sin and cos of the difference, and gravity's two sines.
    assert turns == ["cos", "sin", "sin", "sin"]


def test_small_differences_of_potentials_are_not_multiplied_out():
    text = """
    parameters: {k: 1.0e9}
    coordinates: {a: {}, b: {}}
    definitions: {x1: sin(a), x2: sin(b), y1: cos(a), y2: cos(b)}
    energy:
      kinetic: (x1_dot^2 + y1_dot^2 + (x2_dot + x1_dot)^2 + (y2_dot + y1_dot)^2)/2
      potential: k*(x1 - x2)^4/4
    initial: {a: 0.3, b: 0.3}
    simulation: {duration: 1}
    """
    e = case_of(text).equations
    a, d = 0.3, 1e-4
    state = {"a": a + d, "b": a, "a_dot": 0.0, "b_dot": 0.0, "k": 1e9, "t": 0.0}
    # sin(a + d) - sin(a), free of cancellation.
    small = 2.0 * np.cos(a + d / 2.0) * np.sin(d / 2.0)
    expected = -1e9 * small**3 * np.cos(a + d)
    [found] = evaluate(e.graph, [e.f[0]], state)
    # The difference is off by the rounding of two sines, 1e-16 of 0.3 against 1e-4.
    assert found == pytest.approx(expected, rel=1e-11)
