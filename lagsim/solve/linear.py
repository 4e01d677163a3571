"""The equations of motion of a linear scene as matrices: exact, from the graph."""

from __future__ import annotations

from typing import TYPE_CHECKING

from lagsim.language.derivatives import gradient
from lagsim.solve.series import motion_rates

if TYPE_CHECKING:
    from collections.abc import Sequence

    from lagsim.mechanics.equations import Equations
    from lagsim.mechanics.ldl import Elimination

Entry = tuple[int, int, int]  # row, column, node


def linear_form(equations: Equations, elimination: Elimination) -> list[int]:
    """Give A of z' = A z and P of each power = z^T P z, where z = (q, q', 1).

    Of each: how many entries are not zero, then i, j and the value of each of them.
    For scenes whose `Structure` is linear and time-invariant.
    """
    g = equations.graph
    state = [g.variable(name) for name in (*equations.q, *equations.velocities)]
    rates = motion_rates(equations, elimination)
    size = len(state)
    A = [
        (i, j, node)
        for i, rate in enumerate(rates[:size])
        for j, node in enumerate(_affine(equations, rate, state))
    ]
    written = _written(equations, A)
    for power in rates[size:]:
        slopes = gradient(g, power, state)
        at_rest = g.substitute([power, *slopes], dict.fromkeys(state, g.zero))
        half = g.constant(0.5)
        P = [(size, size, at_rest[0])]
        for i, slope in enumerate(slopes):
            *row, _ = _affine(equations, slope, state)
            P += [(i, j, g.call("mul", half, node)) for j, node in enumerate(row)]
            linear = g.call("mul", half, at_rest[1 + i])
            P += [(i, size, linear), (size, i, linear)]
        written += _written(equations, P)
    return written


def _affine(equations: Equations, node: int, state: Sequence[int]) -> list[int]:
    """Give the slopes of an affine expression, and its value at zero."""
    g = equations.graph
    at_zero = g.substitute([node], dict.fromkeys(state, g.zero))
    return [*gradient(g, node, state), *at_zero]


def _written(equations: Equations, entries: Sequence[Entry]) -> list[int]:
    g = equations.graph
    full = [entry for entry in entries if entry[2] != g.zero]
    written = [g.constant(len(full))]
    for i, j, node in full:
        written += [g.constant(i), g.constant(j), node]
    return written
