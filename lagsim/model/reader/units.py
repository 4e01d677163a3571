"""Consistency of units in the expressions of a file, where units are given.

Each expression is evaluated with the units of its names: coordinates, parameters,
definitions and states with a unit, their rates, and definitions whose unit follows from
their expression. An operand without a unit, or with an unknown unit, fits any other,
and so does a plain number in a sum. A unit is a product of powers of kg, m, s, A, K,
mol, cd with a scale, so that kN/m fits N/mm; angles are numbers. Numbers are never
scaled.

Other libraries know more units: pint takes half a second to load.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from lagsim.errors import Place
from lagsim.language.functions import ELEMENTS, JOINING, OPERATIONS, PART
from lagsim.language.names import rate_of, rated
from lagsim.language.parser import Parsed, ParsedRelation
from lagsim.language.units import (
    ALIKE,
    PURE,
    Quantity,
    combined,
    is_pure,
    parsed,
    times,
    written,
)
from lagsim.model.model import Level, Mismatch
from lagsim.model.reader import quantities
from lagsim.tolerances import COMPUTED_ZERO

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from lagsim.language.units import Unit
    from lagsim.model.model import Model
    from lagsim.model.nodes import Scalar

# Key, among the powers of a unit, of its power of ten relative to SI units.
SCALE = "10"
# Derived units, beside those in `language.units`.
_OTHERS = {
    "Ohm": "V/A", "ohm": "V/A", "Ω": "V/A", "F": "C/V", "H": "V*s/A", "Wb": "V*s",
    "S": "A/V",
}  # fmt: skip
_BASE = ("m", "kg", "s", "A", "K", "mol", "cd")
_UNKNOWN = Quantity()
# Derived units in addition to `language.units`.
_PREFIXED = {
    ("N", -3): "mN (kg mm/s^2)", ("N", 3): "kN", ("N", 6): "MN",
    ("J", -6): "uJ (kg mm^2/s^2)", ("J", -3): "mJ (N mm)", ("J", 3): "kJ",
    ("W", -6): "uW (kg mm^2/s^3)", ("W", -3): "mW (N mm/s)", ("W", 3): "kW",
    ("Pa", 6): "MPa (N/mm^2)", ("Pa", 3): "kPa",
}  # fmt: skip
_TIME = Quantity({"s": 1.0}, "s")
# An expression of t and numbers alone, such as 0.3 + 0.1*t, in which numbers can have
# the unit of a speed or a rate; and a sine or an exponential of such an expression.
_TIMED, _NUMBER = Quantity(free=True), Quantity(PURE, free=True)
_TOGETHER = ALIKE | {"mod", "atan2"}
_KEEPING = (_TOGETHER - {"atan2"}) | {"pow"}
_ANGLES = ("sin", "cos", "tan")
# Operations on operands of any unit.
_ANY = (
    "mul", "div", "neg", "abs", "sign", "heaviside", "sqrt", "cbrt", "floor", "ceil",
)  # fmt: skip


def reduced(text: str) -> Unit | None:
    """Return a unit as powers of SI base units with a scale; None if it is unknown."""
    unit = parsed(quantities.unit_spelling(text))
    found: Unit | None = PURE if unit is not None else None
    for symbol, power in (unit or {}).items():
        plain, factors = quantities.in_si(symbol)
        own = parsed(_OTHERS.get(plain, plain)) or {}
        if found is None or not all(x in _BASE for x in own):
            return None
        found = times(found, own, power)
        if factors != 1.0:
            found = times(found, {SCALE: math.log10(factors)}, power)
    return found


def mismatches(
    model: Model, read: Iterable[tuple[str, Scalar, Parsed | ParsedRelation]]
) -> list[Mismatch]:
    """Return the inconsistent units of a model.

    read : every expression, with its name in messages.
    """
    return _UnitCheck(model, read).run()


class _UnitCheck:
    """Check of the units of all expressions of a file.

    `read` has, by its name in messages, the scalar and the parsed form of each.
    """

    def __init__(
        self,
        model: Model,
        read: Iterable[tuple[str, Scalar, Parsed | ParsedRelation]],
    ) -> None:
        self.model, self.found = model, dict[Place, Mismatch]()
        self.read: dict[str, tuple[Scalar, Parsed | ParsedRelation]] = {}
        for label, scalar, x in read:  # components of a point have one name
            key = f"{label} {len(self.read)}" if label in self.read else label
            self.read[key] = scalar, x
        given = (*model.parameters, *model.variables, *model.definitions)
        self.units = {
            x.name: Quantity(reduced(x.unit), x.unit) for x in given if x.unit
        }
        self.values: dict[str, Quantity] = {}

    def run(self) -> list[Mismatch]:
        if not self.units:
            return []
        for label in self.read:
            self.value(label)
        energy = self._energy()
        for label, (scalar, _) in self.read.items():
            kind, _, name = label.partition(" `")
            expected = self._expected(kind, name.rstrip("`"), energy)
            text = f"{label} is in {{}} here, where {{}} is expected"
            self._compare(scalar, None, self.value(label), expected, text)
        return sorted(self.found.values(), key=lambda x: x.place[1:3])

    def value(self, label: str) -> Quantity:
        """Return the quantity of the expression with the name `label`.

        The units in it are checked. The quantity is unknown for a relation.
        """
        if label not in self.values:
            self.values[label] = _UNKNOWN
            if label in self.read:
                self.values[label] = self._went_through(*self.read[label])
        return self.values[label]

    def _energy(self) -> Quantity:
        """Return the quantity of all energies; inconsistent ones are reported."""
        found = _UNKNOWN
        for label in ("the kinetic energy", "the potential energy", "the Lagrangian"):
            own = self.value(label)
            # If no unit contains a mass, the unit of mass is not stated.
            if not own.unit or "kg" not in own.unit:
                continue
            if found.unit:
                text = f"{label} is in {{}}, the kinetic energy in {{}}"
                self._compare(self.read[label][0], None, own, found, text)
            found = found if found.unit else own
        return found

    def _expected(self, kind: str, name: str, energy: Quantity) -> Quantity:
        """Return the quantity that an expression should have; unknown if any is right.

        kind : such as `the force on`.
        name : the name of the coordinate.
        energy : the quantity of energies.
        """
        per_second = {"s": -1.0}
        if kind in ("the definition", "the parameter", "the mode"):
            return self.units.get(name, _UNKNOWN)
        if kind == "the start value of":
            return self._of(name)
        if kind == "the rate of the state":
            return self._of(rate_of(name))
        if energy.unit and kind == "the dissipation":
            return Quantity(times(energy.unit, per_second))
        if kind not in ("the force on", "the impulse on"):
            return _UNKNOWN
        name = name.partition("`")[0]  # the event of an impulse follows
        along = self._of(name).unit
        if not energy.unit or along is None:
            return _UNKNOWN
        unit = times(energy.unit, along, -1.0)
        kicks = (x for event in self.model.events for x in event.impulses)
        given = self.model.forces if kind == "the force on" else kicks
        on = next((x for x in given if x.on == name), None)
        if on is not None and on.level is Level.VELOCITY:
            unit = times(unit, per_second)
        if kind == "the impulse on":
            unit = times(unit, {"s": 1.0})
        return Quantity(unit)

    def _of(self, name: str) -> Quantity:
        """Return the quantity of a variable."""
        if name in ("t", "pi"):
            return _TIME if name == "t" else Quantity(PURE, free=True)
        base, order = rated(name)
        found = self.units.get(name) or self.units.get(base)
        if found is None:
            found = self.value(f"the definition `{base}`")
            found = found._replace(text="") if not found.free else _UNKNOWN
        if name in self.units or not order or found.unit is None:
            return found
        text = f"{found.text}/s" + (f"^{order}" if order > 1 else "")
        unit = times(found.unit, {"s": 1.0}, -order)
        return Quantity(unit, text if found.text else "")

    def _went_through(self, scalar: Scalar, read: Parsed | ParsedRelation) -> Quantity:
        if isinstance(read, Parsed):
            return self._evaluated(scalar, read)
        left = self._evaluated(scalar, read.left)
        if read.right is None:
            return left
        right = self._evaluated(scalar, read.right)
        span = (read.at, 1 if scalar.text[read.at :].startswith("=") else 2)
        text = "the sides of this relation are in {} and {}"
        self._compare(scalar, span, left, right, text)
        return _UNKNOWN

    def _evaluated(self, scalar: Scalar, read: Parsed) -> Quantity:
        stack = list[tuple[Quantity, float | None]]()
        for op, payload, token in read.postfix:
            if op == "number":
                unit = PURE if is_pure(payload) else None
                stack.append((Quantity(unit, free=True), payload))
            elif op == "name":
                stack.append((self._of(payload), None))
            elif op == "data":  # elements: one member represents all
                stack.append((self._evaluated(scalar, payload.example), None))
            elif op in (ELEMENTS, PART):
                del stack[1 - payload + len(stack) :]
            else:
                args, powers = zip(*stack[-payload:], strict=True)
                del stack[-payload:]
                span = (token.offset, len(token.text))
                found = self._operation(scalar, span, op, args, powers[-1])
                negative = -powers[0] if op == "neg" and powers[0] else None
                stack.append((found, negative))
        return stack[-1][0] if stack else _UNKNOWN

    def _operation(
        self,
        scalar: Scalar,
        span: tuple[int, int],
        op: str,
        args: Sequence[Quantity],
        power: float | None,
    ) -> Quantity:
        """Return the quantity of an operation; inconsistent arguments are reported.

        scalar, span : the expression, and the place of the operation in it.
        op, args : the operation, and the quantities of its arguments.
        power : the value of the last argument, if it is a constant.
        """
        if op not in OPERATIONS or op in JOINING:  # an operation of tables
            return _UNKNOWN
        if _is_timed(args[-2:] if op == "if" else args):
            return _NUMBER if op not in _ANY and op not in _KEEPING else _TIMED
        free = all(x.free for x in args)
        sound, word = True, scalar.text[span[0] :][: span[1]]
        word = word or OPERATIONS[op].sign.strip() or op
        if op in _TOGETHER or OPERATIONS[op].condition:
            text = f"`{word}` is given {{}} and {{}}"
            for one in args[-2:-1]:
                sound = self._compare(scalar, span, one, args[-1], text)
        elif op not in _ANY:
            of = args[-1] if op == "pow" else args[0]
            degrees = op in _ANGLES and of.unit and {*of.unit} == {SCALE}
            text = f"the argument of `{word}` is {{}}, and must be a number"
            pure = Quantity(PURE, "1")
            passed = bool(degrees)  # degrees have a warning of their own
            free = free or (of.unit is None and op != "pow")
            sound = passed or self._compare(scalar, span, of, pure, text)
        if not sound:
            return _UNKNOWN
        unit, text = combined("add" if op in _TOGETHER - {"atan2"} else op, args, power)
        return Quantity(unit, text, free)

    def _compare(
        self,
        scalar: Scalar,
        span: tuple[int, int] | None,
        a: Quantity,
        b: Quantity,
        text: str,
    ) -> bool:
        """Return whether the units of two quantities fit; if not, report the mismatch.

        span : the place in the scalar; None for the whole.
        text : the message, with {} for both units.
        """
        if a.free or b.free or a.unit is None or b.unit is None:
            return True
        difference = times(a.unit, b.unit, -1.0)
        if all(abs(x) < COMPUTED_ZERO for x in difference.values()):
            return True
        place = scalar.place_of(*(span or (0, len(scalar.text))))
        self.found.setdefault(place, Mismatch(place, text.format(_text(a), _text(b))))
        return False


def _is_timed(args: Sequence[Quantity]) -> bool:
    """Whether the operands are t, expressions of t and numbers, or numbers.

    At least one contains t. Units do not matter then.
    """
    timed = [x is _TIME or x is _TIMED for x in args]
    pairs = zip(args, timed, strict=True)
    return any(timed) and all(is_so or x.free for x, is_so in pairs)


def _text(of: Quantity) -> str:
    """Return a quantity's unit in the file's notation, or as powers and a scale."""
    unit = of.unit or PURE
    if of.text or not unit:
        return of.text or "a number"
    power = unit.get(SCALE, 0.0)
    plain = {symbol: power for symbol, power in unit.items() if symbol != SCALE}
    raw = " ".join(f"{symbol}^{power:g}" for symbol, power in plain.items())
    named = written(plain, ("N", "J", "W", "N m", "Pa")) or raw
    if not power:
        return named
    # Prefix of a unit, such as of kg mm/s^2: coordinates in mm beside masses in kg.
    small = _PREFIXED.get((named, round(power)))
    if small and abs(power - round(power)) < COMPUTED_ZERO:
        return small
    degrees = power / math.log10(math.pi / 180.0)
    if not named and abs(degrees - round(degrees)) < COMPUTED_ZERO:
        return "deg" if round(degrees) == 1 else f"deg^{round(degrees)}"
    return f"{10.0**power:.6g} {named}".rstrip()
