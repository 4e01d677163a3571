"""The work done on each group of coordinates that touch no other: `work` is their sum.

    d(energy of a group)/dt = the power of what acts on its coordinates - dL/dt of it

So each group on which forces, dissipation, moving constraints, laws or impacts do work
has a balance of its own, in which no other's energy rounds or hides anything.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple, Protocol

from lagsim.language.derivatives import gradient
from lagsim.language.functions import OPERATIONS
from lagsim.mechanics.groups import Coupled, groups, shared

if TYPE_CHECKING:
    from collections.abc import Sequence

    from lagsim.language.graph import Graph
    from lagsim.mechanics.constraints import Row
    from lagsim.model.model import Model

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
    """Give the power of what acts on some coordinates."""
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
