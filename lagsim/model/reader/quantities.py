"""Numbers in notations of other programs: with units, separators, a decimal comma."""

from __future__ import annotations

import math
import re
from collections import Counter
from typing import TYPE_CHECKING

from lagsim.model.nodes import Mapping, Scalar, Sequence, items_of, texts_of

if TYPE_CHECKING:
    from lagsim.model.nodes import Node

NUMBER = r"(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?"

# Units that are often names of variables too.
_UNITS = (
    "m|g|s|N|J|W|K|A|V|C|T|F|H|h|l|rad|deg|Pa|Hz|bar|Ohm|ohm|mol|L|lb|ft|rpm|in|inch|"
    "sec|seconds?|minutes?|hours?|days?|met(?:re|er)s?|grams?|newtons?|joules?|watts?|"
    "radians?|degrees?|revs?|revolutions?|turns?|grad|gon|inches|Nms?|Ns|Ws|Js"
)
_UNIT = rf"(?:da|[yzafpnuµμmcdhkMGT]|kilo)?(?:{_UNITS})|min|hr|kgf|lbf|mph"


# Units elsewhere: the unit of the SI, and the factors above and below the line.
_ELSEWHERE = {
    "deg degree degrees": ("rad", "pi", "180"), "grad gon": ("rad", "pi", "200"),
    "rev revs revolution revolutions turn turns": ("rad", "2 pi", ""),
    "rpm": ("rad/s", "2 pi", "60"), "min minute minutes": ("s", "60", ""),
    "h hr hour hours": ("s", "3600", ""), "day days": ("s", "86400", ""),
    "s sec second seconds": ("s", "", ""), "us µs μs": ("s", "", "1e6"),
    "g gram grams": ("kg", "", "1000"), "mg": ("kg", "", "1e6"),
    "in inch inches": ("m", "0.0254", ""), "ft": ("m", "0.3048", ""),
    "lb": ("kg", "0.45359237", ""), "bar": ("Pa", "1e5", ""), "cm": ("m", "", "100"),
    "dm": ("m", "", "10"), "um µm μm": ("m", "", "1e6"), "mph": ("m/s", "0.44704", ""),
    **{f"m{of}": (of, "", "1000") for of in ("m", "s", "N", "J", "rad")},
    **{f"k{of}": (of, "1000", "") for of in ("m", "N", "J", "W", "Hz", "Pa")},
    **{f"M{of}": (of, "1e6", "") for of in ("N", "J", "W", "Pa")},
    **{f"G{of}": (of, "1e9", "") for of in ("N", "J", "W", "Pa")},
}  # fmt: skip
_SCALES = {unit: row for units, row in _ELSEWHERE.items() for unit in units.split()}
_SPELT = {"kmh": "km/h", "kph": "km/h", "mps": "m/s"}
_SPELT |= {word: word for word in ("deg", "degrees", "degree", "rad", "rpm", "mph")}
_PER_MINUTE = r"(?:1|U|revs?)/min|min\^-1"
_WORD = r"[^\W\d_]\w*"
_FACTOR = r"([*/]?)([^\W\d_]+)(?:\^(-?\d+))?"
_LIKE = {
    "rad": ": angles are in radians",
    "radians": ": angles are in radians",
    "rad/s": ": rates are in rad/s",
}


def names_in(text: str) -> list[str]:
    """Return the names in a text."""
    return re.findall(_WORD, text)


def is_unit(text: str) -> bool:
    """Whether a text looks like a unit: each word of it does."""
    found = names_in(unit_spelling(text))
    return bool(found) and all(re.fullmatch(_UNIT, word) for word in found)


def unit_spelling(text: str) -> str:
    """Return a unit in this language's spelling: powers by `^`, products by `*`.

    Examples
    --------
    >>> unit_spelling("m/s²")
    'm/s^2'
    """
    for letter, plain in (
        ("**", "^"), ("²", "^2"), ("³", "^3"), ("·", "*"), ("⋅", "*"),
        ("°", "deg"), ("º", "deg"), ("^(-2)", "^-2"), ("^(-1)", "^-1"),
    ):  # fmt: skip
        text = text.replace(letter, plain)
    plain = re.sub(r"\s*([*/^])\s*", r"\1", text.strip(" .")).replace(" ", "*")
    plain = re.sub(r"/(\w+)\^-(\d)", r"/\1^\2", plain)  # m/s^-2
    plain = re.sub(r"\bms\^-", "m*s^-", plain)  # none is of milliseconds
    plain = _SPELT.get(plain.casefold(), plain)
    return "rpm" if re.fullmatch(_PER_MINUTE, plain) else plain


def _scaled(number: str, of: str) -> tuple[str, str]:
    """Return a number in SI units, and the SI unit; unchanged for an unclear unit.

    of : the unit of the number.
    """
    found = re.findall(_FACTOR, of)
    if "".join(a + b + (c and f"^{c}") for a, b, c in found) != of:
        return number, of
    above: Counter[str] = Counter()
    below: Counter[str] = Counter()
    plain = ""
    for sign, word, power in found:
        si, *factors = _SCALES.get(word, (word, "", ""))
        times = int(power or 1) * (-1 if sign == "/" else 1)
        sides = (above, below) if times > 0 else (below, above)
        for side, several in zip(sides, factors, strict=True):
            for factor in several.split():
                side[factor] += abs(times)
        plain += sign + si + (power and f"^{power}")
    ends = "".join(
        f"{sign}{factor}" + (f"^{times}" if times > 1 else "")
        for sign, factors in (("*", above), ("/", below))
        for factor, times in factors.items()
    )
    if ends and not re.fullmatch(rf"[-+]?{NUMBER}", number):
        number = f"({number})"
    return number + ends, plain


def in_si(symbol: str) -> tuple[str, float]:
    """Return the SI unit of a symbol, and the factor between both.

    Examples
    --------
    >>> in_si("km")
    ('m', 1000.0)
    """
    plain, above, below = _SCALES.get(symbol, (symbol, "", ""))
    values = [
        math.prod(math.pi if x == "pi" else float(x) for x in factors.split())
        for factors in (above, below)
    ]
    return plain, values[0] / values[1]


def quantity(number: str, of: str, *, beside: bool) -> str:
    """Return a hint with the spelling of a number that has a unit.

    `beside`: the number is the value of a parameter or a definition, with its unit.
    """
    of = unit_spelling(of)
    if of == "Hz" and not beside:
        return f"write {number}*2*pi: rates are in rad/s"
    scaled, plain = _scaled(number, of)
    if scaled == number:
        if beside:
            return f"write {{value: {number}, unit: {of}}}: a unit is written beside"
        reason = _LIKE.get(of, ": a number is written here without its unit")
        return f"write {number}{reason}"
    if plain in _LIKE:
        return f"write {scaled}{_LIKE[plain]}"
    return (
        f"write {scaled}, in {plain}, or {number} where all is in {of}: "
        "units never scale numbers"
    )


_MARKS = r"[ ',.\u00a0\u202f]"
SEPARATED = rf"(?<![\w.])\d+(?:{_MARKS}\d+)+(?:[eE][+-]?\d+)?"
# Number of digits between two marks of thousands.
_GROUP = 3


def separated(text: str) -> str:
    """Return a hint for a number with separators or a decimal comma, or ""."""
    if not re.fullmatch(SEPARATED, text):
        return ""
    text, *power = re.split(r"(?=[eE])", text)
    parts, marks = re.split(_MARKS, text), re.findall(_MARKS, text)
    groups = all(len(part) == _GROUP for part in parts[1:-1])
    last, others = marks[-1], set(marks[:-1])
    if last in ",." and last not in others and len(others) < 2 and groups:
        if last == "." and not others:
            return ""
        number = f"{''.join(parts[:-1])}.{parts[-1]}"
        if not others and len(parts[-1]) == _GROUP and parts[0].lstrip("0"):
            return f"write {''.join(parts)}, or {number} if the comma is a decimal one"
        return f"write {''.join([number, *power])}: a decimal point is written `.`"
    if groups and len(parts[-1]) == _GROUP and len({*others, last}) == 1:
        return f"write {''.join(parts)}, without separators"
    return ""


_SPAN = (
    rf"(?:[\w.]*(?:range|linspace)\s*)?[\[(]?\s*({NUMBER})\s*(?:,|\.\.|\bto\b|(?<=0):)"
    rf"\s*({NUMBER})\s*(?:,.*)?[\])]?"
)


def span(node: Node) -> str:
    """Return a hint for a time span in another notation, such as `0:10`; else ""."""
    text = ", ".join(texts_of(items_of(node)))
    if separated(text) or not (ends := re.fullmatch(_SPAN, text)):
        return ""
    return f"write `start: {ends[1]}` and `end: {ends[2]}`"


def time(node: Node) -> str:
    """Return a hint for a single time in place of a span or a rate; else ""."""
    found = re.fullmatch(rf"({NUMBER})\s*(?:Hz|1/s|fps)", " ".join(texts_of([node])))
    return f"write 1/{found[1]}" if found else span(node)


def of_collection(node: Node, *, beside: bool) -> str:
    """Return a hint for a mapping or a list in place of an expression; else "".

    beside : see `quantity`.
    """
    if isinstance(node, Mapping):
        given = {k.text: v.text for k, v in node.entries if isinstance(v, Scalar)}
        if given.get("value"):
            return quantity(given["value"], given.get("unit", ""), beside=False)
        if len(node.entries) == 1 and given:
            [(key, value)] = given.items()
            return f"write {value or key}, without braces"
    if isinstance(node, Sequence):
        if len(node.items) == 1 and isinstance(node.items[0], Mapping):
            return of_collection(node.items[0], beside=beside)
        texts = texts_of(node.items)
        if len(texts) == len(node.items) == 1:
            alone = re.fullmatch(rf"([-+]?{NUMBER})\s*(.+)", texts[0])
            if alone and is_unit(alone[2]):
                return quantity(alone[1], alone[2], beside=beside)
            return f"write {texts[0]}, without brackets"
        both = len(texts) == len(node.items) == len(("number", "unit"))
        if both and re.fullmatch(rf"[-+]?{NUMBER}", texts[0]) and is_unit(texts[1]):
            return quantity(*texts, beside=beside)
    return "write one expression, without brackets or braces"
