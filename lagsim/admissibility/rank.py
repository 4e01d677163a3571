"""Rank of the constraint Jacobian: dependent rows, contradictions, and thin sets.

Rows are compared in the metric of the mass matrix M and scaled to length 1, so that
units and scales of relations have no influence. A nearly parallel row is a real
constraint: a row is dependent only if its remainder is below DEPENDENT_ROWS. A gradient
within its rounding error is zero.

A row in the span of others may be redundant: then all states that the others admit
satisfy it, too. It may be dependent only at a singular configuration, where motions
branch. Or it is dependent on the whole set of its solutions, as that of x^2 + y^2 = 0,
of two spheres that touch, or of a plane and a cylinder that touch along a line: the
relation has a multiple root there. No finite multiplier keeps a motion on such a thin
set. Redundancy is tested at states that the other rows admit, dependence on the whole
set at generic states nearby.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from lagsim.admissibility.newton import Relations, Trouble, reach, relations_of
from lagsim.admissibility.point import of_rows
from lagsim.mechanics.algebra import (
    Span,
    cholesky,
    kkt_factors,
    largest_eigenvalue,
    least_squares,
    lengths_in,
    rank_metric,
    solving_metric,
    whitened_rows,
)
from lagsim.tolerances import (
    COMPUTED_ZERO,
    DEPENDENT_ROWS,
    HALF_OF_DIGITS,
    SAFELY_INDEPENDENT,
    SAME_RESULT,
    STATE_ROUNDOFF,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Mapping, Sequence

    from lagsim.admissibility.point import Point
    from lagsim.language.arrays import Floats
    from lagsim.mechanics.constraints import Row

# Safety factor of bounds of rounding errors, which are of first order.
CAUTION = 100.0
LEVELS = ("position", "velocity", "acceleration")
# Relative distance of generic states nearby, their number, and the number of trials.
NEARBY = 0.05
SAMPLES = 3
TRIALS = 8
# Least singular value of a row that is independent at such a state, over the distance.
TRACE = 1e-4


class Dependence(NamedTuple):
    """A row in the span of others: row = sum of coefficient times row.

    Attributes
    ----------
    name : str
    combination : tuple of (name, coefficient)
        Empty if the row itself vanishes.
    everywhere : bool or None
        Whether the dependence holds at generic admissible states nearby, or at the
        state only; None if no generic state was found.
    contradictions : dict
        "position", "velocity" or "acceleration" -> difference between the right-hand
        side of the row's equation for these and the one that the others imply.
    """

    name: str
    combination: tuple[tuple[str, float], ...]
    everywhere: bool | None
    contradictions: dict[str, float]

    def __str__(self) -> str:
        """Return the combination as text, `c3 = 2 c1 - c2`."""
        text = ""
        for name, c in self.combination:
            size = "" if abs(abs(c) - 1) < COMPUTED_ZERO else f"{abs(c):.6g} "
            text += f"{' - ' if c < 0 else ' + '}{size}{name}"
        if text.startswith(" - "):
            text = "-" + text.removeprefix(" - ")
        return f"{self.name} = {text.removeprefix(' + ') or '0'}"

    def contradiction(self) -> str:
        """Return the first contradiction as text; "" if there is none."""
        for level, size in self.contradictions.items():
            if not self.combination:
                return (
                    f"`{self.name}` cannot be satisfied on the level of {level}: "
                    f"its gradient vanishes, and it is off by {size:.6g}"
                )
            others = " and ".join(f"`{name}`" for name, _ in self.combination)
            return (
                f"`{self.name}` contradicts {others} on the level of {level}, "
                f"by {size:.6g}"
            )
        return ""


class RankReport(NamedTuple):
    """The rank of the rows at a state.

    Attributes
    ----------
    rank : int
        The number of independent rows.
    smallest : float
        The smallest nonzero singular value of the scaled rows (1 if there is none).
    generic_rank, generic_smallest : int, float
        Rank and smallest singular value at generic admissible states nearby.
    dependences : tuple of Dependence
        One for each row in the span of earlier rows, in the order of the file.
    not_unique : tuple of str
        The constraints whose multipliers are not determined.
    thin : ThinSet or None
        The rows without finite multipliers, if there are any.
    """

    rank: int
    smallest: float
    generic_rank: int
    generic_smallest: float
    dependences: tuple[Dependence, ...] = ()
    not_unique: tuple[str, ...] = ()
    thin: ThinSet | None = None


def analyse(
    point: Point,
    levels: Sequence[str] = LEVELS,
    corrections: Sequence[Floats] | None = None,
    *,
    double: bool = False,
) -> RankReport:
    """Return the rank of the constraint rows, and the dependent rows by name.

    Parameters
    ----------
    point : Point
    levels : sequence of str
        Some of LEVELS, in this order: contradictions are searched in the equations for
        positions, for velocities or for accelerations. These are the levels whose
        equations the state satisfies, and the first level whose equations it violates.
    corrections : sequence of ndarray, shape (n,), optional
        Change of positions and of velocities on the way to the state. If given, and the
        state satisfies the equations of all levels, thin sets are searched around it.
    double : bool
        Whether the state is a double root, known to half of its digits. Its error is
        then as large as `corrections`.
    """
    rows = point.e.rows
    if not rows:
        return RankReport(0, 1.0, 0, 1.0)
    if point.is_large:
        smallest, _ = _smallest_of_sparse(point, rounded=True)
        if smallest > SAFELY_INDEPENDENT:
            return RankReport(len(rows), smallest, len(rows), smallest)
    Y, lengths = scaled_rows(point, rounded=True)
    around = corrections[0] if double and corrections else None
    if around is not None:
        lengths = _without_traces(point, Y, lengths, around)
    flags = dependent_rows(Y, DEPENDENT_ROWS if around is None else HALF_OF_DIGITS)
    rank = flags.count(False)
    # All m left vectors are needed; all n right vectors would be n^2 unused numbers.
    left, sizes, _ = np.linalg.svd(Y, full_matrices=len(Y) > point.n)
    smallest = float(sizes[rank - 1]) if rank else 1.0
    if rank == len(rows):
        return RankReport(rank, smallest, rank, smallest)
    generic = _generic(point, rank, around)
    demands = _demands(point, levels)
    dependences = []
    for i, coefficients in _combinations(Y, lengths, flags).items():
        everywhere = None
        if generic is not None:
            everywhere = generic.dependent[i] or generic.rank <= rank
        combination = tuple((rows[j].name, c) for j, c in coefficients.items())
        against = _contradictions(demands, i, coefficients)
        dependences.append(Dependence(rows[i].name, combination, everywhere, against))
    # The rows that are part of some combination that vanishes.
    shared = np.any(np.abs(left[:, rank:]) > COMPUTED_ZERO, axis=1)
    names = tuple(row.name for row, is_in in zip(rows, shared, strict=True) if is_in)
    # At a single state the rank is at most the generic rank.
    if generic is None or generic.rank < rank:
        generic = _Generic(rank, smallest, tuple(flags))
    thin = None
    if corrections is not None and levels == LEVELS:
        nearby = (np.zeros(point.n) if around is None else around, corrections[1])
        thin, real = thin_set(point, dependences, nearby)
        # The row is not redundant, though no other state was found nearby.
        dependences = [
            d._replace(everywhere=False)
            if d.name in real and d.everywhere is None
            else d
            for d in dependences
        ]
    found = rank, smallest, generic.rank, generic.smallest
    return RankReport(*found, tuple(dependences), names, thin)


def scaled_rows(
    point: Point,
    metric: Callable[[Floats, Floats], Floats] = rank_metric,
    *,
    rounded: bool = False,
) -> tuple[Floats, Floats]:
    """Return the rows A (m, n) scaled to length 1 in a metric, and their lengths (m,).

    Parameters
    ----------
    point : Point
    metric : function
        Maps the mass matrix M (n, n) and the rows A (m, n) to the metric (n, n).
    rounded : bool
        Whether entries within rounding count as zero.
    """
    A = np.nan_to_num(point.jacobian(point.e.rows, rounded=rounded))
    return whitened_rows(A, cholesky(metric(point.mass_matrix, A)))


def row_lengths(point: Point) -> Floats:
    """Return the lengths (m,) of the rows in the metric of the solver.

    A length within rounding is 0; all are nan if M is not finite.
    """
    if point.is_large and point.is_safely_positive:
        found = lengths_in(*_sparse(point))
        if np.all(np.isfinite(found)):
            return found
    if not np.all(np.isfinite(point.mass_matrix)):
        return np.full(len(point.e.rows), np.nan)
    return scaled_rows(point, solving_metric, rounded=True)[1]


def weakest_rows(
    point: Point, rank: int, usual: Sequence[float]
) -> tuple[Floats, float]:
    """Return the coefficients (m,) of the smallest combination of rows, and its length.

    The coefficients are a left singular vector of the scaled rows, and the length is
    its singular value.

    Parameters
    ----------
    point : Point
    rank : int
        The number of that singular value; 1 for the largest.
    usual : sequence of float, length m
        Usual lengths of the rows: a row counts as at least this long.
    """
    if point.is_large:
        smallest, weakest = _smallest_of_sparse(point, usual)
        if smallest > 0.0:
            return weakest, smallest
    Y, lengths = scaled_rows(point, solving_metric)
    scale = np.maximum(lengths, usual)
    Y = Y * (lengths / np.where(scale > 0, scale, 1.0))[:, None]
    left, sizes, _ = np.linalg.svd(Y, full_matrices=False)
    last = min(rank, len(sizes)) - 1
    return left[:, last], float(sizes[last])


def _sparse(point: Point, *, rounded: bool = False) -> tuple[Any, Any]:
    """Return M (n, n) and A (m, n) as sparse matrices.

    rounded : whether entries within rounding count as 0.
    """
    rows, n = point.e.rows, point.n
    A = point.jacobian_entries(rows, rounded=rounded).sparse(len(rows), n)
    return point.mass_entries().sparse(n, n), A


def _smallest_of_sparse(
    point: Point, usual: Sequence[float] | None = None, *, rounded: bool = False
) -> tuple[float, Floats]:
    """Return the smallest singular value of scaled sparse rows, and its combination.

    The combination (m,) has the coefficients of the rows: the left singular vector.
    Each row is divided by its length or, if given, by `usual`. The value is 0 if it
    cannot be computed safely.

    rounded : whether entries within rounding count as 0.
    """
    from scipy.sparse import diags

    m, n = len(point.e.rows), point.n
    unknown = 0.0, np.zeros(m)
    if not point.is_safely_positive:
        return unknown
    M, A = _sparse(point, rounded=rounded)
    lengths = lengths_in(M, A)
    scale = lengths if usual is None else np.fmax(usual, lengths)
    factors = kkt_factors(M, diags(1.0 / scale) @ A) if np.all(scale > 0) else None
    if factors is None:
        return unknown

    def inverse(r: Floats) -> Floats:
        """Return (A M^-1 A^T)^-1 r for a vector r (m,), with the scaled rows A."""
        return -np.asarray(factors.solve(np.concatenate([np.zeros(n), r])))[n:]

    largest, weakest = largest_eigenvalue(inverse, m)
    return 1.0 / math.sqrt(largest) if np.isfinite(largest) else 0.0, weakest


def dependent_rows(Y: Floats, cutoff: float = DEPENDENT_ROWS) -> list[bool]:
    """Return a mask (m,) of the scaled rows that lie in the span of earlier rows.

    A row counts as dependent if the part outside that span is at most `cutoff`.

    Y : (m, n), the rows scaled to length 1.

    Examples
    --------
    >>> import numpy as np
    >>> dependent_rows(np.array([[1.0, 0.0], [0.0, 1.0], [0.6, 0.8]]))
    [False, False, True]
    """
    span = Span(Y.shape[1])
    return [not span.extend(row, cutoff) for row in Y]


def _combinations(
    Y: Floats, lengths: Floats, flags: Sequence[bool]
) -> dict[int, dict[int, float]]:
    """Return each dependent row as a combination of independent rows.

    The result maps the index of a dependent row to coefficients by index of an
    independent row.

    Y : rows (m, n) scaled to length 1.
    lengths : (m,), the lengths of the rows before this scaling.
    flags : a mask (m,) of the dependent rows.
    """
    independent = [i for i, flag in enumerate(flags) if not flag]
    dependent = [i for i, flag in enumerate(flags) if flag]
    K = least_squares(Y[independent].T, Y[dependent].T, None)
    return {
        i: {
            j: float(c * lengths[i] / lengths[j])
            for j, c in zip(independent, k, strict=True)
            if abs(c) > COMPUTED_ZERO
        }
        for i, k in zip(dependent, K.T, strict=True)
    }


def _demands(point: Point, levels: Sequence[str]) -> dict[str, tuple[Floats, Floats]]:
    """Return right-hand sides (m,) of the rows' equations, with error bounds (m,).

    levels : the equations: some of "position", "velocity", "acceleration", which are
        the keys of the result.
    """
    rows, zero = point.e.rows, point.g.zero
    # Terms that are large only by the distance from the origin do not count.
    lengths = of_rows(point, rows)
    equations = {
        "position": ([r.residual if r.holonomic else zero for r in rows],
                     [r.residual_scale for r in rows], lengths.scales),
        "velocity": ([r.rate for r in rows], [r.rate_scale for r in rows],
                     lengths.motions),
        "acceleration": ([r.b for r in rows], [r.b for r in rows], None),
    }  # fmt: skip
    found = {}
    for level in levels:
        nodes, sizes, own = equations[level]
        scales = abs(point.array(sizes))
        scales = np.fmin(scales, own()) if own else scales
        small = SAME_RESULT * scales + CAUTION * point.rounding(nodes)
        found[level] = point.array(nodes), small
    return found


def _contradictions(
    demands: Mapping[str, tuple[Floats, Floats]], i: int, others: Mapping[int, float]
) -> dict[str, float]:
    """Return the differences between row i's right-hand sides and the implied ones.

    The result contains the differences that exceed rounding, by level ("position",
    ...).

    demands : the result of `_demands`.
    i : index of the row.
    others : index -> coefficient of the rows in the combination that equals row i.
    """
    among, weights = [i, *others], np.array([1.0, *(-c for c in others.values())])
    found = {}
    for level, (values, small) in demands.items():
        # That a vanishing row is violated is no contradiction yet: other states may
        # satisfy it.
        if level == "position" and not others:
            continue
        gap = float(abs(weights @ values[among]))
        if gap > np.abs(weights) @ small[among]:
            found[level] = gap
    return found


# --- States nearby


class Neighbourhood:
    """Random states around a point, for decisions that must hold at generic states.

    Positions vary by the lengths of the relations (see `point.Lengths`), velocities by
    their own size.

    Parameters
    ----------
    point : Point
    corrections : sequence of ndarray, shape (n,), or None
        Change of positions and of velocities on the way to the point: within this
        distance of a double root, lengths are unknown.

    Attributes
    ----------
    metric : ndarray, shape (n, n)
        Metric in which states are projected onto the rows.
    spreads : list of ndarray, shape (n,)
        Variation of positions, and of velocities.
    """

    def __init__(
        self, point: Point, corrections: Sequence[Floats | None] = (None, None)
    ) -> None:
        self.point, v = point.at(errors={}), point.v
        self.metric = rank_metric(point.mass_matrix, point.gradients)
        speed = np.sqrt(v @ self.metric @ v) or 1.0
        rates = np.where(v != 0, np.abs(v), speed / np.sqrt(np.diag(self.metric)))
        self.spreads = [of_rows(point, point.e.rows).spread, rates]
        for k, (spread, own) in enumerate(zip(self.spreads, corrections, strict=True)):
            if own is not None:
                self.spreads[k] = np.where(spread > 0.0, np.fmax(spread, own), 0.0)

    def varied(
        self, size: float, random: np.random.Generator, *, velocities: bool
    ) -> Floats:
        """Return positions or velocities (n,), varied at random.

        size : the variation in units of the spread.
        velocities : whether velocities are varied.
        """
        x = self.point.v if velocities else self.point.q
        kick = np.clip(random.standard_normal(self.point.n), -1.0, 1.0)
        return np.asarray(x + size * self.spreads[velocities] * kick)

    def admissible(
        self, size: float, random: np.random.Generator
    ) -> tuple[Point, bool] | None:
        """Return a random state that all rows admit, and whether it is a double root.

        None if no such state is found.

        size : the distance of the state, in units of the spread.
        """
        if not np.all(np.isfinite(self.metric)):
            return None
        g, rows = self.point.g, self.point.e.rows
        q, v = (self.varied(size, random, velocities=x) for x in (False, True))
        near, double = self.point.at(q, v), False
        entries = [a for row in rows for a in row.A.entries.values()]
        moving = g.depends(entries) & frozenset(self.point.e.velocities)
        for velocities in (False, True) if moving else (False,):
            relations = relations_of(near, rows, velocities=velocities)
            if not relations.conditions:
                continue
            reached = reach(relations, relations.x0, self.metric)
            if not reached.converged:
                return None
            near = relations.at(reached.x)
            double |= reached.trouble is Trouble.DOUBLE_ROOT
        return near, double

    def states(self, relations: Relations, count: int) -> list[Floats]:
        """Return up to `count` random solutions of relations near the point."""
        random = np.random.default_rng(7)  # the same each time
        found = []
        for _ in range(count):
            x = self.varied(FAINT, random, velocities=relations.velocities)
            if not relations.conditions:
                found.append(x)
            elif (reached := reach(relations, x, self.metric)).converged:
                found.append(reached.x)
        return found

    def dimension(self, relations: Relations) -> int | None:
        """Return the dimension of the solution set of relations; None if not found."""
        n, k = self.point.n, relations.velocities
        if n > MOST:
            return None
        spread, weights = self.spreads[k], np.sqrt(np.diag(self.metric))
        size = np.max(spread * weights, initial=0.0) or 1.0
        spread = self.spreads[k] = np.where(spread > 0, spread, size / weights)
        states = self.states(relations, n + 2)
        if len(states) < n + 1:
            return None
        deviations = (np.array(states) - relations.x0) / (FAINT * spread)
        return int(np.sum(np.linalg.svd(deviations, compute_uv=False) > THIN))


class _Generic(NamedTuple):
    """Rank, smallest singular value, and mask of dependent rows at a generic state."""

    rank: int
    smallest: float
    dependent: tuple[bool, ...]


def _generic(point: Point, least: int, double: Floats | None) -> _Generic | None:
    """Return rank and dependent rows at generic admissible states nearby.

    None if no such state is found.

    Parameters
    ----------
    point : Point
    least : int
        The rank at the state, a lower bound of the generic rank.
    double : ndarray, shape (n,), or None
        Change of positions on the way to a double root.
    """
    random = np.random.default_rng(1)  # the same states each time
    around = Neighbourhood(point, (double, None))
    found: list[_Generic] = []
    for trial in range(TRIALS):
        size = NEARBY if trial < SAMPLES else NEARBY / 10.0 ** (trial - SAMPLES)
        near = around.admissible(size, random)
        if near is None:
            continue
        state, is_double = near
        state = state.at(errors=state.solved_errors((point.q, point.v)))
        Y, lengths = scaled_rows(state, rounded=True)
        if is_double:
            _without_traces(state, Y, lengths, size * around.spreads[0])
        flags = dependent_rows(Y, HALF_OF_DIGITS if is_double else COMPUTED_ZERO)
        sizes = np.linalg.svd(Y, compute_uv=False)
        rank = flags.count(False)
        if rank > least and sizes[rank - 1] < TRACE * size:
            # A residual above this grows on the path; a smaller one is the error of
            # Newton's method.
            flags = dependent_rows(Y, TRACE * size)
        rank = max(flags.count(False), least)
        smallest = float(sizes[rank - 1]) if rank else 1.0
        found.append(_Generic(rank, smallest, tuple(flags)))
        if len(found) == SAMPLES:
            break
    return max(found, key=lambda g: (g.rank, g.smallest), default=None)


def _without_traces(
    point: Point, Y: Floats, lengths: Floats, correction: Floats
) -> Floats:
    """Set rows of Y to zero that nearly vanish at the point, but not around it.

    Such a row is a trace of rounding at a double root. Return the lengths (m,) with 0
    for these rows.

    Parameters
    ----------
    Y : ndarray, shape (m, n)
        The rows scaled to length 1, changed in place.
    lengths : ndarray, shape (m,)
        The lengths of the rows before scaling.
    correction : ndarray, shape (n,)
        Distances from the point within which the rows are evaluated.
    """
    random = np.random.default_rng(6)
    usual = np.zeros_like(lengths)
    for _ in range(SAMPLES):
        kick = np.clip(random.standard_normal(point.n), -1.0, 1.0)
        usual = np.fmax(usual, scaled_rows(point.at(point.q + correction * kick))[1])
    vanish = lengths <= HALF_OF_DIGITS * usual
    Y[vanish] = 0.0
    return np.asarray(np.where(vanish, 0.0, lengths))


# --- Thin sets

# Variation of states relative to their lengths, and number of states.
FAINT = 1e-2
THIN_SAMPLES = 8
# A residual below this part of its change along the way to a state is rounding.
MISSED = 1e-10
# Most coordinates with which the dimension of a set is measured; least relative
# distance of points of the set along a direction that it contains.
MOST = 60
THIN = 0.05


class ThinSet(NamedTuple):
    """A set of admissible positions on which rows lose their rank at all points.

    Attributes
    ----------
    names : tuple of str
        The rows that are dependent on the set, and violated at all points around it.
    dimension : int or None
        The dimension of the set; None if it was not found.
    degrees_of_freedom : int or None
        The dimension minus the number of independent relations between velocities.
    """

    names: tuple[str, ...]
    dimension: int | None
    degrees_of_freedom: int | None = None

    def __str__(self) -> str:
        named = " and ".join(f"`{name}`" for name in self.names)
        text = (
            f"{named} has only a multiple root: the constraints lose rank at every "
            "admissible state, and no multiplier keeps a motion admissible"
        )
        if self.dimension is None:
            return text
        if self.dimension == 0:
            return f"{text}; there is one admissible state, an isolated point"
        return f"{text}; the admissible states have dimension {self.dimension}"


def thin_set(
    point: Point, dependences: Sequence[Dependence], corrections: tuple[Floats, Floats]
) -> tuple[ThinSet | None, tuple[str, ...]]:
    """Return the rows with a multiple root on the whole solution set through the point.

    Parameters
    ----------
    point : Point
    dependences : sequence of Dependence
    corrections : tuple of ndarray, shape (n,)
        See `Neighbourhood`.

    Returns
    -------
    thin : ThinSet or None
        None if no row has a multiple root on the whole set.
    real : tuple of str
        Dependent rows that are violated by states on which all other rows hold.
    """
    suspects = [d for d in dependences if d.everywhere is not False]
    if not suspects or point.is_large:
        return None, ()
    dependent = {d.name for d in dependences}
    around, rows, real = Neighbourhood(point, corrections), point.e.rows, list[str]()
    moving = frozenset(point.e.velocities)
    holonomic = [row for row in rows if row.holonomic]
    for k, examined in enumerate((holonomic, rows)):
        if k:
            # For positions there are no further rows; for velocities the curved rows.
            curved = {
                row.name
                for row in rows
                if not row.holonomic
                and point.g.depends(row.A.entries.values()) & moving
            }
            suspects = [d for d in suspects if d.name in curved]
        found = _violated(around, examined, suspects, dependent, velocities=bool(k))
        real += [d.name for d in found]
        thin = tuple(d.name for d in found if d.everywhere)
        if not thin:
            continue
        dimension = around.dimension(relations_of(point, examined, velocities=bool(k)))
        if k:
            return ThinSet(thin, None, dimension), tuple(real)
        free = {row.name for row in rows if not row.holonomic} - dependent
        freedom = None if dimension is None else dimension - len(free)
        return ThinSet(thin, dimension, freedom), tuple(real)
    return None, tuple(real)


def _violated(
    around: Neighbourhood,
    rows: Sequence[Row],
    dependences: Sequence[Dependence],
    dependent: Collection[str],
    *,
    velocities: bool,
) -> list[Dependence]:
    """Return the dependent rows that are violated by states on which all others hold.

    Such a row is a constraint of its own, no consequence of the others.

    Parameters
    ----------
    around : Neighbourhood
        The source of the states.
    rows : sequence of Row
        All rows.
    dependences : sequence of Dependence
        The rows to be tested.
    dependent : collection of str
        Names of all dependent rows.
    velocities : bool
        Whether relations between velocities are tested, or between positions.
    """
    known, point = {row.name: row for row in rows}, around.point
    suspects = [d for d in dependences if d.name in known]
    independent = [row for row in rows if row.name not in dependent]
    # If the independent rows determine the state, there is no other state to test.
    if not suspects or len(independent) >= point.n:
        return []
    others = relations_of(point, independent, velocities=velocities)
    own = [known[d.name] for d in suspects]
    relations = relations_of(point, own, velocities=velocities)
    # Bound of the rounding of the rows at these states.
    L, x0 = cholesky(around.metric), relations.x0
    slopes = np.linalg.norm(np.linalg.solve(L, relations(x0)[1].T), axis=0)
    missed = np.zeros(len(suspects), bool)
    for x in around.states(others, THIN_SAMPLES):
        far = MISSED * np.linalg.norm(L.T @ (x - x0)) * slopes
        violated = relations.violated(x, STATE_ROUNDOFF * np.abs(x))
        missed |= violated & (np.abs(relations(x)[0]) > far)
    return [d for d, is_missed in zip(suspects, missed, strict=True) if is_missed]
