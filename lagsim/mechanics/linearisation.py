"""Linearisation of the equations of motion about a state: eigenvalues and modes.

Small changes satisfy the constraints, so the linearised motion has one coordinate per
free direction. The columns of Z span the velocities, and the columns of Zh the
positions, that the constraints admit (Zh = Z where all constraints are holonomic),
both orthonormal in the metric of M:

    dq = Zh a,      dq' = Z w + K a + H z,      K = -A^+ B Zh,      H = -A^+ C,

where B dq + A dq' + C z is the change of the rates of the constraints, and z the change
of the first-order states. Then a', w' and z' are linear in (a, w, z), without the
spurious eigenvalues of the index-1 form of the constraints. The columns rotate with the
constraints, without rotation relative to each other.

Source: E. Hairer, G. Wanner, Solving ODEs II (1996), VII.2: equations on manifolds in
local coordinates.
"""

from __future__ import annotations

import copy
import math
from collections import Counter
from itertools import accumulate
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lagsim.language.derivatives import gradient, slopes, tangent
from lagsim.language.evaluate import evaluate, evaluate_with_error
from lagsim.language.sparse import Budget, TooLongError, minimum_degree
from lagsim.mechanics.algebra import Metric
from lagsim.mechanics.equations import memoized_by_motion
from lagsim.mechanics.ldl import dense_operations
from lagsim.tolerances import (
    COMPUTED_ZERO,
    HALF_OF_DIGITS,
    RESIDUAL_ROUNDOFF,
    SOLUTION_ROUNDOFF,
    STATE_ROUNDOFF,
    TINY,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterator, Mapping, Sequence

    from lagsim.language.arrays import Complexes, Flags, Floats
    from lagsim.mechanics.equations import Equations
    from lagsim.mechanics.ldl import Elimination
    from lagsim.methods.parts.newton import SparseNewton


class Eigenmodes(NamedTuple):
    """Eigenvalues of a matrix, with right and left eigenvectors.

    Attributes
    ----------
    values : ndarray, shape (k,)
        The eigenvalues.
    right : ndarray, shape (size, k)
        The right eigenvectors, in the order of `values`.
    left : ndarray, shape (size, k)
        The eigenvectors of the transpose, in another order than `values`.
    """

    values: Complexes
    right: Complexes
    left: Complexes

    def amplitudes(self, rates: Floats) -> Complexes:
        """Return the amplitude (k,) of each mode in a vector of rates (size,)."""
        # Left and right vectors of equal eigenvalues need not come in pairs.
        sides = self.left.T @ self.right, self.left.T @ rates
        return np.asarray(np.linalg.lstsq(*sides, rcond=None)[0], dtype=complex)

    def parts(self, displacements: Complexes, masses: Floats, states: int) -> Floats:
        """Return the part of each coordinate and first-order state in each mode.

        The result has the shape (n + states, k), with entries of at most 1. Parts of
        coordinates are the amplitudes `displacements`, shape (n, k), times the roots of
        `masses`, shape (n,). Where the last `states` components of a mode participate
        by more than half, the parts of states are their participation factors, and the
        parts of coordinates are 0. Source: I. J. Perez-Arriaga, G. C. Verghese, F. C.
        Schweppe, IEEE Trans. Power Apparatus and Systems 101 (1982), 3117:
        participation factors.
        """
        shapes = np.abs(displacements) * np.sqrt(masses)[:, None]
        sides = self.left.T @ self.right, self.left.T
        dual = np.linalg.lstsq(*sides, rcond=None)[0].T
        shares = np.abs(self.right * dual)[len(self.right) - states :]
        by_states = shares.sum(axis=0) > 0.5
        found: Floats = np.vstack([shapes * ~by_states, shares * by_states])
        found /= np.maximum(np.max(found, axis=0, initial=0.0), TINY)
        return found

    def are_slowly_damped(self, part: float) -> Flags:
        """Return a mask (k,) of the modes that decay slowly beside their |eigenvalue|.

        part : the largest rate of decay, as a part of |eigenvalue|.
        """
        flags: Flags = -self.values.real < part * np.abs(self.values)
        return flags


def eigenmodes(matrix: Floats, selects: Callable[[Floats], Flags]) -> Eigenmodes:
    """Return the modes of `matrix` with the eigenvalues that `selects` marks.

    selects : |eigenvalues| (size,) -> flags (size,).
    """
    values, right = np.linalg.eig(matrix)
    others, left = np.linalg.eig(matrix.T)
    chosen = selects(np.abs(values))
    return Eigenmodes(
        values[chosen], right[:, chosen], left[:, selects(np.abs(others))]
    )


class Linear(NamedTuple):
    """The linearised motion (a, w, z)' = R (a, w, z) about a state.

    Attributes
    ----------
    R : ndarray, shape (k + d + l, k + d + l)
        The matrix: k free directions of positions, d free directions of velocities,
        and l first-order states.
    Zh : ndarray, shape (n, k)
        Basis of the positions that the constraints admit: dq = Zh a.
    Z : ndarray, shape (n, d)
        Basis of the velocities that the constraints admit.
    lengths : ndarray, shape (n, n)
        L^T, where L L^T is the metric: |L^T dq| measures changes.
    first_order : ndarray, shape (l,)
        The rates of the first-order states.
    """

    R: Floats
    Zh: Floats
    Z: Floats
    lengths: Floats
    first_order: Floats

    def eigenvalues(self) -> Complexes:
        """Return the eigenvalues of R, by decreasing absolute value."""
        found = np.linalg.eigvals(self.R).astype(complex)
        return np.asarray(found[np.argsort(-np.abs(found), kind="stable")])


class Slopes(NamedTuple):
    """Equations and their derivatives at a state.

    Attributes
    ----------
    values : dict of str to float
        The values of all variables: parameters, t, state, q'' and lambda.
    M, A : ndarray, shape (n, n) and (m, n)
        The mass matrix, and the constraint rows.
    metric, position_metric : Metric
        Projections by all rows, and by the holonomic rows alone.
    slopes : ndarray, shape (n + m + l, 2 n + l)
        Derivatives of M q'' - f - A^T lambda, of A q'' - b and of s' with respect to
        (q, q', s).
    B, C : ndarray, shape (m, n) and (m, l)
        Derivatives of the rates of the rows with respect to q and s.
    turning : ndarray, shape (m, n)
        dA/dt along the motion.
    acceleration, rates : ndarray, shape (n,) and (l,)
        q'' and s'.
    """

    values: dict[str, float]
    M: Floats
    A: Floats
    metric: Metric
    position_metric: Metric
    slopes: Floats
    B: Floats
    C: Floats
    turning: Floats
    acceleration: Floats
    rates: Floats


class Linearisation:
    """Equations of motion and their derivatives, for linearisation at any state.

    The expression graph is evaluated in Python, without compilation, which suffices for
    some tens of states.

    Parameters
    ----------
    equations : Equations
        The equations of motion, with values of the parameters.
    frozen : function, optional
        Returns a list of nodes without switches for a list of nodes. By default nodes
        are unchanged: each switch has the branch that the state selects.

    Attributes
    ----------
    nodes : int
        The count of nodes that one linearisation evaluates.
    """

    def __init__(
        self,
        equations: Equations,
        frozen: Callable[[Sequence[int]], list[int]] = list,
    ) -> None:
        e, g = equations, equations.graph
        self.e, self.g = e, g
        self.n, self.m, self.first = len(e.q), len(e.rows), len(e.states)
        self._parameters = {p.name: p.value for p in e.model.parameters}
        positions = [g.variable(name) for name in e.q]
        first = [g.variable(x.name) for x in e.states]
        accelerations = [g.variable(name) for name in e.accelerations]
        A = [node for row in e.rows for node in row.A]
        A = frozen(A)
        forces = [row.force(g) for row in e.rows] if e.has_drags else []
        nodes = [x.get(j, g.zero) for x in forces for j in range(self.n)]
        self._drags = frozen(nodes) if nodes else []
        self._terms = [
            *frozen([node for row in e.M for node in row]), *A,
            *frozen([*e.f, *(row.b for row in e.rows), *(x.rate for x in e.states)]),
        ]  # fmt: skip
        rates, state = e.flow.rates, [g.variable(name) for name in e.state]
        flow = e.flow.forward | dict(zip(rates, accelerations, strict=True))
        residuals = frozen([*e.motion_residuals(), *(x.rate for x in e.states)])
        by = [*positions, *first]
        self._slopes = [
            *(s for r in residuals for s in gradient(g, r, state)),
            *(s for x in frozen([r.rate for r in e.rows]) for s in gradient(g, x, by)),
            *tangent(g, A, flow),
        ]
        self.nodes = len(g.cone(self._terms)) + len(g.cone(self._slopes))
        self.holonomic = np.array([row.holonomic for row in e.rows], dtype=bool)

    def bound(self, equations: Equations) -> Linearisation:
        """Return the linearisation of these equations with other values of parameters.

        equations : the equations with these values.
        """
        found = copy.copy(self)
        found.e = equations
        found._parameters = equations.model.parameter_values  # noqa: SLF001
        return found

    def on(self, sides: Mapping[str, float]) -> Linearisation:
        """Return the linearisation with values of mode variables, by name."""
        found = copy.copy(self)
        found._parameters = {**self._parameters, **sides}  # noqa: SLF001
        return found

    def at(self, t: float, q: Floats, v: Floats, s: Floats | tuple[()] = ()) -> Linear:
        """Linearise about a state.

        Parameters
        ----------
        t : float
            Time.
        q, v : ndarray, shape (n,)
            Coordinates and velocities.
        s : ndarray, shape (l,)
            First-order states.

        Raises
        ------
        ValueError
            If a term of the equations, or a derivative, is not finite at the state.
        """
        return self.linear(self.values(t, q, v, s))

    def linear(self, x: Slopes, noise: Floats | None = None) -> Linear:
        """Return the linearised motion in the directions that constraints admit.

        Parameters
        ----------
        x : Slopes
            The equations and their derivatives at the state, from `values`.
        noise : ndarray, shape (n + m + l, 2 n + l), optional
            Bounds of the errors of `x.slopes`: entries of R below these are set to 0.
        """
        n, m, Z, Zh = self.n, self.m, x.metric.free, x.position_metric.free
        K, dv, change = self.changes(x)
        turned = -x.metric.inverse @ (x.turning @ Z)
        G, f, b = x.metric.G, x.slopes[:n], x.slopes[n : n + m]
        f = -x.metric.with_drags(-f, -x.metric.inverse @ b)
        R = np.vstack([
            Zh.T @ G @ dv,
            turned.T @ G @ K - Z.T @ (f @ change),
            x.slopes[n + m :] @ change,
        ])  # fmt: skip
        if noise is not None:
            R = self._cleaned(R, x, noise, (Zh.T @ G, Z), (dv, change))
        return Linear(R, Zh, Z, np.asarray(x.metric.L.T), x.rates)

    def changes(self, x: Slopes) -> tuple[Floats, Floats, Floats]:
        """Return the changes of velocities and of the state per unit of (a, w, z).

        The results are (K, 0, H), see the module docstring, and the change of q', both
        of shape (n, k + d + l); and the change of (q, q', s), of shape
        (2 n + l, k + d + l).
        """
        Z, Zh, first = x.metric.free, x.position_metric.free, self.first
        still = np.zeros((self.m, Z.shape[1]))
        K = -x.metric.inverse @ np.hstack([x.B @ Zh, still, x.C])
        dv = K + np.pad(Z, ((0, 0), (Zh.shape[1], first)))
        dq = np.pad(Zh, ((0, 0), (0, Z.shape[1] + first)))
        last = np.eye(first, dv.shape[1], dv.shape[1] - first)
        return K, dv, np.vstack([dq, dv, last])

    def _cleaned(
        self,
        R: Floats,
        x: Slopes,
        noise: Floats,
        bases: tuple[Floats, Floats],
        changes: tuple[Floats, Floats],
    ) -> Floats:
        """Return R with the entries set to 0 that are no more than rounding errors.

        Parameters
        ----------
        R : ndarray
            The matrix of the linearised motion.
        x : Slopes
            The equations and their derivatives at the state.
        noise : ndarray
            Bounds of the errors of `x.slopes`.
        bases : tuple of ndarray
            Rows that map changes to coefficients of positions, and the basis of
            velocities.
        changes : tuple of ndarray
            Changes of velocities, and of (q, q', s), per unit of each state variable.
        """
        n, m, (P, Z), (dv, change) = self.n, self.m, bases, map(np.abs, changes)
        k, end = len(P), len(R) - self.first
        terms = noise + RESIDUAL_ROUNDOFF * np.abs(x.slopes)
        own = terms[:n]
        if self._drags:
            of_f = x.metric.with_drags(np.eye(n), np.zeros((n, n)))
            of_b = x.metric.with_drags(np.zeros((n, m)), x.metric.inverse)
            own = np.abs(of_f) @ own + np.abs(of_b) @ terms[n : n + m]
        error = np.vstack([
            STATE_ROUNDOFF * np.abs(P) @ dv,
            np.abs(Z.T) @ own @ change,
            terms[n + m :] @ change,
        ])  # fmt: skip
        # Forces and directions that cancel leave their rounding, independent of their
        # size.
        lengths = np.linalg.norm(x.metric.L.T @ dv, axis=0)
        lengths[:k] = np.max(lengths[:k], initial=0.0)
        error[:k] += STATE_ROUNDOFF * lengths
        stiffness = float(np.max(np.abs(R[k:end, :k]), initial=0.0))
        damping = float(np.max(np.abs(R[k:end, k:end]), initial=0.0))
        error[k:end, :k] += STATE_ROUNDOFF * stiffness
        error[k:end, k:end] += STATE_ROUNDOFF * (damping + math.sqrt(stiffness))
        return np.where(np.abs(R) > error, R, 0.0)

    def noise(self, x: Slopes, errors: Mapping[str, float]) -> Floats:
        """Return bounds of the rounding errors of `x.slopes`, in its shape.

        Parameters
        ----------
        x : Slopes
            The equations and their derivatives at the state.
        errors : mapping of str to float
            Error bounds of variables, by name; other variables have the rounding error
            of their value.
        """
        found = self._errors(self._slopes[: x.slopes.size], x, errors)
        return found.reshape(x.slopes.shape)

    def term_errors(self, x: Slopes, errors: Mapping[str, float]) -> list[Floats]:
        """Return bounds of the errors of M, A, f, b and s', each as a flat array.

        x : the equations and their derivatives at the state.
        errors : error bounds of variables, by name; other variables have the rounding
            error of their value.
        """
        n, m = self.n, self.m
        found = self._errors(self._terms, x, errors)
        return np.split(found, np.cumsum([n * n, m * n, n, m]))

    def _errors(
        self, nodes: list[int], x: Slopes, errors: Mapping[str, float]
    ) -> Floats:
        inexact = {
            name: (value, errors.get(name, STATE_ROUNDOFF * abs(value)))
            for name, value in x.values.items()
        }
        return np.array([e for _, e in evaluate_with_error(self.g, nodes, inexact)])

    def values(
        self, t: float, q: Floats, v: Floats, s: Floats | tuple[()] = ()
    ) -> Slopes:
        """Evaluate the equations and their derivatives at a state, as for `at`.

        Raises
        ------
        ValueError
            If a term of the equations, or a derivative, is not finite at the state.
        """
        n, m, first, e = self.n, self.m, self.first, self.e
        values = self._parameters | {"t": t}
        values |= dict(zip(e.state, np.concatenate([q, v, s]).tolist(), strict=True))
        found = self._evaluated(self._terms, values)
        M, A, f, b, rates = np.split(found, np.cumsum([n * n, m * n, n, m]))
        M, A = M.reshape(n, n), A.reshape(m, n)
        drags = None
        if self._drags:
            drags = self._evaluated(self._drags, values).reshape(m, n) - A
        metric = Metric(M, A, drags)
        acceleration, lam = metric.motion(f, b)
        values |= dict(zip(e.accelerations, map(float, acceleration), strict=True))
        values |= dict(zip(e.multipliers, map(float, lam), strict=True))
        slopes = self._evaluated(self._slopes, values)
        size = 2 * n + first
        cuts = np.cumsum([(n + m + first) * size, m * (n + first)])
        by_state, of_rows, turning = np.split(slopes, cuts)
        B, C = np.split(of_rows.reshape(m, n + first), [n], axis=1)
        position_metric = metric
        if not self.holonomic.all():
            position_metric = Metric(M, A * self.holonomic[:, None])
        return Slopes(
            values, M, A, metric, position_metric, by_state.reshape(-1, size), B, C,
            turning.reshape(m, n), acceleration, rates,
        )  # fmt: skip

    def _evaluated(self, nodes: list[int], values: dict[str, float]) -> Floats:
        found = np.array(evaluate(self.g, nodes, values), dtype=float)
        if not np.all(np.isfinite(found)):
            raise ValueError
        return found


class BoundedEigenvalues(NamedTuple):
    """Eigenvalues of a matrix other than 0, with bounds of their rounding errors.

    Attributes
    ----------
    values : ndarray, shape (k,)
        The eigenvalues, by increasing absolute value.
    vectors : ndarray, shape (size, k)
        The right eigenvectors.
    errors : ndarray, shape (k,)
        Bounds of the rounding errors of the eigenvalues.
    zero : int
        The count of eigenvalues that are 0.
    """

    values: Complexes
    vectors: Complexes
    errors: Floats
    zero: int

    @property
    def growing(self) -> Flags:
        """Return a mask (k,) of real parts that are positive beyond rounding."""
        flags: Flags = self.values.real > self.errors
        return flags

    @property
    def decaying(self) -> Flags:
        """Return a mask (k,) of real parts that are negative beyond rounding."""
        flags: Flags = self.values.real < -self.errors
        return flags


def eigenvalues_of(R: Floats) -> BoundedEigenvalues:
    """Return the eigenvalues of R, shape (size, size), with the zero ones counted.

    The zero eigenvalue of a rigid motion is defective: computed together with the
    others it would have only half of its digits. Null spaces are therefore split off
    first, one after the other, and the eigenvalues of the remaining block are computed.
    """
    from scipy.linalg import block_diag, matrix_balance

    S, scale = matrix_balance(R, permute=False, separate=True)
    scale = np.asarray(scale[0])
    balanced, P, zero = S, np.eye(len(R)), 0
    size = float(np.linalg.norm(S, 2)) if S.size else 0.0
    while S.size:
        _, singular, V = np.linalg.svd(S)
        null = int(np.sum(singular <= SOLUTION_ROUNDOFF * size))
        if not null:
            break
        V = np.roll(V, null, axis=0)
        P = P @ block_diag(np.eye(zero), V.T)
        S, zero = V[null:] @ S @ V[null:].T, zero + null
    values, right = np.linalg.eig(S.astype(complex) if not S.size else S)
    # The null block is nilpotent: (value - F) y = coupling z has one solution.
    F = P.T @ balanced @ P
    coupled = F[:zero, zero:] @ right
    whole = np.zeros((len(R), len(values)), complex)
    whole[zero:] = right
    for k, value in enumerate(values if zero else ()):
        shifted = value * np.eye(zero) - F[:zero, :zero]
        whole[:zero, k] = np.linalg.solve(shifted, coupled[:, k])
    # The condition of an eigenvalue is 1 / |cosine of its left and right vector|.
    left = np.linalg.pinv(right)
    conditions = np.linalg.norm(left, axis=1) * np.linalg.norm(right, axis=0)
    rounding = RESIDUAL_ROUNDOFF * np.sqrt(len(R)) * size * conditions
    order = np.argsort(np.abs(values), kind="stable")
    return BoundedEigenvalues(
        values[order].astype(complex),
        np.asarray(scale[:, None] * (P @ whole), complex)[:, order],
        np.minimum(rounding, HALF_OF_DIGITS * size)[order],
        zero,
    )


class EigenMode(NamedTuple):
    """Mode of the linearised equations.

    Attributes
    ----------
    eigenvalue : complex
        The eigenvalue of the conjugate pair with imaginary part >= 0.
    shape : ndarray of complex, shape (n,)
        Amplitudes of the coordinates; the largest is 1.
    states : ndarray of complex, shape (l,)
        Amplitudes of the first-order states, in the scale of `shape`.
    stable : bool
        Whether the real part of the eigenvalue is not positive beyond rounding.
    """

    eigenvalue: complex
    shape: Complexes
    states: Complexes
    stable: bool

    @property
    def frequency(self) -> float:
        """Cycles per unit of time; 0 for a mode without oscillation."""
        return self.eigenvalue.imag / (2.0 * math.pi)

    @property
    def natural_frequency(self) -> float:
        """|eigenvalue| / 2 pi: the frequency without damping."""
        return abs(self.eigenvalue) / (2.0 * math.pi)

    @property
    def period(self) -> float | None:
        """Duration of a cycle; None for a mode without oscillation."""
        return 1.0 / self.frequency if self.frequency > 0.0 else None

    @property
    def damping_ratio(self) -> float:
        """Ratio of the damping to critical damping; negative for a growing mode."""
        return -self.eigenvalue.real / abs(self.eigenvalue)


def modes(linear: Linear, found: BoundedEigenvalues) -> tuple[EigenMode, ...]:
    """Return the modes of the linearised motion, by increasing |eigenvalue|.

    found : the eigenvalues of `linear.R`.
    """
    made = []
    k, first = linear.Zh.shape[1], len(linear.R) - len(linear.first_order)
    pairs = zip(found.values, found.vectors.T, found.growing, strict=True)
    for value, vector, growing in pairs:
        if value.imag < 0.0:
            continue
        shape, states = linear.Zh @ vector[:k], vector[first:]
        moved = np.abs(shape) > COMPUTED_ZERO * np.linalg.norm(vector)
        of = shape if moved.any() else states
        top = of[np.argmax(np.abs(of))] if len(of) else 1.0
        top = top if abs(top) > 0.0 else 1.0  # a velocity alone
        made.append(EigenMode(complex(value), shape / top, states / top, not growing))
    return tuple(made)


# --- Newton's matrix of an implicit method, by its nonzero entries
#
# With the residuals r = M q'' - f - A^T lambda and s = A q'' - b, changes of q, of
# lambda, of q' and of q'' satisfy R_q dq + R_v dv + M da - A^T dlambda = 0, and
# likewise for s. An implicit method has dv = g dq - r and da = g dv - s, so that
#
#     (C0 + g C1 + g^2 C2) (dq, dlambda) = C1 r + C2 (g r + s),
#
# with sparse C0 = (R_q, -A^T; S_q, 0), C1 = (R_v; S_v), C2 = (M; A). The rate of each
# work is one more row, with -1 in C1 for the change of the work itself.
#
# The matrix is factored without pivoting, in an order of minimum degree in which each
# constraint follows its coordinates: its pivot is then a Schur complement.
#
# Sources: E. Hairer and G. Wanner, Solving Ordinary Differential Equations II, 2nd ed.,
# section IV.8; T. A. Davis, Direct Methods for Sparse Linear Systems, chapter 6.

# Cost of a multiplication of sparse entries, in multiplications of full rows.
SLOWER = 6.0
# Cost of a real and a complex multiplication, in real ones: both matrices are factored.
BOTH = 5


class Entry(NamedTuple):
    """Nonzero entry of C0, C1 or C2, the coefficient matrices of Newton's matrix.

    Newton's matrix is C0 + g C1 + g^2 C2 for a number g. `power`, 0, 1 or 2, selects
    the matrix; `node` is the expression of the entry in this row and column.
    """

    power: int
    row: int
    column: int
    node: int


class NewtonMatrix(NamedTuple):
    """Newton's matrix C0 + g C1 + g^2 C2: its entries, and the pattern of its factors.

    C0, C1 and C2 hold the derivatives of the equations of motion by positions and
    multipliers, by velocities, and by accelerations; g is a number of the method.

    Its N rows and columns belong to coordinates, constraints, works. The factors are
    stored by rows in the order of elimination (compressed sparse rows).

    Attributes
    ----------
    entries : tuple of Entry
        The nonzero entries of C0, then of C1, then of C2.
    counts : tuple of int
        Counts of entries of C0, C1 and C2.
    places : tuple of int, length N
        Position of each row and column in the order of elimination.
    starts : tuple of int, length N + 1
        Index, among the entries of the factors, of the first entry of each row.
    diagonals : tuple of int, length N
        Index, among the entries of the factors, of each diagonal entry.
    columns : tuple of int
        Column of each entry of the factors, ascending within each row.
    slots : tuple of int
        Index, among the entries of the factors, of each entry of C0, C1 and C2.
    operations : int
        Real multiplications of a real and a complex factorisation.
    """

    entries: tuple[Entry, ...]
    counts: tuple[int, int, int]
    places: tuple[int, ...]
    starts: tuple[int, ...]
    diagonals: tuple[int, ...]
    columns: tuple[int, ...]
    slots: tuple[int, ...]
    operations: int

    @property
    def sizes_of_factors(self) -> dict[str, int]:
        """Sizes of the arrays that a method stores for the factors, by name."""
        return {
            "unknowns": len(self.places),
            "entries": len(self.entries),
            "filled": len(self.columns),
        }

    @property
    def sizes(self) -> dict[str, int]:
        """Sizes of the arrays of the pattern in `SparseNewton`, by name."""
        still, moving, _ = self.counts
        return {**self.sizes_of_factors, "still": still, "damped": still + moving}

    def fill(self, p: SparseNewton) -> None:
        """Write the pattern into the arrays of the parameters `p`."""
        n = p.n
        p.newton_slots[:] = self.slots
        p.newton_rows[:] = [self.places[entry.row] for entry in self.entries]
        # Works are the last unknowns; their parts are the quadratures of y.
        offset = p.quadratures.start - (n + p.m)
        p.newton_parts[:] = [
            e.column + (offset if e.column >= n + p.m else 0) for e in self.entries
        ]
        p.newton_places[:] = self.places
        p.newton_starts[:] = self.starts
        p.newton_diagonals[:] = self.diagonals
        p.newton_columns[:] = self.columns

    def nodes(self, equations: Equations, elimination: Elimination) -> list[int]:
        """Return the nodes of all entries, with q'' and lambda substituted.

        elimination : the symbolic solution for q'' and lambda.
        """
        g = equations.graph
        motion = (*equations.accelerations, *equations.multipliers)
        found = (node for part in elimination.motion() for node in part)
        new = dict(zip(map(g.variable, motion), found, strict=True))
        return g.substitute([entry.node for entry in self.entries], new)

    def jacobian(self, n: int, values: Floats) -> Floats:
        """Return dq''/d(q, q'), shape (n, 2 n), from the values of the entries."""
        N = len(self.places)
        C = np.zeros((3, N, N))
        for (power, row, column, _), value in zip(self.entries, values, strict=True):
            C[power, row, column] = value
        whole = np.hstack([C[2, :, :n], C[0, :, n:]])
        right = np.hstack([C[0, :, :n], C[1, :, :n]])
        N -= int(np.count_nonzero(C[1].diagonal()[n:]))  # works
        whole, right = whole[:N, :N], right[:N]
        return np.asarray(np.linalg.solve(whole, -right)[:n])


@memoized_by_motion
def newton_matrix(equations: Equations) -> NewtonMatrix | None:
    """Return Newton's matrix; None where full matrices take fewer operations."""
    if equations.laws or equations.states or equations.chains is not None:
        return None
    n, m = len(equations.q), len(equations.rows)
    # Multiplications of both factorisations (2 n: complex), and of J.
    full = n**3 // 3 + (2 * n) ** 3 // 3 + 2 * n**3 + dense_operations(n, m)
    most = int(full / SLOWER / BOTH)
    entries = sorted(_entries(equations, most))
    if len(entries) > most:
        return None
    after = {n + i: row.A.entries.keys() for i, row in enumerate(equations.rows)}
    try:
        return factored(entries, n + m, after, most)
    except TooLongError:
        return None


def factored(
    entries: Sequence[Entry],
    size: int,
    after: Mapping[int, Collection[int]],
    most: float = math.inf,
) -> NewtonMatrix:
    """Select an order of elimination, and compute the pattern of the factors.

    Parameters
    ----------
    entries
        The nonzero entries of C0, C1 and C2, see `NewtonMatrix`.
    size
        The count of rows to be ordered. Later rows stay last: their unknowns are in no
        other row.
    after
        Row -> rows that must precede it in the order.
    most
        The largest number of real multiplications that is permitted.

    Raises
    ------
    TooLongError
        If a real factorisation takes more than `most` multiplications.
    """
    neighbours: list[set[int]] = [set() for _ in range(size)]
    for entry in entries:
        if entry.row < size:
            neighbours[entry.row].add(entry.column)
            neighbours[entry.column].add(entry.row)
    order = minimum_degree([set(row) for row in neighbours], Budget(most), after=after)
    rows = max((1 + entry.row for entry in entries), default=0)
    places = list(range(max(size, rows)))
    for place, k in enumerate(order):
        places[k] = place
    upper = _filled([{places[j] for j in neighbours[k]} for k in order])
    lower: list[list[int]] = [[] for _ in upper]
    for i, row in enumerate(upper):
        for j in row:
            lower[j].append(i)
    for k in range(size, len(places)):
        last = {places[entry.column] for entry in entries if entry.row == k}
        for i in range(size):
            if i in last:
                last.update(upper[i])
        lower.append(sorted(last - {k}))
        upper.append([])
    operations = sum(1 + len(upper[k]) for row in lower for k in row)
    Budget(most).add(operations)
    columns = [[*row, i, *upper[i]] for i, row in enumerate(lower)]
    return _laid_out(entries, places, columns, BOTH * operations)


def _filled(rows: Sequence[set[int]]) -> list[list[int]]:
    """Return the columns right of the diagonal in each row of the factors, ascending.

    rows : the columns of the nonzero entries in each row of the symmetric pattern, in
        the order of elimination.
    """
    upper = [{j for j in row if j > i} for i, row in enumerate(rows)]
    for row in upper:
        if row:
            parent = min(row)
            upper[parent] |= row - {parent}
    return [sorted(row) for row in upper]


def _laid_out(
    entries: Sequence[Entry],
    places: Sequence[int],
    columns: Sequence[Sequence[int]],
    operations: int,
) -> NewtonMatrix:
    starts = [0, *accumulate(len(row) for row in columns)]
    slot = {
        (i, j): start + k
        for i, (start, row) in enumerate(zip(starts, columns, strict=False))
        for k, j in enumerate(row)
    }
    powers = Counter(entry.power for entry in entries)
    return NewtonMatrix(
        entries=tuple(entries),
        counts=(powers[0], powers[1], powers[2]),
        places=tuple(places),
        starts=tuple(starts),
        diagonals=tuple(slot[i, i] for i in range(len(columns))),
        columns=tuple(j for row in columns for j in row),
        slots=tuple(slot[places[e.row], places[e.column]] for e in entries),
        operations=operations,
    )


def _entries(equations: Equations, most: int) -> Iterator[Entry]:
    """Generate the nonzero entries of C0, C1 and C2 of Newton's matrix.

    The generator stops after more than `most` entries.
    """
    e, g = equations, equations.graph
    n, m = len(e.q), len(e.rows)
    columns: dict[int, tuple[int, int]] = {}
    for power, names in enumerate((e.q, e.velocities, e.accelerations)):
        columns |= {g.variable(name): (power, j) for j, name in enumerate(names)}
    columns |= {g.variable(x): (0, n + i) for i, x in enumerate(e.multipliers)}
    variables = frozenset(columns)
    count = 0
    for row, residual in enumerate((*e.motion_residuals(), *e.powers)):
        for variable, node in slopes(g, residual, variables).items():
            if node != g.zero:
                yield Entry(columns[variable][0], row, columns[variable][1], node)
                count += 1
        if count > most:
            return
    for row in range(n + m, n + m + len(e.works)):
        yield Entry(1, row, row, g.constant(-1.0))
