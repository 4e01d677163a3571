"""Energies, forces and constraints with their laws; `until`."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from lagsim.model.model import Constraint, Force, Level, OneSided, Relation, Sense
from lagsim.model.nodes import Broken, Mapping, Node, Scalar, Sequence
from lagsim.model.reader.expressions import NUMBERS, STATE
from lagsim.model.reader.fields import (
    EXPRESSION,
    PLAIN,
    Fields,
    described,
    either,
    entries,
    fields,
    keyed,
    listed,
    listing,
)
from lagsim.model.reader.names import Kind, check_name, naming

if TYPE_CHECKING:
    from lagsim.errors import Place
    from lagsim.language.parser import ParsedRelation
    from lagsim.model.reader.expressions import Expressions
    from lagsim.model.reader.fields import Entry, Faults


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


# --- Laws of constraints: restitution and friction, `limit`, `when`

FRICTION = {
    "static": described(
        "Coefficient of what sticks, at least that of sliding.", EXPRESSION
    ),
    "dynamic": described("Coefficient of what slides.", EXPRESSION),
}
CONTACT = {
    "restitution": described(
        "Of a one-sided relation between positions: 0 stays down, 1 bounces back.",
        EXPRESSION,
    ),
    "friction": described(
        "Coefficient of friction; needs `slip`.",
        either(EXPRESSION, keyed(FRICTION, FRICTION)),
    ),
    "slip": described(
        "The sliding velocity that friction opposes: one expression, or two.",
        either(EXPRESSION, listing(EXPRESSION, 1, 2)),
    ),
}
LAW_KEYS = {
    **CONTACT,
    "limit": described(
        "Of an equality between velocities: the largest size of its multiplier, past "
        "which it slips.",
        EXPRESSION,
    ),
    "when": described(
        "In force while this condition, of t and parameters, is true.", EXPRESSION
    ),
}


def between_velocities(relation: Relation, x: Expressions) -> bool:
    """Tell whether a relation contains a velocity."""
    velocities = {f"{q}_dot" for q in x.names.of(Kind.COORDINATE)}
    return not velocities.isdisjoint(x.graph.depends([relation.node]))


def is_freewheel(relation: Relation, x: Expressions) -> bool:
    """Tell whether a relation is linear and homogeneous in the velocities."""
    return degrees(relation.node, x) == frozenset((1,))


def check_equality(below: Fields, what: str, x: Expressions) -> None:
    """Report what only a contact has."""
    for key in CONTACT:
        if key in below:
            text = f"{what} is an equality and has no `{key}`"
            hint = "a contact is one-sided: write its relation with `>=` or `<=`"
            x.faults.add("not-one-sided", text, below.place_of(key), hint)


def check_one_sided(below: Fields, what: str, x: Expressions) -> None:
    """Report what only an equality has."""
    if "limit" in below:
        text = f"{what} is one-sided and has no `limit`"
        hint = "an equality has one: write its relation with `=`"
        x.faults.add("not-an-equality", text, below.place_of("limit"), hint)


def read_limit(
    below: Fields, relation: Relation | None, what: str, x: Expressions
) -> int | None:
    """Build the largest size of the multiplier of an equality between velocities."""
    node = below.value("limit")
    if node is None:
        return None
    if relation is not None and not between_velocities(relation, x):
        text = f"{what} contains no velocity and has no `limit`"
        hint = "write its rate: `x_dot = 0` holds what `x = 0` does, and can slip"
        x.faults.add("not-a-velocity", text, below.place_of("limit"), hint)
    of = f"the limit of {what}"
    compiled = x.compile(node, of, STATE)
    if compiled is None:
        return None
    if x.graph.depends([compiled[0]]) <= x.values.keys():
        _not_negative(node, of, x)
    return compiled[0]


def read_when(below: Fields, what: str, x: Expressions) -> int | None:
    """Build the condition under which a constraint is in force, as 1 or 0."""
    node = below.value("when")
    if node is None:
        return None
    of = f"the `when` of {what}"
    compiled = x.compile(node, of, STATE, condition=True)
    if compiled is None:
        return None
    g = x.graph
    fixed = {"t", *x.names.of(Kind.PARAMETER)}
    moving = sorted(g.depends([compiled[0]]) - fixed)
    if moving:
        text = f"{of} depends on {listed(moving)}; it must not depend on the motion"
        hint = "it is a condition of t and parameters, such as t < 1"
        x.faults.add("not-of-time", text, node.place, hint)
    return g.call("if", compiled[0], g.one, g.zero)


def read_freewheel(
    below: Fields, relation: Relation, what: str, x: Expressions
) -> OneSided | None:
    """Give the law of a one-sided relation between velocities."""
    if not is_freewheel(relation, x):
        text = f"{what} is one-sided, and not homogeneous in the velocities"
        hint = "a freewheel is, as `b_dot >= a_dot`; a contact is between positions"
        x.faults.add("not-homogeneous", text, relation.place, hint)
        return None
    for key in CONTACT:
        if key in below:
            text = f"{what} is between velocities and has no `{key}`"
            hint = "a freewheel engages inelastically and without friction"
            x.faults.add("not-a-contact", text, below.place_of(key), hint)
    return OneSided(0.0)


def read_contact(
    below: Fields, what: str, x: Expressions, *, known: bool
) -> OneSided | None:
    """Build the law of a contact; `known` tells that it is one."""
    restitution = _number(below, "restitution", what, x)
    if restitution is not None and not 0 <= restitution <= 1:
        node = below.value("restitution")
        text = f"the restitution of {what} is {restitution:g}, outside of 0 to 1"
        x.faults.add("out-of-range", text, node.place if node else below.place)
    if known and "restitution" not in below:
        text = f"{what} is one-sided and has no `restitution`"
        hint = "write {relation: ..., restitution: 0}: 0 stays down, 1 bounces back"
        x.faults.add("missing-key", text, below.place, hint)
    dynamic, static = _friction(below, what, x)
    slips = _slips(below, what, x)
    if "friction" in below and "slip" not in below:
        text = f"{what} has `friction` but no `slip`"
        hint = "`slip` is the sliding velocity that friction opposes"
        x.faults.add("missing-key", text, below.place_of("friction"), hint)
    if "slip" in below and "friction" not in below:
        text = f"{what} has `slip` but no `friction`"
        x.faults.add("missing-key", text, below.place_of("slip"), "give `friction: mu`")
    if restitution is None:
        return None
    return OneSided(restitution, dynamic, slips, static)


def _number(below: Fields, key: str, what: str, x: Expressions) -> float | None:
    node = below.value(key)
    return None if node is None else x.number(node, f"the {key} of {what}")


def _not_negative(node: Node, what: str, x: Expressions) -> float | None:
    """Give the value of an expression of parameters; a negative one is a fault."""
    value = x.number(node, what)
    if value is not None and value < 0:
        text = f"{what} is {value:g}, which is negative"
        x.faults.add("out-of-range", text, node.place)
    return value


def _friction(
    below: Fields, what: str, x: Expressions
) -> tuple[int | None, int | None]:
    """Build the coefficient of what slides, and of what sticks where it differs."""
    node = below.value("friction")
    if node is None:
        return None, None
    if not isinstance(node, Mapping):
        return _coefficient(node, f"the friction of {what}", x)[0], None
    place = below.place_of("friction")
    given = fields(node, f"the friction of {what}", FRICTION, x.faults, place)
    found: list[tuple[int | None, float | None]] = []
    for key in FRICTION:
        part = given.value(key)
        if part is None:
            text = f"the friction of {what} has no `{key}`"
            hint = "{static: ..., dynamic: ...}, or one number for both"
            x.faults.add("missing-key", text, place, hint)
            found.append((None, None))
        else:
            found.append(_coefficient(part, f"the {key} friction of {what}", x))
    (sticking, most), (sliding, least) = found
    if most is not None and least is not None and most < least:
        text = (
            f"the static friction of {what} is {most:g}, less than the dynamic one, "
            f"{least:g}"
        )
        below_static = given.value("static")
        assert below_static is not None
        hint = "what sticks holds at least what sliding does"
        x.faults.add("out-of-range", text, below_static.place, hint)
    return sliding, sticking


def _coefficient(
    node: Node, what: str, x: Expressions
) -> tuple[int | None, float | None]:
    """Give the node of a coefficient, and its value."""
    value = _not_negative(node, what, x)
    compiled = None if value is None else x.compile(node, what, NUMBERS)
    return (compiled[0] if compiled else None), value


def _slips(below: Fields, what: str, x: Expressions) -> tuple[int, ...]:
    node = below.value("slip")
    if node is None:
        return ()
    parts = node.items if isinstance(node, Sequence) else (node,)
    if len(parts) not in (1, 2):
        text = f"the slip of {what} must be one expression or two, found {len(parts)}"
        x.faults.add("wrong-count", text, node.place)
        return ()
    found = (_slip(part, f"the slip of {what}", x) for part in parts)
    return tuple(slip for slip in found if slip is not None)


def _slip(node: Node, what: str, x: Expressions) -> int | None:
    compiled = x.compile(node, what, STATE)
    if compiled is None:
        return None
    slip, level = compiled
    if level is not Level.VELOCITY:
        text = f"{what} contains no velocity"
        x.faults.add("not-affine", text, node.place, "it is a sliding velocity")
    elif not is_affine(slip, x):
        text = f"{what} is not affine in the velocities"
        hint = "a sum of velocities times what depends on positions would do"
        x.faults.add("not-affine", text, node.place, hint)
    return slip


# --- Relations: constraints, and `until`

KEYS = {
    "relation": described("lhs = rhs, lhs <= rhs or lhs >= rhs.", EXPRESSION),
    **LAW_KEYS,
    "description": described("Plain text.", PLAIN),
}
_LAW = {
    **keyed(KEYS, ["relation"]),
    "dependencies": {"friction": ["slip"], "slip": ["friction"]},
}
FORM = naming(described("A relation, or one with a law.", either(EXPRESSION, _LAW)))


def declared_constraints(node: Node | None, x: Expressions) -> list[Entry]:
    """Give the constraints whose names are good, and declare these."""
    if node is None:
        return []
    found = []
    for entry in entries(node, "`constraints`", x.faults):
        if check_name(entry[0], "a constraint", x.faults):
            found.append(entry)
            x.names.constraints.append(entry[0].text)
        else:
            x.names.faulty.add(entry[0].text)
    return found


def read_relation(
    node: Node, what: str, x: Expressions
) -> tuple[Relation | None, Sense | None]:
    """Build a relation.

    Returns
    -------
    relation : Relation or None
        None where a fault was reported.
    sense : Sense or None
        None where not even that is known.
    """
    scalar = x.scalar(node, what)
    parsed = x.parse_relation(scalar) if scalar else None
    if scalar is None or parsed is None:
        return None, None
    sense = Sense.EQUAL if parsed.sense == "=" else Sense.AT_LEAST
    if x.check(parsed.names, scalar, what, STATE) is None:
        return None, sense
    gap = _gap(parsed, x)
    kinds = x.names.variables
    used = (kinds.get(n.removesuffix("_dot")) for n in x.graph.depends([gap]))
    if Kind.COORDINATE not in used:
        text = f"{what} depends on no coordinate and no velocity"
        hint = "a time to stop at is `end` or `duration`" if what == "`until`" else ""
        x.faults.add("no-coordinate", text, scalar.place, hint)
        return None, sense
    text = " ".join(scalar.text.split())
    return Relation(gap, sense, text, scalar.place), sense


def _gap(parsed: ParsedRelation, x: Expressions) -> int:
    left = x.build(parsed.left)
    if parsed.right is None:
        return left
    right = x.build(parsed.right)
    if parsed.sense == "<=":
        return x.graph.call("sub", right, left)
    return x.graph.call("sub", left, right)


def read_constraints(given: list[Entry], x: Expressions) -> tuple[Constraint, ...]:
    """Build the constraints."""
    found = (_constraint(key, node, x) for key, node in given)
    return tuple(c for c in found if c is not None)


def again(found: Constraint, entry: Entry, x: Expressions) -> Constraint:
    """Give a constraint of the file at other values of the parameters."""
    return found if found.always else (_constraint(*entry, x) or found)


def _constraint(key: Scalar, node: Node, x: Expressions) -> Constraint | None:
    what = f"the constraint `{key.text}`"
    below = Fields({}, key.place, sound=False)
    expression: Node | None = node
    if isinstance(node, Mapping):
        below = fields(node, what, KEYS, x.faults, key.place)
        expression = below.value("relation")
    if expression is None:
        x.faults.add("missing-key", f"{what} has no `relation`", key.place)
        expression = Broken(key.place)
    relation, sense = read_relation(expression, what, x)
    about = below.text("description", x.faults)
    law = limit = None
    when = read_when(below, what, x)
    if sense is Sense.EQUAL:
        check_equality(below, what, x)
        relation = relation and _once(relation, x)
        limit = read_limit(below, relation, what, x)
    elif isinstance(node, Mapping) or sense is Sense.AT_LEAST:
        law = _one_sided(expression, below, relation, what, x)
    if relation is None or (law is None and sense is Sense.AT_LEAST):
        return None
    return Constraint(key.text, relation, law, about, limit, when)


def _one_sided(
    expression: Node,
    below: Fields,
    relation: Relation | None,
    what: str,
    x: Expressions,
) -> OneSided | None:
    """Build the law of what is one-sided, or whose relation is not known."""
    if relation is None:
        return read_contact(below, what, x, known=False)
    check_one_sided(below, what, x)
    if between_velocities(relation, x):
        bounces = any(key in below for key in CONTACT)
        if not bounces or is_freewheel(relation, x):
            return read_freewheel(below, relation, what, x)
        _check_no_velocity(expression, what, x)
    return read_contact(below, what, x, known=True)


def _once(relation: Relation, x: Expressions) -> Relation:
    """Take a multiple root once."""
    from lagsim.language.forms import simple_root

    moving, kinds = (Kind.COORDINATE, Kind.VELOCITY), x.names.variables
    used = x.graph.depends([relation.node])
    names = {n for n in used if kinds.get(n.removesuffix("_dot")) in moving}
    root = simple_root(x.graph, relation.node, names)
    return relation._replace(node=root, multiple=root != relation.node)


def _check_no_velocity(expression: Node, what: str, x: Expressions) -> None:
    """Report velocities in a one-sided relation, where each stands."""
    assert isinstance(expression, Scalar)
    parsed = x.parse_relation(expression)
    assert parsed is not None
    allowed = STATE - {Kind.VELOCITY, Kind.RATE}
    x.check(parsed.names, expression, f"{what}, being one-sided,", allowed)
