"""Commands that run one model in many ways: their job, options and closing lines."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, NamedTuple

from lagsim.cli._shared import (
    coloured,
    commit,
    counted,
    drawn,
    listed,
    progress_bar,
    show_json,
)
from lagsim.cli._streams import complain, say
from lagsim.errors import Problem
from lagsim.outputs.table import table_of

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence
    from pathlib import Path

    from lagsim.run.interrupt import Interrupt

    Progress = Callable[[float], None] | None
    Measure = Callable[[Interrupt, Progress], "Measured | list[str]"]


class Measured(NamedTuple):
    """The result of an experiment, as it is written and reported."""

    # Its record, the manifest, which will list its files; what else is written.
    document: dict[str, Any]
    tables: Mapping[str, bytes]
    # The name of its picture, and what draws it; None where there is none.
    chart: str
    draw: Callable[[], bytes] | None
    # Gives the closing lines, of what they say of the files; and lines for stderr.
    summary: Callable[[str], str]
    remarks: Sequence[str] = ()
    # The exit code, if no signal has another.
    code: int = 0


def experiment(
    command: str,
    measure: Measure,
    folder: Path,
    manifest: str,
    documents: list[Any] | None = None,
    *,
    quiet: bool,
    as_json: bool,
) -> int:
    """Measure; write and report what is found; return the exit code.

    `measure` ends early where it is interrupted, and may give remarks instead: then
    nothing is written. A signal leaves the chart out, and so does what keeps it from
    being drawn. The document is printed, as JSON, or goes to `documents`.
    """
    from lagsim.outputs.results import open_results
    from lagsim.run.interrupt import Interrupt

    interrupt = Interrupt()
    with open_results(folder, manifest) as results, interrupt.noted():
        with progress_bar(command, quiet=quiet) as progress:
            found = measure(interrupt, progress)
        if isinstance(found, list):
            complain("\n".join(found))
            return 128 + (interrupt.signal or 0)
        files = dict(found.tables)
        warnings = list[Any]()
        for caution in results.cautions:
            complain(f"warning: {caution.text} [{caution.number}]")
            warnings.append(caution.record)

        def draw() -> None:
            content = found.draw and drawn(found.chart, found.draw, warnings)
            if content:
                files[found.chart] = content

        interrupt.cut(draw)
        document = found.document | {"files": [*files, manifest]}
        document |= {"warnings": warnings} if warnings else {}
        commit(results, document, files)
    for remark in found.remarks:
        complain(remark)
    if documents is not None:
        documents.append(document)
    elif as_json:
        show_json(document)
    if not quiet and not as_json:
        say(found.summary(f"{folder}: {', '.join(document['files'])}"))
    return found.code if interrupt.signal is None else 128 + interrupt.signal


def csv(columns: Sequence[str], rows: Iterable[Mapping[str, Any]]) -> bytes:
    """Return a table of the rows that a document holds."""
    return table_of(columns, ([row[name] for name in columns] for row in rows))


def numbers(
    problems: list[Problem],
    option: str,
    text: str,
    *,
    what: str,
    example: str,
    allowed: Callable[[float, float], bool],
) -> tuple[float, float] | None:
    """Return the numbers of A:B, the smaller first; else add a problem."""
    try:
        low, high = sorted(float(part) for part in text.split(":"))
    except ValueError:
        low = high = math.nan
    if math.isfinite(low) and math.isfinite(high) and allowed(low, high):
        return low, high
    message = f"{option} {text}: two {what} are expected"
    problems.append(Problem("usage", message, hint=f"such as {example}"))
    return None


def headline(document: Mapping[str, Any], *counts: tuple[int, str]) -> str:
    """Return the first of the closing lines: whether it is done, and how much."""
    state, colour = ("done", "32") if document["complete"] else ("interrupted", "31")
    counted_up = " by ".join(counted(*count) for count in counts)
    return f"{coloured(state, colour)}: {document['model']['name']}, {counted_up}"


def left_out(refused: Iterable[Mapping[str, str]]) -> list[tuple[str, str]]:
    """Return the closing lines of methods that do not apply, by their reasons."""
    by_reason: dict[str, list[str]] = {}
    for one in refused:
        by_reason.setdefault(one["reason"], []).append(one["method"])
    return listed("left out", (f"{', '.join(m)}: {r}" for r, m in by_reason.items()))
