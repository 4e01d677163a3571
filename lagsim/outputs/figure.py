"""Picture: a matplotlib Figure with title, legend and notes; curves, marks and maps.

matplotlib's constrained layout places the panels, once for all formats. A `Pen` is a
set of options of matplotlib: colour, line and marker of a curve.
"""

from __future__ import annotations

import lagsim.outputs.bare_matplotlib  # noqa: F401

# isort: split
import functools
import io
import math
import textwrap
import warnings
from typing import TYPE_CHECKING, Any, NamedTuple, ParamSpec, TypeAlias, TypeVar

import matplotlib as mpl
import numpy as np
from matplotlib.backend_bases import get_registered_canvas_class
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.transforms import ScaledTranslation

from lagsim.outputs import ENERGIES
from lagsim.outputs.letters import cut_text, mathtext
from lagsim.outputs.scale import (
    OF_LABELS,
    SPARE,
    finite_range,
    greatest,
    is_level,
    name_axis,
    read_off,
    size_of,
    value_scale,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from matplotlib.figure import SubFigure
    from matplotlib.legend import Legend
    from numpy.typing import ArrayLike

    from lagsim.language.arrays import Floats
    from lagsim.outputs.scale import Scale
    from lagsim.run.observers.thinning import Array

# Pixels per inch.
DPI = 200
# Inches: width of a picture; height of a line of its title or legend, of a line of its
# notes, of the numbers below the last panel, and of the space above each panel.
WIDTH, LINE, NOTE, BELOW_PANELS, APART = 7.0, 0.2, 0.14, 0.45, 0.26
# Letters per inch: of the title, and of small print.
OF_TITLE, OF_SMALL_PRINT = 10, 14
# Letters that fit into the room of the line before a name of a legend.
BESIDE = 6

# Points, as printed.
SMALL, NORMAL, HEADING = 7.5, 8.5, 9.5

# matplotlib's own.
FONT = "DejaVu Sans"

INK, DIM, FAINT = "#000000", "#555555", "#d8d8d8"

# Style of lines and marks: keywords of matplotlib's Line2D.
Pen: TypeAlias = dict[str, Any]
# A name in a legend, and its pen.
Entry: TypeAlias = tuple[str, Pen]
# Name of the quantity on an axis, and its unit.
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
# Colours of maps and of many curves; colour of a cell without a result.
COLOURS, NO_RESULT = "viridis", "#999999"


def marker_pen(marker: str, size: float, color: str = INK, fill: str = "") -> Pen:
    """Return the pen of points without a line.

    Parameters
    ----------
    marker : str
        matplotlib's name of the marker.
    size : float
        In points.
    color, fill : str
        Colours of edge and inside; by default they are equal.
    """
    edge = 0.0 if marker == "." else 0.8
    return {
        "color": color, "marker": marker, "markersize": size, "linestyle": "none",
        "markerfacecolor": fill or color, "markeredgewidth": edge,
    }  # fmt: skip


HOUSE: dict[Any, Any] = {
    "font.family": FONT, "font.size": NORMAL, "axes.axisbelow": True,
    "axes.grid": True, "grid.color": FAINT, "grid.linewidth": 0.4,
    "axes.edgecolor": DIM, "axes.linewidth": 0.6, "axes.labelsize": NORMAL,
    "axes.titlelocation": "left", "axes.titlesize": SMALL, "axes.titlepad": 4.0,
    "axes.formatter.limits": (-3, 5),
    "xtick.labelsize": SMALL, "ytick.labelsize": SMALL,
    "xtick.major.size": 0.0, "ytick.major.size": 0.0,
    "xtick.minor.size": 0.0, "ytick.minor.size": 0.0,
    "ytick.alignment": "center_baseline", "lines.linewidth": 0.9,
    "legend.frameon": False, "legend.fontsize": SMALL, "legend.borderpad": 0.0,
    "legend.borderaxespad": 0.4, "legend.handlelength": 2.7,
    "legend.handletextpad": 0.6, "legend.columnspacing": 1.7,
    "figure.constrained_layout.h_pad": 0.06, "figure.constrained_layout.w_pad": 0.08,
    "svg.hashsalt": "lagsim",
}  # fmt: skip
# Files contain no date, version or author: equal rows give equal bytes.
NOBODY = {
    "png": ("Software",),
    "svg": ("Creator", "Date", "Format", "Type"),
    "pdf": ("Creator", "Producer", "CreationDate"),
}

P = ParamSpec("P")
R = TypeVar("R")


def in_house_style(draw: Callable[P, R]) -> Callable[P, R]:
    """Decorate a function so that it draws in lagsim's style, not in the user's."""

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
def encoded_figure(figure: Figure, form: str = "png") -> bytes:
    """Return the bytes of a figure as png, svg (with letters as outlines) or pdf."""
    if isinstance(figure, Picture):
        figure.settle()
    file = io.BytesIO()
    how: dict[str, Any] = {"metadata": dict.fromkeys(NOBODY[form])}
    if form == "png":
        # A third faster than matplotlib's usual 6, and a tenth larger.
        how["pil_kwargs"] = {"compress_level": 3}
    # `savefig` would draw everything twice, to find the positions.
    canvas = get_registered_canvas_class(form)(figure)
    getattr(canvas, f"print_{form}")(file, **how)
    return file.getvalue()


def legend(
    of: Figure | SubFigure | Axes, entries: Sequence[Entry], width: float, **more: Any
) -> Legend:
    """Add a legend of `entries`, names with pens, and return it.

    By default it has as many columns as fit into `width` inches.

    of : the figure, or the part of it, to which the legend is added.
    """
    names, columns = in_columns(entries, width)
    # An entry without a pen has no line; a broad pen keeps its width.
    pens = (pen or {"linestyle": "none"} for _, pen in entries)
    lines = [Line2D([], [], **{"solid_capstyle": "butt", **pen}) for pen in pens]
    more.setdefault("ncols", columns)
    return of.legend(lines, list(map(mathtext, names)), **more)


def in_columns(entries: Sequence[Entry], width: float) -> tuple[list[str], int]:
    """Return the names of a legend, cut to fit, and its number of columns.

    entries : names with pens.
    width : the width of the legend in inches, to which each name is cut.
    """
    most = int(OF_SMALL_PRINT * width)
    names = [cut_text(name, most - BESIDE) for name, _ in entries]
    longest = max(map(len, names), default=0)
    return names, max(1, min(most // (longest + BESIDE), len(names)))


def legend_above(axes: Axes, entries: Sequence[Entry], **more: Any) -> None:
    """Add a legend of `entries`, names with pens, above a panel."""
    more |= {"loc": "lower left", "bbox_to_anchor": (0.0, 1.0)}
    legend(axes, entries, size_of(axes)[0], **more)


class Picture(Figure):
    """A picture with a title, a legend below it, and notes at the bottom.

    Parameters
    ----------
    height : float
        Height of the panels with their labels, in inches.
    title, subject : str
        Written as `title: subject`.
    width : float
        Width of the picture, in inches.
    legend : sequence of (str, Pen)
    notes : iterable of str

    Attributes
    ----------
    adjust : list of callable
        Functions that choose scales by the sizes of panels. `settle` calls each twice,
        before and after the layout, since sizes depend on the numbers at axes.
    """

    def __init__(
        self,
        height: float,
        title: str,
        subject: str = "",
        *,
        width: float = WIDTH,
        legend: Sequence[Entry] = (),
        notes: Iterable[str] = (),
    ) -> None:
        self.adjust: list[Callable[[], None]] = []
        self._drawing: list[Callable[[], None]] = []
        text = ": ".join(filter(None, (title, subject)))
        lines = textwrap.wrap(text, int(OF_TITLE * width), break_on_hyphens=False)
        below = "\n".join(notes)
        counted = -(-len(below) // int(OF_SMALL_PRINT * width)) + below.count("\n")
        super().__init__(layout="constrained", dpi=DPI)
        named = header(self, legend, width, title=mathtext("\n".join(lines)))
        high = height + LINE * (len(lines) + named) + NOTE * counted
        self.set_size_inches(width, high)
        if below:
            style: Pen = {"size": SMALL, "color": DIM, "ha": "left", "wrap": True}
            self.supxlabel(mathtext(below), x=0.012, **style)

    def settle(self) -> None:
        """Run the layout once, draw the deferred parts, and fix panel positions."""
        engine = self.get_layout_engine()
        if engine is None or not self.axes:
            return
        for adjust in self.adjust:
            adjust()
        engine.execute(self)
        for adjust in self.adjust:
            adjust()
        for draw in self._drawing:
            draw()
        self.adjust, self._drawing = [], []
        self.set_layout_engine("none")

    def when_placed(self, draw: Callable[..., None], *args: Any) -> None:
        """Call `draw(*args)` after the layout, once the sizes of panels are known."""
        self._drawing.append(functools.partial(draw, *args))

    def _repr_png_(self) -> bytes:
        """Return the PNG for a notebook, without pyplot."""
        return encoded_figure(self)


def header(
    of: Figure | SubFigure, entries: Sequence[Entry], width: float, title: str = ""
) -> int:
    """Add a title and a legend above all panels; return the legend's number of lines.

    of : the figure, or the part of it, to which both are added.
    entries : names with pens.
    width : in inches.
    """
    if title or entries:
        legend(
            of, entries, width, loc="outside upper left", title=title or None,
            alignment="left", title_fontproperties={"size": HEADING, "weight": "bold"},
            borderaxespad=1.0,
        )  # fmt: skip
    return -(-len(entries) // in_columns(entries, width)[1])


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
    """Set scales and labels of a panel.

    Parameters
    ----------
    axes : Axes
    x, y : Scale
    below, up : (str, str)
        Name and unit of each axis; without `below` the x axis has no numbers.
    above : bool or None
        Whether the label of the y axis is above the panel, or at its side; None: where
        it fits.
    colour : str
        Colour of the y axis.
    """
    x.apply(axes, "x")
    y.apply(axes, "y")
    # a fifth of the time of a layout, without effect
    for spine in axes.spines.values():
        spine.set_in_layout(False)
    if below[0]:
        name_axis(axes.xaxis, *below)
    else:
        axes.tick_params(labelbottom=False)
    if above is None:
        above = len(up[0]) + len(up[1]) > OF_LABELS * (size_of(axes)[1] + SPARE)
    name_axis(axes.yaxis, *up, axes.set_title("") if above else None)
    axes.yaxis.label.set_color(colour)
    axes.tick_params("y", labelcolor=colour)


# --- Curves: gaps and single values, bands, marks of events and of the horizon

GREY = "#444444"


class Mark(NamedTuple):
    """Name of a kind of event, and the pen of its mark at the top of a panel."""

    name: str
    top: Pen


# In the order of a legend. A filled mark: a constraint is in force from this time on.
MARKS = {
    "impact": Mark("impact", marker_pen("|", 5.0, "#D55E00")),
    "corner": Mark("corner", marker_pen("|", 5.0, "#0072B2")),
    "zeno": Mark("at rest", marker_pen("o", 3.2, GREY)),
    "stick": Mark("stick", marker_pen("v", 3.6, GREY)),
    "slip": Mark("slip", marker_pen("v", 3.6, GREY, "white")),
    "contact": Mark("contact", marker_pen("s", 3.2, GREY)),
    "release": Mark("release", marker_pen("s", 3.2, GREY, "white")),
    "switch": Mark("switch", marker_pen("|", 5.0, GREY)),
    "rank": Mark("loss of rank", marker_pen("D", 2.8, GREY)),
}
OTHERS = Mark("event", marker_pen("|", 5.0, "#888888"))
# Least distance in points between ticks of one kind, so that thousands do not fill a
# band; and between other marks, beside their own width.
TICKS_APART, MARKS_APART = 5.0, 2.0
# Largest number of single values that are drawn with dots.
MOST_DOTS = 40
# Colour past the horizon, where a row is no longer a forecast.
LOST = "#dddddd"

# Where a line covers this part of the area that it spans, its strokes lie a twentieth
# of an inch apart: it is a band, in which neither strokes nor dashes would be seen.
BAND = 0.5
# A jump in a pixel with more values than this is hidden in its band.
CROWD = 4
# Widest swing in pixels that is drawn as a band.
NARROW = 10
# Ratio of covered to spanned area above which lines hide each other.
BLOT = 1.5
# Opacity of areas around curves.
BAND_OPACITY = 0.25
# Width of a line for such areas, in inches.
STROKE = 0.9 / 72

# Successive directions of a curve that turn by more than a right angle so often mean
# that its points are too far apart to be joined.
TOO_COARSE, ENOUGH = 0.25, 1000


def line(axes: Axes, x: ArrayLike, y: ArrayLike, pen: Pen, **more: Any) -> None:
    """Add a line without updating data limits, unlike `Axes.plot`.

    The scales of the panel are already known.
    """
    axes.add_artist(Line2D(x, y, **pen, **more))


def curve(axes: Axes, x: Array, y: Array, pen: Pen) -> None:
    """Draw y against x as a line with gaps at nan; a value between gaps is a dot."""
    # Moved to whole pixels, a level curve between two would show its rounding.
    line(axes, x, y, pen, snap=False)
    seen = np.isfinite(x) & np.isfinite(y)
    linked = np.append(seen[:-1] & seen[1:], False)
    alone = seen & ~linked & ~np.roll(linked, 1)
    if alone.any():
        line(
            axes, x[alone], y[alone], marker_pen("o", 2.5, pen["color"]), clip_on=False
        )


def series(axes: Axes, t: Array, values: Array, pen: Pen) -> None:
    """Draw values against time: as a curve, or as a band if they oscillate fast."""
    if not len(t) or ink(*inches(axes, t, values)) < BAND:
        curve(axes, t, values, pen)
        return
    seen = np.flatnonzero(np.isfinite(values))
    # A new piece begins at each gap, a new column at each pixel, and at each visible
    # jump of the curve.
    piece = np.cumsum(np.diff(seen, prepend=seen[0]) > 1)
    pixel = np.floor(inches(axes, t[seen], values[seen])[0] * DPI)
    _, at, counts = np.unique(pixel, return_inverse=True, return_counts=True)
    jump = (np.diff(t[seen], prepend=-np.inf) == 0.0) & (counts[at] <= CROWD)
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
    style = {"facecolor": (pen["color"], 0.45), "edgecolor": pen["color"]}
    axes.fill_between(t, low, high, **style, linewidth=0.5, zorder=1.8)


def draw_band(axes: Axes, t: Array, low: Array, high: Array, pen: Pen) -> None:
    """Draw the area between the curves low(t) and high(t), behind other curves."""
    axes.fill_between(
        t, low, high, facecolor=(pen["color"], BAND_OPACITY), linewidth=0.0, zorder=1.7
    )


def _envelope(low: Array, high: Array, values: Array) -> tuple[Array, Array]:
    """Return the lower and upper curve (k,) of the band of a fast oscillation.

    Both are the envelope of the extremes in each pixel: pixels with and without turning
    points would alternate visibly.

    low, high : (k,), the extremes in each pixel.
    values : (n,), the oscillation.
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
    """Draw y against x, as dots if the pen has a marker, else as a line.

    trusted : number of values before the horizon; the others are pale.
    """
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
    """Draw one or several marks at (x, y) above the curves, unclipped at the edge."""
    x, y = np.atleast_1d(x, y)
    if len(x):  # an empty curve has no position, and no layout would be found
        line(axes, x, y, {"zorder": 2.5, **pen}, clip_on=False)


def shade(axes: Axes, horizon: float) -> None:
    """Shade the part of a panel against time that lies past the time `horizon`."""
    low, high = axes.get_xlim()
    if horizon < high:
        style: Pen = {"facecolor": (LOST, 0.45), "edgecolor": LOST, "linewidth": 0.5}
        axes.axvspan(max(horizon, low), high, **style, zorder=0.2)


def marks(axes: Axes, times: Sequence[float], mark: Mark) -> None:
    """Mark times by short ticks at the top of a panel; omit ticks that would touch."""
    low, high = axes.get_xlim()
    inside = np.sort([t for t in times if low <= t <= high])
    across = axes.get_xaxis_transform()
    at = across.transform(np.column_stack((inside, np.zeros_like(inside))))[:, 0]
    size = float(mark.top["markersize"])
    distance = TICKS_APART if mark.top["marker"] == "|" else size + MARKS_APART
    shown = inside[_spaced(at / axes.figure.dpi, distance / 72)]
    inch = axes.figure.dpi_scale_trans
    at_top = across + ScaledTranslation(0.0, -size / 144, inch)
    level = np.ones_like(shown)
    line(axes, shown, level, mark.top, transform=at_top, zorder=1.6, clip_on=False)


def _spaced(places: Array, distance: float) -> list[int]:
    """Return the indices of marks to keep, at least `distance` from each other.

    places : (n,), ascending positions of the marks, of which the first is kept.
    """
    kept = []
    k = 0
    while k < len(places):
        kept.append(k)
        k = max(k + 1, int(np.searchsorted(places, places[k] + distance)))
    return kept


def stems(axes: Axes, t: Array, values: Array, pen: Pen) -> None:
    """Draw a column that is 0 except at single times: a line up to each value.

    Few values (at most `MOST_DOTS`) have a dot each.
    """
    line(axes, axes.get_xlim(), (0.0, 0.0), pen)
    there = np.isfinite(values) & (values != 0.0)
    t, values = t[there], values[there]
    none = np.full_like(t, np.nan)
    x = np.stack((t, t, none), axis=1).ravel()
    y = np.stack((np.zeros_like(t), values, none), axis=1).ravel()
    line(axes, x, y, pen)
    if len(t) <= MOST_DOTS:
        line(axes, t, values, marker_pen("o", 2.0, pen["color"]), clip_on=False)


def inches(axes: Axes, x: Array, y: Array) -> tuple[Array, Array]:
    """Return the coordinates of points (x, y) on the sheet, in inches."""
    pixels = axes.transData.transform(np.column_stack((x, y))).T
    across, up = pixels / axes.figure.dpi
    return across, up


def ink(x: Array, y: Array) -> float:
    """Return the area of a drawn line as a fraction of its bounding box.

    Parts that overlap count repeatedly, so that it can exceed 1.

    x, y : ndarray, shape (n,), in inches.
    """
    length = float(np.nansum(np.hypot(np.diff(x), np.diff(y))))
    # A line along an axis spans no area, but has a width.
    sides = [max(high - low, 0.1) for low, high in (finite_range(x), finite_range(y))]
    return length * STROKE / math.prod(sides)


def is_dotted(x: Array, y: Array) -> bool:
    """Whether a path (x, y), in inches, is better drawn by points than by lines.

    True where lines would only fill an area, and where points are so far apart that
    chords would be seen instead of the curve.
    """
    if min(high - low for low, high in (finite_range(x), finite_range(y))) < STROKE:
        return False  # along an axis every chord coincides with the curve
    dx, dy = np.diff(x), np.diff(y)
    turns = dx[1:] * dx[:-1] + dy[1:] * dy[:-1] < 0
    coarse = len(turns) >= ENOUGH and float(np.mean(turns)) > TOO_COARSE
    return coarse or ink(x, y) > BLOT


# --- Columns

# Heights in inches: of a panel of columns, of a path, of a spectrum, of a map.
PANEL, PATH, SPECTRUM, MAP = 1.65, 4.2, 3.2, 2.2
# Least amplitude that a spectrum shows, relative to the largest.
SHOWN = 1e-5


class PlottedColumn(NamedTuple):
    """Column of a picture.

    Attributes
    ----------
    name, unit : str
        Both typeset.
    values : ndarray, shape (rows,)
    log : bool
        Whether the axis is logarithmic.
    """

    name: str
    unit: str
    values: Floats
    log: bool = False

    def label_axis(self, axis: Axis) -> None:
        """Label an axis with the name and the unit of the column."""
        name_axis(axis, self.name, self.unit)


def stack_height(count: int, height: float) -> float:
    """Return the height in inches of `count` panels above each other."""
    return count * (APART + height) + BELOW_PANELS


@in_house_style
def figure(
    title: str, against: PlottedColumn, columns: Sequence[PlottedColumn]
) -> Picture:
    """Return a picture of columns against another column, one panel for each unit.

    If all columns have the unit of `against`, both axes have equal scales.
    """
    groups = list(_grouped(columns))
    equal = bool(against.unit) and {c.unit for c in columns} == {against.unit}
    height = PATH if equal else PANEL
    found = Picture(stack_height(len(groups), height), title)
    panels = found.subplots(len(groups), squeeze=False, sharex=True)[:, 0]
    for axes, group in zip(panels, groups, strict=True):
        _draw(axes, against, group)
        if equal:
            axes.set_aspect("equal", adjustable="datalim")
    against.label_axis(panels[-1].xaxis)
    found.align_ylabels()
    return found


@in_house_style
def crossed(title: str, x: PlottedColumn, y: PlottedColumn, kind: str) -> Picture:
    """Draw the states of a section as points in the plane of two columns.

    kind : words after the number of states.
    """
    found = Picture(stack_height(1, PATH), title, f"{len(x.values)} {kind}")
    axes = found.subplots()
    axes.plot(x.values, y.values, **marker_pen(".", 3.0, PENS[0]["color"]))
    axes.margins(0.05)
    if x.unit and x.unit == y.unit:
        axes.set_aspect("equal", adjustable="datalim")
    x.label_axis(axes.xaxis)
    y.label_axis(axes.yaxis)
    return found


@in_house_style
def spectrum_figure(
    title: str,
    across: PlottedColumn,
    up: PlottedColumn,
    peaks: Sequence[tuple[float, float]],
) -> Picture:
    """Draw amplitudes against frequencies, with marks at the peaks and their list.

    Parameters
    ----------
    title : str
    across, up : PlottedColumn
        Frequencies and amplitudes.
    peaks : sequence of (float, float)
        Frequency and amplitude of each peak.
    """
    subject = f"spectrum of {up.name.removeprefix('amplitude of ')}"
    found = Picture(stack_height(1, SPECTRUM), title, subject)
    axes = found.subplots()
    _draw(axes, across, [up._replace(log=True)])
    across.label_axis(axes.xaxis)
    largest = float(up.values.max(initial=0.0))
    if largest:
        axes.set_ylim(SHOWN * largest, 5 * largest)
        seen = across.values[up.values >= SHOWN * largest]
        axes.set_xlim(0.0, 1.05 * float(seen[-1]))
    unit = f" {up.unit}" if up.unit else ""
    white = {"facecolor": "white", "edgecolor": "none"}
    for number, place in enumerate(peaks, 1):
        axes.plot(*place, **marker_pen("o", 3.0))
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
    across: PlottedColumn,
    up: PlottedColumn,
    maps: Sequence[PlottedColumn],
    *,
    subject: str = "",
    abreast: int = 1,
    **header: Any,
) -> Picture:
    """Draw maps: values (rows, columns) as colours over the plane of two other columns.

    Parameters
    ----------
    title, subject : str
    across, up : PlottedColumn
        Borders of the cells.
    maps : sequence of PlottedColumn
        Values of the cells; cells with nan are grey, and values that differ by rounding
        have one colour.
    abreast : int
        Number of maps side by side.
    **header
        Further arguments of `Picture`.
    """
    sizes: dict[str, float] = {}
    for column in maps:
        largest = greatest(column.values) if column.unit else 0.0
        sizes[column.unit] = max(sizes.get(column.unit, 0.0), largest)
    rows = -(-len(maps) // abreast)
    found = Picture(stack_height(rows, MAP), title, subject, **header)
    panels = found.subplots(
        rows, abreast, squeeze=False, sharex=True, sharey=True,
        subplot_kw={"facecolor": NO_RESULT},
    )  # fmt: skip
    for k, (axes, column) in enumerate(zip(panels.flat, maps, strict=False)):
        axes.grid(visible=False)
        axes.set_xscale("log" if across.log else "linear")
        axes.set_yscale("log" if up.log else "linear")
        cells = np.ma.masked_invalid(column.values)
        scale = value_scale(column.values, margin=0.0, size=sizes[column.unit])
        if is_level(column.values):
            cells[~cells.mask] = 0.5 * (scale.low + scale.high)
        drawn = axes.pcolormesh(
            across.values, up.values, cells, cmap=COLOURS,
            vmin=scale.low, vmax=scale.high,
        )  # fmt: skip
        bar = found.colorbar(drawn, ax=axes, aspect=15, pad=0.03)
        column.label_axis(bar.ax.yaxis)
        axes.tick_params(length=2.0, labelbottom=k + abreast >= len(maps))
        if k % abreast == 0:
            up.label_axis(axes.yaxis)
        if k + abreast >= len(maps):
            across.label_axis(axes.xaxis)
    for axes in panels.flat[len(maps) :]:
        axes.remove()
    return found


def _grouped(columns: Sequence[PlottedColumn]) -> Iterable[list[PlottedColumn]]:
    groups: dict[str, list[PlottedColumn]] = {}
    for column in columns:
        # Each column without a known unit has a scale of its own.
        own = "energies" if column.name in ENERGIES else column.name
        groups.setdefault(column.unit or f"of {own}", []).append(column)
    for group in groups.values():
        for start in range(0, len(group), len(PENS)):
            yield group[start : start + len(PENS)]


def _draw(axes: Axes, against: PlottedColumn, group: Sequence[PlottedColumn]) -> None:
    for column, pen in zip(group, PENS, strict=False):
        axes.plot(against.values, column.values, label=mathtext(column.name), **pen)
    axes.margins(x=0.0 if against.name == "t" else 0.03)
    values = [column.values for column in group]
    if is_level(*values) and not group[0].log:
        value_scale(*values).apply(axes, "y")
    # Before the labels, since they contain the powers of ten of linear scales.
    if against.log:
        axes.set_xscale("log")
    if group[0].log:
        axes.set_yscale("log", nonpositive="mask")
        axes.minorticks_off()
    if len(group) == 1:
        group[0].label_axis(axes.yaxis)
    else:
        name_axis(axes.yaxis, "", group[0].unit)
        legend_above(axes, [(c.name, pen) for c, pen in zip(group, PENS, strict=False)])
