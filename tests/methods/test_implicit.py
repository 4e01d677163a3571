"""Implicit methods: their linear algebra, invariants, and failures."""

import math

import numpy as np
import pytest

from lagsim.methods import generalized_alpha, method
from lagsim.methods.parts.newton import decompose, solve
from lagsim.methods.radau import ALPHA, BETA, DENSE, GAMMA, SLOPE, T_INVERSE, A, C, T
from tests.small_scenes import elastic_pendulum, oscillator
from tests.support import run

ELASTIC = elastic_pendulum(
    "theta: 1, u: 0.2, theta_dot: 0.5",
    "duration: 200, output_step: 0.1, method: METHOD, step: 0.02",
)
DOUBLE = """
coordinates: {a: {}, b: {}}
energy:
  kinetic: a_dot^2 + b_dot^2/2 + a_dot*b_dot*cos(a - b)
  potential: -2*cos(a) - cos(b)
initial: {a: 1, b: 0.5}
simulation: {duration: 200, output_step: 0.1, method: METHOD, step: 0.02}
"""
PLANET = """
coordinates: {r: {}, phi: {}}
definitions: {momentum: r^2*phi_dot}
energy: {kinetic: (r_dot^2 + r^2*phi_dot^2)/2, potential: -1/r}
initial: {r: 0.7, phi: 0, r_dot: 0, phi_dot: 1.9}
output: {columns: [momentum]}
simulation: {duration: 100, output_step: 0.5, method: METHOD, step: 0.02}
"""
JUMPING = """
coordinates: {x: {}}
energy: {kinetic: x_dot^2/2, potential: -exp(x^2)}
initial: {x: 1, x_dot: 1}
simulation: {duration: 5, output_step: 0.5, method: METHOD, step: 0.5}
"""


@pytest.mark.parametrize("width", [1, 2])
def test_lu_solves_and_sees_singular_matrices(width):
    random = np.random.default_rng(3)

    def drawn(*shape):
        parts = random.standard_normal((2, *shape))
        return parts[0] + 1j * parts[1] if width == 2 else parts[0]

    for n in (1, 2, 5, 9):
        A, x = drawn(n, n) * 10.0 ** random.integers(-6, 6, (n, 1)), drawn(n)
        right, factors = (np.array(a).ravel().view(float) for a in (A @ x, A))
        pivots = np.zeros(n)
        assert decompose(width, n, n, factors, pivots) == 1
        solve(width, n, n, factors, pivots, right)
        scaled = np.linalg.cond(A / np.max(np.abs(A), axis=1, keepdims=True))
        # Backward stable, up to the growth of the elimination.
        off = np.abs(right.view(A.dtype) - x)
        assert np.max(off) < 100 * scaled * 2.0**-53 * np.max(np.abs(x))
    for singular in ([1.0, 2.0, 2.0, 4.0], [0.0, 0.0, 2.0, 4.0], [math.nan] * 4):
        factors = np.zeros(4 * width)
        factors[::width] = singular
        assert decompose(width, 2, 2, factors, np.zeros(2)) == 0


@pytest.mark.parametrize("band", [0, 1, 2, 5])
def test_lu_of_a_band_touches_no_other_element(band):
    random, n = np.random.default_rng(7), 9
    far = np.abs(np.subtract.outer(np.arange(n), np.arange(n))) > band
    A, x = np.where(far, 0.0, random.standard_normal((n, n))), random.random(n)
    factors, right, pivots = A.ravel().copy(), A @ x, np.zeros(n)
    assert decompose(1, n, band, factors, pivots) == 1
    solve(1, n, band, factors, pivots, right)
    assert np.max(np.abs(right - x)) < 1e3 * np.linalg.cond(A) * 2.0**-53
    # Interchanges of rows double the band above the diagonal.
    high = np.subtract.outer(np.arange(n), np.arange(n)) < -2 * band
    assert not factors[high.ravel()].any()


def test_the_tables_of_radau():
    # Collocation; Hairer and Wanner, IV.8, (8.12).
    rounding = 1e-14
    for k in range(1, 4):
        assert A @ np.power(C, k - 1) == pytest.approx(np.power(C, k) / k)
    inverse = np.linalg.inv(A)
    middle = [[GAMMA, 0, 0], [0, ALPHA, -BETA], [0, BETA, ALPHA]]
    product = np.array(T_INVERSE) @ inverse @ np.array(T)
    assert np.allclose(product, middle, rtol=0, atol=rounding)
    assert np.allclose(np.array(T_INVERSE) @ T, np.eye(3), rtol=0, atol=rounding)
    assert np.allclose(SLOPE, inverse[2], rtol=0, atol=rounding)
    # The dense output integrates cubics of slopes exactly.
    for k in range(4):
        increments = np.array(A) @ np.power(C, k)
        for x in (0.3, *C):
            terms = np.array(DENSE) @ [0.0**k, *increments]
            value = terms @ x ** np.arange(1, 5)
            assert value == pytest.approx(x ** (k + 1) / (k + 1), abs=rounding)


@pytest.mark.parametrize("radius", [0.0, 0.3, 0.8, 1.0])
def test_the_radius_of_generalized_alpha_is_that_at_infinity(radius):
    found = generalized_alpha.amplification(1e7j, radius)
    assert found == pytest.approx(radius, abs=1e-3)
    # Never above 1, and for damped oscillations below it.
    for y in np.logspace(-3, 5, 60):
        assert generalized_alpha.amplification(1j * y, radius) <= 1.0 + 1e-7
    if radius < 1.0:  # at 1 the acceleration keeps a third one, -1
        assert generalized_alpha.amplification(-0.1 + 1j, radius) < 1.0


OSCILLATOR = """
coordinates: {x: {}}
energy: {kinetic: x_dot^2/2, potential: 9e4*x^2/2}
initial: {x: 1}
simulation: {duration: 2, output_step: 0.01, method: generalized-alpha, step: 0.01}
"""


@pytest.mark.parametrize("radius", [0.5, 0.9])
def test_fast_motion_is_damped_as_the_amplification_says(radius):
    # h w = 3; past the first steps one pair of eigenvalues is left, whose energy
    # swings by a bounded factor: over 150 steps a percent in the rate.
    found = run(OSCILLATOR, spectral_radius=radius)
    steps = np.arange(50, 201)
    rate = np.polyfit(steps, 0.5 * np.log(found["energy"][50:]), 1)[0]
    expected = generalized_alpha.amplification(3j, radius)
    assert math.exp(rate) == pytest.approx(expected, rel=0.01)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["midpoint", "gauss4"])
@pytest.mark.parametrize("text", [ELASTIC, DOUBLE])
def test_the_energy_error_does_not_grow(name, text):
    found = run(text.replace("METHOD", name))
    off = np.abs(found["energy"] - found["energy"][0])
    half = len(off) // 2
    # 10,000 steps; the error of each swings. rk4's grows all the way.
    assert np.max(off[half:]) < 1.5 * np.max(off[:half])
    # (h w)^p with w about 6 per unit of time, of an energy of about 5.
    assert np.max(off) < 5 * (0.02 * 6) ** method(name).ORDER
    other = run(text.replace("METHOD", "rk4"), step=0.05)
    off = np.abs(other["energy"] - other["energy"][0])
    assert np.max(off[half:]) > 1.5 * np.max(off[:half])


@pytest.mark.parametrize("name", ["midpoint", "gauss4"])
def test_angular_momentum_is_kept_to_rounding(name):
    found = run(PLANET.replace("METHOD", name))
    momentum = found["momentum"]
    # Momenta are summed with compensation; velocities are solved for to rounding.
    assert np.max(np.abs(momentum / momentum[0] - 1.0)) < 1e-14


@pytest.mark.parametrize("name", ["midpoint", "gauss4"])
def test_quadratic_energies_are_kept_to_rounding(name):
    text = """
    coordinates: {x: {}, y: {}}
    energy: {kinetic: x_dot^2/2 + y_dot^2, potential: x^2 + x*y + 2*y^2}
    initial: {x: 1, y: -0.3}
    simulation: {duration: 1000, output_step: 1, method: METHOD, step: 0.1}
    """
    found = run(text.replace("METHOD", name))
    # 10,000 steps without a trend: a random walk of rounding would give 1e-14.
    assert found.drift < 2e-14 * found["energy"][0]


@pytest.mark.parametrize("name", ["midpoint", "gauss4", "generalized-alpha"])
def test_an_iteration_that_fails_ends_the_run_with_advice(name):
    found = run(JUMPING.replace("METHOD", name))
    trajectory = found.trajectory
    assert trajectory.outcome.word == "failed"
    assert trajectory.outcome.name == "NEWTON_FAILED"
    assert f"t = {trajectory.end!r} (x = " in trajectory.reason


@pytest.mark.slow
def test_radau_shortens_the_step_instead():
    # x'' = 2 x exp(x^2) blows up in finite time: the step shrinks until none is left.
    found = run(JUMPING.replace("METHOD", "radau"))
    assert found.trajectory.outcome.word == "failed"
    assert found.trajectory.statistics.steps > 100
    assert found["x"][-1] > 5.0


def test_radau_counts_its_factorisations():
    linear = oscillator("duration: 10, method: radau, rtol: 1e-6")
    statistics = run(linear).trajectory.statistics
    # Three evaluations for each iteration and one at the end of each step, and four
    # at the start; J is constant and kept, so factorisations go with changes of h.
    assert statistics.evaluations >= 4 * statistics.steps
    assert (statistics.evaluations - statistics.steps - 4) % 3 == 0
    assert 3 <= statistics.factorisations < statistics.steps


# Forces of a norm that vanishes at the start, where the derivative of a root is 0/0.
KINK = """
coordinates: {x: {}, y: {}}
energy: {kinetic: (x_dot^2 + y_dot^2)/2, potential: FIELD}
forces: {x: "FORCE*X", y: "FORCE*Y"}
initial: {x: 0.2, y: -1}
simulation: {duration: 2, output_step: 0.1, method: METHOD}
"""
STEPS = {"radau": ("", 1e-11), "gauss4": (", step: 0.01", 1e-8),
         "midpoint": (", step: 0.002", 3e-6),
         "generalized-alpha": (", step: 0.002", 1e-5)}  # fmt: skip
NORMS = {
    "root": "-2*sqrt(x_dot^2 + y_dot^2)", "norm": "-2*hypot(x_dot, y_dot)",
    "power": "-2*(x_dot^2 + y_dot^2)^0.5",
}  # fmt: skip


def fallen(norm, method, field):
    text = KINK.replace("FORCE", NORMS[norm]).replace("FIELD", field)
    text = text.replace("X", "x_dot").replace("Y", "y_dot")
    steps, within = STEPS[method]
    return run(text.replace("METHOD", method + steps)), within


@pytest.mark.parametrize("method", STEPS)
@pytest.mark.parametrize("norm", NORMS)
def test_drag_by_a_norm_begins_at_rest(norm, method):
    rests, _ = fallen(norm, method, "0*x")
    assert np.all(rests["x"] == 0.2)
    assert np.all(rests["y"] == -1.0)
    found, within = fallen(norm, method, "8*y")
    # v' = -8 + 2 v^2: v = -2 tanh(4 t).
    assert np.all(found["x"] == 0.2)
    exact = -1 - np.log(np.cosh(4 * found["t"])) / 2
    assert np.max(np.abs(found["y"] - exact)) < within


@pytest.mark.parametrize("method", STEPS)
def test_a_spring_by_a_norm_begins_at_its_end(method):
    text = KINK.replace("FORCE", "-hypot(x - 0.2, y + 1)").replace("FIELD", "-x - y")
    text = text.replace("X", "(x - 0.2)").replace("Y", "(y + 1)")
    steps, within = STEPS[method]
    found = run(text.replace("METHOD", method + steps))
    u, v = np.sqrt(2) * (found["x"] - 0.2), np.sqrt(2) * found["x_dot"]
    assert np.max(u) > 1.5
    assert np.max(np.abs(v**2 / 2 - (np.sqrt(2) * u - u**3 / 3))) < within
    assert np.max(np.abs(found["x"] - 0.2 - found["y"] - 1)) < 1e-12
