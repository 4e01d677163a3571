"""Fixed steps on oscillators: each fails as much as theory says.

The amplitude after N steps is a power of the stability function (Hairer and Wanner,
Solving ODEs II, section IV.2), or of the matrix of the step for partitioned methods.
"""

import math

import numpy as np
import pytest

from lagsim.methods import method, names
from tests.small_scenes import oscillator
from tests.support import run

OSCILLATOR = oscillator()
CUBIC = OSCILLATOR.replace("x^2/2", "x^2/2 + x^3/3").replace("x: 1", "x: SIZE")
FIXED = [name for name in names() if not method(name).ADAPTIVE]


def oscillate(name, h, duration, text=OSCILLATOR):
    options = f"duration: {duration}, output_step: {duration}/100"
    if name != "auto":
        options += f", method: {name}, step: {h!r}"
    return run(f"{text}simulation: {{{options}}}")


def growth(found):
    return found["energy"][-1] / found["energy"][0]


def powers(name, h, duration):
    """Return |R|^2 over whole steps, and over the rest of the last step."""
    amplification = method(name).amplification
    steps = math.floor(duration / h + 1e-9)
    rest = duration - steps * h
    return amplification(1j * h) ** (2 * steps) * amplification(1j * rest) ** 2


# The energy of an oscillator is |z|^2/2, and a Runge-Kutta step multiplies z by exactly
# R(i h w): only rounding in up to 10^4 steps is left, 1e-16 in each.
@pytest.mark.parametrize(
    ("name", "h", "duration", "told"),
    [
        ("euler", 0.01, 100, 2.718),  # (1 + h^2)^(t/h), nearly e^(h t)
        ("rk4", 1.0, 1000, 4.9e-6),
        ("rk4", 2.9, 344 * 2.9, 5.6e52),
        ("rk4", 2.9, 1000, 1.4e52),  # the last step is shorter, and stable
    ],
)
def test_runge_kutta_methods_gain_or_lose_energy(name, h, duration, told):
    found = oscillate(name, h, duration)
    assert growth(found) == pytest.approx(powers(name, h, duration), rel=1e-11)
    assert growth(found) == pytest.approx(told, rel=0.02)


def test_what_is_chosen_does_not():
    # The default tolerance is 1e-11 of a motion of length 1000.
    assert abs(growth(oscillate("auto", None, 1000)) - 1.0) < 1e-8


def test_verlet_beyond_its_limit():
    # x after N steps from rest at 1 is cos(N a) with 2 cos a = 2 - (h w)^2, where
    # |cos a| > 1: cosh of N times 0.2 and more.
    h, steps = 2.01, 1000
    found = oscillate("verlet", h, h * steps)
    expected = math.cosh(steps * math.acosh(h * h / 2.0 - 1.0))
    assert found.trajectory.statistics.steps == steps
    # Each of 1000 steps rounds, and the sensitivity to h at the border is
    # N da/dh = 1000 * 10.
    assert found["x"][-1] == pytest.approx(expected, rel=1e-9)
    assert found["x"][-1] == pytest.approx(3.3e86, rel=0.01)


# No step is too long for implicit ones.
UNLIMITED = {"gauss4", "generalized-alpha", "midpoint"}


def test_methods_without_a_limit():
    assert {name for name in FIXED if math.isinf(method(name).IMAGINARY_LIMIT)} == (
        UNLIMITED
    )


@pytest.mark.parametrize("name", [n for n in FIXED if n not in UNLIMITED])
def test_each_method_is_stable_just_below_its_limit_and_not_above(name):
    module = method(name)
    limit = module.IMAGINARY_LIMIT
    below, above = 0.998 * limit, 1.002 * limit if limit else 0.1
    if limit:
        # 3000 steps: what is bounded stays so. The ellipse of a partitioned method is
        # flattened by sqrt(1 - 0.998^2) = 0.06, so that its energy swings by 250.
        found = oscillate(name, below, 3000 * below)
        assert found.trajectory.outcome.word == "done"
        assert np.max(found["energy"]) < 300 * found["energy"][0]
    found = oscillate(name, above, 3000 * above)
    rate = math.log(module.amplification(1j * above))
    assert rate > 0.0
    # e^(rate N), up to a factor that does not grow; the run ends at 1e300 = e^691.
    steps = found.trajectory.statistics.steps
    reached = math.log(math.hypot(found["x"][-1], found["x_dot"][-1]))
    assert reached == pytest.approx(steps * rate, rel=0.02, abs=4)
    assert steps == 3000 or reached > 680.0


def escape(name, h, size):
    """Return the number of steps to leave the cubic well, whose rim is at -1."""
    text = CUBIC.replace("SIZE", str(size))
    text += (
        f'simulation: {{duration: 1e4, method: {name}, step: {h!r}, until: "x <= -2"}}'
    )
    return run(text)


@pytest.mark.slow
def test_a_cubic_well_at_the_third_order_resonance():
    """Three steps are one turn at h w = sqrt 3, and no amplitude is stable.

    On average over three steps z' = c conj(z)^2, so that 1/|z| falls by an equal amount
    in every step, and the steps to escape go with 1/size.
    """
    sizes = (0.01, 0.005, 0.0025)
    steps = []
    for size in sizes:
        found = escape("verlet", math.sqrt(3.0), size)
        assert found.trajectory.outcome.word == "until"
        steps.append(found.trajectory.statistics.steps)
    products = [n * size for n, size in zip(steps, sizes, strict=True)]
    assert max(products) / min(products) < 1.1
    # Off the resonance, and with what is chosen, the same starts stay.
    for h in (1.6, 1.85):
        assert escape("verlet", h, 0.04).trajectory.outcome.word == "done"
    found = run(CUBIC.replace("SIZE", "0.04") + "simulation: {duration: 1000}")
    # The other turning point, where the potential is that of 0.04, is at -0.0411.
    assert np.max(np.abs(found["x"])) < 0.0412
    assert found.drift < 1e-11
