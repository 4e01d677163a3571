"""Which way the motion goes from a point on several surfaces: Filippov's conditions.

Each surface k has a share w_k in [0, 1] of its upper side, and a rate
rho = B w - r at which its expression grows:

    w = 0 and rho <= 0 (below it),  w = 1 and rho >= 0 (above),  or rho = 0 (along it).
"""

from __future__ import annotations

from itertools import product
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from lagsim.native.kernel_types import Floats

BELOW, ABOVE, ALONG = 0, 1, 2
# All ways are tried up to this many surfaces; beyond it they are exchanged one by one.
FEW = 5
MOST_EXCHANGES = 1000
# A rate this small against its terms is rounding.
ROUNDING = 1e-12


def ways(
    B: Floats, r: Floats, scale: Floats, now: Sequence[int], held: dict[int, int]
) -> list[int] | None:
    """Give BELOW, ABOVE or ALONG for each surface; None where no way meets all.

    Parameters
    ----------
    B, r : ndarray, shapes (k, k) and (k,)
    scale : ndarray, shape (k,)
        The size of the terms of the rates.
    now
        The sides before: preferred where both would do.
    held
        Surfaces whose way is known.
    """
    tolerance = ROUNDING * scale
    if len(r) <= FEW:
        for way in _candidates(len(r), now, held):
            for least in (tolerance, -tolerance):
                if _holds(B, r, way, held, least, tolerance):
                    return way
        return None
    return _exchanged(B, r, now, held, tolerance)


def _candidates(
    count: int, now: Sequence[int], held: dict[int, int]
) -> Iterator[list[int]]:
    choices = [
        [held[k]] if k in held else [now[k], 1 - now[k], ALONG] for k in range(count)
    ]
    every = [list(way) for way in product(*choices)]
    yield from sorted(every, key=lambda way: way.count(ALONG))


def _solved(B: Floats, r: Floats, way: Sequence[int]) -> Floats:
    """Give the shares that keep the rates of the surfaces followed at 0."""
    w = np.array([1.0 if k == ABOVE else 0.0 for k in way])
    along = [i for i, k in enumerate(way) if k == ALONG]
    if along:
        right = r[along] - B[along] @ w
        inner = B[np.ix_(along, along)]
        # Forces of which only the sum matters: the shares closest to one half.
        half = np.full(len(along), 0.5)
        w[along] = half + np.linalg.lstsq(inner, right - inner @ half, rcond=None)[0]
    return w


def _holds(
    B: Floats,
    r: Floats,
    way: Sequence[int],
    held: dict[int, int],
    least: Floats,
    tolerance: Floats,
) -> bool:
    """Tell whether a way meets the conditions, with rates of at least `least`.

    Where the rate of a side is rounding only, the motion follows the surface if both
    sides push onto it.
    """
    w = _solved(B, r, way)
    rho = B @ w - r
    for i, k in enumerate(way):
        if i in held:
            continue
        if k == ALONG:
            inside = -ROUNDING <= w[i] <= 1.0 + ROUNDING
            if not (inside and B[i, i] < 0.0 and abs(rho[i]) <= tolerance[i]):
                return False
        elif not (rho[i] if k == ABOVE else -rho[i]) >= least[i]:
            return False
    return True


def _exchanged(
    B: Floats,
    r: Floats,
    now: Sequence[int],
    held: dict[int, int],
    tolerance: Floats,
) -> list[int] | None:
    """Exchange the first surface that violates its condition until none does.

    Ends where -B is a P-matrix, as for friction (K. G. Murty, Linear Complementarity,
    Linear and Nonlinear Programming, section 5.1, with bounds above).
    """
    way = [held.get(i, ALONG if B[i, i] < 0.0 else now[i]) for i in range(len(r))]
    for _ in range(MOST_EXCHANGES):
        w = _solved(B, r, way)
        rho = B @ w - r
        for i, k in enumerate(way):
            if i in held:
                continue
            new = _better(k, w[i], rho[i], tolerance[i], bool(B[i, i] < 0.0))
            if new != k:
                way[i] = new
                break
        else:
            return way
    return None


def _better(k: int, w: float, rho: float, tolerance: float, attracts: bool) -> int:
    if k == ALONG:
        if w > 1.0 + ROUNDING:
            return ABOVE
        return BELOW if w < -ROUNDING else ALONG
    wrong = rho < -tolerance if k == ABOVE else rho > tolerance
    if not wrong:
        return k
    return ALONG if attracts else 1 - k
