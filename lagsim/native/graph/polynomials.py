"""IR of the values of a Taylor series at a time, for all components side by side.

A series c is stored as its order K and the coefficients y_0, ..., y_K, each (size,).
The functions are

- `bend(h, c, out)`: the sum of y_k h^k over k >= 2,
- `slope(h, c, out)`: the derivative of the series, the sum of k y_k h^(k - 1),
- `reached(h, c, lost, out, left)`: the sum of all y_k h^k and of `lost`, the roundoff
  of y_0; `left` is the roundoff of the result.

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
    from collections.abc import Callable, Sequence

# Largest number of components in one vector. More are computed in a loop.
WIDEST = 8
# Number of polynomials into which one is split.
SPLIT = 4


def digest(size: int, order: int) -> str:
    """Return a digest of all that determines the result of `series_values`.

    size, order : its arguments.
    """
    return hashlib.sha256(
        repr((size, order, text_beside(__file__))).encode()
    ).hexdigest()


def series_values(size: int, order: int) -> str:
    """Return the IR of `bend`, `slope` and `reached`, for series of `size` components.

    order : K, at least 4.
    """
    bend = [(k, 1.0) for k in range(2, order + 1)]
    slope = [(k, float(k)) for k in range(1, order + 1)]
    functions = [
        _function("bend", size, lambda vectors: vectors.bend(bend)),
        _function("slope", size, lambda vectors: vectors.slope(slope)),
        _function(
            "reached", size, lambda vectors: vectors.reached(bend), ("lost", "left")
        ),
    ]
    return "\n".join([*functions, ""])


class _VectorWriter:
    """Writer of IR lines on vectors of `width` doubles.

    A vector is loaded from an array NAME at the address `NAME.at`.

    mark : prefix of the names of values.
    """

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
        """Write `factor` times the coefficients y_k; return the name of the vector."""
        place = f"getelementptr double, ptr %c.at, i64 {1 + k * self.size}"
        loaded = self.line(f"load {self.kind}, ptr {self.line(place)}, align 8")
        if factor == 1.0:
            return loaded
        each = ", ".join([f"double {number(factor)}"] * self.width)
        return self.mul(loaded, f"<{each}>")

    def polynomial(self, terms: Sequence[tuple[int, float]], powers: list[str]) -> str:
        """Write the sum over j of factor_j y_(k_j) h^j; return the name of its value.

        terms : pairs (k_j, factor_j).
        powers : the names of h, h^2 and h^4.
        """
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

    def bend(self, terms: Sequence[tuple[int, float]]) -> None:
        """Write the function `bend`; for `terms` see `polynomial`."""
        _, value, square = self._powers_and_value(terms)
        self._store(self.mul(value, square), "out")

    def slope(self, terms: Sequence[tuple[int, float]]) -> None:
        """Write the function `slope`; for `terms` see `polynomial`."""
        _, value, _ = self._powers_and_value(terms)
        self._store(value, "out")

    def reached(self, terms: Sequence[tuple[int, float]]) -> None:
        """Write the function `reached` of the module docstring.

        terms : the terms of orders from 2 on.
        """
        h, value, square = self._powers_and_value(terms)
        lost = self.line(f"load {self.kind}, ptr %lost.at, align 8")
        first = self.add(self.mul(h, self.coefficient(1, 1.0)), lost)
        change = self.add(self.mul(value, square), first)
        before = self.coefficient(0, 1.0)
        after = self._exact("fadd", before, change)
        moved = self._exact("fsub", after, before)
        back = self._exact("fsub", after, moved)
        one = self._exact("fsub", before, back)
        other = self._exact("fsub", change, moved)
        self._store(after, "out")
        self._store(self._exact("fadd", one, other), "left")

    def _powers_and_value(
        self, terms: Sequence[tuple[int, float]]
    ) -> tuple[str, str, str]:
        h = self.splat("%h")
        square = self.mul(h, h)
        fourth = self.mul(square, square)
        return h, self.polynomial(terms, [h, square, fourth]), square

    def _exact(self, operation: str, x: str, y: str) -> str:
        return self.line(f"{operation} {self.kind} {x}, {y}")

    def _store(self, value: str, array: str) -> None:
        self.lines.append(f"store {self.kind} {value}, ptr %{array}.at, align 8")


def _function(
    name: str,
    size: int,
    write: Callable[[_VectorWriter], None],
    more: Sequence[str] = (),
) -> str:
    """Return the IR of the function `name`, for series of `size` components.

    write : function that writes the code for one vector of components with a
        `_VectorWriter`.
    more : names of the array parameters besides `c` and `out`, two or none.
    """
    arrays = ("c", more[0], "out", more[1]) if more else ("c", "out")
    signature = ", ".join(f"ptr %{x}" for x in arrays)
    whole, rest = divmod(size, WIDEST)
    text = [f"define void @{name}(double %h, {signature}) {{", "entry:"]
    if whole:
        vectors = _VectorWriter(size, WIDEST, "v")
        write(vectors)
        text += ["br label %each", "each:"]
        text.append("%first = phi i64 [0, %entry], [%next, %each]")
        text += [
            f"%{x}.at = getelementptr double, ptr %{x}, i64 %first" for x in arrays
        ]
        text += [*vectors.lines, f"%next = add i64 %first, {WIDEST}"]
        text.append(f"%again = icmp slt i64 %next, {whole * WIDEST}")
        text += ["br i1 %again, label %each, label %rest", "rest:"]
    if rest:
        vectors = _VectorWriter(size, rest, "r")
        write(vectors)
        begin = whole * WIDEST
        text += [
            f"%{x}.rest = getelementptr double, ptr %{x}, i64 {begin}" for x in arrays
        ]
        text += [line.replace(".at", ".rest") for line in vectors.lines]
    return "\n".join([*text, "ret void", "}"])
