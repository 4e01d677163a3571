"""Thin sets: constraints that have only a multiple root all over the set they make.

A row that others span may be one relation too many: then all states that the others
admit satisfy it, too. It may be dependent only at a singular configuration, where
motions branch. Or it is dependent all over the set that it makes, as that of x^2 + y^2
= 0, of two spheres that touch, or of a plane and a cylinder that touch along a line:
the relation holds there as a multiple root. No multiplier keeps a motion on such a set.

The first is tried on states that the other rows admit; of the others `rank` tells.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lagsim.admissibility.algebra import cholesky
from lagsim.admissibility.newton import Relations, reach, wanted_of
from lagsim.admissibility.rank import Neighbourhood
from lagsim.tolerances import STATE_ROUNDOFF

if TYPE_CHECKING:
    from collections.abc import Collection, Sequence

    from lagsim.admissibility.point import Point
    from lagsim.admissibility.rank import Dependence
    from lagsim.language.arrays import Floats
    from lagsim.mechanics.constraints import Row

# How far, against their lengths, states are varied, and how often.
NEARBY = 1e-2
SAMPLES = 8
# What a state misses a row by is rounding below this part of what the way changes.
TRACE = 1e-10
# Coordinates up to which the dimension of a set is measured; points that lie apart by
# less than this part of the way that they were sent do not span it.
MOST = 60
THIN = 0.05


class ThinSet(NamedTuple):
    """A set of admissible positions on which rows lose their rank all over.

    Attributes
    ----------
    names : tuple of str
        The rows that are dependent there, and hold nowhere around it.
    dimension : int or None
        Of the set; None where it was not found.
    degrees_of_freedom : int or None
        The dimension less the independent relations between velocities.
    """

    names: tuple[str, ...]
    dimension: int | None
    degrees_of_freedom: int | None = None

    def __str__(self) -> str:
        named = " and ".join(f"`{name}`" for name in self.names)
        text = (
            f"{named} has only a multiple root: the constraints lose rank at every "
            "admissible state, and no multiplier keeps a motion admissible"
        )
        if self.dimension is None:
            return text
        if self.dimension == 0:
            return f"{text}; there is one admissible state, an isolated point"
        return f"{text}; the admissible states have dimension {self.dimension}"


def thin_set(
    point: Point, dependences: Sequence[Dependence], ways: tuple[Floats, Floats]
) -> tuple[ThinSet | None, tuple[str, ...]]:
    """Find the rows that hold as multiple roots on the whole set through the point.

    Parameters
    ----------
    ways
        See `Neighbourhood`.

    Returns
    -------
    thin : ThinSet or None
    real : tuple of str
        Dependent rows that states admitted by the others violate.
    """
    suspects = [d for d in dependences if d.everywhere is not False]
    if not suspects or point.is_large:
        return None, ()
    dependent = {d.name for d in dependences}
    rows = point.e.rows
    held = [row for row in rows if row.holonomic]
    around = Neighbourhood(point, ways)
    thin, real = _thin_rows(around, held, suspects, dependent, velocities=False)
    if thin:
        dimension = _dimension(around, held, velocities=False)
        free = {row.name for row in rows if not row.holonomic} - dependent
        freedom = None if dimension is None else dimension - len(free)
        return ThinSet(thin, dimension, freedom), real
    names = frozenset(point.e.velocities)
    curved = {
        row.name
        for row in rows
        if not row.holonomic and point.g.depends(row.A.entries.values()) & names
    }
    suspects = [d for d in suspects if d.name in curved]
    thin, more = _thin_rows(around, rows, suspects, dependent, velocities=True)
    if not thin:
        return None, real + more
    return ThinSet(thin, None, _dimension(around, rows, velocities=True)), real + more


def _relations(
    around: Neighbourhood, rows: Sequence[Row], *, velocities: bool
) -> Relations:
    """Give what `rows` ask of all positions, or of all velocities."""
    wanted, n = wanted_of(rows, velocities=velocities), around.point.n
    return Relations(around.point, wanted, range(n), velocities=velocities)


def _states(
    around: Neighbourhood, rows: Sequence[Row], count: int, *, velocities: bool
) -> list[Floats]:
    """Give positions, or velocities, around: of `count` those that `rows` admit."""
    random = np.random.default_rng(7)  # the same each time
    relations = _relations(around, rows, velocities=velocities)
    found = []
    for _ in range(count):
        x = around.varied(NEARBY, random, velocities=velocities)
        if not rows:
            found.append(x)
        elif (reached := reach(relations, x, around.metric)).converged:
            found.append(reached.x)
    return found


def _dimension(
    around: Neighbourhood, rows: Sequence[Row], *, velocities: bool
) -> int | None:
    """Give the dimension of the set that `rows` admit around a point."""
    n, x = around.point.n, around.point.v if velocities else around.point.q
    if n > MOST:
        return None
    spread, weights = around.spreads[velocities], np.sqrt(np.diag(around.metric))
    size = np.max(spread * weights, initial=0.0) or 1.0
    spread = around.spreads[velocities] = np.where(spread > 0, spread, size / weights)
    states = _states(around, rows, n + 2, velocities=velocities)
    if len(states) < n + 1:
        return None
    ways = (np.array(states) - x) / (NEARBY * spread)
    return int(np.sum(np.linalg.svd(ways, compute_uv=False) > THIN))


def _thin_rows(
    around: Neighbourhood,
    rows: Sequence[Row],
    dependences: Sequence[Dependence],
    dependent: Collection[str],
    *,
    velocities: bool,
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Give the dependent rows that make the set thin, and those that others miss."""
    known = {row.name: row for row in rows}
    suspects = [d for d in dependences if d.name in known]
    independent = [row for row in rows if row.name not in dependent]
    # Where they leave no way but the state itself, no other state tells anything.
    if not suspects or len(independent) >= around.point.n:
        return (), ()
    states = _states(around, independent, SAMPLES, velocities=velocities)
    if not states:
        return (), ()
    own = [known[d.name] for d in suspects]
    relations = _relations(around, own, velocities=velocities)
    values = np.array([relations(x)[0] for x in states])
    missed = np.array(
        [relations.violated(x, STATE_ROUNDOFF * np.abs(x)) for x in states]
    )
    # What rounding may leave in the rows at these states.
    L, x0 = cholesky(around.metric), relations.x0
    slopes = np.linalg.norm(np.linalg.solve(L, relations(x0)[1].T), axis=0)
    ways = [np.linalg.norm(L.T @ (x - x0)) for x in states]
    missed &= np.abs(values) > TRACE * np.outer(ways, slopes)
    thin, real = [], []
    for i, d in enumerate(suspects):
        if not np.any(missed[:, i]):
            continue
        real.append(d.name)
        if d.everywhere:
            thin.append(d.name)
    return tuple(thin), tuple(real)
