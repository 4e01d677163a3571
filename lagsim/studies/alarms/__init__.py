"""What a person should know about a run besides its result.

An alarm is a `Caution`: a stable code, and a text that names the part of the scene and
what to do. `simulate` raises those that only the loop over arcs can see (`rank`,
`unresolved-switch`, `coordinate-singularity`, and `step-at-stability-bound` of methods
that choose their steps); the others are raised here, from what the rows have shown:

- `inputs`: what was asked for and is done otherwise;
- `rows`: constraints not met, energy that nothing explains, the horizon of a forecast;
- `steps`: a step past the stability bound, or one that damps what should go on.

docs/failing.md says of each code what it means.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from lagsim.methods import method
from lagsim.run.observers.witness import Witness
from lagsim.studies.alarms.inputs import about_inputs
from lagsim.studies.alarms.rows import about_constraints, about_energy, about_error
from lagsim.studies.alarms.verdict import Doubt, doubt_about

if TYPE_CHECKING:
    from collections.abc import Sequence

    from lagsim.mechanics.equations import Equations
    from lagsim.notes import Caution
    from lagsim.plan.plan import Plan
    from lagsim.run.error import ErrorBar
    from lagsim.run.observers.ledger import Ledger
    from lagsim.run.session import Session
    from lagsim.run.trajectory import Trajectory
    from lagsim.studies.alarms.groups import Balance, Whole

# Methods with nothing to look for: they notice on the way, or are exact.
SEE_FOR_THEMSELVES = ("dop853", "exponential")
# Steps that follow the motion are not shorter than this, in parts of 1/rate of the
# fastest that is to be seen (a series takes 0.5 to 1.5).
FOLLOWS = 0.05

__all__ = ["Doubt", "Witness", "alarms", "doubt_about"]


def alarms(
    session: Session,
    trajectory: Trajectory,
    ledger: Ledger,
    witness: Witness,
    balances: Sequence[Balance | Whole],
    bar: ErrorBar | str,
) -> list[Caution]:
    """Give all that there is to know about a run, in the order of its stages."""
    case, plan = session.case, session.plan
    equations, examined, settings = case.equations, case.examined, case.settings
    return [
        *examined.warnings,
        *about_inputs(examined, settings, plan),
        *trajectory.warnings,
        *_about_steps(equations, plan, trajectory, witness),
        *about_energy(equations, settings, plan, trajectory, balances, witness),
        *about_constraints(
            equations, examined.state, plan, ledger, witness, trajectory
        ),
        *about_error(bar, equations, plan, balances, witness),
    ]


def _about_steps(
    equations: Equations, plan: Plan, trajectory: Trajectory, witness: Witness
) -> list[Caution]:
    """Ask for the eigenvalues of the scene, where there may be something to tell."""
    steps = trajectory.statistics.steps
    chosen = plan.step is None and plan.formulation != "baumgarte"
    if not steps or (chosen and plan.method in SEE_FOR_THEMSELVES):
        return []
    if chosen and math.isfinite(method(plan.method).IMAGINARY_LIMIT):
        h = (trajectory.end - trajectory.start) / steps
        if h * witness.fastest_rate > FOLLOWS:
            return []
    from lagsim.studies.alarms.steps import about_steps

    return about_steps(equations, plan, trajectory, witness)
