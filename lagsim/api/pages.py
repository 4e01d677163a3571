"""Small pages for notebooks, in HTML that needs nothing else."""

from __future__ import annotations

import base64
from html import escape
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

_CELL = "text-align: left; vertical-align: top"


def counted(number: int, word: str) -> str:
    """Give `2 rows`, or `1 row`."""
    ending = "s" if number != 1 else ""
    if word.endswith("degree of freedom"):
        return f"{number} degree{ending} of freedom"
    return f"{number} {word}{ending}"


def heading(text: str) -> str:
    """Give a heading."""
    return f"<strong>{escape(text)}</strong>"


def table(rows: Iterable[Sequence[str]], head: Sequence[str] = ()) -> str:
    """Give a table of texts."""
    lines = [_row("th", head)] if head else []
    lines += [_row("td", row) for row in rows]
    return "<table>\n" + "\n".join(lines) + "\n</table>"


def _row(tag: str, cells: Sequence[str]) -> str:
    inside = "".join(f'<{tag} style="{_CELL}">{escape(c)}</{tag}>' for c in cells)
    return f"<tr>{inside}</tr>"


def picture(png: bytes, about: str) -> str:
    """Give a picture that lies in the page itself."""
    source = f"data:image/png;base64,{base64.b64encode(png).decode()}"
    style = "max-width: 700px; width: 100%"
    return f'<img alt="{escape(about)}" style="{style}" src="{source}">'
