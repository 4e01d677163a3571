"""A step held at the stability bound: say so, or go on with the stiff method.

By cost, not on principle: the stiff method takes over where its step is several times
larger and its operations fewer, as a trial shows. It would damp away a fast oscillation
that is excited and smaller than the tolerance, so one that is excited stays.

Source: E. Hairer and G. Wanner, Solving Ordinary Differential Equations II, 2nd ed.,
section IV.2, for when to ask.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from lagsim.formulation import Choice
from lagsim.methods import _state as at
from lagsim.methods import method
from lagsim.structure import structure
from lagsim.system import System
from lagsim.trajectory import Caution

if TYPE_CHECKING:
    from lagsim.equations import Equations
    from lagsim.native.kernel_types import Floats
    from lagsim.simulate.arcs import Run

STIFF = "radau"
# Its steps may fail for other reasons: of them nothing is said.
SERIES = "taylor"
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
    values, right = _fast_modes(whole)
    _, left = _fast_modes(whole.T)
    masses = np.maximum(run.state[at.HEADER + 3 * size + 2 :][:n], 0.0)
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
    energy = 0.5 * float(np.sum(masses * moving**2))
    excited = energy > EXCITED * run.state[at.ENERGY]
    return Fast(float(np.max(np.abs(values))), where, bool(excited))


def _fast_modes(matrix: Floats) -> tuple[Any, Any]:
    """Give the large eigenvalues (k,) and their vectors (2 n, k)."""
    values, vectors = np.linalg.eig(matrix)
    speeds = np.abs(values)
    fast = speeds >= FAST * np.max(speeds)  # all of them where none moves
    return values[fast], vectors[:, fast]


def _gain(run: Run, system: System) -> float:
    """Give how many times larger the stiff method's step is; 0 where it costs more.

    From a trial on a copy of the state; its beginning counts only if that is all.
    """
    state = _converted(run, system)
    state[at.ROW_LIMIT] = -np.inf
    runner, block = system.link(STIFF), np.empty((1, 1 + system.size))
    before = state.copy()
    if runner.advance(state, block, TRIAL) == at.PAUSED:
        before = state.copy()
        runner.advance(state, block, TRIAL)
    steps = state[at.STEPS] - before[at.STEPS]
    passed = state[at.T] - before[at.T]
    if steps == 0.0:
        return 0.0
    n = system.n
    evaluation = _operations(run.equations)
    # Half of the factorisations are real (n^3/3), half complex as real ones of 2 n.
    factorisation = 0.5 * (n**3 / 3 + (2 * n) ** 3 / 3)
    spent = evaluation * (state[at.EVALUATIONS] - before[at.EVALUATIONS])
    spent += factorisation * (state[at.FACTORISATIONS] - before[at.FACTORISATIONS])
    h = run.state[at.STEP_H]
    if spent / passed > evaluation * PER_STEP / h:
        return 0.0
    return float(passed / steps / h)


def _operations(equations: Equations) -> float:
    """Give about how many operations an evaluation takes: terms, and their solution."""
    nodes = [*equations.f, *(node for row in equations.M for node in row)]
    for row in equations.rows:
        nodes += [*row.A, row.b]
    return len(equations.graph.cone(nodes)) + len(equations.q) ** 3 / 3


def _converted(run: Run, system: System) -> Floats:
    """Give the state of the run as the stiff method's, at the start of an arc."""
    length = max(len(run.state), method(STIFF).state_size(system.size))
    state = np.zeros(length)
    common = at.HEADER + 6 * system.size + 6
    state[:common] = run.state[:common]
    state[at.FRESH] = 1.0
    return state


def _switch(run: Run, system: System, fast: Fast, gained: float) -> None:
    reason = (
        f"the step was held at the stability bound by {_named(fast.where)}, at "
        f"{fast.rate:.3g} per unit of time; {STIFF}'s is {gained:.0f} times larger"
    )
    run.choices.append(Choice(f"method: {STIFF} from t = {run.t:.9g} on", reason))
    state = _converted(run, system)
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
