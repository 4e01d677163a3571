"""Scales for values of very different sizes: one spike, or growth without end.

On a linear scale there would be a spike and a line at 0, or a line at 0 and a corner
at the end. So powers of ten count from some size on; growth of one sign has no other.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from lagsim.outputs.scale import Scale, log_scale, value_scale

if TYPE_CHECKING:
    from lagsim.run.observers.thinning import Array

# A spike lasts for no more than this part of the time, and is so many times as high as
# anything else.
BRIEF, HIGH = 0.02, 30.0
# What ends so many times as large as it mostly was, at the end, has exploded.
EXPLOSION, LAST = 1e6, 0.9
# Of decades: what is shown of those that a spike, or growth, began with.
FEWEST = 0.5
ROUND = (1.0, 2.0, 5.0, 10.0)


def spread_scale(*drawn: tuple[Array, Array], size: float = 0.0) -> Scale:
    """Return a scale for curves (times, values) against time, as `value_scale` does."""
    series = [values for _, values in drawn]
    plain = value_scale(*series, size=size)
    sizes = np.abs(np.concatenate(series))
    sizes = sizes[np.isfinite(sizes)]
    most = float(sizes.max(initial=0.0))
    if most <= 0.0 or not math.isfinite(most) or most <= 1e-9 * size:
        return plain
    usual = float(np.quantile(sizes, 1.0 - BRIEF))
    if 0.0 < usual < most / HIGH:
        return _beyond(plain, _round(usual), most)
    usual = float(np.median(sizes))
    if not 0.0 < usual < most / EXPLOSION or not _ends(drawn):
        return plain
    if all(np.nanmin(values) > 0.0 for values in series):
        return log_scale(*series)
    least = max(float(np.quantile(sizes, 0.1)), most * 1e-30)
    return _beyond(plain, _round(least), most, FEWEST)


def _ends(drawn: tuple[tuple[Array, Array], ...]) -> bool:
    """Tell whether the largest value is among the last."""
    for t, values in drawn:
        sizes = np.where(np.isfinite(values), np.abs(values), 0.0)
        largest = t[int(sizes.argmax())]
        if largest - t[0] > LAST * (t[-1] - t[0]):
            return True
    return False


def _beyond(plain: Scale, linear: float, most: float, share: float = 0.0) -> Scale:
    """Return a scale with powers of ten beyond a size, in half of it at most."""
    decades = max(math.log10(most / linear), 1.0)
    # The margin of a linear scale may be larger than all that is on the other side.
    low = plain.low if -plain.low > 0.1 * plain.high else -linear
    high = plain.high if plain.high > -0.1 * plain.low else linear
    return Scale(1.3 * low, 1.3 * high, linear=linear, share=share or 0.9 * decades)


def _round(size: float) -> float:
    """Return a round number that is not less."""
    power = 10.0 ** math.floor(math.log10(size))
    return next((x * power for x in ROUND if x * power >= size), 10.0 * power)
