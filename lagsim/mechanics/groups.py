"""Decoupled groups of coordinates: the share of each in a sum, and the work done on it.

Two coordinates are coupled where one stands in an entry of M, a force, a constraint or
a law of the other.

    d(energy of a group)/dt = the power of what acts on its coordinates - dL/dt of it

So each group on which forces, dissipation, moving constraints, laws or impacts do work
has a balance of its own, in which no other's energy rounds or hides anything.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple, Protocol

from lagsim.language.derivatives import gradient
from lagsim.language.functions import OPERATIONS
from lagsim.language.graph import VARIABLE, once
from lagsim.language.sparse import DisjointSets

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from lagsim.language.graph import Graph
    from lagsim.mechanics.constraints import Law, Row
    from lagsim.model.model import Model


# Whose coordinates a node depends on: of no group, or of more than one.
NOBODY, SEVERAL = -1, -2


class Coupled(Protocol):
    """Equations of motion, as far as they tell which coordinates touch."""

    @property
    def graph(self) -> Graph: ...  # noqa: D102
    @property
    def q(self) -> tuple[str, ...]: ...  # noqa: D102
    @property
    def velocities(self) -> tuple[str, ...]: ...  # noqa: D102
    @property
    def f(self) -> tuple[int, ...]: ...  # noqa: D102
    @property
    def rows(self) -> tuple[Row, ...]: ...  # noqa: D102
    @property
    def laws(self) -> tuple[Law, ...]: ...  # noqa: D102
    @property
    def coupled(self) -> list[tuple[list[int], list[int]]]: ...  # noqa: D102
    @property
    def nodes(self) -> tuple[object, ...]: ...  # noqa: D102


def groups(equations: Coupled) -> list[list[int]]:
    """Give the coordinates that touch one another, group by group."""
    key = groups, equations.nodes
    return once(equations.graph, key, lambda: _groups(equations))


def _groups(equations: Coupled) -> list[list[int]]:
    e, g = equations, equations.graph
    together = [([*nodes, *(e.f[i] for i in own)], own) for nodes, own in e.coupled]
    together += [
        ([row.residual, row.rate, row.b, *row.A.entries.values()], [*row.A.entries])
        for row in e.rows
    ]
    for law in e.laws:
        row, held = law.row, [*law.row.A.entries]
        if law.normal >= 0:  # friction has the contact's multiplier
            held += e.laws[law.normal].row.A.entries
        nodes = [row.residual, row.rate, row.b, law.bound, law.static]
        together.append(([*nodes, *row.A.entries.values()], held))
    names = coordinates_of(e)
    found = DisjointSets(len(e.q))
    # Of each node one of the coordinates below it: the others are in the same set.
    touched: dict[int, int] = {}

    def unite(below: list[int], nodes: Iterable[int]) -> int | None:
        below = below + [touched[n] for n in nodes if n in touched]
        for j in below[1:]:
            found.merge(below[0], j)
        return below[0] if below else None

    for node in g.cone(node for nodes, _ in together for node in nodes):
        leaf = g.ops[node] == VARIABLE
        j = names.get(str(g.payload(node))) if leaf else unite([], g.args[node])
        if j is not None:
            touched[node] = j
    for nodes, own in together:
        unite(own, nodes)
    return found.sets()


def coordinates_of(e: Coupled) -> dict[str, int]:
    """Give the coordinate that each variable of the state belongs to."""
    return {name: j for names in (e.q, e.velocities) for j, name in enumerate(names)}


def shares(e: Coupled, found: Sequence[Sequence[int]], node: int) -> list[int]:
    """Share of each group in a sum `node`, up to a constant.

    A sum is shared out; what touches several groups and is no sum goes to each of them.
    """
    return shared(e, found, node)[0]


def shared(
    e: Coupled, found: Sequence[Sequence[int]], node: int
) -> tuple[list[int], int]:
    """Shares of the groups, and the rest that belongs to none, up to a constant."""
    g = e.graph
    group_of = {j: i for i, group in enumerate(found) for j in group}
    names = {name: group_of[j] for name, j in coordinates_of(e).items()}
    given, factors = [g.zero] * len(found), {node: g.one}
    rest = g.zero
    cone = g.cone([node])
    owners = _owners(g, cone, names)
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
        for i in {names[name] for name in g.depends([n]) if name in names}:
            given[i] = g.call("add", given[i], term)
    return given, rest


def _owners(g: Graph, cone: Iterable[int], names: Mapping[str, int]) -> dict[int, int]:
    """Give the group that each node depends on, or NOBODY or SEVERAL."""
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
    """Addends of `factor` times `n`, each with its factor; none if it is no sum."""
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


WORK = "work"


class Energetic(Coupled, Protocol):
    """Equations of motion with their energy."""

    @property
    def model(self) -> Model: ...  # noqa: D102
    @property
    def energy(self) -> int: ...  # noqa: D102


class Work(NamedTuple):
    """The work done on a group of coordinates.

    Attributes
    ----------
    name : str
        Of its variable: `work` where it is all work, else with the group's first
        coordinate.
    coordinates : frozenset of str
        Empty for what a function of time alone in L gives.
    rate : int
        The power, with the multipliers as variables: a node.
    energy : int
        The group's share of the energy: a node.
    """

    name: str
    coordinates: frozenset[str]
    rate: int
    energy: int


def works_of(e: Energetic, Q: Sequence[int], dL_dt: int) -> tuple[Work, ...]:
    """Give the works of equations that have none yet, for the generalized forces Q."""
    g, model = e.graph, e.model
    acts = bool(model.forces) or model.dissipation is not None or dL_dt != g.zero
    acts = acts or any(row.transport != g.zero for row in e.rows) or bool(e.laws)
    acts = acts or any(may_strike(g, row) for row in e.rows)
    # L may depend on time in each group and not as a whole: seen from a moving frame.
    timed = "t" in g.depends([model.lagrangian])
    found = groups(e)
    if len(found) > 1 and (acts or timed):
        several = _of_groups(e, Q, timed, found)
        if several:
            return several
    if not acts:
        return ()
    everything = list(range(len(e.q)))
    return (Work(WORK, frozenset(e.q), _power(e, Q, dL_dt, everything), e.energy),)


def may_strike(g: Graph, row: Row) -> bool:
    """Tell whether a constraint's rate may jump: an impact takes energy."""
    cone = g.cone([row.rate])
    return any((known := OPERATIONS.get(g.ops[n])) and known.switch for n in cone)


def _of_groups(
    e: Energetic, Q: Sequence[int], timed: bool, found: Sequence[list[int]]
) -> tuple[Work, ...]:
    """Give the work of each group that has some; nothing where L is no sum."""
    g = e.graph
    energies, _ = shared(e, found, e.energy)
    rates, left = [g.zero] * len(found), g.zero
    if timed:
        parts, rest = shared(e, found, e.model.lagrangian)
        *rates, left = (
            gradient(g, part, [g.variable("t")])[0] for part in (*parts, rest)
        )
    made: list[Work] = []
    for group, energy, late in zip(found, energies, rates, strict=True):
        own = {names[j] for names in (e.q, e.velocities) for j in group}
        others = {*e.q, *e.velocities} - own
        power = _power(e, Q, late, group)
        if g.depends([energy, power]) & others:
            return ()
        if power != g.zero or _is_met(e, group):
            name = f"{WORK}.{e.q[group[0]]}"
            coordinates = frozenset(e.q[j] for j in group)
            made.append(Work(name, coordinates, power, energy))
    if left != g.zero:
        rate = g.call("neg", left)
        made.append(Work(f"{WORK}.t", frozenset(), rate, g.zero))
    return (made[0]._replace(name=WORK),) if len(made) == 1 else tuple(made)


def _is_met(e: Energetic, group: Sequence[int]) -> bool:
    """Tell whether impacts may do work on a group."""
    rows = [law.row for law in e.laws]
    rows += [row for row in e.rows if may_strike(e.graph, row)]
    return any(row.A.entries.keys() & {*group} for row in rows)


def _power(e: Energetic, Q: Sequence[int], dL_dt: int, some: Sequence[int]) -> int:
    """Power of the forces on some coordinates."""
    g, among = e.graph, {*some}
    rates = [g.variable(name) for name in e.velocities]
    power = g.product_sum((Q[j], rates[j]) for j in some)
    power = g.call("sub", power, dL_dt)
    for row in e.rows:
        if row.transport != g.zero and row.A.entries.keys() <= among:
            term = g.call("mul", g.variable(f"lambda_{row.name}"), row.transport)
            power = g.call("add", power, term)
    for law in e.laws:
        if law.row.A.entries.keys() <= among:
            term = g.call("mul", g.variable(law.multiplier), law.moved(g, rates))
            power = g.call("add", power, term)
    return power
