"""Losses of rank on the way: which constraints are in them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lagsim.admissibility.point import Point
from lagsim.admissibility.rank import weakest_rows
from lagsim.trajectory import Caution

if TYPE_CHECKING:
    from collections.abc import Sequence

    from lagsim.equations import Equations
    from lagsim.native.kernel_types import Floats


def weakest(
    equations: Equations,
    rank: int,
    usual: Sequence[float],
    t: float,
    q: Floats,
    v: Floats,
) -> tuple[tuple[str, ...], float]:
    """Give the constraints closest to dependent at a state, and how close they are.

    Parameters
    ----------
    rank
        Of the rows, in general.
    usual : (m,)
        Their lengths, in general.
    """
    point = Point(equations)
    point.move_to(t)
    left, smallest = weakest_rows(point, q, v, rank, usual)
    heavy = np.abs(left) > 1e-3
    rows = zip(equations.rows, heavy, strict=True)
    return tuple(row.name for row, is_in in rows if is_in), smallest


def rank_caution(time: float, names: tuple[str, ...], smallest: float) -> Caution:
    """Say what a loss of rank means."""
    text = (
        f"at t = {time:.9g} the constraints {', '.join(names)} lose their "
        f"independence (smallest singular value {smallest:.1e}): a singular "
        "configuration, where motions branch; their multipliers are large around it"
    )
    return Caution("rank", text)
