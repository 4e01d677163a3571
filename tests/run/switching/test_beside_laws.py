"""Switches in forces beside constraints that come and go: both act as if alone."""

import itertools
import random

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from lagsim.model.reader import read
from lagsim.run.trajectory import Outcome
from tests.run.switching.scenes import one_quick
from tests.scenes.contact.motions import scene as mechanical
from tests.support import run

# A body of 1 kg that a wind pushes with 1 N beyond x = 0.5 and 1 N more beyond x = 1.
PUSHES = ["if(x > 0.5, 1, 0)", "if(x > 0.5, 1, 0) + if(x > 1, 1, 0)"]
# Beside it: a law that holds at times, and where z is after t (g = 10, falls from 0.8).
BESIDE = {
    "contact": "{relation: z >= 0, restitution: 0.5}",
    "friction": "{relation: z >= 0, restitution: 0, friction: 0.2, slip: w_dot}",
    "limit": "{relation: z_dot = 0, limit: 4}",
    "freewheel": "{relation: z_dot >= 0}",
}


def scene(push, law):
    return f"""
name: both
coordinates: {{x: {{}}, z: {{}}, w: {{}}}}
energy:
  kinetic: (x_dot^2 + z_dot^2 + w_dot^2)/2
  potential: 10*z
forces:
  x: "{push}"
constraints:
  law: {law}
initial: {{x: 0, x_dot: 1, z: 0.8, w: 0, w_dot: 3}}
simulation: {{duration: 1.5, output_step: 0.125}}
"""


def pushed(t, pushes):
    """Return x: uniform to 0.5, then by one push, then by two."""
    first = 0.5
    second = first + np.sqrt(2.0) - 1.0  # 0.5 = s + s^2/2
    s, r = t - first, t - second
    x = np.where(s > 0, 0.5 + s + s**2 / 2, t)
    if pushes == 2:
        x = np.where(r > 0, 1.0 + np.sqrt(2.0) * r + r**2, x)
    return x


def fallen(t, law):
    """Return z of bodies that fall under each law alone."""
    fall = 0.8 - 5 * t**2
    s = t - 0.4  # at the ground with 4 m/s
    if law == "contact":
        return np.where(s > 0, np.where(s < 0.4, 2 * s - 5 * s**2, np.nan), fall)
    if law == "friction":
        return np.where(s > 0, 0.0, fall)
    if law == "limit":
        return 0.8 - 3 * t**2
    return np.full(len(t), 0.8)


@pytest.mark.parametrize("push", one_quick(PUSHES[1], PUSHES[0]))
@pytest.mark.parametrize("law", BESIDE)
def test_laws_and_switches_act_as_if_alone(law, push):
    found = run(read(scene(push, BESIDE[law]), "both.yaml"))
    t, x, z = found["t"], found["x"], found["z"]
    # Rows at events are as good as those of the output steps.
    assert x == pytest.approx(pushed(t, push.count("if")), abs=1e-9)
    expected = fallen(t, law)
    known = np.isfinite(expected)
    assert np.count_nonzero(known) > 6
    assert z[known] == pytest.approx(expected[known], abs=1e-9)


def rubbing(bound, pairs, force, *, limits, mu=0.3, k=20, start=("f", 0.1)):
    """Bodies on springs that rub on the ground, and some on each other.

    limits : the part of all friction that is by limits, chosen at random.
    """
    slips = {x: (f"{x}_dot", F) for x, F in bound.items()}
    slips |= {x + y: (f"{y}_dot - {x}_dot", mu) for x, y in pairs}
    force = dict.fromkeys(bound, "0") | force
    r, laws = random.Random(repr(bound)), {}
    for name, (v, F) in slips.items():
        if r.random() < limits:
            laws[name] = {"relation": f"{v} = 0", "limit": F}
            continue
        force[name[-1]] += f" - {F}*sign({v})"
        force[name[0]] += f" + {F}*sign({v})" if len(name) > 1 else ""
    springs = " + ".join(f"({x} - {y})^2" for x, y in itertools.pairwise(bound))
    return mechanical(
        " ".join(bound), " + ".join(f"{x}_dot^2/2" for x in bound),
        f"{k}*({springs}) + a^2/2", laws,
        dict.fromkeys(bound, 0.0) | dict([start]), forces=force, duration=3,
        output_step=0.125,
    )  # fmt: skip


def agree(names, least, **scene):
    """Compare motions by limits, by switches and by both, relative to their size."""
    texts = [rubbing(**scene, limits=x) for x in (1.0, 0.0, 0.5)]
    ways = [run(read(text, "rubbing.yaml")) for text in texts]
    assert all(way.trajectory.outcome is Outcome.DONE for way in ways)
    assert len(ways[1].trajectory.events) > least
    times = np.arange(0.0, 3.01, 0.125)
    rows = [
        np.array([x[name][np.searchsorted(x["t"], times - 1e-9)] for name in names])
        for x in ways
    ]
    for other in rows[1:]:
        size = np.max(np.ptp(other, axis=1))
        assert rows[0] == pytest.approx(other, abs=1e-9 * size)


@pytest.mark.slow
@pytest.mark.parametrize("pairs", one_quick(["ab"], ["ab", "bc", "cd"]))
def test_friction_by_switches_is_that_by_limits_where_more_rubs_than_moves(pairs):
    bound = {"a": 1, "b": 1, "c": 1, "d": 2, "e": 1, "f": 0.5}
    force = {"a": "6*sin(t)", "f": "4*sin(1.3*t)"}
    agree("abcdef", 10, bound=bound, pairs=pairs, force=force)


@pytest.mark.parametrize(
    ("brake", "x", "a"), [(2.0, 4 / 3, 0.0), (0.5, 19 / 12, 49 / 48)]
)
def test_friction_by_a_switch_beside_a_clutch_to_a_brake(brake, x, a):
    # A load t on x, which rubs with 1; a clutch of 1 joins it to what is braked: both
    # bear 2 before x goes, x'' = t - 2. A brake of 0.5 gives way first, at t = 1.5, and
    # both go, (t - 1.5)/2, until the clutch slips at 2.5: then t - 2 and 0.5.
    text = mechanical(
        "x a", "(x_dot^2 + a_dot^2)/2", "0",
        {"brake": {"relation": "a_dot = 0", "limit": brake},
         "clutch": {"relation": "a_dot = x_dot", "limit": 1}},
        {"x": 0, "a": 0}, forces={"x": "t - sign(x_dot)"}, duration=4, output_step=0.5,
    )  # fmt: skip
    found = run(read(text, "clutch.yaml"))
    assert [found[q][-1] for q in ("x", "a")] == pytest.approx([x, a], abs=1e-9)
    assert not found.trajectory.warnings


def test_limits_do_not_share_a_load_that_a_switch_bears_with_them():
    # The limits hold a by b, which the switch holds: what b bears of the load is not
    # known by the limits' forces on a alone. Both give way at their sum, 1 + 0.3.
    text = mechanical(
        "a b", "(a_dot^2 + b_dot^2)/2", "0",
        {"joint": {"relation": "b_dot = a_dot", "limit": 0.3},
         "brake": {"relation": "a_dot = 0", "limit": 1}},
        {"a": 0, "b": 0}, forces={"a": "t", "b": "0.5*t - 2*sign(b_dot)"}, duration=3,
        output_step=0.5,
    )  # fmt: skip
    found = run(read(text, "joint.yaml"))
    slips = [e.time for e in found.trajectory.events if e.constraint]
    assert slips == pytest.approx([1.3, 1.3], abs=1e-12)  # known to rounding
    assert found["a"][-1] == pytest.approx(1.7**3 / 6.0, abs=1e-12)
    assert found["b"][-1] == pytest.approx(0.0, abs=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("u", [1.0, 1e-6])
def test_a_force_that_switches_and_limits_bear_together_in_any_unit(u):
    # Of 5.52 sin 1.49 t on a its brake bears 2, and its friction on b 0.77, which b
    # passes on: until then nothing has moved at all, but for rounding.
    forces = {
        "a": "5.52*sin(1.49*t) + 0.77*sign(b_dot - a_dot)",
        "b": "-0.31*sign(b_dot) - 0.77*sign(b_dot - a_dot)",
        "c": "0.77*sign(d_dot - c_dot)",
        "d": "-sign(d_dot) - 0.77*sign(d_dot - c_dot) + 0.77*sign(e_dot - d_dot)",
        "e": "-sign(e_dot) - 0.77*sign(e_dot - d_dot)",
    }
    limits = {"a": ("a_dot", 2), "c": ("c_dot", 1), "bc": ("c_dot - b_dot", 0.77)}
    text = mechanical(
        "a b c d e", f"{u}*({' + '.join(f'{x}_dot^2/2' for x in 'abcde')})",
        f"{u}*a^2/2", {k: {"relation": f"{v} = 0", "limit": u * most}
        for k, (v, most) in limits.items()}, dict.fromkeys("abcde", 0.0),
        forces={x: f"{u}*({force})" for x, force in forces.items()}, duration=1,
        output_step=0.125,
    )  # fmt: skip
    found = run(read(text, "units.yaml"))
    assert found.trajectory.outcome is Outcome.DONE
    slips = [e.time for e in found.trajectory.events if e.constraint == "a"]
    assert slips == pytest.approx([np.arcsin(2.77 / 5.52) / 1.49], abs=1e-9)


# Scenes that ended in switches without end, or jumped, where ties were broken one by
# one: all rub on the ground and each on the next.
@pytest.mark.slow
@pytest.mark.parametrize("seed", one_quick(0, *range(1, 24)))
def test_rows_of_blocks_that_rub_on_each_other(seed):
    r = random.Random(seed)
    names = "abcdef"[: r.randint(3, 6)]
    bound = {x: r.choice([0.5, 1, 1, 2, round(r.uniform(0.2, 3), 2)]) for x in names}
    push = f"{round(r.uniform(3, 8), 2)}*sin({round(r.uniform(0.5, 4), 2)}*t)"
    agree(
        names, 2, bound=bound, pairs=[x + y for x, y in itertools.pairwise(names)],
        force={r.choice(names): push}, mu=r.choice([0.3, round(r.uniform(0.05, 1), 2)]),
        k=round(r.uniform(2, 60), 1), start=(r.choice(names), r.choice([0.0, 0.1])),
    )  # fmt: skip


@pytest.mark.slow
def test_a_slip_on_a_disc_comes_to_rest_with_switches_that_accumulate():
    # Friction of 1.2 on (x_dot, w_dot); each swing of x is about 0.553 of the last.
    found = run("""
coordinates: {x: {}, w: {}}
energy: {kinetic: (x_dot^2 + w_dot^2)/2, potential: 0}
forces: {x: -2*sign(x), w: 0.5}
constraints: {c: {relation: [x_dot = 0, w_dot = 0], limit: 1.2}}
initial: {x: 0.5, x_dot: 0, w: 0, w_dot: 1}
simulation: {duration: 5, output_step: 0.1}
""")
    end, w = _spiralled_in()
    assert found.trajectory.outcome is Outcome.DONE
    zeno = [e.time for e in found.trajectory.events if e.kind == "zeno"]
    assert zeno == pytest.approx([end], abs=1e-6)
    rest = found["t"] > end + 1e-5
    assert rest.any()
    assert found["w"][rest] == pytest.approx(w, abs=1e-8)
    for at_rest in ("x", "x_dot", "w_dot"):
        assert np.max(np.abs(found[at_rest][rest])) < 1e-11
    assert found.trajectory.statistics.steps < 1000


def _spiralled_in():
    """Time and w at the limit, by another integrator from swing to swing."""
    t, y, side = 0.0, np.array([0.5, 0.0, 0.0, 1.0]), 1.0
    times = [t]

    def rates(_t, y):
        slip = np.hypot(y[2], y[3])
        return [y[2], y[3], -2 * side - 1.2 * y[2] / slip, 0.5 - 1.2 * y[3] / slip]

    def back(_t, y):
        return y[0]

    back.terminal = True
    while np.hypot(y[2], y[3]) > 1e-4:
        back.direction = -side
        swing = solve_ivp(
            rates, (t, 9), y, method="DOP853", events=back, rtol=1e-11, atol=1e-15
        )
        t, y, side = swing.t[-1], swing.y[:, -1], -side
        y[0] = 0.0
        times.append(t)
    ratio = (times[-1] - times[-3]) / (times[-3] - times[-5])
    return t + (t - times[-3]) * ratio / (1 - ratio), y[1]


# Conditions that hold, and that do not, where a position x and a velocity v are 0.
HOLD = ("v <= 0", "not (v > 0)", "-v >= 0.5*x", "2*v >= x", "0.5*x <= -v")
FAIL = ("v < 0", "not (v <= 0)", "-v > 0.5*x", "not (0.5*x <= -v)", "v > x")


@pytest.mark.parametrize("unit", one_quick(1.0, 1e-3))
@pytest.mark.parametrize("law", one_quick("limit", "friction"))
@pytest.mark.parametrize(
    ("low", "high"), one_quick((-0.2, 0.1), (0.1, -0.2), (0.1, 0.2))
)
def test_a_body_that_a_law_holds_has_the_force_of_a_switch_at_its_level(
    low, high, law, unit
):
    """Each of ten bodies rests by friction of 0.3, beside a force of a condition."""
    conditions = {f"x{k}": text for k, text in enumerate(HOLD + FAIL)}
    laws, push = {}, {}
    for q, text in conditions.items():
        laws[f"rub{q}"] = {"relation": f"{q}_dot = 0", "limit": 0.3 * unit}
        if law == "friction":
            laws[f"rub{q}"] = {
                "relation": f"h{q} >= 0", "restitution": 0, "friction": 0.03,
                "slip": f"{q}_dot",
            }  # fmt: skip
        place = text.replace("x", f"({q}/{unit})").replace("v", f"({q}_dot/{unit})")
        push[q] = f"{unit}*if({place}, {low}, {high})"
    heights = [f"h{q}" for q in conditions] if law == "friction" else []
    names = [*conditions, *heights]
    text = mechanical(
        " ".join(names), " + ".join(f"{q}_dot^2/2" for q in names),
        " + ".join(f"{10 * unit}*{h}" for h in heights) or "0", laws,
        dict.fromkeys(names, 0), forces=push, duration=1, output_step=0.125,
    )  # fmt: skip
    found = run(read(text, "level.yaml"))
    assert not found.trajectory.events
    for q, text in conditions.items():
        force = low if text in HOLD else high
        column = "friction." if law == "friction" else "lambda_"
        expected = np.full(len(found["t"]), -force * unit)
        assert found[f"{column}rub{q}"] == pytest.approx(expected, rel=1e-12)
        assert np.max(np.abs(found[q])) < 1e-20


@pytest.mark.parametrize(("above", "at", "time"), [(1, 2, 0.25), (-1, 2, 1 / 6)])
def test_friction_that_holds_a_body_beside_a_condition_sticks_once(above, at, time):
    """A block of weight 10 with mu = 1/2 stops under 1 - 5 or -1 - 5, then bears 2.

    The force at rest is below the limit of friction: the law alone holds the block, and
    the condition on its velocity is no surface along which it slides.
    """
    found = run(f"""
coordinates: {{x: {{}}, y: {{}}}}
energy: {{kinetic: (x_dot^2 + y_dot^2)/2, potential: 10*y}}
forces: {{x: "if(x_dot > 0, {above}, {at})"}}
constraints:
  floor: {{relation: y >= 0, restitution: 0, friction: 0.5, slip: x_dot}}
initial: {{x: 0, y: 0, x_dot: 1}}
simulation: {{duration: 1, output_step: 0.125}}
""")
    [event] = found.trajectory.events
    assert (event.kind, event.constraint) == ("stick", "floor")
    assert event.time == pytest.approx(time, abs=1e-12)
    rest = found["t"] > time
    assert found["friction.floor"][rest] == pytest.approx(-at, abs=1e-12)
    assert found["x"][rest] == pytest.approx(time / 2, abs=1e-12)


def test_a_nested_switch_beside_a_law_has_its_value_at_its_level():
    # The inner condition is true at rest: 0.5 - 1.94*0.39 < t.
    found = run("""
coordinates: {x: {}}
definitions: {push: "if(0.5 + 1.94*if(not (x <= -2*x_dot), 0.29, -0.39) > t, 0.1, 0.3)"}
energy: {kinetic: 1.24*x_dot^2, potential: 0}
forces: {x: push}
constraints: {rub: {relation: x_dot = 0, limit: 0.5}}
initial: {x: 0}
simulation: {duration: 2, output_step: 0.125}
""")
    assert set(found["push"]) == {0.3}
    assert found["lambda_rub"] == pytest.approx(np.full(17, -0.3), rel=1e-12)


@pytest.mark.parametrize(
    "law",
    [
        "{relation: z_dot = 0, limit: 5}",
        "{relation: y >= 0, restitution: 0, friction: 0.9, slip: z_dot}",
    ],
)
def test_a_held_coordinate_rests_on_a_switch_without_rounding(law):
    # A push along x - 0.13 z that varies: z is held, and the solution for z'' is not
    # 0 but for rounding.
    found = run(
        f"""
coordinates: {{x: {{}}, y: {{}}, z: {{}}}}
definitions: {{d: floor(z_dot), s: sign(z), p: x - 0.13*z}}
states: {{w: {{rate: 0.3*floor(z_dot) + sign(z)}}}}
energy: {{kinetic: (x_dot^2 + y_dot^2)/2 + 0.8*z_dot^2, potential: 10*y}}
forces: {{p: -0.5*x_dot + 0.02*t*x}}
constraints: {{rub: {law}}}
initial: {{x: 0, x_dot: 1.5, y: 0, z: 0, w: 0}}
simulation: {{duration: 6, output_step: 0.15}}
"""
    )
    assert found.trajectory.outcome is Outcome.DONE
    for name in ("d", "s", "w", "z", "z_dot"):
        assert not np.any(found[name])
    assert not [e for e in found.trajectory.events if e.kind == "switch"]


# A force of -1 while x_dot > 0, else of 6.
JUMP = one_quick(
    "if(x_dot > 0, -1, 6)",
    "if(not (2*x_dot <= 0), -1, 6)",
    "6 - 7*heaviside(x_dot)",
    "2.5 - 3.5*sign(x_dot)",
    "if(x_dot > 0, -1, 5) + if(3*x_dot > 0, 0, 1)",
    "if(x_dot > 0, -1, 5) + if(abs(x_dot) - x_dot > 0, 1, if(x_dot > 0, 0, 1))",
)
HOLDING = {
    "limit": "{relation: x_dot = 0, limit: 5}",
    "limits": "{relation: x_dot = 0, limit: 2}, b: {relation: x_dot = 0, limit: 3}",
    "friction": "{relation: z >= 0, restitution: 0, friction: 0.5, slip: x_dot}",
}


@pytest.mark.parametrize("law", one_quick(*HOLDING))
@pytest.mark.parametrize("force", JUMP)
@pytest.mark.parametrize("scale", one_quick(1.0, 1e-3))
def test_a_law_beside_a_force_that_jumps_by_more_than_its_bound(force, law, scale):
    # Until v = 1 - 6 t + 4 t^2 = 0 the body slides; it rests while some mean of -1 and
    # 6, plus 8 t, is at most 5; from t = 3/4 on it slides by 8 (t - 3/4).
    found = run(f"""
coordinates: {{x: {{}}, z: {{}}}}
energy: {{kinetic: {scale}*(x_dot^2 + z_dot^2)/2, potential: {scale}*10*z}}
definitions: {{jump: "{scale}*({force})", ramp: "{scale}*8*t"}}
forces: {{x: jump + ramp, z: "{0 if law == "friction" else 10 * scale}"}}
constraints: {{law: {HOLDING[law].replace("limit: ", f"limit: {scale}*")}}}
initial: {{x: 0, x_dot: 1, z: 0}}
simulation: {{duration: 1, output_step: 0.025}}
""")
    stop = (6.0 - np.sqrt(20.0)) / 8.0
    far = stop - 3.0 * stop**2 + 4.0 / 3.0 * stop**3
    t, rests = found["t"], (found["t"] > stop) & (found["t"] <= 0.75)
    x = np.where(rests, far, t - 3.0 * t**2 + 4.0 / 3.0 * t**3)
    x = np.where(t > 0.75, far + 4.0 / 3.0 * (t - 0.75) ** 3, x)
    assert found["x"] == pytest.approx(x, abs=1e-11)
    jump, held = found["jump"][rests] / scale, found["Qc_x"][rests] / scale
    assert np.all((jump >= -1.0 - 1e-12) & (jump <= 6.0 + 1e-12))
    assert np.all(np.abs(held) <= 5.0 + 1e-12)
    assert held == pytest.approx(-jump - 8.0 * t[rests], abs=1e-12)
    assert found["x_ddot"][rests] == pytest.approx(0.0, abs=1e-12)
    gain = found["kinetic"] - scale / 2.0 - found["work"]
    assert gain == pytest.approx(0.0, abs=1e-10 * scale)
