"""The switches of a model's motion."""

from __future__ import annotations

from typing import TYPE_CHECKING

from lagsim.language.graph import remembered
from lagsim.mechanics.switches.find import Switches, find_switches

if TYPE_CHECKING:
    from lagsim.mechanics.equations import Equations


def model_switches(equations: Equations, *, located: bool = True) -> Switches:
    """Find the switches of the equations of motion.

    Those of the state that only stand in outputs or in an energy without a slope make
    no difference to the motion. Those of time alone count where others are not located.
    """
    e = equations
    dynamics = [*e.mass_nodes, *e.f, *e.quadrature_rates]
    for law in e.laws:
        dynamics += [law.bound, law.static]
        dynamics += [] if law.when is None else [law.when]
    for row in (*e.rows, *(law.row for law in e.laws)):
        dynamics += [
            row.residual,
            row.rate,
            *row.A.entries.values(),
            row.b,
            row.transport,
        ]
    state = [*e.q, *e.velocities]
    works = (x.name for x in e.works)
    moving = (*state, *works, *e.accelerations, *e.multipliers)
    sided = tuple(dynamics) if located else ()
    return _found(e.graph, (*dynamics, e.energy), moving, sided, e.velocities)


_found = remembered(find_switches)
