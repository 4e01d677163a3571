"""What `check --json` says of the start of a model."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from lagsim.admissibility.verdict import START_VALUE

if TYPE_CHECKING:
    from collections.abc import Sequence

    from lagsim.admissibility.examination import StartReport
    from lagsim.admissibility.verdict import Verdict
    from lagsim.mechanics.equations import Equations
    from lagsim.notes import Choice


def document(
    equations: Equations, start: StartReport, choices: Sequence[Choice] = ()
) -> dict[str, Any]:
    """Give the content of `check --json`."""
    from lagsim.codes import failure

    model, ranks, reach = equations.model, start.ranks, start.reach
    missed = [v for v in start.verdicts if v.kind == START_VALUE]
    return {
        "model": {"name": model.name, "file": model.file, "sha256": model.sha256},
        "admissible": start.admissible,
        "failure": None if start.admissible else failure("inadmissible"),
        "degrees_of_freedom": start.degrees_of_freedom,
        "rank": start.rank,
        "generic_rank": ranks.generic_rank,
        "conditioning": ranks.smallest,
        "generic_conditioning": ranks.generic_smallest,
        "multipliers_not_unique": list(ranks.not_unique),
        "mass_matrix": "singular alone" if start.augmented else "regular",
        "constraints": [
            _constraint(v) for v in start.verdicts if v.kind != START_VALUE
        ],
        "contradictions": [
            {
                "name": d.name,
                "combination": dict(d.combination),
                "levels": d.contradictions,
            }
            for d in start.contradictions
        ],
        "start_values": [
            {"name": v.name, "residual": v.position.value, "bound": v.position.bound}
            for v in missed
        ],
        "dependences": [
            {
                "name": d.name,
                "combination": dict(d.combination),
                "everywhere": d.everywhere,
            }
            for d in ranks.dependences
        ],
        "thin_set": None
        if start.thin is None
        else {
            "names": list(start.thin.names),
            "dimension": start.thin.dimension,
        },
        "reach": None
        if reach is None
        else {
            "dimension": reach.dimension,
            "hidden": reach.hidden,
            "entering": list(reach.entering),
            "reason": reach.reason,
        },
        "changes": {
            name: {"stated": old, "exact": new}
            for name, (old, new) in start.changes.items()
        },
        "repair": start.repair,
        "unsolved": start.unsolved,
        "plan": [{"choice": c.choice, "reason": c.reason} for c in choices],
        "warnings": [w.record for w in start.warnings],
    }


def _constraint(verdict: Verdict) -> dict[str, Any]:
    position, velocity, rate = verdict.position, verdict.velocity, verdict.rate
    return {
        "name": verdict.name,
        "kind": verdict.kind,
        "scleronomic": verdict.scleronomic,
        "pfaffian": verdict.pfaffian,
        "integrable": verdict.integrable,
        "undecided": verdict.undecided,
        "residual": position.value,
        "scale": position.scale,
        "bound": position.bound,
        "bound_reason": position.why,
        "velocity_residual": velocity.value if velocity else None,
        "velocity_scale": velocity.scale if velocity else None,
        "velocity_bound": velocity.bound if velocity else None,
        "velocity_bound_reason": velocity.why if velocity else None,
        "rate": rate.value if rate else None,
        "active": verdict.active,
        "holds": verdict.holds,
        "mode": verdict.mode or None,
        "satisfied": verdict.satisfied,
        "redundant": verdict.redundant,
    }
