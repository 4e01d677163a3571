"""One run: plan -> integrate -> Trajectory; its rows go to the observers."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lagsim.run.arcs import Run
from lagsim.run.states import MOST_STEPS

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from lagsim.mechanics.equations import Equations
    from lagsim.mechanics.state import State
    from lagsim.model.settings import Settings
    from lagsim.plan import Plan
    from lagsim.run.apart import Apart
    from lagsim.run.interrupt import Interrupt
    from lagsim.run.observers import Observer
    from lagsim.run.system import System
    from lagsim.run.trajectory import Trajectory


def simulate(
    equations: Equations,
    start: State,
    plan: Plan,
    system: System,
    settings: Settings,
    observers: Sequence[Observer],
    *,
    interrupt: Interrupt | None = None,
    progress: Callable[[float], None] | None = None,
    most_steps: int = MOST_STEPS,
    arc_steps: float = 0.0,
    longest_step: float = 0.0,
) -> Trajectory:
    """Integrate from `start`, handing every row to the observers.

    Parameters
    ----------
    progress
        Called with the fraction of the run that is done.
    arc_steps
        How many of the most steps an arc counts as, besides its own.
    longest_step
        No step of a method that chooses its steps is longer, if it is not 0; the ranges
        of the coordinates over the steps are then noted, too.
    """
    run: Run | Apart
    if plan.parts:
        from lagsim.run.apart import Apart

        run = Apart(
            start, plan, system, settings, observers, interrupt=interrupt,
            progress=progress, longest_step=longest_step,
        )  # fmt: skip
    else:
        run = Run(
            equations, start, plan, system, settings, observers, interrupt=interrupt,
            progress=progress, longest_step=longest_step,
        )  # fmt: skip
    # A motion that diverges passes every number; what is made of it says so itself.
    with np.errstate(all="ignore"):
        return run.whole(most_steps, arc_steps)
