"""What is computed for each row of the results."""

from __future__ import annotations

from typing import TYPE_CHECKING

from lagsim.mechanics.constraints import Kind
from lagsim.mechanics.equations import ACTION
from lagsim.mechanics.ldl import without_rows

if TYPE_CHECKING:
    from collections.abc import Mapping

    from lagsim.mechanics.constraints import Row
    from lagsim.mechanics.equations import Equations


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
        if equations.works:
            nodes["work"] = equations.work
        rows = _in_order(equations)
        nodes.update((f"lambda_{name}", g.variable(f"lambda_{name}")) for name in rows)
        forces = equations.constraint_forces() if rows else []
        names = [f"Qc_{q}" for q in equations.q]
        nodes.update(zip(names, forces, strict=False))
        nodes.update((f"residual_{name}", row.residual) for name, row in rows.items())
        nodes |= _optional(equations)
        self.table = len(nodes)
        nodes |= _judged(equations, rows)
        nodes.update((x.name, g.variable(x.name)) for x in equations.works)
        for name, components in model.scene.points.items():
            for k, node in enumerate(components, 1):
                nodes[f"point.{name}.{k}"] = node
        for k, plot in enumerate(model.output.plots):
            nodes |= {name: curve.node for name, curve in plot.curves(k).items()}
        new = {g.variable("energy"): equations.energy}
        new |= {
            g.variable(f"Qc_{q}"): f for q, f in zip(equations.q, forces, strict=False)
        }
        reactions = [f"reaction.{x}" for x in model.output.reactions]
        new |= {g.variable(name): nodes[name] for name in reactions}
        written = g.substitute(nodes.values(), new)
        self.nodes = dict(zip(nodes, g.substitute(written, recovered), strict=True))

    @property
    def names(self) -> tuple[str, ...]:
        """All names, in order."""
        return tuple(self.nodes)

    @property
    def of_table(self) -> tuple[str, ...]:
        """The names of those that the table shows."""
        return self.names[: self.table]


def _in_order(equations: Equations) -> dict[str, Row]:
    """Give the rows of the constraints by name, in the order of the file."""
    rows = {row.name: row for row in equations.rows}
    rows |= {x.row.name: x.row for x in equations.laws if x.kind is not Kind.SLIP}
    names = [c.name for c in equations.model.constraints]
    return {name: rows[name] for name in names if name in rows}


def _judged(equations: Equations, rows: Mapping[str, Row]) -> dict[str, int]:
    """Give the scale of what each constraint must not miss, and that of one side."""
    g = equations.graph
    free = {x.constraint: x for x in equations.laws if x.kind is not Kind.SLIP}
    nodes: dict[str, int] = {}
    for name, row in rows.items():
        law = free.get(name)
        if law is not None:
            if law.kind in (Kind.LIMITED, Kind.TIMED):
                continue
            missed = g.call("min", row.residual, g.zero)
            if law.when is not None:
                missed = g.call("mul", law.when, missed)
            nodes[f"missed.{name}"] = missed
        nodes[f"scale.{name}"] = row.residual_scale
    return nodes


def _optional(equations: Equations) -> dict[str, int]:
    """Give the columns of contacts, and what keys of `output` ask for."""
    e, g = equations, equations.graph
    nodes: dict[str, int] = {}
    for law in e.laws:
        if law.kind is Kind.CONTACT:
            name = f"impulse.{law.constraint}"
            nodes[name] = g.variable(name)
        elif law.kind is Kind.SLIP:
            nodes[law.multiplier] = g.variable(law.multiplier)
    if e.model.output.gauss:
        alone = without_rows(e)
        free = alone.motion()[0]
        nodes.update((f"gauss.a_{q}", a) for q, a in zip(e.q, free, strict=True))
        # G = (q'' - a)^T M (q'' - a)/2, which the constrained q'' makes least, with
        # M (q'' - a) = Qc: no difference, and none of what switches hold.
        held = e.constraint_forces()
        square = g.product_sum(zip(held, alone.response(held), strict=True))
        nodes["gauss.G"] = g.call("mul", g.constant(0.5), square)
    if e.model.output.action:
        nodes[ACTION] = g.variable(ACTION)
    if e.model.output.reactions:
        from lagsim.mechanics.equations import reactions

        nodes.update((f"reaction.{name}", node) for name, node in reactions(e).items())
    return nodes
