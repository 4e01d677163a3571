"""Sides of steps that only conditions and output contain: their surfaces are *shown*.

A step is a function with a jump, such as `sign`; the surface is where it jumps. The
motion does not depend on these sides, and no arc ends where the motion passes such a
surface. But where the argument of `sign(x_dot)` is 0 its rounding must not decide the
step. After all modes of the motion are selected, each shown surface at its level
is therefore given

- its level, where the motion stays on it: constraints, laws or other surfaces hold the
  argument there, or the motion is at rest. The arc ends where the argument leaves the
  level by more than rounding;
- else the side to which the motion leads. Conditions use this side until the argument
  exceeds the slack of the surface, whatever its sign is meanwhile.
"""

from __future__ import annotations

import math
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from lagsim.methods.parts import parameters as kept
from lagsim.methods.parts import state as at
from lagsim.run.events.surface_modes import ABOVE, BELOW, LEVEL, SurfaceModes
from lagsim.run.trajectory import Decision, Source, Turn
from lagsim.tolerances import (
    CLEAR_OF_ROUNDING,
    HALF_OF_DIGITS,
    RESIDUAL_ROUNDOFF,
)

if TYPE_CHECKING:
    from lagsim.language.arrays import Flags, Floats
    from lagsim.run.arc import Arc
    from lagsim.run.events.records import SurfacesAt

# Newton steps by which displaced states are projected onto the rows in force.
PROJECTIONS = 3
# Parts of the displacement from which it is tested whether a surface is held.
APART = (1.0, 0.61)
# Scales of the displacement: it may be too large for Newton steps far from the origin.
SCALES = (1.0, 2.0**-10)
# Factor of the slack of an argument at its level whose rounding exceeds the slack.
GROWS = 16.0
# Error of a nearly constant coordinate, see `switching`.
NOISE = 1e-4
# Bounds of rounding by rows, as a part of the largest component.
BY_ROWS = 1e-9


class ShownSides(Source):
    """The source of the sides of shown surfaces.

    Attributes
    ----------
    modes : SurfaceModes
        The modes of all surfaces in the present arc.
    """

    def __init__(self, arc: Arc) -> None:
        self.modes = SurfaceModes(arc)
        # Each shown surface, whether it steps at whole numbers, and a bound of values
        # that may be rounding, for magnitudes up to `then`.
        self.far: list[tuple[int, bool, float]] = []
        self.then = np.zeros(0)
        self._memory: kept.Parameters | None = None
        self._modes: tuple[Floats, ...] = ()

    @cached_property
    def autonomous(self) -> bool:
        """Whether neither the motion nor an expression of a surface depends on t."""
        equations = self.modes.arc.equations
        nodes = [*equations.of_accelerations, *(x.node for x in self.modes.sides)]
        return "t" not in equations.graph.depends(nodes)

    def are_decided(self, arc: Arc) -> bool:
        """Whether no side of a shown surface need be selected.

        Each shown surface is off its levels, where steps have the values as written, or
        at its level while the motion rests: y' is 0, and nothing depends on t. Values
        are compared with bounds of an earlier instant, far above rounding.
        """
        p = arc.system.p
        if p is not self._memory:
            self._memory, self._modes = p, (p.slack, p.slides, p.least)
            return False
        if (np.maximum(np.abs(arc.y), arc.sizes) > self.then).any():
            return False
        slack, slides, least = self._modes
        values = arc.runner.function("surfaces", self.modes.count)(arc.t, arc.y)
        rests = False
        for k, is_whole, far in self.far:
            level = round(values[k]) if is_whole else 0.0
            off = abs(values[k] - level)
            free = slides[k] == slack[k] == 0.0 and least[k] == -math.inf
            if free and off > far:
                continue
            if slides[k] != kept.LEVEL or least[k] != level or not off <= slack[k]:
                return False
            rests = True
        return not rests or (self.autonomous and not arc.rates(arc.t, arc.y).any())

    def decide(self, arc: Arc, code: int) -> Decision | None:
        """Return the decision to settle where a shown surface has left its level."""
        if code != at.SWITCH_FOUND:
            return None
        hit = int(arc.state.switched) - 1
        if not arc.system.acting_surfaces <= hit < arc.system.surfaces:
            return None
        return Decision(turn=Turn.SETTLE)

    def put_on_levels(self, arc: Arc) -> None:
        """Put each shown surface that the state is on at its level, to rounding."""
        modes = self.modes
        modes.begin(arc)
        near = RESIDUAL_ROUNDOFF * modes.sizes()
        for k, value in enumerate(modes.values(arc.t, arc.y).tolist()):
            if not modes.shown[k]:
                continue
            if abs(value - modes.level(k, value)) <= near[k]:
                modes.set_mode(k, modes.level(k, value), LEVEL)
            else:
                modes.set_by_value(k, value)
        modes.write()

    def select(self, arc: Arc, surfaces: SurfacesAt) -> SurfacesAt:
        """Select the sides of all shown surfaces; return the surfaces at the instant.

        A surface whose argument has not left the slack of its side keeps this side,
        unless it has been decided at this instant before.

        surfaces : the surfaces at the instant, with the modes of the motion.
        """
        modes = self.modes
        modes.begin(arc, surfaces.selected)
        p, shown = modes.p, modes.shown_order
        slack = p.slack[: modes.count].copy()
        values = modes.values(arc.t, arc.y)
        whole = np.where(modes.whole, np.round(values), 0.0)
        off, sizes, slopes = np.abs(values - whole), *modes.term_sizes()
        far = HALF_OF_DIGITS * sizes
        if arc.system.m:
            far += BY_ROWS * np.max(arc.magnitudes, initial=0.0) * slopes
        self.far = [(k, bool(modes.whole[k]), float(far[k])) for k in shown]
        self.then = 2.0 * arc.magnitudes
        near = (off <= far) & (off < math.inf) | (off <= slack)
        is_any = near[shown].any()
        least = RESIDUAL_ROUNDOFF * (modes.including_rows(sizes) if is_any else sizes)
        decided = set[int]()
        before = modes.value.copy(), modes.kind.copy(), slack.copy()
        for k in shown:
            free = modes.kind[k] == 0.0
            if not near[k]:
                modes.set_by_value(k, values[k])
                slack[k] = 0.0
            elif free and off[k] <= slack[k] > 0.0 and k not in surfaces.shown:
                continue
            elif free and off[k] > max(least[k], slack[k]):
                modes.set_by_value(k, values[k])
                slack[k] = 0.0
            else:
                decided.add(k)
                modes.set_mode(k, float(whole[k]), LEVEL)
        if decided:
            if modes.shown_nested:
                modes.write()
            self._decide(arc, sorted(decided), values, least, slack)
        if not decided and bool(np.all((p.least < p.most) | (modes.kind != 0.0))):
            now = modes.value, modes.kind, slack
            if all(map(np.array_equal, before, now)):
                return surfaces
        modes.watched = [k for k in modes.watched if not modes.shown[k]]
        modes.watched += [k for k in shown if modes.kind[k] == kept.LEVEL]
        modes.write()
        modes.store(slack=slack)
        return surfaces._replace(shown=surfaces.shown | decided)

    def _decide(
        self, arc: Arc, on: list[int], values: Floats, least: Floats, slack: Floats
    ) -> None:
        """Select the sides of the surfaces `on`, which are at their levels.

        values : the expressions of all surfaces (K,).
        least : the rounding of all expressions (K,).
        slack : the slack of each surface (K,), changed in place.
        """
        modes = self.modes
        rates, weak, by_state, reach = modes.deciding_rates()
        keeps = arc.system.m > 0 or arc.system.p.sliding > 0.0
        clear = np.abs(rates) > weak
        moved = clear & (by_state > HALF_OF_DIGITS * np.abs(rates))
        drifts = modes.drifts() if keeps else np.zeros(modes.count)
        apart = np.maximum(CLEAR_OF_ROUNDING * least, drifts)
        slow = {k: apart[k] for k in on if not clear[k]}
        ways = np.where(clear, rates, modes.leads(slow) if slow else 0.0)
        off = np.abs(values - modes.levels)
        beyond = off > np.maximum(least, slack)
        leaves = beyond | (ways != 0.0)
        if leaves[on].any() and (keeps or not moved[on].all()):
            held = self._held(arc, values, least)
            ways[held], beyond[held] = 0.0, False
        # Changes of the expressions by errors within the tolerance.
        step = arc.t - arc.state.step_t if arc.steps else 0.0
        noise = NOISE * arc.state.rtol * np.where(modes.on_rates, 1.0, step) * reach
        for k in on:
            if beyond[k]:
                modes.set_by_value(k, values[k])
                slack[k] = 0.0
                continue
            own = max(least[k], math.ulp(0.0), 2.0 * off[k], noise[k])
            if off[k] > slack[k] > 0.0:  # the terms that cancel have become larger
                own = max(own, GROWS * off[k])
            if ways[k] != 0.0:
                modes.set_mode(k, modes.levels[k], ABOVE if ways[k] > 0.0 else BELOW)
                slack[k] = own
            else:
                slack[k] = max(own + drifts[k], slack[k])

    def _held(self, arc: Arc, values: Floats, least: Floats) -> Flags:
        """Return a mask (K,) of the expressions that constraints keep at their values.

        Such an expression, like a constant one, has an equal value at all nearby states
        that are tested, which satisfy the rows in force.

        values : the expressions of all surfaces (K,).
        least : their rounding (K,).
        """
        found = np.zeros(self.modes.count, dtype=bool)
        for scale in SCALES:
            stays = (self._stays(arc, scale * x, values, least) for x in APART)
            found |= np.all([*stays], axis=0)
        return found

    def _stays(self, arc: Arc, part: float, values: Floats, least: Floats) -> Flags:
        """Return a mask (K,) of the expressions with equal values at a nearby state.

        part : factor of the distance of this state.
        values, least : see `_held`.
        """
        modes = self.modes
        y, t = modes.displaced(part)
        if arc.system.m:
            for _ in range(PROJECTIONS):
                step = arc.runner.function("position_step")(t, y)
                y[arc.state.positions] += step[: arc.system.n]
            step = arc.runner.function("velocity_step")(t, y)
            y[arc.velocities] += step[: arc.system.n]
        if arc.system.p.sliding:
            arc.runner.project_sliding(t, y)
        rows = modes.rows(y, t)
        terms = modes.changes_by_slopes(rows, np.abs(y - arc.y))
        least = np.maximum(least, RESIDUAL_ROUNDOFF * rows.scales)
        most = np.maximum(HALF_OF_DIGITS * terms, CLEAR_OF_ROUNDING * least)
        return np.asarray(np.abs(modes.values(t, y) - values) <= most)
