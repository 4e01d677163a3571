"""`lagsim check`: whether the initial state is admissible."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

import typer

from lagsim.cli._shared import (
    AsJson,
    ModelPath,
    Sets,
    assignments,
    coloured,
    faults_shown,
    show_json,
    table,
)

if TYPE_CHECKING:
    from lagsim.admissibility import Start, Verdict
    from lagsim.equations import Equations
    from lagsim.model import Model


def command(
    model: ModelPath,
    sets: Sets = None,
    repair: Annotated[
        bool, typer.Option("--repair", help="Print the nearest admissible state.")
    ] = False,
    as_json: AsJson = False,
) -> int:
    """Tell whether the initial state is admissible, and what the constraints are."""
    from lagsim.admissibility import examine
    from lagsim.equations import derive
    from lagsim.reader import read_file

    with faults_shown(as_json=as_json) as code:
        read = read_file(model, assignments(sets))
        equations = derive(read)
        start = examine(equations)
        code.append(show(read, equations, start, as_json=as_json, repair=repair))
    return code[-1]


def show(
    model: Model,
    equations: Equations,
    start: Start,
    *,
    as_json: bool = False,
    repair: bool = False,
) -> int:
    """Print the report; give the exit code."""
    if as_json:
        show_json(document(model, start))
    else:
        print(report(model, equations, start, repair=repair))
    return 0 if start.admissible else 1


def document(model: Model, start: Start) -> dict[str, Any]:
    """Give the content of `check --json`."""
    return {
        "model": {"name": model.name, "file": model.file, "sha256": model.sha256},
        "admissible": start.admissible,
        "degrees_of_freedom": start.degrees_of_freedom,
        "constraints": [_constraint(v) for v in start.verdicts],
        "repair": start.repair,
        "warnings": [{"code": w.code, "text": w.text} for w in start.warnings],
    }


def _constraint(verdict: Verdict) -> dict[str, Any]:
    return {
        "name": verdict.name,
        "kind": verdict.kind,
        "scleronomic": verdict.scleronomic,
        "pfaffian": verdict.pfaffian,
        "integrable": None,
        "residual": verdict.residual,
        "velocity_residual": verdict.velocity_residual,
        "satisfied": verdict.satisfied,
        "redundant": verdict.redundant,
    }


def report(
    model: Model, equations: Equations, start: Start, *, repair: bool = False
) -> str:
    """Give the report for people; its first line is the verdict."""
    if start.admissible:
        head = coloured("admissible", "32") + f": {model.name}"
    else:
        violated = [v for v in start.verdicts if not v.satisfied]
        head = coloured("inadmissible", "31") + f": {model.name}: "
        head += "; ".join(map(_violation, violated))
    n, m = len(equations.q), len(equations.rows)
    freedom = start.degrees_of_freedom
    lines = [
        head,
        (
            f"  {n} coordinates, {m} constraints of rank {start.rank}, "
            f"{freedom} degree{'s' * (freedom != 1)} of freedom"
        ),
    ]
    if start.verdicts:
        lines.append(table((v.name, _described(v)) for v in start.verdicts))
    lines += [f"  warning: {w.text}" for w in start.warnings]
    if not start.admissible or repair:
        lines += _repair(start)
    return "\n".join(lines)


def _violation(verdict: Verdict) -> str:
    if abs(verdict.residual) > verdict.bound:
        return f"constraint `{verdict.name}` has the residual {verdict.residual:.6g}"
    return f"the rate of constraint `{verdict.name}` is {verdict.velocity_residual:.6g}"


def _described(verdict: Verdict) -> str:
    words = [verdict.kind, "scleronomic" if verdict.scleronomic else "rheonomic"]
    if verdict.pfaffian is not None:
        words.append("Pfaffian" if verdict.pfaffian else "not Pfaffian")
    if verdict.redundant:
        words.append("redundant")
    text = f"{', '.join(words)}; residual {verdict.residual:.3g}"
    if verdict.velocity_residual is not None:
        text += f", of the rate {verdict.velocity_residual:.3g}"
    return text + ("" if verdict.satisfied else "  <- violated")


def _repair(start: Start) -> list[str]:
    if start.admissible:
        return ["  nothing to repair"]
    if start.repair is None:
        return ["  no admissible state was found from here"]
    lines = ["  the nearest admissible state, for `initial:`"]
    lines += [f"    {name}: {value!r}" for name, value in start.repair.items()]
    names = ", ".join(name for name in start.repair)
    lines.append(f"  or give {names} as `{{guess: value}}` to have them solved")
    return lines
