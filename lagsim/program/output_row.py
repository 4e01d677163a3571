"""Quantities of an output row: columns of the table, and quantities for plots."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING

from lagsim.language.columns import (
    ACTION,
    FORCE,
    FREE,
    GAUSS,
    IMPULSE,
    MULTIPLIER,
    REACTION,
    RESIDUAL,
    Column,
)
from lagsim.language.names import rate_of
from lagsim.mechanics.derivation import reactions
from lagsim.mechanics.ldl import without_rows
from lagsim.mechanics.pieces import MARK, whole
from lagsim.mechanics.reduction import with_lengths

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping

    from lagsim.mechanics.constraints import Row
    from lagsim.mechanics.equations import Equations


class Columns:
    """The quantities of an output row: columns of the table, then quantities for plots.

    Attributes
    ----------
    nodes : dict of str to int
        Name -> expression of the integrated state, q'' and lambda, in the order of the
        table. Variables removed by a reduction are replaced by their expressions.
    columns : tuple of Column
        The columns of the table, in order, before a reduction.
    sections : list of int
        The relations of sections, as expressions of the integrated state.
    wants_sections : bool
        Whether there are sections or strobes.
    """

    def __init__(self, equations: Equations, recovered: Mapping[int, int]) -> None:
        model, g = equations.model, equations.graph
        columns = list(_declared(equations))
        rows = _in_order(equations)
        sums = _sums(equations)
        columns += _multipliers(equations, rows, sums)
        forces = equations.constraint_forces() if rows else []
        names = [FORCE.of(q) for q in equations.q]
        columns += [Column(x, n) for x, n in zip(names, forces, strict=False)]
        columns += [Column(RESIDUAL.of(x), row.residual) for x, row in rows.items()]
        columns += _optional(equations)
        nodes = {column.name: column.node for column in columns}
        if len(nodes) < len(columns):
            raise ValueError("two columns have one name")  # the reader refuses these
        self.columns = tuple(columns)
        parts = (x.multiplier for x in equations.laws if MARK in x.constraint)
        nodes.update((name, g.variable(name)) for name in parts)
        nodes |= _judged(equations, rows)
        nodes.update((x.name, g.variable(x.name)) for x in equations.works)
        for name, components in model.scene.points.items():
            for k, node in enumerate(components, 1):
                nodes[f"point.{name}.{k}"] = node
        for k, plot in enumerate(model.output.plots):
            nodes |= {name: curve.node for name, curve in plot.curves(k).items()}
        new = {g.variable("energy"): equations.energy, **sums}
        new |= {g.variable(x): force for x, force in zip(names, forces, strict=False)}
        reactions = [REACTION.of(x) for x in model.output.reactions]
        new |= {g.variable(name): nodes[name] for name in reactions}
        written = g.substitute(nodes.values(), new)
        known = {
            g.variable(x.multiplier): x.slider.force for x in equations.laws if x.slider
        }
        written = g.substitute(written, {**recovered, **known})
        self.nodes = dict(zip(nodes, written, strict=True))
        relations = [x.at for x in model.output.sections if x.at is not None]
        self.wants_sections = bool(model.output.sections)
        self.sections = list(g.substitute(relations, recovered))

    @cached_property
    def names(self) -> tuple[str, ...]:
        """All names, in order."""
        return tuple(self.nodes)

    @property
    def of_table(self) -> tuple[str, ...]:
        """Names of the columns of the table."""
        return self.names[: self.table]

    @property
    def table(self) -> int:
        """Number of columns of the table."""
        return len(self.columns)


def _declared(equations: Equations) -> Iterator[Column]:
    """Yield the columns of t, the motion, definitions, energies and work."""
    model, g, units = equations.model, equations.graph, stated_units(equations)
    nodes: dict[str, int | None] = {"t": g.variable("t")}
    for group in (equations.q, equations.velocities, equations.accelerations):
        nodes.update((name, g.variable(name)) for name in group)
    nodes |= {x.name: g.variable(x.name) for x in equations.states}
    nodes |= {rate_of(x.name): x.rate for x in equations.states}
    nodes |= {p.name: g.variable(p.name) for p in model.parameters if p.mode}
    defined = {d.name: d.node for d in model.definitions}
    nodes.update((name, defined[name]) for name in model.output.columns)
    if model.kinetic is not None and model.potential is not None:
        nodes |= {"kinetic": model.kinetic, "potential": model.potential}
    else:
        nodes["lagrangian"] = model.lagrangian
    nodes["energy"] = equations.energy
    if equations.works:
        nodes["work"] = equations.work
    for name, node in nodes.items():
        if node is not None:
            yield Column(name, node, units.get(name, ""))


def stated_units(equations: Equations) -> dict[str, str]:
    """Return the units that the file states: of t, and of columns by their names.

    Rates, and accelerations without constraints, are included.
    """
    model = equations.model
    found = {"t": "s"}
    for c in model.coordinates:
        if c.unit:
            found[c.name] = c.unit
            found[rate_of(c.name)] = f"{c.unit}/s"
            found[rate_of(c.name, 2)] = found[FREE.of(c.name)] = f"{c.unit}/s^2"
    for s in model.states:
        if s.unit:
            found[s.name], found[rate_of(s.name)] = s.unit, f"{s.unit}/s"
    found |= {p.name: p.unit for p in model.parameters if p.mode and p.unit}
    found |= {d.name: d.unit for d in model.definitions if d.unit}
    return found


def _multipliers(
    equations: Equations, rows: Iterable[str], sums: Mapping[int, int]
) -> Iterator[Column]:
    """Yield the columns `lambda_NAME` of the constraints `rows`.

    sums : for a gap with several pieces, node of one multiplier -> node of their sum.
    """
    for name in rows:
        node = equations.graph.variable(MULTIPLIER.of(name))
        yield Column(MULTIPLIER.of(name), sums.get(node, node))


def _sums(equations: Equations) -> dict[int, int]:
    """Return, for each gap with several pieces, the sum over its pieces as a node.

    The keys are the nodes of the multiplier, friction force, and impulse of the first
    piece.
    """
    g = equations.graph
    parts: dict[str, list[str]] = {}
    for law in equations.laws:
        if MARK in law.constraint:
            names = [law.multiplier]
            if law.gapped:
                names.append(IMPULSE.of(law.constraint))
            for name in names:
                parts.setdefault(whole(name), []).append(name)
    return {g.variable(x): g.sum(map(g.variable, own)) for x, own in parts.items()}


def _in_order(equations: Equations) -> dict[str, Row]:
    """Return the row of each constraint by its name, in the order of the file.

    A gap with several pieces is represented by the row of its first piece, with the
    residual of the whole gap and the largest residual scale of its pieces.
    """
    g = equations.graph
    parts: dict[str, list[Row]] = {}
    for x in equations.relations:
        if not x.slips:
            parts.setdefault(whole(x.row.name), []).append(x.row)
    found = {}
    for c in equations.model.constraints:
        if own := parts.get(c.name):
            row, scale = own[0], own[0].residual_scale
            for other in own[1:]:
                scale = g.call("max", scale, other.residual_scale)
            residual = c.relation.node if len(own) > 1 else row.residual
            found[c.name] = row._replace(residual=residual, residual_scale=scale)
    return found


def _judged(equations: Equations, rows: Mapping[str, Row]) -> dict[str, int]:
    """Return the nodes that are compared with tolerances after a run, by name.

    `scale:NAME` is the residual scale of a constraint; `missed:NAME` is min(gap, 0) of
    a contact or freewheel while its condition holds, its violation. Equalities that
    hold at times, and limited ones, have neither.

    rows : the row of each constraint by its name.
    """
    g = equations.graph
    laws = {whole(x.row.name): x for x in equations.relations if not x.slips}
    nodes: dict[str, int] = {}
    for name, row in rows.items():
        law = laws[name]
        if law.one_sided:
            missed = g.call("min", row.residual, g.zero)
            if law.when is not None:
                missed = g.call("mul", law.when, missed)
            nodes[f"missed:{name}"] = missed
        if law.one_sided or law.always:
            nodes[f"scale:{name}"] = row.residual_scale
    return nodes


def _optional(equations: Equations) -> Iterator[Column]:
    """Yield the columns of impulses, friction forces and optional keys of `output`.

    These keys are `gauss` (accelerations without constraints), `action` and
    `reactions`.
    """
    e, g = equations, equations.graph
    sums = _sums(e)
    names = [
        x.multiplier if x.slips else IMPULSE.of(x.constraint)
        for x in e.relations
        if x.slips or x.gapped or (e.model.kicks and not x.bounded)
    ]
    for name in dict.fromkeys(map(whole, names)):
        node = g.variable(name)
        yield Column(name, sums.get(node, node))
    if e.model.output.gauss:
        alone = without_rows(with_lengths(e))
        free = alone.motion()[0]
        units = stated_units(e)
        for q, a in zip(e.q, free, strict=True):
            yield Column(FREE.of(q), a, units.get(FREE.of(q), ""))
        # G = (q'' - a)^T M (q'' - a)/2, whose minimum is the constrained q'', with M
        # (q'' - a) = Qc: no cancellation, and no forces that contain switches.
        forces = e.constraint_forces()
        square = g.product_sum(zip(forces, alone.response(forces), strict=True))
        yield Column(GAUSS.of(), g.call("mul", g.constant(0.5), square))
    if e.model.output.action:
        yield Column(ACTION.of(), g.variable(ACTION.of()))
    if e.model.output.reactions:
        for name, node in reactions(e).items():
            yield Column(REACTION.of(name), node)
