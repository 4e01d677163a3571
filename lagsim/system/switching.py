"""The functions that locate the switches of a motion."""

from __future__ import annotations

from typing import TYPE_CHECKING

from lagsim.constraints import scale_of
from lagsim.expressions.derivatives import gradient, tangent

if TYPE_CHECKING:
    from lagsim.equations import Equations
    from lagsim.switches import Side, Switches


def on_velocities(equations: Equations, side: Side) -> bool:
    """Tell whether a surface depends on velocities."""
    names = equations.graph.depends([side.node])
    return bool(names & frozenset(equations.velocities))


def surface_functions(equations: Equations, switches: Switches) -> dict[str, list[int]]:
    """Give `surfaces` and `surface_rows` of `kkt.sliding`."""
    g = equations.graph
    positions = [g.variable(name) for name in equations.q]
    rates = [g.variable(name) for name in equations.velocities]
    flow = dict(zip(positions, rates, strict=True)) | {g.variable("t"): g.one}
    nodes = switches.freeze([side.node for side in switches.sides])
    residuals, speeds, J, b, scales = [], [], [], [], []
    for side, node in zip(switches.sides, nodes, strict=True):
        moving = on_velocities(equations, side)
        variables = rates if moving else positions
        slopes = gradient(g, node, variables)
        (speed,) = [node] if moving else tangent(g, [node], flow)
        residuals.append(g.zero if moving else node)
        speeds.append(speed)
        J += slopes
        b.append(g.call("neg", tangent(g, [speed], flow)[0]))
        scales.append(scale_of(g, node, variables, dict(enumerate(slopes))))
    return {"surfaces": nodes, "surface_rows": [*residuals, *speeds, *J, *b, *scales]}
