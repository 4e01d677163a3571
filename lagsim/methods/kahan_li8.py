"""Kahan-Li 8: seventeen Verlet steps, five backwards in time, order 8.

The same construction as `kahan-li6`, two orders higher. It is the method for keeping an
energy to rounding over many thousands of periods, as of planets: with compensated
summation the error of Kepler's energy is some 1e-14 after ten thousand orbits. For
fewer digits `kahan-li6` or `verlet` are cheaper; for the path over a few hundred
periods `dop853` is.

It takes seventeen evaluations per step. Stable for h w < 3.096, w the fastest
frequency; a step of h w = 0.1 to 0.5 is usual. It needs a constant mass matrix and
forces that depend on positions and time only.

Source: W. Kahan and R.-C. Li, Composition constants for raising the orders of
unconventional schemes for ordinary differential equations, Math. Comp. 66 (1997)
1089-1099; E. Hairer, C. Lubich and G. Wanner, Geometric Numerical Integration, 2nd ed.,
section V.3.2.
"""

from __future__ import annotations

from functools import partial

from lagsim.language.arrays import Floats
from lagsim.methods.parts.fixed import interpolate as hermite
from lagsim.methods.parts.fixed import step as compose
from lagsim.methods.parts.parameters import Parameters
from lagsim.methods.parts.state import DONE, derivative, power
from lagsim.methods.verlet import (
    Symplectic,
    composed_amplification,
    make,
    refusal,
    start,
)
from lagsim.native.kernels.words import total, unrolled
from lagsim.native.layout import array

__all__ = ["make", "refusal", "start"]

NAME = "kahan-li8"
TITLE = "Kahan-Li composition of 17 Verlet steps"
ORDER = 8
DENSE_ORDER = 6
ADAPTIVE = False
IMAGINARY_LIMIT = 3.096
HANDLES = "constant M, forces f(q, t); no constraints"

# Half of the weights and the middle one; the others mirror them.
HALF = (
    0.13020248308889008087881763,
    0.56116298177510838456196441,
    -0.38947496264484728640807860,
    0.15884190655515560089621075,
    -0.39590389413323757733623154,
    0.18453964097831570709183254,
    0.25837438768632204729397911,
    0.29501172360931029887096624,
    -0.60550853383003451169892108,
)
WEIGHTS = (*HALF, *HALF[-2::-1])
amplification = partial(composed_amplification, WEIGHTS)
NEEDS = ("power",)

CONSTRAINED = False  # for code shared with methods that support constraints


# --- symmetric compositions of Verlet steps, and rows within them
#
# Dense output of order 6: the quintic through q, q', q'' at both ends of the step is
# accurate enough to evaluate the acceleration at four points between; polynomials that
# interpolate these accelerations as well are more accurate by two orders (W. H.
# Enright, K. R. Jackson, S. P. Norsett and P. G. Thomsen, Interpolants for Runge-Kutta
# formulas, ACM Trans. Math. Softw. 12 (1986) 193-218: bootstrapping). In w = x (1 - x)
# and c = x - 1/2,
#
#     q(x) = quintic(x) + w^3 (r0 + r1 c + r2 c^2 + r3 c^3),
#     q'(x), work(x) = cubic(x) + w^2 (r0 + r1 c + r2 c^2 + r3 c^3)
#
# with r from the residuals of the accelerations and of the power at the four points.
# (The derivative of q(x) would divide the error of the step by its length.) The dense
# output is computed for steps with rows only.

NODES = (0.2, 0.4, 0.6, 0.8)
# Maps residuals at the nodes to r: the inverse of (w^3 c^m)'' there, and of (w^2 c^m)'.
BEND = (
    (-2375 / 2816, -29125 / 12672, -29125 / 12672, -2375 / 2816),
    (321875 / 153216, 334375 / 76608, -334375 / 76608, -321875 / 153216),
    (-15625 / 704, -15625 / 1056, -15625 / 1056, -15625 / 704),
    (1328125 / 38304, -78125 / 6384, 78125 / 6384, -1328125 / 38304),
)
RISE = (
    (1375 / 576, 125 / 288, -125 / 288, -1375 / 576),
    (-2125 / 352, 1125 / 176, 1125 / 176, -2125 / 352),
    (3125 / 144, -3125 / 72, 3125 / 72, -3125 / 144),
    (15625 / 88, 15625 / 132, 15625 / 132, 15625 / 88),
)


class Composition(Symplectic):
    """Memory of compositions: the polynomials of the dense output of the last step."""

    r: Floats = array(lambda s: 4 * s.size)
    c3: Floats = array("size")  # coefficients of the quintic
    c4: Floats = array("size")
    c5: Floats = array("size")
    residuals: Floats = array(lambda s: 4 * s.size)  # residuals at the four points
    z: Floats = array("size")


def step(s: Composition, p: Parameters) -> int:
    """Advance by one step; return DONE, or the code of a failure (see `state`)."""
    code = compose(s, p)
    if code == DONE:
        make_dense(s, p)
    return code


def make_dense(s: Composition, p: Parameters) -> None:
    """Compute the polynomials of the dense output of the last step.

    The quintics are always computed, the corrections r if a row lies within the step.
    """
    size, n = s.size, s.n
    s.r[:] = 0.0
    quintic(s)
    row = s.row_start + s.row * s.row_step
    extra = s.extras > 0.0 and s.extra < s.t
    if s.located > 0.0 or extra or (row < s.row_limit and row < s.t):
        store_residuals(s, p)
        for i in range(n):
            for m in unrolled(4):
                coefficient = total(
                    BEND[m][j] * s.residuals[j * size + i] for j in unrolled(4)
                )
                s.r[m * size + i] = coefficient
        correct(s, s.velocities.start, s.velocities.stop)
        if size > s.quadratures.start:
            store_rate_residuals(s, p)
            correct(s, s.quadratures.start, size)


def quintic(s: Composition) -> None:
    """Compute the coefficients of x^3, x^4, x^5 in the quintics of the positions."""
    h, old, v, old_v = s.step_h, s.old, s.y[s.velocities], s.old[s.velocities]
    a, old_a = s.k[s.velocities], s.before[s.velocities]
    for i in range(s.n):
        a0 = h * h * old_a[i]
        rest = s.y[i] - old[i] - h * old_v[i] - 0.5 * a0
        turn = h * (v[i] - old_v[i]) - a0
        change = h * h * a[i] - a0
        s.c3[i] = 10.0 * rest - 4.0 * turn + 0.5 * change
        s.c4[i] = -15.0 * rest + 7.0 * turn - change
        s.c5[i] = 6.0 * rest - 3.0 * turn + 0.5 * change


def store_residuals(s: Composition, p: Parameters) -> None:
    """Store the residuals of the equations on the dense output at four points.

    The residuals (4, size) are h^2 q'' less the second derivative of the quintics for
    positions, and h times the rate less the derivative of the polynomial for other
    components. The points are the fractions `NODES` of the last step.
    """
    h, slope, first = s.step_h, s.slope, s.velocities.start
    a, old_a = slope[s.velocities], s.before[s.velocities]
    for j in unrolled(4):
        x = NODES[j]
        interpolate(s, p, x, s.z)
        derivative(s.step_t + x * h, s.z, p, slope)
        s.evaluations += 1.0
        rates = s.residuals[j * s.size :]
        for i in range(s.n):
            curved = x * (6.0 * s.c3[i] + x * (12.0 * s.c4[i] + x * 20.0 * s.c5[i]))
            rates[i] = h * h * (a[i] - old_a[i]) - curved
            rates[first + i] = h * a[i] - steepness(s, first + i, x)


def store_rate_residuals(s: Composition, p: Parameters) -> None:
    """Store h times the rates of the quadratures, less the slopes of their cubics.

    The cubics are Hermite polynomials, see `steepness`. The differences at the four
    points `NODES` of the step are stored in `residuals` (4, size).
    """
    h = s.step_h
    first = s.quadratures.start
    for j in unrolled(4):
        x = NODES[j]
        interpolate(s, p, x, s.z)
        rates = s.residuals[j * s.size :]
        power(s.step_t + x * h, s.z, p, rates[first:])
        for i in range(first, s.size):
            rates[i] = h * rates[i] - steepness(s, i, x)


def correct(s: Composition, first: int, end: int) -> None:
    """Compute the corrections r of components first ... end - 1 of the dense output.

    The corrections follow from the `residuals` at the four points `NODES`.
    """
    for i in range(first, end):
        for m in unrolled(4):
            coefficient = total(
                RISE[m][j] * s.residuals[j * s.size + i] for j in unrolled(4)
            )
            s.r[m * s.size + i] = coefficient


def steepness(s: Composition, i: int, x: float) -> float:
    """Return the derivative of component i's cubic Hermite polynomial at x in [0, 1].

    x : the fraction of the last step, by which the derivative is taken.
    """
    h = s.step_h
    u = 1.0 - x
    change = s.y[i] - s.old[i]
    first = h * s.before[i] - change
    last = h * s.k[i] - change
    return float(change + u * (u - 2.0 * x) * first + x * (x - 2.0 * u) * last)


def interpolate(s: Composition, p: Parameters, x: float, out: Floats) -> None:
    """Write the state (size,) at the fraction x of the last step."""
    h, old_v, old_a = s.step_h, s.old[s.velocities], s.before[s.velocities]
    w = x * (1.0 - x)
    hermite(s, p, x, out)
    for i in range(s.n):
        straight = x * h * (old_v[i] + 0.5 * x * h * old_a[i])
        far = x * x * x * (s.c3[i] + x * (s.c4[i] + x * s.c5[i]))
        out[i] = s.old[i] + straight + far + w * w * w * polynomial(s, i, x)
    for i in range(s.velocities.start, s.size):
        out[i] += w * w * polynomial(s, i, x)


def polynomial(s: Composition, i: int, x: float) -> float:
    """Return the correction r0 + r1 c + r2 c^2 + r3 c^3 of component i, c = x - 1/2."""
    size, r = s.size, s.r
    c = x - 0.5
    more = r[size + i] + c * (r[2 * size + i] + c * r[3 * size + i])
    return float(r[i] + c * more)


class KahanLi8(Composition):
    """Memory of `kahan-li8`, with the weights of the Verlet steps."""

    stages: int = 17
    weights: Floats = array("stages", WEIGHTS)


STATE = KahanLi8
