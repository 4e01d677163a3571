"""Taylor series of the motion, of equations solved symbolically on the graph."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from lagsim.language.forms import normal_form
from lagsim.language.graph import memoized
from lagsim.language.series import ORDERS, Recurrence, recurrence, taylor_series
from lagsim.methods.taylor import order_for

if TYPE_CHECKING:
    from collections.abc import Sequence

    from lagsim.language.graph import Graph
    from lagsim.mechanics.equations import Equations
    from lagsim.mechanics.ldl import Elimination
    from lagsim.native.graph.keys import Loop


# Largest count of operations of a loop over the order: it compiles in about a second.
MOST_OPERATIONS = 500_000
# Operations of straight-line code that fit into the instruction cache; each operation
# beyond these costs WAITING more, for the fetch of instructions from memory.
CACHED, WAITING = 3700, 3.0
# Cost of one order in a loop, in operations of straight-line code (0.13 ns), and of
# each operation of the loop's body (measured: 18 ns with 40 operations and 6 products,
# 330 ns with 1,494 and 188).
PER_ORDER, PER_NODE = 90.0, 1.2
# Cost of one term of the inner sums: one instruction adds eight terms.
PER_TERM = 0.3
# Instructions for a sum in one order of straight-line code, besides its vectors, and
# the longest such code (measured at order 15: 194 ns instead of 307 with 77 operations
# and 12 sums, 697 instead of 610 with 169 and 25).
PER_SUM = 9
MOST_UNROLLED = 3500


def motion_rates(equations: Equations, elimination: Elimination) -> list[int]:
    """Return the nodes of y' = (q', q'', rates of first-order states and works).

    elimination : the symbolic solution for q'' and lambda.
    """
    e, g = equations, equations.graph
    accelerations, multipliers = elimination.motion()
    new = dict(zip(map(g.variable, e.multipliers), multipliers, strict=True))
    new |= dict(zip(map(g.variable, e.accelerations), accelerations, strict=True))
    velocities = [g.variable(v) for v in e.velocities]
    return [
        *velocities,
        *accelerations,
        *g.substitute(elimination.other_rates, new),
    ]


class Cost(NamedTuple):
    """Cost of the Taylor series of one step.

    Attributes
    ----------
    operations
        The cost, in operations of straight-line code.
    loop
        Whether the code is a loop over the order.
    """

    operations: int
    loop: bool


def series_cost(equations: Equations, elimination: Elimination, rtol: float) -> Cost:
    """Estimate the cost of the Taylor series of a step with the tolerance `rtol`.

    The cost is that of the cheaper form of the equations: a loop over the order, or
    straight-line code.

    elimination : the symbolic solution of the equations.
    """
    g, state = equations.graph, _state(equations)
    rates = _shorter(g, state, tuple(motion_rates(equations, elimination)))
    return _cost(g, state, rates, order_for(rtol))


def motion_series(
    equations: Equations, rates: Sequence[int], rtol: float, *, loop: bool = True
) -> list[int] | Loop:
    """Return the Taylor series of y: its order, then its coefficients.

    Parameters
    ----------
    equations
        The equations of motion.
    rates
        Nodes of y', shape (size,), with the switches frozen in the branches of an arc.
    rtol
        The relative tolerance, which determines the order.
    loop
        Whether to return a `Loop`; False for functions that run from tapes.

    Returns
    -------
    list of int or Loop
        With `loop`, a loop over the order, possibly unrolled; else nodes: the order,
        then the coefficients, shape (order + 1, size), row by row.
    """
    g, order = equations.graph, order_for(rtol)
    state = _state(equations)
    shorter = _shorter(g, state, tuple(rates))
    cost = _cost(g, state, shorter, order)
    if loop:
        # a loop is compiled only if the series is integrated
        from lagsim.native.graph.keys import Loop

        made = _recurrence(g, state, shorter)
        return Loop(made, order, cost.operations, unrolled=not cost.loop)
    rows = taylor_series(g, state, shorter, order)
    return [g.constant(order), *(node for row in rows for node in row)]


@memoized
def _cost(g: Graph, state: tuple[int, ...], rates: tuple[int, ...], order: int) -> Cost:
    loop = _recurrence(g, state, rates)
    body, products = _order_cost(g, loop)
    length = order * body + order * order * products
    straight = length + WAITING * max(0.0, length - CACHED)
    sums = 0.5 * order * PER_TERM * len(loop.sums)
    looped = len(g.cone(loop.rates)) + order * (PER_ORDER + PER_NODE * body + sums)
    unrolled = order * (body + PER_SUM * len(loop.sums))
    return Cost(int(min(straight, looped)), unrolled > MOST_UNROLLED)


def _order_cost(g: Graph, loop: Recurrence) -> tuple[int, float]:
    """Return the operations of one order, and the number of its sums of products.

    The sum of a square counts half.

    loop : the loop over the orders of the series.
    """
    names = [str(g.payload(n)) for n in loop.variables]
    squares = sum(a == b for a, b in loop.factors)
    body = len(g.dependent(loop.computed, (*ORDERS, *names)))
    return body, len(loop.sums) - 0.5 * squares


def _state(equations: Equations) -> tuple[int, ...]:
    names = (*equations.state, *(x.name for x in equations.works))
    return tuple(map(equations.graph.variable, names))


@memoized
def _recurrence(g: Graph, state: tuple[int, ...], rates: tuple[int, ...]) -> Recurrence:
    return recurrence(g, state, rates)


@memoized
def _shorter(
    g: Graph, state: tuple[int, ...], rates: tuple[int, ...]
) -> tuple[int, ...]:
    """Return `rates`, or their normal form if its Taylor series is shorter.

    state, rates : nodes of the variables y and of y', shape (size,) each.
    """
    names = [str(g.payload(v)) for v in state]
    moving = g.dependent(rates, [*names, "t"])
    forms = rates, tuple(normal_form(g, rates, moving))

    def operations(nodes: tuple[int, ...]) -> float:
        body, products = _order_cost(g, _recurrence(g, state, nodes))
        return body + 10.0 * products

    return min(forms, key=operations)
