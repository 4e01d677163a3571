"""Laws of constraints: restitution and friction, `limit`, `when`."""

from __future__ import annotations

from typing import TYPE_CHECKING

from lagsim.model.model import Level, OneSided
from lagsim.model.nodes import Mapping, Node, Sequence
from lagsim.model.reader.dynamics import degrees, is_affine
from lagsim.model.reader.expressions import NUMBERS, STATE
from lagsim.model.reader.fields import (
    EXPRESSION,
    described,
    either,
    fields,
    keyed,
    listed,
    listing,
)
from lagsim.model.reader.names import Kind

if TYPE_CHECKING:
    from lagsim.model.model import Relation
    from lagsim.model.reader.expressions import Expressions
    from lagsim.model.reader.fields import Fields

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
KEYS = {
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
