"""Numbers that leave the range of doubles, in rows, and computed with in Python.

Kernels look at each state that they come to. What happens at events is computed here
and there in Python, which raises where numpy goes on with inf and nan.
"""

from __future__ import annotations

from functools import wraps
from typing import TYPE_CHECKING, NamedTuple, ParamSpec, TypeVar

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from lagsim.language.arrays import Floats

P = ParamSpec("P")
T = TypeVar("T")
S = TypeVar("S")

# numpy's LinAlgError is a ValueError.
RAISED = (ArithmeticError, ValueError)
# What Python, numpy and scipy say of a number that is out of range, in a ValueError.
SAID = ("NaN", "infs", "math domain")


def unless_overflow(otherwise: S) -> Callable[[Callable[P, T]], Callable[P, T | S]]:
    """Decorate: what a function gives, or this where numbers are out of range."""

    def guarded(work: Callable[P, T]) -> Callable[P, T | S]:
        @wraps(work)
        def call(*args: P.args, **kwargs: P.kwargs) -> T | S:
            try:
                return work(*args, **kwargs)
            except RAISED as error:
                if not is_overflow(error):
                    raise
            return otherwise

        return call

    return guarded


def is_overflow(error: Exception) -> bool:
    """Tell whether an error comes of numbers that are out of range."""
    if isinstance(error, (ArithmeticError, np.linalg.LinAlgError)):
        return True
    return any(word in str(error) for word in SAID)


def finite_rows(rows: Floats, columns: int) -> int:
    """Give how many rows there are before one with a value that is not finite.

    Only the first columns are looked at, of which there are so many.
    """
    finite = np.isfinite(rows[:, :columns])
    first = int(finite.argmin())
    return len(rows) if finite.flat[first] else first // columns


class Gap(NamedTuple):
    """The first value of a column that is not finite, and in how many rows it is so."""

    value: float
    time: float
    rows: int


class Gaps:
    """Notes the first value of each column that is not finite.

    Parameters
    ----------
    columns
        The names of the first columns of a row.
    """

    def __init__(self, columns: Sequence[str]) -> None:
        self._names = tuple(columns)
        self.found: dict[str, Gap] = {}

    def add(self, rows: Floats) -> None:
        """Take rows (k, columns)."""
        finite = np.isfinite(rows[:, : len(self._names)])
        if finite.all():
            return
        for k in np.flatnonzero(~finite.all(axis=0)).tolist():
            name, missing = self._names[k], ~finite[:, k]
            first = int(np.argmax(missing))
            new = Gap(float(rows[first, k]), float(rows[first, 0]), 0)
            known = self.found.get(name, new)
            count = known.rows + int(np.count_nonzero(missing))
            self.found[name] = known._replace(rows=count)
