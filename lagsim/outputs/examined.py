"""The document of `check --json`: verdicts on the start of a model."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from lagsim.admissibility.verdict import START_VALUE
from lagsim.codes import failure

if TYPE_CHECKING:
    from collections.abc import Sequence

    from lagsim.admissibility.examination import StartReport
    from lagsim.admissibility.verdict import Verdict
    from lagsim.mechanics.equations import Equations
    from lagsim.notes import Choice


# Keys of a residual, and its attributes.
LEVEL = {"residual": "value", "scale": "scale", "bound": "bound", "bound_reason": "why"}


def document(
    equations: Equations, start: StartReport, choices: Sequence[Choice] = ()
) -> dict[str, Any]:
    """Return the content of `check --json`."""
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
            _combined(d, levels=d.contradictions) for d in start.contradictions
        ],
        "start_values": [
            {"name": v.name, "residual": v.position.value, "bound": v.position.bound}
            for v in missed
        ],
        "dependences": [
            _combined(d, everywhere=d.everywhere) for d in ranks.dependences
        ],
        "thin_set": start.thin
        and {"names": list(start.thin.names), "dimension": start.thin.dimension},
        "reach": reach
        and {
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


def _combined(of: Any, **more: Any) -> dict[str, Any]:
    return {"name": of.name, "combination": dict(of.combination), **more}


def _constraint(verdict: Verdict) -> dict[str, Any]:
    about = ("name", "kind", "scleronomic", "pfaffian", "integrable", "undecided")
    found = {key: getattr(verdict, key) for key in about}
    for level, at in (("", verdict.position), ("velocity_", verdict.velocity)):
        found |= {
            f"{level}{key}": getattr(at, attribute) if at else None
            for key, attribute in LEVEL.items()
        }
    return found | {
        "rate": verdict.rate.value if verdict.rate else None,
        "active": verdict.active,
        "holds": verdict.holds,
        "mode": verdict.mode or None,
        "satisfied": verdict.satisfied,
        "redundant": verdict.redundant,
    }
