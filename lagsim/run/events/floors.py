"""How small a velocity may be for a root to be taken of it, see `switches.roots`."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from lagsim.language.arrays import Floats
    from lagsim.run.events.modes import Modes

# A floor is this part of what the tolerance lets a velocity err in the run: ten times
# what it may err in a step, so that no error leads through it.
PART = 1.0
USUAL = 1e-9  # of a method without a tolerance
# Where nothing has moved, the forces are looked at so many times, at ever longer spans
# from between two rows to the whole run.
LOOKS = 12
# How a root falls with its argument tells what velocity the forces can keep up.
FARTHER = 16.0
# What is this part of what cancels, or of what forces give, is their rounding.
ROUNDED = 2.0**-44


def set_floors(modes: Modes, met: int | None, *, slipping: bool) -> None:
    """Set the floors of all roots for the arc to come.

    met : the surface that has been reached, or is no more followed (`slipping`). There
    what holds a slow motion falls well below its force: it would stick again.
    """
    rooted = [k for k, side in enumerate(modes.sides) if side.floor]
    if not rooted:
        return
    modes.write()
    former = modes.p.least_root.copy()
    pushed = modes.arc.state.row_step * np.max(np.abs(_pushes(modes)), axis=0)
    seen = _seen(modes, pushed)
    unseen = [k for k in rooted if not seen[k] > 0.0]
    sizes = np.where(seen > 0.0, seen, pushed)
    rtol = modes.arc.state.rtol or USUAL
    floors = np.zeros(modes.count)
    for k in rooted:
        # What has no size yet, and no force on it, moves with the others, if at all.
        size = sizes[k] if sizes[k] > 0.0 else np.max(sizes)
        floors[k] = PART * rtol * size if size > 0.0 else PART * rtol
    _put(modes, floors)
    for k in rooted:
        if k in unseen:
            floors[k] = min(floors[k], PART * rtol * _kept_up(modes, k, floors))
            if former[k] > 0.0 and (slipping or k != met):
                part = FARTHER if k == met else 1.0
                floors[k] = min(floors[k], former[k] / part)
    _put(modes, floors)


def _put(modes: Modes, floors: Floats) -> None:
    modes.tell(floor=floors, least_root=floors)


def _seen(modes: Modes, pushed: Floats) -> Floats:
    """Give how large the expression of each surface has been (K,).

    pushed : (K,), how large it would become between two rows.
    """
    arc, n = modes.arc, modes.arc.system.n
    slopes = np.abs(modes.rows().J)
    here = np.abs(modes.values(arc.t, arc.y))
    # The rounding of what cancels is no size.
    least = ROUNDED * (slopes @ arc.seen[n : 2 * n])
    moved = slopes @ arc.ranges[n : 2 * n]
    found = np.maximum(np.where(here > least, here, 0.0), moved)
    # What has not left its floor has not been seen, nor has the rounding of forces.
    least = np.maximum(modes.p.least_root, ROUNDED * pushed)
    return np.where(found > least, found, 0.0)


def _pushes(modes: Modes) -> Floats:
    """Give the rates (LOOKS, K) of the surfaces by the forces at times to come."""
    arc, n = modes.arc, modes.arc.system.n
    rows = modes.rows()
    left = arc.settings.end - arc.t
    first = min(arc.state.row_step, left)
    spans = np.geomspace(first, left, LOOKS) if left > 0.0 else np.zeros(LOOKS)
    rates = [modes.rates(arc.t + span, arc.y)[n : 2 * n] for span in spans]
    return np.array([np.nan_to_num(rows.J @ a - rows.b) for a in rates])


def _kept_up(modes: Modes, k: int, floors: Floats) -> float:
    """Give the velocity at which the root is as large as the largest force."""
    small = _jump(modes, k)
    _put(modes, FARTHER * floors)
    large = _jump(modes, k)
    force = float(np.max(np.abs(_pushes(modes)[:, k])))
    _put(modes, floors)
    if not (0.0 < small < large and small < force):
        return float("inf")
    power = np.log(large / small) / np.log(FARTHER)
    return float(floors[k] * np.exp(np.log(force / small) / power))


def _jump(modes: Modes, k: int) -> float:
    """Give half of what the sides of a surface differ in its rate."""
    n, arc = modes.arc.system.n, modes.arc
    value, found = modes.value[k], []
    for side in (-1.0, 1.0):
        modes.value[k] = side
        modes.write()
        found.append(float(modes.rows().J[k] @ modes.rates(arc.t, arc.y)[n : 2 * n]))
    modes.value[k] = value
    modes.write()
    return 0.5 * abs(found[1] - found[0])
