"""Shapes of a scene in rows of a run: corners, faces and edges, for any picture.

A body in space is a polyhedron. In a parallel projection, a face is in front if its
corners are counterclockwise. An edge between two faces is visible if one of the faces
is in front; the outline of a round surface consists of edges between a face in front
and a face behind.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lagsim.language.evaluate import evaluate, evaluate_rows
from lagsim.model.model import CURVE

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from numpy.typing import NDArray

    from lagsim.language.arrays import Floats
    from lagsim.model.model import Model, Shape

    # Two corners, and the two faces that meet in the edge; -1: no face.
    Edges = list[tuple[int, int, int, int]]
    # Corners (n, d), faces, edges and seams.
    Mesh = tuple[Floats, list[list[int]], Edges, Edges]

# Number of corners of a circle: of a face, and of the outline of a cylinder or a cone.
ROUND, AROUND = 72, 32
# Number of points of a curve, and of a curve that changes its shape.
ALONG, CHANGING = 1000, 64
# Number of rows in which the extent of a shape is computed.
ROWS = 500


class Body(NamedTuple):
    """A shape in some rows: corners in axes of its own, with faces and edges.

    Attributes
    ----------
    shape : Shape
    at : ndarray, shape (rows, d)
        Origin; one row if the body is at rest.
    axes : ndarray, shape (rows, d, d)
        Rotation matrices: the body's axes are the columns.
    corners : ndarray, shape (rows or 1, n, d)
        Components along the body's axes; one row if they are constant.
    faces : list of list of int
        The corners of each face, counterclockwise as seen from outside.
    edges, seams : list
        Edges of faces, each as its two corners and the two faces that meet in it (-1:
        no face); seams are edges between flat parts of a round surface.
    moves : bool
        Whether the position, the axes or the corners change.
    radius : float
        Radius of a sphere, else 0.
    """

    shape: Shape
    at: Floats
    axes: Floats
    corners: Floats
    faces: list[list[int]]
    edges: Edges
    seams: Edges
    moves: bool
    radius: float = 0.0

    @property
    def height(self) -> float | None:
        """Height of a level ground in space; None for other bodies."""
        level = self.shape.kind == "ground" and not self.shape.corners
        return float(self.corners[0, 0, 2]) if level else None

    def placed(self, rows: Sequence[int] | NDArray[np.intp]) -> Floats:
        """Return the corners in the axes of the scene, in some rows, (rows, n, d).

        rows : the indices of these rows.
        """
        corners = self.corners if len(self.corners) == 1 else self.corners[rows]
        placed: Floats = corners @ self.axes[rows].swapaxes(1, 2)
        return placed + self.at[rows][:, np.newaxis]


def moving(model: Model, nodes: Iterable[int]) -> frozenset[str]:
    """Return the columns of the table on which the values of some nodes depend."""
    fixed = {p.name for p in model.parameters} - model.modes | {CURVE}
    return model.graph.depends(nodes) - fixed


def needed(model: Model) -> frozenset[str]:
    """Return the columns of the table on which the shapes of a model depend."""
    return moving(model, [n for shape in model.scene.shapes for n in shape.nodes])


def values_per_row(model: Model) -> int:
    """Return how many numbers per row an observer stores for the shapes."""
    d, found = model.scene.dimension, 0
    for shape in model.scene.shapes:
        found += d * (bool(shape.at) + d * bool(shape.axes))
        if moving(model, [n for corner in shape.corners for n in corner]):
            found += d * max(2, len(shape.corners), CHANGING * (shape.kind == "curve"))
    return found


def string_lengths(model: Model) -> list[float | None]:
    """Return the stated length of each link; None for a link without one."""
    values, g = model.parameter_values, model.graph
    return [
        None if x is None else evaluate(g, [x.node], values)[0]
        for x in model.scene.lengths
    ]


def mesh_parts(shape: Shape, d: int) -> list[Floats]:
    """Return the corners of a body as linear functions of its sizes.

    The result has one array (n, d) for each size: the corners, in the axes of the body,
    if this size is 1 and all others are 0. Corners are sums of sizes times these
    arrays.

    Parameters
    ----------
    shape : Shape
        A shape without corners of its own.
    d : int
        Number of components, 2 or 3.
    """
    turns = bool(shape.axes)
    return [
        _mesh(shape.kind, own.tolist(), turns=turns, d=d)[0]
        for own in np.eye(len(shape.sizes))
    ]


def bodies(model: Model, columns: Mapping[str, Floats], count: int) -> list[Body]:
    """Return the shapes of a model in rows of a run.

    Parameters
    ----------
    model : Model
    columns : mapping of str to ndarray, shape (count,)
        The columns `needed(model)`.
    count : int
        Number of rows.
    """
    # A component of constraint forces that contains no constraint has no column.
    values: dict[str, float | Floats] = dict.fromkeys(needed(model), 0.0)
    values |= {p.name: p.value for p in model.parameters}
    values |= columns
    return [_body(model, shape, values, count) for shape in model.scene.shapes]


def _body(
    model: Model, shape: Shape, values: Mapping[str, float | Floats], count: int
) -> Body:
    g, d, kind = model.graph, model.scene.dimension, shape.kind
    moves = bool(moving(model, shape.nodes))
    count = count if moves else 1
    values = {
        k: x[:count] if isinstance(x, np.ndarray) else x for k, x in values.items()
    }
    sizes = evaluate_rows(g, shape.sizes, values, 1)[:, 0].tolist()
    at, axes = np.zeros((count, d)), np.tile(np.eye(d), (count, 1, 1))
    at[:, : len(shape.at)] = evaluate_rows(g, shape.at, values, count).T
    own = math.isqrt(len(shape.axes))
    turned = evaluate_rows(g, shape.axes, values, count)
    axes[:, :own, :own] = turned.T.reshape(count, own, own)
    if not shape.corners:
        mesh = _mesh(kind, sizes, turns=own > 0, d=d)
        radius = sizes[0] if kind == "sphere" else 0.0
        return Body(shape, at, axes, mesh[0][np.newaxis], *mesh[1:], moves, radius)
    changes = moving(model, [n for corner in shape.corners for n in corner])
    rows = count if changes else 1
    known = {k: x[:rows] if isinstance(x, np.ndarray) else x for k, x in values.items()}
    if kind == "curve":
        parts = _along(model, shape, known, rows, sizes)
    else:
        found = [evaluate_rows(g, c, known, rows).T for c in shape.corners]
        if kind == "arrow":
            scale = sizes[0] if sizes else 1.0
            found = [np.zeros_like(found[0]), scale * found[0]]
        parts = np.stack(found, axis=1)
    corners = np.zeros((*parts.shape[:2], d))
    corners[..., : parts.shape[-1]] = parts
    _, faces, edges, seams = _flat(corners[0], closed=kind == "polygon")
    return Body(shape, at, axes, corners, faces, edges, seams, moves)


def _along(
    model: Model,
    shape: Shape,
    values: dict[str, float | Floats],
    rows: int,
    ends: list[float],
) -> Floats:
    """Return points (rows, n, components) of a shape that is a curve, as its corners.

    values : variables by name, numbers or arrays (rows,), changed by this function.
    ends : ends of the curve's parameter.
    """
    s = np.linspace(ends[0], ends[1], ALONG if rows == 1 else CHANGING)
    for name, x in values.items():
        if isinstance(x, np.ndarray):
            values[name] = np.repeat(x, len(s))
    values[CURVE] = np.tile(s, rows)
    found = evaluate_rows(model.graph, shape.corners[0], values, rows * len(s))
    return found.T.reshape(rows, len(s), -1)


# --- Corners, faces, edges and seams of bodies

_SQUARE = 0.5 * np.array([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)])


def _circle(radius: float, count: int) -> Floats:
    angle = 2.0 * np.pi / count * np.arange(count)
    return radius * np.stack((np.cos(angle), np.sin(angle)), axis=1)


def _flat(corners: Floats, *, closed: bool) -> Mesh:
    n = len(corners)
    edges = [(k, (k + 1) % n, -1, -1) for k in range(n - (not closed))]
    return corners, [list(range(n))] if closed else [], edges, []


def _mesh(kind: str, sizes: list[float], *, turns: bool, d: int) -> Mesh:
    """Return a body in its own axes; `turns` adds a line that shows the rotation.

    kind : the kind of shape.
    sizes : its lengths.
    d : 2 or 3.
    """
    if kind == "ground":  # a plane: its height at one place
        return np.array([[0.0, 0.0, sizes[0]]]), [], [], []
    if kind == "sphere":
        return _great_circles(sizes[0], 3 if turns else 1)
    if kind == "box" and len(sizes) == 3:
        half = 0.5 * sizes[2]
        return _prism(_SQUARE * sizes[:2], -half, half)
    if kind == "cylinder":
        half = 0.5 * sizes[1]
        return _prism(_circle(sizes[0], AROUND), -half, half, line=turns)
    if kind == "cone":
        return _prism(_circle(sizes[0], AROUND), 0.0, sizes[1], line=turns, tip=True)
    outline = _SQUARE * sizes if kind == "box" else _circle(sizes[0], ROUND)
    spoke = turns and kind != "box"
    corners = np.pad(outline, ((0, spoke), (0, d - 2)))
    _, faces, edges, _ = _flat(outline, closed=True)
    if spoke:
        edges.append((len(outline), 0, -1, -1))
    return corners, [] if kind == "ring" else faces, edges, []


def _great_circles(radius: float, count: int) -> Mesh:
    """Return `count` great circles of a sphere, normal to its axes, z first.

    radius : the radius of the sphere.
    """
    circle = np.pad(_circle(radius, ROUND), ((0, 0), (0, 1)))
    corners = np.concatenate([np.roll(circle, k, axis=1) for k in range(count)])
    edges = [
        (k, k + 1 if (k + 1) % ROUND else k + 1 - ROUND, -1, -1)
        for k in range(len(corners))
    ]
    return corners, [], edges, []


def _prism(
    outline: Floats, low: float, high: float, *, line: bool = False, tip: bool = False
) -> Mesh:
    """Return the prism of an outline from height `low` to `high`, or a cone if `tip`.

    Parameters
    ----------
    outline : ndarray, shape (n, 2)
        Counterclockwise; an outline of more than four corners counts as round.
    low, high : float
        Heights of bottom and top.
    line : bool
        Whether a line from the middle of the top down the side is added.
    tip : bool
        Whether the bottom is a point.
    """
    n = len(outline)
    parts = [(outline, high), (np.zeros((1, 2)) if tip else outline, low)]
    parts += [(np.zeros((1, 2)), high)] * line
    corners = np.concatenate([np.insert(x, 2, z, axis=1) for x, z in parts])
    under = [n if tip else n + k for k in range(n)]
    after = [(k + 1) % n for k in range(n)]
    # The top, the sides, and the bottom.
    sides = [[k, under[k], under[after[k]], after[k]] for k in range(n)]
    faces = [list(range(n)), *(list(dict.fromkeys(side)) for side in sides)]
    edges = [(k, after[k], 0, 1 + k) for k in range(n)]
    seams = [(k, under[k], 1 + k, 1 + (k - 1) % n) for k in range(n)]
    if not tip:
        faces.append(under[::-1])
        edges += [(under[k], under[after[k]], n + 1, 1 + k) for k in range(n)]
    if line:
        edges += [seams[0], (len(corners) - 1, 0, 0, 0)]
    return (
        (corners, faces, edges, seams) if n > 4 else (corners, faces, edges + seams, [])
    )


# --- Views from one side


class ProjectedBody(NamedTuple):
    """Projection of a body: corners (n, 2) each.

    Attributes
    ----------
    faces : list of (ndarray, float)
        The faces in front, each with the cosine of the angle between its normal and the
        line of sight.
    lines, hidden : ndarray, shape (n, 2)
        Edges in front, and behind, as one path each, with gaps of nan.
    depth : float
        Coordinate of the body's middle towards the observer.
    """

    faces: list[tuple[Floats, float]]
    lines: Floats
    hidden: Floats
    depth: float


def projected(body: Body, row: int, view: Floats) -> ProjectedBody | None:
    """Return the projection of a body in one row; None if its place is not finite.

    Parameters
    ----------
    body : Body
    row : int
    view : ndarray, shape (2, d)
        Directions to the right and up.
    """
    row = min(row, len(body.at) - 1)
    [corners] = body.placed([row])
    if not np.isfinite(corners).all() and body.shape.kind != "curve":
        return None
    flat = corners @ view.T
    near = np.cross(*view) if corners.shape[1] == 3 else np.zeros(2)
    depth = float((corners @ near).mean())
    front: list[bool] = []
    faces: list[tuple[Floats, float]] = []
    for face in body.faces:
        turned = _area(flat[face])[-1]
        whole = float(np.linalg.norm(_area(corners[face])))
        front.append(turned > 0.0 or len(body.faces) == 1)
        if front[-1]:
            faces.append((flat[face], abs(turned) / whole if whole else 0.0))
    front.append(True)  # beside edges of one face, or of none
    edges: dict[bool, list[tuple[int, int]]] = {True: [], False: []}
    for i, j, a, b in body.edges:
        ahead = front[a] or front[b]
        if body.radius:
            ahead = bool((corners[i] + corners[j]) @ near >= 2.0 * depth)
        edges[ahead].append((i, j))
    edges[True] += [(i, j) for i, j, a, b in body.seams if front[a] != front[b]]
    lines, hidden = (_path(flat, edges[ahead]) for ahead in (True, False))
    if body.radius:
        outline = body.at[row] @ view.T + _circle(body.radius, ROUND)
        faces = [(outline, 1.0)]
        lines = np.concatenate((outline, outline[:1], np.full((1, 2), np.nan), lines))
    return ProjectedBody(faces, lines, hidden, depth)


def _path(flat: Floats, edges: list[tuple[int, int]]) -> Floats:
    """Return edges as one path (n, 2), with gaps between edges that do not meet.

    flat : (n, 2), the projected corners.
    edges : pairs of corners.
    """
    gap, found, last = np.full(2, np.nan), [], -1
    for i, j in edges:
        found += [flat[j]] if i == last else [gap, flat[i], flat[j]]
        last = j
    return np.array(found).reshape(-1, 2)


def _area(corners: Floats) -> Floats:
    """Return the area vector (n, d) of n polygons; in the plane its only component.

    corners : (n, corners, d), the corners in order.
    """
    beside = np.roll(corners, -1, axis=0)
    if corners.shape[1] == 2:
        (x, y), (u, v) = corners.T, beside.T
        return 0.5 * np.array([np.sum(x * v - y * u)])
    area: Floats = 0.5 * np.cross(corners - corners[0], beside - corners[0]).sum(axis=0)
    return area


def reached(places: Sequence[Floats], bodies: Sequence[Body]) -> Floats:
    """Return finite positions (n, d) of points and corners, for the extent of a view.

    Parameters
    ----------
    places : sequence of ndarray, shape (rows, d)
        Positions of each point.
    bodies : sequence of Body
        Bodies, of which at most `ROWS` rows are evaluated.
    """
    found, heights = list(places), []
    for body in bodies:
        rows = np.unique(np.linspace(0, len(body.at) - 1, ROWS).astype(int))
        if body.height is not None:
            heights.append(body.height)
        elif body.radius:
            ends = body.at[rows]
            found += [ends - body.radius, ends + body.radius]
        else:
            found.append(body.placed(rows).reshape(-1, body.at.shape[1]))
    d = (places[0] if places else bodies[0].at).shape[1]
    every = np.concatenate(found) if found else np.zeros((1, d))
    every = every[np.isfinite(every).all(axis=1)]
    # A plane is at the mean of all other places.
    middle = every.mean(axis=0) if len(every) else np.zeros(d)
    under = [(*middle[:2], z) for z in heights]
    return np.concatenate((every, np.reshape(under, (-1, d))))
