"""Switches in the state: the mode of each arc, and what a switch leads to.

At the start of an arc each surface is found to be below, above or on the state. Where
the state is on a surface, its rate decides; where that vanishes or depends on the side,
Filippov's conditions (`shares`) do: the motion leaves to a side or follows the surface.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lagsim.methods import _interface as kept
from lagsim.methods import _state as at
from lagsim.simulate.sequence import Sequence
from lagsim.simulate.shares import ABOVE, ALONG, BELOW, Crossroads
from lagsim.system.switching import on_velocities
from lagsim.trajectory import Caution, Event

if TYPE_CHECKING:
    from collections.abc import Collection

    from lagsim.native.kernel_types import Floats
    from lagsim.simulate.arcs import Run
    from lagsim.switches import Side

# A state this close to a surface, against the size of its terms, is on it.
ON = 2.0**-47
# Errors of what hardly moves, in parts of rtol and of the speed that the energy gives.
NOISE = 1e-4
# A share this far past its bound still counts as within.
SHARE_SLACK = 1e-12
# Towards a surface past which there are no finite values, steps end after this part of
# the way to it; where even that fails, after this part of it; and so often at most.
AHEAD = 0.9
BACK = 0.25
MOST_APPROACHES = 60
# They are all counted, and so many kept.
MOST_EVENTS = 10_000


class Rows(NamedTuple):
    """What surfaces do at a state, as `kkt.sliding.surface_rows` gives it."""

    residuals: Floats
    rates: Floats
    b: Floats
    scales: Floats
    J: Floats


class Switching:
    """The surfaces of a run: which side each is on.

    Attributes
    ----------
    value : ndarray, shape (K,)
        -1 or 1, or the whole number below; while sliding, of the lower side.
    slides : ndarray of bool, shape (K,)
    """

    def __init__(self, run: Run) -> None:
        self.run = run
        system = run.system
        self.sides: tuple[Side, ...] = system.switches.sides
        self.count = len(self.sides)
        self.whole = np.array([s.whole for s in self.sides])
        self.of_velocities = [on_velocities(run.equations, s) for s in self.sides]
        variables = {s.variable for s in self.sides}
        nodes = system.switches.freeze([s.node for s in self.sides])
        self.nested = bool(variables & run.equations.graph.depends(nodes))
        self.value = np.ones(self.count)
        self.slides = np.zeros(self.count, dtype=bool)
        simulation = run.simulation
        self.sequence = Sequence(simulation.start, simulation.end - simulation.start)
        self.told: set[str] = set()
        self.time = run.t
        self.approaches = 0
        self.reach = AHEAD
        self.tried_at = math.nan

    # What the compiled functions know

    def _kept(self, what: int) -> Floats:
        """Give the K numbers of one kind: a view."""
        p, first = self.run.system.p, self.run.system.switching + 1
        return p[first + what * self.count :][: self.count]

    def _write(self) -> None:
        """Tell the compiled functions the mode."""
        system = self.run.system
        system.p[system.switching] = np.count_nonzero(self.slides)
        self._kept(kept.SIDE)[:] = self.value
        self._kept(kept.SLIDES)[:] = self.slides
        value, whole = self.value, self.whole
        up = value > 0.0
        self._kept(kept.LOW)[:] = np.where(whole, value, -1.0)
        self._kept(kept.HIGH)[:] = np.where(whole, value + 1.0, 1.0)
        least, most = np.where(up, 0.0, -math.inf), np.where(up, math.inf, 0.0)
        self._kept(kept.LEAST)[:] = np.where(whole, value, least)
        self._kept(kept.MOST)[:] = np.where(whole, value + 1.0, most)

    def _rows(self) -> Rows:
        run, K = self.run, self.count
        starts, columns = run.system.pattern
        rows = run.runner.function("surface_rows", 4 * K + len(columns))(run.t, run.y)
        J = np.zeros((K, run.system.n))
        J[np.repeat(np.arange(K), np.diff(starts)), list(columns)] = rows[4 * K :]
        residuals, rates, b, scales = rows[: 4 * K].reshape(4, K)
        return Rows(residuals, rates, b, scales, J)

    def _field(self) -> Floats:
        """Give q'' with the sides as written."""
        system, run = self.run.system, self.run
        length = system.size + system.m
        found = run.runner.function("field", length)(run.t, run.y)
        return np.asarray(found[system.n : 2 * system.n])

    # The start of an arc

    def begin(
        self,
        met: int | None = None,
        *,
        at_rest: Collection[int] = (),
        time: float | None = None,
    ) -> None:
        """Choose the mode at the state reached.

        Parameters
        ----------
        met
            The surface whose mode has just ended.
        at_rest
            Surfaces that the state is on, and whose rate is zero.
        time
            What events are dated, if not the time reached.
        """
        self.time = self.run.t if time is None else time
        before = self.slides.copy()
        held = {}
        if met is not None and before[met]:
            self.run.runner.margins(self.run.t, self.run.y)
            share = self._kept(kept.SHARE)[met]
            held[met] = ABOVE if share > 0.5 else BELOW
        self.slides[:] = False
        on = set(at_rest) | ({met} if met is not None else set())
        levels, rows, sizes = self._find_sides(on)
        open_ = self._by_rates(levels, rows, at_rest)
        self._by_forces(open_, levels, held)
        self._write()
        self._set_slack(levels, rows, sizes)
        self.run.runner.pull(self.run.t, self.run.y)
        self._record(before, met)

    def _find_sides(self, on: set[int]) -> tuple[dict[int, float], Rows, Floats]:
        """Set the sides that are clear; give the level of each surface it is on.

        And the rows and the sizes of the terms. A surface may depend on others' sides.
        """
        run = self.run
        levels: dict[int, float] = {}
        for _ in range(self.count + 2 if self.nested else 1):
            self._write()
            values = run.runner.function("surfaces", self.count)(run.t, run.y)
            rows = self._rows()
            sizes = self._sizes(rows)
            old = self.value.copy()
            for k, side in enumerate(self.sides):
                level = float(np.round(values[k])) if side.whole else 0.0
                if k in on or abs(values[k] - level) <= ON * sizes[k]:
                    levels[k] = level
                elif side.whole:
                    self.value[k] = math.floor(values[k])
                else:
                    self.value[k] = 1.0 if values[k] > 0.0 else -1.0
            if np.array_equal(old, self.value):
                break
        return levels, rows, sizes

    def _sizes(self, rows: Rows) -> Floats:
        """Give the size of the terms of each surface, with sizes seen so far."""
        run, n = self.run, self.run.system.n
        seen = np.maximum(np.abs(run.y), run.sizes)
        slopes = np.abs(rows.J)
        velocities = slopes @ seen[n : 2 * n]
        terms = np.where(self.of_velocities, velocities, slopes @ seen[:n])
        return np.asarray(np.maximum(rows.scales, terms))

    def _by_rates(
        self, levels: dict[int, float], rows: Rows, at_rest: Collection[int]
    ) -> list[int]:
        """Decide what a surface's own rate decides; give the rest."""
        run, n = self.run, self.run.system.n
        seen = np.maximum(np.abs(run.y), run.sizes)[n : 2 * n]
        left = []
        for k, level in levels.items():
            rate = rows.rates[k]
            clear = ON * (np.abs(rows.J[k]) @ seen)
            if self.of_velocities[k] or k in at_rest or abs(rate) <= clear:
                left.append(k)
            else:
                self._put(k, level, ABOVE if rate > 0.0 else BELOW)
        return left

    def _put(self, k: int, level: float, way: int) -> None:
        """Put surface k below or above its level, or along it."""
        self.slides[k] = way == ALONG
        if self.sides[k].whole:
            self.value[k] = level if way == ABOVE else level - 1.0
        else:
            self.value[k] = 1.0 if way == ABOVE else -1.0

    def _by_forces(
        self,
        open_: list[int],
        levels: dict[int, float],
        held: dict[int, int],
    ) -> None:
        """Decide the rest by what the forces do on each side."""
        if not open_:
            return
        now = [self._way_now(k, levels[k]) for k in open_]
        known = {i: held[k] for i, k in enumerate(open_) if k in held}
        crossroads = self._crossroads(open_, levels, known)
        found = crossroads.way(now)
        if found is None or crossroads.is_fork(found):
            self._tell(open_)

        for k, way in zip(open_, found or now, strict=True):
            self._put(k, levels[k], way)

    def _tell(self, several: list[int]) -> None:
        """Warn of a choice that nothing decides, once."""
        names = self._names(several)
        if names not in self.told:
            self.told.add(names)
            text = (
                f"at t = {self.run.t:.9g} nothing decides how the motion goes on from "
                f"{names}: one way of several was taken"
            )
            self.run.warnings.append(Caution("unresolved-switch", text))

    def _names(self, several: Collection[int]) -> str:
        return ", ".join(f"`{self.sides[k].text}`" for k in sorted(several))

    def _way_now(self, k: int, level: float) -> int:
        if self.sides[k].whole:
            return ABOVE if self.value[k] >= level else BELOW
        return ABOVE if self.value[k] > 0.0 else BELOW

    def _crossroads(
        self, open_: list[int], levels: dict[int, float], held: dict[int, int]
    ) -> Crossroads:
        """Give what the forces do with each of the surfaces below or above."""

        def terms(corner: tuple[int, ...]) -> tuple[Floats, Floats, Floats]:
            for k, way in zip(open_, corner, strict=True):
                self._put(k, levels[k], way)
            self._write()
            rows = self._rows()
            return rows.J[open_], rows.b[open_], self._field()

        def rates(corner: tuple[int, ...]) -> Floats:
            J, b, a = terms(corner)
            return np.asarray(J @ a - b)

        scale = np.zeros(len(open_))
        for way in (BELOW, ABOVE):
            J, b, a = terms((way,) * len(open_))
            scale = np.maximum(scale, np.abs(J) @ np.abs(a) + np.abs(b))
        return Crossroads(rates, scale, held)

    def _set_slack(self, levels: dict[int, float], rows: Rows, sizes: Floats) -> None:
        """Let rounding not end a mode that has just begun, and noise none at all."""
        slack = self._kept(kept.SLACK)
        slack[:] = 0.0
        margins = self.run.runner.margins(self.run.t, self.run.y)
        for k in levels:
            least = SHARE_SLACK if self.slides[k] else ON * sizes[k]
            slack[k] = least + 2.0 * max(0.0, -margins[k])
        self._kept(kept.BAND)[:] = np.where(self.slides, 0.0, self._noise(rows))

    def _noise(self, rows: Rows) -> Floats:
        """Give what errors within the tolerance may do to each surface.

        Where a coordinate hardly moves they have any sign. The tolerance has a floor,
        see `methods._controller`.
        """
        run, n = self.run, self.run.system.n
        measured = run.runner.function("measure")(run.t, run.y)
        energy = max(float(run.state[at.ENERGY]), abs(float(measured[0])))
        masses = measured[2 : 2 + n]
        inverse = np.divide(1.0, masses, out=np.zeros(n), where=masses > 0.0)
        speeds = np.abs(rows.J) @ np.sqrt(2.0 * energy * inverse)
        step = run.t - float(run.state[at.STEP_T]) if run.steps else 0.0
        factor = NOISE * float(run.state[at.RTOL])
        return np.asarray(factor * np.where(self.of_velocities, speeds, step * speeds))

    # What a switch leads to

    def _record(self, before: Floats, met: int | None) -> None:
        for k in np.flatnonzero(before != self.slides):
            kind = "switch"
            if self.of_velocities[k]:
                kind = "stick" if self.slides[k] else "slip"
            if self.slides[k] and kind == "switch" and self.sequence.ratio() < 1.0:
                kind = "zeno"  # it has come to rest sooner than looked for
            self._event(kind, int(k))
        if met is not None and before[met] == self.slides[met]:
            self._event("switch", met)

    def _event(self, kind: str, k: int) -> None:
        events = self.run.events
        if len(events) < MOST_EVENTS:
            events.append(Event(self.time, kind, switch=self.sides[k].text))

    def meet(self) -> bool:
        """Go through the switch that was located; tell whether the motion goes on."""
        run = self.run
        k = int(run.state[at.SWITCHED]) - 1
        run.state[at.SWITCHED] = 0.0
        self.approaches = 0
        self.sequence.add(run.t, k)
        several = self.sequence.lately()
        run.accumulating = self._names(several)
        limit = self.sequence.limit()
        if limit is None:
            self.begin(k)
            return not self.sequence.is_stuck()
        self.time = limit
        for k in several:
            self._event("zeno", k)
        self.sequence.recent.clear()
        self.begin(at_rest=several, time=limit)
        return bool(np.any(self.slides[several]))

    def approach(self, end: float) -> float | None:
        """Give a time at which to end an arc that cannot be stepped over its surface.

        On its other side what is frozen may have no finite value (a root, an inverse).
        Gives None where no surface is near; the state may be on one already, which
        counts as met.
        """
        run = self.run
        self.approaches += 1
        if self.approaches > MOST_APPROACHES:
            return None
        self.reach = AHEAD if run.t != self.tried_at else self.reach * BACK
        self.tried_at = run.t
        rows = self._rows()
        forced = rows.J @ self._field() - rows.b
        speeds = np.where(self.of_velocities, forced, rows.rates)
        values = run.runner.function("surfaces", self.count)(run.t, run.y)
        ends = np.where(speeds > 0, self._kept(kept.MOST), self._kept(kept.LEAST))
        with np.errstate(divide="ignore", invalid="ignore"):
            ahead = np.where(self.slides, math.inf, (ends - values) / speeds)
        ahead[~(ahead >= 0.0)] = math.inf
        k = int(np.argmin(ahead))
        if not run.t + ahead[k] < end:
            return None
        if abs(ends[k] - values[k]) <= 8.0 * ON * self._sizes(rows)[k]:
            run.state[at.SWITCHED] = k + 1
        return float(run.t + self.reach * ahead[k])
