"""The mass matrix: the second derivatives of the Lagrangian by the velocities."""

from __future__ import annotations

from typing import TYPE_CHECKING

from lagsim import limits
from lagsim.errors import InputError, Problem
from lagsim.language.derivatives import rate_of
from lagsim.language.sparse import SparseVector

if TYPE_CHECKING:
    from collections.abc import Sequence

    from lagsim.language.graph import Graph


def mass_matrix(
    g: Graph, momenta: Sequence[int], rates: Sequence[int]
) -> tuple[SparseVector, ...]:
    """Give d momenta / d rates: for each rate one sweep over what depends on it.

    Raises
    ------
    InputError
        Where there are too many.
    """
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
    cone = [node for node in g.cone(momenta) if g.args[node]]
    for node in cone:
        mask = 0
        for a in g.args[node]:
            mask |= dependence.get(a, 0)
        dependence[node] = mask
    _refuse_full(sum(dependence.get(p, 0).bit_count() for p in momenta))
    for node in cone:
        mask = dependence[node]
        while mask:
            j = (mask & -mask).bit_length() - 1
            below[j].append(node)
            mask &= mask - 1
    return below


def _refuse_full(entries: int) -> None:
    if entries > limits.INERTIAS:
        text = (
            f"the mass matrix has {entries:,} entries that are not 0, and the limit is "
            f"{limits.INERTIAS:,}"
        )
        hint = "fewer velocities in one product or square of the energies couple less"
        raise InputError([Problem("too-long", text, None, hint)])
