"""Taylor series on the graph: the coefficients of a motion, as nodes.

For y' = f(t, y) the k-th normalised coefficient y_k = y^(k)(t)/k! follows from the
earlier ones, operation by operation. Sums, products, quotients, powers and roots have
recurrences of their own; of anything else the chain rule f' = slope x' gives one, with
the slope's series made the same way, so that a new function of the language needs
nothing here. Functions that select or step keep the branch that they are on at t.

`taylor_series` writes all coefficients out. Their number of operations grows with the
square of the order; `recurrence` gives one order's, of which a loop makes them all.

Sources: R. E. Moore, Interval Analysis (1966); A. Griewank and A. Walther, Evaluating
Derivatives, 2nd ed. (2008), chapter 13; A. Jorba and M. Zou, Experimental Mathematics
14 (2005), proposition 2.1.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from lagsim.language.derivatives import local_slopes, log_slopes
from lagsim.language.functions import OPERATIONS
from lagsim.language.graph import CONSTANT, TRUTH, VARIABLE
from lagsim.language.recurrences import integral

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable, Mapping, Sequence

    from lagsim.language.graph import Graph

# The variables of a loop over the order: k, 1/k, 1/(k+1), the coefficient of t, which
# is 1 and then 0; and how the names of others begin.
K, OVER_K, OVER_NEXT, TIME = ORDERS = tuple(
    f"series.{name}" for name in ("k", "1/k", "1/(k+1)", "t")
)
SUM, CARRIED = "series.sum.", "series.y."


class Recurrences:
    """How the coefficients of order k follow from earlier ones.

    Parameters
    ----------
    g : Graph
    moving : collection of node
        The variables that move.
    """

    def __init__(self, g: Graph, moving: Collection[int]) -> None:
        self.g = g
        self.moving = moving
        self._moves: dict[int, bool] = {}
        self._twins: dict[int, int | None] = {}
        self._growing: dict[int, bool] = {}
        self._slopes: dict[int, list[tuple[int, int]]] = {}

    def __call__(self, n: int) -> int:
        """Give the coefficient of order k of node `n`."""
        raise NotImplementedError

    def inner(self, a: int, b: int) -> int:
        """Give the sum of a_j b_(k-j), j from 1 to k - 1."""
        raise NotImplementedError

    def inner_rate(self, a: int, b: int) -> int:
        """Give the sum of j/k a_j b_(k-j), j from 1 to k - 1."""
        raise NotImplementedError

    def moves(self, n: int) -> bool:
        """Tell whether `n` changes along the motion."""
        found = self._moves.get(n)
        if found is None:
            for below in self.g.cone([n]):
                if below not in self._moves:
                    args = self.g.args[below]
                    moved = any(self._moves[a] for a in args)
                    self._moves[below] = moved or below in self.moving
            found = self._moves[n]
        return found

    def twin(self, n: int, made: Callable[[], int | None]) -> int | None:
        """Give an expression with the series of `n`, made once; None if it has none."""
        if n not in self._twins:
            self._twins[n] = made()
        return self._twins[n]

    def smooth(self, nodes: Iterable[int]) -> list[int]:
        """Give what moves of `nodes` and below, from the leaves upwards."""
        g = self.g
        conditions = {name for name, row in OPERATIONS.items() if row.condition}
        return [
            n for n in g.cone(nodes) if self.moves(n) and g.ops[n] not in conditions
        ]

    def coefficient(self, n: int) -> int:
        """Give the coefficient of order k of an operation from its arguments'."""
        g = self.g
        op, args = g.ops[n], g.args[n]
        row = OPERATIONS[op]
        if row.branches is not None:
            first, second = (self(a) for a in args[-2:])
            return g.call("if", row.branches(g, args), first, second)
        if row.series is None or (op == "div" and self._overflows(args[1])):
            return self._by_slopes(n)
        return row.series(self, n)

    def _overflows(self, n: int) -> bool:
        """Tell whether a divisor may overflow, and has a logarithm that does not."""
        if n not in self._growing:
            self._growing[n] = bool(log_slopes(self.g, n))
        return self._growing[n]

    def _by_slopes(self, n: int) -> int:
        """Give the coefficient from f' = sum of slope * argument'."""
        if n not in self._slopes:
            slopes = local_slopes(self.g, n)
            self._slopes[n] = [(x, slope) for x, slope in slopes if self.moves(x)]
        return self.g.sum(integral(self, x, slope) for x, slope in self._slopes[n])


class Series(Recurrences):
    """Coefficients along a motion, made as they are asked for.

    rates : mapping of node to node
        The rate of each variable that moves.
    """

    def __init__(self, g: Graph, rates: Mapping[int, int]) -> None:
        super().__init__(g, rates)
        self.rates = rates
        self._known: dict[int, list[int]] = {}
        self._k = 0

    def __call__(self, n: int) -> int:
        """Give the coefficient of `n` of the order that is being made."""
        return self.at(n, self._k)

    def at(self, n: int, k: int) -> int:
        """Give the coefficient of order `k` of node `n`."""
        g = self.g
        if not self.moves(n):
            return n if k == 0 else g.zero
        known = self._known.setdefault(n, [n])
        outer = self._k
        while len(known) <= k:
            self._k = len(known)
            if n in self.rates:
                rate = self.at(self.rates[n], self._k - 1)
                known.append(g.call("mul", g.constant(1.0 / self._k), rate))
            else:
                known.append(self.coefficient(n))
        self._k = outer
        return known[k]

    def extend(self, nodes: Iterable[int], order: int) -> None:
        """Make all coefficients of `nodes` up to `order`, from the leaves upwards."""
        cone = self.smooth(nodes)
        for k in range(order + 1):
            for n in cone:
                self.at(n, k)

    def inner(self, a: int, b: int) -> int:
        """Give the sum of a_j b_(k-j); the newest coefficients are added last."""
        g, k = self.g, self._k
        if a != b:
            js = sorted(range(1, k), key=lambda j: (-min(j, k - j), j))
            return g.product_sum((self.at(a, j), self.at(b, k - j)) for j in js)
        half = range((k - 1) // 2, 0, -1)
        total = g.product_sum((self.at(a, j), self.at(a, k - j)) for j in half)
        total = g.call("mul", g.constant(2.0), total)
        if k % 2:
            return total
        middle = self.at(a, k // 2)
        return g.call("add", total, g.call("mul", middle, middle))

    def inner_rate(self, a: int, b: int) -> int:
        """Give the sum of j/k a_j b_(k-j)."""
        g, k = self.g, self._k
        terms = (
            (g.call("mul", g.constant(j), self.at(a, j)), self.at(b, k - j))
            for j in range(1, k)
        )
        return g.call("mul", g.constant(1.0 / k), g.product_sum(terms))


class Recurrence(NamedTuple):
    """One order of the series of y' = f(t, y), from the inner sums of its products.

    Its variables are those of ORDERS besides those that are told here.

    Attributes
    ----------
    state, rates : tuple of node
        y and y'.
    carried, following : tuple of node
        The variables of y_k, and y_(k+1).
    sums : tuple of node
        The variables of the sums of a_j b_(k-j), j from 1 to k - 1.
    factors : tuple of pair of node
        a_k and b_k of each.
    """

    state: tuple[int, ...]
    rates: tuple[int, ...]
    carried: tuple[int, ...]
    following: tuple[int, ...]
    sums: tuple[int, ...]
    factors: tuple[tuple[int, int], ...]

    @property
    def made(self) -> list[int]:
        """All nodes that an order makes."""
        return [*self.following, *(n for pair in self.factors for n in pair)]

    @property
    def nodes(self) -> tuple[list[int], list[int]]:
        """All nodes of order 0, and of an order."""
        order = [*self.carried, *self.sums, *self.made]
        return [*self.state, *self.rates], order


class _Symbolic(Recurrences):
    """Coefficients of an order k that is a variable."""

    def __init__(self, g: Graph, state: Sequence[int]) -> None:
        t = g.variable("t")
        carried = {v: g.variable(f"{CARRIED}{i}") for i, v in enumerate(state)}
        super().__init__(g, (t, *state))
        # Of a product: its factors, and whether the first is multiplied by j.
        self.sums: dict[int, tuple[int, int, bool]] = {}
        self._variables: dict[tuple[int, int, bool], int] = {}
        self._known = {t: g.variable(TIME)} | carried

    def __call__(self, n: int) -> int:
        """Give the coefficient of `n`."""
        if not self.moves(n):
            return self.g.zero
        if n not in self._known:
            self._known[n] = self.coefficient(n)
        return self._known[n]

    def extend(self, nodes: Iterable[int]) -> None:
        """Make the coefficients of `nodes`, from the leaves upwards."""
        for n in self.smooth(nodes):
            self(n)

    def inner(self, a: int, b: int) -> int:
        """Give the variable of the sum of a_j b_(k-j)."""
        return self._sum(min(a, b), max(a, b), rated=False)

    def inner_rate(self, a: int, b: int) -> int:
        """Give that of j a_j b_(k-j), divided by k."""
        return self.g.call("mul", self.g.variable(OVER_K), self._sum(a, b, rated=True))

    def _sum(self, a: int, b: int, *, rated: bool) -> int:
        if not (self.moves(a) and self.moves(b)):
            return self.g.zero
        key = (a, b, rated)
        if key not in self._variables:
            found = self.g.variable(f"{SUM}{len(self._variables)}")
            self._variables[key] = found
            self.sums[found] = key
        return self._variables[key]

    def factors(self, variable: int) -> tuple[int, int]:
        """Give a_k and b_k of a sum."""
        a, b, rated = self.sums[variable]
        self.extend((a, b))
        k = self.g.variable(K)
        return self.g.call("mul", k, self(a)) if rated else self(a), self(b)


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
    return [[series.at(v, k) for v in state] for k in range(order + 1)]


def recurrence(g: Graph, state: Sequence[int], rates: Sequence[int]) -> Recurrence:
    """Give what one order of the same coefficients takes."""
    made = _Symbolic(g, state)
    made.extend(rates)
    over_next = g.variable(OVER_NEXT)
    following = [g.call("mul", over_next, made(rate)) for rate in rates]
    factors: dict[int, tuple[int, int]] = {}
    left = following
    while left:  # what is only compared, or has a twin, is not wanted
        wanted = [n for n in g.cone(left) if n in made.sums and n not in factors]
        factors |= {n: made.factors(n) for n in wanted}
        left = [x for n in wanted for x in factors[n]]
    return Recurrence(
        tuple(state), tuple(rates), tuple(map(made, state)), tuple(following),
        tuple(factors), tuple(factors.values()),
    )  # fmt: skip


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
        row = OPERATIONS[op]
        linear = row.branches or not row.convolutions
        fixed_factor = op == "mul" and not all(a in moving for a in args)
        fixed_divisor = op == "div" and args[1] not in moving
        if linear or fixed_factor or fixed_divisor:
            total += order
        elif op == "mul" and args[0] == args[1]:
            total += 0.5 * order * order
        else:
            total += (
                row.convolutions * order * order
            )  # half as many terms, of two operations
    return int(total)
