"""Pictures of docs/gallery.md, which `regenerate.py` writes.

One small picture for each model of models/: the ways of the points of its scene, and
the scene with its shapes at the end; the coordinates against time where it has none.
"""

from __future__ import annotations

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import Polygon

from benchmarks.failing_chart import small_png
from benchmarks.pages import MODELS
from lagsim.model.reader import read_file
from lagsim.outputs.shapes import bodies, needed, projected
from lagsim.run.observers import Keep
from lagsim.run.session import open_case

SIZE, DPI = (2.4, 1.8), 100
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
# A scene in space is seen from the front, the right and above: these components of
# x, y, z go to the right and up.
RIGHT = (np.cos(0.6), np.sin(0.6), 0.0)
UP = (-np.sin(0.6) * np.sin(0.4), np.cos(0.6) * np.sin(0.4), np.cos(0.4))


def drawn(name):
    """Run a model; return its picture as a PNG."""
    model = read_file(str(MODELS / f"{name}.yaml"))
    session = open_case(model).ready()
    kept = Keep()
    session.run([kept])
    columns = dict(zip(session.system.columns.names, kept.table.T, strict=True))
    figure = Figure(figsize=SIZE, dpi=DPI)
    axes = figure.add_axes((0.04, 0.04, 0.92, 0.92))
    axes.axis("off")
    places = {
        name: _seen(name, parts, columns) for name, parts in model.scene.points.items()
    }
    # What moves in one line is better seen against time.
    if model.scene.shapes or (
        places
        and all(np.ptp(np.concatenate(xs)) for xs in zip(*places.values(), strict=True))
    ):
        _scene(axes, model.scene, places)
        _shapes(
            axes,
            model,
            columns,
            [name for name, xs in places.items() if np.ptp(xs[0]) + np.ptp(xs[1]) > 0],
        )
    else:
        _curves(axes, [q.name for q in model.coordinates], columns)
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    return small_png(np.asarray(canvas.buffer_rgba()))


def _scene(axes, scene, places):
    moving = [name for name, (x, y) in places.items() if np.ptp(x) + np.ptp(y) > 0]
    for k, name in enumerate(moving):
        axes.plot(*places[name], color=COLOURS[k % len(COLOURS)], linewidth=0.7)
    for ends in scene.links:
        (x1, y1), (x2, y2) = (places[name] for name in ends)
        axes.plot([x1[-1], x2[-1]], [y1[-1], y2[-1]], color="black", linewidth=1.2)
    for name, (x, y) in places.items():
        shape = "o" if name in moving else "s"
        axes.plot(x[-1:], y[-1:], shape, color="black", markersize=3.5)
    axes.set_aspect("equal", adjustable="datalim")


def _shapes(axes, model, columns, moving):
    """Draw the shapes at the end, in the colours of their points."""
    last = {name: columns[name][-1:] for name in needed(model)}
    view = np.eye(2) if model.scene.dimension == 2 else np.array((RIGHT, UP))
    for body in bodies(model, last, 1):
        found, kind = projected(body, 0, view), body.shape.kind
        known = body.shape.point in moving
        number = moving.index(body.shape.point) if known else len(moving)
        colour = COLOURS[number % len(COLOURS)] if body.moves else "#555555"
        for face, _ in found.faces:
            axes.add_patch(Polygon(face, facecolor=colour, alpha=0.3))
        width = 1.6 if kind == "ground" else 0.9
        axes.plot(*found.lines.T, color=colour, linewidth=width)


def _seen(name, parts, columns):
    """Return the picture's coordinates of a point, to the right and up."""
    found = [columns[f"point.{name}.{k}"] for k in range(1, len(parts) + 1)]
    if len(found) == 2:
        return found
    return [
        sum(c * x for c, x in zip(turn, found, strict=True)) for turn in (RIGHT, UP)
    ]


def _curves(axes, names, columns):
    for k, name in enumerate(names):
        values = columns[name]
        size = np.ptp(values) or 1.0
        axes.plot(columns["t"], values / size, color=COLOURS[k % len(COLOURS)])
    axes.axhline(0.0, color="#999999", linewidth=0.5)
