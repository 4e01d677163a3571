"""Constraints that are not met, however long projection or relaxation goes on."""

from __future__ import annotations

from typing import TYPE_CHECKING

from lagsim.methods.parts import state as at
from lagsim.notes import Caution
from lagsim.run.decisions import Decision, Ending, Source
from lagsim.run.trajectory import Outcome

if TYPE_CHECKING:
    from lagsim.run.arc import Arc

# A state that is projected is off its constraints by rounding. One that is off by more
# than this part of their terms, looked at so often and each time so many steps later,
# never meets them.
MET = 1e-3
LOOKS = 8
APART = 10_000


class Unmet(Source):
    """Looks from time to time whether the constraints are met."""

    def __init__(self) -> None:
        self._looks = 0

    def ask_at(self, arc: Arc) -> int:
        """Give when it looks next."""
        return (arc.steps // APART + 1) * APART

    def decide(self, arc: Arc, code: int) -> Decision | None:
        """End a run whose constraints have not been met for a long time."""
        held = arc.system.m and arc.plan.projected
        if code != at.PAUSED or arc.steps % APART or not held:
            return None
        columns = dict(
            zip(arc.system.columns.names, arc.observed().tolist(), strict=True)
        )
        found = next(
            (
                name
                for name in (row.name for row in arc.equations.rows)
                if abs(columns[f"residual_{name}"]) > MET * columns[f"scale.{name}"]
            ),
            None,
        )
        self._looks = 0 if found is None else self._looks + 1
        if found is None or self._looks < LOOKS:
            return None
        return Decision(ending=Ending(Outcome.NO_ANSWER, found))


def unsettled(arc: Arc) -> tuple[Caution, ...]:
    """Tell of steps whose impulses were not found to the end."""
    count = int(getattr(arc.state, "unsettled", 0))
    if not count:
        return ()
    from lagsim.methods.moreau import MOST_SWEEPS

    text = (
        f"in {count} of {arc.steps} steps the impulses did not converge within "
        f"{MOST_SWEEPS} sweeps: contacts overlap a little; shorter steps need "
        "fewer sweeps"
    )
    return (Caution("unsettled-impulses", text),)
