"""Relations: constraints, and `until`."""

from __future__ import annotations

from typing import TYPE_CHECKING

from lagsim.model.model import Constraint, OneSided, Relation, Sense
from lagsim.model.nodes import Broken, Mapping, Node, Scalar
from lagsim.model.reader import laws
from lagsim.model.reader.expressions import STATE
from lagsim.model.reader.fields import (
    EXPRESSION,
    PLAIN,
    Fields,
    described,
    either,
    entries,
    fields,
    keyed,
)
from lagsim.model.reader.names import Kind, check_name, naming

if TYPE_CHECKING:
    from lagsim.language.parser import ParsedRelation
    from lagsim.model.reader.expressions import Expressions
    from lagsim.model.reader.fields import Entry

KEYS = {
    "relation": described("lhs = rhs, lhs <= rhs or lhs >= rhs.", EXPRESSION),
    **laws.KEYS,
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
    when = laws.read_when(below, what, x)
    if sense is Sense.EQUAL:
        laws.check_equality(below, what, x)
        relation = relation and _once(relation, x)
        limit = laws.read_limit(below, relation, what, x)
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
        return laws.read_contact(below, what, x, known=False)
    laws.check_one_sided(below, what, x)
    if laws.between_velocities(relation, x):
        bounces = any(key in below for key in laws.CONTACT)
        if not bounces or laws.is_freewheel(relation, x):
            return laws.read_freewheel(below, relation, what, x)
        _check_no_velocity(expression, what, x)
    return laws.read_contact(below, what, x, known=True)


def _once(relation: Relation, x: Expressions) -> Relation:
    """Take a multiple root once."""
    from lagsim.language.roots import simple_root

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
