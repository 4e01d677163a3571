"""`lagsim explain`: the meaning of a message, and what to try."""

from __future__ import annotations

import textwrap
from difflib import get_close_matches
from typing import TYPE_CHECKING, Annotated, Any

import typer

from lagsim.cli._faults import faults_shown
from lagsim.cli._shared import AsJson, show_json, table
from lagsim.cli._streams import say
from lagsim.codes import every, found
from lagsim.errors import InputError, Problem

if TYPE_CHECKING:
    from lagsim.codes.row import Row

WIDTH = 88


def _words() -> list[str]:
    return [word for row in every() for word in (row.number, row.code)]


def command(
    code: Annotated[
        str | None,
        typer.Argument(help="Number or code, such as E104; without it all are listed.",
                       autocompletion=_words),
    ] = None,
    as_json: AsJson = False,
) -> int:  # fmt: skip
    """Explain a message, and what to try."""
    documents: list[Any] = []
    with faults_shown(documents if as_json else None) as codes:
        rows = _asked(code)
        if as_json:
            documents.append([_document(row) for row in rows])
        elif code is None:
            say(table((row.number, f"{row.code}: {row.happened}") for row in rows))
        else:
            say("\n\n".join(map(_page, rows)))
        codes.append(0)
    if as_json:
        show_json(documents[0])
    return codes[-1]


def _asked(code: str | None) -> list[Row]:
    if code is None:
        return every()
    rows = found(code)
    if not rows:
        near = get_close_matches(code.upper(), _words(), 1)
        near = near or get_close_matches(code.lower(), _words(), 1)
        hint = f"did you mean `{near[0]}`?" if near else ""
        text = f"there is no message `{code}`"
        raise InputError([Problem("unknown-code", text, hint=hint)])
    return rows


def _document(row: Row) -> dict[str, Any]:
    return {
        "number": row.number,
        "code": row.code,
        "expected": row.expected or row.happened,
        "hint": row.hint,
        "example": {"model": row.model, "commands": row.commands},
    }


def _page(row: Row) -> str:
    lines = [
        f"{row.number} {row.code}",
        "",
        textwrap.fill(row.happened, WIDTH),
        *([textwrap.fill(f"Expected: {row.expected}", WIDTH)] if row.expected else []),
        textwrap.fill(row.hint, WIDTH, initial_indent="  hint: ",
                      subsequent_indent="        "),
    ]  # fmt: skip
    if row.commands:
        lines += ["", "Example"]
        if row.change:
            lines += ["", textwrap.indent(row.change.rstrip("\n"), "    ")]
        lines += ["", *(f"    {command}" for command in row.commands)]
    return "\n".join(lines)
