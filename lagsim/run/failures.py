"""Failures of a method, and stiffness: another method goes on, or the run ends.

A series has no finite coefficients where an expression has a value and no derivative
(drag that grows with the speed, from rest; a root of the time); an implicit step may
find no solution. What handles everything then takes over, and where it fails as well,
the motion itself is at an end. So it is for the method of `auto`, and for a series that
was asked for: that it does not exist says nothing about the motion. An implicit step
over a loss of rank finds a false solution: that too is left to what passes it even
where the implicit method was asked for.

Constraints that are not satisfied, however long projection goes on, end a run too.
"""

from __future__ import annotations

import math
from dataclasses import replace
from math import inf
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lagsim.errors import several
from lagsim.language.tables import ended
from lagsim.mechanics.linearisation import Linearisation, eigenmodes
from lagsim.mechanics.surfaces import expression_text
from lagsim.methods import method
from lagsim.methods.moreau import MOST_SWEEPS
from lagsim.methods.parts import parameters as kept
from lagsim.methods.parts import state as at
from lagsim.notes import Caution, Choice
from lagsim.plan.formulation import STAGES
from lagsim.plan.plan import ANY, structure
from lagsim.program.system import System
from lagsim.run.arc import LONG, SERIES
from lagsim.run.interrupt import MOST_STEPS
from lagsim.run.trajectory import GO_ON, Decision, Ending, Outcome, Source
from lagsim.tolerances import BROKEN_CONSTRAINT, TINY

if TYPE_CHECKING:
    from collections.abc import Mapping

    from lagsim.language.arrays import Flags, Floats
    from lagsim.methods.parts.driver import State
    from lagsim.run.arc import Arc


# What a kernel gives that cannot go on.
FAILED = {
    at.NOT_FINITE: Outcome.NOT_FINITE,
    at.STEP_TOO_SMALL: Outcome.STEP_TOO_SMALL,
    at.PROJECTION_FAILED: Outcome.PROJECTION_FAILED,
    at.NEWTON_FAILED: Outcome.NEWTON_FAILED,
}
WHY = {
    Outcome.NOT_FINITE: "{} finds no finite values there",
    Outcome.STEP_TOO_SMALL: "{} finds no step from there on",
    Outcome.PROJECTION_FAILED: "{} does not satisfy the constraints from there on",
    Outcome.NEWTON_FAILED: "{} cannot solve its equations there",
}
LOSS = "the constraints become dependent there, which {} cannot integrate through"
# What a method has noted of a loss of rank ahead of it is not another's.
NO_LOSS = {"passes": 0.0, "planned": 0.0, "tried": 0.0}


class Fallback(Source):
    """Another method, for one that fails, or does not pass what is ahead."""

    def decide(self, arc: Arc, code: int) -> Decision | None:
        """Go on with it, if there is one."""
        name = arc.runner.method.NAME
        if code == at.LOSS_AHEAD:
            return handed_over(arc, LOSS.format(name), NO_LOSS)
        if code not in FAILED or name == ANY:
            return None
        if arc.settings.method != "auto" and name != SERIES:
            return None
        return handed_over(arc, WHY[FAILED[code]].format(name), {})


def handed_over(arc: Arc, reason: str, numbers: Mapping[str, float]) -> Decision:
    """Go on with the method that handles everything."""
    arc = arc.by(replace(arc.plan, method=ANY), arc.system)
    return by_method(arc, reason, {"h": 0.0, **numbers})


def by_method(arc: Arc, reason: str, numbers: Mapping[str, float]) -> Decision:
    """Go on with an arc by another method than before."""
    choice = Choice(f"method: {arc.plan.method} from t = {arc.t:.9g} on", reason)
    return Decision(choices=(choice,), arc=arc, numbers={"at_bound": 0.0, **numbers})


# What kept a run from its end; a place or a cause follows.
FAILURES = {
    Outcome.TOO_MANY_STEPS: "too many steps ({steps}{about})",
    Outcome.NOT_FINITE: "values that are not finite{about}",
    Outcome.EVENTS_CHATTER: "the events {about} chatter, and no time passes",
    Outcome.CONSTRAINT_JUMPS: "the position that constraint `{about}` prescribes jumps",
    Outcome.SWITCHES_ACCUMULATE: "the switches {about} accumulate",
    Outcome.PARADOX: "no contact forces satisfy the laws of {about}",
    Outcome.LAW_OUT_OF_RANGE: "{about}",
    Outcome.STATE_JUMPS: "the state would have jumped",
    Outcome.TABLE_ENDS: "the table {about}",
    Outcome.UNDETERMINED_SLIDERS: "no velocities keep the forces of {about} in limits",
    Outcome.PROJECTION_FAILED: "the constraints could not be satisfied",
    Outcome.NO_ANSWER: "constraint `{about}` is not satisfied",
    Outcome.NEWTON_FAILED: "the equations of an implicit step could not be solved",
    Outcome.STEP_TOO_SMALL: "the step size became too small",
}


def reason_of(arc: Arc, ending: Ending, row: Floats | None = None) -> str:
    """Say why a run ended so, in its last arc: at the state reached, or at `row`."""
    outcome, until = ending.outcome, arc.equations.model.until
    if outcome is Outcome.DONE:
        return f"the end was reached at t = {arc.t!r}"
    if outcome is Outcome.UNTIL and until is not None:
        return f"`{until.text}` at t = {arc.t!r}"
    if outcome is Outcome.INTERRUPTED:
        return f"interrupted at t = {arc.t!r}; the rows up to there were kept"
    shown = arc.observed() if row is None else row
    what = FAILURES[outcome].format(steps=arc.steps, about=ending.about)
    text = f"{what} at t = {float(shown[0])!r} ({_described_state(arc, shown)})"
    if outcome is Outcome.STEP_TOO_SMALL:
        text += f"; {_fastest(arc)}"
    return f"{text}: {outcome.advice}{_other_means(arc, outcome)}"


def _other_means(arc: Arc, outcome: Outcome) -> str:
    """Name a method that may go on, where it is not the one that failed."""
    if outcome not in WHY or arc.runner.method.NAME == ANY:
        return ""
    if arc.plan.step is not None:
        return f", take a smaller step, or `--method {ANY}`, which chooses its own"
    return (
        f"; `--method {ANY}` needs no Taylor series of the expressions, and may get "
        "farther"
    )


def _described_state(arc: Arc, row: Floats) -> str:
    known = dict(zip(arc.system.columns.names, row, strict=False))
    shown = [f"{name} = {known[name]:.6g}" for name in arc.equations.state]
    if len(shown) > 12:
        shown = [*shown[:12], f"... {len(shown) - 12} more"]
    return ", ".join(shown)


def _fastest(arc: Arc) -> str:
    """Name the coordinate or velocity that grows fastest for its size."""
    moving = arc.state.dynamic
    rates = np.abs(arc.rates(arc.t, arc.y))[moving]
    sizes = np.abs(arc.y[moving])
    ratio = rates / np.maximum(sizes, TINY)
    ratio[~np.isfinite(rates)] = np.inf
    # A component near zero changes fast for its size without any singularity.
    k = int(np.argmax(np.where(sizes > 1e-3 * np.max(sizes), ratio, -1.0)))
    name = arc.system.state[k]
    return f"`{name}` grows fastest, at {rates[k]:.3g} per unit of time"


def end_of_table(arc: Arc) -> Ending | None:
    """End of a run in a mode beyond the points of a table that does not go on."""
    g, p, switches = arc.equations.graph, arc.system.p, arc.system.switches
    cells = [
        (g.args[x.discrete], p.flat[arc.system.place(x.variable)])
        for x in switches.modes
    ]
    cells += [
        ((s.node,), math.ceil(v))
        for s, v in zip(switches.sides, p.side, strict=False)
        if s.whole
    ]
    for args, cell in cells:
        found = ended(g, args[0], cell) if args else None
        if found is not None:
            table, knot = found
            of = expression_text(g, *table.args)
            about = f"`{table.name}` ends at {knot:.9g}, which `{of}` has reached,"
            return Ending(Outcome.TABLE_ENDS, about)
    return None


# A state that is projected is off its constraints by rounding. One that is far off,
# looked at so often and each time so many steps later, never meets them.
CHECKS = 8
APART = 10_000


class Unmet(Source):
    """Periodic check that the constraints are satisfied."""

    def __init__(self) -> None:
        self._looks = 0

    def ask_at(self, arc: Arc) -> int:
        """Return the step of the next check."""
        return (arc.steps // APART + 1) * APART

    def decide(self, arc: Arc, code: int) -> Decision | None:
        """End a run whose constraints have long not been satisfied."""
        held = arc.system.m and arc.plan.projected
        if code != at.PAUSED or arc.steps % APART or not held:
            return None
        shown = arc.observed().tolist()
        columns = dict(zip(arc.system.columns.names, shown, strict=True))
        unmet = []
        for row in arc.equations.rows:
            off, scale = (columns[x + row.name] for x in ("residual_", "scale:"))
            unmet += [row.name] if abs(off) > BROKEN_CONSTRAINT * scale else []
        self._looks = self._looks + 1 if unmet else 0
        if self._looks < CHECKS:
            return None
        return Decision(ending=Ending(Outcome.NO_ANSWER, unmet[0]))


def unsettled(arc: Arc) -> tuple[Caution, ...]:
    """Report steps whose impulses did not converge."""
    count = int(getattr(arc.state, "unsettled", 0))
    if not count:
        return ()
    text = (
        f"in {count} of {arc.steps} steps the impulses did not converge within "
        f"{MOST_SWEEPS} sweeps: contacts overlap a little; shorter steps need "
        "fewer sweeps"
    )
    return (Caution("unsettled-impulses", text),)


# --- A step held at the stability bound: say so, or go on with the stiff method
#
# By cost, not on principle: the stiff method takes over where its step is several times
# larger and its operations fewer, as a trial shows. It would damp away a fast
# oscillation that is excited and smaller than the tolerance, so one that is excited
# stays. From time to time it is asked whether the explicit method has become cheaper
# again.
#
# Source: E. Hairer and G. Wanner, Solving Ordinary Differential Equations II, 2nd ed.,
# section IV.2, for when to ask.

STIFF = "radau"
EXPLICIT = "dop853"
# Asked again after this many times as many steps at the bound.
ASKED_AGAIN = 4.0
# The eigenvalues confirm the bound from this part of it on.
CLOSE = 0.25
# What is faster than this part of the fastest is fast, and oscillates if the damping
# ratio is below the next.
FAST = 0.5
OSCILLATING = 0.1
# A fast oscillation with more than this part of the energy is excited. What follows
# slow motion quasi-statically has the fourth power of the ratio of the frequencies.
EXCITED = 1e-10
# A body that another one moves has no more than so many times the energy by which it
# depends on it: the square of how its acceleration does, in units of the fast motion.
FOLLOWS = 1e2
# Steps of the trial: some to grow, as many to measure.
TRIAL = 25
WORTH = 5.0
# After so many steps of the stiff method, and then twice as many each time, it is asked
# whether to go back: where that costs less than this part.
REVIEWED = 100
CHEAPER = 0.5


class Fast(NamedTuple):
    """The fastest motion of the scene, linearised.

    `excited` where it oscillates with energy that a stiff method would lose.
    """

    rate: float
    where: tuple[str, ...]
    excited: bool


class Stiffness(Source):
    """Asks for another method where steps are held by stability.

    And, after a while, whether one that has been taken is still the better one.
    """

    def __init__(self, arc: Arc) -> None:
        # The steps at which it is asked whether to go on with the method that there is,
        # and the state when it was asked last.
        series = arc.settings.method == "auto" and arc.plan.method == SERIES
        self._review_at = LONG if series else MOST_STEPS
        self._reviewed = arc.state

    def ask_at(self, arc: Arc) -> int:
        """Return when it is asked next whether to go on with the method."""
        another = arc.plan.method in (SERIES, STIFF)
        return self._review_at if another else MOST_STEPS

    def decide(self, arc: Arc, code: int) -> Decision | None:
        """Change the method, or say that steps are at the bound."""
        if code == at.STIFF:
            return self._considered(arc)
        if code != at.PAUSED or arc.steps < self.ask_at(arc):
            return None
        if arc.plan.method == SERIES:
            return self._series_reviewed(arc)
        return self._stiff_reviewed(arc)

    def _considered(self, arc: Arc) -> Decision:
        """Decide on a step that has been at the bound for a while."""
        asked = {"at_bound": 0.0, "ask_at": ASKED_AGAIN * arc.state.ask_at}
        return self._considered_once(arc)._replace(numbers=asked)

    def _considered_once(self, arc: Arc) -> Decision:
        scene = arc.system.equations
        # Sliding has a method of its own.
        alone = arc.slides or scene.quadratures or scene.laws
        if scene.laws and _turns_on_disc(arc):
            return GO_ON
        if alone or method(STIFF).refusal(structure(scene)):
            return GO_ON if arc.plan.method == SERIES else self._warning(arc, (), "")
        stiff = _compiled_for(arc, STIFF)
        fast = _fastest_motion(stiff)
        if fast is None:
            return self._warning(arc, (), "")
        limit = arc.runner.method.IMAGINARY_LIMIT
        if fast.rate * arc.state.step_h < CLOSE * limit:
            return GO_ON  # something else, as where rows lose their rank
        asked = arc.settings.method != "auto"
        if arc.plan.method == SERIES and (asked or fast.excited):
            return GO_ON
        if asked:
            advice = (
                f"`--method {STIFF}` takes longer steps where fast motion has died out"
            )
            return self._warning(arc, fast.where, advice)
        if fast.excited:
            advice = (
                f"this motion has energy, which {STIFF} would damp; make it rigid "
                "by a constraint, or model its damping"
            )
            return self._warning(arc, fast.where, advice)
        gained = _gain(arc, stiff)
        if gained < WORTH:
            return GO_ON
        self._reviewed, self._review_at = stiff.state.copy(), arc.steps + REVIEWED
        reason = (
            f"the step was held at the stability bound by {_named(fast.where)}, at "
            f"{fast.rate:.3g} per unit of time; {STIFF}'s is {gained:.0f} times larger"
        )
        return by_method(stiff, reason, {})

    def _warning(self, arc: Arc, where: tuple[str, ...], advice: str) -> Decision:
        h, rate = arc.state.step_h, arc.state.speed
        text = (
            f"at t = {arc.t:.9g} the step ({h:.3g}) is held at the stability bound of "
            f"{arc.runner.method.NAME}, not by accuracy: {_named(where)} at about "
            f"{rate:.3g} per unit of time"
        )
        text = f"{text}; {advice}" if advice else text
        return Decision(cautions=self.once("step-at-stability-bound", text))

    def _series_reviewed(self, arc: Arc) -> Decision:
        """Ask for the stiff method where fast motion is damped.

        A series' step for accuracy is close to its stability bound: nothing in a step
        tells that it is held there.
        """
        self._review_at = int(ASKED_AGAIN) * arc.steps
        state, equations = arc.state, arc.system.equations
        if equations.quadratures:
            return GO_ON
        try:
            blocks = state.positions, state.velocities, state.first_order
            linear = Linearisation(equations).at(arc.t, *(arc.y[x] for x in blocks))
        except ValueError:  # not finite there
            return GO_ON
        values = linear.eigenvalues()
        speeds = np.abs(values)
        fast = _fast(speeds)
        damped = np.any(values.real[fast] < -OSCILLATING * speeds[fast])
        return self._considered(arc) if damped else GO_ON

    def _stiff_reviewed(self, arc: Arc) -> Decision:
        """Go back to the explicit method where that has become cheaper."""
        state, before = arc.state, self._reviewed
        made = state.steps - before.steps
        self._review_at, self._reviewed = int(arc.steps + 2 * made), state.copy()
        fast = None if arc.slides else _fastest_motion(arc)
        if fast is None:
            return GO_ON
        enough = CHEAPER * _cost(arc, before, state)
        shortest = method(EXPLICIT).IMAGINARY_LIMIT / max(fast.rate, TINY)
        if arc.system.operations * STAGES / shortest > enough:
            return GO_ON
        explicit = _compiled_for(arc, EXPLICIT)
        cost = _cost(arc, *_trial(explicit))
        if cost > enough:
            return GO_ON
        times = enough / CHEAPER / cost
        reason = f"no longer stiff: {STIFF} takes {times:.1f} times the operations"
        return by_method(explicit, reason, {})


def _turns_on_disc(arc: Arc) -> bool:
    """Whether something slips in two directions.

    Where that begins its friction turns it fast: steps are short for a while, and
    nothing can be done about it.
    """
    p = arc.system.p
    return bool(np.any((p.law_mode == kept.SLIDING) & (p.law_pair >= 0.0)))


def _compiled_for(arc: Arc, name: str) -> Arc:
    """Arc by another method, which has functions of its own."""
    plan = replace(arc.plan, method=name)
    return arc.by(plan, System(arc.equations, plan))


def _fastest_motion(arc: Arc) -> Fast | None:
    """Analyse q' = v, (v', s') = J (q, v, s); None where J is not finite."""
    n = arc.system.n
    size, sparse = arc.system.size, arc.system.newton
    length = (size - n) * arc.state.dynamic.stop
    length = length if sparse is None else len(sparse.entries)
    J = arc.runner.function("jacobian", length)(arc.t, arc.y)
    if sparse is None:
        J = J.reshape(size - n, -1)[: arc.state.dynamic.stop - n]
    else:
        J = sparse.jacobian(n, J)
    if not np.all(np.isfinite(J)):
        return None
    whole = np.vstack([np.eye(n, J.shape[1], n), J])
    modes = eigenmodes(whole, _fast)
    masses, equations = arc.masses, arc.system.equations
    parts = modes.parts(modes.right[:n], masses, len(equations.states))
    heavy = np.max(parts, axis=1, initial=0.0) > 0.5
    names = *equations.q, *(x.name for x in equations.states)
    where = tuple(q for q, is_in in zip(names, heavy, strict=True) if is_in)
    # Of y' itself: how fast the state moves along each of them.
    rates = arc.rates(arc.t, arc.y)[arc.state.dynamic]
    swinging = np.abs(modes.amplitudes(rates)) * modes.swing(OSCILLATING)
    moving = np.abs(modes.right[:n]) @ swinging
    rate = float(np.max(np.abs(modes.values)))
    excited = rate > 0.0 and _is_excited(arc, masses * moving**2, masses, J, rate)
    return Fast(rate, where, excited)


def _is_excited(
    arc: Arc, fast: Floats, masses: Floats, J: Floats, speed: float
) -> bool:
    """Whether fast motion has energy, twice that of each coordinate in `fast`.

    Against the whole of the bodies that depend on each other, as far as they do: that
    of others, and the speed of all of them together, says nothing about it.
    """
    n = len(masses)
    by_q, by_v = J[:n, :n], J[:n, n : 2 * n]
    depends = np.abs(by_q) / speed**2 + np.abs(by_v) / speed
    roots = np.sqrt(masses)
    ratios = np.divide(
        roots[:, None], roots, out=np.full((n, n), inf), where=roots > 0.0
    )
    moved = np.where(depends > 0.0, ratios * depends, 0.0)
    # What one body's energy may leave in another that follows it quasi-statically.
    linked = np.minimum(FOLLOWS / EXCITED * np.maximum(moved, moved.T) ** 2, 1.0)
    linked = np.maximum(linked, np.eye(n))
    for _ in range(n.bit_length()):
        linked = np.minimum(linked @ linked, 1.0)
    each = masses * arc.ranges[arc.velocities] ** 2
    whole = np.minimum(linked @ each, 2.0 * arc.state.energy)
    return bool(np.any(linked @ fast > EXCITED * whole))


def _fast(speeds: Floats) -> Flags:
    """Whether each rate is large: all of them where nothing moves."""
    fast: Flags = speeds >= FAST * np.max(speeds, initial=0.0)
    return fast


def _trial(arc: Arc) -> tuple[State, State]:
    """State before and after some steps of another arc.

    On a copy; its beginning counts only if that is all.
    """
    state, p = arc.state.copy(), arc.system.p
    state.row_limit = state.arc_rows = -np.inf
    state.extras = state.ask_at = 0.0
    before, passed = state.copy(), p.passed
    cells = p.fixed, p.side, p.low, p.high, p.least, p.most
    kept = [values.copy() for values in cells]
    if arc.runner.advance(state, 1, TRIAL) == at.PAUSED:
        before = state.copy()
        arc.runner.advance(state, 1, TRIAL)
    p.passed = passed  # and it is where it was, in the cells of tables, too
    for values, former in zip(cells, kept, strict=True):
        values[:] = former
    return before, state


def _cost(arc: Arc, before: State, after: State) -> float:
    """Operations per unit of time."""
    n = arc.system.n + len(arc.system.equations.states)
    passed = after.t - before.t
    if passed == 0.0:
        return inf
    # Half of the factorisations are real (n^3/3), half complex as real ones of 2 n.
    factorisation = 0.5 * (n**3 / 3 + (2 * n) ** 3 / 3)
    if (sparse := arc.system.newton) is not None:
        factorisation = 0.5 * sparse.operations
    evaluations = after.evaluations - before.evaluations
    factorisations = after.factorisations - before.factorisations
    spent = arc.system.operations * evaluations + factorisation * factorisations
    return float(spent / passed)


def _gain(arc: Arc, stiff: Arc) -> float:
    """Ratio of the stiff method's step to this one's; 0 where it costs more."""
    before, after = _trial(stiff)
    h = arc.state.step_h
    if _cost(stiff, before, after) > stiff.system.operations * STAGES / h:
        return 0.0
    steps = after.steps - before.steps
    return float((after.t - before.t) / steps / h)


def _named(where: tuple[str, ...]) -> str:
    shown = several((f"`{name}`" for name in where), 4)
    return f"fast motion of {shown}" if where else "fast motion"
