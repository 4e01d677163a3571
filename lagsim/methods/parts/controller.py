"""Error tolerances from each component's own scale, and the first step.

The default tolerance of a component is rtol times its own scale: the range that it has
gone through, which no shift of the origin and no other body changes, or what its rate
does in the step. Where forces cancel, what each of them could do counts a little too.
And no component is controlled below its own rounding: that of its value, and that of
its rate. The latter is looked at where a step would be rejected: what the rounding of
the state does to it, and what is rounded where it is computed. No unit enters: metres
and millimetres give the same steps.
"""

from __future__ import annotations

from math import sqrt
from typing import TYPE_CHECKING

from lagsim.methods.parts.interface import derivative, measure, rounding, terms
from lagsim.methods.parts.noise import (
    RATE_NOISE,
    TIGHT,
    hardly_moves,
    look_ahead,
    look_at_rounding,
    look_between,
)
from lagsim.methods.parts.parameters import Parameters
from lagsim.methods.parts.state import State
from lagsim.native.kernels.words import at

if TYPE_CHECKING:
    from lagsim.language.arrays import Floats

# Of what the terms of a rate could do in a step, though they cancel: errors of other
# components within the tolerance leave a part of them.
FLOOR = 1e-3
# Of the tolerances of what rows link it with, a component's own. Off the constraints,
# in the stages of a step, errors of one act on the others; projection takes them out.
# A tenth of it costs Bricard's mechanism twice the steps; others hardly notice either.
LEAK = 1e-2
# What of its range counts as the size of a component: an oscillation about 0 is half of
# it in size, a motion away from 0 the whole.
WIDTH = 0.7
# Of the length of an arc: too short to matter.
INSTANT = 1e-6
# A value is not known better than this part of itself.
NOISE = 4.0 * 2.0**-53
# At tight tolerances the floor is a part of the last place: truncation up to NOISE acts
# the same way in every step and so outgrows rounding, of which sums lose little.
FINEST = 2.0**-55
# Below this a number has no digits to control: some of the smallest steps between two.
UNDERFLOW = 2.0**-1068
# The square of this is finite.
HUGE = 1e140
# The first step of all, an Euler step, is this part of what lies between two rows; and
# how much longer the next may be, and how often the guess is made again.
EULER = 1e-2
FARTHEST = 100.0
MOST_GUESSES = 20
# The part of the tolerance that one step may use: errors of many steps add up, and the
# tolerance is meant for the motion (Kepler's, e = 0.6, 100 orbits: 6 digits at 1e-11).
LOCAL = 0.1

SWITCHES = True


def record_sizes(s: State, p: Parameters) -> None:
    """Take the state, accepted, into the largest sizes and the energy."""
    take_measure(s, s.t, s.y, p)
    record_measured(s, p)


def record_measured(s: State, p: Parameters) -> None:
    """Do the same where `set_tolerances` has measured this state last."""
    record_extents(s)
    s.energy = energy_scale(s)
    n = s.n
    masses = s.masses
    parts = s.parts
    terms(s.t, s.y, p, parts)
    # From here on as accelerations, and the whole in the metric of M.
    pushes = s.pushes
    pushes[0] = 0.0
    for i in range(n):
        push = parts[i]
        parts[i] = 0.0
        if masses[i] > 0.0:
            part = push / masses[i]
            pushes[0] += push * part
            parts[i] = part
        parts[n + i] = parts[i]


def record_extents(s: State) -> None:
    """Take the state into the largest sizes: all that a fixed step asks for."""
    size = s.size
    y = s.y
    sizes = s.sizes
    low = s.low
    high = s.high
    noise = s.noise
    for i in range(size):
        now = y[i]
        sizes[i] = max(sizes[i], abs(now))
        low[i] = min(low[i], now)
        high[i] = max(high[i], now)
        noise[i] = 0.0
    s.looked = 0.0


def take_measure(s: State, t: float, y: Floats, p: Parameters) -> None:
    """Leave what `measure` gives in the state."""
    measure(t, y, p, s.measured)
    if s.evaluations <= 1.0:
        s.potential = s.energies[1]


def energy_scale(s: State) -> float:
    """Give the largest kinetic energy or change of potential, what is measured too."""
    energies = s.energies
    change = abs(energies[1] - s.potential)
    return max(float(s.energy), abs(float(energies[0])), float(change))


def set_tolerances(
    s: State, p: Parameters, t: float, new: Floats, rates: Floats, h: float
) -> None:
    """Set the tolerance of each component for a step of length h to `new` at t.

    new, rates : (size,), the state after the step and y' before it. A tolerance of 0
    means that the component has no scale and is not controlled.
    """
    take_measure(s, t, new, p)
    size = s.size
    n = s.n
    y = s.y
    sizes = s.sizes
    tolerances = s.tolerances
    if s.atol >= 0.0:
        for i in range(size):
            scale = max(abs(y[i]), abs(new[i]))
            tolerances[i] = LOCAL * (s.atol + s.rtol * scale)
        return
    low = s.low
    high = s.high
    parts = s.parts
    noise = s.noise
    foreseen = s.foreseen
    law_pushes = p.law_pushes
    # A start from rest with a jump in the force (dry friction) is off by the same part
    # of every step, however short; its first instant is not controlled finer.
    instant = INSTANT * (s.end - s.arc_start) - (s.t - s.arc_start)
    instant = max(instant, 0.0)
    moment = max(h, instant)
    rtol = LOCAL * s.rtol
    floor = FINEST if s.rtol < TIGHT else NOISE
    for i in range(size):
        after = new[i]
        rate = abs(rates[i])
        width = max(high[i], after) - min(low[i], after)
        sized = WIDTH * width if width > 0.0 else h * rate
        if instant > 0.0:
            sized = max(sized, instant * rate, foreseen[i])
        part = parts[i]
        if p.laws > 0:
            part = max(part, law_pushes[i])
        if i < n:
            # Positions: what their velocities do in the step.
            part *= moment
            noise[i] = max(floor * rate, noise[n + i] * h)
            sized = max(sized, instant * instant * abs(rates[n + i]))
        sized = max(sized, FLOOR * moment * part)
        rough = floor * max(sizes[i], abs(after))
        rough = max(rough, noise[i] * h, UNDERFLOW)
        tolerances[i] = max(rtol * sized, rough)
    if p.m > 0:
        share_tolerances(s)
    if size > 2 * n:
        limit_works(s, p, new)


def share_tolerances(s: State) -> None:
    """Control no coordinate far finer than those that rows link it with.

    In the metric of M, in which projection turns errors of one into errors of another:
    what rests by symmetry has no motion of its own to be controlled by.
    """
    n = s.n
    masses = s.masses
    linked = s.linked
    shared = s.shared
    for level in range(2):
        tolerances = at(s.tolerances, level * n)
        for i in range(n):
            shared[i] = 0.0
        for i in range(n):
            k = int(linked[i])
            tolerance = tolerances[i]
            if masses[i] > 0.0:
                shared[k] = max(shared[k], masses[i] * tolerance * tolerance)
        for i in range(n):
            if masses[i] > 0.0:
                most = sqrt(shared[int(linked[i])] / masses[i])
                tolerances[i] = max(tolerances[i], LEAK * most)


def against(error: float, tolerance: float) -> float:
    """Give an error in units of the tolerance; one that is finite has a finite square.

    It may be rounding, though much more than a component that rests should have.
    """
    part = abs(error / tolerance)
    if abs(error) < 1e300:
        part = min(part, HUGE)
    return part


def limit_works(s: State, p: Parameters, new: Floats) -> None:
    """Control works no finer than the energy that each is compared with."""
    n = s.n
    tolerances = s.tolerances
    masses = s.masses
    worked = p.worked
    energies = s.shared
    works = p.works
    for k in range(works):
        energies[k] = 0.0
    if works > 0:
        for i in range(n):
            own = int(worked[i])
            off = tolerances[n + i]
            energy = abs(masses[i]) * (abs(new[n + i]) + off) * off
            if own >= 0:
                energies[own] += energy
    for k in range(works):
        tolerances[2 * n + k] = max(tolerances[2 * n + k], energies[k])


def look_again(
    s: State, p: Parameters, h: float, new: Floats, k: Floats, health: float
) -> bool:
    """Look at the rounding in a step h to `new`, and set the tolerances by it.

    Tells whether that had not been done. k : (size,), y' at the start of the step.
    """
    if s.looked > 0.0:
        return False
    size = s.size
    n = s.n
    t = s.t
    look_at_rounding(s, p, t, s.y, k, health)
    if SWITCHES and hardly_moves(s, p, h, k):
        look_between(s, p, h, k)
    if SWITCHES and health >= 1.0 and (p.laws > 0 or p.sliding > 0.0):
        look_ahead(s, p, h, k)
    if size > 2 * n:
        # The power of forces has no rounding where everything rests, at the start.
        noise = s.noise
        z = s.work
        rounding(t + h, new, p, z)
        for i in range(2 * n, size):
            if abs(z[i - n]) < 1e300:
                noise[i] = max(noise[i], RATE_NOISE * abs(z[i - n]))
        # Nor has it where rows balance them, or surfaces, but velocities have.
        if (p.m > 0 or p.sliding > 0.0) and p.works > 0:
            worked = p.worked
            for i in range(n):
                own = 2 * n + int(worked[i])
                power = abs(s.masses[i]) * s.parts[i] * noise[n + i] * h
                if own >= 2 * n:
                    noise[own] = max(noise[own], power)
    set_tolerances(s, p, t + h, new, k, h)
    s.looked = 1.0
    return True


def foresee(s: State, p: Parameters, k: Floats) -> None:
    """Find what becomes of the components at rest in the first instant of an arc.

    A force that begins at 0, as a power of the time does, gives them a motion without
    any size. One may set the next in motion. k : (size,), y' at the start.
    """
    size = s.size
    n = s.n
    y = s.y
    noise = s.noise
    foreseen = s.foreseen
    z = s.work
    slopes = s.spare
    instant = INSTANT * (s.end - s.t)
    waiting = 0
    for i in range(size):
        foreseen[i] = 0.0
        z[i] = y[i] + instant * k[i]
        if i < n:
            z[i] += instant * instant * k[n + i]
        elif abs(k[i]) <= noise[i]:
            waiting += 1
    while waiting > 0:
        derivative(s.t + instant, z, p, slopes)
        s.evaluations += 1.0
        before = waiting
        for i in range(n, size):
            rate = abs(slopes[i])
            rests = abs(k[i]) <= noise[i] and foreseen[i] == 0.0
            if rests and noise[i] < rate and rate < 1e300:
                foreseen[i] = instant * rate
                z[i] = y[i] + instant * slopes[i]
                if i < 2 * n:
                    foreseen[i - n] = instant * foreseen[i]
                    z[i - n] = y[i - n] + instant * instant * slopes[i]
                waiting -= 1
        if waiting == before:
            return


def first_step(s: State, p: Parameters, order: int, k: Floats) -> float:
    """Give a first step: one explicit Euler step tells how fast the rates change.

    k : (size,) is y' at the start. An error that falls with this power of the step,
    against that change, is within the tolerance.
    """
    size = s.size
    y = s.y
    z = s.work
    slopes = s.spare
    look_at_rounding(s, p, s.t, y, k, 1.0)
    foresee(s, p, k)
    span = s.end - s.t
    h = min(EULER * s.row_step, span)
    part = (LOCAL * max(float(s.rtol), NOISE)) ** (1.0 / order)
    guess = h
    for _ in range(MOST_GUESSES):
        for i in range(size):
            z[i] = y[i] + h * k[i]
        derivative(s.t + h, z, p, slopes)
        s.evaluations += 1.0
        # What rests has a scale by now.
        set_tolerances(s, p, s.t + h, z, slopes, h)
        guess = min(part * time_of_change(s, h, k, slopes), FARTHEST * h)
        if guess > 0.1 * h:
            break
        h = guess
    return float(min(guess, span))


def time_of_change(s: State, h: float, k: Floats, slopes: Floats) -> float:
    """Give the time in which a rate changes by its own size: from k to `slopes` in h.

    Rates that begin at 0 do not count, nor do changes within the tolerances.
    """
    tolerances = s.tolerances
    least = 1e300
    for i in range(s.size):
        change = abs(slopes[i] - k[i])
        if not change < 1e300:
            return 1e-3 * h
        if h * change > tolerances[i] and abs(k[i]) > 0.1 * abs(slopes[i]):
            least = min(least, h * abs(k[i]) / change)
    return least
