"""Coordinates near their singularity: an inertia that all but vanishes on the way.

In polar coordinates the inertia of the angle is m r^2, of a spherical pendulum's
azimuth m l^2 sin^2 theta, and of Euler's angles a pivot of M is: where one of them
falls to a small part of its largest value, the coordinate hardly means anything, its
rate is huge, and steps are short though nothing happens. The inertias are looked at
after every step (`methods.parts.driver`), since rows may miss such a moment.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from lagsim.notes import Caution

if TYPE_CHECKING:
    from lagsim.run.arc import Arc

# An inertia below this part of its largest value is close to none: the lever arm is a
# 300th of what it was. (Measured on an oscillator in polar coordinates that misses the
# pole by 1e-1, 3e-3 and 1e-5 of its amplitude: 20,600, 33,900 and 46,500 evaluations,
# errors of 2e-11, 1e-9 and 1e-8 of the range.)
VANISHING = 1e-5


def singularity_caution(arc: Arc) -> list[Caution]:
    """Warn of the coordinate that came closest to losing its meaning."""
    state = arc.state
    if not state.inertias or not arc.steps:
        return []
    # Lists: for so few numpy takes longer.
    pairs = zip(
        state.inertia_largest.tolist(), state.inertia_smallest.tolist(), strict=True
    )
    parts = [
        smallest / largest if largest > 0.0 else 1.0 for largest, smallest in pairs
    ]
    vanishing = [k for k, part in enumerate(parts) if part < VANISHING]
    vanishing = [k for k in vanishing if not _is_held(arc, k)]
    if not vanishing:
        return []
    k = min(vanishing, key=lambda k: parts[k])
    part, name, when = parts[k], arc.system.inertias[k], float(state.inertia_when[k])
    text = (
        f"at t = {when:.9g} the inertia of `{name}` falls to {part:.1g} of its "
        f"largest value: `{name}` is nearly undefined there (polar coordinates at "
        "the pole, angles at gimbal lock), which alone makes the steps short; "
        "Cartesian coordinates, or angles with their pole elsewhere, avoid this"
    )
    return [Caution("coordinate-singularity", text)]


def _is_held(arc: Arc, k: int) -> bool:
    """Tell whether the constraints hold the coordinate where its inertia is smallest.

    A component of a quaternion has none along the quaternion itself, whose length is
    one: a force on the coordinate then meets the inertia of what it can move.
    """
    e, name = arc.system.equations, arc.system.inertias[k]
    if not e.rows or name not in e.q:
        return False
    from lagsim.admissibility.inertia import admitted_inertia
    from lagsim.admissibility.point import Point

    state, n = arc.state, arc.system.n
    where = state.inertia_where[2 * n * k : 2 * n * (k + 1)]
    point = Point(e, float(state.inertia_when[k]))
    found = admitted_inertia(point, where[:n], where[n:], e.q.index(name))
    return not found < VANISHING * float(state.inertia_largest[k])
