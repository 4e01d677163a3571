"""Errors of a run: the estimate by a repeat, and what rounding does to what rests."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lagsim.language.derivatives import gradient
from lagsim.language.evaluate import evaluate_rows, roundings
from lagsim.language.sparse import joined
from lagsim.mechanics.equations import pushes
from lagsim.tolerances import SUM_ROUNDOFF

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from lagsim.language.arrays import Floats
    from lagsim.mechanics.equations import Equations


# Past the horizon the estimate exceeds this part of a coordinate's range.
LOST = 0.1
# How many times the growth is told at.
TIMES = 20


class Failed(str):
    """Reason why a repeat gave no error bar."""

    __slots__ = ()


class CoordinateError(NamedTuple):
    """The estimated error of one coordinate, in its unit and as a part of its range."""

    largest: float
    relative: float
    time: float


class ErrorBar(NamedTuple):
    """Error estimate of a run, from its repeat at a tighter tolerance.

    Attributes
    ----------
    method, rtol
        Of the repeat.
    names
        Of the coordinates and the first-order states, n in all.
    times : ndarray, shape (k,)
        Of the rows that were compared.
    errors : ndarray, shape (k, n)
        The estimates, in their units.
    scales : ndarray, shape (n,)
        The range of each, or what counts as one.
    still : ndarray, shape (n,)
        What moves less than this has no horizon; by default nothing.
    rates : ndarray or None
        The estimates for the velocities, a column a coordinate.
    repeated : dict
        Times, coordinates, velocities and states of the repeat, by the number of
        what was compared.
    parted : str
        How the two runs ended differently, if they did.
    rests : bool
        Nothing moves but by rounding.
    """

    method: str
    rtol: float | None
    names: tuple[str, ...]
    times: Floats
    errors: Floats
    scales: Floats
    still: Floats | None = None
    rates: Floats | None = None
    repeated: Mapping[int, Floats] = {}
    parted: str = ""
    rests: bool = False

    @property
    def parts(self) -> Floats:
        """The estimates as parts of the ranges (k, n)."""
        return _parts(self.errors, self.scales)

    @property
    def coordinates(self) -> dict[str, CoordinateError]:
        """The largest error of each coordinate and state, and when."""
        worst = np.argmax(self.errors, axis=0)
        largest, parts = self.errors, self.parts
        return {
            name: CoordinateError(
                float(largest[k, i]), float(parts[k, i]), float(self.times[k])
            )
            for i, (name, k) in enumerate(zip(self.names, worst, strict=True))
        }

    @property
    def relative(self) -> float:
        """The largest part of a range that any error reaches."""
        return float(np.max(self.parts, initial=0.0))

    @property
    def growth(self) -> list[tuple[float, float]]:
        """Times, and the largest part of a range that any error has reached by then."""
        reached = np.maximum.accumulate(np.max(self.parts, axis=1))
        last = len(self.times) - 1
        samples = sorted({-(-last * k // TIMES) for k in range(1, TIMES + 1)})
        return [(float(self.times[k]), float(reached[k])) for k in samples]

    def lost_by(self, errors: Floats) -> Floats:
        """Errors (n,) or (k, n) as parts of what can be lost."""
        still = 0.0 if self.still is None else self.still
        return _parts(errors, np.fmax(self.scales, still))

    @property
    def lost(self) -> Floats:
        """The largest error in each row (k,), as parts of what can be lost."""
        return np.asarray(np.max(self.lost_by(self.errors), axis=1))

    @property
    def horizon(self) -> float | None:
        """The first time at which an error exceeds the part LOST of its range."""
        lost = np.flatnonzero(self.lost > LOST)
        return float(self.times[lost[0]]) if len(lost) else None


def _parts(errors: Floats, scales: Floats) -> Floats:
    return np.divide(errors, scales, out=np.zeros_like(errors), where=scales > 0.0)


# --- Displacement of what rests: coordinates if nothing held them, what follows them
#
# See `mechanics.equations`. A coordinate that moves no farther than the rounding of its
# forces could take it is at rest.

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


def in_groups(labels: Sequence[int], roots: Floats, found: Floats) -> Floats:
    """`largest_beside` in each group of coordinates with one label."""
    whole = np.array(found)
    for label in sorted({k for i, k in enumerate(labels) if k != i}):
        group = np.array(labels) == label
        whole[group] = largest_beside(roots[group], found[group])
    return whole


def largest_beside(roots: Floats, found: Floats) -> Floats:
    """Return the largest of range_j min(1, root_j/root_i): by size, without n^2."""
    finite = np.where(np.isfinite(found) & np.isfinite(roots), found, 0.0)
    lightest = np.argsort(roots)
    whole = np.zeros(len(found))
    below = np.maximum.accumulate((finite * roots)[lightest])
    above = np.maximum.accumulate(finite[lightest][::-1])[::-1]
    own = roots[lightest]
    lighter = np.divide(below, own, out=np.zeros_like(below), where=own > 0.0)
    whole[lightest] = np.fmax(lighter, above)
    return whole
