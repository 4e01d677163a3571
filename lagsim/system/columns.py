"""What is computed for each row of the results."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping

    from lagsim.equations import Equations


class Columns:
    """What is computed for each row: the columns of the table, then what plots need.

    Attributes
    ----------
    nodes : dict of str to int
        In the order of the table; expressions of the state, q'' and lambda, those that
        are integrated: what a reduction leaves out is `recovered`.
    table : int
        How many of them the table shows.
    """

    def __init__(self, equations: Equations, recovered: Mapping[int, int]) -> None:
        model, g = equations.model, equations.graph
        nodes = {"t": g.variable("t")}
        for group in (equations.q, equations.velocities, equations.accelerations):
            nodes.update((name, g.variable(name)) for name in group)
        defined = {d.name: d.node for d in model.definitions}
        nodes.update((name, defined[name]) for name in model.output.columns)
        if model.kinetic is not None and model.potential is not None:
            nodes |= {"kinetic": model.kinetic, "potential": model.potential}
        else:
            nodes["lagrangian"] = model.lagrangian
        nodes["energy"] = equations.energy
        if equations.power is not None:
            nodes["work"] = g.variable("work")
        nodes.update((name, g.variable(name)) for name in equations.multipliers)
        forces = equations.constraint_forces() if equations.rows else []
        names = [f"Qc_{q}" for q in equations.q]
        nodes.update(zip(names, forces, strict=False))
        nodes.update((f"residual_{row.name}", row.residual) for row in equations.rows)
        self.table = len(nodes)
        nodes.update(
            (f"scale.{row.name}", row.residual_scale) for row in equations.rows
        )
        for name, components in model.scene.points.items():
            for k, node in enumerate(components, 1):
                nodes[f"point.{name}.{k}"] = node
        for k, plot in enumerate(model.output.plots):
            nodes |= {f"plot.{k}.x": plot.x, f"plot.{k}.y": plot.y}
        new = {g.variable("energy"): equations.energy}
        new |= {
            g.variable(f"Qc_{q}"): f for q, f in zip(equations.q, forces, strict=False)
        }
        written = g.substitute(nodes.values(), new)
        self.nodes = dict(zip(nodes, g.substitute(written, recovered), strict=True))

    @property
    def names(self) -> tuple[str, ...]:
        """All names, in order."""
        return tuple(self.nodes)
