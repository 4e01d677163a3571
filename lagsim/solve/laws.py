"""The motion where rows hold at times: contacts, friction, limits.

Each law has a row after those of the equalities, and a mode. Of those that hold

    M q'' = f + sum_h (A_h^T + sum_s c_s A_s^T) lambda_h + sum_l c_l A_l^T
    A_h q'' = b_h

where a slip s that slides takes the part c_s of its contact's multiplier, against its
velocity, and a limited row l its bound. What slides makes the equations unsymmetric;
they are small, dense, and solved by elimination with pivoting. The rows that hold are
independent: who sets the modes sees to it.

Source: F. Pfeiffer and C. Glocker, Multibody Dynamics with Unilateral Contacts, 1996,
chapter 5.
"""

from __future__ import annotations

from math import sqrt
from typing import TYPE_CHECKING

from lagsim.methods.parts.parameters import (
    DRIVEN,
    FREEWHEEL,
    HELD,
    IMPLIED,
    LIMITED,
    SLIP,
    Parameters,
)
from lagsim.native.kernels.words import at, external
from lagsim.solve._cholesky import augment_force, backward, factor, forward
from lagsim.solve._pushes import couple, impress, share_out, solve
from lagsim.solve._shares import share
from lagsim.solve.dense import gather

if TYPE_CHECKING:
    from lagsim.language.arrays import Floats

# What reflections leave of a vector, in units of the roundoff of its norm.
REFLECTED = 4.0
# The margin of what has no end of its own.
ENDLESS = 1.0
# A slip on a disc has begun where it is so many times as fast as its floor.
BEGUN = 16.0
# The cosine up to which its way turns before it is noted anew: what turns by more than
# a right angle in a step has stopped.
TURNED = 0.5


@external
def dynamics(t: float, y: Floats, p: Parameters, out: Floats) -> None:
    """Give M (n, n), A (m, n), f (n,), b (m,), then of each law its speed.

    And the bound while it slides, and while it sticks (3 L,).
    """


@external
def quadratures(t: float, y: Floats, p: Parameters, out: Floats) -> None:
    """Give the rates of what follows the velocities, from q'' and lambda in p."""


@external
def geometry(t: float, y: Floats, p: Parameters, out: Floats) -> None:
    """Give M (n, n), A (m, n), residuals, rates, and the scales of both (4 m,)."""


@external
def bends(t: float, y: Floats, p: Parameters, out: Floats) -> None:
    """Give what Newton steps leave; y holds them in the place of the velocities.

    Against their scales: of the residuals (m,) and of the rates (m,).
    """


@external
def loads(t: float, y: Floats, p: Parameters, out: Floats) -> None:
    """Give the rounding of the forces (n,), and of the rates that follow."""


@external
def gaps(t: float, y: Floats, p: Parameters, out: Floats) -> None:
    """Give of each law (L,) the gap, or the speed of what has none."""


def field(t: float, y: Floats, p: Parameters, out: Floats) -> None:
    """Give y' (size,) and lambda (m,)."""
    n, motion, multipliers = p.n, p.motion, p.multipliers
    solve_motion(t, y, p)
    for i in range(n):
        out[i] = y[n + i]
        out[n + i] = motion[i]
    if p.size > 2 * n:
        quadratures(t, y, p, at(out, 2 * n))
    for i in range(p.m):
        out[p.size + i] = multipliers[i]
    if p.law_shares > 0.0:
        share(p, at(out, p.size))


def rounding(t: float, y: Floats, p: Parameters, out: Floats) -> None:
    """Give what rounding does to q'' (n,), and that of other rates; see `dense`."""
    n, m, motion, A, f, b = p.n, p.m, p.motion, p.A, p.f, p.b
    first = m - p.laws
    mode = p.law_mode
    reaction = at(out, p.size)
    solve_motion(t, y, p)
    for k in range(first, m):
        if mode[k - first] != HELD:
            for j in range(n):
                A[k * n + j] = 0.0
    gather(p, reaction)
    loads(t, y, p, out)
    for i in range(n):
        f[i] = out[i]
    for k in range(m):
        b[k] = 0.0
    hold(p)
    respond(p)
    for i in range(n):
        out[i] = abs(motion[i]) + REFLECTED * reaction[i]


def position_step(t: float, y: Floats, p: Parameters, out: Floats) -> None:
    """Give the least change (n,) in the metric of M that removes the residuals.

    Then the largest residual against its scale, 0, and what the change leaves, (3,).
    """
    geometry(t, y, p, p.terms)
    correction(p, p.gaps, p.gap_scales, out)
    out[p.n + 1] = 0.0
    out[p.n + 2] = left_over(0, t, y, p, out)


def velocity_step(t: float, y: Floats, p: Parameters, out: Floats) -> None:
    """Give the same for the velocities and the rates, with 1 instead of 0."""
    geometry(t, y, p, p.terms)
    correction(p, p.gap_rates, p.rate_scales, out)
    out[p.n + 1] = 1.0
    out[p.n + 2] = left_over(p.m, t, y, p, out)


def correction(p: Parameters, residuals: Floats, scales: Floats, out: Floats) -> None:
    """Give -M^-1 A^T S^-1 residuals (n,), and the largest against its scale (1,)."""
    n, order, right, u = p.n, p.order, p.w, p.u
    hold(p)
    largest = 0.0
    count = int(p.ranked)
    for k in range(count):
        i = int(order[k])
        right[k] = -residuals[i]
        if scales[i] > 0.0:
            largest = max(largest, abs(residuals[i]) / scales[i])
    for j in range(n):
        u[j] = 0.0
    couple(p, 0)
    solve(count, p.S, right)
    impress(p, 0)
    backward(n, p.L, u, out)
    out[n] = largest


def left_over(first: int, t: float, y: Floats, p: Parameters, step: Floats) -> float:
    """Give what a Newton step leaves of the residuals, or of the rates."""
    n, z, left, order = p.n, p.tried, p.left, p.order
    for i in range(n):
        z[i] = y[i]
        z[n + i] = step[i]
    bends(t, z, p, left)
    largest = 0.0
    for k in range(int(p.ranked)):
        largest = max(largest, left[first + int(order[k])])
    return largest


def solve_motion(t: float, y: Floats, p: Parameters) -> None:
    """Leave q'' (n,) and lambda (m,) as the motion."""
    dynamics(t, y, p, p.terms)
    if p.augmented > 0.0:
        augment_force(p)
    hold(p)
    drive(p)
    respond(p)


def hold(p: Parameters) -> None:
    """Factor M, and list the rows that hold."""
    first = p.m - p.laws
    order, mode, aside = p.order, p.law_mode, p.aside
    count = 0
    for k in range(p.m):
        holds = aside[k] == 0.0 if k < first else mode[k - first] == HELD
        if holds:
            order[count] = k
            count += 1
    p.ranked = count
    if p.factored < 1.0:
        factor(p)
    p.factored = min(p.constant, 1.0)


def drive(p: Parameters) -> None:
    """Note what slides, and add the forces of limited rows that do."""
    n = p.n
    first = p.m - p.laws
    mode, way, floor, part = p.law_mode, p.law_way, p.law_floor, p.law_part
    pair, speeds, bounds = p.law_pair, p.law_speeds, p.law_bounds
    statics, A, f = p.law_statics, p.A, p.f
    for k in range(p.laws):
        part[k] = 0.0
        if mode[k] == IMPLIED:
            # Where it has a way: at its bound, and kept there by the others.
            part[k] = way[k] * statics[k]
        if mode[k] == DRIVEN:
            part[k] = way[k] * bounds[k]
            other = int(pair[k])
            if other >= 0:
                x = speeds[k] - floor[k] * way[k]
                z = speeds[other] - floor[k] * way[other]
                speed = sqrt(x * x + z * z)
                if speed > 0.0:
                    part[k] = -bounds[k] * x / speed
                if x * way[k] + z * way[other] > 0.0:
                    # Past its stop in a step that is to end there: as before it.
                    part[k] = -part[k]
        if p.law_kind[k] == LIMITED and part[k] != 0.0:
            row = at(A, (first + k) * n)
            for j in range(n):
                f[j] += part[k] * row[j]


def respond(p: Parameters) -> None:
    """Solve for q'' and lambda: the terms are there, and what slides is noted."""
    n, A, b, f, L, u, v, motion = p.n, p.A, p.b, p.f, p.L, p.u, p.v, p.motion
    order, right = p.order, p.w
    for j in range(n):
        v[j] = f[j]
    forward(n, L, v)
    for j in range(n):
        u[j] = v[j]
    backward(n, L, u, motion)
    count = int(p.ranked)
    for k in range(count):
        i = int(order[k])
        right[k] = b[i]
        for j in range(n):
            right[k] -= A[i * n + j] * motion[j]
    couple(p, 1)
    solve(count, p.S, right)
    for j in range(n):
        u[j] = v[j]
    impress(p, 1)
    share_out(p)
    backward(n, L, u, motion)


def law_margins(t: float, y: Floats, p: Parameters, out: Floats) -> None:
    """Give how far each law is from the end of its mode (L,): below 0 it is over."""
    mode = p.law_mode
    if p.law_forces > 0.0:
        solve_motion(t, y, p)
    gaps(t, y, p, out)
    for k in range(p.laws):
        if mode[k] == HELD:
            out[k] = hold_left(p, k)
        elif mode[k] == DRIVEN:
            out[k] = slide_left(p, k, out[k])
        elif mode[k] == IMPLIED or not is_one_sided(p, k):
            out[k] = ENDLESS


def is_one_sided(p: Parameters, k: int) -> bool:
    """Tell whether a law's multiplier pushes and does not pull."""
    kind = p.law_kind
    # These two are the first kinds.
    return float(kind[k]) <= FREEWHEEL


def hold_left(p: Parameters, k: int) -> float:
    """Give how much less, or more, a row that holds could bear."""
    kind, lam, statics = p.law_kind, p.multipliers, p.law_statics
    i = p.m - p.laws + k
    if is_one_sided(p, k):
        return float(lam[i])
    if kind[k] == LIMITED:
        return float(statics[k] - abs(lam[i]))
    return grip(p, k) if kind[k] == SLIP else ENDLESS


def slide_left(p: Parameters, k: int, speed: float) -> float:
    """Give how fast something slides; two slips together, of which one tells.

    Until their way has turned, and has to be noted anew. Of those that begin, how much
    they are below what they begin with, and forward.
    """
    speeds, pair, way, still = p.law_speeds, p.law_pair, p.law_way, p.law_still
    other = int(pair[k])
    if other < 0:
        return float(-way[k] * speed)
    if other < k:
        return ENDLESS
    x = speeds[k]
    z = speeds[other]
    speed = sqrt(x * x + z * z)
    ahead = -(way[k] * x + way[other] * z)
    if p.law_floor[k] > 0.0:
        return float(min(BEGUN * p.law_floor[k] - speed, ahead))
    if ahead < 0.0:
        return float(-speed)
    return float(min(speed - still[k], ahead - TURNED * speed))


def grip(p: Parameters, k: int) -> float:
    """Give how much more a slip that sticks could bear; of two the first one tells."""
    first = p.m - p.laws
    lam, pair, normal, statics = p.multipliers, p.law_pair, p.law_normal, p.law_statics
    other = int(pair[k])
    held = statics[k] * lam[first + int(normal[k])]
    if other < 0:
        return float(held - abs(lam[first + k]))
    if other < k and p.law_mode[other] == HELD:
        return ENDLESS
    x = lam[first + k]
    z = lam[first + other]
    return float(held - sqrt(x * x + z * z))
