"""Subsystems that do not touch: groups of coordinates, each with equations of its own.

Two coordinates touch where one stands in an entry of M, a force or a constraint of the
other. Groups that do not are integrated apart, each with its own steps.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lagsim.admissibility.examination import start_at
from lagsim.mechanics.equations import Instant, coordinates_of, groups, shared
from lagsim.mechanics.linearisation import Linearisation
from lagsim.mechanics.reduction import of_those_left, vector
from lagsim.model.model import Output, Parameter, Scene
from lagsim.plan.formulation import step_cost

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from lagsim.admissibility.examination import Start
    from lagsim.mechanics.constraints import Row
    from lagsim.mechanics.equations import Equations
    from lagsim.model.model import Model

# With more coordinates than this nobody looks, unasked, how fast the subsystems are.
LARGEST = 40
# Compiling and linking a subsystem takes as long as this many operations.
COMPILING = 1e8
# Radians of its fastest motion that a step of order 8 takes at the default tolerance.
RADIANS = 1.0


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
        """Subsystem's part of a state of the whole."""
        return part_of(whole, self.coordinates)


def part_of(whole: Instant, coordinates: Iterable[int]) -> Instant:
    """State of some of the coordinates."""
    chosen = list(coordinates)
    return Instant(whole.t, whole.q[chosen], whole.v[chosen], whole.s)


def refusal(equations: Equations) -> str:
    """Say why subsystems cannot be integrated apart, or return ""."""
    if equations.works or equations.quadratures:
        return "work and action depend on all of them"
    if equations.model.until:
        return "`until` depends on all of them"
    if equations.model.events:
        return "events depend on all of them"
    if len(groups(equations)) < 2:
        return "all coordinates are coupled"
    return ""


def subsystems(equations: Equations, start: Instant) -> list[Subsystem]:
    """Subsystems of equations that `refusal` does not refuse."""
    found = groups(equations)
    energies, _ = shared(equations, found, equations.energy)
    forms, _ = shared(equations, found, equations.kinetic_form)
    group_of = {j: i for i, group in enumerate(found) for j in group}
    rows: list[list[Row]] = [[] for _ in found]
    for row in equations.rows:
        if row.A.entries:
            rows[group_of[min(row.A.entries)]].append(row)
    names = coordinates_of(equations)
    return [
        _part(replace(equations, energy=h, kinetic_form=form), start, own, names, group)
        for group, own, h, form in zip(found, rows, energies, forms, strict=True)
    ]


def _part(
    e: Equations,
    start: Instant,
    rows: Iterable[Row],
    names: Mapping[str, int],
    group: Sequence[int],
) -> Subsystem:
    g = e.graph
    # What its energies still hold of the others is a constant: at their start values.
    fixed: dict[str, float] = {}
    for name in sorted(g.depends([e.energy, e.kinetic_form]) & names.keys()):
        j = names[name]
        if j not in group:
            value = start.q[j] if name == e.q[j] else start.v[j]
            fixed[name] = float(value)
    new = {g.variable(name): g.variable(f"start.{name}") for name in fixed}
    energy, kinetic_form = g.substitute([e.energy, e.kinetic_form], new)
    added = [Parameter(f"start.{name}", value) for name, value in fixed.items()]
    part = replace(
        of_those_left(e, group, e.mass_entries, e.f, e.momenta),
        model=_model(e.model, group, added, g.zero),
        rows=tuple(x._replace(A=vector(g, group, x.A.entries)) for x in rows),
        energy=energy,
        kinetic_form=kinetic_form,
    )
    return Subsystem(tuple(group), part, start_at(part, part_of(start, group)))


def _model(
    model: Model, group: Sequence[int], added: Sequence[Parameter], zero: int
) -> Model:
    """Model without outputs that depend on other groups."""
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
    """Return about how many operations it saves to integrate the parts apart."""
    steps = duration / RADIANS
    paces = [pace(part) for part in parts]
    whole = steps * max(paces) * step_cost(equations) - COMPILING * len(parts)
    if not whole > 0.0:  # whatever the parts cost
        return float(whole)
    apart = sum(
        p * step_cost(part.equations) for p, part in zip(paces, parts, strict=True)
    )
    return float(whole - steps * apart)


def pace(part: Subsystem) -> float:
    """Return the largest rate of the motion near its start, in radians per unit time.

    0 where there is none, or it overflows.
    """
    start = part.start
    try:
        with np.errstate(over="ignore", invalid="ignore"):
            linear = Linearisation(part.equations).at(start.t, start.q, start.v)
        values = linear.eigenvalues()
    except (ValueError, np.linalg.LinAlgError):
        return 0.0
    return float(np.max(np.abs(values), initial=0.0))
