"""The loop over arcs, each integrated by a kernel that fills blocks of rows.

An arc ends at a break in time, at `until`, or at the end of the run; the branch of each
switch in time is fixed within it. Blocks go to the consumers and are forgotten, so
memory does not grow with the number of rows.
"""

from __future__ import annotations

from itertools import chain
from typing import TYPE_CHECKING, Protocol

import numpy as np

from lagsim.mechanics.ldl import dense_operations
from lagsim.methods import method
from lagsim.methods.parts import state as at
from lagsim.methods.parts.singular import CLOSE
from lagsim.notes import Caution, Event
from lagsim.plan import by_loops
from lagsim.plan.solve import WELL_CONDITIONED
from lagsim.run.events.coordinates import singularity_caution
from lagsim.run.events.ranks import RankLosses
from lagsim.run.fallback import fall_back, pass_loss
from lagsim.run.pace import Pace
from lagsim.run.reasons import reason_of
from lagsim.run.states import (
    LONG,
    MOST_STEPS,
    SERIES,
    SLIDING,
    empty_state,
    extents,
    most_pulled,
    named_extents,
    taken_over,
)
from lagsim.run.system import System
from lagsim.run.system.sleepers import timed
from lagsim.run.trajectory import Outcome, Statistics, Trajectory

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from lagsim.language.arrays import Floats
    from lagsim.mechanics.equations import Equations
    from lagsim.mechanics.state import State
    from lagsim.model.settings import Settings
    from lagsim.notes import Choice
    from lagsim.plan import Plan
    from lagsim.run.events.features import Features
    from lagsim.run.events.switching import Switching
    from lagsim.run.interrupt import Interrupt

# Rows in one block: a few hundred kilobytes; fewer where there are many columns.
BLOCK = 2048
MOST_NUMBERS = 2**20
# The last row within this part of a row's spacing is the end's.
SAME_ROW = 1e-9
# A loss of rank is one where the rows' independence falls below this part of what it is
# in general.
LOST = 1e-5
# Steps at the stability bound after which something may be done about it.
AT_BOUND = 15
# Beyond so many multiplications, about a second, the loops are not gone on with.
MOST_DENSE = 10**9
# A state that is projected is off its constraints by rounding. One that is off by more
# than this part of their terms, looked at so often and each time so many steps later,
# never meets them.
MET = 1e-3
LOOKS = 8
APART = 10_000
# After so many steps each it is asked whether they lead to a surface or only up to it.
NEAR = 500


class Consumer(Protocol):
    """Takes the rows of a run, block by block."""

    def add(self, rows: Floats) -> None:
        """Take rows (k, columns) in the order of `System.columns.names`."""


class Run:
    """A run on its way."""

    def __init__(
        self,
        equations: Equations,
        start: State,
        plan: Plan,
        system: System,
        settings: Settings,
        consumers: Sequence[Consumer],
        interrupt: Interrupt | None,
        progress: Callable[[float], None] | None,
        longest_step: float = 0.0,
    ) -> None:
        self.equations, self.start, self.plan = equations, start, plan
        self.settings = settings
        self.consumers, self.interrupt, self.progress = consumers, interrupt, progress
        self.events: list[Event] = []
        self.warnings: list[Caution] = []
        self.choices: list[Choice] = []
        self.torn = ""
        self.accumulating = ""
        self.unmet: list[str] = []
        self.arcs, self.arc_steps = 0, 0.0
        self.losses = RankLosses()
        self.rows = 0
        self.pace = Pace()
        self.use(system)
        self.state = self._fresh_state(system.begin(start))
        if longest_step:
            self.state[at.LONGEST] = longest_step
        rows = max(1, min(BLOCK, MOST_NUMBERS // system.rows_observed))
        self.block = np.empty((rows, 1 + system.size))
        # Where the stiff method has taken over: the steps at which it is asked whether
        # to go back, and the state when it was asked last.
        self.review_at, self.reviewed = MOST_STEPS, self.state
        if self.settings.method == "auto" and plan.method == SERIES:
            self.review_at = LONG
        self.features: Features | None = None
        if method(plan.method).ADAPTIVE and timed(system.equations):
            from lagsim.run.events.features import Features

            self.features = Features(self)
        self.switching: Switching | None = None
        if system.surfaces:
            from lagsim.run.events.switching import Switching

            self.switching = Switching(self)

    def use(self, system: System) -> None:
        """Go on with another formulation."""
        self.system = system
        self.runner = system.link(self.plan.method)

    def _fresh_state(self, y: Floats) -> Floats:
        system, settings = self.system, self.settings
        state = empty_state(self.runner)
        state[at.T] = state[at.ROW_START] = state[at.ARC_START] = settings.start
        state[at.ROW_STEP] = settings.output_step
        self._set_tolerances(state)
        radius = settings.spectral_radius
        state[at.SPECTRAL_RADIUS] = at.USUAL_RADIUS if radius is None else radius
        state[at.ASK_AT] = AT_BOUND
        state[at.N], state[at.SIZE] = system.n, system.size
        state[at.HEALTH] = state[at.PREVIOUS_HEALTH] = 1.0
        self._set_watch(state)
        until = self.equations.model.until
        if until is not None:
            state[at.EQUATION] = until.sense.value == "="
        state[at.HEADER : at.HEADER + len(y)] = y
        return state

    def _set_tolerances(self, state: Floats) -> None:
        state[at.RTOL] = self.plan.tolerance
        state[at.ATOL] = -1.0 if self.plan.atol is None else self.plan.atol
        state[at.FIXED_STEP] = self.plan.step or 0.0

    def _set_watch(self, state: Floats) -> None:
        """Set when a loss of rank is looked for, and what counts as one."""
        usual = self.plan.independence
        state[at.CLOSE_BELOW] = CLOSE * usual
        state[at.LOST_BELOW] = LOST * usual
        straight = self.plan.elimination is not None
        state[at.DEGENERATE_BELOW] = WELL_CONDITIONED if straight else 0.0

    @property
    def t(self) -> float:
        """The time reached."""
        return float(self.state[at.T])

    @property
    def steps(self) -> int:
        """The steps made."""
        return int(self.state[at.STEPS])

    @property
    def y(self) -> Floats:
        """The state at that time: a view."""
        return self.state[at.HEADER : at.HEADER + self.system.size]

    @property
    def sizes(self) -> Floats:
        """The largest sizes of the components so far: a view."""
        size = self.system.size
        return self.state[at.HEADER + size : at.HEADER + 2 * size]

    @property
    def ranges(self) -> Floats:
        """How far each component has moved, also to the state reached."""
        low, high = extents(self.state)
        return np.asarray(np.maximum(high, self.y) - np.minimum(low, self.y))

    def whole(self, most_steps: int, arc_steps: float = 0.0) -> Trajectory:
        """Go through all arcs; each counts as some steps besides its own."""
        self.arc_steps = arc_steps
        outcome = Outcome.DONE
        for end in chain(self._breaks(), [self.settings.end]):
            if self.t > self.settings.start:
                self.events.append(Event(self.t, "switch"))
            outcome = self._between_breaks(end, most_steps)
            if outcome is not Outcome.DONE:
                break
        if outcome is Outcome.UNTIL:
            self.events.append(Event(self.t, "until"))
        self._last_row()
        return self.trajectory(outcome)

    def trajectory(self, outcome: Outcome) -> Trajectory:
        """Put together what the run has done."""
        state = self.state
        evaluations = int(state[at.EVALUATIONS])
        self.warnings += singularity_caution(self)
        all_constant = self.plan.constant >= (2 if self.system.m else 1)
        return Trajectory(
            outcome=outcome,
            reason=reason_of(self, outcome),
            start=self.settings.start,
            end=self.t,
            rows=self.rows,
            statistics=Statistics(
                self.steps,
                int(state[at.REJECTIONS]),
                evaluations,
                int(state[at.FACTORISATIONS]) + (1 if all_constant else evaluations),
                float(state[at.SMALLEST_STEP]) or None,
                self.arcs,
            ),
            events=tuple(self.events),
            warnings=tuple(self.warnings),
            choices=tuple(self.choices),
            extents=named_extents(self.state, self.system.state),
        )

    def _between_breaks(self, end: float, most_steps: int) -> Outcome:
        """Go through the arcs up to the next break in time."""
        if self._begin_arc(end):
            return Outcome.CONSTRAINT_JUMPS
        while True:
            outcome = self._arc(most_steps)
            short = outcome is Outcome.DONE and self.t < end
            blocked = outcome in _BLOCKED
            if self.switching is None or not (
                short or blocked or outcome is Outcome.SWITCHED
            ):
                return outcome
            ahead = self.switching.approach(end) if short or blocked else end
            if ahead is None and blocked:
                return outcome
            if self.state[at.SWITCHED] > 0.0:
                ahead = end
                ended = self.switching.cross()
                if ended is not None:
                    return ended
            self._set_limits(end if ahead is None else ahead)

    def _breaks(self) -> Iterator[float]:
        modes = self.system.switches.modes
        if not modes:
            return iter(())
        from lagsim.run.events.breaks import break_times

        parameters = {p.name: p.value for p in self.equations.model.parameters}
        return break_times(
            self.equations.graph,
            [mode.discrete for mode in modes],
            parameters,
            self.settings.start,
            self.settings.end,
        )

    def _begin_arc(self, end: float) -> bool:
        """Set the branches of the arc that ends at `end`; tell if a constraint tore."""
        held = self.system.m > 0 and self.plan.projected
        held = held and self.t > self.settings.start
        if not held:
            self._set_branches(end)
            self._set_limits(end)
            return False
        from lagsim.run.events.impacts import impact, row_before

        before = row_before(self)
        self._set_branches(end)
        self._set_limits(end)
        return impact(self, before)

    def _set_limits(self, end: float) -> None:
        state, settings = self.state, self.settings
        if self.switching is not None:
            self.runner = self.system.link(self._method_now())
        state[at.END] = end
        last = settings.end - SAME_ROW * settings.output_step
        state[at.ROW_LIMIT] = min(end, last)
        state[at.FRESH] = 1.0
        state[at.ARC_START] = self.t
        self.arcs += 1
        if self.features is not None:
            self.features.advance(self)

    def _method_now(self) -> str:
        """Give the method of the arc: sliding is written for y' alone."""
        assert self.switching is not None
        name = self.plan.method
        slides = bool(np.any(self.switching.slides))
        return SLIDING if slides and method(name).NEEDS else name

    def _set_branches(self, end: float) -> None:
        parameters = {p.name: p.value for p in self.equations.model.parameters}
        switches = self.system.switches
        self.system.set_modes(switches.mode_values(self.t, end, parameters))
        self.runner.prepare()
        if self.switching is not None:
            self.switching.begin()

    def row(self) -> Floats:
        """Give time and state reached (1, 1 + size)."""
        return np.concatenate([[self.t], self.y])[None, :]

    def observed(self) -> Floats:
        """Give the columns of the state reached."""
        return np.asarray(self.runner.tabulate(self.row())[0])

    def _arc(self, most_steps: int) -> Outcome:
        """Integrate to the end of the arc."""
        while True:
            outcome = self.advance(most_steps)
            if outcome is not None:
                return outcome
            if self.progress is not None:
                settings = self.settings
                self.progress((self.t - settings.start) / settings.duration)

    def advance(self, most_steps: int) -> Outcome | None:
        """Integrate on, by one call of the kernel; give an outcome if there is one."""
        state = self.state
        left = most_steps - self.steps - int(self.arcs * self.arc_steps)
        if left <= 0:
            return Outcome.TOO_MANY_STEPS
        budget = min(self.pace.steps, left, self.review_at - self.steps)
        budget = min(budget, APART - self.steps % APART)
        if self.switching is not None:
            budget = min(budget, NEAR - self.steps % NEAR)
        with self.pace.kept():
            room = self.block[: self.pace.rows]
            code = self.runner.advance(state, room, budget)
        self.emit(self.block[: int(state[at.EMITTED])])
        over = code == at.EVENT_FOUND or self.t >= self.settings.end
        over |= state[at.CUT] > 0.0  # the state is that of the step as it was
        pressed = self.interrupt is not None and self.interrupt.asked
        if pressed and not over:
            return Outcome.INTERRUPTED
        if not state[at.PULLED] <= most_pulled(self.plan.rtol):
            return Outcome.STATE_JUMPS
        if code == at.PAUSED and left <= budget:
            return Outcome.TOO_MANY_STEPS
        if code == at.PAUSED and self._never_met():
            return Outcome.NO_ANSWER
        if code == at.SWITCH_FOUND or (code == at.PAUSED and self._is_stuck()):
            return Outcome.SWITCHED
        if code in _OUTCOMES:
            outcome = _OUTCOMES[code]
            return None if fall_back(self, outcome) else outcome
        self._go_on(code)
        return None

    def _is_stuck(self) -> bool:
        """Tell whether steps lead no nearer to a surface that is reached."""
        if self.switching is None or self.steps % NEAR:
            return False
        return self.switching.is_stuck()

    def _never_met(self) -> bool:
        """Tell whether projection has not met the constraints for a long time."""
        if self.steps % APART or not (self.system.m and self.plan.projected):
            return False
        names, row = self.system.columns.names, self.observed()
        column = dict(zip(names, row.tolist(), strict=True))
        found = next(
            (
                name
                for name in (row.name for row in self.equations.rows)
                if abs(column[f"residual_{name}"]) > MET * column[f"scale.{name}"]
            ),
            None,
        )
        self.unmet = [] if found is None else [*self.unmet, found]
        return len(self.unmet) >= LOOKS

    def _go_on(self, code: int) -> None:
        """Do what the kernel has paused for."""
        if code == at.DEGENERATE:
            self._switch_to_loops()
        elif code == at.RANK_LOST:
            self.losses.note(self)
        elif code == at.LOSS_AHEAD:
            pass_loss(self)
        elif code == at.STIFF:
            from lagsim.run.stiffness import consider

            consider(self)
        elif code == at.FEATURE_PASSED:
            assert self.features is not None
            self.features.advance(self)
        elif code == at.PAUSED and self.steps >= self.review_at:
            from lagsim.run.stiffness import review

            review(self)

    def _switch_to_loops(self) -> None:
        """Go on with the QR decomposition where the rows lose their independence."""
        end = float(self.state[at.END])
        n, m = self.system.n, self.system.m
        if dense_operations(n, m) > MOST_DENSE:
            text = (
                f"at t = {self.t:.9g} the constraints come close to dependent, and "
                f"there are too many for a QR decomposition: from there on multipliers "
                "may lose digits"
            )
            self.warnings.append(Caution("nearly-dependent", text))
            self.state[at.DEGENERATE_BELOW] = 0.0
            return
        text = (
            f"at t = {self.t:.9g} the constraints come close to dependent; from there "
            "on they are solved by a QR decomposition"
        )
        self.warnings.append(Caution("nearly-dependent", text))
        self.plan = by_loops(self.plan)
        self.use(System(self.equations, self.plan))
        self.system.begin(self.start)
        self.state = taken_over(self.state, self.runner)
        self._set_tolerances(self.state)
        self._set_watch(self.state)
        self._set_branches(end)

    def emit(self, states: Floats) -> None:
        """Hand rows of times and states on, as columns."""
        if not len(states):
            return
        self.hand_on(self.runner.tabulate(states))

    def hand_on(self, rows: Floats) -> None:
        """Hand rows of columns on."""
        self.rows += len(rows)
        for consumer in self.consumers:
            consumer.add(rows)

    def _last_row(self) -> None:
        """Give the row at the time reached, unless it has been given."""
        if self.rows == 0 or self.row_time(-1) < self.t:
            self.emit(self.row())

    def row_time(self, k: int) -> float:
        """Give the time of the next row (k = 0), or of one before or after it."""
        state = self.state
        return float(state[at.ROW_START] + (state[at.ROW] + k) * state[at.ROW_STEP])


# What may come of a switch close by: past it, the arc's expressions may have no values.
_BLOCKED = (
    Outcome.NOT_FINITE,
    Outcome.STEP_TOO_SMALL,
    Outcome.PROJECTION_FAILED,
    Outcome.NEWTON_FAILED,
)
_OUTCOMES = {
    at.DONE: Outcome.DONE,
    at.EVENT_FOUND: Outcome.UNTIL,
    at.STEP_TOO_SMALL: Outcome.STEP_TOO_SMALL,
    at.NOT_FINITE: Outcome.NOT_FINITE,
    at.PROJECTION_FAILED: Outcome.PROJECTION_FAILED,
    at.NEWTON_FAILED: Outcome.NEWTON_FAILED,
}
