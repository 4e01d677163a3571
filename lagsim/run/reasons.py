"""Why a run ended, in words."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lagsim.plan.plan import ANY
from lagsim.run.fallback import WHY
from lagsim.run.trajectory import Outcome

if TYPE_CHECKING:
    from lagsim.language.arrays import Floats
    from lagsim.run.arc import Arc
    from lagsim.run.decisions import Ending


def reason_of(arc: Arc, ending: Ending, row: Floats | None = None) -> str:
    """Say why a run ended so, in its last arc: at the state reached, or at `row`."""
    outcome = ending.outcome
    if outcome is Outcome.DONE:
        return f"the end was reached at t = {arc.t!r}"
    if outcome is Outcome.UNTIL:
        until = arc.equations.model.until
        assert until is not None
        return f"`{until.text}` at t = {arc.t!r}"
    if outcome is Outcome.INTERRUPTED:
        return f"interrupted at t = {arc.t!r}; the rows up to there were kept"
    what = _what_failed(arc, ending, row)
    return f"{what}: {outcome.advice}{_other_means(arc, outcome)}"


def _what_failed(arc: Arc, ending: Ending, row: Floats | None) -> str:
    outcome = ending.outcome
    shown = arc.observed() if row is None else row
    where = f"at t = {float(shown[0])!r} ({_described_state(arc, shown)})"
    if outcome is Outcome.TOO_MANY_STEPS:
        return f"too many steps ({arc.steps}{ending.about}) {where}"
    if outcome is Outcome.NOT_FINITE:
        return f"values that are not finite {where}"
    if outcome is Outcome.CONSTRAINT_JUMPS:
        return f"the position that constraint `{ending.about}` prescribes jumps {where}"
    if outcome is Outcome.SWITCHES_ACCUMULATE:
        return f"the switches {ending.about} accumulate {where}"
    if outcome is Outcome.PARADOX:
        return f"no contact forces satisfy the laws of {ending.about} {where}"
    if outcome is Outcome.STATE_JUMPS:
        return f"the state would have jumped {where}"
    if outcome is Outcome.PROJECTION_FAILED:
        return f"the constraints could not be satisfied {where}"
    if outcome is Outcome.NO_ANSWER:
        return f"constraint `{ending.about}` is not satisfied {where}"
    if outcome is Outcome.NEWTON_FAILED:
        return f"the equations of an implicit step could not be solved {where}"
    return f"the step size became too small {where}; {_fastest(arc)}"


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
    names = (*arc.equations.q, *arc.equations.velocities)
    shown = [f"{name} = {x:.6g}" for name, x in zip(names, row[1:], strict=False)]
    if len(shown) > 12:
        shown = [*shown[:12], f"... {len(shown) - 12} more"]
    return ", ".join(shown)


def _fastest(arc: Arc) -> str:
    """Name the coordinate or velocity that grows fastest for its size."""
    names = arc.system.state
    moving = 2 * arc.system.n  # work follows what moves
    rates = np.abs(arc.runner.function("derivative")(arc.t, arc.y))
    size = arc.system.size
    sizes = np.maximum(np.abs(arc.y), 1e-300)
    ratio = np.where(np.isfinite(rates[:size]), rates[:size] / sizes, np.inf)
    # A component near zero changes fast for its size without any singularity.
    large = np.abs(arc.y) > 1e-3 * np.max(np.abs(arc.y[:moving]))
    k = int(np.argmax(np.where(large, ratio, -1.0)[:moving]))
    return f"`{names[k]}` grows fastest, at {rates[k]:.3g} per unit of time"
