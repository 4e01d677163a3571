"""One picture: lines, marks and plain text on a sheet measured in inches.

A figure of matplotlib's is used with its Agg canvas, without its axes: frame, grid and
ticks placed by hand cost a fraction of theirs, and every size is known before anything
is drawn. Lengths are inches from the upper left corner.
"""

from __future__ import annotations

import functools
import struct
import warnings
import zlib
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Literal, ParamSpec, TypeAlias, TypeVar

import matplotlib as mpl
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg, RendererAgg
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties
from matplotlib.lines import Line2D
from matplotlib.patches import PathPatch, Polygon
from matplotlib.text import Text
from matplotlib.transforms import Bbox, TransformedBbox

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from matplotlib.path import Path
    from numpy.typing import NDArray

    from lagsim.run.observers.thinning import Array

DPI = 200
WIDTH = 7.0

# Points, as printed.
SMALL, NORMAL, HEADING = 7.5, 8.5, 9.5

INK, DIM, FAINT = "#000000", "#555555", "#d8d8d8"

ELLIPSIS = "…"


@dataclass(frozen=True, slots=True)
class Pen:
    """How a line looks; `dash` in line widths, empty for a solid line."""

    colour: str = INK
    dash: tuple[float, ...] = ()
    width: float = 0.9
    marker: str = ""
    size: float = 4.0
    fill: str | None = None


# M. Okabe, K. Ito (2008), "Color Universal Design": told apart by the colour blind.
# The dashes tell them apart in grey. Their yellow is left out: unreadable on white.
PENS = (
    Pen("#0072B2"),
    Pen("#E69F00", (4.0, 1.4), width=1.1),
    Pen("#D55E00", (1.2, 1.0)),
    Pen("#009E73", (6.0, 1.4, 1.2, 1.4)),
    Pen("#CC79A7", (9.0, 2.0)),
    Pen("#56B4E9", (3.0, 1.2, 1.0, 1.2, 1.0, 1.2)),
)
BLACK = Pen()

Align: TypeAlias = Literal["left", "center", "right"]
Stand: TypeAlias = Literal["baseline", "center_baseline"]

P = ParamSpec("P")
R = TypeVar("R")


@contextmanager
def _defaults() -> Iterator[None]:
    """Draw by matplotlib's defaults, whatever the user's matplotlibrc says."""
    kinds = ("text.", "font.", "lines.", "path.", "agg.", "figure.", "patch.")
    style = {
        name: value
        for name, value in mpl.rcParamsDefault.items()
        if name.startswith(kinds)
    }
    with mpl.rc_context(style), warnings.catch_warnings():
        # A letter that the font lacks becomes a box; that is no fault of the run.
        warnings.simplefilter("ignore")
        yield


def in_house_style(draw: Callable[P, R]) -> Callable[P, R]:
    """Let a function draw in a style that depends on nothing but lagsim."""

    @functools.wraps(draw)
    def drawn(*args: P.args, **kwargs: P.kwargs) -> R:
        with _defaults():
            return draw(*args, **kwargs)

    return drawn


@functools.cache
def _font(*, bold: bool) -> FontProperties:
    # matplotlib's own file, so that the same rows give the same bytes everywhere.
    name = "DejaVuSans-Bold.ttf" if bold else "DejaVuSans.ttf"
    return FontProperties(fname=FilePath(mpl.get_data_path(), "fonts", "ttf", name))


@functools.cache
def _ruler() -> RendererAgg:
    return RendererAgg(1, 1, DPI)  # type: ignore[no-untyped-call]


@functools.lru_cache(maxsize=1024)
def text_width(text: str, size: float = NORMAL, *, bold: bool = False) -> float:
    """Return the width of a text in inches."""
    font = _font(bold=bold).copy()
    font.set_size(size)
    measured = _ruler().get_text_width_height_descent(  # type: ignore[no-untyped-call]
        text, font, ismath=False
    )
    return float(measured[0]) / DPI


def fitted(text: str, room: float, size: float = NORMAL, *, bold: bool = False) -> str:
    """Return the text, its middle left out until it is at most `room` inches wide."""
    text = "".join(c if c.isprintable() else " " for c in text)
    keep = len(text)
    shown = text
    while (width := text_width(shown, size, bold=bold)) > room and keep > 1:
        keep = max(1, min(keep - 1, int(keep * room / width)))
        # Names differ at the end more often than in the middle.
        head = (keep + 1) // 2
        shown = text[:head] + ELLIPSIS + text[len(text) - (keep - head) :]
    return shown


class Sheet:
    """A white sheet of a given size; artists are drawn in the order they come."""

    def __init__(self, width: float, height: float) -> None:
        self.width, self.height = width, height
        self.figure = Figure(figsize=(width, height), dpi=DPI, facecolor="white")
        self.canvas = FigureCanvasAgg(self.figure)

    def text(
        self,
        x: float,
        y: float,
        text: str,
        *,
        size: float = NORMAL,
        align: Align = "left",
        stand: Stand = "baseline",
        turned: bool = False,
        colour: str = INK,
        bold: bool = False,
    ) -> Text:
        """Write plain text: nothing in it is ever typeset."""
        artist = Text(
            x,
            self.height - y,
            text,
            fontproperties=_font(bold=bold),
            fontsize=size,
            color=colour,
            horizontalalignment=align,
            verticalalignment=stand,
            rotation=90.0 if turned else 0.0,
            rotation_mode="anchor",
            transform=self.figure.dpi_scale_trans,
            parse_math=False,
            usetex=False,
        )
        self.figure.add_artist(artist)
        return artist

    def line(
        self, x: Array, y: Array, pen: Pen, clip: Bbox | None = None, layer: float = 2.0
    ) -> Line2D:
        """Draw a polyline, or the marks of a pen that has a marker; NaN is a gap."""
        artist = Line2D(
            x,
            self.height - y,
            color=pen.colour,
            linewidth=pen.width,
            linestyle="none" if pen.marker else ((0.0, pen.dash) if pen.dash else "-"),
            marker=pen.marker or "none",
            markersize=pen.size,
            markerfacecolor=pen.fill or pen.colour,
            markeredgewidth=0.0 if pen.marker == "." else 0.8,
            solid_joinstyle="round",
            transform=self.figure.dpi_scale_trans,
            zorder=layer,
        )
        if clip is not None:
            artist.set_clip_box(TransformedBbox(clip, self.figure.dpi_scale_trans))
        self.figure.add_artist(artist)
        return artist

    def area(
        self,
        x: Array,
        low: Array,
        high: Array,
        pen: Pen,
        clip: Bbox,
        layer: float = 1.8,
    ) -> None:
        """Fill what lies between two curves, so that others show through."""
        outline = np.concatenate((low, high[::-1]))
        corners = np.stack((np.concatenate((x, x[::-1])), self.height - outline), 1)
        artist = Polygon(
            corners,
            facecolor=(pen.colour, 0.45),
            edgecolor=pen.colour,
            linewidth=0.5,
            transform=self.figure.dpi_scale_trans,
            zorder=layer,
        )
        artist.set_clip_box(TransformedBbox(clip, self.figure.dpi_scale_trans))
        self.figure.add_artist(artist)

    def boxes(self, corners: Array, colours: list[str], layer: float = 1.5) -> None:
        """Fill boxes (k, 4) of left, top, right, bottom, one colour each."""
        left, top, right, bottom = corners.T
        top, bottom = self.height - top, self.height - bottom
        across = np.stack((left, right, right, left), 1)
        outlines = np.stack((across, np.stack((top, top, bottom, bottom), 1)), 2)
        artist = PolyCollection(
            list(outlines),
            facecolors=colours,
            edgecolors="none",
            antialiaseds=False,
            transform=self.figure.dpi_scale_trans,
            zorder=layer,
        )
        self.figure.add_artist(artist)

    def shape(self, outline: Path, pen: Pen, clip: Bbox, layer: float = 1.2) -> None:
        """Fill an outline, given in inches from the lower left corner."""
        artist = PathPatch(
            outline,
            facecolor=pen.fill or "none",
            edgecolor=pen.colour,
            linewidth=pen.width,
            transform=self.figure.dpi_scale_trans,
            zorder=layer,
        )
        artist.set_clip_box(TransformedBbox(clip, self.figure.dpi_scale_trans))
        self.figure.add_artist(artist)

    @in_house_style
    def pixels(self) -> NDArray[np.uint8]:
        """Draw, and return the picture: (height, width, 4), its last colour opaque."""
        self.canvas.draw()  # type: ignore[no-untyped-call]
        return np.asarray(self.canvas.buffer_rgba())  # type: ignore[no-untyped-call]

    def png(self) -> bytes:
        """Return the picture as a PNG file."""
        return png(self.pixels())


def png(pixels: NDArray[np.uint8]) -> bytes:
    """Return a PNG file of pixels : (height, width, 3 or more); needs no matplotlib.

    No date, no version, nothing but the picture and its size on paper.
    """
    height, width, _ = pixels.shape
    # Filter 2 of the standard: each row as its difference from the one above. Pictures
    # of lines shrink by it as well as by trying all five, in a third of the time.
    filtered = np.empty((height, 1 + 3 * width), np.uint8)
    filtered[:, 0] = 2
    for k in range(3):
        colour, place = pixels[:, :, k], filtered[:, 1 + k :: 3]
        place[0] = colour[0]
        np.subtract(colour[1:], colour[:-1], out=place[1:])
    per_metre = round(DPI / 0.0254)
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        (
            _chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)),
            _chunk(b"pHYs", struct.pack(">IIB", per_metre, per_metre, 1)),
            _chunk(b"IDAT", zlib.compress(filtered.data, 2)),
            _chunk(b"IEND", b""),
        )
    )


def _chunk(kind: bytes, data: bytes) -> bytes:
    check = zlib.crc32(data, zlib.crc32(kind))
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", check)
