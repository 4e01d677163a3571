"""Rank of equality constraints at a state where the residual has a kink.

At a kink, as of `abs(u)` at u = 0, the rows of both branches are in force unless the
equations of one branch lead away from it.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from lagsim.admissibility.point import Point
from lagsim.admissibility.verdict import CAUTION, accelerations
from lagsim.mechanics.constraints import constraint_row
from lagsim.mechanics.pieces import kinks
from lagsim.tolerances import RESIDUAL_ROUNDOFF

if TYPE_CHECKING:
    from lagsim.language.arrays import Floats
    from lagsim.mechanics.constraints import Row
    from lagsim.mechanics.pieces import Kink


def raised_by_corners(point: Point) -> int:
    """Return the number of independent rows that corners add to the equality rows.

    A motion at rest at a corner stays at the corner unless the equations of one branch
    alone lead away from it.
    """
    e, g = point.e, point.g
    moving = [*e.q, "t"]
    slopes = list(point.gradients)
    equalities = len(slopes)
    for row in (x for x in e.rows if x.holonomic):
        for kink in kinks(g, row.residual, e.model.parameter_values, moving):
            across = constraint_row(g, row.name, kink.u, e.flow)
            nodes = [across.residual, across.rate]
            near = np.abs(point.array(nodes)) <= CAUTION * point.rounding(nodes)
            if near.all() and _holds(point, row, kink, across):
                slopes.append(point.jacobian([across])[0])
    if len(slopes) == equalities:
        return 0
    rows = np.array(slopes) / point.sizes
    ranks = [int(np.linalg.matrix_rank(x)) for x in (rows, rows[:equalities])]
    return ranks[0] - ranks[1]


def _holds(point: Point, row: Row, kink: Kink, across: Row) -> bool:
    """Whether the equations of neither branch of a kink lead away from the kink.

    row : the row with the kink.
    across : the row of the surface on which the kink lies.
    """
    e, g = point.e, point.g
    for way, side in ((1.0, kink.above), (-1.0, kink.below)):
        (residual,) = g.substitute([row.residual], {kink.node: side})
        own = constraint_row(g, row.name, residual, e.flow)
        rows = tuple(own if x is row else x for x in e.rows)
        there = Point(replace(e, rows=rows), point.state, point.errors)
        a, terms, _ = accelerations(there)
        J: Floats = point.jacobian([across])[0]
        (b,) = point.array([across.b])
        leads = way * float(J @ a - b)
        if leads > RESIDUAL_ROUNDOFF * float(np.abs(J) @ terms + abs(b)):
            return False
    return True
