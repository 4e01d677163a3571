"""What an error is measured by: the range of the coordinate's own motion."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lagsim.language.evaluate import evaluate
from lagsim.language.rounding import BALANCED
from lagsim.run.error import LOST
from lagsim.run.system.coupling import in_groups, joined, largest_beside

if TYPE_CHECKING:
    from collections.abc import Mapping

    from lagsim.language.arrays import Floats
    from lagsim.mechanics.equations import Equations
    from lagsim.mechanics.instant import Instant
    from lagsim.run.observers.checkpoints import Checkpoints

# A coordinate that should stay at rest is moved by the rounding of what moves beside
# it: its range counts as no less than this part of theirs.
SEED = 1e-9
# What moves by less than so many units in the last place of its own values, or of the
# motion of what it is linked with, is at rest but for rounding: its error is told as a
# part of those, and is no horizon.
RESOLVED = 64.0 * 2.0**-52
# What moves by a million times its error does not rest.
RESOLVED_BY = 1e-6
# For a horizon, what moves less than this part of the others has no motion to lose.
STILL = 1e-6


def ranges(
    names: tuple[str, ...],
    checkpoints: Checkpoints,
    again: Checkpoints,
    extents: Mapping[str, tuple[float, float]],
) -> Floats:
    """Give the ranges (n,): over all rows of both runs, and over the repeat's steps.

    Rows may be few, or show an oscillation always in the same phase.
    """
    low = np.fmin(checkpoints.low, again.low)
    high = np.fmax(checkpoints.high, again.high)
    for k, name in enumerate(names):
        if name in extents:
            low[k] = np.fmin(low[k], extents[name][0])
            high[k] = np.fmax(high[k], extents[name][1])
    return np.asarray(high - low)


def beside(equations: Equations, start: Instant, found: Floats) -> Floats:
    """Give the largest motion beside that of each coordinate, in its own unit (n,).

    As far as its inertia may be moved by it: of a heavier body no more than that body's
    own range, so that what is light does not hide behind it; of a lighter one less, as
    the roots of the masses. Where units differ, whichever is less.
    """
    return largest_beside(_roots(equations, start), found)


def linked(equations: Equations, start: Instant, found: Floats) -> Floats:
    """Give `beside` of what the rows of constraints link each coordinate with (n,)."""
    labels = joined(len(found), [row.A.entries for row in equations.rows])
    return in_groups(labels, _roots(equations, start), found)


def _roots(equations: Equations, start: Instant) -> Floats:
    """Give the roots of the diagonal of M at the start (n,)."""
    values = {p.name: p.value for p in equations.model.parameters} | {"t": start.t}
    values |= dict(zip(equations.q, start.q, strict=True))
    values |= dict(zip(equations.velocities, start.v, strict=True))
    diagonal = evaluate(equations.graph, equations.inertias, values)
    return np.sqrt(np.fmax(diagonal, 0.0))


def hardly_moving(
    found: Floats, moving: Floats, errors: Floats, scales: Floats
) -> list[int]:
    """Give the numbers of coordinates that may rest but for rounding.

    All else moves by far more than its error, or than the millionth of what moves
    beside it, and nobody has to ask what could push it.
    """
    slow = (found <= STILL * moving) | (errors > RESOLVED_BY * scales)
    return list(map(int, np.flatnonzero(slow)))


def is_at_rest(found: Floats, largest: Floats, held: Floats) -> bool:
    """Tell whether nothing moves but by rounding, of values or of forces."""
    return bool(np.all(found <= np.fmax(RESOLVED * largest, BALANCED * held)))


def scales_of(
    found: Floats, moving: Floats, linked: Floats, largest: Floats, held: Floats
) -> tuple[Floats, Floats]:
    """Give what errors are told as parts of, and below which there is no horizon (n,).

    Parameters
    ----------
    found, moving, linked, largest, held
        Of each coordinate the range, the motion beside it, that of what it is linked
        with, the largest value, and how far it would move if nothing held it.
    """
    scales = np.fmax(found, SEED * moving)
    at_rest = found <= BALANCED * held
    for size in (largest, linked):
        scales = np.where(found > RESOLVED * size, scales, np.fmax(scales, size))
    scales = np.where(at_rest, np.fmax(scales, held), scales)
    still = np.fmax(STILL * moving, BALANCED * held / LOST)
    return scales, np.fmax(still, RESOLVED * largest / LOST)
