"""What rounding leaves in the rates of a state, where a step would be rejected.

A bound of what is rounded on the way to them, and what small changes of the state do.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from lagsim.methods.parts.interface import derivative, rounding
from lagsim.methods.parts.parameters import Parameters
from lagsim.methods.parts.state import State
from lagsim.native.kernels.words import rare

if TYPE_CHECKING:
    from lagsim.language.arrays import Floats

# Rates of the size of one leave so much in the error estimate, by their rounding.
RATE_NOISE = 32.0 * 2.0**-53
# Of what a relative change of the state by one would do; it is rounded to nearest.
PROBED = 0.5
# A relative change of the state this small shows what its rounding does to y'.
PROBE = 2.0**-36
# And so does one of some last places. A step that moves by fewer than so many is short.
ROUNDED = 2.0**-50
FEW_PLACES = 2.0**-30


def hardly_moves(s: State, h: float, k: Floats) -> bool:
    """Tell whether a step moves a position by few of its last places."""
    sizes = s.sizes
    for i in range(s.n):
        moved = h * abs(k[i])
        if moved > 0.0 and moved < FEW_PLACES * sizes[i]:
            return True
    return False


@rare
def look_between(s: State, p: Parameters, h: float, k: Floats) -> None:
    """Take what rounding does to the rates in the middle of a step h for noise too.

    Beside a switch forces may have no slope that tells: those of Hertz, or a root. The
    step itself may lead anywhere. k : (size,), y' at its start.
    """
    size = s.size
    n = s.n
    y = s.y
    noise = s.noise
    z = s.work
    slopes = s.spare
    middle = s.look
    rates = s.look_rates
    t = s.t + 0.5 * h
    for i in range(size):
        middle[i] = y[i] + 0.5 * h * k[i] if i < n else y[i]
    derivative(t, middle, p, rates)
    s.evaluations += 3.0
    for way in range(2):
        change = ROUNDED if way == 0 else -ROUNDED
        move_aside(size, middle, change, z)
        derivative(t, z, p, slopes)
        for i in range(n, size):
            found = RATE_NOISE * PROBED / ROUNDED * abs(slopes[i] - rates[i])
            if found < 1e300:
                noise[i] = max(noise[i], found)


@rare
def look_at_rounding(
    s: State, p: Parameters, t: float, y: Floats, k: Floats, health: float
) -> None:
    """Find what rounding leaves in the rates k (size,) at y, for this step.

    From a bound of what is rounded on the way, and from y' nearby. A health below 1 is
    that of rows close to a loss of rank, which enlarges the former; y' off the
    constraints says nothing there.
    """
    size = s.size
    n = s.n
    noise = s.noise
    z = s.work
    rounding(t, y, p, z)
    larger = 1.0 / max(health, float(s.lost_below))
    for i in range(n, size):
        noise[i] = larger * abs(z[i - n])
    if health >= 1.0:
        add_probe(s, p, t, y, k)
    for i in range(n, size):
        if not noise[i] < 1e300:
            noise[i] = 0.0
        noise[i] = RATE_NOISE * (PROBED * abs(k[i]) + noise[i])


@rare
def add_probe(s: State, p: Parameters, t: float, y: Floats, k: Floats) -> None:
    """Add what the rounding of the state does to its rates k."""
    size = s.size
    n = s.n
    noise = s.noise
    z = s.work
    slopes = s.spare
    move_aside(size, y, PROBE, z)
    derivative(t * (1.0 + PROBE), z, p, slopes)
    s.evaluations += 1.0
    for i in range(n, size):
        noise[i] += PROBED * abs(slopes[i] - k[i]) / PROBE


@rare
def move_aside(size: int, y: Floats, change: float, out: Floats) -> None:
    """Give y with a relative change.

    Components change by different parts, or a change of the whole scene's size or
    place would hide what cancels.
    """
    for i in range(size):
        part = 0.618033988749895 * (i + 1)
        out[i] = y[i] * (1.0 + change * (0.5 + part - int(part)))
