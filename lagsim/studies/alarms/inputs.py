"""What the file or the options asked for, and the run does otherwise."""

from __future__ import annotations

from typing import TYPE_CHECKING

from lagsim.notes import Caution

if TYPE_CHECKING:
    from lagsim.admissibility.report import StartReport
    from lagsim.model.model import Settings
    from lagsim.plan.plan import Plan


def about_inputs(
    examined: StartReport, settings: Settings, plan: Plan
) -> list[Caution]:
    """Say what the file or the options asked for and the run does otherwise."""
    found = []
    if examined.changes:
        moved = ", ".join(
            f"{name} from {old!r} to {new!r}"
            for name, (old, new) in examined.changes.items()
        )
        text = f"the run starts from the nearest exact state: {moved}"
        found.append(Caution("start-changed", text))
    if plan.step is None and settings.step is not None:
        text = f"`step` has no effect: {plan.method} chooses its steps"
        found.append(Caution("step-unused", text))
    if settings.spectral_radius is not None and plan.method != "generalized-alpha":
        text = f"`spectral_radius` has no effect: {plan.method} has no such parameter"
        found.append(Caution("spectral-radius-unused", text))
    if plan.rtol is None and (settings.rtol, settings.atol) != (None, None):
        text = f"tolerances have no effect: {plan.method} takes fixed steps"
        found.append(Caution("tolerance-unused", text))
    if plan.formulation != "baumgarte" and settings.gain is not None:
        text = f"`gain` has no effect: the formulation is {plan.formulation}"
        found.append(Caution("gain-unused", text))
    return found
