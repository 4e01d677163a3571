"""One picture: Axes and plain text on a sheet measured in inches.

To make an Axes with its ticks costs several times as much as to draw it. So there is
one for all panels: it is moved to its place, filled, drawn and emptied again. A layout
engine would cost as much as all the drawing, so places are in inches from the upper
left corner, known before anything is drawn.
"""

from __future__ import annotations

import lagsim.outputs.bare_matplotlib  # noqa: F401

# isort: split
import functools
import math
import warnings
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, ParamSpec, TypeAlias, TypeVar

import matplotlib as mpl
import numpy as np
from matplotlib.backends.backend_agg import RendererAgg
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties
from matplotlib.lines import Line2D
from matplotlib.text import Text

from lagsim.outputs.paper import DPI, PAPERS, Pixels
from lagsim.outputs.scale import label

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from numpy.typing import NDArray

    from lagsim.outputs.paper import Paper
    from lagsim.outputs.scale import Scale

# Inches: of a sheet, its edge, from one line of small print to the next.
WIDTH, EDGE, LINE = 7.0, 0.12, 0.14

# Points, as printed.
SMALL, NORMAL, HEADING = 7.5, 8.5, 9.5

INK, DIM, FAINT = "#000000", "#555555", "#d8d8d8"

ELLIPSIS = "…"

# Of a legend: the piece of line with the space after it, and the space between names.
SAMPLE, GAP = 0.34, 0.18

# How lines and marks look, in matplotlib's words for a Line2D.
Pen: TypeAlias = dict[str, Any]
# What an axis shows, and its unit.
Named: TypeAlias = tuple[str, str]
NOTHING: Named = ("", "")
# Left, top, width, height.
Place: TypeAlias = tuple[float, float, float, float]

# M. Okabe, K. Ito (2008), "Color Universal Design": told apart by the colour blind.
# The dashes tell them apart in grey. Their yellow is left out: unreadable on white.
PENS: tuple[Pen, ...] = (
    {"color": "#0072B2"},
    {"color": "#E69F00", "dashes": (4.0, 1.4), "linewidth": 1.1},
    {"color": "#D55E00", "dashes": (1.2, 1.0)},
    {"color": "#009E73", "dashes": (6.0, 1.4, 1.2, 1.4)},
    {"color": "#CC79A7", "dashes": (9.0, 2.0)},
    {"color": "#56B4E9", "dashes": (3.0, 1.2, 1.0, 1.2, 1.0, 1.2)},
)
BLACK: Pen = {"color": INK}


def mark(marker: str, size: float, color: str = INK, fill: str = "") -> Pen:
    """Return the pen of points that no line joins."""
    edge = 0.0 if marker == "." else 0.8
    return {
        "color": color, "marker": marker, "markersize": size, "linestyle": "none",
        "markerfacecolor": fill or color, "markeredgewidth": edge,
    }  # fmt: skip


HOUSE: dict[Any, Any] = {
    "axes.axisbelow": True,
    "xtick.bottom": False, "ytick.left": False, "xtick.major.size": 0.0,
    "ytick.major.size": 0.0, "ytick.alignment": "center_baseline",
    "lines.linewidth": 0.9, "text.parse_math": False,
    "svg.hashsalt": "lagsim",
}  # fmt: skip
_KINDS = (
    "text.", "font.", "lines.", "path.", "agg.", "figure.", "patch.", "axes.", "grid.",
    "xtick.", "ytick.", "markers.", "contour.", "pcolor", "svg.", "pdf.",
)  # fmt: skip

P = ParamSpec("P")
R = TypeVar("R")


def in_house_style(draw: Callable[P, R]) -> Callable[P, R]:
    """Let a function draw as lagsim does, whatever the user's matplotlibrc says."""

    @functools.wraps(draw)
    def drawn(*args: P.args, **kwargs: P.kwargs) -> R:
        style: dict[Any, Any] = mpl.rcParamsDefault | HOUSE
        style = {k: v for k, v in style.items() if k.startswith(_KINDS)}
        with mpl.rc_context(style), warnings.catch_warnings():
            # A letter that the font lacks becomes a box; that is no fault of the run.
            warnings.simplefilter("ignore")
            return draw(*args, **kwargs)

    return drawn


@functools.cache
def _font(size: float, *, bold: bool = False) -> FontProperties:
    # matplotlib's own file, so that the same rows give the same bytes everywhere.
    name = "DejaVuSans-Bold.ttf" if bold else "DejaVuSans.ttf"
    file = Path(mpl.get_data_path(), "fonts", "ttf", name)
    return FontProperties(fname=file, size=size)


@functools.cache
def _ruler() -> RendererAgg:
    return RendererAgg(1, 1, DPI)  # type: ignore[no-untyped-call]


@functools.lru_cache(maxsize=1024)
def text_width(text: str, size: float = NORMAL, *, bold: bool = False) -> float:
    """Return the width of a text in inches."""
    measured = _ruler().get_text_width_height_descent(  # type: ignore[no-untyped-call]
        text, _font(size, bold=bold), ismath=False
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


def wrapped(notes: Sequence[str], room: float) -> list[str]:
    """Break texts in small print into lines of at most `room` inches."""
    lines = []
    for note in notes:
        lines.append("")
        for word in note.split():
            longer = f"{lines[-1]} {word}".strip()
            if lines[-1] and text_width(longer, SMALL) > room:
                lines.append(word)
            else:
                lines[-1] = longer
    return lines


@functools.cache
def _lent() -> tuple[Figure, Axes, tuple[Line2D, ...]]:
    """Return the Axes for all panels; with grid and frame, by a line for a dozen."""
    figure = Figure(dpi=DPI)
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    # The sheet is white already; the place of a title is known.
    axes.patch.set_visible(False)
    axes.spines[:].set_visible(False)
    axes.set_title("", y=1.0)
    for axis in (axes.xaxis, axes.yaxis):
        axis.offsetText.set_visible(False)
        axis.label.set(fontproperties=_font(NORMAL), va="baseline")
        # All further ticks take after the first.
        for side in ("label1", "label2"):
            getattr(axis.get_major_ticks(1)[0], side).set_fontproperties(_font(SMALL))
    grid: Pen = {"color": FAINT, "linewidth": 0.4, "zorder": 0.6}
    edge: Pen = {"color": DIM, "linewidth": 0.6, "zorder": 2.6, "clip_on": False}
    corners = ([0, 1, 1, 0, 0], [0, 0, 1, 1, 0])
    kept = (
        Line2D([], [], transform=axes.get_xaxis_transform(), **grid),
        Line2D([], [], transform=axes.get_yaxis_transform(), **grid),
        Line2D(*corners, transform=axes.transAxes, **edge),
    )
    for line in kept:
        axes.add_artist(line)
    return figure, axes, kept


def in_lines(
    entries: Sequence[tuple[str, Pen]], room: float
) -> list[list[tuple[str, Pen]]]:
    """Break the entries of a legend into lines of at most `room` inches."""
    lines: list[list[tuple[str, Pen]]] = [[]]
    left = room
    for name, pen in entries:
        wanted = SAMPLE + text_width(name, SMALL) + GAP
        if lines[-1] and wanted > left:
            lines.append([])
            left = room
        lines[-1].append((name, pen))
        left -= wanted
    return lines


class Sheet:
    """A white sheet of a given size; everything is drawn when it comes."""

    def __init__(self, width: float, height: float, form: str = "png") -> None:
        self.width, self.height = width, height
        self.paper: Paper = PAPERS[form](width, height)
        self.renderer = self.paper.renderer

    def pixels(self) -> NDArray[np.uint8]:
        """Return the picture: (height, width, 4), its last colour opaque."""
        assert isinstance(self.paper, Pixels)
        return self.paper.pixels()

    def content(self) -> bytes:
        """Return the file; nothing can be drawn after."""
        return self.paper.content()

    def _figure(self) -> Figure:
        """Give the figure that all artists are in, as the paper counts."""
        figure, *_ = _lent()
        if figure.dpi != self.paper.dpi:
            figure.set_dpi(self.paper.dpi)
        return figure

    def _draw(self, artist: Artist) -> None:
        figure = self._figure()
        artist.set_figure(figure)
        artist.set_transform(figure.dpi_scale_trans)
        artist.draw(self.renderer)

    def text(
        self,
        x: float,
        y: float,
        text: str,
        *,
        size: float = NORMAL,
        bold: bool = False,
        room: float = math.inf,
        **more: Any,
    ) -> None:
        """Write plain text, cut to `room` inches: nothing in it is ever typeset."""
        shown = fitted(text, room, size, bold=bold)
        font = _font(size, bold=bold)
        self._draw(Text(x, self.height - y, shown, fontproperties=font, **more))

    def heading(self, title: str, subject: str) -> None:
        """Write a title at the left and what is shown at the right."""
        title = fitted(title, 0.65 * self.width, HEADING, bold=True)
        self.text(EDGE, 0.22, title, size=HEADING, bold=True)
        room = self.width - 2 * EDGE - text_width(title, HEADING, bold=True) - GAP
        right = self.width - EDGE
        self.text(right, 0.22, subject, room=room, ha="right", color=DIM)

    def corner(self, place: Place, text: str, side: str) -> None:
        """Write small print into an upper corner of a panel, at the left or right."""
        left, top, width, _ = place
        x = left + 0.05 if side == "left" else left + width - 0.05
        look: Pen = {"size": SMALL, "ha": side, "color": DIM, "room": width - 0.1}
        self.text(x, top + 0.16, text, **look)

    def notes(self, top: float, lines: Sequence[str]) -> None:
        """Write lines in small print."""
        for k, line in enumerate(lines):
            self.text(EDGE, top + k * LINE, line, size=SMALL, color=DIM)

    def line(self, x: Sequence[float], y: Sequence[float], pen: Pen) -> None:
        """Draw a line beside the panels, from places in inches."""
        self._draw(Line2D(x, [self.height - level for level in y], **pen))

    def legend(
        self,
        x: float,
        y: float,
        entries: Sequence[tuple[str, Pen]],
        room: float,
        down: float = 0.0,
    ) -> None:
        """Name lines in a row of `room` inches; or `down` inches below each other."""
        names = [fitted(name, room - SAMPLE, SMALL) for name, _ in entries]
        if not down:
            wanted = [SAMPLE + text_width(name, SMALL) + GAP for name in names]
            if sum(wanted) > room:
                share = room / len(names) - SAMPLE - GAP
                names = [fitted(name, share, SMALL) for name in names]
        for name, (_, pen) in zip(names, entries, strict=True):
            dots = {None: 2, ".": 7}.get(pen.get("marker"), 1)
            dots = 3 if "markevery" in pen else dots  # a line with a mark on it
            along = np.linspace(x, x + 0.28, dots) if dots > 1 else np.array([x + 0.14])
            if pen:
                level = np.full(dots, self.height - y + 0.04)
                self._draw(Line2D(along, level, **pen))
            self.text(x + SAMPLE if pen else x, y, name, size=SMALL)
            x += 0.0 if down else SAMPLE + text_width(name, SMALL) + GAP
            y += down

    @contextmanager
    def panel(
        self,
        place: Place,
        x: Scale,
        y: Scale,
        *,
        below: Named = NOTHING,
        side: Named = NOTHING,
        above: Named = NOTHING,
        ticks: tuple[int, int] | None = None,
        reach: float = 0.46,
        spare: float = 0.1,
        over: bool = False,
        colour: str = "",
    ) -> Iterator[Axes]:
        """Give Axes at a place; they are drawn in the end, and then lent to the next.

        Parameters
        ----------
        below, side, above : name and unit of what an axis shows, written below, at the
            left (`reach` inches from the frame, and at most `spare` longer than it) and
            above. Without `below` there are no numbers there either.
        ticks : how many at most, across and up, 0 for none; else as many as fit.
        over : over the panel that was drawn last, with its own scale at the right.
        colour : of the numbers and the label of the axis that runs up.
        """
        left, top, width, height = place
        figure = self._figure()
        _, axes, kept = _lent()
        for artist in (*axes.lines, *axes.patches, *axes.collections, *axes.texts):
            if artist not in kept:
                artist.remove()
        figure.set_size_inches(self.width, self.height)
        bottom = self.height - top - height
        across, up = 1.0 / self.width, 1.0 / self.height
        axes.set_position((left * across, bottom * up, width * across, height * up))
        fit = ticks or (
            max(3, int(1.5 * width)),
            max(3, min(7, math.ceil(3.4 * height))),
        )
        places = x.put(axes, "x", fit[0], bare=not below[0], room=width)
        levels = np.repeat(places, 3)
        kept[0].set_data(levels, np.resize([0.0, 1.0, np.nan], len(levels)))
        levels = np.repeat(y.put(axes, "y", fit[1]), 3)
        kept[1].set_data(np.resize([0.0, 1.0, np.nan], len(levels)), levels)
        beside = min(0.25, left, self.width - left - width)
        axes.set_xlabel(_label(axes.xaxis, below, width + 2 * beside))
        axes.xaxis.set_label_coords(0.5, -0.31 / height)
        axes.set_ylabel(_label(axes.yaxis, side, height + spare))
        aside = reach / width
        axes.yaxis.set_label_coords(1.0 + aside if over else -aside, 0.5)
        title = _label(axes.yaxis, above, width, SMALL)
        if title != axes.get_title(loc="left"):
            look: Pen = {"fontproperties": _font(SMALL), "y": 1.0, "pad": 0.06 * 72}
            axes.set_title(title, loc="left", **look)
        yield axes
        if over:
            axes.yaxis.tick_right()
        # Labels say it; where ticks change sides it is shown again.
        axes.yaxis.offsetText.set_visible(False)
        for line in kept:
            line.set_visible(not over)
        _label_colour(axes, colour or INK)
        axes.draw(self.renderer)
        _label_colour(axes, INK)
        if over:
            axes.yaxis.tick_left()


def _label_colour(axes: Axes, colour: str) -> None:
    axes.yaxis.label.set_color(colour)
    for tick in axes.yaxis.get_major_ticks():
        tick.label1.set_color(colour)
        tick.label2.set_color(colour)


def _label(axis: Axis, named: Named, room: float, size: float = NORMAL) -> str:
    return fitted(label(axis, *named), room, size) if named[0] else ""
