"""Expressions that sympy would never come to the end of, refused before it sees them.

sympy writes everything out and keeps numbers exactly: (x/2)^(10^10) would be 2^(10^10),
with three thousand million digits, and no signal ends the making of such a number.
"""

from __future__ import annotations

import math
from fractions import Fraction
from typing import TYPE_CHECKING, NamedTuple

from lagsim import limits
from lagsim.errors import InputError, Problem
from lagsim.language.graph import TRUTH, VARIABLE

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from lagsim.language.graph import Graph

# sympy writes exp(n log x) as x^n.
_JOINED = ("add", "sub", "mul", "div", "neg")
# The digits of a common denominator of small fractions.
_OF_A_SUM = 6.0
HINT = "`--format python` takes them as they are"


class _Size(NamedTuple):
    """What an expression comes to, written out.

    Attributes
    ----------
    operations, depth : int
    digits : float
        Of the numbers that may stand before its terms.
    factor : float
        The largest number that multiplies what is in it.
    logarithm : bool
        A logarithm is a term of it, or a factor.
    """

    operations: int = 1
    depth: int = 1
    digits: float = 0.0
    factor: float = 1.0
    logarithm: bool = False


def refuse_endless(
    g: Graph, nodes: Iterable[int], numbers: Mapping[int, float] | None = None
) -> None:
    """Refuse expressions that are too long to be written out.

    Parameters
    ----------
    numbers
        The values of parameters that are put in.

    Raises
    ------
    InputError
    """
    sizes: dict[int, _Size] = {}
    nodes, numbers = list(nodes), numbers or {}
    for n in g.cone(nodes):
        sizes[n] = _size(g, n, sizes, numbers)
    size = sum(sizes[n].operations for n in nodes)
    depth = max((sizes[n].depth for n in nodes), default=0)
    if size > limits.WRITTEN_OPERATIONS or depth > limits.WRITTEN_DEPTH:
        about = f"{size:.2g} operations" if size < 1e12 else "no end of operations"
        most = f"{limits.WRITTEN_OPERATIONS:,} and {limits.WRITTEN_DEPTH}"
        text = (
            f"the energies, written out, have {about}, nested {depth} deep, and the "
            f"limits are {most}"
        )
        raise InputError([Problem("too-long", text, None, HINT)])
    digits = max((sizes[n].digits for n in sizes), default=0.0)
    if digits > limits.EXACT_DIGITS:
        about = f"about {digits:.2g} digits" if digits < 1e12 else "no end of digits"
        text = (
            "the energies, written out, have numbers to the power of numbers with "
            f"{about}, and the limit is {limits.EXACT_DIGITS}"
        )
        raise InputError([Problem("too-long", text, None, HINT)])


def _size(
    g: Graph, n: int, sizes: Mapping[int, _Size], numbers: Mapping[int, float]
) -> _Size:
    number = numbers.get(n, g.value(n))
    if number is not None:
        return _Size(digits=_digits(number), factor=max(1.0, abs(number)))
    op, args = g.ops[n], [sizes[a] for a in g.args[n]]
    if op in (VARIABLE, TRUTH):
        return _Size()
    digits = [a.digits for a in args]
    joined = op in _JOINED
    found = _Size(
        operations=1 + sum(a.operations for a in args),
        depth=1 + max(a.depth for a in args),
        digits=sum(digits) if op in ("mul", "div") else max(digits),
        factor=math.prod(a.factor for a in args) if joined else 1.0,
        logarithm=op == "log" or (joined and any(a.logarithm for a in args)),
    )
    if op in ("add", "sub") and all(digits):
        return found._replace(digits=found.digits + _OF_A_SUM)
    if op == "pow":
        power = numbers.get(g.args[n][1], g.value(g.args[n][1]))
        if power is not None:
            most = max(digits[1], digits[0] * max(1.0, abs(power)))
            return found._replace(digits=most)
    if op == "exp" and args[0].logarithm:
        return found._replace(digits=digits[0] * args[0].factor)
    return found


def _digits(x: float) -> float:
    """Give the decimal digits of a number as a fraction; none of 0, 1 and -1."""
    if not math.isfinite(x):
        return 0.0
    part = Fraction(x).limit_denominator(16)
    if part.numerator / part.denominator != x:
        part = Fraction(repr(x))
    return math.log10(max(1, abs(part.numerator))) + math.log10(part.denominator)
