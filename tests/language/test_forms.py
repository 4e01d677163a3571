"""Sums of products: known identities, cancellation, and small differences."""

import numpy as np
import pytest

from benchmarks.link_chain import chain
from lagsim.language.evaluate import evaluate
from lagsim.language.forms import Collected, fewer_terms
from lagsim.language.graph import Graph
from lagsim.mechanics.derivation import derive
from lagsim.model.reader import read
from tests.language._programs import build
from tests.support import case_of

MOVING = ("a", "b", "c", "x")


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
        ("cos(a)*cos(b)/3 + sin(a)*sin(b)/3", "cos(a - b)/3"),
        ("2*cos(a - b) + cos(a)*cos(b) + sin(a)*sin(b)", "3*cos(a - b)"),
        ("x*a + sin(b)*cos(a) - cos(b)*sin(a)", "x*a - sin(a - b)"),
        ("cos(a - b)*cos(c) + sin(a - b)*sin(c)", "cos(a - b - c)"),
        # Squares and cubes of sums with factors other than 1.
        ("(3*sin(a) + 2*cos(a))^2 + (2*sin(a) - 3*cos(a))^2", "13"),
        ("(2*x*cos(a) + sin(a))^2 + (2*x*sin(a) - cos(a))^2", "4*x*x + 1"),
        ("(3*sin(a) + cos(a))^2 - 6*sin(a)*cos(a) - 8*sin(a)^2", "1"),
        ("(2*cos(a))^3 + 8*cos(a)*sin(a)^2", "8*cos(a)"),
        ("x*sin(a)^2/4 + x*cos(a)^2/4", "x/4"),
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


def test_small_differences_stay_whole():
    g = Graph()
    x, y, z = map(g.variable, "abc")
    difference = g.call("sub", x, y)
    node = g.call("add", g.call("mul", z, z), difference)
    collected = Collected(g, MOVING)
    assert difference in {n for _, n in collected.addends(node)}
    product = collected.sum([(g.variable("k"), difference, z)])
    values = {"a": 1e6 + 2.0**-20, "b": 1e6, "c": 3.0, "k": 0.5}
    assert evaluate(g, [product], values) == [1.5 * 2.0**-20]


@pytest.mark.parametrize("n", [2, 3, 6])
def test_chains_have_their_closed_form(n):
    # Of 6 angles there are 15 differences, which are written by sines and cosines.
    e = derive(read(chain(n, 1.0), "model.yaml"), chained=False)
    a, v = np.random.default_rng(n).uniform(-2.0, 2.0, (2, n))
    state = dict(zip((*e.q, *e.velocities), (*a, *v), strict=True))
    at = state | {"m": 1.3, "l": 0.7, "g": 9.81, "t": 0.0}
    hung = n - np.maximum.outer(range(n), range(n))
    apart = np.subtract.outer(a, a)
    M = 1.3 * 0.7**2 * hung * np.cos(apart)
    f = -1.3 * 0.7**2 * (hung * np.sin(apart)) @ v**2
    f -= 1.3 * 9.81 * 0.7 * (n - np.arange(n)) * np.sin(a)
    found = [evaluate(e.graph, row, at) for row in (*e.M, e.f)]
    np.testing.assert_allclose(found, [*M, f], rtol=0, atol=1e-12 * n**2)


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
