"""Starts at rest: guesses for which velocities and accelerations vanish.

Unknowns are the positions and first-order states that are guesses, and the multipliers
of all active rows. The equations are f + A^T lambda = 0 and the relations between
positions, at q' = 0 and the time of the start. Newton's method starts from the guess
and is accepted if each step is clearly shorter than the one before: a rest this near
may be unstable. Otherwise the energy, if there is one, is minimised, and damped steps
of least change follow.

Contacts that are closed at the guess are active, with their friction. A contact that is
penetrated is added, one whose force pulls is removed, and friction beyond its limit is
removed. If no rest is found, the next contact is tried, finally each beside the earlier
ones. The laws of the contacts decide elsewhere whether they hold.

A rest in a corner, where forces step or rows of equalities turn, is found by a walk: on
one side of each surface Newton's method, or where this fails the acceleration, leads to
the first surface, on which the state is then held with the share of the upper side as
an unknown. A share outside of [0, 1] releases the state to the side beyond; see
`kinks`.
"""

from __future__ import annotations

import math
from enum import Enum
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lagsim.admissibility.kinks import ROUNDED, Kinks, Pin, Step, drift
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
from lagsim.admissibility.verdict import (
    acting,
    judge_laws,
    judge_rest,
    one_sided,
    verdicts_on,
)
from lagsim.language.derivatives import gradient, slopes
from lagsim.language.names import rate_of
from lagsim.mechanics.algebra import (
    cholesky,
    least_squares,
    null_space,
    rank_metric,
)
from lagsim.mechanics.constraints import Kind, scale_of
from lagsim.tolerances import COMPUTED_ZERO, SAME_RESULT, STATE_ROUNDOFF, TINY

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence

    from lagsim.admissibility.point import Point
    from lagsim.language.arrays import Flags, Floats
    from lagsim.mechanics.constraints import Law, Row
    from lagsim.mechanics.equations import Equations

# Newton's method is accepted if slopes change by at most this part along each step, and
# the next step is at most this part of it.
CONTRACTION = 0.5
# Weight of changes of multipliers, relative to the displacement by their forces.
LIGHT = 1e-2
# Least decrease of the merit function, relative to its linear prediction.
FAITHFUL = 0.25
# Least curvature of the energy, relative to the greatest.
FLAT = 1e-6
# Number of combinations that are tried for each contact.
TRIES = 4
# Longest step relative to the lengths of the relations.
FAR = 1e3
# Most surfaces that a walk to a corner meets or leaves.
MOST_MET = 200


class Rest(Relations):
    """Residuals of a state at rest, as functions of guesses and multipliers.

    Parameters
    ----------
    point : Point
        With velocities of zero.
    stated : sequence of Condition
        Further equations for positions.
    held : sequence of Row
        The rows of the active laws.
    free : tuple of sequence of int
        Indices of the positions, and of the states, that are guesses.
    pinned : mapping of str to int
        Unknown shares of the upper sides of surfaces, by name, and the node that is
        zero on the surface.
    """

    def __init__(
        self,
        point: Point,
        stated: Sequence[Condition],
        held: Sequence[Row],
        free: tuple[Sequence[int], Sequence[int]],
        pinned: Mapping[str, int] | None = None,
    ) -> None:
        e, g, pinned = point.e, point.g, pinned or {}
        point.multipliers = {**dict.fromkeys(pinned, 0.5), **point.multipliers}
        self.rows, self.positions, self.states = [*e.rows, *held], *map(list, free)
        self.shares = [*pinned]
        q = [e.q[j] for j in self.positions]
        lam = [f"lambda/{k}" for k in range(len(self.rows))]
        names = [*q, *(e.states[j].name for j in self.states), *pinned, *lam]
        place = {g.variable(name): k for k, name in enumerate(names)}
        forces = [[f] for f in e.f]
        for row, name in zip(self.rows, lam, strict=True):
            for j, entry in row.A.entries.items():
                forces[j].append(g.call("mul", entry, g.variable(name)))
        sums = map(g.sum, forces)
        nodes = [*zip(e.accelerations, sums, strict=True)]
        nodes += [(rate_of(e.states[j].name), e.states[j].rate) for j in self.states]
        own = {j: k for k, j in enumerate(self.positions)}
        self.stated = [*implied_conditions(self.rows, velocities=False), *stated]
        wanted = [
            x._replace(A={own[j]: s for j, s in x.A.items() if j in own})
            for x in self.stated
        ]
        self.relations = len(wanted) + len(pinned)
        for name, node in (*pinned.items(), *nodes):
            found = slopes(g, node, frozenset(place))
            A = {place[x]: slope for x, slope in found.items()}
            wanted.append(Condition(name, node, A, scale_of(g, node, (), {})))
        self.names = names
        self._ask(point, wanted, {k: k for k in place.values()}, velocities=False)
        self._x0 = self.first(point)

    def first(self, point: Point) -> Floats:
        """Return the first iterate (k,): the guesses, and multipliers.

        The multipliers minimise the accelerations.
        """
        A, lam = point.jacobian(self.rows), np.zeros(len(self.rows))
        if len(A):
            sizes = self.point.sizes
            lam = least_squares(A.T / sizes[:, None], -point.array(point.e.f) / sizes)
        shares = [point.values[name] for name in self.shares]
        return np.concatenate([
            point.q[self.positions], point.state.s[self.states], shares, lam
        ])  # fmt: skip

    @property
    def angles(self) -> int:
        """Number of values, from the first on, that may be angles."""
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
        """Mark the residuals beyond rounding (m,).

        Each residual includes the rounding of all multipliers, and of the distance from
        the guess.
        """
        guesses = len(self.positions) + len(self.states)
        weights = np.sqrt(np.diag(self.metric))
        far = weights * np.concatenate([x[:guesses] - self.x0[:guesses], x[guesses:]])
        parts = [np.full(len(y), np.linalg.norm(y)) for y in np.split(far, [guesses])]
        own = STATE_ROUNDOFF * np.concatenate(parts) / weights
        return super().violated(x, errors + own)

    @cached_property
    def metric(self) -> Floats:
        """Metric of changes (k, k): M for positions, displacement for the others.

        The displacement by a force is estimated from the stiffness at the start.
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
        """Return error bounds of the guesses that were solved for, by name."""
        point = self.at(x)
        found = point.solved_errors((self.point.q, self.point.v))
        return {**self.point.errors, **{n: found[n] for n in self.names if n in found}}

    def pulls(self, x: Floats) -> Floats:
        """Return the scaled force of each row that pulls (rows,), 0 where it pushes."""
        own = np.linalg.norm(self.at(x).jacobian(self.rows) / self.point.sizes, axis=1)
        pushes = x[len(x) - len(self.rows) :] * own
        small = COMPUTED_ZERO * np.max(np.abs(pushes), initial=0.0)
        return np.where(pushes < -small, -pushes, 0.0)

    def undetermined(self, x: Floats) -> list[str]:
        """Return the guesses on which no residual depends, at x0 and at x."""
        flat = np.all([
            np.all(np.nan_to_num(self(at)[1]) == 0.0, axis=0) for at in (self.x0, x)
        ], axis=0)  # fmt: skip
        guesses = len(self.positions) + len(self.states)
        return [self.names[k] for k in np.flatnonzero(flat[:guesses])]


def _contracted(rest: Rest, metric: Floats) -> Floats | None:
    """Return the limit of Newton's method if it contracts from the start, else None.

    Along each step the slopes change by no more than half of their size, and the next
    step is no longer than half (L. V. Kantorovich's conditions, checked where
    evaluated).
    """
    x, L = rest.x0, cholesky(metric)
    r, J = rest(x)
    last = math.inf
    for _ in range(MOST_STEPS):
        if not (np.all(np.isfinite(r)) and np.all(np.isfinite(J))):
            return None
        if rest.hold(x, STATE_ROUNDOFF * np.abs(x)):
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
    """Return a minimum of the energy below the guess; None if forces have no energy.

    Newton's method with absolute curvatures, along the relations and back onto them. A
    merit function, energy plus penalty for residuals of relations (Nocedal and Wright,
    chapter 18), determines the step length, along which gradients of relations must not
    turn by much.
    """
    point, k, m, x = rest.point, len(rest.positions), rest.relations, rest.x0
    e, g, weights, moved = point.e, point.g, np.zeros(rest.relations), 0.0
    if not k:
        return None
    sizes, own = point.sizes[rest.positions], [m + j for j in rest.positions]
    f = [e.f[j] for j in rest.positions]
    f += gradient(g, e.energy, [g.variable(e.q[j]) for j in rest.positions])

    lengths = (Lengths(point, rest.stated).spread * point.sizes)[rest.positions]
    farthest = FAR * np.max(lengths[np.isfinite(lengths)], initial=0.0) or math.inf
    for _ in range(MOST_STEPS):
        r, J = rest(x)
        push, slope = rest.at(x).array(f).reshape(2, k)
        if not (np.all(np.isfinite(r)) and np.all(np.isfinite(J))):
            return None
        if np.any(np.abs(push + slope) > SAME_RESULT * np.max(np.abs(push))):
            return None  # forces that are no slopes of an energy
        Y, lengths = rows_of_length_one(J[:m, :k] / sizes, np.eye(k))
        H, N = -J[own, :k] / sizes / sizes[:, None], null_space(Y)
        back = least_squares(Y, -r[:m] / lengths)
        w, U = np.linalg.eigh(N.T @ (H + H.T) @ N / 2.0)
        along = U.T @ (N.T @ (push / sizes - H @ back))
        w = np.maximum(np.abs(w), FLAT * np.max(np.abs(w), initial=0.0))
        w = np.maximum(w, np.linalg.norm(along) / farthest)
        if not np.all(w):
            return None if np.any(along) else x  # a straight energy has no minimum
        down = N @ (U @ (along / w))
        step = np.pad((back + down) / sizes, (0, len(x) - k))
        if np.linalg.norm(sizes * step[:k]) <= SAME_RESULT * moved:
            return x
        held = np.abs(least_squares(Y.T, push / sizes)) / lengths
        weights = np.maximum(weights, 2.0 * held)
        gain = float(push @ step[:k] + weights @ np.abs(r[:m]))
        part = _part(rest, x, step, weights, gain)
        if not part:
            return x
        x = x + part * step
        moved = max(moved, float(np.linalg.norm(sizes * (x - rest.x0)[:k])))
        x = np.concatenate([x[:k], rest.first(rest.at(x))[k:]])
    return x


def _part(rest: Rest, x: Floats, step: Floats, weights: Floats, gain: float) -> float:
    """Return the fraction of a step for which the merit function falls enough; else 0.

    Parameters
    ----------
    rest : Rest
    x, step : ndarray, shape (k,)
    weights : ndarray, shape (relations,)
        Penalties.
    gain : float
        Decrease of the merit function predicted by the slopes at x.
    """
    m, part, (r, J) = rest.relations, 1.0, rest.looked_at(x)
    lengths = np.linalg.norm(J[:m] / np.sqrt(np.diag(rest.metric)), axis=1)
    lengths = np.maximum(lengths, TINY)[:, None]

    def height(x: Floats, r: Floats) -> float:
        return float(rest.at(x).array([rest.point.e.energy])[0] + weights @ np.abs(r))

    before = height(x, r[:m])
    while part > SMALLEST_DAMPING:
        other, slopes_there = rest.looked_at(x + part * step)
        turned = (slopes_there - J)[:m] * step / lengths
        whole = np.where(turned, J[:m] * step / lengths, 0.0)
        straight = np.linalg.norm(turned) <= CONTRACTION * np.linalg.norm(whole)
        gained = before - height(x + part * step, other[:m])
        if straight and gained > FAITHFUL * gain * part * (2.0 - part):
            return part
        part /= 2.0
    return 0.0


class Way(Enum):
    """Way from a guess to a rest.

    NEAR: Newton's method where it contracts, else downhill. CONTRACTED: Newton's method
    where it contracts, else none. FAR: other starts around the guess, too. DOWN:
    downhill. ROOT: damped steps, which may end at a saddle of the energy. CORNER: from
    surface to surface, to a corner of forces or of equalities.
    """

    NEAR, CONTRACTED, FAR, DOWN, ROOT, CORNER = range(6)


def _solved(rest: Rest, way: Way = Way.NEAR) -> NewtonResult:
    """Return a rest near the guess, found by one of the ways; see `Way`."""
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


class AtRest(NamedTuple):
    """State at rest.

    Attributes
    ----------
    point : Point
    touching : set of str
        The contacts that are active there.
    undetermined : list of str
        Guesses that keep their values, since no equation determines them.
    held : list of Row
        The rows of the active laws.
    multipliers : ndarray, shape (m + held,)
        Of the rows that always hold, then of `held`.
    corner : Corner or None
        The surfaces on which the state rests; the equations of `point` are then those
        of both sides, with shares as variables.
    on_ridge : bool
        Whether the state lies on a surface from which the forces of a side drive it
        away.
    """

    point: Point
    touching: set[str]
    undetermined: list[str]
    held: list[Row]
    multipliers: Floats
    corner: RestCorner | None = None
    on_ridge: bool = False


class RestCorner(NamedTuple):
    """Surfaces on which a state rests.

    Attributes
    ----------
    equations : Equations
        The equations of both sides, with the shares that balance there as numbers.
    rows : tuple of Row
        Equalities that hold the state on the surfaces.
    """

    equations: Equations
    rows: tuple[Row, ...]


class _Balance(NamedTuple):
    """Balance of forces: the equations, their solution x (k,), and the state.

    `corner` is set where surfaces hold the state; `on_ridge` where forces of a side
    drive it away from a surface.
    """

    rest: Rest
    x: Floats
    there: Point
    corner: RestCorner | None = None
    on_ridge: bool = False


def _balance(
    point: Point,
    stated: Sequence[Condition],
    held: Sequence[Row],
    free: tuple[Sequence[int], Sequence[int]],
    way: Way,
) -> _Balance | None:
    """Return a balance of forces with the rows `held` in force, or None.

    point, stated, held, free : see `Rest`.
    """
    if way is Way.CORNER:
        return _Walk(point, stated, held, free).found()
    rest = Rest(point, stated, held, free)
    end = _solved(rest, way)
    if not end.converged:
        return None
    there = rest.at(end.x).at(errors=rest.errors(end.x))
    there.multipliers = {}
    found = _Balance(rest, end.x, there)
    return _beside_kinks(found, stated, held, free, near=way is Way.NEAR)


def _beside_kinks(
    found: _Balance,
    stated: Sequence[Condition],
    held: Sequence[Row],
    free: tuple[Sequence[int], Sequence[int]],
    *,
    near: bool,
) -> _Balance:
    """Return the corner in which a balance lies, or one that is nearer.

    Parameters
    ----------
    found : _Balance
        Of the equations as written.
    stated, held, free
        See `Rest`.
    near : bool
        Whether a nearer corner between the guess and the balance is searched for.
    """
    rest, point = found.rest, found.rest.point
    walk = _Walk(found.there, stated, held, free)
    if walk.levels:
        own = walk.found()
        if own is not None and own.corner is not None:
            far = np.abs(own.there.q - found.there.q)
            errors = [own.there.errors.get(name, 0.0) for name in point.e.q]
            if np.all(far <= errors):
                return own
        if walk.on_ridge:
            found = found._replace(on_ridge=True)
    if not near or not walk.kinks.sides:
        return found
    before = _Walk(point, stated, held, free)
    if before.sides == walk.sides:
        return found
    other = before.found()
    if other is None or other.corner is None:
        return found
    size = np.diag(rest.metric)[: len(rest.positions)]
    far, close = (
        size @ (x.there.q - point.q)[rest.positions] ** 2 for x in (found, other)
    )
    return other if close < far else found


class _Walk:
    """Walk from a guess from surface to surface, to a rest in a corner.

    Parameters
    ----------
    point, stated, held, free
        See `Rest`.

    Attributes
    ----------
    sides : dict of int to float
        The side of each surface on which the walk is.
    levels : dict of int to float
        The levels of the surfaces on which the state is held.
    on_ridge : bool
        Whether the guess is a balance from which the forces of a side drive the state
        away.
    """

    def __init__(
        self,
        point: Point,
        stated: Sequence[Condition],
        held: Sequence[Row],
        free: tuple[Sequence[int], Sequence[int]],
    ) -> None:
        self.guess, self.here, self.stated, self.free = point, point, stated, free
        self.kinks, self.held = Kinks(point.e), held
        self.sides, self.levels = self.kinks.at(point)
        self.on_ridge, self.tried = False, set[object]()

    def found(self) -> _Balance | None:
        """Walk from surface to surface; return the balance at the end, or None."""
        for _ in range(MOST_MET if self.kinks.sides else 0):
            mode = _mode(self.levels, self.sides)
            if mode in self.tried:
                return None
            self.tried.add(mode)
            rest = self._rest()
            if self._meets(self._unbalanced(rest), beyond=True):
                continue
            end = _solved(rest)
            if end.converged:
                if self._meets([self._at(rest, end.x)], beyond=False):
                    continue
                found = self._decided(rest, end.x, first=len(self.tried) == 1)
                if found is not None:
                    return found
            elif not self._meets(self._driven(rest), beyond=True):
                if not self.levels:
                    return None
                self._cross([*self.levels][-1])
        return None

    def _decided(self, rest: Rest, x: Floats, *, first: bool) -> _Balance | None:
        """Return the balance x (k,) if forces hold it there; else leave a surface.

        first : whether no surface was met or left before.
        """
        own = self._shares(rest, x)
        off = [max(-w, w - 1.0) for w in own]
        if max(off, default=0.0) > ROUNDED and self._meet_in_a_point(rest, x):
            x = self._with_bounds(rest, x)
            own = self._shares(rest, x)
            off = [max(-w, w - 1.0) for w in own]
        shares: dict[int, float] = dict(zip(self.levels, own, strict=True))
        if max(off, default=0.0) > ROUNDED:
            worst = sorted(zip(off, shares, strict=True), reverse=True)
            out = [k for w, k in worst if w > ROUNDED]
            ends = {k: shares[k] > 1.0 for k in out}
            new = (k for k in out if self._without(k, above=ends[k]) not in self.tried)
            k = next(new, out[0])
            self._release(k, above=ends[k])
            self.here = self._at(rest, x)
            return None
        found = self._balance(rest, x, shares)
        actual, near = self.kinks.at(found.there)
        passed = [k for k in actual if k not in near and k not in self.levels]
        if any(actual[k] != self.sides[k] for k in passed):
            self.sides |= {k: actual[k] for k in passed}
            self.here = self._at(rest, x)
            return None
        steps = self.kinks.steps(found.there, self.sides, self._pins(), self.held)
        gone = [k for k, step in steps.items() if step is not Step.TOWARDS]
        if not gone:
            return found
        self.on_ridge |= first and Step.AWAY in steps.values()
        self._cross(gone[0])
        self.here = self._at(rest, x)
        return None

    def _pins(self, shares: Mapping[int, float] | None = None) -> dict[int, Pin]:
        """Return the pin of each surface that holds the state, by the surface's number.

        Shares are variables of the graph, or constants where values are given.
        """
        g, kinks = self.guess.g, self.kinks
        return {
            k: Pin(
                level,
                g.variable(kinks.share(k)) if shares is None else g.constant(shares[k]),
            )
            for k, level in self.levels.items()
        }

    def _rest(self) -> Rest:
        """Return the residuals on the present sides and surfaces, from `here`."""
        kinks, pins = self.kinks, self._pins()
        e = kinks.on(self.sides, pins)
        pinned = {
            kinks.share(k): kinks.distance(k, level, self.sides)
            for k, level in self.levels.items()
        }
        held = kinks.rows(self.held, self.sides, pins)
        return Rest(self.here.of(e), self.stated, held, self.free, pinned)

    def _at(self, rest: Rest, x: Floats) -> Point:
        """Return the equations as written, at the values x (k,)."""
        at = rest.at(x).state
        return self.guess.at(at.q, s=at.s)

    def _shares(self, rest: Rest, x: Floats) -> list[float]:
        first = len(rest.positions) + len(rest.states)
        return [float(w) for w in x[first : first + len(rest.shares)]]

    def _meet_in_a_point(self, rest: Rest, x: Floats) -> bool:
        """Whether gradients of the surfaces and relations are linearly dependent."""
        J = rest(x)[1][: rest.relations] / np.sqrt(np.diag(rest.metric))
        lengths = np.linalg.norm(J, axis=1)
        J /= np.where(lengths > 0.0, lengths, 1.0)[:, None]
        return bool(np.linalg.matrix_rank(J, tol=SAME_RESULT) < rest.relations)

    def _with_bounds(self, rest: Rest, x: Floats) -> Floats:
        """Return x (k,) with shares between 0 and 1 where these balance the forces.

        The shares of more surfaces than directions are not unique. Without a balance x
        is returned.
        """
        from scipy.optimize import least_squares as bounded  # slow to load

        first, m = len(rest.positions) + len(rest.states), rest.relations
        weights = np.ones(len(rest.targets))
        weights[m : m + self.here.n] = self.here.sizes
        size = np.sqrt(np.diag(rest.metric))[first:]
        n = len(rest.shares)
        size[:n] = 1.0

        def of(z: Floats) -> Floats:
            return np.concatenate([x[:first], z / size])

        low, high = np.full(len(size), -np.inf), np.full(len(size), np.inf)
        low[:n], high[:n] = 0.0, 1.0
        begun = x[first:] * size
        begun[:n] = 0.5
        fit = bounded(
            lambda z: (rest.looked_at(of(z))[0] / weights)[m:],
            begun,
            jac=lambda z: (rest.looked_at(of(z))[1] / weights[:, None])[m:, first:]
            / size,
            bounds=(low, high),
            xtol=1e-15, ftol=1e-15, gtol=1e-15,
        )  # fmt: skip
        found = of(np.asarray(fit.x, dtype=float))
        return found if rest.hold(found, STATE_ROUNDOFF * np.abs(found)) else x

    def _meets(self, ways: Iterable[Point], *, beyond: bool) -> bool:
        """Move the state to the first surface on one of the ways, and hold it there.

        Return whether a surface was met.

        Parameters
        ----------
        ways : iterable of Point
            The ends of straight ways from `here`, in the order in which they are tried.
        beyond : bool
            Whether the ways continue beyond their ends.
        """
        here = self.here
        for there in ways:
            met = self.kinks.first_crossing(
                (here, there), self.sides, self.levels, beyond=beyond
            )
            if met is None:
                continue
            self.levels[met.side] = met.level
            self.here = here.at(
                here.q + met.part * (there.q - here.q),
                s=here.state.s + met.part * (there.state.s - here.state.s),
            )
            return True
        return False

    def _unbalanced(self, rest: Rest) -> Iterator[Point]:
        """Yield the state displaced along the part of the forces that stays unbalanced.

        No displacement balances this part. Without such a part no state is yielded.
        """
        n, m = self.here.n, rest.relations
        r, J = rest(rest.x0)
        if not (np.all(np.isfinite(r)) and np.all(np.isfinite(J))):
            return
        weights = np.ones(len(r))
        weights[:m] = np.linalg.norm(J[:m], axis=1)
        weights[m : m + n] = self.here.sizes
        weights = 1.0 / np.where(weights > 0.0, weights, 1.0)
        r, J = weights * r, weights[:, None] * J
        columns = np.linalg.norm(J, axis=0)
        J /= np.where(columns > 0.0, columns, 1.0)
        left = r + J @ least_squares(J, -r)
        if np.linalg.norm(left[m:]) > SAME_RESULT * np.linalg.norm(r[m:]):
            left *= weights
            yield self._moved(rest, left[m : m + n], left[m + n :])

    def _driven(self, rest: Rest) -> Iterator[Point]:
        """Yield the state displaced along its acceleration on the present surfaces."""
        rows = [*rest.rows[len(self.here.e.rows) :]]
        rows += [self.kinks.row(k, x, self.sides) for k, x in self.levels.items()]
        a, rates = drift(rest.at(rest.x0), rows)
        yield self._moved(rest, a, rates[rest.states])

    def _moved(self, rest: Rest, a: Floats, rates: Floats) -> Point:
        """Return the state with q displaced by a (n,), first-order states by rates."""
        q, s = self.here.q.copy(), self.here.state.s.copy()
        q[rest.positions] += a[rest.positions]
        s[rest.states] += rates
        return self.here.at(q, s=s)

    def _without(self, k: int, *, above: bool) -> object:
        """Return the key (see `_mode`) of the walk once surface k has been left."""
        end = self.kinks.ends(k, self.levels[k])[above]
        levels = {i: x for i, x in self.levels.items() if i != k}
        return _mode(levels, {**self.sides, k: end})

    def _cross(self, k: int) -> None:
        """Let the state leave a surface to the side from which it did not come."""
        low, _ = self.kinks.ends(k, self.levels[k])
        self._release(k, above=self.sides[k] == low)

    def _release(self, k: int, *, above: bool) -> None:
        """Let the state leave a surface, to its upper or lower side."""
        self.sides[k] = self.kinks.ends(k, self.levels.pop(k))[above]

    def _balance(self, rest: Rest, x: Floats, shares: Mapping[int, float]) -> _Balance:
        """Return the record of a balance x (k,) with its state and its corner.

        Away from surfaces the equations of the state are those of the model.
        """
        there, corner = rest.at(x).of(self.guess.e), None
        there.multipliers = dict(zip(rest.shares, shares.values(), strict=True))
        if shares:
            kinks, sides = self.kinks, self.sides
            there = there.of(kinks.on(sides, self._pins()))
            rows = (kinks.row(k, level, sides) for k, level in self.levels.items())
            corner = RestCorner(kinks.on(sides, self._pins(shares)), tuple(rows))
        found = there.solved_errors((self.guess.q, self.guess.v))
        errors = {name: found[name] for name in rest.names if name in found}
        if corner is not None:
            # A zero within rounding is one: a run begins exactly in the corner.
            own = np.array([errors.get(name, 0.0) for name in rest.names])
            x = np.where(np.abs(x) <= own, 0.0, x)
            at = rest.at(x).state
            there = there.at(at.q, s=at.s)
        there = there.at(errors={**self.guess.errors, **errors})
        return _Balance(rest, x, there, corner)


def _mode(levels: Mapping[int, float], sides: Mapping[int, float]) -> object:
    """Return a hashable key of the levels that hold a state and of its other sides."""
    return frozenset(levels.items()), frozenset(sides.items())


def find_rest(
    point: Point,
    stated: Sequence[Condition],
    free: tuple[Sequence[int], Sequence[int]],
    off: Collection[str],
    ways: Sequence[Way] = (Way.NEAR, Way.CORNER, Way.FAR),
) -> AtRest | None:
    """Return a state at rest; None if there is none near the guess.

    Parameters
    ----------
    point : Point
        The guess, with velocities of zero.
    stated : sequence of Condition
        Equations for positions beside the rows.
    free : tuple of sequence of int
        Indices of the positions, and of the first-order states, that are guesses.
    off : collection of str
        Constraints that are out of force.
    ways : sequence of Way
        The ways that are tried, in order. If FAR is among the ways, NEAR is tried again
        at last, with each contact in turn in force.
    """
    laws = point.e.laws
    apart = [k for k in _by_gap(point) if laws[k].constraint not in off]
    active = _of(laws, {x.name for x in judge_laws(point, off) if x.active})
    # The force of a slider without mass is known; a row keeps it at its limit.
    begun = {k for k in active if not laws[k].slider}
    limits = one_sided(point, {law.constraint for law in laws if law.slider})
    rows = [limits.get(law.constraint, law.row) for law in laws]
    rounds = [(way, False) for way in ways]
    for way, wide in rounds + [(Way.NEAR, True)] * (Way.FAR in ways):
        held, bases, tried = begun, list[set[int]](), set[frozenset[int]]()
        while frozenset(held) not in tried and len(tried) <= TRIES * (1 + len(apart)):
            tried.add(frozenset(held))
            own = [rows[k] for k in sorted(held)]
            end = _balance(point, stated, own, free, way)
            if end is not None:
                rest, there = end.rest, end.there
                changes = _changes(rest, end.x, there, held, off)
                if not all(x.satisfied for x in verdicts_on(there)):
                    return None  # a relation that moves
                if not changes:
                    left = judge_rest(there, judge_laws(there, off)) if laws else ()
                    if not all(x.satisfied for x in left):
                        return None  # a wall that comes, or goes
                    sided = {k for k in held if laws[k].kind.one_sided}
                    touching = {laws[k].constraint for k in sided}
                    own = rest.rows[len(point.e.rows) :]
                    lam = end.x[len(end.x) - len(rest.rows) :]
                    loose = rest.undetermined(end.x)
                    return AtRest(there, touching, loose, own, lam, *end[3:])
            else:
                more = [laws[k].constraint for k in apart if k not in held]
                changes = _of(laws, more[:1])
                bases.append(held)
            held = held ^ changes
            if wide and frozenset(held) in tried:
                each = [_of(laws, {laws[k].constraint}) for k in apart]
                beside = (base | x for base in bases for x in each)
                held = next((x for x in beside if frozenset(x) not in tried), held)
    return None


def _changes(
    rest: Rest, x: Floats, there: Point, held: set[int], off: Collection[str]
) -> set[int]:
    """Return the indices of laws to be added to the laws in force, or removed.

    held : indices of the laws in force at the rest x. off : constraints out of force.
    """
    laws, verdicts = there.e.laws, judge_laws(there, off)
    if passed := _of(laws, {x.name for x in verdicts if not x.satisfied}):
        return passed - held
    pulls = dict(
        zip(sorted(held), rest.pulls(x)[len(rest.rows) - len(held) :], strict=True)
    )
    pulling = [k for k in held if laws[k].kind.one_sided and pulls[k] > 0.0]
    if pulling:
        most = max(pulling, key=lambda k: pulls[k])
        return _of(laws, {laws[most].constraint}) & held
    sliding = held - acting(there, verdicts).holding
    return {k for k in sliding if laws[k].kind.bounded}


def _of(laws: Sequence[Law], names: Collection[str]) -> set[int]:
    """Return the indices of the laws of the named constraints."""
    return {k for k, law in enumerate(laws) if law.constraint in names}


def _by_gap(point: Point) -> list[int]:
    """Return the indices of contacts, ordered by their scaled gaps."""
    contacts = [k for k, x in enumerate(point.e.laws) if x.kind is Kind.CONTACT]
    rows = [point.e.laws[k].row for k in contacts]
    lengths = np.linalg.norm(point.jacobian(rows) / point.sizes, axis=1)
    gaps = point.array([row.residual for row in rows]) / np.maximum(lengths, TINY)
    return [contacts[k] for k in np.argsort(gaps, kind="stable")]
