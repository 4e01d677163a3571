"""Every message that lagsim has: its number, what is expected, what to try, an example.

One table. Messages take their numbers from it, and
`docs/errors.md` and `lagsim explain` all that they say. A number is given once: where a
message goes, its number goes with it.
"""

from __future__ import annotations

import functools
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from lagsim.codes.row import Row


@functools.cache
def errors() -> dict[str, Row]:
    """Give all that can go wrong, by code."""
    from lagsim.codes import models, runs

    return {row.code: row for row in models.ROWS + runs.ROWS}


@functools.cache
def cautions() -> dict[str, Row]:
    """Give all warnings, by code."""
    from lagsim.codes import warnings

    return {row.code: row for row in warnings.ROWS}


def number(code: str) -> str:
    """Give the number of an error, such as E104."""
    return errors()[code].number


def failure(code: str) -> dict[str, Any]:
    """Give what documents say of an answer that is no, or of a run that failed."""
    row = errors()[code]
    return {
        "code": code,
        "number": row.number,
        "expected": row.expected,
        "hint": row.hint,
    }


def every() -> list[Row]:
    """Give all messages, errors first, by number."""
    return [*errors().values(), *cautions().values()]


def found(word: str) -> list[Row]:
    """Give the messages with this number or this code, an error and a warning maybe."""
    return [r for r in every() if word.upper() == r.number or word.lower() == r.code]
