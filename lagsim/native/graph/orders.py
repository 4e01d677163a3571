"""A Taylor series as straight-line code: one order after the other.

The inner sums of the products of an order, a_1 b_(k-1) + ... + a_(k-1) b_1, are
computed side by side: the factors of order j of all sums are the lanes of vectors, and
one instruction adds the products of several sums. The first and the last term of a sum,
with the newest coefficients, are added to its lane alone, since the next order waits
for them; so are all terms of low orders. The code for the vectors of order k + 1 comes
before that for the other operations of order k, which the processor then executes
beside them. Each sum has a lane of its own, so that the width of the processor's
vectors does not change the result.

The memory of a series, behind the scratch memory of other functions, holds the vectors
of all orders.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from lagsim.language.series import ORDERS
from lagsim.native.graph.lines import exponent_of, hoisted, number
from lagsim.native.graph.writer import LINE_BYTES

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from lagsim.native.graph.keys import Loop
    from lagsim.native.graph.writer import FunctionWriter, Place

# The factors of a sum: the names of their values of one order.
Factors = list[tuple[str, str]]

# Number of sums in one vector, and in the last one if there are so few.
WIDEST, NARROW = 4, 2
# Sums from this order on are computed in vectors.
FIRST_VECTORS = 6
# A sum is split into so many, which overlap in time.
CHAINS = 2

_START = """\
define void @{name}({signature}) {{
%raw = getelementptr double, ptr %p, i64 {base}
%address = ptrtoint ptr %raw to i64
%negative = sub i64 0, %address
%missing = and i64 %negative, {mask}
%w = getelementptr i8, ptr %raw, i64 %missing
store double {order}, ptr %out"""


def write(
    w: FunctionWriter, name: str, loop: Loop, places: Mapping[int, Place]
) -> None:
    """Write the function `name`, which evaluates a Taylor series order by order.

    w : writer to whose lines the code is added.
    loop : the series.
    places : graph nodes that `prepare` has evaluated, with the places of their values
        in memory.
    """
    start = _START.format(
        name=name, signature=w.signature, base=w.scratch, mask=LINE_BYTES - 1,
        order=number(loop.order),
    )  # fmt: skip
    w.lines.append(start)
    orders = _Orders(w, loop, places)
    for k in range(1, loop.order):
        orders.write(k)
    w.lines += ["ret void", "}"]
    w.scratch_used = orders.row * loop.order + LINE_BYTES // 8


class _Orders:
    """Writer of the code of a series, order by order.

    Attributes
    ----------
    row : int
        Number of doubles in memory of the vectors of one order.
    """

    def __init__(
        self, w: FunctionWriter, loop: Loop, places: Mapping[int, Place]
    ) -> None:
        self.w, self.g, self.r, self.order = w, w.g, loop.recurrence, loop.order
        g, r = self.g, self.r
        self._numbers = [g.variable(x) for x in ORDERS]
        count = len(r.sums)
        # The first sum, and the width, of each vector.
        self._vectors = [
            (i, WIDEST if count - i > NARROW else NARROW)
            for i in range(0, count, WIDEST)
        ]
        self.row = 2 * -(-count // WIDEST) * WIDEST
        self._factors: dict[int, Factors] = {}
        self._ahead: list[str] = []  # names of the sums of the next order, but its ends
        once = hoisted(g, r.computed, {*self._numbers, *r.carried, *r.sums})
        begin = [(n, ("out", 1 + i)) for i, n in enumerate((*r.state, *r.rates))]
        self._once = w.values(begin, once, places)
        self._places = places
        self._state = [self._once[n] for n in r.rates]

    def write(self, k: int) -> None:
        """Write order k, which determines the coefficients of order k + 1."""
        g, r, w = self.g, self.r, self.w
        numbers = (float(k), 1.0 / k, 1.0 / (k + 1), float(k == 1))
        new = dict(zip(self._numbers, map(g.constant, numbers), strict=True))
        if k == 1:
            new |= dict.fromkeys(r.sums, g.zero)
        last = k + 1 == self.order
        made = g.substitute(r.following if last else r.computed, new)
        values = dict(zip(r.carried, self._state, strict=True))
        if k > 1:
            values |= zip(r.sums, self._sums(k), strict=True)
        if k + 1 >= FIRST_VECTORS and not last:
            self._ahead = [*self._inner(k + 1)]
        size = len(r.state)
        for n in g.cone(made, self._places):
            known = n in values or n in self._once or n in self._places
            if g.args[n] and not known:
                operands = [self._operand(a, values) for a in g.args[n]]
                values[n] = w.operation(g.ops[n], exponent_of(g, n), operands)
        self._state = [self._operand(n, values) for n in made[:size]]
        for i, value in enumerate(self._state):
            w.store(value, ("out", 1 + (k + 1) * size + i))
        pairs = [self._operand(n, values) for n in made[size:]]
        self._factors[k] = list(zip(pairs[::2], pairs[1::2], strict=True))
        if 1 < k < self.order - 2:
            self._store_factors(k)

    def _operand(self, n: int, values: Mapping[int, str]) -> str:
        if n in values:
            return values[n]
        if n not in self._once:
            self._once[n] = self.w.leaf(n, self._places)
        return self._once[n]

    def _sums(self, k: int) -> list[str]:
        """Write the inner sums of order k > 1; return the names of their values."""
        w, found = self.w, self._ahead or [""] * len(self.r.sums)
        for i in range(len(found)):
            for j in (1, k - 1) if self._ahead else _outward(1, k):
                a, b = self._factors[j][i][0], self._factors[k - j][i][1]
                product = w.line(f"fmul double {a}, {b}")
                before = found[i]
                found[i] = (
                    w.line(f"fadd double {before}, {product}") if before else product
                )
        return found

    def _inner(self, k: int) -> Iterator[str]:
        """Write the inner sums of order k without their first and last terms.

        The names of their values are yielded.
        """
        w = self.w
        for first, width in self._vectors:
            kind = f"<{width} x double>"
            parts = [""] * CHAINS
            for at, j in enumerate(_outward(2, k - 1)):
                a = self._vector(j, first, width, 0)
                b = self._vector(k - j, first, width, 1)
                product = w.line(f"fmul contract {kind} {a}, {b}")
                before = parts[at % CHAINS]
                if before:
                    product = w.line(f"fadd contract {kind} {before}, {product}")
                parts[at % CHAINS] = product
            value = w.line(f"fadd contract {kind} {parts[1]}, {parts[0]}")
            for lane in range(min(width, len(self.r.sums) - first)):
                yield w.line(f"extractelement {kind} {value}, i32 {lane}")

    def _vector(self, j: int, first: int, width: int, which: int) -> str:
        """Write code that loads a vector of factors of order j; return its name.

        first, width : index of the first sum to which the factors belong, and their
            number.
        which : 0 for the first factors, 1 for the second.
        """
        place = self.w.address(self._place(j, first, which))
        kind = f"<{width} x double>"
        return self.w.line(f"load {kind}, ptr {place}, align {8 * width}")

    def _place(self, j: int, first: int, which: int) -> Place:
        return "w", self.row * j + which * (self.row // 2) + first

    def _store_factors(self, k: int) -> None:
        """Write code that stores the factors of order k of all sums in memory.

        Each sum of products has a first and a second factor. The first factors of all
        sums are stored as one sequence of vectors, with a lane for each sum; the second
        factors as another.
        """
        w = self.w
        for first, width in self._vectors:
            kind = f"<{width} x double>"
            for which in range(2):
                value = "zeroinitializer"
                for lane, pair in enumerate(self._factors[k][first : first + width]):
                    one = f"double {pair[which]}, i32 {lane}"
                    value = w.line(f"insertelement {kind} {value}, {one}")
                place = w.address(self._place(k, first, which))
                w.lines.append(f"store {kind} {value}, ptr {place}, align {8 * width}")


def _outward(first: int, end: int) -> list[int]:
    """Return first, ..., end - 1, ordered from the middle to both ends.

    The newest terms of a sum are at the ends.

    Examples
    --------
    >>> _outward(2, 6)
    [3, 4, 2, 5]
    """
    ends = first + end - 1
    return sorted(range(first, end), key=lambda j: (-min(j, ends - j), j))
