"""Inertia of bodies that turn, as textbooks write it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from lagsim.language.derivatives import gradient
from lagsim.language.sparse import SparseVector
from lagsim.language.trigonometry import fewer_terms

if TYPE_CHECKING:
    from collections.abc import Sequence

    from lagsim.language.graph import Graph
    from lagsim.mechanics.constraints import Flow
    from lagsim.model.model import Model


def in_fewer_terms(
    g: Graph,
    model: Model,
    flow: Flow,
    M: tuple[SparseVector, ...],
    f: list[int],
    convective: Sequence[int],
    Q: Sequence[int],
) -> tuple[tuple[SparseVector, ...], list[int]]:
    """Give M and f with inertia as textbooks write it, where that is shorter.

    What potentials and forces give stays as it is: differences that are small stand
    there, and nothing may be multiplied out of them.
    """
    T, V = model.kinetic, model.potential
    if T is None or V is None or flow.velocities & g.depends([V]):
        return M, f
    n = len(f)
    inertial = [
        g.call("sub", a, c)
        for a, c in zip(gradient(g, T, flow.positions), convective, strict=True)
    ]
    entries = [(i, j) for i, row in enumerate(M) for j in row.entries if i <= j]
    moving = {*(c.name for c in model.coordinates), *flow.velocities, "t"}
    before = [*(M[i][j] for i, j in entries), *inertial]
    after = fewer_terms(g, before, moving)
    if after == before:
        return M, f
    rows: list[dict[int, int]] = [{} for _ in range(n)]
    for (i, j), node in zip(entries, after, strict=False):
        rows[i][j] = rows[j][i] = node
    forces = [
        g.call("add", g.call("sub", a, b), c)
        for a, b, c in zip(
            after[len(entries) :], gradient(g, V, flow.positions), Q, strict=True
        )
    ]
    return tuple(SparseVector(g, n, row) for row in rows), forces
