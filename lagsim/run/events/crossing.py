"""How the motion goes on from a state on some surfaces.

A surface that is met at a rate is crossed. Where the rate vanishes, or is that of a
velocity and so depends on the side, the forces decide (`shares`). A surface that steps
together with another, `abs(x_dot) > 0` with `sign(x_dot)`, has no way of its own: on
each side of the other it has the side that it has there. One that keeps its level on a
whole stretch, as `sign(x - max(-1, min(1, x)))` does, is on neither side.
"""

from __future__ import annotations

from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from lagsim.run.events.modes import ON
from lagsim.run.events.probe import keeps_to
from lagsim.run.events.shares import ABOVE, ALONG, BELOW, LEVEL, Crossroads

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping, Sequence

    from lagsim.language.arrays import Floats
    from lagsim.run.events.modes import Modes, Rows

# Rows of J this close to parallel are those of one surface.
PARALLEL = 1e-9
# A motion that comes to rest in a time goes no farther by then than this many times
# what its rate makes of it.
REACH = 4.0
# All corners of up to so many surfaces are looked at for the scales of their rates.
FEW_CORNERS = 3


class Crossing:
    """A state on some surfaces.

    Parameters
    ----------
    modes
        Is left in the mode that is found.
    levels
        The level of each surface that the state is on.
    sizes
        Of the terms of all surfaces.
    at_rest
        Surfaces whose rate is zero.
    held
        The way of surfaces where it is known.
    settled
        The motion has come to rest on the surfaces, by itself.
    left
        In so much time, that is.
    met
        The surface that has ended the arc before.

    Attributes
    ----------
    undecided : list of int
        The surfaces that nothing decides the way from.
    noise : ndarray, shape (K,)
        Rates of the open ones smaller than this are rounding.
    """

    def __init__(
        self,
        modes: Modes,
        levels: Mapping[int, float],
        sizes: Floats,
        at_rest: Collection[int],
        held: Mapping[int, int],
        *,
        settled: bool,
        left: float = 0.0,
        met: int | None = None,
    ) -> None:
        self.modes, self.levels, self.sizes = modes, levels, sizes
        self.at_rest, self.held, self.settled = at_rest, held, settled
        self.open: list[int] = []
        self.loose: list[int] = []
        self.undecided: list[int] = []
        self.noise = np.zeros(modes.count)
        self.left = left
        self.met = met

    def decide(self) -> None:
        """Choose the mode."""
        modes = self.modes
        now = {k: self._way_now(k) for k in self.levels}
        for k in modes.order:
            self._sort(k)
        if self.open:
            self._by_forces([now[k] for k in self.open])

    def _way_now(self, k: int) -> int:
        modes = self.modes
        above = modes.value[k] >= (self.levels[k] if modes.whole[k] else 0.5)
        return ABOVE if above else BELOW

    def _sort(self, k: int) -> None:
        """Decide what a surface's own rate decides; note what is left."""
        modes = self.modes
        hangs = not modes.depends[k].isdisjoint([*self.open, *self.loose])
        if k not in self.levels:
            if hangs:
                self.loose.append(k)
            return
        if hangs and self._follows(k):
            self.loose.append(k)
            return
        modes.write()
        rows = modes.rows()
        if modes.keeps(k):
            modes.put(k, self.levels[k], LEVEL)
            return
        rate = self._rate(rows, k)
        if rate != 0.0:
            modes.put(k, self.levels[k], ABOVE if rate > 0.0 else BELOW)
        elif self._parallel(rows, k):
            self.loose.append(k)
        else:
            self.open.append(k)

    def _rate(self, rows: Rows, k: int) -> float:
        """Give the rate of a surface in positions; 0 where it is rounding."""
        modes, n = self.modes, self.modes.arc.system.n
        if modes.of_velocities[k] or k in self.at_rest:
            return 0.0
        v = modes.arc.y[n : 2 * n]
        rate = float(rows.rates[k])
        terms = np.abs(rows.J[k]) @ modes.arc.seen[n : 2 * n]
        terms += abs(rate - float(rows.J[k] @ v))
        return rate if abs(rate) > ON * terms else 0.0

    def _follows(self, k: int) -> bool:
        """Tell whether a surface's side is known on each side of the open ones."""
        modes = self.modes
        for way in (BELOW, ABOVE):
            self._settle((way,) * len(self.open))
            modes.write()
            if not (modes.keeps(k) or self._parallel(modes.rows(), k)):
                return False
        return True

    def _parallel(self, rows: Rows, k: int) -> tuple[int, float] | None:
        """Give an open surface that k steps together with, and their common sign."""
        J, b = rows.J, rows.b
        for j in self.open:
            if self.modes.of_velocities[j] != self.modes.of_velocities[k]:
                continue
            square = float(J[j] @ J[j])
            factor = float(J[k] @ J[j]) / square if square > 0.0 else 0.0
            if factor == 0.0:
                continue
            off = np.max(np.abs(J[k] - factor * J[j]))
            same = off <= PARALLEL * np.max(np.abs(J[k]))
            if same and abs(b[k] - factor * b[j]) <= PARALLEL * abs(b[k]):
                return j, factor
        return None

    def _settle(self, corner: Sequence[int]) -> None:
        """Put the open surfaces on these sides, and what hangs on them where it is."""
        modes, arc = self.modes, self.modes.arc
        for k, way in zip(self.open, corner, strict=True):
            modes.put(k, self.levels[k], way)
        for k in self.loose:
            modes.write()
            value = float(modes.values(arc.t, arc.y)[k])
            level = modes.level(k, value)
            if k not in self.levels and abs(value - level) > ON * self.sizes[k]:
                modes.put_clear(k, value)
                continue
            rows = modes.rows()
            if modes.keeps(k):
                modes.put(k, level, LEVEL)
                continue
            found = self._parallel(rows, k)
            if found is not None:
                leader, factor = found
                way = corner[self.open.index(leader)]
                modes.put(k, level, way if factor > 0.0 else 1 - way)
        modes.write()

    def _by_forces(self, now: list[int]) -> None:
        """Decide the rest by what the forces do on each side."""
        several = list(self.open)
        held = {i: self.held[k] for i, k in enumerate(self.open) if k in self.held}
        crossroads = self._crossroads(held)
        if not (held or self.at_rest):
            resting = self._let_rest(crossroads)
            if not self.open:
                return
            if resting:
                now = [
                    way for k, way in zip(several, now, strict=True) if k in self.open
                ]
                crossroads = self._crossroads(held)
        found = crossroads.way(now)
        if found is None or crossroads.is_fork(found):
            self.undecided = self.open
        self._take(found or now)

    def _let_rest(self, crossroads: Crossroads) -> list[int]:
        """Put the motion on the level of the surfaces that it does not leave.

        With the values that are written there, sign(0) = 0, and whatever the others do.
        Surfaces that attract are none: it may have to be held on these; nor is one that
        it has just come to. Give them.
        """
        modes = self.modes
        former = modes.value.copy(), modes.kind.copy()
        low = (BELOW,) * len(self.open)
        base = crossroads.rates(low)
        drawn = [
            (crossroads.rates((*low[:i], ABOVE, *low[i + 1 :])) - base)[i]
            for i in range(len(low))
        ]
        free = -crossroads.tolerance <= np.array(drawn)
        free &= np.array(self.open) != self.met
        near = [k for k in self.loose if k in self.levels and k != self.met]
        resting = [*(k for k, x in zip(self.open, free, strict=True) if x), *near]
        for k in (*self.open, *near):
            modes.put(k, self.levels[k], LEVEL)
        most = np.zeros(modes.count)
        most[self.open] = crossroads.tolerance
        resting = [k for k in resting if self._stays(k, most[k])]
        modes.restore(*former)
        for k in resting:
            modes.put(k, self.levels[k], LEVEL)
        others = [k for k in self.open if k not in resting]
        for way in (BELOW, ABOVE) if others else ():
            for k in others:
                modes.put(k, self.levels[k], way)
            if not all(self._stays(k, most[k]) for k in resting):
                resting = []
        if not resting or set(resting).isdisjoint(self.open):
            modes.restore(*former)
            return []
        self.open = others
        self.loose = [k for k in self.loose if k not in resting]
        modes.watch(resting)
        return resting

    def _stays(self, k: int, tolerance: float) -> bool:
        """Tell whether the motion stays on surface k in the mode there is.

        A short step tells, whatever the order in which it would leave.
        """
        modes, arc, n = self.modes, self.modes.arc, self.modes.arc.system.n
        modes.write()
        rows, a = modes.rows(), modes.field()[:n]
        if not abs(float(rows.J[k] @ a - rows.b[k])) <= tolerance:
            return False
        return (
            keeps_to(
                np.ones(1),
                modes.rates,
                lambda t, y: modes.values(t, y)[[k]] - self.levels[k],
                arc.t,
                arc.y,
                arc.settings.duration,
                ON * self.sizes[[k]],
            )
            is None
        )

    def _take(self, ways: Sequence[int]) -> None:
        """Take a way, with what steps together with the surfaces that it follows."""
        modes = self.modes
        base = [BELOW if way == ALONG else way for way in ways]
        self._settle(base)
        low, kind = modes.value.copy(), modes.kind.copy()
        along = [i for i, way in enumerate(ways) if way == ALONG]
        carried = {}
        for i in along:
            self._settle([*base[:i], ABOVE, *base[i + 1 :]])
            for k in self.loose:
                steps = modes.value[k] != low[k]
                if steps or (k in self.levels and k not in carried):
                    carried[k] = self.open[i], float(modes.value[k])
        modes.restore(low, kind)
        for k, (leader, high) in carried.items():
            modes.carry(k, leader, high)
        for i in along:
            modes.put(self.open[i], self.levels[self.open[i]], ALONG)

    def _corners(self) -> list[tuple[int, ...]]:
        """Give corners to look at for scales: all of few."""
        count = len(self.open)
        if count <= FEW_CORNERS:
            return list(product((BELOW, ABOVE), repeat=count))
        return [(BELOW,) * count, (ABOVE,) * count]

    def _crossroads(self, held: dict[int, int]) -> Crossroads:
        """Give what the forces do with each of the surfaces below or above."""
        modes, arc = self.modes, self.modes.arc
        levels = np.array([self.levels[k] for k in self.open])

        def terms(corner: Sequence[int], y: Floats) -> tuple[Floats, Floats, Floats]:
            self._settle(corner)
            rows = modes.rows(y)
            a = modes.rates(arc.t, y)[arc.system.n : 2 * arc.system.n]
            return rows.J[self.open], rows.b[self.open], a

        def rates(corner: Sequence[int], y: Floats = arc.y) -> Floats:
            J, b, a = terms(corner, y)
            # What has no value tells nothing.
            return np.nan_to_num(J @ a - b, nan=0.0, posinf=0.0, neginf=0.0)

        def stays(corner: Sequence[int]) -> bool | None:
            self._settle(corner)
            return keeps_to(
                np.where(np.array(corner) == ABOVE, 1.0, -1.0),
                modes.rates,
                lambda t, y: modes.values(t, y)[self.open] - levels,
                arc.t,
                arc.y,
                arc.settings.duration,
                ON * self.sizes[self.open],
            )

        scale, noise = np.zeros((2, len(self.open)))
        reach = REACH * self.left * np.abs(modes.rates(arc.t, arc.y))
        for corner in self._corners():
            J, b, a = terms(corner, arc.y)
            scale = np.fmax(scale, np.abs(J) @ np.abs(a) + np.abs(b))
            for aside in modes.asides(reach):
                noise = np.fmax(noise, np.abs(rates(corner, aside) - rates(corner)))
        self.noise[self.open] = noise
        settled = self.settled or not np.all(scale > noise)
        return Crossroads(rates, scale, held, stays, noise=noise, settled=settled)
