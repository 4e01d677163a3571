"""Taylor series on the graph: the coefficients of a motion, as nodes.

For y' = f(t, y) the k-th normalised coefficient y_k = y^(k)(t)/k! follows from the
earlier ones, operation by operation. Sums, products, quotients, powers and roots have
recurrences of their own; other functions have that of the chain rule f' = slope x',
with the slope's series computed alike, so that a new function of the language needs no
code here. Functions that select or step keep their branch at t.

`recurrence` returns the nodes of one order, to be evaluated in a loop over the orders;
`taylor_series` returns the nodes of all coefficients, whose number grows with the
square of the order. A function such as `_mul(s, n)` returns the node of the coefficient
of order k of the operation n, from the coefficients `s` of its arguments.

Sources: R. E. Moore, Interval Analysis (1966); A. Griewank and A. Walther, Evaluating
Derivatives, 2nd ed. (2008), chapter 13; A. Jorba and M. Zou, Experimental Mathematics
14 (2005), proposition 2.1.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from lagsim.language.derivatives import local_slopes, log_slopes
from lagsim.language.functions import OPERATIONS
from lagsim.language.simpler import UNDONE, hyperbolic_square

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from lagsim.language.graph import Graph

# The variables of a loop over the order: k, 1/k, 1/(k+1), the coefficient of t, which
# is 1 and then 0; and how the names of others begin.
K, OVER_K, OVER_NEXT, TIME = ORDERS = tuple(
    f"series.{name}" for name in ("k", "1/k", "1/(k+1)", "t")
)
SUM, CARRIED = "series.sum.", "series.y."


# Powers up to this are written as products and a root: cheaper than the recurrence,
# which divides by the base and so fails where that passes zero.
LARGEST_PRODUCT = 64


class Recurrence(NamedTuple):
    """Order k of the series of y' = f(t, y), from the inner sums of its products.

    Attributes
    ----------
    state, rates : tuple of node
        Nodes of y and y'.
    carried, following : tuple of node
        The variables of y_k, and the nodes of y_(k+1).
    sums : tuple of node
        The variables of the sums of a_j b_(k-j), j from 1 to k - 1.
    factors : tuple of pair of node
        a_k and b_k of each sum.
    """

    state: tuple[int, ...]
    rates: tuple[int, ...]
    carried: tuple[int, ...]
    following: tuple[int, ...]
    sums: tuple[int, ...]
    factors: tuple[tuple[int, int], ...]

    @property
    def computed(self) -> list[int]:
        """Nodes computed in each order."""
        return [*self.following, *(n for pair in self.factors for n in pair)]

    @property
    def variables(self) -> list[int]:
        """Variables of the recurrence, besides the variables of ORDERS."""
        return [*self.carried, *self.sums]

    @property
    def nodes(self) -> tuple[list[int], list[int]]:
        """Nodes to evaluate once for order 0, and nodes for each higher order."""
        order = [*self.variables, *self.computed]
        return [*self.state, *self.rates], order


class Coefficients:
    """Taylor coefficients of order k along a motion, where k is a variable.

    The coefficients of order 0 are the nodes themselves.

    Parameters
    ----------
    g
        The graph.
    state
        The variables that change along the motion, besides t.
    """

    def __init__(self, g: Graph, state: Sequence[int]) -> None:
        self.g = g
        # Of a product: its factors, and whether the first is multiplied by j.
        self.sums: dict[int, tuple[int, int, bool]] = {}
        self._variables: dict[tuple[int, int, bool], int] = {}
        self._known = {v: g.variable(f"{CARRIED}{i}") for i, v in enumerate(state)}
        self._known[g.variable("t")] = g.variable(TIME)
        self._moves = dict.fromkeys(self._known, True)
        self._newest = frozenset(self._known.values())
        self._depths: dict[int, int] = {}
        self._twins: dict[int, int | None] = {}
        # nodes with coefficients, as have all nodes below
        self._extended: set[int] = set()

    def __call__(self, n: int) -> int:
        """Return the coefficient of order k of node `n`."""
        if not self.moves(n):
            return self.g.zero
        if n not in self._known:
            self._known[n] = self._coefficient(n)
        return self._known[n]

    def inner(self, a: int, b: int) -> int:
        """Return a variable for the sum of a_j b_(k-j) over j from 1 to k - 1.

        a, b : nodes, whose coefficients of order j are a_j and b_j.
        """
        return self._sum(min(a, b), max(a, b), rated=False)

    def inner_rate(self, a: int, b: int) -> int:
        """Return a variable for the sum of (j/k) a_j b_(k-j) over j from 1 to k - 1.

        a, b : see `inner`.
        """
        return self.g.call("mul", self.g.variable(OVER_K), self._sum(a, b, rated=True))

    def newest(self, known: int, *terms: tuple[int, int]) -> int:
        """Return `known` plus the sum of the products of `terms`.

        The product whose coefficient takes the most operations is added last, so that
        the sum of all other products can be computed before.

        terms : pairs of a factor of order 0 and a coefficient of order k.
        """
        total = known
        for factor, coefficient in sorted(terms, key=lambda term: self._depth(term[1])):
            total = self.g.call("add", total, self.g.call("mul", factor, coefficient))
        return total

    def _depth(self, n: int) -> int:
        """Return the number of operations in the longest path from the state to n.

        Paths begin at the coefficients of order k of the state. 0 if n does not depend
        on the state.
        """
        depths = self._depths
        for below in self.g.cone([n], depths):
            deepest = max([depths.get(a, 0) for a in self.g.args[below]] or [0])
            depths[below] = deepest + 1 if deepest or below in self._newest else 0
        return depths[n]

    def moves(self, n: int) -> bool:
        """Whether the value of node `n` changes along the motion."""
        if n not in self._moves:
            for below in self.g.cone([n], self._moves):
                if below not in self._moves:
                    args = self.g.args[below]
                    self._moves[below] = any(self._moves[a] for a in args)
        return self._moves[n]

    def twin(self, n: int, compute: Callable[[], int | None]) -> int | None:
        """Return a node of equal value whose series takes fewer operations, or None.

        n : the node, such as x^3.
        compute : function that computes the other node, such as x*x*x; called once for
            each n.
        """
        if n not in self._twins:
            self._twins[n] = compute()
        return self._twins[n]

    def extend(self, nodes: Iterable[int]) -> None:
        """Compute the coefficients of order k of `nodes` and of all nodes below."""
        cone = self.g.cone(nodes, self._extended)
        for n in cone:
            if self.g.ops[n] not in _CONDITIONS:
                self(n)
        self._extended.update(cone)

    def factors(self, variable: int) -> tuple[int, int]:
        """Return the nodes a_k and b_k of the sum that a variable represents.

        variable : a result of `inner`.
        """
        a, b, rated = self.sums[variable]
        self.extend((a, b))
        k = self.g.variable(K)
        return self.g.call("mul", k, self(a)) if rated else self(a), self(b)

    def _sum(self, a: int, b: int, *, rated: bool) -> int:
        if not (self.moves(a) and self.moves(b)):
            return self.g.zero
        key = (a, b, rated)
        if key not in self._variables:
            found = self.g.variable(f"{SUM}{len(self._variables)}")
            self._variables[key] = found
            self.sums[found] = key
        return self._variables[key]

    def _coefficient(self, n: int) -> int:
        """Return the coefficient of order k of operation n, as a node.

        It is computed from the coefficients of the arguments by the recurrence of the
        operation, or by the chain rule.
        """
        g = self.g
        op, args = g.ops[n], g.args[n]
        row = OPERATIONS[op]
        if op in ("add", "sub", "neg"):
            return g.call(op, *map(self, args))
        if row.branches is not None:
            first, second = (self(a) for a in args[-2:])
            return row.chosen(g, args, first, second)
        if op == "div":
            twin = self.twin(n, lambda: _hyperbolic_slope(g, n))
            if twin is not None:
                return self(twin)
        # A divisor that may overflow has a logarithm that does not.
        if op not in RECURRENCES or (op == "div" and log_slopes(g, args[1])):
            slopes = local_slopes(g, n)  # f' is the sum of slope times argument'
            return g.sum(
                _integral(self, x, slope) for x, slope in slopes if self.moves(x)
            )
        return RECURRENCES[op](self, n)


_CONDITIONS = frozenset(name for name, row in OPERATIONS.items() if row.condition)


# The recurrences of single operations


def _mul(s: Coefficients, n: int) -> int:
    """Return the node of order k of a product x y: the sum of x_j y_(k-j)."""
    g = s.g
    x, y = g.args[n]
    if x == y:
        newest = g.call("mul", g.call("mul", g.constant(2.0), x), s(x))
        return g.call("add", s.inner(x, x), newest)
    return s.newest(s.inner(x, y), (x, s(y)), (y, s(x)))


def _div(s: Coefficients, n: int) -> int:
    """Return f_k of f = x/y: y_0 f_k = x_k - sum of y_j f_(k-j), j from 1 to k."""
    g = s.g
    x, y = g.args[n]
    part = g.call("div", g.one, y)
    known = g.call("mul", g.call("neg", s.inner(y, n)), part)
    factor = g.call("neg", g.call("mul", n, part))
    return s.newest(known, (part, s(x)), (factor, s(y)))


def _hyperbolic_slope(g: Graph, n: int) -> int | None:
    """Return 1 - tanh(x)^2 where n is 1/cosh(x)^2; None for other quotients.

    The difference loses digits in order 0 alone, and order 0 is not computed from it.
    """
    one, below = g.args[n]
    cosh = g.args[below][0] if g.ops[below] == "pow" else below
    if (
        one != g.one
        or g.ops[cosh] != "cosh"
        or hyperbolic_square(g, g.args[cosh][0]) != below
    ):
        return None
    tanh = g.call("tanh", g.args[cosh][0])
    return g.call("sub", g.one, g.call("mul", tanh, tanh))


def _sqrt(s: Coefficients, n: int) -> int:
    """Return f_k of f^2 = x: 2 f_0 f_k = x_k - sum of f_j f_(k-j), 0 < j < k."""
    g = s.g
    part = g.call("div", g.constant(0.5), n)
    known = g.call("mul", g.call("neg", s.inner(n, n)), part)
    return s.newest(known, (part, s(g.args[n][0])))


def _hypot(s: Coefficients, n: int) -> int:
    """Return the node of order k of sqrt(x^2 + y^2)."""
    g = s.g

    def root() -> int:
        x, y = (g.call("mul", a, a) for a in g.args[n])
        return g.call("sqrt", g.call("add", x, y))

    twin = s.twin(n, root)
    assert twin is not None
    return s(twin)


def _integral(s: Coefficients, x: int, slope: int) -> int:
    """Return f_k of a function f of x with f' = slope x', by the chain rule.

    f_k is the sum of j/k x_j slope_(k-j), j from 1 to k.

    x, slope : nodes of the argument and of df/dx.
    """
    g = s.g
    return g.call("add", s.inner_rate(x, slope), g.call("mul", slope, s(x)))


def _power(s: Coefficients, n: int) -> int:
    """Return f_k of x f' = p x' f, that is of f = x^p.

    x_0 f_k is the sum of ((p + 1) j/k - 1) x_j f_(k-j), j from 1 to k.
    """
    g = s.g
    twin = s.twin(n, lambda: _as_products(s, n))
    if twin is not None:
        return s(twin)
    x, p = g.args[n]
    part = g.call("div", g.one, x)
    rising = g.call("mul", g.call("add", p, g.one), s.inner_rate(x, n))
    known = g.call("mul", g.call("sub", rising, s.inner(x, n)), part)
    factor = g.call("mul", p, g.call("mul", n, part))
    return s.newest(known, (factor, s(x)))


def _as_products(s: Coefficients, n: int) -> int | None:
    """Return x^p as products and a square root, or as an exponential.

    An exponential is returned if p changes along the motion. None if p is no multiple
    of 1/2, or too large.
    """
    g = s.g
    x, p = g.args[n]
    if s.moves(p):
        return g.call("exp", g.call("mul", p, g.call("log", x)))
    value = g.value(p)
    if value is None or 2.0 * value % 1.0 or abs(value) > LARGEST_PRODUCT:
        return None
    whole = int(abs(value))
    result = g.one if whole == abs(value) else g.call("sqrt", x)
    # Simplification would turn a product of roots into the power again.
    root = g.ops[x] in UNDONE

    def times(a: int, b: int) -> int:
        plain = root and a != g.one
        return g.unsimplified("mul", (a, b)) if plain else g.call("mul", a, b)

    while whole:
        if whole % 2:
            result = times(result, x)
        whole //= 2
        x = times(x, x)
    return g.call("div", g.one, result) if value < 0.0 else result


RECURRENCES = {
    "mul": _mul, "div": _div, "sqrt": _sqrt, "hypot": _hypot, "pow": _power,
}  # fmt: skip


def recurrence(g: Graph, state: Sequence[int], rates: Sequence[int]) -> Recurrence:
    """Return one order of the Taylor coefficients of the motion y' = rates.

    Parameters
    ----------
    g
        The graph.
    state, rates : sequence of node, shape (size,)
        The variables of y, and y'. Time, if present, is the variable `t`.
    """
    made = Coefficients(g, state)
    made.extend(rates)
    over_next = g.variable(OVER_NEXT)
    following = [g.call("mul", over_next, made(rate)) for rate in rates]
    factors: dict[int, tuple[int, int]] = {}
    left = following
    while left:  # nodes only compared, or with a twin, are not needed
        sums = [n for n in g.cone(left) if n in made.sums and n not in factors]
        factors |= {n: made.factors(n) for n in sums}
        left = [x for n in sums for x in factors[n]]
    return Recurrence(
        tuple(state), tuple(rates), tuple(map(made, state)), tuple(following),
        tuple(factors), tuple(factors.values()),
    )  # fmt: skip


def taylor_series(
    g: Graph, state: Sequence[int], rates: Sequence[int], order: int
) -> list[list[int]]:
    """Return the Taylor coefficients y_0 ... y_order, shape (order + 1, size).

    Parameters
    ----------
    g
        The graph.
    state, rates : sequence of node, shape (size,)
        The variables of y, and y', as for `recurrence`.
    order
        The highest order.

    Examples
    --------
    >>> from lagsim.language.evaluate import evaluate
    >>> from lagsim.language.graph import Graph
    >>> g = Graph()
    >>> y = g.variable("y")  # y' = y
    >>> rows = taylor_series(g, [y], [y], 2)
    >>> [evaluate(g, row, {"y": 1.0}) for row in rows]
    [[1.0], [1.0], [0.5]]
    """
    r, size = recurrence(g, state, rates), len(state)
    rows, made = [list(state), list(rates)], list[list[int]]()
    names = [g.variable(name) for name in ORDERS]
    for k in range(1, order):
        numbers = (float(k), 1.0 / k, 1.0 / (k + 1), float(k == 1))
        new = dict(zip(names, map(g.constant, numbers), strict=True))
        new |= dict(zip(r.carried, rows[-1], strict=True))
        for i, (variable, (a, b)) in enumerate(zip(r.sums, r.factors, strict=True)):
            columns = [row[2 * i] for row in made], [row[2 * i + 1] for row in made]
            new[variable] = _inner(g, *columns, same=a == b)
        found = g.substitute(r.computed, new)
        rows.append(found[:size])
        made.append(found[size:])
    return rows[: order + 1]


def _inner(g: Graph, a: Sequence[int], b: Sequence[int], *, same: bool) -> int:
    """Return the sum of a_j b_(k-j), j from 1 to k - 1; newest terms are added last.

    a, b : nodes of the coefficients of orders 0, 1, ...
    same : whether a and b are equal.
    """
    k = len(a) + 1
    if not same:
        js = sorted(range(1, k), key=lambda j: (-min(j, k - j), j))
        return g.product_sum((a[j - 1], b[k - j - 1]) for j in js)
    half = range((k - 1) // 2, 0, -1)
    total = g.product_sum((a[j - 1], a[k - j - 1]) for j in half)
    total = g.call("mul", g.constant(2.0), total)
    if k % 2:
        return total
    middle = a[k // 2 - 1]
    return g.call("add", total, g.call("mul", middle, middle))
