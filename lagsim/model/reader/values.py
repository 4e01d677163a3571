"""Definitions, parameters and start values: names, and what they are given by."""

from __future__ import annotations

import math
import re
from typing import TYPE_CHECKING, NamedTuple

from lagsim.language.evaluate import evaluate_with_error
from lagsim.language.graph import Graph
from lagsim.model.model import (
    Coordinate,
    Definition,
    InitialValue,
    Level,
    Parameter,
    Target,
)
from lagsim.model.nodes import Broken, Mapping, Node, Scalar, Sequence, argument
from lagsim.model.reader.expressions import (
    NUMBERS,
    OUTPUT,
    STATE,
    Resolved,
    highest,
    level_of_kind,
)
from lagsim.model.reader.fields import (
    EXPRESSION,
    PLAIN,
    described,
    either,
    entries,
    fields,
    keyed,
    kind_of,
)
from lagsim.model.reader.names import Kind, naming
from lagsim.model.reader.quantities import is_unit
from lagsim.tolerances import UNIT_ROUNDOFF

if TYPE_CHECKING:
    from collections.abc import Iterable
    from collections.abc import Mapping as MappingType

    from lagsim.errors import Place
    from lagsim.language.parser import Parsed
    from lagsim.model.reader.expressions import Expressions
    from lagsim.model.reader.fields import Entry
    from lagsim.model.reader.names import Meaning


_OF_DEFINITIONS = (Kind.DEFINITION, Kind.RATE, Kind.SECOND_RATE)


class _Entry(NamedTuple):
    scalar: Scalar | None
    parsed: Parsed | None
    unit: str
    description: str


class Definitions:
    """Reads the definitions; those for output wait until the energies are built."""

    def __init__(self, given: list[Entry], x: Expressions) -> None:
        self.x = x
        self._entries: dict[str, _Entry] = {}
        for key, node in given:
            what = f"the definition `{key.text}`"
            expression, unit, about = value_entry(key, node, what, x)
            beside = expression is node
            scalar = x.scalar(expression, what, beside=beside)
            parsed = x.parse(scalar, beside=beside) if scalar else None
            self._entries[key.text] = _Entry(scalar, parsed, unit, about)
        self._uses = {name: self._used(entry) for name, entry in self._entries.items()}
        self._order = self._in_order()
        self._find_levels()

    def _used(self, entry: _Entry) -> list[str]:
        """Give the definitions that an expression names, once each."""
        found: dict[str, None] = {}
        for used in entry.parsed.names if entry.parsed else ():
            meaning = self.x.names.meaning(used.text)
            if (
                meaning
                and meaning.kind in _OF_DEFINITIONS
                and meaning.base in self._entries
            ):
                found[meaning.base] = None
        return list(found)

    def _in_order(self) -> list[str]:
        """Give the definitions, each after those it uses; cycles are left out."""
        missing = {name: len(uses) for name, uses in self._uses.items()}
        users: dict[str, list[str]] = {name: [] for name in self._uses}
        for name, uses in self._uses.items():
            for used in uses:
                users[used].append(name)
        order = [name for name, count in missing.items() if count == 0]
        for name in order:  # grows as it goes
            for user in users[name]:
                missing[user] -= 1
                if missing[user] == 0:
                    order.append(user)
        self._report_cycles({name for name, count in missing.items() if count})
        return order

    def _report_cycles(self, left: set[str]) -> None:
        seen: set[str] = set()
        for start in self._entries:
            path: list[str] = []
            name = start
            while name in left and name not in seen:
                seen.add(name)
                path.append(name)
                name = next(used for used in self._uses[name] if used in left)
            if name in path:
                self._report_cycle(path[path.index(name) :])

    def _report_cycle(self, cycle: list[str]) -> None:
        place = {name: i for i, name in enumerate(self._entries)}
        first = cycle.index(min(cycle, key=place.__getitem__))
        cycle = cycle[first:] + cycle[:first]
        entry = self._entries[cycle[0]]
        assert entry.scalar is not None
        assert entry.parsed is not None
        follower = cycle[1] if len(cycle) > 1 else cycle[0]
        at = next(
            n
            for n in entry.parsed.names
            if (meaning := self.x.names.meaning(n.text)) and meaning.base == follower
        )
        shown = cycle if len(cycle) <= 12 else [*cycle[:10], "...", cycle[-1]]
        self.x.faults.add(
            "cycle",
            f"the definition `{cycle[0]}` depends on itself: "
            + " -> ".join([*shown, cycle[0]]),
            entry.scalar.place_of(at.offset, len(at.text)),
        )

    def _find_levels(self) -> None:
        """Enter what each definition depends on, by the names in it."""
        known = self.x.definitions
        for name in self._order:
            levels = []
            parsed = self._entries[name].parsed
            for used in parsed.names if parsed else ():
                meaning = self.x.names.meaning(used.text)
                if meaning is None:
                    continue
                levels.append(level_of_kind(meaning.kind))
                if meaning.base in known and meaning.kind in _OF_DEFINITIONS:
                    levels.append(known[meaning.base].level)
            known[name] = Resolved(None, highest(levels))

    def build(self, *levels: Level) -> None:
        """Build the definitions of some levels, those of positions first."""
        known = self.x.definitions
        for level in levels:
            for name in self._order:
                if known[name].level is level:
                    known[name] = Resolved(self._node(name, level), level)

    def _node(self, name: str, level: Level) -> int | None:
        entry = self._entries[name]
        if entry.scalar is None or entry.parsed is None:
            return None
        allowed = OUTPUT if level is Level.OUTPUT else STATE
        what = f"the definition `{name}`"
        if self.x.check(entry.parsed.names, entry.scalar, what, allowed) is None:
            return None
        return self.x.build(entry.parsed)

    def read(self) -> tuple[Definition, ...]:
        """Give the definitions in the order of the file, those that are sound."""
        found = []
        for name, entry in self._entries.items():
            known = self.x.definitions.get(name)
            if known is not None and known.node is not None:
                found.append(
                    Definition(
                        name, known.node, known.level, entry.unit, entry.description
                    )
                )
        return tuple(found)


# --- Parameters: numbers from numbers, in order, and `--set`

Value = tuple[float, float]

_WORD = re.compile(r"\w+")
# What stands at these is no expression.
_TEXTS = ("name", "description", "source", "title", "unit")

_ONE_LINE = {**PLAIN, "pattern": r"^[^\n]*$"}
UNIT = described("Plain text; numbers are not scaled by it.", _ONE_LINE)
DESCRIPTION = described("Plain text.", PLAIN)
COORDINATE_KEYS = {"unit": UNIT, "description": DESCRIPTION}
COORDINATES = {**naming(keyed(COORDINATE_KEYS)), "minProperties": 1}
VALUE_KEYS = {"value": described("An expression.", EXPRESSION), **COORDINATE_KEYS}
VALUE = either(EXPRESSION, keyed(VALUE_KEYS, ["value"]))


class Unfolded(Graph):
    """A graph whose numbers are variables, so that nothing is folded.

    Folding would lose the rounding error of what it folds: `cos(pi/2)` is not zero,
    but zero within its error.
    """

    def __init__(self) -> None:
        self.numbers: dict[str, Value] = {}
        super().__init__()

    def constant(self, x: float) -> int:
        """Give the node of the number `x`: a variable that is called as it is."""
        exact = float(x).is_integer()
        self.numbers[repr(x)] = x, 0.0 if exact else UNIT_ROUNDOFF * abs(x)
        return self.variable(repr(x))


def value_with_error(parsed: Parsed, known: MappingType[str, Value]) -> Value:
    """Give value and rounding error of an expression of numbers.

    A number alone is exact: it is what the file states.

    Parameters
    ----------
    parsed
        The expression.
    known
        Value and error of each name in it but `pi`.
    """
    (kind, number), *more = parsed.postfix
    if not more and kind == "number":
        return float(number), 0.0
    g = Unfolded()
    node = parsed.build(
        g, lambda name: g.constant(math.pi) if name == "pi" else g.variable(name)
    )
    value, error = evaluate_with_error(g, [node], {**known, **g.numbers})[0]
    alone = all(kind in ("number", "neg") for kind, _ in parsed.postfix)
    return value, 0.0 if alone else error


def value_entry(
    key: Scalar, node: Node, what: str, x: Expressions
) -> tuple[Node, str, str]:
    """Give expression, unit and description of `name: expression` or a mapping."""
    if not isinstance(node, Mapping):
        return node, "", ""
    found = fields(node, what, VALUE_KEYS, x.faults, key.place)
    value = found.value("value")
    if value is None:
        text = f"{what} has no `value`"
        hint = x.faults.belongs(key.text) or "write {value: ..., unit: ...}"
        x.faults.add("missing-key", text, key.place, hint)
        value = Broken(key.place)
    return value, found.text("unit", x.faults), found.text("description", x.faults)


class Parameters:
    """Reads the parameters.

    Attributes
    ----------
    values
        Value and rounding error of each parameter that is sound.
    """

    def __init__(self, x: Expressions, overrides: MappingType[str, str]) -> None:
        self.x = x
        self.values: dict[str, Value] = {}
        self._below: set[str] = set()  # the parameter being read and those after it
        self._overrides = {
            name: argument(f"--set {name}=", text) for name, text in overrides.items()
        }

    def read(self, given: list[Entry]) -> tuple[Parameter, ...]:
        """Give the parameters, with what `--set` says; faults are reported."""
        self._check_overrides()
        self._below = {key.text for key, _ in given}
        found = []
        for key, node in given:
            what = f"the parameter `{key.text}`"
            expression, unit, description = value_entry(key, node, what, self.x)
            expression = self._overrides.get(key.text, expression)
            beside = expression is node
            value = self._value(key.text, expression, what, beside=beside)
            self._below.discard(key.text)
            if value is not None:
                follows = not words(expression).isdisjoint(self.values)
                of_file = (key.text, value[0], unit, description)
                found.append(Parameter(*of_file, follows=follows))
                self.values[key.text] = value
                self.x.values[key.text] = value[0]
        return tuple(found)

    def _check_overrides(self) -> None:
        names, faults = self.x.names, self.x.faults
        for name, value in self._overrides.items():
            meaning = names.meaning(name)
            kind = meaning.kind if meaning else None
            if kind is Kind.PARAMETER or names.is_faulty(name):
                continue
            moving = names.moving()
            rates = (f"{q}_dot" for q in moving)
            known = [*names.of(Kind.PARAMETER), *moving, *rates]
            hint = faults.did_you_mean(name, known)
            if "." in name:
                text, hint = f"`{name}`: names with a dot are reserved", ""
            elif kind is not None:
                text = f"`{name}` is {kind.value}"
                text += "; --set takes parameters and start values"
                hint = ""
            elif not names.complete:
                continue
            else:
                text = f"there is no parameter or start value `{name}`"
            option = argument("--set ", f"{name}={value.text}")
            faults.add("unknown-parameter", text, option.place_of(0, len(name)), hint)

    def _value(self, name: str, node: Node, what: str, *, beside: bool) -> Value | None:
        x = self.x
        scalar = x.scalar(node, what, beside=beside)
        parsed = x.parse(scalar, beside=beside) if scalar else None
        if scalar is None or parsed is None:
            return None
        later = {n.text for n in parsed.names} & self._below
        for used in {n.text: n for n in reversed(parsed.names)}.values():
            if used.text in later:
                own = used.text == name
                x.faults.add(
                    "later-parameter",
                    f"`{name}` uses itself"
                    if own
                    else f"`{name}` uses `{used.text}`, which is below it",
                    scalar.place_of(used.offset, len(used.text)),
                    "a parameter may use those above it",
                )
        others = [n for n in parsed.names if n.text not in later]
        if x.check(others, scalar, what, NUMBERS) is None or later:
            return None
        value = value_with_error(parsed, self.values)
        if not math.isfinite(value[0]):
            text = f"{what} is {value[0]}, which is not a finite number"
            x.faults.add("not-finite", text, scalar.place)
            return None
        return value


def unused(root: Node, names: Iterable[str]) -> tuple[str, ...]:
    """Give the parameters that no expression of the file names, used or replaced."""
    said = words(root)
    return tuple(name for name in names if name not in said)


def words(*roots: Node) -> set[str]:
    """Give the words of all expressions below some nodes."""
    said: set[str] = set()
    below = [*roots]
    while below:
        node = below.pop()
        if isinstance(node, Mapping):
            below += [v for k, v in node.entries if k.text not in _TEXTS]
        elif isinstance(node, Sequence):
            below += node.items
        elif isinstance(node, Scalar):
            said.update(_WORD.findall(node.text))
    return said


def read_coordinates(given: list[Entry], x: Expressions) -> tuple[Coordinate, ...]:
    """Give the coordinates."""
    found = []
    for key, node in given:
        what = f"the coordinate `{key.text}`"
        if isinstance(node, Scalar) and not node.empty:
            x.faults.add(
                "not-a-mapping",
                f"{what} has no value here, found `{node.text}`",
                node.place,
                "write {}; its start value belongs in `initial`"
                if re.match(r"[-+.\d]", node.text)
                else f"write {{unit: {node.text}}}; start values belong in `initial`",
            )
            found.append(Coordinate(key.text))
            continue
        below = fields(node, what, COORDINATE_KEYS, x.faults, key.place)
        unit, about = (below.text(k, x.faults) for k in ("unit", "description"))
        found.append(Coordinate(key.text, unit, about))
    return tuple(found)


# --- The start: stated values, guesses, and start values of definitions

# What a start value may be given to.
TARGETS = {
    Kind.COORDINATE: Target.COORDINATE,
    Kind.VELOCITY: Target.VELOCITY,
    Kind.DEFINITION: Target.DEFINITION,
    Kind.RATE: Target.RATE,
}

# Where values stand that replace those of the file.
SET = "--set "
START_KEYS = {
    "guess": described("Solved for from the constraints, near this.", EXPRESSION)
}
FORM = naming(either(EXPRESSION, keyed(START_KEYS, START_KEYS)), rates=True)


class Initial:
    """Reads the section `initial`.

    Parameters
    ----------
    x
        The expressions of the file.
    parameters
        Value and rounding error of each parameter.
    instead
        Expressions that stand for those of the file, or beside them.
    """

    def __init__(
        self,
        x: Expressions,
        parameters: MappingType[str, Value],
        instead: MappingType[str, str],
    ) -> None:
        self.x = x
        self.known: dict[str, Value] = dict(parameters)
        self._instead = {
            name: argument(f"{SET}{name}=", text) for name, text in instead.items()
        }
        self._given: set[str] = set()  # keys so far, sound or not
        self._all: set[str] = set()

    def read(self, entry: Entry | None, root: Place) -> tuple[InitialValue, ...]:
        """Give the start values: all positions, all velocities, then definitions."""
        x = self.x
        if entry is None:
            text = "the file has no `initial`"
            hint = "each coordinate needs a start value"
            x.faults.add("missing-key", text, root, hint)
            return ()
        section, node = entry
        given = entries(node, "`initial`", x.faults)
        self._all = {key.text for key, _ in given}
        added = [name for name in self._instead if name not in self._all]
        given += [(argument(SET, name), self._instead[name]) for name in added]
        self._all.update(added)
        found: dict[str, InitialValue] = {}
        for key, value in given:
            one = self._value(key, value)
            self._given.add(key.text)
            if one is not None:
                self.known[one.name] = one.value, one.error
                found[one.name] = one
        if isinstance(node, Mapping) or (isinstance(node, Scalar) and node.empty):
            self._check_complete(section)
        return self._in_order(found, section.place)

    def _check_complete(self, section: Scalar) -> None:
        started = [name for name in self._given if name in self.x.definitions]
        for q in self.x.names.of(Kind.COORDINATE):
            if q not in self._all:
                text = f"`initial` has no value for the coordinate `{q}`"
                hint = f"write `{q}: 0`, or `{q}: {{guess: 0}}` to have it solved"
                if any(self._rests_on(name, q) for name in started):
                    hint = f"write `{q}: {{guess: 0}}`: it is solved for, near 0"
                self.x.faults.add("missing-initial", text, section.place, hint)

    def _rests_on(self, definition: str, q: str) -> bool:
        node = self.x.definitions[definition].node
        return node is not None and q in self.x.graph.depends([node])

    def _in_order(
        self, found: dict[str, InitialValue], place: Place
    ) -> tuple[InitialValue, ...]:
        coordinates = self.x.names.of(Kind.COORDINATE)
        for q in coordinates:
            rate = f"{q}_dot"
            if rate not in self._all:  # a velocity not named is stated to be 0
                found[rate] = InitialValue(
                    rate, Target.VELOCITY, 0.0, 0.0, guess=False, text="0", place=place
                )
        order = [*coordinates, *(f"{q}_dot" for q in coordinates)]
        moving = frozenset(order)
        order += [name for name in found if name not in moving]
        return tuple(found[name] for name in order if name in found)

    def _value(self, key: Scalar, node: Node) -> InitialValue | None:
        target = self._target(key)
        expression, guess = self._guess(key, node)
        expression = self._instead.get(key.text, expression)
        what = f"the start value of `{key.text}`"
        scalar = self.x.scalar(expression, what)
        parsed = self.x.parse(scalar) if scalar else None
        if scalar is None or parsed is None or not self._check(parsed, scalar):
            return None
        if target is None:
            return None
        value, error = value_with_error(parsed, self.known)
        if not math.isfinite(value):
            text = f"{what} is {value}, which is not a finite number"
            self.x.faults.add("not-finite", text, scalar.place)
            return None
        kind, direction = target
        if guess and kind in (Target.DEFINITION, Target.RATE):
            text = f"`{key.text}` cannot be a guess: it is not a coordinate or velocity"
            hint = f"write `{key.text}: {scalar.text}`, and guess coordinates"
            self.x.faults.add("not-a-guess", text, key.place, hint)
            return None
        text = " ".join(scalar.text.split())
        return InitialValue(
            key.text, kind, value, error, guess, text, scalar.place, direction
        )

    def _guess(self, key: Scalar, node: Node) -> tuple[Node, bool]:
        what = f"the start value of `{key.text}`"
        if both := self._with_rate(key.text, node):
            text = f"{what} must be one expression, found {kind_of(node)}"
            hint = f"write `{key.text}: {both[0]}` and `{key.text}_dot: {both[1]}`"
            self.x.faults.add("not-an-expression", text, node.place, hint)
            return Broken(node.place), True
        if not isinstance(node, Mapping):
            return node, False
        if "value" in {name.text for name, _ in node.entries}:
            self.x.scalar(node, what)  # a fault, with what to write
            return Broken(node.place), True
        below = fields(node, what, START_KEYS, self.x.faults, key.place)
        guess = below.value("guess")
        if guess is None:
            if not node.entries:
                text = f"{what} must be an expression, or {{guess: expression}}"
                self.x.faults.add("not-an-expression", text, node.place)
            return Broken(node.place), True
        return guess, True

    def _with_rate(self, name: str, node: Node) -> list[str]:
        """Give position and velocity where a start value holds both."""
        given = node.items if isinstance(node, Sequence) else ()
        if isinstance(node, Mapping):
            own = ("guess", "unit", "description")
            given = tuple(value for k, value in node.entries if k.text not in own)
        texts = [part.text for part in given if isinstance(part, Scalar)]
        both = len(texts) == len(given) == len(("position", "velocity"))
        moving = name in self.x.names.of(Kind.COORDINATE)
        return texts if both and moving and not is_unit(texts[1]) else []

    def _target(self, key: Scalar) -> tuple[Target, int | None] | None:
        """Give what a key of `initial` names, and the node of a definition."""
        name, names, faults = key.text, self.x.names, self.x.faults
        meaning = names.meaning(name)
        if meaning is None:
            if not names.is_faulty(name) and names.complete:
                self._report_unknown(key)
            return None
        if meaning.kind in (Kind.COORDINATE, Kind.VELOCITY):
            return TARGETS[meaning.kind], None
        if meaning.kind in (Kind.DEFINITION, Kind.RATE):
            return self._definition(key, meaning)
        text = f"`{name}` is {meaning.kind.value} and has no start value"
        hint = "its value belongs in `parameters`"
        if meaning.kind is not Kind.PARAMETER:
            hint = "start values are those of positions and velocities"
        faults.add("not-a-start-value", text, key.place, hint)
        return None

    def _report_unknown(self, key: Scalar) -> None:
        from lagsim.model.reader import suggestions

        names, faults = self.x.names, self.x.faults
        moving = names.moving()
        near = re.sub(r"_?0$|\(0\)$", "", key.text)  # x0, x(0)
        near = near if near in moving else suggestions.rate_of(key.text, moving)
        near = near or suggestions.rate_within(key.text, moving)
        coordinates = names.of(Kind.COORDINATE)
        if not near and key.text in suggestions.SPEEDS and len(coordinates) == 1:
            near = f"{coordinates[0]}_dot"
        if not near:
            near = faults.guess(
                key.text, [*moving, *(f"{name}_dot" for name in moving)]
            )
        hint = "start values are those of coordinates, definitions and their rates"
        hint += f", such as {moving[0]}_dot" if moving else ""
        if near:  # read as that, or it would be reported as missing too
            hint = f"did you mean `{near}`?"
            self._all.add(near)
            self._given.add(near)
        hint = faults.belongs(key.text) or hint
        if key.text[:1].isdecimal():
            from lagsim.model.reader import quantities

            hint = quantities.split_by_comma(key) or hint
        text = f"`{key.text}` is no coordinate, velocity or definition"
        faults.add("unknown-name", text, key.place, hint)

    def _definition(
        self, key: Scalar, meaning: Meaning
    ) -> tuple[Target, int | None] | None:
        name, base, faults = key.text, meaning.base, self.x.faults
        definition = self.x.definitions.get(base)
        if definition is None:
            return None
        if definition.level is Level.OUTPUT:
            text = f"`{base}` uses {definition.level.value} and has no start value here"
            hint = "start values are those of positions and velocities"
            faults.add("output-only", text, key.place, hint)
            return None
        if meaning.kind is Kind.RATE and definition.level is not Level.POSITION:
            text = (
                f"`{name}` asks for the rate of `{base}`, which depends on velocities"
            )
            faults.add("no-rate", text, key.place)
            return None
        node = definition.node
        if node is not None and meaning.kind is Kind.RATE:
            node = self.x.rate(base)
        return (TARGETS[meaning.kind], node) if node is not None else None

    def _check(self, parsed: Parsed, scalar: Scalar) -> bool:
        """Report names that a start value must not use."""
        sound = True
        for used in {n.text: n for n in reversed(parsed.names)}.values():
            name = used.text
            if name in self.known or name == "pi":
                continue
            sound = False
            problem = self._unusable(name)
            if problem is not None:
                from lagsim.model.reader import suggestions

                code, text, hint = problem
                hint = suggestions.of_unknown(scalar.text, used.offset) or hint
                place = scalar.place_of(used.offset, len(name))
                self.x.faults.add(code, text, place, hint)
        return sound

    def _unusable(self, name: str) -> tuple[str, str, str] | None:
        names = self.x.names
        meaning = names.meaning(name)
        if meaning is None:
            if names.is_faulty(name) or not names.complete:
                return None
            known = [n for n in self.known if n in names.variables]
            text, hint = names.unknown(name, self.x.faults, known)
            hint = hint or f"give `{name}` a value in `parameters`"
            return "unknown-name", text, hint
        if name in self._given or meaning.kind is Kind.PARAMETER:
            return None  # faulty itself, and told
        hint = "a start value may use parameters and the start values above it"
        if name in self._all:
            text = f"the start value of `{name}` is not given above this line"
            return "later-initial", text, hint
        text = f"`{name}` is {meaning.kind.value} without a start value above this line"
        if meaning.kind not in TARGETS:
            text = f"a start value cannot use `{name}`, {meaning.kind.value}"
        return "not-a-start-value", text, hint
