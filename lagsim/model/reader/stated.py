"""The numbers of a file, evaluated again for other values or other coordinates.

Parameters, laws, start values and settings: what is built of names alone, the graph and
every expression on it, stays.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, NamedTuple

from lagsim.errors import InputError, Problem
from lagsim.model.model import Coordinate, Level, Separation
from lagsim.model.nodes import Mapping, Scalar, Sequence, argument
from lagsim.model.reader.equations import (
    again,
    read_constraints,
    read_energies,
    read_forces,
)
from lagsim.model.reader.expressions import Expressions
from lagsim.model.reader.fields import Faults
from lagsim.model.reader.names import Kind
from lagsim.model.reader.simulation import read_settings
from lagsim.model.reader.values import (
    TARGETS,
    Definitions,
    Initial,
    Parameters,
    Value,
    words,
)

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator
    from collections.abc import Mapping as MappingType

    from lagsim.errors import Place
    from lagsim.model.model import InitialValue, Model, Parameter, Settings
    from lagsim.model.nodes import Node
    from lagsim.model.reader.fields import Entry, Fields
    from lagsim.model.reader.names import Names


# --- The model read again with some of its definitions as coordinates of their own
#
# By their names, not by what they are: where the file writes `x` the separated model
# has `x`, and where it writes what `x` denotes, that.


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


class Sections(NamedTuple):
    """The sections of a file that are read again, and where the file begins."""

    parameters: list[Entry]
    definitions: list[Entry]
    energy: Fields
    forces: Node | None
    constraints: list[Entry]
    initial: Entry | None
    simulation: Fields
    root: Place


def _starts(name: str, names: Names) -> bool:
    """Tell whether a name has a start value, not a parameter's."""
    meaning = names.meaning(name)
    return meaning is not None and meaning.kind in TARGETS


def _leaves(name: str, node: Node) -> Iterator[tuple[str, Scalar]]:
    """Give the scalars at a key and below it, each by the keys that lead to it."""
    if isinstance(node, Scalar):
        yield name, node
    elif isinstance(node, Mapping):
        for key, value in node.entries:
            yield from _leaves(f"{name}.{key.text}", value)
    elif isinstance(node, Sequence):
        for k, item in enumerate(node.items, 1):
            yield from _leaves(f"{name}.{k}", item)


@dataclass(frozen=True, slots=True)
class Stated:
    """The sections with what was said instead of them.

    Attributes
    ----------
    x : Expressions
        Of the file: its graph, its definitions, and the values of this binding.
    instead, starting, options : dict of str to str
        Expressions that stand for those of parameters, of start values and of keys of
        `simulation`.
    """

    file: str
    sections: Sections
    x: Expressions
    instead: MappingType[str, str]
    options: MappingType[str, str]
    starting: MappingType[str, str] = field(default_factory=dict)

    @classmethod
    def of(
        cls,
        file: str,
        sections: Sections,
        x: Expressions,
        overrides: MappingType[str, str],
        options: MappingType[str, str],
    ) -> Stated:
        """Take the overrides apart: those of start values, and all others."""
        starting = {k: text for k, text in overrides.items() if _starts(k, x.names)}
        instead = {k: text for k, text in overrides.items() if k not in starting}
        return cls(file, sections, x, instead, options, starting)

    def parameters(self) -> tuple[tuple[Parameter, ...], dict[str, Value]]:
        """Give the parameters, and what is known of each; faults go to those of `x`."""
        reader = Parameters(self.x, self.instead)
        return reader.read(self.sections.parameters), reader.values

    def initial(self, known: MappingType[str, Value]) -> tuple[InitialValue, ...]:
        """Give the start values; faults go to those of `x`."""
        reader = Initial(self.x, known, self.starting)
        return reader.read(self.sections.initial, self.sections.root)

    def settings(self, options: MappingType[str, str]) -> Settings:
        """Give the settings, see `Model.settings`."""
        faults = Faults(self.file)
        found = self.asked(self.x.over(faults, self.x.values), options)
        faults.raise_if_any()
        return found

    def asked(self, x: Expressions, options: MappingType[str, str]) -> Settings:
        """Evaluate the settings; faults go to those of `x`."""
        return read_settings(self.sections.simulation, {**self.options, **options}, x)

    def bound(
        self,
        model: Model,
        parameters: MappingType[str, str],
        initial: MappingType[str, str],
    ) -> Model:
        """Give a model of this file with other values, see `Model.bind`."""
        faults = Faults(self.file)
        new = replace(
            self,
            x=self.x.over(faults, {}),
            instead={**self.instead, **parameters},
            starting={**self.starting, **initial},
        )
        values, known = new.parameters()
        constraints = zip(model.constraints, self.sections.constraints, strict=True)
        laws = tuple(again(c, entry, new.x) for c, entry in constraints)
        starts = new.initial(known)
        faults.raise_if_any()
        return replace(
            model, parameters=values, constraints=laws, initial=starts, stated=new
        )

    def rests_on(self, names: Collection[str]) -> bool:
        """Tell whether other numbers rest on these, see `Model.rests_on`."""
        s = self.sections
        given = {key.text: node for key, node in s.parameters}
        if s.initial is not None and isinstance(s.initial[1], Mapping):
            given |= {key.text: node for key, node in s.initial[1].entries}
        own = (self.instead, self.starting, self.options)
        instead = {name: argument("", x) for said in own for name, x in said.items()}
        given |= {key: node for key, (_, node) in s.simulation.found.items()}
        others = (x for name, x in {**given, **instead}.items() if name not in names)
        return not words(*others).isdisjoint(names)

    def texts(self) -> dict[str, Scalar]:
        """Give the expressions of energies, forces and constraints, as `forces.x`."""
        s = self.sections
        below = {
            "definitions": s.definitions,
            "energy": list(s.energy.found.values()),
            "forces": s.forces.entries if isinstance(s.forces, Mapping) else (),
            "constraints": s.constraints,
        }
        given = ((k, entry) for k, found in below.items() for entry in found)
        return {
            name: text
            for section, (key, node) in given
            for name, text in _leaves(f"{section}.{key.text}", node)
        }

    def numbers(self) -> list[str]:
        """Give the expressions that parameters and start values are given by."""
        given = [*self.sections.parameters]
        start = self.sections.initial
        if start is not None and isinstance(start[1], Mapping):
            given += start[1].entries
        found = [*self.instead.values(), *self.starting.values()]
        for key, node in given:
            below = node.entries if isinstance(node, Mapping) else ()
            nodes = [node, *(v for k, v in below if k.text in ("value", "guess"))]
            if key.text not in self.instead and key.text not in self.starting:
                found += [n.text for n in nodes if isinstance(n, Scalar)]
        return found

    def separated(self, model: Model) -> Separation:
        """Give `model` in other coordinates, see `Model.separated`."""
        s = self.sections
        return separated(
            model, s.definitions, s.energy, s.forces, s.constraints, self.x
        )
