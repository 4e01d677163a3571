"""Rest at the end of a switching curve, as at the target of a time-optimal control.

At the end of a curve, as of `v + sign(x)*sqrt(2*abs(x))`, the slope of the curve is
unbounded, or vanishes (`x + v*abs(v)/2`), so that the rate along the curve does not
determine the mode. The remaining motion has a bound instead: at a speed s against a
deceleration a the position moves by at most s^2/(2 a). Where this bound is below the
rounding of the position, the motion rests. Where switches accumulate, it also rests if
the forces stop it in the time left to their limit.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lagsim.run.events.kinematics import Kinematics
from lagsim.run.events.law_modes import that_could_act
from lagsim.run.events.surface_modes import ABOVE, BELOW, LEVEL, SLIDING, Carried
from lagsim.tolerances import RESIDUAL_ROUNDOFF

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from lagsim.language.arrays import Floats
    from lagsim.run.events.records import LawsAt
    from lagsim.run.events.surface_modes import Rows, SurfaceModes


# Bound of the distance to rest, in products of the rate and the time to rest.
REACH = 4.0
# Largest remaining motion at rest, in roundings of a position: that of several steps.
FEW = 64.0
# Speeds at which the curve is evaluated beside rest, relative to the largest ones so
# far: their squares are clear of the rounding of positions.
SLOW = 2.0**-20
# Largest distance of the curve from its level there, in sizes of the surface: a few
# roots of a rounding.
APART = FEW * RESIDUAL_ROUNDOFF**0.5
# Interval after which it is evaluated again, relative to the duration of the run.
SOON = 1e-3


def come_to_rest(
    modes: SurfaceModes, levels: Mapping[int, float], sizes: Floats, left: float,
    laws: LawsAt | None,
) -> bool:  # fmt: skip
    """Select rest at the end of a switching curve; return whether rest is possible.

    Rest requires a surface on whose side all other surfaces at their level depend, and
    forces that lead back to this surface from both of its sides. If there is none, or
    the values of switches at their levels already leave the motion at rest, or laws may
    hold it, the modes are left unchanged.

    Parameters
    ----------
    modes : SurfaceModes
        The modes of all K surfaces; changed to rest where it is possible.
    levels : mapping of int to float
        Levels of the surfaces that the state is on.
    sizes : ndarray, shape (K,)
        Magnitudes of the terms of all surfaces.
    left : float
        Time in which switches accumulate there.
    laws : LawsAt or None
        The laws at the instant; None for a model without laws.
    """
    value, kind = modes.value.copy(), modes.kind.copy()
    others = {k: [j for j in levels if j != k] for k in levels}
    leaders = [k for k in levels if all(k in modes.depends[j] for j in others[k])]
    if len(levels) < 2 or not leaders:
        return False
    still = _is_still(modes, levels, laws)
    modes.restore(value, kind)
    modes.write()
    rows = modes.rows()
    for k in leaders if not still else ():
        if _rests(modes, rows, k, others[k], levels, sizes, left):
            return True
        modes.restore(value, kind)
        modes.write()
    return False


def _is_still(
    modes: SurfaceModes, levels: Mapping[int, float], laws: LawsAt | None
) -> bool:
    """Whether the motion rests at the levels of all surfaces in `levels`.

    It rests if the rates of these surfaces are 0 and, besides, either laws may act on
    the surfaces or forces do not move the state off the levels. The motion is then not
    at the end of a switching curve, and `Crossing` selects the modes.

    modes : the modes of all surfaces; those of `levels` are changed to LEVEL.
    levels, laws : see `come_to_rest`.
    """
    for k, level in levels.items():
        modes.set_mode(k, level, LEVEL)
    modes.write()
    arc, on, rows = modes.arc, [*levels], modes.rows()
    if rows.rates[on].any():
        return False
    if laws is not None:
        here = Kinematics(arc, arc.y)
        active = that_could_act(here, laws.closed)
        response = here.acting(active, laws.left).response
        if (rows.J[on, : arc.system.n] @ response).any():
            return True
    return not modes.forced(arc.y)[on].any()


def _rests(
    modes: SurfaceModes,
    rows: Rows,
    k: int,
    others: list[int],
    levels: Mapping[int, float],
    sizes: Floats,
    left: float,
) -> bool:
    """Whether the motion can rest on surface k; if so, the modes are set to rest.

    The surfaces `others` have to be at their level on both sides of k (a surface whose
    expression jumps at k is at its level on one side only), and to stay there while the
    motion rests (an expression of the time, or of another body, leaves).

    rows : the rows of all surfaces.
    others : the other surfaces at their levels.
    levels, sizes, left : see `come_to_rest`.
    """
    arc, J, positions = modes.arc, rows.J[k], modes.arc.state.positions
    by_q = J[: arc.system.n]
    square = float(J @ J)
    if not square > 0.0 or modes.whole[k]:
        return False
    speed, moving = float(rows.rates[k]), modes.on_rates[k]
    size = sizes[k]
    aside = RESIDUAL_ROUNDOFF * size
    if moving:
        size = float(np.abs(by_q) @ arc.magnitudes[positions])
        aside = SLOW * float(np.abs(J) @ arc.magnitudes[arc.state.driven])
    part, along = (arc.state.driven, J) if moving else (positions, by_q)
    rest = arc.y.copy()
    if not moving:
        rest[arc.state.driven] -= speed / square * J
    rest[part] -= rows.residuals[k] / square * along
    found, pulls, fields = {}, [], []
    for side, sign in ((BELOW, -1.0), (ABOVE, 1.0)):
        beside = arc.y.copy()
        beside[arc.state.driven] -= speed / square * J
        beside[part] += (sign * aside - rows.residuals[k]) / square * along
        modes.set_mode(k, levels[k], side)
        for j in others:
            modes.write()
            value = float(modes.values(arc.t, beside)[j])
            if abs(value - levels[j]) > APART * sizes[j]:
                return False
            modes.set_by_value(j, value)
        modes.write()
        back = -sign * float(J @ modes.accelerations(beside) - rows.b[k])
        way = 2.0 * FEW * RESIDUAL_ROUNDOFF * size * back
        short = speed * speed <= way or abs(speed) <= REACH * left * back
        if not (back > 0.0 and short):
            return False
        found[side] = modes.value.copy()
        pulls.append(back)
        fields.append(modes.rates(arc.t, rest))
    resting = (pulls[1] * fields[0] + pulls[0] * fields[1]) / (pulls[0] + pulls[1])
    if not _stays_at_levels(modes, found, rest, resting, others, levels, sizes):
        return False
    modes.value[:] = found[BELOW]
    for j in others:
        same = bool(found[BELOW][j] == found[ABOVE][j])
        modes.carry(j, Carried(k, float(found[ABOVE][j]), same, same))
    modes.set_mode(k, levels[k], SLIDING)
    return True


def _stays_at_levels(
    modes: SurfaceModes,
    sides: Mapping[int, Floats],
    rest: Floats,
    rates: Floats,
    others: Sequence[int],
    levels: Mapping[int, float],
    sizes: Floats,
) -> bool:
    """Whether surfaces stay at their levels for a short time from a state at rest.

    Parameters
    ----------
    modes : SurfaceModes
        The modes of all K surfaces.
    sides : mapping of int to ndarray, shape (K,)
        The sides of all surfaces, below and above the surface of the rest.
    rest, rates : ndarray, shape (size,)
        The state, and its rates.
    others : sequence of int
        The surfaces that are evaluated.
    levels, sizes
        See `come_to_rest`.
    """
    arc = modes.arc
    short = min(SOON * arc.settings.duration, arc.settings.end - arc.t)
    for values in sides.values():
        modes.value[:] = values
        modes.write()
        after = modes.values(arc.t + short, rest + short * rates)
        if any(abs(after[j] - levels[j]) > APART * sizes[j] for j in others):
            return False
    return True
