"""Units as powers of symbols, and the units of operations."""

from __future__ import annotations

import math
import re
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

from lagsim.tolerances import COMPUTED_ZERO

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

# Powers of base symbols: {"kg": 1, "m": 1, "s": -2}.
Unit: TypeAlias = dict[str, float]

PURE: Unit = {}
NEWTON: Unit = {"kg": 1.0, "m": 1.0, "s": -2.0}
JOULE: Unit = {"kg": 1.0, "m": 2.0, "s": -2.0}
KNOWN: dict[str, Unit] = {
    "N": NEWTON,
    "J": JOULE,
    "W": {"kg": 1.0, "m": 2.0, "s": -3.0},
    "Pa": {"kg": 1.0, "m": -1.0, "s": -2.0},
    "Hz": {"s": -1.0},
    "C": {"A": 1.0, "s": 1.0},
    "V": {"kg": 1.0, "m": 2.0, "s": -3.0, "A": -1.0},
    "T": {"kg": 1.0, "s": -2.0, "A": -1.0},
    "rad": PURE,
    "1": PURE,
}

_FACTOR = re.compile(r"\s*([*·/]?)\s*([^\W\d_]+|1)(?:\s*(?:\^|\*\*)\s*(-?\d+))?\s*")

# A factor is a pure number if it is a fraction of whole numbers up to this size; 9.8
# could be in m/s^2.
SMALL = 12

# A fraction above this size, in whole hundredths, is a part and no unit conversion.
LEAST_PART = 0.02

SAME = frozenset(("neg", "abs", "floor", "ceil"))
ALIKE = frozenset(("add", "sub", "min", "max", "hypot", "if", "smooth.if"))
_ROOTS = {"sqrt": 0.5, "cbrt": 1.0 / 3.0}


def parsed(text: str) -> Unit | None:
    """Return the powers of symbols in a unit such as `N s/m`; None if invalid.

    Examples
    --------
    >>> parsed("N s/m")
    {'kg': 1.0, 's': -1.0}
    """
    found: Unit = PURE
    at = 0
    while at < len(text):
        factor = _FACTOR.match(text, at)
        if factor is None:
            return None
        sign, symbol, power = factor.groups()
        exponent = float(power or 1) * (-1.0 if sign == "/" else 1.0)
        found = times(found, KNOWN.get(symbol, {symbol: 1.0}), exponent)
        at = factor.end()
    return found if text.strip() else None


def times(one: Unit, other: Unit, power: float = 1.0) -> Unit:
    """Return the unit `one` times a power of the unit `other`."""
    found = dict(one)
    for symbol, exponent in other.items():
        found[symbol] = found.get(symbol, 0.0) + power * exponent
    return {symbol: e for symbol, e in found.items() if e}


def written(unit: Unit | None, names: Iterable[str] = ("N", "J", "W")) -> str:
    """Return the text of a unit, with one of `names` where it fits; "" for None."""
    if not unit:
        return ""
    for name in names:
        if parsed(name) == unit:
            return name
    if any(e % 1 for e in unit.values()):
        return ""
    over = " ".join(_power(s, e) for s, e in unit.items() if e > 0.0)
    under = "/".join(_power(s, -e) for s, e in unit.items() if e < 0.0)
    return (over or "1") + (f"/{under}" if under else "")


def _power(symbol: str, exponent: float) -> str:
    return symbol if exponent == 1.0 else f"{symbol}^{exponent:.0f}"


class Quantity(NamedTuple):
    """Unit of an expression: the powers of symbols (None if unknown), and a text.

    The text is the unit in the file's notation; sums and numeric factors keep it.
    `free` marks an expression of numbers alone, which fits any unit in a sum.
    """

    unit: Unit | None = None
    text: str = ""
    free: bool = False


def combined(
    op: str, parts: Sequence[Quantity], power: float | None
) -> tuple[Unit | None, str]:
    """Return unit and text of an operation; the unit is None if it is unknown.

    parts : the arguments.
    power : the last argument, if it is a constant.
    """
    one, other = parts[0], parts[-1]
    if op in ("mul", "div"):
        if one.unit is None or other.unit is None:
            return None, ""
        text = ""
        if other.unit == PURE and not other.text:
            text = one.text
        elif op == "mul" and one.unit == PURE and not one.text:
            text = other.text
        return times(one.unit, other.unit, 1.0 if op == "mul" else -1.0), text
    if op in SAME:
        return one.unit, one.text
    if op in ALIKE:  # a number is taken in the unit of the other term
        terms = [part for part in parts[-2:] if not part.free]
        texts = {part.text for part in terms}
        units = [part.unit for part in terms if part.unit is not None]
        agreed = units and all(unit == units[0] for unit in units)
        return units[0] if agreed else None, texts.pop() if len(texts) == 1 else ""
    if op in _ROOTS or op == "pow":
        power = _ROOTS.get(op, power)
        if not one.unit:
            return one.unit, ""
        return None if power is None else times(PURE, one.unit, power), ""
    return PURE, ""  # of sines and logarithms, and of conditions


def is_pure(value: float) -> bool:
    """Whether a numeric factor has no unit of its own, such as 1/2 or pi."""
    size = abs(value)
    return (
        any(value * k % 1 == 0.0 and size * k <= SMALL for k in range(1, SMALL + 1))
        or any(size == k * math.pi for k in (0.25, 0.5, 1.0, 2.0, 4.0))
        or (
            LEAST_PART <= size < 1.0
            and abs(size * 100.0 - round(size * 100.0)) < COMPUTED_ZERO
        )
    )
