"""The page that plays a motion, in a notebook."""

from __future__ import annotations

from html import escape
from pathlib import Path

# Pixels: tall enough for a scene, its panel and the controls.
HEIGHT = 640


class Animation:
    """A page that plays a motion; a notebook shows it at the end of a cell.

    Attributes
    ----------
    html : str
        The page: one file that needs nothing else.
    """

    def __init__(self, html: str, name: str, height: int = HEIGHT) -> None:
        self.html, self._name, self._height = html, name, height

    def write(self, path: str | Path) -> None:
        """Write the page to a file, to open it in a browser."""
        Path(path).write_text(self.html, encoding="utf-8")

    def __repr__(self) -> str:
        return f"<Animation of {self._name}: {len(self.html) / 1000:.0f} kB of HTML>"

    def _repr_html_(self) -> str:
        style = f"width: 100%; height: {self._height}px; border: 0"
        return (
            f'<iframe title="{escape(self._name)}" style="{style}" '
            f'sandbox="allow-scripts allow-downloads" srcdoc="{escape(self.html)}">'
            "</iframe>"
        )
