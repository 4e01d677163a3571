"""HTML fragments for notebooks, which refer to no other file."""

from __future__ import annotations

import base64
from html import escape
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

# Letters in a line of a text.
LINE = 76
_CELL = "text-align: left; vertical-align: top"


def short_list(items: Sequence[str], most: int = LINE - 13) -> str:
    """Return items as `a, b, c`, cut to `most` letters: `a, b and 12 more`.

    The text is `none` without items.

    Examples
    --------
    >>> short_list(["x", "y", "theta"])
    'x, y, theta'
    """
    whole = ", ".join(items) or "none"
    if len(whole) <= most:
        return whole
    shown = len(items) - 1
    while shown > 1 and len(", ".join(items[:shown])) > most - len(" and 100 more"):
        shown -= 1
    return f"{', '.join(items[:shown])} and {len(items) - shown} more"


def short(text: str, most: int = LINE) -> str:
    """Return a text on one line of at most `most` letters."""
    line = " ".join(text.split())
    return line if len(line) <= most else f"{line[: most - 3].rstrip()}..."


def text_block(head: str, rows: Iterable[tuple[str, str]]) -> str:
    """Return a text for `repr`: a head, and a line for each pair (name, text)."""
    rows = list(rows)
    width = max((len(name) for name, _ in rows), default=0)
    lines = [f"  {name:<{width}}  {short(text, LINE - width)}" for name, text in rows]
    return "\n".join([f"<{short(head)}", *lines]) + ">"


def paragraphs(*parts: str) -> str:
    """Return the parts that are not empty, separated by line breaks."""
    return "\n".join(part for part in parts if part)


def heading(text: str) -> str:
    """Return a heading in HTML."""
    return f"<strong>{escape(text)}</strong>"


def paragraph(text: str) -> str:
    """Return a paragraph in HTML; "" without text."""
    return f"<p>{escape(text)}</p>" if text else ""


def html_table(rows: Iterable[Sequence[str]], head: Sequence[str] = ()) -> str:
    """Return an HTML table of texts; "" without rows."""
    lines = [_row("td", row) for row in rows]
    if not lines:
        return ""
    lines[:0] = [_row("th", head)] if head else []
    return "<table>\n" + "\n".join(lines) + "\n</table>"


def _row(tag: str, cells: Sequence[str]) -> str:
    inside = "".join(f'<{tag} style="{_CELL}">{escape(c)}</{tag}>' for c in cells)
    return f"<tr>{inside}</tr>"


def picture(png: bytes, about: str) -> str:
    """Return an HTML image that contains its data, with alternative text `about`."""
    source = f"data:image/png;base64,{base64.b64encode(png).decode()}"
    style = "max-width: 700px; width: 100%"
    return f'<img alt="{escape(about)}" style="{style}" src="{source}">'


def framed(html: str, name: str, height: int) -> str:
    """Return an HTML frame that contains a page.

    Parameters
    ----------
    html : str
        The text of the page.
    name : str
        The title of the frame.
    height : int
        The height of the frame, in pixels.
    """
    style = f"width: 100%; height: {height}px; border: 0"
    return (
        f'<iframe title="{escape(name)}" style="{style}" '
        f'sandbox="allow-scripts allow-downloads" srcdoc="{escape(html)}"></iframe>'
    )
