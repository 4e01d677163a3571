"""What the rows of a run show: constraints, energy, and how far they can be trusted."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from lagsim.language.evaluate import evaluate
from lagsim.notes import Caution
from lagsim.studies.error_bar import beside
from lagsim.studies.error_bar.scales import BALANCED

if TYPE_CHECKING:
    from lagsim.language.arrays import Floats
    from lagsim.mechanics.equations import Equations
    from lagsim.mechanics.instant import Instant
    from lagsim.model.settings import Settings
    from lagsim.plan.plan import Plan
    from lagsim.run.error import ErrorBar
    from lagsim.run.observers.ledger import Ledger
    from lagsim.run.observers.witness import Witness
    from lagsim.run.trajectory import Trajectory

# Rows meet the constraints to rounding; what is off by more than this part is not met.
HELD = 1e-6
# An unexplained change of the energy counts from this part of the energy in play on: an
# amplitude off by half of it is about the width of a line in a picture, and what the
# default tolerance leaves is a million times less.
UNEXPLAINED = 1e-3
# A place is known no better than to this part of the motion beside it.
NEIGHBOURS = 1e-12


def about_error(bar: ErrorBar | str, plan: Plan) -> list[Caution]:
    """Say from when on the rows are no forecast, and whether their end is one."""
    if isinstance(bar, str):
        return []
    found = []
    if bar.parted:
        text = f"{bar.parted}: which of them it is, is not known"
        found.append(Caution("end-in-doubt", f"the end of the run is in doubt: {text}"))
    if bar.horizon is None:
        return found
    less = "a shorter step" if plan.rtol is None else "a tighter rtol"
    text = (
        f"past t = {bar.horizon:.6g} the estimated error exceeds a tenth of a "
        f"coordinate's range: rows beyond it show one motion of many ({less} moves "
        "this horizon)"
    )
    return [*found, Caution("horizon", text)]


def about_constraints(
    equations: Equations, start: Instant, plan: Plan, ledger: Ledger, witness: Witness
) -> list[Caution]:
    """Say so where rows do not meet the constraints: the motion is then no answer."""
    found = not_held(equations, start, ledger, witness)
    if found is None:
        return []
    name, worst = found
    why = "the constraints do not determine this motion, and the rows are no answer"
    if not plan.projected and not plan.reduction.eliminated:
        why = f"the formulation {plan.formulation} lets it go; `projection` does not"
    text = (
        f"constraint `{name}` is not met in all rows (off by {worst:.2g} of its "
        f"scale): {why}"
    )
    return [Caution("constraint-not-held", text)]


def not_held(
    equations: Equations, start: Instant, ledger: Ledger, witness: Witness
) -> tuple[str, float] | None:
    """Give the constraint that is off most, and the part of its scale; or None.

    Where all of its terms all but vanish they are no scale: what counts is by how much
    of their motion the coordinates would have to move to meet it.
    """
    n = len(equations.q)
    g = equations.graph
    for name, residual, part, values in ledger.constraints_off(HELD):
        if not math.isfinite(residual):
            return name, part
        row = equations.row(name)
        moved = witness.ranges[1 : 1 + n]
        seed = NEIGHBOURS * beside(equations, start, moved)
        if not row.holonomic:
            moved = witness.ranges[1 + n : 1 + 2 * n]
            seed = NEIGHBOURS * beside(equations, start, moved)
        state = dict(zip(equations.q, values[1 : 1 + n].tolist(), strict=True))
        rates = values[1 + n : 1 + 2 * n].tolist()
        state |= dict(zip(equations.velocities, rates, strict=True))
        state |= {p.name: p.value for p in equations.model.parameters}
        state["t"] = float(values[0])
        slopes = np.abs(evaluate(g, list(row.A), state))
        seed = seed + held_still(equations, witness, values)[0]
        if residual > HELD * float(slopes @ moved) + float(slopes @ seed):
            return name, part
    return None


def held_still(
    equations: Equations, witness: Witness, row: Floats
) -> tuple[Floats, float]:
    """Give how far (n,) rounding moves what constraint forces hold, and its energy.

    Forces that balance leave their rounding, and that makes a motion of its own, with
    nothing beside it to compare it with where all else rests.
    """
    n, g = len(equations.q), equations.graph
    values = dict(zip(equations.q, row[1 : 1 + n].tolist(), strict=True))
    values |= dict(zip(equations.velocities, row[1 + n :].tolist(), strict=False))
    values |= {p.name: p.value for p in equations.model.parameters}
    values["t"] = float(row[0])
    masses = np.asarray(evaluate(g, equations.inertias, values))
    pushed = np.divide(witness.held, masses, out=np.zeros(n), where=masses > 0.0)
    moved = BALANCED * pushed * float(witness.ranges[0]) ** 2
    return moved, float(moved @ witness.held)


def about_energy(
    equations: Equations,
    settings: Settings,
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
    if ledger.worst_row is not None:
        _, rounded = held_still(equations, witness, ledger.worst_row)
        if abs(gained) <= rounded:
            return []
    from lagsim.studies.alarms.jumps import jumps

    since = ledger.drift_since(UNEXPLAINED * in_play)
    when = witness.end if plan.rtol is None or since is None else since
    way = "gained" if gained > 0.0 else "lost"
    part = abs(gained) / in_play
    reached = "by" if plan.rtol is None else "from"
    text = (
        f"the motion has {way} energy that no force explains, {part:.2g} of the energy "
        f"in play {reached} t = {when:.6g}"
    )
    if jumps(equations, witness, ledger.worst_row):
        text += "; its expression jumps, which is no error and makes no impulse"
    elif trajectory.outcome.complete:
        text += f": that is an error of {_whose(plan)}; {_how(settings, plan)} it"
    return [Caution(f"energy-{way}", text)]


def _whose(plan: Plan) -> str:
    """Name what lets the energy go."""
    if plan.formulation == "drift":
        return f"{plan.method} and of the formulation drift"
    return plan.method


def _how(settings: Settings, plan: Plan) -> str:
    """Say what keeps the energy: nothing that has been tried."""
    how = "a shorter step" if plan.rtol is None else "a tighter rtol"
    if settings.method != "auto":
        return f"{how}, or `--method auto`, keeps"
    return f"{how} keeps"
