"""Functions with which kernels are written, in addition to Python's own.

A kernel is a plain Python function of the subset that `translation` translates. CPython
executes the definitions below; the translator recognises them by identity and writes
code with equal bits.
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
    """Return `range(*bounds)`; the translator unrolls the loop.

    The bounds are static, and so is the loop variable: an element of a table at this
    index becomes a number, an `if` on it is decided at translation.

    Examples
    --------
    >>> [k for k in unrolled(2, -1, -1)]
    [2, 1, 0]
    """
    return range(*bounds)


def apart(count: int) -> range:
    """Return `range(count)` for a loop whose passes access disjoint elements.

    The translator marks the loop for vectorisation, with equal bits. Worthwhile for
    long arrays only, because of the time to compile.
    """
    return range(count)


def total(terms: Iterable[float]) -> float:
    """Return the sum of terms, added in order.

    As in `total(A[j] * k[j] for j in unrolled(4))`. The builtin `sum` is compensated
    from Python 3.12 on, so its bits differ. The sum starts with the first term; an
    empty one is 0.0. The translator omits terms with a static factor of 0.0, which are
    added here: bits are equal as long as the other factors are finite, except for the
    sign of a sum that is zero.

    Examples
    --------
    >>> total(0.1 for _ in range(3))
    0.30000000000000004
    """
    iterator = iter(terms)
    result = next(iterator, 0.0)
    for term in iterator:
        result = result + term
    return result


def fused(a: float, b: float, c: float) -> float:
    """Return a*b + c, rounded once (IEEE 754: fusedMultiplyAdd).

    For recurrences in which each sum depends on the previous one: half the latency of
    two operations.

    Examples
    --------
    >>> fused(0.1, 10.0, -1.0) == 2.0**-54, 0.1 * 10.0 - 1.0
    (True, 0.0)
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
    """Return the bits of a double (IEEE 754: binary64) as a signed integer.

    Examples
    --------
    >>> hex(bits(1.0))
    '0x3ff0000000000000'
    """
    return int(struct.unpack("<q", struct.pack("<d", x))[0])


def from_bits(k: int) -> float:
    """Return the double with the bits of a signed integer.

    Examples
    --------
    >>> from_bits(bits(0.1))
    0.1
    """
    return float(struct.unpack("<d", struct.pack("<q", k))[0])


def external(function: Callable[P, R]) -> Callable[P, R]:
    """Mark a function that is defined at link time, under its name.

    The function's annotations declare the kinds of parameters and result; its body is
    not translated (mypy requires `raise NotImplementedError` where there is a result).
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
    """Whether `function` is marked by `external`."""
    return getattr(function, _EXTERNAL, False) is True
