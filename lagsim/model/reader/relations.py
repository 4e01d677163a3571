"""Relations: constraints with their laws, and `until`."""

from __future__ import annotations

from typing import TYPE_CHECKING

from lagsim.language.roots import simple_root
from lagsim.model.model import Constraint, Level, OneSided, Relation, Sense
from lagsim.model.nodes import Broken, Mapping, Node, Scalar, Sequence
from lagsim.model.reader.dynamics import affine
from lagsim.model.reader.expressions import NUMBERS, STATE
from lagsim.model.reader.fields import Fields, entries, fields
from lagsim.model.reader.names import Kind, check_name

if TYPE_CHECKING:
    from lagsim.language.parser import ParsedRelation
    from lagsim.model.reader.expressions import Expressions
    from lagsim.model.reader.fields import Entry

KEYS = ("relation", "restitution", "friction", "slip", "description")
_LAW = ("restitution", "friction", "slip")


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


def read_law(entry: Entry, x: Expressions) -> OneSided | None:
    """Build the law of a constraint that is one-sided."""
    found = _constraint(*entry, x)
    return None if found is None else found.law


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
    law = None
    if sense is Sense.EQUAL:
        _check_no_law(below, what, x)
        relation = relation and _once(relation, x)
    elif isinstance(node, Mapping) or sense is Sense.AT_LEAST:
        if relation is not None:
            _check_no_velocity(expression, what, x)
        law = _law(below, what, x, known=sense is not None)
    if relation is None or (law is None and sense is Sense.AT_LEAST):
        return None
    return Constraint(key.text, relation, law, about)


def _once(relation: Relation, x: Expressions) -> Relation:
    """Take a multiple root once."""
    moving = (Kind.COORDINATE, Kind.VELOCITY)
    names = {n for n, kind in x.names.variables.items() if kind in moving}
    names |= {f"{n}_dot" for n in names}
    root = simple_root(x.graph, relation.node, names)
    return relation._replace(node=root, multiple=root != relation.node)


def _check_no_law(below: Fields, what: str, x: Expressions) -> None:
    for key in _LAW:
        if key in below:
            text = f"{what} is an equality and has no `{key}`"
            hint = "a contact is one-sided: write its relation with `>=` or `<=`"
            x.faults.add("not-one-sided", text, below.place_of(key), hint)


def _check_no_velocity(expression: Node, what: str, x: Expressions) -> None:
    """Report velocities in a one-sided relation, where each stands."""
    assert isinstance(expression, Scalar)
    parsed = x.parse_relation(expression)
    assert parsed is not None
    allowed = STATE - {Kind.VELOCITY, Kind.RATE}
    x.check(parsed.names, expression, f"{what}, being one-sided,", allowed)


def _law(below: Fields, what: str, x: Expressions, *, known: bool) -> OneSided | None:
    """Build the law of a contact; `known` tells that it is one."""
    restitution = _number(below, "restitution", what, x)
    if restitution is not None and not 0 <= restitution <= 1:
        node = below.value("restitution")
        text = f"the restitution of {what} is {restitution:g}, outside of 0 to 1"
        x.faults.add("out-of-range", text, node.place if node else below.place)
    if known and "restitution" not in below:
        text = f"{what} is one-sided and has no `restitution`"
        hint = "0 stays down, 1 bounces back: {relation: ..., restitution: 0}"
        x.faults.add("missing-key", text, below.place, hint)
    friction = _friction(below, what, x)
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
    return OneSided(restitution, friction, slips)


def _number(below: Fields, key: str, what: str, x: Expressions) -> float | None:
    node = below.value(key)
    return None if node is None else x.number(node, f"the {key} of {what}")


def _friction(below: Fields, what: str, x: Expressions) -> int | None:
    node = below.value("friction")
    if node is None:
        return None
    value = _number(below, "friction", what, x)
    if value is None:
        return None
    if value < 0:
        text = f"the friction of {what} is {value:g}, which is negative"
        x.faults.add("out-of-range", text, node.place)
    compiled = x.compile(node, what, NUMBERS)
    return compiled[0] if compiled else None


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
    elif not affine(slip, x):
        text = f"{what} is not affine in the velocities"
        hint = "a sum of velocities times what depends on positions would do"
        x.faults.add("not-affine", text, node.place, hint)
    return slip
