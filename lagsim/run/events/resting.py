"""Rest at the end of a switching curve: `v + sign(x)*sqrt(2*abs(x))` at the target.

There the slope of the curve has no bound, or vanishes (`x + v*abs(v)/2`), and no rate
along it says anything. But what is left of the motion is known: at a speed s against
forces that lead back at a the position gets no farther than s^2/(2 a). Where that is
its rounding, the motion rests.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lagsim.run.events.modes import ON
from lagsim.run.events.shares import ABOVE, ALONG, BELOW

if TYPE_CHECKING:
    from collections.abc import Mapping

    from lagsim.language.arrays import Floats
    from lagsim.run.events.modes import Modes, Rows

# What is left may be so many times the rounding of a position: that of several steps.
FEW = 64.0
# Beside rest in velocities the curve is looked at for speeds of this part of those
# seen: their squares are clear of the rounding of positions.
SLOW = 2.0**-20


def come_to_rest(modes: Modes, levels: Mapping[int, float], sizes: Floats) -> bool:
    """Let the motion rest on a surface, if it does; tell whether.

    Where the others that the state is on depend on its side, and the forces on both
    sides of it lead back.
    """
    value, kind = modes.value.copy(), modes.kind.copy()
    rows = modes.rows()
    for k in levels:
        others = [j for j in levels if j != k]
        if not others or not all(k in modes.depends[j] for j in others):
            continue
        if _rests(modes, rows, k, others, levels, sizes[k]):
            return True
        modes.restore(value, kind)
        modes.write()
    return False


def _rests(
    modes: Modes,
    rows: Rows,
    k: int,
    others: list[int],
    levels: Mapping[int, float],
    size: float,
) -> bool:
    """Try rest on surface k; the modes are left at it."""
    arc, n, J = modes.arc, modes.arc.system.n, rows.J[k]
    square = float(J @ J)
    if not square > 0.0 or modes.whole[k]:
        return False
    speed, moving = float(rows.rates[k]), modes.of_velocities[k]
    aside = ON * size
    if moving:
        size = float(np.abs(J) @ arc.seen[:n])
        aside = SLOW * float(np.abs(J) @ arc.seen[n : 2 * n])
    found = {}
    for way, sign in ((BELOW, -1.0), (ABOVE, 1.0)):
        beside = arc.y.copy()
        beside[n : 2 * n] -= speed / square * J
        part = slice(n, 2 * n) if moving else slice(n)
        beside[part] += (sign * aside - rows.residuals[k]) / square * J
        modes.put(k, levels[k], way)
        for j in others:
            modes.write()
            modes.put_clear(j, float(modes.values(arc.t, beside)[j]))
        modes.write()
        a = modes.rates(arc.t, beside)[n : 2 * n]
        back = -sign * float(J @ a - rows.b[k])
        if not (back > 0.0 and speed * speed <= 2.0 * FEW * ON * size * back):
            return False
        found[way] = modes.value.copy()
    modes.value[:] = found[BELOW]
    for j in others:
        if found[BELOW][j] != found[ABOVE][j]:
            modes.carry(j, k, float(found[ABOVE][j]))
    modes.put(k, levels[k], ALONG)
    return True
