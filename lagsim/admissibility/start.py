"""A state, and how equations stand at it: what a plan is made from."""

from __future__ import annotations

from typing import TYPE_CHECKING

from lagsim.admissibility.inertia import needs_constraints
from lagsim.admissibility.point import Point
from lagsim.admissibility.rank import analyse
from lagsim.admissibility.report import Start

if TYPE_CHECKING:
    from lagsim.mechanics.equations import Equations
    from lagsim.mechanics.instant import Instant


def start_at(equations: Equations, state: Instant) -> Start:
    """Look at equations at a state that meets their constraints."""
    q, v = state.q, state.v
    point = Point(equations, state.t)
    errors = point.solved_errors(q, v)
    ranks = analyse(point, q, v, errors)
    return Start(state.t, q, v, ranks, needs_constraints(point, q, v, errors))
