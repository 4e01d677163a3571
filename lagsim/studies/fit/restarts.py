"""Detection of a fit in a local minimum, and the parts of records that lead out of it.

Residuals of the least minimum are measurement noise, which is independent from row to
row; in a local minimum they follow the motion. A fit to the first part of a record, in
which the motion has changed little, has fewer local minima: its values begin the fit to
a longer part.

Sources: J. Durbin and G. S. Watson, Biometrika 37 (1950), 409, for the correlation of
successive residuals; H. G. Bock, Numerical treatment of inverse problems in chemical
reaction kinetics, Springer Series in Chemical Physics 18 (1981), 102, for local minima
of fits to whole motions.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from lagsim.language.arrays import Flags, Floats

# Standard deviations of the correlation of n independent residuals, 1/sqrt(n), beyond
# which it is a pattern: one in 4,000. Fewer than 13 residuals never have one.
CLEAR = 3.5
# Multiple of the median size at which residuals are cut off: 3 standard deviations.
CUT = 4.4
# Ratio of residuals to data below which residuals are rounding.
ROUNDING = 1e-8
# Parts of the time of the data to which a fit is made in turn.
PARTS = (1 / 16, 1 / 8, 1 / 4, 1 / 2)
# Number of random starts that are compared by their cost, and of fits that begin at
# the starts of least cost.
COMPARED, BEGUN = 40, 3


def has_pattern(raw: Floats, data: Floats) -> bool:
    """Whether successive residuals of a column are correlated, in the order of time.

    raw, data : (n,), residuals and measurements of one column.
    """
    size = float(raw @ raw)
    if size <= ROUNDING**2 * float(data @ data):
        return False
    # A few large residuals, beside an impact, hide the others: these are cut off.
    bound = CUT * float(np.median(np.abs(raw))) or math.sqrt(size / len(raw))
    return any(
        float(x[:-1] @ x[1:]) * math.sqrt(len(x)) > CLEAR * float(x @ x)
        for x in (raw, np.clip(raw, -bound, bound))
    )


def patterned(raw: Floats, data: Floats, groups: Iterable[Flags]) -> bool:
    """Whether the residuals of at least one of several groups of rows follow a pattern.

    raw, data : (n,), see `has_pattern`.
    groups : a mask (n,) of the rows of each group.
    """
    return any(has_pattern(raw[own], data[own]) for own in groups)


def parts_of(times: Floats, fewest: int) -> Iterator[Flags]:
    """Yield a mask (n,) of the measurements in growing first parts of the records.

    The whole time is left out.

    Parameters
    ----------
    times : ndarray, shape (n,)
        Times of the measurements, from the begin of their record.
    fewest : int
        Parts with fewer measurements are left out.
    """
    span = float(np.max(times, initial=0.0))
    for part in PARTS:
        within = times <= part * span
        if fewest <= np.count_nonzero(within) < len(times):
            yield within
