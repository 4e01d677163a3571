"""Subsystems that do not touch: groups of coordinates, each with equations of its own.

Two coordinates touch where one stands in an entry of M, a force or a constraint of the
other. Groups that do not are integrated apart, each with its own steps.
"""

from __future__ import annotations

from dataclasses import replace
from functools import reduce
from operator import or_
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lagsim.admissibility.point import Point
from lagsim.admissibility.start import start_at
from lagsim.language.evaluate import evaluate
from lagsim.language.graph import VARIABLE
from lagsim.language.sparse import SparseVector
from lagsim.mechanics.instant import Instant
from lagsim.mechanics.ldl import Elimination, TooLongError
from lagsim.model.model import Output, Parameter, Scene
from lagsim.plan.cost import step_cost

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from lagsim.admissibility import Start
    from lagsim.language.arrays import Floats
    from lagsim.mechanics.equations import Equations
    from lagsim.model.model import Model

# With more coordinates than this nobody looks, unasked, how fast the subsystems are.
LARGEST = 40
# Compiling and linking a subsystem takes as long as this many operations.
COMPILING = 1e8
# Radians of its fastest motion that a step of order 8 takes at the default tolerance.
RADIANS = 1.0
# Of the state: how far it is moved to see how fast the motion is.
NUDGE = 1e-6


class Subsystem(NamedTuple):
    """A group of coordinates with its equations.

    Attributes
    ----------
    coordinates : tuple of int
        Their indices in the whole.
    equations : Equations
        On the graph of the whole; their rows show q, q' and what belongs to them.
    start : Start
    """

    coordinates: tuple[int, ...]
    equations: Equations
    start: Start

    def at(self, whole: Instant) -> Instant:
        """Give the subsystem's part of a state of the whole."""
        return part_of(whole, self.coordinates)


def part_of(whole: Instant, coordinates: Iterable[int]) -> Instant:
    """Give the state of some of the coordinates."""
    chosen = list(coordinates)
    return Instant(whole.t, whole.q[chosen], whole.v[chosen])


def refusal(equations: Equations) -> str:
    """Say why subsystems cannot be integrated apart, or give ""."""
    if equations.power is not None or equations.quadratures:
        return "work and action are quadratures of them all"
    if equations.model.until:
        return "`until` looks at them all"
    if len(groups(equations)) < 2:
        return "all coordinates are coupled"
    return ""


def groups(equations: Equations) -> list[list[int]]:
    """Give the coordinates that touch one another, group by group."""
    e, g = equations, equations.graph
    bit = {name: 1 << j for j, name in enumerate(e.q)}
    bit |= {name: 1 << j for j, name in enumerate(e.velocities)}
    together = [
        ([*row.entries.values(), e.f[i]], 1 << i | _bits(row.entries))
        for i, row in enumerate(e.M)
    ]
    together += [
        ([row.residual, row.rate, row.b, *row.A.entries.values()], _bits(row.A.entries))
        for row in e.rows
    ]
    touched: dict[int, int] = {}
    for node in g.cone(node for nodes, _ in together for node in nodes):
        mask = bit.get(str(g.payload(node)), 0) if g.ops[node] == VARIABLE else 0
        for a in g.args[node]:
            mask |= touched[a]
        touched[node] = mask
    found: list[int] = []
    for nodes, own in together:
        mask = reduce(or_, (touched[node] for node in nodes), own)
        apart = [other for other in found if not other & mask]
        found = [*apart, reduce(or_, (o for o in found if o & mask), mask)]
    n = range(len(e.q))
    return sorted([j for j in n if mask >> j & 1] for mask in found)


def _bits(indices: Iterable[int]) -> int:
    return reduce(or_, (1 << j for j in indices), 0)


def subsystems(equations: Equations, start: Instant) -> list[Subsystem]:
    """Give the subsystems of equations that `refusal` does not refuse."""
    return [_part(equations, start, group) for group in groups(equations)]


def _part(e: Equations, start: Instant, group: Sequence[int]) -> Subsystem:
    g = e.graph
    place = {j: i for i, j in enumerate(group)}

    def vector(x: SparseVector) -> SparseVector:
        kept = {place[j]: node for j, node in x.entries.items()}
        return SparseVector(g, len(group), kept)

    # What energies hold of the others is a constant: they stand at their start values.
    fixed: dict[str, float] = {}
    for j, (name, rate) in enumerate(zip(e.q, e.velocities, strict=True)):
        if j not in place:
            fixed |= {name: float(start.q[j]), rate: float(start.v[j])}
    new = {g.variable(name): g.variable(f"start.{name}") for name in fixed}
    energy, kinetic_form = g.substitute([e.energy, e.kinetic_form], new)
    added = [Parameter(f"start.{name}", value) for name, value in fixed.items()]
    part = replace(
        e,
        model=_model(e.model, group, added, g.zero),
        q=tuple(e.q[j] for j in group),
        velocities=tuple(e.velocities[j] for j in group),
        M=tuple(vector(e.M[j]) for j in group),
        f=tuple(e.f[j] for j in group),
        rows=tuple(
            replace(row, A=vector(row.A))
            for row in e.rows
            if any(j in place for j in row.A.entries)
        ),
        momenta=tuple(e.momenta[j] for j in group),
        energy=energy,
        kinetic_form=kinetic_form,
    )
    return Subsystem(tuple(group), part, start_at(part, part_of(start, group)))


def _model(
    model: Model, group: Sequence[int], added: Sequence[Parameter], zero: int
) -> Model:
    """Give a model without what looks at other groups."""
    return replace(
        model,
        parameters=(*model.parameters, *added),
        coordinates=tuple(model.coordinates[j] for j in group),
        definitions=(),
        lagrangian=zero,
        kinetic=None,
        potential=None,
        scene=Scene({}),
        output=Output(()),
    )


def saving(equations: Equations, parts: Sequence[Subsystem], duration: float) -> float:
    """Give about how many operations it saves to integrate the parts apart."""
    if len(equations.q) > LARGEST:
        return -np.inf
    steps = duration / RADIANS
    paces = [pace(part) for part in parts]
    apart = sum(
        p * step_cost(part.equations) for p, part in zip(paces, parts, strict=True)
    )
    return float(
        steps * (max(paces) * step_cost(equations) - apart) - COMPILING * len(parts)
    )


def pace(part: Subsystem) -> float:
    """Give the largest rate of the motion near its start, in radians per unit time.

    The largest eigenvalue of dy'/dy, from differences; 0 where there is none.
    """
    e = part.equations
    try:
        nodes = Elimination(e).motion()[0]
    except TooLongError:
        return 0.0
    point = Point(e, part.start.t)
    n = len(e.q)
    y = np.concatenate([part.start.q, part.start.v])

    def rates(y: Floats) -> Floats:
        values = point.values(y[:n], y[n:])
        return np.array([*y[n:], *evaluate(e.graph, nodes, values)])

    size = np.maximum(np.abs(y), np.max(np.abs(y), initial=1e-3))
    J = np.empty((2 * n, 2 * n))
    for j in range(2 * n):
        change = np.zeros(2 * n)
        change[j] = NUDGE * size[j]
        J[:, j] = (rates(y + change) - rates(y - change)) / (2.0 * change[j])
    if not np.all(np.isfinite(J)):
        return 0.0
    return float(np.max(np.abs(np.linalg.eigvals(J)), initial=0.0))
