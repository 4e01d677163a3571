"""Taylor series on the graph: the coefficients of a motion, as nodes.

For y' = f(t, y) the k-th normalised coefficient y_k = y^(k)(t)/k! follows from the
earlier ones, operation by operation. Sums, products, quotients, powers and roots have
recurrences of their own; of anything else the chain rule f' = slope x' gives one, with
the slope's series made the same way, so that a new function of the language needs
nothing here. Functions that select or step keep the branch that they are on at t.

Sources: R. E. Moore, Interval Analysis (1966); A. Griewank and A. Walther, Evaluating
Derivatives, 2nd ed. (2008), chapter 13; A. Jorba and M. Zou, Experimental Mathematics
14 (2005), proposition 2.1.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from lagsim.language.functions import OPERATIONS
from lagsim.language.graph import CONSTANT, TRUTH, VARIABLE

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence

    from lagsim.language.graph import Graph

# Powers up to this are written as products and a root: cheaper than the recurrence,
# which divides by the base and so fails where that passes zero.
LARGEST_PRODUCT = 64


class Series:
    """Coefficients along a motion, made as they are asked for.

    Parameters
    ----------
    g : Graph
    rates : mapping of node to node
        The rate of each variable that moves.
    """

    def __init__(self, g: Graph, rates: Mapping[int, int]) -> None:
        self.g = g
        self.rates = rates
        self._known: dict[int, list[int]] = {}
        self._moves: dict[int, bool] = {}
        self._twins: dict[int, int | None] = {}
        self._slopes: dict[int, tuple[int, ...]] = {}

    def __call__(self, n: int, k: int) -> int:
        """Give the coefficient of order `k` of node `n`."""
        if not self.moves(n):
            return n if k == 0 else self.g.zero
        known = self._known.setdefault(n, [n])
        while len(known) <= k:
            known.append(self._coefficient(n, len(known)))
        return known[k]

    def extend(self, nodes: Iterable[int], order: int) -> None:
        """Make all coefficients of `nodes` up to `order`, from the leaves upwards."""
        g = self.g
        cone = [n for n in g.cone(nodes) if self.moves(n)]
        for k in range(order + 1):
            for n in cone:
                row = OPERATIONS.get(g.ops[n])
                if row is None or not row.condition:
                    self(n, k)

    def moves(self, n: int) -> bool:
        """Tell whether `n` changes along the motion."""
        found = self._moves.get(n)
        if found is None:
            for below in self.g.cone([n]):
                if below not in self._moves:
                    args = self.g.args[below]
                    moved = any(self._moves[a] for a in args)
                    self._moves[below] = moved or below in self.rates
            found = self._moves[n]
        return found

    def _coefficient(self, n: int, k: int) -> int:
        g = self.g
        if n in self.rates:
            return self.scaled(1.0 / k, self(self.rates[n], k - 1))
        op, args = g.ops[n], g.args[n]
        branches = OPERATIONS[op].branches
        if branches is not None:
            first, second = (self(a, k) for a in args[-2:])
            return g.call("if", branches(g, args), first, second)
        rule = RECURRENCES.get(op)
        return rule(self, n, k) if rule is not None else self.chain(n, k)

    def scaled(self, factor: float, node: int) -> int:
        """Give factor * node."""
        return self.g.call("mul", self.g.constant(factor), node)

    def convolution(self, a: int, b: int, k: int, js: Iterable[int]) -> int:
        """Give the sum of a_j b_(k-j).

        The newest coefficients, those of the highest order, are added last: whatever
        does not wait for them is ready by then.
        """
        js = sorted(js, key=lambda j: (-min(j, k - j), j))
        return self.g.product_sum((self(a, j), self(b, k - j)) for j in js)

    def square(self, a: int, k: int, least: int = 0) -> int:
        """Give the sum of a_j a_(k-j), j from `least` to k - `least`, by halves."""
        g = self.g
        total = self.convolution(a, a, k, range(least, (k + 1) // 2))
        total = self.scaled(2.0, total)
        if k % 2 == 0 and 2 * least <= k:
            middle = self(a, k // 2)
            total = g.call("add", total, g.call("mul", middle, middle))
        return total

    def chain(self, n: int, k: int) -> int:
        """Give the coefficient from f' = sum of slope * argument'.

        k f_k = sum of j x_j s_(k-j), j from 1 to k, for each argument x with slope s.
        """
        g, args = self.g, self.g.args[n]
        if n not in self._slopes:
            partials = OPERATIONS[g.ops[n]].partials
            assert partials is not None
            self._slopes[n] = partials(g, args, n)
        earlier, newest = g.zero, g.zero
        for x, slope in zip(args, self._slopes[n], strict=True):
            newest = g.call("add", newest, g.call("mul", self(slope, 0), self(x, k)))
            terms = (
                (self.scaled(j, self(x, j)), self(slope, k - j)) for j in range(1, k)
            )
            earlier = g.call("add", earlier, g.product_sum(terms))
        return g.call("add", self.scaled(1.0 / k, earlier), newest)

    def twin(self, n: int, made: Callable[[], int | None]) -> int | None:
        """Give an expression with the series of `n`, made once; None if it has none."""
        if n not in self._twins:
            self._twins[n] = made()
        return self._twins[n]


def _add(s: Series, n: int, k: int) -> int:
    x, y = s.g.args[n]
    return s.g.call("add", s(x, k), s(y, k))


def _sub(s: Series, n: int, k: int) -> int:
    x, y = s.g.args[n]
    return s.g.call("sub", s(x, k), s(y, k))


def _neg(s: Series, n: int, k: int) -> int:
    return s.g.call("neg", s(s.g.args[n][0], k))


def _mul(s: Series, n: int, k: int) -> int:
    x, y = s.g.args[n]
    return s.square(x, k) if x == y else s.convolution(x, y, k, range(k + 1))


def _div(s: Series, n: int, k: int) -> int:
    """F y = x: y_0 f_k = x_k - sum of y_j f_(k-j), j from 1 to k."""
    g = s.g
    x, y = g.args[n]
    earlier = s.convolution(y, n, k, range(1, k + 1)) if s.moves(y) else g.zero
    return g.call("mul", g.call("sub", s(x, k), earlier), g.call("div", g.one, y))


def _sqrt(s: Series, n: int, k: int) -> int:
    """F f = x: 2 f_0 f_k = x_k - sum of f_j f_(k-j), j from 1 to k - 1."""
    g = s.g
    rest = g.call("sub", s(g.args[n][0], k), s.square(n, k, 1))
    return g.call("mul", rest, g.call("div", g.constant(0.5), n))


def _hypot(s: Series, n: int, k: int) -> int:
    g = s.g

    def root() -> int:
        x, y = (g.call("mul", a, a) for a in g.args[n])
        return g.call("sqrt", g.call("add", x, y))

    twin = s.twin(n, root)
    assert twin is not None
    return s(twin, k)


def _pow(s: Series, n: int, k: int) -> int:
    """X f' = p x' f: x_0 f_k = sum of ((p + 1) j/k - 1) x_j f_(k-j), j from 1 to k."""
    g = s.g
    twin = s.twin(n, lambda: _power(s, n))
    if twin is not None:
        return s(twin, k)
    x, p = g.args[n]
    pairs = [(s(x, j), s(n, k - j)) for j in range(1, k + 1)]
    rates = ((s.scaled(j, a), b) for j, (a, b) in enumerate(pairs, 1))
    more = g.call("add", p, g.one)
    rising = g.call("mul", more, s.scaled(1.0 / k, g.product_sum(rates)))
    falling = g.product_sum(pairs)
    return g.call("mul", g.call("sub", rising, falling), g.call("div", g.one, x))


def _power(s: Series, n: int) -> int | None:
    """Give x^p as products and a root, or as an exponential; None: the recurrence."""
    g = s.g
    x, p = g.args[n]
    if s.moves(p):
        return g.call("exp", g.call("mul", p, g.call("log", x)))
    value = g.value(p)
    if value is None or 2.0 * value % 1.0 or abs(value) > LARGEST_PRODUCT:
        return None
    whole = int(abs(value))
    result = g.one if whole == abs(value) else g.call("sqrt", x)
    while whole:
        if whole % 2:
            result = g.call("mul", result, x)
        whole //= 2
        x = g.call("mul", x, x)
    return g.call("div", g.one, result) if value < 0.0 else result


RECURRENCES: dict[str, Callable[[Series, int, int], int]] = {
    "add": _add,
    "sub": _sub,
    "neg": _neg,
    "mul": _mul,
    "div": _div,
    "sqrt": _sqrt,
    "hypot": _hypot,
    "pow": _pow,
}


def taylor_series(
    g: Graph, state: Sequence[int], rates: Sequence[int], order: int
) -> list[list[int]]:
    """Give the coefficients y_0 ... y_order of the motion y' = rates.

    Parameters
    ----------
    state, rates : sequence of node, shape (size,)
        The variables of y, and y'. Time, if it is there, is the variable `t`.
    order : int

    Returns
    -------
    list, shape (order + 1, size)
    """
    moving = dict(zip(state, rates, strict=True)) | {g.variable("t"): g.one}
    series = Series(g, moving)
    series.extend(rates, order - 1)
    return [[series(v, k) for v in state] for k in range(order + 1)]


# Convolutions that an operation takes where it moves; others take none.
_CONVOLUTIONS = {"mul": 1.0, "div": 1.0, "sqrt": 0.5, "hypot": 1.5, "pow": 2.0}
_CHAIN = 2.0  # the slope's and the function's own


def series_operations(
    g: Graph, state: Sequence[int], rates: Sequence[int], order: int
) -> int:
    """Estimate how many operations `taylor_series` takes, without making it."""
    names = [str(g.payload(v)) for v in state]
    moving = g.dependent(rates, (*names, "t"))
    total = 0.0
    for n in moving:
        op, args = g.ops[n], g.args[n]
        if op in (CONSTANT, TRUTH, VARIABLE) or OPERATIONS[op].condition:
            continue
        weight = _CONVOLUTIONS.get(op, _CHAIN)
        linear = op in ("add", "sub", "neg") or OPERATIONS[op].branches
        fixed_factor = op == "mul" and not all(a in moving for a in args)
        fixed_divisor = op == "div" and args[1] not in moving
        if linear or fixed_factor or fixed_divisor:
            total += order
        elif op == "mul" and args[0] == args[1]:
            total += 0.5 * order * order
        else:
            total += weight * order * order  # half as many terms, of two operations
    return int(total)
