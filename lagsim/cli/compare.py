"""`lagsim compare`: whether a result is still what it was."""

from __future__ import annotations

import math
from functools import partial
from pathlib import Path  # noqa: TC003  typer looks at it
from typing import TYPE_CHECKING, Any, NamedTuple

import typer

from lagsim.cli._shared import JSON, aligned, coloured, counted, quiet, show_json
from lagsim.cli._streams import say
from lagsim.cli._writing import put_picture
from lagsim.codes import failure, number
from lagsim.errors import InputError, Problem
from lagsim.studies.comparison import compare
from lagsim.studies.tables import read_results

if TYPE_CHECKING:
    from collections.abc import Sequence

    from lagsim.studies.comparison import Deviation, Verdict
    from lagsim.studies.tables import Table

# So many columns are listed for a person.
LISTED = 10
DIFFERS = "differs"


def command(
    golden: Path = typer.Argument(
        metavar="GOLDEN", help="The reference: a CSV file or a folder of results."
    ),
    new: Path = typer.Argument(
        metavar="NEW", help="The result to be compared with it: a CSV file or a folder."
    ),
    rtol: str | None = typer.Option(
        None, metavar="X",
        help="Allowed difference relative to a column's scale; default: one unit in "
        "the last place.",
    ),
    atol: str | None = typer.Option(
        None, metavar="X",
        help="Allowed absolute difference, added to that; default 0.",
    ),
    plot: Path | None = typer.Option(
        None, metavar="FILE", help="Draw the columns that differ most into a PNG file."
    ),
    as_json: bool = JSON,
    quiet: bool = quiet(
        "Print nothing but faults; the exit code gives the result."
    ),
) -> int:  # fmt: skip
    """Compare two results.

    The exit code is 0 within tolerance, 1 where they differ, 2 if unusable.
    """
    tolerances = _tolerances(rtol, atol)
    one, two = read_results(golden), read_results(new)
    found = _Found(one, two, compare(one, two, *tolerances))
    if plot is not None:
        put_picture(plot, partial(_picture, found))
    if as_json:
        show_json(document(found))
    elif not quiet:
        say(report(found))
    return 0 if found.comparison.passed else 1


class _Found(NamedTuple):
    """A comparison and what was compared."""

    golden: Table
    new: Table
    comparison: Verdict


def _picture(found: _Found) -> bytes:
    from lagsim.outputs.letters import Letters
    from lagsim.studies.comparison_chart import picture, summary

    golden, new, comparison = found
    letters, units = Letters(golden.columns), {**golden.units, **new.units}
    title, *first = summary(comparison, letters)
    names = f"{golden.name} and {new.name}"
    return picture(title, names, comparison, letters, units, first)


def _tolerances(
    rtol: str | None, atol: str | None
) -> tuple[float | None, float | None]:
    """Read the tolerances; refuse what is no number, or negative."""
    values: list[float | None] = []
    problems = []
    for option, text in (("--rtol", rtol), ("--atol", atol)):
        try:
            value = None if text is None else float(text)
        except ValueError:
            value = math.nan
        if value is not None and not 0.0 <= value < math.inf:
            message = f"{option} {text}: a number of at least 0 is expected"
            problems.append(Problem("usage", message, hint=f"such as {option} 1e-9"))
        values.append(value)
    if problems:
        raise InputError(problems)
    return values[0], values[1]


def report(found: _Found) -> str:
    """Return what a person reads: the verdict, then the worst columns."""
    comparison, rows = found.comparison, found.comparison.rows
    assert rows is not None
    passed = comparison.passed
    verdict = coloured("same", "32") if passed else coloured("differ", "31")
    size = f"{counted(len(rows.golden), 'row')}, "
    size += counted(len(comparison.worst), "column")
    what = f"{found.golden.name} and {found.new.name}, {size} compared"
    numbered = "" if passed else f" [{number(DIFFERS)}]"
    lines = [f"{verdict}: {what}{numbered}"]
    lines += [f"  {note}" for note in notes(found)]
    if comparison.failed:
        lines += differing(comparison)
    else:
        lines += listing(comparison.worst[:3])
    more = len(comparison.failed) - LISTED
    if more > 0:
        lines.append(f"  and {counted(more, 'more column')} that differ")
    return "\n".join(lines)


def differing(verdict: Verdict) -> list[str]:
    """Return lines of what differs: the first column to do so, then the worst."""
    first = verdict.first
    assert first is not None
    head = f"  the first to pass its bound: {first.column}, t = {first.first!r}"
    return [head, *listing(verdict.failed[:LISTED])]


def notes(found: _Found) -> list[str]:
    """Return notes on what only one table has, and on incomplete runs."""
    comparison = found.comparison
    lines = [*found.golden.remarks, *found.new.remarks]
    for what, names in (("missing", comparison.missing), ("extra", comparison.extra)):
        more = f" and {len(names) - 8} more" if len(names) > 8 else ""
        lines += [f"{what}: {', '.join(names[:8])}{more}"] if names else []
    return [*lines, *comparison.faults]


def listing(deviations: Sequence[Deviation]) -> list[str]:
    """Return the worst cell of each column as an aligned table."""
    rows = [("column", "worst at t", "golden", "new", "difference", "bound", "cells")]
    rows += [
        (
            d.column, f"{d.t:.9g}", repr(d.golden), repr(d.new),
            f"{d.difference:.3g}", f"{d.tolerance:.3g}", str(d.cells),
        )
        for d in deviations
    ]  # fmt: skip
    return aligned(rows, lefts=len(rows[0])).splitlines()


def document(found: _Found) -> dict[str, Any]:
    """Return the JSON document; keys are only ever added."""
    comparison, rows = found.comparison, found.comparison.rows
    assert rows is not None
    first = comparison.first
    return {
        "pass": comparison.passed,
        "failure": None if comparison.passed else failure(DIFFERS),
        "golden": found.golden.name,
        "new": found.new.name,
        "rows": len(rows.golden),
        "first": first and {"column": first.column, "t": first.first},
        "missing_columns": list(comparison.missing),
        "extra_columns": list(comparison.extra),
        "missing_times": len(rows.missing),
        "extra_times": len(rows.extra),
        "notes": notes(found),
        "worst": [as_mapping(d) for d in comparison.worst],
    }


def as_mapping(deviation: Deviation) -> dict[str, Any]:
    """Return a column's worst cell for JSON."""
    found = {**deviation._asdict(), "pass": deviation.passed}
    del found["ratio"]
    return found
