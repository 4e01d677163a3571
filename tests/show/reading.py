"""Reads the formulas of a derivation back: text, ASCII and LaTeX, into numbers.

Shares nothing with lagsim. One grammar serves all three: factors that stand side by
side are multiplied, as by hand.
"""

from __future__ import annotations

import math
import re
import unicodedata
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
    """Return the number of a formula; `values` has the value of each displayed name."""
    return _Reader(formula, values).whole()


class UnreadableError(Exception):
    """Formula that a person could not read either."""


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


def text_rows(document: str) -> list[tuple[str, str]]:
    """Return the rows `label = formula` of a text; prose has an empty formula."""
    _, *sections = re.split(r"(?m)^.*\n-+$", unicodedata.normalize("NFC", document))
    # A term that begins a line goes on with the one before.
    body = re.sub(r"\n\s{4,}(?=[−=+-] )", " ", "\n".join(sections))
    rows = (line.strip().partition(" = ") for line in body.splitlines())
    return [(label.strip(), formula.strip()) for label, _, formula in rows if label]


def latex_rows(document: str) -> list[tuple[str, str]]:
    """Return the rows `label &= formula` of all aligned formulas."""
    bodies = re.findall(r"\\begin\{align\*\}(.*?)\\end\{align\*\}", document, re.DOTALL)
    rows = []
    for body in bodies:
        for line in re.sub(r"\\\\\s*&\\quad", " ", body).split("\\\\"):
            label, mark, formula = line.strip().partition("&")
            assert mark, line
            rows.append((label.strip(), formula.strip().removeprefix("=").strip()))
    return rows
