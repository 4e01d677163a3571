"""The start: stated values, guesses, and start values of definitions."""

from __future__ import annotations

import math
import re
from typing import TYPE_CHECKING

from lagsim.model.model import InitialValue, Level, Target
from lagsim.model.nodes import Broken, Mapping, Node, Scalar, Sequence, argument
from lagsim.model.reader.fields import (
    EXPRESSION,
    described,
    either,
    entries,
    fields,
    keyed,
    kind_of,
)
from lagsim.model.reader.names import Kind, naming
from lagsim.model.reader.parameters import Value, value_with_error
from lagsim.model.reader.quantities import is_unit

if TYPE_CHECKING:
    from collections.abc import Mapping as MappingType

    from lagsim.errors import Place
    from lagsim.language.parser import Parsed
    from lagsim.model.reader.expressions import Expressions
    from lagsim.model.reader.fields import Entry
    from lagsim.model.reader.names import Meaning

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
        from lagsim.model.reader import intent

        names, faults = self.x.names, self.x.faults
        moving = names.moving()
        near = re.sub(r"_?0$|\(0\)$", "", key.text)  # x0, x(0)
        near = near if near in moving else intent.rate_of(key.text, moving)
        near = near or intent.rate_within(key.text, moving)
        coordinates = names.of(Kind.COORDINATE)
        if not near and key.text in intent.SPEEDS and len(coordinates) == 1:
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
                from lagsim.model.reader import intent

                code, text, hint = problem
                hint = intent.of_unknown(scalar.text, used.offset) or hint
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
