"""The equations of motion linearised about a state: eigenvalues and modes.

Small changes keep the constraints, so the linearised motion is written in as many
coordinates as there are free directions. With columns Z that span the velocities which
the constraints let through, and Zh the positions (Zh = Z where all constraints are
holonomic), both orthonormal in the metric of M,

    dq = Zh a,      dq' = Z w + K a + H z,      K = -A^+ B Zh,      H = -A^+ C,

where B dq + A dq' + C z is the change of the rates of the constraints, and z that of
the first-order states. Then a', w' and z' are linear in (a, w, z), and no eigenvalue of
the constraints' own index-1 form is among them. The columns turn with the constraints,
without turning among themselves.

Source: E. Hairer, G. Wanner, Solving ODEs II (1996), VII.2: equations on manifolds in
local coordinates.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lagsim.language.derivatives import gradient, tangent
from lagsim.language.evaluate import evaluate
from lagsim.mechanics.algebra import Metric
from lagsim.tolerances import HALF_OF_DIGITS, TINY

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

    def parts(self, moved: Complexes, masses: Floats, states: int) -> Floats:
        """Part of coordinates and of the `states`, the last components, in each mode.

        Shape (n + states, k), each at most 1: of coordinates, `moved` (n, k), by the
        roots of masses (n,), or of states where these participate by more than half.
        Source: I. J. Perez-Arriaga, G. C. Verghese, F. C. Schweppe, IEEE Trans. Power
        Apparatus and Systems 101 (1982), 3117: participation factors.
        """
        shapes = np.abs(moved) * np.sqrt(masses)[:, None]
        sides = self.left.T @ self.right, self.left.T
        dual = np.linalg.lstsq(*sides, rcond=None)[0].T
        shares = np.abs(self.right * dual)[len(self.right) - states :]
        by_states = shares.sum(axis=0) > 0.5
        found: Floats = np.vstack([shapes * ~by_states, shares * by_states])
        found /= np.maximum(np.max(found, axis=0, initial=0.0), TINY)
        return found

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


class Linear(NamedTuple):
    """The linearised motion (a, w, z)' = R (a, w, z) about a state.

    Attributes
    ----------
    R : ndarray, shape (k + d + l, k + d + l)
        k free directions of positions, d of velocities, l first-order states.
    Zh : ndarray, shape (n, k)
        What a stands for: dq = Zh a.
    Z : ndarray, shape (n, d)
        The velocities which the constraints let through.
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
        """Return them, by falling size."""
        found = np.linalg.eigvals(self.R).astype(complex)
        return np.asarray(found[np.argsort(-np.abs(found), kind="stable")])


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
        self.n, self.m, self.first = len(e.q), len(e.rows), len(e.states)
        self._parameters = {p.name: p.value for p in e.model.parameters}
        positions = [g.variable(name) for name in e.q]
        first = [g.variable(x.name) for x in e.states]
        accelerations = [g.variable(name) for name in e.accelerations]
        A = [node for row in e.rows for node in row.A]
        self._terms = [
            *(node for row in e.M for node in row), *A, *e.f,
            *(row.b for row in e.rows), *(x.rate for x in e.states),
        ]  # fmt: skip
        rates, state = e.flow.rates, [g.variable(name) for name in e.state]
        flow = e.flow.forward | dict(zip(rates, accelerations, strict=True))
        residuals = [*e.motion_residuals(), *(x.rate for x in e.states)]
        by = [*positions, *first]
        self._slopes = [
            *(s for r in residuals for s in gradient(g, r, state)),
            *(s for row in e.rows for s in gradient(g, row.rate, by)),
            *tangent(g, A, flow),
        ]
        self.nodes = len(g.cone(self._terms)) + len(g.cone(self._slopes))
        self._holonomic = np.array([row.holonomic for row in e.rows], dtype=bool)

    def at(self, t: float, q: Floats, v: Floats, s: Floats | tuple[()] = ()) -> Linear:
        """Linearise about a state.

        Parameters
        ----------
        t, q, v, s
            Time, coordinates and velocities (n,), first-order states (l,).

        Raises
        ------
        ValueError
            Where something is not finite.
        """
        n, m, first, e = self.n, self.m, self.first, self.e
        values = self._parameters | {"t": t}
        values |= dict(zip(e.state, np.concatenate([q, v, s]).tolist(), strict=True))
        found = self._evaluated(self._terms, values)
        M, A, f, b, rates = np.split(found, np.cumsum([n * n, m * n, n, m]))
        M, A = M.reshape(n, n), A.reshape(m, n)
        metric = Metric(M, A)
        acceleration, lam = metric.motion(f, b)
        values |= dict(zip(e.accelerations, map(float, acceleration), strict=True))
        values |= dict(zip(e.multipliers, map(float, lam), strict=True))
        slopes = self._evaluated(self._slopes, values)
        size = 2 * n + first
        cuts = np.cumsum([(n + m + first) * size, m * (n + first)])
        by_state, moved, turning = np.split(slopes, cuts)
        r, _, of_first = np.split(by_state.reshape(-1, size), [n, n + m])
        B, C = np.split(moved.reshape(m, n + first), [n], axis=1)
        turning = turning.reshape(m, n)
        Z, inverse = metric.free, metric.inverse
        held = metric
        if not self._holonomic.all():
            held = Metric(M, A * self._holonomic[:, None])
        Zh = held.free
        # Changes of q and of q' by (a, w, z).
        K = -inverse @ np.hstack([B @ Zh, np.zeros((m, Z.shape[1])), C])
        dv = K + np.pad(Z, ((0, 0), (Zh.shape[1], first)))
        dq = np.pad(Zh, ((0, 0), (0, Z.shape[1] + first)))
        last = np.eye(first, dv.shape[1], dv.shape[1] - first)
        change = np.vstack([dq, dv, last])
        turned = -inverse @ (turning @ Z)
        G = metric.G
        R = np.vstack([
            Zh.T @ G @ dv, turned.T @ G @ K - Z.T @ (r @ change), of_first @ change
        ])  # fmt: skip
        return Linear(R, Zh, Z, np.asarray(metric.L.T), rates)

    def _evaluated(self, nodes: list[int], values: dict[str, float]) -> Floats:
        found = np.array(evaluate(self.g, nodes, values), dtype=float)
        if not np.all(np.isfinite(found)):
            raise ValueError
        return found


class Mode(NamedTuple):
    """Mode of the linearised equations.

    Attributes
    ----------
    eigenvalue : complex
        The one with the imaginary part >= 0.
    shape : ndarray of complex, shape (n,)
        Of the coordinates; the largest is 1.
    """

    eigenvalue: complex
    shape: np.ndarray[tuple[int], np.dtype[np.complex128]]

    @property
    def frequency(self) -> float:
        """Cycles per unit of time; 0 where it does not oscillate."""
        return self.eigenvalue.imag / (2.0 * math.pi)

    @property
    def period(self) -> float | None:
        """The time of a cycle; None where it does not oscillate."""
        return 1.0 / self.frequency if self.frequency > 0.0 else None

    @property
    def damping_ratio(self) -> float:
        """Of critical damping; below 0 where it grows."""
        return -self.eigenvalue.real / abs(self.eigenvalue)


def modes(linear: Linear) -> tuple[Mode, ...]:
    """Modes by rising frequency; neutral directions are left out."""
    moving = eigenmodes(linear.R, lambda x: x > HALF_OF_DIGITS * np.max(x, initial=0.0))
    found = []
    k = linear.Zh.shape[1]
    for value, vector in zip(moving.values, moving.right.T, strict=True):
        if value.imag < 0.0:
            continue
        shape = linear.Zh @ vector[:k].astype(complex)
        top = shape[np.argmax(np.abs(shape))] if len(shape) else 1.0
        if top == 0.0:
            continue  # a velocity alone
        found.append(Mode(complex(value), shape / top))
    return tuple(sorted(found, key=lambda mode: abs(mode.eigenvalue)))
