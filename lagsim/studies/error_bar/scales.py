"""What an error is measured by: the range of the coordinate's own motion."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lagsim.language.evaluate import evaluate
from lagsim.run.error import LOST
from lagsim.run.system.coupling import joined

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

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
# For a horizon, what moves less than this part of the others has no motion to lose.
STILL = 1e-6
# Forces balance to this part: what constraints hold moves no less than by the rest.
BALANCED = 2.0**-46


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
    return _largest(_roots(equations, start), found)


def linked(equations: Equations, start: Instant, found: Floats) -> Floats:
    """Give `beside` of what the rows of constraints link each coordinate with (n,)."""
    labels = joined(len(found), [row.A.entries for row in equations.rows])
    return _in_groups(labels, _roots(equations, start), found)


def _in_groups(labels: Sequence[int], roots: Floats, found: Floats) -> Floats:
    whole = np.array(found)
    for label in sorted({k for i, k in enumerate(labels) if k != i}):
        group = np.array(labels) == label
        whole[group] = _largest(roots[group], found[group])
    return whole


def _roots(equations: Equations, start: Instant) -> Floats:
    """Give the roots of the diagonal of M at the start (n,)."""
    values = {p.name: p.value for p in equations.model.parameters} | {"t": start.t}
    values |= dict(zip(equations.q, start.q, strict=True))
    values |= dict(zip(equations.velocities, start.v, strict=True))
    diagonal = evaluate(equations.graph, equations.inertias, values)
    return np.sqrt(np.fmax(diagonal, 0.0))


def _largest(roots: Floats, found: Floats) -> Floats:
    """Give the largest of range_j min(1, root_j/root_i): by size, without n^2."""
    finite = np.where(np.isfinite(found) & np.isfinite(roots), found, 0.0)
    lightest = np.argsort(roots)
    whole = np.zeros(len(found))
    below = np.maximum.accumulate((finite * roots)[lightest])
    above = np.maximum.accumulate(finite[lightest][::-1])[::-1]
    own = roots[lightest]
    lighter = np.divide(below, own, out=np.zeros_like(below), where=own > 0.0)
    whole[lightest] = np.fmax(lighter, above)
    return whole


def falls(equations: Equations, start: Instant, span: float, step: float) -> Floats:
    """Give how far forces would carry each coordinate without constraints (n,).

    What constraints hold against them rests, as far as these balance, and has no range
    of its own. What no force acts on is pushed by the constraints alone: rounding of
    that is projected away again within a step. Zero without constraints.
    """
    e = equations
    if not (e.rows or e.laws):
        return np.zeros(len(e.q))
    values = {p.name: p.value for p in e.model.parameters} | {"t": start.t}
    values |= dict(zip(e.q, start.q, strict=True))
    values |= dict(zip(e.velocities, start.v, strict=True))
    masses = np.array(evaluate(e.graph, e.inertias, values))
    forces = np.abs(evaluate(e.graph, list(e.f), values))
    pulled = np.divide(forces, masses, out=np.zeros(len(e.q)), where=masses > 0.0)
    pulled = np.where(np.isfinite(pulled), pulled, 0.0)
    labels = joined(len(e.q), [A.entries for A in e.slopes])
    pushed = _in_groups(labels, np.sqrt(np.fmax(masses, 0.0)), pulled)
    return np.asarray(np.fmax(pulled * span * span, pushed * step * step))


def is_at_rest(found: Floats, largest: Floats, falls: Floats) -> bool:
    """Tell whether nothing moves but by rounding, of values or of forces."""
    return bool(np.all(found <= np.fmax(RESOLVED * largest, BALANCED * falls)))


def scales_of(
    found: Floats, moving: Floats, linked: Floats, largest: Floats, falls: Floats
) -> tuple[Floats, Floats]:
    """Give what errors are told as parts of, and below which there is no horizon (n,).

    Parameters
    ----------
    found, moving, linked, largest, falls
        Of each coordinate the range, the motion beside it, that of what it is linked
        with, the largest value, and how far it would move if nothing held it.
    """
    scales = np.fmax(found, SEED * moving)
    at_rest = scales <= BALANCED * falls
    for size in (largest, linked):
        scales = np.where(found > RESOLVED * size, scales, np.fmax(scales, size))
    scales = np.where(at_rest, np.fmax(scales, falls), scales)
    still = np.fmax(STILL * moving, BALANCED * falls / LOST)
    return scales, np.fmax(still, RESOLVED * largest / LOST)
