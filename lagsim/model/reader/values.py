"""Reader of coordinates, definitions, parameters and start values."""

from __future__ import annotations

import math
import re
from collections import ChainMap
from contextlib import suppress
from functools import partial
from graphlib import CycleError, TopologicalSorter
from typing import TYPE_CHECKING, NamedTuple

from lagsim.codes.known import (
    CYCLE,
    LATER_INITIAL,
    LATER_PARAMETER,
    MISSING_INITIAL,
    MISSING_KEY,
    NO_RATE,
    NOT_A_GUESS,
    NOT_A_MAPPING,
    NOT_A_START_VALUE,
    NOT_AN_EXPRESSION,
    OUT_OF_RANGE,
    OUTPUT_ONLY,
    UNKNOWN_NAME,
    UNKNOWN_PARAMETER,
    WRONG_COUNT,
)
from lagsim.language.evaluate import evaluate_with_error
from lagsim.language.graph import Graph
from lagsim.language.names import HIDDEN, in_file, member_hint, rate_of, rated
from lagsim.language.parser import parse
from lagsim.model.model import Coordinate, Definition, InitialValue, Level, Parameter
from lagsim.model.nodes import (
    Broken,
    Entry,
    Mapping,
    Node,
    Scalar,
    Sequence,
    argument,
    entries_of,
    texts_of,
)
from lagsim.model.reader import hints, quantities
from lagsim.model.reader.expressions import OF_DEFINITIONS, Resolved, Value
from lagsim.model.reader.fields import (
    COORDINATE,
    DEFINITION,
    START,
    VALUE,
    belongs,
    entries,
    fields,
    is_mapping,
    kind_of,
)
from lagsim.model.reader.names import NameKind
from lagsim.tolerances import UNIT_ROUNDOFF

if TYPE_CHECKING:
    from collections.abc import Mapping as MappingType

    from lagsim.codes.known import ErrorCode
    from lagsim.errors import Place
    from lagsim.language.parser import Name, Parsed
    from lagsim.model.model import Table
    from lagsim.model.reader.expressions import Expressions, Rule
    from lagsim.model.reader.fields import Form


def read_coordinates(given: list[Entry], x: Expressions) -> tuple[Coordinate, ...]:
    """Return the coordinates of the entries `given`; faults are reported."""
    found = []
    for key, node in given:
        label = f"the coordinate `{key.text}`"
        if isinstance(node, Scalar) and not node.empty:
            text = f"{label} has no value here, found `{node.text}`"
            unit = node.text.removeprefix("unit ")
            hint = f"write {{unit: {unit}}}; start values belong in `initial`"
            if re.match(r"[-+.\d]", node.text):
                hint = "write {}; its start value belongs in `initial`"
            x.faults.add(NOT_A_MAPPING, text, node, hint)
            found.append(Coordinate(key.text))
            continue
        below = fields(node, label, COORDINATE, x.faults, key.place)
        unit, about = below.text("unit"), below.text("description")
        found.append(Coordinate(key.text, unit, about))
    return tuple(found)


class _Entry(NamedTuple):
    """Value of an entry `name: expression`, or `name: {value: expression, ...}`.

    `value`, `uncertainty` and `range` are YAML nodes, `unit` and `about` (the
    description) texts; all but `value` are further keys of the mapping.
    """

    value: Node
    unit: str = ""
    about: str = ""
    uncertainty: Node | None = None
    range: Node | None = None


def _value_entry(
    key: Scalar, node: Node, label: str, x: Expressions, form: Form = DEFINITION
) -> _Entry:
    """Return the value and the further keys of an entry, see `_Entry`.

    key, node : name and value in the file.
    label : name of the entry in messages.
    form : the keys that the mapping may have.
    """
    if not isinstance(node, Mapping):
        return _Entry(node)
    found = fields(node, label, form, x.faults, key.place)
    found.needs("value", belongs(key.text) or "write {value: ..., unit: ...}")
    value = found.value("value") or Broken(key.place)
    about = found.text("unit"), found.text("description")
    return _Entry(value, *about, found.value("uncertainty"), found.value("range"))


class Definitions:
    """Reader of definitions: parses them, then builds their graph nodes by levels.

    Definitions of level OUTPUT are built after the energies.

    Parameters
    ----------
    given : list of Entry
        The entries of the section `definitions`.
    x : Expressions
        Expressions of the file.
    """

    def __init__(self, given: list[Entry], x: Expressions) -> None:
        self.x = x
        self._about: dict[str, tuple[str, str]] = {}
        # expressions without a fault
        self._texts: dict[str, tuple[Scalar, Parsed]] = {}
        for key, node in given:
            name, label = key.text, f"the definition `{key.text}`"
            entry = _value_entry(key, node, label, x)
            self._about[name] = entry.unit, entry.about
            text = x.text(entry.value, label, parse, beside=entry.value is node)
            if text is not None:
                self._texts[name] = text
        # The definitions that each expression names, at their first place; the level of
        # other names.
        self._uses: dict[str, dict[str, Name]] = {name: {} for name in self._about}
        levels = dict.fromkeys(self._about, Level.POSITION)
        for name, (_, parsed) in self._texts.items():
            for used in parsed.names:
                kind, base = x.names.meaning(used.text) or (NameKind.PI, "")
                levels[name] = max(levels[name], kind.level)
                if kind in OF_DEFINITIONS and base in self._about:
                    self._uses[name].setdefault(base, used)
        self._order = self._in_order()
        self._report_cycles()
        for name in self._order:
            below = (x.definitions[used].level for used in self._uses[name])
            x.definitions[name] = Resolved(None, max((levels[name], *below)))

    def _in_order(self) -> list[str]:
        """Return the definitions, each after all that it contains, without cycles."""
        # Among definitions without open dependencies the order is that of the file.
        sorter = TopologicalSorter(dict.fromkeys(self._about, ()))
        for name, uses in self._uses.items():
            sorter.add(name, *uses)
        with suppress(CycleError):
            sorter.prepare()
        order: list[str] = []
        while ready := sorter.get_ready():
            order += ready
            sorter.done(*ready)
        return order

    def _report_cycles(self) -> None:
        cyclic = self._about.keys() - set(self._order)
        position = {name: k for k, name in enumerate(self._about)}
        seen: set[str] = set()
        for start in self._about:
            name, path = start, list[str]()
            while name in cyclic and name not in seen:
                seen.add(name)
                path.append(name)
                name = next(used for used in self._uses[name] if used in cyclic)
            if name in path:
                cycle = path[path.index(name) :]
                at = cycle.index(min(cycle, key=position.__getitem__))
                self._report(cycle[at:] + cycle[:at])

    def _report(self, cycle: list[str]) -> None:
        scalar, at = self._texts[cycle[0]][0], self._uses[cycle[0]][(cycle * 2)[1]]
        shown = cycle if len(cycle) <= 12 else [*cycle[:10], "...", cycle[-1]]
        about = f"the definition `{cycle[0]}` depends on itself: "
        about += " -> ".join(name.lstrip(HIDDEN) for name in [*shown, cycle[0]])
        place = scalar.place_of_name(at.text, at.offset)
        self.x.faults.add(CYCLE, about, place)

    def build(self, *levels: Level) -> None:
        """Build the graph nodes of definitions of the given levels, positions first."""
        known = self.x.definitions
        for level in levels:
            most = max(level, Level.VELOCITY)
            for name in self._order:
                if known[name].level is not level or name not in self._texts:
                    continue
                scalar, parsed = self._texts[name]
                if self.x.check(parsed.names, scalar, f"the definition `{name}`", most):
                    known[name] = Resolved(self.x.build(parsed), level)

    def read(self, *, hidden: bool = False) -> tuple[Definition, ...]:
        """Return the sound definitions in the order of the file, or the hidden ones."""
        return tuple(
            Definition(name.lstrip(HIDDEN), known.node, known.level, *about)
            for name, about in self._about.items()
            if (known := self.x.definitions.get(name)) and known.node is not None
            if (name[:1] == HIDDEN) is hidden
        )


# --- Numbers from numbers: parameters and start values, and `--set`

# Text before values on the command line, in messages.
SET = "--set "


class Unfolded(Graph):
    """Graph that represents numbers by variables, so that no constants are folded.

    Folding would lose the rounding error of the folded operation: `cos(pi/2)` is not
    zero, but zero within its error.
    """

    def __init__(self) -> None:
        self.numbers = {"pi": (math.pi, UNIT_ROUNDOFF * math.pi)}
        super().__init__()

    def constant(self, x: float) -> int:
        """Return the graph node of a variable whose name is the number `x`."""
        exact = float(x).is_integer()
        self.numbers[repr(x)] = x, 0.0 if exact else UNIT_ROUNDOFF * abs(x)
        return self.variable(repr(x))

    def value_with_error(
        self,
        parsed: Parsed,
        known: dict[str, Value],
        tables: MappingType[str, Table],
    ) -> Value:
        """Return value and rounding error of the expression `parsed`, made of numbers.

        A single number is exact, as written in the file.

        known : value and error of each name in the expression, except `pi`.
        tables : the tables by name.
        """
        (kind, number, _), *more = parsed.postfix
        if not more and kind == "number":
            return float(number), 0.0
        node = parsed.build(self, self.variable, tables)
        values = ChainMap(self.numbers, known)
        value, error = evaluate_with_error(self, [node], values)[0]
        alone = all(kind in ("number", "neg") for kind, *_ in parsed.postfix)
        return value, 0.0 if alone else error


class _Numbers:
    """Reader of numbers whose expressions may use the numbers read before.

    `known` has value and rounding error of each sound number, `formulas` the expression
    of each.

    instead : expressions that replace those of the file, by name.
    """

    def __init__(self, x: Expressions, instead: MappingType[str, str]) -> None:
        self.x = x
        self.known = x.known
        self.formulas: dict[str, Parsed] = {}
        self._unfolded = Unfolded()
        self._instead = {
            name: argument(f"{SET}{name}=", text) for name, text in instead.items()
        }

    def _read(
        self,
        node: Node,
        label: str,
        rule: Rule,
        *,
        beside: bool = False,
        evaluates: bool = True,
    ) -> tuple[Scalar, Parsed, Value] | None:
        """Return an entry's scalar, parsed expression, and value with rounding error.

        None after a fault.

        node, label : the value in the file, and its name in messages.
        rule : see `expressions.Expressions.check_by`.
        beside : whether a unit may be given beside the expression.
        evaluates : False to check the expression only, and return None.
        """
        x, found = self.x, self.x.text(node, label, parse, beside=beside)
        if found is None:
            return None
        scalar, parsed = found
        if not (x.check_by(rule, parsed.names, scalar) and evaluates):
            return None
        value = self._unfolded.value_with_error(parsed, self.known, x.names.tables)
        is_finite = x.is_finite(value[0], label, scalar.place)
        return (scalar, parsed, value) if is_finite else None


class ParameterReader(_Numbers):
    """Reader of parameters and modes."""

    def read(self, given: list[Entry], modes: list[Entry]) -> tuple[Parameter, ...]:
        """Return parameters and modes; faults are reported.

        Expressions of `--set` replace their values.

        given, modes : the entries of the file.
        """
        self._check_names()
        below = {key.text for key, _ in given}  # the parameter being read, and later
        found = []
        for key, node in (*given, *modes):
            kind = self.x.names.variables.get(key.text, NameKind.PARAMETER)
            name, label = key.text, f"the{kind.text[1:]} `{key.text}`"
            form = VALUE if kind is NameKind.PARAMETER else DEFINITION
            entry = _value_entry(key, node, label, self.x, form)
            expression = self._instead.get(name, entry.value)
            rule = partial(self._rule, name, label, below)
            read = self._read(expression, label, rule, beside=expression is node)
            deviation = self._deviation(entry.uncertainty, label, rule)
            between = self._range(entry.range, label, rule)
            below.discard(name)
            if read is not None:
                _, parsed, value = read
                self.formulas[name] = parsed
                follows = any(used.text in self.known for used in parsed.names)
                mode = kind is NameKind.MODE
                (self.x.modes if mode else self.known)[name] = value
                about = entry.unit, entry.about
                found.append(
                    Parameter(name, value[0], *about, follows, mode, deviation, between)
                )
        return tuple(found)

    def _deviation(self, node: Node | None, label: str, rule: Rule) -> float:
        """Return the value of `uncertainty`, a standard deviation; 0 without the key.

        node : the value of the key.
        label : the parameter, for messages.
        rule : see `expressions.Expressions.check_by`.
        """
        if node is None:
            return 0.0
        label = f"`uncertainty` of {label}"
        read = self._read(node, label, rule)
        if read is None:
            return 0.0
        scalar, _, (value, _) = read
        if value < 0.0:
            text = f"{label} is {value:g}, a standard deviation is 0 or larger"
            self.x.faults.add(OUT_OF_RANGE, text, scalar)
        return value

    def _range(
        self, node: Node | None, label: str, rule: Rule
    ) -> tuple[float, float] | None:
        """Return the least and the greatest value of a slider, from the key `range`.

        None without the key, or after a fault. Arguments as for `_deviation`.
        """
        if node is None:
            return None
        label, faults = f"`range` of {label}", self.x.faults
        if not isinstance(node, Sequence) or len(node.items) != 2:
            text = f"{label} is a list of two numbers, the least and the greatest value"
            faults.add(WRONG_COUNT, text, node.place, "write range: [0, 10]")
            return None
        ends = [self._read(end, label, rule) for end in node.items]
        low, high = (None if end is None else end[2][0] for end in ends)
        if low is None or high is None:
            return None
        if not low < high:
            text = f"{label} goes from {low:g} to {high:g}: the second must be larger"
            faults.add(OUT_OF_RANGE, text, node.place)
            return None
        return low, high

    def _check_names(self) -> None:
        names, faults = self.x.names, self.x.faults
        for name, value in self._instead.items():
            meaning = names.meaning(name)
            kind = meaning.kind if meaning else None
            if kind in (NameKind.PARAMETER, NameKind.MODE) or names.is_faulty(name):
                continue
            moving, states = names.moving(), names.of(NameKind.STATE)
            rates = map(rate_of, moving)
            modes = names.of(NameKind.MODE)
            among = [*names.of(NameKind.PARAMETER), *modes, *moving, *states, *rates]
            hint = member_hint(name, among)
            if not hint:
                near = faults.guess(name, among)
                hint = f"did you mean `{near}`?" if near else ""
            text = f"there is no parameter or start value `{name}`"
            if "." in name and self.x.reading is None:
                text, hint = f"`{name}`: names with a dot are reserved", ""
            elif kind is not None:
                text = f"`{name}` is {kind.text}"
                text, hint = f"{text}: others are given to parameters and starts", ""
            elif not names.complete:
                continue
            option = argument(SET, f"{name}={value.text}")
            faults.add(UNKNOWN_PARAMETER, text, option.place_of(0, len(name)), hint)

    def _rule(
        self, name: str, label: str, below: set[str], used: Name, scalar: Scalar
    ) -> bool:
        if used.text not in below:
            return self.x.allows(label, Level.NUMBER, used, scalar)
        text = f"`{name}` uses `{used.text}`, which is below it"
        if used.text == name:
            text = f"`{name}` uses itself"
        hint = "a parameter may use the parameters above it"
        return self.x.refuse(used, scalar, LATER_PARAMETER, text, hint)


# Kinds of names that can have a start value.
STARTED = (
    NameKind.COORDINATE,
    NameKind.VELOCITY,
    NameKind.STATE,
    NameKind.DEFINITION,
    NameKind.RATE,
)


class Initial(_Numbers):
    """Reader of the section `initial`: exact values and guesses."""

    def read(self, entry: Entry | None, root: Place) -> tuple[InitialValue, ...]:
        """Return the start values: positions, velocities, states, then definitions.

        entry : the section `initial`, or None if it is absent.
        root : place of the file.
        """
        x = self.x
        if entry is None:
            hint = "each coordinate needs a start value"
            x.faults.add(MISSING_KEY, "the file has no `initial`", root, hint)
            return ()
        section, node = entry
        given = entries(node, "`initial`", x.faults)
        stated = {key.text for key, _ in given}
        more = ((k, text) for k, text in self._instead.items() if k not in stated)
        given += [(argument(SET, name), text) for name, text in more]
        self.known = {**x.known, **x.modes}
        self._above: set[str] = set()  # keys so far, sound or not
        self._all = {key.text for key, _ in given}
        found: dict[str, InitialValue] = {}
        for key, value in given:
            one = self._start(key, value)
            self._above.add(key.text)
            if one is not None:
                self.known[one.name] = one.value, one.error
                found[one.name] = one
        if is_mapping(node):
            self._check_complete(section)
        return self._in_order(found, section.place)

    def _check_complete(self, section: Scalar) -> None:
        x, graph = self.x, self.x.graph
        started = (x.definitions.get(name) for name in self._above)
        nodes = [d.node for d in started if d is not None and d.node is not None]
        every = [(q, "coordinate", "guess") for q in x.names.of(NameKind.COORDINATE)]
        every += [(s, "state", "steady") for s in x.names.of(NameKind.STATE)]
        for q, label, key in every:
            if q not in self._all and not x.names.is_faulty(q):
                own, text = in_file(q), f"`initial` has no value for the {label} `{q}`"
                hint = f"write `{own}: 0`, or `{own}: {{{key}: 0}}` to have it solved"
                if any(q in graph.depends([node]) for node in nodes):
                    hint = f"write `{own}: {{{key}: 0}}`: it is solved for, near 0"
                x.faults.add(MISSING_INITIAL, text, section, hint)

    def _in_order(
        self, found: dict[str, InitialValue], place: Place
    ) -> tuple[InitialValue, ...]:
        coordinates = self.x.names.of(NameKind.COORDINATE)
        velocities = list(map(rate_of, coordinates))
        started = (self.x.definitions.get(name) for name in found)
        nodes = [d.node for d in started if d and d.level is Level.VELOCITY]
        free = self.x.graph.depends(n for n in nodes if n is not None)
        for name in velocities:
            # stated to be 0, or left open for such a definition
            if name not in self._all:
                found[name] = InitialValue(name, 0.0, 0.0, name in free, "", place)
        order = [*coordinates, *velocities, *self.x.names.of(NameKind.STATE), *found]
        return tuple(found[name] for name in dict.fromkeys(order) if name in found)

    def _start(self, key: Scalar, node: Node) -> InitialValue | None:
        name, label = key.text, f"the start value of `{key.text}`"
        sound, defined = self._defined(key)
        expression, guess = self._guess(key, node, label)
        expression = self._instead.get(name, expression)
        read = self._read(expression, label, self._rule, evaluates=sound)
        if read is None:
            return None
        scalar, self.formulas[name], value = read
        if guess and defined is not None:
            about = f"`{name}` cannot be a guess: it is not a coordinate or velocity"
            hint = f"write `{in_file(name)}: {scalar.text}`, and guess coordinates"
            self.x.faults.add(NOT_A_GUESS, about, key, hint)
            return None
        stated = " ".join(scalar.text.split())
        return InitialValue(name, *value, guess, stated, scalar.place, defined)

    def _guess(self, key: Scalar, node: Node, label: str) -> tuple[Node, bool]:
        """Return the expression of a start value, and whether it is a guess.

        key, node : name and value in the file.
        label : name in messages.
        """
        faults, broken = self.x.faults, (Broken(node.place), True)
        if both := self._with_rate(key.text, node):
            text = f"{label} must be one expression, found {kind_of(node)}"
            hint = f"write `{key.text}: {both[0]}` and `{rate_of(key.text)}: {both[1]}`"
            faults.add(NOT_AN_EXPRESSION, text, node, hint)
            return broken
        if not isinstance(node, Mapping):
            return node, False
        if "value" in {name.text for name, _ in node.entries}:
            self.x.scalar(node, label)  # a fault, with a hint
            return broken
        is_state = key.text in self.x.names.of(NameKind.STATE)
        wanted, other = ("steady", "guess") if is_state else ("guess", "steady")
        given = fields(node, label, START, faults, key.place)
        guess = given.value(wanted)
        if guess is None and not node.entries:
            text = f"{label} must be an expression, or {{{wanted}: expression}}"
            faults.add(NOT_AN_EXPRESSION, text, node)
        if other in given:
            text = f"{label} has `{other}`, which is for "
            text += "coordinates and velocities" if is_state else "states"
            hint = f"write {{{wanted}: ...}}: "
            hint += "solved for where its rate is 0" if is_state else "it is solved for"
            faults.add(NOT_A_GUESS, text, given.place_of(other), hint)
        return broken if guess is None else (guess, True)

    def _with_rate(self, name: str, node: Node) -> list[str]:
        """Return the texts of position and velocity of an entry with both; else []."""
        own = ("guess", "unit", "description")
        values = [value for k, value in entries_of(node) if k.text not in own]
        given = node.items if isinstance(node, Sequence) else values
        texts = texts_of(given)
        if isinstance(node, Scalar):
            if "," not in node.text or quantities.separated(node.text):
                return []
            texts = [part.strip() for part in node.text.split(",")]
            texts = [] if "(" in node.text or "" in texts else texts
        elif len(texts) < len(given):
            return []
        both = len(texts) == len(("position", "velocity"))
        moving = self.x.names.variables.get(name) is NameKind.COORDINATE
        return texts if both and moving and not quantities.is_unit(texts[1]) else []

    def _defined(self, key: Scalar) -> tuple[bool, int | None]:
        """Return whether `key` may have a start value, and a definition's graph node.

        The node is that of the definition, or of its rate if `key` is a rate; None if
        `key` is a coordinate, velocity or state, or after a fault.
        """
        name, names, faults = key.text, self.x.names, self.x.faults
        meaning = names.meaning(name)
        if meaning is None:
            if not names.is_faulty(name) and names.complete:
                self._report_unknown(key)
            return False, None
        kind, base = meaning
        if kind in (NameKind.COORDINATE, NameKind.VELOCITY, NameKind.STATE):
            return True, None
        hint = "start values belong to positions and velocities"
        if kind not in STARTED:
            text = f"`{name}` is {kind.text} and has no start value"
            if kind in (NameKind.PARAMETER, NameKind.MODE):
                hint = f"its value belongs in `{kind.text[2:]}s`"
            faults.add(NOT_A_START_VALUE, text, key, hint)
            return False, None
        definition = self.x.definitions.get(base)
        if definition is None:
            return False, None
        node, level = definition
        if level is Level.OUTPUT:
            text = f"`{base}` uses {level.text} and has no start value here"
            faults.add(OUTPUT_ONLY, text, key, hint)
            return False, None
        if kind is NameKind.RATE and level is not Level.POSITION:
            text = f"`{name}` is the rate of `{base}`, which uses velocities"
            faults.add(NO_RATE, text, key)
            return False, None
        if kind is NameKind.RATE and node is not None:
            node = self.x.rate_of(base)
        return node is not None, node

    def _report_unknown(self, key: Scalar) -> None:
        names, faults, name = self.x.names, self.x.faults, key.text
        moving, coordinates = names.moving(), names.of(NameKind.COORDINATE)
        near = re.sub(r"_?0$|\(0\)$", "", name)  # x0, x(0)
        near = near if near in moving else hints.rate_spelling(name, moving)
        near = near or hints.rate_within(name, moving)
        if not near and name in hints.SPEEDS and len(coordinates) == 1:
            near = rate_of(coordinates[0])
        if not near and rated(name)[0] not in self._above:
            among = [*moving, *names.of(NameKind.STATE), *map(rate_of, moving)]
            near = faults.guess(name, among)
        hint = "start values belong to coordinates, definitions and their rates"
        hint += f", such as {in_file(rate_of(moving[0]))}" if moving else ""
        if near:  # read as this name, which otherwise would be reported as missing too
            hint = f"did you mean `{in_file(near)}`?"
            self._all.add(near)
            self._above.add(near)
        text = f"`{name}` is no coordinate, velocity or definition"
        if name in self._instead:
            text = f"there is no parameter or start value `{name}`"
        else:
            hint = belongs(name) or hint
        faults.add(UNKNOWN_NAME, text, key, hint)

    def _rule(self, used: Name, scalar: Scalar) -> bool:
        """Whether the expression of a start value may contain a name; else a fault.

        A rule for `Expressions.check_by`.

        used, scalar : the name, and the expression.
        """
        name, names = used.text, self.x.names
        if name in self.known or name == "pi":
            return True
        meaning = names.meaning(name)
        code: ErrorCode = NOT_A_START_VALUE
        if meaning is None:
            if not names.is_faulty(name) and names.complete:
                known = [n for n in self.known if n in names.variables]
                self.x.refuse_unknown(used, scalar, known)
            return False
        if name in self._above or meaning.kind in (NameKind.PARAMETER, NameKind.MODE):
            return False  # faulty itself, and reported
        hint = "a start value may use parameters and the start values above it"
        text = f"`{name}` is {meaning.kind.text} without a start value above this line"
        if name in self._all:
            code = LATER_INITIAL
            text = f"the start value of `{name}` is not given above this line"
        elif meaning.kind not in STARTED:
            text = f"a start value cannot use `{name}`, {meaning.kind.text}"
        found = hints.matching(scalar.text, used.offset, parsed=True)
        return self.x.refuse(used, scalar, code, text, found[2] if found else hint)
