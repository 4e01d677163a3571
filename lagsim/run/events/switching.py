"""Switches in the state: the mode of each arc, and what a switch leads to.

At the start of an arc each surface is found to be below, above or on the state. Where
the state is on a surface, its rate decides; where that vanishes or depends on the side,
Filippov's conditions (`shares`) do: the motion leaves to a side or follows the surface.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from lagsim.notes import Caution, Event
from lagsim.run.events.crossing import Crossing
from lagsim.run.events.impacts import impact, row_before
from lagsim.run.events.modes import ON, Modes
from lagsim.run.events.sequence import Sequence
from lagsim.run.events.shares import ABOVE, BELOW
from lagsim.run.states import most_pulled, pulled
from lagsim.run.trajectory import Outcome

if TYPE_CHECKING:
    from collections.abc import Collection

    from lagsim.language.arrays import Floats
    from lagsim.run.arcs import Run
    from lagsim.run.events.modes import Rows

# Errors of what hardly moves, in parts of rtol and of its speeds and what forces add.
NOISE = 1e-4
# A share this far past its bound still counts as within.
SHARE_SLACK = 1e-12
# One farther past it where it is located has not left by its bound: no share keeps to
# the surface there.
HELD = 1e-6
# What is left of accumulating switches, against the speeds there were.
LEFT = 1e-4
# Towards a surface past which there are no finite values, steps end after this part of
# the way to it; where even that fails, after this part of it; and so often at most.
AHEAD = 0.9
BACK = 0.25
MOST_APPROACHES = 60
# They are all counted, and so many kept.
MOST_EVENTS = 10_000


class Switching:
    """The switches of a run."""

    def __init__(self, run: Run) -> None:
        self.run = run
        self.modes = Modes(run)
        self.sides = self.modes.sides
        self.of_velocities = self.modes.of_velocities
        simulation = run.simulation
        self.sequence = Sequence(simulation.start, simulation.end - simulation.start)
        self.told: set[str] = set()
        self.time = run.t
        self.jumped = False
        self.approaches = 0
        self.reach = AHEAD
        self.tried_at = math.nan

    @property
    def slides(self) -> Floats:
        """The surfaces that the motion follows (K,)."""
        return self.modes.slides

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
        run, modes = self.run, self.modes
        self.time = run.t if time is None else time
        before = self.slides
        held = {}
        if met is not None and before[met]:
            run.runner.margins(run.t, run.y)
            share = modes.p.share[met]
            if share >= 0.0 - HELD and share <= 1.0 + HELD:
                held[met] = ABOVE if share > 0.5 else BELOW
        modes.forget()
        on = set(at_rest) | ({met} if met is not None else set())
        levels, rows, sizes = self._find_sides(on)
        settled = bool(at_rest) or any(before[k] for k in levels)
        left = max(0.0, self.time - run.t) if at_rest else 0.0
        crossing = Crossing(
            modes, levels, sizes, at_rest, held, settled=settled, left=left
        )
        crossing.decide()
        if crossing.undecided:
            self._tell(crossing.undecided)
            modes.choose(crossing.undecided)
        modes.write()
        modes.p.noise[:] = 2.0 * crossing.noise
        self._set_slack(levels, rows, sizes)
        self._pull(resting=bool(at_rest))
        self._record(before, met)

    def _pull(self, *, resting: bool) -> None:
        """Take the state onto the surfaces that it follows; note if that is a jump."""
        run, n = self.run, self.run.system.n
        former, seen = run.y.copy(), self.modes.seen()
        run.runner.pull(run.t, run.y)
        masses = run.runner.function("measure")(run.t, former)[2 : 2 + n]
        most = most_pulled(run.plan.rtol)
        most = max(most, LEFT) if resting else most
        for part in (slice(n), slice(n, 2 * n)):
            change = run.y[part] - former[part]
            far = pulled(masses, change, self._reach()[part], seen[part])
            if not far <= most:
                run.y[:] = former
                self.jumped = True

    def _find_sides(self, on: set[int]) -> tuple[dict[int, float], Rows, Floats]:
        """Set the sides that are clear; give the level of each surface it is on.

        And the rows and the sizes of the terms. A surface may depend on others' sides.
        """
        run, modes = self.run, self.modes
        levels: dict[int, float] = {}
        for _ in range(modes.count + 2 if modes.nested else 1):
            modes.write()
            values = modes.values(run.t, run.y)
            rows = modes.rows()
            sizes = modes.sizes(rows)
            old = modes.value.copy()
            levels = {}
            for k, value in enumerate(values):
                level = modes.level(k, value)
                if k in on or abs(value - level) <= ON * sizes[k]:
                    levels[k] = level
                else:
                    modes.put_clear(k, value)
            if np.array_equal(old, modes.value):
                break
        return levels, rows, sizes

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

    def _set_slack(self, levels: dict[int, float], rows: Rows, sizes: Floats) -> None:
        """Let rounding not end a mode that has just begun, and noise none at all."""
        slides = self.slides
        slack = self.modes.p.slack
        slack[:] = 0.0
        margins = self.run.runner.margins(self.run.t, self.run.y)
        for k in levels:
            least = SHARE_SLACK if slides[k] else ON * sizes[k]
            slack[k] = least + 2.0 * max(0.0, -margins[k])
        self.modes.p.band[:] = np.where(slides, 0.0, self._noise(rows))

    def _reach(self) -> Floats:
        """Give how far positions and velocities (2 n,) have moved.

        And would in a step, by each term of their forces alone.
        """
        run, n = self.run, self.run.system.n
        step = run.t - run.state.step_t if run.steps else 0.0
        ranges = run.ranges[: 2 * n].copy()
        ranges[n:] += step * run.state.parts[:n]
        ranges[:n] += step * ranges[n:]
        return ranges

    def _noise(self, rows: Rows) -> Floats:
        """Give what errors within the tolerance may do to each surface.

        Where a coordinate hardly moves they have any sign. The tolerance has a floor,
        see `methods._controller`.
        """
        run, n = self.run, self.run.system.n
        speeds = np.abs(rows.J) @ self._reach()[n:]
        step = run.t - run.state.step_t if run.steps else 0.0
        factor = NOISE * run.state.rtol
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

    def cross(self) -> Outcome | None:
        """Go through the switch that was located; give how the run ends there."""
        run = self.run
        before = row_before(run) if run.system.m else run.row()
        goes_on = self.meet()
        if self.jumped:
            return Outcome.STATE_JUMPS
        if not goes_on:
            return Outcome.SWITCHES_ACCUMULATE
        torn = run.system.m > 0 and impact(run, before)
        return Outcome.CONSTRAINT_JUMPS if torn else None

    def meet(self) -> bool:
        """Go through the switch that was located; tell whether the motion goes on."""
        run = self.run
        k = int(run.state.switched) - 1
        run.state.switched = 0.0
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
        modes = self.modes
        rows = modes.rows()
        forced = rows.J @ modes.field() - rows.b
        speeds = np.where(self.of_velocities, forced, rows.rates)
        values = modes.values(run.t, run.y)
        ends = np.where(speeds > 0, modes.p.most, modes.p.least)
        with np.errstate(divide="ignore", invalid="ignore"):
            ahead = np.where(modes.bound, math.inf, (ends - values) / speeds)
        ahead[~(ahead >= 0.0)] = math.inf
        k = int(np.argmin(ahead))
        if not run.t + ahead[k] < end:
            return None
        if abs(ends[k] - values[k]) <= 8.0 * ON * modes.sizes(rows)[k]:
            run.state.switched = k + 1
        return float(run.t + self.reach * ahead[k])
