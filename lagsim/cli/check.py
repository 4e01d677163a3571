"""`lagsim check`: whether the initial state is admissible."""

from __future__ import annotations

from typing import Any

from lagsim import limits
from lagsim.cli._faults import reported
from lagsim.cli._shared import (
    JSON,
    MODELS,
    NO_LIMITS,
    SETS,
    STRICT,
    assignments,
    flag,
    print_stderr,
    print_stdout,
    quiet,
    show_json,
    strict_line,
)
from lagsim.cli._verdict import annotate_start, report
from lagsim.errors import LagsimError
from lagsim.model.reader import read_file
from lagsim.outputs.manifest import examination
from lagsim.run.session import check


def command(
    models: list[str] = MODELS,
    sets: list[str] | None = SETS,
    repair: bool = flag("--repair", "Print the nearest admissible state."),
    as_json: bool = JSON,
    no_limits: bool = NO_LIMITS,
    quiet: bool = quiet("Print only starts that are not admissible."),
    strict: bool = STRICT,
) -> int:
    """Check whether a start is admissible, and list the constraints."""
    documents: list[Any] | None = [] if as_json else None

    def one(path: str) -> int:
        model = read_file(path, assignments(sets))
        case, choices = check(model)
        equations, examined = case.equations, case.examined
        admissible, warnings = examined.admissible, examined.warnings
        alarmed = strict and admissible and bool(warnings)
        if documents is not None:
            documents.append(examination(equations, examined, choices))
        elif not (quiet and admissible and not alarmed):
            print_stdout(report(equations, examined, choices, repair=repair))
        if warnings or not admissible:
            annotate_start(equations, examined)
        if alarmed:
            print_stderr(strict_line(model.name, [w.code for w in warnings]))
        return 0 if admissible and not alarmed else 1

    codes = []
    for path in models:
        try:
            with limits.lifted(really=no_limits):
                codes.append(one(path))
        except LagsimError as error:
            codes.append(reported(error, documents, path))
    if documents is not None:
        show_json(documents[0] if len(models) == 1 else documents)
    return max(codes)
