"""Ignorable coordinates: their momenta are kept, and they are quadratures.

A coordinate c in which neither L nor the constraints stand, and on which no force acts,
keeps its momentum p = dL/dq_c'. Its velocity follows from that, its acceleration from
row c of M q'' = f, and what is left is solved without it:

    (M - M_c M_cc^-1 M_c^T) q'' = f - M_c M_cc^-1 f_c + A^T lambda

Source: H. Goldstein, Classical Mechanics, 2nd ed., section 8-3 (Routh's procedure).
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

from lagsim.language.sparse import Meter
from lagsim.mechanics.equations import Quadrature
from lagsim.mechanics.ldl import Factorisation
from lagsim.mechanics.reduction._equations import (
    minus,
    of_those_left,
    substituted,
    vector,
)

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from lagsim.mechanics.equations import Equations

# The momentum of a coordinate becomes a parameter, or a column, of this name.
MOMENTUM = "momentum."


def momentum_of(coordinate: str) -> str:
    """Give the name of the parameter that the momentum of a coordinate becomes."""
    return MOMENTUM + coordinate


def conserved(equations: Equations) -> list[int]:
    """Give the coordinates whose momentum is kept, as far as the graph shows it."""
    e, g = equations, equations.graph
    nodes = [*e.mass_nodes, *e.f, e.energy, *e.momenta]
    nodes += e.powers
    rows = [*e.rows, *(law.row for law in e.laws)]
    for row in rows:
        nodes += [row.residual, row.rate, row.b, *row.A.entries.values()]
    nodes += [bound for law in e.laws for bound in (law.bound, law.static)]
    seen = g.depends(nodes)
    inertias = e.inertias
    held = {c for row in rows for c in row.A.entries}
    return [
        c
        for c, name in enumerate(e.q)
        if name in e.unforced
        and name not in seen
        and c not in held
        and inertias[c] != g.zero
    ]


def ignorable(equations: Equations) -> list[int]:
    """Give the coordinates that the motion of the others can do without.

    At least one other coordinate is left. None where the action is integrated, which
    needs all velocities.
    """
    e, g = equations, equations.graph
    free = [] if e.quadratures else conserved(e)
    among = frozenset(e.velocities[c] for c in free)
    if g.depends([e.M[c][d] for c in free for d in free]) & among:
        return []
    return free if len(free) < len(e.q) else free[1:]


def ignored(
    e: Equations, coordinates: Sequence[int], limit: float
) -> tuple[Equations, dict[int, int]]:
    """Give the equations without `coordinates`, and what stands for their rates.

    Raises
    ------
    TooLongError
        Where solving for these takes more than `limit` multiplications.
    """
    g = e.graph
    left = [j for j in range(len(e.q)) if j not in coordinates]
    speeds = [g.variable(e.velocities[c]) for c in coordinates]
    at_rest = g.substitute(
        [e.momenta[c] for c in coordinates], dict.fromkeys(speeds, g.zero)
    )
    momenta = [g.variable(momentum_of(e.q[c])) for c in coordinates]
    right = enumerate(map(partial(g.call, "sub"), momenta, at_rest))
    solved = _factored(e, coordinates, limit).solve(dict(right))
    rates = [solved.get(k, g.zero) for k in range(len(coordinates))]
    new = dict(zip(speeds, rates, strict=True))
    full = substituted(e, new)
    factors = _factored(full, coordinates, limit)
    Z = {
        j: factors.forward({k: full.M[c][j] for k, c in enumerate(coordinates)})
        for j in left
        if any(j in full.M[c].entries for c in coordinates)
    }
    force = factors.forward({k: full.f[c] for k, c in enumerate(coordinates)})
    M = dict(full.mass_entries)
    f = list(full.f)
    for i, z in Z.items():
        f[i] = _less(factors, f[i], z, force)
        for j, other in Z.items():
            if j <= i:
                entry = M.get((i, j), g.zero)
                M[i, j] = M[j, i] = _less(factors, entry, z, other)
    bends = factors.solve(
        {k: _less_inertia(full, c, left) for k, c in enumerate(coordinates)}
    )
    recovered = new | {
        g.variable(f"{e.q[c]}_ddot"): bends.get(k, g.zero)
        for k, c in enumerate(coordinates)
    }
    quadratures = tuple(
        Quadrature(e.q[c], rate, full.M[c][c])
        for c, rate in zip(coordinates, rates, strict=True)
    )
    reduced = of_those_left(full, left, M, f, full.momenta)
    rows = (r._replace(A=vector(g, left, r.A.entries)) for r in full.rows)
    return replace(reduced, rows=tuple(rows), quadratures=quadratures), recovered


def _factored(e: Equations, coordinates: Sequence[int], limit: float) -> Factorisation:
    entries = {
        (i, j): e.M[c][d]
        for i, c in enumerate(coordinates)
        for j, d in enumerate(coordinates)
        if d in e.M[c].entries
    }
    return Factorisation(e.graph, len(coordinates), entries, Meter(limit))


def _less(
    factors: Factorisation, node: int, z: Mapping[int, int], other: Mapping[int, int]
) -> int:
    """Give node - z^T D^-1 other."""
    g = factors.g
    for k in sorted(z.keys() & other.keys()):
        part = g.call("mul", g.call("mul", z[k], factors.inverse[k]), other[k])
        node = g.call("sub", node, part)
    return node


def _less_inertia(e: Equations, c: int, left: Sequence[int]) -> int:
    """Give f of row c less M q'' of the coordinates left."""
    node = e.f[c]
    for j in left:
        acceleration = e.graph.variable(f"{e.q[j]}_ddot")
        node = minus(e.graph, node, e.M[c][j], acceleration)
    return node
