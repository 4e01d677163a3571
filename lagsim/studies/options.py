"""Options of studies whose values commands read from text, and Python as numbers."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Iterable


class RangeOption(NamedTuple):
    """Option whose value is a range of numbers, `A:B` or (A, B), in any order.

    Attributes
    ----------
    values : str
        The numbers, in messages: `frequencies above 0`.
    example : str
        The option on the command line.
    above : float
        A bound below both numbers.
    may_be_equal : bool
        Whether the range may be a single number.
    """

    values: str
    example: str
    above: float = -math.inf
    may_be_equal: bool = False

    def ends(self, given: Iterable[float | str]) -> tuple[float, float] | None:
        """Return the smaller and the larger end; None if `given` is no such range.

        Examples
        --------
        >>> RangeOption("numbers above 0", "--steps 0.01:1", 0.0).ends(["1", "0.1"])
        (0.1, 1.0)
        """
        try:
            low, high = sorted(float(x) for x in given)
        except (TypeError, ValueError):
            return None
        in_order = low < high or (self.may_be_equal and low == high)
        return (
            (low, high) if in_order and self.above < low and high < math.inf else None
        )


VARIED_RANGE = RangeOption("different numbers", "--vary K=10:1000")
FREQUENCY_RANGE = RangeOption("frequencies above 0", "--frequencies 0.1:10", 0.0)
STEP_RANGE = RangeOption("different numbers above 0", "--steps 0.01:1", 0.0)
TOLERANCE_RANGE = RangeOption(
    "numbers above 0", "--tolerances 1e-3:1e-9", 0.0, may_be_equal=True
)
# Keys of `simulation` that are options of the runs of a fit.
RUNS_OF_FITS = ("duration", "method", "formulation", "atol")
