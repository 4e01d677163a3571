"""Where switches lead to rest: switching curves, accumulations, levels, dead zones."""

import math

import numpy as np
import pytest

from tests.choosing import turn
from tests.run.switching.scenes import codes, events, kinds, one_quick, scene
from tests.support import run


def time_optimal(x, v, t):
    """Return x of x'' = +-1 that is brought to rest at 0 in least time, and that time.

    For starts from which it is pushed back first: above the curve x = -v |v|/2.
    """
    first = v + math.sqrt(v * v / 2 + x)
    end = 2 * first - v
    pushed = x + v * t - t * t / 2
    return np.where(t < first, pushed, np.maximum(end - t, 0) ** 2 / 2), end


@pytest.mark.slow
@pytest.mark.parametrize(
    "law",
    one_quick(
        "-sign(x + x_dot*abs(x_dot)/2)",
        "if(2*x + x_dot*abs(x_dot) > 0, -1, 1)",
        "1 - 2*heaviside(x + 0.5*x_dot^2*sign(x_dot))",
        "-sign(x + if(x_dot > 0, x_dot^2, -x_dot^2)/2)",
    ),
)
def test_time_optimal_control_comes_to_rest_at_its_time(law):
    for x, v, sign in [(1, 0, 1), (0.5, 1, 1), (2, -0.5, -1), (0.01, 3, -1)]:
        found = run(scene(force=law, x=sign * x, v=sign * v, duration=8))
        exact, end = time_optimal(x, v, found["t"])
        # Parabolas: a method of order 8 has rounding alone, of a motion of size 5.
        assert np.max(np.abs(sign * found["x"] - exact)) < 1e-13
        assert events(found)[-1][0] == pytest.approx(end, abs=1e-7)
        later = found["t"] > end + 1e-6
        assert not np.any(np.abs(found["x_dot"][later]) > 1e-15)
        assert np.max(np.abs(found["x_ddot"][later])) < 1e-12
        assert codes(found) == []


# Pushed with -gain + load from 1 to the curve x = -c v |v|, then along it to rest; or,
# where the load is against that, in swings.
CURVES = [(1, 0.8, 0), (1, 0.6, 0), (1, 2.0, 0), (2, 0.25, 0), (1, 0.5, 0.1)]
CURVES += [(1, 0.5, -0.1)]
FORMS = [("square", *curve) for curve in CURVES]
FORMS += [("root", *curve) for curve in CURVES]


@pytest.mark.parametrize(("form", "gain", "c", "load"), FORMS)
def test_the_end_of_a_switching_curve_is_rest(form, gain, c, load):
    curve = f"x + {c}*x_dot*abs(x_dot)"
    if form == "root":
        curve = f"x_dot + sign(x)*sqrt({1 / c}*abs(x))"
    found = run(scene(force=f"{load} - {gain}*sign({curve})", x=1, duration=12))
    assert found.trajectory.outcome.name == "DONE"
    t, x, push = found["t"], found["x"], gain - load
    if load >= 0:
        # 1 - push t^2/2 = c (push t)^2, and v' = 1/(2 c) on the curve.
        met = 1 / math.sqrt(push / 2 + c * push**2)
        end = met + 2 * c * push * met
        speed = np.maximum(end - t, 0) / (2 * c)
        exact = np.where(t < met, 1 - push * t**2 / 2, c * speed**2)
        # At the end the speed is the root of what the place is known to.
        assert np.max(np.abs(x - exact)) < (1e-13 if form == "square" else 1e-9)
        assert kinds(found)[0] == "stick"
        assert events(found)[-1][0] == pytest.approx(end, abs=1e-5)
        assert not np.any(np.abs(found["x_dot"][t > end + 1e-6]) > 1e-15)
    assert np.max(np.abs(found["x_dot"][-20:])) == 0.0
    assert np.max(np.abs(x[-20:])) < 1e-12
    assert np.max(np.abs(found["x_ddot"][-20:])) < 1e-12


@pytest.mark.slow
@pytest.mark.parametrize("form", ["square", "root"])
@pytest.mark.parametrize("c", one_quick(0.444623563057, 0.1, 0.3, 0.4))
def test_switches_on_a_curve_accumulate_and_rest(form, c):
    # The first is Fuller's problem. A swing from rest at x ends at -x k, k below.
    curve = f"x + {c}*x_dot*abs(x_dot)"
    if form == "root":
        curve = f"x_dot + sign(x)*sqrt(abs(x)/{c})"
    found = run(scene(force=f"-sign({curve})", x=1, duration=20))
    k = (0.5 - c) / (0.5 + c)
    end = 2 / math.sqrt(0.5 + c) / (1 - math.sqrt(k))
    zeno = [e.time for e in found.trajectory.events if e.kind == "zeno"]
    assert zeno == pytest.approx([end] * len(zeno), abs=1e-8)
    assert zeno
    later = found["t"] > end + 1e-6
    # What was left of the motion is the square of 4e-6 of it.
    assert np.max(np.abs(found["x"][later])) < 1e-10
    assert np.max(np.abs(found["x_dot"][later])) < 1e-15
    assert found.drift < 1e-9


@pytest.mark.slow
@pytest.mark.parametrize(
    ("force", "speed"),
    one_quick(
        ("1.5 - floor(x_dot)", 2.0),
        ("2.5 - ceil(x_dot)", 2.0),
        ("0.35 - 0.1*floor(10*x_dot)", 0.4),
        ("-floor(x_dot + 3.5) + 0.5", -2.5),
        ("1 - 2*heaviside(x_dot - 0.75)", 0.75),
    ),
)
def test_friction_of_levels_holds_the_speed_of_its_level(force, speed):
    for v in (0, 3.7, -1.2):
        found = run(scene(force=force, v=v, duration=30))
        assert kinds(found)[-1] == "stick"
        stuck = found["t"] > events(found)[-1][0] + 1e-9
        assert found["x_dot"][stuck] == pytest.approx(speed, abs=1e-14)
        # The last stretch is uniform: x goes with the speed from row to row.
        steps = np.diff(found["x"][stuck]) / np.diff(found["t"][stuck])
        assert steps == pytest.approx(speed, abs=1e-11)
        assert found.drift < 1e-11


def in_a_dead_zone(t):
    """Return x of x'' = -1 above 1, 1 below -1, 0 between, from 0 at speed 1."""
    t = np.mod(t, 8)
    half = np.mod(t, 4)
    out = np.where(half < 1, half, 1 + (half - 1) * (3 - half) / 2)
    x = np.where(half < 3, out, 4 - half)
    return np.where(t < 4, x, -x)


EDGES = [
    "x - max(-1, min(1, x))",
    "x - (abs(x + 1) - abs(x - 1))/2",
    "if(x > 1, x - 1, if(x < -1, x + 1, 0))",
    "max(0, x - 1) + min(0, x + 1)",
]
LAWS = [
    "sign(u)",
    "if(u > 0, 1, if(u < 0, -1, 0))",
    "if(u >= 0, if(u <= 0, 0, 1), -1)",
    "(floor(u) + ceil(u))",
]


@pytest.mark.parametrize(
    ("edge", "law"), one_quick(*((edge, law) for law in LAWS for edge in EDGES))
)
def test_the_edge_of_a_dead_zone_is_crossed(edge, law):
    force = "-" + law.replace("u", f"({edge})")
    found = run(scene(force=force, v=1, duration=16))
    assert np.max(np.abs(found["x"] - in_a_dead_zone(found["t"]))) < 1e-12
    assert found.drift < 1e-12


BACKLASH = """
parameters: {{b: 0.1, k: 100, c: 2}}
coordinates: {{a: {{}}, p: {{}}}}
definitions: {{phi: a - p, stretch: "{stretch}", force: "{force}"}}
energy: {{kinetic: (a_dot^2 + 3*p_dot^2)/2, potential: 0}}
forces: {{a: -force, p: force}}
initial: {{a: 0, p: 0, a_dot: 1}}
simulation: {{duration: 10, output_step: 0.05}}
"""
PUSH = "k*stretch + c*phi_dot"
PUSH = f"if(stretch > 0, max(0, {PUSH}), if(stretch < 0, min(0, {PUSH}), 0))"


@pytest.mark.slow
@pytest.mark.parametrize(
    "stretch",
    one_quick("phi - max(-b, min(b, phi))", "phi - (abs(phi + b) - abs(phi - b))/2"),
)
def test_gears_with_backlash_touch_and_part(stretch):
    found = run(BACKLASH.format(stretch=stretch, force=PUSH))
    # In phi one mass of 3/4. Free until phi = b, then a damped spring until its force
    # would pull, then free to the other side, and so on, each time by the same factor.
    m, k, c, b = 0.75, 100.0, 2.0, 0.1
    s, w = c / (2 * m), math.sqrt(k / m - (c / (2 * m)) ** 2)
    # stretch e^(-s t) sin(w t) v/w: the force vanishes first where k x + c x' = 0.
    part = math.atan2(-c * w, k - c * s) % math.pi / w
    depth = math.exp(-s * part) * math.sin(w * part) / w
    left = math.exp(-s * part) * (math.cos(w * part) - s / w * math.sin(w * part))
    t, v, times = b, 1.0, []
    while t < 10:
        times.append(t)
        gap = 2 * b + depth * v
        t, v = t + part + gap / (-left * v), -left * v
    met = np.array([e.time for e in found.trajectory.events])
    for time in times:
        assert np.min(np.abs(met - time)) < 1e-8
    momentum = found["a_dot"] + 3 * found["p_dot"]
    assert np.max(np.abs(momentum - 1)) < 1e-11
    assert found.drift < 1e-10
    assert np.max(np.abs(np.diff(found["phi"]))) < 0.06  # a speed of 1 at most


@pytest.mark.slow
@pytest.mark.parametrize("scale", one_quick(1e6, 1e-6, 1.0))
def test_accumulating_switches_end_at_their_limit_in_any_unit_of_time(scale):
    # Up against 1.3, down with 0.7: each swing sqrt(7/13) of the one before.
    # In a unit of time `scale` times as long, all of the run is 1/scale as long.
    force = f"-0.3*{scale}^2*sign(x_dot)"
    found = run(
        scene(f"{scale}^2*abs(x)", force, v=scale, duration=20 / scale,
              output_step=0.1 / scale)
    )  # fmt: skip
    ratio = math.sqrt(0.7 / 1.3)
    limit = (1 / 1.3 + ratio / 0.7) / (1 - ratio)
    zeno = [e.time for e in found.trajectory.events if e.kind == "zeno"]
    assert zeno == pytest.approx([limit / scale] * 2, rel=1e-10)
    later = found["t"] * scale > limit + 1e-6
    # What was left of the motion is the square of 2e-6, the part not gone through.
    assert np.max(np.abs(found["x"][later])) < 1e-12
    rest = 0.0 if scale == 1.0 else 1e-30 * scale
    assert np.max(np.abs(found["x_dot"][later])) <= rest
    assert found.drift < 1e-11 * scale**2
    assert found.trajectory.statistics.steps < 400


@pytest.mark.parametrize(
    "law",
    one_quick(
        "if(x_dot > 0, 1, -1)",
        "2*heaviside(x_dot) - 1",
        "if(x >= 0, 1, -1)",
        "if(x^3 < 0, -1, 1)",
    ),
)
def test_a_side_that_nothing_decides_is_told_and_shown(law):
    text = scene(force="push", duration=2)
    text = text.replace("energy:", f'definitions: {{push: "{law}"}}\nenergy:')
    found = run(text)
    assert codes(found) == ["unresolved-switch"]
    assert np.array_equal(found["push"], found["x_ddot"])
    assert np.abs(found["x"]) == pytest.approx(found["t"] ** 2 / 2, abs=1e-12)


def test_what_another_holds_in_balance_rests_though_its_switch_repels():
    # Held, -sign(y_dot) is -1/2, so that x has no force at sign(0) = 0; with y_dot on
    # either side of 0 it would have one.
    found = run("""
coordinates: {x: {}, y: {}}
energy: {kinetic: (x_dot^2 + y_dot^2)/2, potential: 0}
forces:
  x: 2*sign(x) + sign(y_dot) - 0.5
  y: 0.5 - sign(y_dot)
initial: {x: 0, y: 0}
simulation: {duration: 2, output_step: 0.1}
""")
    assert not np.any(found["x"])
    assert not np.any(found["y"])
    assert codes(found) == []


# Definitions that jump at a = 0, with their value there, and forces of them that are 0
# at a = 0, push back from one side or from both, and not at once.
AT_LEVEL = [
    ("if({a} > 0, 1, if({a} < 0, -1, 0))", 0, "-if(d > 0.5, 1, 0)"),
    ("if({a} > 0, 1, if({a} < 0, -1, 0))", 0, "if(d < -0.5, 1, 0)"),
    ("sign({a})", 0, "-heaviside(d - 0.5)"),
    ("min(0.2, sign({a}))", 0, "if(d < -0.4, 1, 0)"),
    ("max(sign({a}), 0.5*sign({a}))", 0, "-d"),
    ("abs(sign({a}))", 0, "-d*sign({a})"),
    ("sign({a})^2", 0, "-(d + sign({a}))/2"),
    ("heaviside({a}) + heaviside(-({a}))", 2, "(2 - d)*sign(-({a}))"),
    ("floor({a}) + ceil({a})", 0, "-if(d > 0.3, 1, 0)"),
    ("mod({a}, 2)", 0, "if(d > 0.3, 0.7, 0) - heaviside({a} - 0.001)"),
    ("tb(sign({a}))", 5, "5*(5 - d)*sign({a})"),
    ("if(abs({a}) > 0, 1, 4)", 4, "if({a} < 0, 1, 0)*if(d < 2, 1, 0)"),
    ("sign(abs({a}))", 0, "if({a} <= 0, 1, -1) - 1"),
    ("if(max({a}, -({a})) <= 0, 7, 1)", 7, "if(sign(-({a})) > 0.5, 0.3, 0)"),
]
METHODS = ["dop853", "dopri5", "taylor", "radau", "rk4, step: 0.01"]
ARGUMENTS = ["x", "-x/3", "x - y", "x_dot", "x + x_dot"]


@pytest.mark.parametrize(
    ("definition", "value", "force"),
    [pytest.param(*case, id=case[0].format(a="a")) for case in AT_LEVEL],
)
def test_rows_at_rest_show_values_at_the_level(definition, value, force, request):
    name = request.node.nodeid
    a, method = (turn(name + x, "", of) for x, of in (("a", ARGUMENTS), ("m", METHODS)))
    d, push = definition.format(a=a), force.format(a=a)
    where = turn(name, "", ["t < 0.33", "u > 0", "z < 0.33"])
    text = f"""
name: scene
tables: {{tb: {{points: [[-2, 1], [0, 5], [2, 3]], outside: extend}}}}
coordinates: {{x: {{}}, y: {{}}, z: {{}}}}
definitions: {{d: '{d}', used: tb(z)}}
initial: {{x: 0, y: 0, z: 0, z_dot: 1}}
modes: {{u: 1}}
events: {{late: {{at: z >= 0.33, set: {{u: 0}}}}}}
energy: {{kinetic: (x_dot^2 + y_dot^2 + z_dot^2)/2, potential: 0}}
forces: {{x: 'if({where}, {push}, 2)'}}
simulation: {{duration: 1, output_step: 0.06, method: {method}}}
"""
    found = run(text)
    t, x = found["t"], found["x"]
    assert np.all(found["d"][t < 0.33] == value)
    assert np.all(x[t < 0.33] == 0.0)
    # Thrown off by 2 from then on: a parabola, which the methods integrate exactly.
    assert np.max(np.abs(x - np.maximum(t - 0.33, 0) ** 2)) < 1e-13


@pytest.mark.parametrize("hold", ["x_dot = 0, limit: 4", "x >= 0, restitution: 0"])
@pytest.mark.parametrize("force", ["0", "-d", "-d + if(e < 0.6, 1, 0)"])
def test_rows_held_by_laws_show_values_at_the_level(hold, force):
    d = "heaviside(x_dot) - heaviside(-x_dot)"
    text = f"""
name: scene
coordinates: {{x: {{}}}}
definitions: {{d: {d}, e: 'if(not x_dot > 0, 1, 0)', f: 'if(abs(x_dot) <= 0, 7, 1)'}}
initial: {{x: 0}}
energy: {{kinetic: x_dot^2/2, potential: 0}}
forces: {{x: 'if(t < 0.33, {force} - if(f > 7.3, 1, 0) - 2.4, 9)'}}
constraints: {{hold: {{relation: {hold}}}}}
simulation: {{duration: 0.5, output_step: 0.06}}
"""
    found = run(text)
    held = found["t"] < 0.33
    for name, value in {"d": 0, "e": 1, "f": 7}.items():
        assert np.all(found[name][held] == value)
    assert np.all(np.abs(found["lambda_hold"][held] - 2.4) < 1e-14)
