"""stability.png: maps of verdicts, below them regions of stability with eigenvalues."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from lagsim.outputs.axis import LogAxis
from lagsim.outputs.panel import Panel, legend
from lagsim.outputs.sheet import (
    DIM,
    HEADING,
    INK,
    NORMAL,
    SMALL,
    Pen,
    Sheet,
    in_house_style,
    text_width,
)
from lagsim.studies.bench.chart import wrapped
from lagsim.studies.bench.stability_document import prediction
from lagsim.studies.bench.stability_panels import (
    ALONG,
    AT_START,
    EDGE,
    FOUND,
    LEFT,
    NUMBERS,
    PREDICTED,
    RIGHT,
    VERDICT_COLOURS,
    WIDTH,
    parameter_axis,
    regions,
    regions_height,
    spread_axis,
    work,
    work_height,
)
from lagsim.studies.bench.trial import KICK, VERDICTS

if TYPE_CHECKING:
    from collections.abc import Sequence

    from lagsim.studies.bench.stability import Border, Stability
    from lagsim.studies.bench.trial import Cell

# Inches: above the maps; a strip and its distance; a map, its gaps, in rows of so many.
TOP, LINE = 0.82, 0.14
STRIP, STRIP_GAP = 0.2, 0.06
MAP_HEIGHT, MAP_GAP, MAP_ACROSS, MAPS = 1.5, 0.62, 0.5, 3
BELOW = 0.5

NO_BORDER = Pen(INK, width=0.9)


@in_house_style
def chart(title: str, found: Stability, varied: str | None) -> bytes:
    """Draw what was found. Returns a PNG."""
    notes = [
        line
        for note in _notes(found, varied)
        for line in wrapped(note, WIDTH - 2 * EDGE)
    ]
    regions_at = TOP + _maps_height(found, varied)
    work_at = regions_at + regions_height(found)
    notes_at = work_at + work_height(found)
    sheet = Sheet(WIDTH, notes_at + LINE * len(notes) + 0.1)
    sheet.text(EDGE, 0.22, title, size=HEADING, bold=True)
    subject = "where methods hold and where they fail"
    sheet.text(WIDTH - EDGE, 0.22, subject, size=NORMAL, align="right", colour=DIM)
    _legend(sheet, found, varied=varied is not None)
    if found.methods:
        if varied is None:
            _strips(sheet, found)
        else:
            _maps(sheet, found, varied)
        regions(sheet, regions_at, found)
    if found.adaptive:
        assert varied is not None
        work(sheet, work_at, found, varied)
    for k, line in enumerate(notes):
        place = notes_at + 0.04 + k * LINE
        sheet.text(EDGE, place, line, size=SMALL, colour=DIM)
    return sheet.png()


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
    x, y = EDGE, 0.45
    for verdict in (v for v in VERDICTS if v in seen):
        box = np.array([[x, y - 0.09, x + 0.2, y + 0.02]])
        sheet.boxes(box, [VERDICT_COLOURS[verdict]])
        sheet.text(x + 0.26, y, verdict, size=SMALL)
        x += 0.26 + text_width(verdict, SMALL) + 0.2
    if found.methods:
        predicted = [
            ("predicted: start", PREDICTED[0]),
            ("predicted: motion", PREDICTED[1]),
        ]
        if varied:
            predicted = [("predicted", PREDICTED[2])]
        entries = [
            ("border found", FOUND),
            *predicted,
            ("h·λ: start", AT_START),
            ("h·λ: motion", ALONG),
        ]
        legend(sheet, EDGE, 0.66, entries, WIDTH - 2 * EDGE)


def _strips(sheet: Sheet, found: Stability) -> None:
    """Draw a strip of verdicts over steps for each method."""
    width = WIDTH - LEFT - RIGHT
    axis = _step_axis(found)
    borders = {border.method: border for border in found.borders}
    for k, method in enumerate(found.methods):
        place = (LEFT, TOP + k * (STRIP + STRIP_GAP), width, STRIP)
        panel = Panel(sheet, place, axis, LogAxis(0.0, 1.0))
        _cells(panel, found.of(method), None, found)
        middle = panel.top + STRIP / 2
        sheet.text(
            LEFT - 0.08, middle, method, size=SMALL, align="right",
            stand="center_baseline",
        )  # fmt: skip
        if method in borders:
            _border_marks(panel, borders[method])
    last = TOP + len(found.methods) * (STRIP + STRIP_GAP) - STRIP_GAP
    frame = Panel(sheet, (LEFT, TOP, width, last - TOP), axis, LogAxis(0.0, 1.0))
    places, texts = axis.ticks(9)
    for x, text in zip(frame.across(np.array(places)), texts, strict=True):
        sheet.line(np.array([x, x]), np.array([last, last + 0.04]), NO_BORDER)
        sheet.text(float(x), last + 0.16, text, size=SMALL, align="center")
    sheet.text(LEFT + width / 2, last + 0.32, "step h", size=SMALL, align="center")


def _step_axis(found: Stability) -> LogAxis:
    """Give the axis that the cells fill: half a cell past the outermost steps."""
    return spread_axis([math.log10(step) for step in found.steps])


def _cells(
    panel: Panel,
    cells: Sequence[Cell],
    values: Sequence[float] | None,
    found: Stability,
) -> None:
    """Fill the panel: over steps, or over values (as on its axis) and steps."""
    if not cells:
        return
    steps = {step: k for k, step in enumerate(found.steps)}
    columns = {value: k for k, value in enumerate(found.values)}
    boxes, colours = [], []
    for cell in cells:
        assert cell.step is not None
        k = steps[cell.step]
        if values is None:
            size = panel.width / len(steps)
            left, top = panel.left + k * size, panel.top
            box = (left, top, left + size, panel.bottom)
        else:
            size = panel.width / len(columns)
            left = panel.left + columns[cell.value] * size
            tall = panel.height / len(steps)
            bottom = panel.bottom - k * tall
            box = (left, bottom - tall, left + size, bottom)
        boxes.append(box)
        colours.append(VERDICT_COLOURS[cell.verdict])
    panel.sheet.boxes(np.array(boxes), colours)


def _border_marks(panel: Panel, border: Border) -> None:
    """Mark a border found by a bar, those predicted by marks."""
    if border.found is not None:
        x = panel.across(np.full(2, math.log10(border.found)))
        panel.sheet.line(x, np.array([panel.top, panel.bottom]), FOUND, layer=2.4)
    pairs = zip((border.at_start, border.along), PREDICTED[:2], strict=True)
    for predicted, mark in pairs:
        if predicted and panel.x.low < math.log10(predicted) < panel.x.high:
            panel.mark(math.log10(predicted), 0.5, mark, mark.colour)


def _maps(sheet: Sheet, found: Stability, varied: str) -> None:
    """Draw a map over the parameter and the step for each method."""
    values = [value for value in found.values if value is not None]
    logarithmic = min(values) > 0.0
    places = [math.log10(v) for v in values] if logarithmic else list(values)
    x_axis = parameter_axis(values)
    y_axis = _step_axis(found)
    room = WIDTH - NUMBERS - EDGE
    width = (room - (MAPS - 1) * MAP_ACROSS) / MAPS
    for k, method in enumerate(found.methods):
        row, column = divmod(k, MAPS)
        left = NUMBERS + column * (width + MAP_ACROSS)
        top = TOP + 0.12 + row * (MAP_HEIGHT + MAP_GAP)
        panel = Panel(sheet, (left, top, width, MAP_HEIGHT), x_axis, y_axis)
        _cells(panel, found.of(method), places, found)
        panel.frame((4, 6))
        sheet.text(left, top - 0.06, method, size=SMALL, bold=True)
        below = top + MAP_HEIGHT + 0.3
        sheet.text(left + width / 2, below, varied, size=SMALL, align="center")
        if column == 0:
            middle = top + MAP_HEIGHT / 2
            sheet.text(0.2, middle, "step h", align="center", turned=True)
        borders = [b for b in found.borders if b.method == method]
        at = dict(zip(values, places, strict=True))
        x = np.array([at[b.value] for b in borders if b.value is not None])
        _curve(panel, x, [b.found for b in borders], FOUND)
        _curve(panel, x, [prediction(b) for b in borders], PREDICTED[2])


def _curve(
    panel: Panel, x: np.ndarray, steps: Sequence[float | None], pen: Pen
) -> None:
    y = np.array([math.log10(step) if step else math.nan for step in steps])
    panel.curve(x, np.where(y > panel.y.low, y, math.nan), pen)


def _notes(found: Stability, varied: str | None) -> list[str]:
    subject = found.subject
    lines = []
    if found.methods:
        least = min(a for a, _ in found.runs.values())
        most = max(b for _, b in found.runs.values())
        lines.append(
            f"Each cell is a run of at least {least} steps and, up to {most}, as long "
            f"as the model runs ({subject.span:.4g}), its velocities changed by "
            f"{KICK:g} of the energy so that every mode takes part. It grows or decays "
            "where energy - work ends more than 1 % of the motion's energy away."
        )
    missing = [f"{b.method}: {b.note}" for b in found.borders if b.note]
    if varied is None and missing:
        lines.append(f"No border: {'; '.join(missing)}.")
    never = dict.fromkeys(
        b.method for b in found.borders if 0.0 in (b.at_start, b.along)
    )
    if never:
        lines.append(f"Predicted to grow at every step: {', '.join(never)}.")
    if subject.unknown:
        lines.append(f"No eigenvalues: {subject.unknown}.")
    return lines
