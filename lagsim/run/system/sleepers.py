"""Functions that may sleep: flat to rounding almost everywhere, awake on a short way.

A method sees what its stages or its series see. What hides between them is flat there
to the last digit: an exponential (and all that is made of it), a large power, the
inverse of something that nearly vanishes. Whether such a function wakes is told by its
argument, which moves no faster than the motion does: where the argument of `exp` is
largest, that of `tanh` passes zero, a denominator is least. These arguments are what
the steps are looked through for, see `methods._looks`.
"""

from __future__ import annotations

import math
from itertools import chain
from typing import TYPE_CHECKING, NamedTuple

from lagsim.language.derivatives import tangent
from lagsim.language.evaluate import evaluate
from lagsim.language.graph import once, remembered
from lagsim.methods.parts.missed import LARGE, LARGEST, NEAR_ZERO, SMALL

if TYPE_CHECKING:
    from collections.abc import Sequence

    from lagsim.language.graph import Graph
    from lagsim.mechanics.equations import Equations

# Powers from this on are flat enough to hide: a wall.
TALL = 6.0
# What may sleep, or lets what it is made with sleep: a scene without any has nothing to
# look for.
DROWSY = frozenset(
    ("exp", "cosh", "sinh", "tanh", "atan", "sqrt", "log", "pow", "div")
)  # fmt: skip
# What a product may sleep by.
FLAT = frozenset(("exp", "pow"))
# Products of more factors are not taken apart.
MOST_FACTORS = 64


class Sleeper(NamedTuple):
    """An argument, which way it wakes a function, and the function's power."""

    node: int
    kind: float
    power: float


def motion_nodes(equations: Equations) -> list[int]:
    """Give all that the motion depends on."""
    e = equations
    nodes = [*e.mass_nodes, *e.f, *e.quadrature_rates]
    for row in (*e.rows, *(law.row for law in e.laws)):
        nodes += [row.residual, row.rate, row.b, *row.A.entries.values()]
    for law in e.laws:
        nodes += [law.bound, law.static]
    return nodes


def all_sleepers(
    equations: Equations, nodes: Sequence[int], ends: Sequence[int]
) -> list[Sleeper]:
    """Give the arguments that steps are looked through for.

    Of what the motion depends on, `nodes` as they are in an arc, those that depend on
    the state; of what ends an arc, `ends`, those that depend on t alone too.
    """
    key = all_sleepers, *_resting_on(equations, tuple(nodes), tuple(ends))
    return once(equations.graph, key, lambda: _all_sleepers(equations, nodes, ends))


def _resting_on(equations: Equations, *nodes: tuple[int, ...]) -> tuple[object, ...]:
    """Give what it rests on which of `nodes` sleep: they, and values of exponents."""
    exponents = _exponents(equations.graph, *nodes)
    values = {p.name: p.value for p in equations.model.parameters} if exponents else {}
    return equations.q, nodes, tuple(values.get(name) for name in exponents)


def names_in_exponents(equations: Equations, ends: Sequence[int]) -> frozenset[str]:
    """Give the names on whose values it rests what sleeps."""
    nodes = tuple(motion_nodes(equations))
    return frozenset(_exponents(equations.graph, nodes, tuple(ends)))


@remembered
def _exponents(g: Graph, *nodes: tuple[int, ...]) -> list[str]:
    """Give the names in exponents: on their values it rests what sleeps."""
    powers = [n for n in g.cone(chain(*nodes)) if g.ops[n] == "pow"]
    return sorted(g.depends(g.args[n][1] for n in powers))


def _all_sleepers(
    equations: Equations, nodes: Sequence[int], ends: Sequence[int]
) -> list[Sleeper]:
    g = equations.graph
    state = (*equations.q, *equations.velocities)
    found = _Search(equations, nodes).among(g.dependent(nodes, state))
    found += _Search(equations, ends).among(g.dependent(ends, (*state, "t")))
    return list(dict.fromkeys(found))


def timed_sleepers(equations: Equations, nodes: Sequence[int]) -> list[Sleeper]:
    """Give the arguments that depend on t and on nothing that moves."""
    e, g = equations, equations.graph
    if "t" not in g.depends(nodes):
        return []
    works = (x.name for x in e.works)
    moving = (*e.q, *e.velocities, *e.accelerations, *e.multipliers, *works)
    timed = g.dependent(nodes, ("t",)) - g.dependent(nodes, moving)
    return _Search(equations, nodes).among(timed)


def timed(equations: Equations) -> bool:
    """Tell whether anything depends on t and may sleep."""
    nodes = motion_nodes(equations)
    key = timed, *_resting_on(equations, tuple(nodes))
    return once(equations.graph, key, lambda: bool(timed_sleepers(equations, nodes)))


def signal_nodes(equations: Equations, sleepers: Sequence[Sleeper]) -> list[int]:
    """Give the arguments, then their rates along the motion, with q'' as `slope` says.

    One number each, with the names of `slope` for q''.
    """
    e, g = equations, equations.graph
    nodes = [x.node for x in sleepers]
    flow = {g.variable("t"): g.one}
    flow |= {
        g.variable(q): g.variable(v) for q, v in zip(e.q, e.velocities, strict=True)
    }
    flow |= {g.variable(v): g.variable(slope(v)) for v in e.velocities}
    return [*nodes, *tangent(g, nodes, flow)]


def slope(velocity: str) -> str:
    """Give the name that the rate of a velocity has where arguments are watched."""
    return f"{velocity}'"


class _Search:
    """Finds the arguments of all that may sleep below some nodes."""

    def __init__(self, equations: Equations, nodes: Sequence[int]) -> None:
        g = self.g = equations.graph
        self.cone = g.cone(nodes)
        self.ops = {g.ops[n] for n in self.cone}
        moves = (*equations.q, *equations.velocities, "t")
        moves = (*moves, *equations.accelerations, *equations.multipliers)
        moves = (*moves, *(x.name for x in equations.works))
        self.moving = g.dependent(nodes, moves)
        self.values = {p.name: p.value for p in equations.model.parameters}

    def among(self, those: set[int]) -> list[Sleeper]:
        """Give what may wake a node of `those`, with arguments among them too."""
        found: dict[Sleeper, None] = {}
        for n in self.cone if self.ops & DROWSY else ():
            if n in those:
                found |= dict.fromkeys(self._of(n, those))
        return list(found)

    def _of(self, n: int, those: set[int]) -> list[Sleeper]:
        """Give the arguments that could wake the node `n`."""
        g, op, args = self.g, self.g.ops[n], self.g.args[n]
        if op in ("mul", "div"):
            found = self._product(n) if self.ops & FLAT else []
            # A root in a denominator is watched itself.
            watched = op == "div" and args[1] in those and g.ops[args[1]] != "sqrt"
            if watched and not _never_small(g, args[1]):
                found.append(Sleeper(args[1], SMALL, 1.0))
            return found
        if op in ("add", "sub"):
            return self._sum(args) if "exp" in self.ops else []
        if not args or args[0] not in those:
            return []
        if op == "exp":
            return [Sleeper(args[0], LARGEST, 1.0)]
        if op in ("cosh", "sinh"):
            return [
                Sleeper(args[0], LARGEST, 1.0),
                Sleeper(g.call("neg", args[0]), LARGEST, 1.0),
                Sleeper(args[0], NEAR_ZERO, 1.0),
            ]
        if op in ("tanh", "atan"):
            return [Sleeper(args[0], NEAR_ZERO, 1.0)]
        if op in ("sqrt", "log"):
            return [Sleeper(args[0], SMALL, 1.0)]
        return self._power(n) if op == "pow" else []

    def _power(self, n: int) -> list[Sleeper]:
        base, exponent = self.g.args[n]
        if exponent in self.moving:
            return []
        power = self._value(exponent)
        if power < 0.0 or power != int(power):
            return [Sleeper(base, SMALL, max(-power, 1.0))]
        return [Sleeper(base, LARGE, power)] if power >= TALL else []

    def _value(self, n: int) -> float:
        """Give the value of a node that does not move; 0 where it is not known."""
        if not self.g.depends([n]) <= self.values.keys():
            return 0.0
        (found,) = evaluate(self.g, [n], self.values)
        return float(found) if math.isfinite(found) else 0.0

    def _product(self, n: int) -> list[Sleeper]:
        """Give the argument of a product's factors: they wake it together."""
        terms = self._exponents(n)
        if not terms:
            return []
        return [Sleeper(self.g.sum(terms), LARGEST, 1.0)]

    def _exponents(self, n: int) -> list[int] | None:
        """Give the exponents of the factors of `n` that sleep; None for too many."""
        g, below = self.g, [(n, False)]
        found: list[int] = []
        for _ in range(MOST_FACTORS):
            if not below:
                return found
            n, inverse = below.pop()
            op, args = g.ops[n], g.args[n]
            if n not in self.moving:
                continue
            if op in ("mul", "div"):
                below += [(args[0], inverse), (args[1], inverse != (op == "div"))]
            elif op == "neg":
                below.append((args[0], inverse))
            elif op == "exp":
                found.append(g.call("neg", args[0]) if inverse else args[0])
            elif op == "pow" and self._tall(args[1]):
                size = g.call("log", g.call("abs", args[0]))
                size = g.call("mul", args[1], size)
                found.append(g.call("neg", size) if inverse else size)
        return None

    def _tall(self, exponent: int) -> bool:
        """Tell whether a power is one that a product may sleep by."""
        return exponent not in self.moving and abs(self._value(exponent)) >= TALL

    def _sum(self, args: Sequence[int]) -> list[Sleeper]:
        """Give where two exponentials, or one and a constant, are of one size."""
        first, second = (self._logarithm(n) for n in args)
        if first is None or second is None:
            return []
        difference = self.g.call("sub", first, second)
        if self.g.value(difference) is not None:
            return []
        return [Sleeper(difference, NEAR_ZERO, 1.0)]

    def _logarithm(self, n: int) -> int | None:
        """Give the logarithm of the size of a product of exponentials and constants."""
        g = self.g
        if n not in self.moving:
            return g.call("log", g.call("abs", n)) if n != g.zero else None
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
    """Tell whether a node is a positive number at least, made larger by exp or cosh."""
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
