"""Functions that may sleep: flat to rounding almost everywhere, awake on a short way.

A method sees what its stages or its series see. What hides between them is flat there
to the last digit: an exponential (and all that is made of it), a large power, the
inverse of something that nearly vanishes. Whether such a function wakes is told by its
argument, which moves no faster than the motion does: where the argument of `exp` is
largest, that of `tanh` passes zero, a denominator is least. These arguments are what
the steps are looked through for, see `methods._looks`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from lagsim.expressions.derivatives import tangent
from lagsim.methods._looks import LARGE, LARGEST, NEAR_ZERO, SMALL

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from lagsim.equations import Equations
    from lagsim.expressions.graph import Graph

# Powers from this on are flat enough to hide: a wall.
TALL = 6.0


class Sleeper(NamedTuple):
    """An argument, which way it wakes a function, and the function's power."""

    node: int
    kind: float
    power: float


def motion_nodes(equations: Equations) -> list[int]:
    """Give all that the motion depends on."""
    e = equations
    nodes = [*e.mass_entries.values(), *e.f, *(x.rate for x in e.quadratures)]
    nodes += [] if e.power is None else [e.power]
    for row in e.rows:
        nodes += [row.residual, row.rate, row.b, *row.A.entries.values()]
    return nodes


def state_sleepers(equations: Equations, nodes: Sequence[int]) -> list[Sleeper]:
    """Give the arguments that depend on the state; `nodes` as they are in an arc."""
    g = equations.graph
    return _found(g, nodes, g.dependent(nodes, (*equations.q, *equations.velocities)))


def timed_sleepers(equations: Equations, nodes: Sequence[int]) -> list[Sleeper]:
    """Give the arguments that depend on t and on nothing that moves."""
    e, g = equations, equations.graph
    moving = (*e.q, *e.velocities, *e.accelerations, *e.multipliers, "work")
    timed = g.dependent(nodes, ("t",)) - g.dependent(nodes, moving)
    return _found(g, nodes, timed)


def signal_nodes(equations: Equations, sleepers: Sequence[Sleeper]) -> list[int]:
    """Give the arguments, then their rates along the motion, with q'' as `slope` says.

    One number each, with the names of `slope` for q''.
    """
    e, g = equations, equations.graph
    nodes = [x.node for x in sleepers]
    flow = {g.variable("t"): g.one}
    flow |= {g.variable(q): g.variable(v) for q, v in zip(e.q, e.velocities, strict=True)}
    flow |= {g.variable(v): g.variable(slope(v)) for v in e.velocities}
    return [*nodes, *tangent(g, nodes, flow)]


def slope(velocity: str) -> str:
    """Give the name that the rate of a velocity has where arguments are watched."""
    return f"{velocity}'"


def _found(g: Graph, nodes: Iterable[int], those: set[int]) -> list[Sleeper]:
    found: dict[Sleeper, None] = {}
    for n in g.cone(nodes):
        if n in those:
            found |= dict.fromkeys(x for x in _of(g, n) if x.node in those)
    return list(found)


def _of(g: Graph, n: int) -> list[Sleeper]:
    """Give the arguments that could wake the node `n`."""
    op, args = g.ops[n], g.args[n]
    if op == "exp":
        # Where it is largest; beside 1, as in 1/(1 + exp(u)), where u passes zero.
        return [Sleeper(args[0], LARGEST, 1.0), Sleeper(args[0], NEAR_ZERO, 1.0)]
    if op in ("cosh", "sinh"):
        other = g.call("neg", args[0])
        return [
            Sleeper(args[0], LARGEST, 1.0), Sleeper(other, LARGEST, 1.0),
            Sleeper(args[0], NEAR_ZERO, 1.0),
        ]  # fmt: skip
    if op in ("tanh", "atan"):
        return [Sleeper(args[0], NEAR_ZERO, 1.0)]
    if op in ("sqrt", "log"):
        return [Sleeper(args[0], SMALL, 1.0)]
    if op == "div":
        return [Sleeper(args[1], SMALL, 1.0)]
    power = g.value(args[1]) if op == "pow" else None
    if power is None:
        return []
    if power < 0.0 or power != int(power):
        return [Sleeper(args[0], SMALL, max(-power, 1.0))]
    return [Sleeper(args[0], LARGE, power)] if power >= TALL else []
