"""What stands many times behind itself in a sequence: the same steps, link by link."""

from __future__ import annotations

from heapq import heapify, heappop, heappush
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

# Longer ones would take as long to compile as straight-line code.
LONGEST = 256
# What is repeated less often, or is shorter in all, is not worth a loop.
LEAST_TIMES = 4
LEAST_LENGTH = 16


class Repeat(NamedTuple):
    """From `start` on, `times` times `period` elements, each time the same."""

    start: int
    period: int
    times: int

    @property
    def length(self) -> int:
        """How many elements they are together."""
        return self.period * self.times


def repeats(sequence: Sequence[int]) -> list[Repeat]:
    """Find stretches that repeat themselves, apart from each other, in order.

    The longest first, and of those that are equally long the one of least period.
    """
    elements = np.asarray(sequence, dtype=np.int64)
    queue = [_rank(x) for x in _all(elements)]
    heapify(queue)
    free = np.ones(len(elements) + 1, dtype=bool)
    free[-1] = False
    found = []
    while queue:
        _, period, start, times = heappop(queue)
        whole = Repeat(start, period, times)
        pieces = [
            Repeat(first, period, (end - first) // period)
            for first, end in _stretches(free, whole)
        ]
        if pieces == [whole]:
            found.append(whole)
            free[start : start + whole.length] = False
            continue
        for piece in pieces:
            if piece.times >= LEAST_TIMES and piece.length >= LEAST_LENGTH:
                heappush(queue, _rank(piece))
    return sorted(found)


def _all(elements: np.ndarray) -> Iterator[Repeat]:
    """Give all stretches that repeat themselves, however they overlap."""
    for period in range(1, min(LONGEST, len(elements) // LEAST_TIMES) + 1):
        same = np.zeros(len(elements) - period + 2, dtype=np.int8)
        same[1:-1] = elements[period:] == elements[:-period]
        starts, ends = np.flatnonzero(np.diff(same)).reshape(-1, 2).T
        times = (ends - starts) // period + 1
        worth = (times >= LEAST_TIMES) & (times * period >= LEAST_LENGTH)
        for start, count in zip(starts[worth], times[worth], strict=True):
            yield Repeat(int(start), period, int(count))


def _rank(repeat: Repeat) -> tuple[int, int, int, int]:
    return -repeat.length, repeat.period, repeat.start, repeat.times


def _stretches(free: np.ndarray, repeat: Repeat) -> list[tuple[int, int]]:
    """Give the parts of `repeat` that nothing longer has."""
    within = np.zeros(repeat.length + 2, dtype=np.int8)
    within[1:-1] = free[repeat.start : repeat.start + repeat.length]
    edges = np.flatnonzero(np.diff(within)).reshape(-1, 2) + repeat.start
    return [(start, end) for start, end in edges.tolist()]
