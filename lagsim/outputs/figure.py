"""Columns as a matplotlib Figure, which its owner may change and save as any other.

It looks like the pictures of a run (`sheet`), with places that a layout engine finds.
"""

from __future__ import annotations

import lagsim.outputs.bare_matplotlib  # noqa: F401

# isort: split
import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.lines import Line2D

from lagsim.outputs.letters import mathtext
from lagsim.outputs.sheet import (
    DIM,
    EDGE,
    FAINT,
    HEADING,
    LINE,
    NORMAL,
    PENS,
    SMALL,
    WIDTH,
    Pen,
    content,
    fitted,
    in_house_style,
    in_lines,
    mark,
    text_width,
    wrapped,
)

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from matplotlib.axes import Axes

    from lagsim.language.arrays import Floats

# What has the unit of energy, known or not.
ENERGIES = ("kinetic", "potential", "lagrangian", "energy", "work")
# Inches: of a panel, of one that shows a path, and of what is below the last.
PANEL, PATH, SPECTRUM, REST = 1.9, 4.2, 3.2, 0.41
MAP = 2.6
# From above: of the line of the title, of what is below it, and of a legend; between
# panels beside each other, in parts of their width.
LINE_OF_TITLE, TITLE, LEGEND, APART = 0.22, 0.34, 0.22, 0.08
COLOURS, NO_RESULT = "viridis", "#999999"
# Of the largest amplitude, what a spectrum still shows.
SHOWN = 1e-5


class Column(NamedTuple):
    """A column, and what it is called: values (rows,)."""

    name: str
    unit: str
    values: Floats

    @property
    def label(self) -> str:
        """What stands at its axis."""
        return self.within(math.inf)

    def within(self, room: float) -> str:
        """Give the same, cut to so many inches."""
        text = f"{self.name} ({self.unit})" if self.unit else self.name
        return mathtext(fitted(text, room))


class Picture(Figure):
    """A Figure that notebooks show without pyplot."""

    def _repr_png_(self) -> bytes:
        return content(self, "png")


@in_house_style
def figure(title: str, against: Column, columns: Sequence[Column]) -> Picture:
    """Draw columns against another, those of one unit in one panel.

    What has the unit of `against` is drawn at equal scales.
    """
    groups = list(_grouped(columns))
    equal = bool(against.unit) and {c.unit for c in columns} == {against.unit}
    height = PATH if equal else PANEL * len(groups)
    found = Picture(figsize=(WIDTH, height + REST), layout="constrained")
    panels = found.subplots(len(groups), sharex=True, squeeze=False)[:, 0]
    for axes, group in zip(panels, groups, strict=True):
        _draw(axes, against, group)
        if equal:
            axes.set_aspect("equal", adjustable="datalim")
    panels[-1].set_xlabel(against.label, size=NORMAL)
    found.align_ylabels()
    headed(found, title)
    return found


@in_house_style
def spectrum_figure(
    title: str, across: Column, up: Column, peaks: Sequence[tuple[float, float]]
) -> Picture:
    """Draw amplitudes against frequencies, with the places of peaks, and their list."""
    found = Picture(figsize=(WIDTH, SPECTRUM + REST), layout="constrained")
    axes = found.subplots()
    _draw(axes, across, [up])
    axes.set_yscale("log")
    axes.minorticks_off()
    axes.set_xlabel(across.label, size=NORMAL)
    largest = float(up.values.max(initial=0.0))
    if largest:
        axes.set_ylim(SHOWN * largest, 5 * largest)
        seen = across.values[up.values >= SHOWN * largest]
        axes.set_xlim(0.0, 1.05 * float(seen[-1]))
    unit = f" {up.unit}" if up.unit else ""
    for number, place in enumerate(peaks, 1):
        axes.plot(*place, **mark("o", 3.0))
        axes.annotate(
            str(number),
            place,
            (3.0, 3.0),
            textcoords="offset points",
            size=SMALL,
            bbox={"facecolor": "white", "edgecolor": "none", "pad": 0.3, "alpha": 0.8},
        )
    lines = [
        f"{number}:  {frequency:.4g} {across.unit},  {amplitude:.3g}{unit}"
        for number, (frequency, amplitude) in enumerate(peaks, 1)
    ]
    axes.text(
        0.99, 0.98, mathtext("\n".join(lines)), transform=axes.transAxes, size=SMALL,
        ha="right", va="top", multialignment="left",
        bbox={"facecolor": "white", "edgecolor": "none"},
    )  # fmt: skip
    headed(found, title, f"spectrum of {up.name.removeprefix('amplitude of ')}")
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
    legend: Sequence[tuple[str, Pen]] = (),
    notes: Sequence[str] = (),
) -> Picture:
    """Draw maps, values (rows, columns), over two others: borders of their cells.

    So many beside each other; of what is nan the ground is seen.
    """
    rows = -(-len(maps) // abreast)
    found = Picture(figsize=(WIDTH, MAP * rows + REST), layout="constrained")
    panels = found.subplots(rows, abreast, sharex=True, sharey=True, squeeze=False)
    for axes, column in zip(panels.flat, maps, strict=False):
        axes.set_facecolor(NO_RESULT)
        cells = np.ma.masked_invalid(column.values)
        drawn = axes.pcolormesh(across.values, up.values, cells, cmap=COLOURS)
        bar = found.colorbar(drawn, ax=axes, aspect=15)
        bar.set_label(column.within(0.85 * MAP), size=NORMAL)
        bar.ax.tick_params(labelsize=SMALL, length=0.0)
        axes.tick_params(length=2.0, labelsize=SMALL)
    for axes in panels.flat[len(maps) :]:
        axes.remove()
    for axes in panels[:, 0]:
        axes.set_ylabel(up.within(0.85 * MAP), size=NORMAL)
    for axes in panels[-1, : len(maps) - abreast * (rows - 1)]:
        axes.set_xlabel(across.within(WIDTH / (abreast + 0.5)), size=NORMAL)
    headed(found, title, subject, legend, notes)
    return found


def headed(
    found: Figure,
    title: str,
    subject: str = "",
    legend: Sequence[tuple[str, Pen]] = (),
    notes: Sequence[str] = (),
) -> None:
    """Write a title at the left and what is shown at the right, over all panels.

    Under them a legend, of names and pens, and below the panels notes in small print.
    The figure grows by what they take.
    """
    lines = wrapped(notes, WIDTH - 2 * EDGE)
    below = LINE * (len(lines) + bool(lines))
    named = in_lines(legend, WIDTH - 2 * EDGE) if legend else []
    above = TITLE + LEGEND * len(named)
    high = found.get_figheight() + above + below
    found.set_figheight(high)
    edge = EDGE / WIDTH
    for k, line in enumerate(named):
        samples = [Line2D([], [], **pen) for _, pen in line]
        found.legend(
            samples, [mathtext(name) for name, _ in line], loc="upper left",
            bbox_to_anchor=(edge, 1.0 - (TITLE + k * LEGEND) / high), ncols=len(line),
        ).set_in_layout(False)  # fmt: skip
    # Above the panels, and with one line for both to stand on.
    engine = found.get_layout_engine()
    assert isinstance(engine, ConstrainedLayoutEngine)
    shown = (high - above - below) / high
    engine.set(rect=(0.0, below / high, 1.0, shown), wspace=APART)
    level = 1.0 - LINE_OF_TITLE / high
    title = fitted(title, 0.65 * WIDTH, HEADING, bold=True)
    room = WIDTH - 4 * EDGE - text_width(title, HEADING, bold=True)
    subject = mathtext(fitted(subject, room))
    found.text(edge, level, mathtext(title), size=HEADING, weight="bold")
    found.text(1.0 - edge, level, subject, ha="right", size=NORMAL, color=DIM)
    if lines:
        text = "\n".join(map(mathtext, lines))
        found.text(edge, 0.4 * LINE / high, text, size=SMALL, color=DIM, va="bottom")


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
    axes.grid(color=FAINT, linewidth=0.4)
    axes.spines[:].set(color=DIM, linewidth=0.6)
    axes.tick_params(length=0.0, labelsize=SMALL)
    axes.yaxis.get_offset_text().set_fontsize(SMALL)
    axes.margins(x=0.0 if against.name == "t" else 0.03)
    if len(group) == 1:
        axes.set_ylabel(group[0].label, size=NORMAL)
        return
    axes.set_ylabel(mathtext(group[0].unit), size=NORMAL)
    axes.legend(
        loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=len(group), frameon=False,
        fontsize=SMALL, borderaxespad=0.2,
    )  # fmt: skip
