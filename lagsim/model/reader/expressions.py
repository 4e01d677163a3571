"""Expressions of the file -> graph: where each name may stand, and what it is there."""

from __future__ import annotations

import math
from copy import copy
from functools import partial
from typing import TYPE_CHECKING, NamedTuple, TypeVar

from lagsim import limits
from lagsim.language.derivatives import tangent
from lagsim.language.evaluate import evaluate
from lagsim.language.parser import (
    ExpressionError,
    Parsed,
    parse,
    parse_condition,
    parse_relation,
)
from lagsim.model.model import Level
from lagsim.model.nodes import Broken, Node, Scalar
from lagsim.model.reader import hints, quantities
from lagsim.model.reader.fields import kind_of, shortened
from lagsim.model.reader.names import Kind

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping

    from lagsim.errors import Place
    from lagsim.language.graph import Graph
    from lagsim.language.parser import Name
    from lagsim.model.reader.fields import Faults
    from lagsim.model.reader.names import Meaning, Names

    # Code, text and hint of a name that must not stand where it does.
    Refusal = tuple[str, str, str]
    Rule = Callable[[Name, Scalar], Level | Refusal | None]

_T = TypeVar("_T")

NUMBERS = frozenset((Kind.PI, Kind.PARAMETER))
OF_DEFINITIONS = (Kind.DEFINITION, Kind.RATE, Kind.SECOND_RATE)
STATE = NUMBERS | {
    Kind.TIME,
    Kind.COORDINATE,
    Kind.VELOCITY,
    Kind.DEFINITION,
    Kind.RATE,
}
OUTPUT = frozenset(Kind)

_VELOCITIES = (Kind.VELOCITY, Kind.RATE)
_FOR_OUTPUT = "such names are allowed only in definitions for output, and in plots"


class Resolved(NamedTuple):
    """What is known of a definition; `node` is None where a fault was reported."""

    node: int | None
    level: Level


def level_of_kind(kind: Kind) -> Level:
    """Give what an expression depends on that uses a name of this kind."""
    if kind in _VELOCITIES:
        return Level.VELOCITY
    return Level.POSITION if kind in STATE else Level.OUTPUT


def highest(levels: Iterable[Level]) -> Level:
    """Give the last of `levels` in the order of the class Level."""
    order = list(Level)
    return max(levels, key=order.index, default=Level.POSITION)


class Expressions:
    """Compiles expressions; faults go to `faults`, and give None.

    Attributes
    ----------
    graph
        The graph of the model.
    values
        Value of each parameter that is known.
    definitions
        The definitions that have been built.
    energies
        Nodes of `kinetic` and `potential`, once built.
    """

    def __init__(self, graph: Graph, names: Names, faults: Faults) -> None:
        self.graph = graph
        self._longest = 0
        self.names = names
        self.faults = faults
        self.values: dict[str, float] = {}
        self.definitions: dict[str, Resolved] = {}
        self.energies: dict[str, int | None] = {}
        # Nodes of the definitions of positions, their rates, their second rates.
        self._rates: list[dict[str, int]] = []
        self._last_hint: tuple[Scalar, str] | None = None

    def over(self, faults: Faults, values: Mapping[str, float]) -> Expressions:
        """Give the same with other faults and other values of the parameters."""
        other = copy(self)
        other.faults, other.values = faults, dict(values)
        return other

    # Reading a text

    def scalar(
        self, node: Node | None, what: str, *, beside: bool = False
    ) -> Scalar | None:
        """Give the scalar that an expression is expected to be, if there is one.

        `beside`: a unit may stand beside it.
        """
        if node is None or isinstance(node, Broken):
            return None
        hint = "write a number or an expression, such as 0"
        if not isinstance(node, Scalar):
            hint = quantities.of_collection(node, beside=beside)
        elif node.quoted or not node.empty:
            return node
        text = f"{what} must be an expression, found {kind_of(node)}"
        self.faults.add("not-an-expression", text, node.place, hint)
        return None

    def text(
        self,
        node: Node | None,
        what: str,
        parser: Callable[[str], _T],
        *,
        beside: bool = False,
    ) -> tuple[Scalar, _T] | None:
        """Give the scalar of an expression, and what a parser makes of it.

        `what`: how messages call it; `beside`: a unit may stand beside it.
        """
        scalar = self.scalar(node, what, beside=beside)
        if scalar is None:
            return None
        many, most = len(scalar.text), limits.EXPRESSION_LETTERS
        if many > most:
            text = f"the expression has {many:,} letters, more than {most:,}"
            hint = "parts of it may be definitions"
            self.faults.add("expression-too-long", text, scalar.place, hint)
            return None
        if many > self._longest:
            self._longest, self.graph.place = many, scalar.place
        try:
            return scalar, parser(scalar.text)
        except ExpressionError as fault:
            token = scalar.text[fault.offset : fault.offset + fault.length]
            if token not in self.names.faulty:
                known, relation = self.names.variables, parser is parse_relation
                self.faults.add_expression(
                    fault, scalar, known, beside=beside, relation=relation
                )
            return None

    # Building nodes

    def compile(
        self,
        node: Node | None,
        what: str,
        allowed: frozenset[Kind],
        *,
        condition: bool = False,
    ) -> int | None:
        """Give the graph node of an expression, if there is one.

        `allowed` are the kinds of names that may stand in it; a `condition` is one, as
        the first argument of `if`.
        """
        found = self.text(node, what, parse_condition if condition else parse)
        if found is None:
            return None
        scalar, parsed = found
        sound = self.check(parsed.names, scalar, what, allowed) is not None
        return self.build(parsed) if sound else None

    def build(self, parsed: Parsed) -> int:
        """Give the node of an expression whose names were checked."""
        return parsed.build(self.graph, self._node)

    def number(self, node: Node | None, what: str) -> float | None:
        """Give the value of an expression of parameters, which must be finite."""
        found = self.compile(node, what, NUMBERS)
        if node is None or found is None:
            return None
        value = evaluate(self.graph, [found], self.values)[0]
        return value if self.is_finite(value, what, node.place) else None

    def is_finite(self, value: float, what: str, place: Place) -> bool:
        """Report a value that is not finite."""
        if not math.isfinite(value):
            text = f"{what} is {value}, which is not a finite number"
            self.faults.add("not-finite", text, place)
        return math.isfinite(value)

    def check(
        self, used: Iterable[Name], scalar: Scalar, what: str, allowed: frozenset[Kind]
    ) -> Level | None:
        """Report names that must not stand here; give the level of the expression.

        None where any name is faulty.
        """
        return self.check_by(partial(self.rule, what, allowed), used, scalar)

    def check_by(
        self, rule: Rule, used: Iterable[Name], scalar: Scalar
    ) -> Level | None:
        """Do the same by a rule for each name.

        It gives the level of the name, why it must not stand there, or None where that
        is reported already.
        """
        first: dict[str, Name] = {}
        for one in used:
            first.setdefault(one.text, one)
        levels, sound = [], True
        for one in sorted(first.values(), key=lambda name: name.offset):
            found = rule(one, scalar)
            if isinstance(found, Level):
                levels.append(found)
                continue
            sound = False
            if found is not None:
                code, text, hint = found
                place = scalar.place_of(one.offset, len(one.text))
                self.faults.add(code, text, place, hint)
        return highest(levels) if sound else None

    def rule(
        self, what: str, allowed: frozenset[Kind], used: Name, scalar: Scalar
    ) -> Level | Refusal | None:
        """Tell for `check_by` whether a name may stand in an expression."""
        name, meaning = used.text, self.names.meaning(used.text)
        if meaning is None:
            if self.names.is_faulty(name) or not self.names.complete:
                return None
            return self._unknown(used, scalar, numbers=allowed <= NUMBERS)
        if meaning.kind not in allowed:
            return _misplaced(name, meaning, what, allowed)
        if meaning.kind in OF_DEFINITIONS:
            return self._rule_of_definition(name, meaning, what, allowed)
        # A parameter without a value is reported already; only numbers need it.
        unvalued = meaning.kind is Kind.PARAMETER and name not in self.values
        unbuilt = meaning.kind is Kind.ENERGY and self.energies.get(name, 0) is None
        if (unvalued and allowed <= NUMBERS) or unbuilt:
            return None
        return level_of_kind(meaning.kind)

    def _unknown(self, used: Name, scalar: Scalar, *, numbers: bool) -> Refusal | None:
        """Refuse a name that means nothing; once where a hint is of several names."""
        name, names = used.text, self.names
        hint = hints.of_unknown(scalar.text, used.offset)
        if hint and (scalar, hint) == self._last_hint:
            return None
        self._last_hint = scalar, hint
        among = list(self.values) if numbers else None
        text, other = names.unknown(name, self.faults, among)
        hint = hint or other
        if not hint and not hints.is_other(name):
            hint = self.faults.meant(scalar, used.offset, names.variables)
        hint = hint or f"give `{shortened(name)}` a value in `parameters`"
        return "unknown-name", text, hint

    def _rule_of_definition(
        self, name: str, meaning: Meaning, what: str, allowed: frozenset[Kind]
    ) -> Level | Refusal | None:
        definition = self.definitions.get(meaning.base)
        if definition is None:
            return None
        level = definition.level
        if meaning.kind is not Kind.DEFINITION and level is not Level.POSITION:
            text = f"`{name}` asks for the rate of `{meaning.base}`, which depends on "
            hint = "rates are those of coordinates and of definitions of positions and "
            return "no-rate", text + level.value, hint + "time"
        if level is Level.OUTPUT and not allowed >= OUTPUT:
            text = f"the definition `{name}` uses {level.value}; {what} cannot use it"
            return "output-only", text, _FOR_OUTPUT
        if level is Level.VELOCITY and Kind.VELOCITY not in allowed:
            text = f"the definition `{name}` depends on velocities; {what} must not"
            return "velocity-not-allowed", text, ""
        if definition.node is None:
            return None
        return highest((level, level_of_kind(meaning.kind)))

    def _node(self, name: str) -> int:
        meaning = self.names.meaning(name)
        assert meaning is not None
        kind, base = meaning.kind, meaning.base
        if kind is Kind.PI:
            return self.graph.constant(math.pi)
        if kind is Kind.DEFINITION:
            node = self.definitions[base].node
        elif kind in (Kind.RATE, Kind.SECOND_RATE):
            node = self.rate(base, second=kind is Kind.SECOND_RATE)
        elif kind is Kind.ENERGY and name != "energy":
            node = self.energies[name]
        else:
            node = self.graph.variable(name)
        assert node is not None
        return node

    def rate(self, definition: str, *, second: bool = False) -> int:
        """Give the node of the total time derivative of a definition of positions.

        All of them are made at once: one sweep over the graph costs no more than one
        for a single definition does.
        """
        if not self._rates:
            known = self.definitions.items()
            at_position = ((k, d.node) for k, d in known if d.level is Level.POSITION)
            self._rates.append({k: n for k, n in at_position if n is not None})
        while len(self._rates) < 2 + second:
            nodes = self._rates[-1]
            rates = tangent(self.graph, nodes.values(), self._motion())
            self._rates.append(dict(zip(nodes, rates, strict=True)))
        return self._rates[1 + second][definition]

    def _motion(self) -> dict[int, int]:
        """Give the rate of everything that moves: t, q and q_dot."""
        g = self.graph
        motion = {g.variable("t"): g.one}
        for q in self.names.of(Kind.COORDINATE):
            motion[g.variable(q)] = g.variable(f"{q}_dot")
            motion[g.variable(f"{q}_dot")] = g.variable(f"{q}_ddot")
        return motion


def _misplaced(
    name: str, meaning: Meaning, what: str, allowed: frozenset[Kind]
) -> Refusal:
    """Refuse a known name where it must not stand."""
    kind = meaning.kind
    if allowed <= NUMBERS:
        text = f"`{name}` is {kind.value}; {what} must be a number"
        return "not-constant", text, "numbers are made of parameters and `pi`"
    if kind in _VELOCITIES:
        text = f"`{name}` is {kind.value}; {what} must not depend on velocities"
        return "velocity-not-allowed", text, ""
    text = f"`{name}` is {kind.value}, which the motion gives; {what} cannot use it"
    return "output-only", text, _FOR_OUTPUT
