"""What a step of Taylor's keeps: the series at both its ends, and states between."""

from __future__ import annotations

from typing import TYPE_CHECKING

from lagsim.methods.parts.noise import TIGHT, add_drift, add_exactly, carry
from lagsim.methods.parts.power_series import sum_bend
from lagsim.methods.parts.state import State
from lagsim.native.kernels.words import abreast, at, fused, keep, vector
from lagsim.native.layout import array

if TYPE_CHECKING:
    from lagsim.language.arrays import Floats

MOST_ORDER = 18


class Taylor(State):
    """Two series, each its order K, then y_0 ... y_K; and the new state."""

    which: float  # of the two series is the present one: 0 or 1
    trial: float  # the step that is tried
    trouble: float  # the code of what was wrong with the last one
    rejected: float  # 1 once one was not accepted
    # 1 where a step is made in lanes; its error in units of the tolerance; the next.
    plain: float
    error: float
    next: float
    series: Floats = array(lambda s: buffer(s.size, 2.0))
    new: Floats = array(lambda s: s.size)
    rates: Floats = array(lambda s: s.size)  # the series' own at the new state
    # The rest at the start of the last step, and where tolerances are tight its rate.
    carried: Floats = array(lambda s: s.size)
    drift: Floats = array(lambda s: s.size)


def buffer(size: int, which: float) -> int:
    """Give where one of the two series lies; of both, how long they are."""
    return int(which) * (1 + (MOST_ORDER + 1) * size)


def reach(s: Taylor, c: Floats, rest: Floats, h: float, out: Floats) -> None:
    """Give the state (size,) at h in a step of series c, and in `left` its own rest.

    rest : (size,), what the state lacked at the start. At the end of the step this is
    the new state to the last bit: what lies past a switch there does so here.
    """
    size = s.size
    left = s.left
    sum_bend(size, c, h, left)
    if s.rtol < TIGHT:
        add_exactly(size, at(c, 1), at(c, 1 + size), h, out, left)
        add_drift(s, s.drift, h)
        for i in range(size):
            left[i] += rest[i]
        carry(size, out, left, out, left)
        return
    for i in abreast(size):
        before = vector(c, 1 + i)
        change = vector(left, i) + fused(h, vector(c, 1 + size + i), vector(rest, i))
        after = before + change
        moved = after - before
        keep(after, out, i, size - i)
        keep((before - (after - moved)) + (change - moved), left, i, size - i)
