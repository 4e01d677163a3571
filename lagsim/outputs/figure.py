"""Picture: a matplotlib Figure with a header, panels of given sides, small print.

Lengths are inches, places those from the upper left corner. They are known before
anything is drawn: a layout engine would take as long as all the drawing.
"""

from __future__ import annotations

import lagsim.outputs.bare_matplotlib  # noqa: F401

# isort: split
import functools
import io
import math
import warnings
from typing import TYPE_CHECKING, Any, NamedTuple, ParamSpec, TypeAlias, TypeVar

import matplotlib as mpl
import numpy as np
from matplotlib.backends.backend_agg import RendererAgg
from matplotlib.cbook import is_math_text
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.lines import Line2D

from lagsim.outputs import ENERGIES
from lagsim.outputs.letters import BELOW, END, mathtext, plain
from lagsim.outputs.scale import Counting, extent, label, read_off, size_of

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from matplotlib.legend import Legend
    from numpy.typing import ArrayLike, NDArray

    from lagsim.language.arrays import Floats
    from lagsim.outputs.scale import Scale
    from lagsim.run.observers.thinning import Array

# Of pixels to the inch.
DPI = 200
# A picture, what is free at its edge, and at the sides of its panels.
WIDTH, EDGE, LEFT, RIGHT = 7.0, 0.12, 0.78, 0.18
# The base line of the title; the title, a line of a legend, one of small print.
LEVEL, TITLE, NAMES, LINE = 0.22, 0.34, 0.2, 0.14
# Below the last panel: its numbers and what they are.
BELOW_PANELS = 0.45
# How much longer than its panel a name at its side, or below it, may be.
SPARE = 0.4
# A name above a panel is written smaller before it is cut.
SIZES = 7.5, 7.0, 6.5, 6.0, 5.5

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
# A name in a legend, and the pen that it names.
Entry: TypeAlias = tuple[str, Pen]
# What an axis shows, and its unit.
Named: TypeAlias = tuple[str, str]
NOTHING: Named = ("", "")

# M. Okabe, K. Ito (2008), "Color Universal Design": distinct for the colour blind,
# and by their dashes in grey. Their yellow is left out: unreadable on white.
PENS: tuple[Pen, ...] = (
    {"color": "#0072B2"},
    {"color": "#E69F00", "dashes": (4.0, 1.4), "linewidth": 1.1},
    {"color": "#D55E00", "dashes": (1.2, 1.0)},
    {"color": "#009E73", "dashes": (6.0, 1.4, 1.2, 1.4)},
    {"color": "#CC79A7", "dashes": (9.0, 2.0)},
    {"color": "#56B4E9", "dashes": (3.0, 1.2, 1.0, 1.2, 1.0, 1.2)},
)
BLACK: Pen = {"color": INK}
# Of maps, and of many curves; of a cell without a result.
COLOURS, NO_RESULT = "viridis", "#999999"


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
    "axes.edgecolor": DIM, "axes.linewidth": 0.6, "axes.labelsize": NORMAL,
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
        del style["backend"]  # nothing is shown
        with warnings.catch_warnings():
            # A letter that the font lacks becomes a box; that is no fault of the run.
            warnings.simplefilter("ignore")
            with mpl.rc_context(style):
                return draw(*args, **kwargs)

    return drawn


@in_house_style
def content(figure: Figure, form: str = "png") -> bytes:
    """Return a figure as a file: png, svg (with letters as outlines) or pdf."""
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
def text_width(text: str, size: float = NORMAL, weight: str = "normal") -> float:
    """Return the width of a text in inches."""
    font = FontProperties(family=FONT, size=size, weight=weight)
    shown = mathtext(text)
    measured = _ruler().get_text_width_height_descent(  # type: ignore[no-untyped-call]
        shown, font, ismath=is_math_text(shown)
    )
    return float(measured[0]) / DPI


def fitted(text: str, room: float, size: float = NORMAL, weight: str = "normal") -> str:
    """Return the text, its middle left out until it is at most `room` inches wide."""
    shown = "".join(c if c.isprintable() or c in (BELOW, END) else " " for c in text)
    if text_width(shown, size, weight) <= room:
        return shown
    text = shown = plain(shown)
    keep = len(text)
    while (width := text_width(shown, size, weight)) > room and keep > 1:
        keep = max(1, min(keep - 1, int(keep * room / width)))
        # Names differ at the end more often than in the middle.
        head = (keep + 1) // 2
        shown = text[:head] + ELLIPSIS + text[len(text) - (keep - head) :]
    return shown


def wrapped(notes: Iterable[str], room: float) -> list[str]:
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


def in_lines(entries: Sequence[Entry], room: float) -> list[list[Entry]]:
    """Break the entries of a legend into lines of at most `room` inches."""
    lines: list[list[Entry]] = []
    left = 0.0
    for name, pen in entries:
        wanted = SAMPLE + text_width(name, SMALL) + GAP
        if not lines or wanted > left:
            lines.append([])
            left = room
        lines[-1].append((name, pen))
        left -= wanted
    return lines


def legend(
    of: Figure | Axes, entries: Sequence[Entry], room: float, **more: Any
) -> Legend:
    """Name lines side by side, cut to their shares of the room where it is short."""
    wanted = sum(SAMPLE + text_width(name, SMALL) + GAP for name, _ in entries)
    share = math.inf if wanted <= room else room / len(entries) - SAMPLE - GAP
    names = [mathtext(fitted(name, share, SMALL)) for name, _ in entries]
    # Where there is no pen there is no line; a broad one keeps to its place.
    pens = (pen or {"linestyle": "none"} for _, pen in entries)
    lines = [Line2D([], [], **{"solid_capstyle": "butt", **pen}) for pen in pens]
    return of.legend(lines, names, ncols=len(names), **more)


def legend_above(axes: Axes, entries: Sequence[Entry]) -> None:
    """Name the lines of a panel above it."""
    anchor: dict[str, Any] = {"loc": "lower left", "bbox_to_anchor": (0.0, 1.0)}
    legend(axes, entries, size_of(axes)[0], **anchor, borderaxespad=0.4)


class Picture(Figure):
    """A picture with a title, what it shows, a legend, and notes.

    Parameters
    ----------
    height : float
        Of what is between the header and the notes: panels, and what belongs to them.
    title, subject : str
        At the left and at the right of the first line.
    width : float
        The least one: it grows up to `WIDTH` until the first line fits.
    legend : sequence of (str, Pen)
        Below it.
    remarks, notes : sequence of str
        Small print below these, and at the end.
    layout : str, optional
        A layout engine of matplotlib's, which finds the places of panels.

    Attributes
    ----------
    width, height : float
    top : float
        Where the panels begin.
    """

    def __init__(
        self,
        height: float,
        title: str,
        subject: str = "",
        *,
        width: float = WIDTH,
        legend: Sequence[Entry] = (),
        remarks: Iterable[str] = (),
        notes: Iterable[str] = (),
        layout: Any = None,
    ) -> None:
        header = text_width(title, HEADING, "bold") + text_width(subject) + GAP
        width = max(width, min(header + 2 * EDGE, WIDTH))
        room = width - 2 * EDGE
        names = in_lines(legend, room)
        above, below = wrapped(remarks, room), wrapped(notes, room)
        self.top = TITLE + NAMES * len(names) + LINE * len(above)
        under = LINE * (len(below) + bool(below))
        high = self.top + height + under
        super().__init__(figsize=(width, high), dpi=DPI, layout=layout)
        self.width, self.height = width, high
        if isinstance(engine := self.get_layout_engine(), ConstrainedLayoutEngine):
            engine.set(rect=(0.0, under / high, 1.0, height / high), wspace=0.08)
        title = fitted(title, 0.65 * width, HEADING, "bold")
        self.write(EDGE, LEVEL, title, size=HEADING, weight="bold")
        room -= text_width(title, HEADING, "bold") + GAP
        right = width - EDGE
        self.write(right, LEVEL, subject, room=room, ha="right", color=DIM)
        self.names(EDGE, TITLE + 0.08, names, width - 2 * EDGE)
        self._small_print(self.top - LINE * len(above), above)
        self._small_print(high - under + 0.5 * LINE, below)

    def _small_print(self, top: float, lines: Sequence[str]) -> None:
        look: Pen = {"size": SMALL, "color": DIM, "room": self.width - 2 * EDGE}
        for k, text in enumerate(lines):
            self.write(EDGE, top + (k + 0.6) * LINE, text, **look)

    def write(
        self, x: float, y: float, text: str, *, room: float = math.inf, **look: Any
    ) -> None:
        """Write text, cut to `room`; of it names of `Letters` are typeset."""
        look = {"size": NORMAL, "weight": "normal", **look}
        shown = mathtext(fitted(text, room, look["size"], look["weight"]))
        self.text(x, self.height - y, shown, transform=self.dpi_scale_trans, **look)

    def names(
        self, x: float, y: float, lines: Sequence[Sequence[Entry]], room: float
    ) -> None:
        """Name curves from here on to the right and down, as `in_lines` has them."""
        for k, entries in enumerate(lines):
            place = x, self.height - y - k * NAMES + ASCENT * SMALL / 72
            legend(
                self, entries, room, loc="upper left", bbox_to_anchor=place,
                bbox_transform=self.dpi_scale_trans,
            ).set_in_layout(False)  # fmt: skip

    def panels(
        self,
        widths: Sequence[float],
        heights: Sequence[float],
        *,
        left: float = LEFT,
        top: float = 0.0,
        across: float = 0.0,
        down: float = 0.0,
    ) -> NDArray[Any]:
        """Return a grid of panels (rows, columns), so far below the header.

        Parameters
        ----------
        widths, heights
            Of the columns and the rows of the grid.
        across, down
            What is between columns, and between rows.
        """
        wide, high, top = self.width, self.height, self.top + top
        right = left + sum(widths) + across * (len(widths) - 1)
        below = top + sum(heights) + down * (len(heights) - 1)
        grid = self.add_gridspec(
            len(heights), len(widths), left=left / wide, right=right / wide,
            top=1.0 - top / high, bottom=1.0 - below / high,
            wspace=across * len(widths) / sum(widths), width_ratios=widths,
            hspace=down * len(heights) / sum(heights), height_ratios=heights,
        )  # fmt: skip
        found = grid.subplots(squeeze=False)
        for axes in found.flat:
            axes.grid(visible=True)
        return np.asarray(found)

    def _repr_png_(self) -> bytes:
        """Return what a notebook shows, without pyplot."""
        return content(self)


def frame(
    axes: Axes,
    x: Scale,
    y: Scale,
    *,
    below: Named = NOTHING,
    up: Named = NOTHING,
    above: bool | None = None,
    colour: str = INK,
) -> None:
    """Give a panel its scales, and name what they show.

    Parameters
    ----------
    below, up : name and unit of each axis; without `below` it has no numbers.
    above : the second stands above the panel, or at its side; None: where it fits.
    colour : of the axis that runs up.
    """
    x.put(axes, "x", bare=not below[0])
    y.put(axes, "y")
    width, height = size_of(axes)
    axes.set_xlabel(_named(axes.xaxis, below, width + SPARE))
    if above is None:
        above = text_width(label(axes.yaxis, *up)) > height + SPARE
    if above:
        text, room = label(axes.yaxis, *up), width + RIGHT
        fits = (size for size in SIZES if text_width(text, size) <= room)
        size = next(fits, SIZES[-1])
        axes.set_title(_named(axes.yaxis, up, room, size), fontsize=size)
    else:
        axes.set_ylabel(_named(axes.yaxis, up, height + SPARE), color=colour)
    axes.tick_params("y", labelcolor=colour)


def _named(axis: Axis, named: Named, room: float, size: float = NORMAL) -> str:
    return mathtext(fitted(label(axis, *named), room, size)) if named[0] else ""


# --- Curves: gaps and single values, bands, marks of events and of the horizon

GREY = "#444444"


class Mark(NamedTuple):
    """Name of a kind of event, and its mark at the top of a panel."""

    name: str
    top: Pen


# In the order of a legend. Filled where something holds from then on.
MARKS = {
    "impact": Mark("impact", mark("|", 5.0, "#D55E00")),
    "zeno": Mark("at rest", mark("o", 3.2, GREY)),
    "stick": Mark("stick", mark("v", 3.6, GREY)),
    "slip": Mark("slip", mark("v", 3.6, GREY, "white")),
    "contact": Mark("contact", mark("s", 3.2, GREY)),
    "release": Mark("release", mark("s", 3.2, GREY, "white")),
    "switch": Mark("switch", mark("|", 5.0, GREY)),
    "rank": Mark("loss of rank", mark("D", 2.8, GREY)),
}
OTHERS = Mark("event", mark("|", 5.0, "#888888"))
# Points from one mark to the next of its kind, beside its own width.
TICKS_APART = 2.0
# Single values more than these have no dots.
MOST_DOTS = 40
# What lies past the horizon, where a row is no longer a forecast.
LOST = "#dddddd"

# Where a line covers this part of the area that it spans, its strokes lie a twentieth
# of an inch apart: it is a band, in which neither strokes nor dashes would be seen.
BAND = 0.5
# A jump in a pixel with more values than this is hidden in its band.
CROWD = 4
# Of a band: swings no broader than so many pixels.
NARROW = 10
# Lines that cover more than the area they span leave nothing to see.
BLOT = 1.5
# Of a line that such areas are asked of, in inches.
STROKE = 0.9 / 72

# Successive directions of a curve that turn by more than a right angle so often mean
# that its points are too far apart to be joined.
TOO_COARSE, ENOUGH = 0.25, 1000


def line(axes: Axes, x: ArrayLike, y: ArrayLike, pen: Pen, **more: Any) -> None:
    """Add a line; `Axes.plot` would measure it, though the scales are known."""
    axes.add_artist(Line2D(x, y, **pen, **more))


def curve(axes: Axes, x: Array, y: Array, pen: Pen) -> None:
    """Draw y against x; a value between two gaps becomes a dot."""
    # Moved to whole pixels, a level curve between two would show its rounding.
    line(axes, x, y, pen, snap=False)
    seen = np.isfinite(x) & np.isfinite(y)
    linked = np.append(seen[:-1] & seen[1:], False)
    alone = seen & ~linked & ~np.roll(linked, 1)
    if alone.any():
        line(axes, x[alone], y[alone], mark("o", 2.5, pen["color"]), clip_on=False)


def series(axes: Axes, t: Array, values: Array, pen: Pen) -> None:
    """Draw values against time: as a curve, or as the band that it fills."""
    if not len(t) or ink(*inches(axes, t, values)) < BAND:
        curve(axes, t, values, pen)
        return
    seen = np.flatnonzero(np.isfinite(values))
    # A new piece begins at each gap, a new column at each pixel, and where the curve is
    # seen as such at a jump.
    piece = np.cumsum(np.diff(seen, prepend=seen[0]) > 1)
    pixel = np.floor(inches(axes, t[seen], values[seen])[0] * DPI)
    _, at, crowd = np.unique(pixel, return_inverse=True, return_counts=True)
    jump = (np.diff(t[seen], prepend=-np.inf) == 0.0) & (crowd[at] <= CROWD)
    jump &= np.diff(values[seen], prepend=-np.inf) != 0.0
    parts = pixel + (piece + np.cumsum(jump)) * 1e6
    columns = np.flatnonzero(np.diff(parts, prepend=-1.0))
    low = np.minimum.reduceat(values[seen], columns)
    high = np.maximum.reduceat(values[seen], columns)
    if piece[-1] == piece[0] and not jump.any():
        low, high = _envelope(low, high, values[seen])
    ends = np.flatnonzero(np.diff(piece[columns])) + 1
    t, low, high = (
        np.insert(part, ends, np.nan) for part in (t[seen][columns], low, high)
    )
    look = {"facecolor": (pen["color"], 0.45), "edgecolor": pen["color"]}
    axes.fill_between(t, low, high, **look, linewidth=0.5, zorder=1.8)


def _envelope(low: Array, high: Array, values: Array) -> tuple[Array, Array]:
    """Widen what is filled at each pixel to what a swing fills, if that is narrow.

    Else the pixels in which swings turn, and those between, would be seen as a pattern.
    """
    turns = int(np.count_nonzero(np.diff(np.sign(np.diff(values)))))
    swing = 2.0 * len(low) / max(turns, 1)
    if swing > NARROW:
        return low, high
    half = math.ceil(1.5 * swing)
    beside = np.lib.stride_tricks.sliding_window_view
    low, high = (np.pad(part, half, mode="edge") for part in (low, high))
    width = 2 * half + 1
    return beside(low, width).min(axis=1), beside(high, width).max(axis=1)


def path(axes: Axes, x: Array, y: Array, pen: Pen, trusted: int) -> None:
    """Draw y against x, by dots or lines; pale after the first `trusted` values."""
    if trusted < len(x):
        path(
            axes, x[max(trusted - 1, 0) :], y[max(trusted - 1, 0) :], _pale(pen), len(x)
        )
    if "marker" in pen:
        line(axes, x[:trusted], y[:trusted], pen | {"markersize": 1.2})
    else:
        curve(axes, x[:trusted], y[:trusted], pen)


def _pale(pen: Pen) -> Pen:
    return {k: LOST if k in ("color", "markerfacecolor") else v for k, v in pen.items()}


def point(axes: Axes, x: ArrayLike, y: ArrayLike, pen: Pen) -> None:
    """Draw a mark, or some, above the curves, whole at the edge too."""
    x, y = np.atleast_1d(x, y)
    if len(x):  # without any it had no place, and no layout were found
        line(axes, x, y, {"zorder": 2.5, **pen}, clip_on=False)


def shade(axes: Axes, horizon: float) -> None:
    """Shade what lies past a time."""
    low, high = axes.get_xlim()
    if horizon < high:
        look: Pen = {"facecolor": (LOST, 0.45), "edgecolor": LOST, "linewidth": 0.5}
        axes.axvspan(max(horizon, low), high, **look, zorder=0.2)


def marks(axes: Axes, times: Sequence[float], look: Mark) -> None:
    """Mark times by short ticks at the top; no two of them so near that they touch."""
    low, high = axes.get_xlim()
    inside = np.sort([t for t in times if low <= t <= high])
    across = axes.get_xaxis_transform()
    at = across.transform(np.column_stack((inside, np.zeros_like(inside))))[:, 0]
    size = float(look.top["markersize"])
    apart = TICKS_APART if look.top["marker"] == "|" else size + TICKS_APART
    shown = inside[_spaced(at / axes.figure.dpi, apart / 72)]
    level = np.full_like(shown, 1.0 - size / 144 / size_of(axes)[1])
    line(axes, shown, level, look.top, transform=across, zorder=1.6, clip_on=False)


def _spaced(places: Array, apart: float) -> list[int]:
    """Return which of ascending places stay, the first of those nearer than `apart`."""
    kept = []
    k = 0
    while k < len(places):
        kept.append(k)
        k = max(k + 1, int(np.searchsorted(places, places[k] + apart)))
    return kept


def stems(axes: Axes, t: Array, values: Array, pen: Pen) -> None:
    """Draw what is 0 but at single times: a line up to each value, where few a dot."""
    line(axes, axes.get_xlim(), (0.0, 0.0), pen)
    there = np.isfinite(values) & (values != 0.0)
    t, values = t[there], values[there]
    none = np.full_like(t, np.nan)
    x = np.stack((t, t, none), axis=1).ravel()
    y = np.stack((np.zeros_like(t), values, none), axis=1).ravel()
    line(axes, x, y, pen)
    if len(t) <= MOST_DOTS:
        line(axes, t, values, mark("o", 2.0, pen["color"]), clip_on=False)


def inches(axes: Axes, x: Array, y: Array) -> tuple[Array, Array]:
    """Return where values lie on the sheet."""
    pixels = axes.transData.transform(np.column_stack((x, y))).T
    across, up = pixels / axes.figure.dpi
    return across, up


def ink(x: Array, y: Array) -> float:
    """Return which part of the area that it spans a line covers, if not over itself."""
    length = float(np.nansum(np.hypot(np.diff(x), np.diff(y))))
    # A line along an axis spans no area, but has a width.
    sides = [max(high - low, 0.1) for low, high in (extent(x), extent(y))]
    return length * STROKE / math.prod(sides)


def dotted(x: Array, y: Array) -> bool:
    """Whether a path, given in inches, is better shown by its points than by lines.

    It is when lines would only fill an area, and when the points are too far apart, so
    that chords would be seen and not the curve.
    """
    if min(high - low for low, high in (extent(x), extent(y))) < STROKE:
        return False  # along an axis every chord is the curve
    dx, dy = np.diff(x), np.diff(y)
    turns = dx[1:] * dx[:-1] + dy[1:] * dy[:-1] < 0
    coarse = len(turns) >= ENOUGH and float(np.mean(turns)) > TOO_COARSE
    return coarse or ink(x, y) > BLOT


# --- Columns

# Inches: of a panel of columns, of one that shows a path, of a spectrum, of a map; and
# between them.
PANEL, PATH, SPECTRUM, MAP = 1.65, 4.2, 3.2, 2.2
APART = 0.26
# Of the largest amplitude, what a spectrum still shows.
SHOWN = 1e-5


class Column(NamedTuple):
    """A column, what it is called, whether its scale is logarithmic: values (rows,)."""

    name: str
    unit: str
    values: Floats
    log: bool = False

    def stand_at(self, axis: Axis, room: float = math.inf) -> None:
        """Name an axis, in so many inches, with what its numbers count in."""
        if axis.get_scale() == "linear":
            axis.set_major_formatter(Counting())
            axis.get_offset_text().set_visible(False)
        axis.set_label_text(_named(axis, (self.name, self.unit), room))


def stacked(found: Picture, count: int, height: float, top: float = 0.0) -> list[Axes]:
    """Return so many panels above each other, on one scale that runs across."""
    width, top = found.width - LEFT - RIGHT, top + APART
    panels = found.panels([width], [height] * count, top=top, down=APART)[:, 0]
    for axes in panels[:-1]:
        axes.sharex(panels[-1])
        axes.tick_params(labelbottom=False)
    return list(panels)


def stack_height(count: int, height: float) -> float:
    """Return what so many panels above each other take."""
    return count * (APART + height) + BELOW_PANELS


@in_house_style
def figure(title: str, against: Column, columns: Sequence[Column]) -> Picture:
    """Draw columns against another, those of one unit in one panel.

    What has the unit of `against` is drawn at equal scales.
    """
    groups = list(_grouped(columns))
    equal = bool(against.unit) and {c.unit for c in columns} == {against.unit}
    height = PATH if equal else PANEL
    found = Picture(stack_height(len(groups), height), title)
    panels = stacked(found, len(groups), height)
    for axes, group in zip(panels, groups, strict=True):
        _draw(axes, against, group)
        if equal:
            axes.set_aspect("equal", adjustable="datalim")
    against.stand_at(panels[-1].xaxis)
    found.align_ylabels()
    return found


@in_house_style
def crossed(title: str, x: Column, y: Column) -> Picture:
    """Draw points: the states of a section."""
    found = Picture(stack_height(1, PATH), title, f"{len(x.values)} crossings")
    (axes,) = stacked(found, 1, PATH)
    axes.plot(x.values, y.values, **mark(".", 3.0, PENS[0]["color"]))
    axes.margins(0.05)
    if x.unit and x.unit == y.unit:
        axes.set_aspect("equal", adjustable="datalim")
    x.stand_at(axes.xaxis)
    y.stand_at(axes.yaxis, PATH)
    return found


@in_house_style
def spectrum_figure(
    title: str, across: Column, up: Column, peaks: Sequence[tuple[float, float]]
) -> Picture:
    """Draw amplitudes against frequencies, with the places of peaks, and their list."""
    subject = f"spectrum of {up.name.removeprefix('amplitude of ')}"
    found = Picture(stack_height(1, SPECTRUM), title, subject)
    [axes] = stacked(found, 1, SPECTRUM)
    _draw(axes, across, [up._replace(log=True)])
    across.stand_at(axes.xaxis)
    largest = float(up.values.max(initial=0.0))
    if largest:
        axes.set_ylim(SHOWN * largest, 5 * largest)
        seen = across.values[up.values >= SHOWN * largest]
        axes.set_xlim(0.0, 1.05 * float(seen[-1]))
    unit = f" {up.unit}" if up.unit else ""
    white = {"facecolor": "white", "edgecolor": "none"}
    for number, place in enumerate(peaks, 1):
        axes.plot(*place, **mark("o", 3.0))
        axes.annotate(
            str(number), place, (3.0, 3.0), textcoords="offset points", size=SMALL,
            bbox=white | {"pad": 0.3, "alpha": 0.8},
        )  # fmt: skip
    lines = [
        f"{number}:  {frequency:.4g} {across.unit},  {read_off(amplitude, 3)}{unit}"
        for number, (frequency, amplitude) in enumerate(peaks, 1)
    ]
    axes.text(
        0.99, 0.98, mathtext("\n".join(lines)), transform=axes.transAxes, size=SMALL,
        ha="right", va="top", multialignment="left", bbox=white,
    )  # fmt: skip
    return found


@in_house_style
def map_figure(
    title: str,
    across: Column,
    up: Column,
    maps: Sequence[Column],
    *,
    subject: str = "",
    abreast: int = 1,
    **header: Any,
) -> Picture:
    """Draw maps, values (rows, columns), over two others: borders of their cells.

    So many beside each other; of what is nan the ground is seen. `header` are what else
    a `Picture` is made of.
    """
    rows = -(-len(maps) // abreast)
    found = Picture(stack_height(rows, MAP), title, subject, **header)
    # Each with its bar of colours, and the numbers at it.
    width = (WIDTH - LEFT + EDGE) / abreast - LEFT
    panels = found.panels(
        [width] * abreast, [MAP] * rows, top=APART, across=LEFT, down=APART
    )
    for k, (axes, column) in enumerate(zip(panels.flat, maps, strict=False)):
        axes.set_facecolor(NO_RESULT)
        axes.grid(visible=False)
        axes.set_xscale("log" if across.log else "linear")
        axes.set_yscale("log" if up.log else "linear")
        cells = np.ma.masked_invalid(column.values)
        drawn = axes.pcolormesh(across.values, up.values, cells, cmap=COLOURS)
        bar = found.colorbar(drawn, ax=axes, aspect=15, pad=0.03)
        column.stand_at(bar.ax.yaxis, MAP + SPARE)
        is_last = k + abreast >= len(maps)
        axes.tick_params(length=2.0, labelbottom=is_last, labelleft=k % abreast == 0)
        if k % abreast == 0:
            up.stand_at(axes.yaxis, MAP + SPARE)
        if is_last:
            across.stand_at(axes.xaxis, width)
    for axes in panels.flat[len(maps) :]:
        axes.remove()
    return found


def _grouped(columns: Sequence[Column]) -> Iterable[list[Column]]:
    groups: dict[str, list[Column]] = {}
    for column in columns:
        # Of what has no known unit each has a scale of its own.
        own = "energies" if column.name in ENERGIES else column.name
        groups.setdefault(column.unit or f"of {own}", []).append(column)
    for group in groups.values():
        for start in range(0, len(group), len(PENS)):
            yield group[start : start + len(PENS)]


def _draw(axes: Axes, against: Column, group: Sequence[Column]) -> None:
    for column, pen in zip(group, PENS, strict=False):
        axes.plot(against.values, column.values, label=mathtext(column.name), **pen)
    axes.yaxis.get_offset_text().set_fontsize(SMALL)
    axes.margins(x=0.0 if against.name == "t" else 0.03)
    # Before the labels, which have the powers of ten of linear scales.
    if against.log:
        axes.set_xscale("log")
    if group[0].log:
        axes.set_yscale("log", nonpositive="mask")
        axes.minorticks_off()
    if len(group) == 1:
        group[0].stand_at(axes.yaxis, PATH)
    else:
        axes.set_ylabel(mathtext(group[0].unit))
        axes.legend(
            loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=len(group),
            borderaxespad=0.4,
        )  # fmt: skip
