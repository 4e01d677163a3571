"""The functions compiled from the graph: name -> the nodes written to out.

A method declares in NEEDS which functions it uses besides y', and a row of NEEDED
constructs each one: only functions in use are differentiated and compiled. `Columns`
are the quantities of an output row.
"""

from __future__ import annotations

from itertools import accumulate, chain
from typing import TYPE_CHECKING, NamedTuple

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
from lagsim.language.derivatives import gradient, tangent
from lagsim.language.evaluate import roundings
from lagsim.language.names import rate_of
from lagsim.mechanics.constraints import Kind, scale_of
from lagsim.mechanics.equations import (
    generalized_forces,
    may_strike,
    pushes,
    reactions,
)
from lagsim.mechanics.ldl import without_rows
from lagsim.mechanics.motion_series import motion_rates
from lagsim.mechanics.pieces import MARK, whole
from lagsim.mechanics.reduction import with_lengths
from lagsim.methods.parts.control import scattered
from lagsim.methods.parts.parameters import ALWAYS
from lagsim.plan.formulation import GAIN
from lagsim.plan.plan import coupled
from lagsim.tolerances import SUM_ROUNDOFF, UNIT_ROUNDOFF

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence

    from lagsim.language.graph import Graph
    from lagsim.mechanics.constraints import Row
    from lagsim.mechanics.equations import Equations
    from lagsim.mechanics.ldl import Elimination
    from lagsim.mechanics.switches import Switches
    from lagsim.methods.moreau import Impulses
    from lagsim.methods.parts.parameters import Parameters
    from lagsim.plan.plan import Plan


class Columns:
    """The quantities of an output row: columns of the table, then quantities for plots.

    Attributes
    ----------
    nodes : dict of str to int
        Name -> expression of the integrated state, q'' and lambda, in the order of the
        table. Variables removed by a reduction are replaced by the nodes `recovered`.
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

    @property
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

    The keys are the nodes of the first piece's multiplier, friction force, and impulse.
    """
    g = equations.graph
    parts: dict[str, list[str]] = {}
    for law in equations.laws:
        if MARK in law.constraint:
            names = [law.multiplier]
            if law.kind is Kind.CONTACT:
                names.append(IMPULSE.of(law.constraint))
            for name in names:
                parts.setdefault(whole(name), []).append(name)
    return {g.variable(x): g.sum(map(g.variable, own)) for x, own in parts.items()}


def _in_order(equations: Equations) -> dict[str, Row]:
    """Return the row of each constraint by its name, in the order of the file.

    A gap with several pieces is represented by the row of its first piece, with the
    residual of the whole gap and the largest residual scale of its pieces.
    """
    g, rows = equations.graph, {row.name: row for row in equations.rows}
    parts: dict[str, list[Row]] = {}
    for law in equations.laws:
        if law.kind is not Kind.SLIP:
            parts.setdefault(whole(law.row.name), []).append(law.row)
    found = {}
    for c in equations.model.constraints:
        own = parts.get(c.name, [])
        row = own[0] if own else rows.get(c.name)
        if row is not None:
            scale = row.residual_scale
            for other in own[1:]:
                scale = g.call("max", scale, other.residual_scale)
            residual = c.relation.node if len(own) > 1 else row.residual
            found[c.name] = row._replace(residual=residual, residual_scale=scale)
    return found


def _judged(equations: Equations, rows: Mapping[str, Row]) -> dict[str, int]:
    """Return the nodes that are compared with tolerances after a run, by name.

    `scale:NAME` is the residual scale of a constraint; `missed:NAME` is min(gap, 0) of
    a contact or freewheel while its condition holds, its violation. Laws that are not
    one-sided have neither.
    """
    g = equations.graph
    free = {whole(x.row.name): x for x in equations.laws if x.kind is not Kind.SLIP}
    nodes: dict[str, int] = {}
    for name, row in rows.items():
        law = free.get(name)
        if law is not None:
            if not law.kind.one_sided:
                continue
            missed = g.call("min", row.residual, g.zero)
            if law.when is not None:
                missed = g.call("mul", law.when, missed)
            nodes[f"missed:{name}"] = missed
        nodes[f"scale:{name}"] = row.residual_scale
    return nodes


def _optional(equations: Equations) -> Iterator[Column]:
    """Yield the columns of impulses, friction forces and optional keys of `output`.

    These keys are `gauss` (accelerations without constraints), `action` and
    `reactions`.
    """
    e, g = equations, equations.graph
    sums = _sums(e)
    kinds = [Kind.CONTACT, Kind.SLIP]
    names = []
    if e.model.kicks:
        kinds += [Kind.FREEWHEEL, Kind.TIMED]
        names = [IMPULSE.of(row.name) for row in e.rows]
    laws = [law for law in e.laws if law.kind in kinds]
    names += [
        x.multiplier if x.kind is Kind.SLIP else IMPULSE.of(x.constraint) for x in laws
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
        # G = (q'' - a)^T M (q'' - a)/2, which the constrained q'' makes least, with
        # M (q'' - a) = Qc: no cancellation, and no forces that hold switches.
        held = e.constraint_forces()
        square = g.product_sum(zip(held, alone.response(held), strict=True))
        yield Column(GAUSS.of(), g.call("mul", g.constant(0.5), square))
    if e.model.output.action:
        yield Column(ACTION.of(), g.variable(ACTION.of()))
    if e.model.output.reactions:
        for name, node in reactions(e).items():
            yield Column(REACTION.of(name), node)


def _held(g: Graph, rows: Iterable[Row]) -> list[int]:
    """Return the residual node of each row, the zero node for velocity constraints."""
    return [row.residual if row.holonomic else g.zero for row in rows]


def _conditions(e: Equations) -> list[int]:
    """Return, for each law, the node of its condition `when`, or of 1 without one."""
    return [e.graph.one if law.when is None else law.when for law in e.laws]


def loop_functions(e: Equations, columns: Columns) -> dict[str, list[int]]:
    """Return the nodes of the functions that kernels of `dense` call, by name."""
    g, rows = e.graph, e.every_row
    found = {
        "dynamics": _dynamics(e),
        "other_rates": e.other_rates,
        "columns": list(columns.nodes.values()),
        "force_rounding": _force_rounding(e),
    }
    if rows:
        found["geometry"] = [
            *(node for row in e.M for node in row),
            *(node for row in rows for node in row.A),
            *_held(g, rows),
            *(row.rate for row in rows),
            *(row.residual_scale for row in rows),
            *(row.rate_scale for row in rows),
        ]  # fmt: skip
        found["second_order"] = _second_orders(e, rows)
        found["second_order"] += _unknown(g, rows)
    if e.laws:
        found["gaps"] = [
            law.slider.left
            if law.slider
            else law.row.residual
            if law.kind is Kind.CONTACT
            else law.row.rate
            for law in e.laws
        ]
        if sliders := [law.slider.force for law in e.laws if law.slider]:
            found["sliders"] = sliders
        found["conditions"] = _conditions(e)
        if any(law.bounce is not None for law in e.laws):
            found["restitutions"] = [
                g.constant(law.restitution) if law.bounce is None else law.bounce
                for law in e.laws
            ]
    return found


def _dynamics(e: Equations) -> list[int]:
    """Return the nodes of all terms of the equations of motion, concatenated.

    In order: M, A, f, b; then of the laws their rates, bounds while sliding, and bounds
    while sticking.
    """
    rows = e.every_row
    return [
        *(node for row in e.M for node in row),
        *(node for row in rows for node in row.A),
        *e.f, *(row.b for row in rows),
        *(law.row.rate for law in e.laws),
        *(law.bound for law in e.laws),
        *(law.static for law in e.laws),
    ]  # fmt: skip


def _unknown(g: Graph, rows: Iterable[Row]) -> list[int]:
    """Mark the rows whose rate residual after a Newton step has no a-priori bound.

    Return the node of 1 for nonlinear velocity constraints, of 0 for all other rows.
    """
    return [g.zero if row.holonomic or row.pfaffian else g.one for row in rows]


def _second_orders(e: Equations, rows: Iterable[Row]) -> list[int]:
    """Return, for each row, the node of its scaled residual after a Newton step.

    The residual is expanded to second order, with the step in place of the velocities.
    The first-order term cancels the residual where the rows are independent. Velocity
    constraints have 0.
    """
    g: Graph = e.graph
    step = dict(zip(map(g.variable, e.q), map(g.variable, e.velocities), strict=True))
    found = []
    for row in rows:
        if not row.holonomic:
            found.append(g.zero)
            continue
        (first,) = tangent(g, [row.residual], step)
        (second,) = tangent(g, [first], step)
        half = g.call("mul", g.constant(0.5), second)
        whole = g.call("add", g.call("add", row.residual, first), half)
        found.append(_against(g, whole, row.residual_scale))
    return found


def _against(g: Graph, value: int, scale: int) -> int:
    """Return the node of |value| / scale, which is 0 where the scale is 0."""
    part = g.call("div", g.call("abs", value), scale)
    return g.call("if", g.call("gt", scale, g.zero), part, g.zero)


class Pattern(NamedTuple):
    """Sparsity pattern of M and of the rows.

    Attributes
    ----------
    first : list of int, length n
        First column of each row of M.
    starts, columns : list of int
        Of the elements of the rows: index of the first element of each row, and column
        of each element.
    """

    first: list[int]
    starts: list[int]
    columns: list[int]

    @property
    def inertial(self) -> int:
        """Number of elements of M in its envelope."""
        return sum(i - j + 1 for i, j in enumerate(self.first))


class RowPattern(NamedTuple):
    """Sparsity of A L^-T, of the rows of equalities and laws, with M = L L^T.

    Attributes
    ----------
    first : list of int, length n
        First column of each row of L.
    ranges : list of list of (int, int), length m
        The reach of each row: columns of the row of A L^-T, with those of the friction
        that a multiplier of the row causes, as ranges (first, last + 1).
    near : list of list of int, length m
        Rows, ascending, whose reaches overlap with that of each row. Empty where there
        are no laws.
    """

    first: list[int]
    ranges: list[list[tuple[int, int]]]
    near: list[list[int]]

    @property
    def sizes(self) -> dict[str, int]:
        """Sizes of the memory that `fill` fills."""
        return {
            "reached": sum(map(len, self.ranges)),
            "neighbours": sum(map(len, self.near)),
        }

    def fill(self, p: Parameters) -> None:
        """Store the sparsity in the parameters of the kernels."""
        p.inertia_first[:] = self.first
        ranges = list(chain(*self.ranges))
        p.reach_starts[:] = list(accumulate(map(len, self.ranges), initial=0))
        p.reach_begins[:] = [begin for begin, _ in ranges]
        p.reach_ends[:] = [end for _, end in ranges]
        if p.laws:
            p.near_starts[:] = list(accumulate(map(len, self.near), initial=0))
            p.near_rows[:] = list(chain(*self.near))


def row_pattern(e: Equations, *, augmented: bool) -> RowPattern:
    """Return the sparsity of the rows in the metric of M.

    augmented : M is replaced by M + A^T W A, with the rows of the equalities.
    """
    first = [min([i, *row.entries]) for i, row in enumerate(e.M)]
    if augmented:
        for row in e.rows:
            for j in row.A.entries:
                first[j] = min(first[j], *row.A.entries)
    count = len(e.rows)
    columns = [set(row.A.entries) for row in e.every_row]
    for k, law in enumerate(e.laws):
        if law.slider:
            columns[count + k].add(law.slider.coordinate)
        if law.normal >= 0:
            columns[count + law.normal] |= columns[count + k]
    reach = [_reach(own, first) for own in columns]
    near = _overlapping(reach, len(first)) if e.laws else [[] for _ in reach]
    return RowPattern(first, [_ranges(own) for own in reach], near)


def _ranges(numbers: list[int]) -> list[tuple[int, int]]:
    """Return ascending numbers as ranges (first, last + 1)."""
    found: list[tuple[int, int]] = []
    for j in numbers:
        if found and found[-1][1] == j:
            found[-1] = found[-1][0], j + 1
        else:
            found.append((j, j + 1))
    return found


def _overlapping(reach: list[list[int]], n: int) -> list[list[int]]:
    """Return for each row the rows, ascending, that share a column of n with it."""
    holders: list[list[int]] = [[] for _ in range(n)]
    for k, own in enumerate(reach):
        for j in own:
            holders[j].append(k)
    near: list[set[int]] = [set() for _ in reach]
    for some in holders:
        for k in some:
            near[k].update(some)
    return [sorted(x) for x in near]


def _reach(columns: set[int], first: list[int]) -> list[int]:
    """Return the rows, ascending, of L^-1 x that are not 0 for x with some elements."""
    found: list[int] = []
    last = -1
    for i in range(min(columns, default=len(first)), len(first)):
        if i in columns or first[i] <= last:
            found.append(i)
            last = i
    return found


def pattern(e: Equations) -> Pattern:
    """Return the sparsity pattern of M and of the rows."""
    starts, columns = [0], []
    for A in e.slopes:
        columns += list(A.entries)
        starts.append(len(columns))
    first = [min([i, *row.entries]) for i, row in enumerate(e.M)]
    return Pattern(first, starts, columns)


def fill(p: Impulses, e: Equations, found: Pattern) -> None:
    """Store in p the sparsity pattern, and each row's kind, contact and restitution."""
    count, laws = len(e.rows), e.laws
    p.inertia_first[:] = found.first
    p.slope_starts[:], p.slope_columns[:] = found.starts, found.columns
    p.row_kind[:] = [ALWAYS] * count + [law.kind.code for law in laws]
    # Equalities come first.
    for name in ("normal", "pair"):
        numbers = (getattr(law, name) for law in laws)
        shifted = [k + count if k >= 0 else -1 for k in numbers]
        getattr(p, f"row_{name}")[:] = [-1] * count + shifted
    p.row_restitution[:] = [0.0] * count + [law.restitution for law in laws]


def stepping_functions(
    e: Equations, columns: Columns, found: Pattern
) -> dict[str, list[int]]:
    """Return the functions `balance`, `effort` and `columns` of the method `moreau`.

    `balance` has the nonzero elements of M and A, then f and the data of the rows;
    `effort` has the powers without constraint forces; in `columns` impulses are 0.

    found : the sparsity pattern of M and of the rows.
    """
    g, rows = e.graph, e.every_row
    always = [g.zero] * len(e.rows)
    lam = {g.variable(name): g.zero for name in e.multipliers}
    at_impacts = {
        g.variable(IMPULSE.of(law.constraint)): g.zero
        for law in e.laws
        if law.kind in (Kind.CONTACT, Kind.FREEWHEEL, Kind.TIMED)
    }
    return {
        "balance": [
            *(e.M[i][j] for i, k in enumerate(found.first) for j in range(k, i + 1)),
            *(slope for row in rows for slope in row.A.entries.values()),
            *e.f,
            *_held(g, rows),
            *(_offset(e, row) for row in rows),
            *always, *(law.bound for law in e.laws),
            *always, *(law.static for law in e.laws),
            *(g.one for _ in e.rows),
            *_conditions(e),
        ],
        "effort": g.substitute(e.powers, lam),
        "columns": g.substitute(columns.nodes.values(), at_impacts),
    }  # fmt: skip


def _offset(e: Equations, row: Row) -> int:
    """Return the node of rate - A q', the part of a row's rate independent of q'."""
    g = e.graph
    if row.holonomic:
        return g.call("neg", row.transport)
    if row.pfaffian and row.transport == g.zero:
        return g.zero
    rates = [g.variable(name) for name in e.velocities]
    moved = g.product_sum((slope, rates[j]) for j, slope in row.A.entries.items())
    return g.call("sub", row.rate, moved)


def on_rates(equations: Equations, switches: Switches) -> list[bool]:
    """Return, for each surface, whether its expression contains rates that jump.

    These are velocities, and first-order states whose rates are discontinuous. Such a
    surface is reached with a jump in its own rate. Sides of other surfaces are
    constants.
    """
    e, depends = equations, equations.graph.depends
    modes = {side.variable for side in switches.sides}
    rates = zip(e.states, switches.freeze([x.rate for x in e.states]), strict=True)
    stepping = {x.name for x, rate in rates if depends([rate]) & modes}
    names = frozenset(e.velocities) | stepping
    nodes = switches.freeze([side.node for side in switches.sides])
    return [bool(depends([node]) & names) for node in nodes]


def surface_functions(
    equations: Equations, switches: Switches
) -> tuple[dict[str, list[int]], list[int], list[int]]:
    """Return `surfaces` and `surface_rows`, see `sliding`, and the pattern of J.

    The pattern: index of the first element of each row, and column of each element.
    """
    g = equations.graph
    flow = equations.flow
    states = [*flow.states]
    positions, driven = [*flow.positions, *states], [*flow.rates, *states]
    still = {x: rate for x, rate in flow.forward.items() if x not in flow.states}
    nodes = switches.freeze([side.node for side in switches.sides])
    moving_sides = on_rates(equations, switches)
    residuals, speeds, b, scales = [], [], [], []
    elements: list[int] = []
    columns: list[int] = []
    starts = [0]
    for moving, node in zip(moving_sides, nodes, strict=True):
        variables = driven if moving else positions
        slopes = dict(enumerate(gradient(g, node, variables)))
        (speed,) = [node] if moving else tangent(g, [node], flow.forward)
        residuals.append(g.zero if moving else node)
        speeds.append(speed)
        b.append(g.call("neg", tangent(g, [speed], still)[0]))
        scales.append(scale_of(g, node, variables, slopes))
        if not moving and not flow.states.keys().isdisjoint(g.cone([speed])):
            slopes = dict(enumerate(gradient(g, speed, driven)))
        there = {j: slope for j, slope in slopes.items() if slope != g.zero}
        elements += there.values()
        columns += there
        starts.append(len(columns))
    made: dict[str, list[int]] = {}
    if nodes or equations.laws:
        rows = [*residuals, *speeds, *b, *scales, *elements]
        made = {"surfaces": nodes, "surface_rows": rows}
        made["corner_levers"] = _levers(equations, switches)
    return made, starts, columns


def _levers(equations: Equations, switches: Switches) -> list[int]:
    """Return the nodes of the levers of all surfaces (surfaces, 1 + m), flat.

    The levers give the jump of a corner's row across its surface, see `corners`;
    without corners the list is empty.
    """
    if not switches.corners:
        return []
    none = (equations.graph.zero,) * (1 + len(equations.multipliers))
    found = [switches.corners.get(k) for k in range(len(switches.sides))]
    return [x for c in found for x in (c.levers if c else none)]


# Greatest number of nodes of pivots of M that are compiled: the 845 of a chain of ten
# links increased the time to compile by a third.
SHORT_PIVOTS = 300


def functions(
    equations: Equations,
    plan: Plan,
    columns: Columns,
    needs: Sequence[str] = (),
    moreau: Pattern | None = None,
    *,
    switching: bool = False,
) -> dict[str, list[int]]:
    """Return all functions of a system: name -> the nodes written to out.

    Parameters
    ----------
    needs : sequence of str
        The functions that the method uses in addition to y', see NEEDED.
    moreau : Pattern or None
        Pattern of M and the rows for the method `moreau`; None for others.
    switching : bool
        Whether the kernels of `sliding` compute y' and rows from `field`.
    """
    g = equations.graph
    rest = g.call("sub", equations.energy, equations.kinetic_form)
    found = {
        "energies_masses": [equations.kinetic_form, rest, *equations.inertias, g.zero],
        "terms": pushes(equations),
        "inertias": list(varying_inertias(equations, plan).values()),
    }
    if located := equations.model.located:
        found["located"] = [x.node for x in located]
        nodes = [x.node for x in located]
        found["located_slopes"] = _slopes(equations, nodes, equations.moving)
    if events := equations.model.events:
        found["sets"] = [node for event in events for _, node in event.sets]
    if moreau is not None:
        found |= stepping_functions(equations, columns, moreau)
    elif equations.laws or plan.elimination is None:
        found |= loop_functions(equations, columns)
    else:
        found |= _solved(equations, plan, columns, switching=switching)
    # Used at impacts where works balance other energies than that of the model.
    laws, works = bool(equations.laws), equations.works
    strikes = laws or any(may_strike(equations, x) for x in equations.rows)
    strikes |= equations.model.kicks
    if strikes and any(x.energy != equations.energy for x in works):
        found["energies"] = [x.energy for x in equations.works]
    for need in needs:
        if need in NEEDED:
            found |= NEEDED[need](equations, plan)
    return found


def section_functions(
    e: Equations, relations: list[int], state: Sequence[str]
) -> dict[str, list[int]]:
    """Return the functions of sections: their relations, and slopes with term sizes."""
    return {"sections": relations, "section_slopes": _slopes(e, relations, state)}


# The bound of the rounding of a condition counts each of its operations with one
# roundoff, where the size of its terms counts with `SUM_ROUNDOFF`: eight times the
# bound suffices.
INNER = 8.0 * UNIT_ROUNDOFF / SUM_ROUNDOFF


def _slopes(e: Equations, nodes: Sequence[int], names: Sequence[str]) -> list[int]:
    """Return nodes of magnitudes (C,) of conditions' terms, then of slopes (C, V).

    Terms within a function, as in `sin(x + 1e6)`, count by their effect on the value.

    nodes : the C conditions.
    names : the V variables with respect to which slopes are taken.
    """
    g = e.graph
    variables = [g.variable(name) for name in names]
    rows = [gradient(g, node, variables) for node in nodes]
    inner = roundings(g, nodes, names)
    scales = [
        g.call(
            "max",
            scale_of(g, node, variables, dict(enumerate(row))),
            g.call("mul", g.constant(INNER), rounding),
        )
        for node, row, rounding in zip(nodes, rows, inner, strict=True)
    ]
    return [*scales, *(slope for row in rows for slope in row)]


def varying_inertias(equations: Equations, plan: Plan) -> dict[str, int]:
    """Return the inertias that vary with positions: coordinate -> node.

    These are the pivots of M if they are short expressions, since a pivot vanishes
    where other coordinates can replace the coordinate (Euler angles at theta = 0); else
    the diagonal of M.
    """
    g, positions = equations.graph, frozenset(equations.q)
    found = dict(zip(equations.q, equations.inertias, strict=True))
    if plan.elimination is not None:
        pivots = plan.elimination.mass.pivots
        nodes = [pivots[i][0] for i in range(len(equations.q))]
        if len(g.cone(nodes)) <= SHORT_PIVOTS:
            found = dict(zip(equations.q, nodes, strict=True))
    varying = g.dependent(found.values(), positions)
    return {q: node for q, node in found.items() if node in varying}


def _solved(
    equations: Equations, plan: Plan, columns: Columns, *, switching: bool
) -> dict[str, list[int]]:
    """Return the functions of equations that were solved symbolically, by name."""
    e, g, elimination = equations, equations.graph, plan.elimination
    assert elimination is not None
    accelerations, multipliers = elimination.motion()
    forces = dict(zip(map(g.variable, e.multipliers), multipliers, strict=True))
    moved = dict(zip(map(g.variable, e.accelerations), accelerations, strict=True))
    rates = motion_rates(e, elimination)
    if switching:
        found = {
            "field": [*rates, *multipliers],
            "columns": list(columns.nodes.values()),
        }
    else:
        observed = g.substitute(columns.nodes.values(), forces | moved)
        found = {
            "derivative": rates,
            # Output rows show the motion without stabilising terms.
            "observe": g.substitute(observed, {g.variable(GAIN): g.zero}),
        }
    # The power of an eliminated drive depends on q''.
    found["rounding"] = g.substitute(_rounding(e, elimination), forces | moved)
    if e.rows:
        found |= _steps(e, elimination)
    return found


def _steps(e: Equations, elimination: Elimination) -> dict[str, list[int]]:
    """Return `position_step` and `velocity_step`: Newton steps onto the constraints.

    Velocity constraints have residual 0 on the level of positions. See `dense` for the
    elements.
    """
    g, rows = e.graph, e.rows
    held = _held(g, rows)
    off = [_against(g, x, r.residual_scale) for x, r in zip(held, rows, strict=True)]
    off_rates = [_against(g, r.rate, r.rate_scale) for r in rows]
    step = elimination.correction(held)
    left = _largest(g, _second_orders(e, rows))
    velocities = map(g.variable, e.velocities)
    left_by_step = g.substitute([left], dict(zip(velocities, step, strict=True)))
    return {
        "position_step": [*step, _largest(g, off), g.zero, *left_by_step],
        "velocity_step": [
            *elimination.correction([r.rate for r in rows]), _largest(g, off_rates),
            elimination.smallest_singular_value(), _largest(g, _unknown(g, rows)),
        ],
    }  # fmt: skip


def _force_rounding(e: Equations) -> list[int]:
    """Return nodes of rounding-error bounds of the forces (n,) and of the other rates.

    Each force's bound is multiplied by a factor of its own with a pseudo-random sign,
    so that errors of several forces do not cancel in an acceleration that they
    determine.
    """
    g = e.graph
    state = e.state
    found = roundings(g, (*e.f, *e.other_rates), (*state, "t"), state)
    force_rounding = [
        g.call("add", g.call("abs", force), error)
        for force, error in zip(e.f, found, strict=False)
    ]
    return [*_in_parts(g, force_rounding), *found[len(force_rounding) :]]


def _inertial(e: Equations, elimination: Elimination) -> list[int]:
    """Return bounds of the rounding errors of M q'' (n,), for a varying coupled M.

    Where M is close to singular (angles near gimbal lock) these errors dominate. Signs
    are as in `_force_rounding`.
    """
    g, moving = e.graph, frozenset(e.moving).difference(e.velocities)
    if e.chains is not None:
        rates = [g.call("abs", x) for x in elimination.motion()[0]]
        return _in_parts(g, e.chains.sizes(g, rates, moving))
    off = [(i, *entry) for i, row in enumerate(e.M) if len(row.entries) > 1
           for entry in row.entries.items()]  # fmt: skip
    if not off:
        return [g.zero] * len(e.q)
    nodes = [node for *_, node in off]
    varying = g.dependent(nodes, moving)
    sizes: list[list[tuple[int, int]]] = [[] for _ in e.q]
    errors = roundings(g, nodes, moving, e.q)
    for (i, j, node), error in zip(off, errors, strict=True):
        if node in varying:
            rate = g.call("abs", elimination.motion()[0][j])
            sizes[i].append((g.call("add", g.call("abs", node), error), rate))
    return _in_parts(g, [g.product_sum(row) for row in sizes])


def _in_parts(g: Graph, sizes: Sequence[int]) -> list[int]:
    """Multiply each node of `sizes` by a fixed pseudo-random factor in +-[1, 2)."""
    parts = (
        (1.0 + scattered(k, 0)) * (1.0 if scattered(k, 1) < 0.5 else -1.0)
        for k in range(len(sizes))
    )
    return [
        g.call("mul", g.constant(part), x) for part, x in zip(parts, sizes, strict=True)
    ]


def _rounding(e: Equations, elimination: Elimination) -> list[int]:
    """Return bounds of the rounding errors of rates, as `dense.rounding` does."""
    g, n = e.graph, len(e.q)
    force_rounding = _force_rounding(e)
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


def _largest(g: Graph, sizes: Iterable[int]) -> int:
    """Return the node of the maximum of nodes whose values are nonnegative."""
    largest = g.zero
    for size in sizes:
        largest = g.call("max", size, largest)
    return largest


def _jacobian(equations: Equations, plan: Plan) -> dict[str, list[int]]:
    """Return the functions for `dense.jacobian`, or a sparse Newton matrix."""
    e, g = equations, equations.graph
    if plan.newton is not None and plan.elimination is not None:
        return {"jacobian": plan.newton.nodes(e, plan.elimination)}
    residuals = e.motion_residuals()
    state = [g.variable(name) for name in e.state]
    motion = [g.variable(name) for name in (*e.accelerations, *e.multipliers)]
    others = [*(x.rate for x in e.states), *e.powers]
    slopes = [s for r in (*residuals, *others) for s in gradient(g, r, state)]
    slopes += [s for rate in others for s in gradient(g, rate, motion)]
    return {"dynamics": _dynamics(e), "slopes": slopes}


def _powers(e: Equations, plan: Plan) -> list[int]:
    """Return the rates of works, with q'' replaced by its solution.

    q'' occurs in the power of an eliminated moving constraint.
    """
    g = e.graph
    if plan.elimination is None or g.depends(e.powers).isdisjoint(e.accelerations):
        return e.powers
    solved = zip(e.accelerations, plan.elimination.motion()[0], strict=True)
    return list(g.substitute(e.powers, {g.variable(k): x for k, x in solved}))


def _lagrangian(equations: Equations, plan: Plan) -> dict[str, list[int]]:
    """Return the functions of variational methods.

    `lagrangian`: momenta, dL/dq + Q, powers. `lagrangian_slopes`: derivatives of the
    momenta and of dL/dq + Q with respect to q and q'. `inertia`: M.
    """
    e, g, L = equations, equations.graph, equations.model.lagrangian
    positions = [g.variable(name) for name in e.q]
    rates = [g.variable(name) for name in e.velocities]
    Q = generalized_forces(g, e.model, e.flow)
    dL_dq = gradient(g, L, positions)
    forces = [g.call("add", a, b) for a, b in zip(dL_dq, Q, strict=True)]
    M = [node for row in e.M for node in row]
    by_position = [s for p in e.momenta for s in gradient(g, p, positions)]
    second = [
        slope
        for variables in (positions, rates)
        for force in forces
        for slope in gradient(g, force, variables)
    ]
    return {
        "lagrangian": [*e.momenta, *forces, *_powers(e, plan)],
        "lagrangian_slopes": [*by_position, *M, *second],
        "inertia": M,
    }


NEEDED: dict[str, Callable[[Equations, Plan], dict[str, list[int]]]] = {
    "jacobian": _jacobian,
    "lagrangian": _lagrangian,
    # The rates of works by themselves, for scenes without constraints.
    "power": lambda e, plan: {"power": _powers(e, plan)},
}
# Derived by the system from y' with its branches frozen.
AFTER_FREEZING = "series"
