"""Names of columns, derived from coordinates, definitions and their members.

A member of a family or a component of a vector has a name with dots, `q.3`, `G.3.x`;
endings are inserted before the first dot: `q_dot.3`, `G_ddot.3.x`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Collection

# Prefix of the names of hidden definitions, which no name of a file has.
HIDDEN = "~"
# Prefix of the names of the constraints on the lengths of quaternions.
UNIT_LENGTH = "unit."
ENDINGS = ("", "_dot", "_ddot")


def rate_of(name: str, order: int = 1) -> str:
    """Return the name of a rate (order 1), or of the second rate.

    Examples
    --------
    >>> rate_of("q.3")
    'q_dot.3'
    """
    head, dot, tail = name.partition(".")
    return f"{head}{ENDINGS[order]}{dot}{tail}"


def rated(name: str) -> tuple[str, int]:
    """Return the base of a rate's name, and the order; for other names, itself and 0.

    Examples
    --------
    >>> rated("q_dot.3"), rated("q")
    (('q.3', 1), ('q', 0))
    """
    head, dot, tail = name.partition(".")
    for order in (2, 1):
        if head.endswith(ENDINGS[order]):
            return f"{head.removesuffix(ENDINGS[order])}{dot}{tail}", order
    return name, 0


def member_hint(name: str, columns: Collection[str]) -> str:
    """Return a hint that names the columns of a family or vector; else "".

    name : the name in question.
    columns : names of all columns.
    """
    for column in columns:
        if name == in_file(column):
            return f"its name outside of the file is `{column}`"
    for column in columns:
        if column.startswith(f"{name}.") or in_file(column).startswith(f"{name}."):
            return f"name one value of it, such as `{column}`"
    return ""


def in_file(name: str) -> str:
    """Return a member or a component in the file's notation: `G(3).x` for `G.3.x`.

    Examples
    --------
    >>> in_file("G.3.x")
    'G(3).x'
    """
    head, *rest = name.split(".")
    numbers = [part for part in rest if part.isdecimal() or part[:1] == "-"]
    letters = [f".{part}" for part in rest if part not in numbers]
    return head + (f"({', '.join(numbers)})" if numbers else "") + "".join(letters)
