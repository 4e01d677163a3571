"""What a person should know about a run besides its result."""

from __future__ import annotations

from typing import TYPE_CHECKING

from lagsim.trajectory import Caution

if TYPE_CHECKING:
    from lagsim.admissibility import Start
    from lagsim.error_bar import ErrorBar
    from lagsim.outputs.ledger import Ledger
    from lagsim.plan import Plan
    from lagsim.system import System

# Rows meet the constraints to rounding; what is off by more than this part is not met.
HELD = 1e-6


def about_inputs(start: Start, plan: Plan, system: System) -> list[Caution]:
    """Say what the file or the options asked for and the run does otherwise."""
    found = []
    if start.changes:
        moved = ", ".join(
            f"{name} from {old!r} to {new!r}"
            for name, (old, new) in start.changes.items()
        )
        text = f"the run starts from the nearest exact state: {moved}"
        found.append(Caution("start-changed", text))
    simulation = system.equations.model.simulation
    if simulation is None:
        return found
    if plan.step is None and simulation.step is not None:
        text = f"`step` has no effect: {plan.method} chooses its steps"
        found.append(Caution("step-unused", text))
    if simulation.spectral_radius is not None and plan.method != "generalized-alpha":
        text = f"`spectral_radius` has no effect: {plan.method} has no such parameter"
        found.append(Caution("spectral-radius-unused", text))
    if plan.rtol is None and (simulation.rtol, simulation.atol) != (None, None):
        text = f"tolerances have no effect: {plan.method} takes fixed steps"
        found.append(Caution("tolerance-unused", text))
    if plan.formulation != "baumgarte" and simulation.gain is not None:
        text = f"`gain` has no effect: the formulation is {plan.formulation}"
        found.append(Caution("gain-unused", text))
    return found


def about_error(bar: ErrorBar | str) -> list[Caution]:
    """Say from when on the rows are no forecast."""
    if isinstance(bar, str) or bar.horizon is None:
        return []
    text = (
        f"past t = {bar.horizon:.6g} the estimated error exceeds a tenth of a "
        "coordinate's range: rows beyond it show one motion of many (a tighter rtol "
        "moves this horizon)"
    )
    return [Caution("horizon", text)]


def about_rows(ledger: Ledger, plan: Plan) -> list[Caution]:
    """Say so where rows do not meet the constraints: the motion is then no answer."""
    worst = ledger.constraint_residual
    if worst <= HELD:
        return []
    why = "they do not determine this motion, and the rows are no answer"
    if not plan.projected and not plan.reduction.eliminated:
        why = f"the formulation {plan.formulation} lets them go; `projection` does not"
    text = (
        f"the constraints are not met in all rows (off by {worst:.2g} of their scale): "
        f"{why}"
    )
    return [Caution("constraint-not-held", text)]
