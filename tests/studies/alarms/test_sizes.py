"""Each alarm at energies and lengths of 1e-6 and 1e6: no bound depends on units."""

from __future__ import annotations

import re

import numpy as np
import pytest

from lagsim.run.observers.monitors import Checkpoints
from tests.studies.judged import cautions, codes, repeated
from tests.support import run

ENERGIES = pytest.mark.parametrize("unit", ["1e-6", "1", "1e6"])
GAINED, LOST = "energy-gained", "energy-lost"
HELD = "constraint-not-held"
BOUND, DAMPED = "step-at-stability-bound", "fast-mode-damped"
OSCILLATOR = """\
coordinates: {{x: {{}}}}
energy: {{kinetic: {unit}*x_dot^2/2, potential: {unit}*x^2/2}}
initial: {{x: 1}}
simulation: {{duration: {duration}, output_step: 0.05}}
"""
STIFF = """\
coordinates: {{x: {{}}, u: {{}}}}
energy:
  kinetic: {unit}*(x_dot^2 + u_dot^2)/2
  potential: {unit}*(x^2 + 1e6*u^2)/2
initial: {{x: 1, u: {u}}}
simulation: {{duration: 2, output_step: 0.05}}
"""


def oscillator(unit, duration, **options):
    return run(OSCILLATOR.format(unit=unit, duration=duration), **options)


def text_of(found, code, bar="not estimated"):
    (text,) = [c.text for c in cautions(found, bar) if c.code == code]
    return text


@ENERGIES
@pytest.mark.parametrize(
    ("method", "step", "duration", "code", "part"),
    [
        # Euler multiplies the energy by 1 + h^2 in each of n steps. By the medians of
        # the first and last tenth: (1 + h^2)^(0.95 n) less (1 + h^2)^(0.05 n), against
        # the largest kinetic energy, about the last: between these.
        ("euler", 0.01, 10, GAINED, (0.05, 0.10)),
        ("euler", 0.01, 50, GAINED, (0.24, 0.40)),
        # RK4 by 1 - h^6/72: at h = 0.5 over 100 by exp(-0.0434), 0.9 of that in 0.5.
        ("rk4", 0.5, 100, LOST, (0.03, 0.10)),
    ],
)
def test_the_part_of_the_energy(unit, method, step, duration, code, part):
    found = oscillator(unit, duration, method=method, step=step)
    said = float(re.search(r"explains, (\S+) of the energy", text_of(found, code))[1])
    assert part[0] < said < part[1]


@ENERGIES
def test_a_thousandth_is_told_and_less_is_not(unit):
    # Euler's energy grows by the factor exp(h t): of 0.9 h t of the energy, at t = 10.
    for step, told in ((4e-4, True), (4e-5, False)):
        found = oscillator(unit, 10, method="euler", step=step)
        assert (GAINED in codes(found)) == told


@ENERGIES
def test_the_stability_bound(unit):
    assert BOUND in codes(oscillator(unit, 20, method="verlet", step=2.01))
    assert BOUND not in codes(oscillator(unit, 20, method="verlet", step=1.0))


@ENERGIES
@pytest.mark.parametrize(
    # The share of the fast mode in the energy is 1e6 u^2.
    ("u", "told"), [(1e-4, True), (2e-5, True), (2e-6, False), (0.0, False)],
)  # fmt: skip
def test_a_fast_mode_with_some_energy(unit, u, told):
    found = run(STIFF.format(unit=unit, u=u),
        method="generalized-alpha", step=0.01, spectral_radius=0.5,
    )  # fmt: skip
    assert (DAMPED in codes(found)) == told


# Two rods of a double pendulum; it is chaotic when let go from high up.
DOUBLE = """\
coordinates: {{a: {{}}, b: {{}}}}
energy:
  kinetic: {unit}*(a_dot^2 + b_dot^2/2 + a_dot*b_dot*cos(a - b))
  potential: -{unit}*9.81*(2*cos(a) + cos(b))
initial: {{a: {high}, b: {high}/2}}
simulation: {{duration: {duration}, output_step: 0.05}}
"""


def barred(text, **options):
    found = run(text, **options)
    checkpoints = Checkpoints(len(found.equations.q), found.session.case.settings)
    checkpoints.add(found.rows)
    return found, repeated(found.session, found.trajectory, checkpoints)


@ENERGIES
def test_the_horizon_of_chaos(unit):
    found, bar = barred(DOUBLE.format(unit=unit, high=2, duration=28))
    assert codes(found, bar) == ["horizon"]
    # Errors grow tenfold in 2 s from about 1e-12: 0.1 of the range some 22 s later.
    told = float(re.search(r"past t = (\S+) ", text_of(found, "horizon", bar))[1])
    assert told == pytest.approx(bar.horizon, rel=1e-5)
    assert 18.0 < told < 27.0


@pytest.mark.parametrize("unit", ["1e-6", "1e6"])
def test_no_horizon_of_what_is_not_chaotic(unit):
    found, bar = barred(DOUBLE.format(unit=unit, high=0.02, duration=10))
    assert codes(found, bar) == []


SIZES = pytest.mark.parametrize(
    ("length", "mass"), [(1e-6, 1e-6), (1e-6, 1e6), (1e6, 1e6)]
)
# Bars of a parallelogram, driven at one crank: flat at pi, where it could turn over.
LINKAGE = """\
parameters: {{l: {length}, m: {mass}}}
coordinates: {{a: {{}}, b: {{}}, c: {{}}}}
energy: {{kinetic: m*l^2*(a_dot^2 + b_dot^2 + c_dot^2)/2, potential: "0"}}
constraints:
  across: l*cos(a) + l*cos(c) = l + l*cos(b)
  along: l*sin(a) + l*sin(c) = l*sin(b)
initial: {{a: 2, b: 2, c: 0, a_dot: {speed}, b_dot: {speed}, c_dot: 0}}
simulation: {{duration: {duration}, output_step: 0.01}}
"""


@SIZES
def test_where_bars_lie_in_one_line(length, mass):
    # Without forces both cranks turn uniformly, and lie flat at (pi - 2)/speed.
    text = LINKAGE.format(length=length, mass=mass, speed=1.0, duration=2)
    found = run(text)
    said = text_of(found, "rank")
    time = float(re.search(r"at t = (\S+) ", said)[1])
    assert time == pytest.approx(np.pi - 2, abs=1e-3)
    # All sines vanish there, and with them what `across` asks of the velocities.
    assert "constraints across become dependent" in said
    early = run(text, duration=1.0)
    assert "rank" not in codes(early)


# A mass on a circle that only its second derivative holds.
CIRCLE = """\
parameters: {{r: {length}, m: {mass}}}
coordinates: {{x: {{}}, y: {{}}}}
energy: {{kinetic: m*(x_dot^2 + y_dot^2)/2, potential: "0"}}
constraints: {{rod: x^2 + y^2 = r^2}}
initial: {{x: r, y: 0, x_dot: 0, y_dot: r}}
simulation: {{duration: 4, output_step: 0.2}}
"""


def drifted(step, duration=4.0):
    """Give x^2 + y^2 - 1 at the end, by Runge's rule for x'' = -x v^2/x^2."""

    def rates(z):
        return np.array([*z[2:], *(-z[:2] * (z[2:] @ z[2:]) / (z[:2] @ z[:2]))])

    z = np.array([1.0, 0.0, 0.0, 1.0])
    for _ in range(round(duration / step)):
        a = rates(z)
        b = rates(z + step / 2 * a)
        c = rates(z + step / 2 * b)
        d = rates(z + step * c)
        z = z + step / 6 * (a + 2 * b + 2 * c + d)
    return abs(z[:2] @ z[:2] - 1.0)


@SIZES
@pytest.mark.parametrize(("step", "told"), [(0.25, True), (0.01, False)])
def test_a_constraint_that_is_let_go(length, mass, step, told):
    text = CIRCLE.format(length=length, mass=mass)
    found = run(text, method="rk4", step=step, formulation="drift")
    assert (HELD in codes(found)) == told
    missed = drifted(step)
    assert (missed > 1e-5) == told
    assert (missed < 1e-7) == (not told)
    if told:
        said = float(re.search(r"off by (\S+) of", text_of(found, HELD))[1])
        # Its scale is between r^2 and the sum of its terms.
        assert 0.3 * missed < said < 1.05 * missed
