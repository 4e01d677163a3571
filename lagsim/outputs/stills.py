"""Pictures of a scene at single states: rests, and modes at their two extremes."""

from __future__ import annotations

import lagsim.outputs.bare_matplotlib  # noqa: F401

# isort: split
from functools import partial
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from matplotlib.patches import Polygon

from lagsim.language.evaluate import evaluate_rows
from lagsim.outputs.animation import Film, Track, stage
from lagsim.outputs.figure import (
    APART,
    BELOW_PANELS,
    DIM,
    INK,
    PENS,
    SMALL,
    WIDTH,
    Picture,
    in_house_style,
    line,
    marker_pen,
    point,
)
from lagsim.outputs.letters import mathtext
from lagsim.outputs.scale import finite_range, per_inch, set_equal_scales
from lagsim.outputs.shapes import bodies, needed, projected, reached, string_lengths
from lagsim.outputs.views import LOOKS, OBLIQUE, edges, inch_of, plane
from lagsim.tolerances import COMPUTED_ZERO

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from matplotlib.axes import Axes

    from lagsim.language.arrays import Floats
    from lagsim.model.model import Model
    from lagsim.outputs.figure import Entry, Pen

# Panels of a picture; panels side by side if there are more than a few; height of a
# panel in inches.
MOST, ABREAST, FEW, HEIGHT = 12, 3, 4, 1.75
LOWEST, TALLEST = 0.6, 2.4
# Largest displacement of a point in a mode relative to the extent of the scene, and
# largest change of a coordinate in a model without one.
DISPLACED, CHANGED = 0.15, 0.3
# A small change, for the displacement of points by a mode.
SMALL_CHANGE = 1e-6
# Free room around the scene of a panel.
FREE = 1.15


class Still(NamedTuple):
    """Panel of a picture that shows a scene in some states.

    Attributes
    ----------
    title : str
    film : Film or None
        The scene, with one frame for each state.
    pens : sequence of Pen
        The pen of each state.
    """

    title: str
    film: Film | None
    pens: Sequence[Pen]


def film_at(
    model: Model,
    values: Mapping[str, float | Floats],
    count: int,
    t: Floats | None = None,
    name: str = "",
) -> Film | None:
    """Return the scene of a model in some states, as the frames of a film.

    None if the model has no scene.

    Parameters
    ----------
    model : Model
    values : mapping of str to float or ndarray, shape (count,)
        The values of all variables in each state.
    count : int
        Number of states.
    t : ndarray, shape (count,), optional
        Times of the states on a page.
    name : str
    """
    scene, g = stage(model), model.graph
    if not scene.dimension:
        return None
    names = needed(model) | g.depends(x for p in scene.points.values() for x in p)
    known: dict[str, float | Floats] = dict.fromkeys(names, 0.0)
    known |= {p.name: p.value for p in model.parameters} | dict(values)
    t = np.arange(float(count)) if t is None else t
    tracks = {}
    for label, parts in scene.points.items():
        place = np.zeros((count, scene.dimension))
        place[:, : len(parts)] = evaluate_rows(g, parts, known, count).T
        rate = np.zeros_like(place)
        if count > 1:
            rate = np.asarray(np.gradient(place, t, axis=0))
        tracks[label] = Track(place, rate)
    rows = {
        label: np.broadcast_to(np.asarray(known[label], float), (count,))
        for label in needed(model)
        if label in known
    }
    shapes = bodies(model, rows, count) if scene.shapes else []
    return Film(
        name, model.description, t, np.zeros(count, bool), tracks, scene.links,
        scene.looks, string_lengths(model), shapes,
    )  # fmt: skip


def displaced(
    model: Model,
    values: Mapping[str, float],
    shape: Mapping[str, complex],
    phases: Floats,
) -> dict[str, float | Floats]:
    """Return the values of all variables in a mode of oscillation, at some phases.

    The amplitude is chosen such that the largest displacement of a point is a fixed
    part of the extent of the scene.

    Parameters
    ----------
    model : Model
    values : mapping of str to float
        Of all variables at rest.
    shape : mapping of str to complex
        Coordinate -> its amplitude.
    phases : ndarray, shape (rows,)
        Phases of the oscillation in rad; the result has arrays of this shape.
    """
    turns = np.exp(1j * phases)
    waves = {name: np.real(x * turns) for name, x in shape.items()}
    sizes = [max(1.0, abs(values[name])) for name in shape]
    largest = max(abs(x) / s for x, s in zip(shape.values(), sizes, strict=True))
    part = CHANGED / (largest or 1.0)
    small = np.linspace(0.0, 2.0 * np.pi, 5)[:4]
    moved = {
        name: values[name] + SMALL_CHANGE * np.real(x * np.exp(1j * small))
        for name, x in shape.items()
    }
    film = film_at(model, {**values, **moved}, 4)
    if film is not None:
        whole = float(np.max(np.ptp(_places(film), axis=(0, 1)))) or 1.0
        for turns in (False, True):
            extent = np.ptp(_places(film, turns=turns), axis=0)
            far = np.max(np.linalg.norm(extent, axis=-1), initial=0.0) / 2.0
            if far > COMPUTED_ZERO * SMALL_CHANGE * whole:
                part = DISPLACED * whole * SMALL_CHANGE / far
                break
    return {**values, **{n: values[n] + part * wave for n, wave in waves.items()}}


# Shapes whose turning about their middle shows in a spoke alone.
ROUND = ("disk", "ring", "sphere")


def _places(film: Film, *, turns: bool = True) -> Floats:
    """Return the places of points and of corners, shape (rows, places, components).

    Round shapes contribute their middles only, unless `turns`.
    """
    rows = np.arange(len(film.t))
    found = [track.place[:, None] for track in film.tracks.values()]
    for body in film.shapes:
        if body.height is None:
            at = np.minimum(rows, len(body.at) - 1)
            corners = body.corners if len(body.corners) == 1 else body.corners[at]
            if body.shape.kind in ROUND and not turns:
                corners = np.zeros_like(corners[:, :1])
            placed = corners @ body.axes[at].swapaxes(1, 2) + body.at[at][:, None]
            found.append(np.broadcast_to(placed, (len(rows), *placed.shape[1:])))
    return np.concatenate(found, axis=1)


# Pens of the state itself, and of the two extremes of a mode.
MIDDLE: Pen = {"color": DIM, "linewidth": 0.6}
EXTREMES: tuple[Pen, Pen] = ({**PENS[0], "linewidth": 1.1}, PENS[1])


@in_house_style
def stills(
    title: str, subject: str, panels: Sequence[Still], legend: Sequence[Entry] = ()
) -> Picture:
    """Draw the scene in each panel, with one scale for all.

    Parameters
    ----------
    title, subject : str
        Written as `title: subject`.
    panels : sequence of Still
        The panels, of which the first `MOST` are drawn.
    legend : sequence of (str, Pen)
    """
    shown = panels[:MOST]
    columns = max(1, len(shown) if len(shown) <= FEW else ABREAST)
    rows = -(-len(shown) // columns)
    notes = [f"{len(panels) - MOST} more"] if len(panels) > MOST else []
    films = [still.film for still in shown if still.film is not None]
    view = OBLIQUE if films and films[0].dimension == 3 else np.eye(2)
    ends = [_ends(film, view) for film in films]
    whole = (
        [finite_range(np.array([e[k] for e in ends])) for k in (0, 1)] if ends else []
    )
    width = WIDTH / max(columns, 1) - APART
    across, up = (high - low for low, high in whole)
    each = min(TALLEST, max(LOWEST, width * up / across if across else TALLEST))
    height = rows * (APART + each) + APART
    picture = Picture(height, title, subject, legend=legend, notes=notes)
    grid = picture.subplots(rows, columns, squeeze=False)
    for axes, still in zip(grid.flat, shown, strict=False):
        axes.set_title(mathtext(still.title), size=SMALL)
        axes.grid(visible=False)
        axes.tick_params(labelbottom=False, labelleft=False)
        if still.film is not None:
            picture.adjust.append(partial(_set_scale, axes, whole))
            picture.when_placed(_draw, axes, still, view)
    for axes in grid.flat[len(shown) :]:
        axes.remove()
    return picture


def _ends(film: Film, view: Floats) -> list[tuple[float, float]]:
    places = [track.place for track in film.tracks.values()]
    flat = reached(places, film.shapes) @ view.T
    return [finite_range(flat[:, k]) for k in (0, 1)]


def _set_scale(axes: Axes, ends: Sequence[tuple[float, float]]) -> None:
    """Set one scale for both axes of a panel, with a free margin.

    ends : the ranges of the horizontal and vertical axis.
    """
    each = FREE * per_inch(axes, ends)
    set_equal_scales(axes, ends, each if each > 0.0 else 1.0)


def _draw(axes: Axes, still: Still, view: Floats) -> None:
    """Draw each state of a panel with its pen.

    view : (2, d), directions to the right and up.
    """
    film = still.film
    assert film is not None
    kinds = film.looks or ("",) * len(film.links)
    extents = [finite_range(_places(film)[..., k]) for k in range(film.dimension)]
    for row, pen in enumerate(still.pens):
        first = row == 0
        for body in film.shapes:
            if row and not body.moves:
                continue
            style = pen | ({"color": DIM, "linewidth": 0.7} if not body.moves else {})
            if body.height is not None:
                plane(axes, view, body.height, extents)
            elif (found := projected(body, row, view)) is not None:
                for face, _ in found.faces if first and body.moves else ():
                    patch = Polygon(face, facecolor=style["color"], alpha=0.12)
                    axes.add_artist(patch)
                empty = found.hidden[:0]
                edges(axes, found.lines, empty, body, style | {"zorder": 1.8})
        flat = {name: view @ x.place[row] for name, x in film.tracks.items()}
        for (a, b), look_of in zip(film.links, kinds, strict=True):
            ends = np.stack((flat[a], flat[b]))
            if first and look_of in LOOKS:
                ends = LOOKS[look_of](ends[0], ends[1], inch_of(axes))
            line(axes, ends[:, 0], ends[:, 1], pen)
        for name, place in flat.items():
            still_there = (
                len(film.t) > 1 and not np.ptp(film.tracks[name].place, axis=0).any()
            )
            style = (
                marker_pen("s", 2.2)
                if still_there
                else marker_pen("o", 2.6, pen["color"])
            )
            point(axes, place[0], place[1], style)


@in_house_style
def bars(title: str, subject: str, panels: Sequence[tuple[str, Floats]]) -> Picture:
    """Draw the amplitudes of the coordinates as bars, with a panel for each mode.

    panels : title and amplitudes of each.
    """
    shown = panels[:MOST]
    columns = len(shown) if len(shown) <= FEW else ABREAST
    rows = -(-len(shown) // columns)
    notes = [f"{len(panels) - MOST} more"] if len(panels) > MOST else []
    height = rows * (APART + HEIGHT) + BELOW_PANELS
    picture = Picture(height, title, subject, notes=notes)
    grid = picture.subplots(rows, columns, squeeze=False, sharey=True)
    for axes, (name, values) in zip(grid.flat, shown, strict=False):
        axes.set_title(mathtext(name), size=SMALL)
        places = np.arange(1, len(values) + 1)
        axes.axhline(0.0, color=INK, linewidth=0.5)
        style = marker_pen("o", 3.0 if len(values) < 30 else 1.5, PENS[0]["color"])
        axes.plot(places, values, **style | {"linestyle": "-", "linewidth": 0.7})
        axes.set_ylim(-1.15, 1.15)
        axes.set_xticks(places if len(values) < 12 else [1, len(values)])
    for axes in grid.flat[len(shown) :]:
        axes.remove()
    return picture
