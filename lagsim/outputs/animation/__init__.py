"""The animation of a run: an HTML page without external files, see docs/animation.md.

First the motion is computed: points of a scene and the forces on these points
(`carriers`) in every frame. A model without a scene has one point if it has the names x
and y (and z).

Then the page is written: one file with its data, style and script.
"""

from __future__ import annotations

import base64
import html
import json
import math
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np

from lagsim.codes.known import NOTHING_TO_DRAW
from lagsim.language.columns import REACTION
from lagsim.language.derivatives import tangent
from lagsim.language.evaluate import evaluate_rows
from lagsim.language.names import rate_of
from lagsim.model.model import Level, Scene
from lagsim.notes import Caution
from lagsim.outputs import ENERGIES
from lagsim.outputs.animation.carriers import Carriers, Push, reactions
from lagsim.outputs.plot_data import merged
from lagsim.outputs.shapes import (
    bodies,
    needed,
    reached,
    string_lengths,
    values_per_row,
)
from lagsim.run.observers.thinning import Frames
from lagsim.tolerances import COMPUTED_ZERO, SATISFIED

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from collections.abc import Set as AbstractSet

    from lagsim.language.arrays import Flags, Floats
    from lagsim.mechanics.equations import Equations
    from lagsim.model.model import Model
    from lagsim.notes import Event
    from lagsim.outputs.shapes import Body

NAME = "animation.html"
# The point of a model that has no scene.
ONLY = "point"
# Bytes of a page's numbers before they are written as text, which takes a third more.
ROOM = 1_900_000
# More frames are not distinguishable, and cells of frames take memory.
MOST_FRAMES, MOST_CELLS = 1 << 15, 1 << 23
# A component whose rate would carry it this many times through the scene between two
# frames is not interpolated by its rate.
SWIFT = 3.0


class Track(NamedTuple):
    """Motion of a point of the scene.

    Attributes
    ----------
    place, rate : ndarray, shape (frames, components)
        Positions and velocities.
    """

    place: Floats
    rate: Floats


class Film(NamedTuple):
    """The motion of a scene, frame by frame.

    Attributes
    ----------
    name, description : str
        Name and description of the model.
    t : ndarray, shape (frames,)
    broken : ndarray of bool, shape (frames,)
        Whether positions are interpolated linearly up to the next frame.
    tracks : dict of str to Track
    links : sequence of pairs of names
    looks : sequence of str
        Kind of each link, as in `model.model.Scene`, "" where its length determines the
        kind; () means all "".
    lengths : sequence of float or None
        Stated length of each link that is a string; () means no stated lengths.
    shapes : sequence of Body
    pushes : sequence of Push
        The forces of constraints.
    energies : dict of str to ndarray, shape (frames,)
    events : sequence of Event
    struck : dict of str to tuple of str
        Constraint -> names of the points on which its force acts, if known.
    horizon : float
        Time past which the motion is no forecast.
    units : dict of str to str
        Units of `length`, `energy` and `force`, if known.
    notes : sequence of str
        Texts below the controls of the page.
    """

    name: str
    description: str
    t: Floats
    broken: Flags
    tracks: Mapping[str, Track]
    links: Sequence[tuple[str, str]] = ()
    looks: Sequence[str] = ()
    lengths: Sequence[float | None] = ()
    shapes: Sequence[Body] = ()
    pushes: Sequence[Push] = ()
    energies: Mapping[str, Floats] = {}
    events: Sequence[Event] = ()
    struck: Mapping[str | None, Sequence[str]] = {}
    horizon: float = math.inf
    units: Mapping[str, str] = {}
    notes: Sequence[str] = ()

    @property
    def dimension(self) -> int:
        """Number of components of a place; 2 where nothing is drawn."""
        if not self.tracks and not self.shapes:
            return 2
        places = [track.place for track in self.tracks.values()]
        return int([*places, *(body.at for body in self.shapes)][0].shape[1])


def stage(model: Model) -> Scene:
    """Return the scene of a model, or a scene of the point (x, y) or (x, y, z).

    The second one serves models without a scene; its dimension is 0 if there are no
    variables x and y.
    """
    if model.scene.points or model.scene.shapes:
        return model.scene
    nodes = {c.name: model.graph.variable(c.name) for c in model.coordinates}
    nodes |= {d.name: d.node for d in model.definitions if d.level is not Level.OUTPUT}
    if "x" not in nodes or "y" not in nodes:
        return Scene({})
    return Scene({ONLY: tuple(nodes[name] for name in "xyz" if name in nodes)})


def nothing_to_draw(model: Model) -> list[Caution]:
    """Return the warning that a model has no animation, in a list; [] if it has one."""
    if stage(model).dimension:
        return []
    text = (
        f"there is no {NAME}: {model.name} has nothing to draw; add a `scene` with "
        "points, or definitions x and y (and z)"
    )
    return [Caution(NOTHING_TO_DRAW, text)]


def frames_of(equations: Equations, columns: Sequence[str]) -> Frames:
    """Return the observer of a run that stores the frames from which `film` is made.

    Parameters
    ----------
    equations : Equations
    columns : sequence of str
        Columns of the rows that the observer will receive.
    """
    scene = stage(equations.model)
    names = ["t", *equations.state, *equations.accelerations]
    names += [*equations.multipliers, *sorted(equations.model.modes)]
    known = frozenset(columns)
    names += ENERGIES
    names += [REACTION.of(name) for name in equations.model.output.reactions]
    names += sorted(needed(equations.model).difference(names))
    names = [name for name in names if name in known]
    # Positions and rates; forces, at two points at most; time and energies.
    parts = sum(len(c) for c in scene.points.values())
    many = 2 * parts + 6 * len(equations.multipliers) + 2 + len(ENERGIES)
    many += values_per_row(equations.model)
    most = min(MOST_FRAMES, ROOM // (4 * many), MOST_CELLS // len(names))
    return Frames(columns, names, most)


def film(
    equations: Equations,
    frames: Frames,
    events: Sequence[Event],
    *,
    horizon: float = math.inf,
    units: Mapping[str, str] | None = None,
    notes: Sequence[str] = (),
) -> Film | None:
    """Return the motion of a model's scene; None if there is nothing to draw.

    Parameters
    ----------
    equations : Equations
    frames : Frames
        The result of `frames_of`, after the run.
    events : sequence of Event
    horizon : float
        Time past which the motion is no forecast.
    units : mapping of str to str, optional
        Units of columns.
    notes : sequence of str
        Texts below the controls of the page.
    """
    model, scene = equations.model, stage(equations.model)
    table = frames.table
    if not scene.dimension or not len(table):
        return None
    columns = {name: table[:, k] for k, name in enumerate(frames.names)}
    values: dict[str, float | Floats] = {p.name: p.value for p in model.parameters}
    values |= columns
    tracks = _tracks(equations, scene, values, len(table))
    shapes = bodies(model, columns, len(table)) if scene.shapes else []
    with np.errstate(all="ignore"):
        carriers = Carriers(equations, scene, values, len(table))
        pushes = [*carriers.pushes, *reactions(model, scene, columns)]
        broken = frames.broken | _swift(tracks, columns["t"])
    if frames.stride > 1:
        thinned = f"one of {frames.stride} rows; positions between are interpolated"
        notes = [*notes, thinned]
    return Film(
        model.name, model.description, columns["t"], broken, tracks, scene.links,
        scene.looks, string_lengths(model), shapes, pushes,
        {k: columns[k] for k in ENERGIES if k in columns}, events,
        carriers.struck, horizon, _units(scene, units or {}), notes,
    )  # fmt: skip


def _units(scene: Scene, known: Mapping[str, str]) -> dict[str, str]:
    """Return the units of lengths, energies and forces on a page.

    known : units of columns by name.
    """
    columns = [
        f"point.{name}.{k + 1}"
        for name, x in scene.points.items()
        for k in range(len(x))
    ]
    if scene.points.keys() == {ONLY}:
        columns = list("xyz")
    return page_units({known.get(c, "") for c in columns}, known.get("energy", ""))


def page_units(lengths: AbstractSet[str], energy: str) -> dict[str, str]:
    """Return the units on a page: length, energy, force; "" if unknown.

    lengths : the units of coordinates of points.
    energy : the unit of energies.

    Examples
    --------
    >>> page_units({"m", ""}, "J")
    {'length': 'm', 'energy': 'J', 'force': 'N'}
    """
    [length, *others] = sorted(set(lengths) - {""}) or [""]
    length = "" if others else length
    force = "N" if (energy, length) == ("J", "m") else ""
    return {"length": length, "energy": energy, "force": force}


def _tracks(
    e: Equations, scene: Scene, values: Mapping[str, float | Floats], count: int
) -> dict[str, Track]:
    """Return position and velocity of each point of a scene in some frames, by name.

    Components that a point lacks are 0.

    values : variables by name, numbers or arrays (count,).
    count : number of frames.
    """
    g = e.graph
    nodes = [node for parts in scene.points.values() for node in parts]
    accelerations = map(g.variable, e.accelerations)
    seed = e.flow.forward | dict(zip(e.flow.rates, accelerations, strict=True))
    rates = tangent(g, nodes, seed)
    found = evaluate_rows(g, [*nodes, *rates], values, count)
    dimension = scene.dimension
    tracks, k = {}, 0
    for name, parts in scene.points.items():
        place, rate = np.zeros((2, count, dimension))
        here = slice(k, k + len(parts))
        place[:, : len(parts)] = found[: len(nodes)][here].T
        rate[:, : len(parts)] = found[len(nodes) :][here].T
        tracks[name] = Track(place, rate)
        k += len(parts)
    return tracks


def _swift(tracks: Mapping[str, Track], t: Floats) -> Flags:
    """Return a mask (frames,) of the frames after which positions must be linear.

    There the interpolation from positions and rates of two frames would overshoot.

    t : (frames,), the times of the frames.
    tracks : positions and rates of the points.
    """
    steps = np.append(np.diff(t), 0.0)[:, np.newaxis]
    size = longest_side(tracks)
    found = np.zeros(len(t), dtype=bool)
    for track in tracks.values():
        moved = np.abs(track.rate) * steps > SWIFT * size
        found |= (moved | ~np.isfinite(track.rate)).any(axis=1)
    return found


def longest_side(tracks: Mapping[str, Track]) -> float:
    """Return the longest side of the bounding box of the points of all tracks."""
    if not tracks:
        return 0.0
    every = reached([track.place for track in tracks.values()], [])
    return float(np.ptp(every, axis=0).max()) if len(every) else 0.0


# --- The motion of one point, from the columns of a table


def film_of_columns(
    name: str, columns: Mapping[str, Floats], events: Sequence[Event], **more: Any
) -> Film | None:
    """Return the motion of the point (x, y) or (x, y, z); None without these columns.

    The velocity is read from the columns x_dot, y_dot, ... if all exist; else it is a
    finite difference of rows, separately on each side of an impact.

    Parameters
    ----------
    name : str
    columns : mapping of str to ndarray, shape (rows,)
    events : sequence of Event
    **more
        Further attributes of the film.
    """
    if not {"t", "x", "y"} <= columns.keys():
        return None
    axes = [axis for axis in "xyz" if axis in columns]
    rates = list(map(rate_of, axes))
    known = set(rates) <= columns.keys()
    names = ["t", *axes, *(rates if known else ())]
    names += [energy for energy in ENERGIES if energy in columns]
    frames = Frames(names, names, MOST_FRAMES)
    frames.add(np.stack([columns[name] for name in names], axis=1))
    kept = dict(zip(names, frames.table.T, strict=True))
    place = np.stack([kept[axis] for axis in axes], axis=1)
    if known:
        rate = np.stack([kept[name] for name in rates], axis=1)
    else:
        rate = _slopes(kept["t"], place)
    return Film(
        name, "", kept["t"], frames.broken | ~np.isfinite(rate).all(axis=1),
        {ONLY: Track(place, rate)},
        energies={k: kept[k] for k in ENERGIES if k in kept}, events=events, **more,
    )  # fmt: skip


def _slopes(t: Floats, place: Floats) -> Floats:
    """Return the derivatives of `place` (rows, d) by t (rows,), from parabolas.

    Rows between two impacts are one piece; a piece of a single row has nan.
    """
    rate = np.full_like(place, np.nan)
    ends = [*(np.flatnonzero(np.diff(t) == 0.0) + 1), len(t)]
    first = 0
    for end in ends:
        rows = slice(first, end)
        if end - first > 1:
            edge: Literal[1, 2] = 2 if end - first > 2 else 1
            rate[rows] = np.gradient(place[rows], t[rows], axis=0, edge_order=edge)
        first = end
    return rate


def film_of_energies(
    name: str, columns: Mapping[str, Floats], events: Sequence[Event]
) -> Film:
    """Return the film of a model that has nothing to draw: its energies and events.

    Parameters
    ----------
    name : str
    columns : mapping of str to ndarray, shape (rows,)
    events : sequence of Event
    """
    t = columns["t"]
    energies = {k: columns[k] for k in ENERGIES if k in columns}
    nothing = np.zeros(len(t), dtype=bool)
    return Film(name, "", t, nothing, {}, energies=energies, events=events)


# --- The page

# In this order: each script uses the ones before it.
COMMON = ("motion.js", "view.js", "draw.js", "panel.js", "player.js")
SCRIPTS = (*COMMON, "page.js")
# A self-contained page loads no other resource.
CLOSED = "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; "
# The data of a page, for `recorded`.
_DATA = re.compile(
    r'<script type="application/json" id="runs">(.*?)</script>', re.DOTALL
)
# Largest relative change of length of a rigid link; least part of the frames in which a
# link with a contact has its full length if it is a string.
RIGID, TAUT = 1e-3, 0.02
# A view shows the whole motion, unless its extent exceeds that between the percentiles
# 100 - MOST and MOST by the factor OUTLYING.
MOST, OUTLYING = 98.0, 20.0
# Largest distance of a visible floor below a view, relative to the size of the view.
NEAR = 0.1
# Largest number of events that can be distinguished on a time line.
MOST_EVENTS = 4000


def _thinned(events: Sequence[Event]) -> list[Event]:
    """Return MOST_EVENTS of more events: all rare ones, of frequent ones some.

    Events of one kind and name that are more than their share are evenly spaced.
    """
    own: dict[object, list[int]] = {}
    for k, e in enumerate(events):
        own.setdefault((e.kind, e.constraint, e.switch, e.name), []).append(k)
    kept, left = list[int](), MOST_EVENTS
    for i, places in enumerate(sorted(own.values(), key=len)):
        most = min(len(places), left // (len(own) - i))
        at = np.linspace(0, len(places) - 1, most).round().astype(int)
        kept += [places[k] for k in at.tolist()]
        left -= most
    return [events[k] for k in sorted(kept)]


@np.errstate(all="ignore")  # a diverging motion overflows
def record(film: Film) -> dict[str, Any]:
    """Return a film as JSON data for the script of the page; `page` joins such data."""
    size = longest_side(film.tracks)
    names = list(film.tracks)
    places = [track.place for track in film.tracks.values()]
    drawn = places or film.shapes
    every = reached(places, film.shapes) if drawn else np.empty((0, film.dimension))
    kinds = film.looks or ("",) * len(film.links)
    strings = film.lengths or (None,) * len(film.links)
    points: list[dict[str, Any]] = []
    for name, (place, rate) in film.tracks.items():
        finite = place[np.isfinite(place).all(axis=1)]
        still = (
            len(finite) == len(place)
            and np.ptp(finite, 0).max() <= COMPUTED_ZERO * size
        )
        found = {"fixed": place[0].tolist()} if still else {
            "place": _packed(place), "rate": _packed(rate),
        }  # fmt: skip
        points.append({"name": name, **found})
    events = merged(film.events)
    notes = list(film.notes)
    if len(events) > MOST_EVENTS:
        notes.append(
            f"{MOST_EVENTS} of {len(events)} events are marked, of frequent ones some"
        )
        events = _thinned(events)
    return {
        "name": film.name,
        "description": film.description,
        "t": _packed(film.t, "<f8"),
        "broken": np.flatnonzero(film.broken).tolist(),
        "dimension": film.dimension,
        "box": (box := _box(every)),
        "floor": _floor(film, every, box),
        "points": points,
        "links": [
            _link(film, names, link, kind, length)
            for link, kind, length in zip(film.links, kinds, strings, strict=True)
        ],
        "shapes": [_shape(body, names) for body in film.shapes],
        "pushes": [
            {"name": p.constraint, "point": names.index(p.point),
             "force": _packed(p.force), "usual": _usual(p.force)}
            for p in film.pushes
        ],
        "energies": {name: _packed(values) for name, values in film.energies.items()},
        "events": [
            {"t": e.time, "kind": e.kind,
             "what": e.constraint or e.switch or e.name or "",
             "points": [names.index(p) for p in film.struck.get(e.constraint, ())]}
            for e in events
        ],
        "horizon": film.horizon if math.isfinite(film.horizon) else None,
        "units": dict(film.units),
        "notes": notes,
    }  # fmt: skip


def _packed(values: Floats, kind: str = "<f4") -> str:
    """Return an array of numbers as base64 text, row by row.

    values : the array.
    kind : numpy's dtype in the text, such as `<f4`.
    """
    return base64.b64encode(np.ascontiguousarray(values, kind).tobytes()).decode()


def _usual(force: Floats) -> float:
    """Return a high percentile of |force| over frames, which scales the arrows.

    Unlike the maximum it is insensitive to spikes. It is 0 without a finite force.

    force : (frames, components), the force in each frame.
    """
    sizes = np.linalg.norm(force, axis=1)
    sizes = sizes[np.isfinite(sizes) & (sizes > 0)]
    return float(np.percentile(sizes, MOST)) if len(sizes) else 0.0


def _floor(film: Film, every: Floats, box: Sequence[Sequence[float]]) -> float | None:
    """Return the height of a floor below all points; None if it is out of sight.

    In space it is the height of the first ground of the scene, if there is one.

    film : whose scene can have a ground.
    every : positions of all points (k, d).
    box : least and greatest value of each component in the view.
    """
    if levels := [b.height for b in film.shapes if b.height is not None]:
        return levels[0]
    last = [track.place[:, -1] for track in film.tracks.values()]
    heights = np.concatenate([*last, every[:, -1]])
    lowest = float(heights[np.isfinite(heights)].min(initial=box[-1][0]))
    size = max(high - low for low, high in box)
    return lowest if lowest >= box[-1][0] - NEAR * size else None


def _box(every: Floats) -> list[list[float]]:
    """Return the least and greatest value of each component, for the view.

    Few places far from all others are left out.

    every : positions of all points (k, d).
    """
    if not len(every):
        return [[0.0, 0.0] for _ in range(every.shape[1])]
    low, high = every.min(axis=0), every.max(axis=0)
    usual = np.percentile(every, (100.0 - MOST, MOST), axis=0)
    if np.max(high - low) > OUTLYING * np.max(usual[1] - usual[0]) > 0:
        low, high = usual
    return [[float(a), float(b)] for a, b in zip(low, high, strict=True)]


def _shape(body: Body, names: Sequence[str]) -> dict[str, Any]:
    """Return a shape as JSON data; the script of the page computes the last axis.

    body : the shape in all frames.
    names : the names of the points of the film.
    """
    shape = body.shape
    axes = body.axes.swapaxes(1, 2)[:, :-1]
    parts = {"at": body.at, "axes": axes, "corners": body.corners}
    return {
        "name": shape.name, "kind": shape.kind, "moves": body.moves,
        "point": names.index(shape.point) if shape.point else None,
        "carried": bool(shape.point) and bool(shape.at), "radius": body.radius,
        "faces": body.faces, "edges": body.edges, "seams": body.seams,
        **{key: _coded(place) for key, place in parts.items()},
    }  # fmt: skip


def _coded(place: Floats) -> dict[str, str]:
    """Return an array (frames, ...) as JSON data: base64 text under a key.

    The key is `place`; it is `fixed`, with one row, if all rows are equal.
    """
    same = np.array_equal(place, np.broadcast_to(place[:1], place.shape))
    return {"fixed" if same else "place": _packed(place[0] if same else place)}


def _link(
    film: Film,
    names: Sequence[str],
    link: tuple[str, str],
    style: str,
    length: float | None,
) -> dict[str, Any]:
    """Return a link as JSON data.

    names : points of the film.
    link : the points at its ends.
    style : the kind of the link; by default it follows from the lengths of the link in
        the motion.
    length : stated length of a string, or None.
    """
    a, b = link
    vector = film.tracks[a].place - film.tracks[b].place
    lengths = np.linalg.norm(vector, axis=1)
    lengths = lengths[np.isfinite(lengths)]
    lengths = lengths if len(lengths) else np.zeros(1)
    longest = float(lengths.max()) if length is None else length
    kind = "spring"
    if style:
        kind = style
    elif float(lengths.min()) >= (1.0 - RIGID) * longest:
        kind = "rod"
    elif any({a, b} & set(points) for points in film.struck.values()):
        taut = np.mean(lengths >= (1.0 - SATISFIED) * longest)
        kind = "string" if taut > TAUT else "spring"
    ends, usual = (names.index(a), names.index(b)), float(np.median(lengths))
    return {"ends": ends, "kind": kind, "longest": longest, "usual": usual}


def page(runs: Sequence[Mapping[str, Any]], title: str) -> bytes:
    """Return the HTML page on which runs play side by side, on one clock.

    runs : the films of the runs, as of `record`.
    """
    data = json.dumps(runs, ensure_ascii=False, separators=(",", ":"), allow_nan=False)
    # The data must not end the HTML element that contains it.
    data = data.replace("<", "\\u003c")
    return filled(
        title, kind="plays", script=wrapped(SCRIPTS), policy=CLOSED + "img-src data:",
        data=f'<script type="application/json" id="runs">{data}</script>\n',
    )  # fmt: skip


def page_part(name: str) -> str:
    """Return the text of a file that is a part of pages.

    name : the name of a file in this package.
    """
    return (Path(__file__).parent / name).read_text("utf-8")


def wrapped(scripts: Sequence[str]) -> str:
    """Return scripts as one script in a function, whose names are invisible outside.

    scripts : names of the files.
    """
    return "\n".join(['"use strict";', "(() => {", *map(page_part, scripts), "})();"])


def filled(
    title: str,
    *,
    kind: str,
    script: str,
    policy: str,
    styles: Sequence[str] = ("page.css",),
    more: str = "",
    data: str = "",
) -> bytes:
    """Return an HTML page from its parts.

    Parameters
    ----------
    title : str
    kind : str
        The class of the element `body`.
    script : str
    styles : sequence of str
        Names of the files of styles.
    policy : str
        The Content-Security-Policy within the page.
    more, data : str
        HTML elements before the controls, and before the script.
    """
    parts = {
        "TITLE": html.escape(title),
        "POLICY": policy,
        "KIND": kind,
        "MORE": more,
        "STYLE": "\n".join(map(page_part, styles)),
        "DATA": data,
        "SCRIPT": script,
    }
    whole = re.sub(
        r"\{\{([A-Z]+)\}\}", lambda found: parts[found[1]], page_part("page.html")
    )
    return whole.encode(errors="replace")


def recorded(content: str) -> list[dict[str, Any]] | None:
    """Return the films in the text of a page, as of `record`; None if it has none."""
    found = _DATA.search(content)
    if not found:
        return None
    try:
        runs = json.loads(found[1])
    except ValueError:
        return None
    return runs if isinstance(runs, list) else None
