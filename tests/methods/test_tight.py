"""Tight tolerances: the accuracy of a motion in doubles, with compensated sums.

The references were made in quadruple precision (113 bits) by extrapolation of the
midpoint rule over 13 columns, order 26 (Hairer, Norsett and Wanner, Solving ODEs I,
II.9), from the doubles of the models, by textbook equations. Half of the step changed
the ends by less than 1e-14 (double pendulum), two thirds by 4e-21.
"""

import math
from fractions import Fraction
from statistics import median

import mpmath
import numpy as np
import pytest

from lagsim.methods.parts.control import add_exactly
from tests.support import MODELS, run

UNIT = 2.0**-53
# theta, u and their rates after 3,600 s.
ELASTIC = (
    0.38590068090646945, 0.2018963627578325, -0.6316733837198766, 2.7576920207092095,
)  # fmt: skip
# The angles and their rates after 20 s, from rest at (2 + k/64, 1).
ENDS = """
    1.6303292446126285 -26.718915667511503 -1.429009979057931 -2.4442983340807016
    0.4041521219676421 20.447510438649804 1.0306207363963908 5.933274232951716
    -0.48451011594003635 -9.039121657702909 3.1766011802295635 -0.6710397421696793
    -1.246875967102408 -5.585756148124709 1.1988979183924875 -5.239484300619141
    -0.8462399237088425 -8.551681282658468 3.1182867665143426 0.9857631434157016
    0.11840246159828122 1.8897418067329805 -3.3699766254428107 3.689208116231173
    -0.4321814973981691 7.171115555999464 -1.1177975648629483 7.665653281362146
    -0.3913289830398863 9.65222076007708 -0.5753352195486844 -5.591415781109827
    1.5632467302049453 -19.462051997411415 3.599293497635246 4.210291987145345
    -1.338805310589465 -18.62958769771782 -3.611253259117598 -3.514320220976023
"""
DOUBLE = np.fromstring(ENDS, sep=" ").reshape(-1, 4)


def test_a_product_is_added_exactly():
    random = np.random.default_rng(2)
    y, k = random.normal(size=64), random.normal(size=64)
    h = 0.1
    new, left = np.zeros(64), np.zeros(64)
    add_exactly(64, y, k, h, new, left)
    for before, slope, after, cut in zip(y, k, new, left, strict=True):
        exact = Fraction(float(before)) + Fraction(h) * Fraction(float(slope))
        off = Fraction(float(after)) + Fraction(float(cut)) - exact
        # The two that are cut off are themselves rounded once.
        assert abs(off) < UNIT * abs(cut) + UNIT**3


FALL = """
coordinates: {x: {}}
energy: {kinetic: x_dot^2/2, potential: 9.8*x}
initial: {x: 100, x_dot: 0.1}
simulation: {duration: 128, output_step: 128, method: rk4, step: 1/1024}
"""


def test_a_fixed_step_carries_what_is_cut_off():
    # Of order 2: no error but rounding, of 131,072 steps, all in one direction. The
    # change of the velocity in a step is a double: 9.8 / 1024.
    found = run(FALL)
    v = Fraction(0.1) - Fraction(9.8) * 128
    assert abs(Fraction(float(found["x_dot"][-1])) - v) <= UNIT * abs(v)


def kepler(t):
    """Return x, y and their rates at the time of a row of the model, exactly."""
    with mpmath.workdps(40):
        x, rate = mpmath.mpf(1 - 0.6), mpmath.mpf(math.sqrt((1 + 0.6) / (1 - 0.6)))
        a = 1 / (2 / x - rate**2)
        e, n = 1 - x / a, a**-1.5
        mean = n * mpmath.mpf(float(t))
        mean -= 2 * mpmath.pi * mpmath.nint(mean / (2 * mpmath.pi))
        E = mpmath.findroot(lambda E: E - e * mpmath.sin(E) - mean, mean / (1 - e))
        r, b = 1 - e * mpmath.cos(E), a * mpmath.sqrt(1 - e * e)
        return (
            a * (mpmath.cos(E) - e), b * mpmath.sin(E),
            -a * n * mpmath.sin(E) / r, b * n * mpmath.cos(E) / r,
        )  # fmt: skip


def off(found, names, reference):
    """Return the largest error of the last row."""
    ends = zip(names, reference, strict=True)
    return max(abs(float(found[name][-1] - end)) for name, end in ends)


def after(orbits, rtol="1e-15", method="taylor"):
    """Return Kepler's motion, the error at its end, and the energy's."""
    span = f"{2 * orbits}*pi"
    options = {"method": method, "rtol": rtol, "duration": span, "output_step": span}
    found = run("kepler", **options)
    end = off(found, ("x", "y", "x_dot", "y_dot"), kepler(found["t"][-1]))
    x, y, u, v = (
        mpmath.mpf(float(found[name][-1])) for name in ("x", "y", "x_dot", "y_dot")
    )
    with mpmath.workdps(40):
        energy = (u * u + v * v) / 2 - 1 / mpmath.sqrt(x * x + y * y)
        return found, end, abs(float(energy + 0.5))


@pytest.mark.slow
def test_kepler_over_a_hundred_orbits():
    found, end, energy = after(100)
    assert end < 1e-11
    # Brouwer's law; at the end itself the energy is rounded with the state.
    steps = found.trajectory.statistics.steps
    assert energy < UNIT * math.sqrt(steps)
    assert end < UNIT * steps**1.5


# What rounding does to one run is a throw of dice: tolerances that hardly differ give
# others. The median of nine is steady.
RTOLS = [f"{1 + k / 10}e-15" for k in range(9)]


@pytest.mark.slow
def test_errors_grow_as_brouwer_says():
    # D. Brouwer, Astronomical Journal 46 (1937) 149-153: the rounding of n steps, at
    # random, makes the energy wander as n^(1/2), and with it the place as n^(3/2).
    for orbits, rtols, most in ((1_000, RTOLS, 2e-10), (10_000, RTOLS[:3], 1.0)):
        runs = [after(orbits, rtol) for rtol in rtols]
        steps = median(found.trajectory.statistics.steps for found, _, _ in runs)
        assert median(energy for _, _, energy in runs) < UNIT * math.sqrt(steps)
        assert median(end for _, end, _ in runs) < min(most, UNIT * steps**1.5)


def test_dop853_gains_by_it_where_steps_are_many():
    # Truncation is most of its error, and 100 orbits enlarge it as their square.
    _, end, energy = after(100, method="dop853")
    assert energy < 4e-14
    assert end < 2e-10


@pytest.mark.parametrize(("rtol", "each"), [("1e-12", 1), ("1e-13", 1), ("1e-15", 2)])
def test_only_where_it_is_tight_a_step_costs_an_evaluation_more(rtol, each):
    statistics = run("kepler", method="taylor", rtol=rtol).trajectory.statistics
    assert statistics.rejections == 0
    assert 0 <= statistics.evaluations - each * statistics.steps < 8


@pytest.mark.slow
def test_an_elastic_pendulum_over_an_hour():
    options = {"method": "taylor", "duration": "3600", "output_step": "3600"}
    names = ("theta", "u", "theta_dot", "u_dot")
    runs = [run("elastic-pendulum", rtol=rtol, **options) for rtol in RTOLS]
    assert median(off(found, names, ELASTIC) for found in runs) < 1e-11


@pytest.mark.slow
def test_double_pendulums_from_ten_starts():
    # A change of the start grows by 1e10 in the median of them, 4e7 to 2e12.
    text = (MODELS / "double-pendulum.yaml").read_text()
    names = ("theta1", "theta2", "theta1_dot", "theta2_dot")
    errors = []
    for k, end in enumerate(DOUBLE):
        started = text.replace("theta1: 2\n", f"theta1: {2 + k / 64}\n")
        found = run(started, method="taylor", rtol="1e-15", output_step="20")
        errors.append(off(found, names, end))
    assert median(errors) < 5e-7
