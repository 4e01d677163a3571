"""Bounds of the rounding errors of forces, accelerations and rates, as nodes."""

from __future__ import annotations

from typing import TYPE_CHECKING

from lagsim.language.evaluate import roundings
from lagsim.mechanics.equations import pushes
from lagsim.mechanics.forces import generalized_forces
from lagsim.methods.parts.control import pseudorandom
from lagsim.plan.method_choice import coupled

if TYPE_CHECKING:
    from collections.abc import Sequence

    from lagsim.language.graph import Graph
    from lagsim.mechanics.equations import Equations
    from lagsim.mechanics.ldl import Elimination


def force_rounding_bounds(e: Equations) -> list[int]:
    """Return nodes of rounding-error bounds of the forces (n,) and of the other rates.

    The bound of each force is multiplied by a factor of its own with a pseudo-random
    sign, so that errors of several forces do not cancel in an acceleration that they
    determine.
    """
    g = e.graph
    state = e.state
    moving = (*state, "t")
    forces = [*e.f]
    sizes = [g.call("abs", f) for f in forces]
    potential = e.model.potential
    if e.tree and potential is not None and e.tree.is_rigid(g, e.q):
        # For the inertial forces of rotations the running bound is far too large (56
        # links: 2,000 times the error of q''), since each error counts in each body
        # outward.
        forces = _not_inertial(e, potential)
        sizes = [g.call("add", *pair) for pair in zip(sizes, pushes(e), strict=False)]
    known = e.known_roundings(moving, state)
    found = roundings(g, (*forces, *e.other_rates), moving, state, known)
    force_rounding = [
        g.call("add", size, error) for size, error in zip(sizes, found, strict=False)
    ]
    return [*_in_parts(g, force_rounding), *found[len(force_rounding) :]]


def _not_inertial(e: Equations, potential: int) -> list[int]:
    """Return generalized forces plus the forces of the potential, as nodes (n,).

    potential : the node of the potential energy.
    """
    g, flow = e.graph, e.flow
    found = generalized_forces(g, e.model, flow)
    slopes = flow.gradient(g, potential, by_rates=False)
    for j, slope in slopes.entries.items():
        found[j] = g.call("sub", found[j], slope)
    return found


def _inertial(e: Equations, elimination: Elimination) -> list[int]:
    """Return bounds of the rounding errors of M q'' (n,), for a varying coupled M.

    The bounds are nodes. Where M is close to singular (angles near gimbal lock) these
    errors dominate. Signs are as in `force_rounding_bounds`.

    elimination : the symbolic solution.
    """
    g, moving = e.graph, frozenset(e.moving).difference(e.velocities)
    if e.chains is not None:
        rates = [g.call("abs", x) for x in elimination.motion()[0]]
        if e.tree:
            # The factors of a tree are computed from the inertia of each body together
            # with the bodies outward from it: entries of M, in which errors are larger,
            # are never formed (measured, 56 links: q'' is as exact as f).
            pairs = zip(e.inertias, rates, strict=True)
            return _in_parts(g, [g.call("mul", *pair) for pair in pairs])
        return _in_parts(g, e.chains.sizes(g, rates, moving))
    off = [(i, *entry) for i, row in enumerate(e.M) if len(row.entries) > 1
           for entry in row.entries.items()]  # fmt: skip
    if not off:
        return [g.zero] * len(e.q)
    nodes = [node for *_, node in off]
    varying = g.dependent(nodes, moving)
    sizes: list[list[tuple[int, int]]] = [[] for _ in e.q]
    errors = roundings(g, nodes, moving, e.q, e.known_roundings(moving, e.q))
    for (i, j, node), error in zip(off, errors, strict=True):
        if node in varying:
            rate = g.call("abs", elimination.motion()[0][j])
            sizes[i].append((g.call("add", g.call("abs", node), error), rate))
    return _in_parts(g, [g.product_sum(row) for row in sizes])


def _in_parts(g: Graph, sizes: Sequence[int]) -> list[int]:
    """Return each node of `sizes` times a fixed pseudo-random factor in +-[1, 2).

    Bounds of rounding errors with these factors do not cancel in sums or differences,
    as equal bounds of equal bodies would.
    """
    parts = (
        (1.0 + pseudorandom(k, 0)) * (1.0 if pseudorandom(k, 1) < 0.5 else -1.0)
        for k in range(len(sizes))
    )
    return [
        g.call("mul", g.constant(part), x) for part, x in zip(parts, sizes, strict=True)
    ]


def rounding_bounds(e: Equations, elimination: Elimination) -> list[int]:
    """Return nodes of bounds of the rounding errors of rates, see `dense.rounding`.

    elimination : the symbolic solution of the equations.
    """
    g, n = e.graph, len(e.q)
    force_rounding = force_rounding_bounds(e)
    pairs = zip(force_rounding, _inertial(e, elimination), strict=False)
    forces = [g.call("add", *pair) for pair in pairs]
    found = [_size(g, x) for x in elimination.response(forces)]
    label = coupled(e)
    shares: dict[int, int] = {}
    for row, square in zip(e.rows, elimination.reactions(), strict=True):
        first = label[min(row.A.entries)] if row.A.entries else 0
        shares[first] = g.call("add", shares.get(first, g.zero), square)
    for i, inertia in enumerate(e.inertias):
        if label[i] in shares and inertia != g.zero:
            share = g.call("div", shares[label[i]], inertia)
            root = g.call("sqrt", g.call("max", share, g.zero))
            found[i] = g.call("add", found[i], root)
    return [*found, *force_rounding[n:]]


def _size(g: Graph, x: int) -> int:
    """Return the node of |x|, which for x = c |y| with a constant c is |c| |y|."""
    if g.ops[x] == "mul":
        c, rest = g.value(g.args[x][0]), g.args[x][1]
        if c is not None and g.ops[rest] == "abs":
            return g.call("mul", g.constant(abs(c)), rest)
    return g.call("abs", x)
