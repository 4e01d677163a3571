"""Functions given by points: piecewise polynomials as data of graph operations.

A table has cells between its knots, and one beyond each end: the cells -1, 0, ... m.
`axis` has m, the number of continuous derivatives at its knots, the period (0: none), 1
if a run ends with the table, and the m + 1 knots. `pieces` has p, then the coefficients
c_0 ... c_(p - 1) of each cell from -1 on: the polynomial in the distance from the
cell's lower knot (in the cell m, from the last one). With two arguments each cell has
p*p coefficients, the second argument's index running fastest.

Cells are selected by a separate number, `floor(table.knot(axis, x))`, which is an
ordinary switch. Steps end at each knot of a smooth table, too: the error estimate of a
step over the jump of a second or third derivative may be too small by a factor of a
thousand. Functions whose names begin with `table_` are kernels.
"""

from __future__ import annotations

from functools import cached_property
from math import floor, inf
from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator

    from lagsim.language.arrays import Floats
    from lagsim.language.simpler import Builder

FIRST = 4  # where the knots begin in an axis
LINEAR = 2  # the coefficients of a piece that has kinks at its ends
# A number this far below a whole one is another double; and far beyond both ends.
BELOW, TINY, FAR = 1.5 * 2.0**-53, 2.0**-1000, 1e300


class Data:
    """Array of numbers that operations read; two are equal if name and bits are equal.

    Attributes
    ----------
    name : str
        Name of the table.
    numbers : ndarray, shape (k,)
        The numbers.
    """

    def __init__(self, name: str, numbers: Floats) -> None:
        import hashlib

        self.name, self.numbers = name, numbers
        self.digest = hashlib.sha256(numbers.tobytes()).hexdigest()

    @cached_property
    def values(self) -> list[float]:
        """The numbers as Python floats."""
        return list(self.numbers.tolist())

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Data) and repr(self) == repr(other)

    def __hash__(self) -> int:
        return hash(self.digest)

    def __repr__(self) -> str:
        return f"{self.name}.{self.digest}"


def table_cell(axis: Floats, x: float) -> int:
    """Return the index of the cell, an interval between two points, that contains x.

    It is -1 below the first point and m past the last. In a periodic table the cells of
    later periods continue the numbering.

    axis : the m + 1 points of a table, after four numbers that describe them.
    """
    m = int(axis[0])
    before = 0
    if axis[2] > 0.0:
        turns = floor((x - axis[4]) / axis[2])
        before = turns * m
        x = x - turns * axis[2]
    elif x < axis[4]:
        return -1
    elif x > axis[4 + m]:
        return m
    low = 0
    high = m
    while high - low > 1:
        middle = (low + high) // 2
        if x < axis[4 + middle]:
            high = middle
        else:
            low = middle
    return before + low


def table_row(axis: Floats, cell: int) -> int:
    """Return the index of a cell's coefficients, reduced to a period if periodic.

    axis : data of the table, see the module; so in the functions below.
    """
    m = int(axis[0])
    if axis[2] > 0.0:  # beyond all digits of x the remainder has no value
        return 1 + max(0, min(cell - floor(cell / m) * m, m - 1))
    return 1 + cell


def table_from(axis: Floats, x: float, cell: int) -> float:
    """Return x less the knot from which a cell's polynomial is measured."""
    m = int(axis[0])
    if axis[2] > 0.0:
        x = x - floor(cell / m) * axis[2]
    return float(x - axis[3 + max(table_row(axis, cell), 1)])


def table_knot(axis: Floats, x: float) -> float:
    """Return a knot number in [k, k + 1) for x in cell k, increasing with x.

    Past the ends of the table the number changes by less than 1. Its whole part is
    exact: it increases at one double, whatever the number of knots.
    """
    m = int(axis[0])
    cell = table_cell(axis, x)
    length = axis[4 + m] - axis[4]
    top = cell + 1.0
    if axis[2] == 0.0 and cell < 0:
        far = min((axis[4] - x) / length, FAR)
        found = -far / (1.0 + far)
    elif axis[2] == 0.0 and cell >= m:
        far = min((x - axis[4 + m]) / length, FAR)
        found = m + far / (1.0 + far)
    else:
        k = 3 + table_row(axis, cell)
        local = table_from(axis, x, cell)
        found = max(cell + local / (axis[k + 1] - axis[k]), float(cell))
    return float(min(found, top - BELOW * abs(top) - TINY))


def table_rate(axis: Floats, x: float) -> float:
    """Return the slope of `table_knot`."""
    m = int(axis[0])
    cell = table_cell(axis, x)
    if axis[2] > 0.0 or (cell >= 0 and cell < m):
        k = 3 + table_row(axis, cell)
        return float(1.0 / (axis[k + 1] - axis[k]))
    length = axis[4 + m] - axis[4]
    far = max(axis[4] - x, x - axis[4 + m]) / length
    return float(1.0 / (length * (1.0 + far) * (1.0 + far)))


def table_chosen(axis: Floats, piece: float) -> int:
    """Return the number of the cell whose polynomial is used for a piece number.

    piece : the number of a piece, which may lie beyond the ends of a table that is not
        periodic: the cell is then that at the end.
    """
    k = floor(piece)
    return k if axis[2] > 0.0 else max(-1, min(k, int(axis[0])))


def table_power(j: int, order: float) -> float:
    """Return j (j - 1) ... (j - order + 1), the factor of a derivative of x^j."""
    found = 1.0
    for i in range(int(order)):
        found = found * (j - i)
    return found


def table_piece(
    axis: Floats, pieces: Floats, order: float, x: float, piece: float
) -> float:
    """Return a derivative of a piece of a table of one argument.

    Parameters
    ----------
    axis, pieces : ndarray
        The table's data, see the module.
    order
        Order of the derivative.
    x
        The argument.
    piece
        Number of the piece, -1 to m.
    """
    p = int(pieces[0])
    cell = table_chosen(axis, piece)
    first = 1 + p * table_row(axis, cell)
    d = table_from(axis, x, cell)
    found = 0.0
    for i in range(p - int(order)):
        j = p - 1 - i
        found = found * d + table_power(j, order) * pieces[first + j]
    return found


def table_piece2(
    axis: Floats,
    other: Floats,
    pieces: Floats,
    order: float,
    order2: float,
    x: float,
    y: float,
    piece: float,
    piece2: float,
) -> float:
    """Return a partial derivative of a piece of a table of two arguments.

    Parameters
    ----------
    axis, other, pieces : ndarray
        The axes of both arguments, and the coefficients, see the module.
    order, order2
        Orders of the derivative in x and y.
    x, y
        The arguments.
    piece, piece2
        Numbers of the piece along both axes.
    """
    p = int(pieces[0])
    cell = table_chosen(axis, piece)
    cell2 = table_chosen(other, piece2)
    row = table_row(axis, cell) * (int(other[0]) + 2) + table_row(other, cell2)
    dx = table_from(axis, x, cell)
    dy = table_from(other, y, cell2)
    found = 0.0
    for i in range(p - int(order)):
        j = p - 1 - i
        inner = 0.0
        for k in range(p - int(order2)):
            n = p - 1 - k
            factor = table_power(n, order2)
            inner = inner * dy + factor * pieces[1 + (row * p + j) * p + n]
        found = found * dx + table_power(j, order) * inner
    return found


# Pieces of tables of one argument, and of two.
PIECES = ("table.piece", "table.piece2")
KERNELS = (table_knot, table_rate, table_piece, table_piece2)


def functions() -> list[Callable[..., Any]]:
    """Return all kernels of this module."""
    return [f for name, f in globals().items() if name.startswith("table_")]


def on_data(kernel: Callable[..., Any], count: int) -> Callable[..., Any]:
    """Adapt a kernel of arrays to arguments of type Data.

    The result is a function that passes the arrays `values` of its first `count`
    arguments, and its other arguments unchanged.
    """
    return lambda *args: kernel(*(a.values for a in args[:count]), *args[count:])


def differentiated(g: Builder, op: str, args: tuple[int, ...], which: int) -> int:
    """Return the node of the partial derivative of a piece.

    op, args : the operation of the piece, and its arguments.
    which : 0 or 1, the argument of the table by which it is differentiated.
    """
    data = 1 + (op == "table.piece2")
    pieces, at = g.payload(args[data]), data + 1 + which
    order = g.value(args[at])
    assert order is not None
    if order + 1.0 >= pieces.numbers[0]:
        return g.zero
    return g.call(op, *args[:at], g.constant(order + 1.0), *args[at + 1 :])


def called(g: Builder, axes: tuple[Data, ...], pieces: Data, args: list[int]) -> int:
    """Return the node of a table's value.

    axes, pieces : data of the table, see the module.
    args : nodes of its arguments.
    """
    chosen = [
        g.call("floor", g.call("table.knot", g.data(axis), x))
        for axis, x in zip(axes, args, strict=True)
    ]
    op = "table.piece" if len(axes) == 1 else "table.piece2"
    data = map(g.data, (*axes, pieces))
    return g.call(op, *data, *[g.zero] * len(axes), *args, *chosen)


def cell_of(g: Builder, discrete: int) -> tuple[Data, int] | None:
    """Return axis and argument of the table of which `discrete` is the cell number.

    None if `discrete` is no cell number.
    """
    (inner,) = g.args[discrete][:1] or (discrete,)
    if g.ops[discrete] != "floor" or g.ops[inner] != "table.knot":
        return None
    axis, x = g.args[inner]
    return g.payload(axis), x


def is_smooth(g: Builder, discrete: int) -> bool:
    """Whether `discrete` is the cell number of a table without kinks at its knots."""
    cell = cell_of(g, discrete)
    return cell is not None and cell[0].numbers[1] > 0.0


def at_ends(g: Builder, axis: Data, x: int) -> int:
    """Return the graph node of a function of x that steps only at a table's ends.

    It is -1 before the first point, 0 within the table and 1 past its end.

    axis : data of the table.
    x : the node of the argument.
    """
    ends = _axis(axis.name, axis.numbers[[FIRST, -1]], (0.0, 0.0, *axis.numbers[3:4]))
    return g.call("floor", g.call("table.knot", g.data(ends), x))


def highest_orders(g: Builder, nodes: Iterable[int]) -> dict[int, int]:
    """Return the highest order of derivative of tables in `nodes` and below.

    The result maps the node of the cell number, along one argument, to the order.
    """
    found: dict[int, int] = {}
    for n in g.cone(nodes):
        if g.ops[n] in PIECES:
            orders = written(g, n).orders
            for order, cell in zip(orders, g.args[n][-len(orders) :], strict=True):
                found[cell] = max(order, found.get(cell, 0))
    return found


def continuous(axis: Data, order: int) -> tuple[float, float]:
    """Return the open range of knot numbers in which a derivative is continuous.

    The range (0, 0) is empty: the derivative jumps at each knot.

    axis : data of the table.
    order : the order of the derivative.
    """
    m, smooth, period, ends = axis.values[:FIRST]
    if order > smooth:
        return 0.0, 0.0
    if period:
        return -inf, inf
    return (0.0, m) if ends or order else (-1.0, m + 1.0)


class Written(NamedTuple):
    """Operation of a table at a graph node: name of the table, orders, arguments.

    `orders` has the order of the derivative in each argument, `args` the nodes of the
    arguments.
    """

    name: str
    orders: tuple[int, ...]
    args: tuple[int, ...]


def written(g: Builder, n: int) -> Written:
    """Return table, orders of derivative and arguments of a table's operation n.

    A knot number counts as a value of order 0.
    """
    args = g.args[n]
    name = g.payload(args[0]).name
    if not g.ops[n].startswith("table.piece"):
        return Written(name, (0,), args[1:])
    count = 2 if g.ops[n] == "table.piece2" else 1
    orders = args[count + 1 : 2 * count + 1]
    found = tuple(int(g.value(a) or 0.0) for a in orders)
    return Written(name, found, args[2 * count + 1 : 3 * count + 1])


def arguments(g: Builder, n: int) -> tuple[int, ...]:
    """Return the argument nodes of an operation, without data for a table's operation.

    n : the node of the operation.
    """
    return written(g, n).args if g.ops[n].startswith("table.") else g.args[n]


def knots_between(axis: Data, first: float, last: float) -> Iterator[tuple[int, float]]:
    """Yield the knots from `first` to `last`, in this order, each with its number."""
    _, _, period, _, *knots = axis.values
    turns = [0.0, 0.0]
    if period:
        knots, turns = knots[:-1], [(x - knots[0]) // period for x in (first, last)]
    up = 1 if first < last else -1
    numbered = list(enumerate(knots))[::up]
    for turn in range(int(turns[0]), int(turns[1]) + up, up):
        for k, knot in numbered:
            x = turn * period + knot
            if min(first, last) <= x <= max(first, last):
                yield turn * len(knots) + k, x


def ended(g: Builder, knot: int, cell: float) -> tuple[Written, float] | None:
    """Return a table that ends the run beyond its points, and the x of that end.

    None if the cell is within the table, or if the table has values beyond its ends.

    knot : node of the knot number of a table.
    cell : number of the cell in which its argument lies.
    """
    if g.ops[knot] != "table.knot":
        return None
    axis = g.payload(g.args[knot][0]).values
    if not axis[3] or 0.0 <= cell < axis[0]:
        return None
    return written(g, knot), axis[FIRST] if cell < 0.0 else axis[-1]


def last_level(g: Builder, knot: int) -> float:
    """Return the knot number of the last point of a table that ends the run beyond it.

    inf for a table with values beyond its ends, and for other nodes.

    knot : node of the knot number of a table.
    """
    axis = g.payload(g.args[knot][0]).values if g.ops[knot] == "table.knot" else None
    return float(axis[0]) if axis is not None and axis[3] else inf


# --- From points to pieces

OUTSIDE = ("error", "hold", "extend", "repeat")
INTERPOLATIONS = ("linear", "cubic", "monotone")
CONTINUOUS = {"linear": 0.0, "monotone": 1.0, "cubic": 2.0}  # continuous derivatives


def _axis(name: str, knots: Floats | list[float], head: tuple[float, ...]) -> Data:
    import numpy as np

    return Data(name, np.array([len(knots) - 1.0, *head, *knots]))


def axes_and_pieces(
    name: str, points: tuple[Floats, ...], values: Floats, how: str, outside: str
) -> tuple[tuple[Data, ...], Data]:
    """Return the axes and pieces of a table.

    Parameters
    ----------
    name : str
        Name of the table.
    points
        For each argument its values (n,), in ascending order.
    values : ndarray, shape (n,) or (n, n2)
        Values of the table at the points.
    how, outside
        One of INTERPOLATIONS, and of OUTSIDE.
    """
    import numpy as np

    found = values
    for x in points:  # each argument has its cells and powers removed from the stack
        found = np.moveaxis(_pieces(x, found, how, outside), (0, 1), (-1, -2))
    if len(points) == 2:  # cells, powers; cells, powers of the second
        found = np.moveaxis(found, 1, 2)
    if outside == "error":
        for k in range(len(points)):
            cells = np.moveaxis(found, k, 0)
            cells[0] = cells[-1] = np.nan
    periods = [x[-1] - x[0] if outside == "repeat" else 0.0 for x in points]
    axes = tuple(
        _axis(name, x, (CONTINUOUS[how], period, float(outside == "error")))
        for x, period in zip(points, periods, strict=True)
    )
    return axes, Data(name, np.array([found.shape[-1], *found.ravel()]))


def _pieces(x: Floats, y: Floats, how: str, outside: str) -> Floats:
    """Return polynomial coefficients (p, m + 2, ...) through the points of a table.

    The first and the last piece are those outside the points.

    x : (m + 1,), the arguments of the points.
    y : (m + 1, ...).
    how, outside : see `axes_and_pieces`.
    """
    import numpy as np

    if how == "linear":
        width = np.diff(x).reshape(-1, *[1] * (y.ndim - 1))
        inner = np.stack([y[:-1], np.diff(y, axis=0) / width])
    else:
        inner = _by_scipy(x, y, how, outside)[::-1]
    ends = np.zeros((2, *inner[:, 0].shape))
    ends[0] = inner[:, 0]
    # The last piece about its upper end, where it is y and has this slope.
    h = x[-1] - x[-2]
    slope = sum(j * inner[j, -1] * h ** (j - 1) for j in range(1, len(inner)))
    ends[1, 0], ends[1, 1] = y[-1], slope
    ends[:, 1 + (outside == "extend") :] = 0.0
    return np.concatenate([ends[0][:, None], inner, ends[1][:, None]], axis=1)


def _by_scipy(x: Floats, y: Floats, how: str, outside: str) -> Floats:
    """Return coefficients (4, m, ...) of cubic pieces by scipy, highest power first.

    x : (m + 1,), the arguments of the points.
    y : (m + 1, ...).
    how, outside : see `axes_and_pieces`.
    """
    import numpy as np
    from scipy.interpolate import CubicSpline, PchipInterpolator

    again = outside == "repeat"
    if how == "cubic":
        return np.asarray(
            CubicSpline(x, y, bc_type="periodic" if again else "not-a-knot").c
        )
    if again:  # with as many points beyond each end as the slopes there depend on
        period, k = x[-1] - x[0], min(2, len(x) - 1)
        x = np.concatenate([x[-1 - k : -1] - period, x, x[1 : 1 + k] + period])
        y = np.concatenate([y[-1 - k : -1], y, y[1 : 1 + k]])
        return np.asarray(PchipInterpolator(x, y).c[:, k:-k])
    return np.asarray(PchipInterpolator(x, y).c)
