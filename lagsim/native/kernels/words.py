"""The words a kernel is written in besides Python's own.

A kernel is a plain Python function of the subset that `translation` translates. Under
CPython these definitions are what runs; the translator knows them by identity and
gives the same bits.
"""

from __future__ import annotations

import functools
import struct
from math import inf
from typing import TYPE_CHECKING, ParamSpec, TypeAlias, TypeVar

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

# The kind of a parameter that is known at translation: the function is translated once
# for each value that it is called with.
Static: TypeAlias = int

P = ParamSpec("P")
R = TypeVar("R")

_EXTERNAL = "lagsim_external"


def unrolled(*bounds: int) -> range:
    """Return `range(*bounds)`; the translator writes the loop over it out.

    The bounds are known at translation, and so is the loop variable: a table indexed
    by it becomes a number, an `if` on it is decided.
    """
    return range(*bounds)


def apart(count: int) -> range:
    """Return `range(count)` for a loop whose passes do not touch each other's elements.

    The translator has them made several at once, with the same bits. For arrays of some
    length: it takes code, and time to compile.
    """
    return range(count)


def total(terms: Iterable[float]) -> float:
    """Sum the terms in their order, as in `total(A[j] * k[j] for j in unrolled(4))`.

    The builtin `sum` is compensated from Python 3.12 on and so gives other bits.
    The sum starts with the first term, an empty one is 0.0. The translator leaves out
    the terms with a static factor of 0.0; here they are added. Both give the same bits
    as long as the other factors are finite, but for the sign of a sum that is zero.
    """
    iterator = iter(terms)
    result = next(iterator, 0.0)
    for term in iterator:
        result = result + term
    return result


def fused(a: float, b: float, c: float) -> float:
    """Return a*b + c, rounded once (IEEE 754: fusedMultiplyAdd).

    Where a sum waits for each of its terms: it takes half the time of two operations.
    """
    from fractions import Fraction

    if not abs(a) < inf or not abs(b) < inf:
        return a * b + c
    if not abs(c) < inf:
        return c
    exact = Fraction(a) * Fraction(b) + Fraction(c)
    try:
        return float(exact) if exact else a * b + c
    except OverflowError:
        return inf if exact > 0 else -inf


def bits(x: float) -> int:
    """Return the bits of a number (IEEE 754: binary64), as a signed integer."""
    return int(struct.unpack("<q", struct.pack("<d", x))[0])


def from_bits(k: int) -> float:
    """Return the number that has these bits."""
    return float(struct.unpack("<d", struct.pack("<q", k))[0])


def external(function: Callable[P, R]) -> Callable[P, R]:
    """Mark a function that is given at link time under its name.

    Its annotations tell the kinds of parameters and result; its body is not read
    (mypy wants `raise NotImplementedError` where there is a result).
    """

    @functools.wraps(function)
    def missing(*_args: P.args, **_kwargs: P.kwargs) -> R:
        name = getattr(function, "__name__", "?")
        raise NotImplementedError(
            f"{name} is external: linked to native code, or given to "
            "tests.kernels.bind for plain Python"
        )

    setattr(missing, _EXTERNAL, True)
    return missing


def is_external(function: object) -> bool:
    """Whether `function` was marked by `external`."""
    return getattr(function, _EXTERNAL, False) is True
