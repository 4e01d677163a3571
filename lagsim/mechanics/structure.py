"""The structure of the equations of motion, as far as the graph shows it.

What a method or a formulation can handle, and what a scene does not need, is decided
by this. All of it is seen in the expressions: a structure that only shows at some
values of the parameters is not found.
"""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from lagsim.language.sparse import DisjointSets
from lagsim.mechanics.equations import memoized_by_motion
from lagsim.methods import Structure

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from lagsim.language.arrays import Floats
    from lagsim.mechanics.equations import Equations


@memoized_by_motion
def structure(equations: Equations) -> Structure:
    """Find the structure of `equations`."""
    g, entries = equations.graph, equations.mass_nodes
    coupled = [together for _, together in equations.coupled]
    rows = equations.rows
    A = [node for row in rows for node in row.A.entries.values()]
    right = [*equations.f, *(row.b for row in rows)]
    right += [x.rate for x in equations.states]
    state = frozenset(equations.state)
    moving = state | {"t"}
    everything = [*entries, *A, *right, *(row.rate for row in rows)]
    levels = {row.holonomic for row in rows}
    kinds = {(): "none", (True,): "holonomic", (False,): "nonholonomic"}
    constants = g.dependent([*entries, *A], moving)
    degrees = g.degrees(right, state)
    power = equations.powers
    # Multipliers are affine where all else is.
    of_power = g.degrees(power, state.union(equations.multipliers))
    return Structure(
        mass_varies_with=_varies(equations, entries),
        diagonal=all(len(set(together)) == 1 for together in coupled),
        blocks=len(set(joined(len(equations.q), coupled))),
        constant_rows=not g.dependent(A, moving),
        constraints=kinds.get(tuple(levels), "mixed"),
        forces_free_of_velocities=not g.dependent(equations.f, equations.velocities),
        autonomous=not g.dependent([*everything, *power], ("t",)),
        linear=not constants
        and all(d is not None and d.most <= 1 for d in degrees)
        and all(d is not None and d.most <= 2 for d in of_power),
        unknowns=len(equations.q) + len(rows),
    )


def _varies(equations: Equations, entries: list[int]) -> str:
    names = equations.graph.depends(entries)
    if names & frozenset(equations.velocities):
        return "velocities"
    if names & frozenset(equations.q):
        return "positions"
    return "time" if "t" in names else "nothing"


def coupled(e: Equations) -> list[int]:
    """Return for each coordinate the first that M and all rows join it with."""
    slopes = (row.entries for row in e.slopes)
    return joined(len(e.q), [*slopes, *(together for _, together in e.coupled)])


def joined(n: int, rows: Iterable[Iterable[int]]) -> list[int]:
    """Return for each of n coordinates the first one that `rows` join it with."""
    sets = DisjointSets(n)
    for row in rows:
        for i, j in pairwise(row):
            sets.merge(i, j)
    return [sets.leader(i) for i in range(n)]


def in_groups(labels: Sequence[int], roots: Floats, found: Floats) -> Floats:
    """`largest_beside` in each group of coordinates with one label."""
    whole = np.array(found)
    for label in sorted({k for i, k in enumerate(labels) if k != i}):
        group = np.array(labels) == label
        whole[group] = largest_beside(roots[group], found[group])
    return whole


def largest_beside(roots: Floats, found: Floats) -> Floats:
    """Return the largest of range_j min(1, root_j/root_i): by size, without n^2."""
    finite = np.where(np.isfinite(found) & np.isfinite(roots), found, 0.0)
    lightest = np.argsort(roots)
    whole = np.zeros(len(found))
    below = np.maximum.accumulate((finite * roots)[lightest])
    above = np.maximum.accumulate(finite[lightest][::-1])[::-1]
    own = roots[lightest]
    lighter = np.divide(below, own, out=np.zeros_like(below), where=own > 0.0)
    whole[lightest] = np.fmax(lighter, above)
    return whole
