"""Equations of a state at rest, and their solution near a guess.

Unknowns are the positions and first-order states that are guesses, and the multipliers
of all active rows. The equations are f + A^T lambda = 0, with the generalized forces f
and the constraint rows A, and the relations between positions, at q' = 0 and the time
of the start. Newton's method starts from the guess and is accepted if each step is
clearly shorter than the one before: a rest this near may be unstable. Otherwise the
energy, if there is one, is minimised, and damped steps of least change follow.
"""

from __future__ import annotations

import math
from enum import Enum
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from lagsim.admissibility.newton import (
    MOST_STEPS,
    SMALLEST_DAMPING,
    NewtonResult,
    Relations,
    descend,
    nearest_solution,
    reach,
    rows_of_length_one,
    unwound,
)
from lagsim.admissibility.point import Condition, Lengths, implied_conditions
from lagsim.language.derivatives import gradient, slopes
from lagsim.language.names import rate_of
from lagsim.mechanics.algebra import (
    cholesky,
    least_squares,
    null_space,
    rank_metric,
)
from lagsim.mechanics.constraints import scale_of
from lagsim.tolerances import COMPUTED_ZERO, SAME_RESULT, STATE_ROUNDOFF, TINY

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from lagsim.admissibility.point import Point
    from lagsim.language.arrays import Flags, Floats
    from lagsim.mechanics.constraints import Row

# Newton's method is accepted if slopes change by at most this part along each step, and
# the next step is at most this part of it.
CONTRACTION = 0.5
# Weight of changes of multipliers, relative to the displacement by their forces.
LIGHT = 1e-2
# Least decrease of the merit function, relative to its linear prediction.
FAITHFUL = 0.25
# Least curvature of the energy, relative to the greatest.
FLAT = 1e-6
# Longest step relative to the lengths of the relations.
FAR = 1e3


class Rest(Relations):
    """Residuals of the equations of rest, as functions of guesses and multipliers.

    Parameters
    ----------
    point : Point
        The guess, with velocities of zero.
    stated : sequence of Condition
        Equations for positions, beside the rows that always hold.
    active : sequence of Row
        The rows of the active laws, which hold beside the equalities.
    free : tuple of sequence of int
        Indices of the positions, and of the first-order states, that are guesses.
    pinned : mapping of str to int, optional
        The surfaces on which the state is held. Key: name of the variable, an unknown,
        of the share of the upper side. Value: the node that is zero on the surface.
    """

    def __init__(
        self,
        point: Point,
        stated: Sequence[Condition],
        active: Sequence[Row],
        free: tuple[Sequence[int], Sequence[int]],
        pinned: Mapping[str, int] | None = None,
    ) -> None:
        e, g, pinned = point.e, point.g, pinned or {}
        point.multipliers = {**dict.fromkeys(pinned, 0.5), **point.multipliers}
        self.rows, self.positions, self.states = [*e.rows, *active], *map(list, free)
        self.shares = [*pinned]
        q = [e.q[j] for j in self.positions]
        lam = [f"lambda/{k}" for k in range(len(self.rows))]
        names = [*q, *(e.states[j].name for j in self.states), *pinned, *lam]
        place = {g.variable(name): k for k, name in enumerate(names)}
        forces = [[f] for f in e.f]
        for row, name in zip(self.rows, lam, strict=True):
            for j, entry in row.force(g).items():
                forces[j].append(g.call("mul", entry, g.variable(name)))
        sums = map(g.sum, forces)
        nodes = [*zip(e.accelerations, sums, strict=True)]
        nodes += [(rate_of(e.states[j].name), e.states[j].rate) for j in self.states]
        own = {j: k for k, j in enumerate(self.positions)}
        self.stated = [*implied_conditions(self.rows, velocities=False), *stated]
        conditions = [
            x._replace(A={own[j]: s for j, s in x.A.items() if j in own})
            for x in self.stated
        ]
        self.relations = len(conditions) + len(pinned)
        for name, node in (*pinned.items(), *nodes):
            found = slopes(g, node, frozenset(place))
            A = {place[x]: slope for x, slope in found.items()}
            conditions.append(Condition(name, node, A, scale_of(g, node, (), {})))
        self.names = names
        self._set_conditions(
            point, conditions, {k: k for k in place.values()}, velocities=False
        )
        self._x0 = self.first(point)

    def first(self, point: Point) -> Floats:
        """Return the first iterate (k,): the guesses, and multipliers.

        The multipliers minimise the accelerations.
        """
        A, lam = point.forces_of(self.rows), np.zeros(len(self.rows))
        if len(A):
            sizes = self.point.sizes
            lam = least_squares(A.T / sizes[:, None], -point.array(point.e.f) / sizes)
        shares = [point.values[name] for name in self.shares]
        return np.concatenate([
            point.q[self.positions], point.state.s[self.states], shares, lam
        ])  # fmt: skip

    @property
    def angles(self) -> int:
        """Number of unknowns, from the first on, that can be angles."""
        return len(self.positions)

    @property
    def x0(self) -> Floats:
        """Guesses and multipliers at the point, shape (k,)."""
        return self._x0

    def at(self, x: Floats, errors: Floats | None = None) -> Point:
        """Return the point with values x (k,), optionally with error bounds (k,)."""
        q, s = self.point.q.copy(), self.point.state.s.copy()
        k, own = len(self.positions), None
        n = k + len(self.states)
        q[self.positions], s[self.states] = x[:k], x[k:n]
        if errors is not None:
            named = zip(self.names, errors.tolist(), strict=True)
            own = {**self.point.errors, **dict(named)}
        point = self.point.at(q, errors=own, s=s)
        point.multipliers = dict(zip(self.names[n:], x[n:].tolist(), strict=True))
        return point

    def violated(self, x: Floats, errors: Floats) -> Flags:
        """Return a mask (m,) of the residuals that exceed their rounding errors.

        The bound of a residual includes the rounding of all multipliers, and of the
        distance of x from the guess.

        errors : error bounds (k,) of x.
        """
        guesses = len(self.positions) + len(self.states)
        weights = np.sqrt(np.diag(self.metric))
        far = weights * np.concatenate([x[:guesses] - self.x0[:guesses], x[guesses:]])
        parts = [np.full(len(y), np.linalg.norm(y)) for y in np.split(far, [guesses])]
        own = STATE_ROUNDOFF * np.concatenate(parts) / weights
        return super().violated(x, errors + own)

    @cached_property
    def metric(self) -> Floats:
        """Metric (k, k) in which changes of the unknowns are measured.

        The metric of positions is the mass matrix M. The metric of any other unknown is
        diagonal: the square of the displacement that a unit of this unknown causes,
        estimated from the stiffness at the start.
        """
        point, k = self.point, len(self.positions)
        M = point.mass_entries(self.positions).dense(k, k)
        J = np.nan_to_num(np.abs(self(self.x0)[1]))[self.relations :][: point.n]
        J /= point.sizes[:, None]
        stiffness = J[:, :k] / point.sizes[self.positions]
        time = 1.0 / (np.max(stiffness, initial=0.0) or 1.0)
        others = LIGHT * time * np.linalg.norm(J[:, k:], axis=0)
        others[others == 0.0] = 1.0
        found = np.diag(np.concatenate([np.zeros(k), others**2]))
        if k:
            A = point.jacobian(self.rows)[:, self.positions]
            found[:k, :k] = rank_metric(M, A)
        return found

    def errors(self, x: Floats) -> dict[str, float]:
        """Return error bounds of the solved guesses, by name, at x (k,)."""
        point = self.at(x)
        found = point.solved_errors((self.point.q, self.point.v))
        return {**self.point.errors, **{n: found[n] for n in self.names if n in found}}

    def pulls(self, x: Floats) -> Floats:
        """Return the tension of each row (rows,), scaled; 0 for a row that pushes.

        Contacts cannot pull: a row with a tension has to be released.
        """
        own = np.linalg.norm(self.at(x).jacobian(self.rows) / self.point.sizes, axis=1)
        pushes = x[len(x) - len(self.rows) :] * own
        small = COMPUTED_ZERO * np.max(np.abs(pushes), initial=0.0)
        return np.where(pushes < -small, -pushes, 0.0)

    def undetermined(self, x: Floats) -> list[str]:
        """Return the guesses on which no residual depends at x0 and at x (k,)."""
        flat = np.all([
            np.all(np.nan_to_num(self(at)[1]) == 0.0, axis=0) for at in (self.x0, x)
        ], axis=0)  # fmt: skip
        guesses = len(self.positions) + len(self.states)
        return [self.names[k] for k in np.flatnonzero(flat[:guesses])]


def _contracted(rest: Rest, metric: Floats) -> Floats | None:
    """Return the limit (k,) of Newton's method; None if it does not contract.

    The method contracts if, along each step, the slopes change by no more than half of
    their size, and the next step is no longer than half (L. V. Kantorovich's
    conditions, checked at the points where the residuals are evaluated).

    metric : (k, k), in which steps are measured.
    """
    x, L = rest.x0, cholesky(metric)
    r, J = rest(x)
    last = math.inf
    for _ in range(MOST_STEPS):
        if not (np.all(np.isfinite(r)) and np.all(np.isfinite(J))):
            return None
        if rest.are_satisfied(x, STATE_ROUNDOFF * np.abs(x)):
            return x
        Y, lengths = rows_of_length_one(J, L)
        z = least_squares(Y, -r / lengths)
        step, before = np.linalg.solve(L.T, z), J
        x = x + step
        r, J = rest(x)
        turned = least_squares(Y, np.nan_to_num((J - before) @ step) / lengths)
        length = float(np.linalg.norm(z))
        if not length <= last or np.linalg.norm(turned) > CONTRACTION * length:
            return None
        last = CONTRACTION * length
    return None


def _downhill(rest: Rest) -> Floats | None:
    """Return the x (k,) of a minimum of the energy below the guess, or None.

    None if the forces have no energy. Newton's method with absolute curvatures, along
    the relations and back onto them. A merit function, energy plus penalty for
    residuals of relations (Nocedal and Wright, chapter 18), determines the step length,
    along which gradients of relations must not turn by much.
    """
    point, k, m, x = rest.point, len(rest.positions), rest.relations, rest.x0
    e, g, weights, distance = point.e, point.g, np.zeros(rest.relations), 0.0
    if not k:
        return None
    sizes, own = point.sizes[rest.positions], [m + j for j in rest.positions]
    f = [e.f[j] for j in rest.positions]
    f += gradient(g, e.energy, [g.variable(e.q[j]) for j in rest.positions])

    lengths = (Lengths(point, rest.stated).spread * point.sizes)[rest.positions]
    farthest = FAR * np.max(lengths[np.isfinite(lengths)], initial=0.0) or math.inf
    for _ in range(MOST_STEPS):
        r, J = rest(x)
        forces, slope = rest.at(x).array(f).reshape(2, k)
        if not (np.all(np.isfinite(r)) and np.all(np.isfinite(J))):
            return None
        if np.any(np.abs(forces + slope) > SAME_RESULT * np.max(np.abs(forces))):
            return None  # the forces have no potential
        Y, lengths = rows_of_length_one(J[:m, :k] / sizes, np.eye(k))
        H, N = -J[own, :k] / sizes / sizes[:, None], null_space(Y)
        back = least_squares(Y, -r[:m] / lengths)
        w, U = np.linalg.eigh(N.T @ (H + H.T) @ N / 2.0)
        along = U.T @ (N.T @ (forces / sizes - H @ back))
        w = np.maximum(np.abs(w), FLAT * np.max(np.abs(w), initial=0.0))
        w = np.maximum(w, np.linalg.norm(along) / farthest)
        if not np.all(w):
            return None if np.any(along) else x  # a linear energy has no minimum
        down = N @ (U @ (along / w))
        step = np.pad((back + down) / sizes, (0, len(x) - k))
        if np.linalg.norm(sizes * step[:k]) <= SAME_RESULT * distance:
            return x
        held = np.abs(least_squares(Y.T, forces / sizes)) / lengths
        weights = np.maximum(weights, 2.0 * held)
        gain = float(forces @ step[:k] + weights @ np.abs(r[:m]))
        part = _part(rest, x, step, weights, gain)
        if not part:
            return x
        x = x + part * step
        distance = max(distance, float(np.linalg.norm(sizes * (x - rest.x0)[:k])))
        x = np.concatenate([x[:k], rest.first(rest.at(x))[k:]])
    return x


def _part(rest: Rest, x: Floats, step: Floats, weights: Floats, gain: float) -> float:
    """Return the largest tried fraction of a step that lowers the merit enough.

    The fraction is 0 if no tried fraction does.

    Parameters
    ----------
    rest : Rest
        The equations of the balance.
    x, step : ndarray, shape (k,)
        The iterate, and the step from it.
    weights : ndarray, shape (relations,)
        Penalties of the residuals of relations in the merit function.
    gain : float
        Decrease of the merit function predicted by the slopes at x.
    """
    m, part, (r, J) = rest.relations, 1.0, rest.evaluated(x)
    lengths = np.linalg.norm(J[:m] / np.sqrt(np.diag(rest.metric)), axis=1)
    lengths = np.maximum(lengths, TINY)[:, None]

    def height(x: Floats, r: Floats) -> float:
        return float(rest.at(x).array([rest.point.e.energy])[0] + weights @ np.abs(r))

    before = height(x, r[:m])
    while part > SMALLEST_DAMPING:
        other, slopes_there = rest.evaluated(x + part * step)
        turned = (slopes_there - J)[:m] * step / lengths
        whole = np.where(turned, J[:m] * step / lengths, 0.0)
        straight = np.linalg.norm(turned) <= CONTRACTION * np.linalg.norm(whole)
        gained = before - height(x + part * step, other[:m])
        if straight and gained > FAITHFUL * gain * part * (2.0 - part):
            return part
        part /= 2.0
    return 0.0


class Way(Enum):
    """Algorithm of the search for a rest from a guess.

    - NEAR: Newton's method if it contracts, otherwise descent of the energy.
    - CONTRACTED: Newton's method if it contracts, otherwise no result.
    - FAR: as NEAR, then from other starts around the guess.
    - DOWN: descent of the energy (`_downhill`).
    - ROOT: damped Newton steps, which may end at a saddle of the energy.
    - CORNER: from surface to surface, to a kink of the forces or of equalities.
    """

    NEAR, CONTRACTED, FAR, DOWN, ROOT, CORNER = range(6)


def solved(rest: Rest, way: Way = Way.NEAR) -> NewtonResult:
    """Solve for a rest near the guess by one of the ways; see `Way`.

    The result has `converged` False if that way finds no rest.
    """
    x0 = rest.x0
    if rest.exact(x0) or not len(x0):
        return NewtonResult(x0, converged=rest.exact(x0))
    metric = rest.metric
    if way is Way.FAR:
        return nearest_solution(rest, metric)
    if way is Way.ROOT:
        reached = reach(rest, x0, metric)
        return reached._replace(x=unwound(rest, reached.x))
    x = None if way is Way.DOWN else _contracted(rest, metric)
    if x is None and way is Way.CONTRACTED:
        return NewtonResult(x0, converged=False)
    x = _downhill(rest) if x is None else x
    reached = reach(rest, x0 if x is None else x, metric, x0)
    if reached.converged:
        x = descend(rest, x0, unwound(rest, reached.x), metric)
        return NewtonResult(x, converged=True)
    return NewtonResult(x0, converged=False)
