"""Derivation of the equations of motion from the energies, as graph nodes.

The symbols M, f, A, b and lambda are defined in `equations`.

Reactions are computed by virtual separation: with a definition x as a coordinate of its
own, held by the constraint x = r(q, t), the equation of x is

    d/dt dL/dx' - dL/dx = Q_x + sum_c lambda_c dg_c/dx + R_x,

and the known motion, inserted, yields R_x without solving a system. R_x is the
multiplier of x - r = 0: the force on all parts of the model that are written with x.

Sources: H. P. Gavin, Generalized Coordinates, Lagrange's Equations, and Constraints,
eqs 47 and 61; Arnold, Mathematical Methods of Classical Mechanics, sections 12 and 15;
C. Lanczos, The Variational Principles of Mechanics, section III.5.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from graphlib import TopologicalSorter
from typing import TYPE_CHECKING

from lagsim import limits
from lagsim.codes.known import TOO_LARGE
from lagsim.errors import InputError, Problem
from lagsim.language.columns import ACTION
from lagsim.language.derivatives import gradient, slopes, tangent
from lagsim.language.forms import fewer_terms
from lagsim.language.functions import ELEMENTS, OPERATIONS
from lagsim.language.names import rate_of
from lagsim.language.sparse import Budget, SparseVector
from lagsim.mechanics.chains import (
    ChainedMass,
    inertial_forces,
    shorter_chains,
    shorter_than_entries,
)
from lagsim.mechanics.constraints import Flow, constraint_row, laws_of
from lagsim.mechanics.equations import Equations, Quadrature
from lagsim.mechanics.forces import generalized_forces
from lagsim.mechanics.frames import tree_of_frames
from lagsim.mechanics.groups import works_of

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Sequence

    from lagsim.language.graph import Graph
    from lagsim.model.model import Model


def mass_matrix(
    g: Graph, momenta: Sequence[int], rates: Sequence[int]
) -> tuple[SparseVector, ...]:
    """Return the mass matrix d momenta/d rates (n, n), symmetric, as sparse rows.

    The lower triangle is differentiated and mirrored.

    Parameters
    ----------
    momenta : sequence of int, length n
        dL/dq': nodes.
    rates : sequence of int, length n
        q': nodes.

    Raises
    ------
    InputError
        Where more than `limits.INERTIAS` entries may differ from 0.
    """
    variables = frozenset(rates)
    entries = _entries(g, momenta, rates) if len(rates) ** 2 > limits.INERTIAS else 0
    if entries > limits.INERTIAS:
        text = (
            f"the mass matrix has {entries:,} entries that are not 0, and the limit is "
            f"{limits.INERTIAS:,}"
        )
        hint = "fewer velocities in one product or square of the energies couple less"
        hint = limits.without(hint)
        raise InputError([Problem(TOO_LARGE, text, None, hint)])
    places = {v: j for j, v in enumerate(rates)}
    M: list[dict[int, int]] = [{} for _ in rates]
    for i, momentum in enumerate(momenta):
        for v, node in slopes(g, momentum, variables).items():
            if places[v] <= i:
                M[i][places[v]] = M[places[v]][i] = node
    return tuple(SparseVector(g, len(rates), row) for row in M)


def _entries(g: Graph, momenta: Iterable[int], rates: Iterable[int]) -> int:
    """Return the number of entries of M that may differ from 0.

    It is the number of pairs of a momentum and a velocity on which the momentum
    depends.

    momenta, rates : nodes.
    """
    below = {v: 1 << j for j, v in enumerate(rates)}  # node -> bit set of velocities
    momenta = list(momenta)
    for n in g.cone(momenta):
        if n not in below:
            below[n] = 0
            for a in g.args[n]:
                below[n] |= below[a]
    return sum(below[p].bit_count() for p in momenta)


def in_fewer_terms(
    g: Graph,
    model: Model,
    flow: Flow,
    M: tuple[SparseVector, ...],
    f: list[int],
    convective: Sequence[int],
    Q: Sequence[int],
) -> tuple[tuple[SparseVector, ...], list[int]]:
    """Return M and f with the inertial terms rewritten in fewer terms, where possible.

    The terms of the potential and of the applied forces are unchanged: they may contain
    small differences, which would cancel if multiplied out.

    Parameters
    ----------
    M : tuple of SparseVector, shape (n, n)
        The mass matrix.
    f : list of int, length n
        The right-hand side of M q'' = f.
    convective : sequence of int, length n
        d/dt(dL/dq') at q'' = 0.
    Q : sequence of int, length n
        The generalized forces.
    """
    T, V = model.kinetic, model.potential
    if T is None or V is None or flow.velocities & g.depends([V]):
        return M, f
    n = len(f)
    inertial = [
        g.call("sub", a, c)
        for a, c in zip(gradient(g, T, flow.positions), convective, strict=True)
    ]
    entries = [(i, j) for i, row in enumerate(M) for j in row.entries if i <= j]
    moving = {*(x.name for x in model.variables), *flow.velocities, "t"}
    before = [*(M[i][j] for i, j in entries), *inertial]
    after = fewer_terms(g, before, moving)
    if after == before:
        return M, f
    rows: list[dict[int, int]] = [{} for _ in range(n)]
    for (i, j), node in zip(entries, after, strict=False):
        rows[i][j] = rows[j][i] = node
    forces = [
        g.call("add", g.call("sub", a, b), c)
        for a, b, c in zip(
            after[len(entries) :], gradient(g, V, flow.positions), Q, strict=True
        )
    ]
    return tuple(SparseVector(g, n, row) for row in rows), forces


# Up to this number of coordinates the entries of M take fewer operations than chains.
FEW = 5


# Functions besides y' that methods may use in models with elements (`NEEDS` of a
# method), see `language.elements`.
OF_ELEMENTS = frozenset(("power", "balance"))
# Switches and kinks, and roots with an infinite slope: messages show their arguments.
BENT = frozenset(k for k, x in OPERATIONS.items() if x.switch or x.branches) | {"cbrt"}


def may_gather(model: Model, needs: Collection[str] = ()) -> bool:
    """Whether the equations can be integrated with the elements of the model.

    needs : names of functions, besides y', that the method evaluates.
    """
    g, output = model.graph, model.output
    vectors = frozenset(g.of((ELEMENTS,)))
    if not vectors or not OF_ELEMENTS.issuperset(needs):
        return False
    if output.reactions or not vectors.isdisjoint(g.cone(_bent(model))):
        return False
    # Of sums of velocities M has no entries.
    velocities = {rate_of(c.name) for c in model.coordinates}
    of_energies = vectors.intersection(g.cone([model.lagrangian]))
    return velocities.isdisjoint(g.depends(of_energies))


def _bent(model: Model) -> list[int]:
    """Return the arguments of all functions with a jump, a kink or an infinite slope.

    Functions in columns alone are left out.
    """
    g, found = model.graph, list(model.relations)
    for c in model.constraints:
        law = () if c.law is None else (c.law.friction, c.law.static, c.law.bounce)
        slips = () if c.law is None else c.law.slips
        nodes = (c.relation.node, c.limit, c.static, c.when, *law, *slips)
        found += [n for n in nodes if n is not None]
    found += [model.lagrangian, *(x.node for x in model.forces)]
    found += [x.rate for x in model.states]
    found += [] if model.dissipation is None else [model.dissipation]
    bent = (n for n in g.cone(found) if g.ops[n] in BENT)
    return [a for n in bent for a in g.args[n]]


def derive(
    model: Model, *, chained: bool = True, gathers: bool = False, trees: bool = True
) -> Equations:
    """Derive the equations of motion of `model`.

    Parameters
    ----------
    model : Model
        The model, with its energies, constraints, forces and events.
    chained : bool
        Keep M as a ChainedMass where factors along chains take fewer operations than
        its entries.
    gathers : bool
        Keep sums that are elements, see `may_gather`; else they are written out.
    trees : bool
        Write rates of frames by recursion where `chained`, see `frames`. Equations
        that are shown to a reader are written in the definitions of the file.
    """
    if not gathers:
        model = model.written_out()
    g = model.graph
    q = tuple(c.name for c in model.coordinates)
    velocities = tuple(map(rate_of, q))
    flow = Flow(g, q, velocities, model.states)
    positions, rates = flow.positions, flow.rates
    time = g.variable("t")

    *by_state, dL_dt = gradient(g, model.lagrangian, [*rates, *positions, time])
    dL_dt = g.call("add", dL_dt, *tangent(g, [model.lagrangian], flow.states))
    momenta, dL_dq = by_state[: len(q)], by_state[len(q) :]
    always = all(c.always for c in model.constraints)
    few = len(q) <= FEW
    tree = tree_of_frames(model, flow) if chained and trees and not few else None
    chains = tree and tree.chains
    entries = partial(mass_matrix, g, momenta, rates)
    if tree:
        flow = Flow(g, q, velocities, model.states, tree.turned)
        entries = partial(tree.chains.entries, g, Budget())
        factored = always and shorter_than_entries(g, tree.chains)
    elif chained and not few and always:
        chains = shorter_chains(g, model.lagrangian, rates, velocities)
        factored = chains is not None
    M = ChainedMass(g, chains, entries) if chains and factored else entries()
    Q = generalized_forces(g, model, flow)
    if chains:
        lagrangian = tree.lagrangian if tree else model.lagrangian
        pushes = inertial_forces(model, lagrangian, flow)
    else:
        convective = tangent(g, momenta, flow.forward)
        pushes = [g.call("sub", a, c) for a, c in zip(dL_dq, convective, strict=True)]
    f = [g.call("add", a, force) for a, force in zip(pushes, Q, strict=True)]
    if chains is None and isinstance(M, tuple) and has_angles(g, model.kinetic):
        M, f = in_fewer_terms(g, model, flow, M, f, convective, Q)
    plain = [c for c in model.constraints if c.always]
    rows = tuple(constraint_row(g, c.name, c.relation.node, flow) for c in plain)
    laws = tuple(laws_of(g, model.constraints, flow, model.parameter_values))
    energy, is_sum = _energy(g, model, momenta, rates, flow.velocities)
    found = Equations(
        model=model,
        graph=g,
        q=q,
        velocities=velocities,
        M=M,
        f=tuple(f),
        rows=rows,
        momenta=tuple(momenta),
        energy=energy,
        energy_is_sum=is_sum,
        kinetic_form=model.kinetic or g.zero,
        works=(),
        unforced=frozenset(
            name
            for name, *pushes in zip(q, dL_dq, Q, strict=True)
            if set(pushes) == {g.zero}
        ),
        quadratures=(Quadrature(ACTION.of(), model.lagrangian),)
        if model.output.action
        else (),
        laws=laws,
        states=model.states,
        tree=tree,
    )
    found = replace(found, works=works_of(found, Q, dL_dt))
    if isinstance(M, ChainedMass) and is_sum:
        return found
    form = g.product_sum(zip(rates, found.mass_times(rates), strict=True))
    return replace(found, kinetic_form=g.call("mul", g.constant(0.5), form))


def has_angles(g: Graph, node: int | None) -> bool:
    """Whether an expression contains a sine or cosine; False for None."""
    circular = g.of(("sin", "cos"))
    if node is None or not circular:
        return False
    return not set(circular).isdisjoint(g.cone([node]))


def _energy(
    g: Graph,
    model: Model,
    momenta: Sequence[int],
    rates: Sequence[int],
    velocities: frozenset[str],
) -> tuple[int, bool]:
    if model.kinetic is not None and model.potential is not None:
        quadratic = g.degree(model.kinetic, velocities)
        if quadratic is not None and quadratic.least >= 2 >= quadratic.most:
            static = not g.depends([model.potential]) & velocities
            if static:
                return g.call("add", model.kinetic, model.potential), True
    moved = g.product_sum(zip(rates, momenta, strict=True))
    return g.call("sub", moved, model.lagrangian), False


def reactions(e: Equations) -> dict[str, int]:
    """Return the reaction R_x of each definition named in `output.reactions`.

    Each R_x is the reaction in the model in which x alone is a separate coordinate.

    Returns
    -------
    dict
        Name of the definition -> node of the state, q'' and lambda.
    """
    g = e.graph
    separated, expressions = e.model.stated.separated(e.model)
    apart = derive(separated)
    own = dict(zip(apart.q, apart.motion_residuals(), strict=False))
    # All definitions are separated at once: a part written with x through another
    # definition y acts on x through the reaction of y.
    users = {
        name: [
            other for other, node in expressions.items() if name in g.depends([node])
        ]
        for name in expressions
    }
    reaction_of: dict[str, int] = {}
    for name in TopologicalSorter(users).static_order():
        x = g.variable(name)
        rest = (
            (reaction_of[other], gradient(g, expressions[other], [x])[0])
            for other in users[name]
        )
        reaction_of[name] = g.call("add", own[name], g.product_sum(rest))
    nodes = g.substitute((reaction_of[name] for name in expressions), _motion(e))
    return dict(zip(expressions, nodes, strict=True))


def _motion(e: Equations) -> dict[int, int]:
    """Return the motion of the definitions in `output.reactions` as expressions.

    The result maps the variables x, x' and x'' of each such definition to the graph
    nodes of x, x' and x'' as functions of t, q, q' and q''.
    """
    g = e.graph
    seed = {**e.flow.forward}
    for q in e.q:
        seed[g.variable(q)] = g.variable(rate_of(q))
        seed[g.variable(rate_of(q))] = g.variable(rate_of(q, 2))
    found = {d.name: d.node for d in e.model.definitions}
    names = e.model.output.reactions
    new: dict[int, int] = {}
    nodes = [found[name] for name in names]
    for order in range(3):
        variables = (g.variable(rate_of(n, order)) for n in names)
        new |= dict(zip(variables, nodes, strict=True))
        nodes = tangent(g, nodes, seed)
    return new
