"""The switches of a model's motion, and the functions that locate them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from lagsim.constraints import scale_of
from lagsim.expressions.derivatives import gradient, tangent
from lagsim.switches import find_switches

if TYPE_CHECKING:
    from lagsim.equations import Equations
    from lagsim.switches import Side, Switches


def model_switches(equations: Equations) -> Switches:
    """Find the switches of the equations of motion.

    Those of the state that only stand in outputs or in an energy without a slope make
    no difference to the motion.
    """
    e = equations
    dynamics = [node for row in e.M for node in row]
    dynamics += [*e.f, *([] if e.power is None else [e.power])]
    for row in e.rows:
        dynamics += [row.residual, row.rate, *row.A, row.b, row.transport]
    state = [*e.q, *e.velocities]
    moving = [*state, "work", *e.accelerations, *e.multipliers]
    return find_switches(e.graph, [*dynamics, e.energy], moving, dynamics)


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
        scales.append(scale_of(g, node, variables, slopes))
    return {"surfaces": nodes, "surface_rows": [*residuals, *speeds, *J, *b, *scales]}
