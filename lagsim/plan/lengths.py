"""How long the constraint rows usually are, so that one that vanishes is seen to.

A row's length, in the metric in which the motion is solved for, is that at the start.
Only a row that is zero there is looked at nearby, at a distance that its own relation
tells, or the motion: no size of a coordinate is one, since where the origin lies says
nothing.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lagsim.admissibility.large import is_large, row_lengths
from lagsim.admissibility.newton import solving_metric
from lagsim.admissibility.point import Point
from lagsim.admissibility.rank import scaled_rows
from lagsim.language.derivatives import tangent
from lagsim.language.evaluate import UNIT_ROUNDOFF, addends

if TYPE_CHECKING:
    from lagsim.language.arrays import Floats
    from lagsim.mechanics.constraints import Row
    from lagsim.mechanics.equations import Equations, Instant

# How many states around the start are looked at, and how far away they are, against the
# distance over which a relation changes.
AROUND = 3
NEARBY = 0.1
# What a double leaves of a coordinate, a few times: an entry of this origin is zero.
ROUNDED = 4.0 * UNIT_ROUNDOFF


def usual_lengths(
    equations: Equations, start: Instant, step: float
) -> tuple[float, ...]:
    """Give the length of each row at the start, or around it where it vanishes.

    Around it is where the motion comes within a part of `step`.
    """
    if not equations.rows:
        return ()
    point = Point(equations, start.t)
    lengths = _lengths(point, start.q, start.v)
    vanishing = np.flatnonzero(~(lengths > 0.0))
    if len(vanishing):
        random = np.random.default_rng(4)  # the same states each time
        for _ in range(AROUND):
            for k in vanishing:
                q, v = _nearby(point, equations.rows[k], start, step, random)
                found = _lengths(point, q, v)[k]
                lengths[k] = np.fmax(lengths[k], found)
    return tuple(map(float, np.nan_to_num(lengths)))


def _lengths(point: Point, q: Floats, v: Floats) -> Floats:
    """Give the lengths (m,), 0 of what is nothing but rounding; nan where M is not."""
    if is_large(point):
        found = row_lengths(point, q, v)
        if np.all(np.isfinite(found)):
            return found
    if not np.all(np.isfinite(point.mass(q, v))):
        return np.full(len(point.e.rows), np.nan)
    names = (*point.e.q, *point.e.velocities)
    values = np.concatenate([q, v])
    errors = dict(zip(names, ROUNDED * np.abs(values), strict=True))
    return scaled_rows(point, q, v, solving_metric, errors)[1]


def _nearby(
    point: Point, row: Row, start: Instant, step: float, random: np.random.Generator
) -> tuple[Floats, Floats]:
    """Give a state as far from the start as says something of a row."""
    q, v = start.q, start.v
    u, w = (random.standard_normal(point.n) / point.sizes(q, v) for _ in range(2))
    if row.holonomic:
        distance = _own_distance(point, row, q, u)
        if distance > 0.0:
            return q + NEARBY * distance * u, v
    speed = float(np.linalg.norm(point.sizes(q, v) * v)) or 1.0
    return q + NEARBY * speed * step * u, v + NEARBY * speed * w


def _own_distance(point: Point, row: Row, q: Floats, u: Floats) -> float:
    """Give how far along u the terms of a relation change by their own size."""
    e, g = point.e, point.g
    along = dict(zip(map(g.variable, e.q), map(g.variable, e.velocities), strict=True))
    bend = tangent(g, tangent(g, [row.residual], along), along)
    terms = addends(g, row.residual)
    found = np.abs(point.array([*bend, *terms], q, u))
    if not found[0] > 0.0 or not np.all(np.isfinite(found)):
        return 0.0
    return float(np.sqrt(np.max(found[1:]) / found[0]))
