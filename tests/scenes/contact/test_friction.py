"""Friction: spheres, inclines, belts, discs, rods."""

import math
import re

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

import lagsim
from tests.scenes.contact import scenes
from tests.scenes.contact.motions import GLOBAL, G, close, contact, play, scene, tried
from tests.support import refused

LANDS = scenes.SPHERE_TIME


def test_a_spinning_sphere_slips_through_the_impact_and_rolls_later():
    found = play(scenes.sphere(50))
    assert found.instants("impact") == pytest.approx([LANDS], abs=GLOBAL)
    speed = math.sqrt(2 * G * 0.9)
    # The impulse of friction is mu times that of the floor; I = 0.004.
    x, spin = -0.2 * speed, 50 - 0.1 * 0.2 * speed / 0.004
    assert (x, spin) == pytest.approx((-0.840428, 28.98929), abs=1e-5)
    assert found.pair("x_dot", LANDS) == pytest.approx((0.0, x), abs=GLOBAL)
    assert found.pair("phi_dot", LANDS) == pytest.approx((50, spin), abs=50 * GLOBAL)
    assert found.pair("impulse.floor", LANDS)[1] == pytest.approx(speed, rel=GLOBAL)
    # Slip falls by (1 + m r^2/I) mu g = 3.5 mu g.
    rolls = LANDS + (x + 0.1 * spin) / (3.5 * 0.2 * G)
    assert found.times("stick", "floor") == pytest.approx([rolls], abs=GLOBAL)
    slides = (found.t > LANDS + GLOBAL) & (found.t < rolls)
    close(found["x_dot"][slides], x - 0.2 * G * (found.t[slides] - LANDS))
    close(found["friction.floor"][slides], np.full(np.count_nonzero(slides), -0.2 * G))
    after = found.t > rolls
    # Momentum about the point of contact stays: x' = -(2/7) r 50.
    close(found["x_dot"][after], np.full(np.count_nonzero(after), -10 / 7))
    close(found["phi_dot"][after], np.full(np.count_nonzero(after), 100 / 7))
    assert np.max(np.abs(found["friction.floor"][after])) < 1e-10


def test_a_slowly_spinning_sphere_rolls_at_once():
    found = play(scenes.sphere(10))
    x, spin = -10 * 0.1 * 2 / 7, 10 * 2 / 7
    assert (x, spin) == pytest.approx((-0.285714, 2.857143), abs=1e-6)
    assert found.pair("x_dot", LANDS) == pytest.approx((0.0, x), abs=GLOBAL)
    assert found.pair("phi_dot", LANDS) == pytest.approx((10, spin), abs=10 * GLOBAL)
    after = found.t > LANDS + GLOBAL
    close(found["x"][after], x * (found.t[after] - LANDS))
    close(found["lambda_floor"][after], np.full(np.count_nonzero(after), G))


def test_a_bouncing_sphere_loses_slip_at_every_bounce():
    found = play(scenes.sphere(50, e=0.6), duration=1.6)
    speed, slip, x = math.sqrt(2 * G * 0.9), 5.0, 0.0
    t = LANDS
    for _ in range(3):
        push = min(0.2 * 1.6 * speed, slip / 3.5)
        x, slip, speed = x - push, slip - 3.5 * push, 0.6 * speed
        assert found.pair("x_dot", t)[1] == pytest.approx(x, abs=GLOBAL)
        assert found.pair("y_dot", t)[1] == pytest.approx(speed, abs=GLOBAL)
        t += 2 * speed / G
    assert slip == 0.0


ANGLE = 0.5


@pytest.mark.parametrize("mu", ["tan(a)", "tan(a)*(1 + 1e-15)", "tan(a)*1.05", "2"])
def test_a_block_stays_at_and_below_the_angle_of_friction(mu):
    found = play(scenes.incline(ANGLE, mu))
    assert np.max(np.abs(found["s"])) < GLOBAL
    assert np.max(np.abs(found["n"])) < 1e-14
    close(found["lambda_floor"], np.full(len(found.t), 3 * G * math.cos(ANGLE)))
    close(found["friction.floor"], np.full(len(found.t), -3 * G * math.sin(ANGLE)))


@pytest.mark.parametrize("mu", [0.0, 0.3, 0.54])
def test_a_block_slides_past_the_angle_of_friction(mu):
    assert mu < math.tan(ANGLE)
    found = play(scenes.incline(ANGLE, mu))
    a = G * (math.sin(ANGLE) - mu * math.cos(ANGLE))
    close(found["s_ddot"], np.full(len(found.t), a))
    close(found["s"], a * found.t**2 / 2)
    push = -mu * 3 * G * math.cos(ANGLE)
    close(found["friction.floor"], np.full(len(found.t), push))


@pytest.mark.parametrize(("angle", "mu"), [(0.4, 0.5), (0.5, 0.3)])
def test_a_block_sent_uphill_stays_or_comes_back(angle, mu):
    found = play(scenes.incline(angle, mu, v=-2.0))
    up = G * (math.sin(angle) + mu * math.cos(angle))
    down = max(0.0, G * (math.sin(angle) - mu * math.cos(angle)))
    turn, far = 2 / up, -2 / up
    later = np.maximum(found.t - turn, 0.0)
    rising = -2 * found.t + up * found.t**2 / 2
    close(found["s"], np.where(found.t < turn, rising, far + down * later**2 / 2))
    sticks = [turn] if down == 0.0 else []
    assert found.times("stick", "floor") == pytest.approx(sticks, abs=GLOBAL)
    balance = found["energy"] - found["work"]
    close(balance, np.full(len(balance), balance[0]))


@pytest.mark.parametrize("method", ["auto", "moreau"])
def test_static_friction_holds_more_than_sliding_friction(method):
    law = contact("y >= 0", 0, friction={"static": 0.5, "dynamic": 0.2}, slip="x_dot")
    text = scene(
        "x y", "m*(x_dot^2 + y_dot^2)/2", "m*g*y", {"floor": law}, {"x": 0, "y": 0},
        parameters={"m": 2}, forces={"x": "10*t"}, duration=2, output_step=0.02,
    )  # fmt: skip
    found = play(text, method=method, **({} if method == "auto" else {"step": 1e-3}))
    loose = 0.5 * 2 * G / 10
    s = np.maximum(found.t - loose, 0.0)
    within = GLOBAL if method == "auto" else 5e-3  # of a step that it slips in
    v = (10 * (loose * s + s**2 / 2) - 0.2 * 2 * G * s) / 2
    close(found["x_dot"], v, within)
    if method == "moreau":
        return
    assert found.times("slip", "floor") == pytest.approx([loose], abs=GLOBAL)
    holds = found.t < loose
    close(found["friction.floor"][holds], -10 * found.t[holds])


def test_stick_and_slip_on_a_belt():
    found = play(scenes.belt())
    w, u, held, slid = 10.0, 0.2, 0.6 * G / 100, 0.4 * G / 100
    loose = held / u
    glide = 2 / w * (math.pi - math.atan(w * (held - slid) / u))
    period = glide + 2 * (held - slid) / u
    slips = np.arange(loose, 4, period)
    sticks = np.arange(loose + glide, 4, period)
    assert len(sticks) >= 4
    assert found.times("slip", "belt") == pytest.approx([*slips], abs=GLOBAL)
    assert found.times("stick", "belt") == pytest.approx([*sticks], abs=GLOBAL)
    s = (found.t - loose) % period
    sliding = slid + (held - slid) * np.cos(w * s) + u / w * np.sin(w * s)
    carried = 2 * slid - held + u * (s - glide)
    expected = np.where(s < glide, sliding, carried)
    close(found["x"], np.where(found.t < loose, u * found.t, expected))
    stuck = (s > glide + GLOBAL) & (found.t > loose)
    close(found["friction.belt"][stuck], 100 * found["x"][stuck])
    assert np.max(np.abs(found["x_dot"][stuck] - u)) < 1e-12


@pytest.mark.parametrize("as_limit", [True, False], ids=["limit", "sign"])
def test_a_dry_oscillator_stops_for_good(as_limit):
    # Half turns about -1 and 1 by turns, each turning point 2 nearer.
    found = play(scenes.dry(as_limit))
    far = math.hypot(13, 6)
    first = math.atan2(6, 13)
    turns = [first + k * math.pi for k in range(8)]
    stop = turns[7]
    rest = 15 - far
    assert abs(rest) < 1
    assert found.times("stick")[-1] == pytest.approx(stop, abs=1e-7)

    def place(t):
        if t > stop:
            return rest
        k = max(0, math.ceil((t - first) / math.pi))
        return (1 if k % 2 else -1) + (far - 2 * k) * math.cos(t - first)

    close(found["x"], [place(t) for t in found.t])
    still = found.t > stop + 1e-6
    assert np.max(np.abs(found["x_dot"][still])) < 1e-12


def test_the_limited_force_is_the_multiplier():
    found = play(scenes.dry(as_limit=True))
    push, v = found["lambda_floor"], found["x_dot"]
    moves = np.abs(v) > 1e-6
    assert np.array_equal(push[moves], -np.sign(v[moves]))
    close(push[-1], found["x"][-1])
    close(found["residual_floor"], v, 1e-14)


def test_a_point_slides_straight_on_a_plane():
    found = play(scenes.slide(3, 4))
    stop = 5 / (0.3 * G)
    s = np.minimum(found.t, stop)
    way = 5 * s - 0.3 * G * s**2 / 2
    close(found["x"], 0.6 * way)
    close(found["y"], 0.8 * way)
    assert found.times("stick", "floor") == pytest.approx([stop], abs=GLOBAL)
    slides = found.t < stop - 1e-6
    close(found["friction.floor.1"][slides], np.full(np.sum(slides), -0.6 * 0.3 * G))
    close(found["friction.floor.2"][slides], np.full(np.sum(slides), -0.8 * 0.3 * G))


def test_a_runner_that_weighs_more_one_way_curves():
    found = play(scenes.slide(3, 4, 1, 4))

    def rates(_, s):
        size = math.hypot(s[2], s[3])
        return [s[2], s[3], -0.3 * G * s[2] / size, -0.3 * G * s[3] / size / 4]

    rows = found.t[found.t < 2.0]
    other = solve_ivp(
        rates, (0, 2), [0, 0, 3, 4], "DOP853", rows, rtol=1e-12, atol=1e-13
    )
    close(found["x"][: len(rows)], other.y[0])
    close(found["y"][: len(rows)], other.y[1])
    size = np.hypot(found["friction.floor.1"], found["friction.floor.2"])[: len(rows)]
    close(size, np.full(len(rows), 0.3 * G), 1e-12)


@pytest.mark.parametrize("mu", [0.1, 0.4, 5.0])
def test_an_impact_obeys_the_exact_disc(mu):
    # m_x v_x' = p_x, and p against the slip after it: |p| is mu p_n, or the slip ends.
    law = contact("z >= 0", 0.5, friction=mu, slip=["x_dot", "y_dot"])
    text = scene(
        "x y z", "(x_dot^2 + 4*y_dot^2 + z_dot^2)/2", "g*z", {"floor": law},
        {"x": 0, "y": 0, "z": 1, "x_dot": 3, "y_dot": 1}, duration=0.6, output_step=0.1,
    )  # fmt: skip
    found = play(text)
    # One impact: its friction is no other.
    assert found.times("impact") == pytest.approx([math.sqrt(2 / G)], abs=GLOBAL)
    most = mu * 1.5 * math.sqrt(2 * G)

    def after(k):
        # v = v_before - p/m with p = k v: (1 + k/m) v = v_before.
        return 3 / (1 + k), 1 / (1 + k / 4)

    vx = vy = 0.0
    if most < math.hypot(3, 4):
        k = brentq(lambda k: k * math.hypot(*after(k)) - most, 0, 1e6, xtol=1e-14)
        vx, vy = after(k)
    t = math.sqrt(2 / G)
    assert found.pair("x_dot", t)[1] == pytest.approx(vx, abs=GLOBAL)
    assert found.pair("y_dot", t)[1] == pytest.approx(vy, abs=GLOBAL)


STEEP = 1.0  # rad; there 1 + 3 cos(th) (cos(th) - mu sin(th)) < 0 for mu = 2


@pytest.mark.parametrize(("mu", "fine"), [(1.3, True), (2.0, False)])
def test_a_rod_pushed_past_four_thirds_is_a_paradox(mu, fine):
    """A uniform rod slides at every angle for mu < 4/3 only."""
    assert (
        1 + 3 * math.cos(STEEP) * (math.cos(STEEP) - mu * math.sin(STEEP)) > 0
    ) == fine
    text = scenes.rod(mu, STEEP, -1.0)
    if fine:
        found = tried(text, duration=1e-3, output_step=1e-4)
        assert found.result.complete
        cos, sin = math.cos(STEEP), math.sin(STEEP)
        push = G / (1 + 3 * cos * (cos - mu * sin))
        assert found["lambda_tip"][0] == pytest.approx(push, rel=GLOBAL)
        assert found["friction.tip"][0] == pytest.approx(mu * push, rel=GLOBAL)
        return
    with refused("no-motion", "`tip`") as caught:
        tried(text)
    assert caught.value.exit_code == 2


def test_a_rod_that_slides_the_other_way_is_none():
    found = tried(scenes.rod(2.0, STEEP, 1.0), duration=0.04)
    assert found.result.complete


def test_a_paradox_on_the_way_stops_the_run():
    # It cannot turn for a while, and friction cannot dig it in; then it can.
    guide = {"relation": f"th = {STEEP}", "when": "t < 0.1"}
    found = tried(scenes.rod(2.0, STEEP, -3.0, guide=guide))
    assert found.result.outcome == "failed"
    assert "`tip`" in found.result.reason
    assert found.t[-1] == pytest.approx(0.1, abs=GLOBAL)
    slides = found.t < 0.1
    close(found["x_dot"][slides], -3 + 2 * G * found.t[slides])


def kane(slide, far=0.0):
    """Return the rod of Kane and Levinson with this slip, and its gain of energy.

    Newton's law with friction that ends a small slip raises the energy: by how much,
    from the impulses.
    """
    th, a, v = 0.8, 0.5, 2.0
    law = contact("y - a*sin(th) >= 0", 1, friction=1, slip="x_dot + a*sin(th)*th_dot")
    text = scene(
        "x y th", "(x_dot^2 + y_dot^2)/2 + a^2/6*th_dot^2", "0", {"tip": law},
        {"x": far, "th": th, "y": "a*sin(th) + 0.47", "x_dot": slide, "y_dot": -v},
        parameters={"a": a}, duration=0.5, output_step=0.05,
    )  # fmt: skip
    rows = np.array([[0, 1, -a * math.cos(th)], [1, 0, a * math.sin(th)]])
    inverse = np.diag([1, 1, 3 / a**2])
    # It sticks: the rates after it are (v, 0).
    before, after = rows @ [slide, -v, 0], np.array([v, 0.0])
    impulse = np.linalg.solve(rows @ inverse @ rows.T, after - before)
    assert abs(impulse[1]) < impulse[0]
    gain = impulse @ (before + after) / 2
    return text, gain, gain / (np.abs(impulse) @ (np.abs(before) + np.abs(after)))


@pytest.mark.parametrize("far", [0.0, 1e12])
def test_an_impact_that_raises_the_energy_is_told(far):
    text, gain, _ = kane(0.1, far)
    assert gain > 0.0
    found = play(text)
    energy = found.pair("energy", 0.235)
    assert energy[1] - energy[0] == pytest.approx(gain, rel=GLOBAL)
    told = [w.text for w in found.result.warnings if w.code == "impact-energy"]
    assert told
    numbers = [float(x) for x in re.findall(r"\d+\.?\d*(?:e[-+]?\d+)?", " ".join(told))]
    assert any(x == pytest.approx(gain, rel=0.01) for x in numbers)


@pytest.mark.slow
@pytest.mark.parametrize("mu", [0.0, 0.01])
def test_what_bounces_to_rest_goes_on_sliding(mu):
    # Till it lies the floor has pushed as much as the weight: the friction of a slip
    # that never ends has taken the part mu of that, g*t in all.
    law = contact("y >= 0", 0.5, friction="mu", slip="x_dot - u")
    found = play(scene(
        "x y", "(x_dot^2 + y_dot^2)/2", "g*y", {"floor": law},
        {"x": 0, "y": 0.444, "x_dot": 1.89, "y_dot": 0.94},
        parameters={"mu": mu, "u": 1}, duration=2, output_step=0.1,
    ))  # fmt: skip
    assert found.times("zeno")
    lies = found.t > found.times("zeno")[0] + 1e-3
    rate = (G * found.t[lies] - 0.94) * mu
    close(found["x_dot"][lies], np.maximum(1.89 - rate, 1.0))


@pytest.mark.parametrize(
    ("part", "told"), [(1e-5, True), (1e-7, True), (1e-11, False), (-1e-5, False)]
)
def test_a_gain_by_impacts_is_told_from_a_billionth_on(part, told):
    # With no slip before it nothing is gained; the more slip the more.
    slide = brentq(lambda slide: kane(slide)[2] - part, -0.05, 0.1, xtol=1e-16)
    found = play(kane(slide)[0])
    codes = [w.code for w in found.result.warnings]
    assert ("impact-energy" in codes) == told


@pytest.mark.slow
def test_many_impacts_without_loss_gain_nothing():
    # Between slanting walls, with numbers that round.
    walls = {
        f"w{k}": contact(f"cos({k}*2*pi/3 + 0.1)*x + sin({k}*2*pi/3 + 0.1)*y <= 1", 1)
        for k in range(3)
    }
    text = scene(
        "x y", "0.3*(x_dot^2 + y_dot^2)", "0", walls,
        {"x": 0.1, "y": 0.2, "x_dot": 1.7, "y_dot": 0.9}, duration=40, output_step=1,
    )  # fmt: skip
    found = play(text)
    assert len(found.times("impact")) > 20
    assert "impact-energy" not in [w.code for w in found.result.warnings]
    close(found["energy"], np.full(len(found.t), found["energy"][0]))


JAMMED = """
parameters: {L: LENGTH, d: 0.368*L}
coordinates: {x: {}, q: {}}
definitions: {u: x + 0.375*L*sin(q), h: -0.375*L*cos(q)}
energy:
  kinetic: (0.352*x_dot^2 + 1.029*(u_dot^2 + h_dot^2))/2
  potential: 1.029*9.81*L*h
forces: {x: (7.52*sin(5.14*t) - 4.22*sign(x_dot))*L}
constraints: {floor: {relation: h >= -d, restitution: 0.5, friction: 0.2, slip: u_dot}}
initial: {x: 0.04*L, q: -0.255, q_dot: -0.384}
simulation: {duration: 1, output_step: 0.1}
"""


@pytest.mark.slow
@pytest.mark.parametrize("length", ["1", "1000"])
def test_a_rod_that_jams_between_a_cart_and_a_floor_rests(length):
    """Its angle from the vertical has a tangent of 0.196, below the friction of 0.2."""
    found = play(JAMMED.replace("LENGTH", length))
    late = found.t > 0.7
    assert found["q"][late] == pytest.approx(-np.arccos(0.368 / 0.375), abs=1e-9)
    assert found["x_dot"][late] == pytest.approx(0.0, abs=1e-12 * float(length))


@pytest.mark.slow
@pytest.mark.parametrize(("c", "s"), [(1, 0), (0.8, 0.6)])
def test_dry_friction_beside_a_limit_adds_to_it(c, s):
    # Coulomb: `sign` and `limit` on one slip hold it together, by the sum of both.
    text = """
parameters: {{F1: 8, F2: 2.4}}
coordinates: {{r(1..2): {{components: xyz}}}}
definitions: {{slip: "{c}*r_dot(2).x + {s}*r_dot(2).y"}}
gravity: [{s}*-3, {c}*3, -9]
bodies: {{b(i = 1..2): {{mass: 1 + i/4, at: r(i)}}}}
energy: {{kinetic: bodies, potential: bodies}}
forces: {{slip: "4*sin(5*t) - {force}"}}
constraints:
  rod: norm(r(1)) = 0.4
  bar: norm(r(2) - r(1)) = 0.4
  hold: {{relation: slip = 0, limit: {limit}}}
initial: {{r(1): [0.24, 0, 0.32], r(2): [0, 0.32, 0.32]}}
simulation: {{duration: 1, output_step: 0.1}}
"""
    two, one = (
        play(text.format(c=c, s=s, force=force, limit=limit))
        for force, limit in (("F2*sign(slip)", "F1"), ("0", "F1 + F2"))
    )
    assert len(two.result.events) <= 3 * len(one.result.events) + 3
    for name in ("r.1.x", "r.2.x", "r.2.y", "r_dot.2.z"):
        assert two[name] == pytest.approx(one[name], abs=1e-10)


@pytest.mark.slow
def test_dry_friction_of_a_floor_and_of_a_switch_add_until_it_lifts_off():
    # Coulomb: together they hold the slip by 0.2*10 + 0.5 = 0.25*10 N, until the block
    # is lifted at t = 3.3.
    text = """
coordinates: {{x: {{}}, z: {{}}}}
energy: {{kinetic: (x_dot^2 + z_dot^2)/2, potential: 10*z}}
forces: {{x: "3*sin(3*t) - {force}", z: "if(t < 3.3, 0, 12)"}}
constraints:
  floor: {{relation: z >= 0, restitution: 0, friction: {mu}, slip: x_dot}}
initial: {{x: 0, z: 0, x_dot: 0.4}}
simulation: {{duration: 5, output_step: 0.1}}
"""
    two, one = (
        play(text.format(force=force, mu=mu))
        for force, mu in (
            ("0.5*sign(x_dot)", 0.2),
            ("if(t < 3.3, 0, 0.5*sign(x_dot))", 0.25),
        )
    )
    assert len(two.result.events) <= 20
    for name in ("x", "z", "x_dot"):
        assert two[name] == pytest.approx(one[name], abs=1e-10)


@pytest.mark.parametrize("end", [3.0, 3.5])
@pytest.mark.parametrize(
    "force",
    [
        "0.75*q - 1.5*sign(x_dot)",
        "0.75*(q - 2*sign(x_dot))",
        "exp(0.1*q)*(0.3*q - 0.6*sign(x_dot))",
    ],
)
def test_a_force_may_reach_its_friction_at_the_end_of_the_run(force, end):
    # q = 1 - t reaches -2, where the force is as large as the friction, at t = 3.
    text = f"""
coordinates: {{x: {{}}, q: {{}}}}
energy: {{kinetic: (x_dot^2 + q_dot^2)/2, potential: 0}}
forces: {{x: "{force}"}}
initial: {{x: 0, q: 1, q_dot: -1}}
simulation: {{duration: {end}, output_step: 0.25}}
"""
    found = play(text)
    assert found.t[-1] == end
    assert np.max(np.abs(found["x"][found.t <= 3.0])) < 1e-14
    slips = found.instants("slip")
    assert slips == pytest.approx([3.0] if end > 3.0 or slips else [], abs=GLOBAL)


def test_a_slip_against_the_time_is_rounding_where_its_speeds_vanish():
    # A block sticks to a belt whose speed falls to 0 at t = 0.5. There the slip
    # x_dot - (0.5 - t) is the rounding of 0.5 - t, which exceeds that of x_dot by far.
    text = """
    coordinates: {x: {}, y: {}}
    energy: {kinetic: (x_dot^2 + y_dot^2)/2, potential: 9.81*y}
    constraints:
      f:
        relation: y >= 0
        restitution: 0
        friction: if(slip_speed > 0.3, 0.1, 0.3)
        slip: x_dot - (0.5 - t)
    forces: {x: -4*x}
    initial: {x: 0.3, y: 0}
    simulation: {duration: 0.5}
    """
    found = lagsim.simulate(lagsim.load(text), method="dop853", error_bar="never")
    stuck = found.t > 0.4
    assert found["x_dot"][stuck] == pytest.approx(0.5 - found.t[stuck], abs=1e-12)
    assert found.record["steps"] < 100
