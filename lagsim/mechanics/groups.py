"""Groups of coordinates that do not touch, and the share of each in a sum.

Two coordinates touch where one stands in an entry of M, a force, a constraint or a law
of the other.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

from lagsim.language.disjoint_sets import DisjointSets
from lagsim.language.graph import VARIABLE, once

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from lagsim.language.graph import Graph
    from lagsim.mechanics.constraints import Row
    from lagsim.mechanics.laws import Law

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
    """Give what there is in `node` of each group, but for a constant.

    A sum is shared out; what touches several groups and is no sum goes to each of them.
    """
    return shared(e, found, node)[0]


def shared(
    e: Coupled, found: Sequence[Sequence[int]], node: int
) -> tuple[list[int], int]:
    """Give the same, and what there is of no group, but for a constant."""
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
    """Give what `factor` times `n` is a sum of, each with its factor, or nothing."""
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
