"""One picture: a matplotlib Figure that is measured in inches from its upper left.

Places are known before anything is drawn: a layout engine would take as long as all the
drawing.
"""

from __future__ import annotations

import lagsim.outputs.bare_matplotlib  # noqa: F401

# isort: split
import functools
import io
import math
import warnings
from typing import TYPE_CHECKING, Any, ParamSpec, TypeAlias, TypeVar

import matplotlib as mpl
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg, RendererAgg
from matplotlib.cbook import is_math_text
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties
from matplotlib.lines import Line2D

from lagsim.outputs.letters import BELOW, END, mathtext, plain
from lagsim.outputs.scale import label

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from numpy.typing import NDArray

    from lagsim.outputs.scale import Scale

# Inches: of a sheet, its edge, from one line of small print to the next.
WIDTH, EDGE, LINE = 7.0, 0.12, 0.14
# Of pixels.
DPI = 200

# Points, as printed.
SMALL, NORMAL, HEADING = 7.5, 8.5, 9.5
# Of a line of text, the part above its base line.
ASCENT = 0.76

# matplotlib's own.
FONT = "DejaVu Sans"

INK, DIM, FAINT = "#000000", "#555555", "#d8d8d8"

ELLIPSIS = "…"

# Of a legend: the piece of line, with the space after it, and the space between names.
STROKE, SAMPLE, GAP = 0.28, 0.34, 0.18

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
    "font.family": FONT, "font.size": NORMAL, "axes.axisbelow": True,
    "grid.color": FAINT, "grid.linewidth": 0.4,
    "axes.edgecolor": DIM, "axes.linewidth": 0.6,
    "axes.titlelocation": "left", "axes.titlesize": SMALL, "axes.titley": 1.0,
    "axes.titlepad": 0.06 * 72,
    "xtick.labelsize": SMALL, "ytick.labelsize": SMALL,
    "xtick.major.size": 0.0, "ytick.major.size": 0.0,
    "ytick.alignment": "center_baseline", "lines.linewidth": 0.9,
    "legend.frameon": False, "legend.fontsize": SMALL, "legend.borderpad": 0.0,
    "legend.borderaxespad": 0.0, "legend.handlelength": STROKE * 72 / SMALL,
    "legend.handletextpad": (SAMPLE - STROKE) * 72 / SMALL,
    "legend.columnspacing": GAP * 72 / SMALL, "svg.hashsalt": "lagsim",
}  # fmt: skip
_KINDS = (
    "text.", "mathtext.", "font.", "lines.", "path.", "agg.", "figure.", "patch.",
    "axes.", "grid.", "xtick.", "ytick.", "markers.", "contour.", "pcolor", "svg.",
    "pdf.", "legend.", "savefig.",
)  # fmt: skip
# No file tells a date, a version or who made it: the same rows give the same bytes.
NOBODY = {
    "png": ("Software",),
    "svg": ("Creator", "Date", "Format", "Type"),
    "pdf": ("Creator", "Producer", "CreationDate"),
}

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


@in_house_style
def content(figure: Figure, form: str) -> bytes:
    """Give a figure as a file: png, svg or pdf; with letters as outlines in an svg."""
    file = io.BytesIO()
    how: dict[str, Any] = {"metadata": dict.fromkeys(NOBODY[form])}
    if form == "png":
        # A third faster than matplotlib's usual 6, and a tenth larger.
        how["pil_kwargs"] = {"compress_level": 3}
    figure.savefig(file, format=form, dpi=DPI, **how)
    return file.getvalue()


@functools.cache
def _ruler() -> RendererAgg:
    return RendererAgg(1, 1, DPI)  # type: ignore[no-untyped-call]


@functools.lru_cache(maxsize=1024)
def text_width(text: str, size: float = NORMAL, *, bold: bool = False) -> float:
    """Return the width of a text in inches."""
    weight = "bold" if bold else "normal"
    font = FontProperties(family=FONT, size=size, weight=weight)
    shown = mathtext(text)
    measured = _ruler().get_text_width_height_descent(  # type: ignore[no-untyped-call]
        shown, font, ismath=is_math_text(shown)
    )
    return float(measured[0]) / DPI


def fitted(text: str, room: float, size: float = NORMAL, *, bold: bool = False) -> str:
    """Return the text, its middle left out until it is at most `room` inches wide."""
    shown = "".join(c if c.isprintable() or c in (BELOW, END) else " " for c in text)
    if text_width(shown, size, bold=bold) <= room:
        return shown
    text = shown = plain(shown)
    keep = len(text)
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
    """A white sheet of a given size in inches.

    Attributes
    ----------
    figure : Figure
        What is drawn on it.
    """

    def __init__(self, width: float, height: float, form: str = "png") -> None:
        self.width, self.height, self.form = width, height, form
        self.figure = Figure(figsize=(width, height), dpi=DPI)

    @in_house_style
    def pixels(self) -> NDArray[np.uint8]:
        """Return the picture: (height, width, 4), its last colour opaque."""
        canvas = FigureCanvasAgg(self.figure)
        canvas.draw()  # type: ignore[no-untyped-call]
        return np.asarray(canvas.buffer_rgba())  # type: ignore[no-untyped-call]

    def content(self) -> bytes:
        """Return the file."""
        return content(self.figure, self.form)

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
        """Write text, cut to `room` inches; of it names of `Letters` are typeset."""
        shown = fitted(text, room, size, bold=bold)
        weight = "bold" if bold else "normal"
        at, inches = (x, self.height - y), self.figure.dpi_scale_trans
        look = {"size": size, "weight": weight, "transform": inches, **more}
        self.figure.text(*at, mathtext(shown), **look)

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
        line = Line2D(x, [self.height - level for level in y], **pen)
        line.set_transform(self.figure.dpi_scale_trans)
        self.figure.add_artist(line)

    def legend(
        self,
        x: float,
        y: float,
        entries: Sequence[tuple[str, Pen]],
        room: float,
        down: float = 0.0,
    ) -> None:
        """Name lines in a row of `room` inches; or `down` inches below each other."""
        if not entries:
            return
        names = [fitted(name, room - SAMPLE, SMALL) for name, _ in entries]
        if not down:
            wanted = [SAMPLE + text_width(name, SMALL) + GAP for name in names]
            if sum(wanted) > room:
                share = room / len(names) - SAMPLE - GAP
                names = [fitted(name, share, SMALL) for name in names]
        # Where there is no pen there is no line.
        pens = [pen or {"linestyle": "none"} for _, pen in entries]
        self.figure.legend(
            [Line2D([], [], **pen) for pen in pens], [mathtext(name) for name in names],
            loc="upper left", ncols=1 if down else len(names),
            labelspacing=max(0.0, down * 72 / SMALL - 1.0),
            bbox_to_anchor=(x, self.height - y + ASCENT * SMALL / 72),
            bbox_transform=self.figure.dpi_scale_trans,
        )  # fmt: skip

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
        over: Axes | None = None,
        colour: str = INK,
    ) -> Axes:
        """Give Axes at a place.

        Parameters
        ----------
        below, side, above : name and unit of what an axis shows, written below, at the
            left (`reach` inches from the frame, and at most `spare` longer than it) and
            above. Without `below` there are no numbers there either.
        ticks : how many at most, across and up, 0 for none; else as many as fit.
        over : the panel that this one lies over, with its own scale at the right.
        colour : of the numbers and the label of the axis that runs up.
        """
        left, top, width, height = place
        if over is None:
            inches = left, self.height - top - height, width, height
            size = self.width, self.height, self.width, self.height
            axes = self.figure.add_axes(tuple(np.divide(inches, size)))
            axes.grid(visible=True)
        else:
            axes = over.twinx()
        fit = ticks or (
            max(3, int(1.5 * width)),
            max(3, min(7, math.ceil(3.4 * height))),
        )
        if over is None:
            x.put(axes, "x", fit[0], bare=not below[0], room=width)
        y.put(axes, "y", fit[1])
        beside = min(0.25, left, self.width - left - width)
        axes.set_xlabel(_label(axes.xaxis, below, width + 2 * beside), va="baseline")
        axes.xaxis.set_label_coords(0.5, -0.31 / height)
        axes.set_ylabel(
            _label(axes.yaxis, side, height + spare), va="baseline", color=colour
        )
        aside = reach / width
        axes.yaxis.set_label_coords(1.0 + aside if over else -aside, 0.5)
        axes.set_title(_label(axes.yaxis, above, width, SMALL))
        axes.tick_params("y", labelcolor=colour)
        # Labels say it.
        for axis in (axes.xaxis, axes.yaxis):
            axis.offsetText.set_visible(False)
        return axes


def _label(axis: Axis, named: Named, room: float, size: float = NORMAL) -> str:
    return mathtext(fitted(label(axis, *named), room, size)) if named[0] else ""
