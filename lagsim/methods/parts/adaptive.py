"""What methods that choose their steps have in common: the step to try, and its bound.

Whether an explicit method's step is held by stability is seen at no cost. Two states at
the same time, close together, and y' at both: the quotient of the differences tells how
fast the fastest motion is, which is what they differ in when the step is at the bound.
In the metric of the energy, sqrt(|da| / |dq|) is the frequency of an undamped
oscillation in any phase and the rate of one that is damped, |da| / |dv| is at most
that, and serves where dq is below rounding.

Source: E. Hairer and G. Wanner, Solving Ordinary Differential Equations II, 2nd ed.,
section IV.2 (automatic stiffness detection), for systems of first order.
"""

from __future__ import annotations

from math import sqrt
from typing import TYPE_CHECKING

from lagsim.methods.parts.parameters import Parameters
from lagsim.methods.parts.singular import clear_of_loss
from lagsim.methods.parts.state import State

if TYPE_CHECKING:
    from lagsim.language.arrays import Floats

CONSTRAINED = True

# Steps towards what happens at its own time are this part of the way to it.
CLOSER = 0.25

# Below this many units in the last place of t a step makes no progress.
SMALLEST = 8.0 * 2.0**-52

# What is closer than so many of the smallest steps has been reached.
REACHED = 4.0

# A step past this part of the limit is at the bound: step control holds it between
# this and a little more than 1, and accuracy asks for less than a tenth of it.
PART = 0.5
# So many steps in a row below it, and there is no bound.
CLEAR = 6.0


def usable_step(s: State, p: Parameters) -> float:
    """Give the step to try, with t + h exact; 0 where it would be too small."""
    t = s.t
    h = s.h
    if s.most_step > 0.0:
        h = min(h, s.most_step)
    if s.feature_width > 0.0:
        h = up_to_feature(s, h)
    rest = s.end - t
    passes = False
    if CONSTRAINED:
        # A step over a loss of rank has the length that it needs, whatever is asked.
        h = clear_of_loss(s, p, h, rest)
        passes = s.passes > 0.0
    if s.longest > 0.0 and not passes:
        h = min(h, s.longest)
    # Not t + 1.01 h >= END: rounded, that holds for ever at the last digit of t.
    if 1.01 * h >= rest:
        return float(rest)
    if not h > SMALLEST * max(abs(t), 1e-6 * rest):
        return 0.0
    return float((t + h) - t)


def up_to_feature(s: State, h: float) -> float:
    """Give the step, no longer than what happens at its own time lets it be.

    It ends where that begins; from there steps shrink with the way left to it.
    """
    away = s.feature - s.t
    before = away - s.feature_reach - s.feature_width
    if before > REACHED * SMALLEST * abs(s.t):
        return float(min(h, before))
    if away < -s.feature_reach:
        return h
    return float(min(h, max(s.feature_width, CLOSER * abs(away))))


def record_speed(
    s: State, h: float, limit: float, y: Floats, k: Floats, z: Floats, slope: Floats
) -> None:
    """Note the fastest motion, from states y and z with slopes k and `slope`."""
    n = s.n
    masses = s.masses
    positions = 0.0
    velocities = 0.0
    accelerations = 0.0
    for i in range(n):
        dq = y[i] - z[i]
        dv = y[n + i] - z[n + i]
        da = k[n + i] - slope[n + i]
        positions += masses[i] * dq * dq
        velocities += masses[i] * dv * dv
        accelerations += masses[i] * da * da
    s.speed = 0.0
    if positions > 0.0:
        s.speed = sqrt(sqrt(accelerations / positions))
    moved = velocities + sqrt(accelerations) * sqrt(positions)
    if moved > 0.0:
        s.speed = max(float(s.speed), sqrt(accelerations / moved))
    if h * s.speed > PART * limit:
        s.at_bound += 1.0
        s.off_bound = 0.0
    else:
        s.off_bound += 1.0
        if s.off_bound >= CLEAR:
            s.at_bound = 0.0
