"""Impulses of all rows that act in a step, by projected relaxation on sparse rows.

M (v+ - v) = h f + A^T p, and each row has its law for p and its rate after the step:

    equality     rate = aim
    contact      p >= 0, rate >= aim, one of the two an equality
    slips        |p| <= mu times that of the contact; rate 0, or p against the slip
    limited      |p| <= h times its bound; rate 0, or p against it

One row after the other is given the impulse that meets its law, forth and back, until
none changes. A sweep costs no more than the elements of the rows that act and of what
they push; M is factored within its envelope.

Source: M. Jean, The non-smooth contact dynamics method, Comput. Methods Appl. Mech.
Eng. 177 (1999) 235-257.
"""

from __future__ import annotations

from math import sqrt
from typing import TYPE_CHECKING

from lagsim.methods.parts.interface import balance, columns
from lagsim.methods.parts.parameters import (
    ALWAYS,
    CONTACT,
    FREEWHEEL,
    LIMITED,
    SLIP,
    Parameters,
)
from lagsim.native.kernels.words import at

if TYPE_CHECKING:
    from lagsim.language.arrays import Floats

NAN = float("nan")
# Relaxation ends where no impulse changes its own rate by more than this part of the
# rates it is among; or after so many sweeps, and that is told.
SETTLED = 1e-10
MOST_SWEEPS = 5000
# A row that is met farther than it needs to be passes on what it changes to the next
# ones faster: long stacks take a tenth of the sweeps (R. W. Cottle, J.-S. Pang and R.
# E. Stone, The Linear Complementarity Problem, 1992, section 5.2: any factor below 2
# converges). Few rows need none of it.
PATIENT = 30
BEYOND = 1.7
# A slip is none below this part of its rates: what relaxation leaves of one that rests.
AT_REST = 1e-8
# A gap that opens by this part of the step's motion is touched: what relaxation leaves
# must not let a pile fall for a step.
NEAR = 1e-3


def observe(t: float, y: Floats, p: Parameters, out: Floats) -> None:
    """Give the columns of a row: q'' is that of the forces and the mean multipliers.

    y ends with these.
    """
    n = p.n
    motion = p.motion
    lam = at(y, p.size - p.met)
    starts = p.slope_starts
    places = p.slope_columns
    balance(t, y, p, p.balance)
    slopes = p.met_slopes
    pushes = p.pushes
    factor(p)
    for j in range(n):
        motion[j] = pushes[j]
    for k in range(p.met):
        for e in range(int(starts[k]), int(starts[k + 1])):
            motion[int(places[e])] += slopes[e] * lam[k]
    respond(p, motion)
    columns(t, y, p, out)


def factor(p: Parameters) -> None:
    """Factor M = L L^T within its envelope, once if it is constant."""
    n = p.n
    M = p.balance
    L = p.inertia_factor
    first = p.inertia_first
    if p.factored >= 1.0:
        return
    p.factored = min(p.constant, 1.0)
    row = 0
    for i in range(n):
        begin = int(first[i])
        other = 0
        for j in range(i + 1):
            before = int(first[j])
            if j >= begin:
                value = M[row + j - begin]
                for k in range(max(begin, before), j):
                    value -= L[row + k - begin] * L[other + k - before]
                if j < i:
                    value /= L[other + j - before]
                elif value > 0.0:
                    value = sqrt(value)
                else:
                    value = NAN
                L[row + j - begin] = value
            other += j - before + 1
        row += i - begin + 1


def respond(p: Parameters, x: Floats) -> None:
    """Replace forces x (n,) by M^-1 x."""
    n = p.n
    L = p.inertia_factor
    first = p.inertia_first
    row = 0
    for i in range(n):
        begin = int(first[i])
        value = x[i]
        for j in range(begin, i):
            value -= L[row + j - begin] * x[j]
        row += i - begin + 1
        x[i] = value / L[row - 1]
    for back in range(n):
        i = n - 1 - back
        begin = int(first[i])
        row -= i - begin + 1
        if x[i] != 0.0:
            x[i] /= L[row + i - begin]
            for j in range(begin, i):
                x[j] -= L[row + j - begin] * x[i]


def gather(p: Parameters, v: Floats, w: Floats, h: float, room: Floats) -> int:
    """List the rows that act, with what they aim at and push; give their number.

    v, w : (n,), the velocities before, and after without impulses; room : (n,).
    """
    kind = p.met_kind
    gaps = p.met_gaps
    force = p.met_force
    normal = p.met_normal
    acting = p.acting
    place = p.among
    aims = p.aims
    count = 0
    p.answer_starts[0] = 0.0
    for k in range(p.met):
        place[k] = 0.0
        acts = force[k] != 0.0
        if kind[k] == CONTACT and gaps[k] > 0.0:
            acts = gaps[k] <= NEAR * h * reach(p, k, v, w) and acts
        if kind[k] == SLIP:
            acts = place[int(normal[k])] > 0.0
        if acts and answer(p, k, count, room) > 0:
            acting[count] = k
            place[k] = count + 1
            before = rate(p, k, v)
            aims[count] = 0.0
            if kind[k] == ALWAYS:
                aims[count] = -gaps[k] / h
            if kind[k] == CONTACT and before < 0.0:
                aims[count] = -p.met_restitution[k] * before
            p.reaches[count] = reach(p, k, v, w)
            count += 1
    return count


def answer(p: Parameters, k: int, count: int, room: Floats) -> int:
    """Note M^-1 A^T of row k, and its own part; give 0 where nothing answers."""
    n = p.n
    starts = p.slope_starts
    places = p.slope_columns
    slopes = p.met_slopes
    answers = p.answers
    columns_of = p.answer_columns
    for j in range(n):
        room[j] = 0.0
    for e in range(int(starts[k]), int(starts[k + 1])):
        room[int(places[e])] += slopes[e]
    respond(p, room)
    own = 0.0
    for e in range(int(starts[k]), int(starts[k + 1])):
        own += slopes[e] * room[int(places[e])]
    if not own > 0.0:
        return 0
    end = int(p.answer_starts[count])
    for j in range(n):
        if room[j] != 0.0:
            answers[end] = room[j]
            columns_of[end] = j
            end += 1
    p.answer_starts[count + 1] = end
    p.yields[count] = own
    return 1


def rate(p: Parameters, k: int, v: Floats) -> float:
    """Give the rate of row k at velocities v (n,)."""
    starts = p.slope_starts
    places = p.slope_columns
    slopes = p.met_slopes
    found = float(p.met_offsets[k])
    for e in range(int(starts[k]), int(starts[k + 1])):
        found += slopes[e] * v[int(places[e])]
    return found


def reach(p: Parameters, k: int, v: Floats, w: Floats) -> float:
    """Give how large the rate of row k is at velocities v, and at w."""
    starts = p.slope_starts
    places = p.slope_columns
    slopes = p.met_slopes
    found = abs(p.met_offsets[k])
    for e in range(int(starts[k]), int(starts[k + 1])):
        j = int(places[e])
        found += abs(slopes[e]) * (abs(v[j]) + abs(w[j]))
    return float(found)


def push(p: Parameters, i: int, impulse: float, w: Floats) -> None:
    """Add what an impulse of the row in place i does to velocities w."""
    starts = p.answer_starts
    answers = p.answers
    places = p.answer_columns
    for e in range(int(starts[i]), int(starts[i + 1])):
        w[int(places[e])] += answers[e] * impulse


def relax(p: Parameters, count: int, h: float, v: Floats, w: Floats) -> int:
    """Find the impulses of the rows that act; give the sweeps, or 0 if it did not end.

    v : (n,), the velocities before. w : (n,), those that there would be without the
    impulses in `struck`, which are a guess; on return those after the step.
    """
    struck = p.struck
    for i in range(count):
        push(p, i, struck[i], w)
    for sweep in range(MOST_SWEEPS):
        beyond = BEYOND if sweep >= PATIENT else 1.0
        worst = 0.0
        for i in range(count):
            worst = max(worst, meet(p, i, h, v, w, beyond))
        for back in range(count):
            worst = max(worst, meet(p, count - 1 - back, h, v, w, beyond))
        if worst <= SETTLED:
            return sweep + 1
    return 0


def meet(p: Parameters, i: int, h: float, v: Floats, w: Floats, beyond: float) -> float:
    """Meet the law of the row in place i; give how much that changes, of its rates."""
    k = int(p.acting[i])
    kind = p.met_kind[k]
    pair = int(p.met_pair[k])
    struck = p.struck
    own = p.yields[i]
    before = struck[i]
    other = -1
    if pair >= 0:
        other = int(p.among[pair]) - 1
    if other >= 0:
        if pair < k:
            return 0.0
        return meet_two(p, i, other, v, w)
    found = before - (rate(p, k, w) - p.aims[i]) / own
    # Kinds in their order: one-sided, bounded, two-sided.
    if FREEWHEEL < kind <= LIMITED:
        bound = limit(p, k, h, v, abs(found))
        found = min(max(found, -bound), bound)
    else:
        found = before + beyond * (found - before)
    if kind <= FREEWHEEL:
        found = max(found, 0.0)
    struck[i] = found
    push(p, i, found - before, w)
    size = p.reaches[i] + own * max(abs(found), abs(before))
    return float(own * abs(found - before) / size) if size > 0.0 else 0.0


def meet_two(p: Parameters, i: int, other: int, v: Floats, w: Floats) -> float:
    """Meet the law of two slips, in places i and other: on the disc."""
    struck = p.struck
    k = int(p.acting[i])
    own = max(p.yields[i], p.yields[other])
    x = struck[i] - rate(p, k, w) / own
    z = struck[other] - rate(p, int(p.acting[other]), w) / own
    far = sqrt(x * x + z * z)
    bound = limit(p, k, 1.0, v, far)
    if far > bound:
        x *= bound / far
        z *= bound / far
    changed = abs(x - struck[i]) + abs(z - struck[other])
    push(p, i, x - struck[i], w)
    push(p, other, z - struck[other], w)
    struck[i] = x
    struck[other] = z
    size = p.reaches[i] + p.reaches[other] + own * far
    return float(own * changed / size) if size > 0.0 else 0.0


def limit(p: Parameters, k: int, h: float, v: Floats, asked: float) -> float:
    """Give the largest impulse of row k: another while it rests, if that is enough."""
    normal = int(p.met_normal[k])
    factor_of = h
    if normal >= 0:
        factor_of = p.struck[int(p.among[normal]) - 1]
    static = p.met_statics[k] * factor_of
    if p.met_statics[k] == p.met_bounds[k]:
        return float(static)
    i = int(p.among[k]) - 1
    if asked <= static and abs(rate(p, k, v)) <= AT_REST * p.reaches[i]:
        return float(static)
    return float(p.met_bounds[k] * factor_of)
