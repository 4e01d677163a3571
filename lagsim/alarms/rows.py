"""What the rows of a run show: constraints, energy, and how far they can be trusted."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from lagsim.trajectory import Caution

if TYPE_CHECKING:
    from lagsim.alarms.witness import Witness
    from lagsim.equations import Equations
    from lagsim.error_bar import ErrorBar
    from lagsim.outputs.ledger import Ledger
    from lagsim.plan import Plan
    from lagsim.trajectory import Trajectory

# Rows meet the constraints to rounding; what is off by more than this part is not met.
HELD = 1e-6
# An unexplained change of the energy counts from this part of the energy in play on: an
# amplitude off by half of it is about the width of a line in a picture, and what the
# default tolerance leaves is a million times less.
UNEXPLAINED = 1e-3

# Functions that make an energy jump, which is no error: a jump makes no impulse.
JUMPS = frozenset(("sign", "heaviside", "floor", "ceil", "if"))


def about_error(bar: ErrorBar | str, plan: Plan) -> list[Caution]:
    """Say from when on the rows are no forecast."""
    if isinstance(bar, str) or bar.horizon is None:
        return []
    less = "a shorter step" if plan.rtol is None else "a tighter rtol"
    text = (
        f"past t = {bar.horizon:.6g} the estimated error exceeds a tenth of a "
        f"coordinate's range: rows beyond it show one motion of many ({less} moves "
        "this horizon)"
    )
    return [Caution("horizon", text)]


def about_constraints(ledger: Ledger, plan: Plan) -> list[Caution]:
    """Say so where rows do not meet the constraints: the motion is then no answer."""
    name, worst = ledger.worst_constraint
    if worst <= HELD:
        return []
    why = "the constraints do not determine this motion, and the rows are no answer"
    if not plan.projected and not plan.reduction.eliminated:
        why = f"the formulation {plan.formulation} lets it go; `projection` does not"
    text = (
        f"constraint `{name}` is not met in all rows (off by {worst:.2g} of its "
        f"scale): {why}"
    )
    return [Caution("constraint-not-held", text)]


def about_energy(
    equations: Equations,
    plan: Plan,
    trajectory: Trajectory,
    ledger: Ledger,
    witness: Witness,
) -> list[Caution]:
    """Say so where the energy drifts and no force explains it.

    The energy of a symplectic method swings to and fro, and goes nowhere: of a fixed
    step, what is gained on the whole counts, else the largest deviation.
    """
    in_play = witness.energy_in_play
    gained = witness.energy_gained
    if plan.rtol is not None and math.isfinite(ledger.energy_gained):
        gained = ledger.energy_gained
    if not abs(gained) > UNEXPLAINED * in_play:
        return []
    since = ledger.drift_since(UNEXPLAINED * in_play)
    when = witness.end if plan.rtol is None or since is None else since
    way = "gained" if gained > 0.0 else "lost"
    part = abs(gained) / in_play
    reached = "by" if plan.rtol is None else "from"
    text = (
        f"the motion has {way} energy that no force explains, {part:.2g} of the energy "
        f"in play {reached} t = {when:.6g}"
    )
    if jumps(equations):
        text += "; its expression jumps, which is no error and makes no impulse"
    elif trajectory.outcome.complete:
        text += f": that is an error of {_whose(plan)}; {_how(equations, plan)} it"
    return [Caution(f"energy-{way}", text)]


def _whose(plan: Plan) -> str:
    """Name what lets the energy go."""
    if plan.formulation == "drift":
        return f"{plan.method} and of the formulation drift"
    return plan.method


def _how(equations: Equations, plan: Plan) -> str:
    """Say what keeps the energy: nothing that has been tried."""
    how = "a shorter step" if plan.rtol is None else "a tighter rtol"
    simulation = equations.model.simulation
    if simulation is not None and simulation.method != "auto":
        return f"{how}, or `--method auto`, keeps"
    return f"{how} keeps"


def jumps(equations: Equations) -> bool:
    """Tell whether the energy may jump where nothing of the motion does."""
    g = equations.graph
    moving = g.dependent([equations.energy], (*equations.q, *equations.velocities, "t"))
    return any(g.ops[n] in JUMPS for n in moving)
