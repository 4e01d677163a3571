"""work_precision.png: time and evaluations against the error they bought."""

from __future__ import annotations

from itertools import groupby
from typing import TYPE_CHECKING

import numpy as np

from lagsim.methods import names
from lagsim.outputs.curves import curve, inches, point
from lagsim.outputs.scale import Scale, log_scale
from lagsim.outputs.sheet import (
    EDGE,
    LINE,
    PENS,
    SMALL,
    Pen,
    Place,
    Sheet,
    in_house_style,
    mark,
    wrapped,
)
from lagsim.studies.bench.machine import described
from lagsim.studies.bench.scipy_solvers import NAMES as SCIPY

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence
    from typing import Any

    from matplotlib.axes import Axes

    from lagsim.studies.bench.work_precision import Entry, WorkPrecision

# Inches: the sheet, its margins, the panels and what is between them.
WIDTH, LEFT, RIGHT = 7.6, 0.72, 1.55
TOP, HEIGHT, GAP = 0.62, 3.0, 0.42
# Between the names at the right.
NAME_GAP = 0.135

FRONT: Pen = {"color": "#F0E442", "linewidth": 6.0}
CHOSEN = mark("o", 8.0, fill="none")
FLOOR: Pen = {"color": "#888888", "dashes": (3.0, 2.0), "linewidth": 0.8}
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
    notes = wrapped(_notes(found, document), WIDTH - 2 * EDGE)
    below = TOP + 2 * HEIGHT + GAP + 0.5
    sheet = Sheet(WIDTH, below + LINE * len(notes) + 0.1)
    sheet.heading(title, "what an error costs")
    errors = [_error(e.error) for entries in curves.values() for e in entries]
    least = min([*errors, _error(found.reference.floor), 1e-3])
    across = Scale(2.0 * max(errors, default=1.0), 0.5 * least, log=True)
    label = "error: greatest of any coordinate or velocity, against its range"
    for k, of in enumerate(("seconds", "evaluations")):
        place = (LEFT, TOP + k * (HEIGHT + GAP), width, HEIGHT)
        costs = [max(e.cost(of), LEAST) for row in curves.values() for e in row]
        y = log_scale(np.array(costs), margin=0.05, least=0.05)
        with sheet.panel(
            place, across, y, below=(label if k else " ", ""), side=(of, ""),
            ticks=(9, 7), reach=LEFT - 0.2,
        ) as axes:  # fmt: skip
            front = [found.entries[k] for k in found.front(of)]
            curve(axes, *_points(front, of), FRONT)
            axes.axvline(_error(found.reference.floor), **FLOOR)
            for method, entries in curves.items():
                line, look = pens(method)
                points = _points(entries, of)
                curve(axes, *points, line)
                for entry, x, cost in zip(entries, *points, strict=True):
                    point(axes, x, cost, look)
                    if entry.chosen:
                        point(axes, x, cost, CHOSEN)
            _names(sheet, place, axes, curves, of)
    named = [
        ("Pareto front", FRONT | {"linewidth": 4.0}),
        ("what `auto` takes", CHOSEN),
        ("the reference is known to this", FLOOR),
    ]
    sheet.legend(LEFT, TOP - 0.1, named, width)
    sheet.notes(below + 0.1, notes)
    return sheet.png()


def _error(value: float | None) -> float:
    return max(value or 0.0, LEAST)


def _points(entries: Sequence[Entry], of: str) -> tuple[Any, Any]:
    x = np.array([_error(e.error) for e in entries])
    return x, np.array([_error(e.cost(of)) for e in entries])


def pens(curve: tuple[str, str]) -> tuple[Pen, Pen]:
    """Give line and mark of a method: the same in every chart."""
    method, formulation = curve
    if method in SCIPY:
        marker = SCIPY_MARKERS[SCIPY.index(method)]
        return {"color": "#777777", "linewidth": 0.7}, mark(marker, 4.5, "#777777")
    turn, colour = divmod(names().index(method), len(PENS))
    kinds = ("none", "projection", "velocity projection", "elimination", "baumgarte")
    shape = kinds.index(formulation) if formulation in kinds else len(kinds)
    marker, pen = MARKERS[max(0, shape - 1) % len(MARKERS)], PENS[colour]
    return pen, mark(marker, 3.4, pen["color"], "white" if turn else "")


def _name(curve: tuple[str, str], curves: Iterable[tuple[str, str]]) -> str:
    method, formulation = curve
    alone = sum(name == method for name, _ in curves) == 1
    return method if alone else f"{method} {formulation}"


def _names(sheet: Sheet, place: Place, axes: Axes, curves: Curves, of: str) -> None:
    """Write the names at the right, each level with its curve's end where it can be."""
    left, top, width, height = place
    ends = []
    for method, entries in curves.items():
        x, y = inches(axes, *_points(entries, of))
        best = int(np.argmax(x))
        ends.append((sheet.height - y[best], x[best], method))
    ends.sort()
    wanted = [level for level, _, _ in ends]
    places = spread(wanted, top + 0.05, top + height - 0.02, NAME_GAP)
    right, paper = left + width, axes.figure.dpi_scale_trans
    for (level, x, method), at in zip(ends, places, strict=True):
        look = {"color": pens(method)[0]["color"]}
        across = [x, right, right + 0.13]
        up = sheet.height - np.array([level, level, at])
        thread = look | {"linewidth": 0.35, "zorder": 1.2, "clip_on": False}
        axes.plot(across, up, **thread, transform=paper)
        name = _name(method, curves)
        sheet.text(right + 0.16, at, name, size=SMALL, va="center_baseline", **look)


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
    for method, entries in curves.items():
        for outcome, group in groupby(entries, _without_answer):
            if outcome is not None:
                missing = list(group)
                ends = (missing[0], missing[-1])
                values = dict.fromkeys(f"{e.value:.3g}" for e in ends)
                where = f"{_name(method, curves)} at {missing[0].setting}"
                said.append(f"{where} {' to '.join(values)}: {outcome}")
    return said


def _without_answer(entry: Entry) -> str | None:
    return entry.outcome if entry.error is None else None
