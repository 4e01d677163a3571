"""State space of small motions: x' = A x + B u, y = C x + D u about a steady state.

The inputs u are added to forces, to parameters, or to the right sides of constraints.
The right side of a holonomic constraint g(q) = u enters with two rates,

    A dq = u,      B dq + A dq' + C z = u',      d(A q'' - b) = u'',

and the right side of a constraint between velocities with one rate; z are the
first-order states, and A, B and C here those of `linearisation`. With dq = Z x + A^+ u
the linearised equations M dq'' - A^T dlambda = -r give dq'' and dlambda, and with these
the slopes of any output. The state x consists of free coordinates, their rates and the
first-order states (`Linear` has coefficients of orthonormal directions in place of
coordinates).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lagsim.language.derivatives import gradient, slopes
from lagsim.language.evaluate import evaluate
from lagsim.language.names import rate_of

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from lagsim.language.arrays import Complexes, Floats
    from lagsim.mechanics.equations import Instant
    from lagsim.mechanics.linearisation import Linearisation


class Input(NamedTuple):
    """Quantity that is added to a part of the equations.

    Attributes
    ----------
    name : str
        The name of the input.
    force : mapping of int to int
        Index of a coordinate -> node of the generalized force per unit of the input.
    parameters : mapping of str to float
        Parameter -> its change per unit of the input.
    row : int
        The index of the constraint whose right side is the input; -1 for none.
    """

    name: str
    force: Mapping[int, int] = {}
    parameters: Mapping[str, float] = {}
    row: int = -1


class StateSpace(NamedTuple):
    """Matrices of x' = A x + B u, y = C x + D u, with the names of x, u and y.

    Attributes
    ----------
    A, B, C, D : ndarray, shape (s, s), (s, i), (o, s), (o, i)
        Matrices for s states, i inputs with their rates, and o outputs.
    states, inputs, outputs : tuple of str
        An input `c'` is the rate of the input `c`, and `c''` the rate of `c'`.
    """

    A: Floats
    B: Floats
    C: Floats
    D: Floats
    states: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]

    def response(self, frequencies: Floats) -> Complexes:
        """Return the frequency response of the outputs, shape (k, o, inputs).

        A rate `c'` is not an input of its own: it varies with `c`.

        Parameters
        ----------
        frequencies : ndarray, shape (k,)
            In cycles per unit of time.
        """
        names = [x for x in self.inputs if not x.endswith("'")]
        rate = 2j * np.pi * np.asarray(frequencies)[:, None, None]
        E = np.array([
            [name.rstrip("'") == own for own in names] for name in self.inputs
        ], dtype=float).reshape(len(self.inputs), len(names))  # fmt: skip
        order = np.array([len(x) - len(x.rstrip("'")) for x in self.inputs])
        u = rate ** order[:, None] * E
        x = np.linalg.solve(rate * np.eye(len(self.A)) - self.A, self.B @ u)
        return np.asarray(self.C @ x + self.D @ u)


def inputs_of(names: Sequence[str], orders: Sequence[int]) -> tuple[str, ...]:
    """Return names of inputs, each followed by the names of its rates: c, c', c''.

    orders : for each input, the order of its highest rate.
    """
    pairs = zip(names, orders, strict=True)
    return tuple(name + "'" * k for name, order in pairs for k in range(order + 1))


def state_space(
    linearisation: Linearisation,
    state: Instant,
    inputs: Sequence[Input],
    outputs: Mapping[str, int],
) -> StateSpace:
    """Return the state space about a steady state, in free coordinates.

    Parameters
    ----------
    linearisation : Linearisation
        The equations of motion, with derivatives at any state.
    state : Instant
        A rest, or a state whose velocities change nothing in the equations.
    inputs : sequence of Input
        The quantities u.
    outputs : mapping of str to int
        Name -> node of the state, q'' and lambda.

    Raises
    ------
    ValueError
        If a term of the equations, or a derivative, is not finite at the state.
    """
    L, e, n, m = linearisation, linearisation.e, linearisation.n, linearisation.m
    x = L.values(state.t, state.q, state.v, state.s)
    pushed = [_pushed(L, x.values, one) for one in inputs]
    # The order of an input: of its highest rate that the equations contain.
    orders = [_order(L, levels) for _, levels in pushed]
    names = inputs_of([one.name for one in inputs], orders)
    count, at = len(names), np.cumsum([0, *(k + 1 for k in orders)]).tolist()
    # Right sides of A dq, of the rates and of A q'' - b; changes of the residuals.
    right, change = np.zeros((3, m, count)), np.zeros((n + m + L.first, count))
    for (residuals, levels), first, order in zip(pushed, at, orders, strict=False):
        change[:, first] = residuals
        for i in np.flatnonzero(levels):
            for k in range(3) if L.holonomic[i] else (1, 2):
                own = k if L.holonomic[i] else k - 1
                if own <= order:
                    right[k, i, first + own] = levels[i]
    Zh, Z, inverse = x.position_metric.free, x.metric.free, x.metric.inverse
    chosen, rates = _chosen(Zh, x.M), _chosen(Z, x.M)
    k, d, size = len(chosen), len(rates), L.first
    lift = x.position_metric.inverse @ right[0]
    T = np.linalg.inv(Zh[chosen]) if k else np.zeros((0, 0))
    dq = Zh @ T @ np.hstack([np.eye(k, k + d + size), -lift[chosen]])
    dq[:, k + d + size :] += lift
    ds = np.eye(size, k + d + size + count, k + d)
    forces = -x.B @ dq - x.C @ ds
    forces[:, k + d + size :] += right[1]
    dv = inverse @ forces
    target = np.eye(d, k + d + size + count, k) - dv[rates]
    dv += Z @ np.linalg.solve(Z[rates], target) if d else 0.0
    every = np.vstack([dq, dv, ds])
    residuals = x.slopes @ every
    residuals[:, k + d + size :] += change
    given = -residuals[n : n + m]
    given[:, k + d + size :] += right[2]
    da, dlam = x.metric.motion(-residuals[:n], given)
    whole = np.vstack([dv[chosen], da[rates], residuals[n + m :]])
    shown = _outputs(L, x.values, outputs, inputs, np.vstack([every, da, dlam]), at)
    cut = k + d + size
    return StateSpace(
        whole[:, :cut], whole[:, cut:], shown[:, :cut], shown[:, cut:],
        (*(e.q[j] for j in chosen), *(e.velocities[j] for j in rates),
         *(s.name for s in e.states)),
        names, tuple(outputs),
    )  # fmt: skip


def _order(L: Linearisation, levels: Floats) -> int:
    """Return the order of the highest derivative of an input that enters the rows.

    levels : (m,), the change of each row's right-hand side per unit of the input.
    L : the equations, linearised at any state.
    """
    rows = np.flatnonzero(levels)
    return max((2 if L.holonomic[i] else 1 for i in rows), default=0)


def _pushed(
    L: Linearisation, values: Mapping[str, float], one: Input
) -> tuple[Floats, Floats]:
    """Return the changes of residuals, and of right-hand sides, per unit of an input.

    They have the shapes (n + m + l,) and (m,); residuals are those of `Slopes`, and the
    right-hand sides those of the constraint rows.

    values : the values of all variables.
    one : the input.
    L : the equations, linearised at any state.
    """
    e, g, n, m = L.e, L.g, L.n, L.m
    change, levels = np.zeros(n + m + L.first), np.zeros(m)
    force = evaluate(g, one.force.values(), values)
    for j, push in zip(one.force, force, strict=True):
        change[j] -= push
    if one.row >= 0:
        levels[one.row] = 1.0
    if one.parameters:
        by = [g.variable(name) for name in one.parameters]
        weights = np.array([*one.parameters.values()])
        nodes = [*e.motion_residuals(), *(x.rate for x in e.states)]
        nodes += [row.residual for row in e.rows]
        found = [s for node in nodes for s in gradient(g, node, by)]
        values_of = np.array(evaluate(g, found, values)).reshape(-1, len(by)) @ weights
        change += values_of[: n + m + L.first]
        levels -= values_of[n + m + L.first :]
    return change, levels


def _outputs(
    L: Linearisation,
    values: Mapping[str, float],
    outputs: Mapping[str, int],
    inputs: Sequence[Input],
    motion: Floats,
    at: Sequence[int],
) -> Floats:
    """Return the changes of the outputs per unit of states and inputs, (o, columns).

    L : the equations, linearised at any state.

    Parameters
    ----------
    values : mapping
        The values of all variables.
    outputs : mapping
        Name -> node.
    inputs : sequence of Input
        The quantities u.
    motion : ndarray
        Changes of state variables, q'' and lambda, a row for each.
    at : sequence of int
        The first column of each input, counted among the columns of inputs, then the
        number of these columns.
    """
    e, g = L.e, L.g
    names = [*e.state, *(rate_of(q, 2) for q in e.q), *e.multipliers]
    place = {g.variable(name): k for k, name in enumerate(names)}
    found = np.zeros((len(outputs), motion.shape[1]))
    first = motion.shape[1] - at[-1]
    for i, node in enumerate(outputs.values()):
        own = slopes(g, node, frozenset(place))
        for v, value in zip(own, evaluate(g, own.values(), values), strict=True):
            found[i] += value * motion[place[v]]
        for one, column in zip(inputs, at, strict=False):
            by = [g.variable(name) for name in one.parameters]
            direct = evaluate(g, gradient(g, node, by), values)
            found[i, first + column] += np.dot(direct, [*one.parameters.values()])
    return found


def _chosen(Z: Floats, M: Floats) -> list[int]:
    """Return the indices of coordinates that serve as free coordinates.

    Their values determine the coefficients of the columns of Z (n, d): the pivots of a
    QR decomposition with column pivoting, in the metric of the diagonal of M.
    """
    if not Z.shape[1]:
        return []
    if Z.shape[1] == len(Z):
        return list(range(len(Z)))
    from scipy.linalg import qr

    sizes = np.sqrt(np.abs(np.diag(M)))
    sizes = np.where(sizes > 0.0, sizes, 1.0)
    pivots = qr((sizes[:, None] * Z).T, mode="r", pivoting=True)[1]
    return sorted(pivots[: Z.shape[1]].tolist())
