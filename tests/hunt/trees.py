"""Expressions of random models: their texts, and their Taylor series piece by piece.

A tree is written for lagsim by `text`. The referee evaluates it by `Reading.value` from
series of the variables: arrays (ORDER + 1,) of coefficients of powers of the time from
an instant. A *switch* is a node whose function of its argument is smooth between given
points: the *cell* of a switch is the number of the interval that its argument is in,
and a reading has one cell for each switch that it evaluates.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline

from tests.hunt.series import UndecidedError, circle, constant, times

if TYPE_CHECKING:
    from collections.abc import Callable

# Arguments this close to a point where a switch changes are at it, relative to 1 or it.
TIE = 1e-11


@dataclass(eq=False)
class Tree:
    """A node. kind : + * var const sin cos, a kind of switch, or a condition's.

    args : nodes.
    data : a number, a name, a `Table`.
    form : which spelling `text` takes
    """

    kind: str
    args: tuple[Tree, ...] = ()
    data: Any = None
    form: int = 0
    name: str = ""

    def nodes(self):
        """Return all nodes, this one last."""
        return [*itertools.chain(*(x.nodes() for x in self.args)), self]

    @property
    def is_of_modes(self):
        """Whether the value changes at events alone."""
        return all(x.data[0] == "u" for x in self.nodes() if x.kind == "var")


@dataclass(eq=False)
class Table:
    """A table as lagsim has it: linear or cubic, with `hold`, `extend` or `repeat`."""

    name: str
    x: list[float]
    y: list[float]
    kind: str
    outside: str
    pieces: Any = field(init=False)

    def __post_init__(self):
        x, y = np.array(self.x), np.array(self.y)
        if self.kind == "linear":
            self.pieces = np.stack([np.diff(y) / np.diff(x), y[:-1]])
        else:
            again = self.outside == "repeat"
            self.pieces = CubicSpline(
                x, y, bc_type="periodic" if again else "not-a-knot"
            ).c

    @property
    def period(self):
        return self.x[-1] - self.x[0]

    def cell(self, x):
        turns = 0
        if self.outside == "repeat":
            turns = math.floor((x - self.x[0]) / self.period)
            x -= turns * self.period
        n = len(self.x) - 1
        k = int(np.searchsorted(self.x, x, side="right")) - 1
        if self.outside == "repeat":
            return turns * n + min(max(k, 0), n - 1)
        return k

    def bounds(self, cell):
        n = len(self.x) - 1
        if self.outside == "repeat":
            turns, k = divmod(cell, n)
            shift = turns * self.period
            return self.x[k] + shift, self.x[k + 1] + shift
        low = -math.inf if cell < 0 else self.x[cell]
        return low, math.inf if cell >= n else self.x[cell + 1]

    def polynomial(self, cell):
        """Return the left end and the coefficients, highest power first."""
        n = len(self.x) - 1
        if self.outside == "repeat":
            turns, k = divmod(cell, n)
            return self.x[k] + turns * self.period, self.pieces[:, k]
        if 0 <= cell < n:
            return self.x[cell], self.pieces[:, cell]
        end, k = (0, 0) if cell < 0 else (-1, n - 1)
        slope = 0.0
        if self.outside == "extend":
            c, width = self.pieces[:, k], self.x[k + 1] - self.x[k]
            slope = np.polyval(np.polyder(c), 0.0 if cell < 0 else width)
        return self.x[end], np.array([slope, self.y[end]])


# --- the kinds of switches ------------------------------------------------------------


class Kind(NamedTuple):
    """A kind of switch.

    of : the argument, from the series of the node's arguments
    cell, bounds : the cell of a number, and the bounds of a cell
    value : the value, from the cell, the argument and the arguments
    """

    of: Callable[..., Any]
    cell: Callable[..., int]
    bounds: Callable[..., tuple[float, float]]
    value: Callable[..., Any]


def _side(_, x):
    return 1 if x >= 0.0 else -1


def _half(_, cell):
    return {1: (0.0, math.inf), -1: (-math.inf, 0.0), 0: (0.0, 0.0)}[cell]


def _whole(_, x):
    return math.floor(x)


def _between(_, cell):
    return float(cell), float(cell + 1)


def _looked_up(table, cell, x, _):
    left, c = table.polynomial(cell)
    d = x - constant(left)
    found = constant(c[0])
    for more in c[1:]:
        found = times(found, d) + constant(more)
    return found


def _first(_data, a):
    return a


def _difference(_data, a, b):
    return a - b


def _number(_data, cell, _x, _args):
    return constant(cell)


def _step(_data, cell, _x, _args):
    return constant(float(cell >= 0))


def _size(_data, cell, x, _args):
    return cell * x


def _least(_data, cell, _x, args):
    return args[0] if cell < 0 else args[1]


def _greatest(_data, cell, _x, args):
    return args[1] if cell < 0 else args[0]


def _remainder(data, cell, _x, args):
    return args[0] - constant(data * cell)


KINDS = {
    "sign": Kind(_first, _side, _half, _number),
    "heaviside": Kind(_first, _side, _half, _step),
    "abs": Kind(_first, _side, _half, _size),
    "min": Kind(_difference, _side, _half, _least),
    "max": Kind(_difference, _side, _half, _greatest),
    "floor": Kind(_first, _whole, _between, _number),
    "mod": Kind(lambda m, a: a / m, _whole, _between, _remainder),
    "table": Kind(_first, Table.cell, Table.bounds, _looked_up),
    # Its argument is left - right.
    "compare": Kind(_difference, _side, _half, _number),
}
# The cells of these are the sides of one point: -1, 1, and 0 for what stays there.
HALVES = ("sign", "heaviside", "abs", "min", "max", "compare")
# These have no jump, so nothing slides along them.
CONTINUOUS = ("abs", "min", "max", "table")


# --- texts ----------------------------------------------------------------------------

TEXTS: dict[str, list[str]] = {
    "sign": ["sign({0})", "if({0} > 0, 1, if({0} < 0, -1, 0))"],
    "heaviside": ["heaviside({0})", "if({0} >= 0, 1, 0)", "if({0} < 0, 0, 1)"],
    "abs": [
        "abs({0})", "max({0}, -({0}))", "sqrt(({0})^2)", "hypot({0}, 0)",
        "if({0} < 0, -({0}), {0})", "({0})*sign({0})",
    ],
    "min": ["min({0}, {1})", "if({0} < {1}, {0}, {1})",
            "({0} + ({1}) - abs({0} - ({1})))/2", "-max(-({0}), -({1}))"],
    "max": ["max({0}, {1})", "if({0} > {1}, {0}, {1})",
            "({0} + ({1}) + abs({0} - ({1})))/2"],
    "floor": ["floor({0})", "-ceil(-({0}))", "(({0}) - mod({0}, 1))"],
    "mod": ["mod({0}, {m})", "(({0}) - {m}*floor(({0})/{m}))"],
    "+": ["({0} + {1})", "({0} - (-({1})))"],
    "*": ["({0})*({1})"],
    "sin": ["sin({0})"], "cos": ["cos({0})"],
    "table": ["{data.name}({0})"],
    "if": ["if({0}, {1}, {2})", "if(not ({0}), {2}, {1})"],
    "and": ["({0} and {1})"], "or": ["({0} or {1})"], "not": ["(not {0})"],
}  # fmt: skip


def text(tree, names, defined=None):
    """Return a tree as lagsim reads it.

    names : variable -> text.
    defined : gathers the texts of nodes that have a name
    """
    if tree.name and defined is not None:
        if tree.name not in defined:
            defined[tree.name] = _written(tree, names, defined)
        return tree.name
    return _written(tree, names, defined)


def _written(tree, names, defined):
    if tree.kind == "var":
        return names[tree.data]
    if tree.kind == "const":
        return repr(tree.data) if tree.data >= 0 else f"({tree.data!r})"
    args = [text(x, names, defined) for x in tree.args]
    if tree.kind == "compare":
        return f"{args[0]} {tree.data} {args[1]}"
    forms = TEXTS[tree.kind]
    return forms[tree.form % len(forms)].format(*args, m=tree.data, data=tree.data)


def number(value):
    return Tree("const", data=float(value))


def plus(a, b):
    return Tree("+", (a, b))


def product(a, b):
    return Tree("*", (a, b))


# --- evaluation -----------------------------------------------------------------------


@dataclass
class Reading:
    """Trees evaluated at an instant.

    series : variable -> (ORDER + 1,)
    cells : switch -> cell; missing ones are found from the argument's value
    choose : called with this reading, a switch, the point that its argument is at, and
        the cells on both sides; returns a cell
    rounded : called likewise where an argument of modes alone is at a point but for
        rounding
    """

    series: dict[str, Any]
    cells: dict[Tree, int]
    choose: Callable[..., int] | None = None
    rounded: Callable[..., int] | None = None
    arguments: dict[Tree, Any] = field(default_factory=dict)
    known: dict[Any, Any] = field(default_factory=dict)

    def value(self, tree):
        """Return the series of a tree; of a condition, True or False."""
        found = self.known.get(tree)
        if found is None:
            found = self.known[tree] = METHODS[tree.kind](self, tree)
        return found

    def slope(self, tree, by):
        """Return the series of the derivative of a tree by a variable, cells fixed."""
        key = (tree, by)
        if key not in self.known:
            self.known[key] = self._slope(tree, by)
        return self.known[key]

    def _slope(self, tree, by):
        kind, args = tree.kind, tree.args
        if kind == "var":
            return constant(float(tree.data == by))
        if kind == "if":
            return self.slope(args[1] if self.value(args[0]) else args[2], by)
        if kind == "*" and args[0].kind == "const":
            return args[0].data * self.slope(args[1], by)
        self.value(tree)
        if kind in ("const", "sign", "heaviside", "floor"):
            return constant(0.0)
        d = [self.slope(a, by) for a in args]
        if kind == "+":
            return d[0] + d[1]
        if kind == "*":
            return times(self.value(args[0]), d[1]) + times(self.value(args[1]), d[0])
        if kind in ("sin", "cos"):
            sine, cosine = self._circle(args[0])
            return times(cosine if kind == "sin" else -sine, d[0])
        return self._slope_of_switch(tree, d)

    def _slope_of_switch(self, tree, d):
        """Return the derivative of a switch that is continuous within its cell."""
        kind, cell = tree.kind, self.cells[tree]
        if kind == "mod":
            return d[0]
        if kind == "abs":
            return cell * d[0]
        if kind in ("min", "max"):
            return d[0] if (cell < 0) == (kind == "min") else d[1]
        left, c = tree.data.polynomial(cell)
        step, found = self.value(tree.args[0]) - constant(left), constant(0.0)
        for more in np.polyder(c):
            found = times(found, step) + constant(more)
        return times(found, d[0])

    def _var(self, tree):
        return self.series[tree.data]

    def _const(self, tree):
        return constant(tree.data)

    def _plus(self, tree):
        return self.value(tree.args[0]) + self.value(tree.args[1])

    def _product(self, tree):
        if tree.args[0].kind == "const":
            return tree.args[0].data * self.value(tree.args[1])
        return times(self.value(tree.args[0]), self.value(tree.args[1]))

    def _circle(self, tree):
        """Return sine and cosine of a series."""
        key = ("circle", tree)
        if key not in self.known:
            self.known[key] = circle(self.value(tree))
        return self.known[key]

    def _sine(self, tree):
        return self._circle(tree.args[0])[0]

    def _cosine(self, tree):
        return self._circle(tree.args[0])[1]

    def _if(self, tree):
        return self.value(tree.args[1] if self.value(tree.args[0]) else tree.args[2])

    def _and(self, tree):
        return all(values(self, tree))

    def _or(self, tree):
        return any(values(self, tree))

    def _not(self, tree):
        return not self.value(tree.args[0])

    def _switch(self, tree):
        kind = KINDS[tree.kind]
        args = [self.value(x) for x in tree.args]
        x = kind.of(tree.data, *args)
        self.arguments[tree] = x
        if tree not in self.cells:
            self.cells[tree] = self._cell(tree, kind, x[0])
        cell = self.cells[tree]
        if tree.kind == "compare":
            if cell == 0:
                return "=" in tree.data
            return (cell > 0) == (tree.data[0] == ">")
        return kind.value(tree.data, cell, x, args)

    def _cell(self, tree, kind, x):
        cell = kind.cell(tree.data, x)
        low, high = kind.bounds(tree.data, cell)
        for point, inside in ((low, 1.0), (high, -1.0)):
            tie = TIE * max(1.0, abs(point))
            if math.isfinite(point) and abs(x - point) <= tie:
                other = kind.cell(tree.data, point - inside * 10.0 * tie)
                mine = kind.cell(tree.data, point + inside * 10.0 * tie)
                choose = self.choose
                if tree.is_of_modes:
                    if x == point:
                        return 0 if tree.kind in HALVES else max(mine, other)
                    choose = self.rounded
                if choose is None:
                    raise UndecidedError(f"a value at a point of {tree.kind}")
                return choose(self, tree, point, *sorted((mine, other)))
        return cell


def values(reading, tree):
    """Return the values of all arguments, evaluated without short circuit."""
    return [reading.value(x) for x in tree.args]


METHODS = dict.fromkeys(KINDS, Reading._switch) | {
    "var": Reading._var, "const": Reading._const, "+": Reading._plus,
    "*": Reading._product, "sin": Reading._sine, "cos": Reading._cosine,
    "if": Reading._if, "and": Reading._and, "or": Reading._or, "not": Reading._not,
}  # fmt: skip
