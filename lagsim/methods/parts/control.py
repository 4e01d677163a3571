"""Error tolerances from each component's own scale.

The default tolerance of a component is rtol times its own scale: its range so far,
which is independent of the origin and of other bodies, or its change by its rate in the
step. Where forces cancel, a small part of their terms counts as well. No tolerance is
below the rounding of the component's value and of its rate. The rounding of rates is
bounded only if a step would be rejected, or would grow little while forces cancel. The
bound includes the effect of the rounding of the state, and the rounding within the
evaluation. No unit enters: metres and millimetres give equal steps.
"""

from __future__ import annotations

from math import inf, sqrt

from lagsim.language.arrays import Floats
from lagsim.methods.parts.parameters import SLIDING, Parameters
from lagsim.methods.parts.state import (
    LOCAL,
    ArcRows,
    derivative,
    energies_masses,
    rounding,
    terms,
)
from lagsim.native.kernels.words import apart, fused
from lagsim.native.layout import after, array, part
from lagsim.tolerances import (
    OVERFLOW,
    PROBE,
    RESIDUAL_ROUNDOFF,
    SQUARABLE,
    STATE_ROUNDOFF,
    TERM_ROUNDOFF,
    UNDERFLOW,
    UNIT_ROUNDOFF,
    VALUE_ROUNDOFF,
)

# Least scale of a component, relative to the change by the terms of its rate in a step:
# errors of other components within the tolerance leave a part of terms that cancel.
FLOOR = 1e-3
# Least tolerance of a component, relative to those of components linked by rows. Off
# the constraints, in the stages of a step, errors of one act on the others; projection
# removes them. A tenth of this value costs Bricard's mechanism twice the steps; other
# models change little.
LEAK = 1e-2
# A coordinate whose size is below so many times the rounding of its mechanism is at
# rest: its motion is rounding.
AT_REST = 100.0
# Amplification of rounding by a method's stages, in error estimates of constrained
# components: the coefficients of DOP853 are as large as 43, of either sign.
AMPLIFIED = 4.0
# Size of a component relative to its range: 1/2 for an oscillation about 0, 1 for a
# motion away from 0.
WIDTH = 0.7
# Ratio of a range to the least scale of its component from which on that scale, which
# varies slowly, need not be known in each step.
WIDE = 100.0
# Tolerances by ranges hold for steps longer by the first factor, of which WIDE exceeds
# the square, if they exceed roundoff by the second.
LONGER = 4.0
CLEARLY = 4.0
# Ratio of the roundoff bound at the start of a step to that at its end from which the
# former is that of an instant; the latter is then used, times the second number.
SINGULAR = 2.0**16
OF_INSTANT = 64.0
# Negligible time, relative to the length of an arc.
INSTANT = 1e-6
# Part of a component's size by the motion of others that counts as a scale.
AT_ONSET = 1e-2
# At tight tolerances the floor is below the last place: truncation errors of the size
# of roundoff have the same sign in every step and so grow faster than the rounding that
# remains in compensated sums.
FINEST = 0.25 * UNIT_ROUNDOFF


class Control(ArcRows):
    """Memory of error control: ranges, tolerances, energies, roundoff."""

    rtol: float
    atol: float  # below 0: rtol times the component's own scale
    energy: float  # the largest kinetic energy or change of potential so far
    potential: float  # the potential energy at the start of the run
    lost_below: float  # the rows have lost rank where sigma is below this
    # number of directions by which the roundoff was bounded in this step
    rounding_known: float
    # the length of the step for which the roundoff was bounded; 0 for a start
    bounded_step: float
    limited: float  # 1 if the bound was limited by that at the end of the step, else 0
    balanced: float  # 1 if the only scale of a component is that of forces that cancel
    balanced_alone: float  # 1 if the roundoff of these components alone counts
    wide: float  # 1 if the range of each component exceeds its least scale by far
    # number of steps for which energies and terms of forces are not renewed
    spared: float
    # Up to this step tolerances are equal for all states within the ranges; 0: unknown.
    steady: float
    sizes: Floats = array("size")  # the largest magnitude of each component of y so far
    # The least and the largest value of each component.
    low: Floats = array("size", inf)
    high: Floats = array("size", -inf)
    tolerances: Floats = array("size")
    # Sum of absolute terms of each rate, its roundoff bound, its size after the first
    # instant from rest.
    parts: Floats = array("size")
    roundoff: Floats = array("size")
    foreseen: Floats = array("size")
    # The size of each component by the motion of others, in this arc; 0: unknown. The
    # number of components in a row that are reached when it is next computed.
    onset: Floats = array("size")
    hops: float
    reach: Floats = array("size")  # the largest magnitudes in the step that is bounded
    # The compensation term of y, and that of the new state.
    compensation: Floats = array("size")
    remainder: Floats = array("size")
    # Values of `energies_masses`: both, and a 0 that is replaced by the sum of M_ii
    # a_i^2 of the accelerations that forces could cause.
    measured: Floats = array(lambda s: s.n + 3)
    energies: Floats = part("measured", lambda _: 2)
    masses: Floats = after("energies", "n")
    pushes: Floats = after("masses", lambda _: 1)
    # the number of the mechanism to which a coordinate belongs
    joined: Floats = array("n")
    # likewise, where mechanisms are coupled by rows alone, and not by M
    linked: Floats = array("n")
    # The largest tolerance of linked coordinates, at the first of their indices; the
    # energy that each work is compared with.
    shared: Floats = array(lambda s: s.size - s.n)


def record_sizes(s: Control, p: Parameters) -> None:
    """Update the largest sizes so far, and the energy, by the accepted state s.y."""
    store_energies(s, s.t, s.y, p)
    record_measured(s, p)


def record_measured(s: Control, p: Parameters) -> None:
    """Update the largest sizes so far, and the energy, by the state s.y.

    The energies are not evaluated: those that the last call of `store_energies` (by
    `set_tolerances`, for example) has stored are used.
    """
    record_extents(s)
    if s.spared > 0.0:
        s.spared -= 1.0
        return
    s.steady = 0.0
    change = abs(s.energies[1] - s.potential)
    s.energy = max(float(s.energy), abs(float(s.energies[0])), float(change))
    parts, accelerations = s.parts, s.parts[s.velocities]
    terms(s.t, s.y, p, parts)
    for back in range(s.states):
        k = s.states - 1 - back
        parts[s.velocities.stop + k] = parts[s.n + k]
    # From here on as accelerations, and the whole in the metric of M.
    masses, whole = s.masses, 0.0
    for i in range(s.n):
        push = parts[i]
        part = 0.0
        if masses[i] > 0.0:
            part = push / masses[i]
            whole += push * part
        parts[i] = part
        accelerations[i] = part
    s.pushes[0] = whole


def record_extents(s: Control) -> None:
    """Update the largest sizes and the ranges of all components by the state reached.

    Methods with a fixed step record this alone; others also record energies.
    """
    y, sizes, low, high = s.y, s.sizes, s.low, s.high
    for i in apart(s.size):
        now = y[i]
        sizes[i] = max(sizes[i], abs(now))
        low[i] = min(low[i], now)
        high[i] = max(high[i], now)
    forget_roundoff(s)


def forget_roundoff(s: Control) -> None:
    """Set the roundoff bounds to 0, so that they are computed again where needed."""
    for i in apart(s.size):
        s.roundoff[i] = 0.0
    s.rounding_known = 0.0
    s.bounded_step = 0.0
    s.limited = 0.0


def store_energies(s: Control, t: float, y: Floats, p: Parameters) -> None:
    """Store kinetic energy, energy and the diagonal of M at the state y (size,).

    While `spared` is positive the former values are kept.

    t : the time.
    """
    if s.spared > 0.0:
        return
    energies_masses(t, y, p, s.measured)
    if s.evaluations <= 1.0:
        s.potential = s.energies[1]


def set_tolerances(
    s: Control, p: Parameters, t: float, new: Floats, rates: Floats, h: float
) -> bool:
    """Set the tolerance of each component for a step of length h to `new` at time t.

    A component with a tolerance of 0 has no scale and is not controlled. Return False
    if the tolerances of the last call hold and are kept, else True.

    new, rates : (size,), the state after the step and y' before it.
    """
    store_energies(s, t, new, p)
    if not CONSTRAINED and not SWITCHES and h <= s.steady and is_within(s, new):
        return False
    compute_tolerances(s, p, new, rates, h)
    if not CONSTRAINED and not SWITCHES:
        s.steady = longest_steady(s, p, new, h)
    return True


def is_within(s: Control, y: Floats) -> bool:
    """Whether a state y (size,) is within the ranges of the components so far."""
    low, high, out = s.low, s.high, 0
    for i in range(s.size):
        out += 0 if low[i] <= y[i] <= high[i] else 1
    return out == 0


def longest_steady(s: Control, p: Parameters, new: Floats, h: float) -> float:
    """Return the longest step for which the present tolerances need no change, or 0.

    Within the ranges of the components, the tolerances hold if they follow from these
    ranges alone, by a wide margin. The result is 0 if roundoff of rates is known, since
    the roundoff of positions grows with the step.

    new : (size,), the state after the step h for which the tolerances were computed.
    """
    if s.wide == 0.0 or s.atol >= 0.0 or p.m > 0 or p.works > 0:
        return 0.0
    if s.bounded_step > 0.0 or s.rounding_known > 0.0 or not is_within(s, new):
        return 0.0
    rtol = LOCAL * s.rtol
    longest = LONGER * h
    for i in range(s.size):
        moved = s.sizes[i]
        if i < s.n:
            moved = max(moved, longest * s.sizes[s.n + i])
        by_range = rtol * (WIDTH * (s.high[i] - s.low[i]))
        alone = by_range > CLEARLY * STATE_ROUNDOFF * moved + UNDERFLOW
        if not alone or s.tolerances[i] != by_range:
            longest = 0.0
    return longest


def compute_tolerances(
    s: Control, p: Parameters, new: Floats, rates: Floats, h: float
) -> None:
    """Compute the tolerances of all components; arguments: see `set_tolerances`."""
    shorter = h < SHORTER * s.bounded_step
    if shorter and (s.limited > 0.0 or (SWITCHES and p.surfaces > 0)):
        forget_roundoff(s)  # the bound is that of a longer step
    size, n = s.size, s.n
    s.wide = 1.0
    if s.atol >= 0.0:
        for i in range(size):
            scale = max(abs(s.y[i]), abs(new[i]))
            s.tolerances[i] = LOCAL * (s.atol + s.rtol * scale)
        return
    roundoff, of_velocities = s.roundoff, s.roundoff[s.velocities]
    accelerations = rates[s.velocities]
    # A start from rest with a jump in the force (dry friction) is off by the same part
    # of every step, however short; its first instant is not controlled finer.
    instant = INSTANT * (s.end - s.arc_start) - (s.t - s.arc_start)
    instant = max(instant, 0.0)
    moment = max(h, instant)
    rtol = LOCAL * s.rtol
    floor = FINEST if s.rtol < TIGHT else STATE_ROUNDOFF
    balanced, wide, alone = 0.0, 1.0, 1.0 - s.balanced_alone
    amplification = AMPLIFIED if CONSTRAINED and slides_on_a_disc(p) == 0 else 1.0
    for i in range(size):
        after = new[i]
        rate = abs(rates[i])
        width = max(s.high[i], after) - min(s.low[i], after)
        sized = WIDTH * width if width > 0.0 else h * rate
        sized = max(sized, AT_ONSET * s.onset[i])
        if instant > 0.0:
            sized = max(sized, instant * rate, s.foreseen[i])
        part = s.parts[i]
        if p.laws > 0:
            part = max(part, p.law_pushes[i])
        if i < n:
            # Positions: their change by the velocities in the step.
            part *= moment
            roundoff[i] = max(floor * rate, of_velocities[i] * h)
            sized = max(sized, instant * instant * abs(accelerations[i]))
        least = FLOOR * moment * part
        balanced = max(balanced, 1.0 if sized < least else 0.0)
        wide = min(wide, 1.0 if sized >= WIDE * least else 0.0)
        rough = max(floor * max(s.sizes[i], abs(after)), UNDERFLOW)
        counts = amplification if sized < least else alone
        rough = max(rough, counts * roundoff[i] * h)
        s.tolerances[i] = max(rtol * max(sized, least), rough)
    s.balanced, s.wide = balanced, wide
    if p.m > 0:
        share_tolerances(s)
        share_rounding(s)
    if p.works > 0:
        limit_works(s, p, h, new)


def slides_on_a_disc(p: Parameters) -> int:
    """Return 1 if a pair of slips is sliding, whose direction has rounding, else 0."""
    for k in range(p.laws):
        if p.law_mode[k] == SLIDING and p.law_pair[k] >= 0.0:
            return 1
    return 0


def share_tolerances(s: Control) -> None:
    """Raise tolerances much finer than the tolerances of coordinates coupled by rows.

    Tolerances are compared in the metric of M, in which projection converts errors of
    one coordinate into errors of another. A coordinate at rest by symmetry has no
    motion of its own as a scale.
    """
    n, masses, shared = s.n, s.masses, s.shared
    for level in range(2):
        tolerances = s.tolerances[level * n :]
        find_largest(n, s.linked, masses, tolerances, shared)
        for i in range(n):
            most = LEAK * LEAK * shared[int(s.linked[i])]
            # Few tolerances are raised: no root where no tolerance is raised.
            if masses[i] > 0.0 and masses[i] * tolerances[i] * tolerances[i] < most:
                tolerances[i] = sqrt(most / masses[i])


def find_largest(
    n: int, groups: Floats, masses: Floats, sizes: Floats, largest: Floats
) -> None:
    """Write the largest m_i x_i^2 of each group of coordinates to `largest` (n,).

    The largest value of successive coordinates of one group is held in a register,
    since a store to memory and a load at each coordinate would take longer.

    groups : (n,), the index of the group of each coordinate.
    masses, sizes : m and x, (n,).
    """
    largest[:n] = 0.0
    group, most = 0, 0.0
    for i in range(n):
        k = int(groups[i])
        if k != group:
            largest[group] = most
            group, most = k, largest[k]
        most = max(most, masses[i] * sizes[i] * sizes[i])
    largest[group] = most


def share_rounding(s: Control) -> None:
    """Raise the tolerances of coordinates at rest to the rounding of their mechanism.

    Projection, and the accelerations that rows determine, convert the rounding of one
    coordinate into motion of those that M couples to it, in the metric of M.
    """
    n, masses, shared = s.n, s.masses, s.shared
    for level in range(2):
        tolerances, sizes = s.tolerances[level * n :], s.sizes[level * n :]
        find_largest(n, s.joined, masses, sizes, shared)
        for i in range(n):
            most = STATE_ROUNDOFF * STATE_ROUNDOFF * shared[int(s.joined[i])]
            own = masses[i] * sizes[i] * sizes[i]
            if masses[i] > 0.0 and own < AT_REST * AT_REST * most < OVERFLOW:
                tolerances[i] = max(tolerances[i], sqrt(most / masses[i]))


def against(error: float, tolerance: float) -> float:
    """Return |error/tolerance|, at most SQUARABLE if the error is finite.

    Therefore the square of the result is finite, also for a component at rest, whose
    error may be rounding that far exceeds the tolerance.
    """
    part = abs(error / tolerance)
    if abs(error) < OVERFLOW:
        part = min(part, SQUARABLE)
    return part


def limit_works(s: Control, p: Parameters, h: float, new: Floats) -> None:
    """Raise the tolerances of works to the errors of the corresponding energies.

    An error of a velocity changes the kinetic energy. Where the velocity is within its
    tolerance, since rows hold it at 0, the error also changes the work of the forces in
    the step. (Elsewhere this change is limited by the velocity's own range: near the
    stop of a slip on a disc it would hide the error of the whole step.)

    If terms A^T W A replace the inertia of a massless coordinate, the multipliers on
    this coordinate have the rounding of these terms, and so has the work.

    h : the length of the step.
    new : (size,), the state after the step.
    """
    before, v = s.y[s.velocities], new[s.velocities]
    of_velocities = s.tolerances[s.velocities]
    tolerances = s.tolerances[s.quadratures]
    energies, works = s.shared, p.works
    energies[:works] = 0.0
    for i in range(s.n):
        own = int(p.worked[i])
        off = of_velocities[i]
        speed = max(abs(before[i]), abs(v[i]))
        push = 0.0
        if speed <= off and p.laws > 0:
            push = max(s.parts[s.n + i], p.law_pushes[s.n + i])
        elif speed <= off and p.m > 0:
            push = s.parts[s.n + i]
        energy = (speed + off + h * push) * abs(s.masses[i]) * off
        if p.augmented > 0.0 and s.masses[i] == 0.0:
            for j in range(i + 1):
                factor = p.L[i * s.n + j]
                energy += factor * factor * RESIDUAL_ROUNDOFF * speed * speed
        if own >= 0:
            energies[own] += energy
    for k in range(works):
        tolerances[k] = max(tolerances[k], energies[k])


def is_set_by_rounding(s: Control, h: float) -> bool:
    """Whether rounding in a step h, more than rtol, sets the tolerance of a component.

    This is so far from the origin, and where terms of forces cancel.
    """
    for i in range(s.size):
        rough = max(STATE_ROUNDOFF * s.sizes[i], h * s.roundoff[i])
        if 2.0 * rough > s.tolerances[i]:
            return True
    return False


def allow_roundoff(
    s: Control, p: Parameters, h: float, new: Floats, k: Floats, sigma: float
) -> bool:
    """Bound the roundoff in a step h to `new` (size,), and adapt the tolerances to it.

    Arguments and result: see `bound_step`.
    """
    if not bound_step(s, p, h, new, k, sigma):
        return False
    adapt_to_roundoff(s, p, h, new, k)
    return True


def bound_step(
    s: Control, p: Parameters, h: float, new: Floats, k: Floats, sigma: float
) -> bool:
    """Bound the roundoff of the rates in a step h to `new` (size,).

    The bound is the rounding of the evaluation plus the change of y' in a displacement
    of the state by its roundoff. The first call in a step displaces the state in one
    direction, the second call in another; where terms cancel in many components, each
    call uses both. Return False, without an effect, after two calls in a step, else
    True.

    k : (size,), y' at the start of the step.
    sigma : see `bound_roundoff`.
    """
    if s.rounding_known >= MOST_WAYS:
        return False
    s.rounding_known += 1.0
    t = s.t
    # If terms cancel in many components, a single direction misses some of these by
    # chance.
    ways = MOST_WAYS if s.balanced > 0.0 else s.rounding_known
    bound_roundoff(s, p, t, s.y, k, sigma, h, int(ways))
    if sigma >= 1.0:
        limit_by_end(s, p, t + h, new)
    if SWITCHES and hardly_moves(s, p, h, k):
        bound_roundoff_between(s, p, h, k)
    if SWITCHES and sigma >= 1.0 and (p.laws > 0 or p.sliding > 0.0):
        # Coordinates held by laws or surfaces are at rest against forces that may begin
        # at 0. The trial step itself may lead anywhere.
        lead_positions(s, h, k)
        add_bound(s, p, t + h, s.point, s.velocities.start, s.velocities.stop)
    if s.size > s.velocities.stop:
        # At the start, where all bodies are at rest, the power of forces has no
        # rounding.
        add_bound(s, p, t + h, new, s.velocities.stop, s.size)
    return True


def adapt_to_roundoff(
    s: Control, p: Parameters, h: float, new: Floats, k: Floats
) -> None:
    """Adapt the tolerances for a step h to the roundoff bounds of the rates.

    h, new, k : see `bound_step`.
    """
    set_tolerances(s, p, s.t + h, new, k, h)
    if s.states > 0 or (p.works > 0 and (p.m > 0 or p.sliding > 0.0)):
        bound_by_others(s, p, h, new, k)


def bound_by_others(
    s: Control, p: Parameters, h: float, new: Floats, k: Floats
) -> None:
    """Raise tolerances of states and works to the effects of other components' errors.

    A state that follows a constrained coordinate, or the power on it, has the tolerance
    of that coordinate as its only scale; another state may follow this state. A state
    with a range of its own, far above these errors, keeps its tolerance.

    Each state is raised at most once in a step: first by coordinates and velocities,
    then by states that were raised. So the error of a stiff state raises neither its
    own tolerance nor the tolerances of states in a cycle with it, since an implicit
    method damps this error.

    h, new, k : see `allow_roundoff`.
    """
    first, waits, own = s.velocities.stop, s.far_before, sqrt(float(s.rtol))
    for i in range(s.size):
        waits[i] = 0.0 if i < first else 1.0
        s.work[i] = s.y[i]
    for i in range(first):
        s.work[i] += s.tolerances[i] if i % 2 == 0 else -s.tolerances[i]
    for _ in range(1 + s.states):
        derivative(s.t, s.work, p, s.spare)
        s.evaluations += 1.0
        s.work[: s.size] = s.y
        grown = 0
        for i in range(first, s.size):
            change = abs(s.spare[i] - k[i]) * waits[i]
            width = max(s.high[i], new[i]) - min(s.low[i], new[i])
            if i < first + s.states and not h * change > own * width:
                continue
            if change < OVERFLOW and h * change > 2.0 * s.tolerances[i]:
                grown += 1
                waits[i] = 0.0
                s.work[i] += h * change if i % 2 == 0 else -h * change
            if change < OVERFLOW:
                s.roundoff[i] = max(s.roundoff[i], change)
        set_tolerances(s, p, s.t + h, new, k, h)
        if grown == 0:
            break


# --- roundoff: its bounds in rates, and compensated sums ------------------------------
# Where a step would be rejected, or grow little: a bound of the rounding in the
# evaluation of rates, and of the effect of small changes of the state on rates.
#
# A step adds little to a state, and the rounding error of the sum grows with the steps,
# or faster. The state is y + `compensation`, which is smaller than half of y's last
# place: the error of a sum is found exactly and added with the next step (D. E. Knuth,
# The Art of Computer Programming 2, 3rd ed., section 4.2.2; E. Hairer, C. Lubich and G.
# Wanner, Geometric Numerical Integration, 2nd ed., section VIII.5: compensated
# summation).
#
# The slopes of a step are those at y alone. At tight tolerances the change of slopes by
# the compensation is found by a difference: it is as large as the rounding of forces.
#
# An arc begins with a compensation of 0, as its state is a new one, or given as
# doubles; so does a step that ends with a projection onto constraints, which rounds the
# state. And where there are switches it stays 0: steps that move by less than a
# last place would sum up to a state on the surface itself, where a root has no slope,
# instead of leaping over it.
CONSTRAINED = True
SWITCHES = True

# Roundoff relative to the effect of a unit change: values are rounded to nearest.
PROBED = 0.5
# Relative change of time, different from that of components: in a moving frame, x - v
# t, the effects would cancel.
TIME_PART = 2.0
# Rounding in the error estimate, relative to the effect of such a change.
PERTURBED = VALUE_ROUNDOFF * PROBED / TERM_ROUNDOFF
# Constants of `pseudorandom`.
GOLDEN = 0.6180339887498949
SILVER = 0.4142135623730951
SCRAMBLED = 1e4
# Directions in which a state is moved: in one alone some sum may cancel by chance.
MOST_WAYS = 2.0
# With switches, a roundoff bound does not hold for a step shorter than this part of its
# own: a component that grows by a high power of the time is much smaller in the shorter
# step, and an error of its size could lead it across its switch again and again.
SHORTER = 0.1
# A step that moves a position by less than this part of it is short.
FEW_PLACES = 2.0**-30
# Below this tolerance, which is below that of repeats of usual runs, rounding is
# reduced at any cost.
TIGHT = 5e-14
# The compensation times this factor is a relative change of y by 1e-8 at most: within
# the linear range of forces, and large against the rounding of y'.
LARGER = 2.0**26


def hardly_moves(s: Control, p: Parameters, h: float, k: Floats) -> bool:
    """Whether a step h moves a position by only a few units in its last place.

    With switches, positions at rest count: another body may set them in motion by a
    force that starts at a switch.

    k : (size,), y' at the start.
    """
    for i in range(s.n):
        moved = h * abs(k[i])
        if moved < FEW_PLACES * s.sizes[i] and (moved > 0.0 or p.surfaces > 0.0):
            return True
    return False


def limit_by_end(s: Control, p: Parameters, t: float, y: Floats) -> None:
    """Limit the roundoff bounds of the rates to a multiple of those at a step's end.

    At a root with an infinite slope (|u|^0.3 at u = 0) the bound is that of an instant,
    not of the step that leaves it.

    y : (size,), the state at the end t of the step.
    """
    rounding(t, y, p, s.point)
    singular = False
    for i in range(s.n, s.size):
        there = VALUE_ROUNDOFF * abs(s.point[i - s.n])
        singular = singular or s.roundoff[i] > SINGULAR * there > 0.0
    if not singular:
        return
    derivative(t, y, p, s.point_rates)
    perturb(s, p, t, y, s.point_rates, PROBE, 2, s.far_before)
    s.evaluations += 3.0
    for i in range(s.n, s.size):
        there = abs(s.point[i - s.n]) + PROBED * s.far_before[i] / PROBE
        there = VALUE_ROUNDOFF * (PROBED * abs(s.point_rates[i]) + there)
        if s.roundoff[i] > SINGULAR * there > 0.0:
            s.roundoff[i] = OF_INSTANT * there
            s.limited = 1.0


def bound_roundoff_between(s: Control, p: Parameters, h: float, k: Floats) -> None:
    """Extend the roundoff bound of the rates by that at the middle of a step h.

    Near a switch, forces may have no derivative that shows the effect of rounding
    (Hertz contact, a root), and the step itself may end anywhere.

    k : (size,), y' at its start.
    """
    t = s.t + 0.5 * h
    lead_positions(s, 0.5 * h, k)
    derivative(t, s.point, p, s.point_rates)
    s.evaluations += 3.0
    perturb(s, p, t, s.point, s.point_rates, TERM_ROUNDOFF, 2, s.far_before)
    for i in range(s.n, s.size):
        s.roundoff[i] = max(s.roundoff[i], PERTURBED * s.far_before[i])


def lead_positions(s: Control, h: float, k: Floats) -> None:
    """Store in `point` (size,) the state with the positions advanced by a time h.

    The positions are advanced by the velocities in k = y' (size,), or by the
    accelerations from rest.
    """
    accelerations = k[s.velocities]
    s.point[: s.size] = s.y
    for i in range(s.n):
        s.point[i] += h * k[i] if k[i] != 0.0 else 0.5 * h * h * accelerations[i]


def add_bound(
    s: Control, p: Parameters, t: float, y: Floats, first: int, end: int
) -> None:
    """Raise the roundoff bounds of components first ... end - 1 to those at (t, y).

    y : (size,), the state.
    """
    rounding(t, y, p, s.work)
    for i in range(first, end):
        found = abs(s.work[i - s.n])
        if found < OVERFLOW:
            s.roundoff[i] = max(s.roundoff[i], VALUE_ROUNDOFF * found)


def set_reach(s: Control, p: Parameters, y: Floats, k: Floats, h: float) -> None:
    """Set the largest size of each component in a step h from y, with y' = k at y.

    The sizes are stored in `reach`. With switches, the size of a velocity is that at y:
    a force with a root of the velocity is steep at rest, and the change of the velocity
    in the step is no rounding.
    """
    accelerations = k[s.velocities]
    for i in range(s.size):
        after = y[i]
        if p.surfaces == 0.0 or i < s.n or i >= s.velocities.stop:
            after += h * k[i]
        if i < s.n:
            after += 0.5 * h * h * accelerations[i]
        s.reach[i] = abs(y[i])
        if abs(after) < OVERFLOW:
            s.reach[i] = max(s.reach[i], abs(after))


def perturb(
    s: Control,
    p: Parameters,
    t: float,
    y: Floats,
    rates: Floats,
    change: float,
    ways: int,
    out: Floats,
) -> None:
    """Compute the change of rates (size,) at (t, y) by a relative change of y and t.

    rates : (size,), y' at (t, y).
    change : the relative change.
    ways : 1 or 2, the number of directions in which components are changed: in one
        alone, terms may cancel by chance.
    out : (size,), the largest change of each rate; a rate that is not finite counts as
        unchanged.
    """
    size = s.size
    out[:size] = 0.0
    for way in range(ways):
        part = change if way == 0 else -change
        move_aside(size, y, s.reach, part, way, s.work)
        derivative(t * (1.0 + TIME_PART * part), s.work, p, s.spare)
        for i in range(size):
            moved = abs(s.spare[i] - rates[i])
            if moved < OVERFLOW:
                out[i] = max(out[i], moved)


def bound_roundoff(
    s: Control,
    p: Parameters,
    t: float,
    y: Floats,
    k: Floats,
    sigma: float,
    h: float,
    ways: int,
) -> None:
    """Bound the roundoff of the rates k (size,) at (t, y), for a step h from y (size,).

    The bound is that of the rounding in the evaluation, plus the change of y' at states
    moved by rounding in `ways` (1 or 2) directions. At a start, h = 0, and the bound is
    renewed with the first step.

    sigma : 1, or less where rows are close to a loss of rank, which enlarges the first
        bound; y' off the constraints is of no use there.
    """
    n, roundoff = s.n, s.roundoff
    s.steady = 0.0
    rounding(t, y, p, s.work)
    larger = 1.0 / max(sigma, float(s.lost_below))
    for i in range(n, s.size):
        roundoff[i] = larger * abs(s.work[i - n])
    if sigma >= 1.0:
        s.bounded_step = h
        set_reach(s, p, y, k, h)
        perturb(s, p, t, y, k, PROBE, ways, s.far_before)
        s.evaluations += ways
        for i in range(n, s.size):
            roundoff[i] += PROBED * s.far_before[i] / PROBE
    for i in range(n, s.size):
        if not roundoff[i] < OVERFLOW:
            roundoff[i] = 0.0
        roundoff[i] = VALUE_ROUNDOFF * (PROBED * abs(k[i]) + roundoff[i])


def move_aside(
    size: int, y: Floats, sizes: Floats, change: float, way: int, out: Floats
) -> None:
    """Write y + change * part * sizes (size,) to out, with a part for each component.

    The parts are pseudorandom, in one of two directions (way 0 or 1): a common change
    of size or place of the whole model would not reveal cancellation. In the second
    direction neighbours change by parts from different halves, since their parts in the
    first one may be equal by chance.
    """
    for i in range(size):
        part = pseudorandom(i, way)
        if way > 0:
            part = 0.5 * (part + (i + 1) % 2)
        out[i] = y[i] + change * sizes[i] * (0.5 + part)


def pseudorandom(i: int, way: int) -> float:
    """Return a pseudorandom number in [0, 1) for component i and direction `way`.

    Multiples of an irrational number are unsuitable: their second differences are
    integers or 0, so that forces between neighbours would often seem to have no error.
    """
    part = GOLDEN * (i + 1) + SILVER * way
    part = SCRAMBLED / (1.0 + part - int(part))
    return part - int(part)


def add_exactly(
    size: int, y: Floats, k: Floats, h: float, new: Floats, left: Floats
) -> None:
    """Write y + h k (size,) to `new`, and add the rounding error of the sum to left."""
    for i in range(size):
        before = y[i]
        rate = k[i]
        moved = h * rate
        cut = fused(h, rate, -moved)
        after = before + moved
        back = after - before
        cut += (before - (after - back)) + (moved - back)
        new[i] = after
        left[i] += cut


def add_change(s: Control, p: Parameters, k: Floats, h: float, new: Floats) -> None:
    """Add the small terms of compensated summation to the new state `new` (size,).

    The terms are `remainder`, the old state's `compensation`, and, where rtol < TIGHT,
    the effect of the compensation on y' in the step h. The part that rounding leaves
    over is stored in `remainder`.

    k : (size,), y' at the start of the step.
    """
    s.remainder[:] += s.compensation
    if s.rtol < TIGHT:
        drift = s.spare
        find_drift(s, p, k, drift)
        add_drift(s, drift, h)
    add_compensated(s.size, new, s.remainder, new, s.remainder)


def find_drift(s: Control, p: Parameters, k: Floats, out: Floats) -> None:
    """Compute the change of y' that the compensation term of the state y causes.

    The change is stored in out (size,); the change is 0 with constraints or switches.

    k : (size,), y' at y.
    """
    size = s.size
    if CONSTRAINED or SWITCHES:
        out[:size] = 0.0
        return
    s.work[:size] = s.y + LARGER * s.compensation
    derivative(s.t, s.work, p, out)
    s.evaluations += 1.0
    for i in range(size):
        drift = (out[i] - k[i]) / LARGER
        out[i] = drift if abs(drift) < OVERFLOW else 0.0


def add_drift(s: Control, drift: Floats, h: float) -> None:
    """Add to `remainder` the displacement in a step h by the compensation term.

    drift : (size,), the change of y' by the compensation, see `find_drift`.
    """
    accelerations = drift[s.velocities]
    for i in range(s.size):
        s.remainder[i] += h * drift[i]
        if i < s.n:
            s.remainder[i] += 0.5 * h * h * accelerations[i]


def keep_compensation(s: Control) -> None:
    """Set the state's `compensation` to the roundoff of the accepted step, `remainder`.

    With constraints or switches it is set to 0.
    """
    if CONSTRAINED or SWITCHES:
        drop_compensation(s)
        return
    for i in apart(s.size):
        s.compensation[i] = s.remainder[i]


def drop_compensation(s: Control) -> None:
    """Set the compensation term to 0."""
    s.compensation[:] = 0.0


def add(n: int, y: Floats, compensation: Floats, h: float, rate: Floats) -> None:
    """Add h * rate to y (n,) by compensated summation.

    compensation : (n,), the compensation of y, which is updated.
    """
    compensation[:n] += h * rate[:n]
    add_compensated(n, y, compensation, y, compensation)


def add_compensated(
    n: int, y: Floats, change: Floats, out: Floats, left: Floats
) -> None:
    """Write y + change (n,) to out, and its rounding error to left.

    out and left may be y and change.
    """
    for i in apart(n):
        before = y[i]
        more = change[i]
        after = before + more
        moved = after - before
        out[i] = after
        left[i] = (before - (after - moved)) + (more - moved)
