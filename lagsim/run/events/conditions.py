"""Truth of located conditions at an instant: of the events', then of `until`.

The kernels locate where a condition becomes true within a step
(`methods.parts.search`), and decide its truth at an instant (`methods.parts.truth`).
Here they are called, in the order of an instant; and the leeway of conditions that
constraints and contacts keep at 0 is set.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lagsim.methods.parts.truth import LEAST

if TYPE_CHECKING:
    from collections.abc import Iterable

    from lagsim.language.arrays import Flags, Floats
    from lagsim.run.arc import Arc

# Time after an instant, as a part of the output step, at which jumps show. Positions
# that accelerations alone separate must differ in doubles at `PART` of this time.
SOON = 2.0**-30
# Least number of units in the last place by which the state moves meanwhile.
PLACES = 4.0
# Increment of the difference quotients, relative to the size of a component.
PART = 2.0**-10


def located_within(arc: Arc) -> float:
    """Return the error bound, by rounding, of the time of the located condition.

    The time is that at which the condition became true; 0 if no condition was located.
    """
    return Truth(arc).run("located_within")


def is_postponed(arc: Arc) -> bool:
    """Whether the event of the located condition waits for that of another condition.

    Both events belong to one instant, see `truth.wait`.
    """
    return Truth(arc).run("wait") > 0


def rounding_of_start(arc: Arc) -> Floats:
    """Return bounds (C,) of the rounding errors of the C conditions at the start.

    The bounds are twice the changes of the conditions by the rounding of the
    expressions that define the start values.
    """
    errors = {x.name: x.error for x in arc.equations.model.initial}
    start_errors = np.array([errors.get(x, 0.0) for x in arc.system.equations.moving])
    slopes = arc.state.condition_slopes[len(arc.state.worth) :]
    slopes = np.abs(slopes.reshape(-1, len(start_errors)))
    known = np.isfinite(slopes) & (start_errors > 0.0)
    return np.asarray(2.0 * np.where(known, slopes, 0.0) @ start_errors)


class Truth:
    """Decisions of the truth of all conditions at an instant.

    The kernels decide the truth just before and just after the instant. They write it
    to two arrays (C,) of the memory, `orientation` (0 for a condition that is true) and
    `leeway`. This happens in a selection (`run.modes.Selection`), which restores both
    arrays after an error.

    Attributes
    ----------
    set_by_modes : bool
        Whether conditions contain modes that events set.
    steps : bool
        Whether conditions contain functions with jumps (steps, such as `sign`), whose
        sides are selected at an instant.
    """

    def __init__(
        self, arc: Arc, *, set_by_modes: bool = True, steps: bool = True
    ) -> None:
        self.arc, self.state, self.set_by_modes = arc, arc.state, set_by_modes
        self.steps = steps
        self._kernel, self._words = arc.runner.kernel, arc.system.p.address
        # Orientation and leeway (C,) of the conditions before `satisfied`.
        self._before: tuple[Floats, ...] = ()

    def run(self, kernel: str, *arguments: float) -> float:
        """Call a kernel of `methods.parts.truth` by its name, and return its result."""
        return self._kernel(kernel)(self.state.address, self._words, *arguments)

    def begin(self) -> None:
        """Store the truth of all conditions at the start of the run.

        A condition counts as true if it is true within its rounding, or within that of
        the expressions that define the start values. Whether a value of 0 is about to
        become false is decided by its rate, after all phases of the start (`settled`).
        """
        state, equation = self.state, self.state.equation > 0.0
        self.run("evaluate_with_bounds", -1, 0)
        np.maximum(state.zero, rounding_of_start(self.arc), out=state.zero)
        values, zero, fixed = state.worth, state.zero, np.isinf(state.leeway)
        off = (np.abs(values) > zero) & ((values < 0.0) | equation) & ~fixed
        state.orientation[:] = np.where(off, np.sign(values), 0.0)
        true = ~off & ~fixed
        state.leeway[true] = 2.0 * zero[true]

    def _store_jumps(self) -> None:
        """Store in `ahead` the jumps by which conditions become true after the instant.

        They count for the instant and for the step after it.
        """
        state, arc = self.state, self.arc
        now, delay = arc.located(arc.t, arc.y), SOON * arc.settings.output_step
        soon, sooner = self._located_after(delay, 1.0), self._located_after(delay, PART)
        true = (sooner >= 0.0) & (soon >= 0.0)
        true &= np.isfinite(sooner - now)
        true &= np.abs(sooner - now) > np.abs(soon - now) / 2.0
        true &= (state.equation == 0.0) & np.isfinite(state.leeway)
        state.ahead[:] = np.where(true, sooner - now, 0.0)

    def _located_after(self, delay: float, part: float) -> Floats:
        """Return the values (C,) of the conditions shortly after the instant.

        The time after the instant is `part` times `delay`; time and state move by at
        least some units in the last place.
        """
        arc, places = self.arc, PLACES * part / PART
        rates = np.zeros(len(arc.y))
        if arc.system.moreau is None:  # its scheme has accelerations after a step only
            rates = arc.rates(arc.t, arc.y)
        # Positions to second order, so that two points that begin together with one
        # velocity separate.
        middle = delay * part / 2.0
        rates[arc.state.positions] = (arc.y + middle * rates)[arc.velocities]
        displaced = arc.later(np.zeros(len(arc.y)), rates, delay * part)
        displaced += np.sign(displaced) * places * np.spacing(np.abs(arc.y))
        time = arc.t + max(delay * part, places * float(np.spacing(abs(arc.t))))
        return arc.located(time, arc.y + displaced)

    def decide_before(self, found: int = -1) -> None:
        """Decide all conditions at the state just before an instant; store their truth.

        found : index of the condition located at the instant, or -1.
        """
        is_late = self.run("decide_before", found)
        # A step of the time has the value before it at its own time: floor(1 - t) is 0
        # at 1. So have steps of the state, and rounding decides which others.
        if is_late or (found >= 0 and self.state.jumps_beside > 0.0):
            self._store_jumps()
            self.run("decide_before", found)

    def satisfied(self) -> set[int]:
        """Return indices of the conditions that the motion satisfies at the instant.

        A condition that is about to become false at that time counts as false.
        """
        self.keep()
        return self._marked(self.run("mark_satisfied"))

    def keep(self) -> None:
        """Copy the present truth of the conditions, for `falsified` and `wait`."""
        self._before = self.state.orientation.copy(), self.state.leeway.copy()

    def falsified(self) -> list[int]:
        """Return indices of the conditions that `satisfied` found to become false."""
        sides = zip(self._before[0].tolist(), self.state.orientation, strict=True)
        return [c for c, (before, now) in enumerate(sides) if before == 0.0 != now]

    def wait(self, waiting: Iterable[int]) -> None:
        """Restore the truth of the conditions `waiting` until `settled` decides it.

        At the instant, rounding decides on which side of its jump a function such as
        `sign` in a condition is evaluated. For the comparison in `settled` each
        condition that was false before is therefore given a value clear of 0.

        waiting : indices of conditions whose truth `satisfied` has found to change.
        """
        state, indices = self.state, list(waiting)
        state.marked[indices] = state.ahead[indices] = 0.0
        sides, leeways = (x[indices] for x in self._before)
        state.orientation[indices], state.leeway[indices] = sides, leeways
        clear = 2.0 * np.maximum(state.zero[indices], np.abs(state.worth[indices]))
        state.worth[indices] = np.where(
            sides != 0.0, sides * clear, state.worth[indices]
        )

    def mark_true(self, *, for_ever: Iterable[int] = ()) -> None:
        """Store as true from now on the conditions that were last found to become true.

        for_ever : indices of conditions that are true for the rest of the run, so that
            their events never act again.
        """
        self.run("mark_true")
        for c in for_ever:
            self.state.leeway[c] = np.inf

    def changed(self) -> set[int]:
        """Return indices of conditions that become true by modes that events set.

        Empty if conditions contain no such modes.
        """
        if not self.set_by_modes:
            return set()
        if not self.arc.steps or np.any(self.state.ahead != 0.0):
            self._store_jumps()
        return self._marked(self.run("change"))

    def settled(self, *, struck: bool) -> set[int]:
        """Return indices of conditions that are true only after all acts of an instant.

        struck : whether velocities have jumped by an impact.
        """
        by_modes = self.set_by_modes or self.steps
        jumped = int(struck or by_modes or not self.arc.steps)
        if not self.arc.steps:
            self._store_jumps()
        return self._marked(self.run("settle", jumped))

    def _marked(self, count: float) -> set[int]:
        """Return the indices of the conditions that the last kernel has marked as true.

        Where constraints may keep the value of a true condition at 0, its leeway is
        raised first.

        count : the number of marked conditions.
        """
        state = self.state
        if state.any_stays > 0.0 and self.arc.equations.model.constraints:
            raise_leeway(self.arc, state.worth, state.stays > 0.0)
        if not count:
            return set()
        return {k for k, due in enumerate(state.marked.tolist()) if due}


def raise_leeway(arc: Arc, values: Floats, which: Flags) -> None:
    """Raise the leeway of some true conditions to the tolerance of their values.

    Where a constraint keeps the value of a condition at 0, as the ground does that of
    `y <= 0`, rounding errors must not make the condition false. The tolerance of a
    value is relative to the magnitudes of the state components on which the value
    depends; that of a velocity at rest is the magnitude of its position over the
    duration of the run.

    Parameters
    ----------
    arc : Arc
        The arc, at the state reached; the leeway in its memory is changed.
    values : ndarray, shape (C,)
        Values of all conditions at the state reached.
    which : ndarray of bool, shape (C,)
        The conditions whose leeway is raised.
    """
    state, sizes = arc.state, arc.magnitudes.copy()
    speeds = sizes[state.positions] / arc.settings.duration
    sizes[state.velocities] = np.maximum(sizes[state.velocities], speeds)
    scale = np.zeros(len(values))
    for i in np.flatnonzero(sizes[state.dynamic]):
        y = arc.y.copy()
        y[i] += PART * sizes[i]
        with np.errstate(invalid="ignore"):
            scale += np.abs(arc.located(arc.t, y) - values) / PART
    part = float(arc.plan.tolerance)
    if arc.system.moreau is not None:  # its contacts move by up to one step
        part = max(part, (arc.plan.step or 0.0) / arc.settings.duration)
    which = which & np.isfinite(scale)
    state.leeway[which] = np.maximum(state.leeway, part * scale)[which]


def allow_closed(arc: Arc, y: Floats, closed: Floats) -> None:
    """Set a leeway for conditions that are satisfied at gaps of 0, after an impact.

    After an impact rounding leaves a gap of either sign, and the motion opens the gap:
    without a leeway, the condition `x <= 0` might never become true at the ground `x >=
    0`. A condition without leeway that is true at the state `closed` obtains one: the
    negative distance of its value from 0 at y, or a least distance if it is true there.

    Parameters
    ----------
    arc : Arc
        The arc that the impact ends.
    y, closed : ndarray, shape (size,)
        The state after an impact, and this state with the gaps at exactly 0.
    """
    state = arc.state
    if not len(state.orientation):
        return
    misses = arc.located(arc.t, y) * state.orientation
    satisfied = arc.located(arc.t, closed) * state.orientation <= 0.0
    satisfied &= (state.orientation != 0.0) & (state.leeway == 0.0)
    state.leeway[satisfied] = -np.maximum(misses, LEAST)[satisfied]
