"""What alarms say, in numbers: by closed forms, and from which size on they are raised.

No bound depends on units: each failing scene raises the same in others.
"""

from __future__ import annotations

import re

import numpy as np
import pytest

from tests.invariance.same import CHANGES
from tests.invariance.transforms import document
from tests.small_scenes import oscillator
from tests.studies.alarms.test_alarms import BOUND, DAMPED, FAILING, GAINED, HELD, LOST
from tests.studies.judged import barred, cautions, codes
from tests.support import MODELS, run


@pytest.mark.parametrize("units", ["metres", "megametres", "grams", "tonnes"])
@pytest.mark.parametrize(("name", "options", "expected", "_"), FAILING)
def test_alarms_are_the_same_in_other_units(name, options, expected, _, units):
    text = (MODELS / "failing" / f"{name}.yaml").read_text(encoding="utf-8")
    other = CHANGES[units].put(document(text), None).text()
    assert {*codes(run(other, **options))} - {"unused-parameter"} == {*expected}


def number(text, pattern):
    return float(re.search(pattern, text)[1])


def text_of(found, code, bar="not estimated"):
    (text,) = [c.text for c in cautions(found, bar) if c.code == code]
    return text


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
def test_the_part_of_the_energy(method, step, duration, code, part):
    text = oscillator(f"duration: {duration}, output_step: 0.05")
    found = run(text, method=method, step=step)
    said = number(text_of(found, code), r"explains, (\S+) of the energy")
    assert part[0] < said < part[1]


# Euler's energy grows by the factor exp(h t): of 0.9 h t of the energy, at t = 10.
@pytest.mark.parametrize(("step", "told"), [(4e-4, True), (4e-5, False)])
def test_a_thousandth_is_told_and_less_is_not(step, told):
    text = oscillator("duration: 10, output_step: 0.05")
    assert (GAINED in codes(run(text, method="euler", step=step))) == told


@pytest.mark.parametrize(("step", "told"), [(2.01, True), (1.0, False)])
def test_the_stability_bound(step, told):
    text = oscillator("duration: 20, output_step: 0.05")
    assert (BOUND in codes(run(text, method="verlet", step=step))) == told


STIFF = """\
coordinates: {{x: {{}}, u: {{}}}}
energy: {{kinetic: (x_dot^2 + u_dot^2)/2, potential: (x^2 + 1e6*u^2)/2}}
initial: {{x: 1, u: {u}}}
simulation: {{duration: 2, output_step: 0.05}}
"""


@pytest.mark.parametrize(
    # The share of the fast mode in the energy is 1e6 u^2.
    ("u", "told"), [(1e-4, True), (2e-5, True), (2e-6, False), (0.0, False)],
)  # fmt: skip
def test_a_fast_mode_with_some_energy(u, told):
    options = {"method": "generalized-alpha", "step": 0.01, "spectral_radius": 0.5}
    assert (DAMPED in codes(run(STIFF.format(u=u), **options))) == told


# Two rods of a double pendulum; it is chaotic when let go from high up.
DOUBLE = """\
coordinates: {a: {}, b: {}}
energy:
  kinetic: a_dot^2 + b_dot^2/2 + a_dot*b_dot*cos(a - b)
  potential: -9.81*(2*cos(a) + cos(b))
initial: {a: HIGH, b: HIGH/2}
simulation: {duration: 28, output_step: 0.05}
"""


@pytest.mark.parametrize(("high", "expected"), [("2", ["horizon"]), ("0.02", [])])
def test_the_horizon_of_chaos(high, expected):
    text = DOUBLE.replace("HIGH", high)
    found = run(text)
    bar = barred(found.equations.model)[1]
    assert codes(found, bar) == expected
    if expected:
        # Errors grow tenfold in 2 s from about 1e-12: 0.1 of the range in some 22 s.
        told = number(text_of(found, "horizon", bar), r"past t = (\S+) ")
        assert told == pytest.approx(bar.horizon, rel=1e-5)
        assert 18.0 < told < 27.0


# Bars of a parallelogram, driven at one crank: flat at pi, where it could turn over.
LINKAGE = """\
coordinates: {a: {}, b: {}, c: {}}
energy: {kinetic: (a_dot^2 + b_dot^2 + c_dot^2)/2, potential: "0"}
constraints:
  across: cos(a) + cos(c) = 1 + cos(b)
  along: sin(a) + sin(c) = sin(b)
initial: {a: 2, b: 2, c: 0, a_dot: 1, b_dot: 1, c_dot: 0}
simulation: {duration: 2, output_step: 0.01}
"""


def test_where_bars_lie_in_one_line():
    # Without forces both cranks turn uniformly, and lie flat at pi - 2.
    said = text_of(run(LINKAGE), "rank")
    assert number(said, r"at t = (\S+) ") == pytest.approx(np.pi - 2, abs=1e-3)
    # All sines vanish there, and with them what `across` asks of the velocities.
    assert "constraints across become dependent" in said
    assert "rank" not in codes(run(LINKAGE, duration=1.0))


# A mass on a circle that only its second derivative holds.
CIRCLE = """\
coordinates: {x: {}, y: {}}
energy: {kinetic: (x_dot^2 + y_dot^2)/2, potential: "0"}
constraints: {rod: x^2 + y^2 = 1}
initial: {x: 1, y: 0, x_dot: 0, y_dot: 1}
simulation: {duration: 4, output_step: 0.2}
"""


@pytest.mark.parametrize(("step", "told"), [(0.25, True), (0.01, False)])
def test_a_constraint_that_is_let_go(step, told):
    found = run(CIRCLE, method="rk4", step=step, formulation="drift")
    assert (HELD in codes(found)) == told
    missed = np.max(np.abs(found["x"] ** 2 + found["y"] ** 2 - 1.0))
    assert missed > 1e-5 if told else missed < 1e-7
    if told:
        said = number(text_of(found, HELD), r"off by (\S+) of")
        # Its scale is between r^2 and the sum of its terms.
        assert 0.3 * missed < said < 1.05 * missed
