"""Which forces joints without inertia hand on, and how these are felt.

Of the forces F on sums in which velocities v without inertia stand, c_v F = 0 for each
v leaves E with c_v E = 0: along the link, where there is one sum more than velocities;
nothing, where there are as many. What moves v alone is N_v with c_v N_v = 1, across E
and the c of all others.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from lagsim.language.disjoint_sets import DisjointSets
from lagsim.language.normal_form import common_factor
from lagsim.language.trigonometry import fewer_terms

if TYPE_CHECKING:
    from collections.abc import Collection, Sequence

    from lagsim.language.graph import Graph
    from lagsim.mechanics.newton import Newton

# How many velocities without inertia may stand together in how many sums: along lines,
# in a plane and in space; on rigid links, or with what these may stretch by.
KINDS = {(1, 1), (1, 2), (2, 2), (2, 3), (3, 3)}

Vector = dict[int, int]  # sum -> node; what is absent is zero


class Turn(NamedTuple):
    """A velocity without inertia.

    Attributes
    ----------
    factors : dict
        Its factor in each sum, over `length`.
    across : dict
        N, times `length` and `factors` times this.
    length : int
        What the factors have in common.
    """

    velocity: int
    factors: Vector
    across: Vector
    length: int


class Joints(NamedTuple):
    """E of the links; the velocities; and what does not move of lengths, by sum."""

    along: list[Vector]
    turns: list[Turn]
    lengths: Vector


def joints(
    g: Graph, held: Newton, free: Collection[int], moving: frozenset[str]
) -> Joints | None:
    """Give the joints; None where there are others than of KINDS."""
    moved = g.dependent((c for x in held.sums.values() for c in x.values()), moving)
    found, places = Joints([], [], {}), {u: j for j, u in enumerate(free)}
    sets = DisjointSets(len(places))
    sums_of: dict[int, list[int]] = {u: [] for u in free}
    for k, form in held.sums.items():
        massless = [i for i in form if i not in held.masses]
        if k not in held.masses or any(i not in places for i in massless):
            return None
        if any(form[i] in moved for i in form if i in held.masses):
            return None  # of little inertia, it would take digits
        for i in massless:
            sums_of[i].append(k)
            sets.merge(places[massless[0]], places[i])
        if not massless:
            found.along.append({k: g.one})
    names = list(places)
    for group in sets.sets():
        velocities = sorted(names[j] for j in group)
        sums = sorted({k for u in velocities for k in sums_of[u]})
        if not _join(g, found, held, velocities, sums, moving):
            return None
    return found


def _join(
    g: Graph,
    found: Joints,
    held: Newton,
    velocities: Sequence[int],
    sums: Sequence[int],
    moving: frozenset[str],
) -> bool:
    """Add a joint of `velocities` that stand in `sums`, if it is of a known kind."""
    kind = len(velocities), len(sums)
    if kind not in KINDS:
        return False
    rows, lengths = [], []
    for u in velocities:
        factors = [held.sums[k].get(u, g.zero) for k in sums]
        length, rest = common_factor(g, factors)
        lengths.append(length)
        rows.append(rest)
    along: list[int] = []
    if kind[0] == 1:
        across = rows
        along = _normal(g, rows[0]) if kind == (1, 2) else []
    elif kind == (2, 2):
        across = [_normal(g, rows[1]), _normal(g, rows[0])]
    else:
        third = rows[2] if kind == (3, 3) else _across(g, rows[0], rows[1], moving)
        along = third if kind == (2, 3) else []
        pairs = ((rows[1], third), (third, rows[0]), (rows[0], rows[1]))
        across = [_across(g, a, b, moving) for a, b in pairs[: kind[0]]]
    if along:
        found.along.append(dict(zip(sums, along, strict=True)))
    for u, row, turned, length in zip(velocities, rows, across, lengths, strict=True):
        both = [dict(zip(sums, x, strict=True)) for x in (row, turned)]
        found.turns.append(Turn(u, both[0], both[1], length))
    still = [x for x in lengths if not g.depends([x]) & moving]
    if still:
        found.lengths.update(dict.fromkeys(sums, still[0]))
    return True


def _normal(g: Graph, a: Sequence[int]) -> list[int]:
    return [g.call("neg", a[1]), a[0]]


def _across(
    g: Graph, a: Sequence[int], b: Sequence[int], moving: frozenset[str]
) -> list[int]:
    """Give the cross product, without what all its components have in common."""
    product = [
        g.call("sub", g.call("mul", a[i], b[j]), g.call("mul", a[j], b[i]))
        for i, j in ((1, 2), (2, 0), (0, 1))
    ]
    return common_factor(g, fewer_terms(g, product, moving))[1]
