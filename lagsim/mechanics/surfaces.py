"""Surfaces at which discrete functions step, and the side of the state on each.

A discrete function of the state (`x > 0`, `sign(x_dot)`, `floor(x)`) steps where an
expression meets 0, or a whole number. Functions that step together share a `Side`: a
mode variable that is -1 or 1, or the whole number below. While the motion slides along
a surface the variable lies between the values of its two sides; it also lies between
these values where the expression keeps its level on an interval, as in a dead zone.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from lagsim.language.functions import JOINING, OPERATIONS, STEPS
from lagsim.language.graph import CONSTANT, TRUTH, VARIABLE
from lagsim.language.tables import written

if TYPE_CHECKING:
    from lagsim.language.graph import Graph


WHOLE = ("floor", "ceil")


class Surface(NamedTuple):
    """A part of a discrete function that steps where `node` meets a value.

    Attributes
    ----------
    discrete
        The node of the comparison or of the sign, heaviside, floor or ceil.
    op
        The operation of `discrete`.
    node
        The expression whose value 0 (a whole number for floor and ceil) is the
        surface; a - b for a comparison a < b.
    """

    discrete: int
    op: str
    node: int


def joined_conditions(g: Graph, discrete: int) -> list[int]:
    """Return the nodes `and`, `or`, `not` at and below a condition.

    The nodes are in the order of evaluation.

    discrete : the node of the condition.
    """
    found: set[int] = set()
    stack = [discrete]
    while stack:
        n = stack.pop()
        if g.ops[n] in JOINING and n not in found:
            found.add(n)
            stack += g.args[n]
    return sorted(found)


def surfaces(g: Graph, discrete: int) -> tuple[Surface, ...]:
    """Return the surfaces of a discrete function, one per comparison or step."""
    joined = joined_conditions(g, discrete)
    parts = {discrete, *(a for n in joined for a in g.args[n])} - set(joined)
    found = []
    for n in sorted(parts):
        op, args = g.ops[n], g.args[n]
        if op in STEPS:
            found.append(Surface(n, op, args[0]))
        elif args:  # else a truth value
            found.append(Surface(n, op, g.call("sub", *args)))
    return tuple(found)


class Side(NamedTuple):
    """Position of the state relative to a surface, or to the levels of `floor`.

    Attributes
    ----------
    variable
        The name of the mode variable.
    sliding
        The name of a variable that is 1 while the motion follows the surface, else 0.
    slack
        The name of the distance from its level up to which the expression counts as on
        the side selected.
    departed
        The name of the level that the motion leaves, for a surface that is only shown:
        past another level the slack does not count.
    node
        The expression whose value 0, or whole number, is the surface.
    whole
        Whether the switch steps at every whole number.
    text
        Text of one of the switches, approximately as in the model file.
    floor
        The name of the variable below which no argument of a root of `node` falls (see
        `switches.Roots`); empty for none.
    smooth, continuous
        Open intervals of levels. The motion crosses levels in `smooth` without a jump
        of y', and levels in `continuous` without a jump of velocities: there the rate
        of `node` determines the side.
    shown
        Whether the surface is only in conditions and output: it has no influence on the
        motion and is not located. It is on its level while the motion stays there.
    """

    variable: str
    sliding: str
    slack: str
    departed: str
    node: int
    whole: bool
    text: str
    floor: str = ""
    smooth: tuple[float, float] = (0.0, 0.0)
    continuous: tuple[float, float] = (0.0, 0.0)
    shown: bool = False


class Corner(NamedTuple):
    """Surface at which the residuals of equality or limited rows have a kink.

    Attributes
    ----------
    push : str
        The name of the variable p, the generalized force along du/dq, or du/dq'.
    levers : tuple of int, length 1 + m
        Nodes of mode variables: the components of the forces, then of each row, along
        this gradient. Their jumps at the surface are d and C.
    rows : tuple of str
        The names of the rows with a kink.
    moving : bool
        Whether the surface depends on velocities.
    equal : bool
        Whether one of the rows is an equality, so that velocities may jump.
    """

    push: str
    levers: tuple[int, ...]
    rows: tuple[str, ...]
    moving: bool
    equal: bool = True


def oriented(g: Graph, surface: Surface) -> tuple[int, int]:
    """Return an expression that vanishes on the surface, and a sign, 1 or -1.

    Expressions that differ by a sign or a constant factor have one common result. The
    expression of the surface is positive where sign times the result is positive.
    """
    node, sign = surface.node, 1
    if surface.op in WHOLE:
        return node, sign
    while True:
        opposite = g.call("neg", node)
        if g.ops[node] == "neg" or (opposite < node and g.ops[node] == "sub"):
            node, sign = opposite, -sign
        elif g.ops[node] == "mul" and (c := g.value(g.args[node][0])):
            node, sign = g.args[node][1], sign if c > 0 else -sign
        elif g.ops[node] == "div" and (c := g.value(g.args[node][1])):
            node, sign = g.args[node][0], sign if c > 0 else -sign
        else:
            return node, sign


def stepped(g: Graph, op: str, side: int, sign: int) -> int:
    """Return the node of the value of a discrete function, given its mode variable.

    Where the expression keeps its level on an interval, the variable is 0, or a whole
    number minus 1/2, and the value is the function's at the level.

    op : the function, or a comparison, whose truth is returned.
    side : the node of its mode variable.
    sign : the sign of its expression relative to the side, see `oriented`.
    """
    if op == "floor":
        return g.call("ceil", side)
    if op == "ceil":
        return g.call("floor", g.call("add", side, g.one))
    turned = side if sign > 0 else g.call("neg", side)
    if op == "sign":
        return turned
    if op == "heaviside":
        return g.call("if", g.call("ge", turned, g.zero), g.one, g.zero)
    return g.call(op, turned, g.zero)


def expression_text(g: Graph, *nodes: int, depth: int = 6) -> str:
    """Return expressions as text for a message; `...` replaces nodes below `depth`."""
    return ", ".join(_text(g, n, depth)[1] for n in nodes)


def _text(g: Graph, n: int, depth: int) -> tuple[int, str]:
    """Return the binding power and the text of a node.

    `...` replaces nodes below `depth`.
    """
    op, args = g.ops[n], g.args[n]
    if op in (VARIABLE, TRUTH):
        return 9, str(g.payload(n))
    if op == CONSTANT:
        x = g.value(n)
        assert x is not None
        return (9 if x >= 0.0 else 7), f"{x:.12g}"
    if depth == 0:
        return 9, "..."
    row = OPERATIONS[op]
    if row.sign:
        power, sign = row.binds, row.sign
        parts = [_text(g, a, depth - 1) for a in args]
        # The right operand of -, / and comparisons, and the base of ^, bind tighter.
        least = [power + (op == "pow"), power + (op in ("sub", "div"))][-len(parts) :]
        shown = [
            f"({text})" if p < q else text
            for (p, text), q in zip(parts, least, strict=True)
        ]
        return power, sign + shown[0] if row.arity == 1 else sign.join(shown)
    if row.data:
        op, orders, args = written(g, n)
        op += "'" * sum(orders)
    return 9, f"{op}({expression_text(g, *args, depth=depth - 1)})"
