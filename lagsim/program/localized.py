"""Localized terms of the equations, and the activity indicators that locate them.

A method samples the equations at its stages only. A term that is 0 to the last digit at
all samples is missed: an exponential and functions derived from it, a large power, the
inverse of a function that nearly vanishes. Whether such a term is active is shown by
its argument, which varies as slowly as the motion: `exp` is active where its argument
is largest, `tanh` where its argument passes zero, a quotient where its denominator is
smallest. Steps are searched for these points, see `methods.parts.missed`.
"""

from __future__ import annotations

import math
from functools import cached_property
from itertools import chain
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lagsim.language.elements import payload, sums
from lagsim.language.evaluate import evaluate
from lagsim.language.functions import ELEMENTS, JOINING, OPERATIONS, STEPS
from lagsim.language.graph import memoize, memoized
from lagsim.mechanics.surfaces import WHOLE, surfaces
from lagsim.methods.parts.search_table import FALLING, LARGE, LARGEST, NEAR_ZERO, SMALL
from lagsim.tolerances import TINY

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping, Sequence

    from lagsim.language.graph import Graph
    from lagsim.mechanics.equations import Equations

# Least exponent of a power that counts as localized: a steep wall.
TALL = 6.0
# Values of the argument at which each function is active.
ACTS_WHERE = {
    "exp": (LARGEST,), "cosh": (NEAR_ZERO,), "sinh": (NEAR_ZERO,), "tanh": (NEAR_ZERO,),
    "atan": (NEAR_ZERO,), "sqrt": (SMALL,), "log": (SMALL,),
}  # fmt: skip
# A scene without any of these has no localized terms.
MAY_BE_LOCALIZED = frozenset((*ACTS_WHERE, "pow", "div", ELEMENTS))
# A smooth table in a condition with more points than MANY_POINTS is searched without
# regard to its points, as other smooth functions are, if it has at most MANY_TURNS
# maxima and minima.
MANY_POINTS, MANY_TURNS = 256.0, 64
# Products of more factors are not decomposed.
MOST_FACTORS = 64


class Indicator(NamedTuple):
    """Activity indicator of a localized term.

    Attributes
    ----------
    node : int
        An argument of the term.
    kind : float
        Code of the values of the argument at which the term is active, such as LARGEST
        or NEAR_ZERO, see `ACTS_WHERE`.
    power : float
        Exponent of a power of the argument.
    members : int
        Number of terms: for a term of elements, their number of members; `node` is then
        the vector of the arguments of all members.
    """

    node: int
    kind: float
    power: float = 1.0
    members: int = 1


def indicators(
    equations: Equations,
    nodes: Sequence[int],
    ends: Sequence[int],
    held: Mapping[int, int] | None = None,
) -> list[Indicator]:
    """Return the indicators for which steps are searched.

    Parameters
    ----------
    nodes : sequence of int
        Expressions on which the motion depends, with the modes of an arc.
    ends : sequence of int
        Expressions that end an arc.
    held : mapping of int to int
        For nodes of steps, such as `sign(u)`, the node of a condition that is true
        while the motion stays at the level of the step.

    Examples
    --------
    A pulse is active where the argument of its exponential is largest:

    >>> from lagsim.mechanics.derivation import derive
    >>> from lagsim.model.reader import read
    >>> text = '''
    ... coordinates: {x: {}}
    ... energy: {kinetic: x_dot^2/2, potential: 0}
    ... forces: {x: "exp(-(t - 5)^2/1e-6)"}
    ... initial: {x: 0, x_dot: 0}
    ... simulation: {duration: 10}
    ... '''
    >>> equations = derive(read(text, "pulse.yaml"))
    >>> [pulse] = indicators(equations, equations.of_motion, [])
    >>> pulse.kind == LARGEST, sorted(equations.graph.depends([pulse.node]))
    (True, ['t'])
    """
    g, names, levels = equations.graph, (*equations.state, "t"), held or {}

    def found() -> list[Indicator]:
        moves = (*_moves(equations), "t")
        values = {p.name: p.value for p in equations.model.parameters}
        result = _IndicatorSearch(g, nodes, moves, values).among(names)
        result += _IndicatorSearch(g, ends, moves, values).among(names)
        result += _steps(g, ends, frozenset(names), levels)
        return list(dict.fromkeys(result))

    key = (*_key(equations, tuple(nodes), tuple(ends)), tuple(levels.items()))
    return memoize(g, (indicators, *key), found)


def _steps(
    g: Graph, nodes: Sequence[int], names: frozenset[str], held: Mapping[int, int]
) -> list[Indicator]:
    """Return two indicators, for u and -u, of each argument u of a switch in `nodes`.

    A switch is a function with a jump or a kink, such as a linear table; arguments that
    do not depend on the variables `names`, of the state and t, are left out. While the
    motion stays at the level of a switch, its argument counts as far from the level,
    since its sign is rounding.

    held : see `indicators`.
    """
    found: list[Indicator] = []
    cone = g.cone(nodes)
    calm = {g.args[n][-1] for n in cone if g.ops[n] == "table.piece" and _is_calm(g, n)}
    for n in cone:
        op, row = g.ops[n], OPERATIONS.get(g.ops[n])
        if row is None or op in JOINING:
            continue
        plain = row.condition or op in STEPS
        if not plain and not row.decided_by:
            continue
        for surface in surfaces(g, n if plain else g.call(row.decided_by, *g.args[n])):
            u = surface.node
            if g.depends([u]).isdisjoint(names) or surface.discrete in calm:
                continue
            if surface.op in WHOLE:
                u = g.call("sin", g.call("mul", g.constant(math.pi), u))
            both = u, g.call("neg", u)
            if surface.discrete in held:
                on = held[surface.discrete]
                both = (
                    g.call("if", on, g.one, both[0]),
                    g.call("if", on, g.one, both[1]),
                )
            found += [Indicator(x, FALLING) for x in both]
    return list(dict.fromkeys(found))


def has_switches(g: Graph, node: int, names: frozenset[str]) -> bool:
    """Whether an expression has a switch whose argument depends on variables `names`.

    A switch is a function with a jump or a kink, see `_steps`.
    """
    return bool(_steps(g, [node], names, {}))


def _is_calm(g: Graph, piece: int) -> bool:
    """Whether a smooth table of many points has few maxima and minima.

    piece : the node of the table's value.
    """
    axis, pieces = (g.payload(n).numbers for n in g.args[piece][:2])
    if axis[1] == 0.0 or axis[0] <= MANY_POINTS:
        return False
    rises = np.diff(pieces[1 :: int(pieces[0])]) > 0.0
    return int(np.count_nonzero(rises[1:] != rises[:-1])) <= MANY_TURNS


def _moves(e: Equations) -> tuple[str, ...]:
    """Return the names of all variables except t that vary in time."""
    works = (x.name for x in e.works)
    return (*e.state, *e.accelerations, *e.multipliers, *works)


def _key(equations: Equations, *nodes: tuple[int, ...]) -> tuple[object, ...]:
    """Return the cache key of the indicators of `nodes`: nodes and values in exponents.

    The values of parameters in exponents decide whether a power is localized.
    """
    exponents = _exponents(equations.graph, *nodes)
    values = {p.name: p.value for p in equations.model.parameters} if exponents else {}
    return equations.q, nodes, tuple(values.get(name) for name in exponents)


def names_in_exponents(equations: Equations, ends: Sequence[int]) -> frozenset[str]:
    """Return the names of parameters in exponents of the equations and of `ends`.

    A power is a localized term if its exponent is large: other values of these
    parameters may need other activity indicators.

    ends : expressions (nodes) whose zeros end an arc.
    """
    nodes = tuple(equations.of_motion)
    return frozenset(_exponents(equations.graph, nodes, tuple(ends)))


@memoized
def _exponents(g: Graph, *nodes: tuple[int, ...]) -> list[str]:
    """Return the names of parameters in the exponents of powers in `nodes`, sorted."""
    powers = {n for n in g.of(("pow",)) if g.value(g.args[n][1]) is None}
    powers = powers.intersection(g.cone(chain(*nodes)) if powers else ())
    return sorted(g.depends(g.args[n][1] for n in powers))


class _IndicatorSearch:
    """Search for the indicators of all localized terms in some expressions.

    Parameters
    ----------
    g, nodes
        The graph, and the expressions.
    moves : collection of str
        The names of the variables that vary in time.
    values : mapping of str to float
        The values of the parameters, on which exponents may depend.
    """

    def __init__(
        self,
        g: Graph,
        nodes: Sequence[int],
        moves: Collection[str],
        values: Mapping[str, float],
    ) -> None:
        self.g, self.moves, self.values = g, moves, values
        self.nodes, self.cone = nodes, g.cone(nodes)
        self.ops = {g.ops[n] for n in self.cone}

    @cached_property
    def moving(self) -> set[int]:
        """Set of nodes that depend on variables that vary in time."""
        return self.g.dependent(self.nodes, self.moves)

    def among(self, names: Collection[str]) -> list[Indicator]:
        """Return the indicators of terms that depend on variables in `names`."""
        if not self.ops & MAY_BE_LOCALIZED:
            return []
        varying = self.g.dependent(self.nodes, names)
        found: dict[Indicator, None] = {}
        for n in self.cone:
            if n in varying:
                found |= dict.fromkeys(self._of(n, varying))
        return list(found)

    def _of(self, n: int, varying: set[int]) -> list[Indicator]:
        """Return the indicators of node n, for its arguments in `varying`.

        varying : the nodes that depend on the variables of the search.
        """
        g, op, args = self.g, self.g.ops[n], self.g.args[n]
        if op in ("mul", "div"):
            found = self._product(n) if self.ops & {"exp", "pow"} else []
            # A root has an indicator of its own.
            watched = op == "div" and args[1] in varying and g.ops[args[1]] != "sqrt"
            if watched and not _never_small(g, args[1]):
                found.append(Indicator(args[1], SMALL))
            return found
        if op in ("add", "sub"):
            return self._sum(args) if "exp" in self.ops else []
        if op == ELEMENTS:
            return self._members(n, varying)
        if not args or args[0] not in varying:
            return []
        if op == "pow":
            return self._power(n)
        found = []
        if op in ("cosh", "sinh"):
            found = [Indicator(x, LARGEST) for x in (args[0], g.call("neg", args[0]))]
        return found + [Indicator(args[0], kind) for kind in ACTS_WHERE.get(op, ())]

    def _members(self, n: int, varying: set[int]) -> list[Indicator]:
        """Return the indicators of localized terms in elements, each for all members.

        n : the node of the elements.
        varying : see `_of`.
        """
        g, of, args = self.g, payload(self.g, n), self.g.args[n][1:]
        changing = frozenset(k for k, a in enumerate(args) if a in varying)
        own = [x for x in of.slots if of.reads(x, changing)]
        names = [str(of.graph.payload(x.node)) for x in own]
        found = _IndicatorSearch(
            of.graph, [o.node for o in of.outputs], names, {}
        ).among(names)
        return [
            x._replace(node=sums(g, of.listed(x.node), args), members=of.members)
            for x in found
        ]

    def _power(self, n: int) -> list[Indicator]:
        base, exponent = self.g.args[n]
        if exponent in self.moving:
            return []
        power = self._value(exponent)
        if power < 0.0 or power != int(power):
            return [Indicator(base, SMALL, max(-power, 1.0))]
        return [Indicator(base, LARGE, power)] if power >= TALL else []

    def _value(self, n: int) -> float:
        """Return the value of node n; 0 if n varies in time or is not finite."""
        if not self.g.depends([n]) <= self.values.keys():
            return 0.0
        (found,) = evaluate(self.g, [n], self.values)
        return float(found) if math.isfinite(found) else 0.0

    def _product(self, n: int) -> list[Indicator]:
        """Return [indicator] for a product with factors exp or large powers; else [].

        The argument of the indicator is the sum of the factors' logarithms.
        """
        g, below = self.g, [(n, False)]
        terms: list[int] = []
        for _ in range(MOST_FACTORS):
            if not below:
                return [Indicator(g.sum(terms), LARGEST)] if terms else []
            n, inverse = below.pop()
            op, args = g.ops[n], g.args[n]
            if n not in self.moving:
                continue
            if op in ("mul", "div"):
                below += [(args[0], inverse), (args[1], inverse != (op == "div"))]
            elif op == "neg":
                below.append((args[0], inverse))
            elif op == "exp":
                terms.append(g.call("neg", args[0]) if inverse else args[0])
            elif (
                op == "pow"
                and args[1] not in self.moving
                and abs(self._value(args[1])) >= TALL
            ):
                size = g.call("log", g.call("abs", args[0]))
                size = g.call("mul", args[1], size)
                terms.append(g.call("neg", size) if inverse else size)
        return []

    def _sum(self, args: Sequence[int]) -> list[Indicator]:
        """Return a list with the indicator of the zeros of a sum of two nodes `args`.

        Each node is an exponential or a constant; for other nodes the list is empty.
        The argument of the indicator is the difference of the logarithms of |node|.
        """
        first, second = (self._logarithm(n) for n in args)
        if first is None or second is None:
            return []
        difference = self.g.call("sub", first, second)
        if self.g.value(difference) is not None:
            return []
        return [Indicator(difference, NEAR_ZERO)]

    def _logarithm(self, n: int) -> int | None:
        """Return the node of log |n|, or None.

        None unless n is an exponential, a constant, or a product or quotient of these.
        """
        g = self.g
        if n not in self.moving:
            if n == g.zero:
                return None
            # A parameter or a mode may be 0 as well.
            size = g.call("add", g.call("abs", n), g.constant(TINY))
            return g.call("log", size)
        op, args = g.ops[n], g.args[n]
        if op == "exp":
            return args[0]
        if op == "neg":
            return self._logarithm(args[0])
        if op not in ("mul", "div"):
            return None
        first, second = (self._logarithm(a) for a in args)
        if first is None or second is None:
            return None
        return g.call("add" if op == "mul" else "sub", first, second)


def _never_small(g: Graph, n: int) -> bool:
    """Whether a node is bounded from below by a positive number, as 1 + exp(x) is."""
    op, args = g.ops[n], g.args[n]
    value = g.value(n)
    if value is not None:
        return value > 0.0
    if op == "add":
        least = [_never_small(g, a) for a in args]
        return any(least) and all(
            m or g.ops[a] == "exp" for m, a in zip(least, args, strict=True)
        )
    if op == "pow":
        power = g.value(args[1])
        return power is not None and power > 0.0 and _never_small(g, args[0])
    return op == "cosh" or (op == "mul" and all(_never_small(g, a) for a in args))
