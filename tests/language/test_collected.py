"""Sums of products against their values, and what they take."""

from __future__ import annotations

import random
from typing import TYPE_CHECKING

import pytest

from lagsim.language.collected import Collected
from lagsim.language.evaluate import evaluate
from lagsim.language.graph import Graph

if TYPE_CHECKING:
    from collections.abc import Sequence

MOVING = ("x", "y", "z")
STILL = ("m", "n", "k")


def moving_operations(g: Graph, node: int) -> int:
    return sum(bool(g.args[n]) for n in g.dependent([node], MOVING))


def test_equal_products_are_one_and_equal_factors_stand_once() -> None:
    g = Graph()
    x, y, m, n = map(g.variable, "xymn")
    light, heavy = (g.call("div", g.one, mass) for mass in (m, n))
    terms = [(w, d, d) for d in (x, y) for w in (light, heavy)]
    found = Collected(g, MOVING).sum(terms)
    # (1/m + 1/n) (x x + y y)
    assert moving_operations(g, found) == 4
    values = {"x": 3.0, "y": 4.0, "m": 2.0, "n": 4.0}
    assert evaluate(g, [found], values) == [0.75 * 25.0]


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


def test_what_stands_still_divides_a_sum_where_that_is_shorter() -> None:
    g = Graph()
    x, y, m, k = map(g.variable, ("x", "y", "m", "k"))
    push = g.call("sub", g.call("mul", m, g.call("mul", x, x)), g.call("mul", k, y))
    found = Collected(g, MOVING).scaled(push, g.call("div", g.one, m))
    # x x - (k/m) y
    assert moving_operations(g, found) == 3
    values = {"x": 3.0, "y": 5.0, "m": 4.0, "k": 2.0}
    assert evaluate(g, [found], values) == [6.5]
    whole = g.call("add", x, y)
    assert moving_operations(g, Collected(g, MOVING).scaled(whole, k)) == 2


def test_tidy_sums_have_no_terms_that_cancel() -> None:
    g = Graph()
    x, y, z, m, k = map(g.variable, ("x", "y", "z", "m", "k"))
    # z (m (k (2 x y)) / 2 - k (m (x y)) + m (x^2)), as chain rules give it
    twice = g.call("mul", k, g.call("mul", g.constant(2.0), g.call("mul", x, y)))
    one = g.call("mul", m, g.call("mul", g.constant(0.5), twice))
    other = g.call("mul", k, g.call("mul", m, g.call("mul", x, y)))
    square = g.call("mul", m, g.call("pow", x, g.constant(2.0)))
    inner = g.call("add", g.call("sub", one, other), square)
    node = g.call("mul", z, inner)
    [found] = Collected(g, MOVING).tidy([node])
    assert moving_operations(g, found) == 3  # m z (x x)
    values = {"x": 3.0, "y": 5.0, "z": 0.5, "m": 4.0, "k": 2.0}
    assert evaluate(g, [found], values) == [18.0]


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
