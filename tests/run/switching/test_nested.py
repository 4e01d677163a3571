"""Nested, scaled, turned and joined switches, against motions put together by hand.

Between switches the accelerations are constant, so that the times of all switches
follow from square roots.
"""

import math

import numpy as np
import pytest

from lagsim.run.trajectory import Outcome
from tests.run.switching.scenes import events, scene
from tests.support import ready, run


def crossing(x, v, a, level):
    """Return the first later time at which x + v t + a t^2/2 equals a level."""
    if a == 0.0:
        times = [(level - x) / v] if v else []
    else:
        square = v * v - 2.0 * a * (x - level)
        root = math.sqrt(square) if square >= 0.0 else math.nan
        times = [(-v - root) / a, (-v + root) / a]
    return min((t for t in times if t > 1e-9), default=math.inf)


def pieces(push, levels, speeds, x, v, end):
    """Return (t, x, v, a) where each piece of a motion x'' = push(x, v) begins."""
    t, found = 0.0, []
    while t < end:
        # On a level, what holds is what comes next.
        ahead = 1e-6 * v if v else 5e-13 * push(x, v)
        a = push(x + ahead, v)
        if v in speeds:
            a = push(x + ahead, v + 1e-6 * a)
        found.append((t, x, v, a))
        times = [crossing(x, v, a, level) for level in levels]
        times += [(s - v) / a for s in speeds if a and (s - v) / a > 1e-9]
        step = min([*times, end - t])
        x, v, t = x + v * step + a * step**2 / 2.0, v + a * step, t + step
        # Meet levels exactly.
        x = next((y for y in levels if abs(y - x) < 1e-9), x)
        v = next((s for s in speeds if abs(s - v) < 1e-9), v)
    return found


def motion(found, t):
    """Return x at times t from pieces."""
    starts = np.array([p[0] for p in found])
    k = np.searchsorted(starts, t, side="right") - 1
    begin, x, v, a = np.array(found).T[:, k]
    s = t - begin
    return x + v * s + a * s**2 / 2.0


def sign(x):
    return float(x > 0) - float(x < 0)


# Text of a force or potential, what it pushes with, and where that changes: levels of x
# and of x'.
POTENTIALS = {
    "abs(abs(x) - 1)": (lambda x: -sign(abs(x) - 1) * sign(x), (-1, 0, 1)),
    "abs(1 - abs(x))": (lambda x: -sign(abs(x) - 1) * sign(x), (-1, 0, 1)),
    "abs(abs(-x/2) - 1)*2": (lambda x: -sign(abs(x) - 2) * sign(x), (-2, 0, 2)),
    "abs(abs(abs(x) - 2) - 1)": (
        lambda x: -sign(abs(abs(x) - 2) - 1) * sign(abs(x) - 2) * sign(x),
        (-3, -2, -1, 0, 1, 2, 3),
    ),
    "abs(x/3)": (lambda x: -sign(x) / 3, (0,)),
    "abs(x/(-7))": (lambda x: -sign(x) / 7, (0,)),
    "2*abs(-3*x + 1)": (lambda x: -6 * sign(x - 1 / 3), (1 / 3,)),
    "max(x/(-7), x)": (lambda x: -1.0 if x > 0 else 1 / 7, (0,)),
    "-min(x/7, -x)": (lambda x: -1.0 if x > 0 else 1 / 7, (0,)),
    "max(0, -x) + max(0, x - 1)": (
        lambda x: 1.0 if x < 0 else (-1.0 if x > 1 else 0.0),
        (0, 1),
    ),
    "max(abs(x), 1)": (lambda x: -sign(x) if abs(x) > 1 else 0.0, (-1, 1)),
    "if(x/(-7) < 0, x, -x/2)": (lambda x: -1.0 if x > 0 else 0.5, (0,)),
    "if(not (x >= 1) and not (x/(-2) > 0), 0, if(x >= 1, 2*x - 2, -x))": (
        lambda x: -2.0 if x >= 1 else (0.0 if x >= 0 else 1.0),
        (0, 1),
    ),
}


@pytest.mark.parametrize(("x", "v"), [(2.7, 0.0), (-2.7, 0.4), (0.6, 0.9), (-0.3, -2)])
@pytest.mark.parametrize("potential", POTENTIALS)
def test_kinked_potentials_from_all_sides(potential, x, v):
    push, levels = POTENTIALS[potential]
    found = run(scene(potential, x=x, v=v, duration=12))
    exact = pieces(lambda x, _: push(x), levels, (), float(x), float(v), 12.0)
    # Times of some ten switches to 1e-11 of the speed, each carried on.
    assert np.max(np.abs(found["x"] - motion(exact, found["t"]))) < 1e-9
    changes = [p[0] for p, q in zip(exact[1:], exact, strict=False) if p[3] != q[3]]
    told = [t for t, _ in events(found)]
    assert all(min(abs(t - s) for s in told) < 1e-9 for t in changes)
    assert {kind for _, kind in events(found)} <= {"switch"}
    assert found.drift < 1e-9


FORCES = {
    # Forces that step with the velocity but push through the surface.
    "if(not (x_dot <= 1), -1, -2)": (lambda _, v: -1.0 if v > 1 else -2.0, (), (1,)),
    "-1 - heaviside(x_dot/(-3))": (lambda _, v: -2.0 if v < 0 else -1.0, (), (0,)),
    "-floor(x/2)/2 - 0.25": (
        lambda x, _: -math.floor(x / 2) / 2 - 0.25,
        tuple(range(-10, 12, 2)),
        (),
    ),
    "-sign(x/(-7)) - 2": (lambda x, _: sign(x) - 2.0, (0,), ()),
    "if(x/(-7) >= -0.25 or x_dot < -1, -1, -3)": (
        lambda x, v: -1.0 if x <= 1.75 or v < -1 else -3.0,
        (1.75,),
        (-1,),
    ),
}


@pytest.mark.parametrize(("x", "v"), [(0.0, 2.9), (1.2, 2.5), (-1.5, 4.0)])
@pytest.mark.parametrize("force", FORCES)
def test_forces_that_step(force, x, v):
    push, levels, speeds = FORCES[force]
    found = run(scene(force=force, x=x, v=v, duration=4))
    exact = pieces(push, levels, speeds, float(x), float(v), 4.0)
    assert np.max(np.abs(found["x"] - motion(exact, found["t"]))) < 1e-10
    assert found.drift < 1e-9


FRICTIONS = (
    "if(not (x_dot <= 0), -1, 1)",
    "if(x_dot > 0, -1, 1)",
    "if(not (x_dot > 0), 1, -1)",
    "-sign(x_dot/3)",
    "sign(x_dot/(-7))",
    "-sign(x_dot^3)",
    "1 - 2*heaviside(x_dot)",
    "-1 + 2*if(-x_dot >= 0, 1, 0)",
    "if(x_dot/(-7) < 0 and not (x_dot < 0), -1, 1)",
)

# A step of a step: both surfaces are met at once, and the share of the inner one goes
# through the outer one.
STEPS_OF_STEPS = (
    "-sign(sign(x_dot))",
    "-abs(sign(x_dot))*sign(x_dot)",
    "if(if(x_dot > 0, 1, -1) > 0, -1, 1)",
    "-sign(floor(x_dot/8) + 0.5)",
)


@pytest.mark.parametrize("v", [2.0, -2.0])
@pytest.mark.parametrize("force", [*FRICTIONS, *STEPS_OF_STEPS])
def test_friction_however_it_is_written(force, v):
    # Slows down by 1 and rests from t = 2 at the distance 2.
    found = run(scene(force=force, v=v, duration=5))
    s = np.minimum(found["t"], 2.0)
    exact = math.copysign(1.0, v) * (2.0 * s - s**2 / 2.0)
    assert np.max(np.abs(found["x"] - exact)) < 1e-12
    assert [k for _, k in events(found)] == ["stick"]
    assert events(found)[0][0] == pytest.approx(2.0, abs=1e-12)
    later = found["t"] > 2.0 + 1e-9
    assert np.max(np.abs(found["x_dot"][later])) < 1e-15
    assert np.max(np.abs(found["x_ddot"][later])) < 1e-15
    assert found.drift < 1e-12


# A pad without mass, held to the block by a rod, rubs; one that rubs with the block's
# own speed times two, by a lever.
PAD = """
coordinates: {{x: {{}}, s: {{}}}}
energy: {{kinetic: x_dot^2/2, potential: 8*x^2/2}}
forces: {{s: -0.3*sign(s_dot)}}
constraints: {{rod: s = {lever}*x}}
initial: {{x: 1, s: {lever}}}
simulation: {{duration: 16, output_step: 0.02}}
"""


@pytest.mark.slow
@pytest.mark.parametrize("lever", [1, 2, -3])
def test_a_massless_coordinate_with_friction(lever):
    # Half periods pi/sqrt(8) about +-d; rest where friction holds the spring.
    found = run(PAD.format(lever=lever))
    w, d = math.sqrt(8.0), 0.3 * abs(lever) / 8.0
    halves = math.ceil((1.0 / d - 1.0) / 2.0)
    t = found["t"]
    half = np.minimum(np.floor(t * w / math.pi), halves)
    amplitude = 1.0 - (2.0 * half + 1.0) * d
    side = np.where(half % 2 == 0, 1.0, -1.0)
    exact = side * (amplitude * np.cos(w * t - half * math.pi) + d)
    rest = (-1.0) ** halves * (1.0 - 2.0 * halves * d)
    exact = np.where(half < halves, exact, rest)
    assert np.max(np.abs(found["x"] - exact)) < 1e-9
    assert np.max(np.abs(found["s"] - lever * found["x"])) < 1e-13
    stop = halves * math.pi / w
    assert stop < 16.0
    assert [k for _, k in events(found)] == ["switch"] * (halves - 1) + ["stick"]
    assert events(found)[-1][0] == pytest.approx(stop, abs=1e-9)
    # The rod carries the friction: 0.3 against the motion, then what the spring asks.
    moving = (t > 1e-3) & (t < stop - 1e-3) & (np.abs(found["x_dot"]) > 1e-3)
    drag = -0.3 * np.sign(found["s_dot"][moving])
    assert found["lambda_rod"][moving] == pytest.approx(-drag, abs=1e-9)
    resting = t > stop + 1e-3
    held = -8.0 * rest / lever
    assert found["lambda_rod"][resting] == pytest.approx(held, abs=1e-9)
    assert found.drift < 1e-9


STUCK = """
coordinates: {x: {}}
energy: {kinetic: x_dot^2/2, potential: 0}
definitions: {F: "LAW"}
forces: {x: "F + 0.5*sin(3*t)"}
output: {columns: [F]}
initial: {x: 0, x_dot: 0.3}
simulation: {duration: 3, output_step: 0.1}
"""


@pytest.mark.parametrize(
    "law",
    [
        "if(x_dot > 0, -1, if(x_dot < 0, 1, 0))",
        "if(x_dot > 0, if(x_dot > 0.1, -1, -2), if(x_dot < -0.1, 1, 2))",
        "if(x_dot < 0, 1, if(x_dot <= 0, 7, -1))",
        "if(x_dot > 0, -1, sign(-x_dot))",
        "if(x_dot > 0 and 2*x_dot > 0, -1, 1)",
        "if(sign(x_dot) > 0, -1, if(x > -5, 1, 3))",
        "-sign(x_dot)*if(x_dot > 0, 1, 2)",
        "-sign(x_dot)*abs(sign(x_dot))",
        "-floor(sign(x_dot))",
        "-sign(x_dot)/if(x_dot > 0, 1, 0.5)",
    ],
)
def test_rows_of_a_nested_law_show_the_force_that_holds(law):
    found = run(STUCK.replace("LAW", law))
    stuck = [e.time for e in found.trajectory.events if e.kind == "stick"]
    # The equation of motion, with the law as the row shows it.
    left = found["F"] + 0.5 * np.sin(3 * found["t"]) - found["x_ddot"]
    assert np.max(np.abs(left)) < 1e-14
    # It rests from there on: what is shown holds the load.
    held = found["t"] > stuck[0]
    assert np.count_nonzero(held) > 10
    assert np.max(np.abs(found["x_dot"][held])) < 1e-15


TURNING = """
coordinates: {q: {unit: rad}, w: {}}
energy: {kinetic: q_dot^2/2 + w_dot^2/2, potential: 0}
forces: {w: "FORCE"}
initial: {q: 0, q_dot: 1, w: 0}
simulation: {duration: 20, output_step: 0.5, METHOD}
"""
LEFT = 20 - 6 * math.pi  # of the fourth turn


@pytest.mark.parametrize(
    ("force", "impulse"),
    [
        # The angle from -pi to pi: positive in half of each turn.
        ("if(atan2(sin(q), cos(q)) > 0, 1, 0)", 20 - 3 * math.pi),
        ("abs(atan2(sin(q), cos(q)))", 3 * math.pi**2 + LEFT**2 / 2),
        ("mod(atan2(sin(q), cos(q)) + 2*pi, 2*pi)", 6 * math.pi**2 + LEFT**2 / 2),
        ("sign(atan(tan(q/2)))", LEFT),
        # Poles.
        ("sign(tan(q))", LEFT),
        ("if(1/sin(q) > 0, 1, 0)", 20 - 3 * math.pi),
        ("heaviside(1/(q - 3))", 17.0),
        ("min(max(tan(q), -1), 1)", math.log(2) / 2 + LEFT - math.pi / 4),
    ],
)
@pytest.mark.parametrize("method", ["method: auto", "method: dopri5"])
def test_an_argument_jumps_past_the_level(force, impulse, method):
    """At a cut of an angle, or a pole, the side is that of the value after the jump."""
    found = run(TURNING.replace("FORCE", force).replace("METHOD", method))
    # An angle is a force that jumps: two steps of rtol 1e-11 beside each of three cuts.
    assert found["w_dot"][-1] == pytest.approx(impulse, abs=1e-8)


# The integral over a time of 6: a root at a jump or a kink, where its argument, with
# all switches held, is below 0 by rounding.
ROOTS = {
    "sqrt(mod(q, 2))": 3 * 2**2.5 / 3,
    "mod(q, 2)^1.5": 3 * 2**3.5 / 5,
    "acosh(1 + mod(q, 2))": 3 * (3 * math.acosh(3) - math.sqrt(8)),
    "asin(1 - mod(q, 2)/2)": 3 * (math.pi - 2),
    "if(q < 2, sqrt(2 - q), 5 + sqrt(q - 2))": 2**2.5 / 3 + 20 + 16 / 3,
    "if(mod(q, 2) < 1, sqrt(1 - mod(q, 2)), 0)": 2.0,
    "max(0, 1 - abs(q - 3))^1.5": 0.8,
}


@pytest.mark.slow
@pytest.mark.parametrize("method", ["auto", "dopri5", "radau"])
@pytest.mark.parametrize("variable", ["q", "t"])
@pytest.mark.parametrize("force", ROOTS)
def test_a_root_at_a_switch_has_no_jump_by_rounding(force, variable, method):
    shown = force.replace("q", variable).replace(f"s{variable}rt", "sqrt")
    model = TURNING.replace("FORCE", shown).replace("METHOD", f"method: {method}")
    found = run(model.replace("duration: 20", "duration: 6"))
    # Roots whose slope is unbounded: steps of 1e-11 where they begin, at six places.
    assert found["w_dot"][-1] == pytest.approx(ROOTS[force], abs=1e-9)


def test_a_root_without_a_value_on_its_own_side_ends_the_run():
    """Outside its domain a root is mirrored beside its own switch alone."""
    shown = "if(q > 1, sqrt(q - 3), 0)"
    model = TURNING.replace("FORCE", shown).replace("METHOD", "method: auto")
    found = run(model).trajectory
    assert found.outcome == Outcome.NOT_FINITE
    assert found.end == pytest.approx(1.0, abs=1e-6)


FLAT = "flat: {points: [[0, 3], [1, 3], [1.5, 0], [4, 0], [5, 1]], outside: hold}"
SAW = "saw: {points: [[0, 0], [1, 2], [2, -1], [3, 0]], outside: repeat}"


@pytest.mark.parametrize(
    ("force", "impulse"),
    [
        # 3 in the first second, then a ramp of 0.75; from q = 4 a ramp of 0.5, then 1.
        ("abs(flat(q))", 3.75 + 0.5 + 1),
        ("sign(flat(q))", 1.5 + 2),
        # The same four pieces, times q + 1.
        ("max(0, flat(q)*(q + 1))", 4.5 + 1.625 + 17 / 6 + 6.5),
        # 1 + saw(q) is below 1.5 but for 1/4 < q < 3/2.
        ("if(flat(1 + saw(q)) > 0, 1, 0)", 2 * (3 - 1.25)),
    ],
)
def test_the_argument_of_a_switch_is_0_between_points_of_a_table(force, impulse):
    """Past a point of the table the switch is decided again, at whatever rate."""
    tables = f"tables: {{{FLAT}, {SAW if 'saw' in force else ''}}}"
    model = tables + TURNING.replace("FORCE", force).replace("METHOD", "method: auto")
    found = run(model.replace("duration: 20", "duration: 6"))
    # Forces are linear in t between points: exact to rounding and to the times found.
    assert found["w_dot"][-1] == pytest.approx(impulse, abs=1e-11)


@pytest.mark.parametrize(
    ("argument", "expected"),
    [
        ("tan(x)", True), ("atan2(sin(x), cos(x))", True), ("1/(x - 3)", True),
        ("atan(1/x)", True), ("x^-3", True), ("x^-k", True), ("x^(1 - t)", True),
        ("x/k", False), ("x^3", False), ("sqrt(x + 9)", False), ("abs(x) - 1", False),
        ("max(x, tanh(x)) - 1", False), ("ceil(x) - x", False), ("mod(x, 2)", False),
    ],
)  # fmt: skip
def test_poles_are_known_from_the_expression(argument, expected):
    # A jump of rounding, of an expression without a pole, is none.
    text = scene(force=f"if({argument} > 0, 1, 0)") + "parameters: {k: 2}\n"
    assert np.any(ready(text).system.poles) == expected


# w rises; the switch is one of the time alone, at cos(t + 0.6) = 0.
TIMED = """
coordinates: {{w: {{}}, z: {{}}}}
energy: {{kinetic: (w_dot^2 + z_dot^2)/2, potential: 0}}
forces: {{w: {pull}, z: "0.3*sign(cos(t + 0.6)*(1 + {x})) + abs({x} - 3.5)"}}
initial: {{w: 0.5, w_dot: 0.1, z: 0}}
simulation: {{duration: 2, output_step: 1, method: {method}}}
"""


@pytest.mark.parametrize("method", ["dop853", "radau", "taylor"])
@pytest.mark.parametrize("x", ["w", "2*w", "w_dot"])
@pytest.mark.parametrize("pull", [0.0, 0.5])
def test_switches_of_the_time_with_a_factor_of_the_state(method, x, pull):
    """Surfaces beside a switch of the time keep their sides, whatever its slope is.

    At cos(t + 0.6) = 0 the slope of cos(t + 0.6)*(1 + w) by w is 1e-16, not 0.
    """
    found = run(TIMED.format(method=method, x=x, pull=pull))
    at = math.pi / 2 - 0.6
    way = 0.5 * 2.0 + 0.1 * 2.0 + pull * 2.0**3 / 6.0
    shown = {"w": way, "2*w": 2.0 * way, "w_dot": 0.1 * 2.0 + pull * 2.0}[x]
    expected = 0.3 * (at - (2.0 - at)) + 3.5 * 2.0 - shown
    assert found["z_dot"][-1] == pytest.approx(expected, rel=1e-11)
