"""A coordinate that a holonomic constraint gives, expressed by the others.

a q_e + r(q, t) = 0 with a constant a gives q_e = Q(q, t) of the coordinates left,
q_e' = J q' + Q_t and q_e'' = J q'' + c. With B = (1, J) the full q'' is B q'' + (0, c),
and the equations left are

    B^T M B q'' = B^T (f - M (0, c)) + (A B)^T lambda,      A B q'' = b - A (0, c)

Row e of the full ones gives the multiplier: a lambda = M q'' - f - A^T lambda_rest.

Source: E. Hairer and G. Wanner, Solving Ordinary Differential Equations II, section
VII.1 (state-space form).
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

from lagsim.constraints import Flow
from lagsim.expressions.derivatives import tangent
from lagsim.expressions.evaluate import evaluate
from lagsim.expressions.functions import OPERATIONS
from lagsim.reduction._equations import (
    minus,
    of_those_left,
    plus,
    substituted,
    vector,
)

if TYPE_CHECKING:
    from lagsim.constraints import Row
    from lagsim.equations import Equations


def given_by(equations: Equations, row: Row) -> list[int]:
    """Give the coordinates in which `row` is affine with a constant factor, not 0.

    Relations with switches are left alone: where their rate jumps, all velocities do.
    """
    g = equations.graph
    if not row.holonomic or _switches(equations, row.residual):
        return []
    moving = frozenset((*equations.q, *equations.velocities, "t"))
    found = [
        c for c, factor in row.A.entries.items() if not g.depends([factor]) & moving
    ]
    values = {p.name: p.value for p in equations.model.parameters}
    factors = evaluate(g, [row.A[c] for c in found], values)
    return [
        c
        for c, factor in zip(found, factors, strict=True)
        if factor and math.isfinite(factor)
    ]


def _switches(equations: Equations, node: int) -> bool:
    g = equations.graph
    rows = (OPERATIONS.get(g.ops[n]) for n in g.cone([node]))
    return any(row is not None and (row.switch or row.condition) for row in rows)


def eliminated(e: Equations, k: int, c: int) -> tuple[Equations, dict[int, int]]:
    """Give the equations without row k and coordinate c, and what stands for them."""
    g, row = e.graph, e.rows[k]
    left = [j for j in range(len(e.q)) if j != c]
    names = [e.q[j] for j in left], [e.velocities[j] for j in left]
    flow = Flow(g, *names)
    at_zero = g.substitute([row.residual], {g.variable(e.q[c]): g.zero})[0]
    value = g.call("neg", g.call("div", at_zero, row.A[c]))
    along = flow.gradient(g, value, by_rates=False).entries
    J = {left[i]: slope for i, slope in along.items()}
    [rate] = tangent(g, [value], flow.forward)
    [bend] = tangent(g, [rate], flow.forward)
    new = {g.variable(e.q[c]): value, g.variable(e.velocities[c]): rate}
    acceleration = bend
    for j, slope in J.items():
        acceleration = plus(g, acceleration, slope, g.variable(f"{e.q[j]}_ddot"))
    full = substituted(e, new)
    recovered = new | {
        g.variable(f"{e.q[c]}_ddot"): acceleration,
        g.variable(f"lambda_{row.name}"): _multiplier(full, k, c, acceleration),
    }
    mass = full.M[c].entries
    own = mass.get(c, g.zero)
    M = {(i, j): node for (i, j), node in full.mass_entries.items() if c not in (i, j)}
    touched = sorted((mass.keys() | J.keys()) - {c})
    for i in touched:
        for j in (j for j in touched if j <= i):
            node = plus(g, M.get((i, j), g.zero), mass.get(i, g.zero), J.get(j))
            across = plus(g, mass.get(j, g.zero), own, J.get(j))
            M[i, j] = M[j, i] = plus(g, node, across, J.get(i))
    f, momenta = list(full.f), list(full.momenta)
    force = minus(g, f[c], own, bend)
    for j in touched:
        f[j] = plus(g, minus(g, f[j], mass.get(j, g.zero), bend), force, J.get(j))
        momenta[j] = plus(g, momenta[j], momenta[c], J.get(j))
    rows = []
    for other in (r for r in full.rows if r.name != row.name):
        A = dict(other.A.entries)
        factor = A.pop(c, g.zero)
        for j, slope in J.items():
            A[j] = plus(g, A.get(j, g.zero), factor, slope)
        rows.append(
            replace(
                other, A=vector(g, left, A), b=minus(g, other.b, factor, bend)
            )
        )  # fmt: skip
    power = full.power
    if power is not None:
        [power] = g.substitute([power], recovered)
    reduced = of_those_left(full, left, M, f, momenta)
    return replace(reduced, rows=tuple(rows), power=power), recovered


def _multiplier(full: Equations, k: int, c: int, acceleration: int) -> int:
    """Give the multiplier of row k from row c of M q'' = f + A^T lambda."""
    g, row = full.graph, full.rows[k]
    left = g.call("neg", full.f[c])
    for j, entry in full.M[c].entries.items():
        moved = acceleration if j == c else g.variable(f"{full.q[j]}_ddot")
        left = plus(g, left, entry, moved)
    for other in full.rows:
        if other.name != row.name and c in other.A.entries:
            left = minus(g, left, other.A[c], g.variable(f"lambda_{other.name}"))
    return g.call("div", left, row.A[c])
