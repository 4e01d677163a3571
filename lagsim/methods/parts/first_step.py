"""The first step of an arc, and the sizes that components at rest reach in an instant.

Each component has its own scale, and at a start from rest it has none: the first
instant of the motion gives one.
"""

from __future__ import annotations

from lagsim.language.arrays import Floats
from lagsim.methods.parts.control import (
    FLOOR,
    INSTANT,
    Control,
    bound_roundoff,
    forget_roundoff,
    set_tolerances,
)
from lagsim.methods.parts.onset import forget_onsets
from lagsim.methods.parts.parameters import Parameters
from lagsim.methods.parts.state import LOCAL, derivative, rounding
from lagsim.tolerances import OVERFLOW, STATE_ROUNDOFF

# Length of the trial Euler step, relative to the output step; largest factor of growth;
# number of trials.
EULER = 1e-2
FARTHEST = 100.0
MOST_GUESSES = 20
# Largest angle, in radians, by which the fastest oscillation turns in the first step of
# an implicit method.
OSCILLATIONS = 30.0
# Largest relative change of the square of an angle, where half a step has a quarter.
PROPORTIONAL = 0.2
# Least factor by which the trial Euler step is shortened if its end is far outside.
SHORTEST = 1e-3


def foresee(s: Control, p: Parameters, k: Floats) -> None:
    """Compute the sizes that components at rest reach in the first instant of an arc.

    The sizes are stored in `foreseen`. A component at rest may be set in motion by a
    force that starts from 0 as a power of the time, or by another component. For a
    first-order state at rest whose rate is a sum of terms that cancel, by a symmetry
    that later motion breaks, a small part of the terms is used. This is not done for
    velocities: the forces on a body at rest cancel for as long as it rests.

    k : (size,), y' at the start.
    """
    forget_onsets(s)
    n, y, foreseen, z = s.n, s.y, s.foreseen, s.work
    slopes, accelerations = s.spare, k[s.velocities]
    instant = INSTANT * (s.end - s.t)
    waiting = 0
    for i in range(s.size):
        foreseen[i] = 0.0
        z[i] = y[i] + instant * k[i]
        if i < n:
            z[i] += instant * instant * accelerations[i]
        elif abs(k[i]) <= s.roundoff[i]:
            waiting += 1
    first = n
    while waiting > 0:
        if first > n:
            rounding(s.t + instant, z, p, slopes[n:])
            slopes[n : s.size] = FLOOR * slopes[n : s.size]
        else:
            derivative(s.t + instant, z, p, slopes)
            s.evaluations += 1.0
        set_off = start_moving(s, k, instant, first)
        waiting -= set_off
        if set_off == 0 and (first > n or s.states == 0):
            return
        first = s.velocities.stop if set_off == 0 else n


def start_moving(s: Control, k: Floats, instant: float, first: int) -> int:
    """Move components that were at rest so far, for the time `instant`.

    The rates are in `spare`. Update the state after that time, in `work`, and the sizes
    in `foreseen`, see `foresee`. Return the number of components that begin to move.

    k : (size,), y' at the start.
    first : index of the first component that may move.
    """
    n, y, foreseen, z, slopes = s.n, s.y, s.foreseen, s.work, s.spare
    set_off = 0
    for i in range(first, s.size):
        rate = abs(slopes[i])
        rests = abs(k[i]) <= s.roundoff[i] and foreseen[i] == 0.0
        if rests and s.roundoff[i] < rate and rate < OVERFLOW:
            foreseen[i] = instant * rate
            z[i] = y[i] + instant * slopes[i]
            if i < s.velocities.stop:
                foreseen[i - n] = instant * foreseen[i]
                z[i - n] = y[i - n] + instant * instant * slopes[i]
            set_off += 1
    return set_off


def first_step(s: Control, p: Parameters, order: int, k: Floats) -> float:
    """Return the length of the first step of an arc, from an explicit Euler step.

    The change of the rates in the Euler step is compared with the rates: with the step
    returned, an error that falls as the power `order` of the step, relative to that
    change, is within the tolerance.

    k : (size,), y' at the start.
    """
    z, slopes = s.work, s.spare
    bound_roundoff(s, p, s.t, s.y, k, 1.0, 0.0, 1)
    foresee(s, p, k)
    span = s.end - s.t
    h = min(EULER * s.row_step, span)
    part = (LOCAL * max(float(s.rtol), STATE_ROUNDOFF)) ** (1.0 / order)
    guess = h
    for _ in range(MOST_GUESSES):
        z[: s.size] = s.y + h * k[: s.size]
        derivative(s.t + h, z, p, slopes)
        s.evaluations += 1.0
        # Components at rest have a scale after the trial step.
        set_tolerances(s, p, s.t + h, z, slopes, h)
        guess = min(part * time_of_change(s, h, k, slopes), FARTHEST * h)
        if guess > 0.1 * h:
            break
        h = guess
    forget_roundoff(s)  # the bound is that of an instant
    return float(min(guess, span))


def within_oscillation(s: Control, p: Parameters, h: float, k: Floats) -> float:
    """Return a first step, h or shorter, that is no longer than some oscillations.

    The error estimate of an implicit method is too small where a step has hundreds of
    oscillations. An angle that is not proportional to the step is that of no
    oscillation: a force that begins at 0 moves a coordinate more and more.

    k : (size,), y' at the start.
    """
    if s.n == 0:
        return h
    shorter, turned = h, angle_squared(s, p, h, k)
    for _ in range(MOST_GUESSES):
        if turned < OSCILLATIONS * OSCILLATIONS:
            break
        shorter = shorter / turned**0.5
        turned = angle_squared(s, p, shorter, k)
    if shorter < h:
        quarter = angle_squared(s, p, 0.5 * shorter, k)
        is_proportional = abs(4.0 * quarter - turned) < PROPORTIONAL * turned
        return shorter if is_proportional else h
    return h


def angle_squared(s: Control, p: Parameters, h: float, k: Floats) -> float:
    """Return the square of the largest angle by which an oscillation turns over h.

    In the explicit Euler step of `first_step` a coordinate at rest does not move, so
    that no acceleration changes. Here coordinates move with constant accelerations over
    h. From the change of an acceleration, relative to the displacement, follows the
    square of a frequency.

    k : (size,), y' at the start.
    """
    n, z, slopes, accelerations = s.n, s.work, s.spare, k[s.velocities]
    z[: s.size] = s.y + h * k[: s.size]
    for i in range(n):
        z[i] += 0.5 * h * h * accelerations[i]
    derivative(s.t + h, z, p, slopes)
    s.evaluations += 1.0
    turned = 0.0
    for i in range(n):
        moved = abs(z[i] - s.y[i])
        change = h * h * abs(slopes[n + i] - k[n + i])
        if moved > s.roundoff[i] and change < OVERFLOW:
            turned = max(turned, change / moved)
    return turned


def time_of_change(s: Control, h: float, k: Floats, slopes: Floats) -> float:
    """Return the least time h |y_i'| / |change of y_i'| over all components i.

    Components whose rate begins at 0, or changes within the tolerance, are omitted. The
    result is OVERFLOW if all are omitted, and h/1000 if a rate is not finite. The rate
    of a first-order state that changes its sign is never omitted, and contributes at
    least h/1000: the state is stiff, and the Euler step ends far past its equilibrium.

    k, slopes : (size,), y' at the start and at the end of the Euler step of length h.
    """
    least = OVERFLOW
    for i in range(s.size):
        change = abs(slopes[i] - k[i])
        if not change < OVERFLOW:
            return SHORTEST * h
        begins = abs(k[i]) <= 0.1 * abs(slopes[i])
        is_state = 0 <= i - s.velocities.stop < s.states  # works follow these
        turns = is_state and k[i] * slopes[i] < 0.0
        if h * change > s.tolerances[i] and (turns or not begins):
            found = h * abs(k[i]) / change
            least = min(least, max(found, SHORTEST * h) if turns else found)
    return least
