"""Decoupled groups of coordinates: their shares of the energy, and works on them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from lagsim.language.columns import MULTIPLIER
from lagsim.language.derivatives import gradient
from lagsim.language.graph import VARIABLE
from lagsim.language.sparse import DisjointSets
from lagsim.mechanics.equations import Equations, Work, may_strike, memoized_by_motion
from lagsim.mechanics.forces import generalized_impulses

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from lagsim.language.graph import Graph


WORK = "work"


# Owner of a node that depends on coordinates of no group, or of several groups.
NOBODY, SEVERAL = -1, -2


@memoized_by_motion
def groups(e: Equations) -> list[list[int]]:
    """Return the decoupled groups of coordinates, as lists of their indices.

    Two coordinates are coupled where one occurs in an entry of M, a force, a constraint
    or a law of the other. Each group on which forces, dissipation, moving constraints,
    laws or impacts do work has an energy balance of its own,

        d(energy)/dt = power of the forces on its coordinates - dL/dt of the group,

    whose accuracy is not limited by rounding errors of the energies of other groups.
    A model with first-order states, or whose energy events change, is one group.
    """
    g = e.graph
    if e.states or e.is_set:
        return [list(range(len(e.q)))]
    together = [([*nodes, *(e.f[i] for i in own)], own) for nodes, own in e.coupled]
    together += [
        ([row.residual, row.rate, row.b, *row.A.entries.values()], [*row.A.entries])
        for row in e.rows
    ]
    for law in e.laws:
        row, columns = law.row, [*law.row.A.entries]
        if law.normal >= 0:  # friction has the contact's multiplier
            columns += e.laws[law.normal].row.A.entries
        nodes = [row.residual, row.rate, row.b, *law.given]
        together.append(([*nodes, *row.A.entries.values()], columns))
    names = coordinates_of(e)
    found = DisjointSets(len(e.q))
    # Node -> one of the coordinates that it depends on; the others are in its set.
    touched: dict[int, int] = {}

    for node in g.cone(node for nodes, _ in together for node in nodes):
        leaf = g.ops[node] == VARIABLE
        below = map(touched.get, g.args[node])
        j = names.get(str(g.payload(node))) if leaf else found.unite(below)
        if j is not None:
            touched[node] = j
    for nodes, own in together:
        found.unite([*own, *map(touched.get, nodes)])
    return found.sets()


def coordinates_of(e: Equations) -> dict[str, int]:
    """Return the index of each coordinate by the names of its variables q_j, q_j'."""
    return {name: j for names in (e.q, e.velocities) for j, name in enumerate(names)}


def shared(
    e: Equations, found: Sequence[Sequence[int]], node: int
) -> tuple[list[int], int]:
    """Divide a sum among decoupled groups of coordinates.

    A term that depends on several groups and cannot be expanded into a sum is added to
    the share of each of these groups.

    Parameters
    ----------
    found : sequence of sequence of int
        The coordinates of each group, by their indices.
    node : int
        The sum.

    Returns
    -------
    shares : list of int
        A node for each group.
    rest : int
        The terms that depend on t and on no group; constants are left out.
    """
    g = e.graph
    group_of = {j: i for i, group in enumerate(found) for j in group}
    names = {name: group_of[j] for name, j in coordinates_of(e).items()}
    given, factors = [g.zero] * len(found), {node: g.one}
    rest = g.zero
    cone = g.cone([node])
    owners = owners_of(g, cone, names)
    for n in reversed(cone):
        factor = factors.get(n)
        if factor is None:
            continue
        if owners[n] == NOBODY:
            if "t" in g.depends([factor, n]):
                rest = g.call("add", rest, g.call("mul", factor, n))
            continue
        if owners[n] == SEVERAL and (addends := _addends(g, n, factor, owners)):
            for a, c in addends:
                factors[a] = g.call("add", factors.get(a, g.zero), c)
            continue
        term = g.call("mul", factor, n)
        own = {owners[n]}
        if owners[n] == SEVERAL:
            own = {names[name] for name in g.depends([n]) if name in names}
        for i in own:
            given[i] = g.call("add", given[i], term)
    return given, rest


def owners_of(
    g: Graph, cone: Iterable[int], names: Mapping[str, int]
) -> dict[int, int]:
    """Return the group on which each node depends; NOBODY for none, SEVERAL for more.

    Parameters
    ----------
    cone : iterable of int
        The nodes, arguments before the operations on them.
    names : mapping
        The index of the group of each variable, by the variable's name.
    """
    found: dict[int, int] = {}
    for n in cone:
        if g.ops[n] == VARIABLE:
            found[n] = names.get(str(g.payload(n)), NOBODY)
        else:
            below = {found[a] for a in g.args[n]} - {NOBODY}
            found[n] = SEVERAL if len(below) > 1 else below.pop() if below else NOBODY
    return found


def _addends(
    g: Graph, n: int, factor: int, owners: Mapping[int, int]
) -> list[tuple[int, int]]:
    """Return the terms of `factor * n` as pairs (node, factor); [] where n is no sum.

    Factors of n that depend on no group are multiplied into `factor`.

    owners : see `owners_of`.
    """
    op, args = g.ops[n], g.args[n]
    if op in ("add", "sub"):
        other = factor if op == "add" else g.call("neg", factor)
        return [(args[0], factor), (args[1], other)]
    if op == "neg":
        return [(args[0], g.call("neg", factor))]
    if op == "mul" and NOBODY in (owners[args[0]], owners[args[1]]):
        fixed, one = sorted(args, key=lambda a: owners[a] != NOBODY)
        return [(one, g.call("mul", factor, fixed))]
    if op == "div" and owners[args[1]] == NOBODY:
        return [(args[0], g.call("div", factor, args[1]))]
    return []


def works_of(e: Equations, Q: Sequence[int], dL_dt: int) -> tuple[Work, ...]:
    """Return the work on each decoupled group of coordinates, or the total work.

    Parameters
    ----------
    e : Equations
        The equations, still without works.
    Q : sequence of int, length n
        The generalized forces.
    dL_dt : int
        The partial derivative of L by t.

    Returns
    -------
    tuple of Work
        Empty where neither forces, constraints, events nor impacts can change the
        energy.
    """
    g, model = e.graph, e.model
    acts = bool(model.forces) or model.dissipation is not None or dL_dt != g.zero
    acts = acts or any(row.transport != g.zero for row in e.rows) or bool(e.laws)
    acts = acts or e.is_set or any(may_strike(e, row) for row in e.rows)
    acts = acts or model.kicks
    # L may depend on time in each group and not as a whole: seen from a moving frame.
    timed = bool(g.dependent([model.lagrangian], ("t",)))
    found = groups(e)
    if len(found) > 1 and (acts or timed):
        several = _of_groups(e, Q, timed, found)
        if several:
            return several
    if not acts:
        return ()
    everything = list(range(len(e.q)))
    return (Work(WORK, frozenset(e.q), _power(e, Q, dL_dt, everything), e.energy),)


def _of_groups(
    e: Equations, Q: Sequence[int], timed: bool, found: Sequence[list[int]]
) -> tuple[Work, ...]:
    """Return the work on each group on which forces have power or impacts act.

    The result is () where a term of an energy or of a power depends on several groups.

    timed : whether energies depend on t.
    found : the coordinates of each group.
    Q : the generalized forces, nodes (n,).
    """
    g = e.graph
    energies, _ = shared(e, found, e.energy)
    rates, left = [g.zero] * len(found), g.zero
    if timed:
        parts, rest = shared(e, found, e.model.lagrangian)
        *rates, left = (
            gradient(g, part, [g.variable("t")])[0] for part in (*parts, rest)
        )
    # Impacts may do work on the coordinates of these rows.
    rows = [law.row for law in e.laws] + [x for x in e.rows if may_strike(e, x)]
    struck = {j for row in rows for j in row.A.entries}
    if e.model.kicks:
        kicks = generalized_impulses(e)
        struck |= {j for kick in kicks for j, x in enumerate(kick) if x != g.zero}
    made: list[Work] = []
    for group, energy, energy_rate in zip(found, energies, rates, strict=True):
        own = {names[j] for names in (e.q, e.velocities) for j in group}
        others = {*e.state} - own
        power = _power(e, Q, energy_rate, group)
        if g.depends([energy, power]) & others:
            return ()
        if power != g.zero or not struck.isdisjoint(group):
            name = f"{WORK}.{e.q[group[0]]}"
            coordinates = frozenset(e.q[j] for j in group)
            made.append(Work(name, coordinates, power, energy))
    if left != g.zero:
        rate = g.call("neg", left)
        made.append(Work(f"{WORK}.t", frozenset(), rate, g.zero))
    return (made[0]._replace(name=WORK),) if len(made) == 1 else tuple(made)


def _power(e: Equations, Q: Sequence[int], dL_dt: int, indices: Sequence[int]) -> int:
    """Return the node of the power of all forces on the coordinates `indices`.

    The partial derivative dL_dt is subtracted, so that the result is d(energy)/dt.

    Q : the generalized forces, nodes (n,).
    """
    g, among = e.graph, {*indices}
    rates = [g.variable(name) for name in e.velocities]
    power = g.product_sum((Q[j], rates[j]) for j in indices)
    power = g.call("sub", power, dL_dt)
    for row in e.rows:
        if row.transport != g.zero and row.A.entries.keys() <= among:
            term = g.call("mul", g.variable(MULTIPLIER.of(row.name)), row.transport)
            power = g.call("add", power, term)
    for law in e.laws:
        if law.row.A.entries.keys() <= among:
            term = g.call(
                "mul", g.variable(law.multiplier), law.conjugate_rate(g, rates)
            )
            power = g.call("add", power, term)
    return power
