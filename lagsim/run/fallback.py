"""Where a method cannot go on, another one does, from the state reached.

A series has no finite coefficients where an expression has a value and no derivative
(drag that grows with the speed, from rest; a root of the time); an implicit step may
find no solution. What handles everything then takes over, and where it fails as well,
the motion itself is at an end. So it is for the method of `auto`, and for a series that
was asked for: that it does not exist says nothing about the motion. An implicit step
over a loss of rank finds a false solution: that too is left to what passes it even
where the implicit method was asked for.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from lagsim.methods.parts import state as at
from lagsim.notes import Choice
from lagsim.plan.plan import ANY
from lagsim.run.decisions import Decision, Source
from lagsim.run.states import SERIES
from lagsim.run.trajectory import Outcome

if TYPE_CHECKING:
    from collections.abc import Mapping

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
    return Decision(
        choices=(Choice(f"method: {ANY} from t = {arc.t:.9g} on", reason),),
        arc=arc.by(replace(arc.plan, method=ANY), arc.system),
        numbers={"h": 0.0, "at_bound": 0.0, **numbers},
    )
