"""Costs read off curves, a textbook's equations, docs/speed.png."""

import numpy as np
import pytest

from benchmarks.measure import cost_at
from benchmarks.rivals_chart import LOOKS, chart
from benchmarks.textbook import OF, Numbers
from lagsim.language.evaluate import evaluate
from lagsim.mechanics.derivation import derive
from lagsim.studies.bench import stamp
from tests.outputs.drawn import assert_legible, drawn
from tests.support import shipped


def test_costs_between_points_are_straight_in_logarithms():
    curve = [(1e-2, 1.0), (1e-4, 4.0), (1e-8, 64.0)]
    assert cost_at(curve, 1e-3) == pytest.approx(2.0)
    assert cost_at(curve, 1e-6) == pytest.approx(16.0)
    assert cost_at(curve, 1e-4) == 4.0


def test_an_error_beyond_the_ends_of_a_curve():
    curve = [(1e-2, 3.0), (1e-4, 4.0)]
    assert cost_at(curve, 1e-1) == 3.0
    assert cost_at(curve, 1e-5) is None
    assert cost_at([], 1.0) is None


def test_a_curve_that_comes_back_is_read_where_it_is_cheapest():
    # Rounding makes tight settings worse: they cost more and do not count.
    assert cost_at([(1e-2, 1.0), (1e-4, 2.0), (1e-3, 9.0)], 1e-3) < 2.0


def accelerations(e, values):
    """Solve M a - A' lambda = f, A a = b densely."""
    g, n, m = e.graph, len(e.q), len(e.rows)
    matrix, right = np.zeros((n + m, n + m)), np.zeros(n + m)
    matrix[:n, :n] = [evaluate(g, row, values) for row in e.M]
    right[:n] = evaluate(g, e.f, values)
    for k, row in enumerate(e.rows):
        matrix[n + k, :n] = evaluate(g, row.A, values)
        matrix[:n, n + k] = -matrix[n + k, :n]
        right[n + k] = evaluate(g, [row.b], values)[0]
    return np.linalg.solve(matrix, right)[:n]


@pytest.mark.parametrize("model", OF)
def test_equations_by_hand_are_those_derived(model):
    e = derive(shipped(model))
    parameters = {p.name: p.value for p in e.model.parameters}
    start = {i.name: i.value for i in e.model.initial}
    rng = np.random.default_rng(1)
    for _ in range(3):
        # Off the constraints as well: index 1 does not need them to hold.
        q = [start.get(name, 0.0) + rng.normal(0.0, 0.02) for name in e.q]
        v = [rng.normal() for _ in e.velocities]
        state = dict(zip([*e.q, *e.velocities], [*q, *v], strict=True))
        expected = accelerations(e, parameters | state | {"t": 0.0})
        found = OF[model](q, v, parameters, Numbers)
        # Rounding, times the condition of the matrix: 1e4 in the mechanism.
        assert np.allclose(found, expected, rtol=1e-11, atol=1e-11 * max(abs(expected)))


def points(times):
    errors = [10.0**-k for k in range(2, 14)]
    return [{"error": e, "seconds": times * e**-0.1} for e in errors]


def document(scenes):
    names = list(LOOKS)
    every = [
        {
            "title": f"ten rods of scene {k}", "agreement": 1e-15, "rows": 1501,
            "points": {name: points(1e-3 * (1 + j)) for j, name in enumerate(names)},
        }
        for k in range(scenes)
    ]  # fmt: skip
    packages = {"python": "3.13.1", "heyoka": "7.13.2", "scikit-sundae": "1.2.0"}
    machine = {"processor": "Some Processor", "cores": 4, "system": "Linux", "load": 0}
    return {
        "lagsim": "1.2.3", "versions": packages, "machine": machine,
        "date": "2030-04-01", "scenes": every,
    }  # fmt: skip


@pytest.mark.parametrize("scenes", [1, pytest.param(3, marks=pytest.mark.slow)])
def test_every_text_is_legible_and_all_is_said(scenes):
    found = document(scenes)
    drawing = drawn(chart, found)
    assert_legible(drawing)
    assert len(drawing.panels) == scenes
    said = drawing.written()
    assert said.count("↙ better") == scenes
    assert stamp(found) in " ".join(said).replace("\n", " ")
    assert set(LOOKS) <= set(said)


def test_curves_are_told_apart_in_grey():
    looks = {(a.line.get("dashes"), a.mark["marker"]) for a in LOOKS.values()}
    assert len(looks) == len(LOOKS)
