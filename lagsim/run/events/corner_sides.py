"""Corners of equalities beside impulses: the sides onto which an impulse leads.

At the corner of a wire y = k*abs(x) the equality is one of two rows, and the impulses
of contacts and events act along the row of the side onto which they lead. A jump of
velocities is computed on each side of the corners that the state is on. It is a
solution if the velocities after it lead onto these sides. Where no side has a solution,
both rows hold, and the motion stops in the corner.
"""

from __future__ import annotations

from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from lagsim.methods.parts import parameters as kept
from lagsim.run.events.filippov import ABOVE, BELOW, SLIDING
from lagsim.run.modes import EqualitiesAlone
from lagsim.tolerances import CLEAR_OF_ROUNDING, RESIDUAL_ROUNDOFF, TINY

if TYPE_CHECKING:
    from collections.abc import Callable

    from lagsim.language.arrays import Floats
    from lagsim.run.arc import Arc
    from lagsim.run.events.filippov import SurfaceModes
    from lagsim.run.events.records import SurfacesAt

    # A function of the corners at which velocities stop, which computes the state
    # (size,) after a jump on the sides in the memory of the arc.
    Jump = Callable[[frozenset[int]], Floats]

# Modes of surfaces at whose levels the motion rests.
AT_LEVEL = (kept.FOLLOWED, kept.REDUNDANT_SIDE, kept.LEVEL)
# Largest number of corners whose sides are combined; for more the present sides stay.
MOST = 6


class CornerSides:
    """The corners of equalities that a state is on, and their sides, on trial.

    Parameters
    ----------
    arc : Arc
        The arc that has ended, at that state.
    modes : SurfaceModes
        The modes of all surfaces, in which the sides are tried.
    surfaces : SurfacesAt
        The surfaces at the instant.

    Attributes
    ----------
    corners : dict of int to float
        The level of each corner's surface, by its number.
    stopped : frozenset of int, or None
        The corners at which the last jump has stopped velocities; None before a jump.
    """

    stopped: frozenset[int] | None = None

    def __init__(self, arc: Arc, modes: SurfaceModes, surfaces: SurfacesAt) -> None:
        self.arc, self.modes = arc, modes
        modes.begin(arc, surfaces.selected)
        on = arc.system.switches.corners
        levels = dict(surfaces.levels)
        resting = [k for k in on if modes.kind[k] in AT_LEVEL and k not in levels]
        if resting:
            values = modes.values(arc.t, arc.y)
            levels |= {k: modes.level(k, float(values[k])) for k in resting}
        # Surfaces whose arguments jump with another side are decided in phase 2.
        nested = set[int]().union(*modes.depends)
        nested |= {k for k, others in enumerate(modes.depends) if others}
        found = {k: x for k, x in levels.items() if k in on and k not in nested}
        self.corners = found if len(found) <= MOST else {}
        self._former = modes.value.copy(), modes.kind.copy()

    def restore(self) -> None:
        """Restore the modes that the surfaces had before the trial.

        The phase `sides` then decides their sides by the velocities after the jump.
        """
        self.modes.restore(*self._former)
        self.modes.write()

    def project(self, y: Floats, stopped: frozenset[int]) -> None:
        """Project the velocities in y (size,), in place, onto equalities alone.

        stopped : corners at whose surfaces the velocities are stopped.
        """
        arc = self.arc
        with EqualitiesAlone(arc):
            step = arc.runner.function("velocity_step")(arc.t, y)
            y[arc.velocities] += step[: arc.system.n]
            if stopped:
                arc.runner.project_sliding(arc.t, y)

    def after(self, jump: Jump) -> Floats:
        """Return the state (size,) after a jump, on the sides onto which it leads.

        These sides are left in the memory of the arc, until `restore`. Of several
        solutions the one with the highest speed away from the corners, relative to the
        rounding of the speed, is returned. jump : the function that computes the jump.
        """
        self.stopped = frozenset()
        best, chosen = 0.0, None
        for sides in product((ABOVE, BELOW), repeat=len(self.corners)):
            self._put(sides)
            speed = self._speed(jump(frozenset()))
            if speed > max(best, 1.0):
                best, chosen = speed, sides
        if chosen is not None:
            self._put(chosen)
            return jump(frozenset())
        self._put((SLIDING,) * len(self.corners))
        self.stopped = frozenset(self.corners)
        return jump(self.stopped)

    def _put(self, sides: tuple[int, ...]) -> None:
        """Write the sides of the corners, ABOVE, BELOW or SLIDING, to the memory."""
        for (k, level), side in zip(self.corners.items(), sides, strict=True):
            self.modes.put(k, level, side)
        self.modes.write()

    def _speed(self, y: Floats) -> float:
        """Return the least speed from a corner onto its side, in units of its rounding.

        y : the state after the jump, shape (size,).
        """
        arc, modes, some = self.arc, self.modes, list(self.corners)
        rows, seen = modes.rows(y), np.abs(y[arc.velocities])
        seen = np.maximum(seen, arc.seen[arc.velocities])
        least = np.abs(rows.J[some, : arc.system.n]) @ seen
        least *= CLEAR_OF_ROUNDING * RESIDUAL_ROUNDOFF
        ways = np.array([modes.way(k, self.corners[k]) for k in some])
        return float(np.min(ways * rows.rates[some] / np.maximum(least, TINY)))
