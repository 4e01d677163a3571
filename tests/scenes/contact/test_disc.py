"""Friction on the disc at any step, where its way turns; where it stops: in pairs."""

import functools
import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq, minimize

from tests.scenes.contact.motions import G, contact, play, scene

MU, K = 0.01, 4.0
FLOOR = {"floor": contact("y >= 0", 0, friction=MU, slip=["x_dot", "z_dot"])}
# Of rattle, friction along a way that turns is of order 1.
METHODS = {
    "rk4": ({"step": 0.002}, 1e-9), "rattle": ({"step": 0.001}, 1e-4),
    "euler": ({"step": 0.001}, 2e-2), "dop853": ({}, 1e-9),
}  # fmt: skip


def spiral(t):
    """Return x, z (k,) of a puck on a spring, by another integrator."""

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
    """Return x, z (2,) at 1 and 2: pushed just past friction, at an angle t^3."""
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


@pytest.mark.slow
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


@pytest.mark.slow
@pytest.mark.parametrize("name", PUSHES)
def test_a_slip_that_begins_takes_tens_of_steps(name):
    found = pushed(name, method="dop853")
    since, (x, z) = begun(name)
    assert found.times("slip", "brake") == pytest.approx([since], abs=1e-12)
    assert [found[q][-1] for q in "xz"] == pytest.approx([x, z], rel=2e-10)
    # Turned by friction from rest on, which is stiff there, it took 3000 and more.
    assert found.result.record["steps"] < 130


@pytest.mark.slow
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


@pytest.mark.slow
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


# What holds a body across the way (-0.8, 0.6), and shares its load with a disc.
ACROSS = "0.6*x_dot + 0.8*w_dot"
RAILS = {
    "friction": {"relation": f"{ACROSS} = 0", "limit": 2},
    "a constraint": {"relation": f"{ACROSS} = 0"},
    "a constraint for a time": {"relation": f"{ACROSS} = 0", "when": "t < 5"},
    "a wall": contact("0.6*x + 0.8*w <= 0", 0),
}  # fmt: skip
DISCS = {
    "limit": {"relation": ["x_dot = 0", "w_dot = 0"], "limit": 3},
    "friction": contact("z >= 0", 0, friction=0.3, slip=["x_dot", "w_dot"]),
}


def railed(rail, disc, push, speed=0.0):
    """Pushed with 1.5 across the rail and `push` along it."""
    return play(scene(
        "x w z", "(x_dot^2 + w_dot^2 + z_dot^2)/2", "10*z",
        {"disc": DISCS[disc], "rail": RAILS[rail]},
        {"x": 0, "w": 0, "z": 0, "x_dot": -0.8 * speed, "w_dot": 0.6 * speed},
        forces={"x": f"0.9 - 0.8*({push})", "w": f"1.2 + 0.6*({push})",
                "z": "if(z > 0, 10, 10)" if disc == "limit" else "0"},
        duration=4, output_step=0.5,
    ))  # fmt: skip


@pytest.mark.parametrize("disc", DISCS)
@pytest.mark.parametrize("rail", RAILS)
def test_a_slip_begins_along_the_way_that_is_left(rail, disc):
    # The rail bears what is across: the disc has 3 for the way.
    found = railed(rail, disc, "1.5*t")
    assert found.times("slip") == pytest.approx([2.0], abs=1e-9)
    way = np.maximum(found.t - 2.0, 0.0) ** 3 / 4
    assert found["x"] == pytest.approx(-0.8 * way, abs=1e-9)
    assert found["w"] == pytest.approx(0.6 * way, abs=1e-9)
    assert found.result.record["steps"] < 100


@pytest.mark.parametrize("rail", RAILS)
def test_a_slip_ends_along_the_way_that_is_left(rail):
    found = railed(rail, "limit", "1", speed=1.0)
    assert found.times("stick") == pytest.approx([0.5], abs=1e-9)
    assert found["w"][1:] == pytest.approx(0.6 * 0.25, abs=1e-9)
    assert found.result.record["steps"] < 100


@pytest.mark.slow
def test_a_disc_on_a_ring_slips_as_a_whole():
    """Both rows of the disc are at the bound of its friction at once, despite rounding.

    The ring bears the transverse force; the friction has its bound along the ring.
    """
    r, a, v, limit, K, w = 1.499, -1.138, -1.263, 1.648387, 2.425, 3.606
    c, s = math.cos(a), math.sin(a)
    found = play(scene(
        "x y", "1.937*(x_dot^2 + y_dot^2)/2", f"{K}*(x - 0.3)^2/2 + {K}*y^2/3",
        {"disc": {"relation": ["x_dot = 0", "y_dot = 0"], "limit": limit},
         "ring": f"x^2 + y^2 = {r * r!r}"},
        {"x": r * c, "y": r * s, "x_dot": -v * r * s, "y_dot": v * r * c},
        forces={"x": f"2.678871*sin({w}*t)"}, duration=2, output_step=0.05,
    ))  # fmt: skip
    [stick, *_], [slip, *_] = found.times("stick"), found.times("slip")
    x, y = (found[q][np.searchsorted(found.t, stick)] for q in "xy")

    def left(t):
        push = -y * (2.678871 * np.sin(w * t) - K * (x - 0.3)) - x * 2.0 * K * y / 3.0
        return limit - abs(push) / r

    assert slip == pytest.approx(brentq(left, stick + 0.1, 1.3), abs=1e-8)
    friction = np.hypot(found["lambda_disc.1"], found["lambda_disc.2"])
    assert np.max(friction) <= limit * (1.0 + 1e-9)


def test_friction_at_its_bound_that_turns_and_falls_holds():
    force = "3*(1 - t/10)"
    found = play(scene(
        "x z", "(x_dot^2 + z_dot^2)/2", "0",
        {"disc": {"relation": ["x_dot = 0", "z_dot = 0"], "limit": 3}},
        {"x": 0, "z": 0}, forces={"x": f"{force}*cos(t)", "z": f"{force}*sin(t)"},
        duration=4,
    ))  # fmt: skip
    assert found.result.events == ()
    assert found.result.record["steps"] < 20


LEGS = np.array([[0.5, 0.4], [-0.5, 0.3], [0.1, -0.6]])


@pytest.mark.slow
@pytest.mark.parametrize("last_places", [0, 5, 6, 9, 13])
def test_a_table_slips_when_no_sharing_of_its_friction_holds_it(last_places):
    """When it slips is limit analysis: the least work of friction over all slips.

    It is pushed at its middle, turns as it slips, and then follows friction that is
    smooth near rest. A force changed in its last places moves it in as many steps:
    lateral speeds of the size of rounding do not decide how its slips begin.
    """
    force = 4.0 * (1.0 + last_places * 1e-14)
    press = np.linalg.solve(np.vstack([np.ones(3), LEGS.T]), [20.0, 0.0, 0.0])
    arms = np.column_stack([-LEGS[:, 1], LEGS[:, 0]])

    def work(slip):
        return 0.3 * press @ np.hypot(*([1.0, slip[0]] + slip[1] * arms).T)

    options = {"xatol": 1e-11, "fatol": 1e-15, "maxiter": 4000}
    slips = minimize(work, [0.0, 0.0], method="Nelder-Mead", options=options).fun / 4

    def rates(t, s):
        slip = s[3:5] + s[5] * arms
        pushes = -0.3 * press / np.sqrt((slip**2).sum(axis=1) + 1e-16) * slip.T
        turn = (arms.T * pushes).sum() / 0.3
        return [*s[3:], 2.0 * t + pushes[0].sum() / 2, pushes[1].sum() / 2, turn]

    expected = solve_ivp(
        rates, (slips, 2.0), np.zeros(6), "LSODA", rtol=1e-10, atol=1e-14
    )
    feet = {
        f"leg{i}": contact(
            f"z + {x}*b - {y}*a >= 0", 0, friction=0.3,
            slip=[f"x_dot - {y}*c_dot", f"w_dot + {x}*c_dot"],
        )
        for i, (x, y) in enumerate(LEGS)
    }  # fmt: skip
    found = play(scene(
        "x w z a b c",
        "x_dot^2 + w_dot^2 + z_dot^2 + 0.15*(a_dot^2 + b_dot^2 + c_dot^2)",
        "20*z", feet, dict.fromkeys("xwzabc", 0), forces={"x": f"{force!r}*t"},
        duration=2,
    ))  # fmt: skip
    assert found.times("slip")[0] == pytest.approx(slips, rel=1e-8)
    end = [found[q][-1] for q in ("x", "w", "c", "x_dot", "w_dot", "c_dot")]
    assert end == pytest.approx(expected.y[:, -1], abs=1e-6)
    assert found.result.record["steps"] < 1000


@pytest.mark.slow
@pytest.mark.parametrize(("speed", "late"), [(0, 2000), (100, 0), (-30, 300)])
def test_a_slip_begins_as_soon_seen_from_elsewhere(speed, late):
    # Its load moves with the frame; friction falls until that moves it.
    def seen(u, start):
        place = f"(x - {u}*(t - {start}))"
        floor = contact("z >= 0", 0, friction=f"0.3 - 0.1*(t - {start})",
                        slip=[f"x_dot - {u}", "y_dot"])  # fmt: skip
        return play(scene(
            "x y z", "(x_dot^2 + y_dot^2 + z_dot^2)/2", f"2*{place}^2 + y^2/2 + 10*z",
            {"floor": floor}, {"x": 0.6, "y": 0.6, "z": 0, "x_dot": u},
            start=start, duration=1.25, output_step=0.25,
        ))  # fmt: skip

    here, there = seen(0, 0), seen(speed, late)
    moves = here.result.record["steps"]
    assert there.result.record["steps"] == pytest.approx(moves, abs=0.5 * moves)
    assert there["x"][-1] - 1.25 * speed == pytest.approx(here["x"][-1], abs=1e-9)
    assert there["y"][-1] == pytest.approx(here["y"][-1], abs=1e-9)


@pytest.mark.slow
def test_a_disc_and_a_brake_that_share_a_way_slip_at_once():
    # The wheel and the body move together: 3 and 0.1 hold them, at an angle.
    friction, brake = 3.0, 0.1
    found = play(scene(
        "x w p", "(x_dot^2 + w_dot^2 + 0.02*p_dot^2)/2", "0",
        {"disc": {"relation": ["x_dot = 0", "w_dot = 0"], "limit": friction},
         "gear": {"relation": "p_dot - w_dot = 0", "limit": 1},
         "brake": {"relation": "p_dot = 0", "limit": brake}},
        dict.fromkeys("xwp", 0), forces={"x": "0.5*t", "w": "t"}, duration=3.5,
    ))  # fmt: skip
    # |(0.5 t, t - 0.1)| = 3
    slips = brentq(lambda t: np.hypot(0.5 * t, t - brake) - friction, 2.0, 3.5)
    assert found.times("slip") == pytest.approx([slips, slips], abs=1e-8)

    def rates(t, s):
        v = np.sqrt(s[2] ** 2 + s[3] ** 2 + 1e-18)
        pushes = 0.5 * t, t - brake
        return [
            *s[2:],
            *(
                (pushes[i] - friction * s[2 + i] / v) / m
                for i, m in ((0, 1), (1, 1.02))
            ),
        ]

    expected = solve_ivp(
        rates, (slips, 3.5), np.zeros(4), "LSODA", rtol=1e-10, atol=1e-14
    )
    end = [found[q][-1] for q in ("x", "w", "x_dot", "w_dot")]
    assert end == pytest.approx(expected.y[:, -1], abs=1e-6)
    assert found.result.record["steps"] < 300


@pytest.mark.slow
def test_a_slip_begins_beside_a_switch_where_no_way_is_smooth():
    # No stretch is so short that the switch is not in it, and the slip has a speed.
    found = play(scene(
        "x z", "(x_dot^2 + z_dot^2)/2", "0",
        {"disc": {"relation": ["x_dot = 0", "z_dot = 0"], "limit": 2}},
        {"x": 0, "z": 0},
        forces={"x": "3*sin(t) + 0.01*sign(x - 1e-9)", "z": "2*sin(2*t)"}, duration=2,
    ))  # fmt: skip

    def push(t, kick):
        return 3.0 * np.sin(t) + kick, 2.0 * np.sin(2.0 * t)

    def rates(t, s, kick):
        v = np.sqrt(s[2] ** 2 + s[3] ** 2 + 1e-20)
        return [
            *s[2:],
            *(f - 2.0 * w / v for f, w in zip(push(t, kick), s[2:], strict=True)),
        ]

    def switch(_, s, *_kick):
        return s[0] - 1e-9

    switch.terminal = True
    t, s = brentq(lambda t: np.hypot(*push(t, -0.01)) - 2.0, 0.0, 0.9), np.zeros(4)
    for kick, events in (-0.01, switch), (0.01, None):
        part = solve_ivp(
            rates, (t, 2.0), s, "LSODA", rtol=1e-10, atol=1e-15, args=(kick,),
            events=events,
        )  # fmt: skip
        t, s = part.t[-1], part.y[:, -1]
    assert t == 2.0
    assert [found[q][-1] for q in "xz"] == pytest.approx(s[:2], abs=1e-6)
