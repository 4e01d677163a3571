"""What is compiled from the graph: the name of a function -> what it writes to out.

What a method needs beyond y' it names in NEEDS; a row of NEEDED makes it, so that
nothing is differentiated or compiled that nobody asked for.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from lagsim.language.derivatives import gradient, tangent
from lagsim.language.evaluate import roundings
from lagsim.mechanics.constraints import Flow
from lagsim.mechanics.equations import generalized_forces, pushes
from lagsim.mechanics.groups import may_strike
from lagsim.plan.formulation import GAIN
from lagsim.run.system.coupling import coupled
from lagsim.solve.series import motion_rates

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from lagsim.mechanics.equations import Equations
    from lagsim.mechanics.ldl import Elimination
    from lagsim.plan.plan import Plan
    from lagsim.run.system.columns import Columns
    from lagsim.run.system.stepping import Pattern

# Nodes of pivots that are followed: the 845 of a chain of ten links added a third to
# the time that it takes to compile.
SHORT_PIVOTS = 300
# Multiples of it, less their whole parts, are spread evenly.
GOLDEN = 0.618033988749895


def functions(
    equations: Equations,
    plan: Plan,
    columns: Columns,
    needs: Sequence[str] = (),
    met: Pattern | None = None,
    *,
    switching: bool = False,
) -> dict[str, list[int]]:
    """Give all functions of a system for a method that `needs` more than y'.

    With `switching`, y' and the rows come from what `solve.sliding` makes of `field`.
    """
    g = equations.graph
    diagonal = equations.inertias
    rest = g.call("sub", equations.energy, equations.kinetic_form)
    found = {
        "measure": [
            equations.kinetic_form, rest, *diagonal, g.zero,
        ],
        "terms": pushes(equations),
    }  # fmt: skip
    found["inertias"] = list(varying_inertias(equations, plan).values())
    if equations.model.until:
        found["until"] = [equations.model.until.node]
    if met is not None:
        from lagsim.run.system.stepping import stepping_functions

        found |= stepping_functions(equations, columns, met)
    elif equations.laws:
        from lagsim.run.system.laws import law_functions

        found |= law_functions(equations, columns)
        found["loads"] = _loads(equations)
    elif plan.elimination is None:
        found |= _terms(equations, columns)
        found["loads"] = _loads(equations)
    else:
        found |= _solved(equations, plan, columns, switching=switching)
    if _takes_energy(equations):
        found["energies"] = [x.energy for x in equations.works]
    for need in needs:
        if need in NEEDED:
            found |= NEEDED[need](equations, plan)
    return found


def _takes_energy(e: Equations) -> bool:
    """Tell whether impacts may take energy from some, and others have their own."""
    apart = any(x.energy != e.energy for x in e.works)
    return apart and (bool(e.laws) or any(may_strike(e.graph, x) for x in e.rows))


def varying_inertias(equations: Equations, plan: Plan) -> dict[str, int]:
    """Give the inertias that vary with positions, as coordinate -> node.

    They are the pivots of M where those are few operations, which see that a
    coordinate can be replaced by others (Euler angles at theta = 0); else its diagonal.
    Of what is integrated by itself, its entry there.
    """
    g, positions = equations.graph, frozenset(equations.q)
    found = dict(zip(equations.q, equations.inertias, strict=True))
    if plan.elimination is not None:
        pivots = plan.elimination.mass.pivots
        nodes = [pivots[i][0] for i in range(len(equations.q))]
        if len(g.cone(nodes)) <= SHORT_PIVOTS:
            found = dict(zip(equations.q, nodes, strict=True))
    found |= {x.name: x.mass for x in equations.quadratures}
    varying = g.dependent(found.values(), positions)
    return {q: node for q, node in found.items() if node in varying}


def _solved(
    equations: Equations, plan: Plan, columns: Columns, *, switching: bool
) -> dict[str, list[int]]:
    """Give the equations solved on the graph."""
    e, g, elimination = equations, equations.graph, plan.elimination
    assert elimination is not None
    accelerations, multipliers = elimination.motion()
    new = dict(zip(map(g.variable, e.multipliers), multipliers, strict=True))
    rates = motion_rates(e, elimination)
    if switching:
        found = {
            "field": [*rates, *multipliers],
            "columns": list(columns.nodes.values()),
        }
    else:
        new |= dict(zip(map(g.variable, e.accelerations), accelerations, strict=True))
        observed = g.substitute(columns.nodes.values(), new)
        found = {
            "derivative": rates,
            # Rows show the motion without what pulls the state to the constraints.
            "observe": g.substitute(observed, {g.variable(GAIN): g.zero}),
        }
    found["rounding"] = _rounding(e, elimination)
    if e.rows:
        held, moving, worst_held, worst_moving = _residuals(e)
        step = elimination.correction(held)
        left, left_moving = bends(e)
        velocities = map(g.variable, e.velocities)
        [left] = g.substitute([left], dict(zip(velocities, step, strict=True)))
        found["position_step"] = [*step, worst_held, g.zero, left]
        found["velocity_step"] = [
            *elimination.correction(moving), worst_moving, elimination.health(),
            left_moving,
        ]  # fmt: skip
    return found


def _terms(equations: Equations, columns: Columns) -> dict[str, list[int]]:
    """Give what the loops of `solve.dense` begin with."""
    e = equations
    found = {
        "dynamics": _dynamics(e),
        "quadratures": e.quadrature_rates,
        "columns": list(columns.nodes.values()),
    }
    if e.rows:
        M = [node for row in e.M for node in row]
        A = [node for row in e.rows for node in row.A]
        held, moving, worst_held, worst_moving = _residuals(e)
        found["geometry"] = [*M, *A, *held, *moving, worst_held, worst_moving]
        found["bends"] = list(bends(e))
    return found


def _dynamics(e: Equations) -> list[int]:
    """Give M, A, f, b."""
    return [
        *(node for row in e.M for node in row),
        *(node for row in e.rows for node in row.A),
        *e.f, *(row.b for row in e.rows),
    ]  # fmt: skip


def _loads(e: Equations) -> list[int]:
    """Give the rounding of the forces, each with a sign and by a part of its own.

    All together they do something to every acceleration that any of them reaches: what
    would cancel if they were alike does not.
    """
    g = e.graph
    state = (*e.q, *e.velocities)
    found = roundings(g, (*e.f, *e.quadrature_rates), (*state, "t"), state)
    loads = []
    for k, (force, error) in enumerate(zip(e.f, found, strict=False)):
        whole = g.call("add", g.call("abs", force), error)
        loads.append(g.call("mul", g.constant(_part(k)), whole))
    return [*loads, *found[len(loads) :]]


def _inertial(e: Equations, elimination: Elimination) -> list[int]:
    """Give the rounding of M q'', where M varies and is no diagonal (n,).

    Where M is close to singular (angles near gimbal lock) it is all that there is.
    Signs are those of `_loads`.
    """
    g, moving = e.graph, frozenset((*e.q, "t"))
    rates = elimination.motion()[0]
    if e.chains is not None:
        sizes = e.chains.sizes(g, [g.call("abs", x) for x in rates], moving)
        return [g.call("mul", g.constant(_part(k)), x) for k, x in enumerate(sizes)]
    found = []
    for k, row in enumerate(e.M):
        entries = row.entries
        parts = []
        if len(entries) > 1:
            errors = roundings(g, entries.values(), moving, e.q)
            for j, error in zip(entries, errors, strict=True):
                if g.depends([entries[j]]) & moving:
                    size = g.call("add", g.call("abs", entries[j]), error)
                    parts.append(g.call("mul", size, g.call("abs", rates[j])))
        found.append(g.call("mul", g.constant(_part(k)), g.sum(parts)))
    return found


def _part(k: int) -> float:
    """Give the sign and the part with which the rounding of a force is taken."""
    return (1.0 + GOLDEN * k % 1.0) * (1.0 - 2.0 * (k % 2))


def _rounding(e: Equations, elimination: Elimination) -> list[int]:
    """Give what rounding does to the accelerations, as `solve.dense.rounding` does."""
    g, n = e.graph, len(e.q)
    loads = _loads(e)
    forces = [
        g.call("add", load, load_of_mass)
        for load, load_of_mass in zip(loads, _inertial(e, elimination), strict=False)
    ]
    found = [g.call("abs", x) for x in elimination.response(forces)]
    label = coupled(e)
    shares: dict[int, int] = {}
    squares = elimination.reactions()
    inertias = e.inertias
    for row, square in zip(e.rows, squares, strict=True):
        first = label[min(row.A.entries)] if row.A.entries else 0
        shares[first] = g.call("add", shares.get(first, g.zero), square)
    for i, x in enumerate(found):
        inertia = inertias[i]
        if label[i] in shares and inertia != g.zero:
            share = g.call("div", shares[label[i]], inertia)
            root = g.call("sqrt", g.call("max", share, g.zero))
            found[i] = g.call("add", x, root)
    return [*found, *loads[n:]]


def bends(equations: Equations) -> tuple[int, int]:
    """Give what a Newton step leaves, largest against the scales, of both levels.

    The step stands in the place of the velocities. On the level of positions that is
    the residual and its first two derivatives, of which the first cancels it where the
    rows are independent; on that of velocities nothing, or 1: not known.
    """
    e, g = equations, equations.graph
    step = dict(zip(map(g.variable, e.q), map(g.variable, e.velocities), strict=True))
    held = [row for row in e.rows if row.holonomic]
    moved = tangent(g, [row.residual for row in held], step)
    bent = tangent(g, moved, step)
    left = g.zero
    for row, first, second in zip(held, moved, bent, strict=True):
        half = g.call("mul", g.constant(0.5), second)
        whole = g.call("add", g.call("add", row.residual, first), half)
        part = g.call("div", g.call("abs", whole), row.residual_scale)
        some = g.call("gt", row.residual_scale, g.zero)
        left = g.call("max", g.call("if", some, part, g.zero), left)
    linear = all(row.holonomic or row.pfaffian for row in e.rows)
    return left, g.zero if linear else g.one


def _residuals(equations: Equations) -> tuple[list[int], list[int], int, int]:
    """Give residuals (m,), rates (m,), and the largest of each against its scale.

    Relations between velocities have no residual on the level of positions.
    """
    g, rows = equations.graph, equations.rows
    held = [r.residual if r.holonomic else g.zero for r in rows]
    rates = [r.rate for r in rows]

    def worst(pairs: list[tuple[int, int]]) -> int:
        largest = g.zero
        for residual, scale in pairs:
            part = g.call("div", g.call("abs", residual), scale)
            some = g.call("gt", scale, g.zero)
            largest = g.call("max", g.call("if", some, part, g.zero), largest)
        return largest

    return (
        held,
        rates,
        worst([(r, row.residual_scale) for r, row in zip(held, rows, strict=True)]),
        worst([(r, row.rate_scale) for r, row in zip(rates, rows, strict=True)]),
    )


def _power(equations: Equations, _plan: Plan) -> dict[str, list[int]]:
    """Give the rates of works by themselves, for scenes without constraints."""
    return {"power": equations.powers}


def _jacobian(equations: Equations, plan: Plan) -> dict[str, list[int]]:
    """Give what `solve.jacobian` begins with; or the entries of Newton's matrix."""
    e, g = equations, equations.graph
    if plan.newton is not None and plan.elimination is not None:
        return {"jacobian": plan.newton.nodes(e, plan.elimination)}
    residuals = e.motion_residuals()
    state = [g.variable(name) for name in (*e.q, *e.velocities)]
    motion = [g.variable(name) for name in (*e.accelerations, *e.multipliers)]
    slopes = [s for r in (*residuals, *e.powers) for s in gradient(g, r, state)]
    slopes += [s for power in e.powers for s in gradient(g, power, motion)]
    return {"dynamics": _dynamics(e), "slopes": slopes}


def _lagrangian(equations: Equations, _plan: Plan) -> dict[str, list[int]]:
    """Give momenta, dL/dq + Q and powers; their slopes; and the slopes M alone."""
    e, g, L = equations, equations.graph, equations.model.lagrangian
    positions = [g.variable(name) for name in e.q]
    rates = [g.variable(name) for name in e.velocities]
    Q = generalized_forces(g, e.model, Flow(g, e.q, e.velocities))
    dL_dq = gradient(g, L, positions)
    forces = [g.call("add", a, b) for a, b in zip(dL_dq, Q, strict=True)]
    M = [node for row in e.M for node in row]
    by_position = [s for p in e.momenta for s in gradient(g, p, positions)]
    bends = [
        slope
        for variables in (positions, rates)
        for force in forces
        for slope in gradient(g, force, variables)
    ]
    return {
        "lagrangian": [*e.momenta, *forces, *e.powers],
        "lagrangian_slopes": [*by_position, *M, *bends],
        "inertia": M,
    }


def _linear(equations: Equations, plan: Plan) -> dict[str, list[int]]:
    """Give the matrices of a linear scene."""
    from lagsim.solve.linear import linear_form  # of one method

    assert plan.elimination is not None
    return {"linear": linear_form(equations, plan.elimination)}


NEEDED: dict[str, Callable[[Equations, Plan], dict[str, list[int]]]] = {
    "jacobian": _jacobian,
    "lagrangian": _lagrangian,
    "linear": _linear,
    "power": _power,
}
# Made by the system from y' with its branches frozen.
AFTER_FREEZING = "series"
