"""work_precision.csv and work_precision.json."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any

import numpy as np
import orjson

from lagsim.errors import InputError, Problem
from lagsim.files import content as content_of
from lagsim.outputs.manifest import versions
from lagsim.outputs.table import table_of
from lagsim.studies.bench.machine import machine, today
from lagsim.version import __version__

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from lagsim.model.model import Model, Settings
    from lagsim.studies.bench.reference import Reference
    from lagsim.studies.bench.work_precision import WorkPrecision

TABLE = "work_precision.csv"
MANIFEST = "work_precision.json"

COLUMNS = (
    "method", "formulation", "setting", "value", "seconds", "evaluations", "error",
    "error_lambda", "energy_drift", "constraint_residual", "outcome", "chosen",
)  # fmt: skip


# Without these no chart can be drawn.
NEEDED = (
    "lagsim", "versions", "machine", "date", "model", "end", "reference", "refused",
    "rows",
)  # fmt: skip


def files(form: str) -> list[str]:
    """Give the files, with the chart as PNG, SVG or PDF in the middle."""
    return [TABLE, f"work_precision.{form}", MANIFEST]


def table(rows: Iterable[Mapping[str, Any]]) -> bytes:
    """Give the content of work_precision.csv; the rows are those of the JSON."""
    return table_of(COLUMNS, ([row[name] for name in COLUMNS] for row in rows))


def read_document(path: str) -> dict[str, Any]:
    """Give what `bench` has measured and kept in work_precision.json.

    Raises
    ------
    InputError
    """
    try:
        found = orjson.loads(content_of(path))
    except OSError as error:
        why = f"{path} cannot be read: {error.strerror}"
        raise InputError([Problem("unreadable", why)]) from None
    except ValueError as error:
        raise InputError([Problem("not-json", f"{path}: {error}")]) from None
    missing = [key for key in NEEDED if not isinstance(found, dict) or key not in found]
    if missing:
        why = (
            f"{path} is not a document of `lagsim bench`, or an older one: "
            f"`{missing[0]}` is "
        )
        hint = "measure again: lagsim bench MODEL"
        raise InputError([Problem("not-a-bench", f"{why}missing", hint=hint)])
    return dict(found)


def document(
    model: Model, settings: Settings, found: WorkPrecision, files: Sequence[str]
) -> dict[str, Any]:
    """Give the content of work_precision.json; keys are only ever added."""
    fronts = {of: set(found.front(of)) for of in ("seconds", "evaluations")}
    rows = []
    for k, entry in enumerate(found.entries):
        row = {name: getattr(entry, name) for name in COLUMNS}
        row["reason"] = entry.reason
        row |= {f"front_{of}": k in front for of, front in fronts.items()}
        rows.append(row)
    curves = [
        {"method": method, "formulation": formulation, "compile_seconds": seconds}
        for (method, formulation), seconds in found.compile_seconds.items()
    ]
    return {
        "lagsim": __version__,
        "versions": versions() | {"scipy": _scipy_version()},
        "machine": machine(),
        "date": today(),
        "model": {"name": model.name, "file": model.file, "sha256": model.sha256},
        "parameters": {p.name: p.value for p in model.parameters},
        "start": settings.start,
        "end": settings.end,
        "output_step": settings.output_step,
        "complete": not found.interrupted,
        "budget": {"seconds": found.budget, "spent": found.seconds},
        "reference": _reference(found.reference),
        "curves": curves,
        "refused": [refused._asdict() for refused in found.refused],
        "rows": rows,
        "files": list(files),
    }


def _reference(reference: Reference) -> dict[str, Any]:
    named = [*reference.state, *reference.multipliers]
    return {
        "made": reference.made,
        "verified": reference.verified,
        "trust": reference.trust,
        "floor": reference.floor,
        "horizon": reference.horizon,
        "rows": len(reference.rows),
        "known_rows": reference.known,
        "agreement": {
            reference.columns[c]: float(reference.agreement[c]) for c in named
        },
        "scales": {
            reference.columns[c]: float(reference.scales[c])
            for c in named
            if np.isfinite(reference.scales[c])
        },
    }


def _scipy_version() -> str:
    if "scipy" in sys.modules:
        return str(sys.modules["scipy"].__version__)
    from importlib.metadata import version

    return version("scipy")
