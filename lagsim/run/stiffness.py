"""A step held at the stability bound: say so, or go on with the stiff method.

By cost, not on principle: the stiff method takes over where its step is several times
larger and its operations fewer, as a trial shows. It would damp away a fast oscillation
that is excited and smaller than the tolerance, so one that is excited stays. From time
to time it is asked whether the explicit method has become cheaper again.

Source: E. Hairer and G. Wanner, Solving Ordinary Differential Equations II, 2nd ed.,
section IV.2, for when to ask.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import inf
from typing import TYPE_CHECKING, Any

import numpy as np

from lagsim.mechanics.linearisation import Linearisation
from lagsim.mechanics.structure import structure
from lagsim.methods import method
from lagsim.methods.parts import state as at
from lagsim.notes import Caution, Choice
from lagsim.run.states import MOST_STEPS, SERIES, taken_over
from lagsim.run.system import System

if TYPE_CHECKING:
    from lagsim.language.arrays import Floats
    from lagsim.mechanics.equations import Equations
    from lagsim.methods.parts.state import State
    from lagsim.run.arcs import Run

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
# Steps of the trial: some to grow, as many to measure.
TRIAL = 25
WORTH = 5.0
# Evaluations in a step of DOP853.
PER_STEP = 12.0
# After so many steps of the stiff method, and then twice as many each time, it is asked
# whether to go back: where that costs less than this part.
REVIEWED = 100
CHEAPER = 0.5


@dataclass(frozen=True, slots=True)
class Fast:
    """The fastest motion of the scene, linearised.

    `excited` where it oscillates with energy that a stiff method would lose.
    """

    rate: float
    where: tuple[str, ...]
    excited: bool


def consider(run: Run) -> None:
    """Act on a step that has been at the bound for a while."""
    state = run.state
    state.at_bound = 0.0
    state.ask_at *= ASKED_AGAIN
    n = run.system.n
    sliding = run.switching is not None and bool(np.any(run.switching.slides))
    # Sliding has a method of its own.
    scene = run.system.equations
    if sliding or scene.quadratures or method(STIFF).refusal(structure(scene)):
        if run.plan.method != SERIES:
            _warn(run, (), "")
        return
    plan = replace(run.plan, method=STIFF)
    system = System(run.equations, plan)
    system.take_modes(run.system)
    runner = system.link(STIFF)
    runner.prepare()
    J = runner.function("jacobian", (n + 1) * 2 * n)(run.t, run.y)[: 2 * n * n]
    if not np.all(np.isfinite(J)):
        _warn(run, (), "")
        return
    fast = _fastest(run, J.reshape(n, 2 * n))
    if fast.rate * state.step_h < CLOSE * run.runner.method.IMAGINARY_LIMIT:
        return  # something else, as where rows lose their rank
    series = run.plan.method == SERIES
    if series and (run.simulation.method != "auto" or fast.excited):
        return
    if run.simulation.method != "auto":
        advice = f"`--method {STIFF}` passes over fast motion that has died out"
        _warn(run, fast.where, advice)
        return
    if fast.excited:
        advice = (
            f"it is excited, and {STIFF} would damp it away; hold it rigid by a "
            "constraint, or give it the damping it has"
        )
        _warn(run, fast.where, advice)
        return
    gained = _gain(run, system)
    if gained >= WORTH:
        _switch(run, system, fast, gained)


def _fastest(run: Run, J: Floats) -> Fast:
    """Analyse q' = v, v' = J (q, v)."""
    n = run.system.n
    whole = np.vstack([np.hstack([np.zeros((n, n)), np.eye(n)]), J])
    values, right = _fast_modes(whole)
    _, left = _fast_modes(whole.T)
    masses = np.maximum(run.state.masses[:n], 0.0)
    shape = np.abs(right[:n]) * np.sqrt(masses)[:, None]
    shape /= np.maximum(np.max(shape, axis=0), 1e-300)
    heavy = np.max(shape, axis=1) > 0.5
    names = run.system.equations.q
    where = tuple(q for q, is_in in zip(names, heavy, strict=True) if is_in)
    # Of y' itself: how fast the state moves along each of them. Left and right ones of
    # equal eigenvalues need not come in pairs.
    rates = run.runner.function("derivative")(run.t, run.y)[: 2 * n]
    amplitudes = np.linalg.lstsq(left.T @ right, left.T @ rates, rcond=None)[0]
    swinging = -values.real < OSCILLATING * np.abs(values)
    moving = np.abs(right[:n]) @ np.abs(amplitudes * swinging)
    excited = _is_excited(run, masses * moving**2, masses, J)
    return Fast(float(np.max(np.abs(values))), where, excited)


def _is_excited(run: Run, fast: Floats, masses: Floats, J: Floats) -> bool:
    """Tell whether fast motion has energy, twice that of each coordinate in `fast`.

    Against the whole of the bodies that depend on each other: that of others, and the
    speed of all of them together, says nothing about it.
    """
    n = len(masses)
    links = np.eye(n) + np.abs(np.sign(J[:, :n])) + np.abs(np.sign(J[:, n:]))
    linked = np.sign(links + links.T)
    for _ in range(n.bit_length()):
        linked = np.sign(linked @ linked)
    each = masses * run.ranges[n : 2 * n] ** 2
    whole = np.minimum(linked @ each, 2.0 * run.state.energy)
    return bool(np.any(linked @ fast > EXCITED * whole))


def _fast_modes(matrix: Floats) -> tuple[Any, Any]:
    """Give the large eigenvalues (k,) and their vectors (2 n, k)."""
    values, vectors = np.linalg.eig(matrix)
    speeds = np.abs(values)
    fast = speeds >= FAST * np.max(speeds)  # all of them where none moves
    return values[fast], vectors[:, fast]


def review(run: Run) -> None:
    """Look anew at a method that has been taken for a while."""
    if run.runner.method.NAME == SERIES:
        _review_series(run)
    else:
        _review_stiff(run)


def _review_series(run: Run) -> None:
    """Ask for the stiff method where fast motion is damped.

    A series' step for accuracy is close to its stability bound: nothing in a step tells
    that it is held there.
    """
    run.review_at = int(ASKED_AGAIN) * run.steps
    n, equations = run.system.n, run.system.equations
    if equations.quadratures:
        return
    try:
        linear = Linearisation(equations).at(run.t, run.y[:n], run.y[n : 2 * n])
    except ValueError:  # not finite there
        return
    values = linear.eigenvalues()
    speeds = np.abs(values)
    fast = speeds >= FAST * np.max(speeds, initial=0.0)
    if np.any(values.real[fast] < -OSCILLATING * speeds[fast]):
        consider(run)


def _review_stiff(run: Run) -> None:
    """Go back to the explicit method where that has become cheaper."""
    state, before = run.state, run.reviewed
    made = state.steps - before.steps
    run.review_at, run.reviewed = int(state.steps + 2 * made), state.copy()
    if run.runner.method.NAME != STIFF:
        return  # it slides
    n = run.system.n
    J = run.runner.function("jacobian", (n + 1) * 2 * n)(run.t, run.y)[: 2 * n * n]
    if not np.all(np.isfinite(J)):
        return
    rate = _fastest(run, J.reshape(n, 2 * n)).rate
    enough = CHEAPER * _cost(run, before, state)
    shortest = method(EXPLICIT).IMAGINARY_LIMIT / max(rate, 1e-300)
    if _operations(run.equations) * PER_STEP / shortest > enough:
        return
    system = System(run.equations, replace(run.plan, method=EXPLICIT))
    system.begin(run.start)
    system.take_modes(run.system)
    system.link(EXPLICIT).prepare()
    cost = _cost(run, *_trial(run, system))
    if cost > enough:
        return
    times = enough / CHEAPER / cost
    reason = f"no longer stiff: {STIFF} takes {times:.1f} times the operations"
    run.review_at = MOST_STEPS
    _go_on(run, system, reason)


def _trial(run: Run, system: System) -> tuple[State, State]:
    """Give the state before and after some steps of another method.

    On a copy; its beginning counts only if that is all.
    """
    runner, block = system.link(system.plan.method), np.empty((1, 1 + system.size))
    state = taken_over(run.state, runner)
    state.row_limit, state.ask_at = -np.inf, 0.0
    before = state.copy()
    if runner.advance(state, block, TRIAL) == at.PAUSED:
        before = state.copy()
        runner.advance(state, block, TRIAL)
    return before, state


def _cost(run: Run, before: State, after: State) -> float:
    """Give how many operations a unit of time took."""
    n = run.system.n
    passed = after.t - before.t
    if passed == 0.0:
        return inf
    # Half of the factorisations are real (n^3/3), half complex as real ones of 2 n.
    factorisation = 0.5 * (n**3 / 3 + (2 * n) ** 3 / 3)
    evaluations = after.evaluations - before.evaluations
    factorisations = after.factorisations - before.factorisations
    spent = _operations(run.equations) * evaluations + factorisation * factorisations
    return float(spent / passed)


def _gain(run: Run, system: System) -> float:
    """Give how many times larger the stiff method's step is; 0 where it costs more."""
    before, after = _trial(run, system)
    h = run.state.step_h
    if _cost(run, before, after) > _operations(run.equations) * PER_STEP / h:
        return 0.0
    steps = after.steps - before.steps
    return float((after.t - before.t) / steps / h)


def _operations(equations: Equations) -> float:
    """Give about how many operations an evaluation takes: terms, and their solution."""
    nodes = [*equations.f, *(node for row in equations.M for node in row)]
    for row in equations.rows:
        nodes += [*row.A, row.b]
    return len(equations.graph.cone(nodes)) + len(equations.q) ** 3 / 3


def _switch(run: Run, system: System, fast: Fast, gained: float) -> None:
    reason = (
        f"the step was held at the stability bound by {_named(fast.where)}, at "
        f"{fast.rate:.3g} per unit of time; {STIFF}'s is {gained:.0f} times larger"
    )
    _go_on(run, system, reason)
    run.reviewed, run.review_at = run.state.copy(), run.steps + REVIEWED


def _go_on(run: Run, system: System, reason: str) -> None:
    """Go on with another method."""
    name = system.plan.method
    run.choices.append(Choice(f"method: {name} from t = {run.t:.9g} on", reason))
    state = taken_over(run.state, system.link(name))
    state.at_bound = 0.0
    run.plan = system.plan
    run.use(system)
    run.state = state


def _warn(run: Run, where: tuple[str, ...], advice: str) -> None:
    code = "step-at-stability-bound"
    if any(c.code == code for c in run.warnings):
        return
    h, rate = run.state.step_h, run.state.speed
    text = (
        f"at t = {run.t:.9g} the step ({h:.3g}) is held at the stability bound of "
        f"{run.runner.method.NAME}, not by accuracy: {_named(where)} at about "
        f"{rate:.3g} per unit of time"
    )
    run.warnings.append(Caution(code, f"{text}; {advice}" if advice else text))


def _named(where: tuple[str, ...]) -> str:
    shown = ", ".join(f"`{name}`" for name in where[:4])
    more = f" and {len(where) - 4} more" if len(where) > 4 else ""
    return f"fast motion of {shown}{more}" if where else "fast motion"
