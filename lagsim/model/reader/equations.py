"""Energies, states, forces, constraints with their laws, `until`, and events."""

from __future__ import annotations

import math
import re
from contextlib import nullcontext
from typing import TYPE_CHECKING, Literal, NamedTuple

from lagsim.codes.known import (
    BOTH_GIVEN,
    CYCLE,
    MISSING_KEY,
    NO_COORDINATE,
    NOT_A_CONTACT,
    NOT_A_DIRECTION,
    NOT_A_MAPPING,
    NOT_A_MODE,
    NOT_A_VELOCITY,
    NOT_AFFINE,
    NOT_AN_EQUALITY,
    NOT_HOMOGENEOUS,
    NOT_OF_TIME,
    NOT_ONE_SIDED,
    OUT_OF_RANGE,
    OUTPUT_ONLY,
    STATE_MISPLACED,
    SWITCH_AT_REST,
    UNKNOWN_NAME,
    UNKNOWN_RESTITUTION_LAW,
    WRONG_COUNT,
)
from lagsim.language.at_rest import Bounds, bounds_at_rest
from lagsim.language.derivatives import tangent
from lagsim.language.names import in_file, rate_of, rated
from lagsim.language.parser import parse_relation
from lagsim.model.model import (
    APPROACH_SPEED,
    SLIP_SPEED,
    Constraint,
    FirstOrderState,
    Force,
    Level,
    OneSided,
    Relation,
    Transition,
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
from lagsim.model.reader import hints
from lagsim.model.reader.fields import (
    CONSTRAINT,
    CONTACT,
    ENERGY,
    EVENT,
    FRICTION,
    LIMIT,
    STATE,
    Fields,
    entries,
    fields,
    kind_of,
    quoted_list,
)
from lagsim.model.reader.names import NameKind, check_name

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable, Iterator
    from collections.abc import Sequence as SequenceType
    from contextlib import AbstractContextManager

    from lagsim.codes.known import ErrorCode
    from lagsim.errors import Place
    from lagsim.language.graph import Degrees, Graph
    from lagsim.model.reader.expressions import Expressions

_SUM = "write a sum of velocities with factors that depend on positions"


class Energies(NamedTuple):
    """Nodes of the energies; None for an energy that is missing or faulty."""

    lagrangian: int | None
    kinetic: int | None
    potential: int | None
    dissipation: int | None


def energy_fields(top: Fields) -> Fields:
    """Return the section `energy` with its keys checked."""
    found, faults = top.below("energy", ENERGY), top.faults
    given = [k for k in ("kinetic", "potential") if k in found]
    if "energy" not in top:
        hint = "give `kinetic` and `potential`, or `lagrangian`"
        faults.add(MISSING_KEY, "the file has no `energy`", top.place, hint)
    elif "lagrangian" in found and given:
        both = " and ".join(f"`{k}`" for k in given)
        text = f"both {both} and `lagrangian` are given"
        hint = "`lagrangian` replaces `kinetic` and `potential`"
        faults.add(BOTH_GIVEN, text, found.place_of("lagrangian"), hint)
    elif given:
        for missing in ("kinetic", "potential"):
            found.needs(missing, f"where there is none, say so: `{missing}: 0`")
    elif found.sound and "lagrangian" not in found:
        text = "`energy` has neither `kinetic` and `potential` nor `lagrangian`"
        faults.add(MISSING_KEY, text, found.place)
    return found


def read_energies(
    found: Fields,
    x: Expressions,
    gathering: Callable[..., AbstractContextManager[None]] = lambda **_: nullcontext(),
) -> Energies:
    """Return the nodes of the energies of the section `energy`; faults are reported.

    gathering : context manager within which sums may be elements, see
    `language.elements`.
    """
    nodes: dict[str, int | None] = {}
    called = {"dissipation": "the dissipation", "lagrangian": "the Lagrangian"}
    for key in ENERGY:
        node, what = found.value(key), called.get(key, f"the {key} energy")
        with gathering(wanted=key != "kinetic"):
            nodes[key] = x.compile(node, what, Level.VELOCITY)
        x.refuse_rates(node, what)
    kinetic, potential, lagrangian, dissipation = (nodes[k] for k in ENERGY)
    if kinetic is not None and potential is not None:
        lagrangian = x.graph.call("sub", kinetic, potential)
    x.energies.update(kinetic=kinetic, potential=potential)
    return Energies(lagrangian, kinetic, potential, dissipation)


def read_states(given: list[Entry], x: Expressions) -> tuple[FirstOrderState, ...]:
    """Return the first-order states with their rates; faults are reported.

    Rates of states within a rate, also in definitions, are replaced by their
    expressions.

    given : the entries of the section `states`.
    """
    found: dict[str, FirstOrderState] = {}
    for key, node in given:
        name, what = key.text, f"the state `{key.text}`"
        below = fields(node, what, STATE, x.faults, key.place)
        below.needs(
            "rate", f"write {name}: {{rate: ...}}, the expression for `{rate_of(name)}`"
        )
        built = x.compile(below.value("rate"), f"the rate of {what}", Level.VELOCITY)
        unit, about = below.text("unit"), below.text("description")
        if built is not None:
            found[name] = FirstOrderState(name, built, unit, about)
    g, rates = x.graph, {name: s.rate for name, s in found.items()}
    for _ in found:
        new = {g.variable(rate_of(s)): node for s, node in rates.items()}
        rates = dict(zip(rates, g.substitute(rates.values(), new), strict=True))
    for key, _ in given:
        if rate_of(key.text) in g.depends([rates.get(key.text, g.zero)]):
            text = f"the rate of the state `{key.text}` depends on itself"
            x.faults.add(CYCLE, text, key)
    if given:
        x.take_states(rates)
    return tuple(s._replace(rate=rates[name]) for name, s in found.items())


def read_forces(node: Node | None, x: Expressions) -> tuple[Force, ...]:
    """Return the generalized forces of the section `forces`; faults are reported."""
    pair = entries_of(node)
    if len(pair) == 2 and not any(hints.node_text(value) for _, value in pair):
        node = Sequence(tuple(key for key, _ in pair), pair[0][0].place)  # {x, F}
    return tuple(_along(entries(node, "`forces`", x.faults), "force", "", x))


def _along(
    given: Iterable[Entry], noun: str, of: str, x: Expressions
) -> Iterator[Force]:
    """Yield the forces, or impulses, of entries whose keys are directions.

    noun : `force` or `impulse`, for messages. of : the event of an impulse, or "".
    """
    for key, value in given:
        direction = _direction(key, noun, x)
        what = f"the {noun} on `{key.text}`{of}"
        compiled = x.compile(value, what, Level.VELOCITY)
        if direction is not None and direction[1] is Level.VELOCITY:
            x.refuse_rates(key, f"the definition `{key.text}`")
        if direction is not None and compiled is not None:
            yield Force(key.text, compiled, *direction, value.place)


def _direction(key: Scalar, noun: str, x: Expressions) -> tuple[int, Level] | None:
    """Return the node along which a force acts, and its level; None after a fault.

    key : a coordinate or a definition. noun : `force` or `impulse`, for messages.
    """
    name, place, faults = key.text, key.place, x.faults
    meaning = x.names.meaning(name)
    one = f"{'an' if noun == 'impulse' else 'a'} {noun}"
    if meaning is None:
        if not x.names.is_faulty(name) and x.names.complete:
            names = x.names.moving()
            hint = faults.did_you_mean(name, names)
            hint = hint or f"{one} acts along one of {quoted_list(map(in_file, names))}"
            text = f"there is no coordinate or definition `{name}` to work on"
            faults.add(UNKNOWN_NAME, text, place, hint)
        return None
    kind, base = meaning
    if kind is NameKind.COORDINATE:
        return x.graph.variable(name), Level.POSITION
    text, hint = f"{one} cannot work on `{name}`", ""
    code: ErrorCode | Literal[""] = ""
    node, level = x.definitions.get(name, (None, Level.POSITION))
    if kind is not NameKind.DEFINITION:
        code, text = NOT_A_DIRECTION, f"{text}, {kind.text}"
        hint = "it works on a coordinate or on a definition"
        if kind in (NameKind.VELOCITY, NameKind.RATE):
            hint = f"write `{base}`: a force on `{base}` has the power p*{name}"
            if noun == "impulse":
                hint = f"write `{base}`: an impulse on `{base}` changes `{name}`"
    elif level is Level.OUTPUT:
        code, text = OUTPUT_ONLY, f"{text}: it uses {level.text}"
        hint = "work on positions or velocities"
    elif node is not None and level > 1 and not _is_affine(node, x):
        code, text = NOT_AFFINE, f"{text}: it is not linear in the velocities"
        hint = _SUM
    if code:
        faults.add(code, text, place, hint)
    return None if code or node is None else (node, level)


def _degrees(node: int, x: Expressions) -> Degrees | None:
    """Return the degrees of a node's terms in the velocities.

    None if the node is no polynomial in the velocities.
    """
    return x.graph.degree(node, x.names.velocities())


def _has_velocity(node: int, x: Expressions) -> bool:
    return not x.names.velocities().isdisjoint(x.graph.depends([node]))


def _is_affine(node: int, x: Expressions) -> bool:
    found = _degrees(node, x)
    return found is not None and found.most <= 1


# --- Relations: constraints, and `until`


def read_relation(
    node: Node | None, what: str, x: Expressions, *, modes: bool = False
) -> tuple[Relation | None, bool | None]:
    """Build a relation, and determine whether it is an equality.

    The relation is None where there is none, or after a fault. Whether it is an
    equality is None if even that is unknown. what : name for messages. modes : whether
    modes count as coordinates.
    """
    found = x.text(node, what, parse_relation)
    if found is None:
        return None, None
    scalar, parsed = found
    equality = parsed.sense == "="
    if not x.check(parsed.names, scalar, what, Level.VELOCITY):
        return None, equality
    gap = x.build(parsed.left)
    if parsed.right is not None:
        sides = (gap, x.build(parsed.right))
        gap = x.graph.call("sub", *(sides[::-1] if parsed.sense == "<=" else sides))
    moving = {NameKind.COORDINATE, NameKind.STATE, *([NameKind.MODE] if modes else ())}
    if not _named(gap, moving, x):
        text = f"{what} depends on no coordinate and no velocity"
        hint = _AT_A_TIME if modes else ""
        hint = "a time to stop at is `end` or `duration`" if what == "`until`" else hint
        x.faults.add(NO_COORDINATE, text, scalar, hint)
        return None, equality
    text = " ".join(scalar.text.split())
    text += scalar.reading.member() if scalar.reading else ""
    return Relation(gap, equality, text, scalar.place), equality


_AT_A_TIME = (
    "an event at regular times has `every`; one at a single time compares t with a "
    "mode: `modes: {t1: 1}` and `at: t >= t1`"
)


def _named(node: int, kinds: Collection[NameKind], x: Expressions) -> set[str]:
    """Return the names of given kinds on which a node, or a rate in it, depends."""
    known, used = x.names.variables, x.graph.depends([node])
    return {name for name in used if known.get(rated(name)[0]) in kinds}


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
            parts = _apart(*entry, x)
            found += parts
            x.names.constraints |= {key.text: key.place for key, _ in parts}
        else:
            x.names.faulty.add(entry[0].text)
    return found


def _apart(key: Scalar, node: Node, x: Expressions) -> list[Entry]:
    """Return the entries of a constraint: two if two relations share its limit."""
    found = {name.text: value for name, value in entries_of(node)}
    both, what = found.get("relation"), f"the constraint `{key.text}`"
    if not isinstance(both, Sequence):
        return [(key, node)]
    if len(both.items) != 2:
        text = f"{what} must have one relation or two, found {len(both.items)}"
        x.faults.add(WRONG_COUNT, text, both)
    elif "limit" not in found:
        text = f"{what} has two relations and no `limit`"
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
    """Return constraints with the bounds of their multipliers, held and sliding.

    Two relations that share a limit have a slip of two components.

    found, readers : each constraint, or None after a fault, and its reader.
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
    """Return the nodes of the rates of equalities that always hold.

    In the bounds of friction they relate slips to other velocities.
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
    return [n if _has_velocity(n, x) else tangent(g, [n], forward)[0] for n in nodes]


def _bounds_of(c: Constraint, g: Graph, velocities: Collection[str]) -> bool:
    """Whether a bound of a constraint depends on velocities."""
    bounds = [c.limit, *([c.law.friction, c.law.static] if c.law else [])]
    nodes = [node for node in bounds if node is not None]
    return not {SLIP_SPEED, *velocities}.isdisjoint(g.depends(nodes))


class _Bound(NamedTuple):
    """Limit or friction coefficient at a key: nodes of the graph, and of the file.

    `sliding` and `resting` are nodes of the graph; `resting` is None where one
    expression holds at rest and while sliding. `of` and `of_resting` are the nodes of
    the file.
    """

    key: str
    sliding: int | None = None
    of: Node | None = None
    resting: int | None = None
    of_resting: Node | None = None


_NO_BOUND = _Bound("limit")


class _ConstraintReader:
    """Reader of one constraint: its relation and its law."""

    def __init__(self, key: Scalar, node: Node, x: Expressions) -> None:
        self.key, self.x, self.what = key, x, f"the constraint `{key.text}`"
        alone = {"relation": (key, node)}
        self.limit = self.friction = _NO_BOUND
        self.below = Fields(self.what, alone, key.place, True, x.faults)
        if isinstance(node, Mapping):
            self.below = fields(node, self.what, CONSTRAINT, x.faults, key.place)

    def read(self) -> Constraint | None:
        """Return the constraint; None where a fault was reported."""
        what, below, x = self.what, self.below, self.x
        below.needs("relation")
        expression, pair = below.value("relation"), self._component()
        if isinstance(expression, Sequence) and "limit" in below:
            pair = 1 if self.key.text.endswith(".1") else -1
            expression = expression.items[0 if pair > 0 else 1]
        relation, equality = read_relation(expression, what, x)
        self._refuse_states(relation)
        x.refuse_rates(expression, what)
        x.refuse_rates(below.value("slip"), what)
        law = None
        when = self._when()
        if equality:
            hint = "a contact is one-sided: write its relation with `>=` or `<=`"
            self._refuse(NOT_ONE_SIDED, CONTACT, "is an equality", hint)
            if relation:  # a multiple root is taken once
                moving = _named(
                    relation.node, (NameKind.COORDINATE, NameKind.VELOCITY), x
                )
                root = simple_root(x.graph, relation.node, moving)
                multiple = root != relation.node
                relation = relation._replace(node=root, multiple=multiple)
            self.limit = self._limit(relation)
        elif not pair:
            law = self._one_sided(relation)
        elif equality is False and expression:  # what has a fault itself may be one
            hint = "two relations are equalities: write them with `=`"
            text = f"{what} is one-sided"
            x.faults.add(NOT_AN_EQUALITY, text, expression, hint)
        about = below.text("description")
        if relation is None or not (equality or law):
            return None
        limit = self.limit.sliding
        return Constraint(self.key.text, relation, law, about, limit, when, pair)

    def _component(self) -> int:
        """Return the offset of the other component of a vector relation with a limit.

        The offset, in the list of constraints, is 1 for the first component and -1 for
        the second one; 0 for other relations.
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
        if relation is None or _has_velocity(relation.node, x):
            return
        used = x.graph.depends([relation.node])
        if found := [s for s in x.names.of(NameKind.STATE) if s in used]:
            text = f"{self.what}, between positions, depends on states: "
            text += quoted_list(found)
            hint = "write its rate, such as `x_dot = v`, or make it a coordinate"
            x.faults.add(STATE_MISPLACED, text, relation.place, hint)

    def _refuse(
        self, code: ErrorCode, keys: Iterable[str], why: str, hint: str
    ) -> None:
        """Report keys that a relation of this kind must not have.

        why, hint : the rest of the message, and the hint.
        """
        for key in keys:
            if key in self.below:
                text = f"{self.what} {why} and has no `{key}`"
                self.x.faults.add(code, text, self.below.place_of(key), hint)

    def _when(self) -> int | None:
        """Return the node of the condition `when`, of value 1 or 0; None without it."""
        node = self.below.value("when")
        x, g, of = self.x, self.x.graph, f"the `when` of {self.what}"
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
        """Return the bound of the multiplier of an equality, from its key `limit`."""
        if relation is not None and not _has_velocity(relation.node, self.x):
            hint = "write its rate: `x_dot = 0` instead of `x = 0`, so that it can slip"
            self._refuse(NOT_A_VELOCITY, ["limit"], "contains no velocity", hint)
        return self._bound("limit", LIMIT)

    def _one_sided(self, relation: Relation | None) -> OneSided | None:
        """Return the law of a one-sided relation; None after a fault.

        relation : the relation; None if it is faulty.
        """
        x = self.x
        if relation is None:
            return self._contact(known=False)
        hint = "an equality has one: write its relation with `=`"
        self._refuse(NOT_AN_EQUALITY, ["limit"], "is one-sided", hint)
        if not _has_velocity(relation.node, x):
            return self._contact(known=True)
        if _degrees(relation.node, x) == (1, 1):
            hint = "a freewheel engages inelastically and without friction"
            self._refuse(NOT_A_CONTACT, CONTACT, "is between velocities", hint)
            return OneSided(0.0)
        if not any(key in self.below for key in CONTACT):
            text = f"{self.what} is one-sided, and not homogeneous in the velocities"
            hint = "a freewheel is, as `b_dot >= a_dot`; a contact is between positions"
            x.faults.add(NOT_HOMOGENEOUS, text, relation.place, hint)
            return None
        what = f"{self.what}, being one-sided,"
        found = x.text(self.below.value("relation"), what, parse_relation)
        assert found is not None
        x.check(found[1].names, found[0], what, Level.POSITION)
        return self._contact(known=True)

    def _contact(self, *, known: bool) -> OneSided | None:
        """Return the law of a contact: restitution and friction; None after a fault.

        known : whether the relation is surely that of a contact, so that faults are
        reported.
        """
        what, below, faults = self.what, self.below, self.x.faults
        node, of = below.value("restitution"), f"the restitution of {what}"
        if node is None and known:
            text = f"{what} is one-sided and has no `restitution`"
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
                text = f"{what} has `{key}` but no `{other}`"
                faults.add(MISSING_KEY, text, below.place_of(key), hint)
        if bounce is None:
            return None
        varies = bounce if e is None else None
        sliding = friction.sliding
        return OneSided(e or 0.0, sliding, slips, None, varies, law == "poisson")

    def _bound(self, key: str, known: Collection[str], speed: str = "") -> _Bound:
        """Build the bound at `key`: a friction coefficient, or a limit of a multiplier.

        known : keys of a mapping that states the bound while sliding and at rest. speed
        : name of the sliding speed, if the bound may depend on it.
        """
        node, of = self.below.value(key), f"the {key} of {self.what}"
        if not isinstance(node, Mapping):
            return _Bound(key, self._number(node, of, Level.VELOCITY, speed)[0], node)
        faults, place = self.x.faults, self.below.place_of(key)
        given, parts = fields(node, of, known, faults, place), []
        for name, own in (("static", ""), ("dynamic", speed)):
            given.needs(name, "{static: ..., dynamic: ...}, or one number for both")
            about = f"the {name} {key} of {self.what}"
            parts.append(self._number(given.value(name), about, Level.VELOCITY, own))
        (sticking, most), (sliding, least) = parts
        if most is not None and least is not None and most < least:
            self._refuse_weaker(key, most, least, given.at("static"))
        nodes = given.value("dynamic"), given.value("static")
        return _Bound(key, sliding, nodes[0], sticking, nodes[1])

    def _refuse_weaker(self, key: str, most: float, least: float, place: Place) -> None:
        """Report that the static bound `most` is below the dynamic bound `least`.

        key : `friction` or `limit`. place : of the static bound.
        """
        text = f"the static {key} of {self.what} is {most:g}, less than the dynamic "
        hint = "static friction is at least dynamic friction"
        self.x.faults.add(OUT_OF_RANGE, text + f"one, {least:g}", place, hint)

    def at_rest(
        self, bound: _Bound, slips: tuple[int, ...], rates: list[int]
    ) -> tuple[int | None, int | None]:
        """Return the nodes of a bound while sliding, and at rest.

        The second is None where both are equal. slips : components of the sliding
        velocity. rates : rates of equalities that always hold.
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
        """Return the nodes of a bound that depends on the slip: sliding, and at rest.

        The second is None where both are equal. key, node : key and value in the file;
        other arguments as for `at_rest`.
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
            text = f"the {key} of {self.what} has a switch at slip 0, or falls as "
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
        """Report constant bounds that are negative, or lower at rest."""
        x, values = self.x, list[float]()
        for name, part in zip(("static", "dynamic"), found, strict=True):
            if x.graph.depends([part]) <= x.known.keys():
                about = f"the {name} {key} of {self.what}"
                value = x.value(part, about, node.place)
                if value is not None and x.within(value, about, node.place, 0.0):
                    values.append(value)
        if len(values) == len(found) and values[0] < values[1]:
            self._refuse_weaker(key, values[0], values[1], node.place)

    def _number(
        self,
        node: Node | None,
        what: str,
        depends: Level,
        speed: str = "",
        most: float = math.inf,
    ) -> tuple[int | None, float | None]:
        """Return the node of a coefficient, and its value if it is constant.

        Both are None after a fault, or without a coefficient. depends : the highest
        level on which it may depend. speed : a name that it may contain besides. most :
        the largest permitted value.
        """
        x = self.x
        x.bound = {speed: x.graph.variable(speed)} if speed else {}
        found = x.compile(node, what, depends)
        x.bound = {}
        if node is None or found is None:
            return None, None
        x.refuse_rates(node, what)
        if not x.graph.depends([found]) <= x.known.keys():  # `5 + 0*t` has a value
            return found, None
        value = x.value(found, what, node.place)
        if value is not None:
            x.within(value, what, node.place, 0.0, most)
        return found, value

    def _slips(self) -> tuple[int, ...]:
        node, what, x = self.below.value("slip"), f"the slip of {self.what}", self.x
        parts = items_of(node)
        if node and len(parts) not in (1, 2):
            text = f"{what} must be one expression or two, found {len(parts)}"
            x.faults.add(WRONG_COUNT, text, node)
            return ()
        found = []
        for part in parts:
            slip = x.compile(part, what, Level.VELOCITY)
            if slip is None:
                continue
            found.append(slip)
            text = hint = ""
            if not _has_velocity(slip, x):
                text, hint = f"{what} contains no velocity", "it is a sliding velocity"
                if isinstance(part, Scalar) and part.text in x.names.moving():
                    hint = f"write {rate_of(part.text)}"
            elif not _is_affine(slip, x):
                text, hint = f"{what} is not affine in the velocities", _SUM
            if text:
                x.faults.add(NOT_AFFINE, text, part, hint)
        return tuple(found)


# sqrt(e) and cbrt(e) vanish with e, where their slopes are infinite.
_ROOTS = {"sqrt": 1.0 / 2.0, "cbrt": 1.0 / 3.0}


def simple_root(g: Graph, node: int, moving: Collection[str]) -> int:
    """Return a node that vanishes where `node` does, with each moving factor once.

    The result is `node` itself where no factor that depends on `moving` is repeated, or
    raised to a power, or inside `abs`.
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
    """Return the factors of a node: constants, powers, and whether `abs` occurs.

    Powers are exponents by the node of a moving factor. moves : nodes that move.
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


# --- Events: the time of each, its assignments and its impulses

_BY_IMPULSES = "an event changes a velocity by an impulse: write impulse: {name: "
_BY_IMPULSES += "expression}, in N s, with a coordinate or a definition as its name"
_HINTS = {
    NameKind.COORDINATE: "no event moves a body; " + _BY_IMPULSES,
    NameKind.VELOCITY: _BY_IMPULSES,
    NameKind.RATE: _BY_IMPULSES,
    NameKind.STATE: "its rate may depend on a mode, or make it a mode",
    NameKind.PARAMETER: "write it in `modes` instead of `parameters`",
}


def read_events(node: Node | None, x: Expressions) -> tuple[Transition, ...]:
    """Return the events, in the order of the file; faults are reported."""
    found = (
        _event(key, value, x)
        for key, value in entries(node, "`events`", x.faults)
        if check_name(key, "an event", x.faults)
    )
    return tuple(event for event in found if event is not None)


def _event(key: Scalar, node: Node, x: Expressions) -> Transition | None:
    what = f"the event `{key.text}`"
    below = fields(node, what, EVENT, x.faults, key.place)
    hint = "`at` is a condition that is located, `every` a period"
    one = below.either("at", "every", hint)
    at, _ = read_relation(below.value("at"), f"the `at` of {what}", x, modes=True)
    of = f"the period of {what}"
    every = x.number(below.value("every"), of, positive=True)
    once = below.truth("once")
    given = [below.value(name) for name in ("set", "impulse")]
    sets, impulses = (
        entries(part, f"the `{name}` of {what}", x.faults)
        for name, part in zip(("set", "impulse"), given, strict=True)
    )
    empty = all(
        part is None or (isinstance(part, Mapping) and not entries_of(part))
        for part in given
    )
    if empty and below.sound:
        text = f"{what} has no assignments and no impulse"
        hint = "write set: {mode: expression} or impulse: {coordinate: expression}"
        x.faults.add(MISSING_KEY, text, key, hint)
    found: list[tuple[str, int]] = []
    for name, value in sets:
        is_mode = _is_mode(name, what, x)
        to = x.compile(value, f"`{name.text}` in {what}", Level.VELOCITY)
        if is_mode and to is not None:
            found.append((name.text, to))
    kicks = tuple(_along(impulses, "impulse", f" by {what}", x))
    sound = one and len(found) == len(sets) and len(kicks) == len(impulses)
    if not sound or not (sets or impulses) or (at is None and every is None):
        return None
    return Transition(key.text, tuple(found), at, every or 0.0, once, key.place, kicks)


def _is_mode(key: Scalar, what: str, x: Expressions) -> bool:
    """Whether a key is the name of a mode; if not, a fault is reported."""
    name, names = key.text, x.names
    meaning, modes = names.meaning(name), names.of(NameKind.MODE)
    if meaning is not None and meaning.kind is NameKind.MODE:
        return True
    if meaning is None and (names.is_faulty(name) or not names.readable):
        return False
    code: ErrorCode = UNKNOWN_NAME
    text = f"{what} sets `{name}`, and there is no such mode"
    hint = x.faults.did_you_mean(name, modes)
    hint = hint or (
        f"modes are {quoted_list(modes)}" if modes else f"modes: {{{name}: 0}}"
    )
    if meaning is not None:
        code, text = NOT_A_MODE, f"{what} sets `{name}`, {meaning.kind.text}"
        hint = _HINTS.get(meaning.kind, hint)
    x.faults.add(code, text, key, hint)
    return False
