"""M, as the entries of its rows or as the chains that it comes from."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import TYPE_CHECKING, overload

from lagsim.language.derivatives import rate_of
from lagsim.language.sparse import SparseVector

if TYPE_CHECKING:
    from lagsim.language.graph import Graph
    from lagsim.mechanics.chains import Chains


def mass_matrix(
    g: Graph, momenta: Sequence[int], rates: Sequence[int]
) -> tuple[SparseVector, ...]:
    """Give d momenta / d rates: for each rate one sweep over what depends on it."""
    n = len(rates)
    rows_of: dict[int, list[int]] = {}
    for i, momentum in enumerate(momenta):
        rows_of.setdefault(momentum, []).append(i)
    M: list[dict[int, int]] = [{} for _ in range(n)]
    below = _below(g, momenta, rates)
    for j, v in enumerate(rates):
        moving = {v: g.one}
        for node in below[j]:
            moving[node] = rate_of(g, node, moving)
        for node in moving.keys() & rows_of.keys():
            for i in rows_of[node]:
                if i >= j:
                    M[i][j] = M[j][i] = moving[node]
    return tuple(SparseVector(g, n, row) for row in M)


def _below(g: Graph, momenta: Sequence[int], rates: Sequence[int]) -> list[list[int]]:
    """Give for each rate what depends on it, in order of evaluation."""
    below: list[list[int]] = [[] for _ in rates]
    dependence: dict[int, int] = {v: 1 << j for j, v in enumerate(rates)}
    for node in g.cone(momenta):
        mask = dependence.get(node, 0)
        if g.args[node]:
            for a in g.args[node]:
                mask |= dependence.get(a, 0)
            dependence[node] = mask
            while mask:
                j = (mask & -mask).bit_length() - 1
                below[j].append(node)
                mask &= mask - 1
    return below


class ChainedMass(Sequence[SparseVector]):
    """M of bodies on chains, whose entries are made where somebody reads them.

    There are n^2 of them, and of what `chains` has only some n.
    """

    def __init__(
        self, g: Graph, found: Chains, momenta: Sequence[int], rates: Sequence[int]
    ) -> None:
        self.chains = found
        self._graph, self._momenta, self._rates = g, momenta, rates

    @cached_property
    def diagonal(self) -> tuple[int, ...]:
        """M_jj (n,)."""
        from lagsim.mechanics.articulated import Composite  # of many links
        from lagsim.mechanics.ordering import Meter

        return tuple(Composite(self._graph, self.chains, Meter()).diagonal())

    @cached_property
    def rows(self) -> tuple[SparseVector, ...]:
        """The entries, row by row."""
        return mass_matrix(self._graph, self._momenta, self._rates)

    def __len__(self) -> int:
        return self.chains.size

    @overload
    def __getitem__(self, i: int) -> SparseVector: ...
    @overload
    def __getitem__(self, i: slice) -> tuple[SparseVector, ...]: ...
    def __getitem__(self, i: int | slice) -> SparseVector | tuple[SparseVector, ...]:
        return self.rows[i]
