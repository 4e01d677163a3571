"""A state, and how equations stand at it: what a plan is made from."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from lagsim.admissibility.inertia import needs_constraints
from lagsim.admissibility.point import Point
from lagsim.admissibility.rank import analyse
from lagsim.mechanics.instant import Instant

if TYPE_CHECKING:
    from lagsim.admissibility.rank import RankReport
    from lagsim.mechanics.equations import Equations


@dataclass(frozen=True, slots=True)
class Start(Instant):
    """A state, which rows depend on others there, and whether M needs them.

    Attributes
    ----------
    augmented : bool
        M alone is singular, but with the constraints every acceleration is determined.
    """

    ranks: RankReport
    augmented: bool


def start_at(equations: Equations, state: Instant) -> Start:
    """Look at equations at a state that meets their constraints."""
    q, v = state.q, state.v
    point = Point(equations, state.t)
    errors = point.solved_errors(q, v)
    ranks = analyse(point, q, v, errors)
    return Start(state.t, q, v, ranks, needs_constraints(point, q, v, errors))
