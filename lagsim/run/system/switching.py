"""The functions that locate the switches of a motion."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from lagsim.language.derivatives import gradient, tangent
from lagsim.mechanics.constraints import scale_of

if TYPE_CHECKING:
    from lagsim.mechanics.equations import Equations
    from lagsim.mechanics.surfaces import Side
    from lagsim.mechanics.switches import Switches


def on_velocities(equations: Equations, side: Side) -> bool:
    """Tell whether a surface depends on velocities."""
    names = equations.graph.depends([side.node])
    return bool(names & frozenset(equations.velocities))


class SurfaceFunctions(NamedTuple):
    """What is compiled of the surfaces, see `solve.sliding`.

    Attributes
    ----------
    starts, columns
        Where in the elements of J each row begins, and the column of each element.
    """

    functions: dict[str, list[int]]
    starts: tuple[int, ...]
    columns: tuple[int, ...]


def surface_functions(equations: Equations, switches: Switches) -> SurfaceFunctions:
    """Give `surfaces` and `surface_rows`."""
    g = equations.graph
    positions = [g.variable(name) for name in equations.q]
    rates = [g.variable(name) for name in equations.velocities]
    flow = dict(zip(positions, rates, strict=True)) | {g.variable("t"): g.one}
    nodes = switches.freeze([side.node for side in switches.sides])
    residuals, speeds, b, scales = [], [], [], []
    elements, starts, columns = [], [0], []
    for side, node in zip(switches.sides, nodes, strict=True):
        moving = on_velocities(equations, side)
        variables = rates if moving else positions
        slopes = gradient(g, node, variables)
        (speed,) = [node] if moving else tangent(g, [node], flow)
        residuals.append(g.zero if moving else node)
        speeds.append(speed)
        b.append(g.call("neg", tangent(g, [speed], flow)[0]))
        scales.append(scale_of(g, node, variables, dict(enumerate(slopes))))
        places = [j for j, slope in enumerate(slopes) if slope != g.zero]
        elements += [slopes[j] for j in places]
        columns += places
        starts.append(len(columns))
    rows = [*residuals, *speeds, *b, *scales, *elements]
    some = nodes or equations.laws
    made = {"surfaces": nodes, "surface_rows": rows} if some else {}
    return SurfaceFunctions(made, tuple(starts), tuple(columns))
