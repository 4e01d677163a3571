"""Reads the formulas of a derivation back: text, ASCII and LaTeX, into numbers.

Shares nothing with lagsim. One grammar serves all three: factors that stand side by
side are multiplied, as by hand.
"""

from __future__ import annotations

import math
import re
import unicodedata
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping

FUNCTIONS = {
    "sin": math.sin, "cos": math.cos, "tan": math.tan, "exp": math.exp,
    "sqrt": math.sqrt, "√": math.sqrt, "ln": math.log, "log": math.log,
    "sgn": lambda x: math.copysign(1.0, x), "sign": lambda x: math.copysign(1.0, x),
    "abs": abs, "hypot": math.hypot, "atan": math.atan, "arctan": math.atan,
}  # fmt: skip
_RAISED = {c: str(k) for k, c in enumerate("⁰¹²³⁴⁵⁶⁷⁸⁹")}
_NUMBER = re.compile(r"\d+(\.\d+)?(e[+-]?\d+)?")
_LATEX = re.compile(r"\\(?:left|right|bigl|bigr|,)|\{\}")


def value(formula: str, values: Mapping[str, float]) -> float:
    """Give the number of a formula; `values` says what each name, as shown, is."""
    return _Reader(formula, values).whole()


class UnreadableError(Exception):
    """What a person could not read either."""


class _Reader:
    def __init__(self, formula: str, values: Mapping[str, float]) -> None:
        # \left and spaces say nothing.
        formula = re.sub(r"\\operatorname\{(\w+)\}", r"\1", formula)
        self.text = _LATEX.sub(" ", formula).replace("−", "-")
        self.values = values
        self.names = sorted(values, key=len, reverse=True)
        self.at = 0
        self.open = [""]

    def whole(self) -> float:
        result = self.sum()
        if self.peek():
            raise UnreadableError(self.text[self.at :])
        return result

    def peek(self) -> str:
        while self.text[self.at : self.at + 1].isspace():
            self.at += 1
        return self.text[self.at : self.at + 1]

    def take(self, *signs: str) -> str:
        self.peek()
        for sign in signs:
            if self.text.startswith(sign, self.at):
                self.at += len(sign)
                return sign
        return ""

    def need(self, sign: str) -> None:
        if not self.take(sign):
            raise UnreadableError(f"no {sign} at {self.text[self.at :]!r}")

    def sum(self) -> float:
        total = -self.product() if self.take("-") else self.product()
        while sign := self.take("+", "-"):
            total += self.product() if sign == "+" else -self.product()
        return total

    def product(self) -> float:
        result = self.power()
        while (c := self.peek()) and c not in "+-)}],&=" and c != self.open[-1]:
            if self.take("/"):
                result /= self.power()
            else:
                self.take("*")
                result *= self.power()
        return result

    def power(self) -> float:
        base = self.atom()
        exponent = self.exponent()
        return base if exponent is None else base**exponent

    def exponent(self) -> float | None:
        if self.take("^{"):
            result = self.sum()
            self.need("}")
            return result
        if self.take("^"):
            return self.atom()
        digits = ""
        while self.text[self.at : self.at + 1] in _RAISED and self.at < len(self.text):
            digits += _RAISED[self.text[self.at]]
            self.at += 1
        return float(digits) if digits else None

    def atom(self) -> float:
        for opening, closing in (("(", ")"), ("{", "}"), ("|", "|")):
            if self.take(opening):
                self.open.append(closing)
                result = self.sum()
                self.need(self.open.pop())
                return abs(result) if opening == "|" else result
        if self.take(r"\frac"):
            return self.atom() / self.atom()
        self.peek()
        if number := _NUMBER.match(self.text, self.at):
            self.at = number.end()
            return float(number[0])
        return self.named()

    def named(self) -> float:
        for name in self.names:
            if self.text.startswith(name, self.at):
                rest = self.text[self.at + len(name) :][:1]
                if not (rest.isalpha() or rest == "_" or rest == "("):
                    self.at += len(name)
                    return self.values[name]
                if rest == "(" and name not in FUNCTIONS:
                    raise UnreadableError(f"{name} is called")
        self.take("\\")
        for name, function in FUNCTIONS.items():
            if self.take(name):
                exponent = self.exponent()
                # A bare argument is one letter or number: \cos \theta.
                result = function(self.atom())
                return result if exponent is None else result**exponent
        raise UnreadableError(self.text[self.at :])


@dataclass(frozen=True)
class Row:
    """A line of a section: what it says it gives, and formulas with one value."""

    section: str
    label: str
    formula: str


def text_rows(document: str) -> list[Row]:
    """Give the rows of a text: `label = formula`; prose has an empty formula."""
    lines = unicodedata.normalize("NFC", document).splitlines()
    section, rows, k = "", [], 0
    while k < len(lines):
        line = lines[k]
        under = lines[k + 1] if k + 1 < len(lines) else ""
        if under and set(under) == {"-"}:
            section, k = line, k + 2
            continue
        k += 1
        # A term that begins a line goes on with the one before.
        while k < len(lines) and re.match(r"\s{4,}[−=+-] ", lines[k]):
            line += " " + lines[k].strip()
            k += 1
        if section and line.strip():
            rows.append(_row(section, line.strip()))
    return rows


def _row(section: str, line: str) -> Row:
    label, _, formula = line.partition(" = ")
    return Row(section, label.strip(), formula.strip())


def latex_rows(document: str) -> list[Row]:
    """Give the rows of all aligned formulas, with the heading that they stand under."""
    rows, section = [], ""
    pattern = (
        r"\\subsection\*\{(?P<title>[^\n]*)\}|For \$(?P<q>[^$]*)\$:"
        r"|(?P<motion>The equations of motion are)"
        r"|\\begin\{align\*\}(?P<body>.*?)\\end\{align\*\}"
    )
    for m in re.finditer(pattern, document, re.DOTALL):
        if m["body"] is None:
            section = m["title"] or m["q"] or m["motion"]
            continue
        body = re.sub(r"\\\\\s*&\\quad", " ", m["body"])
        for line in body.split("\\\\"):
            label, mark, formula = line.strip().partition("&")
            assert mark, line
            formula = formula.strip().removeprefix("=")
            rows.append(Row(section, label.strip(), formula.strip()))
    return rows
