"""Files of goldens, and verdicts on runs by them.

`<name>.csv` holds the rows of a golden, and `<name>.json` all else.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import orjson

from lagsim import files
from lagsim.errors import InputError, Problem
from lagsim.methods import method as method_named
from lagsim.outputs.manifest import encode, versions
from lagsim.outputs.results import open_results
from lagsim.studies.comparison import Deviation, Pair, Verdict, ordered
from lagsim.studies.golden import (
    DIGITS,
    Golden,
    Invariant,
    Motion,
    at_impacts,
    invariants,
    motion_of,
)
from lagsim.studies.tables import read_table
from lagsim.tolerances import SAME_ROW
from lagsim.version import __version__

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from lagsim.errors import Place
    from lagsim.language.arrays import Floats
    from lagsim.model.model import Model
    from lagsim.run.session import Case

FOLDER = "golden"
# How long to wait for others who store in the folder; each takes some milliseconds.
PATIENCE_SECONDS = 10.0
# What a double holds, whatever its bound.
MOST_DIGITS = 17


class Stored(NamedTuple):
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
    """Return the CSV of the rows, with the digits that are certain."""
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
    """Return the shortest text of a value to a tenth of its bound, or better."""
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


# What an invariant is called beside the column of its name.
CONSTANT = " (constant)"


def run(case: Case, stored: Stored) -> Motion:
    """Return the motion of a case with rows at the times of the golden."""
    spacing = float(stored.about["output_step"])
    plan = case.plan()
    step = None if method_named(plan.method).ADAPTIVE else plan.step
    other = case.asking(output_step=spacing, step=step)
    return motion_of(other, stored.golden.stride)


def judge(case: Case, motion: Motion, stored: Stored) -> Verdict:
    """Return the verdict on a motion by the golden of its model."""
    golden, about, model = stored.golden, stored.about, case.equations.model
    pairs = dict(_columns(motion, stored)) | dict(_invariants(case, motion, golden))
    known = about.get("columns", golden.columns)
    changed, places = _changed(model, about)
    worst = ordered(pair.deviation(name) for name, pair in pairs.items())
    return Verdict(
        worst=worst,
        missing=tuple(c for c in golden.columns if c not in motion.columns),
        extra=tuple(c for c in motion.columns if c not in known),
        faults=tuple(_faults(motion, about)),
        of=pairs.__getitem__,
        notes=tuple(_notes(case, motion, about, changed)),
        changed=tuple(changed or ()),
        place=next(iter([*places, *_about(model, worst)]), None),
    )


def _changed(
    model: Model, about: Mapping[str, Any]
) -> tuple[list[str] | None, list[Place]]:
    """Return texts on changed inputs, None where not known, and their places.

    Start values that follow a parameter are not named beside it.
    """
    found: list[str] | None = None
    places: list[Place] = []
    known = {"parameter": model.places, "start value": {}}
    known["start value"] = {x.name: x.place for x in model.initial}
    texts = model.stated.texts()
    known["expression"] = {name: x.place for name, x in texts.items()}
    now: dict[str, dict[str, Any]] = {
        "parameters": {p.name: p.value for p in model.parameters},
        "initial": {x.name: x.value for x in model.initial},
        "expressions": {name: x.text for name, x in texts.items()},
    }
    for (key, values), (word, where) in zip(now.items(), known.items(), strict=True):
        was = about.get(key)
        if not isinstance(was, dict) or (found and key == "initial"):
            continue
        found = found or []
        for name in [n for n in values if values[n] != was.get(n)]:
            other = f"in the golden {was[name]!r}" if name in was else "and is new"
            found.append(f"{word} `{name}` is {values[name]!r}, {other}")
            places += [where[name]] if name in where else []
        found += [f"{word} `{n}` is no longer there" for n in was if n not in values]
    return found, places


def _about(model: Model, worst: Sequence[Deviation]) -> list[Place]:
    """Return the places of the inputs that columns which differ are named after."""
    places = dict(model.places)
    places |= {c.name: c.relation.place for c in model.constraints}
    found = []
    for deviation in worst:
        if not deviation.passed:
            base = deviation.column.removesuffix(CONSTANT)
            for prefix in ("Qc_", "lambda_", "residual_", "reaction."):
                base = base.removeprefix(prefix)
            for name in (base, base.removesuffix("_dot"), base.removesuffix("_ddot")):
                found += [places[name]] if name in places else []
    return found


def _columns(motion: Motion, stored: Stored) -> Iterator[tuple[str, Pair]]:
    """Give each column of both, in the rows of the golden."""
    golden, t = stored.golden, stored.golden.rows[:, 0]
    near = SAME_ROW * float(stored.about["output_step"])
    rows = motion.at(t, near, ends=golden.horizon is None)
    for k, name in enumerate(golden.columns):
        if name in motion.columns:
            bounds = golden.bounds(name)
            if name == "t":  # the same times as far as they were looked for
                bounds = bounds + np.where(at_impacts(t), 0.0, near)
            new = rows[:, motion.columns.index(name)]
            yield name, Pair(t, golden.rows[:, k], new, bounds)


def _invariants(
    case: Case, motion: Motion, golden: Golden
) -> Iterator[tuple[str, Pair]]:
    """Give each invariant of both, in all rows of the motion."""
    now, t = invariants(case.equations, motion), motion.rows[:, 0]
    for name, kept in golden.invariants.items():
        if name in now:
            value, bound = (np.full(len(t), x) for x in (kept.value, kept.bound))
            yield f"{name}{CONSTANT}", Pair(t, value, now[name], bound)


def _faults(motion: Motion, about: Mapping[str, Any]) -> list[str]:
    outcome = motion.trajectory.outcome
    if not outcome.complete:
        return [f"the run does not finish: {motion.trajectory.reason}"]
    if outcome.word != about.get("outcome", outcome.word):
        was = about["outcome"]
        return [f"the run ends by `{outcome.word}`, the golden by `{was}`"]
    return []


def _notes(
    case: Case, motion: Motion, about: Mapping[str, Any], changed: list[str] | None
) -> list[str]:
    """Return notes on changes besides those of the motion."""
    notes = []
    model = case.equations.model
    if model.sha256 != about.get("model_sha256"):
        text = "the model file has changed since its golden was stored"
        if changed is not None:
            what = "; ".join(changed) or "not in what the golden holds of it"
            text = f"{text}: {what}"
        notes.append(text)
    for what in ("method", "formulation"):
        now, was = getattr(motion.plan, what), about.get(what)
        if now != was:
            notes.append(f"{what} {now}, the golden's is {was}")
    was, now = about.get("versions", {}), versions()
    changed = [f"lagsim {about.get('lagsim')}"] * (about.get("lagsim") != __version__)
    changed += [f"{k} {was[k]}" for k in now if k in was and was[k] != now[k]]
    if changed:
        notes.append(f"the golden is from {', '.join(changed)}")
    if case.settings.output_step != float(about["output_step"]):
        notes.append(f"rows every {about['output_step']!r}, as in the golden")
    end = float(about["end"])
    apart = abs(motion.trajectory.end - end)
    if apart > SAME_ROW * float(about["output_step"]):
        notes.append(
            f"the run ends at t = {motion.trajectory.end!r}, the golden's at {end!r}"
        )
    return notes


def picture(case: Case, verdict: Verdict) -> bytes:
    """Draw the worst columns of a verdict on a run; give a PNG."""
    from lagsim.outputs.letters import letters_of
    from lagsim.outputs.units import of_table
    from lagsim.studies import comparison_chart

    model = case.equations.model
    columns = [d.column.partition(" ")[0] for d in verdict.worst]
    letters, units = letters_of(model), of_table(case.equations, columns)
    subject = ", ".join(comparison_chart.summary(verdict, letters))
    title = f"{model.name} differs from its golden"
    return comparison_chart.picture(
        title, subject, verdict, letters, units, verdict.changed
    )
