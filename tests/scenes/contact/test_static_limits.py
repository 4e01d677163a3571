"""Limits and friction that are larger at rest: `{static: , dynamic: }`, and switches.

Closed forms: pieces under forces that are constant, grow with t, or are springs'.
"""

import itertools
import math
import re

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq, minimize, minimize_scalar

import lagsim
from tests.scenes.contact.motions import GLOBAL, G, contact, play, scene
from tests.support import refused

F0, F1 = 3.0, 1.0
# Spellings of the same bound, of the slip `s`.
SPELLINGS = (
    "if(abs(s) > 0, F1, F0)", "F0 - (F0 - F1)*sign(abs(s))", "if(s^2 > 0, F1, F0)",
    "if(abs(s) <= 0, F0, F1)", "F0 - (F0 - F1)*sign(s)^2", "if(max(s, -s) > 0, F1, F0)",
    "if(s > 0 or s < 0, F1, F0)", "if(not (s >= 0 and s <= 0), F1, F0)",
    "F1 + (F0 - F1)*heaviside(-abs(s))", "if(sqrt(s^2) > 0, F1, F0)",
    "F0 - (F0 - F1)*abs(sign(s))", "if(hypot(s, 0) > 0, F1, F0)",
    "if(min(abs(s), 1) > 0, F1, F0)", "if(0 < 2*abs(-s), F1, F0)",
    "if(s > 0, F1, if(s < 0, F1, F0))", "if(sign(abs(s)) > 0.5, F1, F0)",
    "if(abs(s)*(1 + x^2) > 0, F1, F0)",
    # No slip that is computed is so slow.
    "if(abs(s) < 1e-300, F0, F1)", "if(abs(s) > 1e-30, F1, F0)",
    "F1 + (F0 - F1)*(1 - heaviside(abs(s) - 1e-300))", "if(s^2 > 1e-80, F1, F0)",
    "if(s > -1e-30 and s < 1e-300, F0, F1)",
)  # fmt: skip
MAPPING = {"static": "F0", "dynamic": "F1"}


def stick_slip(t, k, v):
    """Return the motion of a mass 1 by a spring whose end moves, and its events."""
    w = math.sqrt(k)
    last = 2 / w * (math.pi - math.atan(w * (F0 - F1) / (k * v)))
    at, x, found, events = 0.0, 0.0, np.full(len(t), np.nan), []
    while at <= t[-1]:
        slips = (F0 / k + x) / v
        found[(t >= at) & (t <= slips)] = x
        s = np.where((t > slips) & (t <= slips + last), t - slips, np.nan)
        u = -(F0 - F1) / k
        moved = u * np.cos(w * s) - v / w * np.sin(w * s) + v * (slips + s) - F1 / k
        found = np.where(np.isnan(s), found, moved)
        at = slips + last
        x = v * at - F1 / k - u
        events += [("slip", slips), ("stick", at)]
    return found, [(kind, time) for kind, time in events if time <= t[-1]]


def pulled(limit, *, slip="x_dot", far=0.0, speed=0.0, **words):
    """Write a block that a spring pulls; the floor moves at `speed`."""
    end = f"x - ({far!r}) - ({speed!r})*t - v*t"
    law = {"relation": f"{slip} = 0", "limit": limit}
    return scene(
        "x", "x_dot^2/2", f"k*({end})^2/2", {"rub": law}, {"x": far, "x_dot": speed},
        parameters={"F0": F0, "F1": F1, "k": 10.0, "v": 0.5, "floor": speed},
        **{"duration": 4, "output_step": 0.05, **words},
    )  # fmt: skip


def holds(found, far=0.0, speed=0.0, bound=GLOBAL):
    x, events = stick_slip(found.t, 10.0, 0.5)
    assert found["x"] == pytest.approx(far + speed * found.t + x, abs=bound)
    told = [(e.kind, e.time) for e in found.result.events]
    assert [kind for kind, _ in told] == [kind for kind, _ in events]
    times = [time for _, time in events]
    assert [time for _, time in told] == pytest.approx(times, abs=bound)
    balance = found["energy"] - found["work"]
    assert np.ptp(balance) < bound * max(1.0, speed**2)


@pytest.mark.parametrize("method", ["auto", "dop853", "rk4"])
def test_a_block_on_a_spring_sticks_and_slips(method):
    more = {"step": 0.001} if method == "rk4" else {}
    holds(play(pulled(MAPPING), method=method, **more))


def spelled(text, slip):
    """Replace `s` in a text by the slip."""
    return re.sub(r"\bs\b", f"({slip})", text)


@pytest.mark.slow
@pytest.mark.parametrize("spelling", SPELLINGS)
def test_a_switch_at_slip_0_is_static_friction(spelling):
    holds(play(pulled(spelled(spelling, "x_dot"))))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("least", "spelling"),
    [
        (1e-9, "if(abs(s) < least, F0, F1)"), (1e-12, "if(abs(s) < 1e-12, F0, F1)"),
        (1e-13, "F0 - (F0 - F1)*heaviside(abs(s) - least)"),
        (1e-14, "if(s^2 > 1e-28, F1, F0)"), (1e-15, "if(abs(s) < least, F0, F1)"),
        (1e-18, "if(abs(s) < 1e-18, F0, F1)"),
    ],
)  # fmt: skip
@pytest.mark.parametrize("floor", [0.0, 0.7])
def test_a_switch_at_a_slip_that_is_nearly_0(floor, least, spelling):
    """The block keeps F0 until its slip is `least`, and sticks by F0.

    Then about v t - F1/k it swings, until its slip is 0: the time with F0 again just
    before, least/(F0 - F1), is within the bound.
    """
    own = "x_dot - floor"
    text = pulled(spelled(spelling, own), slip=own, speed=floor)
    text = text.replace("parameters:", f"parameters:\n  least: {least!r}", 1)
    found = play(text)
    k, v, w = 10.0, 0.5, math.sqrt(10.0)
    begin = F0 / (k * v)
    # v (1 - cos w s) = least, and sin^2(w s/2) = least/(2 v)
    s = 2.0 / w * math.asin(math.sqrt(least / (2.0 * v)))
    # Within rounding of the floor's speed it is not known when the slip is `least`.
    bound = max(GLOBAL, math.sqrt(2.0 * math.ulp(floor) / (k * v)))
    # Until then it has moved by less than rounding.
    off, rate = -v * (begin + s) + F1 / k, least - v
    # -off w sin(u) + rate cos(u) = -v: its second root; the first is the start
    turn = math.atan2(-off * w, rate) + math.acos(-v / math.hypot(off * w, rate))
    sticks = begin + s + turn % math.tau / w
    stops = found.times("stick", "rub")
    assert found.times("slip", "rub")[0] == pytest.approx(begin, abs=bound)
    assert stops[0] == pytest.approx(sticks, abs=bound)
    u = w * (sticks - begin - s)
    x = v * sticks - F1 / k + off * math.cos(u) + rate / w * math.sin(u)
    # it rests until the spring pulls with F0 again
    again = (x + F0 / k) / v
    rests = (found.t > sticks + 1e-6) & (found.t < again)
    assert rests.any()
    assert found["x"][rests] - floor * found.t[rests] == pytest.approx(x, abs=bound)
    assert found.times("slip", "rub")[1] == pytest.approx(again, abs=bound)


@pytest.mark.parametrize("limit", [MAPPING, SPELLINGS[0], SPELLINGS[1], SPELLINGS[5]])
@pytest.mark.parametrize(
    ("far", "speed", "slip"),
    [
        (1e4, 0.0, "x_dot"), (0.0, 3.0, "x_dot - floor"), (-7.0, 0.7, "floor - x_dot"),
        (0.0, -2.0, "2*(x_dot - floor)/2"),
    ],
)  # fmt: skip
def test_static_friction_elsewhere(limit, far, speed, slip):
    own = "x_dot - floor" if speed else "x_dot"
    text = limit if isinstance(limit, dict) else spelled(limit, own)
    found = play(pulled(text, slip=slip, far=far, speed=speed))
    holds(found, far, speed, GLOBAL + 1e-13 * (abs(far) + abs(4 * speed)))


def test_a_definition_may_stand_for_the_slip():
    text = pulled("if(abs(glide) > 0, F1, F0)", slip="x_dot - floor", speed=3.0)
    text += "definitions: {glide: x_dot - floor}\n"
    holds(play(text), speed=3.0)


@pytest.mark.slow
@pytest.mark.parametrize("gear", ["x = 2*q", "x_dot = 2*q_dot", "2*q = x + sin(t) - t"])
@pytest.mark.parametrize("spelling", SPELLINGS[:3])
def test_the_slip_may_be_written_by_what_an_equality_couples(gear, spelling):
    """x slips when 3 t = F0, and the wheel q turns with it."""
    slip = "q_dot" if "sin" not in gear else "2*q_dot - cos(t) + 1"
    text = scene(
        "x q", "x_dot^2/2 + q_dot^2/1e6", "0",
        {"gear": gear, "rub": {"relation": "x_dot = 0",
                               "limit": spelled(spelling, slip)}},
        {"x": 0, "q": {"guess": 0}, "q_dot": {"guess": 0}},
        parameters={"F0": F0, "F1": F1}, forces={"x": "3*t"}, duration=1.5,
        output_step=0.05,
    )  # fmt: skip
    found = play(text)
    s = np.maximum(found.t - 1.0, 0.0)
    assert found.times("slip", "rub") == pytest.approx([1.0], abs=1e-5)
    assert found["x"] == pytest.approx(s**2 + s**3 / 2, abs=1e-5)


def test_a_family_of_blocks_has_a_limit_of_its_own_each():
    text = """
coordinates: {x(1..3): {}}
parameters: {F0: 3, F1: 1}
energy: {kinetic: "sum(i = 1..3, x_dot(i)^2)/2",
         potential: "sum(i = 1..3, 10*(x(i) - t/2)^2)/2"}
constraints:
  rub(i = 1..3): {relation: x_dot(i) = 0, limit: "if(abs(x_dot(i)) > 0, F1, F0)"}
initial: {x(1..3): 0}
simulation: {duration: 4, output_step: 0.05}
"""
    result = lagsim.simulate(lagsim.load(text), error_bar="never")
    x, events = stick_slip(result.t, 10.0, 0.5)
    for i in (1, 2, 3):
        assert result[f"x.{i}"] == pytest.approx(x, abs=GLOBAL)
    assert len(result.events) == 3 * len(events)


@pytest.mark.slow
@pytest.mark.parametrize("limit", [MAPPING, "if(hypot(x_dot, y_dot) > 0, F1, F0)"])
def test_a_disc_has_static_friction_in_the_plane(limit):
    """Along (0.6, 0.8) the motion is that on one slip."""
    text = scene(
        "x y", "(x_dot^2 + y_dot^2)/2", "5*((x - 0.3*t)^2 + (y - 0.4*t)^2)",
        {"rub": {"relation": ["x_dot = 0", "y_dot = 0"], "limit": limit}},
        {"x": 0, "y": 0}, parameters={"F0": F0, "F1": F1}, duration=4,
        output_step=0.05,
    )  # fmt: skip
    found = play(text)
    x, events = stick_slip(found.t, 10.0, 0.5)
    assert found["x"] == pytest.approx(0.6 * x, abs=GLOBAL)
    assert found["y"] == pytest.approx(0.8 * x, abs=GLOBAL)
    assert [e.kind for e in found.result.events] == [kind for kind, _ in events]


@pytest.mark.parametrize(
    "friction",
    [
        {"static": 0.5, "dynamic": 0.2}, "if(slip_speed > 0, 0.2, 0.5)",
        "0.5 - 0.3*sign(slip_speed)", "0.2 + 0.3*heaviside(-slip_speed)",
        "if(abs(x_dot) > 0, 0.2, 0.5)", "0.5 - 0.3*min(1, sign(slip_speed^2))",
    ],
)  # fmt: skip
def test_friction_of_a_contact_that_is_pressed_ever_more(friction):
    """N = 9.81 + 2 t, pulled by 8 t: slips where 8 t = 0.5 N."""
    law = contact("y >= 0", 0, friction=friction, slip="x_dot")
    text = scene(
        "x y", "(x_dot^2 + y_dot^2)/2", "g*y + 2*t*y", {"floor": law}, {"x": 0, "y": 0},
        forces={"x": "8*t"}, duration=2, output_step=0.05,
    )  # fmt: skip
    found = play(text)
    loose = 0.5 * G / (8 - 2 * 0.5)
    later = np.maximum(found.t, loose)
    v = (8 - 0.4) / 2 * (later**2 - loose**2) - 0.2 * G * (later - loose)
    assert found["x_dot"] == pytest.approx(v, abs=GLOBAL)
    assert found.times("slip", "floor") == pytest.approx([loose], abs=GLOBAL)


@pytest.mark.parametrize(
    "friction", [{"static": 0.5, "dynamic": 0.2}, "if(slip_speed > 0, 0.2, 0.5)"]
)
def test_the_foot_of_a_ladder_slips_as_someone_climbs(friction):
    """A weight W at the part t of a ladder of weight 3 g, at 0.9 rad to a floor.

    About the foot: N_wall tan(0.9) = 1.5 g + W t, the friction; N_foot = 3 g + W.
    """
    weight = 60.0
    text = scene(
        "x y a", "3*(x_dot^2 + y_dot^2)/2 + a_dot^2/2", "3*g*y",
        {"foot": contact("y - sin(a) >= 0", 0, friction=friction,
                         slip="x_dot + a_dot*sin(a)"),
         "wall": contact("x + cos(a) <= 0", 0)},
        {"a": 0.9, "x": "-cos(a)", "y": "sin(a)"}, duration=0.8, output_step=0.02,
    )  # fmt: skip
    text += "definitions: {step: y - sin(a) + 2*t*sin(a)}\n"
    text += f"forces: {{step: -{weight!r}}}\n"
    found = play(text)
    push = 0.5 * (3 * G + weight) * math.tan(0.9)
    slips = (push - 1.5 * G) / weight
    assert found.times("slip", "foot") == pytest.approx([slips], abs=1e-8)
    rests = found.t < slips
    borne = (1.5 * G + weight * found.t) / math.tan(0.9)
    assert abs(found["friction.foot"][rests]) == pytest.approx(borne[rests], abs=1e-8)
    ratio = abs(found["friction.foot"]) / found["lambda_foot"]
    assert ratio[~rests] == pytest.approx(0.2, abs=GLOBAL)


@pytest.mark.parametrize(("static", "stays"), [(2.0, True), (1.1, False)])
def test_a_slip_that_comes_to_0_holds_where_static_friction_can(static, stays):
    """From x = 2, k = 1: at rest at -1.4 the spring pulls with 1.4."""
    text = scene(
        "x", "x_dot^2/2", "x^2/2",
        {"rub": {"relation": "x_dot = 0", "limit": {"static": static, "dynamic": 0.3}}},
        {"x": 2.0001, "x_dot": 0}, duration=7, output_step=0.05,
    )  # fmt: skip
    found = play(text)
    turn = -(2.0001 - 2 * 0.3)
    half = found.t <= math.pi
    first = 0.3 + 1.7001 * np.cos(found.t)
    assert found["x"][half] == pytest.approx(first[half], abs=GLOBAL)
    if stays:
        assert found["x"][~half] == pytest.approx(turn, abs=GLOBAL)
    else:
        back = -0.3 + (turn + 0.3) * np.cos(found.t - math.pi)
        second = ~half & (found.t < 2 * math.pi)
        assert found["x"][second] == pytest.approx(back[second], abs=GLOBAL)


def test_a_brake_holds_a_shaft_until_static_friction_gives_way():
    """J = 2, from 3 rad/s against 1.5 + 0.5; a load that grows turns it back."""
    text = scene(
        "w", "w_dot^2", "0",
        {"brake": {"relation": "w_dot = 0", "limit": {"static": 4, "dynamic": 1.5}}},
        {"w": 0, "w_dot": 3}, forces={"w": "if(t < 4, -0.5, -2*(t - 4) - 0.5)"},
        duration=8, output_step=0.1,
    )  # fmt: skip
    found = play(text)
    assert found.times("stick", "brake") == pytest.approx([3.0], abs=GLOBAL)
    assert found.times("slip", "brake") == pytest.approx([5.75], abs=GLOBAL)
    s = np.maximum(found.t - 5.75, 0.0)
    stop = np.minimum(found.t, 3.0)
    v = 3 - stop - (2.5 * s + s**2) / 2
    assert found["w_dot"] == pytest.approx(v, abs=GLOBAL)
    held = (found.t > 3.0) & (found.t < 5.75)
    load = 0.5 + 2 * np.maximum(found.t - 4, 0.0)
    assert found["lambda_brake"][held] == pytest.approx(load[held], abs=GLOBAL)


def test_several_rows_hold_within_all_of_their_static_limits():
    """Blocks 1 and 2 on a floor, coupled: the load is shared until both give way."""
    limits = {
        "a": {"relation": "x_dot = 0", "limit": {"static": 1, "dynamic": 0.3}},
        "b": {"relation": "x_dot = 0", "limit": {"static": 2, "dynamic": 1}},
    }
    for order in ("ab", "ba"):
        text = scene(
            "x", "x_dot^2/2", "0", {k: limits[k] for k in order}, {"x": 0},
            forces={"x": "2*t"}, duration=2, output_step=0.05,
        )  # fmt: skip
        found = play(text)
        s = np.maximum(found.t - 1.5, 0.0)
        assert found["x"] == pytest.approx(0.85 * s**2 + s**3 / 3, abs=GLOBAL)
        for k in order:
            assert found.times("slip", k) == pytest.approx([1.5], abs=GLOBAL)
        held = found.t < 1.5
        half = np.minimum(found.t[held], 1.0)
        assert found["lambda_a"][held] == pytest.approx(-half, abs=GLOBAL)
        rest = -(2 * found.t[held] - half)
        assert found["lambda_b"][held] == pytest.approx(rest, abs=GLOBAL)


@pytest.mark.parametrize(
    "limit",
    [
        "5 - 4*sign(x*abs(x_dot))", "if(x_dot*(x_dot - 1) > 0, 1, 5)",
        "5 - 4*min(1, ceil(abs(x_dot)))", "if(abs(x_dot - two) > 0, 1, 5)",
        # Continuous, but as steep as a switch.
        "max(1, 5*(1 - 1e20*abs(x_dot)))", "5 - 4*min(1, 1e14*abs(x_dot))",
        "1 + 4*exp(-(1e16*x_dot)^2)", "1 + 4/(1 + steep*abs(x_dot))",
        "if(abs(x_dot) > 0.1, 1, 2) + 4/(1 + steep*abs(x_dot))",
    ],
)  # fmt: skip
def test_a_switch_that_is_not_clear_is_refused(limit):
    text = scene(
        "x", "x_dot^2/2", "0", {"rub": {"relation": "x_dot = 2", "limit": limit}}
        if "two" in limit
        else {"rub": {"relation": "x_dot = 0", "limit": limit}},
        {"x": 0.1, "x_dot": 2}, parameters={"two": 2, "steep": 1e15},
        duration=1,
    )  # fmt: skip
    with refused("switch-at-rest", "`rub`"):
        lagsim.load(text)


@pytest.mark.parametrize("steep", [1e3, 1e6, 1e9, 1e11])
@pytest.mark.parametrize(
    "limit", ["max(1, 5*(1 - {}*abs(x_dot)))", "1 + 4*exp(-({}*x_dot)^2)"]
)
def test_a_bound_that_falls_less_steeply_is_taken_as_written(limit, steep):
    """A push of 2 stops the slip in about 1/3 s, and then the limit of 5 holds it."""
    law = {"relation": "x_dot = 0", "limit": limit.format(steep)}
    found = play(scene(
        "x", "x_dot^2/2", "0", {"rub": law}, {"x": 0, "x_dot": -1}, forces={"x": 2},
        duration=1,
    ))  # fmt: skip
    assert found["x"][-1] == pytest.approx(-1 / 6, abs=1.0 / steep + GLOBAL)
    assert found.times("stick") == pytest.approx([1 / 3], abs=1.0 / steep + GLOBAL)


@pytest.mark.parametrize("part", ["abs(x_dot)", "abs(x_dot - y_dot)", "x_dot"])
def test_a_switch_on_a_part_of_two_slips_is_refused(part):
    law = {"relation": ["x_dot = 0", "y_dot = 0"], "limit": f"if({part} > 0, 1, 5)"}
    text = scene(
        "x y", "(x_dot^2 + y_dot^2)/2", "0", {"rub": law}, {"x": 0, "y": 0}, duration=1
    )
    with refused("switch-at-rest", "`rub.1`"):
        lagsim.load(text)


@pytest.mark.parametrize("limit", [
    "if(norm(p_dot) > 0, F1, F0)", "F0 - (F0 - F1)*sign(norm(p_dot))",
    "if(dot(p_dot, p_dot) > 0, F1, F0)", "{static: F0, dynamic: F1}",
    "F1 + (F0 - F1)*heaviside(-norm(p_dot))",
])  # fmt: skip
def test_a_relation_between_vectors_has_static_friction(limit):
    limit = limit if limit[0] == "{" else f'"{limit}"'
    text = f"""
parameters: {{F0: 3, F1: 1}}
coordinates: {{p: {{components: xy}}}}
energy: {{kinetic: "dot(p_dot, p_dot)/2", potential: "5*norm(p - t*vec(0.3, 0.4))^2"}}
constraints: {{rub: {{relation: "p_dot = vec(0, 0)", limit: {limit}}}}}
initial: {{p: [0, 0]}}
simulation: {{duration: 4, output_step: 0.05}}
"""
    result = lagsim.simulate(lagsim.load(text), error_bar="never")
    x, _ = stick_slip(result.t, 10.0, 0.5)
    assert result["p.x"] == pytest.approx(0.6 * x, abs=GLOBAL)
    assert result["p.y"] == pytest.approx(0.8 * x, abs=GLOBAL)


@pytest.mark.parametrize(
    ("limit", "code", "name"),
    [
        ({"static": 1, "dynamic": 2}, "out-of-range", " 2 "),
        ({"static": -1, "dynamic": -2}, "out-of-range", "-2"),
        ({"static": "F1", "dynamic": "F0"}, "out-of-range", " 3 "),
        ("1 + 4*sign(abs(x_dot))", "out-of-range", " 5 "),
        ("if(abs(x_dot) > 0, -1, 5)", "out-of-range", "-1"),
        ({"static": 1}, "missing-key", "`dynamic`"),
    ],
)
def test_static_limits_below_dynamic_ones_are_refused(limit, code, name):
    with refused(code, name):
        lagsim.load(pulled(limit))


@pytest.mark.parametrize(
    ("limit", "at", "least"),
    [
        ({"static": 2, "dynamic": "1 + t"}, 1.0, 2.0),
        ({"static": "2 - t", "dynamic": "1.5 - t/2"}, 1.0, 1.0),
        ({"static": "1 + x", "dynamic": "1 + 0.5*t"}, 0.0, 1.0),
    ],
)
def test_a_static_limit_that_falls_below_the_dynamic_one_ends_the_run(limit, at, least):
    text = scene(
        "x", "x_dot^2/2", "0", {"rub": {"relation": "x_dot = 0", "limit": limit}},
        {"x": 0}, forces={"x": "0.1"}, duration=2, output_step=0.05,
    )  # fmt: skip
    result = lagsim.simulate(lagsim.load(text), error_bar="never")
    assert result.outcome == "failed"
    assert all(x in result.reason for x in ("`rub`", f" {least:g},"))
    assert result.t[-1] == pytest.approx(at, abs=0.1)


def test_a_slider_without_mass_has_one_limit():
    text = """
coordinates: {x: {}, s: {}}
energy: {kinetic: x_dot^2/2, potential: (x - s)^2/2}
constraints: {slider: {relation: s_dot = 0, limit: {static: 2, dynamic: 1}}}
initial: {x: 0, s: 0}
simulation: {duration: 1}
"""
    with refused("no-inertia", " s "):
        lagsim.check(lagsim.load(text))


def least(F, discs, A):
    """Return multipliers of least norm within discs, by scipy."""
    bounds = [
        {"type": "ineq", "fun": lambda x, i=i, L=L: L**2 - np.sum(x[i] ** 2)}
        for i, L in discs
    ]
    equal = {"type": "eq", "fun": lambda x: A.T @ x - F}
    return minimize(
        lambda x: x @ x, np.linalg.lstsq(A.T, F, rcond=None)[0], jac=lambda x: 2 * x,
        constraints=[equal, *bounds], method="SLSQP",
        options={"ftol": 1e-15, "maxiter": 1000},
    ).x  # fmt: skip


SHARED = (
    (("x", 1.0), ("x", 2.0)), (("x", 0.5), ("x", 1.0), ("x", 1.0)),
    (("xy", 2.0), ("x", 0.5)), (("xy", 1.0), ("xy", 2.0)),
    (("x", 0.4), ("y", 0.7), ("2*x", 1.0), ("xy", 1.0)),
)  # fmt: skip


@pytest.mark.parametrize("rows", SHARED)
@pytest.mark.parametrize("turned", [False, True])
def test_redundant_limits_share_with_least_norm(rows, turned):
    """In either order of the file, and none slips while the others hold."""
    given, limits, discs, slopes = [], {}, [], []
    for k, (on, limit) in enumerate(rows):
        relation = [f"{q}_dot = 0" for q in on] if on == "xy" else f"{on}_dot = 0"
        limits[f"c{k}"] = {"relation": relation, "limit": limit}
        first = len(slopes)
        factor = 2.0 if on[0] == "2" else 1.0
        slopes += [[factor * (q == "x"), factor * (q == "y")] for q in on.strip("2*")]
        discs.append((list(range(first, len(slopes))), limit))
        ends = [".1", ".2"] if on == "xy" else [""]
        given += [f"lambda_c{k}{end}" for end in ends]
    names = sorted(limits, reverse=turned)
    text = scene(
        "x y", "(x_dot^2 + y_dot^2)/2", "0",
        {name: limits[name] for name in names}, {"x": 0, "y": 0},
        forces={"x": "1.1*t", "y": "0.3*t^2" if "y" in str(rows) else "0"},
        duration=1.2, output_step=0.1,
    )  # fmt: skip
    found = play(text)
    assert not found.result.events
    A = np.array(slopes)
    for i, t in enumerate(found.t):
        F = np.array([-1.1 * t, -0.3 * t * t if "y" in str(rows) else 0.0])
        lam = np.array([found[name][i] for name in given])
        assert A.T @ lam == pytest.approx(F, abs=1e-10)
        # SLSQP ends within the root of rounding of its optimum.
        assert lam == pytest.approx(least(F, discs, A), abs=1e-6)


@pytest.mark.parametrize(
    "friction",
    [
        {"static": 0.5, "dynamic": 0.2},
        "if(slip_speed > 0, 0.2, 0.5)",
        "0.2 + 0.3*heaviside(-abs(x_dot))",
    ],
)
@pytest.mark.parametrize("law", ["newton", "poisson"])
@pytest.mark.parametrize("c", [0.4, 0.6])
@pytest.mark.parametrize("v", [0.0, 0.1])
def test_an_impact_has_static_friction_where_the_slip_was_0(friction, law, c, v):
    """With inertia c between x and y: p = M (v+ - v), |p_x| <= mu p_y."""
    floor = contact("y >= 0", 0.5, friction=friction, slip="x_dot")
    text = scene(
        "x y", f"(x_dot^2 + y_dot^2)/2 + {c}*x_dot*y_dot", "0",
        {"floor": floor | {"restitution_law": law}},
        {"x": 0, "y": 0.5, "x_dot": v, "y_dot": -1}, duration=1, output_step=0.1,
    )  # fmt: skip
    found = play(text)
    mu = 0.2 if v else 0.5
    rise = 1.5  # of the rate of the gap
    # p_x = dx + c rise, p_y = c dx + rise; it stops x if that is within mu p_y.
    dx = -v
    if abs(dx + c * rise) > mu * (c * dx + rise):
        dx = rise * (mu - c) / (1 - mu * c)
    assert found["x_dot"][-1] == pytest.approx(v + dx, abs=GLOBAL)


def first_slip(rows, force):
    """Return the time at which a growing force exceeds the forces that rows balance.

    A disc of radius L balances the force L in each direction n, a row a with the limit
    L the force L |a . n|; the convex sets of several rows add up.
    """

    def bears(angle):
        n = np.array([math.cos(angle), math.sin(angle)])
        most = sum(L * (1.0 if a is None else abs(n @ a)) for a, L in rows)
        return most / max(n @ force, 1e-9)

    angles = np.linspace(0.0, 2.0 * math.pi, 2001)
    best = angles[np.argmin([bears(x) for x in angles])]
    ends = best - 4e-3, best + 4e-3
    found = minimize_scalar(bears, bounds=ends, method="bounded", options={"xatol": 0})
    kinks = [math.atan2(s * a[0], -s * a[1]) for a, _ in rows if a for s in (1, -1)]
    return float(min(found.fun, *map(bears, kinks)))


REDUNDANT = [
    ([((0, 1), 1.15), (None, 1.0), ((1, 0), 0.9), ((1, 0), 1.4)], (1.0, -0.25)),
    ([(None, 1.54), (None, 1.08), (None, 0.87), ((1, 0), 1.28), ((2, 1), 0.95)],
     (-0.74, 0.78)),
    ([((2, 1), 1.74), ((0, 1), 1.59), ((0, 1), 1.64), (None, 1.0)], (0.9, 0.8)),
    ([(None, 0.33), ((0, 1), 1.2), (None, 0.75), ((2, 1), 1.07)], (-0.83, 0.42)),
    ([(None, 1.0), ((1, 1), 1.0), ((0, 1), 0.7)], (1.0, 0.5)),
    ([((2, 1), 1.5), ((1, 0), 1.75), (None, 1.0)], (0.8, 0.6)),
]  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize(
    ("case", "mass"),
    [*itertools.product(range(6), [1.0, 30.0, 1e-3, 1e6, 1e-6])],
)
@pytest.mark.parametrize("order", [1, -1])
def test_redundant_discs_slip_where_no_multipliers_hold_them(case, order, mass):
    """Whatever the masses are, and in either order of the file."""
    rows, force = REDUNDANT[case]
    laws = {
        f"c{k}": {
            "relation": ["x_dot = 0", "y_dot = 0"]
            if a is None
            else f"{a[0]}*x_dot + {a[1]}*y_dot = 0",
            "limit": {"static": L, "dynamic": 0.5 * L},
        }
        for k, (a, L) in [*enumerate(rows)][::order]
    }
    end = first_slip(rows, np.array(force))
    found = play(scene(
        "x y", f"{mass}*x_dot^2/2 + y_dot^2/2", "0", laws, {"x": 0, "y": 0},
        forces={"x": f"{force[0]}*t", "y": f"{force[1]}*t"}, duration=1.02 * end,
    ))  # fmt: skip
    # Multipliers beside discs are known to 1e-10 of their bounds.
    assert found.times("slip")[0] == pytest.approx(end, rel=1e-9)
    before = found.t < end * (1.0 - 1e-8)
    # The sum of forces in balance is rounded once a row. If all errors had one sign,
    # they would accelerate the body by their sum over its inertia.
    rounding = len(rows) * np.finfo(float).eps * sum(L for _, L in rows)
    moved = rounding / min(1.0, mass) * end**2 / 2.0
    assert np.max(np.abs(found["x"][before])) < moved


@pytest.mark.parametrize("mass", [1e-9, 1e-3, 1e3, 1e6, 1e9])
@pytest.mark.parametrize("row", [(2, 1), (1, -3), (1e-3, 1), (1e-5, 1)])
def test_rows_at_a_small_angle_in_the_metric_hold_at_rest(row, mass):
    """Two limits balance two forces; one of them acts on the light mass alone."""
    a, b = row
    first, second = 0.9 / a, 0.8 - 0.9 * b / a
    laws = {
        "c0": {"relation": f"{a}*x_dot + {b}*y_dot = 0", "limit": 1.2 * abs(first)},
        "c1": {"relation": "y_dot = 0", "limit": 1.3 * abs(second)},
    }
    found = play(scene(
        "x y", f"{mass}*x_dot^2/2 + y_dot^2/2", "0", laws, {"x": 0, "y": 0},
        forces={"x": "0.9*t", "y": "0.8*t"}, duration=1,
    ))  # fmt: skip
    assert not found.result.events
    assert found.result.record["steps"] < 100
    assert found["lambda_c0"][-1] == pytest.approx(-first, rel=1e-12)
    assert found["lambda_c1"][-1] == pytest.approx(
        -second, rel=1e-12, abs=1e-12 * first
    )
    # The forces of the rows are rounded, which moves the mass by no more than this.
    assert abs(found["x"][-1]) < 4 * np.finfo(float).eps / min(mass, 1.0)


STRIBECK = {
    "1 + 4*exp(-({v}/{s})^2)": lambda v, s: 1 + 4 * np.exp(-((v / s) ** 2)),
    "1 + 4*exp(-abs({v})/{s})": lambda v, s: 1 + 4 * np.exp(-abs(v) / s),
    "1 + 4/(1 + ({v}/{s})^2)": lambda v, s: 1 + 4 / (1 + (v / s) ** 2),
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("law", STRIBECK)
@pytest.mark.parametrize("slow", [1e-6, 1e-8])
@pytest.mark.parametrize("as_limit", [True, False])
def test_a_bound_that_falls_within_a_tiny_speed(law, slow, as_limit):
    """Against LSODA between slips and stops.

    A slip takes a time to begin, such as 2.3 (slow^2/12)^(1/3), by which it is later
    than one with static and dynamic friction.
    """
    bound, force = STRIBECK[law], lambda t: 6 * np.sin(3 * t) * np.exp(-0.3 * t)
    t, x, end = 0.0, 0.0, 2.5
    while t < end:
        times = np.linspace(t + 1e-6, end, 100_001)
        over = np.flatnonzero(np.abs(force(times)) > 5.0)
        if not len(over):
            break
        last = times[max(over[0] - 1, 0)]
        t = brentq(lambda s: abs(force(s)) - 5.0, last, times[over[0]], xtol=1e-16)
        way = np.sign(force(t))

        def rates(s, y, t=t, way=way):
            return [y[1], force(t + s) - way * bound(y[1], slow)]

        def stops(s, y, way=way):
            return way * y[1] + (s == 0.0)

        stops.terminal, stops.direction = True, -1.0
        found = solve_ivp(
            rates, (0.0, end - t), [0.0, 0.0], "LSODA", events=stops, rtol=2.3e-13,
            atol=[1e-20, 1e-12 * slow],
        )  # fmt: skip
        t, x = t + found.t[-1], x + found.y[0, -1]
    v, laws, energy = "x_dot", {}, "0"
    if as_limit:
        laws["rub"] = {"relation": "x_dot = 0", "limit": law.format(v=v, s=slow)}
    else:
        mu = f"({law.format(v=v, s=slow)})/10"
        laws["rub"], energy = contact("z >= 0", 0, friction=mu, slip="x_dot"), "10*z"
    got = play(scene(
        "x z", "(x_dot^2 + z_dot^2)/2", energy, laws, {"x": 0, "z": 0},
        forces={"x": "6*sin(3*t)*exp(-0.3*t)"}, duration=end,
    ))  # fmt: skip
    assert len(got.instants("stick")) == 1
    assert got["x"][-1] == pytest.approx(x, rel=1e-9)
