"""Which coordinates hang together."""

from __future__ import annotations

from typing import TYPE_CHECKING

from lagsim.methods.parts.parameters import OFF

if TYPE_CHECKING:
    from collections.abc import Iterable

    from lagsim.language.arrays import Floats
    from lagsim.mechanics.equations import Equations


def coupled(e: Equations) -> list[int]:
    """Give for each coordinate the first that M and all rows join it with."""
    slopes = (row.entries for row in e.slopes)
    return joined(len(e.q), [*slopes, *(together for _, together in e.coupled)])


def held_together(e: Equations, modes: Floats) -> list[int]:
    """Give for each coordinate the first that the rows in force join it with.

    modes : (L,), those of the laws.
    """
    acting = (law.row for law, mode in zip(e.laws, modes, strict=True) if mode != OFF)
    return joined(len(e.q), [row.A.entries for row in (*e.rows, *acting)])


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
