"""Series by a loop over the order against the same written out."""

from __future__ import annotations

import numpy as np
import pytest

from lagsim.language.evaluate import evaluate
from lagsim.language.graph import Graph
from lagsim.language.series import recurrence, taylor_series
from lagsim.native.graph import keys, straight_line
from lagsim.native.graph.keys import Layout, Loop
from tests.native.test_graph_code import LAYOUT, STATE, VALUES, Compiled, build

ORDER = 8
# Products and what has a recurrence; what has slopes alone; branches and time; what
# needs no sums at all. Each state's rate uses the others: none may come too early.
MOTIONS = [
    ("y*z - a*x", "x*z/(2 + y^2)", "sqrt(1 + x^2)*y - b*z"),
    ("sin(x - y)*z", "atan(z*x) + exp(-x)", "hypot(x, y)^1.3"),
    ("y*cos(3*t)", "if(x*y < z, x*z, tanh(x))", "max(x, y)*t"),
    ("y", "-x", "a + t"),
]


def both(texts: tuple[str, ...], order: int = ORDER) -> tuple[Graph, list[int], Loop]:
    """Give the series as nodes, and as a loop."""
    g = Graph()
    state = [g.variable(name) for name in STATE]
    rates = build(g, *texts)
    rows = taylor_series(g, state, rates, order)
    nodes = [g.constant(order), *(n for row in rows for n in row)]
    return g, nodes, Loop(recurrence(g, state, rates), order)


def looped(g: Graph, loop: Loop, length: int) -> list[float]:
    compiled = Compiled(g, {"f": loop})
    compiled.prepare(VALUES)
    return compiled.call("f", VALUES, length)


@pytest.mark.parametrize(("piece", "edges"), [(7, 32), (400, 0)])
@pytest.mark.parametrize("texts", MOTIONS)
def test_a_loop_gives_the_coefficients(
    texts: tuple[str, ...], piece: int, edges: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(keys, "PIECE", piece)
    monkeypatch.setattr(straight_line, "MOST_EDGES", edges)
    g, nodes, loop = both(texts)
    found = looped(g, loop, len(nodes))
    expected = evaluate(g, nodes, VALUES)
    assert found[0] == ORDER
    rows = np.array(expected[1:]).reshape(ORDER + 1, -1)
    # A sum of up to 8 terms in another order, in each of up to a dozen operations.
    size = np.abs(rows).max(axis=1, keepdims=True)
    off = np.abs(np.array(found[1:]).reshape(rows.shape) - rows)
    assert (off <= 1e-14 * size).all()


def test_more_sums_than_one_loop_takes() -> None:
    most = straight_line.WIDTHS[0]
    g = Graph()
    x, y, z = (g.variable(name) for name in STATE)
    rate = g.one
    for _ in range(2 * most + 3):  # Horner: a product each
        rate = g.call(
            "add", g.one, g.call("mul", g.call("mul", g.constant(0.5), x), rate)
        )
    rates = [rate, x, g.call("neg", y)]
    made = recurrence(g, [x, y, z], rates)
    assert len(made.sums) > 2 * most
    rows = taylor_series(g, [x, y, z], rates, 5)
    nodes = [g.constant(5), *(n for row in rows for n in row)]
    expected = evaluate(g, nodes, VALUES)
    found = looped(g, Loop(made, 5), len(nodes))
    # Sums of positive terms: nothing cancels.
    assert found == pytest.approx(expected, rel=1e-13)


def test_a_loop_has_a_key_of_its_own() -> None:
    _, nodes, loop = both(MOTIONS[0])
    g, _, _ = both(MOTIONS[0])
    made = [{"f": nodes}, {"f": loop}, {"f": loop._replace(order=ORDER + 1)}]
    assert len({keys.fingerprint(g, f, LAYOUT) for f in made}) == 3
    moved = Layout(LAYOUT.y, LAYOUT.p, LAYOUT.fixed, LAYOUT.size + 1)
    assert keys.fingerprint(g, made[1], moved) != keys.fingerprint(g, made[1], LAYOUT)
