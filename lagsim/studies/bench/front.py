"""Which of several ways cost least for the error they make."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence

    Point = tuple[float, float]  # error, cost


def pareto(points: Sequence[Point]) -> list[int]:
    """Give the points that no other one beats in error and cost, by falling error.

    Of points that are equal in both the first counts.
    """
    order = sorted(range(len(points)), key=lambda k: (points[k], k))
    found = []
    cheapest = math.inf
    for k in order:
        if points[k][1] < cheapest:
            found.append(k)
            cheapest = points[k][1]
    return found[::-1]


def cost_at(curve: Sequence[Point], error: float) -> float | None:
    """Give what an error costs on a curve; None where it does not get there.

    Parameters
    ----------
    curve
        In the order of the sweep, from loose to tight. Between two points next to each
        other it is a straight line in logarithms.
    """
    costs = [cost for reached, cost in curve if reached <= error]
    for (loose, less), (tight, more) in pairwise(curve):
        if loose > error >= tight > 0.0 and less > 0.0 < more:
            part = math.log(loose / error) / math.log(loose / tight)
            costs.append(less * (more / less) ** part)
    return min(costs, default=None)
