"""A light body has its own scale of errors, whatever heavy bodies the scene has."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from lagsim.model.reader import read
from tests.small_scenes import swing
from tests.support import run

METHODS = ["auto", "dop853"]

# SI units: the Sun, the Earth and a probe of 1000 kg that starts close to the latter.
G = 6.6743e-11
MASSES = {"s": 1.98847e30, "e": 5.9722e24, "p": 1000.0}
PLACES = [0.0, 0.0, 1.495978707e11, 0.0, 1.510978707e11, 2e8]
SPEEDS = [0.0, -0.0894, 0.0, 29780.0, 100.0, 29900.0]
YEAR = 3.156e7


def bodies():
    names = [f"{axis}{body}" for body in MASSES for axis in "xy"]
    kinetic = " + ".join(
        f"{m!r}*(x{b}_dot^2 + y{b}_dot^2)/2" for b, m in MASSES.items()
    )
    pairs = [("s", "e"), ("s", "p"), ("e", "p")]
    potential = " ".join(
        f"- {G * MASSES[a] * MASSES[b]!r}/hypot(x{a} - x{b}, y{a} - y{b})"
        for a, b in pairs
    )
    initial = [f"{q}: {x!r}" for q, x in zip(names, PLACES, strict=True)]
    initial += [f"{q}_dot: {v!r}" for q, v in zip(names, SPEEDS, strict=True)]
    return f"""
coordinates: {{{", ".join(f"{q}: {{}}" for q in names)}}}
energy: {{kinetic: "{kinetic}", potential: "{potential}"}}
initial: {{{", ".join(initial)}}}
simulation: {{duration: {YEAR!r}, output_step: 86400}}
"""


def attraction(_t, y):
    q = y[:6].reshape(3, 2)
    masses = list(MASSES.values())
    a = np.zeros((3, 2))
    for i in range(3):
        for j in range(3):
            if i != j:
                d = q[j] - q[i]
                a[i] += G * masses[j] * d / np.hypot(*d) ** 3
    return np.concatenate([y[6:], a.ravel()])


@pytest.mark.slow
@pytest.mark.parametrize("method", METHODS)
def test_a_probe_beside_the_sun_and_the_earth(method):
    y = np.array(PLACES + SPEEDS)
    expected = solve_ivp(
        attraction, (0.0, YEAR), y, method="DOP853", rtol=3e-14, atol=1e-9
    ).y[:6, -1]
    result = run(bodies(), method=method)
    errors = np.abs(result.rows[-1, 1:7] - expected)
    # Of paths 1e12 m long; both know them to some parts in 1e12.
    assert np.max(errors) < 20.0


BESIDE = """
coordinates: {{a: {{}}{more_coordinates}}}
energy: {{kinetic: "a_dot^2/2{more_energy}", potential: "-cos(a)"}}
initial: {{a: 1, a_dot: 0{more_initial}}}
simulation: {{duration: 20, output_step: 0.5}}
"""


def beside(mass, speed):
    return BESIDE.format(
        more_coordinates=", b: {}",
        more_energy=f" + {mass!r}*b_dot^2/2",
        more_initial=f", b: 1e8, b_dot: {speed!r}",
    )


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(
    ("mass", "speed"),
    [
        (1e30, 1e5),
        pytest.param(1e30, 0.0, marks=pytest.mark.slow),
        pytest.param(1e-30, 1e5, marks=pytest.mark.slow),
    ],
)
def test_a_bystander_changes_nothing(mass, speed, method):
    alone = BESIDE.format(more_coordinates="", more_energy="", more_initial="")
    expected = run(alone, method=method, rtol="1e-13")
    found = run(beside(mass, speed), method=method)
    # Ten oscillations at a local tolerance of 1e-12.
    assert np.max(np.abs(found["a"] - expected["a"])) < 1e-10
    # And it costs nothing: the bystander's own motion is exact.
    own = run(alone, method=method)
    steps = found.trajectory.statistics.steps
    assert abs(steps - own.trajectory.statistics.steps) <= 0.1 * steps


@pytest.mark.slow
def test_a_light_rod_beside_a_heavy_one():
    # Both swing as they do alone: each with sqrt(g/l) = 1 at small angles.
    light, heavy = 1e-20, 1e20
    text = f"""
coordinates: {{x: {{}}, y: {{}}, u: {{}}, w: {{}}}}
energy:
  kinetic: "{light}*(x_dot^2 + y_dot^2)/2 + {heavy}*(u_dot^2 + w_dot^2)/2"
  potential: "{light}*y + {heavy}*w"
constraints: {{a: "x^2 + y^2 = 1", b: "u^2 + w^2 = 1"}}
initial: {{x: 0.6, y: -0.8, u: 0.96, w: -0.28, x_dot: 0, y_dot: 0, u_dot: 0, w_dot: 0}}
simulation: {{duration: 10, output_step: 0.5, formulation: projection}}
"""
    result = run(text)
    for x, y, angle in (("x", "y", math.asin(0.6)), ("u", "w", math.asin(0.96))):
        at = swing(result["t"], angle)
        assert np.max(np.abs(result[x] - np.sin(at))) < 1e-10
        assert np.max(np.abs(result[y] + np.cos(at))) < 1e-10
        assert np.max(np.abs(np.hypot(result[x], result[y]) - 1.0)) < 1e-15


@pytest.mark.slow
@pytest.mark.parametrize("mass", [1e-12, 1e12])
def test_no_unit_of_mass_counts_where_a_coordinate_is_massless(mass):
    """A skate that a massless slider ties to a spring."""
    model = """
coordinates: {{x: {{}}, y: {{}}, a: {{}}, u: {{}}, z: {{}}}}
energy:
  kinetic: {m}*(x_dot^2 + y_dot^2 + a_dot^2 + u_dot^2)/2
  potential: 2*{m}*z^2
constraints: {{edge: sin(a)*x_dot = cos(a)*y_dot, bar: z = (u - x)/sqrt(2)}}
initial: {{x: 0, y: 0, a: 0, u: 1.4, z: 0.7*sqrt(2), x_dot: 1, u_dot: 1, a_dot: 1.5}}
simulation: {{duration: 2, output_step: 0.05, formulation: projection}}
"""
    one, other = (run(read(model.format(m=m), "skate.yaml")) for m in (1.0, mass))
    taken = [x.trajectory.statistics.steps for x in (one, other)]
    assert abs(taken[0] - taken[1]) <= 1
    assert other["x"] == pytest.approx(one["x"], abs=1e-11)


# What rows link keeps its steps in other words; by rounding, a step in a hundred may be
# rejected or not.
# A pendulum in the plane x = 0, where a row holds it that knows the other coordinates:
# x has no motion of its own. With lengths U of the units of x alone.
LINKED = """
parameters: {U: 1, X: 0, W: 0}
coordinates: {p: {}, y: {}, z: {}, far: {}}
definitions: {x: U*p - X}
energy: {kinetic: (x_dot^2 + y_dot^2 + z_dot^2)/2 + far_dot^2/2, potential: 9.81*z}
constraints: {rod: x^2 + y^2 + z^2 = 1, plane: x = x^2 + y^2 + z^2 - 1}
initial: {p: X/U, y: 0.6, z: -0.8, far: 0, far_dot: W}
simulation: {duration: 20, output_step: 0.1, method: dop853, rtol: 1e-7}
"""


def steps(**values):
    text = LINKED
    for name, value in values.items():
        was = "1" if name == "U" else "0"
        text = text.replace(f"{name}: {was}", f"{name}: {value}")
    return run(text).trajectory.statistics.steps


@pytest.mark.parametrize("values", [{"U": "1e-9"}, {"U": "1e9"}, {"W": "1e9"}])
def test_steps_are_those_of_the_same_motion_in_other_words(values):
    assert steps(**values) == pytest.approx(steps(), rel=0.02)
