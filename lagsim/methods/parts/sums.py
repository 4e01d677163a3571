"""Sums over many steps, which carry what rounding cuts off of them.

A step adds little to a state, and what is lost of it each time grows with the steps, or
faster. The state is y and `rest`, which is smaller than half of y's last place: what is
cut off is found exactly and added with the next step (D. E. Knuth, The Art of Computer
Programming 2, 3rd ed., section 4.2.2; E. Hairer, C. Lubich and G. Wanner, Geometric
Numerical Integration, 2nd ed., section VIII.5: compensated summation).

The slopes of a step are those at y alone. Where the tolerance is tight what they lack
is found by a difference: that is as much as the rounding of forces does.

An arc begins without a rest, as its state is a new one, or given as doubles; so does a
step that ends with a projection onto constraints, which rounds all that it moves.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from lagsim.methods.parts.controller import TIGHT
from lagsim.methods.parts.interface import derivative
from lagsim.methods.parts.parameters import Parameters
from lagsim.methods.parts.state import State
from lagsim.native.kernels.words import apart, rare

if TYPE_CHECKING:
    from lagsim.language.arrays import Floats

CONSTRAINED = True

# Parts a double into two halves of 26 bits.
HALVES = 2.0**27 + 1.0
# So much larger a rest is a change of y by a relative 1e-8 at most: little beside what
# bends the forces, and much beside the rounding of y'.
LARGER = 2.0**26


def add_slope(s: State, k: Floats, h: float, new: Floats) -> None:
    """Give y + h k (size,), and add to `left` what is cut off where that shows."""
    size = s.size
    y = s.y
    left = s.left
    if s.rtol < TIGHT:
        add_exactly(size, y, k, h, new, left)
    else:
        for i in range(size):
            new[i] = y[i]
            left[i] += h * k[i]


@rare
def add_exactly(
    size: int, y: Floats, k: Floats, h: float, new: Floats, left: Floats
) -> None:
    """Give y + h k (size,), and add to `left` what both roundings cut off.

    The product in halves of the factors (T. J. Dekker, Numer. Math. 18 (1971) 224-242).
    """
    wide = HALVES * h
    h_high = wide - (wide - h)
    h_low = h - h_high
    for i in range(size):
        wide = HALVES * k[i]
        k_high = wide - (wide - k[i])
        k_low = k[i] - k_high
        moved = h * k[i]
        cut = h_high * k_high - moved
        cut = ((cut + h_high * k_low) + h_low * k_high) + h_low * k_low
        after = y[i] + moved
        back = after - y[i]
        new[i] = after
        left[i] += cut + ((y[i] - (after - back)) + (moved - back))


def add_change(s: State, p: Parameters, k: Floats, h: float, new: Floats) -> None:
    """Add `left` and the rest to a state `new` (size,) that a step h leads to.

    k : (size,), y' at its start. Leaves what is cut off in `left`.
    """
    size = s.size
    left = s.left
    rest = s.rest
    for i in range(size):
        left[i] += rest[i]
    if not CONSTRAINED and s.rtol < TIGHT:
        move_rest(s, p, k, h)
    carry(size, new, left, new, left)


@rare
def move_rest(s: State, p: Parameters, k: Floats, h: float) -> None:
    """Add to a change what the rest does within a step: it moves as the state does."""
    size = s.size
    n = s.n
    y = s.y
    rest = s.rest
    left = s.left
    z = s.work
    slopes = s.spare
    for i in range(size):
        z[i] = y[i] + LARGER * rest[i]
    derivative(s.t, z, p, slopes)
    s.evaluations += 1.0
    for i in range(size):
        slope = (slopes[i] - k[i]) / LARGER
        if abs(slope) < 1e300:
            left[i] += h * slope
            if n <= i < 2 * n:
                left[i - n] += 0.5 * h * h * slope


def keep_rest(s: State) -> None:
    """Take what the step has cut off: it is accepted."""
    rest = s.rest
    left = s.left
    for i in range(s.size):
        rest[i] = 0.0 if CONSTRAINED else left[i]


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
