"""Multipliers that are not determined: the nonnegative ones of least norm.

Where contacts hold a body more often than they must (four legs), their sum of forces is
known and their shares are not.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lagsim.mechanics.contact.delassus import freedom
from lagsim.mechanics.contact.problem import Problem, Role
from lagsim.mechanics.contact.solving import solve

if TYPE_CHECKING:
    from lagsim.language.arrays import Floats


def least_norm(rows: Floats, multipliers: Floats) -> Floats:
    """Give the multipliers (k,) >= 0 of least norm with the same forces.

    Parameters
    ----------
    rows : ndarray, shape (k, n)
        Of the contacts that hold, implied ones among them. Columns may have any units.
    multipliers : ndarray, shape (k,)
        Nonnegative ones.

    Notes
    -----
    With P the projection onto the changes that make no force, they are m + P u with the
    least norm of all, m, and u >= 0 complementary to them (Karush, Kuhn, Tucker).
    """
    sizes = np.abs(rows).max(axis=0)
    N = freedom((rows / np.where(sizes > 0.0, sizes, 1.0)).T)
    if not N.shape[1]:
        return multipliers
    P = N @ N.T
    r, least = len(multipliers), multipliers - P @ multipliers
    nothing, nowhere = [0.0] * r, (-1,) * r
    problem = Problem(
        P, list(least), [Role.SIGNED] * r, nothing, nothing, nothing, nowhere, nowhere
    )
    return np.maximum(least + P @ solve(problem).p, 0.0)
