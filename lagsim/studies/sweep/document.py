"""sweep.csv and sweep.json."""

from __future__ import annotations

import hashlib
import json
from collections import Counter
from functools import partial
from typing import TYPE_CHECKING, Any

from lagsim.outputs.attempted import attempted
from lagsim.outputs.manifest import versions
from lagsim.outputs.table import table_of
from lagsim.studies.sweep.grid import COMPLETE, ERROR, OUTCOME, REASON
from lagsim.version import __version__

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from lagsim.outputs.attempted import Made
    from lagsim.studies.sweep.runs import Row
    from lagsim.studies.sweep.sweeping import Found

TABLE = "sweep.csv"
CHART = "sweep.png"
MANIFEST = "sweep.json"
# What is told of each column, in this order.
TOLD = ("end", "min", "max")


def header(found: Found) -> list[str]:
    """Give the columns of sweep.csv."""
    names = [axis.name for axis in found.grid.axes]
    told = [f"{column}.{x}" for column in found.columns[1:] for x in _told(found)]
    return [*names, OUTCOME, COMPLETE, ERROR, f"{found.columns[0]}.end", *told, REASON]


def _told(found: Found) -> tuple[str, ...]:
    return TOLD[:1] if found.work.ends else TOLD


def cells(found: Found, row: Row) -> Iterator[object]:
    """Give a row of sweep.csv; None is what there is not."""
    yield from (*row.values, row.outcome, row.complete, row.error)
    numbers = row.numbers.T.tolist()
    if not numbers:
        yield from [None] * (1 + len(_told(found)) * (len(found.columns) - 1))
    else:
        yield numbers[0][0]
        for column in numbers[1:]:
            yield from column
    yield row.reason


def table(found: Found) -> bytes:
    """Give the content of sweep.csv: a row for each run, in the order of the grid."""
    rows = (cells(found, found.rows[k]) for k in sorted(found.rows))
    return table_of(header(found), rows)


def identity(found: Found) -> dict[str, Any]:
    """Give what decides on the rows: equal for equal ones."""
    model, work = found.model, found.work
    return {
        "lagsim": __version__,
        "model": {"name": model.name, "sha256": model.sha256},
        "parameters": {p.name: p.value for p in model.parameters},
        "grid": [[axis.name, list(axis.texts)] for axis in work.grid.axes],
        "options": dict(work.options) | {"error_bar": work.error_bars.value},
        "kept": [work.kept is not None, work.plots],
        **({"ends": True} if work.ends else {}),
    }


def mark(found: Found) -> str:
    """Give a word for the same."""
    return hashlib.sha256(json.dumps(identity(found)).encode()).hexdigest()


def document(found: Found, files: Sequence[str]) -> dict[str, Any]:
    """Give the content of sweep.json; keys are only ever added."""
    model, rows = found.model, found.rows.values()
    what = identity(found)
    columns = {name: found.units.get(name, "") for name in found.columns}
    return {
        "lagsim": __version__,
        "versions": versions(),
        "model": {"name": model.name, "file": model.file, "sha256": model.sha256},
        "identity": mark(found),
        "parameters": what["parameters"],
        "options": what["options"],
        "grid": [
            {
                "name": axis.name,
                "of": "initial" if axis.starts else "parameters",
                "unit": axis.unit,
                "expressions": list(axis.texts),
                "values": list(axis.values),
            }
            for axis in found.grid.axes
        ],
        "runs": found.grid.runs,
        "complete": sum(row.complete for row in rows),
        "outcomes": dict(Counter(row.outcome for row in rows)),
        "compiled": _forms(found),
        "notes": notes(found),
        "columns": columns,
        "timings": {"runs": round(found.seconds, 6)},
        "files": list(files),
    }


def files(found: Found, *, plots: bool) -> Iterator[Made]:
    """Give name and content of what stands beside sweep.json."""
    yield TABLE, table(found)
    if plots:
        from lagsim.studies.sweep.chart import chart

        yield CHART, attempted(CHART, partial(chart, found))


def notes(found: Found) -> list[str]:
    """Say what there is to know."""
    forms = _forms(found)
    if forms < 2:
        return []
    text = f"the swept values change the equations: {forms} forms were "
    return [text + "compiled, which takes longer than one"]


def _forms(found: Found) -> int:
    return len({row.form for row in found.rows.values() if row.numbers.size})
