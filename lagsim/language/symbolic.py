"""Graph -> sympy: what a person reads, and what tests compare with.

Each row of the functions table has its sympy twin, so nothing is parsed again. Never
on the path of a run.
"""

from __future__ import annotations

import math
from fractions import Fraction
from typing import TYPE_CHECKING, Any

from lagsim.language.functions import OPERATIONS
from lagsim.language.graph import CONSTANT, TRUTH, VARIABLE

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable, Mapping

    from lagsim.language.graph import Graph

# Constants with a denominator up to this (1/2, 3/4: often made by differentiation and
# folding) are shown as fractions, others as decimals.
LARGEST_DENOMINATOR = 16
# Whole numbers up to here are shown with all their digits.
LARGEST_WHOLE = 10**9


def symbol(name: str) -> Any:
    """Give the sympy symbol of the variable `name`: real, and of exactly this name."""
    import sympy

    return sympy.Symbol(name, real=True)


def to_sympy(
    g: Graph,
    nodes: Iterable[int],
    *,
    known: dict[int, Any] | None = None,
    twins: Mapping[str, Callable[..., Any]] | None = None,
    number: Callable[[float], Any] | None = None,
) -> list[Any]:
    """Give `nodes` as sympy expressions.

    sympy simplifies as it builds, so that an expression without a finite value may
    become its `zoo` or `nan`.

    Parameters
    ----------
    g, nodes
        What to give.
    known
        What stands for some of the nodes; what is below them is not reached. What is
        found is added.
    twins
        What stands for some of the functions, instead of the table's twins.
    number
        What stands for a constant; as it is, numbers keep their value to the last bit.

    Raises
    ------
    TypeError, ValueError
        Where sympy finds that a condition compares what is not real.
    """
    import sympy

    nodes = list(nodes)
    number, twins = number or _number, twins or {}
    found = {} if known is None else known
    for n in _above(g, nodes, found):
        op = g.ops[n]
        if op == VARIABLE:
            found[n] = symbol(str(g.payload(n)))
        elif op == TRUTH:
            found[n] = sympy.true if g.payload(n) else sympy.false
        elif op == CONSTANT:
            value = g.value(n)
            assert value is not None
            found[n] = number(value)
        elif op in _CHAINS:  # sympy sorts what it adds, or multiplies, each time
            signed = _operands(g, n, found)
            args = [-found[a] if negative else found[a] for a, negative in signed]
            found[n] = (sympy.Mul if op == "mul" else sympy.Add)(*args)
        else:
            args = [found[a] for a in g.args[n]]
            twin = twins.get(op)
            found[n] = twin(*args) if twin else OPERATIONS[op].sympy(sympy, *args)
    return [found[n] for n in nodes]


def _above(g: Graph, nodes: Iterable[int], known: Collection[int]) -> list[int]:
    """Give what is to be made, in order of evaluation: `nodes` down to `known`."""
    seen = set(nodes).difference(known)
    stack = list(seen)
    while stack:
        for a, _ in _operands(g, stack.pop(), known):
            if a not in seen and a not in known:
                seen.add(a)
                stack.append(a)
    return sorted(seen)


def _operands(g: Graph, n: int, known: Collection[int]) -> list[tuple[int, bool]]:
    """Give the arguments of a node, and whether each is subtracted.

    Of a sum those of the sums in it, too; and so of a product.
    """
    chain = _CHAINS.get(g.ops[n])
    if chain is None:
        return [(a, False) for a in g.args[n]]
    found, stack = [], [(n, False)]
    while stack:
        a, negative = stack.pop()
        if a == n or (g.ops[a] in chain and a not in known):
            first, second = g.args[a]
            stack += [(first, negative), (second, negative ^ (g.ops[a] == "sub"))]
        else:
            found.append((a, negative))
    return found


_CHAINS = {"mul": ("mul",), "add": ("add", "sub"), "sub": ("add", "sub")}


def _number(x: float) -> Any:
    import sympy

    if not math.isfinite(x):
        return sympy.Float(x)
    exact = Fraction(x)
    if exact.denominator > LARGEST_DENOMINATOR or abs(exact) > LARGEST_WHOLE:
        return sympy.Float(x)
    return sympy.Rational(exact.numerator, exact.denominator)
