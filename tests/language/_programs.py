"""Random expressions: made on a graph, and by mpmath with many digits."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, TypeAlias

import mpmath as mp
from hypothesis import strategies as st

from lagsim.language.graph import Graph
from lagsim.language.parser import parse
from tests.language._cases import CASES, DIGITS

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

# The operation, and which of the values so far are its arguments.
Program: TypeAlias = "Sequence[tuple[str, int, int, int]]"

VARIABLES = ("x", "y", "z")
CONSTANTS = ("0", "1", "2", "-1", "0.5", "0.1", "3.7", "-2.25")
SMOOTH = (
    "add", "sub", "mul", "div", "neg", "square", "cube", "half power",
    "sin", "cos", "tan", "atan", "atan2", "sinh", "tanh", "asinh", "exp", "log",
    "sqrt", "hypot",
)  # fmt: skip
# atan2 jumps by a turn on its cut, where no first-order bound of rounding holds.
CONTINUOUS = sorted({*SMOOTH, "abs", "min", "max"} - {"atan2"})
CORNERED = ("abs", "min", "max", "if", "sign", "heaviside")
_POWERS = {"square": "2", "cube": "3", "half power": "1.5"}


class AsWritten(Graph):
    """A graph that keeps every operation as written, for running error analysis."""

    def call(self, op: str, *args: int) -> int:
        return self.unsimplified(op, args)


def build(g: Graph, text: str) -> int:
    """Return the node of a text."""
    return parse(text).build(g, g.variable)


class OutsideError(Exception):
    """A value that is not real, not finite or out of the range of interest."""


def programs(
    operations: Sequence[str] = SMOOTH + CORNERED, longest: int = 12
) -> st.SearchStrategy[Program]:
    place = st.integers(0, longest + len(VARIABLES) + len(CONSTANTS))
    line = st.tuples(st.sampled_from(operations), place, place, place)
    return st.lists(line, min_size=1, max_size=longest)


states = st.tuples(*(st.floats(-4.0, 4.0, width=32) for _ in VARIABLES)).map(
    lambda values: dict(zip(VARIABLES, values, strict=True))
)


def perform(program: Program, leaves: Sequence[Any], call: Callable[..., Any]) -> Any:
    """Return the last value of a program; later lines favour recent values."""
    values = list(leaves)
    for op, *places in program:
        i, j, k = (values[-1 - place % len(values)] for place in places)
        if op == "if":
            values.append(call("if", call("lt", i, j), k, i))
        elif op in _POWERS:
            values.append(call("pow", i, leaves[-1 - list(_POWERS).index(op)]))
        else:
            arity = len(CASES[op].domain)
            values.append(call(op, *(i, j)[:arity]))
    return values[-1]


def on_graph(g: Graph, program: Program) -> int:
    leaves = [g.variable(name) for name in VARIABLES]
    leaves += [g.constant(float(c)) for c in (*CONSTANTS, "1.5", "3", "2")]
    return perform(program, leaves, g.call)  # type: ignore[no-any-return]


def exactly(program: Program, state: Mapping[str, Any]) -> Any:
    """Return the value with DIGITS digits.

    Raises
    ------
    OutsideError
        Where a value on the way is not real, or not between 1e-30 and 1e30 in size.
    """

    def call(op: str, *args: Any) -> Any:
        if op == "lt":
            return args[0] < args[1]
        if op == "if":
            return args[1] if args[0] else args[2]
        try:
            value = CASES[op].exact(*args)
        except (ZeroDivisionError, ValueError, OverflowError):
            raise OutsideError from None
        if isinstance(value, mp.mpc) or not (value == 0 or 1e-30 < abs(value) < 1e30):
            raise OutsideError
        return value

    with mp.workdps(DIGITS):
        leaves = [mp.mpf(state[name]) for name in VARIABLES]
        leaves += [mp.mpf(c) for c in (*CONSTANTS, "1.5", "3", "2")]
        return perform(program, leaves, call)
