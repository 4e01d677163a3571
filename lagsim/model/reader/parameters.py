"""Parameters: numbers from numbers, in order, and `--set`."""

from __future__ import annotations

import math
import re
from typing import TYPE_CHECKING

from lagsim.language.evaluate import UNIT_ROUNDOFF, evaluate_with_error
from lagsim.language.graph import Graph
from lagsim.model.model import Coordinate, Parameter
from lagsim.model.nodes import Broken, Mapping, Node, Scalar, Sequence, argument
from lagsim.model.reader.expressions import NUMBERS
from lagsim.model.reader.fields import (
    EXPRESSION,
    PLAIN,
    described,
    either,
    fields,
    keyed,
)
from lagsim.model.reader.names import Kind, naming

if TYPE_CHECKING:
    from collections.abc import Iterable
    from collections.abc import Mapping as MappingType

    from lagsim.language.parser import Parsed
    from lagsim.model.reader.expressions import Expressions
    from lagsim.model.reader.fields import Entry

Value = tuple[float, float]

_WORD = re.compile(r"\w+")
# What stands at these is no expression.
_TEXTS = ("name", "description", "source", "title", "unit")

UNIT = described("Plain text; numbers are not scaled by it.", PLAIN)
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
