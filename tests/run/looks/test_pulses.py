"""Features at given times, after a long rest or between similar features."""

import itertools
import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.special import ive

from tests.run.looks.scenes import METHODS, line
from tests.support import run

ROOT = math.sqrt(2 * math.pi)

# Forces on a body of mass 1 at rest, the time that they take, and their impulse.
PULSES = {
    "short": ("exp(-((t - 700)/1e-3)^2/2)", 1e3, 1e-3 * ROOT),
    "ten rows wide": ("exp(-((t - 703)/30)^2/2)", 1e3, 30 * ROOT),
    "gate": ("(tanh(1e3*(t - 500)) - tanh(1e3*(t - 500.01)))/2", 1e3, 0.01),
    "far too large": ("1e9*exp(-((t - 7.7)/1e-4)^2/2)", 10, 1e5 * ROOT),
    "both ways": (
        "exp(-((t - 300)/1e-2)^2/2) - 3*exp(-((t - 600)/1e-3)^2/2)",
        1e3,
        7e-3 * ROOT,
    ),
    "product": (
        "exp(-((t - 700)/1e-2)^2/2)*exp(-((t - 700.01)/1e-2)^2/2)",
        1e3,
        math.exp(-0.25) * 1e-2 * math.sqrt(math.pi),
    ),
    "slow tails": (
        "1e-6/(1e-6 + (t - 333)^2)",
        1e3,
        1e-3 * (math.atan(667e3) + math.atan(333e3)),
    ),
    "quotient": ("2/(exp(50*(t - 9)) + exp(-50*(t - 9)))", 12, math.pi / 50),
    "flat top": ("exp(-((t - 50)/0.01)^4)", 100, 0.02 * math.gamma(1.25)),
    "steep front": ("4*exp(-abs(t - 50)/0.001)", 100, 0.008),
}


@pytest.mark.parametrize("method", METHODS[1:])
@pytest.mark.parametrize("name", PULSES)
def test_a_pulse_gives_its_impulse(name, method):
    force, duration, impulse = PULSES[name]
    if name == "quotient" and method == "taylor":
        force = force.replace("50", "20")  # e^450 squared has no finite value
        impulse *= 2.5
    text = line(force=force, duration=duration, step=duration / 100, method=method)
    found = run(text)
    # Times of the size of the run's are known to 1e-16 of it, against the width.
    assert found["x_dot"][-1] == pytest.approx(impulse, rel=1e-8)
    assert found.trajectory.statistics.steps < 2e4


# Pulses in u = (t - c)/w, and their integral over u.
SHAPES = {
    "exp(-u^2)": math.sqrt(math.pi),
    "1/cosh(u)^2": 2.0,
    "exp(-(t + c)^2*u^2/(4*c^2))": math.sqrt(math.pi),
    "(tanh(4*u + 4) - tanh(4*u - 4))/2": 2.0,
    "exp(-abs(u))": 2.0,  # its peak is where an arc ends
    "max(0, 1 - u^2)^3": 32 / 35,
    "if(abs(u) < 1, 1 - u^2, 0)": 4 / 3,
}


def strikes(shape, c, w, *, x, duration):
    """A unit of impulse at c adds sin(t - c) to the motion of a spring."""
    pulse = shape.replace("u", f"((t - {c!r})/{w!r})").replace("c^", f"{c!r}^")
    pulse = pulse.replace("+ c)", f"+ {c!r})")
    text = line(
        "x^2/2", force=f"{1 / (w * SHAPES[shape])!r}*{pulse}", x=x, v=1,
        duration=duration, step=round(duration / 100, 4),
    )  # fmt: skip
    found = run(text)
    t = found["t"]
    # The width is felt as its square, and t - c is rounded against it.
    within = 10 * (w**2 + duration * 2.0**-53 / w) + 1e-9
    known = abs(t - c) > 60 * w
    moved = x * np.cos(t) + np.sin(t) + np.where(t > c, np.sin(t - c), 0.0)
    assert found["x"][known] == pytest.approx(moved[known], abs=within)


@pytest.mark.slow
@pytest.mark.parametrize("case", range(12))
@pytest.mark.parametrize("shape", SHAPES)
def test_a_pulse_strikes_what_swings(shape, case):
    rng = np.random.default_rng([case, *shape.encode()])
    duration = 10.0 ** rng.uniform(0.5, 2.0)
    c = duration * rng.uniform(0.2, 0.8)
    w = duration * 10.0 ** rng.uniform(-7.0, -5.0)
    strikes(shape, c, w, x=0.3, duration=duration)


@pytest.mark.slow
def test_a_pulse_whose_distance_no_step_sees_is_met():
    strikes("1/cosh(u)^2", 23.623379, 3.85e-6, x=0, duration=34.277)


@pytest.mark.parametrize("method", METHODS)
def test_a_short_pulse_after_a_long_rest(method):
    text = line(
        force="exp(-((t - 7e4)/1e-3)^2/2)", duration=1e5, step=100, method=method
    )
    found = run(text)
    # The argument itself is rounded to 1.5e-11/1e-3 of its unit.
    assert found["x_dot"][-1] == pytest.approx(1e-3 * ROOT, rel=1e-7)


@pytest.mark.parametrize("method", METHODS[:3])
def test_each_pulse_of_a_train_counts(method):
    text = line(
        force="exp(-300*(1 - cos(2*pi*t - 3)))", duration=100, step=10, method=method
    )
    found = run(text)
    # The integral over a period is exp(-300) I_0(300).
    assert found["x_dot"][-1] == pytest.approx(100 * ive(0, 300), rel=1e-9)
    assert found.trajectory.statistics.steps < 100 * 100


@pytest.mark.parametrize("method", METHODS[:3])
def test_a_kick_on_what_moves(method):
    """An oscillator kicked at t0: a sine of the impulse on top of its own."""
    width, t0 = 1e-4, 61.3
    text = line(
        "x^2/2", force=f"exp(-((t - {t0})/{width})^2/2)", x=1, duration=80, step=10,
        method=method,
    )  # fmt: skip
    end = run(text)["x"][-1]
    kick = width * ROOT * math.exp(-(width**2) / 2)
    expected = math.cos(80) + kick * math.sin(80 - t0)
    assert end == pytest.approx(expected, abs=2e-9)


@pytest.mark.slow
@pytest.mark.parametrize("method", METHODS[:3])
def test_a_ramp_of_a_prescribed_motion(method):
    """A mass hangs by a spring from a support that moves up by 1 within 0.01 s."""
    text = line(
        "50*(x - (1 + tanh(200*(t - 30)))/2)^2", duration=33, step=1, method=method
    )
    found = run(text)
    # A step smoothed with sech^2 of that width drives w = 10 by the step's transform.
    z = math.pi * 10 / 400
    expected = 1 - z / math.sinh(z) * math.cos(10 * (33 - 30))
    assert found["x"][-1] == pytest.approx(expected, abs=1e-8)


@pytest.mark.slow
def test_what_varies_gently_makes_no_stops():
    plain = run(line("x^2/2", force="cos(2*t)", x=1, duration=50, method="dop853"))
    text = line("x^2/2", force="exp(cos(2*t))", x=1, duration=50, method="dop853")
    gentle = run(text)
    steps = [r.trajectory.statistics.steps for r in (plain, gentle)]
    assert steps[1] < 2 * steps[0]


@pytest.mark.slow
def test_a_pulse_in_the_first_and_the_last_instant():
    text = line(force="exp(-(t/1e-4)^2/2) + exp(-((t - 20)/1e-4)^2/2)", method="taylor")
    end = run(text)["x_dot"][-1]
    assert end == pytest.approx(1e-4 * ROOT, rel=1e-7)


# A block on the floor, pulled past its friction, is struck from the side at once: after
# how long, how wide, how hard.
STRUCK = [(3.0e-4, 2.6e-5, 1.0e-3), (6.2e-4, 1.0e-4, 5.9e-4), (4.2e-3, 3.0e-5, 5.6e-4)]


@pytest.mark.slow
@pytest.mark.parametrize(("after", "width", "size"), STRUCK)
def test_a_pulse_soon_after_a_slip_has_begun(after, width, size):
    begins = 0.5 * 9.81 / 6
    at = begins + after
    found = run(f"""
coordinates: {{x: {{}}, y: {{}}, z: {{}}}}
energy: {{kinetic: (x_dot^2 + y_dot^2 + z_dot^2)/2, potential: 9.81*z}}
forces: {{x: 6*t, y: "{size!r}*exp(-((t - {at!r})/{width!r})^2)/{width!r}"}}
constraints:
  floor: {{relation: z >= 0, restitution: 0, friction: 0.5, slip: [x_dot, y_dot]}}
initial: {{x: 0, y: 0, z: 0}}
simulation: {{duration: 1, output_step: 0.1}}
""")

    def rates(t, y):
        speed = math.hypot(y[2], y[3])
        pulse = size * math.exp(-min(((t - at) / width) ** 2, 700)) / width
        return [
            y[2], y[3], 6 * t - 4.905 * y[2] / speed, pulse - 4.905 * y[3] / speed,
        ]  # fmt: skip

    # At first x'' = 6 (t - begins).
    early = 1e-3 * after
    y = [early**3, 0, 3 * early**2, 0]
    edges = [begins + early, max(at - 7 * width, begins + 2 * early), at + 7 * width, 1]
    for a, b in itertools.pairwise(edges):
        solved = solve_ivp(
            rates, (a, b), y, "Radau", rtol=1e-10, atol=1e-16, max_step=(b - a) / 100
        )
        y = solved.y[:, -1]
    for name, value in zip(("x", "y"), y, strict=False):
        assert found[name][-1] == pytest.approx(value, rel=1e-5)
