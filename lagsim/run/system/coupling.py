"""Which coordinates hang together, and what one of them may move another by."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lagsim.methods.parts.parameters import OFF

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from lagsim.language.arrays import Floats
    from lagsim.mechanics.equations import Equations
    from lagsim.run.system import System


def coupled(e: Equations) -> list[int]:
    """Give for each coordinate the first that M and all rows join it with."""
    slopes = (row.entries for row in e.slopes)
    return joined(len(e.q), [*slopes, *(together for _, together in e.coupled)])


def held_together(system: System) -> list[int]:
    """Give for each coordinate the first that the rows in force join it with."""
    e, known = system.equations, system.together
    on = system.p.law_mode != OFF
    key = on.tobytes()
    if key not in known:
        acting = (law.row for law, acts in zip(e.laws, on, strict=True) if acts)
        known[key] = joined(len(e.q), [row.A.entries for row in (*e.rows, *acting)])
    return known[key]


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


def in_groups(labels: Sequence[int], roots: Floats, found: Floats) -> Floats:
    """Give `largest_beside` in each group of coordinates with one label."""
    whole = np.array(found)
    for label in sorted({k for i, k in enumerate(labels) if k != i}):
        group = np.array(labels) == label
        whole[group] = largest_beside(roots[group], found[group])
    return whole


def largest_beside(roots: Floats, found: Floats) -> Floats:
    """Give the largest of range_j min(1, root_j/root_i): by size, without n^2."""
    finite = np.where(np.isfinite(found) & np.isfinite(roots), found, 0.0)
    lightest = np.argsort(roots)
    whole = np.zeros(len(found))
    below = np.maximum.accumulate((finite * roots)[lightest])
    above = np.maximum.accumulate(finite[lightest][::-1])[::-1]
    own = roots[lightest]
    lighter = np.divide(below, own, out=np.zeros_like(below), where=own > 0.0)
    whole[lightest] = np.fmax(lighter, above)
    return whole
