"""Which coordinates hang together."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable

    from lagsim.mechanics.equations import Equations


def coupled(e: Equations) -> list[int]:
    """Give for each coordinate the first that M and all rows join it with."""
    slopes = (row.entries for row in e.slopes)
    return joined(len(e.q), [*slopes, *(together for _, together in e.coupled)])


def joined(n: int, rows: Iterable[Iterable[int]]) -> list[int]:
    """Give for each of n coordinates the first one that `rows` join it with."""
    first = list(range(n))

    def root(i: int) -> int:
        while first[i] != i:
            i = first[i]
        return i

    for row in rows:
        roots = sorted({root(i) for i in row})
        for i in roots:
            first[i] = roots[0]
    return [root(i) for i in range(n)]
