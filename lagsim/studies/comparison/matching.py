"""The rows of two tables that belong together: those at the same time.

At an impact two rows share a time; they go together in their order, before and after.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from lagsim.language.arrays import Floats

Ints: TypeAlias = NDArray[np.intp]

# Times are the same if they differ by no more than this part of the rows' spacing: an
# event is located to the tolerance of the run, and its time is compared besides.
SAME = 1e-6


@dataclass(frozen=True, slots=True)
class Matched:
    """Numbers of rows that belong together, and times that have no partner.

    Attributes
    ----------
    golden, new : ndarray of int, shape (k,)
    missing, extra : ndarray
        Times of one table alone.
    """

    golden: Ints
    new: Ints
    missing: Floats
    extra: Floats


def match(golden: Floats, new: Floats, tolerance: float = 0.0) -> Matched:
    """Match rows by their times.

    Parameters
    ----------
    golden, new : ndarray
        The times.
    tolerance
        Between times that are the same, if more than SAME of the spacing.
    """
    near = max(SAME * _spacing(golden), min(tolerance, 0.25 * _spacing(golden)))
    if len(golden) == len(new) and bool(np.all(np.abs(golden - new) <= near)):
        every = np.arange(len(golden))
        return Matched(every, every, golden[:0], new[:0])
    mine, theirs = (np.argsort(t, kind="stable") for t in (golden, new))
    g, n = golden[mine], new[theirs]
    wanted = np.searchsorted(n, g - near) + _turns(g, near)
    there = np.minimum(wanted, len(n) - 1)
    same = (wanted < len(n)) & (np.abs(n[there] - g) <= near)
    alone = np.ones(len(n), bool)
    alone[there[same]] = False
    return Matched(mine[same], theirs[there[same]], g[~same], n[alone])


def _spacing(t: Floats) -> float:
    steps = np.diff(t)
    steps = steps[steps > 0.0]
    return float(np.median(steps)) if len(steps) else 0.0


def _turns(t: Floats, near: float) -> Ints:
    """Give for each row how many before it share its time."""
    turns = np.zeros(len(t), dtype=np.intp)
    for k in np.flatnonzero(np.diff(t) <= near) + 1:  # few: only impacts
        turns[k] = turns[k - 1] + 1
    return turns
