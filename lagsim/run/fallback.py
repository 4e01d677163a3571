"""Where the method of `auto` cannot go on, another one does, from the state reached.

A series has no finite coefficients where an expression has a value and no derivative
(drag that grows with the speed, from rest; a root of the time); an implicit step may
find no solution. What handles everything then takes over, and where it fails as well,
the motion itself is at an end.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

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
    if outcome not in WHY or run.simulation.method != "auto" or name == ANY:
        return False
    reason = WHY[outcome].format(name)
    run.choices.append(Choice(f"method: {ANY} from t = {run.t:.9g} on", reason))
    run.plan = replace(run.plan, method=ANY)
    run.use(run.system)
    run.state = taken_over(run.state, run.runner)
    run.state.h = run.state.at_bound = 0.0
    run.review_at = MOST_STEPS
    return True
