"""Sums of products against their values, and what they take."""

from __future__ import annotations

import random
from typing import TYPE_CHECKING

import pytest

from lagsim.language.evaluate import evaluate
from lagsim.language.forms import Collected
from lagsim.language.graph import Graph

if TYPE_CHECKING:
    from collections.abc import Sequence

MOVING = ("x", "y", "z")
STILL = ("m", "n", "k")


def test_what_cancels_is_not_computed() -> None:
    g = Graph()
    x, y, m, gravity = map(g.variable, ("x", "y", "m", "k"))
    collected = Collected(g, MOVING)
    over = g.call("div", g.one, m)
    weight = g.call("mul", m, gravity)
    difference, opposite = g.call("sub", x, y), g.call("sub", y, x)
    assert collected.sum([(weight, over)]) == gravity
    assert collected.sum([(weight, over, x)]) == g.call("mul", gravity, x)
    both = [(weight, over, difference), (weight, over, opposite)]
    assert collected.sum(both) == g.zero


def test_small_differences_stay_whole() -> None:
    g = Graph()
    x, y, z = map(g.variable, MOVING)
    difference = g.call("sub", x, y)
    node = g.call("add", g.call("mul", z, z), difference)
    collected = Collected(g, MOVING)
    assert difference in {n for _, n in collected.addends(node)}
    product = collected.sum([(g.variable("k"), difference, z)])
    values = {"x": 1e6 + 2.0**-20, "y": 1e6, "z": 3.0, "k": 0.5}
    assert evaluate(g, [product], values) == [1.5 * 2.0**-20]


@pytest.mark.parametrize("seed", range(30))
def test_values_stay(seed: int) -> None:
    r = random.Random(seed)
    g = Graph()
    nodes = [g.variable(name) for name in (*MOVING, *STILL)]
    nodes += [g.one, g.constant(-1.0), g.constant(0.5), g.constant(3.0)]
    for _ in range(20):
        op = r.choice(("add", "sub", "mul", "mul", "div", "neg"))
        nodes.append(g.call(op, *r.choices(nodes, k=1 if op == "neg" else 2)))
    products = [r.choices(nodes, k=r.randint(1, 3)) for _ in range(6)]
    values = {name: r.uniform(0.5, 2.0) for name in (*MOVING, *STILL)}
    collected = Collected(g, MOVING)
    found = evaluate(g, [collected.sum(products)], values)[0]
    terms = [product_of(evaluate(g, factors, values)) for factors in products]
    split = [
        (sign, node)
        for factors in products
        for sign, node in collected.addends(factors[0])
    ]
    apart = evaluate(g, [collected.sum(split)], values)[0]
    firsts = [evaluate(g, factors[:1], values)[0] for factors in products]
    if all(abs(x) < 1e6 for x in (*terms, *firsts)):  # nor divided by what cancelled
        # Each product has a few roundings of its own size.
        assert found == pytest.approx(sum(terms), abs=1e-12 * sum(map(abs, terms)))
        assert apart == pytest.approx(sum(firsts), rel=1e-9, abs=1e-9)


def product_of(factors: Sequence[float]) -> float:
    whole = 1.0
    for x in factors:
        whole *= x
    return whole


@pytest.mark.parametrize("seed", range(20))
def test_tidy_values_stay_and_are_no_longer(seed: int) -> None:
    r = random.Random(seed)
    g = Graph()
    nodes = [g.variable(name) for name in (*MOVING, *STILL)]
    nodes += [g.constant(0.5), g.constant(3.0)]
    for _ in range(30):
        op = r.choice(("add", "sub", "mul", "mul", "neg", "sin"))
        nodes.append(g.call(op, *r.choices(nodes, k=1 if op in ("neg", "sin") else 2)))
    given = nodes[-4:]
    found = Collected(g, MOVING).tidy(given)
    assert g.cost(found, MOVING) <= g.cost(given, MOVING)
    values = {name: r.uniform(0.2, 1.0) for name in (*MOVING, *STILL)}
    expected = evaluate(g, given, values)
    assert evaluate(g, found, values) == pytest.approx(expected, rel=1e-9, abs=1e-11)
