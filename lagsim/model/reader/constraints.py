"""Constraints with their laws: equalities, contacts, limits, friction."""

from __future__ import annotations

import math
import re
from typing import TYPE_CHECKING, NamedTuple

from lagsim.codes.known import (
    MISSING_KEY,
    NOT_A_CONTACT,
    NOT_A_MAPPING,
    NOT_A_VELOCITY,
    NOT_AFFINE,
    NOT_AN_EQUALITY,
    NOT_HOMOGENEOUS,
    NOT_OF_TIME,
    NOT_ONE_SIDED,
    OUT_OF_RANGE,
    STATE_MISPLACED,
    SWITCH_AT_REST,
    UNKNOWN_RESTITUTION_LAW,
    WRONG_COUNT,
)
from lagsim.language.at_rest import Bounds, bounds_at_rest
from lagsim.language.derivatives import tangent
from lagsim.language.names import rate_of
from lagsim.language.parser import parse_relation
from lagsim.model.model import (
    APPROACH_SPEED,
    SLIP_SPEED,
    Constraint,
    Level,
    OneSided,
    Relation,
)
from lagsim.model.nodes import (
    Entry,
    Mapping,
    Node,
    Scalar,
    Sequence,
    entries_of,
    items_of,
)
from lagsim.model.reader.equations import (
    SUM_OF_VELOCITIES,
    degrees,
    has_velocity,
    is_affine,
    named,
    read_relation,
)
from lagsim.model.reader.fields import (
    CONSTRAINT,
    CONTACT,
    FRICTION,
    LIMIT,
    Fields,
    entries,
    fields,
    kind_of,
    quoted_list,
)
from lagsim.model.reader.names import NameKind, check_name

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable
    from collections.abc import Sequence as SequenceType

    from lagsim.codes.known import ErrorCode
    from lagsim.errors import Place
    from lagsim.language.graph import Graph
    from lagsim.model.reader.expressions import Expressions


def declared_constraints(node: Node | None, x: Expressions) -> list[Entry]:
    """Declare the names of the section `constraints`; return the valid entries."""
    found = []
    text = node.text if isinstance(node, Scalar) else ""
    named = re.fullmatch(r"(\w+)\s*=([^=]+=?[^=]+)", text)
    if node and named and x.names.meaning(named[1]) is None:
        hint = f"a colon is missing: `{named[1]}: {named[2].strip()}`"
        text = f"`constraints` must be a mapping, found {kind_of(node)}"
        x.faults.add(NOT_A_MAPPING, text, node, hint)
        return []
    for entry in entries(node, "`constraints`", x.faults):
        if check_name(entry[0], "a constraint", x.faults):
            parts = _split_by_limit(*entry, x)
            found += parts
            x.names.constraints |= {key.text: key.place for key, _ in parts}
        else:
            x.names.faulty.add(entry[0].text)
    return found


def _split_by_limit(key: Scalar, node: Node, x: Expressions) -> list[Entry]:
    """Return the entries of a constraint: two if two relations share its limit.

    The two are named `key.1` and `key.2`. Faults are reported, with no entry returned.

    key, node : its name and its value in the file.
    """
    found = {name.text: value for name, value in entries_of(node)}
    both, label = found.get("relation"), f"the constraint `{key.text}`"
    if not isinstance(both, Sequence):
        return [(key, node)]
    if len(both.items) != 2:
        text = f"{label} must have one relation or two, found {len(both.items)}"
        x.faults.add(WRONG_COUNT, text, both)
    elif "limit" not in found:
        text = f"{label} has two relations and no `limit`"
        hint = "`limit` bounds their Euclidean norm; others are two constraints"
        x.faults.add(MISSING_KEY, text, both, hint)
    else:
        x.faults.once = x.faults.once or set()  # common faults are reported once
        return [(key._replace(text=f"{key.text}.{k}"), node) for k in (1, 2)]
    return []


def read_constraints(given: list[Entry], x: Expressions) -> tuple[Constraint, ...]:
    """Return the constraints of the entries `given`; faults are reported."""
    readers = [_ConstraintReader(key, node, x) for key, node in given]
    return _with_limits([reader.read() for reader in readers], readers)


def laws_at_values(
    known: SequenceType[Constraint], given: SequenceType[Entry], x: Expressions
) -> tuple[Constraint, ...]:
    """Return constraints with their laws read at other values of the parameters.

    known : the constraints at the first values; equalities that always hold are kept.
    given : the entries of the section `constraints`.
    """
    readers = [_ConstraintReader(key, node, x) for key, node in given]
    found = [
        c if c.always else (reader.read() or c)
        for c, reader in zip(known, readers, strict=True)
    ]
    return _with_limits(found, readers)


def _with_limits(
    found: SequenceType[Constraint | None], readers: SequenceType[_ConstraintReader]
) -> tuple[Constraint, ...]:
    """Return constraints with the static and the sliding bounds of their multipliers.

    Constraints that are None, after a fault, are left out.

    found, readers : the constraints, and their readers. Two neighbouring relations
        that share a limit are the two components of one slip.
    """
    done: list[Constraint] = []
    rates = _held_rates(found, readers[0].x) if readers else []
    for k, (c, reader) in enumerate(zip(found, readers, strict=True)):
        if c is None:
            continue
        if c.limit is not None:
            nodes = [c.relation.node]
            if c.pair and 0 <= k + c.pair < len(found):
                other = found[k + c.pair]
                nodes += [other.relation.node] if other else []
            limit, static = reader.at_rest(reader.limit, tuple(nodes), rates)
            c = c._replace(limit=limit, static=static)  # noqa: PLW2901
        elif c.law is not None and c.law.friction is not None:
            bounds = reader.at_rest(reader.friction, c.law.slips, rates)
            law = c.law._replace(friction=bounds[0], static=bounds[1])
            c = c._replace(law=law)  # noqa: PLW2901
        done.append(c)
    return tuple(done)


def _held_rates(found: SequenceType[Constraint | None], x: Expressions) -> list[int]:
    """Return the graph nodes of the rates of equalities that always hold.

    They are 0 in every motion and so relate slips to other velocities in the bounds of
    friction. Empty if no bound depends on velocities.

    found : the constraints, None after a fault.
    """
    g = x.graph
    forward = {
        g.variable(q): g.variable(rate_of(q)) for q in x.names.of(NameKind.COORDINATE)
    }
    forward[g.variable("t")] = g.one
    fast = x.names.velocities()
    if all(c is None or c.always or not _bounds_of(c, g, fast) for c in found):
        return []
    nodes = [c.relation.node for c in found if c is not None and c.always]
    return [n if has_velocity(n, x) else tangent(g, [n], forward)[0] for n in nodes]


def _bounds_of(c: Constraint, g: Graph, velocities: Collection[str]) -> bool:
    """Whether the limit or a friction of c depends on velocities or on the slip."""
    bounds = [c.limit, *([c.law.friction, c.law.static] if c.law else [])]
    nodes = [node for node in bounds if node is not None]
    return not {SLIP_SPEED, *velocities}.isdisjoint(g.depends(nodes))


class _Bound(NamedTuple):
    """Limit, or friction coefficient, that a constraint has at the key `key`.

    `sliding` and `resting` are graph nodes of the value while sliding and at rest;
    `resting` is None where one expression holds for both. `of` and `of_resting` are the
    YAML nodes of these expressions.
    """

    key: str
    sliding: int | None = None
    of: Node | None = None
    resting: int | None = None
    of_resting: Node | None = None


_NO_BOUND = _Bound("limit")


class _ConstraintReader:
    """Reader of one constraint: its relation and its law.

    Parameters
    ----------
    key, node
        The name of the constraint, and its value in the file.
    x : Expressions
        Expressions of the file.
    """

    def __init__(self, key: Scalar, node: Node, x: Expressions) -> None:
        self.key, self.x, self.label = key, x, f"the constraint `{key.text}`"
        alone = {"relation": (key, node)}
        self.limit = self.friction = _NO_BOUND
        self.below = Fields(self.label, alone, key.place, True, x.faults)
        if isinstance(node, Mapping):
            self.below = fields(node, self.label, CONSTRAINT, x.faults, key.place)

    def read(self) -> Constraint | None:
        """Return the constraint; None where a fault was reported."""
        label, below, x = self.label, self.below, self.x
        below.needs("relation")
        expression, pair = below.value("relation"), self._component()
        if isinstance(expression, Sequence) and "limit" in below:
            pair = 1 if self.key.text.endswith(".1") else -1
            expression = expression.items[0 if pair > 0 else 1]
        relation, equality = read_relation(expression, label, x)
        self._refuse_states(relation)
        x.refuse_rates(expression, label)
        x.refuse_rates(below.value("slip"), label)
        law = None
        when = self._when()
        if equality:
            hint = "a contact is one-sided: write its relation with `>=` or `<=`"
            self._refuse(NOT_ONE_SIDED, CONTACT, "is an equality", hint)
            if relation:  # a multiple root counts once
                moving = named(
                    relation.node, (NameKind.COORDINATE, NameKind.VELOCITY), x
                )
                root = simple_root(x.graph, relation.node, moving)
                multiple = root != relation.node
                relation = relation._replace(node=root, multiple=multiple)
            self.limit = self._limit(relation)
        elif not pair:
            law = self._one_sided(relation)
        # an expression with a fault of its own may be a relation
        elif equality is False and expression:
            hint = "two relations are equalities: write them with `=`"
            text = f"{label} is one-sided"
            x.faults.add(NOT_AN_EQUALITY, text, expression, hint)
        about = below.text("description")
        if relation is None or not (equality or law):
            return None
        limit = self.limit.sliding
        return Constraint(self.key.text, relation, law, about, limit, when, pair)

    def _component(self) -> int:
        """Return the offset of the other component of a vector relation with a limit.

        The index of the other component in the list of constraints, less the index of
        this one: 1 or -1; 0 for other relations.
        """
        reading = self.key.reading
        if "limit" not in self.below or reading is None or reading.component is None:
            return 0
        if reading.size != 2 and reading.component == 0:
            name = self.key.text.removesuffix(".x")
            text = f"the `limit` of the constraint `{name}` is of two relations, found "
            text += str(reading.size)
            hint = "write a constraint, with its own limit, for each component"
            place = self.below.place_of("limit")
            self.x.faults.add(WRONG_COUNT, text, place, hint)
        return -1 if reading.component else 1

    def _refuse_states(self, relation: Relation | None) -> None:
        """Report a relation of positions that depends on states."""
        x = self.x
        if relation is None or has_velocity(relation.node, x):
            return
        used = x.graph.depends([relation.node])
        if found := [s for s in x.names.of(NameKind.STATE) if s in used]:
            text = f"{self.label}, between positions, depends on states: "
            text += quoted_list(found)
            hint = "write its rate, such as `x_dot = v`, or make it a coordinate"
            x.faults.add(STATE_MISPLACED, text, relation.place, hint)

    def _refuse(
        self, code: ErrorCode, keys: Iterable[str], why: str, hint: str
    ) -> None:
        """Report keys of the constraint, among some, that its kind must not have.

        code, why, hint : the fault's code, the rest of its message, and its hint.
        """
        for key in keys:
            if key in self.below:
                text = f"{self.label} {why} and has no `{key}`"
                self.x.faults.add(code, text, self.below.place_of(key), hint)

    def _when(self) -> int | None:
        """Return the graph node of the condition `when`, of value 1 or 0; else None."""
        node = self.below.value("when")
        x, g, of = self.x, self.x.graph, f"the `when` of {self.label}"
        condition = x.compile(node, of, Level.VELOCITY, condition=True)
        if node is None or condition is None:
            return None
        fixed = {"t", *x.names.of(NameKind.PARAMETER), *x.names.of(NameKind.MODE)}
        if moving := sorted(g.depends([condition]) - fixed):
            text = f"{of} depends on {quoted_list(moving)}; "
            text += "it must not depend on the motion"
            hint = "it is a condition of t, parameters and modes, such as t < 1"
            x.faults.add(NOT_OF_TIME, text, node, hint)
        return g.call("if", condition, g.one, g.zero)

    def _limit(self, relation: Relation | None) -> _Bound:
        """Return the bound of an equality's multiplier, from its key `limit`.

        relation : the equality, which must contain velocities; None after a fault.
        """
        if relation is not None and not has_velocity(relation.node, self.x):
            hint = "write its rate: `x_dot = 0` instead of `x = 0`, so that it can slip"
            self._refuse(NOT_A_VELOCITY, ["limit"], "contains no velocity", hint)
        return self._bound("limit", LIMIT)

    def _one_sided(self, relation: Relation | None) -> OneSided | None:
        """Return the law of a one-sided relation; None after a fault.

        relation : None if it is faulty; the keys of its law are checked nevertheless.
        """
        x = self.x
        if relation is None:
            return self._contact(known=False)
        hint = "an equality has one: write its relation with `=`"
        self._refuse(NOT_AN_EQUALITY, ["limit"], "is one-sided", hint)
        if not has_velocity(relation.node, x):
            return self._contact(known=True)
        if degrees(relation.node, x) == (1, 1):
            hint = "a freewheel engages inelastically and without friction"
            self._refuse(NOT_A_CONTACT, CONTACT, "is between velocities", hint)
            return OneSided(0.0)
        if not any(key in self.below for key in CONTACT):
            text = f"{self.label} is one-sided, and not homogeneous in the velocities"
            hint = "a freewheel is, as `b_dot >= a_dot`; a contact is between positions"
            x.faults.add(NOT_HOMOGENEOUS, text, relation.place, hint)
            return None
        label = f"{self.label}, being one-sided,"
        found = x.text(self.below.value("relation"), label, parse_relation)
        assert found is not None
        x.check(found[1].names, found[0], label, Level.POSITION)
        return self._contact(known=True)

    def _contact(self, *, known: bool) -> OneSided | None:
        """Return the law of a contact: restitution and friction; None after a fault.

        known : whether the relation is surely that of a contact, so that faults are
            reported.
        """
        label, below, faults = self.label, self.below, self.x.faults
        node, of = below.value("restitution"), f"the restitution of {label}"
        if node is None and known:
            text = f"{label} is one-sided and has no `restitution`"
            hint = "write {relation: ..., restitution: 0}: 0 stays down, 1 bounces back"
            faults.add(MISSING_KEY, text, below.place, hint)
        bounce, e = self._number(node, of, Level.POSITION, APPROACH_SPEED, most=1.0)
        slips = self._slips()
        friction = self.friction = self._bound("friction", FRICTION, SLIP_SPEED)
        laws = "newton", "poisson"
        law = below.choice("restitution_law", laws, UNKNOWN_RESTITUTION_LAW)
        opposed = "`slip` is the sliding velocity that friction opposes"
        for key, other, hint in (
            ("friction", "slip", opposed), ("slip", "friction", "give `friction: mu`"),
        ):  # fmt: skip
            if key in below and other not in below:
                text = f"{label} has `{key}` but no `{other}`"
                faults.add(MISSING_KEY, text, below.place_of(key), hint)
        if bounce is None:
            return None
        varies = bounce if e is None else None
        sliding = friction.sliding
        return OneSided(e or 0.0, sliding, slips, None, varies, law == "poisson")

    def _bound(self, key: str, known: Collection[str], speed: str = "") -> _Bound:
        """Build the bound at `key`: a friction coefficient, or a limit of a multiplier.

        known : keys of a mapping that states the bound while sliding and at rest.
        speed : name of the sliding speed, if the bound may depend on it.
        """
        node, of = self.below.value(key), f"the {key} of {self.label}"
        if not isinstance(node, Mapping):
            return _Bound(key, self._number(node, of, Level.VELOCITY, speed)[0], node)
        faults, place = self.x.faults, self.below.place_of(key)
        given, parts = fields(node, of, known, faults, place), []
        for name, own in (("static", ""), ("dynamic", speed)):
            given.needs(name, "{static: ..., dynamic: ...}, or one number for both")
            about = f"the {name} {key} of {self.label}"
            parts.append(self._number(given.value(name), about, Level.VELOCITY, own))
        (sticking, most), (sliding, least) = parts
        if most is not None and least is not None and most < least:
            self._refuse_weaker(key, most, least, given.at("static"))
        nodes = given.value("dynamic"), given.value("static")
        return _Bound(key, sliding, nodes[0], sticking, nodes[1])

    def _refuse_weaker(self, key: str, most: float, least: float, place: Place) -> None:
        """Report a static bound that is below the dynamic bound.

        key : `friction` or `limit`.
        most, least : values of the static and of the dynamic bound.
        place : the place of the static bound.
        """
        text = f"the static {key} of {self.label} is {most:g}, less than the dynamic "
        hint = "static friction is at least dynamic friction"
        self.x.faults.add(OUT_OF_RANGE, text + f"one, {least:g}", place, hint)

    def at_rest(
        self, bound: _Bound, slips: tuple[int, ...], rates: list[int]
    ) -> tuple[int | None, int | None]:
        """Return the graph nodes of a bound while sliding, and at rest.

        The second is None where both are equal.

        slips : graph nodes of the components of the sliding velocity.
        rates : graph nodes of the rates of equalities that always hold.
        """
        if not slips:
            return bound.sliding, bound.resting
        key = bound.key
        sliding, resting = self._split(key, bound.sliding, bound.of, slips, rates)
        if bound.resting is None:
            return sliding, resting
        given = bound.resting, bound.of_resting
        own, at_zero = self._split(key, *given, slips, rates)
        return sliding, own if at_zero is None else at_zero

    def _split(
        self,
        key: str,
        bound: int | None,
        node: Node | None,
        slips: tuple[int, ...],
        rates: list[int],
    ) -> tuple[int | None, int | None]:
        """Return graph nodes of a bound that depends on the slip: sliding, and at rest.

        The second is None where both are equal.

        key, node : key and value (a YAML node) in the file.
        bound : graph node of the value.
        slips, rates : see `at_rest`.
        """
        x, g = self.x, self.x.graph
        if bound is None or node is None:
            return bound, None
        resting = None
        if SLIP_SPEED in g.depends([bound]):
            speed = g.call("abs" if len(slips) == 1 else "hypot", *slips)
            (bound,), (resting,) = (
                g.substitute([bound], {g.variable(SLIP_SPEED): value})
                for value in (speed, g.zero)
            )
        fast = x.names.velocities()
        found = bounds_at_rest(g, bound, slips, fast, x.known)
        if found == Bounds(bound, bound) and rates:
            found = bounds_at_rest(g, bound, slips, fast, x.known, rates)
        if found is None:
            text = f"the {key} of {self.label} has a switch at slip 0, or falls as "
            text += "steeply, and it is not clear which value bounds the force at rest "
            text += "and while it slides"
            hint = f"write {key}: {{static: ..., dynamic: ...}}"
            x.faults.add(SWITCH_AT_REST, text, node, hint)
        if found is None or found == Bounds(bound, bound):
            return bound, resting
        self._within(key, found, node)
        same = found.sliding == found.resting
        return found.sliding, None if same else found.resting

    def _within(self, key: str, found: Bounds, node: Node) -> None:
        """Report constant bounds that are negative, or lower at rest than sliding.

        key, node : `friction` or `limit`, and its value in the file.
        found : graph nodes of the bound at rest and while sliding.
        """
        x, values = self.x, list[float]()
        for name, part in zip(("static", "dynamic"), found, strict=True):
            if x.graph.depends([part]) <= x.known.keys():
                about = f"the {name} {key} of {self.label}"
                value = x.value(part, about, node.place)
                if value is not None and x.within(value, about, node.place, 0.0):
                    values.append(value)
        if len(values) == len(found) and values[0] < values[1]:
            self._refuse_weaker(key, values[0], values[1], node.place)

    def _number(
        self,
        node: Node | None,
        label: str,
        depends: Level,
        speed: str = "",
        most: float = math.inf,
    ) -> tuple[int | None, float | None]:
        """Return the graph node of a coefficient, and its value if it is constant.

        Both are None after a fault, or without a coefficient.

        node : the coefficient in the file.
        label : name in messages.
        depends : the highest level on which it may depend.
        speed : a name that it may contain besides.
        most : the largest permitted value.
        """
        x = self.x
        x.bound = {speed: x.graph.variable(speed)} if speed else {}
        found = x.compile(node, label, depends)
        x.bound = {}
        if node is None or found is None:
            return None, None
        x.refuse_rates(node, label)
        if not x.graph.depends([found]) <= x.known.keys():  # `5 + 0*t` has a value
            return found, None
        value = x.value(found, label, node.place)
        if value is not None:
            x.within(value, label, node.place, 0.0, most)
        return found, value

    def _slips(self) -> tuple[int, ...]:
        node, label, x = self.below.value("slip"), f"the slip of {self.label}", self.x
        parts = items_of(node)
        if node and len(parts) not in (1, 2):
            text = f"{label} must be one expression or two, found {len(parts)}"
            x.faults.add(WRONG_COUNT, text, node)
            return ()
        found = []
        for part in parts:
            slip = x.compile(part, label, Level.VELOCITY)
            if slip is None:
                continue
            found.append(slip)
            text = hint = ""
            if not has_velocity(slip, x):
                text, hint = f"{label} contains no velocity", "it is a sliding velocity"
                if isinstance(part, Scalar) and part.text in x.names.moving():
                    hint = f"write {rate_of(part.text)}"
            elif not is_affine(slip, x):
                text, hint = (
                    f"{label} is not affine in the velocities",
                    SUM_OF_VELOCITIES,
                )
            if text:
                x.faults.add(NOT_AFFINE, text, part, hint)
        return tuple(found)


# sqrt(e) and cbrt(e) vanish with e, where their slopes are infinite.
_ROOTS = {"sqrt": 1.0 / 2.0, "cbrt": 1.0 / 3.0}


def simple_root(g: Graph, node: int, moving: Collection[str]) -> int:
    """Return a graph node that vanishes where `node` does, with each factor once.

    The result is `node` itself where no factor that depends on the variables `moving`
    is repeated, or raised to a power, or inside `abs`.
    """
    still, powers, kinked = _factors(g, node, g.dependent([node], moving))
    if not kinked and all(power == 1.0 for power in powers.values()):
        return node
    product = g.one
    for factor in (*still, *powers):
        product = g.call("mul", product, factor)
    return product


def _factors(
    g: Graph, node: int, moves: set[int]
) -> tuple[list[int], dict[int, float], bool]:
    """Return the factors of a graph node.

    moves : the graph nodes whose values change during a motion.

    Returns
    -------
    still : list of node
        The constant factors.
    powers : dict of node to float
        The exponent of each other factor, `abs` and signs left out.
    kinked : bool
        Whether `abs` was left out.
    """
    still: list[int] = []
    powers: dict[int, float] = {}
    kinked = False
    stack = [(node, 1.0)]
    while stack:
        n, power = stack.pop()
        op, args = g.ops[n], g.args[n]
        exponent = g.value(args[1]) if op == "pow" else _ROOTS.get(op)
        if n not in moves:
            still.append(n)
        elif op in ("neg", "abs"):
            kinked |= op == "abs"
            stack.append((args[0], power))
        elif op == "mul":
            stack += [(a, power) for a in reversed(args)]
        elif op == "div" and args[1] not in moves:
            still.append(g.call("div", g.one, args[1]))
            stack.append((args[0], power))
        elif exponent is not None and exponent > 0.0:
            stack.append((args[0], power * exponent))
        else:
            powers[n] = powers.get(n, 0.0) + power
    return still, powers, kinked
