"""Starts of large scenes: as they are judged with dense matrices, and at their size."""

import numpy as np
import pytest

from benchmarks.rod_chain import rod_chain
from lagsim.admissibility.examination import examine
from lagsim.admissibility.point import Point
from lagsim.admissibility.rank import scaled_rows, weakest_rows
from lagsim.mechanics import algebra
from lagsim.mechanics.derivation import derive
from lagsim.mechanics.reduction import equations_of_motion
from lagsim.model.reader import read
from lagsim.plan.plan import make_plan
from tests.admissibility.scenes import check
from tests.support import SHIPPED, shipped


def both(e, monkeypatch):
    """Examine with dense matrices, and as if the scene were large."""
    dense = examine(e)
    monkeypatch.setattr(Point, "LARGE", 1)
    return dense, examine(e)


@pytest.mark.parametrize("name", SHIPPED)
def test_shipped_models(name, monkeypatch):
    e = equations_of_motion(shipped(name))
    dense, sparse = both(e, monkeypatch)
    assert sparse.verdicts == dense.verdicts
    assert sparse.ranks.rank == dense.ranks.rank
    # Inverse iteration ends within 1e-6.
    assert sparse.ranks.smallest == pytest.approx(dense.ranks.smallest, rel=1e-5)
    assert sparse.ranks.dependences == dense.ranks.dependences
    assert sparse.augmented == dense.augmented
    # Both are the nearest exact state, to rounding.
    size = np.max(np.abs([*dense.state.q, *dense.state.v]))
    assert np.max(np.abs(sparse.state.q - dense.state.q)) <= 1e-13 * size
    assert np.max(np.abs(sparse.state.v - dense.state.v)) <= 1e-13 * size
    lengths = make_plan(e, sparse.start, e.model.settings()).lengths
    monkeypatch.undo()
    assert lengths == pytest.approx(
        make_plan(e, dense.start, e.model.settings()).lengths, rel=1e-12
    )


def test_values_that_are_solved_for(monkeypatch):
    text = rod_chain(4, 1.0)
    for k in (2, 3, 4):
        text = text.replace(f"  a{k}: 0\n", f"  a{k}: {{guess: {0.1 * k}}}\n")
        text = text.replace(f"  x{k}: {k - 0.5}*l", f"  x{k}: {{guess: {k - 0.5}*l}}")
        text = text.replace(f"  y{k}: 0", f"  y{k}: {{guess: {-0.01 * k}}}")
    dense, sparse = both(derive(read(text, "rods.yaml")), monkeypatch)
    assert dense.admissible
    assert sparse.admissible
    # The least change is a minimum: flat, so that it is known to half of the digits.
    assert sparse.state.q == pytest.approx(dense.state.q, abs=1e-7)
    assert max(abs(v.position.value) for v in sparse.verdicts) < 1e-15


@pytest.mark.slow
def test_many_rods():
    n = 67
    e = derive(read(rod_chain(n, 1.0), "rods.yaml"))
    start = examine(e)
    point = Point(e, start.state)
    assert point.is_large
    assert start.admissible
    assert start.degrees_of_freedom == n
    Y, _ = scaled_rows(point)
    expected = np.linalg.svd(Y, compute_uv=False)[-1]
    assert start.ranks.smallest == pytest.approx(expected, rel=1e-5)
    # The weakest combination, by its definition.
    left, smallest = weakest_rows(point, 2 * n, [0.0] * 2 * n)
    assert np.linalg.norm(left @ Y) == pytest.approx(smallest, rel=1e-5)
    assert type(smallest) is float  # it is told in run.json


AGAIN = "  again: 2*x6 - l*cos(a6) = 2*x5 + l*cos(a5)\ninitial:"


@pytest.mark.parametrize(
    ("old", "new", "augmented", "told"),
    [
        ("initial:", AGAIN, False, ["again = 2 x_joint6"]),
        ("l^2/12*a6_dot^2", "0", True, []),  # a coordinate without inertia
    ],
)
def test_what_is_not_safely_independent_is_looked_into(
    old, new, augmented, told, monkeypatch
):
    monkeypatch.setattr(Point, "LARGE", 1)
    text = rod_chain(6, 1.0).replace(old, new)
    start = examine(derive(read(text, "rods.yaml")))
    check(start, admissible=True, augmented=augmented, texts=told, ranks=(12, 12))
    assert start.degrees_of_freedom == 6


@pytest.mark.slow
def test_factors_grow_with_a_chain(monkeypatch):
    sizes = []
    factored = algebra.factored

    def counted(A, **options):
        factors = factored(A, **options)
        sizes.append(factors.nnz)
        return factors

    monkeypatch.setattr(algebra, "factored", counted)
    examine(derive(read(rod_chain(400, 1.0), "rods.yaml")))
    # Five unknowns a rod, whose matrix has 13 entries; eliminated from one end to the
    # other it fills to at most the square of what hangs on one rod.
    assert 0 < max(sizes) < 400 * 5**2 * 2
