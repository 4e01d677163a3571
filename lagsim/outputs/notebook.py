"""Small pages for notebooks, in HTML that needs nothing else."""

from __future__ import annotations

import base64
from html import escape
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

# Letters in a line of a text.
LINE = 76
_CELL = "text-align: left; vertical-align: top"


def listed(items: Sequence[str], most: int = LINE - 13) -> str:
    """Return `a, b, c`, or as many as fit: `a, b and 12 more`; of nothing `none`."""
    whole = ", ".join(items) or "none"
    if len(whole) <= most:
        return whole
    shown = len(items) - 1
    while shown > 1 and len(", ".join(items[:shown])) > most - len(" and 100 more"):
        shown -= 1
    return f"{', '.join(items[:shown])} and {len(items) - shown} more"


def short(text: str, most: int = LINE) -> str:
    """Return a text on one line of so many letters at most."""
    line = " ".join(text.split())
    return line if len(line) <= most else f"{line[: most - 3].rstrip()}..."


def block(head: str, rows: Iterable[tuple[str, str]]) -> str:
    """Return a text for `repr`: a head, and below it a line for each name and text."""
    rows = list(rows)
    width = max((len(name) for name, _ in rows), default=0)
    lines = [f"  {name:<{width}}  {short(text, LINE - width)}" for name, text in rows]
    return "\n".join([f"<{short(head)}", *lines]) + ">"


def page(*parts: str) -> str:
    """Return the parts that have something to show, below each other."""
    return "\n".join(part for part in parts if part)


def heading(text: str) -> str:
    """Return a heading."""
    return f"<strong>{escape(text)}</strong>"


def paragraph(text: str) -> str:
    """Return a paragraph; nothing where there is no text."""
    return f"<p>{escape(text)}</p>" if text else ""


def table(rows: Iterable[Sequence[str]], head: Sequence[str] = ()) -> str:
    """Return a table of texts; nothing where it has no rows."""
    lines = [_row("td", row) for row in rows]
    if not lines:
        return ""
    lines[:0] = [_row("th", head)] if head else []
    return "<table>\n" + "\n".join(lines) + "\n</table>"


def _row(tag: str, cells: Sequence[str]) -> str:
    inside = "".join(f'<{tag} style="{_CELL}">{escape(c)}</{tag}>' for c in cells)
    return f"<tr>{inside}</tr>"


def picture(png: bytes, about: str) -> str:
    """Return a picture that lies in the page itself."""
    source = f"data:image/png;base64,{base64.b64encode(png).decode()}"
    style = "max-width: 700px; width: 100%"
    return f'<img alt="{escape(about)}" style="{style}" src="{source}">'
