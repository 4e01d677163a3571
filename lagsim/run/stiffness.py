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
from typing import TYPE_CHECKING

import numpy as np

from lagsim.mechanics.eigenmodes import eigenmodes, weighted
from lagsim.mechanics.linearisation import Linearisation
from lagsim.mechanics.structure import structure
from lagsim.methods import method
from lagsim.methods.parts import state as at
from lagsim.notes import Caution, Choice
from lagsim.run.states import MOST_STEPS, SERIES, taken_over
from lagsim.run.system import System

if TYPE_CHECKING:
    from lagsim.language.arrays import Flags, Floats
    from lagsim.mechanics.equations import Equations
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
# A body that another one moves has no more than so many times the energy by which it
# depends on it: the square of how its acceleration does, in units of the fast motion.
FOLLOWS = 1e2
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
    state[at.AT_BOUND] = 0.0
    state[at.ASK_AT] *= ASKED_AGAIN
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
    if fast.rate * state[at.STEP_H] < CLOSE * run.runner.method.IMAGINARY_LIMIT:
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
    n, size = run.system.n, run.system.size
    whole = np.vstack([np.hstack([np.zeros((n, n)), np.eye(n)]), J])
    modes = eigenmodes(whole, _fast)
    masses = np.maximum(run.state[at.HEADER + 3 * size + 2 :][:n], 0.0)
    heavy = np.max(weighted(modes.right[:n], masses), axis=1) > 0.5
    names = run.system.equations.q
    where = tuple(q for q, is_in in zip(names, heavy, strict=True) if is_in)
    # Of y' itself: how fast the state moves along each of them.
    rates = run.runner.function("derivative")(run.t, run.y)[: 2 * n]
    swinging = np.abs(modes.amplitudes(rates)) * modes.swing(OSCILLATING)
    moving = np.abs(modes.right[:n]) @ swinging
    rate = float(np.max(np.abs(modes.values)))
    excited = rate > 0.0 and _is_excited(run, masses * moving**2, masses, J, rate)
    return Fast(rate, where, excited)


def _is_excited(
    run: Run, fast: Floats, masses: Floats, J: Floats, speed: float
) -> bool:
    """Tell whether fast motion has energy, twice that of each coordinate in `fast`.

    Against the whole of the bodies that depend on each other, as far as they do: that
    of others, and the speed of all of them together, says nothing about it.
    """
    n = len(masses)
    depends = np.abs(J[:, :n]) / speed**2 + np.abs(J[:, n:]) / speed
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
    each = masses * run.ranges[n : 2 * n] ** 2
    whole = np.minimum(linked @ each, 2.0 * run.state[at.ENERGY])
    return bool(np.any(linked @ fast > EXCITED * whole))


def _fast(speeds: Floats) -> Flags:
    """Tell which rates are large: all of them where none moves."""
    fast: Flags = speeds >= FAST * np.max(speeds, initial=0.0)
    return fast


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
    fast = _fast(speeds)
    if np.any(values.real[fast] < -OSCILLATING * speeds[fast]):
        consider(run)


def _review_stiff(run: Run) -> None:
    """Go back to the explicit method where that has become cheaper."""
    state, before = run.state, run.reviewed
    made = state[at.STEPS] - before[at.STEPS]
    run.review_at, run.reviewed = int(state[at.STEPS] + 2 * made), state.copy()
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


def _trial(run: Run, system: System) -> tuple[Floats, Floats]:
    """Give the state before and after some steps of another method.

    On a copy; its beginning counts only if that is all.
    """
    runner, block = system.link(system.plan.method), np.empty((1, 1 + system.size))
    state = taken_over(run.state, runner)
    state[at.ROW_LIMIT], state[at.ASK_AT] = -np.inf, 0.0
    before = state.copy()
    if runner.advance(state, block, TRIAL) == at.PAUSED:
        before = state.copy()
        runner.advance(state, block, TRIAL)
    return before, state


def _cost(run: Run, before: Floats, after: Floats) -> float:
    """Give how many operations a unit of time took."""
    n = run.system.n
    passed = after[at.T] - before[at.T]
    if passed == 0.0:
        return inf
    # Half of the factorisations are real (n^3/3), half complex as real ones of 2 n.
    factorisation = 0.5 * (n**3 / 3 + (2 * n) ** 3 / 3)
    evaluations = after[at.EVALUATIONS] - before[at.EVALUATIONS]
    factorisations = after[at.FACTORISATIONS] - before[at.FACTORISATIONS]
    spent = _operations(run.equations) * evaluations + factorisation * factorisations
    return float(spent / passed)


def _gain(run: Run, system: System) -> float:
    """Give how many times larger the stiff method's step is; 0 where it costs more."""
    before, after = _trial(run, system)
    h = run.state[at.STEP_H]
    if _cost(run, before, after) > _operations(run.equations) * PER_STEP / h:
        return 0.0
    steps = after[at.STEPS] - before[at.STEPS]
    return float((after[at.T] - before[at.T]) / steps / h)


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
    state[at.AT_BOUND] = 0.0
    run.plan = system.plan
    run.use(system)
    run.state = state


def _warn(run: Run, where: tuple[str, ...], advice: str) -> None:
    code = "step-at-stability-bound"
    if any(c.code == code for c in run.warnings):
        return
    h, rate = run.state[at.STEP_H], run.state[at.SPEED]
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
