"""`lagsim check`: whether the initial state is admissible."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

import typer

from lagsim.cli._faults import faults_shown
from lagsim.cli._shared import AsJson, Sets, Strict, assignments, refused, show_json
from lagsim.cli._streams import complain, say
from lagsim.cli._verdict import annotate_start, report
from lagsim.model.reader import read_file
from lagsim.outputs.examined import document
from lagsim.run.session import check

if TYPE_CHECKING:
    from collections.abc import Sequence


def command(
    models: Annotated[
        list[str], typer.Argument(metavar="MODEL...", help="Model files; - is stdin.")
    ],
    sets: Sets = None,
    repair: Annotated[
        bool, typer.Option("--repair", help="Print the nearest admissible state.")
    ] = False,
    as_json: AsJson = False,
    quiet: Annotated[
        bool, typer.Option("-q", "--quiet", help="Print nothing for admissible starts.")
    ] = False,
    strict: Strict = False,
) -> int:
    """Check whether a start is admissible, and list the constraints."""
    documents: list[Any] = []
    codes = [
        _one(
            model,
            sets,
            repair=repair,
            quiet=quiet,
            strict=strict,
            documents=documents if as_json else None,
        )
        for model in models
    ]
    if as_json:
        show_json(documents[0] if len(models) == 1 else documents)
    return max(codes)


def _one(
    path: str,
    sets: Sequence[str] | None,
    *,
    repair: bool,
    quiet: bool,
    strict: bool,
    documents: list[Any] | None,
) -> int:
    """Check one model; give the exit code."""
    with faults_shown(documents, file=path) as code:
        model = read_file(path, assignments(sets))
        case, choices = check(model)
        admissible, warnings = case.examined.admissible, case.examined.warnings
        alarmed = strict and admissible and bool(warnings)
        if documents is not None:
            documents.append(document(case.equations, case.examined, choices))
        elif not (quiet and admissible and not alarmed):
            say(report(case.equations, case.examined, choices, repair=repair))
        if warnings or not admissible:
            annotate_start(case.equations, case.examined)
        if alarmed:
            complain(refused(model.name, [w.code for w in warnings]))
        code.append(0 if admissible and not alarmed else 1)
    return code[-1]
