"""What rounding does: what it leaves in rates, and sums that carry what it cuts off.

Where a step would be rejected, a bound of what is rounded on the way to the rates of a
state, and what small changes of the state do to them.

A step adds little to a state, and what is lost of it each time grows with the steps, or
faster. The state is y and `rest`, which is smaller than half of y's last place: what is
cut off is found exactly and added with the next step (D. E. Knuth, The Art of Computer
Programming 2, 3rd ed., section 4.2.2; E. Hairer, C. Lubich and G. Wanner, Geometric
Numerical Integration, 2nd ed., section VIII.5: compensated summation).

The slopes of a step are those at y alone. Where the tolerance is tight what they lack
is found by a difference: that is as much as the rounding of forces does.

An arc begins without a rest, as its state is a new one, or given as doubles; so does a
step that ends with a projection onto constraints, which rounds all that it moves. And
where there are switches there is none: steps that move by less than a last place would
sum up to a state on the surface itself, where a root has no slope, instead of leaping
over it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from lagsim.methods.parts.interface import derivative, rounding
from lagsim.methods.parts.parameters import Parameters
from lagsim.methods.parts.state import State
from lagsim.native.kernels.words import apart, fused

if TYPE_CHECKING:
    from lagsim.language.arrays import Floats

CONSTRAINED = True
SWITCHES = True

# Rates of the size of one leave so much in the error estimate, by their rounding.
RATE_NOISE = 32.0 * 2.0**-53
# Of what a relative change of the state by one would do; it is rounded to nearest.
PROBED = 0.5
# A relative change of the state this small shows what its rounding does to y'.
PROBE = 2.0**-36
# And so does one of some last places. A step that moves by fewer than so many is short.
ROUNDED = 2.0**-50
# Of what that does, what rounding leaves in the error estimate.
SHAKEN = RATE_NOISE * PROBED / ROUNDED
FEW_PLACES = 2.0**-30
# Below this tolerance, which no repeat of a usual run has, as much is done against
# rounding as can be.
TIGHT = 5e-14
# So much larger a rest is a change of y by a relative 1e-8 at most: little beside what
# bends the forces, and much beside the rounding of y'.
LARGER = 2.0**26


def hardly_moves(s: State, p: Parameters, h: float, k: Floats) -> bool:
    """Tell whether a step moves a position by few of its last places.

    What rests counts where there are switches: another body may set it in motion by a
    force that begins at one.
    """
    sizes = s.sizes
    for i in range(s.n):
        moved = h * abs(k[i])
        if moved < FEW_PLACES * sizes[i] and (moved > 0.0 or p.surfaces > 0.0):
            return True
    return False


def look_between(s: State, p: Parameters, h: float, k: Floats) -> None:
    """Take what rounding does to the rates in the middle of a step h for noise too.

    Beside a switch forces may have no slope that tells: those of Hertz, or a root. The
    step itself may lead anywhere. k : (size,), y' at its start.
    """
    size = s.size
    n = s.n
    y = s.y
    noise = s.noise
    middle = s.look
    rates = s.look_rates
    found = s.far_before
    t = s.t + 0.5 * h
    for i in range(size):
        middle[i] = y[i] + 0.5 * h * k[i] if i < n else y[i]
    derivative(t, middle, p, rates)
    s.evaluations += 3.0
    shake(s, p, t, middle, rates, found)
    for i in range(n, size):
        noise[i] = max(noise[i], SHAKEN * found[i])


def shake(
    s: State, p: Parameters, t: float, y: Floats, rates: Floats, out: Floats
) -> None:
    """Give what some last places of a state y, to both sides, do to its rates (size,).

    What has no value there counts as nothing.
    """
    size = s.size
    z = s.work
    slopes = s.spare
    for i in range(size):
        out[i] = 0.0
    for way in range(2):
        move_aside(size, y, ROUNDED if way == 0 else -ROUNDED, z)
        derivative(t, z, p, slopes)
        for i in range(size):
            change = abs(slopes[i] - rates[i])
            if change < 1e300:
                out[i] = max(out[i], change)


def look_ahead(s: State, p: Parameters, h: float, k: Floats) -> None:
    """Take what is rounded at the end of a step h for noise too.

    What laws hold, or surfaces, rests against forces that may begin at 0. The step
    itself may lead anywhere. k : (size,), y' at its start.
    """
    n = s.n
    y = s.y
    noise = s.noise
    z = s.work
    ahead = s.look
    for i in range(s.size):
        ahead[i] = y[i] + h * k[i] if i < n else y[i]
    rounding(s.t + h, ahead, p, z)
    for i in range(n, 2 * n):
        if abs(z[i - n]) < 1e300:
            noise[i] = max(noise[i], RATE_NOISE * abs(z[i - n]))


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


def move_aside(size: int, y: Floats, change: float, out: Floats) -> None:
    """Give y with a relative change.

    Components change by different parts, or a change of the whole scene's size or
    place would hide what cancels.
    """
    for i in range(size):
        part = 0.618033988749895 * (i + 1)
        out[i] = y[i] * (1.0 + change * (0.5 + part - int(part)))


def add_exactly(
    size: int, y: Floats, k: Floats, h: float, new: Floats, left: Floats
) -> None:
    """Give y + h k (size,), and add to `left` what both roundings cut off."""
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


def add_change(s: State, p: Parameters, k: Floats, h: float, new: Floats) -> None:
    """Add `left` and the rest to a state `new` (size,) that a step h leads to.

    k : (size,), y' at its start. Leaves what is cut off in `left`.
    """
    size = s.size
    left = s.left
    rest = s.rest
    for i in range(size):
        left[i] += rest[i]
    if s.rtol < TIGHT:
        drift = s.spare
        find_drift(s, p, k, drift)
        add_drift(s, drift, h)
    carry(size, new, left, new, left)


def find_drift(s: State, p: Parameters, k: Floats, out: Floats) -> None:
    """Give what the rest adds to y' (size,), which is k at y alone."""
    size = s.size
    y = s.y
    rest = s.rest
    z = s.work
    if CONSTRAINED or SWITCHES:
        for i in range(size):
            out[i] = 0.0
        return
    for i in range(size):
        z[i] = y[i] + LARGER * rest[i]
    derivative(s.t, z, p, out)
    s.evaluations += 1.0
    for i in range(size):
        drift = (out[i] - k[i]) / LARGER
        out[i] = drift if abs(drift) < 1e300 else 0.0


def add_drift(s: State, drift: Floats, h: float) -> None:
    """Add to a change what the rest does in a step: it moves as the state does."""
    size = s.size
    n = s.n
    left = s.left
    for i in range(size):
        left[i] += h * drift[i]
        if i < n:
            left[i] += 0.5 * h * h * drift[n + i]


def keep_rest(s: State) -> None:
    """Take what the step has cut off: it is accepted."""
    if CONSTRAINED or SWITCHES:
        forget_rest(s)
        return
    rest = s.rest
    left = s.left
    for i in range(s.size):
        rest[i] = left[i]


def forget_rest(s: State) -> None:
    """Begin with a state as it is."""
    rest = s.rest
    for i in range(s.size):
        rest[i] = 0.0


def add(n: int, y: Floats, rest: Floats, h: float, rate: Floats) -> None:
    """Add h * rate to y (n,), and keep in `rest` (n,) what rounding cuts off."""
    for i in range(n):
        rest[i] += h * rate[i]
    carry(n, y, rest, y, rest)


def carry(n: int, y: Floats, change: Floats, out: Floats, left: Floats) -> None:
    """Give y + change (n,), and what rounding cuts off of it.

    Both results may take the place of what they are made of.
    """
    for i in apart(n):
        before = y[i]
        more = change[i]
        after = before + more
        moved = after - before
        out[i] = after
        left[i] = (before - (after - moved)) + (more - moved)
