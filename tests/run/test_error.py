"""Displacements that bodies pass on to each other, against their definitions."""

import math

import numpy as np
import pytest

from lagsim.run.error import in_groups, largest_beside


def beside(roots, found):
    """Return the largest of found_j min(1, roots_j/roots_i) for each i.

    Values that are not finite count as 0, and no inertia is exceeded by any.
    """
    known = [x if math.isfinite(x) and math.isfinite(r) else 0.0
             for x, r in zip(found, roots, strict=True)]  # fmt: skip
    return [
        max(
            x * (1.0 if r >= own else r / own)
            for x, r in zip(known, roots, strict=True)
        )
        for own in roots
    ]


@pytest.mark.parametrize("seed", range(3))
def test_bodies_pass_on_displacements_by_their_inertias(seed):
    random = np.random.default_rng(seed)
    n = 1 + 2 * seed
    roots, found = 10.0 ** random.uniform(-3, 3, n), random.exponential(size=n)
    if seed % 2:
        found[0] = math.inf
    assert largest_beside(roots, found) == pytest.approx(
        beside(roots, found), rel=1e-14
    )


@pytest.mark.parametrize("seed", range(3))
def test_bodies_of_a_group_alone_pass_on_displacements(seed):
    """The label of a group is the index of a member; a body with its own is alone."""
    random = np.random.default_rng(seed)
    n = 8
    labels = [0, 0, 2, 3, 2, 0, 3, 7]
    roots, found = 10.0 ** random.uniform(-3, 3, n), random.exponential(size=n)
    whole = in_groups(labels, roots, found)
    for label in (0, 2, 3, 7):
        own = [i for i in range(n) if labels[i] == label]
        expected = beside(roots[own], found[own])
        assert whole[own] == pytest.approx(expected, rel=1e-14)
