"""The motion where rows hold at times: contacts, friction, limits.

Each law has a row after those of the equalities, and a mode. Of those that hold

    M q'' = f + sum_h (A_h^T + sum_s c_s A_s^T) lambda_h + sum_l c_l A_l^T
    A_h q'' = b_h

where a slip s that slides takes the part c_s of its contact's multiplier, against its
velocity, and a limited row l its bound. What slides makes the equations unsymmetric;
they are small, dense, and solved by elimination with pivoting. The rows that hold are
independent: who sets the modes sees to it.

Contacts that hold a body more often than they must share its weight with the least norm
of all multipliers: the forces of those that hold, A_h^T lambda_h, are known, and of all
multipliers of what touches, A, that give these, those of least norm are A A_h^T y with

    (A_h A^T A A_h^T) y = A_h A_h^T lambda_h

and the coordinates in units of the rows' elements. What would pull most is left out,
and again. Where friction is bounded by them the multipliers stay as they were found.

Source: F. Pfeiffer and C. Glocker, Multibody Dynamics with Unilateral Contacts, 1996,
chapter 5.
"""

from __future__ import annotations

from math import nan, sqrt
from typing import TYPE_CHECKING

from lagsim.methods.parts.newton import decompose, solve
from lagsim.methods.parts.parameters import (
    CONTACT,
    FREEWHEEL,
    HELD,
    LIMITED,
    REDUNDANT,
    SLIDER,
    SLIDING,
    SLIP,
    TURNS,
    Parameters,
)
from lagsim.methods.parts.state import of_model
from lagsim.native.kernels.words import external
from lagsim.program import mass
from lagsim.tolerances import OVERFLOW

if TYPE_CHECKING:
    from lagsim.language.arrays import Floats


def couple(p: Parameters, sliding: int) -> None:
    """Make Y = L^-1 A^T of the rows that hold, what pushes with them, and S.

    Each row of S, and of the right side, is brought to the size of its own diagonal.
    """
    n = p.n
    count = int(p.ranked)
    for k in range(count):
        row, push, i = p.Y[k * n :], p.Z[k * n :], int(p.order[k])
        row[:n] = p.A[i * n : (i + 1) * n]
        push[:n] = row[:n]
        mass.forward(n, p.L, row)
        place = own_place(p, i)
        if place >= 0:
            push[:n] = 0.0
            push[place] = 1.0
        if sliding > 0:
            slide_along(p, i, push)
        mass.forward(n, p.L, push)
    for k in range(count):
        row = p.Y[k * n :]
        square = mass.product(n, row, row)
        scale = 1.0 / square if square > 0.0 else 0.0
        for i in range(count):
            p.S[k * count + i] = mass.product(n, row, p.Z[i * n :]) * scale
        p.w[k] *= scale


def own_place(p: Parameters, i: int) -> int:
    """Return the coordinate that alone row i acts on, a slider's; or -1."""
    k = i - p.m + p.laws
    return int(p.law_place[k]) if k >= 0 else -1


def slide_along(p: Parameters, i: int, push: Floats) -> None:
    """Add to what row i pushes with the friction that goes with its multiplier."""
    n = p.n
    first = p.m - p.laws
    for k in range(p.laws):
        if int(p.law_normal[k]) == i - first and i >= first and p.law_part[k] != 0.0:
            push[:n] += p.law_part[k] * p.A[(first + k) * n : (first + k + 1) * n]


def impress(p: Parameters) -> None:
    """Add to u (n,) the forces of the rows that hold, times L^-1."""
    n = p.n
    for k in range(int(p.ranked)):
        p.u[:] += p.w[k] * p.Z[k * n : (k + 1) * n]


def share_out(p: Parameters) -> None:
    """Store the multiplier of each row."""
    first = p.m - p.laws
    out = p.multipliers
    p.multipliers[:] = 0.0
    for k in range(int(p.ranked)):
        out[int(p.order[k])] = p.w[k]
    for k in range(p.laws):
        if p.law_part[k] != 0.0:
            out[first + k] = p.law_part[k]
            if p.law_kind[k] == SLIP:
                out[first + k] *= out[first + int(p.law_normal[k])]


def solve_rows(p: Parameters, count: int, x: Floats) -> None:
    """Solve S x = right side (count,) in place; nan where S is singular."""
    if decompose(1, count, p.S, p.factors) == 0:
        x[:count] = nan
    else:
        solve(1, count, p.S, p.factors, x)


def share(p: Parameters, out: Floats) -> None:
    """Share out the multipliers of contacts, of those of all rows (m,).

    What is not left out may not do: then all stay as they are.
    """
    laws = p.laws
    forces, lam = p.diagonal, out[p.m - laws :]
    count = products(p)
    if count == 0:
        return
    for i in range(count):
        forces[i] = 0.0
        for j in range(count):
            k = int(p.x[j])
            forces[i] += p.free[i * laws + k] * lam[k]
    pulls = share_among(p, count)
    while pulls >= 0:
        for i in range(count):
            p.free[i * laws + pulls] = 0.0
        pulls = share_among(p, count)
    for k in range(laws):
        if touches(p, k) and abs(p.w[0]) < OVERFLOW:
            lam[k] = shared(p, count, k)


def products(p: Parameters) -> int:
    """Make G = A_h A^T of the contacts that hold, by laws; give how many these are."""
    n, laws = p.n, p.laws
    rows = p.A[(p.m - laws) * n :]
    count = 0
    weigh(p)
    for k in range(laws):
        if p.law_mode[k] == HELD and touches(p, k):
            for i in range(laws):
                p.free[count * laws + i] = 0.0
                if touches(p, i):
                    p.free[count * laws + i] = inner(p, rows[k * n :], rows[i * n :])
            p.x[count] = k
            count += 1
    return count


def share_among(p: Parameters, count: int) -> int:
    """Solve for y among those in G; return the law that would pull most, or -1."""
    forces = p.diagonal
    p.w[:count] = forces[:count]
    for i in range(count):
        for j in range(count):
            row, other = p.free[i * p.laws :], p.free[j * p.laws :]
            p.S[i * count + j] = mass.product(p.laws, row, other)
    solve_rows(p, count, p.w)
    found = -1
    most = 0.0
    for k in range(p.laws):
        push = shared(p, count, k)
        if push < most:
            most = push
            found = k
    return found


def shared(p: Parameters, count: int, k: int) -> float:
    """Multiplier of law k."""
    found = 0.0
    for i in range(count):
        found += p.w[i] * p.free[i * p.laws + k]
    return found


def weigh(p: Parameters) -> None:
    """Store the square of the factor that scales each column's largest element to 1."""
    n = p.n
    first = p.m - p.laws
    weights = p.u
    p.u[:] = 0.0
    for k in range(p.laws):
        if touches(p, k):
            for j in range(n):
                weights[j] = max(weights[j], abs(p.A[(first + k) * n + j]))
    for j in range(n):
        if weights[j] > 0.0:
            weights[j] = 1.0 / (weights[j] * weights[j])


def inner(p: Parameters, a: Floats, b: Floats) -> float:
    """Product of two rows (n,)."""
    found = 0.0
    for j in range(p.n):
        found += p.u[j] * a[j] * b[j]
    return found


def touches(p: Parameters, k: int) -> bool:
    """Whether a law is a contact without friction that touches and holds."""
    if p.law_kind[k] != CONTACT or not (
        p.law_mode[k] == HELD or p.law_mode[k] == REDUNDANT
    ):
        return False
    slips = 0
    for i in range(p.laws):
        if int(p.law_normal[i]) == k:
            slips += 1
    return slips == 0


# The margin of what has no end of its own.
ENDLESS = 1.0
# A slip on a disc has begun where it is so many times as fast as its floor.
BEGUN = 16.0
# The cosine up to which its way turns before it is noted anew: what turns by more than
# a right angle in a step has stopped.
TURNED = 0.5


# Of each law (L,) the gap, the speed of what has none, or what is `left`.
gaps = of_model("gaps")


@external
def solve_motion(t: float, y: Floats, p: Parameters) -> None:
    """Leave q'' (n,) and lambda (m,) as the motion, see `dense`."""


def take_out(p: Parameters) -> None:
    """Clear the rows of laws that do not hold."""
    first = p.m - p.laws
    for k in range(p.laws):
        if p.law_mode[k] != HELD:
            p.A[(first + k) * p.n : (first + k + 1) * p.n] = 0.0


def correct(p: Parameters) -> None:
    """Leave the change of the state (n,), times L, by the rows that hold, as u."""
    p.u[:] = 0.0
    couple(p, 0)
    solve_rows(p, int(p.ranked), p.w)
    impress(p)


def hold(p: Parameters) -> None:
    """Factor M, and list the rows that hold."""
    first = p.m - p.laws
    count = 0
    for k in range(p.m):
        holds = p.aside[k] == 0.0 if k < first else p.law_mode[k - first] == HELD
        if holds:
            p.order[count] = k
            count += 1
    p.ranked = count
    if p.factored < 1.0:
        mass.factor(p)
    p.factored = min(p.constant, 1.0)


def begun(t: float, p: Parameters, k: int) -> float:
    """Part of the stretch in which slip k begins that has passed."""
    return float((t - p.law_begun[k]) / p.law_lasts[k])


def way(t: float, p: Parameters, k: int) -> float:
    """Direction of row k, of two slips that begin."""
    x = begun(t, p, k)
    turn = 0.0
    for j in range(TURNS):
        turn = (turn + p.law_turn[(k + 1) * TURNS - 1 - j]) * x
    return float(p.law_direction[k] + turn)


def drive(t: float, p: Parameters) -> None:
    """Store the parts of sliding rows, and add the forces of limited ones."""
    first = p.m - p.laws
    direction, part = p.law_direction, p.law_part
    for k in range(p.laws):
        part[k] = 0.0
        if p.law_mode[k] == REDUNDANT:
            # Where it has a way: at its bound, and kept there by the others.
            part[k] = direction[k] * p.law_statics[k]
        if p.law_mode[k] == SLIDING:
            part[k] = direction[k] * p.law_bounds[k]
            other = int(p.law_pair[k])
            if other >= 0:
                x = p.law_speeds[k]
                z = p.law_speeds[other]
                if p.law_floor[k] > 0.0:
                    x -= p.law_floor[k] * way(t, p, k)
                    z -= p.law_floor[k] * way(t, p, other)
                speed = sqrt(x * x + z * z)
                if speed > 0.0:
                    part[k] = -p.law_bounds[k] * x / speed
                if x * direction[k] + z * direction[other] > 0.0:
                    # Past its stop in a step that is to end there: as before it.
                    part[k] = -part[k]
        if p.law_kind[k] == LIMITED and part[k] != 0.0:
            p.f[:] += part[k] * p.A[(first + k) * p.n : (first + k + 1) * p.n]


def respond(p: Parameters) -> None:
    """Solve for q'' and lambda: the terms are there, and what slides is noted."""
    mass.free_motion(p)
    count = int(p.ranked)
    for k in range(count):
        p.w[k] = mass.missing(p, int(p.order[k]))
    couple(p, 1)
    solve_rows(p, count, p.w)
    p.u[:] = p.v
    impress(p)
    share_out(p)
    mass.backward(p.n, p.L, p.u, p.motion)


def law_event_functions(t: float, y: Floats, p: Parameters, out: Floats) -> None:
    """Event functions of the laws (L,): below 0 the mode of a law is over."""
    mode = p.law_mode
    if p.law_forces > 0.0:
        solve_motion(t, y, p)
        if p.sliding > 0.0:  # else on the lower sides of what the motion follows
            p.multipliers[:] = p.side_fields[p.size : p.size + p.m]
    gaps(t, y, p, out)
    for k in range(p.laws):
        if p.law_kind[k] == SLIDER:
            continue
        if mode[k] == HELD:
            out[k] = hold_left(p, k)
        elif mode[k] == SLIDING:
            out[k] = slide_left(t, p, k, out[k])
            if p.law_varies[k] > 0.0:  # it may not become negative
                out[k] = min(out[k], p.law_bounds[k])
        elif mode[k] == REDUNDANT or not is_one_sided(p, k):
            out[k] = ENDLESS


def is_one_sided(p: Parameters, k: int) -> bool:
    """Whether a law's multiplier pushes and does not pull."""
    # These two are the first kinds.
    return float(p.law_kind[k]) <= FREEWHEEL


def hold_left(p: Parameters, k: int) -> float:
    """Event function of a held row: the distance of its multiplier from its bound."""
    if is_one_sided(p, k):
        return float(p.multipliers[p.m - p.laws + k])
    bounded = p.law_kind[k] == SLIP or p.law_kind[k] == LIMITED
    return grip(p, k) if bounded else ENDLESS


def slide_left(t: float, p: Parameters, k: int, speed: float) -> float:
    """Event function of a sliding row: its speed; of two slips one has that of both.

    Until their way has turned, and has to be noted anew. Of those that begin, how much
    they are below what they begin with, in time, too, and forward.
    """
    direction = p.law_direction
    other = int(p.law_pair[k])
    if other < 0:
        return float(-direction[k] * speed)
    if other < k:
        return ENDLESS
    x = p.law_speeds[k]
    z = p.law_speeds[other]
    speed = sqrt(x * x + z * z)
    ahead = -(direction[k] * x + direction[other] * z)
    if p.law_floor[k] > 0.0:
        left = BEGUN * p.law_floor[k]
        # By its band, half a floor, before the end: the polynomial goes no farther.
        in_time = left * (1.0 - begun(t, p, k)) - 0.5 * p.law_floor[k]
        return float(min(left - speed, in_time, ahead))
    if ahead < 0.0:
        return float(-speed)
    return float(min(speed - p.law_still[k], ahead - TURNED * speed))


def grip(p: Parameters, k: int) -> float:
    """Event function of a row that sticks; of two slips the first has that of both."""
    first = p.m - p.laws
    lam = p.multipliers
    other = int(p.law_pair[k])
    held = p.law_statics[k]
    if p.law_kind[k] == SLIP:
        held *= lam[first + int(p.law_normal[k])]
    if other < 0:
        return float(held - abs(lam[first + k]))
    if other < k and p.law_mode[other] == HELD:
        return ENDLESS
    x = lam[first + k]
    z = lam[first + other]
    return float(held - sqrt(x * x + z * z))
