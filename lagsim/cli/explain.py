"""`lagsim explain`: the meaning of a message, and what to try."""

from __future__ import annotations

import textwrap
from typing import TYPE_CHECKING, Any

import typer

from lagsim.cli._shared import JSON, aligned_pairs, print_stdout, show_json
from lagsim.codes import Retired, cautions, every, found
from lagsim.codes.known import RETIRED, UNKNOWN_CODE
from lagsim.errors import did_you_mean, unusable

if TYPE_CHECKING:
    from lagsim.codes import MessageRow

WIDTH = 88


def _words() -> list[str]:
    return [word for row in every() for word in (row.number, row.code)]


def command(
    code: str | None = typer.Argument(
        None, help="Number or code, such as E104; without it all are listed.",
        autocompletion=_words,
    ),
    as_json: bool = JSON,
) -> int:  # fmt: skip
    """Explain a message, and what to try."""
    rows = every() if code is None else found(code) or _of_earlier_versions(code)
    if not rows and code is not None:
        hint = did_you_mean(code.upper(), _words())
        hint = hint or did_you_mean(code.lower(), _words())
        text = f"there is no message `{code}`"
        raise unusable(UNKNOWN_CODE, text, hint=hint)
    if as_json:
        show_json([_document(row) for row in rows])
    elif code is None:
        print_stdout(
            aligned_pairs((row.number, f"{row.code}: {row.happened}") for row in rows)
        )
    else:
        print_stdout("\n\n".join(map(_page, rows)))
    return 0


def _of_earlier_versions(name: str) -> list[MessageRow]:
    """Return the row of warning W207 if `name` is a retired method or formulation.

    [] for other names.
    """
    from lagsim.model.reader import runs

    row = cautions()[RETIRED]
    return [
        row._replace(happened=f"`{name}` was a {key}, and is retired. {row.happened}")
        for key, names in runs.RETIRED.items()
        if name.lower() in names
    ]


def _document(row: MessageRow | Retired) -> dict[str, Any]:
    found = {"number": row.number, "code": row.code}
    if isinstance(row, Retired):
        return found | {
            "expected": row.happened,
            "hint": "",
            "example": None,
            "retired": row.instead,
        }
    return found | {
        "expected": row.expected or row.happened,
        "hint": row.hint,
        "example": {"model": row.model, "commands": row.commands},
        "retired": None,
    }


def _page(row: MessageRow | Retired) -> str:
    if isinstance(row, Retired):
        text = f"{row.happened} This message is retired: {row.instead}."
        return f"{row.number} {row.code}\n\n{textwrap.fill(text, WIDTH)}"
    lines = [f"{row.number} {row.code}", "", textwrap.fill(row.happened, WIDTH)]
    lines += [textwrap.fill(f"Expected: {row.expected}", WIDTH)] * bool(row.expected)
    lines.append(textwrap.fill(f"  hint: {row.hint}", WIDTH, subsequent_indent=" " * 8))
    if row.commands:
        lines += ["", "Example"]
        if row.change:
            lines += ["", textwrap.indent(row.change.rstrip("\n"), "    ")]
        lines += ["", *(f"    {command}" for command in row.commands)]
    return "\n".join(lines)
