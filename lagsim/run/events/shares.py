"""Which way the motion goes from a point on several surfaces: Filippov's conditions.

Each surface k has a share w_k in [0, 1] of its upper side, and a rate rho_k at which
its expression grows:

    w = 0 and rho <= 0 (below it),  w = 1 and rho >= 0 (above),  or rho = 0 (along it).

Source: A. F. Filippov, Differential Equations with Discontinuous Righthand Sides,
1988, sections 4 and 8.
"""

from __future__ import annotations

from functools import cache
from itertools import product
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

    from lagsim.language.arrays import Floats

    Corner = tuple[int, ...]
    Rates = Callable[[Corner], Floats]

BELOW, ABOVE, ALONG = 0, 1, 2
LEVEL = 3  # of a surface that is no boundary here: its expression is constant
# All ways are tried up to this many surfaces; beyond it they are exchanged one by one.
FEW = 5
MOST_EXCHANGES = 1000
# A rate this small against its terms is rounding.
ROUNDING = 1e-12
TINY = 1e-300


class Crossroads:
    """A point on `count` surfaces.

    Parameters
    ----------
    rates
        The rates (count,) with each surface BELOW or ABOVE.
    scale : ndarray, shape (count,)
        The size of the terms of the rates.
    noise : ndarray, shape (count,)
        What the rounding of the state does to them.
    held
        Surfaces whose way is known.
    stays
        Whether the motion from a corner stays in it, as far as can be told.
    settled
        The motion has come to rest on the surfaces, or some of them have no rates.
    """

    def __init__(
        self,
        rates: Rates,
        scale: Floats,
        held: Mapping[int, int] | None = None,
        stays: Callable[[Corner], bool | None] = lambda _: None,
        *,
        noise: Floats | float = 0.0,
        settled: bool = False,
    ) -> None:
        self.count = len(scale)
        self.tolerance = np.maximum(ROUNDING * scale, noise)
        self._clear = np.maximum(self.tolerance, TINY)  # not 0, where nothing pushes
        self.held = held or {}
        self.settled = settled
        self.stays = cache(stays)
        few = self.count <= FEW
        self.rates: Rates = cache(rates) if few else _affine(rates, self.count)

    def way(self, now: Sequence[int]) -> list[int] | None:
        """Give BELOW, ABOVE or ALONG for each surface; None where no way will do.

        Where several do, those with fewer surfaces followed and with the sides `now`
        come first.
        """
        if self.count > FEW:
            return self._exchanged(now)
        candidates = list(self._candidates(now))
        # On a side only with a rate above rounding, at first: else the motion follows
        # the surface rather than to creep along it.
        leading = next((w for w in candidates if self.holds(w, self._clear)), None)
        if leading is not None:
            return leading
        creeping = [way for way in candidates if self.holds(way, -self.tolerance)]
        doubtful = []
        for way in creeping:
            stays = ALONG in way or self.stays(tuple(way))
            if stays:
                return way
            if stays is None:
                doubtful.append(way)
        if doubtful or not self.settled:
            return doubtful[0] if doubtful else None
        # No side leads away: the motion stays, though no surface attracts alone.
        resting = (w for w in candidates if self.holds(w, self._clear, alone=False))
        return next(resting, None)

    def is_fork(self, way: Sequence[int]) -> bool:
        """Tell whether the other side of some surface would do as well."""
        for i, k in enumerate(way):
            if k == ALONG or i in self.held:
                continue
            other = [*way[:i], 1 - k, *way[i + 1 :]]
            if self.holds(other, self._clear) or self._leads_off(other):
                return True
        return False

    def _leads_off(self, way: Sequence[int]) -> bool:
        """Tell whether the motion stays on these sides though no rate says so."""
        if self.count > FEW or ALONG in way or not self.holds(way, -self.tolerance):
            return False
        return self.stays(tuple(way)) is True

    def _candidates(self, now: Sequence[int]) -> Iterator[list[int]]:
        choices = [
            [self.held[k]] if k in self.held else [now[k], 1 - now[k], ALONG]
            for k in range(self.count)
        ]
        every = [list(way) for way in product(*choices)]
        yield from sorted(every, key=lambda way: way.count(ALONG))

    def _solved(self, way: Sequence[int]) -> tuple[Floats, Floats, Floats]:
        """Give the shares that keep what is followed at rest, rates, attractions.

        An attraction is by how much its own upper side adds to a rate: below 0 where
        the sides push onto the surface.
        """
        along = [i for i, k in enumerate(way) if k == ALONG]
        corner = tuple(BELOW if k == ALONG else k for k in way)
        rho = self.rates(corner)
        w = np.array(corner, dtype=float)
        own = np.zeros(self.count)
        if along:
            B = np.array([self.rates(_above(corner, j)) - rho for j in along]).T
            B[np.abs(B) <= self.tolerance[:, None]] = 0.0
            inner = B[along]
            # Forces of which only the sum matters: the shares closest to one half.
            half = np.full(len(along), 0.5)
            right = -rho[along] - inner @ half
            if not (np.all(np.isfinite(inner)) and np.all(np.isfinite(right))):
                # No force there, no way along it: `holds` refuses what is not a number.
                return np.full(self.count, np.nan), np.full(self.count, np.nan), own
            # Of the same size, whatever the units of each surface.
            size = np.max(np.abs(inner), axis=1)
            size[size == 0.0] = 1.0
            inner_scaled, right = inner / size[:, None], right / size
            w[along] = half + np.linalg.lstsq(inner_scaled, right, rcond=None)[0]
            rho = rho + B @ w[along]
            own[along] = np.diag(inner)
        return w, rho, own

    def holds(self, way: Sequence[int], least: Floats, *, alone: bool = True) -> bool:
        """Tell whether a way meets the conditions, with rates of at least `least`.

        And whether each surface that is followed attracts alone.
        """
        w, rho, own = self._solved(way)
        for i, k in enumerate(way):
            if i in self.held:
                continue
            if k == ALONG:
                inside = -ROUNDING <= w[i] <= 1.0 + ROUNDING
                attracts = own[i] < 0.0 or not alone
                if not (inside and attracts and abs(rho[i]) <= self.tolerance[i]):
                    return False
            elif not (rho[i] if k == ABOVE else -rho[i]) >= least[i]:
                return False
        return True

    def _exchanged(self, now: Sequence[int]) -> list[int] | None:
        """Exchange the first surface that violates its condition until none does.

        Ends where -B is a P-matrix, as for friction (K. G. Murty, Linear
        Complementarity, Linear and Nonlinear Programming, 1988, section 5.1, with
        bounds above).
        """
        low = (BELOW,) * self.count
        base = self.rates(low)
        attracts = [
            bool(self.rates(_above(low, i))[i] < base[i]) for i in range(self.count)
        ]
        way = [
            self.held.get(i, ALONG if attracts[i] else now[i])
            for i in range(self.count)
        ]
        for _ in range(MOST_EXCHANGES):
            w, rho, _own = self._solved(way)
            for i, k in enumerate(way):
                if i in self.held:
                    continue
                new = _better(k, w[i], rho[i], self.tolerance[i])
                if new != k:
                    way[i] = ALONG if attracts[i] and k != ALONG else new
                    break
            else:
                return way if np.all(np.isfinite(w + rho)) else None
        return None


def _above(corner: Corner, j: int) -> Corner:
    return (*corner[:j], ABOVE, *corner[j + 1 :])


def _affine(rates: Rates, count: int) -> Rates:
    """Give rates that are affine in the shares, from those of count + 1 corners."""
    low = (BELOW,) * count
    base = rates(low)
    effects = np.array([rates(_above(low, j)) - base for j in range(count)])
    return lambda corner: base + np.array(corner, dtype=float) @ effects


def _better(k: int, w: float, rho: float, tolerance: float) -> int:
    if k == ALONG:
        if w > 1.0 + ROUNDING:
            return ABOVE
        return BELOW if w < -ROUNDING else ALONG
    wrong = rho < -tolerance if k == ABOVE else rho > tolerance
    return 1 - k if wrong else k
