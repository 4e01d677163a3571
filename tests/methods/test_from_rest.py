"""Motions that begin from rest under forces that begin at 0, against closed forms."""

import numpy as np
import pytest

from tests.support import run, simulate

BODY = """name: body
coordinates: {{x: {{}}}}
energy: {{kinetic: "x_dot^2/2", potential: "0"}}
forces: {{x: "{force}"}}
initial: {{x: 0}}
simulation: {{duration: 2, output_step: 0.1, method: {method}}}
"""
PAIR = """name: pair
coordinates: {{x: {{}}, y: {{}}}}
energy: {{kinetic: "(x_dot^2 + y_dot^2)/2", potential: "0"}}
constraints: {{sum: "x + y = 1 + t^{power}"}}
initial: {{x: 0.5, y: 0.5}}
simulation: {{duration: 2, output_step: 0.1, method: dop853}}
"""


@pytest.mark.parametrize(
    ("force", "power", "method"),
    [
        ("sqrt(t)", 0.5, "auto"), ("abs(t)^0.5", 0.5, "dop853"),
        ("cbrt(t)", 1.0 / 3.0, "dop853"), ("t^1.5", 1.5, "dop853"),
        ("t^5", 5.0, "dop853"), ("t^9", 9.0, "auto"), ("sqrt(t)", 0.5, "radau"),
    ],
)  # fmt: skip
def test_a_power_of_the_time(force, power, method):
    result = run(BODY.format(force=force, method=method))
    assert result.trajectory.outcome.complete
    exact = result["t"] ** (power + 2.0) / ((power + 1.0) * (power + 2.0))
    # A tenth of the default tolerance in each step, a hundred steps.
    assert np.max(np.abs(result["x"] - exact)) < 1e-10 * np.max(exact)


@pytest.mark.parametrize("power", [2.5, 4.0, 6.0])
def test_a_constraint_that_begins_to_move(power):
    result = run(PAIR.format(power=power))
    assert result.trajectory.outcome.complete
    exact = 0.5 + result["t"] ** power / 2.0
    assert np.max(np.abs(result["x"] - exact)) < 1e-10 * np.max(exact)


@pytest.mark.parametrize("force", [1.0, 0.0])
def test_one_sets_the_next_in_motion(force):
    # Masses joined by springs, of which the first is pushed, or drives off.
    count = 8
    places = range(count)
    springs = " + ".join(f"(x{i + 1} - x{i})^2" for i in range(count - 1))
    result = run(
        "name: springs\n"
        f"coordinates: {{{', '.join(f'x{i}: {{}}' for i in places)}}}\n"
        "energy:\n"
        f'  kinetic: "({" + ".join(f"x{i}_dot^2" for i in places)})/2"\n'
        f'  potential: "({springs})/2"\n'
        f'forces: {{x0: "{force}"}}\n'
        f"initial: {{{', '.join(f'x{i}: 0' for i in places)}, x0_dot: {1.0 - force}}}\n"
        "simulation: {duration: 3, output_step: 0.5, method: dop853}\n"
    )
    assert result.trajectory.outcome.complete
    # Modes of the free chain: cos(k pi (i + 1/2) / count).
    i = np.arange(count)
    exact = np.zeros(count)
    for k in range(count):
        mode = np.cos(np.pi * k * (i + 0.5) / count)
        part = mode[0] / (mode @ mode) * mode
        w, t = 2.0 * np.sin(np.pi * k / (2.0 * count)), 3.0
        pushed = t * t / 2.0 if k == 0 else (1.0 - np.cos(w * t)) / w**2
        driven = t if k == 0 else np.sin(w * t) / w
        exact += part * (pushed if force else driven)
    found = np.array([result[f"x{k}"][-1] for k in places])
    # The sum of modes cancels to the last masses' share: roundings of the first's.
    assert np.max(np.abs(found - exact)) < 1e-10
    assert np.all(np.abs(found[-2:] - exact[-2:]) < 1e-6 * exact[-2:])


@pytest.mark.slow
@pytest.mark.parametrize("method", ["dop853", "dopri5", "radau", "rk4"])
@pytest.mark.parametrize(
    ("place", "rate", "kink"),
    [(0.1539, -1.688, 9.0), (0.77, -1.0, 0.77), (1.4709, -0.5, 1.896)],
)
def test_a_body_at_rest_is_coupled_by_its_mass_to_one_that_a_row_moves(
    place, rate, kink, method
):
    """The row leaves rounding in y, whose velocity jumps by -1/4 of the jump of x's."""
    found = simulate(
        f"""
coordinates: {{x: {{}}, y: {{}}}}
energy: {{kinetic: (x_dot^2 + y_dot^2 + 0.5*x_dot*y_dot)/2, potential: 0}}
constraints: {{drive: "x = {place} + {rate}*t + 2*max(t - {kink}, 0)"}}
initial: {{x: {{guess: 0}}, x_dot: {{guess: 0}}, y: 0}}
simulation: {{duration: 2, output_step: 0.1, formulation: projection}}
""",
        method=method,
    )
    assert found.outcome == "done"
    later = np.maximum(found.t - kink, 0.0)
    assert found["x"] == pytest.approx(place + rate * found.t + 2 * later, abs=1e-14)
    assert found["y"] == pytest.approx(-0.5 * later, abs=1e-14)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("method", "near"),
    [("auto", 1e-10), ("dop853", 1e-10), ("radau", 1e-10), ("kahan-li8", 1e-10),
     ("kahan-li6", 1e-8), ("rk4", 1e-5), ("gauss4", 1e-5), ("verlet", 1e-2),
     ("rattle", 1e-2), ("midpoint", 1e-2), ("generalized-alpha", 1e-2)],
)  # fmt: skip
@pytest.mark.parametrize(
    ("force", "exact"),
    [
        ("t - abs(x)", lambda t: t - np.sin(t)),
        ("t - x*sign(x)", lambda t: t - np.sin(t)),
        ("t^2 - max(x, -3*x)", lambda t: t**2 - 2.0 + 2.0 * np.cos(t)),
        ("t - max(x_dot, -x_dot)", lambda t: t**2 / 2.0 - t + 1.0 - np.exp(-t)),
    ],
)
def test_a_body_leaves_the_level_of_a_switch_under_a_force_that_begins_at_0(
    force, exact, method, near
):
    """The argument of the switch never has the other sign, and nothing switches."""
    if "x_dot" in force and method in ("kahan-li8", "kahan-li6", "verlet", "rattle"):
        pytest.skip("the method does not handle forces of velocities")
    steps = {} if method in ("auto", "dop853", "radau") else {"step": 0.1}
    found = simulate(BODY.format(force=force, method=method), **steps)
    assert found.outcome == "done"
    assert not found.events
    assert found["x"] == pytest.approx(exact(found.t), abs=near)
