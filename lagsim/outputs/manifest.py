"""Records as JSON: run.json of a run, and the report of `check --json` on a start."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any

import orjson

from lagsim.admissibility.verdict import AT_REST, START_VALUE
from lagsim.codes import failure
from lagsim.codes.known import INADMISSIBLE
from lagsim.outputs.units import of_table
from lagsim.version import __version__

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from lagsim.admissibility.examination import StartReport
    from lagsim.admissibility.verdict import RelationResiduals
    from lagsim.mechanics.equations import Equations
    from lagsim.model.model import Model
    from lagsim.notes import Caution, Choice
    from lagsim.run.error import ErrorBar
    from lagsim.run.observers.appended import Appended
    from lagsim.run.observers.monitors import ResidualMonitor
    from lagsim.run.session import Session
    from lagsim.run.trajectory import Trajectory

PACKAGES = ("numpy", "llvmlite", "matplotlib")


def head(model: Model) -> dict[str, Any]:
    """Return the entries that begin every record: versions, model and parameters."""
    return {
        "lagsim": __version__,
        "versions": versions(),
        "model": _named(model),
        "parameters": {p.name: p.value for p in model.parameters},
    }


def manifest(
    session: Session,
    trajectory: Trajectory,
    residuals: ResidualMonitor,
    constraint_residual: float,
    error_bar: ErrorBar | str,
    cautions: Sequence[Caution],
    timings: Mapping[str, float],
    files: Sequence[str],
    more: Appended | None = None,
) -> dict[str, Any]:
    """Return the content of run.json; versions of lagsim only add keys.

    Parameters
    ----------
    session : Session
    trajectory : Trajectory
    residuals : ResidualMonitor
    constraint_residual : float
        The largest relative residual of the constraints.
    error_bar : ErrorBar or str
        The error bar, or the reason why there is none.
    cautions : sequence of Caution
    timings : mapping of str to float
        Seconds of each stage of the command, by its name.
    files : sequence of str
        Names of the files of the run.
    more : Appended, optional
        Columns of sensitivities.
    """
    model, plan = session.case.equations.model, session.plan
    counts, columns = trajectory.statistics, session.system.columns.of_table
    found = {"sensitivities": more.record} if more else {}
    columns += more.names if more else ()
    return {
        **head(model),
        "method": plan.method,
        "formulation": plan.formulation,
        "rtol": plan.rtol,
        "atol": plan.atol,
        "step": plan.step,
        "plan": _choices((*plan.choices, *trajectory.choices)),
        "outcome": trajectory.outcome.word,
        "complete": trajectory.outcome.complete,
        "reason": trajectory.reason,
        "failure": trajectory.outcome.failure,
        "start": trajectory.start,
        "end": trajectory.end,
        "rows": trajectory.rows,
        "steps": counts.steps,
        "rejections": counts.rejections,
        "evaluations": counts.evaluations,
        "factorisations": counts.factorisations,
        "events": [e.record for e in trajectory.events],
        "event_counts": dict(trajectory.event_counts),
        "energy_drift": residuals.drift.size,
        "constraint_residual": constraint_residual,
        "error": _error(error_bar),
        "warnings": [c.record for c in cautions],
        "timings": dict(timings),
        "columns": of_table(session.case.equations, columns),
        "files": list(files),
        **found,
    }


def _named(model: Model) -> dict[str, Any]:
    found: dict[str, Any] = {
        "name": model.name,
        "file": model.file,
        "sha256": model.sha256,
    }
    tables = [t for t in model.tables if t.file]
    if tables:
        found["tables"] = {t.name: {"file": t.file, "sha256": t.sha256} for t in tables}
    return found


def _choices(choices: Sequence[Choice]) -> list[dict[str, str]]:
    return [{"choice": c.choice, "reason": c.reason} for c in choices]


def _error(bar: ErrorBar | str) -> dict[str, Any] | None:
    if isinstance(bar, str):
        return None
    return {
        "repeated_by": bar.method,
        "repeated_rtol": bar.rtol,
        "relative": bar.relative,
        "coordinates": {name: e._asdict() for name, e in bar.coordinates.items()},
        "growth": [{"time": t, "relative": part} for t, part in bar.growth],
        "horizon": bar.horizon,
    }


# Keys of a residual in JSON, and the attributes of the residual.
LEVEL = {"residual": "value", "scale": "scale", "bound": "bound", "bound_reason": "why"}


def examination(
    equations: Equations, start: StartReport, choices: Sequence[Choice] = ()
) -> dict[str, Any]:
    """Return the content of `check --json`: the report on a start, and choices made."""
    model, ranks, reach = equations.model, start.ranks, start.reach
    missed = [v for v in start.verdicts if v.kind == START_VALUE]
    moving = {v.name: v.position.value for v in start.verdicts if v.kind == AT_REST}
    return {
        "model": _named(model),
        "admissible": start.admissible,
        "failure": None if start.admissible else failure(INADMISSIBLE),
        "degrees_of_freedom": start.degrees_of_freedom,
        "rank": start.rank,
        "generic_rank": ranks.generic_rank,
        "conditioning": ranks.smallest,
        "generic_conditioning": ranks.generic_smallest,
        "multipliers_not_unique": list(ranks.not_unique),
        "mass_matrix": "singular alone" if start.augmented else "regular",
        "constraints": [
            _constraint(v)
            for v in start.verdicts
            if v.kind not in (START_VALUE, AT_REST)
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
        "plan": _choices(choices),
        "warnings": [w.record for w in start.warnings],
        **({"rest": start.rest} if start.rest is not None else {}),
        **({"not_at_rest": moving} if moving else {}),
    }


def _combined(of: Any, **more: Any) -> dict[str, Any]:
    return {"name": of.name, "combination": dict(of.combination), **more}


def _constraint(verdict: RelationResiduals) -> dict[str, Any]:
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


def encode(document: Any) -> bytes:
    """Return a JSON document, indented; nan and inf become null."""
    option = orjson.OPT_INDENT_2 | orjson.OPT_APPEND_NEWLINE
    try:
        return orjson.dumps(document, option=option)
    except TypeError:  # the name of a file need not be Unicode
        return orjson.dumps(_printable(document), option=option)


def _printable(document: Any) -> Any:
    """Return a document without bytes that are not Unicode, in whose place is `?`.

    Such bytes occur in file names.
    """
    if isinstance(document, str):
        return document.encode(errors="replace").decode()
    if isinstance(document, dict):
        return {_printable(key): _printable(value) for key, value in document.items()}
    if isinstance(document, (list, tuple)):
        return [_printable(value) for value in document]
    return document


def versions() -> dict[str, str]:
    """Return the versions of Python and of the loaded packages of `PACKAGES`.

    They are read from the modules, since reading the metadata of packages would take
    longer than integrating.
    """
    found = {"python": sys.version.split()[0]}
    for name in PACKAGES:
        if name in sys.modules:
            found[name] = sys.modules[name].__version__
    return found
