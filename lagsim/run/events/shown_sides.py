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

from lagsim.methods.parts import state as at
from lagsim.native.layout import address
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
# Factor of the rounding up to which an argument is at its level, if other steps depend
# on its step: the rounding of these is measured at states that differ by its own.
APPLIED = 2.0
# Factor of the slack of sides on which other expressions depend, while the rounding of
# these is measured.
WIDER = 16.0
# Error of a nearly constant coordinate, see `switching`.
NOISE = 1e-4
# Result of the kernel `shown_are_decided` where the sides last while the motion rests.
RESTING = 2.0
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
        self.whole: list[bool] = self.modes.whole.tolist()

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
        p, kernel = arc.system.p, arc.runner.kernel("shown_are_decided")
        kernel(arc.t, address(arc.y), p.address, address(arc.sizes))
        if p.shown_decided == RESTING:
            return self.autonomous and not arc.rates(arc.t, arc.y).any()
        return bool(p.shown_decided)

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
                modes.set_by_value(k, defined(value))
        modes.write()

    def select(self, arc: Arc, surfaces: SurfacesAt) -> SurfacesAt:
        """Select the sides of all shown surfaces; return the surfaces at the instant.

        A surface whose argument has not left the slack of its side keeps this side,
        unless it has been decided at this instant before.

        surfaces : the surfaces at the instant, with the modes of the motion.
        """
        self.modes.arc = arc
        p, left = arc.system.p, self.modes.shown_order
        p.far_up_to[:] = 2.0 * arc.magnitudes
        decided: list[int] = []
        wider: list[int] = []
        while left:
            found, left = self._select(arc, surfaces, left)
            decided += found
            if left:  # changes of the state by rounding keep the sides found
                p.slack[found] *= WIDER
                wider += found
        if wider:
            p.slack[wider] /= WIDER
        if not decided:
            return surfaces
        return surfaces._replace(shown=surfaces.shown.union(decided))

    def _select(
        self, arc: Arc, surfaces: SurfacesAt, order: list[int]
    ) -> tuple[list[int], list[int]]:
        """Select the sides of the first surfaces of `order`.

        Return the surfaces that are at their levels, and the remaining ones, of which
        the first depends on a side selected here.
        """
        modes, p = self.modes, arc.system.p
        slack, kinds = p.slack.tolist(), p.slides.tolist()
        departed = p.departed.tolist()
        sizes, slopes, found = modes.term_sizes()
        values = found.tolist()
        limits = HALF_OF_DIGITS * sizes
        if arc.system.m:
            limits += BY_ROWS * np.max(arc.magnitudes, initial=0.0) * slopes
        far = limits.tolist()
        levels = {k: nearest(values[k]) if self.whole[k] else 0.0 for k in order}
        off = {k: abs(values[k] - level) for k, level in levels.items()}
        near = [
            k for k in order if off[k] <= max(far[k], slack[k]) and off[k] < math.inf
        ]
        rounding = RESIDUAL_ROUNDOFF * (modes.including_rows(sizes) if near else sizes)
        least = rounding.tolist()
        decided: list[int] = []
        left: list[int] = []
        for place, k in enumerate(order):
            if decided and not modes.depends[k].isdisjoint(decided):
                left = order[place:]
                break
            p.far[k] = far[k]
            if levels[k] != departed[k]:  # the slack is that of another level
                p.slack[k] = slack[k] = 0.0
            free, own = kinds[k] == 0.0, slack[k]
            clear = APPLIED * least[k] if modes.shown_nested else least[k]
            if k not in near or (free and off[k] > max(clear, own)):
                modes.set_by_value(k, defined(values[k]))
                p.slack[k] = 0.0
            elif free and off[k] <= own > 0.0 and k not in surfaces.shown:
                continue
            else:
                decided.append(k)
                modes.set_mode(k, levels[k], LEVEL)
                if not modes.shown_nested:
                    continue
            modes.write_shown(k)
        if decided:
            self._decide(arc, decided, found, rounding)
        for k in decided:
            modes.write_shown(k)
        return decided, left

    def _decide(self, arc: Arc, on: list[int], values: Floats, least: Floats) -> None:
        """Select the sides of the surfaces `on`, which are at their levels.

        values : the expressions of all surfaces (K,).
        least : the rounding of all expressions (K,).
        """
        modes, slack = self.modes, arc.system.p.slack
        rates, weak, by_state, reach = modes.deciding_rates().tolist()
        keeps = arc.system.m > 0 or arc.system.p.sliding > 0.0
        clear = [k for k in on if abs(rates[k]) > weak[k]]
        moved = [k for k in clear if by_state[k] > HALF_OF_DIGITS * abs(rates[k])]
        ways, drifts = {k: rates[k] for k in clear}, [0.0] * modes.count
        if len(clear) < len(on):
            drifts = modes.drifts().tolist() if keeps else drifts
            apart = np.maximum(CLEAR_OF_ROUNDING * least, drifts)
            slow = [k for k in on if k not in ways]
            led = modes.leads({k: apart[k] for k in slow}).tolist()
            ways |= {k: led[k] for k in slow}
        own_least, own_slack = least.tolist(), slack.tolist()
        off = {k: abs(float(values[k] - modes.levels[k])) for k in on}
        beyond = [k for k in on if off[k] > max(own_least[k], own_slack[k])]
        if (keeps or len(moved) < len(on)) and (beyond or any(ways.values())):
            held = self._held(arc, on, values, least)
            ways |= dict.fromkeys(held, 0.0)
            beyond = [k for k in beyond if k not in held]
            if keeps and held and len(clear) == len(on):
                drifts = modes.drifts().tolist()
        # Changes of the expressions by errors within the tolerance.
        step = arc.t - arc.state.step_t if arc.steps else 0.0
        noise = NOISE * arc.state.rtol
        for k in on:
            error = noise * (1.0 if modes.on_rates[k] else step) * reach[k]
            own = max(own_least[k], math.ulp(0.0), 2.0 * off[k], error)
            # An expression of unbounded slope (a root at 0) leaves its level at once.
            if k in beyond or not own < math.inf:
                modes.set_by_value(k, defined(values[k]))
                slack[k] = 0.0
                continue
            if off[k] > own_slack[k] > 0.0:  # the terms that cancel have become larger
                own = max(own, GROWS * off[k])
            if ways[k] != 0.0:
                modes.set_mode(k, modes.levels[k], ABOVE if ways[k] > 0.0 else BELOW)
                slack[k] = own
            else:
                slack[k] = max(own + drifts[k], own_slack[k])

    def _held(
        self, arc: Arc, on: list[int], values: Floats, least: Floats
    ) -> list[int]:
        """Return those of the surfaces `on` that constraints keep at their levels.

        The expression of such a surface, like a constant one, has an equal value at all
        nearby states that are tested, which satisfy the rows in force.

        values : the expressions of all surfaces (K,).
        least : their rounding (K,).
        """
        held = set[int]()
        for scale in SCALES:
            left = on
            for part in APART:
                if left:
                    stays = self._stays(arc, scale * part, values, least)
                    left = [k for k in left if stays[k]]
            held.update(left)
        return sorted(held)

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


def nearest(value: float) -> float:
    """Return the whole number closest to `value`; a value that is not finite itself."""
    return float(round(value)) if math.isfinite(value) else value


def defined(value: float) -> float:
    """Return `value`, or 0 if it is not finite: its step has no value on any side."""
    return value if math.isfinite(value) else 0.0
