"""Which of several ways cost least for the error they make."""

from __future__ import annotations

import math
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
