"""The jump of atan2 by 2 pi, with fixed steps: located, as other jumps of forces."""

import math

import numpy as np
import pytest

from tests.support import simulate

WRAPPED = """
coordinates: {{q: {{}}}}
energy: {{kinetic: q_dot^2/2, potential: 0}}
forces: {{q: "{force}"}}
initial: {{q: {start}, q_dot: {speed}}}
simulation: {{duration: 10, output_step: 0.25, method: {method}, step: {step}}}
"""
# z is pushed by the angle of a point that crosses the axis y = 0.
CROSSING = """
coordinates: {{x: {{}}, y: {{}}, z: {{}}}}
energy: {{kinetic: (x_dot^2 + y_dot^2 + z_dot^2)/2, potential: 0}}
forces: {{z: "atan2(y, x)"}}
initial: {{x: {x}, y: 1, z: 0, x_dot: 0, y_dot: -1, z_dot: 0}}
simulation: {{duration: 3, output_step: 1, method: {method}, step: {step}}}
"""
METHODS = [
    ("rk4", 4), ("gauss4", 4), ("verlet", 2), ("midpoint", 2), ("kahan-li6", 6),
    ("kahan-li8", 8),
]  # fmt: skip
FORCES = ["-atan2(sin(q), cos(q))", "atan2(-3*sin(q), 3*cos(q))"]


def angle(t, start, speed):
    """Angle at times t of a wheel with the force -theta, theta within pi of 0."""
    amplitude = math.hypot(start, speed)
    turn = 2 * math.asin(math.pi / amplitude)
    phase = t + math.asin(start / amplitude) + turn / 2
    turns = np.floor(phase / turn)
    return 2 * np.pi * turns + amplitude * np.sin(phase - turn * (turns + 0.5))


@pytest.mark.slow
@pytest.mark.parametrize(("method", "order"), METHODS)
@pytest.mark.parametrize("force", FORCES)
@pytest.mark.parametrize(("start", "speed"), [(0.3, 5.0), (1.0, 3.2)])
def test_the_order_holds_across_cuts(method, order, force, start, speed):
    errors = []
    for step in (0.0125, 0.00625):
        found = simulate(WRAPPED.format(
            force=force, start=start, speed=speed, method=method, step=step
        ))  # fmt: skip
        errors.append(np.max(np.abs(found["q"] - angle(found["t"], start, speed))))
    # Times of jumps are located on cubics: their errors grow with h^4, without a
    # regular sign. The rest is rounding, of some 1,600 steps of values of up to 50.
    least = 2.0 ** min(order, 4) / 4
    assert errors[1] < max(errors[0] / least, 1e-11)
    assert errors[0] < {2: 2e-2, 4: 1e-6, 6: 1e-7, 8: 1e-7}[order]


@pytest.mark.parametrize(("method", "order"), METHODS)
@pytest.mark.parametrize("x", [-1, 1])
def test_an_angle_jumps_on_the_negative_axis_only(method, order, x):
    found = simulate(CROSSING.format(x=x, method=method, step=0.01))
    # The integral of atan(u) from u = -2 to 1; atan2(u, -1) is pi sign(u) - atan(u).
    whole = math.pi / 4 - math.log(2) / 2 - 2 * math.atan(2) + math.log(5) / 2
    exact = whole if x > 0 else math.pi * (1 - 2) - whole
    allowed = 1e-4 if order == 2 else 1e-8
    assert found["z_dot"][-1] == pytest.approx(exact, abs=allowed)


@pytest.mark.slow
@pytest.mark.parametrize("step", [0.01, 0.007])
def test_a_state_that_is_led_to_the_cut_stays_there(step):
    """q' = q from 1 to pi, where the rates of both sides lead back."""
    found = simulate(f"""
coordinates: {{y: {{}}}}
energy: {{kinetic: y_dot^2/2, potential: 0}}
states: {{q: {{rate: "atan2(sin(q), cos(q))"}}}}
initial: {{q: 1, y: 0, y_dot: 0}}
simulation: {{duration: 2, output_step: 0.1, method: rk4, step: {step}}}
""")
    exact = np.minimum(np.exp(found["t"]), math.pi)
    assert found["q"] == pytest.approx(exact, abs=1e-8)
