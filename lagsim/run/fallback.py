"""Where the method of `auto` cannot go on, another one does, from the state reached.

A series has no finite coefficients where an expression has a value and no derivative
(drag that grows with the speed, from rest; a root of the time); an implicit step may
find no solution. What handles everything then takes over, and where it fails as well,
the motion itself is at an end. An implicit step over a loss of rank finds a false one:
that is left to what passes it even where the implicit method was asked for.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from lagsim.methods.parts import state as at
from lagsim.notes import Choice
from lagsim.plan.integration import ANY
from lagsim.run.states import MOST_STEPS, taken_over
from lagsim.run.trajectory import Outcome

if TYPE_CHECKING:
    from lagsim.run.arcs import Run

WHY = {
    Outcome.NOT_FINITE: "{} has no finite values there",
    Outcome.STEP_TOO_SMALL: "{} makes no step from there",
    Outcome.PROJECTION_FAILED: "{} does not meet the constraints from there",
    Outcome.NEWTON_FAILED: "{} cannot solve its equations there",
}


def fall_back(run: Run, outcome: Outcome) -> bool:
    """Go on with another method; tell whether there is one."""
    name = run.runner.method.NAME
    if outcome not in WHY or run.settings.method != "auto" or name == ANY:
        return False
    _go_on(run, WHY[outcome].format(name))
    return True


def pass_loss(run: Run) -> None:
    """Leave a loss of rank ahead to the method that passes it, whatever was asked."""
    reason = (
        "the constraints lose their independence there, which "
        f"{run.runner.method.NAME} does not pass"
    )
    _go_on(run, reason)
    run.state[at.PASSES] = run.state[at.PLANNED] = run.state[at.TRIED] = 0.0


def _go_on(run: Run, reason: str) -> None:
    """Go on with the method that handles everything."""
    run.choices.append(Choice(f"method: {ANY} from t = {run.t:.9g} on", reason))
    run.plan = replace(run.plan, method=ANY)
    run.use(run.system)
    run.state = taken_over(run.state, run.runner)
    run.state[at.H] = run.state[at.AT_BOUND] = 0.0
    run.review_at = MOST_STEPS
