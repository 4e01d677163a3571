"""Pieces of a linear table of two arguments: sets of cells that contain no groove.

In each cell of its grid such a table is a polynomial a + b x + c y + d x y. At an edge
between two cells its slope jumps, by an amount that is linear along the edge. Edges at
which this amount changes its sign are divided there, so that each edge is a groove, a
ridge, or flat. Cells that are connected by flat edges or ridges form a patch. A table
that is the maximum of its pieces near each point has one piece for each patch: in its
patch it equals the table, and beyond a groove its polynomial goes on.

A patch of one polynomial that is nowhere above the table is a piece of its own. Other
patches share pieces: no two patches that have a point in common are in one piece. Such
a piece goes on over half a cell beyond its patch, and is far below the table elsewhere.
Where a ridge separates two patches, since grooves meet there, a piece falls off beyond
the ridge twice as steeply as the table.
"""

from __future__ import annotations

from functools import lru_cache
from itertools import combinations, product
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lagsim.language import tables
from lagsim.language.tables import Data

if TYPE_CHECKING:
    from collections.abc import Iterator

    from lagsim.language.arrays import Floats
    from lagsim.language.graph import Graph

    Cell = tuple[int, int]
    # The axes of a table, and its coefficients.
    Table = tuple[tuple[Data, ...], Data]

# Largest number of cells of a table that is divided.
MOST_CELLS = 1_000
# Largest number of patches that are pieces of their own.
MOST_OWN = 9
# Number of patches above which none is a piece of its own.
MOST_PATCHES = 40
# Slopes and values are equal if they differ by this part of the largest one.
ALIKE = 1e-12
# Points of a grid that are nearer to each other, in units of a cell, are one point.
NEAR = 1e-9
# Distance of points beyond the ends of a table, in units of its extent.
FAR = 1e3
# Both halves of a cell, and the quarters of the neighbourhood of a point.
QUARTERS = ((0, 0), (0, 1), (1, 0), (1, 1))


class Polynomial(NamedTuple):
    """The polynomial sum_jk c[j, k] (x - x0)^j (y - y0)^k with j, k = 0, 1."""

    x0: float
    y0: float
    c: Floats

    def __call__(self, x: float, y: float) -> float:
        """Return the value at (x, y)."""
        (a, b), (c, d) = self.c.tolist()
        u, v = x - self.x0, y - self.y0
        return float(a + b * v + (c + d * v) * u)

    def at(self, x: float, y: float) -> Polynomial:
        """Return the same polynomial about (x, y)."""
        (_, b), (c, d) = self.c.tolist()
        u, v = x - self.x0, y - self.y0
        return Polynomial(x, y, np.array([[self(x, y), b + d * u], [c + d * v, d]]))


def _axis(axis: Data) -> list[float]:
    return axis.values[tables.FIRST :]


class TableGrid:
    """A linear table of two arguments, as the polynomials of its cells.

    The cell (i, j) lies below the points i and j of both axes, and above the points
    i - 1 and j - 1: cells with i = 0 lie beyond the first point.

    Parameters
    ----------
    axes, data : the axes and coefficients of the table.
    sign : -1 for the negative table, else 1.
    """

    def __init__(self, axes: tuple[Data, Data], data: Data, sign: float) -> None:
        self.lines = [_axis(axes[0]), _axis(axes[1])]
        shape = [len(x) + 1 for x in self.lines]
        c = sign * np.array(data.values[1:]).reshape(*shape, 2, 2)
        self.cells = {
            (i, j): Polynomial(*self._corner(i, j), c[i, j])
            for i, j in product(*map(range, shape))
        }
        self.ends = bool(axes[0].values[3])
        self.widths = [(x[-1] - x[0]) / (len(x) - 1) for x in self.lines]
        inner = c[np.isfinite(c).all(axis=(2, 3))]
        size = np.array([1.0, self.widths[1]]), np.array([1.0, self.widths[0]])
        self.scale = float(np.max(np.abs(inner * np.outer(size[1], size[0]))))
        self._divide()

    def _corner(self, i: int, j: int) -> tuple[float, float]:
        """Return the point from which the polynomial of a cell is measured."""
        return self.lines[0][max(i - 1, 0)], self.lines[1][max(j - 1, 0)]

    def __contains__(self, cell: Cell) -> bool:
        """Whether the table has values in a cell."""
        if not self.ends:
            return True
        return all(0 < i < len(x) for i, x in zip(cell, self.lines, strict=True))

    def _divide(self) -> None:
        """Add lines of the grid where the jump of slope at an edge changes its sign.

        No lines are added if the cells would become too many.
        """
        more: list[set[float]] = [set(), set()]
        for way, edge in self.edges():
            ends, jumps = self._along(way, edge)
            if min(jumps) < -ALIKE * self.scale and max(jumps) > ALIKE * self.scale:
                (a, b), (low, high) = ends, jumps
                at = a + (b - a) * low / (low - high)
                every = (*self.lines[1 - way], *more[1 - way])
                if min(abs(at - x) for x in every) > NEAR * self.widths[1 - way]:
                    more[1 - way].add(at)
        sizes = [len(x) + len(y) + 1 for x, y in zip(self.lines, more, strict=True)]
        if not (more[0] or more[1]) or sizes[0] * sizes[1] > MOST_CELLS:
            return
        old, former = self.cells, self.lines
        self.lines = [sorted({*x, *y}) for x, y in zip(former, more, strict=True)]
        place = [np.searchsorted(former[k], self.lines[k], "right") for k in (0, 1)]
        own = [[0, *x.tolist()] for x in place]
        self.cells = {
            (i, j): old[own[0][i], own[1][j]].at(*self._corner(i, j))
            for i, j in product(range(len(own[0])), range(len(own[1])))
        }

    def span(self, way: int, i: int) -> tuple[float, float]:
        """Return both ends of a cell along an axis; of outer cells at FAR widths."""
        x, far = self.lines[way], FAR * self.widths[way]
        low = x[i - 1] if i else x[0] - far
        return low, (x[i] if i < len(x) else x[-1] + far)

    def edges(self) -> Iterator[tuple[int, Cell]]:
        """Yield each edge: the axis across it, and the cell below it."""
        for cell in self.cells:
            for way in (0, 1):
                other = self.beyond(way, cell)
                if other in self.cells and cell in self and other in self:
                    yield way, cell

    def beyond(self, way: int, cell: Cell) -> Cell:
        """Return the next cell along an axis."""
        return cell[0] + (way == 0), cell[1] + (way == 1)

    def _along(
        self, way: int, cell: Cell
    ) -> tuple[tuple[float, float], tuple[float, float]]:
        """Return the ends of an edge, and the jumps of slope there.

        The jumps are the changes of the value over a width of a cell.
        """
        x, ends = self.lines[way][cell[way]], self.span(1 - way, cell[1 - way])
        below, above = self.cells[cell], self.cells[self.beyond(way, cell)]
        jumps = list[float]()
        for y in ends:
            at = (x, y) if way == 0 else (y, x)
            jump = (above.at(*at).c - below.at(*at).c)[1 - way, way]
            jumps.append(float(jump) * self.widths[way])
        return (ends[0], ends[1]), (jumps[0], jumps[1])

    def kind(self, way: int, cell: Cell) -> int:
        """Return 1 for an edge with a groove, -1 for a ridge, 0 for a flat edge."""
        _, jumps = self._along(way, cell)
        least = ALIKE * self.scale
        return 1 if max(jumps) > least else -1 if min(jumps) < -least else 0

    def points(self, way: int, k: int) -> tuple[float, float, float]:
        """Return the coordinates of the middle before line k, of line k, and after it.

        Outer cells have the point at FAR widths as their middle.
        """
        x, far = self.lines[way], FAR * self.widths[way]
        low = (x[k - 1] + x[k]) / 2.0 if k else x[0] - far
        high = (x[k] + x[k + 1]) / 2.0 if k + 1 < len(x) else x[-1] + far
        return low, x[k], high

    def alike(self, p: Polynomial, q: Polynomial) -> bool:
        """Whether two polynomials are equal but for rounding."""
        size = np.array([[1.0, self.widths[1]], [self.widths[0], 1.0]])
        size[1, 1] = self.widths[0] * self.widths[1]
        off = np.abs(q.at(p.x0, p.y0).c - p.c) * size
        return bool(np.max(off) <= 8.0 * ALIKE * self.scale)

    def around(self, k: Cell) -> list[Cell]:
        """Return the cells with values around the point with the numbers k."""
        cells = ((k[0] + a, k[1] + b) for a, b in QUARTERS)
        return [cell for cell in cells if cell in self]

    @property
    def corners(self) -> Iterator[Cell]:
        """The numbers of all points of the grid."""
        first, second = (range(len(x)) for x in self.lines)
        return product(first, second)


class Patches:
    """The patches of a grid: each cell has the number of its patch.

    Attributes
    ----------
    found : dict
        Cell -> number of its patch; empty if the table has no groove, or if grooves
        end such that no patches exist.
    """

    def __init__(self, grid: TableGrid) -> None:
        self.grid = grid
        self.found: dict[Cell, int] = {}
        kinds = {(way, cell): grid.kind(way, cell) for way, cell in grid.edges()}
        if 1 not in kinds.values():
            return
        one = [*self._alike()]
        flat = self._joined(one)
        ridges = [
            (cell, grid.beyond(way, cell))
            for (way, cell), kind in kinds.items() if kind < 0
        ]  # fmt: skip
        bent = self._joined([*one, *ridges])
        wrong = self._wrong(bent, kinds)
        # A patch in which grooves meet at a ridge is divided at its ridges.
        kept = [x for x in ridges if bent[x[0]] not in wrong]
        for found in (bent, self._joined([*one, *kept]), flat):
            if not self._wrong(found, kinds):
                self.found = found
                return

    def _alike(self) -> Iterator[tuple[Cell, Cell]]:
        """Yield pairs of cells with a common point and one polynomial."""
        grid = self.grid
        for k in grid.corners:
            for a, b in combinations(grid.around(k), 2):
                if grid.alike(grid.cells[a], grid.cells[b]):
                    yield a, b

    def _joined(self, pairs: list[tuple[Cell, Cell]]) -> dict[Cell, int]:
        """Return the patches of cells, of which both of each pair are in one."""
        parent = {cell: cell for cell in self.grid.cells if cell in self.grid}

        def root(x: Cell) -> Cell:
            while parent[x] != x:
                parent[x] = parent[parent[x]]
                x = parent[x]
            return x

        for cell, other in pairs:
            parent[root(cell)] = root(other)
        numbers: dict[Cell, int] = {}
        return {x: numbers.setdefault(root(x), len(numbers)) for x in parent}

    def _wrong(
        self, found: dict[Cell, int], kinds: dict[tuple[int, Cell], int]
    ) -> set[int]:
        """Return the patches that cannot be continued beyond their edges."""
        grid, wrong = self.grid, set[int]()
        for (way, cell), kind in kinds.items():
            if kind > 0 and found[cell] == found[grid.beyond(way, cell)]:
                wrong.add(found[cell])
        for k in grid.corners:
            cells = grid.around(k)
            for patch in {found[x] for x in cells} - wrong:
                own = [x for x in cells if found[x] == patch]
                beside = sum(abs(a - b) for a, b in zip(own[0], own[-1], strict=True))
                if len(own) == len(cells) or (len(own) == 2 and beside == 1):
                    continue
                first = grid.cells[own[0]]
                if not all(grid.alike(first, grid.cells[x]) for x in own[1:]):
                    wrong.add(patch)
        return wrong

    def own(self) -> dict[int, Polynomial]:
        """Return the patches of one polynomial that is nowhere above the table."""
        grid = self.grid
        cells: dict[int, list[Cell]] = {}
        for cell, patch in self.found.items():
            cells.setdefault(patch, []).append(cell)
        found = dict[int, Polynomial]()
        if len(cells) > MOST_PATCHES:
            return found
        for patch, each in cells.items():
            p = grid.cells[each[0]]
            if not all(grid.alike(p, grid.cells[x]) for x in each[1:]):
                continue
            if all(self._is_below(p, x) for x in self.found if x not in each):
                found[patch] = p
        return found if len(found) <= MOST_OWN else {}

    def _is_below(self, p: Polynomial, cell: Cell) -> bool:
        """Whether a polynomial is at most the table in a cell, and not equal to it."""
        grid = self.grid
        least, strict = ALIKE * grid.scale, False
        for x, y in product(grid.span(0, cell[0]), grid.span(1, cell[1])):
            value, other = grid.cells[cell](x, y), p(x, y)
            near = max(least, ALIKE * abs(value), ALIKE * abs(other))
            if other > value + near:
                return False
            strict |= other < value - near
        return strict

    def colours(self, left: set[int]) -> dict[int, int]:
        """Return numbers of pieces for the patches `left`, as few as a search finds.

        Patches with a common point have different pieces.
        """
        beside: dict[int, set[int]] = {patch: set() for patch in left}
        for k in self.grid.corners:
            near = {self.found[x] for x in self.grid.around(k)} & left
            for patch in near:
                beside[patch] |= near - {patch}
        found: dict[int, int] = {}
        for patch in sorted(left, key=lambda x: (-len(beside[x]), x)):
            taken = {found.get(x) for x in beside[patch]}
            found[patch] = next(k for k in range(len(left)) if k not in taken)
        return found


class _Continued:
    """A piece: its patches, continued over half a cell, and far below elsewhere.

    grid : the table.
    own : the cells of the patches of the piece.
    """

    def __init__(self, grid: TableGrid, own: set[Cell]) -> None:
        self.grid, self.own_cells = grid, own
        values = [
            p(x, y)
            for (i, j), p in grid.cells.items() if (i, j) in grid
            for x, y in product(self._near(0, i), self._near(1, j))
        ]  # fmt: skip
        self.drop = 2.0 * (max(values) - min(values)) + grid.scale

    def _near(self, way: int, i: int) -> tuple[float, float]:
        x, w = self.grid.lines[way], self.grid.widths[way]
        return (x[i - 1] if i else x[0] - w), (x[i] if i < len(x) else x[-1] + w)

    def quarters(self) -> dict[Cell, Polynomial | None]:
        """Return the polynomial of each quarter of a cell; None outside the table.

        The quarter (r, s) belongs to the cell ((r + 1) // 2, (s + 1) // 2), and to the
        point (r // 2, s // 2).
        """
        shape = [2 * len(x) for x in self.grid.lines]
        return {(r, s): self._quarter(r, s) for r, s in product(*map(range, shape))}

    def _quarter(self, r: int, s: int) -> Polynomial | None:
        grid, cell = self.grid, ((r + 1) // 2, (s + 1) // 2)
        if cell not in grid:
            return None
        here = grid.cells[cell]
        if cell in self.own_cells:
            return here
        k = r // 2, s // 2
        own = [x for x in grid.around(k) if x in self.own_cells]
        if not own:
            return here._replace(c=here.c - self.drop * np.eye(2) * [1.0, 0.0])
        off = {x: abs(x[0] - cell[0]) + abs(x[1] - cell[1]) for x in own}
        p = grid.cells[min(own, key=lambda x: (off[x], x))]
        x, y = (grid.points(way, k[way])[1::-1] if not q % 2 else
                grid.points(way, k[way])[1:]
                for way, q in ((0, r), (1, s)))  # fmt: skip
        # Edges beside a cell of the piece have the values of the table.
        met = dict.fromkeys(QUARTERS, False)
        met[0, 0] = True
        met[0, 1] = (2 * k[0] + 1 - cell[0], cell[1]) in self.own_cells
        met[1, 0] = (cell[0], 2 * k[1] + 1 - cell[1]) in self.own_cells
        values, least = np.zeros((2, 2)), 8.0 * ALIKE * grid.scale
        is_one = True
        for a, b in QUARTERS:
            table, other = here(x[a], y[b]), p(x[a], y[b])
            value = table if met[a, b] else min(other, 2.0 * table - other)
            near = max(least, 8.0 * ALIKE * max(abs(table), abs(other)))
            values[a, b] = other if abs(value - other) <= near else value
            is_one &= values[a, b] == other
        if is_one:
            return p
        u, v = x[1] - x[0], y[1] - y[0]
        (f, fy), (fx, fxy) = values
        c = [[f, (fy - f) / v], [(fx - f) / u, (fxy - fx - fy + f) / (u * v)]]
        return Polynomial(x[0], y[0], np.array(c))


def pieces_of_cells(
    g: Graph, axes: tuple[Data, Data], data: Data, args: list[int], sign: float
) -> list[int]:
    """Return the pieces (nodes) of a linear table of two arguments.

    The table is their maximum near each point, or their minimum if `sign` is -1. The
    result is empty if the table has no groove, or if it is not divided.

    axes, data : the table.
    args : the nodes of both arguments.
    """
    sizes = [int(axis.values[0]) + 2 for axis in axes]
    if axes[0].values[2] or sizes[0] * sizes[1] > MOST_CELLS:
        return []
    own, made = _divided(axes, data, sign)
    found = [_surface(g, axes, args, p, sign) for p in own]
    return found + [tables.called(g, *x, args) for x in made]


@lru_cache(maxsize=16)
def _divided(
    axes: tuple[Data, Data], data: Data, sign: float
) -> tuple[list[Polynomial], list[Table]]:
    """Return the pieces of a table that are polynomials, and the others as tables.

    axes, data, sign : see `pieces_of_cells`.
    """
    grid = TableGrid(axes, data, sign)
    patches = Patches(grid)
    if not patches.found:
        return [], []
    own = patches.own()
    colours = patches.colours({*patches.found.values()} - own.keys())
    made = list[tuple[tuple[Data, ...], Data]]()
    for colour in sorted({*colours.values()}):
        cells = {x for x, k in patches.found.items() if colours.get(k) == colour}
        made.append(_table(axes, _Continued(grid, cells), sign))
    return [*own.values()], made


def _surface(
    g: Graph, axes: tuple[Data, Data], args: list[int], p: Polynomial, sign: float
) -> int:
    """Return the node of a polynomial, which ends where the table ends."""
    offs = [
        g.call("sub", w, g.constant(x)) for w, x in zip(args, (p.x0, p.y0), strict=True)
    ]
    (a, b), (c, d) = (sign * p.c).tolist()
    powers = (g.one, offs[1], offs[0], g.call("mul", *offs))
    terms = zip(map(g.constant, (a, b, c, d)), powers, strict=True)
    found = g.product_sum(terms)
    if not axes[0].values[3]:
        return found
    ends = tuple(np.array([_axis(x)[0], _axis(x)[-1]]) for x in axes)
    made = tables.axes_and_pieces(
        axes[0].name, ends, np.zeros((2, 2)), "linear", "error"
    )
    return g.call("add", found, tables.called(g, *made, args))


def _table(axes: tuple[Data, Data], piece: _Continued, sign: float) -> Table:
    """Return a piece as a table that has a line only where the piece bends."""
    grid, quarters = piece.grid, piece.quarters()
    kept, lines = list[list[int]](), list[list[float]]()
    for way in (0, 1):
        x = grid.lines[way]
        every = [(x[k // 2] if k % 2 == 0 else (x[k // 2] + x[k // 2 + 1]) / 2.0)
                 for k in range(2 * len(x) - 1)]  # fmt: skip
        some = [k for k in range(len(every)) if _bends(grid, quarters, way, k)]
        kept.append([0, *(k + 1 for k in some)])
        lines.append([every[k] for k in some])
    for way in (0, 1):
        x, far = lines[way], FAR * (grid.lines[way][-1] - grid.lines[way][0])
        for at in (grid.lines[way][-1] + far, grid.lines[way][-1] + 2.0 * far):
            if len(x) < 2:
                x.append(at)
                kept[way].append(kept[way][-1])
    c = np.full((len(kept[0]), len(kept[1]), 2, 2), np.nan)
    for i, j in product(range(len(kept[0])), range(len(kept[1]))):
        p = quarters[kept[0][i], kept[1][j]]
        if p is not None:
            c[i, j] = sign * p.at(lines[0][max(i - 1, 0)], lines[1][max(j - 1, 0)]).c
    made = tuple(
        Data(axis.name, np.array([len(x) - 1.0, 0.0, 0.0, axis.values[3], *x]))
        for axis, x in zip(axes, lines, strict=True)
    )
    pieces = Data(axes[0].name, np.array([float(tables.LINEAR), *c.ravel()]))
    return made, pieces


def _bends(
    grid: TableGrid, quarters: dict[Cell, Polynomial | None], way: int, k: int
) -> bool:
    """Whether a piece has another polynomial beyond a line, anywhere along it.

    k : the number of the line among the lines and middles of the grid.
    """
    for s in range(2 * len(grid.lines[1 - way])):
        low, high = ((k, s), (k + 1, s)) if way == 0 else ((s, k), (s, k + 1))
        p, q = quarters[low], quarters[high]
        if p is None or q is None:
            if p is not q:
                return True
        elif p is not q and not grid.alike(p, q):
            return True
    return False
