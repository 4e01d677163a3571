"""What could push each coordinate: the scale of what is held, or balanced, at rest.

What rests has no motion to be measured by, and rounding is no measure of rounding. What
its forces could do to it, each by itself, is one: step control, switches, contacts,
error estimates and the verdict on a run all take it from here.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from lagsim.language.rounding import addends

if TYPE_CHECKING:
    from lagsim.mechanics.equations import Equations


def pushes(e: Equations) -> list[int]:
    """Give how large the terms are that each force, and each other rate, sums."""
    g = e.graph
    rates = (*e.f, *e.quadrature_rates)
    unsolved = g.dependent(rates, (*e.multipliers, *e.accelerations))
    return [
        g.sum(g.call("abs", n) for n in addends(g, rate) if n not in unsolved)
        for rate in rates
    ]
