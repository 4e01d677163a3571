"""Expressions of the file -> graph: where each name may stand, and what it is there."""

from __future__ import annotations

import math
from copy import copy
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
from lagsim.model.reader.fields import kind_of, shortened
from lagsim.model.reader.names import Kind

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping

    from lagsim.errors import Place
    from lagsim.language.graph import Graph
    from lagsim.language.parser import Name, ParsedRelation
    from lagsim.model.reader.fields import Faults
    from lagsim.model.reader.names import Meaning, Names

_T = TypeVar("_T")

NUMBERS = frozenset((Kind.PI, Kind.PARAMETER))
STATE = NUMBERS | {
    Kind.TIME,
    Kind.COORDINATE,
    Kind.VELOCITY,
    Kind.DEFINITION,
    Kind.RATE,
}
OUTPUT = frozenset(Kind)

_VELOCITIES = (Kind.VELOCITY, Kind.RATE)


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
        self._rates: dict[Kind, dict[str, int]] = {}
        self._told: tuple[Scalar, str] | None = None

    def over(self, faults: Faults, values: Mapping[str, float]) -> Expressions:
        """Give the same with other faults and other values of the parameters."""
        other = copy(self)
        other.faults, other.values = faults, dict(values)
        return other

    # Reading a text

    def scalar(self, node: Node, what: str, *, beside: bool = False) -> Scalar | None:
        """Give the scalar that an expression is expected to be.

        `beside`: a unit may stand beside it.
        """
        if isinstance(node, Broken):
            return None
        if isinstance(node, Scalar) and (node.quoted or not node.empty):
            return node
        if isinstance(node, Scalar):
            hint = "write a number or an expression, such as 0"
        else:
            from lagsim.model.reader import quantities

            hint = quantities.of_collection(node, beside=beside)
        text = f"{what} must be an expression, found {kind_of(node)}"
        self.faults.add("not-an-expression", text, node.place, hint)
        return None

    def parse(
        self, scalar: Scalar, *, condition: bool = False, beside: bool = False
    ) -> Parsed | None:
        """Parse an expression, or a condition; `beside`: a unit may stand beside it."""
        parser = parse_condition if condition else parse
        return self._parse(scalar, parser, beside=beside)

    def parse_relation(self, scalar: Scalar) -> ParsedRelation | None:
        """Parse a relation."""
        return self._parse(scalar, parse_relation)

    def _parse(
        self, scalar: Scalar, parser: Callable[[str], _T], *, beside: bool = False
    ) -> _T | None:
        if len(scalar.text) > limits.EXPRESSION_LETTERS:
            many, most = len(scalar.text), limits.EXPRESSION_LETTERS
            text = f"the expression has {many:,} letters, more than {most:,}"
            hint = "parts of it may be definitions"
            self.faults.add("expression-too-long", text, scalar.place, hint)
            return None
        if len(scalar.text) > self._longest:
            self._longest, self.graph.place = len(scalar.text), scalar.place
        try:
            return parser(scalar.text)
        except ExpressionError as fault:
            token = scalar.text[fault.offset : fault.offset + fault.length]
            if token not in self.names.faulty:
                self.faults.add_expression(
                    fault,
                    scalar,
                    self.names.variables,
                    beside=beside,
                    relation=parser is parse_relation,
                )
            return None

    # Building nodes

    def compile(
        self,
        node: Node,
        what: str,
        allowed: frozenset[Kind],
        *,
        condition: bool = False,
    ) -> tuple[int, Level] | None:
        """Give the graph node of an expression and what it depends on.

        Parameters
        ----------
        node
            The expression.
        what
            How messages call it.
        allowed
            The kinds of names that may stand in it.
        condition
            It is one, as the first argument of `if`.
        """
        scalar = self.scalar(node, what)
        parsed = self.parse(scalar, condition=condition) if scalar else None
        if scalar is None or parsed is None:
            return None
        level = self.check(parsed.names, scalar, what, allowed)
        return None if level is None else (self.build(parsed), level)

    def build(self, parsed: Parsed) -> int:
        """Give the node of an expression whose names were checked."""
        return parsed.build(self.graph, self._node)

    def number(self, node: Node, what: str) -> float | None:
        """Give the value of an expression of parameters, which must be finite."""
        found = self.compile(node, what, NUMBERS)
        if found is None:
            return None
        value = evaluate(self.graph, [found[0]], self.values)[0]
        if not math.isfinite(value):
            text = f"{what} is {value}, which is not a finite number"
            self.faults.add("not-finite", text, node.place)
            return None
        return value

    def check(
        self,
        used: Iterable[Name],
        scalar: Scalar,
        what: str,
        allowed: frozenset[Kind],
    ) -> Level | None:
        """Report names that must not stand here; give what the expression depends on.

        Returns
        -------
        Level or None
            None where any name is faulty.
        """
        levels: list[Level] = []
        sound = True
        first = {name.text: name.offset for name in reversed(list(used))}
        for name, offset in sorted(first.items(), key=lambda item: item[1]):
            level = self._level(name, scalar, offset, what, allowed)
            sound = sound and level is not None
            levels.append(level or Level.POSITION)
        return highest(levels) if sound else None

    def _level(
        self,
        name: str,
        scalar: Scalar,
        offset: int,
        what: str,
        allowed: frozenset[Kind],
    ) -> Level | None:
        place = scalar.place_of(offset, len(name))
        meaning = self.names.meaning(name)
        if meaning is None:
            if not self.names.is_faulty(name) and self.names.complete:
                self._unknown(name, scalar, offset, numbers=allowed <= NUMBERS)
            return None
        if meaning.kind not in allowed:
            code, text, hint = _misplaced(name, meaning, what, allowed)
            self.faults.add(code, text, place, hint)
            return None
        if meaning.kind in (Kind.DEFINITION, Kind.RATE, Kind.SECOND_RATE):
            return self._level_of_definition(name, meaning, place, what, allowed)
        # A parameter without a value is a fault already told; only numbers need it.
        unvalued = meaning.kind is Kind.PARAMETER and name not in self.values
        unbuilt = meaning.kind is Kind.ENERGY and self.energies.get(name, 0) is None
        if (unvalued and allowed <= NUMBERS) or unbuilt:
            return None
        return level_of_kind(meaning.kind)

    def _unknown(
        self, name: str, scalar: Scalar, offset: int, *, numbers: bool
    ) -> None:
        """Report a name that means nothing; once where a hint is of several names."""
        from lagsim.model.reader import suggestions

        hint = suggestions.of_unknown(scalar.text, offset)
        if hint and (scalar, hint) == self._told:
            return
        self._told = scalar, hint
        among = list(self.values) if numbers else None
        text, other = self.names.unknown(name, self.faults, among)
        hint = hint or other
        if not hint and not suggestions.is_other(name):
            hint = self.faults.meant(scalar, offset, self.names.variables)
        hint = hint or f"give `{shortened(name)}` a value in `parameters`"
        place = scalar.place_of(offset, len(name))
        self.faults.add("unknown-name", text, place, hint)

    def _level_of_definition(
        self,
        name: str,
        meaning: Meaning,
        place: Place,
        what: str,
        allowed: frozenset[Kind],
    ) -> Level | None:
        definition = self.definitions.get(meaning.base)
        if definition is None:
            return None
        level = definition.level
        if meaning.kind is not Kind.DEFINITION and level is not Level.POSITION:
            self.faults.add(
                "no-rate",
                f"`{name}` asks for the rate of `{meaning.base}`, which depends on "
                f"{level.value}",
                place,
                "rates are those of coordinates and of definitions of positions and "
                "time",
            )
            return None
        if level is Level.OUTPUT and not allowed >= OUTPUT:
            text = f"the definition `{name}` uses {level.value}; {what} cannot use it"
            self.faults.add("output-only", text, place, _FOR_OUTPUT)
            return None
        if level is Level.VELOCITY and Kind.VELOCITY not in allowed:
            text = f"the definition `{name}` depends on velocities; {what} must not"
            self.faults.add("velocity-not-allowed", text, place)
            return None
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
            self._rates[Kind.DEFINITION] = {
                name: d.node
                for name, d in self.definitions.items()
                if d.level is Level.POSITION and d.node is not None
            }
        wanted = (Kind.RATE, Kind.SECOND_RATE) if second else (Kind.RATE,)
        below = Kind.DEFINITION
        for kind in wanted:
            if kind not in self._rates:
                nodes = self._rates[below]
                rates = tangent(self.graph, nodes.values(), self._motion())
                self._rates[kind] = dict(zip(nodes, rates, strict=True))
            below = kind
        return self._rates[below][definition]

    def _motion(self) -> dict[int, int]:
        """Give the rate of everything that moves: t, q and q_dot."""
        g = self.graph
        motion = {g.variable("t"): g.one}
        for q in self.names.of(Kind.COORDINATE):
            motion[g.variable(q)] = g.variable(f"{q}_dot")
            motion[g.variable(f"{q}_dot")] = g.variable(f"{q}_ddot")
        return motion


_FOR_OUTPUT = "such names are allowed only in definitions for output, and in plots"


def _misplaced(
    name: str, meaning: Meaning, what: str, allowed: frozenset[Kind]
) -> tuple[str, str, str]:
    """Give code, text and hint for a known name where it must not stand."""
    kind = meaning.kind
    if allowed <= NUMBERS:
        text = f"`{name}` is {kind.value}; {what} must be a number"
        return "not-constant", text, "numbers are made of parameters and `pi`"
    if kind in _VELOCITIES:
        text = f"`{name}` is {kind.value}; {what} must not depend on velocities"
        return "velocity-not-allowed", text, ""
    text = f"`{name}` is {kind.value}, which the motion gives; {what} cannot use it"
    return "output-only", text, _FOR_OUTPUT
