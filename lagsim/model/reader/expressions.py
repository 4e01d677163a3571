"""Names of a file, and compilation of its expressions to nodes of the graph.

Each expression has a set of quantities on which it may depend.
"""

from __future__ import annotations

import math
import re
import unicodedata
from copy import copy
from dataclasses import dataclass, field
from enum import Enum
from functools import partial
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, TypeVar

from lagsim import limits
from lagsim.codes.known import (
    BAD_NAME,
    COLUMN_CLASH,
    EXPRESSION_ARITY,
    EXPRESSION_COMPONENT,
    EXPRESSION_MEMBER,
    EXPRESSION_RANGE,
    EXPRESSION_SIZE,
    EXPRESSION_SUBSCRIPT,
    EXPRESSION_TOO_LONG,
    EXPRESSION_TOO_MANY,
    NAME_CLASH,
    NO_RATE,
    NOT_AN_EXPRESSION,
    NOT_CONSTANT,
    NOT_FINITE,
    OUT_OF_RANGE,
    OUTPUT_ONLY,
    RESERVED_NAME,
    STATE_MISPLACED,
    UNKNOWN_NAME,
    VELOCITY_NOT_ALLOWED,
)
from lagsim.language import columns
from lagsim.language.columns import FORCE, MULTIPLIER, REACTION, RESIDUAL, Owner
from lagsim.language.derivatives import tangent
from lagsim.language.evaluate import evaluate
from lagsim.language.functions import FUNCTIONS, JOINING
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
    RESERVED,
    entries,
    in_one_line,
    is_mapping,
    kind_of,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable, Iterator, Mapping

    from lagsim.errors import Place
    from lagsim.language.graph import Graph
    from lagsim.language.parser import Name
    from lagsim.model.model import Table
    from lagsim.model.nodes import Entry, Reading
    from lagsim.model.reader.fields import Faults

    # Predicate: whether a name is allowed in an expression; reports it if not.
    Rule = Callable[[Name, Scalar], bool]
    from lagsim.codes.known import ErrorCode

_P = TypeVar("_P", Parsed, ParsedRelation)

# A value, and a bound of its rounding error.
Value = tuple[float, float]
# A name with its unit or its argument in brackets, or with digits before it.
_DECORATED = re.compile(r"([^\W\d_]\w*)\s*[(\[]\s*(.*?)\s*[)\]]")
_DIGITS_FIRST = re.compile(r"(\d+)([^\W\d_]\w*)")
# Faults that no other spelling of the text mends.
_OF_MEMBERS = (
    EXPRESSION_SIZE, EXPRESSION_COMPONENT, EXPRESSION_MEMBER, EXPRESSION_SUBSCRIPT,
    EXPRESSION_RANGE, EXPRESSION_TOO_MANY, EXPRESSION_ARITY,
)  # fmt: skip
_A_COLUMN = "it is in the table and in its pictures in any case: leave it out here"


class NameKind(Enum):
    """Kinds of names in expressions: a text for messages, and a level."""

    PI = "the number pi", Level.NUMBER
    PARAMETER = "a parameter", Level.NUMBER
    MODE = "a mode", Level.POSITION  # not a constant
    TIME = "the time", Level.POSITION
    COORDINATE = "a coordinate", Level.POSITION
    VELOCITY = "a velocity", Level.VELOCITY
    STATE = "a state", Level.POSITION
    STATE_RATE = "the rate of a state", Level.VELOCITY
    ACCELERATION = "an acceleration", Level.OUTPUT
    DEFINITION = "a definition", Level.POSITION  # or what is defined depends on
    RATE = "the rate of a definition", Level.VELOCITY
    SECOND_RATE = "the second rate of a definition", Level.OUTPUT
    MULTIPLIER = "a constraint multiplier", Level.OUTPUT
    CONSTRAINT_FORCE = "a constraint force", Level.OUTPUT
    ENERGY = "an energy", Level.OUTPUT
    REACTION = "a reaction", Level.OUTPUT
    TABLE = "a table", Level.NUMBER

    def __init__(self, text: str, level: Level) -> None:
        self.text = text
        self.level = level


# Derived names: prefix and suffix, and the derived kind for each kind of the base.
_Kinds = dict[NameKind | None, NameKind]
_DERIVED: tuple[tuple[str, str, _Kinds], ...] = (
    ("", "_dot",
     {NameKind.COORDINATE: NameKind.VELOCITY, NameKind.DEFINITION: NameKind.RATE,
      NameKind.STATE: NameKind.STATE_RATE}),
    ("", "_ddot",
     {NameKind.COORDINATE: NameKind.ACCELERATION,
      NameKind.DEFINITION: NameKind.SECOND_RATE}),
    (MULTIPLIER.prefix, "", {}),  # of constraints
    (FORCE.prefix, "", {NameKind.COORDINATE: NameKind.CONSTRAINT_FORCE}),
)  # fmt: skip


class Meaning(NamedTuple):
    """Meaning of a name: its kind and base (`x` for `x_dot`, `c` for `lambda_c`)."""

    kind: NameKind
    base: str


@dataclass(slots=True)
class Names:
    """Names of a file.

    Attributes
    ----------
    has_lagrangian
        Whether the file has a Lagrangian, so that its energies are not known.
    variables, places
        Kind and place of each parameter, coordinate, state and definition.
    faulty
        Names with a reported fault; their use is not reported again.
    constraints
        Name and place of each constraint; a namespace of its own.
    reactions
        Definitions listed in `output.reactions`, as far as the list is readable.
    readable
        False where a section that declares names could not be read.
    started
        Names with an entry in `initial`.
    broken
        Names of families whose ranges have a fault.
    tables
        Tables without faults, by name.
    called
        Names of tables that expressions call.
    """

    has_lagrangian: bool
    readable: bool = True
    variables: dict[str, NameKind] = field(default_factory=dict)
    places: dict[str, Place] = field(default_factory=dict)
    constraints: dict[str, Place] = field(default_factory=dict)
    reactions: list[str] = field(default_factory=list)
    faulty: set[str] = field(default_factory=set)
    started: set[str] = field(default_factory=set)
    broken: set[str] = field(default_factory=set)
    tables: dict[str, Table] = field(default_factory=dict)
    called: set[str] = field(default_factory=set)
    _known: dict[object, Any] = field(default_factory=dict, init=False)
    _meanings: dict[str, Meaning] = field(default_factory=dict, init=False)

    @property
    def complete(self) -> bool:
        """Whether all declared names are known, so that any other name is a fault."""
        return self.readable and bool(self.of(NameKind.COORDINATE) or self.broken)

    def section(
        self, section: Node | None, what: str, kind: NameKind, faults: Faults
    ) -> list[Entry]:
        """Declare the names of a section and return the valid entries."""
        if section is None:
            return []
        given = entries(section, what, faults)
        self.readable &= is_mapping(section)
        return [entry for entry in given if self.declare(entry[0], kind, faults)]

    def declare(self, key: Scalar, kind: NameKind, faults: Faults) -> bool:
        """Declare a name as a variable of the file; return whether it is valid."""
        name, self._known, self._meanings = key.text, {}, {}
        if not check_name(key, kind.text, faults):
            self.faulty |= {name, *(f[1] for f in _DECORATED.finditer(name))}
            return False
        if name in self.faulty:
            return False
        if name not in self.variables:
            self.variables[name], self.places[name] = kind, key.place
            return True
        self.faulty.add(name)
        both = [(self.places[name], self.variables.pop(name)), (key.place, kind)]
        (there, first), (here, second) = sorted(both, key=lambda one: one[0][1:3])
        text = f"`{name}` is {first.text} already and cannot be {second.text} too"
        hint = f"the first is in line {there.line}; parameters, coordinates, states, "
        hint += "modes and definitions share one namespace"
        faults.add(NAME_CLASH, text, here, hint)
        return False

    def of(self, kind: NameKind) -> list[str]:
        """Return the names of one kind, in the order of the file."""
        if not self._known:
            kinds: dict[object, list[str]] = {k: [] for k in NameKind}
            for name, k in self.variables.items():
                if name[:1] != HIDDEN:
                    kinds[k].append(name)
            velocities = frozenset(map(rate_of, kinds[NameKind.COORDINATE]))
            self._known = {**kinds, "velocities": velocities}
        found: list[str] = self._known[kind]
        return found

    def velocities(self) -> frozenset[str]:
        """Return the names of the velocities."""
        self.of(NameKind.COORDINATE)
        found: frozenset[str] = self._known["velocities"]
        return found

    def moving(self) -> list[str]:
        """Return the names that have rates: coordinates and definitions."""
        return self.of(NameKind.COORDINATE) + self.of(NameKind.DEFINITION)

    def meaning(self, name: str) -> Meaning | None:
        """Return kind and base of a name in an expression: (velocity, `x`) for `x_dot`.

        None if it has no meaning.
        """
        if name not in self._meanings:
            found = self._meaning(name)
            if found is None:  # it may be declared later
                return None
            self._meanings[name] = found
        return self._meanings[name]

    def _meaning(self, name: str) -> Meaning | None:
        if self.variables.get(name, NameKind.TABLE) is not NameKind.TABLE:
            return Meaning(self.variables[name], name)
        if name in ("t", "pi"):
            return Meaning(NameKind.TIME if name == "t" else NameKind.PI, name)
        known = ["energy", *([] if self.has_lagrangian else ("kinetic", "potential"))]
        if name in known:
            return Meaning(NameKind.ENERGY, name)
        base = name.removeprefix(REACTION.prefix)
        if base != name and base in self.reactions:
            return Meaning(NameKind.REACTION, base)
        for base, kinds in _parted(name):
            if kind := kinds.get(self.variables.get(base)):
                return Meaning(kind, base)
        base = name.removeprefix(MULTIPLIER.prefix)
        constraint = base != name and base in self.constraints
        return Meaning(NameKind.MULTIPLIER, base) if constraint else None

    def is_faulty(self, name: str) -> bool:
        """Whether `name` depends on a name with a reported fault."""
        names = [name, *(base for base, _ in _parted(name))]
        families = [n.partition(".")[0] for n in names]
        return not self.faulty.isdisjoint([*names, *families])

    def unknown(
        self, name: str, faults: Faults, among: Collection[str] | None = None
    ) -> tuple[str, str]:
        """Return the text of a fault on an unknown name, and a hint.

        `among`: the names that are allowed in this place, where not all are.
        """
        base = name.removeprefix(REACTION.prefix)
        if base != name:
            near = faults.guess(base, self.of(NameKind.DEFINITION)) or base
            hint = f"add output: {{reactions: [{near}]}}"
            return f"there is no column `{name}`: `reactions` does not list it", hint
        for ending in ("_ddot", "_dot"):
            base = name.removesuffix(ending)
            if base != name:
                return self._unknown_rate(name, base, ending, faults)
        if name in ("kinetic", "potential"):
            text = f"`{name}` is not known where the file gives `lagrangian`"
            return text, "`energy` is known"
        if name in ("lagrangian", "work") or columns.made(name, RESIDUAL):
            hint = _A_COLUMN
            if name == "lagrangian" and not self.has_lagrangian:
                hint = "write kinetic - potential"
            return f"`{name}` is a column of results, not a name for expressions", hint
        base = name.removeprefix(MULTIPLIER.prefix)
        if base != name and self.constraints:
            near = faults.guess(base, self.constraints)
            hint = f"did you mean `lambda_{near}`?" if near else ""
            return f"there is no constraint `{base}`", hint
        if name in self.started and among is None:
            self.faulty.add(name)  # reported once
            hint = f"it has a start value: write `{name}: {{}}` in `coordinates`"
            return f"unknown name `{name}`", hint
        usable = self.variables if among is None else among
        hint = hints.of_name(name, usable, self.moving() if among is None else ())
        hint = hint or faults.did_you_mean(name, usable)
        if not hint and name in FUNCTIONS:
            hint = f"a function is followed by its arguments: {name}(...)"
        return f"unknown name `{in_one_line(name)}`", hint

    def _unknown_rate(
        self, name: str, base: str, ending: str, faults: Faults
    ) -> tuple[str, str]:
        meaning = self.meaning(base)
        if meaning is None:
            near = faults.guess(base, self.moving())
            near = near and f"did you mean `{near}{ending}`?"
            hint = near or f"define `{base}` in `coordinates` or `definitions`"
            return f"`{name}`: there is no coordinate or definition `{base}`", hint
        if meaning.kind.level is Level.VELOCITY:
            hint = f"the second rate is written `{meaning.base}_ddot`"
            return f"`{name}` is no name", hint if ending == "_dot" else ""
        text = f"`{name}`: `{base}` is {meaning.kind.text} and has no rate here"
        return text, "rates exist of coordinates and of definitions of positions"


def _parted(name: str) -> Iterator[tuple[str, _Kinds]]:
    """Yield the names from which a name could be derived, with the kinds of derivation.

    For `x_dot`: `x` and velocity.
    """
    head, dot, tail = name.partition(".")
    for before, after, kinds in _DERIVED:
        base = head.removeprefix(before).removesuffix(after)
        if base != head:
            yield f"{base}{dot}{tail}", kinds


def check_name(key: Scalar, what: str, faults: Faults) -> bool:
    """Whether a key is valid as a name; if not, a fault is reported."""
    name = key.text
    if key.reading is not None:  # of a member: the name of its family
        name = name.removeprefix(HIDDEN).partition(".")[0]
    code: ErrorCode = RESERVED_NAME
    if problem := _spelling(name):
        text, hint = problem
        text = f"`{in_one_line(name)}` cannot be the name of {what}: {text}"
        code = BAD_NAME
    elif name in RESERVED:
        text = f"`{name}` is reserved and cannot be the name of {what}"
        hint = "it is built in" if name in ("t", "pi") else "it is a column of results"
    elif what == NameKind.TABLE.text and name in FUNCTIONS:
        text, hint = f"`{name}` is a function already and cannot be {what} too", ""
    elif name in JOINING:
        text, hint = f"`{name}` is an operator and cannot be the name of {what}", ""
    elif ending := re.search("_d?dot$", name):
        text = f"`{name}`: a name of {what} must not end in `{ending[0]}`"
        rate = "rates" if ending[0] == "_dot" else "accelerations"
        hint = f"that ending is for the {rate} of coordinates and definitions"
    else:
        return True
    faults.add(code, text, key, hint)
    return False


def _spelling(name: str) -> tuple[str, str] | None:
    """Return the reason why a text cannot be a name, and a hint; None if it can."""
    plain = unicodedata.normalize("NFKC", name)
    if plain != name:
        return "it is not in its plain (NFKC) form", f"write `{in_one_line(plain)}`"
    if not name:
        return "it is empty", ""
    rest_fits = all(c == "_" or c.isalpha() or c.isdecimal() for c in name)
    if name[0].isalpha() and rest_fits:
        return None
    fault = "a name is a letter, then letters, digits and `_`"
    if "\n" in name:
        fault = "it has a line break"
    if found := _DECORATED.fullmatch(name):
        return fault, _undecorated(*found.groups(), called=name.endswith(")"))
    if found := _DIGITS_FIRST.fullmatch(name):
        return fault, f"write `{found[2]}{found[1]}`"
    if equals := re.fullmatch(r"(\w+)\s*:?=\s*([^=]+)", name):
        return fault, f"write `{equals[1]}: {equals[2]}`"
    fitting = re.sub(r"[\W_]+", "_", name).strip("_")
    if fitting and fitting[0].isalpha() and fitting != name and len(fitting) < 40:
        return fault, f"write `{fitting}`"
    return fault, ""


def _undecorated(name: str, decoration: str, *, called: bool) -> str:
    """Return a hint for a name that has a unit or an argument attached to it.

    decoration : the attached text. called : whether it is in parentheses.
    """
    hint = f"write `{name}`"
    if quantities.is_unit(decoration):
        beside = f"{{value: ..., unit: {quantities.unit_spelling(decoration)}}}"
        return f"{hint}; a unit is written beside the value: {beside}"
    if called:
        hint += ": a definition has no arguments, its expression names variables"
    return hint


# The kinds of names with a column; a parameter has none, but its name is an expression.
_SHOWN = (NameKind.COORDINATE, NameKind.STATE, NameKind.MODE, NameKind.DEFINITION)


def _owner(name: str, names: Names) -> tuple[str, Place | None]:
    """Return the meaning of the column that has this name, and its owner's place.

    The meaning is "" where there is no such column. A column that is made only where a
    file has contacts, impulses, sensitivities or uncertainties counts in any file: one
    that adds these later keeps its names.
    """
    found = columns.parsed(name)
    if found is None:
        return "", None
    made, of = found
    if made.owner is Owner.RUN:
        return made.meaning, None
    if made.owner is Owner.PAIR:
        pairs = columns.halves(of)
        both = [x for x in pairs if all(one in names.places for one in x)]
        if not both:
            return "", None
        return made.meaning.format(*both[0]), names.places[both[0][0]]
    place = _place_of(of, made.owner, names)
    return (made.meaning.format(of) if place else ""), place


def _place_of(of: str, owner: Owner, names: Names) -> Place | None:
    """Return the place of an owner of columns; None where there is no such name."""
    if owner is Owner.CONSTRAINT:
        whole = re.sub(r"\.[12]$", "", of)  # of two relations, or two slips
        return names.constraints.get(of, names.constraints.get(whole))
    of = of if of in names.variables else of.replace("_dot", "")
    kinds = _SHOWN if owner is Owner.COLUMN else (NameKind.COORDINATE,)
    return names.places.get(of) if names.variables.get(of) in kinds else None


def check_columns(names: Names, faults: Faults) -> None:
    """Report names that equal a column which the file makes of its other names."""
    for name, place in names.places.items():
        if "." in name and names.variables.get(name) not in _SHOWN:
            continue
        meaning, other = _owner(name, names)
        if meaning:
            text = f"`{name}` is the column of {meaning} in this file"
            hint = f"the first is in line {other.line}" if other else ""
            faults.add(COLUMN_CLASH, text, place, hint)


# --- Expressions

OF_DEFINITIONS = (NameKind.DEFINITION, NameKind.RATE, NameKind.SECOND_RATE)
_FOR_OUTPUT = "such names are allowed only in definitions for output, and in plots"


class Resolved(NamedTuple):
    """Node and level of a definition; `node` is None where a fault was reported."""

    node: int | None
    level: Level


class Expressions:
    """Compiler of expressions; a fault is added to `faults`, and the result is None.

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
        The definitions that have been built.
    energies
        Nodes of `kinetic` and `potential`, once built.
    states
        Rates of the first-order states, once built; before, variables such as `s_dot`.
    with_rates
        For each name, the states whose rates its expression contains.
    bound
        Nodes of names local to a part of the file, such as a curve's parameter.
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
        """Return a copy with another list of faults, and other parameter values."""
        other = copy(self)
        other.faults, other.known, other.modes = faults, dict(known), {}
        other.read = []
        return other

    # Reading a text

    def scalar(
        self, node: Node | None, what: str, *, beside: bool = False
    ) -> Scalar | None:
        """Return the scalar of an expression, or None; other nodes are reported.

        `beside`: a unit may be given beside the expression.
        """
        if node is None or isinstance(node, Broken):
            return None
        hint = "write a number or an expression, such as 0"
        if not isinstance(node, Scalar):
            hint = quantities.of_collection(node, beside=beside)
        elif node.style or not node.empty:
            return node
        text = f"{what} must be an expression, found {kind_of(node)}"
        self.faults.add(NOT_AN_EXPRESSION, text, node, hint)
        return None

    def text(
        self,
        node: Node | None,
        what: str,
        parser: Callable[[str], _P],
        *,
        beside: bool = False,
    ) -> tuple[Scalar, _P] | None:
        """Return the scalar of an expression, and its parsed form.

        `what`: its name in messages; `beside`: a unit may be given beside it.
        """
        scalar = self.scalar(node, what, beside=beside)
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
        self.read.append((what, scalar, found))
        return scalar, found

    def _check_calls(self, found: Parsed | ParsedRelation, text: str) -> None:
        """Report calls of tables with a wrong number of arguments."""
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
        """Return a parser that accepts calls of the file's tables.

        The tables that the text calls are stored as called.
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
        """Report the parser's fault in a relation or in another expression."""
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
        """Return a hint for an expression with faults, or an empty text."""
        if not self.faults.may_guess():
            return ""
        known, moving = self.names.variables, self.names.moving()
        reading = scalar.reading or self.reading
        if reading is not None:
            parser = partial(reading.parsed, parser=parser)
        return hints.of_text(scalar.text, parser, known, moving, beside=beside)

    # Building nodes

    def compile(
        self, node: Node | None, what: str, most: Level, *, condition: bool = False
    ) -> int | None:
        """Return the graph node of an expression, or None.

        `most` is the highest level on which it may depend; `condition`: it is a
        condition, as the first argument of `if`.
        """
        found = self.text(node, what, parse_condition if condition else parse)
        if found is None:
            return None
        scalar, parsed = found
        sound = self.check(parsed.names, scalar, what, most)
        return self.build(parsed) if sound else None

    def build(self, parsed: Parsed) -> int:
        """Return the node of an expression whose names were checked."""
        return parsed.build(self.graph, self._node, self.names.tables)

    def number(
        self, node: Node | None, what: str, *bounds: float, positive: bool = False
    ) -> float | None:
        """Return the finite value of an expression of parameters, or None.

        `bounds`, `positive`: see `within`.
        """
        found = self.compile(node, what, Level.NUMBER)
        if node is None or found is None:
            return None
        value, at = self.value(found, what, node.place), node.place
        if value is None or not self.within(
            value, what, at, *bounds, positive=positive
        ):
            return None
        return value

    def value(self, found: int, what: str, place: Place) -> float | None:
        """Return the value of a node of parameters alone, if it is finite."""
        numbers = {name: value for name, (value, _) in self.known.items()}
        value = evaluate(self.graph, [found], numbers)[0]
        return value if self.is_finite(value, what, place) else None

    def within(
        self,
        value: float,
        what: str,
        place: Place | None,
        least: float = -math.inf,
        most: float = math.inf,
        *,
        positive: bool = False,
    ) -> bool:
        """Whether a number lies in its range; if not, a fault is reported.

        least, most : the range. positive : 0 is excluded.
        """
        rule = "be positive" if positive and value <= 0.0 else ""
        if value > most:
            rule = f"not exceed {most:g}"
        elif value < least:
            rule = f"not be below {least:g}" if least else "not be negative"
        if rule:
            text = f"{what} is {value:g}; it must {rule}"
            self.faults.add(OUT_OF_RANGE, text, place)
        return not rule

    def is_finite(self, value: float, what: str, place: Place) -> bool:
        """Whether a value is finite; if not, a fault is reported."""
        if not math.isfinite(value):
            text = f"{what} is {value}, which is not a finite number"
            self.faults.add(NOT_FINITE, text, place)
        return math.isfinite(value)

    def check(
        self, used: Iterable[Name], scalar: Scalar, what: str, most: Level
    ) -> bool:
        """Whether all names `used` are allowed in an expression; others are reported.

        most : the highest level of quantities on which it may depend.
        """
        return self.check_by(partial(self.allows, what, most), used, scalar)

    def check_by(self, rule: Rule, used: Iterable[Name], scalar: Scalar) -> bool:
        """Whether a rule allows all names of an expression.

        rule : (name, scalar) -> whether the name is allowed; it reports names that are
        not. Each name is checked once.
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
        """Report a name that is not allowed in its place; return False."""
        place = scalar.place_of_name(used.text, used.offset)
        self.faults.add(code, text, place, hint)
        return False

    def allows(self, what: str, most: Level, used: Name, scalar: Scalar) -> bool:
        """Whether an expression may contain a name; if not, a fault is reported.

        what : the expression's name in messages. most : the highest level that it may
        have.
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
            return self.refuse(used, scalar, *_misplaced(name, kind, what, most))
        if kind not in OF_DEFINITIONS:
            # A parameter without a value is reported already; only numbers need it.
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
            text += f" uses {level.text}; {what} cannot use it"
        elif level > most:
            code = VELOCITY_NOT_ALLOWED
            text += f" depends on velocities; {what} must not"
        if code:  # a fault of a hidden definition is reported at its own place
            silent = code == NO_RATE and base[:1] == HIDDEN
            return not silent and self.refuse(used, scalar, code, text, hint)
        return node is not None

    def refuse_unknown(
        self,
        used: Name,
        scalar: Scalar,
        among: Collection[str] | None,
        *,
        output: bool = False,
    ) -> None:
        """Report an unknown name; once where one hint covers several names.

        `among`: see `Names.unknown`; `output`: accelerations are allowed there.
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

    def take_states(self, rates: dict[str, int]) -> None:
        """Replace variables such as `s_dot` in definitions by the rates of states.

        rates : state's name -> node of its rate.
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

    def refuse_rates(self, node: Node | None, what: str) -> None:
        """Report rates of states that depend on the motion, before derivatives.

        Such a rate counts as given in time, with no slope of its own.
        """
        if node is None or not self.with_rates:
            return
        moving = self.names.velocities().union(self.names.of(NameKind.COORDINATE))
        used = {s for word in words_below(node) for s in self.with_rates.get(word, ())}
        for s in sorted(used):
            if depends := sorted(self.graph.depends([self.states[s]]) & moving):
                text = f"{what} contains the rate of the state `{s}`, which depends on "
                hint = "replace it by a coordinate with a constraint on its velocity"
                text += f"`{depends[0]}`"
                self.faults.add(STATE_MISPLACED, text, node, hint)

    def rate_of(self, definition: str, *, second: bool = False) -> int:
        """Return the node of the total time derivative of a definition of positions.

        The rates of all definitions are computed together: one sweep over the graph
        costs no more than one for a single definition.
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
    name: str, kind: NameKind, what: str, most: Level
) -> tuple[ErrorCode, str, str]:
    """Return code, text and hint of a known name that is not allowed in its place."""
    text = f"`{name}` is {kind.text}"
    if most is Level.NUMBER:
        hint = "numbers are made of parameters and `pi`"
        return NOT_CONSTANT, f"{text}; {what} must be a number", hint
    if kind.level is Level.VELOCITY:
        text = f"{text}; {what} must not depend on velocities"
        return VELOCITY_NOT_ALLOWED, text, ""
    text = f"{text}, which the motion gives; {what} cannot use it"
    return OUTPUT_ONLY, text, _FOR_OUTPUT
