"""stability.png: maps of verdicts, below them regions of stability with eigenvalues.

And the work of methods that choose their steps, as a parameter varies.
"""

from __future__ import annotations

import lagsim.outputs.bare_matplotlib  # noqa: F401

# isort: split
import math
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.colors import to_rgba

from lagsim.methods import method as method_named
from lagsim.outputs.curves import curve, point
from lagsim.outputs.figure import Column, Picture, headed
from lagsim.outputs.manifest import versions
from lagsim.outputs.scale import Scale, log_scale
from lagsim.outputs.sheet import (
    DIM,
    DPI,
    EDGE,
    INK,
    SMALL,
    WIDTH,
    Pen,
    content,
    in_house_style,
    mark,
)
from lagsim.studies.bench.chart import look_of
from lagsim.studies.bench.stability import prediction
from lagsim.studies.bench.trial import (
    BREAKS,
    DECAYS,
    DIVERGES,
    FAILS,
    GROWS,
    HOLDS,
    KICK,
    VERDICTS,
)
from lagsim.studies.experiment import stamp
from lagsim.version import __version__

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from matplotlib.axes import Axes
    from matplotlib.figure import SubFigure

    from lagsim.studies.bench.stability import Stability
    from lagsim.studies.bench.trial import Cell

# Inches: a strip, a map, a region, one of few, a panel of work; what is below them. And
# so many of them in a row.
STRIP, MAP, REGION, LARGE, WORK, BELOW = 0.27, 1.9, 1.75, 2.4, 1.0, 0.6
MAPS, REGIONS = 3, 5
# So often places are looked for: numbers and names take room that depends on them.
LAYOUTS = 2
STEPS = Column("step h", "s", np.empty(0))
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
# By the attribute of a border: of which states, and how it is drawn.
PREDICTED: dict[str, tuple[str, Pen]] = {
    "at_start": ("start", mark("D", 4.6, fill="white")),
    "along": ("motion", mark("v", 5.0, fill="#0072B2")),
}
PREDICTED_LINE: Pen = {"color": "#0072B2", "dashes": (3.0, 1.5), "linewidth": 1.4}
AT_START = mark("o", 3.6)
ALONG = mark(".", 3.0, "#D55E00")
ON_AXIS: Pen = {"color": "#0072B2", "linewidth": 2.4}

# The part of the plane of z that is shown, more of it where there is room, and how
# finely it is looked at.
REAL, IMAGINARY, ROOM = (-3.6, 1.2), (0.0, 4.0), 2.0
GRID = (128, 54)
# Of a panel's height: eigenvalues so near those of the start are covered by them.
COVERED = 0.01
# An amplification of 1 that rounding has touched is one.
TOUCHED = 1e-6


@in_house_style
def chart(title: str, found: Stability, varied: str | None, form: str = "png") -> bytes:
    """Draw what was found as a parameter, or none, varied; as PNG, SVG or PDF."""
    over, count = _named(found, varied), len(found.methods)
    heights: list[float] = []
    regions: list[Axes] = []
    if count:
        each = STRIP * count if varied is None else MAP * -(-count // MAPS)
        region = LARGE if count <= MAPS else REGION
        heights = [each + BELOW, BELOW / 2 + region * -(-count // REGIONS)]
    heights += [3 * WORK + BELOW] if found.adaptive else []
    size = WIDTH, sum(heights)
    drawing = Picture(figsize=size, dpi=DPI, layout="constrained")
    places = drawing.add_gridspec(len(heights), 1, height_ratios=heights)
    parts = [drawing.add_subfigure(places[k]) for k in range(len(heights))]
    if count:
        if varied is None:
            _strips(parts[0], found)
        else:
            _maps(parts[0], found, over)
        regions = _regions(parts[1], found)
    if found.adaptive:
        _work(parts[-1], found, over)
    legend = _legend(found, varied=varied is not None)
    subject = "where methods hold and where they fail"
    headed(drawing, title, subject, legend, _notes(found, varied))
    engine = drawing.get_layout_engine()
    assert engine is not None
    for _ in range(LAYOUTS):
        engine.execute(drawing)
        for axes in regions:
            _equal(axes)
    drawing.set_layout_engine("none")
    return content(drawing, form)


def _named(found: Stability, varied: str | None) -> Column:
    """Give what varies, and its unit."""
    units = {p.name: p.unit for p in found.subject.equations.model.parameters}
    values = np.array([x for x in found.values if x is not None], float)
    return Column(varied or "", units.get(varied or "", ""), values)


def _legend(found: Stability, *, varied: bool) -> list[tuple[str, Pen]]:
    """Name colours and marks."""
    seen = {cell.verdict for cell in found.cells}
    bar = {"linewidth": 8.0, "solid_capstyle": "butt"}
    bars = [(v, bar | {"color": VERDICT_COLOURS[v]}) for v in VERDICTS if v in seen]
    at_start, along = eigenvalues_shown(found)
    shown: list[tuple[str, Pen, bool]] = [
        ("border found", FOUND, any(b.found is not None for b in found.borders)),
        ("predicted", PREDICTED_LINE, varied and any(map(prediction, found.borders))),
    ]
    across = spread(found.steps)[0] if found.methods else Scale(0.0, 0.0)
    for key, (where, pen) in PREDICTED.items():
        there = any(_within(getattr(b, key), across) for b in found.borders)
        shown.append((f"predicted: {where}", pen, there and not varied))
    shown += [("h·λ: start", AT_START, at_start), ("h·λ: motion", ALONG, along)]
    return [*bars, *((name, pen) for name, pen, there in shown if there)]


def _within(step: float | None, across: Scale) -> bool:
    return step is not None and across.low < step < across.high


def _strips(part: SubFigure, found: Stability) -> None:
    """Draw a strip of verdicts over steps for each method."""
    across, steps = spread(found.steps)
    borders = {border.method: border for border in found.borders}
    panels = part.subplots(len(found.methods), sharex=True, squeeze=False)[:, 0]
    for axes, method in zip(panels, found.methods, strict=True):
        across.put(axes, "x", 9)
        Scale(-0.5, 0.5).put(axes, "y", 0)
        _cells(axes, found, method, steps, np.array((-0.5, 0.5)))
        if border := borders.get(method):
            if border.found is not None:
                axes.axvline(border.found, **FOUND, zorder=2.4)
            for key, (_, look) in PREDICTED.items():
                if _within(getattr(border, key), across):
                    point(axes, getattr(border, key), 0.0, look)
        axes.set_ylabel(method, rotation=0.0, ha="right", va="center", size=SMALL)
    axes.set_xlabel(STEPS.label)
    axes.annotate(
        CHEAPER, (1.0, 0.0), (0.0, -22.0), "axes fraction", "offset points",
        size=SMALL, ha="right", va="top", color=DIM,
    )  # fmt: skip


def _cells(
    axes: Axes, found: Stability, method: str, x: np.ndarray, y: np.ndarray
) -> None:
    """Fill the cells between borders in x and y with the colours of verdicts."""
    steps = {step: k for k, step in enumerate(found.steps)}
    columns = {value: k for k, value in enumerate(found.values)}
    colours = np.zeros((len(steps), len(columns), 4))
    for cell in found.of(method):
        assert cell.step is not None
        colour = to_rgba(VERDICT_COLOURS[cell.verdict])
        colours[steps[cell.step], columns[cell.value]] = colour
    if len(columns) != len(x) - 1:
        colours = colours.swapaxes(0, 1)
    # Edges of their own colour close the seams that viewers of vectors leave.
    axes.pcolormesh(x, y, colours, zorder=1.0, edgecolors="face", linewidth=0.7)


def _grid(part: SubFigure, count: int, most: int, *, alike: bool) -> list[Axes]:
    """Give so many panels, in rows of at most so many and at least two."""
    rows = -(-count // most)
    columns = max(2, -(-count // rows))
    panels = part.subplots(rows, columns, sharex=alike, sharey=alike, squeeze=False)
    for axes in panels.flat[count:]:
        axes.remove()
    return list(panels.flat[:count])


def _maps(part: SubFigure, found: Stability, varied: Column) -> None:
    """Draw a map over the parameter and the step for each method."""
    across, columns = spread(varied.values.tolist())
    up, steps = spread(found.steps)
    panels = _grid(part, len(found.methods), MAPS, alike=True)
    for axes, method in zip(panels, found.methods, strict=True):
        across.put(axes, "x", 4)
        up.put(axes, "y", 6)
        _cells(axes, found, method, columns, steps)
        borders = [b for b in found.borders if b.method == method]
        x = np.array([b.value for b in borders], float)
        for pen, y in (
            (FOUND, [b.found for b in borders]),
            (PREDICTED_LINE, [prediction(b) for b in borders]),
        ):
            levels = np.array([step or np.nan for step in y])
            curve(axes, x, np.where(levels > up.low, levels, np.nan), pen)
        axes.set_title(method, weight="bold")
        axes.set_xlabel(varied.within(WIDTH / MAPS))
    for axes in panels[:: min(MAPS, max(2, len(panels)))]:
        axes.set_ylabel(STEPS.label)


def _inside(found: Stability, name: str, values: np.ndarray) -> np.ndarray:
    """Give h times the eigenvalues that lie in the panel of a method."""
    (step, _), size = _step_shown(found, name), _size(found, name)
    z = step * values[values.imag >= -1e-12 * np.abs(values)]
    z = z[(z.real >= size * REAL[0]) & (z.real <= size * REAL[1])]
    return np.asarray(z[z.imag <= size * IMAGINARY[1]])


def _size(found: Stability, name: str) -> float:
    """Give how much of the plane a panel shows.

    A bounded region fills its panel; of an unbounded one the eigenvalues decide.
    """
    if math.isfinite(method_named(name).IMAGINARY_LIMIT):
        return 1.0
    largest = float(np.max(np.abs(found.subject.at_start), initial=0.0))
    return max(1.0, 1.2 * _step_shown(found, name)[0] * largest / IMAGINARY[1])


def eigenvalues_shown(found: Stability) -> tuple[bool, bool]:
    """Tell whether a panel shows any of the start, and any along the motion.

    Those of the motion are hidden where they are those of the start.
    """
    start = motion = False
    for name in found.methods:
        first = _inside(found, name, found.subject.at_start)
        along = _inside(found, name, found.subject.along)
        start |= len(first) > 0
        near = COVERED * _size(found, name) * IMAGINARY[1]
        motion |= any(np.min(abs(first - z), initial=np.inf) > near for z in along)
    return start, motion


def _regions(part: SubFigure, found: Stability) -> list[Axes]:
    """Draw each method's region of stability with h times the eigenvalues."""
    text = "blue: a step does not amplify; z = h · eigenvalue, Re z across, Im z up"
    part.suptitle(text, x=EDGE / WIDTH, ha="left", size=SMALL, color=DIM)
    panels = _grid(part, len(found.methods), REGIONS, alike=False)
    for axes, name in zip(panels, found.methods, strict=True):
        method, size = method_named(name), _size(found, name)
        across, up = (Scale(size * low, size * high) for low, high in (REAL, IMAGINARY))
        _region(axes, method.amplification, across, up)
        axes.grid(visible=True)
        axes.axvline(0.0, color="#999999", linewidth=0.6)
        if method.IMAGINARY_LIMIT > 0.0:
            axes.plot([0.0, 0.0], [0.0, min(method.IMAGINARY_LIMIT, up.high)],
                      **ON_AXIS)  # fmt: skip
        for values, pen in (
            (found.subject.along, ALONG),
            (found.subject.at_start, AT_START),
        ):
            if len(z := _inside(found, name, values)):
                axes.plot(z.real, z.imag, **pen, zorder=2.6, clip_on=False)
        axes.set_xlim(across.low, across.high)
        axes.set_ylim(up.low, up.high)
        axes.set_title(name, weight="bold")
        step, what = _step_shown(found, name)
        label = f"h = {step:.3g} s ({what})"
        axes.set_xlabel(label, size=SMALL - 1.0, color=DIM)
    panels[0].set_ylabel("Im z")
    return panels


def _equal(axes: Axes) -> None:
    """Make a panel that has its place as long across as up."""
    low, high = axes.get_ylim()
    width, height = axes.get_window_extent().size
    across = (high - low) * width / height / (REAL[1] - REAL[0])
    axes.set_xlim(REAL[0] * across, REAL[1] * across)


def _region(
    axes: Axes, amplification: Callable[[complex], float], across: Scale, up: Scale
) -> None:
    x = np.linspace(ROOM * across.low, ROOM * across.high, GRID[0])
    y = np.linspace(up.low, up.high, GRID[1])
    with np.errstate(all="ignore"):
        size = np.array([[amplification(complex(a, b)) for a in x] for b in y])
    size = np.nan_to_num(np.minimum(size, 10.0), nan=10.0)
    limit = 1.0 + TOUCHED
    axes.contourf(x, y, size, levels=[-1.0, limit], colors="#d3e8f2", zorder=0.3)
    axes.contour(
        x, y, size, levels=[limit], colors="#5b9ec0", linewidths=0.7, zorder=0.4
    )


def _step_shown(found: Stability, name: str) -> tuple[float, str]:
    """Give the step at which eigenvalues are shown: at the border, where there is one.

    Of the parameter's values the one next to the file's counts.
    """
    borders = [b for b in found.borders if b.method == name]
    if found.usual is not None:
        usual = found.usual
        borders.sort(key=lambda b: abs((b.value or 0.0) - usual))
    for border in borders[:1]:
        if border.found is not None:
            return border.found, "border found"
        predicted = prediction(border)
        if predicted:
            return predicted, "border predicted"
    return found.steps[-1], "largest tried"


def spread(places: Sequence[float]) -> tuple[Scale, np.ndarray]:
    """Give the scale that cells fill, and their borders: half a cell past the last.

    Their places are evenly spaced, or their logarithms are where all are above 0.
    """
    log = min(places) > 0.0
    known = np.log10(places) if log else np.asarray(places, float)
    half = 0.5 * (known[-1] - known[0]) / max(1, len(known) - 1) or 0.05
    borders = np.linspace(known[0] - half, known[-1] + half, len(known) + 1)
    if log:
        borders = 10.0**borders
    return Scale(float(borders[0]), float(borders[-1]), log=log), borders


def _work(part: SubFigure, found: Stability, varied: Column) -> None:
    """Draw what methods that choose their steps do as the parameter varies."""
    across, _ = spread(varied.values.tolist())
    asked: list[tuple[str, Callable[[Cell], float | None]]] = [
        ("evaluations / s", lambda cell: _share(cell.evaluations, cell)),
        ("1 + rejections", lambda cell: _plus_one(cell.rejections)),
        ("least step / run", lambda cell: _share(cell.smallest_step, cell)),
    ]
    panels = part.subplots(len(asked), sharex=True, squeeze=False)[:, 0]
    for axes, (label, of) in zip(panels, asked, strict=True):
        curves = {
            name: np.array([of(cell) or math.nan for cell in found.of(name)])
            for name in found.adaptive
        }
        across.put(axes, "x", 9)
        log_scale(*curves.values()).put(axes, "y", 5)
        axes.grid(visible=True)
        axes.set_ylabel(label)
        for name, values in curves.items():
            x = np.array([cell.value for cell in found.of(name)], float)
            curve(axes, x, values, look_of(name).line | {"label": name})
    axes.set_xlabel(varied.within(WIDTH))
    part.align_ylabels()
    panels[0].legend(loc="lower left", bbox_to_anchor=(0.0, 1.02), ncols=5)


def _share(count: float | None, cell: Cell) -> float | None:
    return count / cell.duration if count and cell.duration else None


def _plus_one(count: int | None) -> float | None:
    """Give a count as it is drawn on logarithms, which have no 0."""
    return None if count is None else 1.0 + count


def _notes(found: Stability, varied: str | None) -> list[str]:
    subject = found.subject
    lines = []
    if found.methods:
        least = min(a for a, _ in found.runs.values())
        most = max(b for _, b in found.runs.values())
        lines.append(
            f"Each cell is one run, as long as the model's ({subject.span:.4g} s), but "
            f"of at least {least} and at most {most} steps. The start velocities are "
            f"changed by {KICK:g} of the energy, so that every mode is excited. A run "
            "grows or decays if energy − work changes by more than 1 % of the energy "
            "of the motion."
        )
        if any(eigenvalues_shown(found)):
            lines.append(
                "λ: eigenvalues of the linearised equations, at the start and at "
                "states along the motion. A method is predicted to be stable where "
                "h·λ lies in its blue region."
            )
    missing: dict[str, list[str]] = {}
    for border in found.borders:
        if border.note:
            missing.setdefault(border.note, []).append(border.method)
    if varied is None and missing:
        said = "; ".join(f"{', '.join(x)}: {note}" for note, x in missing.items())
        lines.append(f"No border found: {said}.")
    never = dict.fromkeys(
        b.method for b in found.borders if 0.0 in (b.at_start, b.along)
    )
    if never:
        lines.append(
            f"By the eigenvalues the motion grows at every step: {', '.join(never)}."
        )
    if subject.unknown:
        lines.append(f"No eigenvalues: {subject.unknown}.")
    versions_of = {"lagsim": __version__, "versions": versions()}
    lines.append(f"{stamp(versions_of)}.")
    return lines
