"""Equations with variables replaced, and those of some of the coordinates."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from lagsim.language.sparse import SparseVector

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from lagsim.language.graph import Graph
    from lagsim.mechanics.equations import Equations
    from lagsim.model.model import Model


def substituted(e: Equations, new: Mapping[int, int]) -> Equations:
    """Give the same equations with variables replaced in every expression."""
    g = e.graph
    nodes = [*e.mass_entries.values(), *e.f, *e.momenta, e.energy, e.kinetic_form]
    nodes += [node for x in e.works for node in (x.rate, x.energy)]
    nodes += [node for x in e.quadratures for node in (x.rate, x.mass)]
    for row in e.rows:
        nodes += [*row.A.entries.values(), row.residual, row.rate, row.b]
        nodes += [row.transport, row.residual_scale, row.rate_scale]
    found = dict(zip(nodes, g.substitute(nodes, new), strict=True))

    def replaced(x: SparseVector) -> SparseVector:
        return SparseVector(g, len(x), {j: found[a] for j, a in x.entries.items()})

    return replace(
        e,
        model=_dynamics(g, e.model, new),
        M=tuple(map(replaced, e.M)),
        f=tuple(found[x] for x in e.f),
        rows=tuple(
            row._replace(
                A=replaced(row.A),
                residual=found[row.residual],
                rate=found[row.rate],
                b=found[row.b],
                transport=found[row.transport],
                residual_scale=found[row.residual_scale],
                rate_scale=found[row.rate_scale],
            )
            for row in e.rows
        ),
        momenta=tuple(found[x] for x in e.momenta),
        energy=found[e.energy],
        kinetic_form=found[e.kinetic_form],
        works=tuple(
            x._replace(rate=found[x.rate], energy=found[x.energy]) for x in e.works
        ),
        quadratures=tuple(
            x._replace(rate=found[x.rate], mass=found[x.mass]) for x in e.quadratures
        ),
    )


def _dynamics(g: Graph, model: Model, new: Mapping[int, int]) -> Model:
    """Replace variables in `until`, and in what methods that discretise L take."""
    forces, until = model.forces, model.until
    loss = [] if model.dissipation is None else [model.dissipation]
    nodes = [model.lagrangian, *loss]
    nodes += [node for force in forces for node in (force.node, force.direction)]
    nodes += [until.node] if until else []
    found = dict(zip(nodes, g.substitute(nodes, new), strict=True))
    return replace(
        model,
        lagrangian=found[model.lagrangian],
        dissipation=found[loss[0]] if loss else None,
        forces=tuple(
            x._replace(node=found[x.node], direction=found[x.direction]) for x in forces
        ),
        until=until._replace(node=found[until.node]) if until else None,
    )


def of_those_left(
    e: Equations,
    left: Sequence[int],
    M: Mapping[tuple[int, int], int],
    f: Sequence[int],
    momenta: Sequence[int],
) -> Equations:
    """Give the equations of the coordinates left."""
    rows: dict[int, dict[int, int]] = {i: {} for i in left}
    for (i, j), node in M.items():
        if i in rows:
            rows[i][j] = node
    return replace(
        e,
        q=tuple(e.q[j] for j in left),
        velocities=tuple(e.velocities[j] for j in left),
        M=tuple(vector(e.graph, left, rows[i]) for i in left),
        f=tuple(f[j] for j in left),
        momenta=tuple(momenta[j] for j in left),
    )


def vector(g: Graph, left: Sequence[int], entries: Mapping[int, int]) -> SparseVector:
    """Give a vector over the coordinates left; `entries` has their old numbers."""
    place = {j: i for i, j in enumerate(left)}
    kept = {place[j]: node for j, node in entries.items() if j in place}
    return SparseVector(g, len(left), kept)


def plus(g: Graph, node: int, x: int, y: int) -> int:
    """Give node + x y."""
    return g.call("add", node, g.call("mul", x, y))


def minus(g: Graph, node: int, x: int, y: int) -> int:
    """Give node - x y."""
    return g.call("sub", node, g.call("mul", x, y))
