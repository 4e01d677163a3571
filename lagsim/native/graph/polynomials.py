"""IR of the values of a Taylor series at a time, for all components side by side.

A series c is stored as its order K and the coefficients y_0, ..., y_K, each (size,).
The functions are

- `bend(h, c, out)`: the sum of y_k h^k over k >= 2,
- `slope(h, c, out)`: the derivative of the series, the sum of k y_k h^(k - 1),
- `reached(h, c, lost, out, left)`: the sum of all y_k h^k and of `lost`, the roundoff
  of y_0; `left` is the roundoff of the result,
- `reached_twice(h, further, c, lost, out, beyond)`: these sums at two times, h and
  `further`. Coefficients are loaded once: a load that crosses a line of the cache takes
  longer than the products,
- `weigh(c, rates, weights, out)`: with a weight for each component, the largest of the
  |y_k| of the last four orders, the highest first, then the largest of |y_1 - rates|,
  each (1,). A product that is not a number counts as 0, but as infinite in the last.

With constraints there are two more, of n velocities and positions, which lead a series
beyond its order between the ends of a step h. Low coefficients of the series at both
ends differ by the error of the step, high ones hardly do. With y_(K+1) ... y_(K+E) the
series has at its other end the last E coefficients of the series there.

- `extend(h, c, other, out)`: v_K h^K, then v_(K+1) h^(K+1) ... v_(K+E) h^(K+E); c and
  `other` are the series at both ends, from the first velocity on.
- `lengthen(x, h, more, q, v)`: adds these terms at the fraction x of h to velocities v,
  and their integrals to positions q; `more` is what `extend` writes.

Components are the lanes of vectors, and the loop over the order is unrolled. A
polynomial is split into four, by the remainder of k divided by 4, which overlap in
time.
"""

from __future__ import annotations

import hashlib
from math import comb, inf
from typing import TYPE_CHECKING

from lagsim.native.graph.lines import number
from lagsim.native.kernels.keys import text_beside

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

# Largest number of components in one vector. More are computed in a loop.
WIDEST = 8
# Numbers of components that are loaded by one instruction.
SINGLE = (1, 2, 4)
# Number of polynomials into which one is split.
SPLIT = 4
# The times of `reached_twice`.
TIMES = ("h", "further")
# Number of orders, the last of a series, whose coefficients `weigh` compares.
LAST_ORDERS = 4
# Largest number E of coefficients beyond the order. With 6 a residual between the ends
# of a step is smaller by 1e-2 to 1e-3.
MOST_BEYOND = 6


def digest(size: int, order: int, n: int = 0) -> str:
    """Return a digest of all that determines the result of `series_values`.

    size, order, n : its arguments.
    """
    return hashlib.sha256(
        repr((size, order, n, text_beside(__file__))).encode()
    ).hexdigest()


def beyond(order: int) -> int:
    """Return E, the number of coefficients that `extend` finds, for series of order K.

    order : K, at least 4.
    """
    return min(MOST_BEYOND, order - 1)


def weights(order: int) -> list[list[float]]:
    """Return weights (E, 2 E) that yield coefficients beyond K from those at both ends.

    Row i yields coefficient K + 1 + i at the first end of a step h: it has the weights
    of the coefficients of orders K - E + 1, ..., K at the first end, then at the other
    end. Every coefficient k is multiplied by h^k.

    order : K.

    Examples
    --------
    Of t^5, at t = 1 from 0, order 4; the coefficients of (1 + t)^5 are 10, 10 and 5.

    >>> row = weights(4)[0]
    >>> round(sum(w * b for w, b in zip(row[3:], (10, 10, 5))), 12)
    1.0
    """
    count = beyond(order)
    orders = range(order - count + 1, order + 1)
    # At the other end coefficient k is the sum of comb(m, k) y_m h^m over m.
    rows = [
        [comb(order + i, k) for i in range(1, count + 1)]
        + [-comb(m, k) for m in orders]
        + [int(m == k) for m in orders]
        for k in orders
    ]
    # Gauss-Jordan in integers: quotients are rounded once. The minors are positive.
    for i, pivot in enumerate(rows):
        for j, row in enumerate(rows):
            if j != i:
                rows[j] = [
                    pivot[i] * x - row[i] * y for x, y in zip(row, pivot, strict=True)
                ]
    return [[x / row[i] for x in row[count:]] for i, row in enumerate(rows)]


def series_values(size: int, order: int, n: int = 0) -> str:
    """Return the IR of the functions of the module docstring.

    size : the number of components of the series.
    order : K, at least 4.
    n : the number of positions, for `extend` and `lengthen`; 0 for neither.
    """
    bend = [(k, 1.0) for k in range(2, order + 1)]
    slope = [(k, float(k)) for k in range(1, order + 1)]
    functions = [
        _function("bend", size, lambda vectors: vectors.bend(bend)),
        _function("slope", size, lambda vectors: vectors.slope(slope)),
        _function(
            "reached", size, lambda vectors: vectors.reached(bend), ("lost", "left")
        ),
        _function(
            "reached_twice", size, lambda vectors: vectors.reached_twice(bend),
            ("lost", "beyond"), numbers=TIMES,
        ),
        _weigh(size, order),
    ]  # fmt: skip
    if n:
        functions += [
            _function(
                "extend", size, lambda vectors: vectors.extend(order), ("other",),
                count=n,
            ),
            _function(
                "lengthen", n, lambda vectors: vectors.lengthen(order),
                names=("more", "q", "v"), numbers=("x", "h"),
            ),
        ]  # fmt: skip
    return "\n".join([*functions, ""])


class _VectorWriter:
    """Writer of IR lines on vectors of `width` doubles.

    A vector is loaded from an array NAME at the address `NAME.at`.

    mark : prefix of the names of values.
    """

    def __init__(self, size: int, count: int, width: int, mark: str) -> None:
        self.size, self.count, self.width, self.mark = size, count, width, mark
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
        loaded = self.load("c", 1 + k * self.size)
        return loaded if factor == 1.0 else self.mul(loaded, self.literal(factor))

    def load(self, array: str, k: int) -> str:
        """Write code that loads the vector at index k of an array; return its name."""
        place = self.line(f"getelementptr double, ptr %{array}.at, i64 {k}")
        return self.line(f"load {self.kind}, ptr {place}, align 8")

    def literal(self, x: float) -> str:
        """Return the literal of a vector of equal numbers."""
        each = ", ".join([f"double {number(x)}"] * self.width)
        return f"<{each}>"

    def power(self, x: str, k: int) -> str:
        """Write the power k > 0 of a vector; return the name of its value."""
        if k == 1:
            return x
        root = self.power(x, k // 2)
        square = self.mul(root, root)
        return self.mul(square, x) if k % 2 else square

    def polynomials(
        self, terms: Sequence[tuple[int, float]], powers: Sequence[Sequence[str]]
    ) -> list[str]:
        """Write the sum over j of factor_j y_(k_j) h^j; return the names of its values.

        terms : pairs (k_j, factor_j).
        powers : the names of h, h^2 and h^4, for each time h.
        """
        parts: list[list[str]] = []
        for first in range(min(SPLIT, len(terms))):
            *lower, highest = terms[first::SPLIT]
            values = [self.coefficient(*highest)] * len(powers)
            for term in reversed(lower):
                factor = self.coefficient(*term)
                values = [
                    self.add(self.mul(value, fourth), factor)
                    for value, (_, _, fourth) in zip(values, powers, strict=True)
                ]
            parts.append(values)
        return [
            self._joined(own, *x)
            for own, x in zip(zip(*parts, strict=True), powers, strict=True)
        ]

    def _joined(self, parts: Sequence[str], h: str, square: str, _fourth: str) -> str:
        """Write the sum of the parts of a polynomial; return the name of its value."""
        low = self.add(parts[0], self.mul(parts[1], h))
        high = parts[2]
        if len(parts) == SPLIT:
            high = self.add(high, self.mul(parts[3], h))
        return self.add(low, self.mul(high, square))

    def bend(self, terms: Sequence[tuple[int, float]]) -> None:
        """Write the function `bend`; for `terms` see `polynomials`."""
        powers = self._powers("%h")
        [value] = self.polynomials(terms, [powers])
        self._store(self.mul(value, powers[1]), "out")

    def slope(self, terms: Sequence[tuple[int, float]]) -> None:
        """Write the function `slope`; for `terms` see `polynomials`."""
        [value] = self.polynomials(terms, [self._powers("%h")])
        self._store(value, "out")

    def reached(self, terms: Sequence[tuple[int, float]]) -> None:
        """Write the function `reached`: the sum of a series, and its roundoff.

        The arguments of this function are in the docstring of the module.

        terms : the terms of orders from 2 on.
        """
        before = self.coefficient(0, 1.0)
        [change] = self._changes(terms, ["%h"])
        after = self._exact("fadd", before, change)
        moved = self._exact("fsub", after, before)
        back = self._exact("fsub", after, moved)
        one = self._exact("fsub", before, back)
        other = self._exact("fsub", change, moved)
        self._store(after, "out")
        self._store(self._exact("fadd", one, other), "left")

    def reached_twice(self, terms: Sequence[tuple[int, float]]) -> None:
        """Write the function `reached_twice`; for `terms` see `reached`."""
        before = self.coefficient(0, 1.0)
        changes = self._changes(terms, [f"%{x}" for x in TIMES])
        for change, array in zip(changes, ("out", "beyond"), strict=True):
            self._store(self._exact("fadd", before, change), array)

    def _changes(
        self, terms: Sequence[tuple[int, float]], times: Sequence[str]
    ) -> list[str]:
        """Write the sums of a series at `times` less y_0; return their names."""
        powers = [self._powers(h) for h in times]
        lost, rate = self.load("lost", 0), self.coefficient(1, 1.0)
        found = self.polynomials(terms, powers)
        return [
            self.add(self.mul(value, square), self.add(self.mul(h, rate), lost))
            for value, (h, square, _) in zip(found, powers, strict=True)
        ]

    def products(self, order: int) -> list[str]:
        """Write the products that `weigh` compares; return the names of their vectors.

        order : K, the order of the series.
        """
        weights = self.load("weights", 0)
        off = self._exact("fsub", self.coefficient(1, 1.0), self.load("rates", 0))
        last = [self.coefficient(order - k, 1.0) for k in range(LAST_ORDERS)]
        found = [self._weighted(x, weights) for x in [*last, off]]
        infinite = self.literal(inf)
        known = [self.selected("ogt", x, "zeroinitializer") for x in found[:-1]]
        return [*known, self.selected("olt", found[-1], infinite)]

    def _weighted(self, x: str, weights: str) -> str:
        size = self.line(
            f"call {self.kind} @llvm.fabs.v{self.width}f64({self.kind} {x})"
        )
        return self._exact("fmul", size, weights)

    def selected(self, test: str, x: str, y: str) -> str:
        """Write x where the comparison `test` of x and y holds, elsewhere y."""
        mask = self.line(f"fcmp {test} {self.kind} {x}, {y}")
        mask = f"<{self.width} x i1> {mask}"
        return self.line(f"select {mask}, {self.kind} {x}, {self.kind} {y}")

    def extend(self, order: int) -> None:
        """Write the function `extend`, for series of order K = `order`."""
        h, count = self.splat("%h"), beyond(order)
        known: dict[str, list[str]] = {"c": [], "other": []}
        power = self.power(h, order - count + 1)
        for k in range(order - count + 1, order + 1):
            for array, terms in known.items():
                loaded = self.load(array, 1 + k * self.size)
                terms.append(self.mul(loaded, power))
            power = self.mul(power, h)
        terms = [*known["c"], *known["other"]]
        self._store(known["c"][-1], "out")
        for i, row in enumerate(weights(order), start=1):
            parts = [
                self.mul(x, self.literal(w)) for w, x in zip(row, terms, strict=True)
            ]
            total = parts[0]
            for part in parts[1:]:
                total = self.add(total, part)
            place = self.line(
                f"getelementptr double, ptr %out.at, i64 {i * self.count}"
            )
            self.lines.append(f"store {self.kind} {total}, ptr {place}, align 8")

    def lengthen(self, order: int) -> None:
        """Write the function `lengthen`, for series of order K = `order`."""
        x, count = self.splat("%x"), beyond(order)
        terms = [self.load("more", i * self.size) for i in range(count + 1)]
        rate = terms[-1]
        place = self.mul(rate, self.literal(1.0 / (order + count + 1)))
        for i in reversed(range(count)):
            if i:
                rate = self.add(self.mul(rate, x), terms[i])
            term = self.mul(terms[i], self.literal(1.0 / (order + i + 1)))
            place = self.add(self.mul(place, x), term)
        power = self.power(x, order + 1)
        far = self.mul(power, self.splat("%h"))
        self._store(self.add(self.mul(place, far), self.load("q", 0)), "q")
        self._store(self.add(self.mul(rate, power), self.load("v", 0)), "v")

    def _powers(self, time: str) -> tuple[str, str, str]:
        """Write the powers 1, 2 and 4 of a number; return the names of the vectors."""
        h = self.splat(time)
        square = self.mul(h, h)
        return h, square, self.mul(square, square)

    def _exact(self, operation: str, x: str, y: str) -> str:
        return self.line(f"{operation} {self.kind} {x}, {y}")

    def _store(self, value: str, array: str) -> None:
        self.lines.append(f"store {self.kind} {value}, ptr %{array}.at, align 8")


def _weigh(size: int, order: int) -> str:
    """Return the IR of `weigh`, for series of `size` components and an order."""
    # The last two vectors may overlap, since the largest product is counted, no sum.
    width, arrays = min(size, WIDEST), ("c", "rates", "weights")
    parameters = ", ".join(f"ptr %{x}" for x in (*arrays, "out"))
    last = _VectorWriter(size, size, width, "r")
    found = last.products(order)
    text = [f"define void @weigh({parameters}) {{", "entry:"]
    text += [
        f"%{x}.rest = getelementptr double, ptr %{x}, i64 {size - width}"
        for x in arrays
    ]
    text += [line.replace(".at", ".rest") for line in last.lines]
    if size > WIDEST:
        vectors = _VectorWriter(size, size, WIDEST, "v")
        most = [f"%most.{k}" for k in range(len(found))]
        new = [
            vectors.selected("ogt", x, y)
            for x, y in zip(vectors.products(order), most, strict=True)
        ]
        text += ["br label %each", "each:"]
        text.append("%first = phi i64 [0, %entry], [%next, %each]")
        text += [
            f"{x} = phi {vectors.kind} [{y}, %entry], [{z}, %each]"
            for x, y, z in zip(most, found, new, strict=True)
        ]
        text += [
            f"%{x}.at = getelementptr double, ptr %{x}, i64 %first" for x in arrays
        ]
        text += [*vectors.lines, f"%next = add i64 %first, {WIDEST}"]
        text.append(f"%again = icmp sle i64 %next, {size - WIDEST}")
        text += ["br i1 %again, label %each, label %rest", "rest:"]
        found = new
    kind = last.kind
    for k, x in enumerate(found):
        largest = f"@llvm.vector.reduce.fmax.v{width}f64({kind} {x})"
        text.append(f"%largest.{k} = call nnan double {largest}")
        text.append(f"%place.{k} = getelementptr double, ptr %out, i64 {k}")
        text.append(f"store double %largest.{k}, ptr %place.{k}, align 8")
    declared = [
        f"declare double @llvm.vector.reduce.fmax.v{width}f64({kind})",
        f"declare {kind} @llvm.fabs.v{width}f64({kind})",
    ]
    return "\n".join([*declared, *text, "ret void", "}"])


def _function(
    name: str,
    size: int,
    write: Callable[[_VectorWriter], None],
    more: Sequence[str] = (),
    *,
    count: int = 0,
    names: Sequence[str] = (),
    numbers: Sequence[str] = ("h",),
) -> str:
    """Return the IR of the function `name`, for series of `size` components.

    write : function that writes the code for one vector of components with a
        `_VectorWriter`.
    more : names of the array parameters besides `c` and `out`, up to two.
    count : the number of components to evaluate, by default all.
    names : names of all array parameters, in place of `more`.
    numbers : names of the parameters that are numbers.
    """
    arrays = (*names,) or ("c", *more[:1], "out", *more[1:])
    count = count or size
    parameters = [f"double %{x}" for x in numbers] + [f"ptr %{x}" for x in arrays]
    whole, rest = divmod(count, WIDEST)
    # The last vector may overlap those before, but where values are changed in place.
    width = rest
    if whole and rest not in SINGLE and "q" not in arrays:
        width = WIDEST
    text = [f"define void @{name}({', '.join(parameters)}) {{", "entry:"]
    if whole:
        vectors = _VectorWriter(size, count, WIDEST, "v")
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
        vectors = _VectorWriter(size, count, width, "r")
        write(vectors)
        begin = count - width
        text += [
            f"%{x}.rest = getelementptr double, ptr %{x}, i64 {begin}" for x in arrays
        ]
        text += [line.replace(".at", ".rest") for line in vectors.lines]
    return "\n".join([*text, "ret void", "}"])
