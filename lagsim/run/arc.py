"""An arc: a stretch of a motion by one plan, and the state that it has reached.

The memory of a method's state goes from arc to arc, and from method to method.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lagsim.methods import method
from lagsim.methods.parts.constraints import CLOSE
from lagsim.run.instants import width
from lagsim.tolerances import (
    NEARLY_DEPENDENT_ROWS,
    SAME_STEP,
    SURFACE_ROUNDOFF,
)

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from lagsim.language.arrays import Floats
    from lagsim.mechanics.equations import Equations, Instant
    from lagsim.methods.parts.driver import State
    from lagsim.model.model import Settings
    from lagsim.native.layout import Block
    from lagsim.plan.plan import Plan
    from lagsim.program.system import Runner, System

    Options = Sequence[tuple[str, float]]


# The method where the motion slides along a surface and the method of the run needs
# more of the model than y'.
SLIDING = "dop853"
# A method whose steps may fail for other reasons than stiffness: of them nothing is
# said, and it is looked at after so many steps, some ten milliseconds.
SERIES = "taylor"
LONG = 20_000
# A state that slides is pulled back by what a step errs: a few times the tolerance
# by a method that has one, and this part of the motion by any other.
MOST_PULLED = 1e-2
LEAST_PULLED = 1e-9
ERRED = 1e4


def shift(masses: Floats, change: Floats, reach: Floats, sizes: Floats) -> float:
    """Size of a change, against the reach of the coordinates that it moves.

    As `methods.parts.driver.projected`: each coordinate
    counts by its own push.
    """
    more = np.abs(change) > SURFACE_ROUNDOFF * sizes
    moved = float(masses @ np.where(more, change, 0.0) ** 2)
    if moved == 0.0:
        return 0.0
    whole = float(np.linalg.norm(masses * change * reach))
    return moved / whole if whole > 0.0 else 1.0


def largest_shift(rtol: float | None) -> float:
    """Largest shift by a projection, against the motion, that is no jump."""
    if rtol is None:
        return MOST_PULLED
    return min(MOST_PULLED, max(LEAST_PULLED, ERRED * rtol))


def empty_state(runner: Runner, options: Options = ()) -> State:
    """State of a method that nothing but its own options has been put into."""
    state = runner.empty.copy()
    for name, value in options:
        if name in state.fields:
            setattr(state, name, value)
    return state


def taken_over(state: State, runner: Runner, options: Options = ()) -> State:
    """State as that of another method or system, at the start of an arc."""
    new = empty_state(runner, options)
    own = (new.kinds, new.powers, new.joined, new.linked)
    kept = [values.copy() for values in own]
    new.take(state)
    for values, before in zip(own, kept, strict=True):
        values[:] = before
    new.fresh = 1.0
    return new


# A loss of rank is one where the rows' independence falls below this part of what it is
# in general.
LOST = 1e-5
# Steps at the stability bound after which something may be done about it.
AT_BOUND = 15
# Rates of forces are taken over this part of the time between rows.
SOON = 1e-6
# After so many steps each it is asked whether they lead to a surface or only up to it.
NEAR = 500


class Arc(NamedTuple):
    """A stretch of a motion, and the state that it has reached.

    The state is the kernels' memory: arcs hand it on, and nothing but an arc writes it.

    Attributes
    ----------
    equations : Equations
        The full ones; `system.equations` are those that are integrated.
    runner : Runner
        By the method of the plan, or the one that slides.
    state : ndarray
        See `methods.parts.state`.
    end : float
        Where the arc ends, unless something happens before.
    """

    equations: Equations
    start: Instant
    plan: Plan
    system: System
    settings: Settings
    runner: Runner
    state: State
    end: float

    @property
    def t(self) -> float:
        """The time reached."""
        return self.state.t

    @property
    def steps(self) -> int:
        """The steps made."""
        return int(self.state.steps)

    @property
    def y(self) -> Floats:
        """The state at that time: a view."""
        return self.state.y

    @property
    def velocities(self) -> Block:
        """Block of y, and of what is known of each of its components."""
        return self.state.velocities

    @property
    def sizes(self) -> Floats:
        """The largest sizes of the components so far: a view."""
        return self.state.sizes

    @property
    def seen(self) -> Floats:
        """The same, with the state reached."""
        return np.maximum(np.abs(self.y), self.sizes)

    @property
    def ranges(self) -> Floats:
        """Range of each component, including the state reached."""
        return self.ranges_to(self.y)

    @property
    def masses(self) -> Floats:
        """The diagonal of M (n,) where it was last measured."""
        return np.maximum(self.state.masses[: self.system.n], 0.0)

    @property
    def parameters(self) -> dict[str, float]:
        """The values of the parameters, and of the modes at the time reached."""
        return {p.name: p.value for p in self.equations.model.parameters} | self.modes

    @property
    def modes(self) -> dict[str, float]:
        """The values of the modes at the time reached."""
        p, names = self.system.p.flat, self.equations.model.modes
        return {name: float(p[self.system.place(name)]) for name in names}

    @property
    def slides(self) -> bool:
        """Whether the motion follows a surface."""
        return self.system.p.sliding > 0.0

    @property
    def moment(self) -> float:
        """A short time, over which rates of forces are taken."""
        return SOON * self.state.row_step

    def later(self, y: Floats, rates: Floats, moment: float) -> Floats:
        """State (size,) a moment after y, to second order, by its rates (size,)."""
        state, y = self.state, y + moment * rates
        y[state.positions] += moment**2 / 2.0 * rates[state.velocities]
        return y

    @property
    def is_looked_at(self) -> bool:
        """Whether it is asked now if steps lead to a surface."""
        return self.system.surfaces > 0 and self.steps % NEAR == 0

    def ranges_to(self, y: Floats) -> Floats:
        """Range of each component, including y."""
        state = self.state
        return np.asarray(np.maximum(state.high, y) - np.minimum(state.low, y))

    def rates(self, t: float, y: Floats) -> Floats:
        """Rates y' (size,) at t and y."""
        return self.runner.function("derivative", self.system.size)(t, y)

    def field(self, t: float, y: Floats) -> Floats:
        """Rates y' (size,) at t and y, with the sides of surfaces as they are."""
        size = self.system.size
        return self.runner.function("field", size + self.system.m)(t, y)[:size]

    def located(self, t: float, y: Floats) -> Floats:
        """Conditions of events, then `until`, at t and y; >= 0 where they are true."""
        count = len(self.state.orientation)
        return self.runner.function("located", count)(t, y) if count else np.zeros(0)

    def surface_rows(self, t: float, y: Floats) -> tuple[Floats, Floats]:
        """Residuals, rates, b, scales (4, K) of the surfaces; their rows (K, n + l)."""
        K, (starts, columns) = self.system.surfaces, self.system.pattern
        found = self.runner.function("surface_rows", 4 * K + len(columns))(t, y)
        J = np.zeros((K, len(y[self.state.driven])))
        J[np.repeat(np.arange(K), np.diff(starts)), list(columns)] = found[4 * K :]
        return found[: 4 * K].reshape(4, K), J

    def row(self, y: Floats | None = None) -> Floats:
        """Time and state (1, 1 + size), the one reached or y."""
        row = np.empty((1, 1 + self.system.size))
        row[0, 0], row[0, 1:] = self.t, self.y if y is None else y
        return row

    def observed(self, y: Floats | None = None) -> Floats:
        """Columns of the state reached, or of y."""
        return np.asarray(self.runner.tabulate(self.row(y))[0])

    def energies(self, y: Floats, shown: Floats | None = None) -> Floats:
        """Energies (works,) of what each work is done on, at this time.

        shown : the columns of y, where they are known.
        """
        if self.system.has_energies:
            return self.runner.function("energies", self.system.works)(self.t, y)
        columns = self.observed(y) if shown is None else shown
        first = self.system.columns.names.index("energy")
        return columns[first : first + self.system.works]

    def add_work(self, y: Floats, before: Floats) -> Floats:
        """Add the change of energies since a jump to works of y; return it (works,)."""
        changes = self.energies(y) - before
        y[self.state.quadratures][: self.system.works] += changes
        return changes

    def row_time(self, k: int) -> float:
        """Time of the next row (k = 0), or of one before or after it."""
        state = self.state
        return float(state.row_start + (state.row + k) * state.row_step)

    def advance(self, rows: int, budget: int) -> int:
        """Integrate on, by one call of the kernel; return its code."""
        if self.settings.moments and self.state.extras:
            self.state.extra = self._moment
        return self.runner.advance(self.state, rows, budget)

    @property
    def _moment(self) -> float:
        """The time of the next state beside the rows, where there is one."""
        return self.settings.moments[-int(self.state.extras)]

    def pass_shown(self) -> None:
        """Take it that what is shown at the time reached has been."""
        state = self.state
        if self.row_time(0) == self.t:
            state.row += 1.0
        if state.extras and self._moment == self.t:
            state.extras -= 1.0

    def put(self, y: Floats) -> None:
        """Let the state jump; how large it was, and where, stays known."""
        self.sizes[:] = self.seen
        np.minimum(self.state.low, self.y, out=self.state.low)
        np.maximum(self.state.high, self.y, out=self.state.high)
        self.y[:] = y

    def store(self, numbers: Mapping[str, float]) -> None:
        """Write numbers of the state's header, by their names."""
        for name, number in numbers.items():
            setattr(self.state, name, number)

    def next(self, end: float, ahead: float) -> Arc:
        """Arc that begins at the state reached.

        And is looked at again at the time `ahead`, if that comes before its end.
        """
        settings, runner, state = self.settings, self.runner, self.state
        if self.system.watched:
            name = self.plan.method
            # Sliding is written for y' alone.
            name = SLIDING if self.slides and method(name).NEEDS else name
            runner = self.system.link(name)
            if runner is not self.runner:
                state = taken_over(state, runner, settings.options)
        if self.system.laws:
            state.linked[:] = self.system.held_together()
        state.end = ahead = min(end, ahead)
        # A row at the instant of the end is the next arc's, or the last.
        last = settings.end - SAME_STEP * settings.output_step
        state.row_limit = state.arc_rows = min(ahead - width(settings, ahead), last)
        state.fresh = 1.0
        state.arc_start = self.t
        state.switched = state.event = state.most_step = 0.0
        return self._replace(runner=runner, state=state, end=end)

    def by(self, plan: Plan, system: System) -> Arc:
        """Return same arc by another method or another system, with its own state."""
        runner = system.link(plan.method)
        if system is not self.system:
            system.begin(self.start)
            system.take_modes(self.system)
            runner.prepare()
        state = taken_over(self.state, runner, self.settings.options)
        if plan.elimination is not self.plan.elimination:
            _set_watch(state, plan)
        return self._replace(plan=plan, system=system, runner=runner, state=state)


def first_arc(
    equations: Equations,
    start: Instant,
    plan: Plan,
    system: System,
    settings: Settings,
    longest_step: float = 0.0,
) -> Arc:
    """State at a start, on no way yet."""
    runner = system.link(plan.method)
    y = system.begin(start)
    state = empty_state(runner, settings.options)
    state.t = state.row_start = state.arc_start = settings.start
    state.row_step = settings.output_step
    if settings.moments:
        state.extras = len(settings.moments)
    state.rtol = plan.tolerance
    state.atol = -1.0 if plan.atol is None else plan.atol
    state.fixed_step = plan.step or 0.0
    state.longest = longest_step
    state.ask_at = AT_BOUND
    state.sigma = 1.0
    _set_watch(state, plan)
    state.equation[:] = [x.equality for x in equations.model.located]
    state.y[:] = y
    return Arc(equations, start, plan, system, settings, runner, state, settings.end)


def _set_watch(state: State, plan: Plan) -> None:
    """Set when a loss of rank is looked for, and what counts as one."""
    state.close_below = CLOSE * plan.smallest_singular_value
    state.lost_below = LOST * plan.smallest_singular_value
    straight = plan.elimination is not None
    state.degenerate_below = NEARLY_DEPENDENT_ROWS if straight else 0.0
