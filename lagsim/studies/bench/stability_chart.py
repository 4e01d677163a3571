"""stability.png: maps of verdicts, below them regions of stability with eigenvalues."""

from __future__ import annotations

import lagsim.outputs.bare_matplotlib  # noqa: F401

# isort: split
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.colors import to_rgba
from matplotlib.ticker import NullFormatter

from lagsim.outputs.curves import curve, point
from lagsim.outputs.manifest import versions
from lagsim.outputs.scale import Scale
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
from lagsim.studies.bench.machine import stamp
from lagsim.studies.bench.stability_document import prediction
from lagsim.studies.bench.stability_panels import (
    ALONG,
    AT_START,
    NUMBERS,
    RIGHT,
    WIDTH,
    eigenvalues_shown,
    regions,
    regions_height,
    spread,
    work,
    work_height,
)
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
from lagsim.version import __version__

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from lagsim.studies.bench.stability import Stability

# Inches: above the maps; a strip and its distance; a map, its gaps, in rows of so many.
TOP, LEFT = 0.82, 1.3
STRIP, STRIP_GAP = 0.2, 0.06
MAP_HEIGHT, MAP_GAP, MAP_ACROSS, MAPS = 1.5, 0.62, 0.5, 3
BELOW = 0.5
STEPS: Named = ("step h", "s")
CHEAPER = "cheaper →"

# Okabe and Ito's hues from pale to dark, so that they are told apart in grey as well.
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
