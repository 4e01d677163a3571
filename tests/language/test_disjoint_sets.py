"""Sets that grow together, against a search through the graph of merges."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from lagsim.language.disjoint_sets import DisjointSets


def test_sets_are_the_components_of_the_graph_of_merges():
    random = np.random.default_rng(7)
    for _ in range(50):
        n, m = int(random.integers(1, 30)), int(random.integers(0, 30))
        pairs = random.integers(0, n, (m, 2))
        found = DisjointSets(n)
        for i, j in pairs.tolist():
            found.merge(i, j)
        graph = coo_array((np.ones(m), pairs.T), shape=(n, n))
        count, labels = connected_components(graph, directed=False)
        sets = found.sets()
        assert len(sets) == count
        assert sorted(i for members in sets for i in members) == list(range(n))
        for members in sets:
            assert members == sorted(members)
            assert len(set(labels[members].tolist())) == 1
            assert all(found.leader(i) == members[0] for i in members)
