"""Energies and forces."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from lagsim.model.model import Force, Level
from lagsim.model.reader.expressions import STATE
from lagsim.model.reader.fields import (
    EXPRESSION,
    Fields,
    described,
    entries,
    fields,
    keyed,
    listed,
)
from lagsim.model.reader.names import Kind, naming

if TYPE_CHECKING:
    from lagsim.errors import Place
    from lagsim.model.nodes import Node, Scalar
    from lagsim.model.reader.expressions import Expressions
    from lagsim.model.reader.faults import Faults
    from lagsim.model.reader.fields import Entry

ENERGY_KEYS = {
    "kinetic": described("The kinetic energy T.", EXPRESSION),
    "potential": described(
        "The potential energy V; where there is none, 0.", EXPRESSION
    ),
    "lagrangian": described("L, instead of `kinetic` and `potential`.", EXPRESSION),
    "dissipation": described(
        "Rayleigh's function F: the force on each coordinate is -dF/dq_dot.", EXPRESSION
    ),
}
ENERGY = {
    **keyed(ENERGY_KEYS),
    "type": "object",
    "oneOf": [
        {"required": ["kinetic", "potential"]},
        {
            "required": ["lagrangian"],
            "properties": {"kinetic": False, "potential": False},
        },
    ],
}
FORCES = naming(
    described(
        "The force p on what the key names, a coordinate or a definition of positions "
        "or linear in the velocities: it does the work p times its change.",
        EXPRESSION,
    )
)


class Energies(NamedTuple):
    """Nodes of the energies; None where the file has none, or a faulty one."""

    lagrangian: int | None
    kinetic: int | None
    potential: int | None
    dissipation: int | None


def energy_fields(entry: Entry | None, faults: Faults, root: Place) -> Fields:
    """Give the section `energy`, its keys checked."""
    if entry is None:
        text = "the file has no `energy`"
        hint = "give `kinetic` and `potential`, or `lagrangian`"
        faults.add("missing-key", text, root, hint)
        return Fields({}, root, sound=False)
    key, node = entry
    found = fields(node, "`energy`", ENERGY_KEYS, faults, key.place)
    if found.sound:
        _check_complete(found, faults)
    return found


def _check_complete(found: Fields, faults: Faults) -> None:
    given = [k for k in ("kinetic", "potential") if k in found]
    if "lagrangian" in found:
        if given:
            beside = " and ".join(f"`{k}`" for k in given)
            text = f"both {beside} and `lagrangian` are given"
            hint = "`lagrangian` replaces `kinetic` and `potential`"
            faults.add("both-given", text, found.place_of("lagrangian"), hint)
    elif not given:
        text = "`energy` has neither `kinetic` and `potential` nor `lagrangian`"
        faults.add("missing-key", text, found.place)
    elif len(given) == 1:
        missing = "potential" if given == ["kinetic"] else "kinetic"
        text = f"`energy` has no `{missing}`"
        hint = f"where there is none, say so: `{missing}: 0`"
        faults.add("missing-key", text, found.place, hint)


def places(found: Fields) -> dict[str, Place]:
    """Give where each energy stands."""
    return {name: node.place for name, (_, node) in found.found.items()}


def read_energies(found: Fields, x: Expressions) -> Energies:
    """Build the energies."""
    nodes: dict[str, int | None] = {}
    for key in ENERGY_KEYS:
        node = found.value(key)
        what = "the dissipation" if key == "dissipation" else f"the {key} energy"
        if key == "lagrangian":
            what = "the Lagrangian"
        compiled = x.compile(node, what, STATE) if node is not None else None
        nodes[key] = compiled[0] if compiled else None
    kinetic, potential, lagrangian, dissipation = (nodes[k] for k in ENERGY_KEYS)
    if kinetic is not None and potential is not None:
        lagrangian = x.graph.call("sub", kinetic, potential)
    x.energies.update(kinetic=kinetic, potential=potential)
    return Energies(lagrangian, kinetic, potential, dissipation)


def read_forces(node: Node | None, x: Expressions) -> tuple[Force, ...]:
    """Build the forces."""
    if node is None:
        return ()
    found = []
    for key, value in entries(node, "`forces`", x.faults):
        direction = _direction(key, x)
        compiled = x.compile(value, f"the force on `{key.text}`", STATE)
        if direction is not None and compiled is not None:
            force, level = compiled[0], direction[1]
            found.append(Force(key.text, force, direction[0], level, value.place))
    return tuple(found)


def _direction(key: Scalar, x: Expressions) -> tuple[int, Level] | None:
    """Give what a force works on: a node, and whether it is a velocity."""
    name, place, faults = key.text, key.place, x.faults
    meaning = x.names.meaning(name)
    if meaning is None:
        if not x.names.is_faulty(name) and x.names.complete:
            names = x.names.of(Kind.COORDINATE) + x.names.of(Kind.DEFINITION)
            hint = faults.did_you_mean(name, names)
            hint = hint or f"a force acts along one of {listed(names)}"
            text = f"there is no coordinate or definition `{name}` to work on"
            faults.add("unknown-name", text, place, hint)
        return None
    if meaning.kind is Kind.COORDINATE:
        return x.graph.variable(name), Level.POSITION
    if meaning.kind is not Kind.DEFINITION:
        text = f"a force cannot work on `{name}`, {meaning.kind.value}"
        hint = "it works on a coordinate or on a definition"
        if meaning.kind in (Kind.VELOCITY, Kind.RATE):
            hint = f"write `{meaning.base}`: a force on `{meaning.base}` has the power "
            hint += f"p*{name}"
        faults.add("not-a-direction", text, place, hint)
        return None
    definition = x.definitions.get(name)
    if definition is None:
        return None
    if definition.level is Level.OUTPUT:
        text = f"a force cannot work on `{name}`: it uses {Level.OUTPUT.value}"
        faults.add("output-only", text, place, "work on positions or velocities")
        return None
    if definition.node is None:
        return None
    if definition.level is Level.VELOCITY and not is_affine(definition.node, x):
        text = f"a force cannot work on `{name}`: it is not linear in the velocities"
        hint = "a sum of velocities times what depends on positions would do"
        faults.add("not-affine", text, place, hint)
        return None
    return definition.node, definition.level


def degrees(node: int, x: Expressions) -> frozenset[int] | None:
    """Give the degrees in the velocities of the terms of a node, see `Graph.degree`."""
    return x.graph.degree(node, {f"{q}_dot" for q in x.names.of(Kind.COORDINATE)})


def is_affine(node: int, x: Expressions) -> bool:
    """Tell whether a node is affine in the velocities."""
    found = degrees(node, x)
    return found is not None and found <= {0, 1}
