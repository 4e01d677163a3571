"""The two files of a golden: `<name>.csv`, its rows, and `<name>.json`, all else."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import orjson

from lagsim import files
from lagsim.errors import InputError, Problem
from lagsim.outputs.manifest import encode, versions
from lagsim.outputs.results import open_results
from lagsim.studies.comparison.reading import read_table
from lagsim.studies.golden.measuring import DIGITS, Golden, Invariant
from lagsim.version import __version__

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from lagsim.language.arrays import Floats
    from lagsim.run.session import Case
    from lagsim.studies.golden.motion import Motion

FOLDER = "golden"
# How long to wait for others who store in the folder; each takes some milliseconds.
PATIENCE_SECONDS = 10.0
# What a double holds, whatever its bound.
MOST_DIGITS = 17


@dataclass(frozen=True)
class Stored:
    """A golden with what its JSON says of the run it was made from."""

    golden: Golden
    about: Mapping[str, Any]


def folder_of(model_path: str) -> Path:
    """Give the folder of a model's golden where none is named."""
    return Path(model_path).parent / FOLDER


def names(model_name: str) -> tuple[str, str]:
    """Give the names of the two files."""
    return f"{model_name}.csv", f"{model_name}.json"


def table(golden: Golden) -> bytes:
    """Give the rows, their digits cut to what is certain."""
    lines = [",".join(golden.columns)]
    bounds = {name: golden.bounds(name) for name in golden.columns}
    for k, row in enumerate(golden.rows.tolist()):
        cells = [
            repr(value) if name == "t" else certain(value, float(bounds[name][k]))
            for name, value in zip(golden.columns, row, strict=True)
        ]
        lines.append(",".join(cells))
    return ("\n".join(lines) + "\n").encode()


def certain(value: float, bound: float) -> str:
    """Give the shortest text of a value to a tenth of its bound, or better."""
    if not (bound > 0.0 and math.isfinite(value)):
        return repr(value)
    last = math.floor(math.log10(DIGITS * bound))
    first = math.floor(math.log10(abs(value))) if value else last
    digits = first - last + 1
    if digits < 1:
        return "0.0"
    text = repr(float(f"{value:.{min(digits, MOST_DIGITS) - 1}e}"))
    return text.removesuffix(".0") if len(text) > 3 else text


def document(case: Case, golden: Golden, base: Motion) -> bytes:
    """Give the JSON; keys are only ever added."""
    model = case.equations.model
    plan = base.plan
    content = {
        "lagsim": __version__,
        "versions": versions(),
        "model": model.name,
        "model_sha256": model.sha256,
        "parameters": {p.name: p.value for p in model.parameters},
        "initial": {x.name: x.value for x in model.initial},
        "expressions": {k: x.text for k, x in model.stated.texts().items()},
        "method": plan.method,
        "formulation": plan.formulation,
        "rtol": plan.rtol,
        "atol": plan.atol,
        "step": plan.step,
        "start": case.settings.start,
        "end": base.trajectory.end,
        "outcome": base.trajectory.outcome.word,
        "output_step": case.settings.output_step,
        "stride": golden.stride,
        "horizon": golden.horizon,
        "invariants": {
            name: {"value": kept.value, "bound": kept.bound}
            for name, kept in golden.invariants.items()
        },
        "columns": list(base.columns),
    }
    # A column's bounds on one line: one number to a line is not for people to read.
    bounds = [
        b"    %b: %b" % (orjson.dumps(name), orjson.dumps(golden.steps[name]))
        for name in golden.columns
    ]
    head = encode(content).removesuffix(b"\n}\n")
    return head + b',\n  "bounds": {\n' + b",\n".join(bounds) + b"\n  }\n}\n"


def store(case: Case, golden: Golden, base: Motion, folder: Path) -> int:
    """Put a golden in the place of the old one; give its size in bytes.

    Raises
    ------
    InputError
        Where the folder cannot be used.
    OSError
        Where there is no room; then the old one stays.
    """
    csv_name, json_name = names(case.equations.model.name)
    rows, about = table(golden), document(case, golden, base)
    # Others may store goldens of other models into the folder.
    with open_results(folder, json_name, patience=PATIENCE_SECONDS) as results:
        results.write(csv_name, rows)
        results.commit(about)
    return len(rows) + len(about)


def load(folder: Path, model_name: str) -> Stored:
    """Read a golden.

    Raises
    ------
    InputError
        If there is none, or it cannot be read.
    """
    csv_name, json_name = names(model_name)
    path = folder / json_name
    try:
        about: Any = orjson.loads(files.content(path))
    except FileNotFoundError:
        text = f"there is no golden of {model_name} in {folder}"
        hint = "`lagsim golden --update` stores one"
        raise InputError([Problem("no-golden", text, hint=hint)]) from None
    except OSError as error:
        raise _broken(path, f"cannot be read: {error.strerror}") from None
    except ValueError:
        raise _broken(path, "is not a JSON document") from None
    rows = read_table(folder / csv_name)
    try:
        golden = _golden(about, rows.columns, rows.data.T)
    except (KeyError, TypeError, ValueError, AttributeError):
        raise _broken(path, "is not a golden, or not the one of these rows") from None
    return Stored(golden, about)


def _golden(about: Any, columns: Sequence[str], rows: Floats) -> Golden:
    steps = {
        str(name): [(float(t), float(bound)) for t, bound in pairs]
        for name, pairs in about["bounds"].items()
    }
    kept = {
        str(name): Invariant(float(entry["value"]), float(entry["bound"]))
        for name, entry in about["invariants"].items()
    }
    if list(steps) != list(columns) or not all(steps.values()):
        raise ValueError
    horizon = about["horizon"]
    horizon = None if horizon is None else float(horizon)
    for key in ("output_step", "end"):
        float(about[key])
    return Golden(
        tuple(columns), np.ascontiguousarray(rows), steps, horizon, kept,
        int(about["stride"]),
    )  # fmt: skip


def _broken(path: Path, why: str) -> InputError:
    hint = "`lagsim golden --update` stores it again"
    return InputError([Problem("bad-golden", f"{path} {why}", hint=hint)])
