"""In which order unknowns are eliminated, and how many operations that takes."""

from __future__ import annotations

import math
from heapq import heapify, heappop, heappush
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence


class TooLongError(Exception):
    """The elimination would take more operations than it may."""


class Meter:
    """Counts multiplications and gives up when they pass a limit."""

    def __init__(self, limit: float = math.inf) -> None:
        self.operations = 0
        self.limit = limit

    def stop(self) -> None:
        """Count on without a limit."""
        self.limit = math.inf

    def add(self, operations: int) -> None:
        """Count `operations` more."""
        self.operations += operations
        if self.operations > self.limit:
            raise TooLongError


def minimum_degree(rows: Sequence[set[int]], meter: Meter) -> list[int]:
    """Give an order of elimination that keeps fill small; counts its operations.

    The row of fewest entries comes next, the first of them where there are several
    (A. George and J. W. H. Liu, SIAM Review 31 (1989), section 2).

    Parameters
    ----------
    rows
        The columns of the entries of each row, symmetric; eliminated on the way.
    """
    order: list[int] = []
    queue = [(len(row), k) for k, row in enumerate(rows)]
    heapify(queue)
    left = set(range(len(rows)))
    while left:
        degree, k = heappop(queue)
        if k not in left or degree != len(rows[k]):
            continue  # out of date: another entry has its degree
        left.remove(k)
        order.append(k)
        others = rows[k] - {k}
        meter.add(1 + len(others) * (len(others) + 3) // 2)
        for i in others:
            rows[i].remove(k)
            rows[i] |= others
            heappush(queue, (len(rows[i]), i))
    return order
