"""IR of the values of a Taylor series at a time, for all components side by side.

A series c is stored as its order K and the coefficients y_0, ..., y_K, each (size,).
The functions are

- `bend(h, c, out)`: the sum of y_k h^k over k >= 2,
- `slope(h, c, out)`: the derivative of the series, the sum of k y_k h^(k - 1).

Components are the lanes of vectors, and the loop over the order is unrolled. A
polynomial is split into four, by the remainder of k divided by 4, which overlap in
time.
"""

from __future__ import annotations

import hashlib
from typing import TYPE_CHECKING

from lagsim.native.graph.lines import number
from lagsim.native.kernels.keys import text_beside

if TYPE_CHECKING:
    from collections.abc import Sequence

# Largest number of components in one vector. More are computed in a loop.
WIDEST = 8
# Number of polynomials into which one is split.
SPLIT = 4


def digest(size: int, order: int) -> str:
    """Return a digest of the inputs that determine the result of `series_values`."""
    return hashlib.sha256(
        repr((size, order, text_beside(__file__))).encode()
    ).hexdigest()


def series_values(size: int, order: int) -> str:
    """Return the IR of `bend` and `slope` for series of `size` components.

    order : K, at least 4.
    """
    bend = [(k, 1.0) for k in range(2, order + 1)]
    slope = [(k, float(k)) for k in range(1, order + 1)]
    functions = [
        _function("bend", size, bend, square=True),
        _function("slope", size, slope, square=False),
    ]
    return "\n".join([*functions, ""])


class _Writer:
    """Lines on vectors of `width` doubles, of the components from %first on."""

    def __init__(self, size: int, width: int, mark: str) -> None:
        self.size, self.width, self.mark = size, width, mark
        self.kind = f"<{width} x double>"
        self.lines: list[str] = []

    def line(self, text: str) -> str:
        name = f"%{self.mark}{len(self.lines)}"
        self.lines.append(f"{name} = {text}")
        return name

    def add(self, x: str, y: str) -> str:
        return self.line(f"fadd contract {self.kind} {x}, {y}")

    def mul(self, x: str, y: str) -> str:
        return self.line(f"fmul contract {self.kind} {x}, {y}")

    def splat(self, x: str) -> str:
        one = self.line(f"insertelement {self.kind} poison, double {x}, i32 0")
        mask = f"<{self.width} x i32> zeroinitializer"
        return self.line(f"shufflevector {self.kind} {one}, {self.kind} poison, {mask}")

    def coefficient(self, k: int, factor: float) -> str:
        """Write `factor` times the coefficients y_k of the components."""
        place = f"getelementptr double, ptr %from, i64 {1 + k * self.size}"
        loaded = self.line(f"load {self.kind}, ptr {self.line(place)}, align 8")
        if factor == 1.0:
            return loaded
        each = ", ".join([f"double {number(factor)}"] * self.width)
        return self.mul(loaded, f"<{each}>")

    def polynomial(self, terms: Sequence[tuple[int, float]], powers: list[str]) -> str:
        """Write the sum of factor_j y_(k_j) h^j; powers : h, h^2 and h^4."""
        h, square, fourth = powers
        parts = []
        for first in range(min(SPLIT, len(terms))):
            *lower, highest = terms[first::SPLIT]
            value = self.coefficient(*highest)
            for term in reversed(lower):
                value = self.add(self.mul(value, fourth), self.coefficient(*term))
            parts.append(value)
        low = self.add(parts[0], self.mul(parts[1], h))
        high = parts[2]
        if len(parts) == SPLIT:
            high = self.add(high, self.mul(parts[3], h))
        return self.add(low, self.mul(high, square))

    def function(self, terms: Sequence[tuple[int, float]], *, square: bool) -> None:
        """Write the polynomial, or its product with h^2, to %to."""
        h = self.splat("%h")
        second = self.mul(h, h)
        fourth = self.mul(second, second)
        value = self.polynomial(terms, [h, second, fourth])
        if square:
            value = self.mul(value, second)
        self.lines.append(f"store {self.kind} {value}, ptr %to, align 8")


def _function(
    name: str, size: int, terms: Sequence[tuple[int, float]], *, square: bool
) -> str:
    """Return the IR of a function that evaluates a polynomial of each component.

    terms : pairs of k and the factor of y_k.
    """
    whole, rest = divmod(size, WIDEST)
    text = f"define void @{name}(double %h, ptr %c, ptr %out) {{\nentry:\n"
    if whole:
        vectors = _Writer(size, WIDEST, "v")
        vectors.function(terms, square=square)
        body = "\n".join(vectors.lines)
        text += _LOOP.format(body=body, widest=WIDEST, end=whole * WIDEST)
    if rest:
        vectors = _Writer(size, rest, "r")
        vectors.function(terms, square=square)
        body = "\n".join(vectors.lines).replace("%from", "%from.r")
        text += _REST.format(body=body.replace("%to", "%to.r"), first=whole * WIDEST)
    return f"{text}ret void\n}}"


_LOOP = """\
br label %each
each:
%first = phi i64 [0, %entry], [%next, %each]
%from = getelementptr double, ptr %c, i64 %first
%to = getelementptr double, ptr %out, i64 %first
{body}
%next = add i64 %first, {widest}
%again = icmp slt i64 %next, {end}
br i1 %again, label %each, label %rest
rest:
"""
_REST = """\
%from.r = getelementptr double, ptr %c, i64 {first}
%to.r = getelementptr double, ptr %out, i64 {first}
{body}
"""
