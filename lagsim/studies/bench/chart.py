"""Charts of a bench and of a map of stability, drawn from their JSON documents.

work_precision.png shows time and evaluations against the error, for at most a dozen
curves, the cheapest first. stability.png shows maps of verdicts, below these the
regions of stability with eigenvalues, and the work of methods with step control as a
parameter varies.
"""

from __future__ import annotations

import lagsim.outputs.bare_matplotlib  # noqa: F401

# isort: split
import math
from functools import partial
from itertools import groupby
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from matplotlib.colors import to_rgba

from lagsim.methods import RETIRED, names
from lagsim.methods import method as method_named
from lagsim.outputs.figure import (
    DIM,
    INK,
    LOST,
    PENS,
    SMALL,
    Entry,
    Pen,
    Picture,
    PlottedColumn,
    curve,
    encoded_figure,
    in_house_style,
    legend,
    marker_pen,
    point,
)
from lagsim.outputs.scale import Scale, log_scale, size_of
from lagsim.studies.bench import DRIFT, PREFIX, SCIPY, stamp
from lagsim.studies.bench.stability import (
    BREAKS,
    DECAYS,
    DIVERGES,
    FAILS,
    GROWS,
    HOLDS,
    VERDICTS,
)
from lagsim.studies.bench.work_precision import COSTS, Key, Row, curves
from lagsim.studies.sweep.chart import borders
from lagsim.tolerances import SAME_RESULT

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence

    from matplotlib.axes import Axes
    from matplotlib.figure import SubFigure

    from lagsim.language.arrays import Complexes, Floats
    from lagsim.run.observers.thinning import Array

    Document = Mapping[str, Any]

MOST = 12
# The largest number of scipy's solvers among these, if there are other curves.
OF_SCIPY = 2
# The largest error, relative to the range, of a point that counts in comparisons of
# cost.
AN_ANSWER = 0.1


class ChartedCurves(NamedTuple):
    """Curves to draw, and the relative costs of curves left out.

    Attributes
    ----------
    curves : dict
        (method, formulation) -> rows of work_precision.json.
    left_out : dict
        (method, formulation) -> cost relative to the Pareto front, see `_times`.
    """

    curves: dict[Key, list[Row]]
    left_out: dict[Key, float]


def curves_below(rows: Sequence[Row], worst: float) -> ChartedCurves:
    """Select curves from rows of work_precision.json with an error of at most `worst`.

    Curves are preferred in this order: settings that `auto` selects, curves on the
    front, the best formulation of each further method (at most OF_SCIPY solvers of
    scipy), other formulations, of which formulations without drift first. The result is
    sorted by cost.
    """
    found = curves(r for r in rows if r["error"] is not None and r["error"] <= worst)
    times = {key: _times(entries, rows) for key, entries in found.items()}
    ranked = sorted(times, key=lambda key: times[key])
    without_drift = sorted(ranked, key=lambda key: key[1] == DRIFT)
    best = [key for key in ranked if any(row["chosen"] for row in found[key])]
    best += [
        key for key in without_drift if any(row["front_seconds"] for row in found[key])
    ]
    known, others = {method for method, _ in best}, []
    for key in without_drift:
        if key[0] not in known:
            known.add(key[0])
            others.append(key)
    scipy = [key for key in others if key[0].startswith(PREFIX)]
    own = [key for key in others if key not in scipy]
    later = [key for key in without_drift if key not in scipy]
    order = dict.fromkeys([*best, *scipy[:OF_SCIPY], *own, *later, *scipy])
    taken = list(order)[:MOST]
    return ChartedCurves(
        {key: found[key] for key in ranked if key in taken},
        {key: times[key] for key in ranked if key not in taken},
    )


def _times(entries: Sequence[Row], rows: Sequence[Row]) -> float:
    """Return the geometric mean of a curve's costs relative to the Pareto front.

    A row is compared with the cheapest row of the front with no larger error. inf if no
    row can be compared.

    entries : the rows of the curve.
    rows : the rows of all curves.
    """
    front = [(row["error"], row["seconds"]) for row in rows if row["front_seconds"]]
    found = []
    for row in entries:
        beside = [cost for error, cost in front if error <= row["error"]]
        if beside and row["error"] <= AN_ANSWER:
            found.append(math.log(row["seconds"] / min(beside)))
    return math.exp(sum(found) / len(found)) if found else math.inf


# An error above this is no answer; one below that is 0.
WORST, LEAST = 3.0, 1e-18

CHOSEN = marker_pen("o", 8.0, fill="none")
FRONT: Pen = {"color": "#F0E442", "linewidth": 6.0}
FLOOR: Pen = {"color": "#888888", "dashes": (3.0, 2.0), "linewidth": 0.8}

# Colours and dashes identify the method; in each round of colours they are combined
# differently. The mark identifies the round (a row of marks) and the formulation (a
# column).
MARKERS = (("o", "D", "P", "<"), ("s", "^", "X", ">"), ("v", "p", "h", "*"))
SHIFT = 2
FORMULATIONS = {"elimination": 1, "baumgarte": 2, "drift": 3}
SCIPY_MARKERS = ("x", "+", "1", "2", "3")
GREY = "#777777"

ERROR = "← more accurate      error / range"
# Inches: a panel with its scales, the space below all panels, and names beside panels.
HEIGHT, REST, NAMES = 3.3, 0.3, 3.2


class CurveStyle(NamedTuple):
    """Style of a curve: its line, and the marker of its points."""

    line: Pen
    mark: Pen

    @property
    def sample(self) -> Pen:
        """The style of the entry in a legend: line and marker."""
        return self.mark | {"linestyle": "-", "markevery": [1]} | self.line


class CostCurve(NamedTuple):
    """Curve of the cost of a method against its error, with its style.

    Attributes
    ----------
    name : str
    style : CurveStyle
    errors, costs : ndarray, shape (k,)
    ringed : sequence of bool
        Points with a ring: settings that `auto` selects.
    """

    name: str
    style: CurveStyle
    errors: Array
    costs: Array
    ringed: Sequence[bool] = ()


def style_of(method: str, formulation: str = "none") -> CurveStyle:
    """Return the style of a method in a formulation, which is equal in all charts."""
    if method in SCIPY:
        line: Pen = {"color": GREY, "linewidth": 0.7}
        return CurveStyle(
            line, marker_pen(SCIPY_MARKERS[SCIPY.index(method)], 4.5, GREY)
        )
    turn, colour = divmod([*names(), *RETIRED].index(method), len(PENS))
    return curve_style(colour, turn, FORMULATIONS.get(formulation, 0))


def curve_style(colour: int, turn: int = 0, kind: int = 0) -> CurveStyle:
    """Return the style for a colour, a round of colours and a kind of formulation.

    Parameters
    ----------
    colour : int
        The index of the colour.
    turn : int
        How often all colours have been used before; selects dashes and the row of
        markers.
    kind : int
        The index of the marker in its row.
    """
    pen = PENS[(colour + SHIFT * turn) % len(PENS)] | {"color": PENS[colour]["color"]}
    return CurveStyle(pen, marker_pen(MARKERS[turn][kind], 3.6, pen["color"]))


def drawable_errors(errors: Iterable[float]) -> Array:
    """Return errors for a logarithmic axis, of which none is below LEAST."""
    return np.fromiter((max(error, LEAST) for error in errors), float)


def error_scale(costs: Sequence[CostCurve], floor: float) -> Scale:
    """Return the logarithmic scale for the errors of all curves.

    costs : the curves.
    floor : the smallest error that is resolved, which the scale includes.
    """
    known = np.concatenate(
        [*(c.errors for c in costs), drawable_errors([floor]), [0.1]]
    )
    return Scale(0.4 * float(min(known)), 2.0 * float(max(known)), log=True)


def cost_panel(
    axes: Axes,
    across: Scale,
    costs: Sequence[CostCurve],
    of: str,
    *,
    floor: float,
    front: tuple[Array, Array] | None = None,
) -> None:
    """Draw curves of cost against error; errors below `floor` are not resolved.

    across : the scale of errors.
    costs : the curves.
    of : name of the cost.
    front : errors and costs on the Pareto front, if that is drawn.
    """
    known = [c.costs for c in costs if len(c.costs)]
    across.apply(axes, "x")
    log_scale(*known, margin=0.05, least=0.08).apply(axes, "y")
    axes.set_ylabel(f"← cheaper      {of}")
    if floor > across.low:
        axes.axvspan(across.low, floor, facecolor=LOST, alpha=0.45, zorder=0.2)
        axes.axvline(floor, **FLOOR)
    if front is not None:
        curve(axes, *front, FRONT)
    for c in costs:
        curve(axes, c.errors, c.costs, c.style.line)
        point(axes, c.errors, c.costs, c.style.mark)
        ringed = np.flatnonzero(c.ringed)
        point(axes, c.errors[ringed], c.costs[ringed], CHOSEN)
    # Numbers keep away from the corner where both axes begin.
    axes.annotate(
        "↙ better", (0.0, 0.0), (-15.0, -12.0), "axes fraction", "offset points",
        size=SMALL, weight="bold", color=DIM, ha="right",
    )  # fmt: skip


@in_house_style
def work_precision(document: Document, form: str = "png") -> bytes:
    """Draw the content of work_precision.json; return a PNG, SVG or PDF."""
    return encoded_figure(figure(document), form)


@in_house_style
def figure(document: Document) -> Picture:
    """Return the figure of seconds and evaluations against the error."""
    found = curves_below(document["rows"], WORST)
    named = [
        ("Pareto front", FRONT | {"linewidth": 4.0}),
        ("choice of `auto`", CHOSEN),
        ("error of the reference", FLOOR),
    ]
    drawing = Picture(
        2 * HEIGHT + REST, document["model"]["name"], "work-precision diagram",
        legend=named, notes=_about_costs(document, found),
    )  # fmt: skip
    panels = drawing.subplots(2)
    floor = float(drawable_errors([document["reference"]["floor"]])[0])
    across = error_scale(_costs(found, COSTS[0]), floor)
    for axes, of in zip(panels, COSTS, strict=True):
        rows = [r for own in found.curves.values() for r in own if r[f"front_{of}"]]
        points = sorted((r["error"], r[of]) for r in rows)
        front = (
            drawable_errors(x for x, _ in points),
            drawable_errors(y for _, y in points),
        )
        cost_panel(axes, across, _costs(found, of), of, floor=floor, front=front)
    panels[1].set_xlabel(ERROR)
    if beside := _costs(found, COSTS[0]):
        legend(
            panels[0], [(c.name, c.style.sample) for c in beside], NAMES,
            ncols=1, loc="upper left", bbox_to_anchor=(1.02, 1.0),
            title="cheapest first", title_fontsize=SMALL, alignment="left",
            labelspacing=0.8,
        ).get_title().set_color(DIM)  # fmt: skip
    return drawing


def _costs(found: ChartedCurves, of: str) -> list[CostCurve]:
    keys = [*found.curves, *found.left_out]
    return [
        CostCurve(
            _name(key, keys), style_of(*key),
            drawable_errors(row["error"] for row in rows),
            drawable_errors(row[of] for row in rows), [row["chosen"] for row in rows],
        )
        for key, rows in found.curves.items()
    ]  # fmt: skip


def _name(key: Key, keys: Iterable[Key]) -> str:
    """Return the name of a curve: the method, with its formulation if it has several.

    key : method and formulation.
    keys : all methods with formulations in the chart.
    """
    method, formulation = key
    alone = sum(name == method for name, _ in keys) == 1
    return method if alone else f"{method} {formulation}"


def _about_costs(document: Document, found: ChartedCurves) -> list[str]:
    lines = [f"Reference: {document['reference']['trust']}."]
    rows = curves(document["rows"])
    if gaps := list(_gaps(rows, found)):
        lines.append(f"No result: {'; '.join(gaps)}.")
    if found.left_out:
        text = ", ".join(
            f"{_name(key, rows)} "
            + (f"({float(f'{times:.2g}'):g})" if times < math.inf else "(no digits)")
            for key, times in found.left_out.items()
        )
        lines.append(f"Not drawn (time relative to the fastest): {text}.")
    others = {r["method"] for r in document["refused"] if r["formulation"] == "auto"}
    if others:
        lines.append(f"Not for this model: {', '.join(sorted(others))}.")
    lines.append(
        "Error: the greatest of any coordinate or velocity in any row. Seconds: the "
        "integration with all its rows and columns (scipy's without), warm, least of "
        f"several. {stamp(document)}."
    )
    return lines


def _gaps(rows: Mapping[Key, Sequence[Row]], found: ChartedCurves) -> Iterator[str]:
    """Yield texts on settings of solvers without an answer; adjacent ones are joined.

    Curves that were left out for their cost are not considered.
    """
    for key in (x for x in rows if x not in found.left_out):
        for outcome, group in groupby(
            rows[key], lambda x: x["outcome"] if x["error"] is None else None
        ):
            if outcome is not None:
                gap = list(group)
                values = dict.fromkeys(f"{x['value']:.3g}" for x in (gap[0], gap[-1]))
                where = f"{_name(key, rows)} at {gap[0]['setting']}"
                yield f"{where} {' to '.join(values)}: {outcome}"


# Maps of stability

# Heights in inches of a strip, a map, a region, a region among few, a panel of work,
# and the space below each; then the largest numbers of maps and regions in a row.
STRIP, MAP, REGION, LARGE, WORK, BELOW = 0.27, 1.9, 1.75, 2.4, 1.0, 0.6
MAPS, REGIONS = 3, 5
STEPS = PlottedColumn("step h", "s", np.empty(0))
CHEAPER = "cheaper →"

# Okabe and Ito's hues from pale to dark, so that they differ in grey as well.
VERDICT_COLOURS = {
    HOLDS: "#DDEFF9",
    DECAYS: "#E3D22B",
    GROWS: "#E69F00",
    DIVERGES: "#D55E00",
    BREAKS: "#8A3D6E",
    FAILS: "#3C3C3C",
}
FOUND: Pen = {"color": INK, "linewidth": 1.8}
# Predicted borders: of which states, and how they are drawn.
PREDICTED: dict[str, Entry] = {
    "predicted_at_start": ("predicted: start", marker_pen("D", 4.6, fill="white")),
    "predicted_along": ("predicted: motion", marker_pen("v", 5.0, fill="#0072B2")),
}
PREDICTED_LINE: Pen = {"color": "#0072B2", "dashes": (3.0, 1.5), "linewidth": 1.4}
PREDICTED_MAP: dict[str, Entry] = {"predicted": ("predicted", PREDICTED_LINE)}
AT_START = marker_pen("o", 3.6)
ALONG = marker_pen(".", 3.0, "#D55E00")
ON_AXIS: Pen = {"color": "#0072B2", "linewidth": 2.4}

# The shown part of the plane of z, the factor by which it grows where there is room,
# and the numbers of grid points.
REAL, IMAGINARY, ROOM = (-3.6, 1.2), (0.0, 4.0), 2.0
GRID = (128, 54)
# Eigenvalues closer than this to an eigenvalue at the start are not drawn, relative to
# the height of a panel.
COVERED = 0.01


@in_house_style
def stability_figure(document: Document, form: str = "png") -> bytes:
    """Draw the content of stability.json; return a PNG, SVG or PDF."""
    vary, (fixed, adaptive) = document["vary"], document["methods"].values()
    regions = [region(document, name) for name in fixed]
    parts: list[tuple[float, Callable[[SubFigure], object]]] = []
    planes: list[Axes] = []
    if fixed:
        each = MAP * -(-len(fixed) // MAPS) if vary else STRIP * len(fixed)
        cells = partial(_maps if vary else _strips, document=document)
        high = (LARGE if len(fixed) <= MAPS else REGION) * -(-len(fixed) // REGIONS)
        below = partial(_regions, regions=regions, panels=planes)
        parts += [(each + BELOW, cells), (BELOW / 2 + high, below)]
    if adaptive:
        parts.append((3 * WORK + BELOW, partial(_work, document=document)))
    heights = [height for height, _ in parts]
    drawing = Picture(
        sum(heights), document["model"]["name"],
        "where methods hold and where they fail",
        legend=_legend(document, regions), notes=_about_maps(document, regions),
    )  # fmt: skip
    places = drawing.add_gridspec(len(heights), 1, height_ratios=heights)
    for k, (_, draw) in enumerate(parts):
        draw(drawing.add_subfigure(places[k]))
    drawing.adjust.append(partial(_round, planes))
    return encoded_figure(drawing, form)


def _round(planes: Sequence[Axes]) -> None:
    """Set the horizontal limits of complex planes so that circles look round."""
    for axes in planes:
        low, high = axes.get_ylim()
        width, height = size_of(axes)
        across = (high - low) * width / height / (REAL[1] - REAL[0])
        axes.set_xlim(REAL[0] * across, REAL[1] * across)


def _varied(document: Document) -> PlottedColumn:
    """Return the parameter that varies over a map, with its unit and values."""
    vary = document["vary"]
    return PlottedColumn(vary["name"], vary["unit"], np.array(vary["values"], float))


def borders_of(document: Document, method: str) -> list[dict[str, Any]]:
    """Return the borders of a method, one for each value of the parameter."""
    found = document["borders"].get(method, [])
    return [found] if isinstance(found, dict) else list(found)


def _legend(document: Document, regions: Sequence[Region]) -> list[Entry]:
    """Return the legend entries of the colours and markers in the chart."""
    verdicts = {cell["verdict"] for cell in document["cells"]}
    bar = {"linewidth": 8.0, "solid_capstyle": "butt"}
    shown = [
        (v, bar | {"color": VERDICT_COLOURS[v]}) for v in VERDICTS if v in verdicts
    ]
    if not regions:
        return shown
    across, _ = cell_borders(document["steps"])
    marks = {"found": ("border found", FOUND)}
    marks |= PREDICTED_MAP if document["vary"] else PREDICTED
    for key, entry in marks.items():
        borders = (b for x in regions for b in borders_of(document, x.name))
        shown += [entry] if any(_within(b[key], across) for b in borders) else []
    shown += [("h·λ: start", AT_START)] if any(len(x.at_start) for x in regions) else []
    shown += [("h·λ: motion", ALONG)] if any(len(x.along) for x in regions) else []
    return shown


def _within(step: float | None, across: Scale) -> bool:
    return step is not None and across.low < step < across.high


def _strips(part: SubFigure, document: Document) -> None:
    """Draw a strip of verdicts over steps for each method in a part of a chart."""
    across, steps = cell_borders(document["steps"])
    methods = document["methods"]["fixed"]
    panels = part.subplots(len(methods), sharex=True, squeeze=False)[:, 0]
    for axes, method in zip(panels, methods, strict=True):
        across.apply(axes, "x")
        axes.set(ylim=(-0.5, 0.5), yticks=[])
        _cells(axes, document, method, steps, np.array((-0.5, 0.5)))
        for border in borders_of(document, method):
            if border["found"] is not None:
                axes.axvline(border["found"], **FOUND, zorder=2.4)
            for key, (_, style) in PREDICTED.items():
                if _within(border[key], across):
                    point(axes, border[key], 0.0, style)
        axes.set_ylabel(method, rotation=0.0, ha="right", va="center", size=SMALL)
    STEPS.label_axis(axes.xaxis)
    axes.annotate(
        CHEAPER, (1.0, 0.0), (0.0, -22.0), "axes fraction", "offset points",
        size=SMALL, ha="right", va="top", color=DIM,
    )  # fmt: skip


def _cells(axes: Axes, document: Document, method: str, x: Floats, y: Floats) -> None:
    """Fill the cells of a map with the colours of a method's verdicts.

    x, y : borders of the cells along both axes.
    """
    cells = [cell for cell in document["cells"] if cell["method"] == method]
    # Cells are ordered by the value of the parameter; after an interrupt the last
    # values are missing.
    values = len(document["vary"]["values"]) if document["vary"] else 1
    colours = np.zeros((values, len(document["steps"]), 4))
    flat = colours.reshape(-1, 4)
    flat[: len(cells)] = [to_rgba(VERDICT_COLOURS[cell["verdict"]]) for cell in cells]
    if document["vary"]:
        colours = colours.swapaxes(0, 1)
    # Edges of their own colour close the seams that viewers of vectors leave.
    axes.pcolormesh(x, y, colours, zorder=1.0, edgecolors="face", linewidth=0.7)


def _grid(
    part: SubFigure, count: int, most: int, side: str, **alike: Any
) -> list[Axes]:
    """Return `count` new panels of a figure, in rows of equal length.

    Parameters
    ----------
    most : int
        The largest number of panels in a row; a row has room for at least two.
    side : str
        The label of the vertical axis at the left of each row.
    **alike
        Options of `subplots`.
    """
    rows = -(-count // most)
    columns = max(2, -(-count // rows))
    panels = part.subplots(rows, columns, squeeze=False, **alike)
    for axes in panels[:, 0]:
        axes.set_ylabel(side)
    for axes in panels.flat[count:]:
        axes.remove()
    return list(panels.flat[:count])


def _maps(part: SubFigure, document: Document) -> None:
    """Draw a map of verdicts over parameter and step for each method.

    part : the part of a chart.
    """
    varied = _varied(document)
    across, columns = cell_borders(varied.values.tolist())
    up, steps = cell_borders(document["steps"])
    methods = document["methods"]["fixed"]
    alike = {"sharex": True, "sharey": True}
    panels = _grid(part, len(methods), MAPS, STEPS.name + " (s)", **alike)
    for axes, method in zip(panels, methods, strict=True):
        across.apply(axes, "x")
        up.apply(axes, "y")
        _cells(axes, document, method, columns, steps)
        borders = borders_of(document, method)
        for key, pen in (("found", FOUND), ("predicted", PREDICTED_LINE)):
            levels = np.array([border[key] or np.nan for border in borders])
            levels = np.where(levels > up.low, levels, np.nan)
            curve(axes, varied.values[: len(borders)], levels, pen)
        axes.set_title(method, weight="bold")
        varied.label_axis(axes.xaxis)


class Region(NamedTuple):
    """Part of the complex plane z = h λ of a method that a panel shows.

    Attributes
    ----------
    step : float
        The step h at which eigenvalues are shown.
    meaning : str
        The origin of the step: `border`, `predicted` or `largest`.
    size : float
        The factor by which the shown part of the plane is enlarged.
    at_start, along : ndarray of complex
        Values of z at the start; and along the motion, without values near the start's.
    """

    name: str
    step: float
    meaning: str
    size: float
    at_start: Complexes
    along: Complexes


def region(document: Document, name: str) -> Region:
    """Return the part of the complex plane to show for the method `name`."""
    step, meaning = _step_shown(document, name)
    start, motion = (
        np.array([step * complex(*pair) for pair in document["eigenvalues"][key]])
        for key in ("at_start", "along")
    )
    # A bounded region fills its panel; of an unbounded one eigenvalues decide.
    size, largest = 1.0, float(np.max(np.abs(start), initial=0.0))
    if not math.isfinite(method_named(name).IMAGINARY_LIMIT):
        size = max(1.0, 1.2 * largest / IMAGINARY[1])
    (low, high), top = REAL, size * IMAGINARY[1]
    at_start, along = (
        z[
            (z.imag >= 0.0)
            & (z.imag <= top)
            & (np.clip(z.real, size * low, size * high) == z.real)
        ]
        for z in (start, motion)
    )
    covers = np.abs(along[:, None] - at_start) <= COVERED * top
    return Region(name, step, meaning, size, at_start, along[~covers.any(axis=1)])


def _regions(part: SubFigure, regions: Sequence[Region], panels: list[Axes]) -> None:
    """Draw each method's region of stability with h times the eigenvalues."""
    text = "blue: a step does not amplify; z = h · eigenvalue, Re z across, Im z up"
    part.suptitle(text, x=0.02, ha="left", size=SMALL, color=DIM)
    panels += _grid(part, len(regions), REGIONS, "Im z")
    for axes, region in zip(panels, regions, strict=True):
        method = method_named(region.name)
        across, up = (
            (region.size * low, region.size * high) for low, high in (REAL, IMAGINARY)
        )
        x = np.linspace(ROOM * across[0], ROOM * across[1], GRID[0])
        y = np.linspace(up[0], up[1], GRID[1])
        with np.errstate(all="ignore"):
            size = np.array(
                [[method.amplification(complex(a, b)) for a in x] for b in y]
            )
        size = np.nan_to_num(np.minimum(size, 10.0), nan=10.0)
        limit = 1.0 + SAME_RESULT
        axes.contourf(x, y, size, levels=[-1.0, limit], colors="#d3e8f2", zorder=0.3)
        edge: Pen = {"colors": "#5b9ec0", "linewidths": 0.7, "zorder": 0.4}
        axes.contour(x, y, size, levels=[limit], **edge)
        axes.axvline(0.0, color="#999999", linewidth=0.6)
        if method.IMAGINARY_LIMIT > 0.0:
            axes.plot([0.0, 0.0], [0.0, min(method.IMAGINARY_LIMIT, up[1])], **ON_AXIS)
        for z, pen in ((region.along, ALONG), (region.at_start, AT_START)):
            point(axes, z.real, z.imag, pen | {"zorder": 2.6})
        axes.set(xlim=across, ylim=up)
        axes.set_title(region.name, weight="bold")
        label = f"h = {region.step:.3g} s ({region.meaning})"
        axes.set_xlabel(label, size=SMALL - 1.0, color=DIM)


def _step_shown(document: Document, name: str) -> tuple[float, str]:
    """Return the step at which eigenvalues of a method are shown, and its origin.

    The step is the stability border if there is one. If a parameter varies, the border
    is interpolated at the value of the file.
    """
    borders, vary = borders_of(document, name), document["vary"]
    usual = document["parameters"][vary["name"]] if vary else 0.0
    places = [border[vary["name"]] if vary else 0.0 for border in borders]
    scale = np.log if min([usual, *places]) > 0.0 else np.array
    for key in ("found", "predicted") if borders else ():
        steps = np.log([border[key] or math.nan for border in borders])
        step = math.exp(np.interp(scale(usual), scale(places), steps))
        if step > 0.0:
            return step, "border" if key == "found" else key
    return document["steps"][-1], "largest"


def cell_borders(places: Sequence[float]) -> tuple[Scale, Floats]:
    """Return the scale of an axis of cells, and the borders of the cells (k + 1,).

    The scale is logarithmic if all values are positive, and extends half a cell past
    both ends.

    places : the values (k,) at the middles of the cells.
    """
    log = min(places) > 0.0
    edges = borders(np.array(places, float), log=log)
    return Scale(float(edges[0]), float(edges[-1]), log=log), edges


def _work(part: SubFigure, document: Document) -> None:
    """Draw the work of methods with step control against the varied parameter.

    The work is in evaluations, rejected steps, and least steps.
    """
    varied = _varied(document)
    across, _ = cell_borders(varied.values.tolist())
    entries: list[tuple[str, Callable[[Document], float | None]]] = [
        ("evaluations / s", lambda cell: _share(cell["evaluations"], cell)),
        # 0 cannot be shown on a logarithmic axis.
        ("1 + rejections", lambda c: c["evaluations"] and 1.0 + c["rejections"]),
        ("least step / run", lambda cell: _share(cell["smallest_step"], cell)),
    ]
    by_method = {
        name: [cell for cell in document["cells"] if cell["method"] == name]
        for name in document["methods"]["adaptive"]
    }
    panels = part.subplots(len(entries), sharex=True, squeeze=False)[:, 0]
    for axes, (label, of) in zip(panels, entries, strict=True):
        curves = {
            name: np.array([of(cell) or math.nan for cell in cells])
            for name, cells in by_method.items()
        }
        across.apply(axes, "x")
        log_scale(*curves.values()).apply(axes, "y")
        axes.set_ylabel(label)
        for name, values in curves.items():
            x = varied.values[: len(values)]
            curve(axes, x, values, style_of(name).line | {"label": name})
    varied.label_axis(axes.xaxis)
    part.align_ylabels()
    panels[0].legend(loc="lower left", bbox_to_anchor=(0.0, 1.02), ncols=5)


def _share(count: float | None, cell: Document) -> float | None:
    return count / cell["duration"] if count and cell["duration"] else None


def _about_maps(document: Document, regions: Sequence[Region]) -> list[str]:
    lines, runs = [], document["runs"]
    if regions:
        least = min(steps["least"] for steps in runs["steps"].values())
        most = max(steps["most"] for steps in runs["steps"].values())
        lines.append(
            f"Each cell is a run of the model's duration ({runs['duration']:.4g} s), "
            f"but of {least} steps at least and {most} at most. Start velocities are "
            f"changed by {runs['perturbation']['energy']:g} of the energy, so that "
            "every mode is excited. A run grows or decays if energy − work changes by "
            "more than 1 % of the energy of the motion."
        )
        if any(len(x.at_start) or len(x.along) for x in regions):
            lines.append(
                "λ: eigenvalues of the linearised equations, at the start and at "
                "states along the motion. A method is predicted to be stable where "
                "h·λ lies in its blue region."
            )
    missing: dict[str, list[str]] = {}
    never = dict[str, None]()
    for name in (x.name for x in regions):
        for border in borders_of(document, name):
            missing.setdefault(border["note"], []).append(name)
            if 0.0 in (border[key] for key in PREDICTED):
                never[name] = None
    missed = [f"{', '.join(x)}: {note}" for note, x in missing.items() if note]
    if missed and not document["vary"]:
        lines.append(f"No border found: {'; '.join(missed)}.")
    if never:
        lines.append(
            f"By the eigenvalues every step amplifies the motion: {', '.join(never)}."
        )
    if unknown := document["eigenvalues"]["unknown"]:
        lines.append(f"No eigenvalues: {unknown}.")
    return [*lines, f"{stamp(document)}."]
