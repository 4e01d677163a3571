"""Interval arithmetic: enclosures of the values of expressions.

An enclosure contains every value of an expression while its variable runs through an
interval, values in double precision included: bounds are rounded outward. Many
intervals are evaluated together, as arrays. Zeros have no sign here. The rows of the
table of functions name their rules in this module: a rule such as `add` returns the
enclosure of a function from the enclosures of its arguments.

Source: R. E. Moore, R. B. Kearfott, M. J. Cloud, Introduction to Interval Analysis,
SIAM 2009.
"""

from __future__ import annotations

import math
import sys
from itertools import product
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from lagsim.language.elements import Elements
from lagsim.language.evaluate import evaluate
from lagsim.language.functions import ELEMENTS, OPERATIONS, PART, STEPS
from lagsim.language.tables import FIRST, Data, table_power
from lagsim.tolerances import TERM_ROUNDOFF

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable, Mapping

    from lagsim.language.arrays import Flags, Floats
    from lagsim.language.functions import Function
    from lagsim.language.graph import Graph


TINY = math.ulp(0.0)
LARGEST = np.finfo(np.float64).max


class Interval(NamedTuple):
    """Enclosures, as arrays of shape (k,); truth values are 0 and 1.

    Attributes
    ----------
    lo, hi : array
        The bounds; nan where the expression is nan throughout.
    partial : array of bool
        Whether the expression may be nan somewhere in the interval.
    jumps : array of bool
        Whether the expression may be discontinuous or unbounded in the interval.
    """

    lo: Floats
    hi: Floats
    partial: Flags
    jumps: Flags

    @property
    def undefined(self) -> Flags:
        """Whether the expression is nan throughout."""
        return np.asarray(np.isnan(self.lo))

    @property
    def is_constant(self) -> Flags:
        """Whether the expression is constant (nan counts as a value)."""
        return np.asarray(self.undefined | ((self.lo == self.hi) & ~self.partial))

    @property
    def width(self) -> Floats:
        """Difference of the bounds."""
        return np.asarray(self.hi - self.lo)

    @property
    def has_zero(self) -> Flags:
        """Whether zero is within the bounds."""
        return np.asarray((self.lo <= 0.0) & (self.hi >= 0.0))

    @property
    def unbounded(self) -> Flags:
        """Whether a bound is infinite."""
        return np.isinf(self.lo) | np.isinf(self.hi)

    def part(self, where: slice) -> Interval:
        """Return the enclosures of the elements selected by the slice `where`."""
        return Interval._make(x[where] for x in self)


def interval(lo: Any, hi: Any, partial: Any = False, jumps: Any = False) -> Interval:
    """Return enclosures with the bounds lo and hi, and the flags `partial` and `jumps`.

    All have equal shapes after broadcasting.
    """
    lo = np.atleast_1d(np.asarray(lo, np.float64))
    return Interval._make(np.broadcast_arrays(lo, hi, partial, jumps))


_ANY = interval(-np.inf, np.inf, partial=True, jumps=True)


def point(x: float) -> Interval:
    """Return the enclosure of the single value `x`."""
    return interval(x, x)


def select(which: Flags, x: Interval, y: Interval) -> Interval:
    """Return x where the flags `which` are True, else y."""
    return Interval._make(np.where(which, a, b) for a, b in zip(x, y, strict=True))


def outward(lo: Floats, hi: Floats, *, zeros: bool = False) -> tuple[Floats, Floats]:
    """Return bounds widened by the error of libraries, except for exact `zeros`.

    An infinite bound due to overflow is replaced by the largest number.
    """
    low = np.minimum(lo, LARGEST)
    high = np.maximum(hi, -LARGEST)
    below, above = (np.abs(x) * TERM_ROUNDOFF + TINY for x in (low, high))
    if zeros:
        below, above = np.where(lo == 0.0, 0.0, below), np.where(hi == 0.0, 0.0, above)
    return low - below, high + above


def _but(
    where: Flags, size: Floats | float, lo: Floats, hi: Floats
) -> tuple[Floats, Floats]:
    """Return bounds (lo, hi), replaced by (-size, size) where `where` holds."""
    return np.where(where, -size, lo), np.where(where, size, hi)


def exact_or_next(bound: Floats, exact: Flags, toward: float) -> Floats:
    """Return bounds, each moved to the next double where the bound is not exact.

    exact : flags.
    toward : -inf or inf, the direction of the move.
    """
    return np.where(exact, bound, np.nextafter(bound, toward))


# ------------------------------------------------------------------- operators


def _error_of_sum(a: Floats, b: Floats, total: Floats) -> Floats:
    """Return the rounding error of total = a + b exactly (Knuth's TwoSum)."""
    part = total - a
    return np.asarray((a - (total - part)) + (b - part))


def add(x: Interval, y: Interval) -> Interval:
    """Enclose x + y."""
    lo, hi = x.lo + y.lo, x.hi + y.hi
    clash = (x.hi == math.inf) & (y.lo == -math.inf)
    clash |= (x.lo == -math.inf) & (y.hi == math.inf)
    lo = exact_or_next(lo, _error_of_sum(x.lo, y.lo, lo) == 0.0, -math.inf)
    hi = exact_or_next(hi, _error_of_sum(x.hi, y.hi, hi) == 0.0, math.inf)
    lo, hi = np.where(np.isnan(lo), -math.inf, lo), np.where(np.isnan(hi), math.inf, hi)
    return interval(lo, hi, clash)


def neg(x: Interval) -> Interval:
    """Enclose -x."""
    return interval(-x.hi, -x.lo)


def sub(x: Interval, y: Interval) -> Interval:
    """Enclose x - y."""
    return add(x, neg(y))


def _corners(
    f: Callable[[Floats, Floats], Floats], x: Interval, y: Interval
) -> tuple[Floats, Floats]:
    values = np.stack(
        np.broadcast_arrays(f(x.lo, y.lo), f(x.lo, y.hi), f(x.hi, y.lo), f(x.hi, y.hi))
    )
    # 0 * inf: the bound is not attained
    values = np.where(np.isnan(values), 0.0, values)
    return values.min(0), values.max(0)


def _whole(x: Interval) -> Flags:
    """Whether both bounds are whole numbers, small enough for exact products."""
    whole = (np.floor(x.lo) == x.lo) & (np.floor(x.hi) == x.hi)
    return np.asarray(whole & (np.maximum(np.abs(x.lo), np.abs(x.hi)) < 2.0**26))


def _one_sided(
    lo: Floats, hi: Floats, x: Interval, y: Interval
) -> tuple[Floats, Floats]:
    """Return bounds of a product or quotient of x and y, widened by its rounding.

    A bound of 0 is not widened past 0 where the signs of x and y determine the sign of
    the result.

    lo, hi : the bounds as computed in doubles.
    """
    one_sign = (x.lo >= 0.0) & (y.lo >= 0.0) | (x.hi <= 0.0) & (y.hi <= 0.0)
    opposite = (x.lo >= 0.0) & (y.hi <= 0.0) | (x.hi <= 0.0) & (y.lo >= 0.0)
    nothing = (x.lo == 0.0) & (x.hi == 0.0) | (y.lo == 0.0) & (y.hi == 0.0)
    return (
        exact_or_next(lo, nothing | (lo == 0.0) & one_sign, -math.inf),
        exact_or_next(hi, nothing | (hi == 0.0) & opposite, math.inf),
    )


def mul(x: Interval, y: Interval) -> Interval:
    """Enclose x*y."""
    lo, hi = _corners(np.multiply, x, y)
    whole = _whole(x) & _whole(y)
    low, high = _one_sided(lo, hi, x, y)
    lo, hi = np.where(whole, lo, low), np.where(whole, hi, high)
    return interval(lo, hi, (x.unbounded & y.has_zero) | (y.unbounded & x.has_zero))


def _square(x: Interval) -> Interval:
    size = magnitude(x)
    return _strict(mul)(size, size)


def div(x: Interval, y: Interval) -> Interval:
    """Enclose x/y."""
    pole = y.has_zero  # also at an end: x / 0 is infinite with either sign
    bounds = _one_sided(*_corners(np.divide, x, y), x, y)
    partial = pole & x.has_zero | x.unbounded & y.unbounded
    return interval(*_but(pole, math.inf, *bounds), partial, pole)


def over_argument(rule: Callable[[Interval], Interval]) -> Callable[..., Interval]:
    """Return the rule that encloses f(x)/x.

    rule : the rule that encloses f(x).
    """
    return lambda x: div(rule(x), x)


def power(x: Interval, y: Interval) -> Interval:
    """Enclose x^y."""
    whole = (y.lo == y.hi) & (np.floor(y.lo) == y.lo) & np.isfinite(y.lo)
    by_whole, by_real = _whole_power(x, y.lo), _real_power(x, y)
    return select(whole, by_whole, by_real)


def _whole_power(x: Interval, n: Floats) -> Interval:
    a, b = np.power(x.lo, n), np.power(x.hi, n)
    even = np.mod(n, 2.0) == 0.0
    inside = x.has_zero
    pole = inside & (n < 0.0)
    lo = np.where(even & inside & (n > 0.0), 0.0, np.minimum(a, b))
    lo = np.where(pole & ~even, -math.inf, lo)
    hi = np.where(pole, math.inf, np.maximum(a, b))
    low, high = outward(lo, hi)
    ones = n == 0.0
    low = np.where(even & (n > 0.0), np.maximum(low, 0.0), low)
    return interval(np.where(ones, 1.0, low), np.where(ones, 1.0, high), False, pole)


def _real_power(x: Interval, y: Interval) -> Interval:
    """Enclose x^y, which is real for x >= 0 only, or where y is a whole number."""
    base = interval(np.maximum(x.lo, 0.0), np.maximum(x.hi, 0.0))
    lo, hi = outward(*_corners(np.power, base, y))
    lo = np.maximum(lo, 0.0)
    negative = x.lo < 0.0
    pole = (x.lo <= 0.0) & (y.lo <= 0.0)
    moving = y.lo < y.hi
    # A negative base with a varying exponent: any whole exponent of the interval is
    # possible.
    size = interval(np.zeros_like(x.lo), np.maximum(np.abs(x.lo), np.abs(x.hi)))
    _, largest = outward(*_corners(np.power, size, y))
    undefined = negative & moving
    nowhere = (x.hi < 0.0) & ~moving
    bounds = _but(nowhere, math.nan, *_but(undefined, largest, lo, hi))
    return interval(*bounds, negative, pole | undefined)


# ------------------------------------------------------------------ conditions


def _comparison(
    surely: Callable[[Interval, Interval], Flags],
    never: Callable[[Interval, Interval], Flags],
) -> Callable[[Interval, Interval], Interval]:
    """Return the rule of a comparison; a comparison with nan is false.

    surely : (x, y) -> whether it is true throughout.
    never : whether it is false throughout.
    """

    def rule(x: Interval, y: Interval) -> Interval:
        true = surely(x, y) & ~(x.partial | y.partial)
        false = never(x, y) | x.undefined | y.undefined
        return interval(true.astype(np.float64), (~false).astype(np.float64))

    return rule


def _less(x: Interval, y: Interval) -> Flags:
    return np.asarray(x.hi < y.lo)


def _not_less(x: Interval, y: Interval) -> Flags:
    return np.asarray(x.lo >= y.hi)


lt, ge = _comparison(_less, _not_less), _comparison(_not_less, _less)


def gt(x: Interval, y: Interval) -> Interval:
    """Enclose x > y."""
    return lt(y, x)


def le(x: Interval, y: Interval) -> Interval:
    """Enclose x <= y."""
    return ge(y, x)


def ends(f: Any) -> Callable[..., Interval]:
    """Return the rule of a function f that increases in each argument.

    The bounds are the values of f at the lower and at the upper bounds of the
    arguments. The values are exact.
    """
    return lambda *x: interval(f(*(y.lo for y in x)), f(*(y.hi for y in x)))


def logical_not(x: Interval) -> Interval:
    """Enclose `not x`."""
    return interval(1.0 - x.hi, 1.0 - x.lo)


def choice(c: Interval, x: Interval, y: Interval) -> Interval:
    """Enclose if(c, x, y)."""
    hull = interval(
        np.fmin(x.lo, y.lo),
        np.fmax(x.hi, y.hi),
        x.partial | y.partial | (x.undefined ^ y.undefined),
        jumps=True,
    )
    return select(c.lo == 1.0, x, select(c.hi == 0.0, y, hull))


def smooth_choice(c: Interval, x: Interval, y: Interval) -> Interval:
    """Enclose a smooth selection, which has a value and no jump where c changes."""
    found = choice(c, x, y)
    decided = (c.lo == 1.0) | (c.hi == 0.0)
    return found._replace(partial=found.partial & decided, jumps=found.jumps & decided)


# ------------------------------------------------------------------- functions


def on(
    f: Any, least: float = -math.inf, most: float = math.inf, *, open_end: bool = False
) -> Callable[[Interval], Interval]:
    """Return the rule of a monotone function f on the interval [`least`, `most`].

    A value 0 of f counts as exact.

    f : the function on arrays.
    open_end : whether f is unbounded at the ends of the interval, which do not belong
        to the domain.
    """

    def rule(x: Interval) -> Interval:
        a, b = (f(np.clip(end, least, most)) for end in (x.lo, x.hi))
        nowhere = (x.hi < least) | (x.lo > most)
        partial = pole = (x.lo < least) | (x.hi > most)
        if open_end:
            pole = (x.lo <= least) | (x.hi >= most)
            partial = pole if most < math.inf else partial
        bounds = _but(
            nowhere, math.nan, *outward(np.fmin(a, b), np.fmax(a, b), zeros=True)
        )
        return interval(*bounds, partial, pole)

    return rule


def exp(x: Interval) -> Interval:
    """Enclose exp(x)."""
    lo, hi = outward(np.exp(x.lo), np.exp(x.hi))
    return interval(np.maximum(lo, 0.0), hi)


def _meets(x: Interval, first: float, period: float) -> Flags:
    """Whether x may contain a point of first + k * period."""
    a, b = x.lo / period - first / period, x.hi / period - first / period
    slack = 8.0 * np.finfo(np.float64).eps
    a, b = a - slack * (np.abs(a) + 1.0), b + slack * (np.abs(b) + 1.0)
    return np.asarray(~(np.ceil(a) > np.floor(b)))


def periodic_rule(
    f: Any, crest: float, trough: float
) -> Callable[[Interval], Interval]:
    """Return the rule of a function f of period 2 pi with values in [-1, 1].

    crest, trough : an argument at which f is 1, and one at which f is -1.
    """

    def rule(x: Interval) -> Interval:
        a, b = f(x.lo), f(x.hi)
        lo, hi = outward(np.fmin(a, b), np.fmax(a, b), zeros=True)
        return interval(
            np.where(_meets(x, trough, math.tau), -1.0, np.maximum(lo, -1.0)),
            np.where(_meets(x, crest, math.tau), 1.0, np.minimum(hi, 1.0)),
            x.unbounded,
        )

    return rule


def tan(x: Interval) -> Interval:
    """Enclose tan(x)."""
    pole = _meets(x, math.pi / 2, math.pi)
    bounds = outward(np.tan(x.lo), np.tan(x.hi), zeros=True)
    return interval(*_but(pole, math.inf, *bounds), x.unbounded, pole)


def magnitude(x: Interval) -> Interval:
    """Enclose |x|."""
    least = np.where(x.has_zero, 0.0, np.minimum(np.abs(x.lo), np.abs(x.hi)))
    return interval(least, np.maximum(np.abs(x.lo), np.abs(x.hi)))


def cosh(x: Interval) -> Interval:
    """Enclose cosh(x)."""
    size = magnitude(x)
    lo, hi = outward(np.cosh(size.lo), np.cosh(size.hi))
    return interval(np.maximum(lo, 1.0), hi)


def hypot(x: Interval, y: Interval) -> Interval:
    """Enclose hypot(x, y)."""
    a, b = magnitude(x), magnitude(y)
    ends = np.hypot(a.lo, b.lo), np.hypot(a.hi, b.hi)
    return interval(*outward(*ends, zeros=True))


def atan2(y: Interval, x: Interval) -> Interval:
    """Enclose atan2(y, x)."""
    origin = y.has_zero & x.has_zero
    cut = (y.lo < 0.0) & (y.hi >= 0.0) & (x.lo <= 0.0) | origin
    lo, hi = outward(*_corners(np.arctan2, y, x))
    lo, hi = np.maximum(lo, -math.pi), np.minimum(hi, math.pi)
    return interval(*_but(cut, math.pi, lo, hi), False, cut)


def step(f: Any) -> Callable[[Interval], Interval]:
    """Return the rule that encloses an increasing step function f."""

    def rule(x: Interval) -> Interval:
        lo, hi = f(x.lo), f(x.hi)
        return interval(lo, hi, False, lo != hi)

    return rule


def extreme(choose: Any) -> Callable[[Interval, Interval], Interval]:
    """Return the rule of min or max, which have no value where an argument has none.

    choose : np.minimum or np.maximum.
    """

    def rule(x: Interval, y: Interval) -> Interval:
        lo, hi = choose(x.lo, y.lo), choose(x.hi, y.hi)
        return interval(lo, hi, x.partial | y.partial, x.jumps | y.jumps)

    return rule


# ---------------------------------------------------------------------- tables


def table_knot(axis: Data, x: Interval) -> Interval:
    """Enclose the knot number of a table, an increasing function."""
    return _strict(lambda x: interval(*_each("table.knot", axis, x)))(x)


def table_rate(axis: Data, x: Interval) -> Interval:
    """Enclose the slope of `table_knot` over the cells that x meets."""
    (first, last) = _cells(_each("table.knot", axis, x))
    own = _each("table.rate", axis, x)
    far = last - first > 1.0
    lo, hi = outward(
        np.where(far, 0.0, own.min(0)), np.where(far, math.inf, own.max(0))
    )
    return _strict(lambda _: interval(np.maximum(lo, 0.0), hi, False, last > first))(x)


def _each(op: str, axis: Data, x: Interval) -> Floats:
    """Return the values (2, k) of a table's function `op` at the bounds of x.

    Row 0 is for the lower bounds.

    op : `table.knot` or `table.rate`.
    axis : data of the table.
    """
    ends = np.concatenate([x.lo, x.hi]).tolist()
    return np.array([OPERATIONS[op](axis, e) for e in ends]).reshape(2, -1)


def _cells(numbers: Floats | list[Floats]) -> Floats:
    """Return the numbers (2, k) of the cells in which two knot numbers lie.

    numbers : (2, k), the knot numbers of both ends of each interval.
    """
    return np.asarray(np.floor(np.nan_to_num(numbers)))


def table_piece(*args: Any) -> Interval:
    """Enclose a piece of a table, from axes, pieces, orders, arguments and numbers.

    The enclosure is the hull of the polynomials of up to two cells of each argument,
    and of all cells where an argument runs through more.
    """
    *axes, pieces = (x for x in args if isinstance(x, Data))
    numbers = args[len(axes) + 1 :]
    n, p = len(axes), int(pieces.numbers[0])
    orders = [int(order.lo[0]) for order in numbers[:n]]
    c = pieces.numbers[1:].reshape(*(int(a.numbers[0]) + 2 for a in axes), *[p] * n)

    def rule(*numbers: Interval) -> Interval:
        x, chosen = numbers[:n], numbers[n:]
        spans = [_cells([piece.lo, piece.hi]) for piece in chosen]
        far = np.any([last - first > 1.0 for first, last in spans], axis=0)
        found = []
        for ends in product((0, 1), repeat=n):
            parts = zip(axes, x, spans, ends, strict=True)
            rows, distances = zip(*(_part(*each) for each in parts), strict=True)
            found.append(_horner(c[rows], orders, distances))
        lo = np.fmin.reduce([value.lo for value in found])
        hi = np.fmax.reduce([value.hi for value in found])
        doubt = far | np.any([np.isnan(value.lo) for value in found], axis=0)
        several = np.any([last > first for first, last in spans], axis=0)
        return interval(*_but(far, math.inf, lo, hi), doubt, several)

    return _strict(rule)(*numbers[n:])


table_piece2 = table_piece


def _part(axis: Data, x: Interval, cells: Floats, end: int) -> tuple[Any, Interval]:
    """Return the cells at one end of intervals of x, and the distance from their knots.

    The first result is (k,), the row of each cell's coefficients; the second encloses x
    less the lower knot of the cell.

    axis : data of the table.
    cells : numbers (2, k) of the first and last cells that x meets.
    end : 0 for the first cells, 1 for the last.
    """
    m, period, knots = int(axis.numbers[0]), axis.numbers[2], axis.numbers[FIRST:]
    cell = cells[end]
    turns = np.floor(cell / m) if period else np.zeros_like(cell)
    at = np.clip(cell - turns * m, -1, m).astype(int)
    low, high = (knots[np.clip(k, 0, m)] + turns * period for k in (at, at + 1))
    single = cells[0] == cells[1]
    lo = np.where(single | (end == 0), x.lo, low)
    hi = np.where(single | (end == 1), x.hi, high)
    return at + 1, interval(*outward(lo - low, hi - low))


def _horner(c: Floats, orders: list[int], distances: Any) -> Interval:
    """Enclose derivatives of polynomials c (k, p) or (k, p, p), lowest power first.

    orders : the order of the derivative in each argument.
    distances : enclosures of the arguments.
    """
    found = interval(np.zeros(len(c)), 0.0)
    for j in reversed(range(orders[0], c.shape[1])):
        term = interval(c[:, j], c[:, j]) if c.ndim == 2 else point(0.0)
        if orders[1:]:
            term = _horner(c[:, j], orders[1:], distances[1:])
        term = _strict(mul)(term, point(table_power(j, orders[0])))
        found = _strict(add)(_strict(mul)(found, distances[0]), term)
    return found


def _strict(rule: Callable[..., Interval]) -> Callable[..., Interval]:
    """Return a rule that is nan, partial or jumping wherever an argument is.

    See `Interval` for the flags `partial` and `jumps`.

    rule : the rule for arguments that are always defined and continuous.
    """

    def whole(*args: Interval) -> Interval:
        lo, hi, partial, jumps = rule(*args)
        for a in args:
            lo, hi = _but(a.undefined, math.nan, lo, hi)
            partial, jumps = partial | a.partial, jumps | a.jumps
        return interval(lo, hi, partial, jumps)

    return whole


def _rule(row: Function) -> Callable[..., Interval]:
    module, name = sys.modules[__name__], row.name.replace(".", "_")
    rule: Callable[..., Interval]
    rule = row.interval(module) if row.interval else getattr(module, name)
    return rule if row.condition or row.branches or row.data else _strict(rule)


RULES = {name: _rule(row) for name, row in OPERATIONS.items() if row.native}
# Sums over tables have no enclosure: any value is possible.
RULES |= {ELEMENTS: lambda *_: _ANY, PART: lambda *_: _ANY}
SQUARE = _strict(_square)


def _of_steps(op: str) -> Callable[..., Interval]:
    """Return the rule of a function whose arguments depend on t through steps only.

    Where each argument has one value throughout the interval, the function has one
    value in double precision. It is computed directly: in an enclosure of its rounding
    error, `mod(floor(t), 1.5)` would seem to jump wherever it is 0.
    """
    rule, value = RULES[op], OPERATIONS[op]

    def whole(*args: Any) -> Interval:
        found = rule(*args)
        numbers = [x for x in args if not isinstance(x, Data)]
        single = np.zeros(found.lo.shape, bool)
        single[:] = math.prod((x.lo == x.hi) & ~x.partial & ~x.jumps for x in numbers)
        if not single.any():
            return found
        table = np.stack([np.broadcast_to(x.lo, single.shape) for x in numbers], 1)
        each, which = np.unique(table[single], axis=0, return_inverse=True)
        values = np.empty(len(each))
        for k, row in enumerate(each.tolist()):
            given = iter(row)
            values[k] = value(
                *(x if isinstance(x, Data) else next(given) for x in args)
            )
        lo, hi = found.lo.copy(), found.hi.copy()
        partial, jumps = found.partial.copy(), found.jumps.copy()
        lo[single] = hi[single] = values[which.ravel()]
        partial[single] = jumps[single] = False
        return Interval(lo, hi, partial, jumps)

    return whole


class Enclosures:
    """Enclosures of nodes over intervals of one variable, with the others fixed.

    The variables in `names`, by default t, run through one common interval,
    independently. A node that does not depend on these variables has the single value
    of `evaluate`.

    Parameters
    ----------
    g, nodes
        The graph, and the nodes to enclose.
    values
        Values of the other variables by name.
    names
        The variables that run through the interval.
    """

    def __init__(
        self,
        g: Graph,
        nodes: Iterable[int],
        values: Mapping[str, float],
        names: Collection[str] = ("t",),
    ) -> None:
        self.nodes = list(nodes)
        self.running = [g.variable(name) for name in names]
        moving = g.dependent(self.nodes, names)
        cone = g.cone(self.nodes)
        fixed = [n for n in cone if n not in moving]
        self.fixed: dict[int, Any] = {
            n: x if isinstance(x, Data | np.ndarray | Elements) else point(float(x))
            for n, x in zip(fixed, evaluate(g, fixed, values), strict=True)
        }
        self.program: list[tuple[int, Callable[..., Interval], tuple[int, ...]]] = []
        stepped = set(fixed)
        for n in sorted(moving.difference(self.running)):
            op, args = g.ops[n], g.args[n]
            if op not in (ELEMENTS, PART) and stepped.issuperset(args):
                stepped.add(n)
                self.program.append((n, _of_steps(op), args))
            elif op == "mul" and args[0] == args[1]:  # x*x is never negative
                self.program.append((n, SQUARE, args[:1]))
            else:
                self.program.append((n, RULES[op], args))
            if op in STEPS or OPERATIONS[op].condition:
                stepped.add(n)

    def __call__(self, lo: Floats, hi: Floats) -> list[Interval]:
        """Return the enclosure of each node over the intervals from `lo` to `hi`.

        Parameters
        ----------
        lo, hi : ndarray, shape (k,)
            Bounds of the intervals.

        Returns
        -------
        list of Interval
            One for each node, with arrays of shape (k,).
        """
        found = dict(self.fixed)
        found |= dict.fromkeys(self.running, interval(lo, hi))
        with np.errstate(all="ignore"):
            for n, rule, args in self.program:
                found[n] = rule(*(found[a] for a in args))
        everywhere = np.zeros(lo.shape)
        return [
            interval(x.lo + everywhere, x.hi, x.partial, x.jumps)
            for x in (found[n] for n in self.nodes)
        ]
