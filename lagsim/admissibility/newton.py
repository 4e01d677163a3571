"""The nearest point that satisfies relations: damped Newton, then minimisation.

`nearest_solution` minimises |x - x0| in a metric subject to r(x) = 0. Damped Newton
steps of least change solve the relations; then Newton's method on the Lagrange
function, along the relations and with a return to the relations after each step,
descends to the minimum, which differs in general from the end of the first iteration.
If the relations cannot be solved, the result contains the reason.

Source: J. Nocedal and S. J. Wright, Numerical Optimization, 2nd ed., chapters 15, 18.
"""

from __future__ import annotations

import math
from enum import Enum
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from lagsim.admissibility.point import implied_conditions
from lagsim.language.derivatives import tangent
from lagsim.mechanics.algebra import (
    Entries,
    cholesky,
    kkt_factors,
    least_squares,
    null_space,
    whitened_rows,
)
from lagsim.tolerances import (
    COMPUTED_ZERO,
    CONVERGED,
    HALF_OF_DIGITS,
    STATE_ROUNDOFF,
    TERM_ROUNDOFF,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence

    from lagsim.admissibility.point import Condition, Point
    from lagsim.language.arrays import Flags, Floats
    from lagsim.mechanics.constraints import Row


# --- Relations: residuals as functions of some values of a state

# A step of m dense equations for k values takes m * k * min(m, k) / STEP operations.
STEP = 350.0


class Relations:
    """Residuals r (m,) as a function of some values x (k,) of a state.

    Parameters
    ----------
    point : Point
        The state, whose other values are fixed.
    conditions : sequence of Condition
        Equations for positions or, with `velocities`, for velocities.
    free : sequence of int
        Indices of the unknowns among positions, velocities or first-order states.
    velocities : bool
        Whether the unknowns are velocities.
    states : bool
        With `velocities`: whether the unknowns are first-order states.
    """

    def __init__(
        self,
        point: Point,
        conditions: Sequence[Condition],
        free: Sequence[int],
        *,
        velocities: bool,
        states: bool = False,
    ) -> None:
        self.free, self.block = list(free), velocities + states
        e = point.e
        names = (e.q, e.velocities, [x.name for x in e.states])[self.block]
        self.names = [names[j] for j in self.free]
        place = {j: k for k, j in enumerate(self.free)}
        self._set_conditions(point, conditions, place, velocities=velocities)

    def _set_conditions(
        self,
        point: Point,
        conditions: Sequence[Condition],
        place: Mapping[int, int],
        *,
        velocities: bool,
    ) -> None:
        self.point, self.conditions, self.velocities = point, conditions, velocities
        self.nodes = [x.node for x in conditions]
        self.targets = np.array([x.target for x in conditions])
        # Derivatives of each node: index of an unknown -> node.
        self.slopes = [
            {place[j]: s for j, s in x.A.items() if j in place} for x in conditions
        ]

    @property
    def _state(self) -> tuple[Floats, Floats, Floats]:
        return self.point.q, self.point.v, self.point.state.s

    @property
    def angles(self) -> int:
        """Number of leading unknowns that can be angles: 0 for velocities, else k."""
        return 0 if self.velocities else len(self.names)

    @property
    def x0(self) -> Floats:
        """Values of the k unknowns at the point, where the iteration starts."""
        return self._state[self.block][self.free]

    def at(self, x: Floats, errors: Floats | None = None) -> Point:
        """Return the point with values x (k,), optionally with error bounds (k,)."""
        q, v, s = state = [part.copy() for part in self._state]
        state[self.block][self.free] = x
        if errors is None:
            return self.point.at(q, v, s=s)
        own: Mapping[str, float] = dict(zip(self.names, errors.tolist(), strict=True))
        return self.point.at(q, v, {**self.point.errors, **own}, s=s)

    @cached_property
    def _second(self) -> list[tuple[int, int, int, int]]:
        """The second derivatives of r that do not vanish identically.

        Each item has the index of the relation, the indices of two unknowns, and the
        node of the derivative.
        """
        g, found = self.point.g, []
        place = {g.variable(x): k for k, x in enumerate(self.names)}
        for i, row in enumerate(self.slopes):
            nodes = list(row.values())
            for x in sorted(place.keys() & frozenset(g.cone(nodes))):
                found += [
                    (i, j, place[x], node)
                    for j, node in zip(row, tangent(g, nodes, {x: g.one}), strict=True)
                    if node != g.zero
                ]
        return found

    def curvature(self, x: Floats, multipliers: Floats) -> Floats:
        """Return the sum of multipliers[i] d^2 r_i/dx^2 over i, (k, k), at x (k,)."""
        found = np.zeros((len(self.names), len(self.names)))
        values = self.at(x).array([entry[3] for entry in self._second])
        for (i, j, k, _), value in zip(self._second, values, strict=True):
            found[j, k] += multipliers[i] * value
        return (found + found.T) / 2

    def __call__(self, x: Floats) -> tuple[Floats, Floats]:
        """Return r (m,) and dr/dx (m, k), and count the operations of a dense step."""
        m, k = len(self.targets), len(self.names)
        self.point.g.count(m * k * min(m, k) / STEP)
        return self.evaluated(x)

    def evaluated(self, x: Floats) -> tuple[Floats, Floats]:
        """Return r (m,) and dr/dx (m, k) at x; no operations of a step are counted."""
        r, entries = self._with_entries(x)
        return r, entries.dense(len(r), len(self.names))

    def sparse(self, x: Floats) -> tuple[Floats, Any]:
        """Return r (m,) and dr/dx (m, k) as a sparse matrix."""
        r, entries = self._with_entries(x)
        return r, entries.sparse(len(r), len(x))

    def _with_entries(self, x: Floats) -> tuple[Floats, Entries]:
        own, slopes = self.nodes, self.slopes
        every = [*own, *(node for row in slopes for node in row.values())]
        found = self.at(x).array(every)
        i = np.repeat(np.arange(len(slopes)), [len(row) for row in slopes])
        j = np.array([j for row in slopes for j in row], dtype=int)
        return found[: len(own)] - self.targets, Entries(i, j, found[len(own) :])

    def are_satisfied(self, x: Floats, errors: Floats) -> bool:
        """Whether all relations are satisfied at x (k,), see `violated`.

        errors : error bounds (k,) of x.
        """
        return not np.any(self.violated(x, errors))

    def violated(self, x: Floats, errors: Floats) -> Flags:
        """Return a mask (m,) of the relations that are not satisfied at x (k,).

        A relation is satisfied if its residual is at most a given part of its terms, or
        within its rounding error.

        errors : error bounds (k,) of x.
        """
        point, residual, terms = self._against_terms(x, errors)
        found: Flags = ~(residual <= terms)
        far = np.flatnonzero(found).tolist()
        found[far] = ~(residual[far] <= self.rounding(point, far))
        return found

    def exact(self, x: Floats) -> bool:
        """Whether r at x is within the rounding errors of the values in the file."""
        point, residual, _ = self._against_terms(x)
        return bool(np.all(residual <= self.rounding(point)))

    def _against_terms(
        self, x: Floats, errors: Floats | None = None
    ) -> tuple[Point, Floats, Floats]:
        """Return the point with values x (k,), |r| (m,), and bounds of |r| (m,).

        The bounds are proportional to the terms of each relation.

        errors : error bounds (k,) of x.
        """
        point = self.at(x, errors)
        scale = np.abs(point.array([x.scale for x in self.conditions]))
        small = CONVERGED * np.maximum(scale, np.abs(self.targets))
        return point, np.abs(point.array(self.nodes) - self.targets), small

    def rounding(self, point: Point, rows: Sequence[int] | None = None) -> Floats:
        """Return error bounds of residuals by rounding and by errors of stated values.

        rows : indices of the residuals; by default all m.
        """
        rows = range(len(self.nodes)) if rows is None else rows
        found = point.rounding([self.nodes[i] for i in rows])
        return np.asarray(found + [self.conditions[i].error for i in rows])


def relations_of(point: Point, rows: Iterable[Row], *, velocities: bool) -> Relations:
    """Return the equations `rows` as relations between positions, or velocities.

    velocities : whether the unknowns are velocities.
    """
    conditions = implied_conditions(rows, velocities=velocities)
    return Relations(point, conditions, range(point.n), velocities=velocities)


# --- Divergence: relations that are satisfied by rounding alone, at ever larger values
#
# `x = sqrt(1 + x^2)` has no solution; its residual falls as 1/(2 x), and its terms
# grow, until at about 1e7 the residual is below the rounding of the terms. At a root
# the relation is satisfied, and on the path to it it is violated; the slope
# distinguishes a root from its neighbours.

# A point is no root if the relation is also satisfied this part of the distance before,
BACKWARD = 0.03
# and if slope times distance is at most this multiple of its residual, of its rounding,
# or of that of its slopes on the path, while the first residual was more. The multiple
# is about the number of steps, which do not become shorter where r falls as exp(-x).
LEVEL = 64.0


def diverges(
    relations: Relations,
    at: Callable[[Floats], tuple[Floats, Any]],
    x0: Floats,
    x: Floats,
    errors: Floats,
) -> bool:
    """Whether a relation that x0 violates is satisfied at x by rounding alone.

    Such a relation decreases towards infinity and has no root.

    Parameters
    ----------
    relations : Relations
    at : function
        x (k,) -> r (m,) and dr/dx (m, k), dense or sparse.
    x0, x : ndarray, shape (k,)
        First and last iterate.
    errors : ndarray, shape (k,)
        Error bounds of x.
    """
    change = x - x0
    if not np.any(change):
        return False
    back = x - BACKWARD * change
    r, J = at(x)
    first, slopes = at(x0)
    linear = np.abs(J @ change)
    if not np.all(np.isfinite(linear)):
        return False
    rounding = np.maximum(np.abs(r), relations.rounding(relations.at(x, errors)))
    rounding = np.maximum(rounding, TERM_ROUNDOFF * (abs(slopes) @ np.abs(change)))
    rounding = np.maximum(rounding, TERM_ROUNDOFF * np.abs(first))
    is_off = ~(linear > LEVEL * rounding)
    if not np.any(is_off):
        return False
    was_off = np.abs(first) > LEVEL * relations.rounding(relations.at(x0, errors))
    was_off &= relations.violated(x0, errors)
    return bool(np.any(is_off & was_off & ~relations.violated(back, errors)))


# --- Newton's method, and the minimum

MOST_STEPS = 60
# Number of further steps once the relations hold.
POLISHING = 3
SMALLEST_DAMPING = 1e-6
# Newton's method reduces the distance to a k-fold root by the factor (k - 1)/k. A root
# is multiple if the factor is in SLOW, constant to STEADY, HALVINGS times in a row.
HALVINGS = 5
SLOW = (0.4, 0.85)
STEADY = 0.05
ARRIVED = 2
# Number of other starts; with more unknowns than FEW there are none if a root is found,
# and the nearest point is a local minimum.
OTHER_STARTS = 6
FEW = 8
# A sparse iteration ends with a step whose length exceeds this part of the last one's.
SHORTER = 0.9
# A whole turn of an angle.
TURN = 2.0 * math.pi


class Trouble(Enum):
    """Reason why no root was found, or a peculiarity of the root.

    DOUBLE_ROOT is a root to which Newton's method converges only linearly; MINIMUM,
    DIVERGES and NOT_FINITE are reasons of a failure.
    """

    NONE = ""
    DOUBLE_ROOT = "double root"
    MINIMUM = "positive minimum"
    DIVERGES = "no root at a finite distance"
    NOT_FINITE = "values that are not finite"


class NewtonResult(NamedTuple):
    """Result of the iteration.

    Attributes
    ----------
    x : ndarray, shape (k,)
        The last iterate.
    converged : bool
        Whether the relations hold at x.
    trouble : Trouble
        Reason of a failure, or a peculiarity of the root.
    reason, least : str
        If not converged: texts on the reason, and on the least residual.
    """

    x: Floats
    converged: bool
    trouble: Trouble = Trouble.NONE
    reason: str = ""
    least: str = ""


@np.errstate(over="ignore", invalid="ignore")  # starts of any size
def nearest_solution(
    relations: Relations, metric: Floats, *, far: bool = True
) -> NewtonResult:
    """Return the point nearest to x0 in a metric that satisfies `relations`.

    If none is found, the result is a point of least |r| nearby.

    Parameters
    ----------
    relations : Relations
    metric : ndarray, shape (k, k)
    far : bool
        Whether to try other starts, for a nearer point or if the first one fails.
    """
    x0 = relations.x0
    if relations.exact(x0):
        return NewtonResult(x0, converged=True)
    reached = reach(relations, x0, metric)
    if far and not reached.converged:
        # In the metric the path can be a narrow valley: each value is scaled by its own
        # size.
        rest = np.sqrt(_square(x0, metric) or 1.0) / np.sqrt(np.diag(metric))
        sizes = np.where(x0 != 0.0, np.abs(x0), rest)
        other = reach(relations, x0, np.diag(sizes**-2.0))
        reached = other if other.converged else reached
    best = descend(relations, x0, reached.x, metric) if reached.converged else None
    if far and (best is None or len(x0) <= FEW):
        for start in _random_starts(relations, x0, best, metric):
            other = reach(relations, start, metric, x0)
            if not other.converged:
                continue
            x = descend(relations, x0, other.x, metric)
            if best is None:
                reached, best = other, x
            elif _square(x - x0, metric) < (1 - HALF_OF_DIGITS) * _square(
                best - x0, metric
            ):
                best = x
    if best is None:
        return _explained(relations, reached, metric)
    return NewtonResult(best, converged=True, trouble=reached.trouble)


def nearest_sparse(relations: Relations, M: Any) -> NewtonResult | None:
    """Return the nearest point in a sparse metric M (n, n); None without convergence.

    Each step solves for the nearest point that satisfies the linearised relations.
    """
    x0 = relations.x0
    if relations.exact(x0):
        return NewtonResult(x0, converged=True)
    x, last = x0.copy(), np.inf
    for _ in range(MOST_STEPS):
        r, J = relations.sparse(x)
        if not (np.all(np.isfinite(r)) and np.all(np.isfinite(J.data))):
            return None
        factors = kkt_factors(M, J)
        if factors is None:
            return None
        step = factors.solve(np.concatenate([M @ (x0 - x), -r]))[: len(x)]
        if not np.all(np.isfinite(step)):
            return None
        x = x + step
        # Each value is compared with its own size, since others may be far larger; the
        # iteration for a value that should be zero ends where steps no longer become
        # shorter.
        length = float(np.sqrt(step @ (M @ step)))
        if np.all(np.abs(step) <= CONVERGED * np.abs(x)) or length > SHORTER * last:
            distance = np.sqrt((x - x0) @ (M @ (x - x0)) / M.diagonal())
            errors = STATE_ROUNDOFF * (np.abs(x) + distance)
            is_off = diverges(relations, relations.sparse, x0, x, errors)
            return (
                NewtonResult(x, converged=True)
                if relations.are_satisfied(x, errors) and not is_off
                else None
            )
        last = length
    return None


def _random_starts(
    relations: Relations, x0: Floats, best: Floats | None, metric: Floats
) -> Iterator[Floats]:
    """Yield random starts (k,) of the search around x0, with a fixed seed.

    Their distance from x0 is about that of `best` (k,), the point found so far, if any.

    metric : (k, k), in which distances are measured.
    """
    random = np.random.default_rng(3)
    L = cholesky(metric)
    near = far = float(np.sqrt(_square(x0 if best is None else best - x0, metric)))
    if best is None:
        far = far or 1.0
        near = _curved(relations, x0, L) or far
    for k in range(OTHER_STARTS):
        kick = np.linalg.solve(L.T, random.standard_normal(len(x0)))
        size = near if k < OTHER_STARTS // 2 else far
        yield x0 + size * 10.0 ** ((k % 3) - 1) * kick


def _curved(relations: Relations, x0: Floats, L: Floats) -> float:
    """Return the distance from x0 within which second-order expansions of r hold.

    The distance is 0 if it is unknown.

    L : Cholesky factor (k, k) of the metric.
    """
    r = relations(x0)[0]
    found = 0.0
    for one, residual in zip(np.eye(len(r)), r, strict=True):
        H = np.nan_to_num(relations.curvature(x0, one), nan=np.inf)
        scaled = np.linalg.solve(L, np.linalg.solve(L, H).T)
        size = np.linalg.norm(scaled)
        if np.isfinite(residual) and np.isfinite(size) and size > 0.0:
            found = max(found, float(np.sqrt(2.0 * abs(residual) / size)))
    return found


@np.errstate(over="ignore", invalid="ignore")  # starts of any size
def reach(
    relations: Relations, start: Floats, metric: Floats, guess: Floats | None = None
) -> NewtonResult:
    """Solve the relations by damped Newton steps of least change.

    Parameters
    ----------
    relations : Relations
    start : ndarray, shape (k,)
        First iterate.
    metric : ndarray, shape (k, k)
    guess : ndarray, shape (k,), optional
        The original guess, if `start` is another start.
    """
    try:
        return _reached(relations, start, metric, start if guess is None else guess)
    except np.linalg.LinAlgError:  # a step led to values that overflow
        return NewtonResult(start.copy(), converged=False, trouble=Trouble.NOT_FINITE)


def _reached(
    relations: Relations, x0: Floats, metric: Floats, guess: Floats
) -> NewtonResult:
    x = x0.copy()
    L = cholesky(metric)
    r, J = relations(x)
    # Rounding of x: of the largest magnitude that each value has had, and of the total
    # length of the path.
    largest, ulp = np.abs(x), STATE_ROUNDOFF / np.sqrt(np.diag(metric))
    distance = 0.0
    halvings, last, before = 0, np.inf, np.inf
    jump, jumped, polished = -MOST_STEPS, False, 0
    for k in range(MOST_STEPS):
        if not np.any(r) or polished >= POLISHING:
            break
        if not (np.all(np.isfinite(J)) and np.all(np.isfinite(r))):
            return NewtonResult(x, converged=False, trouble=Trouble.NOT_FINITE)
        Y, lengths = rows_of_length_one(J, L)
        step = np.asarray(np.linalg.solve(L.T, least_squares(Y, -r / lengths)), float)
        length = float(np.sqrt(_square(step, metric)))
        part = length / (last or 1.0)
        steady = SLOW[0] < part < SLOW[1] and abs(part - before) < STEADY
        halvings = halvings + 1 if steady else 0
        last, before = length, part
        if halvings >= HALVINGS:  # add the sum of a geometric series in one step
            jump, step = k, step / (1.0 - part)
            halvings = 0
        hold = relations.are_satisfied(x, STATE_ROUNDOFF * largest + distance * ulp)
        jumped |= hold and not polished and k - jump <= ARRIVED
        polished += hold
        damped = _damped(relations, x, r, lengths, step, once=hold)
        if damped is None:
            break  # no decrease: rounding, or a minimum of |r|
        x, r, J = damped
        largest = np.maximum(largest, np.abs(x))
        distance = max(distance, float(np.linalg.norm(L.T @ (x - x0))))
    errors = STATE_ROUNDOFF * largest + distance * ulp
    hold = not np.any(r) or relations.are_satisfied(x, errors)
    if hold and diverges(relations, relations, guess, x, errors):
        return NewtonResult(x, converged=False, trouble=Trouble.DIVERGES)
    # Far from a simple root steps can shrink by this ratio, too; then the last steps do
    # not.
    jumped |= not polished and k - jump <= ARRIVED
    trouble = Trouble.DOUBLE_ROOT if jumped and hold else Trouble.NONE
    return NewtonResult(x, converged=hold, trouble=trouble)


def _damped(
    relations: Relations,
    x: Floats,
    r: Floats,
    weights: Floats,
    step: Floats,
    *,
    once: bool,
) -> tuple[Floats, Floats, Floats] | None:
    """Return x, r, dr/dx after the largest part of a step that lowers |r|, or None.

    The parts 1, 1/2, 1/4, ... are tried; with `once`, 1 alone. None if no part lowers
    |r|.

    weights : lengths (m,) by which the residuals are divided.
    """
    before = np.linalg.norm(r / weights)
    damping = 1.0
    while damping > (0.6 if once else SMALLEST_DAMPING):
        trial = x + damping * step
        r_trial, J_trial = relations(trial)
        if np.linalg.norm(r_trial / weights) < before:
            return trial, r_trial, J_trial
        damping /= 2
    return None


def rows_of_length_one(J: Floats, L: Floats) -> tuple[Floats, Floats]:
    """Return the rows of J L^-T scaled to length 1 (m, n), and the lengths before (m,).

    A row of zeros is unchanged, and its length is returned as 1.

    J : (m, n), the Jacobian.
    L : Cholesky factor of the metric.
    """
    Y, lengths = whitened_rows(J, L)
    lengths[lengths == 0] = 1.0
    return Y, lengths


def _explained(
    relations: Relations, reached: NewtonResult, metric: Floats
) -> NewtonResult:
    """Return the point of least |r|, with the reason why no root was found.

    If that point satisfies the relations, the result has `converged` True.

    reached : the result of the iteration that failed.
    metric : (k, k), the metric of the iteration.
    """
    if reached.trouble in (Trouble.NOT_FINITE, Trouble.DIVERGES):
        return reached
    from scipy.optimize import least_squares  # slow to load, and only failures need it

    L = cholesky(metric)
    _, weights = rows_of_length_one(np.nan_to_num(relations(reached.x)[1]), L)

    # In z = L^T x, so that units do not matter.
    def back(z: Floats) -> Floats:
        return np.asarray(np.linalg.solve(L.T, z), dtype=float)

    def residual(z: Floats) -> Floats:
        r = relations(back(z))[0] / weights
        return np.nan_to_num(r, nan=1e100, posinf=1e100, neginf=-1e100)

    def slopes(z: Floats) -> Floats:
        J = np.nan_to_num(relations(back(z))[1])
        return np.asarray(np.linalg.solve(L, (J / weights[:, None]).T).T)

    fit = least_squares(
        residual, L.T @ reached.x, jac=slopes, xtol=1e-15, ftol=1e-15, gtol=1e-15
    )
    z: Floats = np.asarray(fit.x, dtype=float)
    x = back(z)
    displacement = float(np.linalg.norm(z - L.T @ reached.x)) / np.sqrt(np.diag(metric))
    if relations.are_satisfied(x, STATE_ROUNDOFF * (np.abs(x) + displacement)):
        return NewtonResult(x, converged=True)
    return NewtonResult(x, converged=False, trouble=Trouble.MINIMUM)


class _Slope:
    """|x - x0|^2 / 2 along the relations: its gradient and a descent step.

    Parameters
    ----------
    relations : Relations
    x0, x : ndarray, shape (k,)
        The centre of the distance, and a point that satisfies the relations.
    metric : ndarray, shape (k, k)
    """

    def __init__(
        self, relations: Relations, x0: Floats, x: Floats, metric: Floats
    ) -> None:
        self.relations, self.x0, self.x, self.metric = relations, x0, x, metric
        J, L = relations(x)[1], cholesky(metric)
        Y, lengths = rows_of_length_one(J, L)
        gap = L.T @ (x - x0)
        self.multipliers = least_squares(Y.T, gap) / lengths
        self.kernel = np.linalg.solve(L.T, null_space(Y))
        self.gradient = self.kernel.T @ (metric @ (x - x0))
        self.change = float(np.linalg.norm(gap))
        self.steepness = float(np.linalg.norm(self.gradient))

    def step(self) -> Floats:
        """Return the change of x along the relations towards less |x - x0|, shape (k,).

        It is Newton's step, with absolute curvatures; at a maximum or saddle, a short
        step down from it.
        """
        # The Hessian of the Lagrange function.
        H = self.metric - self.relations.curvature(self.x, self.multipliers)
        H = H if np.all(np.isfinite(H)) else self.metric
        curvatures, directions = np.linalg.eigh(self.kernel.T @ H @ self.kernel)
        along = directions.T @ self.gradient
        if (
            self.steepness <= CONVERGED * self.change
            and curvatures[0] < -HALF_OF_DIGITS
        ):
            # A ridge, not a valley: leave it on a reproducible side.
            return np.asarray(0.1 * self.change * (self.kernel @ directions[:, 0]))
        down = -along / np.maximum(np.abs(curvatures), 1e-3)
        return np.asarray(self.kernel @ (directions @ down))

    def lower(self) -> _Slope | None:
        """Return the `_Slope` at a point that is nearer to x0, or None.

        The point satisfies the relations. It is reached by the largest part (1, 1/2,
        ...) of `step` that comes nearer.
        """
        if not self.kernel.shape[1] or self.change == 0:
            return None  # isolated: there is only one point
        step, damping = self.step(), 1.0
        while np.any(step) and damping > SMALLEST_DAMPING:
            trial = reach(self.relations, self.x + damping * step, self.metric)
            if trial.converged:
                there = _Slope(self.relations, self.x0, trial.x, self.metric)
                if there.change < (1 - 1e-10) * self.change:
                    return there
                # Near the minimum the function is level within rounding; its gradient
                # still decides.
                level = there.change <= (1 + 1e-10) * self.change
                if level and there.steepness < 0.5 * self.steepness:
                    return there
                if (
                    level
                    and damping == 1.0
                    and self.steepness < HALF_OF_DIGITS * self.change
                ):
                    return None
            damping /= 2
        return None


def descend(relations: Relations, x0: Floats, x: Floats, metric: Floats) -> Floats:
    """Return the solution nearest to x0, by descent along the relations from x (k,).

    metric : (k, k), in which the distance is measured.
    """
    try:
        here = _Slope(relations, x0, x, metric)
        for _ in range(MOST_STEPS):
            there = here.lower()
            if there is None:
                break
            here = there
    except np.linalg.LinAlgError:
        return x
    return here.x


def _square(x: Floats, metric: Floats) -> float:
    return float(x @ metric @ x)


def with_zeros(relations: Relations, x: Floats) -> Floats:
    """Return the root x (k,) with 0 for components that are rounding errors.

    A component whose exact value is 0 ends as the rounding error of the last step of
    the iteration, such as 1e-64, which is no scale for later computations. It is
    replaced by 0 if no residual becomes larger.
    """
    tiny = (x != 0.0) & (np.abs(x) <= STATE_ROUNDOFF * np.abs(x - relations.x0))
    if not np.any(tiny):
        return x
    zeros = np.where(tiny, 0.0, x)
    r, exact = relations.sparse(x)[0], relations.sparse(zeros)[0]
    return zeros if np.all(np.abs(exact) <= np.abs(r)) else x


def unwound(relations: Relations, x: Floats) -> Floats:
    """Return the root x (k,), shifted by periods to the place nearest to the guess.

    A component has a period if the addition of that period changes no relation, at the
    root and beside it: a full turn of an angle, or half a turn, as of tan.
    """
    near = relations.x0
    for period in (TURN, TURN / 2.0):
        turns = np.rint((x - near) / period)
        turns[relations.angles :] = 0.0
        for k in np.flatnonzero(turns):
            turn = np.zeros(len(x))
            turn[k] = period
            for at in (x, near + 0.1 * (x - near)):
                (r, J), (turned, slopes) = relations(at), relations(at + turn)
                size = COMPUTED_ZERO * (np.abs(r) + TURN * np.linalg.norm(J, axis=1))
                same = np.all(np.abs(turned - r) <= size)
                if not (same and np.all(np.abs(slopes - J) <= size[:, None])):
                    turns[k] = 0.0
        x = np.asarray(x - period * turns)
    return x
