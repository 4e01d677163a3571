"""`lagsim compare`: comparison of two results, column by column."""

from __future__ import annotations

import math
from functools import partial
from pathlib import Path  # noqa: TC003  typer looks at it
from typing import TYPE_CHECKING, Any

import typer

from lagsim.cli._shared import (
    JSON,
    aligned,
    coloured,
    option,
    print_stdout,
    quiet,
    show_json,
    write_picture,
)
from lagsim.codes import failure, number
from lagsim.codes.known import DIFFERS, USAGE
from lagsim.errors import Problems, counted, several
from lagsim.studies.comparison import Deviation, Verdict, compare
from lagsim.studies.tables import StoredTable, read_results

if TYPE_CHECKING:
    from collections.abc import Sequence


# The largest number of columns in the printed list.
LISTED = 10


def command(
    golden: Path = typer.Argument(
        metavar="GOLDEN", help="The reference: a CSV file or a folder of results."
    ),
    new: Path = typer.Argument(
        metavar="NEW", help="The result to be compared with it: a CSV file or a folder."
    ),
    rtol: str | None = option(
        "X",
        "Allowed difference relative to a column's scale; default: one unit in the "
        "last place."
    ),
    atol: str | None = option(
        "X", "Allowed absolute difference, added to that; default 0."
    ),
    plot: Path | None = option(
        "FILE", "Draw the columns that differ most into a PNG file."
    ),
    as_json: bool = JSON,
    quiet: bool = quiet(
        "Print only faults; the exit code is the result."
    ),
) -> int:  # fmt: skip
    """Compare two results.

    The exit code is 0 within tolerance, 1 where they differ, 2 if unusable.
    """
    tolerances = _tolerances(rtol, atol)
    tables = read_results(golden), read_results(new)
    verdict = compare(*tables, *tolerances)
    if plot is not None:
        write_picture(plot, partial(_picture, *tables, verdict))
    remarks = [*tables[0].remarks, *tables[1].remarks, *notes(verdict)]
    names = [table.name for table in tables]
    if as_json:
        show_json(_document(names, verdict, remarks))
    elif not quiet:
        print_stdout(_report(names, verdict, remarks))
    return 0 if verdict.passed else 1


def _picture(golden: StoredTable, new: StoredTable, verdict: Verdict) -> bytes:
    from lagsim.outputs.letters import Letters
    from lagsim.studies.comparison_chart import picture, summary_texts

    letters, units = Letters(golden.columns), {**golden.units, **new.units}
    title, *first = summary_texts(verdict, letters)
    names = f"{golden.name} and {new.name}"
    return picture(title, names, verdict, letters, units, first)


def _tolerances(
    rtol: str | None, atol: str | None
) -> tuple[float | None, float | None]:
    """Parse rtol and atol; None for an option that is not given.

    Raises
    ------
    InputError
        For a text that is no number >= 0.
    """
    values: list[float | None] = []
    problems = Problems()
    for name, text in (("--rtol", rtol), ("--atol", atol)):
        try:
            value = None if text is None else float(text)
        except ValueError:
            value = math.nan
        if value is not None and not 0.0 <= value < math.inf:
            message = f"{name} {text}: a number of at least 0 is expected"
            problems.add(USAGE, message, hint=f"such as {name} 1e-9")
        values.append(value)
    problems.refuse()
    return values[0], values[1]


def _report(names: Sequence[str], verdict: Verdict, remarks: Sequence[str]) -> str:
    """Return the report as text: the verdict, then the columns by falling deviation."""
    assert verdict.rows is not None
    size = f"{counted(len(verdict.rows.golden), 'row')}, "
    size += counted(len(verdict.worst), "column")
    head = verdict_line(verdict, "differ", f"{' and '.join(names)}, {size} compared")
    worst = differing(verdict) or _listing(verdict.worst[:3])
    return "\n".join([head, *(f"  {remark}" for remark in remarks), *worst])


def verdict_line(verdict: Verdict, differs: str, label: str) -> str:
    """Return the verdict as one line: `same: ...`, or `<differs>: ... [number]`.

    differs : the word if the comparison fails.
    label : the names or rows that were compared, which follow the word.
    """
    if verdict.passed:
        return f"{coloured('same', '32')}: {label}"
    return f"{coloured(differs, '31')}: {label} [{number(DIFFERS)}]"


def differing(verdict: Verdict) -> list[str]:
    """Return lines on the columns that fail, the first in time before the others.

    The others are sorted by falling deviation.
    """
    first, failed = verdict.first, verdict.failed
    if first is None:
        return []
    head = f"  the first to pass its bound: {first.column}, t = {first.first!r}"
    lines = [head, *_listing(failed[:LISTED])]
    if more := failed[LISTED:]:
        lines.append(f"  and {counted(len(more), 'more column')} that differ")
    return lines


def notes(verdict: Verdict) -> list[str]:
    """Return notes on columns that only one result has, and on other differences."""
    lines = []
    for label, names in (("missing", verdict.missing), ("extra", verdict.extra)):
        lines += [f"{label}: {several(names, 8)}"] if names else []
    return [*lines, *verdict.faults]


def _listing(deviations: Sequence[Deviation]) -> list[str]:
    """Return the lines of a table: for each column the cell of largest deviation."""
    rows = [("column", "worst at t", "golden", "new", "difference", "bound", "cells")]
    rows += [
        (
            d.column, f"{d.t:.9g}", repr(d.golden), repr(d.new),
            f"{d.difference:.3g}", f"{d.tolerance:.3g}", str(d.cells),
        )
        for d in deviations
    ]  # fmt: skip
    return aligned(rows, lefts=len(rows[0])).splitlines()


def _document(
    names: Sequence[str], verdict: Verdict, remarks: Sequence[str]
) -> dict[str, Any]:
    """Return the comparison as a JSON document.

    Later versions of lagsim add keys and remove none.

    names : the names of the two results.
    """
    rows, first = verdict.rows, verdict.first
    assert rows is not None
    return judgement(verdict) | {
        "golden": names[0],
        "new": names[1],
        "rows": len(rows.golden),
        "first": first and {"column": first.column, "t": first.first},
        "missing_times": len(rows.missing),
        "extra_times": len(rows.extra),
        "notes": remarks,
    }


def judgement(verdict: Verdict) -> dict[str, Any]:
    """Return a verdict as a JSON document: the deviation of each column."""
    worst = [{**d._asdict(), "pass": d.passed} for d in verdict.worst]
    for cell in worst:
        del cell["ratio"]
    return {
        "pass": verdict.passed,
        "failure": None if verdict.passed else failure(DIFFERS),
        "missing_columns": verdict.missing,
        "extra_columns": verdict.extra,
        "worst": worst,
    }
