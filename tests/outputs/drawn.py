"""Calls of matplotlib while a picture is made, read off its artists.

Everything is recorded at the moment it is drawn: places in pixels from the lower left
corner, as on the picture.
"""

from __future__ import annotations

import io
import itertools
import re
from contextlib import contextmanager
from dataclasses import dataclass, field
from types import SimpleNamespace

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.cbook import is_math_text
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.text import Text
from PIL import Image

from lagsim.model.model import DrawnExpression, Plot, Scene
from lagsim.outputs import plots
from lagsim.outputs.figure import DPI, Picture, encoded_figure
from lagsim.outputs.plot_data import PlotData
from lagsim.run.observers.thinning import Thinning

UNITS = {"t": "s", "theta": "rad", "u": "m", "energy": "J"}
NOWHERE = Scene({})
PLAIN = str.maketrans("−⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "--0123456789")
LABEL = re.compile(
    r"(?P<name>.*?)(?: (?P<sign>[−+]) (?P<offset>[\d.e+-]+))?"
    r"(?: \((?:10(?P<power>[⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+))? ?(?P<unit>[^()]*)\))?"
)


@dataclass
class Panel:
    """Axes as they were when they were drawn."""

    box: object
    x: list
    y: list
    labels: tuple
    limits: tuple
    lines: list = field(default_factory=list)
    thin: list = field(default_factory=list)
    areas: list = field(default_factory=list)

    @property
    def name(self):
        """Name of the quantity of the vertical axis, at the side or above."""
        return self.labels[1] or self.labels[2]

    def at(self, times):
        """Places of values of the horizontal axis, in pixels."""
        low, high = self.limits[0]
        share = (np.asarray(times) - low) / (high - low)
        return self.box.x0 + share * self.box.width

    def of_colour(self, colour):
        return [line for line in self.lines if line.colour == colour.lower()]


@dataclass
class Scale:
    """A scale on paper: value = slope * pixels + start, with a name and a unit."""

    name: str
    unit: str
    slope: float
    start: float

    def __call__(self, pixels):
        return self.slope * np.asarray(pixels, float) + self.start


def scale_of(label, ticks):
    """Return the scale that follows from an axis label and ticks (pixels, text)."""
    m = LABEL.fullmatch(label)
    assert m, label
    unit = 10.0 ** int((m["power"] or "0").translate(PLAIN))
    offset = float(m["offset"] or 0.0) * (1.0 if m["sign"] == "−" else -1.0)
    places = np.array([place for place, _ in ticks])
    counts = np.array([float(text.translate(PLAIN)) for _, text in ticks])
    slope, start = np.polyfit(places, counts, 1)
    # Ticks are evenly spaced, or somebody moved one.
    slack = 1e-6 * np.ptp(counts)
    assert np.allclose(slope * places + start, counts, rtol=0, atol=slack)
    return Scale(m["name"], m["unit"] or "", unit * slope, unit * start + offset)


@dataclass
class Drawing:
    """A sheet, its title, panels and texts, and the lines outside of panels."""

    sheet: object = None
    title: str = ""
    panels: list = field(default_factory=list)
    texts: list = field(default_factory=list)
    samples: list = field(default_factory=list)

    def written(self):
        return [text.said for text in self.texts]


def below(letters, subscript):
    """Return the text for matplotlib of a name with a subscript."""
    return rf"{letters}$_\mathrm{{{subscript}}}$"


def numbers(axis, part):
    """Return the visible tick labels of an axis as numbers, with their places."""
    ticks = axis.get_major_ticks()[: len(axis.get_majorticklocs())]
    ticks += axis.get_minor_ticks()[: len(axis.get_minorticklocs())]
    low, high = sorted(axis.get_view_interval())
    slack = 1e-9 * (high - low)
    return [
        (float(t.label1.get_transform().transform(t.label1.get_position())[part]), said)
        for t in ticks
        if low - slack <= t.get_loc() <= high + slack
        and t.label1.get_visible()
        and (said := t.label1.get_text())
    ]


def line_of(line):
    x, y = line.get_transform().transform(line.get_xydata()).T
    return SimpleNamespace(
        x=x, y=y, colour=to_hex(line.get_color()), width=line.get_linewidth(),
        marker=line.get_marker(), dots=line.get_linestyle() == "None",
    )  # fmt: skip


def panel_of(axes):
    panel = Panel(
        axes.get_window_extent().frozen(),
        numbers(axes.xaxis, 0),
        numbers(axes.yaxis, 1),
        (axes.get_xlabel(), axes.get_ylabel(), axes.get_title(loc="left")),
        (axes.get_xlim(), axes.get_ylim()),
    )
    lines = [line_of(line) for line in axes.lines]
    panel.lines = [line for line in lines if line.width > 0.6]
    panel.thin = [line for line in lines if line.width <= 0.6]
    for patch in axes.patches:
        corners = patch.get_transform().transform(patch.get_path().vertices)
        panel.areas.append((to_hex(patch.get_facecolor()), corners))
    for collection in axes.collections:
        if not len(collection.get_facecolor()):  # outlines
            continue
        for path in collection.get_paths():
            corners = collection.get_transform().transform(path.vertices)
            panel.areas.append((to_hex(collection.get_facecolor()[0]), corners))
    return panel


@contextmanager
def noted():
    """Context manager: record all drawing."""
    drawing = Drawing()
    plain = {kind: kind.draw for kind in (Axes, Text, Line2D, Figure)}

    known = {}

    def figure(self, renderer):
        # A layout is found by drawing everything once before.
        lists = drawing.panels, drawing.texts, drawing.samples
        begun = known.setdefault(self, [len(x) for x in lists])
        for noted, count in zip(lists, begun, strict=True):
            del noted[count:]
        if self.legends:  # what stands above all: the model, and what of it is shown
            said = self.legends[0].get_title().get_text()
            drawing.title = said.replace("\n", " ").replace(r"\$", "$")
        plain[Figure](self, renderer)

    def axes(self, renderer):
        # The ticks are up to date after they have been drawn.
        plain[Axes](self, renderer)
        drawing.panels.append(panel_of(self))

    def text(self, renderer):
        plain[Text](self, renderer)
        if self.get_visible() and self.get_text().strip():
            place = self.get_transform().transform(self.get_position())
            drawing.texts.append(SimpleNamespace(
                said=self.get_text().replace(r"\$", "$"), place=place,
                box=self.get_window_extent(renderer).frozen(),
                typeset=is_math_text(self.get_text()) or self.get_usetex(),
            ))  # fmt: skip

    def line(self, renderer):
        plain[Line2D](self, renderer)
        if self.axes is None or self not in self.axes.lines:
            drawing.samples.append(line_of(self))

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Axes, "draw", axes)
        patch.setattr(Text, "draw", text)
        patch.setattr(Line2D, "draw", line)
        patch.setattr(Figure, "draw", figure)
        yield drawing


def record(columns, differences=None, **fields):
    """Return the data that pictures of columns share; one number is a column, too."""
    fields = {"title": "swing", "units": UNITS} | fields
    t = np.asarray(columns["t"], float)
    thinning = Thinning(tuple(columns), differences=differences)
    rows = [np.broadcast_to(column, t.shape) for column in columns.values()]
    thinning.add(np.stack(rows, axis=1).astype(float))
    return PlotData(rows=thinning, **fields)


def drawn(draw, *args, **kwargs):
    """Draw a sheet, and return the record of its drawing."""
    with noted() as drawing:
        drawing.sheet = draw(*args, **kwargs)
        if isinstance(drawing.sheet, Picture):
            with pytest.MonkeyPatch.context() as patch:
                patch.setattr("matplotlib.image.imsave", lambda *_, **__: None)
                encoded_figure(drawing.sheet)
    return drawing


def coordinates(columns, names, scene=NOWHERE, **fields):
    """Draw coordinates and the paths of a scene."""
    return drawn(plots.trajectory, record(columns, **fields), names, scene)


def plotted(columns, wanted, scene=NOWHERE, **fields):
    """Draw a plot of a model file."""
    return drawn(plots.plot, record(columns, **fields), 0, wanted, scene)


def pixels(picture):
    """Return the pixels of a picture, shape (height, width, 3)."""
    return np.asarray(Image.open(io.BytesIO(encoded_figure(picture))))[:, :, :3].astype(
        int
    )


def against(x, *ys, **more):
    """A plot of curves; the nodes of its expressions do not count."""
    return Plot(DrawnExpression(0, x), tuple(DrawnExpression(0, y) for y in ys), **more)


def finite(x, y):
    there = np.isfinite(x) & np.isfinite(y)
    return x[there], y[there]


def assert_legible(drawing):
    """Every text of a sheet lies on it, beside panels and beside other texts."""
    sheet = drawing.sheet
    if isinstance(sheet, Picture):
        width, height = sheet.bbox.size * DPI / sheet.dpi
    else:
        width, height = Image.open(io.BytesIO(sheet)).size
    assert drawing.panels
    boxes = [(text.box, text.said) for text in drawing.texts]
    for box, text in boxes:
        assert 0 <= box.x0 <= box.x1 <= width, text
        assert 0 <= box.y0 <= box.y1 <= height, text
        for panel in drawing.panels:
            # Of a view from aside the axes are named where they end.
            aside = not panel.x and not panel.y and text in ("x", "y", "z")
            assert aside or not box.overlaps(panel.box), text
    for (one, text), (other, text2) in itertools.combinations(boxes, 2):
        # The frame of a letter is wider than its ink.
        assert not one.padded(-2).overlaps(other.padded(-2)), (text, text2)
