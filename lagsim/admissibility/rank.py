"""Rank of the constraint rows: which are independent, which depend on others.

Rows are compared in the metric of M and scaled to length 1, so that neither units nor
the scale of a relation count. A nearly parallel row is a real constraint: only what
vanishes against RANK is dependent. A gradient that is nothing but rounding is zero.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lagsim.admissibility.dependence import LEVELS, Demands, Dependence
from lagsim.admissibility.large import SURELY, SparseRows, is_large
from lagsim.admissibility.lengths import of_rows
from lagsim.admissibility.newton import (
    RANK,
    Trouble,
    least_squares,
    rank_metric,
    reach,
    solving_metric,
)
from lagsim.admissibility.point import Asked
from lagsim.admissibility.report import RankReport

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from lagsim.admissibility.point import Point
    from lagsim.language.arrays import Flags, Floats

# How far, against the state, and how often generic states are looked for nearby.
NEARBY = 0.05
SAMPLES = 3
TRIALS = 8
# Newton's method leaves such states a little off, and dependent rows a little less so.
GENERIC_RANK = 1e-9
# Rank that is won on the way to such a state is won by more than this part of the way.
TRACE = 1e-4
# What vanishes at a double root is known to half of the digits.
HALF = 1e-6
# So many rows at a time are compared with all.
BLOCK = 256


class _Generic(NamedTuple):
    """Rank and smallest singular value at a generic state, and the rows to spare."""

    rank: int
    smallest: float
    redundant: tuple[bool, ...]


def analyse(
    point: Point,
    q: Floats,
    v: Floats,
    errors: Mapping[str, float],
    levels: Sequence[str] = LEVELS,
    *,
    double: Floats | None = None,
) -> RankReport:
    """Find the rank of the constraint rows, and the dependent ones by name.

    Parameters
    ----------
    errors
        Of the state's values, by name.
    levels
        Those on which contradictions are looked for: what the state meets, and the
        first one that it does not.
    double
        The way to the state, where it was found as a double root and is known to half
        of the digits of that.
    """
    rows = point.e.rows
    if not rows:
        return RankReport(0, 1.0, 0, 1.0)
    if is_large(point):
        rows_now = SparseRows(point, q, v, errors)
        smallest = rows_now.smallest
        if smallest > SURELY:
            return RankReport(len(rows), smallest, len(rows), smallest)
    Y, lengths = scaled_rows(point, q, v, errors=errors)
    if double is not None:
        lengths = _without_traces(point, q, v, Y, lengths, double)
    flags = redundant_rows(Y, RANK if double is None else HALF)
    rank = flags.count(False)
    left, sizes, _ = np.linalg.svd(Y, full_matrices=False)
    smallest = float(sizes[rank - 1]) if rank else 1.0
    if rank == len(rows):
        return RankReport(rank, smallest, rank, smallest)
    generic = _generic(point, q, v, rank, double)
    demands = Demands(point, q, v, errors, levels)
    combinations = _combinations(Y, lengths, flags)
    dependences = []
    for i in [i for i, flag in enumerate(flags) if flag]:
        coefficients = combinations[i]
        everywhere = None
        if generic is not None:
            everywhere = generic.redundant[i] or generic.rank <= rank
        dependences.append(
            Dependence(
                rows[i].name,
                tuple((rows[j].name, c) for j, c in coefficients.items()),
                everywhere,
                demands.contradictions(i, coefficients),
            )
        )
    loose = _dependent(left[:, :rank])
    names = tuple(
        row.name for row, is_loose in zip(rows, loose, strict=True) if is_loose
    )
    # Rank can only be lost at a state, not won.
    if generic is None or generic.rank < rank:
        generic = _Generic(rank, smallest, tuple(flags))
    return RankReport(
        rank, smallest, generic.rank, generic.smallest, tuple(dependences), names
    )


def scaled_rows(
    point: Point,
    q: Floats,
    v: Floats,
    metric: Callable[[Floats, Floats], Floats] = rank_metric,
    errors: Mapping[str, float] | None = None,
) -> tuple[Floats, Floats]:
    """Give the rows (m, n) in a metric made of M and A, to length 1, and their lengths.

    With `errors`, those of the state, entries that are only
    rounding are zero.
    """
    A = np.nan_to_num(point.jacobian(point.e.rows, q, v, errors))
    Y = np.linalg.solve(np.linalg.cholesky(metric(point.mass(q, v), A)), A.T).T
    lengths = np.linalg.norm(Y, axis=1)
    return Y / np.where(lengths > 0, lengths, 1.0)[:, None], lengths


def weakest_rows(
    point: Point, q: Floats, v: Floats, rank: int, usual: Sequence[float]
) -> tuple[Floats, float]:
    """Give the combination (m,) of rows that is closest to zero, and its length.

    The last of `rank` singular values; rows count as not shorter than they are as a
    rule, `usual`.
    """
    if is_large(point):
        rows = SparseRows(point, q, v, usual=usual)
        if rows.smallest > 0.0:
            return rows.weakest, rows.smallest
    Y, lengths = scaled_rows(point, q, v, solving_metric)
    scale = np.maximum(lengths, usual)
    Y = Y * (lengths / np.where(scale > 0, scale, 1.0))[:, None]
    left, sizes, _ = np.linalg.svd(Y)
    last = min(rank, len(sizes)) - 1
    return left[:, last], float(sizes[last])


def redundant_rows(Y: Floats, cutoff: float = RANK) -> list[bool]:
    """Tell of each scaled row whether the earlier ones already span it."""
    basis, rank = np.empty((min(Y.shape), Y.shape[1])), 0
    flags: list[bool] = []
    for row in Y:
        left = row.copy()
        for _ in range(2):  # twice is enough (Kahan)
            left -= (basis[:rank] @ left) @ basis[:rank]
        length = float(np.linalg.norm(left))
        flags.append(length <= cutoff)
        if not flags[-1] and rank < len(basis):
            basis[rank] = left / length
            rank += 1
    return flags


def _dependent(range_: Floats) -> Flags:
    """Tell which rows are part of some dependence, (m,).

    Those whose unit vectors are not in the range of the columns of an orthogonal
    matrix; by blocks, for m x m numbers take long and much memory.
    """
    found = np.zeros(len(range_), bool)
    for k in range(0, len(range_), BLOCK):
        part = range_[k : k + BLOCK] @ range_.T
        part[np.arange(len(part)), k + np.arange(len(part))] -= 1.0
        found[k : k + BLOCK] = np.any(np.abs(part) > 1e-9, axis=1)
    return found


def _combinations(
    Y: Floats, lengths: Floats, flags: Sequence[bool]
) -> dict[int, dict[int, float]]:
    """Give each redundant row as a combination of the independent rows before it."""
    independent = [i for i, flag in enumerate(flags) if not flag]
    redundant = [i for i, flag in enumerate(flags) if flag]
    K = least_squares(Y[independent].T, Y[redundant].T, None)
    return {
        i: {
            j: float(c * lengths[i] / lengths[j])
            for j, c in zip(independent, k, strict=True)
            if abs(c) > 1e-9
        }
        for i, k in zip(redundant, K.T, strict=True)
    }


def _generic(
    point: Point, q: Floats, v: Floats, least: int, double: Floats | None
) -> _Generic | None:
    """Give what the rows are like at generic admissible states nearby.

    least
        Their rank at the state, which is not lost around it.
    """
    random = np.random.default_rng(1)  # the same states each time
    found: list[_Generic] = []
    for trial in range(TRIALS):
        nearby = NEARBY if trial < SAMPLES else NEARBY / 10.0 ** (trial - SAMPLES)
        near = admissible_near(point, q, v, nearby, random, double)
        if near is None:
            continue
        state = (near.q, near.v)
        errors = point.solved_errors(*state, (q, v))
        Y, lengths = scaled_rows(point, *state, errors=errors)
        if near.double:
            _without_traces(point, *state, Y, lengths, nearby * near.spread)
        flags = redundant_rows(Y, HALF if near.double else GENERIC_RANK)
        sizes = np.linalg.svd(Y, compute_uv=False)
        if (
            flags.count(False) > least
            and sizes[flags.count(False) - 1] < TRACE * nearby
        ):
            # More than that grows on the way; this is what Newton's method left.
            flags = redundant_rows(Y, TRACE * nearby)
        rank = max(flags.count(False), least)
        smallest = float(sizes[rank - 1]) if rank else 1.0
        found.append(_Generic(rank, smallest, tuple(flags)))
        if len(found) == SAMPLES:
            break
    return max(found, key=lambda g: (g.rank, g.smallest), default=None)


def _without_traces(
    point: Point, q: Floats, v: Floats, Y: Floats, lengths: Floats, way: Floats
) -> Floats:
    """Take rows of Y for zero that nearly vanish here, and not so far; give lengths."""
    random = np.random.default_rng(6)
    usual = np.zeros_like(lengths)
    for _ in range(SAMPLES):
        near = q + way * np.clip(random.standard_normal(len(q)), -1.0, 1.0)
        usual = np.fmax(usual, scaled_rows(point, near, v)[1])
    gone = lengths <= HALF * usual
    Y[gone] = 0.0
    return np.asarray(np.where(gone, 0.0, lengths))


class Near(NamedTuple):
    """A state nearby, how far it was varied, whether it was found as a double root."""

    q: Floats
    v: Floats
    spread: Floats
    double: bool


def admissible_near(
    point: Point,
    q: Floats,
    v: Floats,
    nearby: float,
    random: np.random.Generator,
    way: Floats | None = None,
) -> Near | None:
    """Give a random state near (q, v) that the constraints admit; None if not found.

    way
        To (q, v), where it was found as a double root: as far as that lengths
        are not known.
    """
    metric = rank_metric(point.mass(q, v), point.jacobian(point.e.rows, q, v))
    if not np.all(np.isfinite(metric)):
        return None
    sizes = np.sqrt(np.diag(metric))
    speed = np.sqrt(v @ metric @ v) or 1.0
    own = np.where(v != 0, np.abs(v), speed / sizes)
    lengths = of_rows(point, point.e.rows, q, v).spread
    if way is not None:
        lengths = np.where(lengths > 0.0, np.fmax(lengths, way), 0.0)
    spreads = (lengths, own)
    state = []
    for x, spread in zip((q, v), spreads, strict=True):
        kick = np.clip(random.standard_normal(point.n), -1.0, 1.0)
        state.append(x + nearby * spread * kick)
    names = frozenset(point.e.velocities)
    moving = (
        point.g.depends([a for row in point.e.rows for a in row.A.entries.values()])
        & names
    )
    double = False
    for velocities in (False, True) if moving else (False,):
        asked = Asked()
        asked.add_rows(point.e.rows, velocities=velocities)
        if not asked.nodes:
            continue
        relations = point.relations(
            asked, range(point.n), state[0], state[1], {}, velocities=velocities
        )
        reached = reach(relations, state[velocities], metric)
        if not reached.met:
            return None
        state[velocities] = reached.x
        double |= reached.trouble is Trouble.DOUBLE_ROOT
    return Near(state[0], state[1], spreads[0], double)
