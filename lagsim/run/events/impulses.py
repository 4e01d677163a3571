"""Jumps of velocities by the impulses of events, and impulses of equalities.

An impulse P is the limit of a large force in a short time, at a constant position:

    d(dL/dq') = P + A^T Lambda,      A dq' = 0

with the Lagrangian L, the momenta dL/dq', the jumps d() and the rows A of the
equalities in force, which transmit the impulses Lambda. Contacts
and freewheels that approach after it are struck by this change of the velocities
(`contacts`). Where M or A depends on the velocities, the change is followed from 0 to
the whole impulse.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lagsim.mechanics.algebra import Metric, least_squares
from lagsim.run.trajectory import JumpImpulses

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from lagsim.language.arrays import Floats, Ints
    from lagsim.program.impulses import JumpData
    from lagsim.run.arc import Arc

# Extrapolated midpoint rule: numbers of substeps, relative error, and the largest
# number of times that an interval is halved.
SUBSTEPS = (2, 4, 6, 8, 10, 12, 14, 16)
ERROR = 1e-14
HALVINGS = 30


def data_at(arc: Arc, y: Floats) -> JumpData:
    """Return masses, rows, momenta and impulses at the state y (size,)."""
    found = arc.system.impulses
    assert found is not None
    return found.data(arc.runner.function("impulses", len(found.nodes))(arc.t, y))


def kick(arc: Arc, y: Floats, P: Floats) -> tuple[Floats, JumpImpulses]:
    """Return the state (size,) after an impulse, and the impulses of the rows.

    Parameters
    ----------
    arc : Arc
        The arc that the impulse ends.
    y : ndarray, shape (size,)
        The state before the impulse, with the modes after all acts of the instant.
    P : ndarray, shape (n,)
        The generalized impulse, for all coordinates of the model.

    Raises
    ------
    LinAlgError
        If the mass matrix is singular on the motions that the rows admit, or the
        velocities grow without bound.
    """
    n, first = len(P), data_at(arc, y)
    function = arc.system.impulses
    assert function is not None
    groups = [x for x in function.groups if P[x[0]].any()]

    def state(v: Floats) -> Floats:
        new = y.copy()
        new[arc.velocities] = arc.plan.reduction.independent(v)
        return new

    def change(x: Floats) -> Floats:
        return _response(data_at(arc, state(x[:n])), P, groups)

    x = np.append(first.velocities, np.zeros(len(first.rows)))
    x = followed(change, x, n) if function.is_curved else x + change(x)
    given, p = x[n:], arc.system.p
    count = len(p.row_impulses)
    laws = given[count : count + len(p.impulses)]  # the method moreau has no laws
    return state(x[:n]), JumpImpulses(laws, given[:count])


def _response(now: JumpData, P: Floats, groups: Iterable[tuple[Ints, Ints]]) -> Floats:
    """Return the jump of the velocities (n,), then the impulses of the rows (R,).

    now : masses and rows at the state.
    P : (n,), the generalized impulse.
    groups : see `program.impulses.ImpulseFunction.groups`.
    """
    jump, given = np.zeros(len(P)), np.zeros(len(now.rows))
    for group, rows in groups:
        M, own, held = now.M[np.ix_(group, group)], P[group], rows[now.holds[rows]]
        if not len(held):
            jump[group] = np.linalg.solve(M, own)
            continue
        metric = Metric(M, now.rows[np.ix_(held, group)])
        jump[group] = change = metric.free @ (metric.free.T @ own)
        given[held] = metric.multipliers(own - M @ change)
    return np.append(jump, given)


def transmit(
    arc: Arc,
    before: Floats,
    after: Floats,
    laws: Floats,
    equalities: Sequence[int] = (),
    pushed: Floats | None = None,
) -> JumpImpulses:
    """Return the impulses of laws and equalities in an impact.

    Parameters
    ----------
    arc : Arc
        The arc that the impact ends.
    before, after : ndarray, shape (size,)
        The states before and after the impact.
    laws : ndarray, shape (L,)
        The impulses of the laws in the impact.
    equalities : sequence of int
        The laws that are equalities at a corner: their impulses are computed, too.
    pushed : ndarray, shape (n,), or None
        The changes of all momenta by the laws; by default by the rows after the impact.
    """
    function, p = arc.system.impulses, arc.system.p
    if function is None:
        return JumpImpulses(laws[: len(p.impulses)], p.row_impulses)
    first, last = data_at(arc, before), data_at(arc, after)
    always = len(function.always)
    pushed = laws @ last.rows[always:] if pushed is None else pushed
    jump = last.momenta - first.momenta - pushed
    solved = {*range(always), *(always + k for k in equalities)}
    given = np.concatenate([np.zeros(always), laws])
    for group, rows in function.groups:
        own = np.array([k for k in rows.tolist() if k in solved], dtype=int)
        if len(own) and jump[group].any():
            A = last.rows[np.ix_(own, group)]
            given[own] += least_squares(A.T, jump[group], None)
    return JumpImpulses(given[always:][: len(p.impulses)], given[:always])


def followed(change: Callable[[Floats], Floats], x: Floats, n: int) -> Floats:
    """Return x(1) of x' = change(x) from x(0) = x, by the extrapolated midpoint rule.

    x and change(x) have shape (k,). The first n components of x are velocities. Only
    they decide the length of steps, since the others, impulses of rows, may consist of
    rounding errors alone.

    Source: E. Hairer, S. P. Norsett, G. Wanner, Solving Ordinary Differential Equations
    I, section II.9.
    """
    done, length = 0.0, 1.0
    while done < 1.0:
        found, is_close = _extrapolated(change, x, length, n)
        if is_close:
            x, done = found, done + length
            length = min(2.0 * length, 1.0 - done)
        elif length <= 2.0**-HALVINGS:
            raise np.linalg.LinAlgError("velocities grow without bound")
        else:
            length /= 2.0
    return x


def _extrapolated(
    change: Callable[[Floats], Floats], x: Floats, length: float, n: int
) -> tuple[Floats, bool]:
    """Return x (k,) after one step of a length, and whether its error is negligible.

    The equation is x' = change(x), as in `followed`.

    length : the length of the step.
    n : the first n numbers of x are compared.
    """
    table: list[Floats] = []
    for k, count in enumerate(SUBSTEPS):
        h = length / count
        last, now = x, x + h * change(x)
        for _ in range(count - 1):
            last, now = now, last + 2.0 * h * change(now)
        row = [(last + now + h * change(now)) / 2.0]
        for j in range(k):
            ratio = (count / SUBSTEPS[k - 1 - j]) ** 2
            row.append(row[j] + (row[j] - table[j]) / (ratio - 1.0))
        if table:
            error = np.max(np.abs(row[-1] - row[-2])[:n], initial=0.0)
            sizes = np.maximum(np.abs(row[-1]), np.abs(x))  # of velocities that stop
            scale = np.max(sizes[:n], initial=0.0)
            if error <= ERROR * scale:
                return row[-1], True
        table = row
    return table[-1], False
