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

from lagsim.language.derivatives import local_slopes, log_slopes
from lagsim.language.functions import OPERATIONS
from lagsim.language.functions.recurrences import scaled
from lagsim.language.graph import CONSTANT, TRUTH, VARIABLE

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence

    from lagsim.language.graph import Graph


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
        self._growing: dict[int, bool] = {}
        self._slopes: dict[int, list[tuple[int, int]]] = {}

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
            return scaled(self, 1.0 / k, self(self.rates[n], k - 1))
        op, args = g.ops[n], g.args[n]
        row = OPERATIONS[op]
        if row.branches is not None:
            first, second = (self(a, k) for a in args[-2:])
            return g.call("if", row.branches(g, args), first, second)
        if row.series is None or (op == "div" and self._overflows(args[1])):
            return self.chain(n, k)
        return row.series(self, n, k)

    def _overflows(self, n: int) -> bool:
        """Tell whether a divisor may overflow, and has a logarithm that does not."""
        if n not in self._growing:
            self._growing[n] = bool(log_slopes(self.g, n))
        return self._growing[n]

    def chain(self, n: int, k: int) -> int:
        """Give the coefficient from f' = sum of slope * argument'.

        k f_k = sum of j x_j s_(k-j), j from 1 to k, for each argument x with slope s.
        """
        g = self.g
        if n not in self._slopes:
            slopes = local_slopes(g, n)
            self._slopes[n] = [(x, slope) for x, slope in slopes if self.moves(x)]
        earlier, newest = g.zero, g.zero
        for x, slope in self._slopes[n]:
            newest = g.call("add", newest, g.call("mul", self(slope, 0), self(x, k)))
            terms = (
                (scaled(self, j, self(x, j)), self(slope, k - j)) for j in range(1, k)
            )
            earlier = g.call("add", earlier, g.product_sum(terms))
        return g.call("add", scaled(self, 1.0 / k, earlier), newest)

    def twin(self, n: int, made: Callable[[], int | None]) -> int | None:
        """Give an expression with the series of `n`, made once; None if it has none."""
        if n not in self._twins:
            self._twins[n] = made()
        return self._twins[n]


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
