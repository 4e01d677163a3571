"""Hash-consed expression graph.

A node is an int. Equal expressions are one node, and arguments have smaller numbers
than the operations that use them, so that ascending order is an order of evaluation and
no algorithm on the graph needs recursion.
"""

from __future__ import annotations

import math
import operator
import sys
from collections import defaultdict
from functools import cache, wraps
from itertools import repeat
from typing import (
    TYPE_CHECKING,
    Any,
    Concatenate,
    NamedTuple,
    ParamSpec,
    Protocol,
    TypeVar,
)

from lagsim import limits
from lagsim.codes.known import TOO_LARGE
from lagsim.errors import InputError, Place, Problem
from lagsim.language.functions import ELEMENTS, OPERATIONS

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Container, Iterable, Mapping

    from lagsim.language.tables import Data

    class Members(Protocol):
        """Interface of `elements.Elements` to the graph, which does not import it.

        `count` is the number of arguments, `size` the length of the vector of sums.
        """

        count: int
        size: int

    Payload = float | str | bool | Data | Members

Given = ParamSpec("Given")
Found = TypeVar("Found")

CONSTANT = "constant"
VARIABLE = "variable"
TRUTH = "truth"
DATA = "data"
# Number of nodes whose traversal takes as long as creating one.
LOOKUPS = 7
# Length from which cones are memoized, and the number of memoized cones.
LONG, MOST_CONES, CONES = 1000, 8, "cones"


class Degrees(NamedTuple):
    """The least and the greatest degree of the terms of a polynomial."""

    least: float
    most: float

    def __or__(self, other: Degrees) -> Degrees:
        """Return the degrees of a sum of two polynomials: least and greatest."""
        return Degrees(min(self.least, other.least), max(self.most, other.most))


# degrees of other nodes, and of 0
FLAT, NOTHING = Degrees(0, 0), Degrees(math.inf, -math.inf)


@cache
def _degrees_of(
    op: str, exponent: float | None, *below: Degrees | None
) -> Degrees | None:
    """Return the degrees of an operation; None if it is no polynomial.

    op : the operation.
    exponent : the last argument if it is a number.
    below : degrees of the arguments.
    """
    if all(d in (FLAT, NOTHING) for d in below):
        return FLAT
    known = [d for d in below if d is not None]
    if len(known) < len(below):
        return None
    if op in ("add", "sub"):
        return known[0] | known[1]
    if op == "neg":
        return known[0]
    if op == "mul":
        return Degrees(*map(operator.add, *known))
    if op == "div" and known[1] in (FLAT, NOTHING):
        return known[0]
    if op in ("if", "smooth.if") and known[0] in (FLAT, NOTHING):
        return known[1] | known[2]
    if exponent in (2.0, 3.0, 4.0, 5.0, 6.0):
        return Degrees(*(int(exponent) * d for d in known[0]))
    return None


class TooMuchError(InputError):
    """Signal that work on a graph would exceed `limits.WORK`."""


class Leaves(NamedTuple):
    """Nodes of the variables with given names, collected once.

    `first` is the least of these nodes. `variables` is the number of variables in the
    graph at that time: if it has grown, the nodes are collected again.
    """

    nodes: set[int]
    first: int
    variables: int


class Graph:
    """Hash-consed store of expressions: equal expressions are one node.

    Parameters
    ----------
    most
        Largest number of nodes.
    work
        Budget of operations, see `limits.WORK`, until `unbind` is called.

    Attributes
    ----------
    ops : list of str
        The operation of each node: a key of OPERATIONS, "constant", "variable",
        "truth" or "data".
    args : list of tuple of int
        The arguments of each node.
    place : Place or None
        Place of the longest expression, where there is a file.
    memoized : dict
        Results of memoized functions, see `memoize`.

    Examples
    --------
    >>> g = Graph()
    >>> x = g.variable("x")
    >>> g.call("add", x, g.zero) == x
    True
    >>> g.value(g.call("mul", g.constant(2.0), g.constant(3.0)))
    6.0
    """

    def __init__(self, most: int = limits.GRAPH_NODES, work: float = math.inf) -> None:
        self._most = most
        self._left = work
        self.place: Place | None = None
        self._work = work
        self._allowed = 0
        self.ops: list[str] = []
        self.args: list[tuple[int, ...]] = []
        self._payload: dict[int, Any] = {}
        # Operation -> its arguments, or payload -> node.
        self._known: defaultdict[str, dict[object, int]] = defaultdict(dict)
        self.memoized: dict[object, Any] = {}
        self.zero = self.constant(0.0)
        self.one = self.constant(1.0)

    def __len__(self) -> int:
        return len(self.ops)

    def __getstate__(self) -> dict[str, Any]:
        """Return the state to pickle, without memoized results."""
        return self.__dict__ | {"memoized": {}}

    def unsimplified(
        self,
        op: str,
        args: tuple[int, ...] = (),
        payload: Payload | None = None,
    ) -> int:
        """Return the node of `op` on `args` without simplification, or a leaf.

        Raises
        ------
        InputError
            Where the graph would exceed its largest number of nodes.
        """
        by_arguments = self._known[op]
        key = args if payload is None else payload
        known = by_arguments.get(key)
        if known is not None:
            return known
        node = len(self.ops)
        if node >= self._most:
            text = (
                f"the equations of this model have more than {self._most:,} operations"
            )
            hint = "products and sums of fewer coordinates have shorter derivatives"
            hint = limits.without(hint)
            raise InputError([Problem(TOO_LARGE, text, None, hint)])
        if self._left < 0:
            raise self._too_much()
        self.ops.append(op)
        self.args.append(args)
        if payload is not None:
            self._payload[node] = payload
        by_arguments[key] = node
        return node

    def _too_much(self) -> TooMuchError:
        text = (
            "deriving and examining the equations requires more than "
            f"{self._work:,.0f} operations, the limit for a file of this size; its "
            "longest expression is here"
        )
        hint = "use fewer factors in one product, power or nested call, "
        hint += "fewer constraints, and a start that satisfies the constraints"
        hint = limits.without(hint)
        return TooMuchError([Problem(TOO_LARGE, text, self.place, hint)])

    def count(self, work: float) -> None:
        """Subtract `work`, in operations, from the budget; called before the work.

        Raises
        ------
        TooMuchError
            Where `work` exceeds the budget, which is then unchanged.
        """
        if work > self._left:
            raise self._too_much()
        self._left -= work

    def allow(self, letters: int) -> None:
        """Raise the limits on nodes and operations, for a text of `letters` letters."""
        self._allowed += letters
        self._most = max(self._most, limits.graph_nodes(self._allowed))
        more = limits.work(self._allowed) - limits.work(self._allowed - letters)
        self._left += more
        self._work += more

    def unbind(self) -> None:
        """Remove the limit on work; called once the model is checked and planned."""
        self._left = math.inf

    def known(self, op: str, args: tuple[int, ...]) -> int | None:
        """Return the node of `op` on `args` if it exists, else None."""
        return self._known[op].get(args)

    def of(self, ops: Iterable[str]) -> list[int]:
        """Return all nodes of the graph whose operation is in `ops`, ascending."""
        return sorted(n for op in ops for n in self._known.get(op, {}).values())

    def constant(self, x: float) -> int:
        """Return the node of the number `x`."""
        x = float(x) + 0.0  # -0.0 becomes 0.0
        known = self._known[CONSTANT].get(x)
        return self.unsimplified(CONSTANT, payload=x) if known is None else known

    def truth(self, x: bool) -> int:
        """Return the node of a truth value."""
        return self.unsimplified(TRUTH, payload=bool(x))

    def data(self, numbers: Data | Members) -> int:
        """Return the leaf node of an array or of a table of members."""
        return self.unsimplified(DATA, payload=numbers)

    def variable(self, name: str) -> int:
        """Return the node of the variable `name`."""
        known = self._known[VARIABLE].get(name)
        return self.unsimplified(VARIABLE, payload=name) if known is None else known

    def variables(self) -> Mapping[Any, int]:
        """Return the nodes of all variables, by name."""
        return self._known[VARIABLE]

    def value(self, node: int) -> float | None:
        """Return the number that `node` is, or None if it is not a constant."""
        return self._payload[node] if self.ops[node] == CONSTANT else None

    def payload(self, node: int) -> Any:
        """Return the number, name, truth value, array or Elements of a leaf."""
        return self._payload[node]

    def call(self, op: str, *args: int) -> int:
        """Return the node of operation `op` on `args`, folded and simplified.

        Folding never raises: an operation without a finite value is not folded.
        """
        self._left -= 1
        row = OPERATIONS[op]
        found = row.simpler(self, *args) if row.simpler else None
        if found is not None:
            return found
        for a in args:  # quicker than `any`
            if self.ops[a] not in (CONSTANT, TRUTH):
                break
        else:
            value = row(*(self._payload[a] for a in args))
            if row.condition:
                return self.truth(value)
            if math.isfinite(value):
                return self.constant(value)
        if row.commutes and args[0] > args[1]:
            args = (args[1], args[0])
        return self.unsimplified(op, args)

    def sum(self, nodes: Iterable[int]) -> int:
        """Return the sum of `nodes`, left to right."""
        total = self.zero
        for node in nodes:
            total = self.call("add", total, node)
        return total

    def product_sum(self, pairs: Iterable[tuple[int, int]]) -> int:
        """Return the sum of a * b over `pairs`."""
        return self.sum(self.call("mul", a, b) for a, b in pairs)

    def cone(self, nodes: Iterable[int], ends: Container[int] = ()) -> list[int]:
        """Return `nodes` and all nodes below, in order of evaluation.

        Nodes in `ends` are included where they are reached; nodes below these are not.
        """
        roots, args = frozenset(nodes), self.args
        known: dict[object, list[int]] = self.memoized.setdefault(CONES, {})
        if not ends and roots in known:
            self.count(len(known[roots]) / LOOKUPS)
            return list(known[roots])
        seen = set(roots)
        waiting = [n for n in seen if n not in ends] if ends else list(seen)
        for n in waiting:  # the list grows during the loop
            for a in args[n]:
                if a not in seen:
                    seen.add(a)
                    if a not in ends:
                        waiting.append(a)
        self.count(len(seen) / LOOKUPS)
        found = sorted(seen)
        if len(found) >= LONG and not ends:
            known[roots] = list(found)
            if len(known) > MOST_CONES:
                del known[next(iter(known))]
        return found

    def depends(self, nodes: Iterable[int]) -> frozenset[str]:
        """Return the names of the variables below `nodes`."""
        return frozenset(
            str(self._payload[n]) for n in self.cone(nodes) if self.ops[n] == VARIABLE
        )

    def dependent(self, nodes: Iterable[int], names: Collection[str]) -> set[int]:
        """Return the nodes in the cone of `nodes` that depend on any of `names`."""
        return self.dependents(nodes, names)[0]

    def dependents(
        self, nodes: Iterable[int], *several: Collection[str]
    ) -> list[set[int]]:
        """Return one set of nodes for each set of names in `several`.

        It has the nodes that depend on at least one of the names, of `nodes` and all
        nodes below these.
        """
        args, leaves = self.args, [self._leaves(names) for names in several]
        first = min(leaf.first for leaf in leaves)
        # Older nodes depend on none of the names.
        cone = self.cone(nodes, range(first) if first > LONG else ())
        made = []
        for leaf in leaves:
            found = leaf.nodes.intersection(cone)
            for n in cone if found else ():
                if not found.isdisjoint(args[n]):
                    found.add(n)
            made.append(found)
        return made

    def _leaves(self, names: Collection[str]) -> Leaves:
        """Return the nodes of variables by their names; memoized for a frozenset."""
        known, kept = self._known[VARIABLE], isinstance(names, frozenset)
        found: Leaves | None = self.memoized.get((Leaves, names)) if kept else None
        if found is None or found.variables != len(known):
            nodes = set(map(known.get, names, repeat(-1))) - {-1}
            found = Leaves(nodes, min(nodes, default=sys.maxsize), len(known))
            if kept:
                self.memoized[Leaves, names] = found
        return found

    def cost(self, nodes: Iterable[int], names: Collection[str]) -> int:
        """Return the cost of `nodes` in additions.

        Nodes that do not depend on `names` cost 0.
        """
        found = self.dependent(nodes, names)
        rows = (OPERATIONS.get(self.ops[n]) for n in found)
        cost = sum(row.cost for row in rows if row is not None)
        elements = found.intersection(self.of((ELEMENTS,)))
        return cost + sum(int(self._payload[self.args[n][0]].cost) for n in elements)

    def degree(self, node: int, names: Collection[str]) -> Degrees | None:
        """Return the degrees of the terms of `node` as a polynomial in `names`.

        They are bounds, since terms that cancel are counted. None if `node` is not a
        polynomial, or is not recognised as one.
        """
        return self.degrees([node], names)[0]

    def degrees(
        self, nodes: Iterable[int], names: Collection[str]
    ) -> list[Degrees | None]:
        """Return the degrees of several nodes as polynomials in `names`.

        See `degree`.
        """
        nodes = list(nodes)
        found = self.degrees_below(nodes, names)
        return [found.get(n, FLAT) for n in nodes]

    def degrees_below(
        self, nodes: Iterable[int], names: Collection[str]
    ) -> dict[int, Degrees | None]:
        """Return, by node, the degrees of nodes below `nodes` that depend on `names`.

        The node of the number 0 is included. See `degree`.
        """
        one = Degrees(1, 1)
        found: dict[int, Degrees | None] = {self.zero: NOTHING}
        for n in sorted(self.dependent(nodes, names)):
            args = self.args[n]
            exponent = self.value(args[-1]) if self.ops[n] == "pow" else None
            below = [found.get(a, FLAT) for a in args]
            found[n] = _degrees_of(self.ops[n], exponent, *below) if args else one
        return found

    def substitute(self, nodes: Iterable[int], new: Mapping[int, int]) -> list[int]:
        """Return `nodes` with some nodes replaced by others, below `nodes` as well.

        new : node -> node that replaces it.
        """
        nodes = list(nodes)
        done: dict[int, int] = {}  # nodes whose replacement differs from themselves
        cone = self.cone(nodes, range(min(new, default=len(self))))
        for n in cone if not new.keys().isdisjoint(cone) else ():
            if n in new:
                made = new[n]
            elif done.keys().isdisjoint(self.args[n]):
                continue
            else:
                made = self.call(self.ops[n], *(done.get(a, a) for a in self.args[n]))
            if made != n:
                done[n] = made
        return [done.get(n, n) for n in nodes]


def memoized(
    function: Callable[Concatenate[Graph, Given], Found],
) -> Callable[Concatenate[Graph, Given], Found]:
    """Memoize a function of a graph and further hashable arguments.

    Nodes never change: models that differ only in the values of their parameters share
    the results, which callers must not modify.
    """

    @wraps(function)
    def known(g: Graph, /, *args: Given.args, **keywords: Given.kwargs) -> Found:
        key = (function, args, tuple(keywords.items()))
        return memoize(g, key, lambda: function(g, *args, **keywords))

    return known


def memoize(g: Graph, key: object, find: Callable[[], Found]) -> Found:
    """Return the memoized result of `key`, computed by `find` on first use."""
    if key not in g.memoized:
        g.memoized[key] = find()
    found: Found = g.memoized[key]
    return found
