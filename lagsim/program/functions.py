"""The functions compiled from the graph: name -> the nodes written to out.

A method declares in NEEDS which functions it uses besides y', and a row of NEEDED
constructs each one: only functions in use are differentiated and compiled.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from lagsim.language.columns import IMPULSE
from lagsim.language.derivatives import gradient, tangent
from lagsim.language.evaluate import roundings
from lagsim.mechanics.constraints import scale_of
from lagsim.mechanics.equations import may_strike, pushes
from lagsim.mechanics.forces import generalized_forces
from lagsim.mechanics.motion_series import motion_rates
from lagsim.plan.formulation import GAIN
from lagsim.program.rounding import force_rounding_bounds, rounding_bounds
from lagsim.tolerances import SUM_ROUNDOFF, UNIT_ROUNDOFF

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from lagsim.language.graph import Graph
    from lagsim.mechanics.constraints import Law, Row
    from lagsim.mechanics.equations import Equations
    from lagsim.mechanics.ldl import Elimination
    from lagsim.mechanics.switches import Switches
    from lagsim.plan.plan import Plan
    from lagsim.program.output_row import Columns
    from lagsim.program.patterns import Pattern


def _held(g: Graph, rows: Iterable[Row]) -> list[int]:
    """Return the residual node of each row, the zero node for velocity constraints."""
    return [row.residual if row.holonomic else g.zero for row in rows]


def _conditions(g: Graph, laws: Iterable[Law]) -> list[int]:
    """Return, for each law, the node of its condition `when`; 1 by default."""
    return [g.one if law.when is None else law.when for law in laws]


def loop_functions(e: Equations, columns: Columns) -> dict[str, list[int]]:
    """Return the nodes of the functions that kernels of `dense` call, by name.

    columns : the quantities of an output row.
    """
    g, rows = e.graph, e.every_row
    found = {
        "dynamics": _dynamics(e),
        "other_rates": e.other_rates,
        "columns": list(columns.nodes.values()),
        "force_rounding": force_rounding_bounds(e),
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
            if law.gapped
            else law.row.rate
            for law in e.laws
        ]
        if sliders := [law.slider.force for law in e.laws if law.slider]:
            found["sliders"] = sliders
        found["conditions"] = _conditions(g, e.laws)
        if any(law.bounce is not None for law in e.laws):
            # Constant coefficients are values of a bound system, and no part of the
            # code.
            found["restitutions"] = [
                g.constant(0.0) if law.bounce is None else law.bounce for law in e.laws
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
    """Return for each row the node 1 if it is a nonlinear velocity constraint, else 0.

    The rate residual of a nonlinear velocity constraint after a Newton step has no
    a-priori bound.
    """
    return [g.zero if row.holonomic or row.pfaffian else g.one for row in rows]


def _second_orders(e: Equations, rows: Iterable[Row]) -> list[int]:
    """Return, for each row, the node of its scaled residual after a Newton step.

    The residual is expanded to second order, with the step in place of the velocities.
    The first-order term cancels the residual where the rows are independent. The node
    of a velocity constraint is 0.
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


def stepping_functions(
    e: Equations, columns: Columns, found: Pattern
) -> dict[str, list[int]]:
    """Return the functions `balance`, `effort` and `columns` of the method `moreau`.

    `balance` has the nonzero elements of M and A, then f and the data of the rows;
    `effort` has the powers without constraint forces; in `columns` impulses are 0.

    found : the sparsity pattern of M and of the rows.
    """
    g, rows, relations = e.graph, e.every_row, e.relations
    lam = {g.variable(name): g.zero for name in e.multipliers}
    at_impacts = {
        g.variable(IMPULSE.of(law.constraint)): g.zero
        for law in e.laws
        if not law.bounded
    }
    return {
        "balance": [
            *(e.M[i][j] for i, k in enumerate(found.first) for j in range(k, i + 1)),
            *(slope for row in rows for slope in row.A.entries.values()),
            *e.f,
            *_held(g, rows),
            *(_offset(e, row) for row in rows),
            *(x.bound for x in relations),
            *(x.static for x in relations),
            *_conditions(g, relations),
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

    Such rates are velocities, and first-order states whose rates are discontinuous. The
    rate of such a surface jumps where the surface is reached. The sides of other
    surfaces count as constants.

    switches : the switches of the equations.
    """
    e, depends = equations, equations.graph.depends
    modes = {side.variable for side in switches.sides}
    rates = zip(e.states, switches.freeze([x.rate for x in e.states]), strict=True)
    stepping = {x.name for x, rate in rates if depends([rate]) & modes}
    names = frozenset(e.velocities) | stepping
    nodes = switches.freeze([side.node for side in switches.sides])
    return [bool(depends([node]) & names) for node in nodes]


def may_cancel(switches: Switches) -> list[bool]:
    """Return, for each surface, whether its expression may be constant on a branch.

    The expression then depends on the branch of another switch. On one branch its terms
    may cancel, as those of `x + min(y - x, 0)` where y > x, but for their rounding.
    """
    modes = {x.variable for x in switches.sides}
    modes |= {x.variable for x in switches.modes}
    nodes = switches.surface_nodes()
    return [not modes.isdisjoint(switches.graph.depends([node])) for node in nodes]


def surface_functions(
    equations: Equations, switches: Switches
) -> tuple[dict[str, list[int]], list[int], list[int]]:
    """Return the functions of the surfaces, and the pattern of their rows J.

    switches : the switches of the equations.

    Returns
    -------
    functions : dict of str to list of int
        The nodes of `surfaces`, `surface_rows` and `corner_levers`, see `sliding`.
    starts : list of int
        Index, among the elements of J, of the first element of each row, and their
        number.
    columns : list of int
        Column of each element.
    """
    g = equations.graph
    flow = equations.flow
    states = [*flow.states]
    positions, driven = [*flow.positions, *states], [*flow.rates, *states]
    still = {x: rate for x, rate in flow.forward.items() if x not in flow.states}
    nodes = switches.surface_nodes()
    moving_sides = on_rates(equations, switches)
    residuals, speeds, b, scales = [], [], [], []
    elements: list[int] = []
    columns: list[int] = []
    starts = [0]
    # Terms of an eliminated coordinate, as x - 1e5, are none of the sum, nor are terms
    # within a product that cancel on a branch.
    known = zip(nodes, switches.sides, may_cancel(switches), strict=True)
    deep = [n for n, side, cancels in known if side.shown or cancels]
    bounds = dict(zip(deep, roundings(g, deep, (*equations.moving, "t")), strict=True))
    for moving, node in zip(moving_sides, nodes, strict=True):
        variables = driven if moving else positions
        slopes = dict(enumerate(gradient(g, node, variables)))
        (speed,) = [node] if moving else tangent(g, [node], flow.forward)
        residuals.append(g.zero if moving else node)
        speeds.append(speed)
        b.append(g.call("neg", tangent(g, [speed], still)[0]))
        scales.append(scale_of(g, node, variables, slopes))
        if node in bounds:
            bound = g.call("mul", g.constant(OF_BOUND), bounds[node])
            scales[-1] = g.call("max", scales[-1], bound)
        # Where rates of states are constant, they are in no slope of the speed.
        cone = {*g.cone([speed])}
        mixed = not cone.isdisjoint(flow.rates) and not flow.states.keys().isdisjoint(
            g.cone([node])
        )
        if not moving and (mixed or not flow.states.keys().isdisjoint(cone)):
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

    The levers of a surface are the components, along its gradient, of the forces and of
    each row; their jumps across the surface determine the motion at a corner, see
    `mechanics.corners`. The list is empty without corners.

    switches : the switches of the equations.
    """
    if not switches.corners:
        return []
    none = (equations.graph.zero,) * (1 + len(equations.multipliers))
    found = [switches.corners.get(k) for k in range(len(switches.sides))]
    return [x for c in found for x in (c.levers if c else none)]


# Part of a rounding bound, in units of rounding, that counts as the size of terms.
OF_BOUND = 0.0625
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
    """Return the functions of sections: their relations, and slopes with term sizes.

    relations : the nodes.
    state : the names of the components of y.
    """
    return {"sections": relations, "section_slopes": _slopes(e, relations, state)}


# The bound of the rounding of a condition counts each of its operations with one
# roundoff, where the size of its terms counts with `SUM_ROUNDOFF`: eight times the
# bound suffices.
INNER = 8.0 * UNIT_ROUNDOFF / SUM_ROUNDOFF


def _slopes(e: Equations, nodes: Sequence[int], names: Sequence[str]) -> list[int]:
    """Return nodes of the sizes (C,) of conditions' terms, then of slopes (C, V).

    Terms within a function, as in `sin(x + 1e6)`, count by their effect on the value of
    the function.

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

    The inertias are the pivots of M if these are short expressions, since a pivot
    vanishes where other coordinates can replace the coordinate (Euler angles at theta =
    0); else the diagonal of M.

    plan : the plan, with the symbolic solution, if there is one.
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
    """Return the functions of equations that were solved symbolically, by name.

    switching : see `functions`.
    plan : the plan, with the symbolic solution.
    columns : the quantities of an output row.
    """
    e, g, elimination = equations, equations.graph, plan.elimination
    assert elimination is not None
    accelerations, multipliers = elimination.motion()
    forces = dict(zip(map(g.variable, e.multipliers), multipliers, strict=True))
    accelerations_of = dict(
        zip(map(g.variable, e.accelerations), accelerations, strict=True)
    )
    rates = motion_rates(e, elimination)
    if switching:
        found = {
            "field": [*rates, *multipliers],
            "columns": list(columns.nodes.values()),
        }
    else:
        observed = g.substitute(columns.nodes.values(), forces | accelerations_of)
        found = {
            "derivative": rates,
            # Output rows show the motion without stabilising terms.
            "observe": g.substitute(observed, {g.variable(GAIN): g.zero}),
        }
    # The power of an eliminated drive depends on q''.
    found["rounding"] = g.substitute(
        rounding_bounds(e, elimination), forces | accelerations_of
    )
    if e.rows:
        found |= _steps(e, elimination)
    return found


def _steps(e: Equations, elimination: Elimination) -> dict[str, list[int]]:
    """Return `position_step` and `velocity_step`: Newton steps onto the constraints.

    Velocity constraints have residual 0 on the level of positions. See `dense` for the
    elements.

    elimination : the symbolic solution.
    """
    g, rows = e.graph, e.rows
    residuals = _held(g, rows)
    off = [
        _against(g, x, r.residual_scale) for x, r in zip(residuals, rows, strict=True)
    ]
    off_rates = [_against(g, r.rate, r.rate_scale) for r in rows]
    step = elimination.correction(residuals)
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


def _largest(g: Graph, sizes: Iterable[int]) -> int:
    """Return the node of the maximum of nodes whose values are nonnegative."""
    largest = g.zero
    for size in sizes:
        largest = g.call("max", size, largest)
    return largest


def _jacobian(equations: Equations, plan: Plan) -> dict[str, list[int]]:
    """Return the functions for `dense.jacobian`, or for a sparse Newton matrix.

    plan : determines which of both the method uses.
    """
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
    """Return the nodes of the rates of works, with q'' replaced by its solution.

    q'' occurs in the power of an eliminated moving constraint.

    plan : the plan, with the symbolic solution, if there is one.
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
