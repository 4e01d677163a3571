"""The direction of a slip of two components that begins at rest.

Friction of size c turns a slow slip s d into the direction of its force at the rate
c/(m s): stiff, and without a limit at rest. But one motion from there is smooth in the
time, that on which the slip's acceleration across its direction is s d' from the start
(a slow manifold). The angles of d at Chebyshev points of a stretch of time are found on
it by collocation, together with the states there, for all slips that begin:

    e_i . r_i' = s_i phi_i',    r = s d the slip,  d = (cos phi, sin phi),  e = dd/dphi

by Newton's steps of which the matrix, c_j e_i D_ij e_j + (s_i' + s_i d/dt), has the
Delassus matrix D of the start. The stretch is halved until its series converges to the
tolerance and no mode ends in it. In it kernels take friction along the slip plus a
floor times d(t) (`program/laws.py`), which is the same direction, but not stiff.

Source: L. N. Trefethen, Spectral Methods in MATLAB, 2000, chapter 6 (differentiation);
E. Hairer and G. Wanner, Solving Ordinary Differential Equations II, 2nd ed., section
VI.3 (smooth solutions of singular perturbation problems).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lagsim.methods.parts.parameters import TURNS
from lagsim.run.events.times import SAMPLES, pulses
from lagsim.tolerances import CLEAR_OF_ROUNDING, SUM_ROUNDOFF

if TYPE_CHECKING:
    from lagsim.language.arrays import Floats, Ints
    from lagsim.run.events.kinematics import Kinematics

# The first stretch, in parts of the time in which forces change by as much as friction;
# how often it is halved; and Newton's steps.
STRETCH = 0.5
# The first of the times at which a pulse ahead is looked for, in stretches.
SOONEST = 1e-9
HALVINGS = 8
SWEEPS = 12
# A slip without a speed: what is added to it alone gives its direction.
FAST = 1e100


class Beginning(NamedTuple):
    """A stretch of time, the speeds (P,) at its end, and directions (1 + TURNS, 2P).

    These are polynomials in parts of the time.
    """

    lasts: float
    speeds: Floats
    ways: Floats


def begin_slips(here: Kinematics, pairs: Ints, friction: Floats, steady: float) -> None:
    """Set the ways along which slips of two rows each, pairs (P, 2), begin.

    Only where they are smooth, and faster by their end than the floors that are set.

    friction : (P,), its size; steady : the time in which forces change. The modes are
    set, with the directions at the start.
    """
    lasts, p, rows = _longest(here, steady), here.arc.system.p, pairs.ravel()
    D = here.answer.D[np.ix_(rows, rows)]
    directions, floors, found = p.law_direction.copy(), p.law_floor.copy(), None
    p.law_floor[pairs] = FAST
    try:
        for halvings in range(HALVINGS):
            p.law_direction[:] = directions
            found = _collocated(here, pairs, friction, D, lasts * 0.5**halvings)
            if found is not None:
                break
    finally:
        p.law_direction[:], p.law_floor[:] = directions, floors
    if found is None or (found.speeds < floors[pairs[:, 0]]).any():
        return
    p.law_begun[rows], p.law_lasts[rows] = here.t, found.lasts
    # Speeds of which friction turns the slip no faster than in that time.
    p.law_floor[pairs] = (friction * _own(D) * found.lasts)[:, None]
    p.law_direction[rows] = -found.ways[0]
    p.law_turn.reshape(here.count, TURNS)[rows] = -found.ways[1:].T


def _longest(here: Kinematics, steady: float) -> float:
    """Longest stretch: up to where the time alone changes something, or to the end."""
    p, t = here.arc.system.p, here.t
    times = [here.arc.settings.end, *p.knot_times[int(p.passed) : int(p.known)]]
    left = min(x for x in times if x > t)
    if steady < here.arc.settings.end - t:  # else nothing changes as far as is seen
        left = min(left, t + STRETCH * steady)
    left = float(left - t)
    if here.arc.system.timed:
        # A pulse may come soon: up to half of the way to it.
        ahead = np.append(0.0, np.geomspace(SOONEST, 2.0, SAMPLES))
        while found := pulses(here.arc, t + left * ahead):
            left = 0.5 * (found[0] - t)
    return left


def _collocated(
    here: Kinematics, pairs: Ints, friction: Floats, D: Floats, lasts: float
) -> Beginning | None:
    """Slips on a stretch of time, if they converge on it."""
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
        # Forces follow the places, which begin to move a sweep after the speeds.
        near = (
            tolerance * np.abs(states - straight).max(axis=0) + SUM_ROUNDOFF * here.seen
        )
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
    """Points (K,) of (0, 1], derivatives at 0 and there, and by the points alone.

    Those at 0 and there are Chebyshev's; K = 1 + TURNS.
    """
    x = 0.5 * (1.0 - np.cos(np.pi * np.arange(TURNS + 2) / (TURNS + 1)))
    return x[1:], _derivative(x), _derivative(x[1:])


def _derivative(x: Floats) -> Floats:
    """Matrix (K, K) of the derivatives of polynomials at their points (K,)."""
    apart = x[:, None] - x + np.eye(len(x))
    weights = 1.0 / apart.prod(axis=1)
    d = weights / weights[:, None] / apart
    np.fill_diagonal(d, 0.0)
    return np.asarray(d - np.diag(d.sum(axis=1)))


def _own(D: Floats) -> Floats:
    """Largest acceleration (P,) of each slip by its own unit of friction."""
    return np.asarray(np.diag(D).reshape(-1, 2).max(axis=1))


def _newton_step(
    d: Floats, speed: Floats, gain: Floats, across: Floats, friction: Floats,
    D: Floats, missing: Floats,
) -> Floats:  # fmt: skip
    """Solve for changes of the angles (K, P) by which nothing is missing."""
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
    """Whether the last terms of the angles' Chebyshev series are small."""
    terms = np.cos(np.outer(np.arccos(1.0 - 2.0 * nodes), np.arange(len(nodes))))
    series = np.linalg.solve(terms, phi)
    return bool((np.abs(series[-2:]).sum(axis=0) <= least).all())


def _lasts(here: Kinematics, pairs: Ints, t: float, y: Floats) -> bool:
    """Whether all other modes still last at t and y."""
    events = here.arc.runner.event_functions
    left, slack = events(t, y), 2.0 * np.minimum(events(here.t, here.y), 0.0)
    left[here.arc.system.surfaces + pairs] = 0.0
    return bool((left >= slack).all())
