"""Floors of roots of velocities: their regularization near rest, for the next arc.

A root is a force |v|^p, 0 < p < 1, of a velocity v, with an unbounded slope at v = 0.
The floor of v is the least |v| with which the force is evaluated on a side of v = 0.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lagsim.tolerances import ACCELERATION_ROUNDOFF

if TYPE_CHECKING:
    from lagsim.language.arrays import Floats
    from lagsim.run.events.surface_modes import SurfaceModes


# Number of times ahead at which the forces on a state that has not moved are evaluated,
# from the interval between two rows to the whole run.
SAMPLES = 12
# Ratio of the two floors from which the power law of a root is computed.
FARTHER = 16.0


def set_floors(modes: SurfaceModes, hit: int | None, *, slipping: bool) -> None:
    """Store the floors of all roots, their regularization, for the next arc.

    A floor is the error of a velocity that the tolerance allows in the run: ten times
    the error allowed in a step, so that no error of a step leads across the root.

    Parameters
    ----------
    modes : SurfaceModes
        The modes of all K surfaces, as selected for the next arc.
    hit : int or None
        The surface that has been reached, or is no longer followed (`slipping`). In the
        latter case its floor is reduced, so that the root's force at the floor is well
        below the other forces; otherwise the motion would stick again.
    slipping : bool
        Whether the surface `hit` is no longer followed.
    """
    rooted = np.array([bool(side.floor) for side in modes.sides])
    if not rooted.any():
        return
    modes.write()
    former, rtol = modes.p.least_root.copy(), modes.arc.state.rtol
    pushed = modes.arc.state.row_step * np.max(np.abs(_pushes(modes)), axis=0)
    largest = _largest_values(modes, pushed)
    sizes = np.where(largest > 0.0, largest, pushed)
    # A surface without a size and without a force has the largest size of all.
    sizes = np.where(sizes > 0.0, sizes, np.max(sizes))
    floors = np.where(rooted, rtol * np.where(sizes > 0.0, sizes, 1.0), 0.0)
    modes.store(floor=floors, least_root=floors)
    for k in np.flatnonzero(rooted & ~(largest > 0.0)).tolist():
        floors[k] = min(floors[k], rtol * _kept_up(modes, k, floors))
        if former[k] > 0.0 and (slipping or k != hit):
            part = FARTHER if k == hit else 1.0
            floors[k] = min(floors[k], former[k] / part)
    modes.store(floor=floors, least_root=floors)


def _largest_values(modes: SurfaceModes, pushed: Floats) -> Floats:
    """Return the largest magnitude of each surface's expression so far (K,).

    A magnitude within rounding is 0.

    pushed : ndarray, shape (K,), the largest derivatives of the surfaces' rates by the
        forces, see `_pushes`.
    modes : the modes of all K surfaces.
    """
    arc = modes.arc
    slopes = np.abs(modes.rows().J)
    here = np.abs(modes.values(arc.t, arc.y))
    # The rounding of terms that cancel is not counted.
    least = ACCELERATION_ROUNDOFF * (slopes @ arc.magnitudes[arc.state.driven])
    change = slopes @ arc.ranges[arc.state.driven]
    found = np.maximum(np.where(here > least, here, 0.0), change)
    # Magnitudes within the floor, or within the rounding of forces, are not counted.
    least = np.maximum(modes.p.least_root, ACCELERATION_ROUNDOFF * pushed)
    return np.where(found > least, found, 0.0)


def _pushes(modes: SurfaceModes) -> Floats:
    """Return J (q'', s') - b of all surfaces at later times, shape (SAMPLES, K).

    The results are the derivatives of the surfaces' rates by the forces. The times are
    distributed geometrically from now to the end of the run.

    modes : the modes of all K surfaces.
    """
    arc, rows = modes.arc, modes.rows()
    left = arc.settings.end - arc.t
    first = min(arc.state.row_step, left)
    spans = np.geomspace(first, left, SAMPLES) if left > 0.0 else np.zeros(SAMPLES)
    rates = [modes.accelerations(arc.y, arc.t + span) for span in spans]
    return np.array([np.nan_to_num(rows.J @ a - rows.b) for a in rates])


def _kept_up(modes: SurfaceModes, k: int, floors: Floats) -> float:
    """Return the velocity at which the root on surface k balances the largest force.

    The root is a force |v|^p, 0 < p < 1, of the velocity v, see `set_floors`. The
    velocity is extrapolated by a power law from the roots with `floors` (K,) and with
    FARTHER times these floors; infinity where the power law does not apply.

    modes : the modes of all K surfaces.
    """
    small = _jump(modes, k)
    modes.store(floor=FARTHER * floors, least_root=FARTHER * floors)
    large = _jump(modes, k)
    force = float(np.max(np.abs(_pushes(modes)[:, k])))
    modes.store(floor=floors, least_root=floors)
    if not (0.0 < small < large and small < force):
        return float("inf")
    power = np.log(large / small) / np.log(FARTHER)
    return float(floors[k] * np.exp(np.log(force / small) / power))


def _jump(modes: SurfaceModes, k: int) -> float:
    """Return half the jump of surface k's row times the rates, across the surface.

    This is |J_k r_2 - J_k r_1| / 2, where J_k is the row of the surface, and r_1, r_2
    are the accelerations and rates (q'', s') on its sides.

    modes : the modes of all K surfaces.
    """
    value, found = modes.value[k], []
    for side in (-1.0, 1.0):
        modes.value[k] = side
        modes.write()
        found.append(float(modes.rows().J[k] @ modes.accelerations(modes.arc.y)))
    modes.value[k] = value
    modes.write()
    return 0.5 * abs(found[1] - found[0])
