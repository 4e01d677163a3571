"""Shapes of a scene in rows of a run: corners, faces and edges, for any picture.

A body of space is a polyhedron: seen along parallel lines, a face is in front where its
corners go round against the clock. An edge between faces is seen where one of these
is; the outline of what is round is where a face in front meets one behind.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lagsim.language.derivatives import tangent
from lagsim.language.evaluate import evaluate_rows
from lagsim.model.model import CURVE

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from lagsim.language.arrays import Floats
    from lagsim.model.model import Model, Shape

# Corners of what is round: of a face, and of the outline of a cylinder or a cone.
ROUND, AROUND = 72, 32
# Of a curve, and of one that changes its shape.
ALONG, CHANGING = 1000, 64
# Rows in which it is looked how far a shape reaches.
ROWS = 500


# Of a track whose rate is not known.
NO_RATE = np.empty(0)


class Track(NamedTuple):
    """Places and their rates, (rows, ...) each; `NO_RATE` where they are not known."""

    place: Floats
    rate: Floats = NO_RATE


class Mesh(NamedTuple):
    """Corners (n, d) in the axes of a shape, and what joins them.

    Attributes
    ----------
    faces : list of list of int
        The corners of each, against the clock for who sees it from outside.
    edges : list of (int, int, int, int)
        Two corners, and the faces between which they are; -1 where there is none.
    seams : list of (int, int, int, int)
        Edges between flat parts of what is round.
    """

    corners: Floats
    faces: list[list[int]]
    edges: list[tuple[int, int, int, int]]
    seams: list[tuple[int, int, int, int]]


class Body(NamedTuple):
    """A shape in some rows.

    Attributes
    ----------
    at : Track of (rows, d)
    axes : Track of (rows, d, d)
    corners : Track of (rows, n, d), in these axes; of one row where they do not change.
    moves : whether it does.
    radius : of a sphere, else 0.
    """

    shape: Shape
    at: Track
    axes: Track
    corners: Track
    mesh: Mesh
    moves: bool
    radius: float = 0.0

    def placed(self, rows: list[int] | NDArray[np.intp]) -> Floats:
        """Return the corners in the scene (rows, n, d)."""
        corners = self.corners.place
        corners = corners[rows] if len(corners) > 1 else corners
        turned = corners @ self.axes.place[rows].swapaxes(1, 2)
        placed: Floats = self.at.place[rows][:, np.newaxis] + turned
        return placed


def needed(model: Model) -> frozenset[str]:
    """Return the columns of which shapes are made."""
    g, shapes = model.graph, model.scene.shapes
    found = g.depends([node for shape in shapes for node in shape.nodes])
    return found - {p.name for p in model.parameters} - {CURVE}


def words(model: Model) -> int:
    """Return how many numbers a row of the shapes that move has, rates among them."""
    g, d, found = model.graph, model.scene.dimension, 0
    fixed = {p.name for p in model.parameters} | {CURVE}
    for shape in model.scene.shapes:
        found += 2 * d * (bool(shape.at) + (d - 1) * bool(shape.axes))
        if any(g.depends(corner) - fixed for corner in shape.corners):
            many = {"curve": CHANGING, "arrow": 2}
            found += d * many.get(shape.kind, 2 * len(shape.corners))
    return found


def bodies(
    model: Model,
    columns: Mapping[str, Floats],
    count: int,
    seed: Mapping[int, int] | None = None,
) -> list[Body]:
    """Return the shapes of a model in rows of a run.

    Parameters
    ----------
    columns
        Those that are `needed`, (count,) each.
    seed
        Nodes of variables, and of their rates: for rates of what is drawn.
    """
    # A constraint force without constraints has no column.
    values: dict[str, float | Floats] = dict.fromkeys(needed(model), 0.0)
    values |= {p.name: p.value for p in model.parameters}
    values |= columns
    return [_body(model, shape, values, count, seed) for shape in model.scene.shapes]


def _body(
    model: Model,
    shape: Shape,
    values: Mapping[str, float | Floats],
    count: int,
    seed: Mapping[int, int] | None,
) -> Body:
    g, d = model.graph, model.scene.dimension
    moves = bool(g.depends(shape.nodes) - {p.name for p in model.parameters} - {CURVE})

    def found(nodes: tuple[int, ...]) -> Track:
        place = evaluate_rows(g, nodes, values, count).T
        if seed is None or not moves:
            return Track(place)
        rates = tangent(g, nodes, seed)
        return Track(place, evaluate_rows(g, rates, values, count).T)

    sizes = evaluate_rows(g, shape.sizes, values, 1)[:, 0].tolist()
    at = _padded(found(shape.at), d)
    axes = _turned(found(shape.axes), d, count)
    radius = 0.0
    if not shape.corners:
        mesh = _mesh(shape.kind, sizes, turns=bool(shape.axes), d=d)
        corners = Track(mesh.corners[np.newaxis])
        radius = sizes[0] if shape.kind == "sphere" else 0.0
        return Body(shape, at, axes, corners, mesh, moves, radius)
    if shape.kind == "curve":
        corners = Track(_along(model, shape, values, count, sizes))
    elif shape.kind == "arrow":
        tip = evaluate_rows(g, shape.corners[0], values, count).T
        tip = tip * (sizes[0] if sizes else 1.0)
        corners = Track(np.stack((np.zeros_like(tip), tip), axis=1))
    else:
        tracks = [_padded(found(corner), d) for corner in shape.corners]
        place, rate = (np.stack(x, axis=-2) for x in zip(*tracks, strict=True))
        corners = Track(place, rate if rate.size else NO_RATE)
    corners = _still(_padded(corners, d))
    mesh = _polygon(corners.place[0], closed=shape.kind == "polygon")
    return Body(shape, at, axes, corners, mesh, moves)


def _padded(track: Track, d: int) -> Track:
    """Return places (..., d) of fewer components, which lie at 0 of the others."""

    def wide(x: Floats) -> Floats:
        return np.pad(x, [(0, 0)] * (x.ndim - 1) + [(0, d - x.shape[-1])])

    return Track(wide(track.place), wide(track.rate) if track.rate.size else NO_RATE)


def _turned(entries: Track, d: int, count: int) -> Track:
    """Return rotation matrices (rows, d, d) of their entries, or of no turn."""
    own = math.isqrt(entries.place.shape[-1])
    place = np.tile(np.eye(d), (count, 1, 1))
    rate = np.zeros_like(place) if entries.rate.size else NO_RATE
    place[:, :own, :own] = entries.place.reshape(count, own, own)
    if rate.size:
        rate[:, :own, :own] = entries.rate.reshape(count, own, own)
    return Track(place, rate)


def _still(track: Track) -> Track:
    """Return one row of what is the same in all."""
    first = track.place[:1]
    same = np.broadcast_to(first, track.place.shape)
    return Track(first) if np.array_equal(track.place, same) else track


# --- Curves


def _along(
    model: Model,
    shape: Shape,
    values: Mapping[str, float | Floats],
    count: int,
    ends: list[float],
) -> Floats:
    """Return the corners of a curve (rows or 1, n, components)."""
    g, nodes = model.graph, shape.corners[0]
    changes = g.depends(nodes) - {p.name for p in model.parameters} - {CURVE}
    rows = count if changes else 1
    s = np.linspace(ends[0], ends[1], CHANGING if changes else ALONG)
    known: dict[str, float | Floats] = {
        name: np.repeat(x[:rows], len(s)) if isinstance(x, np.ndarray) else x
        for name, x in values.items()
        if not isinstance(x, np.ndarray) or name in changes
    }
    known[CURVE] = np.tile(s, rows)
    return evaluate_rows(g, nodes, known, rows * len(s)).T.reshape(rows, len(s), -1)


# --- Bodies


def _polygon(corners: Floats, *, closed: bool) -> Mesh:
    n = len(corners)
    edges = [(k, (k + 1) % n, -1, -1) for k in range(n - (not closed))]
    return Mesh(corners, [list(range(n))] if closed else [], edges, [])


def _circle(radius: float, count: int, d: int, z: float = 0.0) -> Floats:
    angle = 2.0 * np.pi / count * np.arange(count)
    found = np.full((count, d), z)
    found[:, 0], found[:, 1] = radius * np.cos(angle), radius * np.sin(angle)
    return found


def _mesh(kind: str, sizes: list[float], *, turns: bool, d: int) -> Mesh:
    """Return a body in its own axes; one that turns has a line that shows it."""
    if kind == "box":
        if len(sizes) == 2:
            corners = np.zeros((4, d))
            corners[:, :2] = 0.5 * np.array(sizes) * _SQUARE
            return _polygon(corners, closed=True)
        return _cuboid(sizes)
    if kind in ("disk", "ring"):
        mesh = _polygon(_circle(sizes[0], ROUND, d), closed=True)
        mesh = mesh._replace(faces=mesh.faces if kind == "disk" else [])
        return _spoke(mesh, np.zeros(d)) if turns else mesh
    if kind == "ground":  # a plane: the height of one place in it
        return Mesh(np.array([[0.0, 0.0, sizes[0]]]), [], [], [])
    if kind == "sphere":
        return _sphere(sizes[0], turns=turns)
    return _turned_body(kind, *sizes, turns=turns)


_SQUARE = np.array([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)])


def _spoke(mesh: Mesh, centre: Floats) -> Mesh:
    corners = np.concatenate((mesh.corners, centre[np.newaxis]))
    return mesh._replace(
        corners=corners, edges=[*mesh.edges, (len(mesh.corners), 0, -1, -1)]
    )


def _cuboid(sizes: list[float]) -> Mesh:
    corners = (
        np.array([(x, y, z) for z in (-0.5, 0.5) for x, y in 0.5 * _SQUARE]) * sizes
    )
    faces = [[3, 2, 1, 0], [4, 5, 6, 7]]
    faces += [[k, (k + 1) % 4, 4 + (k + 1) % 4, 4 + k] for k in range(4)]
    edges = [(k, (k + 1) % 4, 0, 2 + k) for k in range(4)]
    edges += [(4 + k, 4 + (k + 1) % 4, 1, 2 + k) for k in range(4)]
    edges += [(k, 4 + k, 2 + k, 2 + (k - 1) % 4) for k in range(4)]
    return Mesh(corners, faces, edges, [])


def _sphere(radius: float, *, turns: bool) -> Mesh:
    """Return great circles across the axes: of one that turns all, else the equator."""
    circle = _circle(radius, ROUND, 3)
    circles = [np.roll(circle, k, axis=1) for k in range(3 if turns else 1)]
    edges = [
        (ROUND * c + k, ROUND * c + (k + 1) % ROUND, -1, -1)
        for c in range(len(circles))
        for k in range(ROUND)
    ]
    return Mesh(np.concatenate(circles), [], edges, [])


def _turned_body(kind: str, radius: float, length: float, *, turns: bool) -> Mesh:
    """Return a cylinder about its middle, or a cone that stands on its tip."""
    n, cone = AROUND, kind == "cone"
    top = _circle(radius, n, 3, length if cone else 0.5 * length)
    low = np.zeros((1, 3)) if cone else _circle(radius, n, 3, -0.5 * length)
    corners = np.concatenate((top, low))
    below = [n if cone else n + k for k in range(n)]
    after = [(k + 1) % n for k in range(n)]
    faces = [list(range(n))]
    edges = [(k, after[k], 0, 1 + k) for k in range(n)]
    for k in range(n):
        side = [k, below[k], below[after[k]], after[k]]
        faces.append(list(dict.fromkeys(side)))
    seams = [(k, below[k], 1 + k, 1 + (k - 1) % n) for k in range(n)]
    if not cone:
        faces.append(below[::-1])
        edges += [(below[k], below[after[k]], n + 1, 1 + k) for k in range(n)]
    if turns:
        edges.append(seams[0])
        corners = np.concatenate((corners, [(0.0, 0.0, top[0, 2])]))
        edges.append((len(corners) - 1, 0, 0, 0))
    return Mesh(corners, faces, edges, seams)


# --- As seen from one side


class Seen(NamedTuple):
    """A body as it is seen: corners (n, 2) each.

    Attributes
    ----------
    faces : those in front, each with how much it is turned to who sees it, 0 to 1.
    lines, hidden : edges in front, and behind, as one path each, with gaps of nan.
    depth : how near its middle is.
    """

    faces: list[tuple[Floats, float]]
    lines: Floats
    hidden: Floats
    depth: float


def seen(body: Body, row: int, view: Floats) -> Seen | None:
    """Return a body in a row, seen with the rows of `view` (2, d) right and up.

    None where it is nowhere.
    """
    [corners] = body.placed([row])
    if not np.isfinite(corners).all() and body.shape.kind != "curve":
        return None
    flat = corners @ view.T
    near = np.cross(*view) if corners.shape[1] == 3 else np.zeros(2)
    depth = float((corners @ near).mean())
    front, faces = _fronts(corners, flat, body.mesh.faces)
    edges: dict[bool, list[tuple[int, int]]] = {True: [], False: []}
    for i, j, a, b in body.mesh.edges:
        ahead = front[a] or front[b]
        if body.radius:
            ahead = bool((corners[i] + corners[j]) @ near >= 2.0 * depth)
        edges[ahead].append((i, j))
    edges[True] += [(i, j) for i, j, a, b in body.mesh.seams if front[a] != front[b]]
    lines, hidden = (_path(flat, edges[ahead]) for ahead in (True, False))
    if body.radius:
        outline = body.at.place[row] @ view.T + _circle(body.radius, ROUND, 2)
        faces = [(outline, 1.0)]
        lines = np.concatenate((outline, outline[:1], np.full((1, 2), np.nan), lines))
    return Seen(faces, lines, hidden, depth)


def _path(flat: Floats, edges: list[tuple[int, int]]) -> Floats:
    """Return edges as one path (n, 2), with gaps between those that do not meet."""
    gap, found, last = np.full(2, np.nan), [], -1
    for i, j in edges:
        found += [flat[j]] if i == last else [gap, flat[i], flat[j]]
        last = j
    return np.array(found).reshape(-1, 2)


def _fronts(
    corners: Floats, flat: Floats, faces: list[list[int]]
) -> tuple[list[bool], list[tuple[Floats, float]]]:
    """Return which faces are in front, -1 being one; and these, in order."""
    front, found = [], []
    for face in faces:
        turned = _area(flat[face])[-1]
        whole = float(np.linalg.norm(_area(corners[face])))
        front.append(turned > 0.0 or len(faces) == 1)
        if front[-1]:
            found.append((flat[face], abs(turned) / whole if whole else 0.0))
    return [*front, True], found


def _area(corners: Floats) -> Floats:
    """Return the vector of the area of a polygon (n, d), of a plane its one part."""
    beside = np.roll(corners, -1, axis=0)
    if corners.shape[1] == 2:
        (x, y), (u, v) = corners.T, beside.T
        return 0.5 * np.array([np.sum(x * v - y * u)])
    area: Floats = 0.5 * np.cross(corners - corners[0], beside - corners[0]).sum(axis=0)
    return area


def reached(places: Sequence[Floats], bodies: Sequence[Body]) -> Floats:
    """Return finite places (n, d) of points and of bodies, in rows enough for these."""
    d = places[0].shape[-1] if places else bodies[0].at.place.shape[-1]
    found, heights = [np.empty((0, d)), *places], []
    for body in bodies:
        last = len(body.at.place) - 1
        rows = np.unique(np.linspace(0, last, ROWS if body.moves else 1).astype(int))
        if body.shape.kind == "ground" and not body.shape.corners:
            heights.append(body.mesh.corners[0, 2])
        elif body.radius:
            ends = body.at.place[rows]
            found += [ends - body.radius, ends + body.radius]
        else:
            found.append(body.placed(rows).reshape(-1, d))
    every = np.concatenate(found)
    every = every[np.isfinite(every).all(axis=1)]
    middle = every.mean(axis=0) if len(every) else np.zeros(d)
    under = [(*middle[:2], z) for z in heights]
    return np.concatenate((every, np.reshape(under, (-1, d))))
