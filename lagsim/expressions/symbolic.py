"""Graph -> sympy: what a person reads, and what tests compare with.

Each row of the functions table has its sympy twin, so nothing is parsed again. Never
on the path of a run.
"""

from __future__ import annotations

import math
from fractions import Fraction
from typing import TYPE_CHECKING, Any

from lagsim.expressions.functions import OPERATIONS
from lagsim.expressions.graph import CONSTANT, TRUTH, VARIABLE

if TYPE_CHECKING:
    from collections.abc import Iterable

    from lagsim.expressions.graph import Graph

# Constants with a denominator up to this (1/2, 3/4: often made by differentiation and
# folding) are shown as fractions, others as decimals.
LARGEST_DENOMINATOR = 16
# Whole numbers up to here are shown with all their digits.
LARGEST_WHOLE = 10**9


def symbol(name: str) -> Any:
    """Give the sympy symbol of the variable `name`: real, and of exactly this name."""
    import sympy

    return sympy.Symbol(name, real=True)


def to_sympy(g: Graph, nodes: Iterable[int]) -> list[Any]:
    """Give `nodes` as sympy expressions.

    Numbers keep their value to the last bit. sympy simplifies as it builds, so that an
    expression without a finite value may become its `zoo` or `nan`.

    Raises
    ------
    TypeError, ValueError
        Where sympy finds that a condition compares what is not real.
    """
    import sympy

    nodes = list(nodes)
    found: dict[int, Any] = {}
    for n in g.cone(nodes):
        op = g.ops[n]
        if op == VARIABLE:
            found[n] = symbol(str(g.payload(n)))
        elif op == TRUTH:
            found[n] = sympy.true if g.payload(n) else sympy.false
        elif op == CONSTANT:
            value = g.value(n)
            assert value is not None
            found[n] = _number(value)
        else:
            found[n] = OPERATIONS[op].sympy(sympy, *(found[a] for a in g.args[n]))
    return [found[n] for n in nodes]


def _number(x: float) -> Any:
    import sympy

    if not math.isfinite(x):
        return sympy.Float(x)
    exact = Fraction(x)
    if exact.denominator > LARGEST_DENOMINATOR or abs(exact) > LARGEST_WHOLE:
        return sympy.Float(x)
    return sympy.Rational(exact.numerator, exact.denominator)
