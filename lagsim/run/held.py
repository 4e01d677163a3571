"""Displacement of what rests: coordinates if nothing held them, and what follows them.

See `mechanics.equations`. A coordinate that moves no farther than the rounding of its
forces could take it is at rest.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lagsim.language.derivatives import gradient
from lagsim.language.evaluate import evaluate_rows, roundings
from lagsim.mechanics.equations import pushes
from lagsim.mechanics.structure import in_groups, joined
from lagsim.tolerances import SUM_ROUNDOFF

if TYPE_CHECKING:
    from collections.abc import Sequence

    from lagsim.language.arrays import Floats
    from lagsim.mechanics.equations import Equations

# Rows of a motion that forces are looked at, and operations for them, at most.
MOST_ROWS = 64
MOST_OPERATIONS = 2e5


class Held(NamedTuple):
    """Largest force on each coordinate, and its possible displacement (n,)."""

    forces: Floats
    reach: Floats

    @property
    def moved(self) -> Floats:
        """Displacement by roundoff of a body whose forces balance."""
        return np.asarray(SUM_ROUNDOFF * self.reach)


def could_push(
    equations: Equations,
    rows: Floats,
    which: Sequence[int],
    step: float,
    reactions: Floats | None = None,
) -> Held:
    """Return what forces could do along a motion to coordinates that they do not move.

    By the terms of the forces, and all that is rounded where they are computed. In the
    whole of the motion; where a force grows with the place, in the time in which that
    holds what it moves; and what only constraints push, between two projections: there
    the rounding of that is taken away again.

    Parameters
    ----------
    rows : ndarray, shape (k, 1 + 2 n)
        Times, coordinates and velocities.
    which
        The coordinates; of others nothing is given.
    step
        Between two projections, at most.
    reactions : ndarray, shape (n,)
        What constraints push with at most, where that is known.
    """
    e, g, n = equations, equations.graph, len(equations.q)
    state = e.moving
    reacting = g.dependent(e.f, (*e.multipliers, *e.accelerations))
    known = [f for f in e.f if f not in reacting]
    bounds = dict(zip(known, roundings(g, known, state), strict=True))
    sizes = zip(pushes(e), (bounds.get(f, g.zero) for f in e.f), strict=False)
    nodes = [*(g.call("add", *pair) for pair in sizes), *e.inertias]
    nodes += [gradient(g, e.f[i], [g.variable(e.q[i])])[0] for i in which]
    most = max(1, min(MOST_ROWS, int(MOST_OPERATIONS / len(g.cone(nodes)))))
    some = rows[:: -(-len(rows) // most)]
    names = ("t", *e.state)
    values: dict[str, float | Floats] = {p.name: p.value for p in e.model.parameters}
    values |= dict(zip(names, some.T, strict=True))
    found = np.abs(evaluate_rows(g, nodes, values, len(some)))
    forces, inertias, stiffness = found[:n], found[n : 2 * n], found[2 * n :]
    if reactions is not None:
        forces = np.fmax(forces, reactions[:, None])
    pulled = _most(forces, inertias)
    own, linked = np.zeros(n), np.zeros(n)
    chosen, time = list(which), float(np.ptp(rows[:, 0]))
    # What is held by a force of this slope goes no farther than in 1/w.
    stiff = time * time * _most(stiffness, inertias[chosen])
    own[chosen] = pulled[chosen] * time * time / np.fmax(stiff, 1.0)
    labels = joined(n, [A.entries for A in e.slopes])
    roots = np.sqrt(np.max(inertias, axis=1, initial=0.0))
    pushed = in_groups(labels, roots, pulled)
    linked[chosen] = pushed[chosen] * step * step
    return Held(np.max(forces, axis=1, initial=0.0), np.fmax(own, linked))


def could_follow(equations: Equations, rows: Floats, reach: Floats) -> Floats:
    """Displacement of states (l,) if coordinates moved by their `reach` (n,).

    In the whole of the motion, or in its own time constant where a state has one.

    rows : (k, 1 + 2 n + l), times, coordinates, velocities and states
    """
    e, g, n = equations, equations.graph, len(equations.q)
    variables = [g.variable(name) for name in e.state]
    nodes = [slope for x in e.states for slope in gradient(g, x.rate, variables)]
    some = rows[:: -(-len(rows) // MOST_ROWS)]
    values: dict[str, float | Floats] = {p.name: p.value for p in e.model.parameters}
    values |= dict(zip(("t", *e.state), some.T, strict=True))
    found = np.abs(evaluate_rows(g, nodes, values, len(some)))
    slopes = np.max(found, axis=1).reshape(len(e.states), len(variables))
    time = float(np.ptp(rows[:, 0]))
    own = slopes[:, 2 * n :].diagonal().copy()
    slopes[:, 2 * n :][np.diag_indices(len(own))] = 0.0
    moved = np.concatenate([reach, reach / time, np.zeros(len(own))])
    for _ in e.states:
        moved[2 * n :] = slopes @ moved / np.fmax(own, 1.0 / time)
    return moved[2 * n :]


def _most(sizes: Floats, inertias: Floats) -> Floats:
    """Return the largest quotient of each row; what is not finite does not count."""
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        found = sizes / inertias
    return np.asarray(
        np.max(np.where(np.isfinite(found), found, 0.0), axis=1, initial=0.0)
    )
