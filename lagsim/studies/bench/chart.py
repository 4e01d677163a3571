"""work_precision.png: time and evaluations against the error they bought."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import groupby
from typing import TYPE_CHECKING

import numpy as np

from lagsim.methods import names
from lagsim.outputs.axis import DecadeAxis
from lagsim.outputs.panel import Panel, legend
from lagsim.outputs.sheet import (
    DIM,
    HEADING,
    NORMAL,
    PENS,
    SMALL,
    Pen,
    Sheet,
    in_house_style,
    text_width,
)
from lagsim.studies.bench.machine import described
from lagsim.studies.bench.scipy_solvers import NAMES as SCIPY

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence
    from typing import Any

    from lagsim.studies.bench.work_precision import Entry, WorkPrecision

# Inches: the sheet, its margins, the panels and what is between them.
WIDTH, LEFT, RIGHT, EDGE = 7.6, 0.72, 1.55, 0.12
TOP, HEIGHT, GAP, LINE = 0.62, 3.0, 0.42, 0.14
# Between the names at the right.
NAME_GAP = 0.135

FRONT = Pen("#F0E442", width=6.0)
CHOSEN = Pen("#000000", marker="o", size=8.0, fill="none")
FLOOR = Pen("#888888", (3.0, 2.0), width=0.8)
MARKERS = ("o", "s", "^", "D")
SCIPY_MARKERS = ("x", "+", "1", "2", "3")

# An error above this is no answer; one below that is 0.
WORST, LEAST = 3.0, 1e-18

Curves = dict[tuple[str, str], list["Entry"]]


@in_house_style
def chart(title: str, found: WorkPrecision, document: Mapping[str, Any]) -> bytes:
    """Draw what was measured; `document` is its JSON. Returns a PNG."""
    curves = {
        curve: drawn
        for curve, entries in found.curves().items()
        if (drawn := [e for e in entries if e.error is not None and e.error <= WORST])
    }
    width = WIDTH - LEFT - RIGHT
    notes = [
        line
        for note in _notes(found, document)
        for line in wrapped(note, WIDTH - 2 * EDGE)
    ]
    below = TOP + 2 * HEIGHT + GAP + 0.5
    sheet = Sheet(WIDTH, below + LINE * len(notes) + 0.1)
    sheet.text(EDGE, 0.22, title, size=HEADING, bold=True)
    subject = "what an error costs"
    sheet.text(WIDTH - EDGE, 0.22, subject, size=NORMAL, align="right", colour=DIM)
    errors = [_logarithm(e.error) for entries in curves.values() for e in entries]
    floor = _logarithm(found.reference.floor)
    across = DecadeAxis(
        max(errors, default=0.0) + 0.3, min([*errors, floor, -3.0]) - 0.3
    )
    for k, (of, label) in enumerate(
        (("seconds", "seconds"), ("evaluations", "evaluations"))
    ):
        place = (LEFT, TOP + k * (HEIGHT + GAP), width, HEIGHT)
        panel = Panel(sheet, place, across, _costs(curves, of))
        _fill(panel, found, curves, of)
        panel.frame((9, 7))
        middle = panel.top + HEIGHT / 2
        sheet.text(0.2, middle, label, align="center", turned=True)
        if k == 0:
            _legend(panel)
    label = "error: greatest of any coordinate or velocity, against its range"
    sheet.text(LEFT + width / 2, below - 0.17, label, align="center")
    for k, line in enumerate(notes):
        sheet.text(EDGE, below + 0.1 + k * LINE, line, size=SMALL, colour=DIM)
    return sheet.png()


def _logarithm(value: float | None) -> float:
    return math.log10(max(value or 0.0, LEAST))


def _costs(curves: Curves, of: str) -> DecadeAxis:
    costs = [_logarithm(e.cost(of)) for entries in curves.values() for e in entries]
    low, high = min(costs, default=0.0), max(costs, default=1.0)
    margin = 0.05 * (high - low) + 0.05
    return DecadeAxis(low - margin, high + margin)


def _fill(panel: Panel, found: WorkPrecision, curves: Curves, of: str) -> None:
    front = [found.entries[k] for k in found.front(of)]
    panel.curve(*_points(front, of), FRONT)
    floor = _logarithm(found.reference.floor)
    panel.curve(np.array([floor, floor]), np.array([panel.y.low, panel.y.high]), FLOOR)
    ends = []
    for curve, entries in curves.items():
        x, y = _points(entries, of)
        line, mark = pens(curve)
        panel.curve(x, y, line)
        for entry, across, down in zip(entries, x, y, strict=True):
            panel.mark(across, down, mark, line.colour)
            if entry.chosen:
                panel.mark(across, down, CHOSEN, CHOSEN.colour)
        best = int(np.argmin(x))
        ends.append((float(x[best]), float(y[best]), _name(curve, curves), line))
    _names(panel, ends)


def _points(entries: Sequence[Entry], of: str) -> tuple[Any, Any]:
    x = np.array([_logarithm(e.error) for e in entries])
    return x, np.array([_logarithm(e.cost(of)) for e in entries])


def pens(curve: tuple[str, str]) -> tuple[Pen, Pen]:
    """Give line and mark of a method: the same in every chart."""
    method, formulation = curve
    if method in SCIPY:
        mark = Pen(marker=SCIPY_MARKERS[SCIPY.index(method)], size=4.5)
        return Pen("#777777", width=0.7), mark
    turn, colour = divmod(names().index(method), len(PENS))
    kinds = ("none", "projection", "velocity projection", "elimination", "baumgarte")
    shape = kinds.index(formulation) if formulation in kinds else len(kinds)
    mark = Pen(marker=MARKERS[max(0, shape - 1) % len(MARKERS)], size=3.4)
    return PENS[colour], replace(mark, fill="white") if turn else mark


def _name(curve: tuple[str, str], curves: Iterable[tuple[str, str]]) -> str:
    method, formulation = curve
    alone = sum(name == method for name, _ in curves) == 1
    return method if alone else f"{method} {formulation}"


def _names(panel: Panel, ends: list[tuple[float, float, str, Pen]]) -> None:
    """Write the names at the right, each level with its curve's end where it can be."""
    ends.sort(key=lambda end: -end[1])
    wanted = [float(panel.down(np.array([y]))[0]) for _, y, _, _ in ends]
    places = spread(wanted, panel.top + 0.05, panel.bottom - 0.02, NAME_GAP)
    right = panel.left + panel.width
    for (x, _, name, pen), level, place in zip(ends, wanted, places, strict=True):
        from_x = float(panel.across(np.array([x]))[0])
        thread = Pen(pen.colour, width=0.35)
        panel.sheet.line(
            np.array([from_x, right, right + 0.13]),
            np.array([level, level, place]),
            thread,
            layer=1.2,
        )
        panel.sheet.text(
            right + 0.16,
            place,
            name,
            size=SMALL,
            stand="center_baseline",
            colour=pen.colour,
        )


def spread(wanted: Sequence[float], low: float, high: float, gap: float) -> list[float]:
    """Give places at least `gap` apart, in the same order, near those wanted (rising).

    They stay within low and high where there is room for all.
    """
    gap = min(gap, (high - low) / max(1, len(wanted) - 1))
    places: list[float] = []
    for place in wanted:
        places.append(max(place, places[-1] + gap if places else low))
    limit = high
    for k in reversed(range(len(places))):
        places[k] = min(places[k], limit)
        limit = places[k] - gap
    return places


def _legend(panel: Panel) -> None:
    entries = [
        ("Pareto front", replace(FRONT, width=4.0)),
        ("what `auto` takes", CHOSEN),
        ("the reference is known to this", FLOOR),
    ]
    legend(panel.sheet, panel.left, panel.top - 0.1, entries, panel.width)


def _notes(found: WorkPrecision, document: Mapping[str, Any]) -> list[str]:
    reference = found.reference
    agreed = f"{reference.verified} agrees with it to {reference.floor:.1g}"
    known = f"Reference: {reference.made}; {agreed}"
    if reference.horizon is not None:
        known += (
            f" up to t = {reference.horizon:.4g} of {reference.rows[-1, 0]:.4g}, past "
            "which the motion is not known: errors are those of the rows before"
        )
    lines = [f"{known}."]
    gaps = _gaps(found)
    if gaps:
        lines.append(f"Gaps: {'; '.join(gaps)}.")
    packages = " ".join(f"{k} {v}" for k, v in document["versions"].items())
    lines.append(
        "Seconds: the integration with all its rows and columns (scipy's without), "
        f"warm, least of several, on {described(document['machine'])}; lagsim "
        f"{document['lagsim']}, {packages}."
    )
    return lines


def _gaps(found: WorkPrecision) -> list[str]:
    """Say which settings gave nothing, and why, those next to each other together."""
    curves = found.curves()
    said = []
    for curve, entries in curves.items():
        for outcome, group in groupby(entries, _without_answer):
            if outcome is not None:
                missing = list(group)
                ends = (missing[0], missing[-1])
                values = dict.fromkeys(f"{e.value:.3g}" for e in ends)
                where = f"{_name(curve, curves)} at {missing[0].setting}"
                said.append(f"{where} {' to '.join(values)}: {outcome}")
    return said


def _without_answer(entry: Entry) -> str | None:
    return entry.outcome if entry.error is None else None


def wrapped(text: str, room: float) -> list[str]:
    """Break a text in small print into lines of at most `room` inches."""
    lines = [""]
    for word in text.split():
        longer = f"{lines[-1]} {word}".strip()
        if lines[-1] and text_width(longer, SMALL) > room:
            lines.append(word)
        else:
            lines[-1] = longer
    return lines
