"""Friction on the disc at any step, where its way turns; where it stops: in pairs."""

import functools

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from tests.scenes.contact.motions import G, contact, play, scene

MU, K = 0.01, 4.0
FLOOR = {"floor": contact("y >= 0", 0, friction=MU, slip=["x_dot", "z_dot"])}
# Of rattle, friction along a way that turns is of order 1.
METHODS = {
    "rk4": ({"step": 0.002}, 1e-9), "rattle": ({"step": 0.001}, 1e-4),
    "euler": ({"step": 0.001}, 2e-2), "dop853": ({}, 1e-9),
}  # fmt: skip


def spiral(t):
    """Give x, z (k,) of a puck on a spring, by another integrator."""

    def rates(_, s):
        v = np.hypot(s[2], s[3])
        return [s[2], s[3], *(-K * s[i] - MU * G * s[2 + i] / v for i in (0, 1))]

    return solve_ivp(
        rates, (0.0, t[-1]), [1.0, 0.0, 1.2, 0.9], "DOP853", t, rtol=1e-12, atol=1e-13
    ).y[:2]


@pytest.mark.parametrize("method", METHODS)
def test_a_way_that_turns_is_no_event(method):
    options, bound = METHODS[method]
    found = play(scene(
        "x z y", "(x_dot^2 + y_dot^2 + z_dot^2)/2", f"g*y + {K}*(x^2 + z^2)/2", FLOOR,
        {"x": 1, "z": 0, "y": 0, "x_dot": 1.2, "z_dot": 0.9}, duration=3,
        output_step=0.05, method=method, **options,
    ))  # fmt: skip
    # It goes around once and a half.
    for q, x in zip("xz", spiral(found.t), strict=True):
        assert found[q] == pytest.approx(x, abs=bound)
    assert found.result.events == ()
    assert len(found.t) == 61


@functools.cache
def turned():
    """Give x, z (2,) at 1 and 2: pushed a thousandth past friction, at an angle t^3."""
    friction, first = 0.2 * G, 1e-5

    def rates(t, s):
        v, push = np.hypot(s[2], s[3]), 1.001 * friction
        along = push * np.cos(t**3), push * np.sin(t**3)
        return [s[2], s[3], *(along[i] - friction * s[2 + i] / v for i in (0, 1))]

    def slopes(_, s):
        v = np.hypot(s[2], s[3])
        answer = np.eye(4, k=2)
        answer[2:, 2:] = friction * (np.outer(s[2:], s[2:]) / v**3 - np.eye(2) / v)
        return answer

    # Up to `first` it is pushed along x, but for 1e-15.
    push = 0.001 * friction
    start = [push * first**2 / 2.0, 0.0, push * first, 0.0]
    return solve_ivp(
        rates, (first, 2.0), start, "LSODA", (1.0, 2.0), rtol=1e-12, atol=1e-17,
        jac=slopes,
    ).y[:2]  # fmt: skip


@pytest.mark.parametrize("rows", [0.05, 1.0])
def test_a_force_that_begins_to_turn_at_a_rate_of_0(rows):
    push = "1.001*0.2*9.81"
    floor = {"floor": FLOOR["floor"] | {"friction": 0.2}}
    found = play(scene(
        "x z y", "(x_dot^2 + y_dot^2 + z_dot^2)/2", "g*y", floor,
        {"x": 0, "z": 0, "y": 0, "x_dot": 0, "z_dot": 0},
        forces={"x": f"{push}*cos(t^3)", "z": f"{push}*sin(t^3)"},
        duration=2, output_step=rows, method="auto",
    ))  # fmt: skip
    expected = turned()
    for q, x in zip("xz", expected, strict=True):
        seconds = found[q][[round(1.0 / rows), -1]]
        assert seconds == pytest.approx(x, abs=1e-8 * np.ptp(expected))


# Forces along x and z that outgrow friction of size 1.962 and turn; inertias.
PUSHES = {
    "both grow": (lambda t: (3 * np.sin(t), 2 * np.sin(2 * t)), 1, 1),
    "two inertias": (lambda t: (3 * np.sin(t), 2 * np.sin(2 * t)), 1, 4),
    "one is nearly enough": (lambda t: (1.8, 3 * t * (2 - t)), 1, 1),
}
TEXTS = {
    "both grow": ("3*sin(t)", "2*sin(2*t)"), "two inertias": ("3*sin(t)", "2*sin(2*t)"),
    "one is nearly enough": ("1.8", "3*t*(2 - t)"),
}  # fmt: skip


@functools.cache
def begun(name):
    """Time of the beginning, and x, z (2,) at 2, by Radau with an exact Jacobian."""
    push, *m = PUSHES[name]
    m, c, after = np.array(m), 0.2 * G, 1e-5
    since = brentq(lambda t: np.hypot(*push(t)) - c, 0.0, 0.9, xtol=1e-15)

    def rates(t, s):
        return [*s[2:], *((push(t) - c * s[2:] / np.hypot(*s[2:])) / m)]

    def slopes(_, s):
        v, J = np.hypot(*s[2:]), np.eye(4, k=2)
        J[2:, 2:] = c * (np.outer(s[2:], s[2:]) / v**3 - np.eye(2) / v) / m[:, None]
        return J

    # |f| - c grows evenly at first, and d m d s' is as much.
    way = np.array(push(since + after)) / np.hypot(*push(since + after))
    v = way * (np.hypot(*push(since + after)) - c) * after / 2 / (way @ (m * way))
    return since, solve_ivp(
        rates, (since + after, 2.0), [*(v * after / 3), *v], "Radau", (2.0,),
        rtol=1e-11, atol=1e-16, jac=slopes,
    ).y[:2, 0]  # fmt: skip


def pushed(name, **simulation):
    forces = dict(zip("xz", TEXTS[name], strict=True))
    kinetic = f"({PUSHES[name][1]}*x_dot^2 + {PUSHES[name][2]}*z_dot^2)/2"
    brake = {"relation": ["x_dot = 0", "z_dot = 0"], "limit": "0.2*g"}
    return play(scene(
        "x z", kinetic, "0", {"brake": brake}, {"x": 0, "z": 0}, forces=forces,
        duration=2, output_step=0.1, **simulation,
    ))  # fmt: skip


@pytest.mark.parametrize("name", PUSHES)
def test_a_slip_that_begins_takes_tens_of_steps(name):
    found = pushed(name, method="dop853")
    since, (x, z) = begun(name)
    assert found.times("slip", "brake") == pytest.approx([since], abs=1e-12)
    assert [found[q][-1] for q in "xz"] == pytest.approx([x, z], rel=2e-10)
    # Turned by friction from rest on, which is stiff there, it took 3000 and more.
    assert found.result.record["steps"] < 130


def test_a_slip_that_begins_is_of_the_order_of_a_fixed_step():
    off = []
    for step in 0.04, 0.02:
        found = pushed("both grow", method="rk4", step=step)
        x, z = begun("both grow")[1]
        off.append(np.hypot(found["x"][-1] - x, found["z"][-1] - z))
    assert off[1] < min(1e-7, off[0] / 10)


def test_a_slip_that_begins_where_a_run_ends():
    found = play(scene(
        "x z", "(x_dot^2 + z_dot^2)/2", "0",
        {"brake": {"relation": ["x_dot = 0", "z_dot = 0"], "limit": 3}},
        {"x": 0, "z": 0}, forces={"x": "1.5*t"}, duration=2,
    ))  # fmt: skip
    assert [found[q][-1] for q in ("t", "x", "x_dot")] == [2.0, 0.0, 0.0]


def test_a_slip_that_begins_turns_as_its_load_moves():
    # On two springs of other stiffness; friction falls until the load moves it. Its
    # load turns while it moves. Against friction that is smooth near rest.
    text = scene(
        "x y z", "(x_dot^2 + y_dot^2 + z_dot^2)/2", "2*x^2 + y^2/2 + 10*z",
        {"floor": contact("z >= 0", 0, friction="0.3 - 0.1*t",
                          slip=["x_dot", "y_dot"])},
        {"x": 0.6, "y": 0.6, "z": 0}, duration=1.25, output_step=0.25,
    )  # fmt: skip
    found = play(text)

    def rate(t, s):
        x, y, v, w = s
        part = (3.0 - t) / np.sqrt(v * v + w * w + 1e-14)
        return [v, w, -4.0 * x - part * v, -y - part * w]

    begins = 3.0 - 0.6 * np.hypot(4.0, 1.0)
    expected = solve_ivp(
        rate, (begins, 1.25), [0.6, 0.6, 0.0, 0.0], "Radau", rtol=1e-9, atol=1e-12
    )
    end = [found[q][-1] for q in ("x", "y", "x_dot", "y_dot")]
    assert end == pytest.approx(expected.y[:, -1], abs=1e-5)
