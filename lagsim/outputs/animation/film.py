"""What moves: the points of a scene in every frame, their rates, and notes.

A model without a scene has one point where it has the names x and y (and z).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np

from lagsim.language.derivatives import tangent
from lagsim.language.evaluate import evaluate_rows
from lagsim.model.model import Level, Scene
from lagsim.outputs import ENERGIES
from lagsim.outputs.animation.pushes import Carriers, Push, reactions
from lagsim.run.observers.frames import Frames

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from collections.abc import Set as AbstractSet

    from lagsim.language.arrays import Flags, Floats
    from lagsim.mechanics.equations import Equations
    from lagsim.model.model import Model
    from lagsim.notes import Event

# The point of a model that has no scene.
ONLY = "point"
# Bytes of a page's numbers before they are written as text, which takes a third more.
ROOM = 1_900_000
# Frames beyond these show nothing more, and cells of them are memory.
MOST_FRAMES, MOST_CELLS = 1 << 15, 1 << 23
# What would go so many times through the scene from a frame to the next is not
# followed by its rate.
SWIFT = 3.0


class Track(NamedTuple):
    """Where a point is, and its velocity: (frames, components)."""

    place: Floats
    rate: Floats


class Film(NamedTuple):
    """The motion of a scene, frame by frame.

    Attributes
    ----------
    t : ndarray, shape (frames,)
    broken : ndarray of bool, shape (frames,)
        Up to the next frame positions go straight.
    tracks : dict of str to Track
    links : sequence of pairs of names
    pushes : sequence of Push
        The forces of constraints.
    energies : dict of str to ndarray, shape (frames,)
    events : sequence of Event
    struck : dict of str to names
        The points at which each constraint acts, where there are any.
    horizon : float
        No forecast beyond this time.
    units : dict of str to str
        Of `length`, `energy` and `force`, where they are known.
    notes : sequence of str
    """

    name: str
    description: str
    t: Floats
    broken: Flags
    tracks: Mapping[str, Track]
    links: Sequence[tuple[str, str]] = ()
    pushes: Sequence[Push] = ()
    energies: Mapping[str, Floats] = {}
    events: Sequence[Event] = ()
    struck: Mapping[str | None, Sequence[str]] = {}
    horizon: float = math.inf
    units: Mapping[str, str] = {}
    notes: Sequence[str] = ()


def stage(model: Model) -> Scene:
    """Return the scene of a model; where the file has none, one point or nothing."""
    if model.scene.points:
        return model.scene
    nodes = {c.name: model.graph.variable(c.name) for c in model.coordinates}
    nodes |= {d.name: d.node for d in model.definitions if d.level is not Level.OUTPUT}
    if "x" not in nodes or "y" not in nodes:
        return Scene({})
    return Scene({ONLY: tuple(nodes[name] for name in "xyz" if name in nodes)})


def frames_of(equations: Equations, columns: Sequence[str]) -> Frames:
    """Return what keeps of rows with `columns` what a film of the model needs."""
    scene = stage(equations.model)
    names = ["t", *equations.q, *equations.velocities, *equations.accelerations]
    names += equations.multipliers
    known = frozenset(columns)
    names += ENERGIES
    names += [f"reaction.{name}" for name in equations.model.output.reactions]
    names = [name for name in names if name in known]
    # Positions and rates; forces, at two points at most; time and energies.
    parts = sum(len(c) for c in scene.points.values())
    words = 2 * parts + 6 * len(equations.multipliers) + 2 + len(ENERGIES)
    most = min(MOST_FRAMES, ROOM // (4 * words), MOST_CELLS // len(names))
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
    """Return the motion of a model's scene; None where there is nothing to draw.

    Parameters
    ----------
    frames : Frames
        Those of `frames_of`, after the run.
    units : dict of str to str
        Of columns.
    """
    model, scene = equations.model, stage(equations.model)
    table = frames.table
    if not scene.points or not len(table):
        return None
    columns = {name: table[:, k] for k, name in enumerate(frames.names)}
    values: dict[str, float | Floats] = {p.name: p.value for p in model.parameters}
    values |= columns
    tracks = _tracks(equations, scene, values, len(table))
    with np.errstate(all="ignore"):
        carriers = Carriers(equations, scene, values, len(table))
        pushes = [*carriers.pushes(), *reactions(model, scene, columns)]
        broken = frames.broken | _swift(tracks, columns["t"])
    if frames.stride > 1:
        thinned = f"one of {frames.stride} rows; positions between are interpolated"
        notes = [*notes, thinned]
    return Film(
        model.name, model.description, columns["t"], broken, tracks, scene.links,
        pushes, {k: columns[k] for k in ENERGIES if k in columns}, events,
        carriers.struck, horizon, _units(scene, units or {}), notes,
    )  # fmt: skip


def _units(scene: Scene, known: Mapping[str, str]) -> dict[str, str]:
    """Return the units of what a page shows, from those of columns."""
    columns = [
        f"point.{name}.{k + 1}"
        for name, x in scene.points.items()
        for k in range(len(x))
    ]
    if not known.keys() & set(columns):
        columns = list("xyz")
    return page_units({known.get(c, "") for c in columns}, known.get("energy", ""))


def page_units(lengths: AbstractSet[str], energy: str) -> dict[str, str]:
    """Return the units of a page; that of a force follows."""
    [length, *others] = sorted(set(lengths) - {""}) or [""]
    length = "" if others else length
    force = "N" if (energy, length) == ("J", "m") else ""
    return {"length": length, "energy": energy, "force": force}


def _tracks(
    e: Equations, scene: Scene, values: Mapping[str, float | Floats], count: int
) -> dict[str, Track]:
    """Evaluate the points and their rates; a plane lies at z = 0 of a space."""
    g = e.graph
    nodes = [node for parts in scene.points.values() for node in parts]
    seed = {g.variable("t"): g.one}
    for names in ((e.q, e.velocities), (e.velocities, e.accelerations)):
        seed |= {g.variable(a): g.variable(b) for a, b in zip(*names, strict=True)}
    rates = tangent(g, nodes, seed)
    found = evaluate_rows(g, [*nodes, *rates], values, count)
    dimension = max(len(parts) for parts in scene.points.values())
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
    """Tell what no rate follows up to the next frame."""
    steps = np.append(np.diff(t), 0.0)[:, np.newaxis]
    size = extent(tracks)
    found = np.zeros(len(t), dtype=bool)
    for track in tracks.values():
        moved = np.abs(track.rate) * steps > SWIFT * size
        found |= (moved | ~np.isfinite(track.rate)).any(axis=1)
    return found


def extent(tracks: Mapping[str, Track]) -> float:
    """Return the longest side of what the points pass through."""
    every = np.concatenate([track.place for track in tracks.values()])
    every = every[np.isfinite(every).all(axis=1)]
    return float(np.ptp(every, axis=0).max()) if len(every) else 0.0


# --- The motion of one point, from the columns of a table


def film_of_columns(
    name: str, columns: Mapping[str, Floats], events: Sequence[Event], **more: Any
) -> Film | None:
    """Return the motion of the point (x, y) or (x, y, z); None without these columns.

    Its rate is that of the columns x_dot, y_dot, ... where there are all of them; else
    it follows from the rows, on each side of an impact by itself.

    Parameters
    ----------
    more
        Further attributes of the film.
    """
    if not {"t", "x", "y"} <= columns.keys():
        return None
    axes = [axis for axis in "xyz" if axis in columns]
    rates = [f"{axis}_dot" for axis in axes]
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
    """Return the rates of rows, by parabolas; nan where a row stands alone."""
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
