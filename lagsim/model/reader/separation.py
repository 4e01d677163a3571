"""The model read again with some of its definitions as coordinates of their own.

By their names, not by what they are: where the file writes `x` the separated model has
`x`, and where it writes what `x` stands for, that.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from lagsim.errors import InputError, Problem
from lagsim.model.model import Coordinate, Level, Separation
from lagsim.model.reader.definitions import Definitions
from lagsim.model.reader.dynamics import read_energies, read_forces
from lagsim.model.reader.expressions import Expressions
from lagsim.model.reader.faults import Faults
from lagsim.model.reader.names import Kind
from lagsim.model.reader.relations import read_constraints

if TYPE_CHECKING:
    from lagsim.model.model import Model
    from lagsim.model.nodes import Node
    from lagsim.model.reader.fields import Entry, Fields


def separated(
    model: Model,
    definitions: list[Entry],
    energy: Fields,
    forces: Node | None,
    constraints: list[Entry],
    known: Expressions,
) -> Separation:
    """Read sections of a sound file again; `known` are its expressions.

    Raises
    ------
    InputError
        Where a constraint is met as the root of another relation then.
    """
    held = dict.fromkeys(model.output.reactions, Kind.COORDINATE)
    names = replace(known.names, variables={**known.names.variables, **held})
    faults = Faults(model.file)
    x = Expressions(known.graph, names, faults)
    x.values = known.values
    Definitions(definitions, x).build(Level.POSITION, Level.VELOCITY)
    energies = read_energies(energy, x)
    working = read_forces(forces, x)
    laws = read_constraints(constraints, x)
    faults.raise_if_any()
    units = {d.name: d.unit for d in model.definitions}
    expressions = {name: x.definitions[name].node for name in held}
    assert energies.lagrangian is not None
    found = replace(
        model,
        coordinates=(*model.coordinates, *(Coordinate(n, units[n]) for n in held)),
        lagrangian=energies.lagrangian,
        kinetic=energies.kinetic,
        potential=energies.potential,
        dissipation=energies.dissipation,
        forces=working,
        constraints=laws,
    )
    _check_roots(model, found)
    return Separation(found, {k: n for k, n in expressions.items() if n is not None})


def _check_roots(model: Model, found: Model) -> None:
    """Refuse multipliers that are those of other relations than the separated ones."""
    g = model.graph
    new = {g.variable(d.name): d.node for d in model.definitions}
    for one, other in zip(model.constraints, found.constraints, strict=True):
        if not one.relation.multiple and not other.relation.multiple:
            continue
        if g.substitute([other.relation.node], new) != [one.relation.node]:
            text = f"`{one.name}` vanishes as a power, with its gradient; its "
            text += (
                "multiplier does not give the definitions in `output.reactions` a "
                "reaction"
            )
            hint = "write the relation with a simple zero"
            place = one.relation.place
            raise InputError([Problem("multiple-root", text, place, hint)])
