"""Error estimate of a run by a repeat; displacement of bodies at rest by rounding."""

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
# Number of times at which the growth of the error is reported.
TIMES = 20


class Failed(str):
    """Reason, as text, why a repeat of a run provided no error estimate."""

    __slots__ = ()


class CoordinateError(NamedTuple):
    """Largest estimated error of one coordinate or state, and its time.

    `largest` is in the unit of the coordinate, `relative` is a part of its range.
    """

    largest: float
    relative: float
    time: float


class ErrorBar(NamedTuple):
    """Error estimate of a run, from its repeat at a tighter tolerance.

    Attributes
    ----------
    method, rtol
        Method and relative tolerance of the repeat.
    names
        Names of the coordinates and the first-order states, n in all.
    times : ndarray, shape (k,)
        Times of the compared rows.
    errors : ndarray, shape (k, n)
        Error estimates, in the units of the coordinates and states.
    scales : ndarray, shape (n,)
        Range of each coordinate and state, or a substitute of its range.
    still : ndarray, shape (n,), or None
        Displacements by rounding, below which motion has no horizon; None for zeros.
    rates : ndarray or None
        Error estimates of the velocities, one column per coordinate.
    repeated : dict
        Times, coordinates, velocities and states of the repeat, by the index of the
        compared row.
    parted : str
        Difference between the ends of the two runs; empty if they ended alike.
    rests : bool
        Whether the model rests: all motion is by rounding.
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
        """Error estimates as parts of the ranges (k, n)."""
        return _parts(self.errors, self.scales)

    @property
    def coordinates(self) -> dict[str, CoordinateError]:
        """Largest error of each coordinate and state, and its time."""
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
        """Largest error as a part of its range, over all coordinates and times."""
        return float(np.max(self.parts, initial=0.0))

    @property
    def growth(self) -> list[tuple[float, float]]:
        """Pairs (time, error): the largest relative error up to each of some times.

        The largest is over all coordinates and states.
        """
        reached = np.maximum.accumulate(np.max(self.parts, axis=1))
        last = len(self.times) - 1
        samples = sorted({-(-last * k // TIMES) for k in range(1, TIMES + 1)})
        return [(float(self.times[k]), float(reached[k])) for k in samples]

    def lost_by(self, errors: Floats) -> Floats:
        """Return errors (n,) or (k, n) divided by the larger of range and `still`.

        `still` is the displacement by rounding, below which a component counts as at
        rest.

        errors : in the units of the coordinates and states.
        """
        still = 0.0 if self.still is None else self.still
        return _parts(errors, np.fmax(self.scales, still))

    @property
    def lost(self) -> Floats:
        """Largest error in each row (k,), relative as in `lost_by`."""
        return np.asarray(np.max(self.lost_by(self.errors), axis=1))

    @property
    def horizon(self) -> float | None:
        """First time at which an error exceeds the part LOST of its range, or None."""
        lost = np.flatnonzero(self.lost > LOST)
        return float(self.times[lost[0]]) if len(lost) else None


def _parts(errors: Floats, scales: Floats) -> Floats:
    return np.divide(errors, scales, out=np.zeros_like(errors), where=scales > 0.0)


# --- Displacement of coordinates at rest by roundoff, and of states that follow them
#
# See `mechanics.equations`. A coordinate that moves no farther than the rounding of its
# forces could take it is at rest.

# Largest number of rows at which forces are evaluated, and of operations for these.
MOST_ROWS = 64
MOST_OPERATIONS = 2e5
# A coordinate is at rest if it moves no farther than this multiple of the displacement
# that rounding could cause.
HIGHER = 16.0


class Held(NamedTuple):
    """Forces on coordinates, and the displacements that these forces would cause.

    Attributes
    ----------
    forces : ndarray, shape (n,)
        The largest force on each coordinate.
    reach : ndarray, shape (n,)
        The largest displacement of each coordinate by this force.
    """

    forces: Floats
    reach: Floats

    @property
    def displacement(self) -> Floats:
        """Displacements (n,) by rounding errors of bodies whose forces balance."""
        return np.asarray(SUM_ROUNDOFF * self.reach)


def could_push(
    equations: Equations,
    rows: Floats,
    which: Sequence[int],
    step: float,
    reactions: Floats | None = None,
    ranges: Floats | None = None,
) -> Held:
    """Return the largest forces on coordinates at rest, and possible displacements.

    A force here is the sum of the magnitudes of its terms and intermediate results,
    whose rounding errors could move a coordinate. The displacement is computed for a
    force that acts during the whole motion; during 1/w for an elastic force with the
    frequency w; and for a coordinate that moves only by constraints, during the time
    between two projections, which remove the rounding errors.

    Parameters
    ----------
    equations : Equations
        Complete equations of motion.
    rows : ndarray, shape (k, 1 + 2 n)
        Times, coordinates and velocities.
    which
        Indices of the coordinates; displacements of all others are 0.
    step
        Longest time between two projections.
    reactions : ndarray, shape (n,), optional
        Largest constraint forces on the coordinates, if known.
    ranges : ndarray, shape (n,), optional
        Ranges of motion: coordinates that move by more than HIGHER times the effect of
        rounding have the displacement 0.
    """
    e, g, n = equations, equations.graph, len(equations.q)
    state = e.moving
    reacting = g.dependent(e.f, (*e.multipliers, *e.accelerations))
    known = [f for f in e.f if f not in reacting]
    of_frames = e.known_roundings(state)
    found = roundings(g, known, state, known=of_frames)
    bounds = dict(zip(known, found, strict=True))
    sizes = zip(pushes(e), (bounds.get(f, g.zero) for f in e.f), strict=False)
    nodes = [*(g.call("add", *pair) for pair in sizes), *e.inertias]
    most = max(1, min(MOST_ROWS, int(MOST_OPERATIONS / len(g.cone(nodes)))))
    sampled = rows[:: -(-len(rows) // most)]
    names = ("t", *e.state)
    values: dict[str, float | Floats] = {p.name: p.value for p in e.model.parameters}
    values |= dict(zip(names, sampled.T, strict=True))
    sized = np.abs(evaluate_rows(g, nodes, values, len(sampled)))
    forces, inertias = sized[:n], sized[n:]
    if reactions is not None:
        forces = np.fmax(forces, reactions[:, None])
    pulled = _most(forces, inertias)
    chosen, time = np.array(which, int), float(np.ptp(rows[:, 0]))
    labels = joined(n, [A.entries for A in e.slopes])
    roots = np.sqrt(np.max(inertias, axis=1, initial=0.0))
    pushed = in_groups(labels, roots, pulled)
    if ranges is not None:
        farthest = np.fmax(pulled[chosen] * time * time, pushed[chosen] * step * step)
        chosen = chosen[ranges[chosen] <= HIGHER * SUM_ROUNDOFF * farthest]
    # A coordinate held by a force of this slope moves no farther than in the time 1/w.
    slopes = [gradient(g, e.f[i], [g.variable(e.q[i])])[0] for i in chosen]
    stiffness = np.abs(evaluate_rows(g, slopes, values, len(sampled)))
    own, linked = np.zeros(n), np.zeros(n)
    stiff = time * time * _most(stiffness, inertias[chosen])
    own[chosen] = pulled[chosen] * time * time / np.fmax(stiff, 1.0)
    linked[chosen] = pushed[chosen] * step * step
    return Held(np.max(forces, axis=1, initial=0.0), np.fmax(own, linked))


def could_follow(equations: Equations, rows: Floats, reach: Floats) -> Floats:
    """Return displacements (l,) of first-order states that follow coordinates.

    The displacements are reached during the whole motion, or during the time constant
    of a state.

    Parameters
    ----------
    equations : Equations
        Complete equations of motion.
    rows : ndarray, shape (k, 1 + 2 n + l)
        Times, coordinates, velocities and states.
    reach : ndarray, shape (n,)
        Displacements of the coordinates.
    """
    e, g, n = equations, equations.graph, len(equations.q)
    variables = [g.variable(name) for name in e.state]
    nodes = [slope for x in e.states for slope in gradient(g, x.rate, variables)]
    sampled = rows[:: -(-len(rows) // MOST_ROWS)]
    values: dict[str, float | Floats] = {p.name: p.value for p in e.model.parameters}
    values |= dict(zip(("t", *e.state), sampled.T, strict=True))
    found = np.abs(evaluate_rows(g, nodes, values, len(sampled)))
    slopes = np.max(found, axis=1).reshape(len(e.states), len(variables))
    time = float(np.ptp(rows[:, 0]))
    own = slopes[:, 2 * n :].diagonal().copy()
    slopes[:, 2 * n :][np.diag_indices(len(own))] = 0.0
    displacements = np.concatenate([reach, reach / time, np.zeros(len(own))])
    for _ in e.states:
        displacements[2 * n :] = slopes @ displacements / np.fmax(own, 1.0 / time)
    return displacements[2 * n :]


def _most(sizes: Floats, inertias: Floats) -> Floats:
    """Return the largest finite quotient in each row of sizes/inertias, shape (k,).

    0 where no quotient is finite.

    sizes, inertias : shapes that broadcast to (k, columns).
    """
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        found = sizes / inertias
    return np.asarray(
        np.max(np.where(np.isfinite(found), found, 0.0), axis=1, initial=0.0)
    )


def in_groups(labels: Sequence[int], roots: Floats, found: Floats) -> Floats:
    """Return the displacements (n,) that bodies in a group can pass on to each other.

    Coordinates with one label are a group; for each group see `largest_beside`.

    Parameters
    ----------
    labels : sequence of int, length n
        Label of the group of each coordinate.
    roots, found : ndarray, shape (n,)
        See `largest_beside`.
    """
    whole = np.array(found)
    for label in sorted({k for i, k in enumerate(labels) if k != i}):
        group = np.array(labels) == label
        whole[group] = largest_beside(roots[group], found[group])
    return whole


def largest_beside(roots: Floats, found: Floats) -> Floats:
    """Return max over j of found_j min(1, roots_j/roots_i) for each coordinate i, (n,).

    It bounds the displacement of coordinate i by the displacement of another one: a
    heavier body moves a lighter one as far as itself, and a lighter body moves a
    heavier one in the ratio of the roots of their inertias. Computed by sorting.

    Parameters
    ----------
    roots, found : ndarray, shape (n,)
        Square roots of the inertias; displacements or accelerations of the coordinates.
    """
    finite = np.where(np.isfinite(found) & np.isfinite(roots), found, 0.0)
    lightest = np.argsort(roots)
    whole = np.zeros(len(found))
    below = np.maximum.accumulate((finite * roots)[lightest])
    above = np.maximum.accumulate(finite[lightest][::-1])[::-1]
    own = roots[lightest]
    lighter = np.divide(below, own, out=np.zeros_like(below), where=own > 0.0)
    whole[lightest] = np.fmax(lighter, above)
    return whole
