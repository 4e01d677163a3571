"""An arc: a time interval integrated by one plan in fixed modes, and its state.

The memory of a method's state is passed from arc to arc, and from method to method.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lagsim.methods import method
from lagsim.methods.parts.constraints import CLOSE
from lagsim.methods.parts.state import MOST_LISTED
from lagsim.program.localized import has_switches
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


# Method for motion that slides along a surface if the method of the run needs more
# functions of the model than y'.
SLIDING = "dop853"
# A method whose steps may fail for other reasons than stiffness: its failed steps are
# not reported, and its progress is examined after LONG steps, some ten milliseconds.
SERIES = "taylor"
LONG = 20_000
# The projection onto a sliding surface moves a state by the error of a step: a few
# times the tolerance of a method that has one, else this part of the motion.
MOST_PULLED = 1e-2
LEAST_PULLED = 1e-9
ERRED = 1e4


def shift(masses: Floats, change: Floats, reach: Floats, sizes: Floats) -> float:
    """Return the size (a number) of a change of coordinates relative to their ranges.

    Changes within roundoff are ignored, and each coordinate is weighted by M_ii times
    its change, as in `methods.parts.driver.projected`.

    Parameters
    ----------
    masses : ndarray, shape (n,)
        Diagonal of the mass matrix.
    change, reach, sizes : ndarray, shape (n,)
        Change, range and magnitude of each coordinate.
    """
    more = np.abs(change) > SURFACE_ROUNDOFF * sizes
    moved = float(masses @ np.where(more, change, 0.0) ** 2)
    if moved == 0.0:
        return 0.0
    whole = float(np.linalg.norm(masses * change * reach))
    return moved / whole if whole > 0.0 else 1.0


def largest_shift(rtol: float | None) -> float:
    """Return the relative shift beyond which a projection counts as a jump.

    The shift is the result of `shift`, without unit.

    rtol : relative tolerance of the method; None for a method with fixed steps.
    """
    if rtol is None:
        return MOST_PULLED
    return min(MOST_PULLED, max(LEAST_PULLED, ERRED * rtol))


def empty_state(runner: Runner, options: Options = ()) -> State:
    """Return a new state of the runner's method, with only the method's options set.

    options : names and values of the options of methods.
    """
    state = runner.empty.copy()
    for name, value in options:
        if name in state.fields:
            setattr(state, name, value)
    return state


def taken_over(state: State, runner: Runner, options: Options = ()) -> State:
    """Return a copy of a state for another method or system, at an arc's start.

    runner : the linked functions of that method.
    options : names and values of the options of methods.
    """
    new = empty_state(runner, options)
    own = (new.kinds, new.powers, new.joined, new.linked)
    kept = [values.copy() for values in own]
    new.take(state)
    for values, before in zip(own, kept, strict=True):
        values[:] = before
    new.fresh = 1.0
    return new


# Rank is lost where the smallest singular value of the constraint Jacobian falls below
# this part of its usual value.
LOST = 1e-5
# Fields of the state about a loss of rank ahead, reset when the equations are solved
# otherwise.
NO_LOSS = {"passes": 0.0, "planned": 0.0, "tried": 0.0}
# Blocks of independent coordinates are given up below this part of their volume at the
# start: rounding errors of the other accelerations are enlarged by its inverse.
SMALL_BLOCK = 0.1
# Steps at the stability bound after which the method may be replaced.
AT_BOUND = 15
# Rates of forces are differences over this part of the output interval.
SOON = 1e-6
# Number of steps between tests whether the motion crosses a surface or only nears it.
NEAR = 500


class Arc(NamedTuple):
    """A time interval with fixed modes, and the state reached in it.

    The state is the memory of the kernels. It is passed from arc to arc; only arcs and
    kernels write to it.

    Attributes
    ----------
    equations : Equations
        Complete equations of motion; `system.equations` are the ones integrated.
    start : Instant
        Start of the run.
    plan : Plan
        Formulation, solution and method of the arc.
    system : System
        Compiled functions of the plan.
    settings : Settings
        Settings of the run.
    runner : Runner
        Linked functions of the plan's method, or of the method for sliding.
    state : State
        Memory of the kernel, see `methods.parts.state`.
    end : float
        Time at which the arc ends, unless an event ends it earlier.
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
        """Current time."""
        return self.state.t

    @property
    def steps(self) -> int:
        """Number of steps so far."""
        return int(self.state.steps)

    @property
    def y(self) -> Floats:
        """State (size,) at the current time: a view."""
        return self.state.y

    @property
    def velocities(self) -> Block:
        """Slice of the velocities in y, and in arrays with an entry per component."""
        return self.state.velocities

    @property
    def sizes(self) -> Floats:
        """Largest magnitudes (size,) of the components so far: a view."""
        return self.state.sizes

    @property
    def magnitudes(self) -> Floats:
        """Largest magnitudes (size,) so far, including the current state."""
        return np.maximum(np.abs(self.y), self.sizes)

    @property
    def ranges(self) -> Floats:
        """Range (size,) of each component so far, including the current state."""
        return self.ranges_to(self.y)

    @property
    def masses(self) -> Floats:
        """Diagonal of the mass matrix M (n,) at the state of its last evaluation."""
        return np.maximum(self.state.masses[: self.system.n], 0.0)

    @property
    def parameters(self) -> dict[str, float]:
        """Values of the parameters, and of the file's modes at the current time."""
        return {p.name: p.value for p in self.equations.model.parameters} | self.modes

    @property
    def modes(self) -> dict[str, float]:
        """Values of the file's modes at the current time."""
        values = self.system.p.file_modes.tolist()
        return dict(zip(self.system.file_modes, values, strict=True))

    @property
    def slides(self) -> bool:
        """Whether the motion slides along a switching surface."""
        return self.system.p.sliding > 0.0

    @property
    def short_time(self) -> float:
        """Short time interval over which rates of forces are computed."""
        return SOON * self.state.row_step

    def later(self, y: Floats, rates: Floats, moment: float) -> Floats:
        """Return the state (size,) after a short time, to second order in `moment`.

        Parameters
        ----------
        y, rates : ndarray, shape (size,)
            State, and the rates y' there.
        moment : float
            The time step.
        """
        state, y = self.state, y + moment * rates
        y[state.positions] += moment**2 / 2.0 * rates[state.velocities]
        return y

    @property
    def checks_approach(self) -> bool:
        """Whether the run tests, after the current step, if a surface is approached.

        The test is made every NEAR steps, in models with surfaces.
        """
        return self.system.acting_surfaces > 0 and self.steps % NEAR == 0

    def ranges_to(self, y: Floats) -> Floats:
        """Return the range (size,) of each component so far, including state y."""
        state = self.state
        return np.asarray(np.maximum(state.high, y) - np.minimum(state.low, y))

    def rates(self, t: float, y: Floats) -> Floats:
        """Evaluate the rates y' (size,) at t and y."""
        return self.runner.function("derivative", self.system.size)(t, y)

    def field(self, t: float, y: Floats) -> Floats:
        """Evaluate the rates y' (size,) at t and y, all surfaces on present sides.

        Unlike `rates`, the rates of both sides are not combined along surfaces that the
        motion follows.
        """
        size = self.system.size
        return self.runner.function("field", size + self.system.m)(t, y)[:size]

    def located(self, t: float, y: Floats) -> Floats:
        """Evaluate the functions (C,) of all conditions at t and y (size,).

        The conditions are those of located events, then `until`. A condition is true
        where its function is >= 0.
        """
        count = len(self.state.orientation)
        return self.runner.function("located", count)(t, y) if count else np.zeros(0)

    def surface_rows(self, t: float, y: Floats) -> tuple[Floats, Floats]:
        """Evaluate the residuals and Jacobian rows of the K surfaces at t and y.

        Return residuals, rates, b and scales (4, K), and Jacobian rows (K, n + l) of
        q'' (n,) and of the rates of first-order states (l,).
        """
        K, (starts, columns) = self.system.surfaces, self.system.pattern
        found = self.runner.function("surface_rows", 4 * K + len(columns))(t, y)
        J = np.zeros((K, len(y[self.state.driven])))
        J[np.repeat(np.arange(K), np.diff(starts)), list(columns)] = found[4 * K :]
        return found[: 4 * K].reshape(4, K), J

    def row(self, y: Floats | None = None) -> Floats:
        """Return time and state (1, 1 + size), by default the current state."""
        row = np.empty((1, 1 + self.system.size))
        row[0, 0], row[0, 1:] = self.t, self.y if y is None else y
        return row

    def observed(self, y: Floats | None = None) -> Floats:
        """Return the output columns (k,) of the current state, or of y."""
        return np.asarray(self.runner.tabulate(self.row(y))[0])

    def energies(self, y: Floats, shown: Floats | None = None) -> Floats:
        """Return the energies (works,) of the groups on which work is done.

        A group consists of coupled coordinates, see `mechanics.groups`.

        shown : output columns of y, if they are already computed.
        """
        if self.system.has_energies:
            return self.runner.function("energies", self.system.works)(self.t, y)
        columns = self.runner.tabulate(self.row(y))[0] if shown is None else shown
        return columns[self.system.energy_columns]

    def add_work(self, y: Floats, before: Floats) -> Floats:
        """Add the change of the energies in a jump to the work integrals in y.

        Return the change (works,).

        y : (size,), changed in place.
        before : (works,), the energies before the jump.
        """
        changes = self.energies(y) - before
        y[self.state.quadratures][: self.system.works] += changes
        return changes

    def row_time(self, k: int) -> float:
        """Return the time of the next output row (k = 0), or k rows later."""
        state = self.state
        return float(state.row_start + (state.row + k) * state.row_step)

    def advance(self, rows: int, budget: int) -> int:
        """Integrate by one call of the kernel; return its code.

        rows, budget : the most output rows, and the most steps, of this call.
        """
        if self.settings.moments and self.state.extras:
            self._list_moments()
        return self.runner.advance(self.state, rows, budget)

    def _list_moments(self) -> None:
        """Write the next requested times between rows to the kernel's memory."""
        state, moments = self.state, self.settings.moments
        first = len(moments) - int(state.extras)
        times = moments[first : first + MOST_LISTED]
        state.extra_times[: len(times)] = times[::-1]
        state.extra, state.listed = times[0], float(len(times))

    @property
    def _moment(self) -> float:
        """Next requested output time between rows."""
        return self.settings.moments[-int(self.state.extras)]

    def pass_shown(self) -> None:
        """Mark the output due at the current time as written."""
        state = self.state
        if self.row_time(0) == self.t:
            state.row += 1.0
        if state.extras and self._moment == self.t:
            state.extras -= 1.0

    def replace_state(self, y: Floats) -> None:
        """Replace the state by y (size,), as after a jump.

        The largest magnitudes and the ranges still include the former state.
        """
        self.sizes[:] = self.magnitudes
        np.minimum(self.state.low, self.y, out=self.state.low)
        np.maximum(self.state.high, self.y, out=self.state.high)
        self.y[:] = y

    def store(self, numbers: Mapping[str, float]) -> None:
        """Write values, by name, into numbers of the kernel's state."""
        for name, number in numbers.items():
            setattr(self.state, name, number)

    def next(self, end: float) -> Arc:
        """Return the arc that begins at the current state and ends at `end`."""
        settings, runner, state = self.settings, self.runner, self.state
        if self.system.watched:
            name = self.plan.method
            # Sliding is written for y' alone.
            name = SLIDING if self.slides and method(name).NEEDS else name
            runner = self.system.link(name)
            if runner is not self.runner:
                state = taken_over(state, runner, settings.options)
        if self.system.laws:
            state.linked[:] = self.system.coupled_coordinates()
        state.end = end
        # A row at the instant of the end is the next arc's, or the last.
        last = settings.end - SAME_STEP * settings.output_step
        state.row_limit = state.arc_rows = min(end - width(settings, end), last)
        state.fresh = 1.0
        state.arc_start = self.t
        state.switched = state.event = state.most_step = 0.0
        fixed = self.equations, self.start, self.plan, self.system, settings
        return Arc(*fixed, runner, state, end)  # faster than `_replace`

    def by(self, plan: Plan, system: System) -> Arc:
        """Return the arc with another plan and its system, on a copy of the state."""
        runner = system.link(plan.method)
        if system is not self.system:
            system.begin(self.start)
            system.copy_modes(self.system)
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
    """Return the first arc of a run, at its start and before the first step.

    longest_step : the largest step of the method; 0 for no limit.
    plan, system : formulation and method of the run, and the compiled functions.
    """
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
    state.pause_at = AT_BOUND
    state.sigma = 1.0
    _set_watch(state, plan)
    state.equation[:] = [x.equality for x in equations.model.located]
    names = frozenset((*equations.state, "t"))
    located = equations.model.located
    state.kinked[:] = [has_switches(equations.graph, x.node, names) for x in located]
    state.poles[:] = system.poles
    state.y[:] = y
    return Arc(equations, start, plan, system, settings, runner, state, settings.end)


def _set_watch(state: State, plan: Plan) -> None:
    """Set the thresholds of sigma below which a loss of rank is searched or reported.

    Sigma is the smallest singular value of the constraint rows, or the smallest volume
    of the blocks of independent coordinates; the thresholds are parts of its usual
    value, which the plan has found.

    state : the memory of the kernels, in which the thresholds are set.
    """
    usual = plan.volume if plan.blocks else plan.smallest_singular_value
    state.close_below = CLOSE * usual
    state.lost_below = LOST * usual
    straight = plan.elimination is not None
    state.degenerate_below = NEARLY_DEPENDENT_ROWS if straight else 0.0
    if plan.blocks:
        state.degenerate_below = SMALL_BLOCK * usual
