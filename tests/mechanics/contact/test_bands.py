"""Large problems of rows in a chain: each is solved by the band of its matrix."""

import numpy as np
import pytest

from lagsim.mechanics.complementarity import (
    ComplementarityProblem,
    is_regular,
    solve,
    solved_regular,
)

COUNT = 60
# A residual is the sum of a few rounded terms; the band has two refined solutions.
ROUNDED = 1e-12


def chain(masses):
    """Return D of the contacts of a stack on a floor."""
    rows = np.eye(len(masses)) - np.eye(len(masses), k=-1)
    return rows @ np.diag(1.0 / np.asarray(masses)) @ rows.T


def problem(D, c, low=0.0, high=np.inf):
    low, high = (np.vstack([x + 0.0 * c, 0.0 * c]) for x in (low, high))
    alone = np.full(len(c), -1)
    return ComplementarityProblem(D, c, low, high, alone, alone)


def test_each_body_of_a_stack_bears_those_above_it():
    masses = 1.0 + np.arange(COUNT) % 3
    asked = np.zeros(COUNT)
    asked[0] = -9.81  # all fall alike, so that the first contact alone would close
    p, w, found = solve(problem(chain(masses), asked))
    assert found
    assert not w.any()
    assert p == pytest.approx(9.81 * np.cumsum(masses[::-1])[::-1], rel=ROUNDED)


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("high", [np.inf, 0.2])
def test_rows_obey_their_bounds(seed, high):
    random = np.random.default_rng(seed)
    D = chain(10.0 ** random.uniform(-1, 1, COUNT))
    c = random.standard_normal(COUNT)
    c[random.random(COUNT) < 0.3] = 0.0  # tied rows
    low = 0.0 if high == np.inf else -high
    p, w, found = solve(problem(D, c, low, high))
    assert found
    terms = ROUNDED * (np.abs(D) @ np.abs(p) + np.abs(c)).max()
    assert np.abs(D @ p + c - w).max() <= terms
    assert p.min() >= low
    assert p.max() <= high
    assert w[p == low].min(initial=0.0) >= -terms
    assert w[p == high].max(initial=0.0) <= terms
    inside = (low < p) & (p < high)
    assert inside.any()
    assert np.abs(w[inside]).max() <= terms


@pytest.mark.parametrize(
    ("heavy", "regular"), [(1.0, True), (1e20, False)], ids=["stack", "wedged"]
)
def test_rows_between_immovable_bodies_are_dependent_in_any_order(heavy, regular):
    masses = np.ones(COUNT)
    masses[COUNT // 2] = heavy
    D = chain(masses)
    shuffled = np.random.default_rng(1).permutation(COUNT)
    for order in (np.arange(COUNT), shuffled):  # with a narrow band, and without one
        mixed = D[np.ix_(order, order)]
        assert is_regular(mixed) == regular
        found = solved_regular(mixed, mixed @ np.ones(COUNT))
        assert (found is None) == (not regular)
        if regular:
            assert found == pytest.approx(np.ones(COUNT), rel=ROUNDED)
