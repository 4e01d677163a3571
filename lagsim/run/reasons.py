"""Why a run ended, in words."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lagsim.plan.integration import ANY
from lagsim.run.fallback import WHY
from lagsim.run.trajectory import Outcome

if TYPE_CHECKING:
    from lagsim.run.arcs import Run


def reason_of(run: Run, outcome: Outcome) -> str:
    """Say why `run` ended with `outcome`."""
    if outcome is Outcome.DONE:
        return f"the end was reached at t = {run.t!r}"
    if outcome is Outcome.UNTIL:
        until = run.equations.model.until
        assert until is not None
        return f"`{until.text}` at t = {run.t!r}"
    if outcome is Outcome.INTERRUPTED:
        return f"interrupted at t = {run.t!r}; the rows up to there were kept"
    return f"{_what_failed(run, outcome)}: {outcome.advice}{_other_means(run, outcome)}"


def _what_failed(run: Run, outcome: Outcome) -> str:
    where = f"at t = {run.t!r} ({_described_state(run)})"
    if outcome is Outcome.TOO_MANY_STEPS:
        return f"too many steps ({run.steps}) {where}"
    if outcome is Outcome.NOT_FINITE:
        return f"values that are not finite {where}"
    if outcome is Outcome.CONSTRAINT_JUMPS:
        return f"the position that constraint `{run.torn}` asks for jumps {where}"
    if outcome is Outcome.SWITCHES_ACCUMULATE:
        return f"the switches {run.accumulating} accumulate {where}"
    if outcome is Outcome.STATE_JUMPS:
        return f"the state would have jumped {where}"
    if outcome is Outcome.PROJECTION_FAILED:
        return f"the constraints could not be met {where}"
    if outcome is Outcome.NO_ANSWER:
        return f"constraint `{run.unmet[-1]}` is not met {where}"
    if outcome is Outcome.NEWTON_FAILED:
        return f"the equations of an implicit step could not be solved {where}"
    return f"the step size became too small {where}; {_fastest(run)}"


def _other_means(run: Run, outcome: Outcome) -> str:
    """Name a method that may go on, where it is not the one that failed."""
    if outcome not in WHY or run.runner.method.NAME == ANY:
        return ""
    if run.plan.step is not None:
        return f", take a smaller step, or `--method {ANY}`, which chooses its own"
    return f"; `--method {ANY}` asks less of the expressions, and may go on"


def _described_state(run: Run) -> str:
    names = (*run.equations.q, *run.equations.velocities)
    row = run.observed()[1:]  # after t
    shown = [f"{name} = {x:.6g}" for name, x in zip(names, row, strict=False)]
    if len(shown) > 12:
        shown = [*shown[:12], f"... {len(shown) - 12} more"]
    return ", ".join(shown)


def _fastest(run: Run) -> str:
    """Name the coordinate or velocity that grows fastest for its size."""
    names = run.system.state
    moving = 2 * run.system.n  # work follows what moves
    rates = np.abs(run.runner.function("derivative")(run.t, run.y))
    size = run.system.size
    sizes = np.maximum(np.abs(run.y), 1e-300)
    ratio = np.where(np.isfinite(rates[:size]), rates[:size] / sizes, np.inf)
    # A component near zero changes fast for its size without any singularity.
    large = np.abs(run.y) > 1e-3 * np.max(np.abs(run.y[:moving]))
    k = int(np.argmax(np.where(large, ratio, -1.0)[:moving]))
    return f"`{names[k]}` grows fastest, at {rates[k]:.3g} per unit of time"
