"""Relations that hold as a multiple root: what they set to zero, once.

Where (x - y)^2 = 0 holds, its gradient vanishes, and no multiplier keeps a motion
there. The same set is that of x - y = 0.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Collection

    from lagsim.language.graph import Graph

# sqrt(e) and cbrt(e) vanish with e, where their slopes are infinite.
_ROOTS = {"sqrt": 1.0 / 2.0, "cbrt": 1.0 / 3.0}


def simple_root(g: Graph, node: int, moving: Collection[str]) -> int:
    """Give a node that vanishes where `node` does, with each factor once.

    `node` itself where no factor that depends on `moving` is repeated, or raised to a
    power, or inside `abs`.
    """
    still, powers, kinked = _factors(g, node, g.dependent([node], moving))
    if not kinked and all(power == 1.0 for power in powers.values()):
        return node
    product = g.one
    for factor in (*still, *powers):
        product = g.call("mul", product, factor)
    return product


def _factors(
    g: Graph, node: int, moves: set[int]
) -> tuple[list[int], dict[int, float], bool]:
    """Give the factors that do not move, the powers of those that do; any `abs`."""
    still: list[int] = []
    powers: dict[int, float] = {}
    kinked = False
    stack = [(node, 1.0)]
    while stack:
        n, power = stack.pop()
        op, args = g.ops[n], g.args[n]
        exponent = g.value(args[1]) if op == "pow" else _ROOTS.get(op)
        if n not in moves:
            still.append(n)
        elif op in ("neg", "abs"):
            kinked |= op == "abs"
            stack.append((args[0], power))
        elif op == "mul":
            stack += [(a, power) for a in reversed(args)]
        elif op == "div" and args[1] not in moves:
            still.append(g.call("div", g.one, args[1]))
            stack.append((args[0], power))
        elif exponent is not None and exponent > 0.0:
            stack.append((args[0], power * exponent))
        else:
            powers[n] = powers.get(n, 0.0) + power
    return still, powers, kinked
