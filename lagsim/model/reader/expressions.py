"""Compilation of the expressions of a file to nodes of the graph.

Each expression has a set of quantities on which it may depend.
"""

from __future__ import annotations

import math
from copy import copy
from functools import partial
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, TypeVar

from lagsim import limits
from lagsim.codes.known import (
    EXPRESSION_ARITY,
    EXPRESSION_COMPONENT,
    EXPRESSION_MEMBER,
    EXPRESSION_RANGE,
    EXPRESSION_SIZE,
    EXPRESSION_SUBSCRIPT,
    EXPRESSION_TOO_LONG,
    EXPRESSION_TOO_MANY,
    NO_RATE,
    NOT_AN_EXPRESSION,
    NOT_CONSTANT,
    NOT_FINITE,
    OUT_OF_RANGE,
    OUTPUT_ONLY,
    STATE_MISPLACED,
    UNKNOWN_NAME,
    VELOCITY_NOT_ALLOWED,
)
from lagsim.language.derivatives import tangent
from lagsim.language.evaluate import evaluate
from lagsim.language.names import HIDDEN, rate_of
from lagsim.language.parser import (
    SILENT,
    ExpressionError,
    Parsed,
    ParsedRelation,
    parse,
    parse_condition,
    silent,
)
from lagsim.model.model import Level
from lagsim.model.nodes import Broken, Node, Scalar, words_below
from lagsim.model.reader import hints, quantities
from lagsim.model.reader.fields import (
    in_one_line,
    kind_of,
)
from lagsim.model.reader.names import NameKind, Names

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable, Mapping

    from lagsim.errors import Place
    from lagsim.language.graph import Graph
    from lagsim.language.parser import Name
    from lagsim.model.nodes import Reading
    from lagsim.model.reader.fields import Faults

    # Predicate: whether a name is allowed in an expression; reports it if not.
    Rule = Callable[[Name, Scalar], bool]
    from lagsim.codes.known import ErrorCode

_P = TypeVar("_P", Parsed, ParsedRelation)

# A value, and a bound of its rounding error.
Value = tuple[float, float]
# Faults that no other spelling of the text corrects.
_OF_MEMBERS = (
    EXPRESSION_SIZE, EXPRESSION_COMPONENT, EXPRESSION_MEMBER, EXPRESSION_SUBSCRIPT,
    EXPRESSION_RANGE, EXPRESSION_TOO_MANY, EXPRESSION_ARITY,
)  # fmt: skip


# --- Expressions

OF_DEFINITIONS = (NameKind.DEFINITION, NameKind.RATE, NameKind.SECOND_RATE)
_FOR_OUTPUT = "such names are allowed only in definitions for output, and in plots"


class Resolved(NamedTuple):
    """Graph node and level of a definition; the node is None after a fault."""

    node: int | None
    level: Level


class Expressions:
    """Compiler of expressions of a file to graph nodes.

    A fault is added to `faults`, and the result is then None.

    Attributes
    ----------
    graph
        The graph of the model.
    reading
        Reading of texts that no expansion created; None in a file of scalars alone.
    known
        Value and rounding error of each parameter that is known.
    modes
        Value and rounding error of each mode, at the start.
    definitions
        Graph node and level of each definition that has been built.
    energies
        Graph nodes of `kinetic` and `potential`, once built.
    states
        Rates of the first-order states, once built; before, variables such as `s_dot`.
    with_rates
        For each name, the states whose rates its expression contains.
    bound
        Graph nodes of names that are local to a part of the file, such as the parameter
        of a curve.
    read
        The expressions read so far, with their names in messages.
    """

    def __init__(self, graph: Graph, names: Names, faults: Faults) -> None:
        self.graph = graph
        self.reading: Reading | None = None
        self._longest = 0
        self.names = names
        self.faults = faults
        self.known: dict[str, Value] = {}
        self.modes: dict[str, Value] = {}
        self.definitions: dict[str, Resolved] = {}
        self.energies: dict[str, int | None] = {}
        self.states: dict[str, int] = {}
        self.with_rates: dict[str, set[str]] = {}
        self.bound: dict[str, int] = {}
        self.read: list[tuple[str, Scalar, Parsed | ParsedRelation]] = []
        # Nodes of the definitions of positions, their rates, their second rates.
        self._rates: list[dict[str, int]] = []
        self._last_hint: tuple[Scalar, str] | None = None

    def over(self, faults: Faults, known: Mapping[str, Value]) -> Expressions:
        """Return a compiler of this file with other values of parameters.

        Its list `read` is empty.

        faults : the list to which it adds faults.
        known : value and error by name.
        """
        other = copy(self)
        other.faults, other.known, other.modes = faults, dict(known), {}
        other.read = []
        return other

    # Reading a text

    def scalar(
        self, node: Node | None, label: str, *, beside: bool = False
    ) -> Scalar | None:
        """Return the scalar of an expression; None for other nodes, which are reported.

        node, label : the value in the file, and its name in messages.
        beside : whether a unit may be given beside the expression.
        """
        if node is None or isinstance(node, Broken):
            return None
        hint = "write a number or an expression, such as 0"
        if not isinstance(node, Scalar):
            hint = quantities.of_collection(node, beside=beside)
        elif node.style or not node.empty:
            return node
        text = f"{label} must be an expression, found {kind_of(node)}"
        self.faults.add(NOT_AN_EXPRESSION, text, node, hint)
        return None

    def text(
        self,
        node: Node | None,
        label: str,
        parser: Callable[[str], _P],
        *,
        beside: bool = False,
    ) -> tuple[Scalar, _P] | None:
        """Return the scalar of an expression, and its parsed form; None after a fault.

        label : name of the expression in messages.
        parser : parses the text.
        beside : whether a unit may be given beside the expression.
        """
        scalar = self.scalar(node, label, beside=beside)
        if scalar is None:
            return None
        known = self._with_tables(parser, scalar.text)
        many, most = len(scalar.text), limits.EXPRESSION_LETTERS
        if many > most:
            text = f"the expression has {many:,} letters, more than {most:,}"
            hint = "write parts of it as definitions"
            self.faults.add(EXPRESSION_TOO_LONG, text, scalar, hint)
            return None
        if many > self._longest:
            self._longest, self.graph.place = many, scalar.place
        reading = scalar.reading or self.reading
        try:
            if reading is None:
                found = known(scalar.text)
            else:
                found = reading.parsed(scalar.text, parser)
                if self.names.tables or self.names.faulty:
                    self._check_calls(found, scalar.text)
        except ExpressionError as fault:
            self._report(fault, scalar, known, beside=beside)
            return None
        self.read.append((label, scalar, found))
        return scalar, found

    def _check_calls(self, found: Parsed | ParsedRelation, text: str) -> None:
        """Raise an ExpressionError for a table called with a wrong number of arguments.

        found, text : the expression or relation, parsed, and its text.
        """
        sides = [found] if isinstance(found, Parsed) else [found.left, found.right]
        for op, count, _ in (step for x in sides if x for step in x.postfix):
            table = self.names.tables.get(op)
            if table is None and op in self.names.faulty:
                raise silent()
            if table is not None and count != len(table.axes):
                about = f"`{op}` has {len(table.axes)} arguments, found {count}"
                raise ExpressionError(0, len(text), about, code=EXPRESSION_ARITY)

    def _with_tables(
        self, parser: Callable[[str], _P], text: str
    ) -> Callable[[str], _P]:
        """Return a parser like `parser` that accepts calls of the file's tables.

        text : the text to be parsed; the tables that it calls are recorded in
            `Names.called`.
        """
        tables = self.names.tables
        if not tables:
            return parser
        self.names.called |= {name for name in tables if name in text}
        arities = tuple((name, len(table.axes)) for name, table in tables.items())
        more: dict[str, Any] = {"tables": arities}
        return partial(parser, **more)

    def _report(
        self,
        fault: ExpressionError,
        scalar: Scalar,
        parser: hints.Parser,
        *,
        beside: bool,
    ) -> None:
        """Report the fault that the parser found in the text of a scalar.

        parser : the parser of a relation, or of another expression.
        beside : see `text`.
        """
        text = scalar.text
        token = text[fault.offset : fault.offset + fault.length]
        if token in self.names.faulty or fault.code == SILENT:
            return
        code = fault.code
        place = scalar.place_of(fault.offset, fault.length)
        if not self.faults.is_known(code, place):
            hint = fault.hint
            if not (self.reading and fault.code in _OF_MEMBERS):
                hint = self.meant(scalar, parser, beside=beside) or hint
            self.faults.add(code, fault.text, place, hint)

    def meant(
        self, scalar: Scalar, parser: hints.Parser = parse, *, beside: bool = False
    ) -> str:
        """Return a hint for an expression with faults; "" if there is none.

        parser, beside : see `text`.
        """
        if not self.faults.may_guess():
            return ""
        known, moving = self.names.variables, self.names.moving()
        reading = scalar.reading or self.reading
        if reading is not None:
            parser = partial(reading.parsed, parser=parser)
        return hints.of_text(scalar.text, parser, known, moving, beside=beside)

    # Building nodes

    def compile(
        self, node: Node | None, label: str, most: Level, *, condition: bool = False
    ) -> int | None:
        """Return the graph node of an expression; None if it is absent or faulty.

        node, label : the expression in the file, and its name in messages.
        most : the highest level of names that it may contain, see `model.model.Level`.
        condition : whether it is a condition, as the first argument of `if`.
        """
        found = self.text(node, label, parse_condition if condition else parse)
        if found is None:
            return None
        scalar, parsed = found
        sound = self.check(parsed.names, scalar, label, most)
        return self.build(parsed) if sound else None

    def build(self, parsed: Parsed) -> int:
        """Return the graph node of a parsed expression whose names were checked."""
        return parsed.build(self.graph, self._node, self.names.tables)

    def number(
        self, node: Node | None, label: str, *bounds: float, positive: bool = False
    ) -> float | None:
        """Return the finite value of an expression of parameters; None after a fault.

        node, label : the expression in the file, and its name in messages.
        bounds, positive : the permitted range, see `within`.
        """
        found = self.compile(node, label, Level.NUMBER)
        if node is None or found is None:
            return None
        value, at = self.value(found, label, node.place), node.place
        if value is None or not self.within(
            value, label, at, *bounds, positive=positive
        ):
            return None
        return value

    def value(self, found: int, label: str, place: Place) -> float | None:
        """Return the value of the graph node `found`, which contains parameters alone.

        None if it is not finite, which is reported.

        label, place : the quantity and its place in the file, for the message.
        """
        numbers = {name: value for name, (value, _) in self.known.items()}
        value = evaluate(self.graph, [found], numbers)[0]
        return value if self.is_finite(value, label, place) else None

    def within(
        self,
        value: float,
        label: str,
        place: Place | None,
        least: float = -math.inf,
        most: float = math.inf,
        *,
        positive: bool = False,
    ) -> bool:
        """Whether a number lies in its range; if not, a fault is reported.

        label, place : the quantity and its place in the file, for the message.
        least, most : the range.
        positive : whether 0 is excluded.
        """
        rule = "be positive" if positive and value <= 0.0 else ""
        if value > most:
            rule = f"not exceed {most:g}"
        elif value < least:
            rule = f"not be below {least:g}" if least else "not be negative"
        if rule:
            text = f"{label} is {value:g}; it must {rule}"
            self.faults.add(OUT_OF_RANGE, text, place)
        return not rule

    def is_finite(self, value: float, label: str, place: Place) -> bool:
        """Whether a value is finite; if not, a fault is reported.

        label, place : the quantity and its place in the file, for the message.
        """
        if not math.isfinite(value):
            text = f"{label} is {value}, which is not a finite number"
            self.faults.add(NOT_FINITE, text, place)
        return math.isfinite(value)

    def check(
        self, used: Iterable[Name], scalar: Scalar, label: str, most: Level
    ) -> bool:
        """Whether all names `used` are permitted in an expression; others are reported.

        scalar, label : the expression, and its name in messages.
        most : the highest level of quantities on which it may depend.
        """
        return self.check_by(partial(self.allows, label, most), used, scalar)

    def check_by(self, rule: Rule, used: Iterable[Name], scalar: Scalar) -> bool:
        """Whether a rule permits all names of an expression.

        Each name is checked once.

        used : the names.
        rule : (name, scalar) -> whether the name is permitted; it reports names that
            are not.
        """
        first: dict[str, Name] = {}
        for one in used:
            first.setdefault(one.text, one)
        names = sorted(first.values(), key=lambda name: name.offset)
        found = [rule(one, scalar) for one in names]  # each is reported
        return all(found)

    def refuse(
        self, used: Name, scalar: Scalar, code: ErrorCode, text: str, hint: str = ""
    ) -> bool:
        """Report a name that is not permitted in an expression; return False.

        used, scalar : the name, and the expression.
        code, text, hint : the message.
        """
        place = scalar.place_of_name(used.text, used.offset)
        self.faults.add(code, text, place, hint)
        return False

    def allows(self, label: str, most: Level, used: Name, scalar: Scalar) -> bool:
        """Whether an expression may contain a name; if not, a fault is reported.

        used : the name.
        label : name of the expression in messages.
        most : the highest level on which it may depend.
        """
        name, meaning = used.text, self.names.meaning(used.text)
        if name in self.bound:
            return True
        if meaning is None:
            if not self.names.is_faulty(name) and self.names.complete:
                among = list(self.known) if most is Level.NUMBER else None
                self.refuse_unknown(used, scalar, among, output=most is Level.OUTPUT)
            return False
        kind, base = meaning
        if kind.level > most:
            return self.refuse(used, scalar, *_misplaced(name, kind, label, most))
        if kind not in OF_DEFINITIONS:
            # A parameter without a value is already reported; only numbers need the
            # value.
            unvalued = kind is NameKind.PARAMETER and name not in self.known
            unbuilt = kind is NameKind.ENERGY and self.energies.get(name, 0) is None
            return not (unvalued and most is Level.NUMBER) and not unbuilt
        node, level = self.definitions.get(base, (None, Level.POSITION))
        code: ErrorCode | Literal[""] = ""
        text, hint = f"the definition `{name.lstrip(HIDDEN)}`", ""
        if kind is not NameKind.DEFINITION and level is not Level.POSITION:
            code = NO_RATE
            text = f"`{name}` is the rate of `{base}`, which depends on "
            text += level.text
            hint = "rates exist of coordinates and of definitions of positions and "
            hint += "time"
        elif level > most and level is Level.OUTPUT:
            code, hint = OUTPUT_ONLY, _FOR_OUTPUT
            text += f" uses {level.text}; {label} cannot use it"
        elif level > most:
            code = VELOCITY_NOT_ALLOWED
            text += f" depends on velocities; {label} must not"
        if code:  # a fault of a hidden definition is reported at its own place
            is_hidden = code == NO_RATE and base[:1] == HIDDEN
            return not is_hidden and self.refuse(used, scalar, code, text, hint)
        return node is not None

    def refuse_unknown(
        self,
        used: Name,
        scalar: Scalar,
        among: Collection[str] | None,
        *,
        output: bool = False,
    ) -> None:
        """Report an unknown name; only once where one hint covers several names.

        used, scalar : the name, and the expression.
        among : see `names.Names.unknown`.
        output : whether accelerations are permitted here.
        """
        name, names = used.text, self.names
        place = scalar.place_of_name(used.text, used.offset)
        if self.faults.is_known(UNKNOWN_NAME, place):
            return
        if name in names.tables:
            hint = f"it is a function: write {name}(...)"
            self.refuse(used, scalar, UNKNOWN_NAME, f"`{name}` is a table", hint)
            return
        found = hints.matching(scalar.text, used.offset, parsed=True)
        hint = found[2] if found else ""
        if hint and (scalar, hint) == self._last_hint:
            return
        self._last_hint = scalar, hint
        text, other = names.unknown(name, self.faults, among)
        hint = hint or other
        if hint.startswith("write "):
            hint = self.meant(scalar) or hint
        if not hint and not hints.spelt_call(name, ""):
            hint = self.meant(scalar)
        if not hint and output:
            hint = f"define `{in_one_line(name)}` in `definitions`"
        hint = hint or f"give `{in_one_line(name)}` a value in `parameters`"
        self.refuse(used, scalar, UNKNOWN_NAME, text, hint)

    def _node(self, name: str) -> int:
        if name in self.bound:
            return self.bound[name]
        meaning = self.names.meaning(name)
        assert meaning is not None
        kind, base = meaning.kind, meaning.base
        if kind is NameKind.PI:
            return self.graph.constant(math.pi)
        if kind is NameKind.DEFINITION:
            node = self.definitions[base].node
        elif kind in (NameKind.RATE, NameKind.SECOND_RATE):
            node = self.rate_of(base, second=kind is NameKind.SECOND_RATE)
        elif kind is NameKind.ENERGY and name != "energy":
            node = self.energies[name]
        elif kind is NameKind.STATE_RATE:
            node = self.states.get(base, self.graph.variable(name))
        else:
            node = self.graph.variable(name)
        assert node is not None
        return node

    def replace_rates(self, rates: dict[str, int]) -> None:
        """Replace the variables `s_dot` in definitions by the rates of states.

        rates : name of a state -> graph node of its rate.
        """
        g, known, self._rates = self.graph, self.definitions, []
        self.states = rates
        new = {g.variable(rate_of(s)): node for s, node in rates.items()}
        built = {name: d.node for name, d in known.items() if d.node is not None}
        nodes = g.substitute(built.values(), new)
        for (name, old), node in zip(built.items(), nodes, strict=True):
            known[name] = known[name]._replace(node=node)
            used = g.depends([old])
            self.with_rates[name] = {s for s in rates if rate_of(s) in used}
            self.with_rates[rate_of(name)] = {s for s in rates if s in used}
        self.with_rates |= {rate_of(s): {s} for s in rates}

    def refuse_rates(self, node: Node | None, label: str) -> None:
        """Report rates in an expression that depend on coordinates or velocities.

        The rates are those of first-order states. Derivatives of the expression would
        treat such a rate as a given function of time, without slopes.


        node, label : the expression in the file, and its name in messages.
        """
        if node is None or not self.with_rates:
            return
        moving = self.names.velocities().union(self.names.of(NameKind.COORDINATE))
        used = {s for word in words_below(node) for s in self.with_rates.get(word, ())}
        for s in sorted(used):
            if depends := sorted(self.graph.depends([self.states[s]]) & moving):
                text = (
                    f"{label} contains the rate of the state `{s}`, which depends on "
                )
                hint = "replace it by a coordinate with a constraint on its velocity"
                text += f"`{depends[0]}`"
                self.faults.add(STATE_MISPLACED, text, node, hint)

    def rate_of(self, definition: str, *, second: bool = False) -> int:
        """Return the graph node of the total time derivative of a definition.

        The rates of all definitions are computed together: one sweep over the graph
        costs no more than one for a single definition.

        definition : its name; its expression depends on positions and time.
        second : whether the second derivative is returned.
        """
        if not self._rates:
            known = self.definitions.items()
            at_position = ((k, d.node) for k, d in known if d.level is Level.POSITION)
            self._rates.append({k: n for k, n in at_position if n is not None})
        while len(self._rates) < 2 + second:
            g, nodes = self.graph, self._rates[-1]
            motion = {g.variable("t"): g.one}
            for s in self.names.of(NameKind.STATE):
                motion[g.variable(s)] = self.states.get(s, g.variable(rate_of(s)))
            for q in self.names.of(NameKind.COORDINATE):
                motion[g.variable(q)] = g.variable(rate_of(q))
                motion[g.variable(rate_of(q))] = g.variable(rate_of(q, 2))
            rates = tangent(g, nodes.values(), motion)
            self._rates.append(dict(zip(nodes, rates, strict=True)))
        return self._rates[1 + second][definition]


def _misplaced(
    name: str, kind: NameKind, label: str, most: Level
) -> tuple[ErrorCode, str, str]:
    """Return code, text and hint for a known name that is not permitted here.

    label : name of the expression.
    most : the highest level on which it may depend.
    """
    text = f"`{name}` is {kind.text}"
    if most is Level.NUMBER:
        hint = "numbers are made of parameters and `pi`"
        return NOT_CONSTANT, f"{text}; {label} must be a number", hint
    if kind.level is Level.VELOCITY:
        text = f"{text}; {label} must not depend on velocities"
        return VELOCITY_NOT_ALLOWED, text, ""
    text = f"{text}, which the motion gives; {label} cannot use it"
    return OUTPUT_ONLY, text, _FOR_OUTPUT
