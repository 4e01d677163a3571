"""The equations of motion linearised about a state: eigenvalues and modes.

Small changes keep the constraints, so the linearised motion is written in as many
coordinates as there are free directions. With columns Z that span the velocities which
the constraints let through, and Zh the positions (Zh = Z where all constraints are
holonomic), both orthonormal in the metric of M,

    dq = Zh a,      dq' = Z w + K a,      K = -A^+ B Zh,

where B dq + A dq' is the change of the rates of the constraints. Then a' and w' are
linear in (a, w), and no eigenvalue of the constraints' own index-1 form is among them.
The columns turn with the constraints, without turning among themselves.

Source: E. Hairer, G. Wanner, Solving ODEs II (1996), VII.2: equations on manifolds in
local coordinates.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lagsim.language.derivatives import gradient, tangent
from lagsim.language.evaluate import evaluate
from lagsim.mechanics.algebra import Metric
from lagsim.tolerances import TINY

if TYPE_CHECKING:
    from collections.abc import Callable

    from lagsim.language.arrays import Complexes, Flags, Floats
    from lagsim.mechanics.equations import Equations


class Eigenmodes(NamedTuple):
    """Eigenvalues of a matrix, with right and left eigenvectors.

    Attributes
    ----------
    values : ndarray, shape (k,)
    right : ndarray, shape (size, k)
        Their vectors.
    left : ndarray, shape (size, k)
        Those of the transpose, in an order of their own.
    """

    values: Complexes
    right: Complexes
    left: Complexes

    def amplitudes(self, rates: Floats) -> Complexes:
        """Amplitude of each mode in y' = `rates` (k,)."""
        # Left and right vectors of equal eigenvalues need not come in pairs.
        sides = self.left.T @ self.right, self.left.T @ rates
        return np.asarray(np.linalg.lstsq(*sides, rcond=None)[0], dtype=complex)

    def swing(self, part: float) -> Flags:
        """Whether each mode decays by less than `part` of its rate, shape (k,)."""
        flags: Flags = -self.values.real < part * np.abs(self.values)
        return flags


def eigenmodes(matrix: Floats, kept: Callable[[Floats], Flags]) -> Eigenmodes:
    """Modes of `matrix` whose rates |eigenvalue| are `kept`."""
    values, right = np.linalg.eig(matrix)
    others, left = np.linalg.eig(matrix.T)
    chosen = kept(np.abs(values))
    return Eigenmodes(values[chosen], right[:, chosen], left[:, kept(np.abs(others))])


def weighted(moved: Complexes, masses: Floats) -> Floats:
    """Shapes (n, k) by the roots of masses (n,), each at most 1."""
    shapes: Floats = np.abs(moved) * np.sqrt(masses)[:, None]
    shapes /= np.maximum(np.max(shapes, axis=0, initial=0.0), TINY)
    return shapes


class Linear(NamedTuple):
    """The linearised motion (a, w)' = R (a, w) about a state.

    Attributes
    ----------
    R : ndarray, shape (k + d, k + d)
        k free directions of positions, d of velocities.
    Zh : ndarray, shape (n, k)
        What a stands for: dq = Zh a.
    Z : ndarray, shape (n, d)
        The velocities which the constraints let through.
    force : ndarray, shape (d,)
        Z^T (f + A^T lambda), by the mass that is one: how far from an equilibrium.
    lengths : ndarray, shape (n, n)
        L^T, where L L^T is the metric: |L^T dq| measures changes.
    restoring : ndarray, shape (n, m)
        -Ah^+, which takes residuals of holonomic rows to the dq that meets them.
    residuals : ndarray, shape (m,)
        Of the holonomic rows, else 0.
    rates : ndarray, shape (m,)
    """

    R: Floats
    Zh: Floats
    Z: Floats
    force: Floats
    lengths: Floats
    restoring: Floats
    residuals: Floats
    rates: Floats

    def eigenvalues(self) -> Complexes:
        """Return them, by falling size."""
        found = np.linalg.eigvals(self.R).astype(complex)
        return np.asarray(found[np.argsort(-np.abs(found), kind="stable")])

    @property
    def stiffness(self) -> Floats:
        """Return d(force)/da (d, k), with its sign turned."""
        k = self.Zh.shape[1]
        return -self.R[k:, :k]


class Linearisation:
    """The equations and their slopes, ready to be evaluated at states.

    By the graph in plain Python, with the branches that switches have at each state:
    some tens of states are asked for, and nothing is compiled.

    Attributes
    ----------
    nodes : int
        How many are evaluated for one state.
    """

    def __init__(self, equations: Equations) -> None:
        e, g = equations, equations.graph
        self.e, self.g = e, g
        self.n, self.m = len(e.q), len(e.rows)
        self._parameters = {p.name: p.value for p in e.model.parameters}
        positions = [g.variable(name) for name in e.q]
        rates = [g.variable(name) for name in e.velocities]
        accelerations = [g.variable(name) for name in e.accelerations]
        A = [node for row in e.rows for node in row.A]
        self._terms = [
            *(node for row in e.M for node in row), *A, *e.f,
            *(row.b for row in e.rows),
            *(row.residual if row.holonomic else g.zero for row in e.rows),
            *(row.rate for row in e.rows),
        ]  # fmt: skip
        state = [*positions, *rates]
        flow = dict(zip(state, [*rates, *accelerations], strict=True))
        flow[g.variable("t")] = g.one
        self._slopes = [
            *(s for r in e.motion_residuals() for s in gradient(g, r, state)),
            *(s for row in e.rows for s in gradient(g, row.rate, positions)),
            *tangent(g, A, flow),
        ]
        self.nodes = len(g.cone(self._terms)) + len(g.cone(self._slopes))
        self._holonomic = np.array([row.holonomic for row in e.rows], dtype=bool)

    def at(self, t: float, q: Floats, v: Floats, *, resting: bool = False) -> Linear:
        """Linearise about a state.

        Parameters
        ----------
        resting
            As if the accelerations were zero: the forces that this takes are told.

        Raises
        ------
        ValueError
            Where something is not finite.
        """
        n, m, e = self.n, self.m, self.e
        values = self._parameters | {"t": t}
        values |= dict(zip(e.q, map(float, q), strict=True))
        values |= dict(zip(e.velocities, map(float, v), strict=True))
        found = self._evaluated(self._terms, values)
        cuts = np.cumsum([n * n, m * n, n, m, m])
        M, A, f, b, residuals, rates = np.split(found, cuts)
        M, A = M.reshape(n, n), A.reshape(m, n)
        metric = Metric(M, A)
        acceleration, lam = np.zeros(n), metric.multipliers(f)
        if not resting:
            acceleration, lam = metric.motion(f, b)
        values |= dict(zip(e.accelerations, map(float, acceleration), strict=True))
        values |= dict(zip(e.multipliers, map(float, lam), strict=True))
        slopes = self._evaluated(self._slopes, values)
        by_state, B, turning = np.split(slopes, np.cumsum([(n + m) * 2 * n, m * n]))
        r = by_state.reshape(n + m, 2 * n)[:n]
        B, turning = B.reshape(m, n), turning.reshape(m, n)
        Z, inverse = metric.free, metric.inverse
        held = metric
        if not self._holonomic.all():
            held = Metric(M, A * self._holonomic[:, None])
        Zh = held.free
        K = -inverse @ (B @ Zh)
        turned = -inverse @ (turning @ Z)
        G = metric.G
        by_position = -Z.T @ (r[:, :n] @ Zh + r[:, n:] @ K)
        by_position += turned.T @ G @ K
        R = np.block([
            [Zh.T @ G @ K, Zh.T @ G @ Z],
            [by_position, -Z.T @ r[:, n:] @ Z],
        ])  # fmt: skip
        return Linear(
            R, Zh, Z, Z.T @ f, np.asarray(metric.L.T), -held.inverse, residuals, rates
        )  # fmt: skip

    def _evaluated(self, nodes: list[int], values: dict[str, float]) -> Floats:
        found = np.array(evaluate(self.g, nodes, values), dtype=float)
        if not np.all(np.isfinite(found)):
            raise ValueError
        return found
