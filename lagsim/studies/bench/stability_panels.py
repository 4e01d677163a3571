"""The lower panels of stability.png: stability regions, and the work of a parameter."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from contourpy import FillType, contour_generator
from matplotlib.path import Path

from lagsim.methods import method as method_named
from lagsim.outputs.axis import Axis, LogAxis
from lagsim.outputs.panel import Panel, legend
from lagsim.outputs.sheet import DIM, INK, PENS, SMALL, Pen, Sheet
from lagsim.studies.bench.stability_document import prediction
from lagsim.studies.bench.trial import BREAKS, DECAYS, DIVERGES, FAILS, GROWS, HOLDS

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from lagsim.studies.bench.stability import Stability
    from lagsim.studies.bench.trial import Cell

WIDTH, LEFT, RIGHT, EDGE = 7.6, 1.3, 0.2, 0.12
# Beside scales that are numbers.
NUMBERS = 0.8

# Okabe and Ito's colours, pale for what is well, told apart in grey too.
VERDICT_COLOURS = {
    HOLDS: "#BFE3F5",
    DECAYS: "#F0E442",
    GROWS: "#E69F00",
    DIVERGES: "#D55E00",
    BREAKS: "#CC79A7",
    FAILS: "#777777",
}
FOUND = Pen(INK, width=1.8)
PREDICTED = (
    Pen(INK, marker="D", size=4.6, fill="white"),
    Pen(INK, marker="v", size=5.0, fill="#0072B2"),
    Pen("#0072B2", (3.0, 1.5), width=1.4),
)
AT_START = Pen(INK, marker="o", size=3.6, fill=INK)
ALONG = Pen("#D55E00", marker=".", size=3.0)
REGION = Pen("#5b9ec0", width=0.7, fill="#d3e8f2")
AXIS = Pen("#999999", width=0.6)
ON_AXIS = Pen("#0072B2", width=2.4)

# The part of the plane of z that is shown, and how finely it is looked at.
REAL, IMAGINARY = (-3.6, 1.2), (0.0, 4.0)
GRID = (64, 54)
REGION_HEIGHT, REGION_GAP, REGION_ACROSS, REGIONS = 1.2, 0.55, 0.3, 5
HEADROOM = 0.34
# An amplification of 1 that rounding has touched is one.
TOUCHED = 1e-6

WORK_HEIGHT, WORK_GAP = 0.9, 0.18


def regions_height(found: Stability) -> float:
    """Give the height that `regions` takes."""
    rows = -(-len(found.methods) // REGIONS)
    return HEADROOM + rows * (REGION_HEIGHT + REGION_GAP) if rows else 0.0


def regions(sheet: Sheet, top: float, found: Stability) -> None:
    """Draw each method's region of stability with h times the eigenvalues."""
    left = 0.5
    width = (WIDTH - left - EDGE - (REGIONS - 1) * REGION_ACROSS) / REGIONS
    text = "where a step does not amplify (blue), in the plane of z = h · eigenvalue"
    sheet.text(EDGE, top + 0.06, text, size=SMALL, colour=DIM)
    sheet.text(
        0.17, top + HEADROOM + REGION_HEIGHT / 2, "Im z", size=SMALL, align="center",
        turned=True,
    )  # fmt: skip
    for k, name in enumerate(found.methods):
        row, column = divmod(k, REGIONS)
        place = (
            left + column * (width + REGION_ACROSS),
            top + HEADROOM + row * (REGION_HEIGHT + REGION_GAP),
            width,
            REGION_HEIGHT,
        )
        limit = method_named(name).IMAGINARY_LIMIT
        step, what = _step_shown(found, name)
        # A bounded region fills its panel; of an unbounded one the eigenvalues decide.
        reach = step * float(np.max(np.abs(found.subject.at_start), initial=0.0))
        wide = max(1.0, 1.2 * reach / IMAGINARY[1]) if math.isinf(limit) else 1.0
        x, y = (Axis(wide * a, wide * b) for a, b in (REAL, IMAGINARY))
        panel = Panel(sheet, place, x, y)
        _region(panel, method_named(name).amplification)
        panel.curve(np.zeros(2), np.array([0.0, panel.y.high]), AXIS)
        if limit > 0.0:
            top_end = min(limit, panel.y.high)
            panel.curve(np.zeros(2), np.array([0.0, top_end]), ON_AXIS)
        panel.frame((5, 5))
        _eigenvalues(panel, found, step)
        sheet.text(place[0], place[1] - 0.05, name, size=SMALL, bold=True)
        said = f"h = {step:.3g} ({what})"
        sheet.text(
            place[0] + width / 2, panel.bottom + 0.3, said, size=SMALL - 0.5,
            align="center", colour=DIM,
        )  # fmt: skip


def _region(panel: Panel, amplification: Callable[[complex], float]) -> None:
    x = np.linspace(panel.x.low, panel.x.high, GRID[0])
    y = np.linspace(panel.y.low, panel.y.high, GRID[1])
    with np.errstate(all="ignore"):
        size = np.array([[amplification(complex(a, b)) for a in x] for b in y])
    size = np.nan_to_num(np.minimum(size, 10.0), nan=10.0)
    found = contour_generator(x, y, size, fill_type=FillType.OuterCode)
    outlines, codes = cast("tuple[Any, Any]", found.filled(-1.0, 1.0 + TOUCHED))
    for points, code in zip(outlines, codes, strict=True):
        inches = np.stack(
            (
                panel.across(points[:, 0]),
                panel.sheet.height - panel.down(points[:, 1]),
            ),
            1,
        )
        panel.sheet.shape(Path(inches, code), REGION, panel.clip, layer=0.8)


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
            return border.found, "found"
        predicted = prediction(border)
        if predicted:
            return predicted, "predicted"
    return found.steps[-1], "largest"


def _eigenvalues(panel: Panel, found: Stability, step: float) -> None:
    subject = found.subject
    for values, pen, layer in (
        (subject.along, ALONG, 2.1),
        (subject.at_start, AT_START, 2.6),
    ):
        z = step * values[values.imag >= -1e-12 * np.abs(values)]
        inside = (
            (z.real >= panel.x.low)
            & (z.real <= panel.x.high)
            & (z.imag <= panel.y.high)
        )
        z = z[inside]
        across, down = panel.across(z.real), panel.down(z.imag)
        panel.sheet.line(across, down, pen, layer=layer)


def spread_axis(places: Sequence[float]) -> LogAxis:
    """Give the axis that cells fill: half a cell past the outermost, as logarithms."""
    half = 0.5 * (places[-1] - places[0]) / max(1, len(places) - 1) or 0.05
    return LogAxis(places[0] - half, places[-1] + half)


def parameter_axis(values: Sequence[float]) -> Axis:
    """Give the axis of the parameter's values, of logarithms where all are above 0."""
    if min(values) > 0.0:
        return spread_axis([math.log10(v) for v in values])
    half = 0.5 * (values[-1] - values[0]) / max(1, len(values) - 1)
    return Axis(values[0] - half, values[-1] + half)


def work_height(found: Stability) -> float:
    """Give the height that `work` takes."""
    return HEADROOM + 3 * (WORK_HEIGHT + WORK_GAP) + 0.35 if found.adaptive else 0.0


def work(sheet: Sheet, top: float, found: Stability, varied: str) -> None:
    """Draw what methods that choose their steps do as the parameter varies."""
    values = [value for value in found.values if value is not None]
    logarithmic = min(values) > 0.0
    x_axis = parameter_axis(values)
    width = WIDTH - NUMBERS - RIGHT
    entries = [(name, _pen(k)) for k, name in enumerate(found.adaptive)]
    legend(sheet, NUMBERS, top + 0.16, entries, width)
    asked: list[tuple[str, Callable[[Cell], float | None]]] = [
        ("evaluations / time", _evaluations),
        ("rejections", lambda cell: _positive(cell.rejections)),
        ("smallest step / run", _collapse),
    ]
    for row, (label, of) in enumerate(asked):
        place = (NUMBERS, top + HEADROOM + row * (WORK_HEIGHT + WORK_GAP), width)
        curves = [
            np.array([_logarithm(of(cell)) for cell in found.of(name)])
            for name in found.adaptive
        ]
        panel = Panel(sheet, (*place, WORK_HEIGHT), x_axis, _axis_of(curves))
        for k, y in enumerate(curves):
            x = np.array([cell.value for cell in found.of(found.adaptive[k])], float)
            panel.curve(np.log10(x) if logarithmic else x, y, _pen(k))
        panel.frame((9, 5), numbers_below=row == 2)
        sheet.text(
            NUMBERS - 0.5, panel.top + WORK_HEIGHT / 2, label, size=SMALL,
            align="center", turned=True,
        )  # fmt: skip
    below = panel.bottom + 0.3
    sheet.text(NUMBERS + width / 2, below, varied, size=SMALL, align="center")


def _pen(k: int) -> Pen:
    turn, colour = divmod(k, len(PENS))
    return replace(PENS[colour], width=1.2 + 0.6 * turn)


def _axis_of(curves: Sequence[np.ndarray]) -> LogAxis:
    known = np.concatenate([y[np.isfinite(y)] for y in curves])
    low, high = (0.0, 1.0) if not len(known) else (np.min(known), np.max(known))
    margin = 0.06 * (high - low) + 0.1
    return LogAxis(float(low) - margin, float(high) + margin)


def _evaluations(cell: Cell) -> float | None:
    if not cell.evaluations or not cell.duration:
        return None
    return cell.evaluations / cell.duration


def _collapse(cell: Cell) -> float | None:
    if cell.smallest_step is None or not cell.duration:
        return None
    return cell.smallest_step / cell.duration


def _positive(count: int | None) -> float | None:
    """Give a count as it is drawn on logarithms: none as less than one."""
    return None if count is None else max(float(count), 0.5)


def _logarithm(value: float | None) -> float:
    return math.log10(value) if value else math.nan
