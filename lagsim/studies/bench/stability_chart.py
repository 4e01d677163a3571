"""stability.png: maps of verdicts, below them regions of stability with eigenvalues.

And the work of methods that choose their steps, as a parameter varies.
"""

from __future__ import annotations

import lagsim.outputs.bare_matplotlib  # noqa: F401

# isort: split
import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from matplotlib.colors import to_rgba
from matplotlib.ticker import NullFormatter

from lagsim.methods import method as method_named
from lagsim.outputs.curves import curve, point
from lagsim.outputs.manifest import versions
from lagsim.outputs.scale import Scale, log_scale
from lagsim.outputs.sheet import (
    DIM,
    EDGE,
    INK,
    LINE,
    NOTHING,
    SMALL,
    Named,
    Pen,
    Sheet,
    in_house_style,
    mark,
    wrapped,
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

    from lagsim.outputs.sheet import Place
    from lagsim.studies.bench.stability import Stability
    from lagsim.studies.bench.trial import Cell

WIDTH, RIGHT = 7.6, 0.2
# Beside scales that are numbers.
NUMBERS = 0.8

AT_START = mark("o", 3.6)
ALONG = mark(".", 3.0, "#D55E00")
ON_AXIS: Pen = {"color": "#0072B2", "linewidth": 2.4}

# The part of the plane of z that is shown, and how finely it is looked at.
REAL, IMAGINARY = (-3.6, 1.2), (0.0, 4.0)
GRID = (64, 54)
REGION_HEIGHT, REGION_GAP, REGION_ACROSS, REGIONS = 1.2, 0.55, 0.3, 5
# Left of the first one, and the greatest height of one, where there are few.
REGION_LEFT, TALLEST = 0.5, 1.8
HEADROOM = 0.34
# Of a panel's height: eigenvalues so near those of the start are covered by them.
COVERED = 0.01
# An amplification of 1 that rounding has touched is one.
TOUCHED = 1e-6

WORK_HEIGHT, WORK_GAP = 0.9, 0.18


class _Panel(NamedTuple):
    """A region's panel: its place beside the others, its scales, and the step."""

    method: str
    place: Place
    scales: tuple[Scale, Scale]
    step: float
    what: str


def _size(count: int) -> tuple[int, float, float]:
    """Give how many panels stand in a row, and their width and height."""
    rows = -(-count // REGIONS)
    columns = max(2, -(-count // rows))
    room = WIDTH - REGION_LEFT - EDGE
    width = (room - (columns - 1) * REGION_ACROSS) / columns
    usual = (room - (REGIONS - 1) * REGION_ACROSS) / REGIONS
    return columns, width, min(TALLEST, REGION_HEIGHT * width / usual)


def _panels(found: Stability, top: float) -> list[_Panel]:
    columns, width, height = _size(len(found.methods))
    # As long across as up, whatever room there is.
    wider = width / height * (IMAGINARY[1] - IMAGINARY[0]) / (REAL[1] - REAL[0])
    panels = []
    for k, name in enumerate(found.methods):
        row, column = divmod(k, columns)
        x = REGION_LEFT + column * (width + REGION_ACROSS)
        y = top + HEADROOM + row * (height + REGION_GAP)
        step, what = _step_shown(found, name)
        # A bounded region fills its panel; of an unbounded one the eigenvalues decide.
        reach = step * float(np.max(np.abs(found.subject.at_start), initial=0.0))
        endless = math.isinf(method_named(name).IMAGINARY_LIMIT)
        size = max(1.0, 1.2 * reach / IMAGINARY[1]) if endless else 1.0
        across = Scale(size * wider * REAL[0], size * wider * REAL[1])
        up = Scale(size * IMAGINARY[0], size * IMAGINARY[1])
        place = (x, y, width, height)
        panels.append(_Panel(name, place, (across, up), step, what))
    return panels


def _inside(panel: _Panel, values: np.ndarray) -> np.ndarray:
    """Give h times the eigenvalues that lie in a panel."""
    across, up = panel.scales
    z = panel.step * values[values.imag >= -1e-12 * np.abs(values)]
    z = z[(z.real >= across.low) & (z.real <= across.high)]
    return np.asarray(z[z.imag <= up.high])


def eigenvalues_shown(found: Stability) -> tuple[bool, bool]:
    """Tell whether a panel shows any of the start, and any along the motion.

    Those of the motion are hidden where they are those of the start.
    """
    start = motion = False
    for panel in _panels(found, 0.0) if found.methods else []:
        first = _inside(panel, found.subject.at_start)
        along = _inside(panel, found.subject.along)
        start |= len(first) > 0
        near = COVERED * panel.scales[1].high
        motion |= any(np.min(abs(first - z), initial=np.inf) > near for z in along)
    return start, motion


def regions_height(found: Stability) -> float:
    """Give the height that `regions` takes."""
    if not found.methods:
        return 0.0
    columns, _, height = _size(len(found.methods))
    rows = -(-len(found.methods) // columns)
    return HEADROOM + rows * (height + REGION_GAP)


def regions(sheet: Sheet, top: float, found: Stability) -> None:
    """Draw each method's region of stability with h times the eigenvalues."""
    text = "blue: a step does not amplify; z = h · eigenvalue, Re z across, Im z up"
    sheet.text(EDGE, top + 0.06, text, size=SMALL, color=DIM)
    for panel in _panels(found, top):
        x, y, width, height = panel.place
        across, up = panel.scales
        method, first = method_named(panel.method), x == REGION_LEFT
        axes = sheet.panel(
            panel.place, across, up, below=(" ", ""),
            side=("Im z" if first else "", ""), ticks=(5, 5), reach=REGION_LEFT - 0.17,
        )  # fmt: skip
        _region(axes, method.amplification, across, up)
        axes.axvline(0.0, color="#999999", linewidth=0.6)
        if method.IMAGINARY_LIMIT > 0.0:
            axes.plot([0.0, 0.0], [0.0, min(method.IMAGINARY_LIMIT, up.high)],
                      **ON_AXIS)  # fmt: skip
        for values, pen in (
            (found.subject.along, ALONG),
            (found.subject.at_start, AT_START),
        ):
            z = _inside(panel, values)
            axes.plot(z.real, z.imag, **pen, zorder=2.6, clip_on=False)
        sheet.text(x, y - 0.05, panel.method, size=SMALL, bold=True)
        said, size = f"h = {panel.step:.3g} s ({panel.what})", SMALL - 0.5
        middle, below = x + width / 2, y + height + 0.3
        sheet.text(middle, below, said, size=size, ha="center", color=DIM)


def _region(
    axes: Axes, amplification: Callable[[complex], float], across: Scale, up: Scale
) -> None:
    x = np.linspace(across.low, across.high, GRID[0])
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


def work_height(found: Stability) -> float:
    """Give the height that `work` takes."""
    return HEADROOM + 3 * (WORK_HEIGHT + WORK_GAP) + 0.35 if found.adaptive else 0.0


def work(sheet: Sheet, top: float, found: Stability, varied: Named) -> None:
    """Draw what methods that choose their steps do as the parameter varies."""
    across, _ = spread([value for value in found.values if value is not None])
    width = WIDTH - NUMBERS - RIGHT
    pens = {name: look_of(name).line for name in found.adaptive}
    sheet.legend(NUMBERS, top + 0.16, list(pens.items()), width)
    asked: list[tuple[str, Callable[[Cell], float | None]]] = [
        ("evaluations / s", lambda cell: _share(cell.evaluations, cell)),
        ("1 + rejections", lambda cell: _plus_one(cell.rejections)),
        ("least step / run", lambda cell: _share(cell.smallest_step, cell)),
    ]
    for row, (label, of) in enumerate(asked):
        y = top + HEADROOM + row * (WORK_HEIGHT + WORK_GAP)
        curves = {
            name: np.array([of(cell) or math.nan for cell in found.of(name)])
            for name in found.adaptive
        }
        axes = sheet.panel(
            (NUMBERS, y, width, WORK_HEIGHT), across, log_scale(*curves.values()),
            below=varied if row == 2 else NOTHING, side=(label, ""), ticks=(9, 5),
            reach=NUMBERS - 0.2, spare=0.2,
        )  # fmt: skip
        for name, values in curves.items():
            x = np.array([cell.value for cell in found.of(name)], float)
            curve(axes, x, values, pens[name])


def _share(count: float | None, cell: Cell) -> float | None:
    return count / cell.duration if count and cell.duration else None


def _plus_one(count: int | None) -> float | None:
    """Give a count as it is drawn on logarithms, which have no 0."""
    return None if count is None else 1.0 + count


# Inches: above the maps; a strip and its distance; a map, its gaps, in rows of so many.
TOP, LEFT = 0.82, 1.3
STRIP, STRIP_GAP = 0.2, 0.06
MAP_HEIGHT, MAP_GAP, MAP_ACROSS, MAPS = 1.5, 0.62, 0.5, 3
BELOW = 0.5
STEPS: Named = ("step h", "s")
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
PREDICTED = (mark("D", 4.6, fill="white"), mark("v", 5.0, fill="#0072B2"))
PREDICTED_LINE: Pen = {"color": "#0072B2", "dashes": (3.0, 1.5), "linewidth": 1.4}


@in_house_style
def chart(title: str, found: Stability, varied: str | None, form: str = "png") -> bytes:
    """Draw what was found as a parameter, or none, varied; as PNG, SVG or PDF."""
    over = _named(found, varied)
    notes = wrapped(_notes(found, varied), WIDTH - 2 * EDGE)
    regions_at = TOP + _maps_height(found, varied)
    work_at = regions_at + regions_height(found)
    notes_at = work_at + work_height(found)
    sheet = Sheet(WIDTH, notes_at + LINE * len(notes) + 0.1, form)
    sheet.heading(title, "where methods hold and where they fail")
    _legend(sheet, found, varied=varied is not None)
    if found.methods:
        if varied is None:
            _strips(sheet, found)
        else:
            _maps(sheet, found, over)
        regions(sheet, regions_at, found)
    if found.adaptive:
        work(sheet, work_at, found, over)
    sheet.notes(notes_at + 0.04, notes)
    return sheet.content()


def _named(found: Stability, varied: str | None) -> Named:
    """Give what varies, and its unit."""
    units = {p.name: p.unit for p in found.subject.equations.model.parameters}
    return NOTHING if varied is None else (varied, units[varied])


def _maps_height(found: Stability, varied: str | None) -> float:
    count = len(found.methods)
    if not count:
        return 0.0
    if varied is None:
        return count * (STRIP + STRIP_GAP) + BELOW
    return -(-count // MAPS) * (MAP_HEIGHT + MAP_GAP) + 0.05


def _legend(sheet: Sheet, found: Stability, *, varied: bool) -> None:
    """Name colours and marks."""
    seen = {cell.verdict for cell in found.cells}
    verdicts = {v: VERDICT_COLOURS[v] for v in VERDICTS if v in seen}
    bar = {"linewidth": 8.0, "solid_capstyle": "butt"}
    bars = [(name, bar | {"color": colour}) for name, colour in verdicts.items()]
    sheet.legend(EDGE, 0.45, bars, WIDTH - 2 * EDGE)
    start, motion = PREDICTED
    seen_start, seen_motion = eigenvalues_shown(found)
    shown = [
        ("border found", FOUND, any(b.found is not None for b in found.borders)),
        ("predicted", PREDICTED_LINE, varied and any(map(prediction, found.borders))),
    ]
    if not varied:
        across, _ = spread(found.steps) if found.methods else (Scale(0.0, 0.0), None)
        shown += [
            (f"predicted: {where}", pen, any(_within(getattr(b, of), across)
                                             for b in found.borders))
            for where, pen, of in (
                ("start", start, "at_start"), ("motion", motion, "along"),
            )
        ]  # fmt: skip
    shown += [
        ("h·λ: start", AT_START, seen_start),
        ("h·λ: motion", ALONG, seen_motion),
    ]
    entries = [(name, pen) for name, pen, there in shown if there]
    sheet.legend(EDGE, 0.66, entries, WIDTH - 2 * EDGE)


def _within(step: float | None, across: Scale) -> bool:
    return step is not None and across.low < step < across.high


def _strips(sheet: Sheet, found: Stability) -> None:
    """Draw a strip of verdicts over steps for each method."""
    width = WIDTH - LEFT - RIGHT
    across, steps = spread(found.steps)
    borders = {border.method: border for border in found.borders}
    for k, method in enumerate(found.methods):
        top = TOP + k * (STRIP + STRIP_GAP)
        below = STEPS if k + 1 == len(found.methods) else NOTHING
        place = (LEFT, top, width, STRIP)
        axes = sheet.panel(place, across, Scale(-0.5, 0.5), below=below, ticks=(9, 3))
        axes.yaxis.set_major_formatter(NullFormatter())
        _cells(axes, found, method, steps, np.array((-0.5, 0.5)))
        if border := borders.get(method):
            if border.found is not None:
                axes.axvline(border.found, **FOUND, zorder=2.4)
            pairs = zip((border.at_start, border.along), PREDICTED, strict=True)
            for predicted, look in pairs:
                if predicted is not None and _within(predicted, across):
                    point(axes, predicted, 0.0, look)
        look = {"ha": "right", "va": "center_baseline"}
        sheet.text(LEFT - 0.08, top + STRIP / 2, method, size=SMALL, **look)
    low = TOP + len(found.methods) * (STRIP + STRIP_GAP) + 0.25
    sheet.text(WIDTH - RIGHT, low, CHEAPER, size=SMALL, ha="right", color=DIM)


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


def _maps(sheet: Sheet, found: Stability, varied: Named) -> None:
    """Draw a map over the parameter and the step for each method."""
    across, columns = spread([value for value in found.values if value is not None])
    up, steps = spread(found.steps)
    room = WIDTH - NUMBERS - EDGE
    maps = min(MAPS, len(found.methods))
    width = (room - (maps - 1) * MAP_ACROSS) / maps
    for k, method in enumerate(found.methods):
        row, column = divmod(k, maps)
        left = NUMBERS + column * (width + MAP_ACROSS)
        top = TOP + 0.12 + row * (MAP_HEIGHT + MAP_GAP)
        axes = sheet.panel(
            (left, top, width, MAP_HEIGHT), across, up, below=varied, spare=0.4,
            side=NOTHING if column else STEPS, ticks=(4, 6), reach=NUMBERS - 0.2,
        )  # fmt: skip
        _cells(axes, found, method, columns, steps)
        borders = [b for b in found.borders if b.method == method]
        x = np.array([b.value for b in borders], float)
        for pen, y in (
            (FOUND, [b.found for b in borders]),
            (PREDICTED_LINE, [prediction(b) for b in borders]),
        ):
            levels = np.array([step or np.nan for step in y])
            curve(axes, x, np.where(levels > up.low, levels, np.nan), pen)
        sheet.text(left, top - 0.06, method, size=SMALL, bold=True)


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
