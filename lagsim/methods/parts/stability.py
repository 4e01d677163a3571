"""Whether an explicit method's step is held by stability, seen at no cost.

Two states at the same time, close together, and y' at both: the quotient of the
differences tells how fast the fastest motion is, which is what they differ in when the
step is at the bound. In the metric of the energy, sqrt(|da| / |dq|) is the frequency
of an undamped oscillation in any phase and the rate of one that is damped, |da| / |dv|
is at most that, and serves where dq is below rounding.

Source: E. Hairer and G. Wanner, Solving Ordinary Differential Equations II, 2nd ed.,
section IV.2 (automatic stiffness detection), for systems of first order.
"""

from __future__ import annotations

from math import sqrt
from typing import TYPE_CHECKING

from lagsim.methods.parts.state import State

if TYPE_CHECKING:
    from lagsim.language.arrays import Floats

# A step past this part of the limit is at the bound: step control holds it between
# this and a little more than 1, and accuracy asks for less than a tenth of it.
PART = 0.5
# So many steps in a row below it, and there is no bound.
CLEAR = 6.0


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
