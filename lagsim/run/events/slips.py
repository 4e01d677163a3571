"""The direction of a slip of two components that begins at rest.

Friction of size c turns a slow slip s d, of speed s and direction d of a mass m, into
the direction of its force at the rate c/(m s): the equations are stiff, and singular at
rest. But one motion from rest is
smooth in time: that on which the slip's acceleration across its direction is s d' from
the start (a slow manifold). The angles of d at the Chebyshev points of a time interval
are computed on this manifold by collocation, together with the states at these points,
for all slips that begin:

    e_i . r_i' = s_i phi_i',    r = s d the slip,  d = (cos phi, sin phi),  e = dd/dphi

by Newton's method. Its matrix c_j e_i D_ij e_j + (s_i' + s_i d/dt) contains the
Delassus matrix D of the start. The interval is halved until the series of the angles
converges to the tolerance and no mode ends within the interval. There the kernels
direct friction along the slip plus a floor times d(t) (`program/laws.py`). This sum
has the direction of the slip, but is not stiff.

Source: L. N. Trefethen, Spectral Methods in MATLAB, 2000, chapter 6 (differentiation);
E. Hairer and G. Wanner, Solving Ordinary Differential Equations II, 2nd ed., section
VI.3 (smooth solutions of singular perturbation problems).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lagsim.methods.parts.parameters import TURNS
from lagsim.run.events.times import SAMPLES, pulses
from lagsim.run.modes import TrialModes
from lagsim.tolerances import CLEAR_OF_ROUNDING, SUM_ROUNDOFF

if TYPE_CHECKING:
    from lagsim.language.arrays import Floats, Ints
    from lagsim.run.events.kinematics import Kinematics

# Length of the first interval, relative to the time in which forces change by as much
# as the friction.
STRETCH = 0.5
# First of the times at which pulses ahead are located, relative to the interval.
SOONEST = 1e-9
# Largest numbers of halvings of the interval and of Newton's steps.
HALVINGS = 8
SWEEPS = 12
# Floor that is large compared with every slip, so that d(t) alone determines the
# direction.
FAST = 1e100


class Beginning(NamedTuple):
    """The directions of P slips in the time interval in which they begin.

    Attributes
    ----------
    lasts : float
        The length of the interval.
    speeds : ndarray, shape (P,)
        The sliding speeds at the end of the interval.
    ways : ndarray, shape (1 + TURNS, 2 P)
        Coefficients of the polynomials of the directions, lowest power first, in the
        time since the start divided by `lasts`.
    """

    lasts: float
    speeds: Floats
    ways: Floats


def begin_slips(here: Kinematics, pairs: Ints, friction: Floats, steady: float) -> None:
    """Store the directions along which slips of two components begin.

    The directions are stored in the parameters of the kernels, and only where all
    directions are smooth and all speeds at the end of the interval reach the floors
    that are set.

    Parameters
    ----------
    here
        The laws at the start, whose modes and initial directions are set.
    pairs : ndarray of int, shape (P, 2)
        The numbers of the two laws of each slip.
    friction : ndarray, shape (P,)
        The size of each friction force.
    steady
        The time in which forces change by as much as friction.
    """
    lasts, p, rows = _longest(here, steady), here.arc.system.p, pairs.ravel()
    D = here.delassus_of_forces.D[np.ix_(rows, rows)]
    found = None
    for halvings in range(HALVINGS):
        with TrialModes(here.arc):
            p.law_floor[pairs] = FAST
            found = _collocated(here, pairs, friction, D, lasts * 0.5**halvings)
        if found is not None:
            break
    if found is None or (found.speeds < p.law_floor[pairs[:, 0]]).any():
        return
    p.law_begun[rows], p.law_lasts[rows] = here.t, found.lasts
    # Speed at which friction turns a slip within the interval, and no faster.
    p.law_floor[pairs] = (friction * _own(D) * found.lasts)[:, None]
    p.law_direction[rows] = -found.ways[0]
    p.law_turn.reshape(here.count, TURNS)[rows] = -found.ways[1:].T


def _longest(here: Kinematics, steady: float) -> float:
    """Return the length of the longest interval in which slips may be smooth.

    The interval ends at the next knot of a table of t or at the end of the run, after
    `STRETCH` of the time `steady`, or at half of the time to the next pulse of t,
    whichever comes first.

    here : all laws at the start of the slips.
    """
    p, t = here.arc.system.p, here.t
    times = [here.arc.settings.end, *p.knot_times[int(p.passed) : int(p.known)]]
    left = min(x for x in times if x > t)
    if steady < here.arc.settings.end - t:  # otherwise no change of forces is known
        left = min(left, t + STRETCH * steady)
    left = float(left - t)
    if here.arc.system.timed:
        # Half of the time to the next pulse.
        ahead = np.append(0.0, np.geomspace(SOONEST, 2.0, SAMPLES))
        while found := pulses(here.arc, t + left * ahead):
            left = 0.5 * (found[0] - t)
    return left


def _collocated(
    here: Kinematics, pairs: Ints, friction: Floats, D: Floats, lasts: float
) -> Beginning | None:
    """Compute the slips on a time interval by collocation.

    None where the iteration does not converge on the interval, the directions are not
    smooth or another mode ends in it.

    Parameters
    ----------
    here
        The laws at the start.
    pairs : ndarray of int, shape (P, 2)
        The numbers of the two laws of each slip.
    friction : ndarray, shape (P,)
        The size of each friction force.
    D : ndarray, shape (2 P, 2 P)
        The Delassus matrix of the laws in `pairs`.
    lasts
        The length of the interval.
    """
    arc, p, count = here.arc, here.arc.system.p, len(pairs)
    nodes, d, turn = _points()
    d, turn = d / lasts, turn / lasts
    integral = np.linalg.inv(d[1:, 1:])
    size, n, m = arc.system.size, arc.system.n, arc.system.m
    geometry = arc.runner.function("geometry", (n + m) * n + 4 * m)
    first = (n + m) * n + m + m - here.count
    times = here.t + lasts * nodes
    start = -p.law_direction[pairs]
    phi = np.tile(np.arctan2(start[:, 1], start[:, 0]), (len(nodes), 1))
    straight = np.tile(here.y, (len(nodes), 1))
    straight[:, arc.state.positions] += np.outer(lasts * nodes, here.y[arc.velocities])
    states = straight
    rates, slip = np.empty((len(nodes), size)), np.empty((len(nodes), count, 2))
    tolerance = float(arc.plan.tolerance)
    # Rounding of states: the friction of each slip rounds, also where the sum cancels.
    pushed = np.abs(here.delassus_of_forces.response[:, pairs.ravel()]) @ np.repeat(
        friction, 2
    )
    rounding = SUM_ROUNDOFF * here.magnitudes
    rounding[arc.velocities] += SUM_ROUNDOFF * lasts * pushed
    rounding[arc.state.positions] += SUM_ROUNDOFF * lasts**2 * pushed
    for _ in range(SWEEPS):
        along = np.stack([np.cos(phi), np.sin(phi)], axis=-1)
        across = np.stack([-along[..., 1], along[..., 0]], axis=-1)
        for i, t in enumerate(times):
            p.law_direction[pairs] = -along[i]
            rates[i] = arc.rates(t, states[i])
        former, states = states, here.y + integral @ rates
        for i, t in enumerate(times):
            slip[i] = geometry(t, states[i])[first:][pairs]
        change = np.einsum("ij,jpk->ipk", d[1:, 1:], slip)
        speed, gain = (np.einsum("ipk,ipk->ip", along, x) for x in (slip, change))
        missing = np.einsum("ipk,ipk->ip", across, change) - speed * (turn @ phi)
        step = _newton_step(turn, speed, gain, across, friction, D, missing)
        if not np.isfinite(step).all():
            return None
        phi = phi + step
        turned = friction * lasts * _own(D)
        least = tolerance * speed[-1] / turned + SUM_ROUNDOFF
        rounded = CLEAR_OF_ROUNDING * here.still[pairs].max(axis=1) / turned
        # Positions, on which forces depend, change one sweep later than velocities.
        near = tolerance * np.abs(states - straight).max(axis=0) + rounding
        if (np.abs(states - former).max(axis=0) <= near).all() and (
            np.abs(step).max(axis=0) <= 0.1 * least + rounded
        ).all():
            break
    else:
        return None
    if (speed <= 0.0).any() or not _is_smooth(phi, nodes, least + rounded):
        return None
    if not all(_lasts(here, pairs, t, y) for t, y in zip(times, states, strict=True)):
        return None
    powers = np.vander(nodes, increasing=True)
    along = np.stack([np.cos(phi), np.sin(phi)], axis=-1)
    ways = np.linalg.solve(powers, along.reshape(len(nodes), -1))
    return Beginning(lasts, speed[-1], ways)


def _points() -> tuple[Floats, Floats, Floats]:
    """Return Chebyshev points in (0, 1] and two matrices of derivatives on them.

    Returns
    -------
    points : ndarray, shape (K,)
        The Chebyshev points of [0, 1] without 0; K = 1 + TURNS.
    with_start : ndarray, shape (K + 1, K + 1)
        Derivatives of polynomials given at 0 and at the points.
    without_start : ndarray, shape (K, K)
        Derivatives of polynomials given at the points alone.
    """
    x = 0.5 * (1.0 - np.cos(np.pi * np.arange(TURNS + 2) / (TURNS + 1)))
    return x[1:], _derivative(x), _derivative(x[1:])


def _derivative(x: Floats) -> Floats:
    """Return the matrix (K, K) of derivatives of polynomials given at points x (K,)."""
    apart = x[:, None] - x + np.eye(len(x))
    weights = 1.0 / apart.prod(axis=1)
    d = weights / weights[:, None] / apart
    np.fill_diagonal(d, 0.0)
    return np.asarray(d - np.diag(d.sum(axis=1)))


def _own(D: Floats) -> Floats:
    """Return the largest acceleration (P,) of each slip by a unit friction force.

    It is the larger diagonal element of the slip's block of D (2 P, 2 P), the Delassus
    matrix of both components of P slips.
    """
    return np.asarray(np.diag(D).reshape(-1, 2).max(axis=1))


def _newton_step(
    d: Floats, speed: Floats, gain: Floats, across: Floats, friction: Floats,
    D: Floats, missing: Floats,
) -> Floats:  # fmt: skip
    """Solve for Newton's step of the angles, shape (K, P), at K points of P slips.

    Parameters
    ----------
    d : ndarray, shape (K, K)
        The differentiation matrix of the points.
    speed, gain : ndarray, shape (K, P)
        Sliding speeds and their derivatives with respect to time.
    across : ndarray, shape (K, P, 2)
        Unit vectors perpendicular to the slips.
    friction : ndarray, shape (P,)
        The size of each friction force.
    D : ndarray, shape (2 P, 2 P)
        The Delassus matrix.
    missing : ndarray, shape (K, P)
        Residuals of the equations of the angles.
    """
    nodes, count = speed.shape
    blocks = D.reshape(count, 2, count, 2)
    turns = np.einsum("ipa,paqb,iqb,q->ipq", across, blocks, across, friction)
    whole = np.zeros((nodes, count, nodes, count))
    for i in range(nodes):
        whole[i, :, i, :] += turns[i] + np.diag(gain[i])
        for k in range(count):
            whole[i, k, :, k] += speed[i, k] * d[i]
    matrix = whole.reshape(nodes * count, -1)
    step = np.linalg.lstsq(matrix, missing.ravel(), rcond=None)[0]
    return np.asarray(step.reshape(nodes, count))


def _is_smooth(phi: Floats, nodes: Floats, least: Floats) -> bool:
    """Whether the last two terms of the Chebyshev series of the angles are small.

    phi : ndarray, shape (K, P), the angles of P slips.
    nodes : ndarray, shape (K,), the points in (0, 1] at which they are known.
    least : ndarray, shape (P,), the largest sum of the terms of each angle.
    """
    terms = np.cos(np.outer(np.arccos(1.0 - 2.0 * nodes), np.arange(len(nodes))))
    series = np.linalg.solve(terms, phi)
    return bool((np.abs(series[-2:]).sum(axis=0) <= least).all())


def _lasts(here: Kinematics, pairs: Ints, t: float, y: Floats) -> bool:
    """Whether all modes, except of slips in `pairs`, last at time t and state y.

    here : all laws at the start of the slips.
    """
    events = here.arc.runner.event_functions
    left, slack = events(t, y), 2.0 * np.minimum(events(here.t, here.y), 0.0)
    left[here.arc.system.surfaces + pairs] = 0.0
    return bool((left >= slack).all())
