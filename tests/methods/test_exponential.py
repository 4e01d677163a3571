"""The method `exponential`: exact for what is linear, and refused for all else."""

import math

import numpy as np
import pytest
from scipy.linalg import expm

from lagsim.methods.exponential import balance, norm
from tests.support import run

ROUNDING = 2.0**-52

ONE = """
parameters: {{m: 1, k: {k}, c: {c}, F: {F}}}
coordinates: {{x: {{}}}}
energy: {{kinetic: m*x_dot^2/2, potential: k*x^2/2, dissipation: c*x_dot^2/2}}
forces: {{x: F}}
initial: {{x: {x}, x_dot: {v}}}
simulation: {{duration: {duration}, output_step: {step}, method: exponential}}
"""


def one(k=0.0, c=0.0, F=0.0, x=0.0, v=0.0, duration=10, step=0.1):
    text = ONE.format(k=k, c=c, F=F, x=x, v=v, duration=duration, step=step)
    found = run(text)
    assert found.trajectory.outcome.word == "done"
    # The ledger: the integral of the power against the energies.
    scale = np.max(np.abs(found["energy"])) + np.max(np.abs(found["work"]))
    # Each radian of an oscillation may add a rounding.
    radians = math.sqrt(k) * (found["t"][-1] - found["t"][0])
    assert found.drift <= (100 + radians) * ROUNDING * scale
    return found


DAMPED = math.sqrt(4.0 - 0.04)


@pytest.mark.parametrize(
    ("scene", "exact", "bound"),
    [
        # 300 steps, 60 radians: some rounding in each.
        (
            {"k": 4.0, "c": 0.4, "x": 1.0, "duration": 30},
            lambda t: (
                np.exp(-0.2 * t)
                * (np.cos(DAMPED * t) + 0.2 / DAMPED * np.sin(DAMPED * t))
            ),
            1e-14,
        ),
        # Critical damping has no eigenvectors.
        (
            {"k": 9.0, "c": 6.0, "x": 1.0, "duration": 5},
            lambda t: (1 + 3 * t) * np.exp(-3 * t),
            1e-15,
        ),
        # J is nilpotent: a polynomial, exact to rounding on |x| < 430.
        (
            {"F": -9.8, "x": 1.0, "v": 5.0},
            lambda t: 1 + 5 * t - 4.9 * t * t,
            430 * 10 * ROUNDING,
        ),
        # 16,000 radians from row to row: what the phase itself is rounded by, and the
        # doublings enlarge a few times.
        (
            {"k": 1e10, "x": 1.0, "duration": 1.6, "step": 0.16},
            lambda t: np.cos(1e5 * t),
            20 * 1.6e5 * ROUNDING,
        ),
        # A damping of 1e6 beside a load: rest at F/k, to first order in k m/c^2.
        (
            {"k": 2.0, "c": 1e6, "F": 6.0, "duration": 4e6, "step": 1e5},
            lambda t: 3.0 * (1.0 - np.exp(-2e-6 * t)),
            2e-11,
        ),
        # 10^4 steps of a radian, each off by less than one rounding of its own motion.
        ({"k": 1.0, "x": 1.0, "duration": 1e4, "step": 1.0}, np.cos, 1e4 * ROUNDING),
    ],
    ids=["damped", "critical", "free fall", "stiff", "overdamped", "long"],
)
def test_an_oscillator(scene, exact, bound):
    found = one(**scene)
    assert np.max(np.abs(found["x"] - exact(found["t"]))) < bound


@pytest.mark.parametrize("unit", [1e-6, 1.0, 1e9])
def test_what_falls_freely_does_not_enter_the_norm(unit):
    # (x1, x2, v1, v2, 1): x1'' = -9.8, x2'' = -100 x2, times in so many seconds. The
    # norm sets the number of parts of an interpolation: 10 is the rate that there is.
    a = np.zeros((5, 5))
    a[0, 2] = a[1, 3] = 1.0
    a[2, 4], a[3, 1] = -9.8 * unit**2, -100.0 * unit**2
    before, d = a.copy(), np.empty(5)
    balance(5, a.reshape(-1), d)
    assert np.array_equal(a * d[:, None] / d, before)
    assert norm(5, 5, a.reshape(-1)) <= 2 * 10 * unit


@pytest.mark.parametrize("unit", [1e-6, 1e3, 1e9])
def test_units_do_not_matter(unit):
    # Lengths in other units, and forces with them.
    metres = one(k=400.0, c=0.1, F=3.0, x=1.0)
    other = one(k=400.0, c=0.1, F=3.0 * unit, x=unit)
    assert np.max(np.abs(metres["x"] - other["x"] / unit)) < 1e-14
    # Time in other units: stiffness and damping change.
    slower = one(k=400.0 / unit**2, c=0.1 / unit, F=3.0 / unit**2, x=1.0,
                 duration=10 * unit, step=0.1 * unit)  # fmt: skip
    assert np.max(np.abs(metres["x"] - slower["x"])) < 1e-14


@pytest.mark.parametrize("seed", range(4))
def test_random_stable_scenes_against_expm(seed):
    random = np.random.default_rng(seed)
    n = 3
    K, C = (a @ a.T for a in random.normal(size=(2, n, n)))
    G = random.normal(size=(n, n))
    M = np.diag(random.uniform(0.1, 10, n))
    F, q, v = random.normal(size=(3, n))
    names = [f"q{i}" for i in range(n)]
    pairs = [(i, j) for i in range(n) for j in range(n)]

    def form(a, names):
        return " + ".join(f"({a[i, j]!r})*{names[i]}*{names[j]}" for i, j in pairs)

    rates = [f"{x}_dot" for x in names]
    K, C, G = (np.array(a, dtype=object) for a in (K, C, G - G.T))
    circulation = [
        " + ".join(f"({float(G[i, j])!r})*{rates[j]}" for j in range(n))
        + f" + ({float(F[i])!r})"
        for i in range(n)
    ]
    text = "\n".join(
        [
            "coordinates: {" + ", ".join(f"{x}: {{}}" for x in names) + "}",
            "energy:",
            f"  kinetic: ({form(np.array(M.tolist(), dtype=object), rates)})/2",
            f"  potential: ({form(K, names)})/2",
            f"  dissipation: ({form(C, rates)})/2",
            "forces:",
            *(f"  {x}: {f}" for x, f in zip(names, circulation, strict=True)),
            "initial: {"
            + ", ".join(f"{x}: {float(a)!r}" for x, a in zip(names, q, strict=True))
            + ", "
            + ", ".join(f"{x}: {float(a)!r}" for x, a in zip(rates, v, strict=True))
            + "}",
            "simulation: {duration: 6, output_step: 0.5, method: exponential}",
        ]
    )
    found = run(text)
    A = np.zeros((2 * n + 1, 2 * n + 1))
    A[:n, n : 2 * n] = np.eye(n)
    inverse = np.linalg.inv(M)
    A[n : 2 * n, :n] = -inverse @ K.astype(float)
    A[n : 2 * n, n : 2 * n] = inverse @ (G - C).astype(float)
    A[n : 2 * n, 2 * n] = inverse @ F
    z = np.concatenate([q, v, [1.0]])
    for row, t in enumerate(found["t"]):
        exact = expm(A * t) @ z
        states = [found[name][row] for name in (*names, *rates)]
        # Both are good to some rounding times |A| t < 1000.
        assert np.max(np.abs(states - exact[:-1])) < 1e-12 * np.max(np.abs(exact))
    assert found.drift < 1e-12 * np.max(np.abs(found["energy"]))


SLIDING = """
coordinates: {x: {}, y: {}, z: {}}
energy:
  kinetic: (x_dot^2 + 2*y_dot^2 + 3*z_dot^2)/2
  potential: 5*(x^2 + y^2) + z
  dissipation: 0.1*y_dot^2
constraints: {bar: x + 2*y = 1, plane: z = x}
initial: {x: 1, y: 0, z: {guess: 1}}
simulation: {duration: 10, output_step: 0.1, method: METHOD}
"""


def test_constant_constraints():
    found, other = (
        run(SLIDING.replace("METHOD", m)) for m in ("exponential", "dop853")
    )
    for name in ("x", "y", "z", "lambda_bar", "lambda_plane", "work"):
        # The tolerance of dop853, of values below 10.
        assert np.max(np.abs(found[name] - other[name])) < 1e-9
    assert np.max(np.abs(found["x"] + 2 * found["y"] - 1)) < 4 * ROUNDING
    assert found.drift < 1e-13


def test_rows_between_steps():
    # Steps of 0.7 and rows at 0.1: the series between, work with it.
    found = one(k=30.0, c=0.4, F=1.0, x=1.0)
    between = run(
        ONE.format(k=30.0, c=0.4, F=1.0, x=1.0, v=0.0, duration=10, step=0.1).replace(
            "method: exponential", "method: exponential, step: 0.7"
        )
    )
    assert between.trajectory.statistics.steps == 15  # 14 whole ones, and the rest
    for name in ("x", "x_dot", "work"):
        assert np.max(np.abs(between[name] - found[name])) < 1e-13


@pytest.mark.parametrize(
    ("until", "end"),
    [
        ("x <= 0", math.pi / 2),
        # What is true at the start counts once it has been false.
        *((f"x >= {c}", 2 * math.pi - math.acos(c)) for c in (0.5, 0.0, -0.9)),
        ("x >= -1.1", 63.0),
    ],
)
def test_until(until, end):
    # One step has ten periods of x = cos t.
    text = ONE.format(k=1.0, c=0.0, F=0.0, x=1.0, v=0.0, duration=63, step=63)
    found = run(text.replace("method", f"until: {until}, method"))
    assert found["t"][-1] == pytest.approx(end, abs=1e-15)


def test_a_mass_without_a_finite_reciprocal_ends_the_run():
    # Balancing a matrix with infinite entries has no end of its own.
    text = ONE.format(k=1, c=0, F=0, x=1, v=0, duration=1, step=0.1)
    found = run(text.replace("m: 1,", "m: 1e-310,").replace("x: F", "x: 0*F"))
    assert found.trajectory.outcome.word == "failed"
    assert found.trajectory.end == 0.0


@pytest.mark.parametrize("at", [0.0, 1e6, -1e9])
def test_work_far_from_the_origin(at):
    """Work is as exact as the motion, not as the square of the distance."""
    text = ONE.format(k=4.0, c=0.4, F=0.0, x=at + 1.0, v=0.0, duration=5, step=0.1)
    found = run(text.replace("k*x^2/2", f"k*(x - {at!r})^2/2"))
    t = found["t"]
    x = np.exp(-0.2 * t) * (np.cos(DAMPED * t) + 0.2 / DAMPED * np.sin(DAMPED * t))
    v = -4.0 / DAMPED * np.exp(-0.2 * t) * np.sin(DAMPED * t)
    known = 1e-14 + 10 * ROUNDING * abs(at)
    assert np.max(np.abs(found["x"] - at - x)) < known
    assert np.max(np.abs(found["x_dot"] - v)) < 4 * known
    assert np.max(np.abs(found["work"] - (v * v / 2 + 2 * x * x - 2))) < 4 * known
