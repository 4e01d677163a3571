"""Rows that show a force missed by their step: the step is rejected.

Ten rows are enough, whatever the force is made of.
"""

import math

import numpy as np
import pytest
from scipy.integrate import quad

from lagsim.methods.parts import missed
from tests.run.looks.scenes import line
from tests.support import run

METHODS = ("taylor", "dop853", "radau")
ROOT = math.sqrt(2 * math.pi)


@pytest.fixture
def by_rows_alone(monkeypatch):
    """Localized terms are not searched for."""
    monkeypatch.setattr("lagsim.program.system.indicators", lambda *_: [])


# Forces on a body at rest, and their impulse; rows are 1 apart.
PULSES = {
    "gaussian": ("exp(-((t - 14e3)/10)^2/2)", 10 * ROOT),
    "narrow": ("exp(-((t - 14e3)/2)^2/2)", 2 * ROOT),
    "ten rows and nothing else": ("exp(-((t - 14e3)/5)^8)", 10 * math.gamma(1 + 1 / 8)),
}


@pytest.mark.usefixtures("by_rows_alone")
@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("name", PULSES)
def test_a_pulse_late_in_a_long_rest(name, method):
    force, impulse = PULSES[name]
    found = run(line(force=force, duration=2e4, step=1, method=method))
    # The time itself is known to 2e-12, the sum of steps to 1e-11 of each.
    assert found["x_dot"][-1] == pytest.approx(impulse, abs=1e-9)
    assert found["x"][-1] == pytest.approx(6e3 * impulse, rel=1e-9)


# Potentials that a body of energy 0.5 cannot pass, some hundred rows ahead.
HIGH = {
    "hill": "10*exp(-x^2/2)",
    "thin hill": "10*exp(-(2*x)^2/2)",
    "ramp": "5*(1 + tanh((x - 100)/2))",
}


@pytest.mark.usefixtures("by_rows_alone")
@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("name", HIGH)
def test_a_hill_turns_the_motion_back(name, method):
    text = line(HIGH[name], x=-900, v=1, duration=2200, step=0.5, method=method)
    found = run(text)
    assert found["x_dot"][-1] == pytest.approx(-1, abs=1e-8)
    assert np.max(found["x"]) < 100


# Forces that are flat but for a short way, of functions that no other look knows.
UNKNOWN = {
    "squares of squares": ("((cos(0.3*x)^4)^4)^4", lambda x: math.cos(0.3 * x) ** 64),
    "more of them": ("(((cos(x/10)^4)^5)^5)^5", lambda x: math.cos(x / 10) ** 500),
    "many factors": (
        "*".join(["(1 - sin(x/8)^2)^5"] * 8),
        lambda x: math.cos(x / 8) ** 80,
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", UNKNOWN)
def test_what_no_look_knows(name):
    force, law = UNKNOWN[name]
    text = line(
        force=f"-{force}/2", x=-13, v=2, duration=15, step=0.05, method="taylor"
    )
    found = run(text)
    end = found["x"][-1]
    lost = quad(law, -13, end, limit=500, epsabs=1e-13)[0] / 2
    assert found["x_dot"][-1] ** 2 / 2 == pytest.approx(2 - lost, abs=1e-9)


# Scenes in which q'' at rows is off by far more than tolerances, and should be.
NOISY = {
    "stiff": line("1e10*(x - sin(t))^2/2", method="radau, rtol: 1e-6", v=1, duration=6),
    "at rest far away": line("1e6*(x - 1e6)^2/2", force="9", x=1e6 + 9e-6, duration=6),
    "held": """
coordinates: {x: {}, y: {}}
energy: {kinetic: (x_dot^2 + y_dot^2)/2, potential: 9.81*y}
constraints: {rod: "x^2 + y^2 = 1"}
initial: {x: 1e-4, y: -sqrt(1 - 1e-8)}
simulation: {duration: 6, output_step: 0.1}
""",
}


def counts(monkeypatch, model, **options):
    """Return steps, rejections and evaluations with and without the comparison."""
    found = []
    for apart in (missed.APART, 1e300):
        monkeypatch.setattr(missed, "APART", apart)
        made = run(model, **options).trajectory.statistics
        found.append((made.steps, made.rejections, made.evaluations))
    return found


@pytest.mark.slow
@pytest.mark.parametrize("method", METHODS)
def test_smooth_steps_are_left_alone(method, monkeypatch):
    """Some hundred rows in each."""
    options = {"method": method, "rtol": "1e-9", "output_step": 36 / 3e4}
    seen, unseen = counts(monkeypatch, "elastic-pendulum", **options)
    assert seen == unseen


@pytest.mark.slow
@pytest.mark.parametrize("name", NOISY)
def test_noise_and_stiffness_are_no_sign(name, monkeypatch):
    seen, unseen = counts(monkeypatch, NOISY[name], output_step=6e-4)
    assert seen == unseen


@pytest.mark.usefixtures("by_rows_alone")
def test_what_no_step_resolves_does_not_hold_the_run_up():
    """A force in single rows, and nowhere else: half of ten rows is the least step."""
    force = "1e3*exp(-(1e9*sin(pi*t/10))^2)"
    found = run(line(force=force, duration=399.5, step=1, method="dop853"))
    assert found.trajectory.outcome.complete
    counts = found.trajectory.statistics
    assert 399.5 / 10 < counts.steps + counts.rejections < 400
