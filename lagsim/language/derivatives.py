"""Derivatives on the graph: reverse sweeps, forward sweeps, and total rates.

Functions that select among their arguments (`if`, `min`, `max`) are differentiated
branch by branch: the gradient of the whole is a selection among the gradients of the
branches, so that an infinite slope in the branch not taken never spoils a derivative
(0 * inf would be nan).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from lagsim.language.functions import ELEMENTS, OPERATIONS, PART, SMOOTH
from lagsim.language.graph import memoized

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Mapping, Sequence

    from lagsim.language.graph import Graph

Gradient = dict[int, int]


def gradient(g: Graph, node: int, variables: Sequence[int]) -> list[int]:
    """Return d node / d variable for each of `variables`, by reverse sweeps.

    Parameters
    ----------
    g, node
        The graph, and the node to differentiate.
    variables
        Nodes of the variables.

    Returns
    -------
    list of node
        One derivative for each variable.

    Examples
    --------
    >>> from lagsim.language.evaluate import evaluate
    >>> from lagsim.language.graph import Graph
    >>> g = Graph()
    >>> x, y = g.variable("x"), g.variable("y")
    >>> node = g.call("mul", g.call("mul", x, x), y)
    >>> evaluate(g, gradient(g, node, [x, y]), {"x": 3.0, "y": 2.0})
    [12.0, 9.0]
    """
    found = slopes(g, node, frozenset(variables))
    return [found.get(v, g.zero) for v in variables]


def slopes(g: Graph, node: int, variables: frozenset[int]) -> Gradient:
    """Return d node / d variable for each of `variables` that `node` depends on.

    The result maps variables to derivatives (nodes). A variable that is itself an
    operation counts as independent of its arguments.
    """
    if not g.args[node]:
        return {node: g.one} if node in variables else {}
    return pulled(g, {node: g.one}, variables)


def deciding_cone(g: Graph, nodes: Iterable[int]) -> list[int]:
    """Return `nodes` and all nodes below, without the conditions of smooth selections.

    A smooth selection (`SMOOTH`) has equal values and slopes in both branches where
    its condition changes. Nodes that only such conditions use are left out.
    """
    conditions = {g.args[n][0] for n in g.of((SMOOTH,))}
    return [n for n in g.cone(nodes, conditions) if n not in conditions]


def pulled(g: Graph, weights: Gradient, variables: frozenset[int]) -> Gradient:
    """Return the derivatives of the sum of weight * node over `weights`, as nodes.

    The result maps the variables on which the sum depends, among `variables`, to
    derivatives.

    weights : node -> weight; the weights count as constant.
    """
    return _Reverse(g, g.cone(weights), variables).gradient(weights)


def pulled_within(
    g: Graph, node: int, weight: int, variables: Collection[int]
) -> Gradient:
    """Return the derivatives of `node` times `weight` by the variables below the node.

    The node itself may be one of the variables. Nodes below variables are not visited,
    so that the cost grows only with the number of nodes between `node` and the
    variables.
    """
    below = g.cone(g.args[node], variables)
    return _Reverse(g, [*below, node], variables, node).gradient({node: weight})


class _Reverse:
    def __init__(
        self,
        g: Graph,
        cone: Sequence[int],
        variables: Collection[int],
        own: int | None = None,
    ) -> None:
        self.g = g
        self.variables, self.own = variables, own
        self.active: set[int] = set()
        for n in cone:
            if self._is_variable(n) or not self.active.isdisjoint(g.args[n]):
                self.active.add(n)
        # Inner selections come first, so none needs recursion.
        self.selections: dict[int, Gradient] = {}
        for n in cone:
            if n in self.active and g.args[n] and OPERATIONS[g.ops[n]].branches:
                self.selections[n] = self._selection(n)

    def _is_variable(self, n: int) -> bool:
        return n in self.variables and n != self.own

    def _selection(self, n: int) -> Gradient:
        g = self.g
        first, second = g.args[n][-2:]
        row, args = OPERATIONS[g.ops[n]], g.args[n]
        a, b = (self.gradient({branch: g.one}) for branch in (first, second))
        return {
            v: row.chosen(g, args, a.get(v, g.zero), b.get(v, g.zero))
            for v in sorted(a.keys() | b.keys())
        }

    def gradient(self, weights: Gradient) -> Gradient:
        g = self.g
        adjoint = {n: weight for n, weight in weights.items() if n in self.active}
        result: Gradient = {}
        of_sums: dict[int, Gradient] = {}  # vector -> weight of each of its numbers

        def add(to: Gradient, n: int, term: int) -> None:
            to[n] = g.call("add", to[n], term) if n in to else term

        for n in self._below(adjoint):
            weight = adjoint.pop(n, g.zero)
            if weight == g.zero and n not in of_sums:
                continue
            if self._is_variable(n):
                add(result, n, weight)
            elif n in self.selections:
                for v, slope in self.selections[n].items():
                    add(result, v, g.call("mul", weight, slope))
            elif g.ops[n] == PART:
                vector, k = g.args[n]
                of_sums.setdefault(vector, {})[int(g.payload(k))] = weight
            else:
                shares = self._shares(n, weight, of_sums.pop(n, {}))
                for a, share in shares:
                    add(adjoint, a, share)
        return result

    def _shares(
        self, n: int, weight: int, of_sums: Gradient
    ) -> Iterable[tuple[int, int]]:
        """Return the contributions of node n to the adjoints of its arguments.

        The contributions are pairs of nodes: an argument, and the addend of its
        adjoint.

        weight : the adjoint of n.
        of_sums : the adjoint of each component of a vector of sums.
        """
        g = self.g
        if g.ops[n] == ELEMENTS:
            found: list[tuple[int, int]] = g.payload(g.args[n][0]).pull(
                g, n, of_sums, self.active
            )
            return found
        return [
            (a, weight if slope == g.one else g.call("mul", weight, slope))
            for a, slope in local_slopes(g, n)
            if a in self.active
        ]

    def _below(self, nodes: Iterable[int]) -> list[int]:
        """Return the active nodes below `nodes`, in reverse order of evaluation.

        Nodes are active if they depend on the variables. Arguments of selections are
        left out.
        """
        seen = set(nodes)
        stack = list(seen)
        while stack:
            n = stack.pop()
            if n in self.selections:
                continue
            for a in self.g.args[n]:
                if a in self.active and a not in seen:
                    seen.add(a)
                    stack.append(a)
        return sorted(seen, reverse=True)


def tangent(g: Graph, nodes: Iterable[int], seed: Mapping[int, int]) -> list[int]:
    """Return the directional derivative of each of `nodes`.

    Parameters
    ----------
    g, nodes
        The graph, and the nodes to differentiate.
    seed
        The direction: the rate of each variable that is not constant.

    Returns
    -------
    list of node
        One derivative for each of `nodes`.
    """
    nodes = list(nodes)
    rates: dict[int, int] = {}
    for n in g.cone(nodes, seed) if seed else ():
        if n in seed:
            rates[n] = seed[n]
        elif not rates.keys().isdisjoint(g.args[n]):
            rates[n] = rate_of(g, n, rates)
    return [rates.get(n, g.zero) for n in nodes]


def rate_of(g: Graph, n: int, rates: Mapping[int, int]) -> int:
    """Return the rate of node `n` by the chain rule.

    rates : node -> its rate, for the arguments of n; arguments without an entry are
        constant.
    """
    args = g.args[n]
    if g.ops[n] == ELEMENTS:
        pushed: int = g.payload(args[0]).push(g, n, rates)
        return pushed
    if g.ops[n] == PART:
        return g.unsimplified(PART, (rates[args[0]], args[1]))
    if g.ops[n] == "add":  # of long sums there are many
        one, other = (rates.get(a, g.zero) for a in args)
        if g.zero in (one, other):
            return other if one == g.zero else one
        return g.call("add", one, other)
    row = OPERATIONS[g.ops[n]]
    if row.condition:
        return g.zero
    if row.branches:
        moving = [rates.get(a, g.zero) for a in args]
        return row.chosen(g, args, moving[-2], moving[-1])
    moved = [(slope, rates.get(a, g.zero)) for a, slope in local_slopes(g, n)]
    return g.product_sum((slope, rate) for slope, rate in moved if rate != g.zero)


def local_slopes(g: Graph, n: int) -> list[tuple[int, int]]:
    """Return pairs of a node and d n / d node, for the differentiation of `n`.

    The nodes are the arguments of `n`, with two exceptions. For a power of a root, with
    an exponent of 2 or more, they are the arguments of the root, since the power has a
    slope at 0, where the root has none. For a quotient whose divisor grows as exp does,
    and for the logarithm of such a node, they are the nodes of the exponent, so that
    the slope is finite where the divisor overflows.
    """
    args = g.args[n]
    if g.ops[n] == "add":  # of long sums there are many
        return [(a, g.one) for a in args]
    if g.ops[n] == "pow" and g.ops[args[0]] in ("hypot", "sqrt"):
        root, exponent = args[0], g.value(args[1])
        if exponent is not None and exponent >= 2.0:
            rest = g.call("pow", root, g.constant(exponent - 2.0))
            if g.ops[root] == "sqrt":
                half = g.call("mul", g.constant(0.5 * exponent), rest)
                return [(g.args[root][0], half)]
            outer = g.call("mul", g.constant(exponent), rest)
            return [(a, g.call("mul", outer, a)) for a in g.args[root]]
    if g.ops[n] == "div":
        below = log_slopes(g, args[1])
        if below is not None:
            fall = g.call("neg", n)
            through = [(a, g.call("mul", fall, slope)) for a, slope in below]
            return [(args[0], g.call("div", g.one, args[1])), *through]
    if g.ops[n] == "log":
        below = log_slopes(g, args[0])
        if below is not None:
            return below
    partials = OPERATIONS[g.ops[n]].partials
    assert partials is not None
    return list(zip(args, partials(g, args, n), strict=True))


@memoized
def log_slopes(g: Graph, n: int) -> list[tuple[int, int]] | None:
    """Return pairs of a node and d log |n| / d node, without quotients of infinities.

    Such pairs exist for products and powers of exp, cosh and numbers, and for such an
    expression plus a number; else the result is None.
    """
    op, args = g.ops[n], g.args[n]
    if g.value(n) is not None:
        return []
    if op == "exp":
        return [(args[0], g.one)]
    if op == "cosh":
        return [(args[0], g.call("tanh", args[0]))]
    if op == "neg":
        return log_slopes(g, args[0])
    if op == "pow" and g.value(args[1]) is not None:
        return _times(g, args[1], log_slopes(g, args[0]))
    parts = [log_slopes(g, a) for a in args] if op in ("mul", "add", "sub") else []
    if len(parts) != 2 or parts[0] is None or parts[1] is None:
        return None
    if op == "mul":
        return parts[0] + parts[1]
    if parts[0] and parts[1]:
        return None
    k = 0 if parts[0] else 1
    ratio = _quotient(g, args[1 - k], args[k])
    share = g.call("div", g.one, g.call("sub" if op == "sub" else "add", g.one, ratio))
    return _times(g, share, parts[k])


def _times(
    g: Graph, factor: int, found: list[tuple[int, int]] | None
) -> list[tuple[int, int]] | None:
    if found is None:
        return None
    return [(a, g.call("mul", factor, slope)) for a, slope in found]


def _quotient(g: Graph, number: int, grown: int) -> int:
    """Return number / grown; a divisor exp(x) becomes a factor exp(-x).

    number, grown : nodes, the second of which may overflow.
    """
    op, args = g.ops[grown], g.args[grown]
    if op == "exp":
        return g.call("mul", number, g.call("exp", g.call("neg", args[0])))
    if op == "mul" and g.value(args[0]) is not None:
        return _quotient(g, g.call("div", number, args[0]), args[1])
    return g.call("div", number, grown)
