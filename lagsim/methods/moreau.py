"""Moreau's time stepping: for hundreds of contacts, impulses in fixed steps, order 1.

No impact is located. A step of length h computes, in this order:

1. the positions in the middle, q + h/2 v, which decide the contacts that act (gap <=
   0), and at which forces f and M are evaluated;
2. the velocities after the step, changed by the forces and by the impulses p of all
   contacts at once: M (v+ - v) = h f + A^T p;
3. the positions after the step: q + h/2 (v + v+).

After the step each active contact has Newton's rate, at least -e times the rate before;
friction is on its cone, a limited multiplier within its limit. Equalities are treated
like contacts, and their residuals are corrected in the next step. The impulses are
found by projected relaxation; the cost of a sweep is proportional to the number of
elements of the active rows. A step whose relaxation does not converge is counted and
reported.

- **Contacts.** A contact is found up to one step late and keeps a penetration of about
  h |v|. Bounces shorter than a few steps count as rest.
- **Error.** Times of impact, and quantities that depend on these times, are of order 1
  in h, even if the motion between impacts is computed exactly. Smooth motion is that of
  `verlet`.
- **Equalities.** The residual is up to h^2 times the acceleration along the row; of an
  equality between velocities, h times that acceleration.
- **Rows** have the mean multiplier of the step, lambda = p/h, so that an impact is a
  high value. Columns `impulse.<c>` are 0, and there are no events.
- **Work.** The work of impulses is p times the mean of the velocities before and after,
  so that no impulse changes `energy - work`.

For few contacts, or for many digits, methods that locate impacts are better.

Sources: J. J. Moreau, Unilateral contact and dry friction in finite freedom dynamics,
CISM 302 (1988) 1-82; M. Jean, Comput. Methods Appl. Mech. Eng. 177 (1999) 235-257.
"""

from __future__ import annotations

from math import inf, nan, sqrt

from lagsim.language.arrays import Floats
from lagsim.methods import unrestricted
from lagsim.methods.parts.constraints import is_finite
from lagsim.methods.parts.control import record_extents
from lagsim.methods.parts.fixed import Fixed, step
from lagsim.methods.parts.parameters import Parameters
from lagsim.methods.parts.state import DONE, NOT_FINITE, balance, columns, effort
from lagsim.native.layout import after, array, part
from lagsim.tolerances import (
    OVERFLOW,
    SETTLED_IMPULSE,
    SLIP_AT_REST,
    SUM_ROUNDOFF,
)

__all__ = ["step"]

NAME = "moreau"
TITLE = "Moreau's time stepping"
ORDER = 1
DENSE_ORDER = 1
ADAPTIVE = False
IMAGINARY_LIMIT = 2.0
HANDLES = "any model; contacts by hundreds"

refusal = unrestricted
NEEDS = ("balance",)
EVENTS = False

CONSTRAINED = False  # for code shared with methods that support constraints


class Moreau(Fixed):
    """Memory of Moreau's method: index of the multipliers in y, and working memory."""

    # Rows need no slopes.
    before: Floats = array(lambda _: 0, replaces=True)
    k: Floats = array(lambda _: 0, replaces=True)
    slope: Floats = array(lambda _: 0, replaces=True)
    unsettled: float  # number of steps whose impulses did not converge
    multipliers: float  # index of the multipliers in y
    # 1 if a contact closed in the last step faster than forces could close it
    struck: float
    z: Floats = array("size")
    w: Floats = array("n")
    room: Floats = array("size")


STATE = Moreau


class Impulses(Parameters):
    """Parameters of the rows, whose impulses are computed in each step."""

    row_count: int  # number of the rows
    inertial: int  # elements of M in its envelope
    sloping: int  # number of elements of the rows that do not vanish

    # Columns of `mechanics.rows.RowTable`; `row_returns` marks rows whose gap a step
    # returns to 0.
    row_low: Floats = array("row_count")
    row_high: Floats = array("row_count")
    row_gapped: Floats = array("row_count")
    row_returns: Floats = array("row_count")
    row_normal: Floats = array("row_count")
    row_pair: Floats = array("row_count")
    row_restitution: Floats = array("row_count")
    # Layout of the values of `balance`.
    slope_starts: Floats = array(lambda p: p.row_count + 1)
    slope_columns: Floats = array("sloping")
    # Values of `balance`: M in its envelope, the elements of the rows, the forces; then
    # of each row its gap, its rate at rest, its bounds, whether it is in force.
    balance: Floats = array(lambda p: p.inertial + p.sloping + p.n + 5 * p.row_count)
    met_slopes: Floats = part("balance", "sloping", "inertial")
    pushes: Floats = after("met_slopes", "n")
    row_gaps: Floats = after("pushes", "row_count")
    row_offsets: Floats = after("row_gaps", "row_count")
    row_bounds: Floats = after("row_offsets", "row_count")
    row_statics: Floats = after("row_bounds", "row_count")
    row_force: Floats = after("row_statics", "row_count")
    inertia_factor: Floats = array("inertial")
    # Active rows of a step: their indices, and the place of each row among them, from
    # 1; responses to unit impulses, element by element, and where the response of each
    # row begins.
    acting: Floats = array("row_count")
    among: Floats = array("row_count")
    answer_starts: Floats = array(lambda p: p.row_count + 1)
    answers: Floats = array(lambda p: p.row_count * p.n)
    answer_columns: Floats = array(lambda p: p.row_count * p.n)
    # Of each active row: the impulse, the target rate, the rate by a unit impulse, the
    # size of its rates.
    struck: Floats = array("row_count")
    aims: Floats = array("row_count")
    yields: Floats = array("row_count")
    reaches: Floats = array("row_count")


PARAMETERS = Impulses


def amplification(z: complex) -> float:
    """Return the spectral radius of a step on q'' = 2 Re(z) q' - |z|^2 q, h = 1.

    The result is the spectral radius of the matrix (2, 2) that advances (q, q').
    """
    import numpy as np

    square, damping = abs(z) ** 2, 2.0 * z.real
    slope = np.array([-square, 1.0 + damping - 0.5 * square])
    matrix = np.array([[1.0, 0.5] + 0.5 * slope, slope])
    return float(np.max(np.abs(np.linalg.eigvals(matrix))))


def start(s: Moreau, p: Impulses) -> None:
    """Begin an arc: set the multipliers of the state to those of the first step."""
    s.step_h = 0.0
    s.multipliers = s.size - p.row_count
    attempt(s, p, min(float(s.fixed_step), s.end - s.t))
    for i in range(s.size - p.row_count, s.size):
        if abs(s.new[i]) < OVERFLOW:
            s.y[i] = s.new[i]
    record_extents(s)


def make(s: Moreau, p: Impulses, after: float, h: float) -> int:  # noqa: ARG001
    """Compute `new` a step h later, at the time `after`; return DONE or a code.

    See `fixed.make`.
    """
    if attempt(s, p, h) == 0:
        s.unsettled += 1.0
    return DONE if is_finite(s.size, s.new) else NOT_FINITE


def attempt(s: Moreau, p: Impulses, h: float) -> int:
    """Compute the state after a step h; return the number of sweeps of the relaxation.

    The number is 0 if the impulses did not converge.
    """
    n, y, z, w = s.n, s.y, s.z, s.w
    middle = s.t + 0.5 * h
    s.z[:] = y
    s.new[:] = y
    v = y[s.velocities]
    z[:n] += 0.5 * h * v[:n]
    s.room[:n] = v[:n]
    balance(middle, z, p, p.balance)
    s.evaluations += 1.0
    factor(p)
    s.w[:] = p.pushes[:n]
    respond(p, w)
    s.w[:] = s.room[:n] + h * w
    sweeps = satisfy_rows(s, p, h)
    s.new[:n] = z[:n] + 0.5 * h * w
    s.new[s.velocities] = w
    if p.works > 0:
        add_work(s, p, middle, h)
    return sweeps


def satisfy_rows(s: Moreau, p: Impulses, h: float) -> int:
    """Compute the impulses of a step h and the mean multipliers of the rows.

    The impulses of the last step are the first guess. Return the number of sweeps of
    the relaxation, or 0 if it has not converged.
    """
    first = s.size - p.row_count
    count = gather(p, s.z[s.velocities], s.w, h, s.room)
    s.new[first : first + p.row_count] = 0.0
    s.struck = 0.0
    for i in range(count):
        k = int(p.acting[i])
        p.struck[i] = h * s.y[first + k]
        before = rate(p, k, s.z[s.velocities])
        forced = abs(rate(p, k, s.w) - before)
        speed_scale = max(forced, SLIP_AT_REST * p.reaches[i])
        if p.row_gapped[k] > 0.0 and -before > speed_scale:
            s.struck = 1.0
            s.coarse = h
    s.leap = 0.5 * s.struck
    sweeps = relax(p, count, h, s.z[s.velocities], s.w)
    share_out(p, count, h, s.z[s.velocities])
    for i in range(count):
        s.new[first + int(p.acting[i])] = p.struck[i] / h
    return sweeps


def add_work(s: Moreau, p: Impulses, middle: float, h: float) -> None:
    """Add the works of forces and of impulses in a step h to the new state.

    An impulse acts at the mean of the velocities before and after.

    middle : the time at which forces are evaluated.
    """
    z, new = s.z, s.new
    works, before = new[s.quadratures], s.y[s.quadratures]
    z[s.velocities] = 0.5 * (s.y[s.velocities] + new[s.velocities])
    effort(middle, z, p, s.room)
    works[: p.works] = before[: p.works] + h * s.room[: p.works]
    for k in range(p.row_count):
        impulse = h * new[s.size - p.row_count + k]
        if impulse != 0.0:
            own = int(p.worked[int(p.slope_columns[int(p.slope_starts[k])])])
            moved = rate(p, k, z[s.velocities]) - p.row_offsets[k]
            works[own] += impulse * moved


def interpolate(s: Moreau, p: Parameters, x: float, out: Floats) -> None:  # noqa: ARG001
    """Write the state (size,) at the fraction x of the last step: on the chord.

    Multipliers are constant in a step. At an impact velocities and works jump in the
    middle of the step: there are no values in between, and no event.
    """
    n, h = s.n, s.step_h
    out[: s.size] = s.old + x * (s.y - s.old)
    if s.struck > 0.0 and x < 0.5:
        out[s.velocities] = s.old[s.velocities]
        out[s.quadratures] = s.old[s.quadratures]
        out[:n] = s.old[:n] + x * h * s.old[s.velocities]
    if s.struck > 0.0 and x >= 0.5:
        out[s.velocities] = s.y[s.velocities]
        out[s.quadratures] = s.y[s.quadratures]
        out[:n] = s.y[:n] - (1.0 - x) * h * s.y[s.velocities]
    out[int(s.multipliers) : s.size] = s.y[int(s.multipliers) :]


# --- impulses of the rows that act, by projected relaxation ---------------------------
# M (v+ - v) = h f + A^T p, and each row has its law for p and its rate after the step:
#
#     equality     rate = aim
#     contact      p >= 0, rate >= aim, one of the two an equality
#     slips        |p| <= mu times that of the contact; rate 0, or p against the slip
#     limited      |p| <= h times its bound; rate 0, or p against it
#
# The impulse of one row after the other is set to satisfy its law, forward and
# backward, until no impulse changes. The cost of a sweep is that of the elements of the
# active rows and of their responses; M is factored within its envelope.
#
# Source: M. Jean, The non-smooth contact dynamics method, Comput. Methods Appl. Mech.
# Eng. 177 (1999) 235-257.

# number of sweeps after which relaxation ends unconverged, which is reported
MOST_SWEEPS = 5000
# Over-relaxation after PATIENT sweeps: long stacks need a tenth of the sweeps (R. W.
# Cottle, J.-S. Pang and R. E. Stone, The Linear Complementarity Problem, 1992, section
# 5.2: any factor below 2 converges). A few rows do not need it.
PATIENT = 30
BEYOND = 1.7
# A gap below this part of the motion in the step counts as closed, so that the residual
# of the relaxation does not let a pile fall during one step.
NEAR = 1e-3


def observe(t: float, y: Floats, p: Impulses, out: Floats) -> None:
    """Write the columns of a row at time t to out.

    The accelerations q'' follow from the forces and the mean multipliers. The state
    y (size,) ends with the multipliers.
    """
    motion = p.motion
    lam = y[p.size - p.row_count :]
    balance(t, y, p, p.balance)
    factor(p)
    motion[: p.n] = p.pushes[: p.n]
    for k in range(p.row_count):
        for e in range(int(p.slope_starts[k]), int(p.slope_starts[k + 1])):
            motion[int(p.slope_columns[e])] += p.met_slopes[e] * lam[k]
    respond(p, motion)
    columns(t, y, p, out)


def factor(p: Impulses) -> None:
    """Factor M = L L^T within its envelope, unless a constant M has been factored."""
    L = p.inertia_factor
    if p.factored >= 1.0:
        return
    p.factored = min(p.constant, 1.0)
    row = 0
    for i in range(p.n):
        begin = int(p.inertia_first[i])
        other = 0
        for j in range(i + 1):
            before = int(p.inertia_first[j])
            if j >= begin:
                value = p.balance[row + j - begin]
                for k in range(max(begin, before), j):
                    value -= L[row + k - begin] * L[other + k - before]
                if j < i:
                    value /= L[other + j - before]
                elif value > 0.0:
                    value = sqrt(value)
                else:
                    value = nan
                L[row + j - begin] = value
            other += j - before + 1
        row += i - begin + 1


def respond(p: Impulses, x: Floats) -> None:
    """Replace forces x (n,) by the accelerations M^-1 x."""
    n, L = p.n, p.inertia_factor
    row = 0
    for i in range(n):
        begin = int(p.inertia_first[i])
        value = x[i]
        for j in range(begin, i):
            value -= L[row + j - begin] * x[j]
        row += i - begin + 1
        x[i] = value / L[row - 1]
    for back in range(n):
        i = n - 1 - back
        begin = int(p.inertia_first[i])
        row -= i - begin + 1
        if x[i] != 0.0:
            x[i] /= L[row + i - begin]
            for j in range(begin, i):
                x[j] -= L[row + j - begin] * x[i]


def gather(p: Impulses, v: Floats, w: Floats, h: float, room: Floats) -> int:
    """List the active rows with their target rates and responses; return their number.

    v, w : (n,), the velocities before the step, and after it without impulses.
    h : the length of the step.
    room : (n,), working memory.
    """
    gapped, gaps = p.row_gapped, p.row_gaps
    place, aims = p.among, p.aims
    count = 0
    p.answer_starts[0] = 0.0
    for k in range(p.row_count):
        place[k] = 0.0
        acts = p.row_force[k] != 0.0
        if gapped[k] > 0.0 and gaps[k] > 0.0:
            acts = gaps[k] <= NEAR * h * reach(p, k, v, w) and acts
        if p.row_normal[k] >= 0.0:
            acts = place[int(p.row_normal[k])] > 0.0
        if acts and answer(p, k, count, room) > 0:
            p.acting[count] = k
            place[k] = count + 1
            before = rate(p, k, v)
            aims[count] = 0.0
            if p.row_returns[k] > 0.0:
                aims[count] = -gaps[k] / h
            if gapped[k] > 0.0 and before < 0.0:
                aims[count] = -p.row_restitution[k] * before
            p.reaches[count] = reach(p, k, v, w)
            count += 1
    return count


def answer(p: Impulses, k: int, count: int, room: Floats) -> int:
    """Store M^-1 A_k^T and A_k M^-1 A_k^T of row k, as active row number `count`.

    Return 0 if the latter is not positive, else 1.

    room : (n,), working memory.
    """
    starts = p.slope_starts
    room[: p.n] = 0.0
    for e in range(int(starts[k]), int(starts[k + 1])):
        room[int(p.slope_columns[e])] += p.met_slopes[e]
    respond(p, room)
    own = 0.0
    for e in range(int(starts[k]), int(starts[k + 1])):
        own += p.met_slopes[e] * room[int(p.slope_columns[e])]
    if not own > 0.0:
        return 0
    end = int(p.answer_starts[count])
    for j in range(p.n):
        if room[j] != 0.0:
            p.answers[end] = room[j]
            p.answer_columns[end] = j
            end += 1
    p.answer_starts[count + 1] = end
    p.yields[count] = own
    return 1


def rate(p: Impulses, k: int, v: Floats) -> float:
    """Return the rate of row k at velocities v (n,)."""
    found = float(p.row_offsets[k])
    for e in range(int(p.slope_starts[k]), int(p.slope_starts[k + 1])):
        found += p.met_slopes[e] * v[int(p.slope_columns[e])]
    return found


def reach(p: Impulses, k: int, v: Floats, w: Floats) -> float:
    """Return the scale of row k's rate: the sum of |terms| at v (n,) and at w (n,)."""
    found = abs(p.row_offsets[k])
    for e in range(int(p.slope_starts[k]), int(p.slope_starts[k + 1])):
        j = int(p.slope_columns[e])
        found += abs(p.met_slopes[e]) * (abs(v[j]) + abs(w[j]))
    return float(found)


def add_response(p: Impulses, i: int, impulse: float, w: Floats) -> None:
    """Add to the velocities w (n,) the response to the impulse of active row i."""
    for e in range(int(p.answer_starts[i]), int(p.answer_starts[i + 1])):
        w[int(p.answer_columns[e])] += p.answers[e] * impulse


def relax(p: Impulses, count: int, h: float, v: Floats, w: Floats) -> int:
    """Compute the impulses of the active rows; return the number of sweeps.

    The number is 0 if the relaxation does not converge. `struck` contains a first
    guess, and on return the impulses.

    count : the number of active rows.
    h : the length of the step.
    v : (n,), the velocities before.
    w : (n,), the velocities without impulses; on return the velocities after the step.
    """
    for i in range(count):
        add_response(p, i, p.struck[i], w)
    for sweep in range(MOST_SWEEPS):
        beyond = BEYOND if sweep >= PATIENT else 1.0
        worst = 0.0
        for i in range(count):
            worst = max(worst, satisfy(p, i, h, v, w, beyond))
        for back in range(count):
            worst = max(worst, satisfy(p, count - 1 - back, h, v, w, beyond))
        if worst <= SETTLED_IMPULSE:
            return sweep + 1
    return 0


def share_out(p: Impulses, count: int, h: float, v: Floats) -> None:
    """Share the impulses of parallel rows, within their limits: the least norm.

    The motion does not depend on the shares, and relaxation makes them depend on the
    order of the rows.

    count : the number of active rows.
    v : (n,), the velocities before a step h.
    """
    worst = 1.0
    sweep = 0
    while worst > SETTLED_IMPULSE and sweep < PATIENT:
        worst = 0.0
        sweep += 1
        for i in range(count):
            for j in range(i if is_shared(p, i) else 0):
                ratio = parallel(p, i, j) if is_shared(p, j) else 0.0
                if ratio != 0.0:
                    worst = max(worst, share(p, i, j, ratio, h, v))


def is_shared(p: Impulses, i: int) -> bool:
    """Whether the impulse of active row i may be shared with parallel rows.

    True for limits and equalities.
    """
    k = int(p.acting[i])
    if p.row_normal[k] >= 0.0:
        return False
    return float(p.row_low[k]) < 0.0 and float(p.row_pair[k]) < 0.0


def parallel(p: Impulses, i: int, j: int) -> float:
    """Return the ratio of active row j to active row i; 0 if they are not parallel.

    The rows are those of the constraint Jacobian.
    """
    first = int(p.slope_starts[int(p.acting[i])])
    other = int(p.slope_starts[int(p.acting[j])])
    width = int(p.slope_starts[int(p.acting[i]) + 1]) - first
    if int(p.slope_starts[int(p.acting[j]) + 1]) - other != width:
        return 0.0
    ratio = 0.0
    for e in range(width):
        own, its = p.met_slopes[first + e], p.met_slopes[other + e]
        if p.slope_columns[first + e] != p.slope_columns[other + e]:
            return 0.0
        if ratio == 0.0 and own != 0.0:
            ratio = its / own
        if not abs(its - ratio * own) <= SUM_ROUNDOFF * abs(its):
            return 0.0
    return float(ratio)


def share(p: Impulses, i: int, j: int, ratio: float, h: float, v: Floats) -> float:
    """Share the impulse of active rows i and j; return the relative change of j's.

    Beside an equality the impulse of a limited row is 0. `ratio` : row j divided by row
    i.

    h, v : see `share_out`.
    """
    before = float(p.struck[j])
    whole = p.struck[i] + ratio * before
    found = ratio * whole / (1.0 + ratio * ratio)
    own = is_bounded(p, int(p.acting[i]))
    other = is_bounded(p, int(p.acting[j]))
    if other and not own:
        found = 0.0
    elif own and not other:
        found = whole / ratio
    most = bound_of(p, i, h, v)
    if whole - ratio * found > most:
        found = (whole - most) / ratio
    elif whole - ratio * found < -most:
        found = (whole + most) / ratio
    most = bound_of(p, j, h, v)
    found = min(max(found, -most), most)
    p.struck[j] = found
    p.struck[i] = whole - ratio * found
    return abs(found - before) / abs(whole) if whole != 0.0 else 0.0


def bound_of(p: Impulses, i: int, h: float, v: Floats) -> float:
    """Return the largest |impulse| of active row i; inf for an equality.

    h, v : see `share_out`.
    """
    k = int(p.acting[i])
    return limit(p, k, h, v, 0.0) if is_bounded(p, k) else inf


def is_bounded(p: Impulses, k: int) -> bool:
    """Whether the impulse of row k has bounds of both signs."""
    return float(p.row_high[k]) < inf


def satisfy(
    p: Impulses, i: int, h: float, v: Floats, w: Floats, beyond: float
) -> float:
    """Update the impulse of active row i, and w, by one relaxation step for its law.

    Return the change of the rate relative to the row's scale; 0 for the first of two
    slips on a disc, which are updated with the second.

    h, v, w : see `relax`.
    beyond : factor of over-relaxation.
    """
    k = int(p.acting[i])
    pair = int(p.row_pair[k])
    own = p.yields[i]
    before = p.struck[i]
    other = -1
    if pair >= 0:
        other = int(p.among[pair]) - 1
    if other >= 0:
        if pair < k:
            return 0.0
        return satisfy_disc(p, i, other, h, v, w)
    found = before - (rate(p, k, w) - p.aims[i]) / own
    if is_bounded(p, k):
        bound = limit(p, k, h, v, abs(found))
        found = min(max(found, -bound), bound)
    else:
        found = before + beyond * (found - before)
    if p.row_low[k] == 0.0:
        found = max(found, 0.0)
    p.struck[i] = found
    add_response(p, i, found - before, w)
    size = p.reaches[i] + own * max(abs(found), abs(before))
    return float(own * abs(found - before) / size) if size > 0.0 else 0.0


def satisfy_disc(
    p: Impulses, i: int, other: int, h: float, v: Floats, w: Floats
) -> float:
    """Set the impulses of two slips, active rows i and other, on the disc of friction.

    Return the change of the rates relative to their scale.

    h, v, w : see `relax`.
    """
    struck = p.struck
    k = int(p.acting[i])
    own = max(p.yields[i], p.yields[other])
    x = struck[i] - rate(p, k, w) / own
    z = struck[other] - rate(p, int(p.acting[other]), w) / own
    far = sqrt(x * x + z * z)
    bound = limit(p, k, h, v, far)
    if far > bound:
        x *= bound / far
        z *= bound / far
    changed = abs(x - struck[i]) + abs(z - struck[other])
    add_response(p, i, x - struck[i], w)
    add_response(p, other, z - struck[other], w)
    struck[i] = x
    struck[other] = z
    size = p.reaches[i] + p.reaches[other] + own * far
    return float(own * changed / size) if size > 0.0 else 0.0


def limit(p: Impulses, k: int, h: float, v: Floats, impulse: float) -> float:
    """Return the largest |impulse| of row k, a slip or a limited row, in a step h.

    The limit follows from the static bound if the row was at rest before the step
    (velocities v (n,)) and the impulse `impulse` is within that bound; else from the
    dynamic bound.
    """
    normal = int(p.row_normal[k])
    factor_of = h
    if normal >= 0:
        factor_of = p.struck[int(p.among[normal]) - 1]
    static = p.row_statics[k] * factor_of
    if p.row_statics[k] == p.row_bounds[k]:
        return float(static)
    i = int(p.among[k]) - 1
    if impulse <= static and abs(rate(p, k, v)) <= SLIP_AT_REST * p.reaches[i]:
        return float(static)
    return float(p.row_bounds[k] * factor_of)
