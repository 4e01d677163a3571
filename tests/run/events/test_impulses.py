"""Impulses at events: momenta jump, constraints and contacts answer.

Expected values: maps and jumps by hand (momentum balances, A M^-1 A^T), closed forms of
the motion between events. `JUMP` bounds rounding of a single jump of numbers about 1.
"""

import math

import numpy as np
import pytest

import lagsim
from lagsim.errors import InputError
from lagsim.model.reader import read
from lagsim.run.session import open_case
from lagsim.studies.golden import new_golden
from tests.support import refused

JUMP = 1e-13
# Methods with error control, and the steps of the others: each moves a free body, and
# at its order an oscillator, between two events.
ADAPTIVE = ("dop853", "dopri5", "taylor", "radau")
FIXED = (
    "rk4", "euler", "midpoint", "gauss4", "generalized-alpha", "verlet", "kahan-li6",
    "kahan-li8", "rattle", "moreau",
)  # fmt: skip


def scene(
    events, *, coordinates="x: {}", initial="x: 0", kinetic="x_dot^2/2", potential="0",
    end=2.5, step=0.5, more="", settings="",
):  # fmt: skip
    return lagsim.load(
        f"coordinates: {{{coordinates}}}\n"
        f"energy: {{kinetic: {kinetic!r}, potential: {potential!r}}}\n"
        f"events: {{{events}}}\ninitial: {{{initial}}}\n"
        f"simulation: {{duration: {end}, output_step: {step}{settings}}}\n{more}\n"
    )


def run(*args, method="auto", **words):
    model = scene(*args, **words)
    options = {"step": 0.001} if method in FIXED else {}
    result = lagsim.simulate(model, method=method, error_bar="never", **options)
    assert result.complete, result.reason
    return result


def jumps(result):
    """Return the indices of the rows after jumps."""
    return np.flatnonzero(np.diff(result.t) == 0.0) + 1


PLANE = {
    "coordinates": "x: {}, y: {}",
    "initial": "x: 0, y: 0",
    "kinetic": "(x_dot^2 + y_dot^2)/2",
}


@pytest.mark.parametrize("method", [*ADAPTIVE, *FIXED])
def test_a_kicked_body_moves_by_its_map(method):
    result = run("tick: {every: 1, impulse: {x: 1 - x_dot/2}}", method=method)
    speeds = [1.0, 1.5, 1.75]
    assert result["x_dot"][jumps(result)] == pytest.approx(speeds, abs=JUMP)
    assert result["x"][-1] == pytest.approx(1.0 + 1.5 + 0.875, abs=1e-11)
    assert np.ptp(result["energy"] - result["work"]) < 1e-11
    assert [e.kind for e in result.events] == ["event"] * 3
    before, after = result["x_dot"][jumps(result) - 1], result["x_dot"][jumps(result)]
    brought = (1 - before / 2) * (before + after) / 2
    assert [e.energy for e in result.events] == pytest.approx(brought, abs=JUMP)


@pytest.mark.slow
@pytest.mark.parametrize("method", ["auto", "dop853", "rk4", "verlet", "kahan-li8"])
def test_a_kicked_rotor_follows_its_map(method):
    """The standard map at K = 0.6, 100 kicks; its motion from here is regular."""
    result = run(
        "kick: {every: 1, impulse: {q: 0.6*sin(q)}}", coordinates="q: {unit: rad}",
        initial="q: 2.5, q_dot: 0.2", kinetic="q_dot^2/2", end=100.5, step=1.0,
        method=method,
    )  # fmt: skip
    q, p, found = 2.5, 0.2, []
    for _ in range(101):
        p += 0.6 * math.sin(q)
        found.append((q, p))
        q += p
    rows = jumps(result)
    assert len(rows) == 101
    motion = np.transpose([result["q"][rows], result["q_dot"][rows]])
    assert motion == pytest.approx(np.array(found), abs=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("unit", [1.0, 1e3])
def test_an_escapement_has_the_amplitude_of_its_limit_cycle(unit):
    """A linear clock, kicked by J at each passage of 0, in m and in mm.

    From v after a kick the swing loses the factor r = exp(-d pi/w) to the next passage:
    v = r v + J/(m l^2).
    """
    length, c, J, m = 0.25 * unit, 0.4, 0.002 * unit**2, 0.5
    d, w0 = c / 2, math.sqrt(9.81 / 0.25)
    w = math.sqrt(w0**2 - d * d)
    kick = J / (m * length**2)
    v = kick / (1 - math.exp(-d * math.pi / w))
    inertia = m * length**2
    result = run(
        f"tick: {{at: q = 0, impulse: {{q: {J!r}*sign(q_dot)}}}}", coordinates="q: {}",
        initial=f"q: 0, q_dot: {v!r}", kinetic=f"{inertia!r}*q_dot^2/2",
        potential=f"{inertia * w0**2!r}*q^2/2", end=40 * math.pi / w + 0.1, step=0.1,
        more=f"forces: {{q: -{c * inertia!r}*q_dot}}",
    )  # fmt: skip
    speeds = np.abs(result["q_dot"][jumps(result)])
    assert len(speeds) == 40
    assert speeds == pytest.approx(v, rel=1e-10)
    found = np.array([e.time for e in result.events])
    assert found == pytest.approx(np.arange(1, 41) * math.pi / w, abs=1e-10)
    size = inertia * v**2
    assert np.ptp(result["energy"] - result["work"]) < 1e-10 * size


def test_events_of_one_instant_add_up_and_see_the_velocity_before():
    result = run(
        "a: {every: 1, impulse: {x: 1 + x_dot}}, b: {every: 1, impulse: {x: 2*x_dot}}"
    )
    speeds = [1.0, 5.0, 21.0]
    assert result["x_dot"][jumps(result)] == pytest.approx(speeds, abs=JUMP)
    assert (np.bincount(np.unique(result.t, return_inverse=True)[1]) <= 2).all()
    assert result.at(1.0)["x_dot"] == pytest.approx(5.0, abs=JUMP)


@pytest.mark.parametrize("method", ADAPTIVE)
def test_an_event_at_a_single_time_compares_it_with_a_mode(method):
    """As the hint of `at: t >= 1` advises: x = 2 (t - 1) after the kick."""
    kick = "k: {at: t >= t1, impulse: {x: 2}}"
    found = lagsim.simulate(scene(kick, more="modes: {t1: 1}"), method=method)
    assert [(e.time, e.name) for e in found.events] == [(1.0, "k")]
    assert found["x"][-1] == pytest.approx(3.0, abs=JUMP)


def test_an_impulse_stands_beside_assignments():
    """Modes that earlier events set are seen, own ones are not; `n` notes v before."""
    result = run(
        "a: {every: 1, set: {m: m + 1}}, "
        "b: {every: 1, impulse: {x: m}, set: {m: m + 10, n: x_dot}}",
        more="modes: {m: 0, n: 9}\noutput: {columns: []}",
    )
    rows = jumps(result)
    assert result["x_dot"][rows] == pytest.approx([1.0, 13.0, 36.0], abs=JUMP)
    assert result["n"][rows] == pytest.approx([0.0, 1.0, 13.0], abs=JUMP)
    assert result["m"][rows] == pytest.approx([11.0, 22.0, 33.0], abs=JUMP)


def test_a_velocity_that_a_kick_reaches_makes_its_event_act_at_once():
    result = run(
        "fast: {at: x_dot >= 2, impulse: {x: 3*x_dot}}, tick: {every: 1, "
        "impulse: {x: 1}}, far: {at: x_dot >= 8.5, set: {m: 1}}",
        more="modes: {m: 0}",
    )
    rows = jumps(result)
    assert result["x_dot"][rows] == pytest.approx([1.0, 8.0, 9.0], abs=JUMP)
    assert result["m"][rows].tolist() == [0.0, 0.0, 1.0]
    names = [(e.time, e.name) for e in result.events]
    assert names == [
        (0.0, "tick"), (1.0, "tick"), (1.0, "fast"), (2.0, "tick"), (2.0, "far"),
    ]  # fmt: skip


@pytest.mark.parametrize("level", [1, 2])
def test_until_ends_where_a_kick_makes_it_true(level):
    words = {"settings": f", until: x_dot >= {level}"}
    result = run("tick: {every: 1, impulse: {x: 1}}", **words)
    assert result.outcome == "until"
    assert result.t[-1] == level - 1.0
    assert result["x_dot"][-1] == level


@pytest.mark.parametrize(
    ("events", "names"),
    [
        ("a: {at: x_dot <= -1, impulse: {x: 2}}, b: {at: x_dot >= 1, impulse: {x: -2}}",
         "`b`, `a`"),
        ("a: {at: x_dot + m >= 1, impulse: {x: 1}, set: {m: m - 1}}", "`a`"),
    ],
)  # fmt: skip
def test_kicks_that_call_each_other_end_the_run(events, names):
    model = scene(f"{events}, c: {{every: 1, impulse: {{x: 1}}}}", more="modes: {m: 0}")
    result = lagsim.simulate(model, error_bar="never")
    assert result.record["failure"]["number"] == "E512"
    assert names in result.reason


@pytest.mark.parametrize("method", ["auto", "radau", "taylor", "rk4", "gauss4"])
@pytest.mark.parametrize("reverse", [False, True])
@pytest.mark.parametrize(
    ("place", "end"), [("x >= 1", 1.0), ("-x <= -1", 1.0), ("x = 1", 2.5)]
)
def test_kicks_that_turn_a_motion_to_and_fro_at_a_place(place, end, reverse, method):
    """With x = 1 and falling, `x >= 1` is false: the second kick makes it true again.

    `x = 1` becomes true once, since x does not leave 1.
    """
    kicks = [
        f"u: {{at: {place}, impulse: {{x: -2}}}}",
        "d: {at: x_dot <= -0.5, impulse: {x: 2}}",
    ]
    text = scene(", ".join(kicks[::-1] if reverse else kicks), initial="x: 0, x_dot: 1")
    step = {"step": 0.13} if method in FIXED else {}
    result = lagsim.simulate(text, method=method, error_bar="never", **step)
    assert [(e.name, e.time) for e in result.events] == [("u", 1.0), ("d", 1.0)]
    assert result.t[-1] == end
    assert result.complete == (end > 1.0)
    if not result.complete:
        assert result.record["failure"]["number"] == "E512"
        assert "`u`, `d`" in result.reason


ROD = "constraints: {rod: x^2 + y^2 = 1}"


@pytest.mark.slow
@pytest.mark.parametrize("method", ["dop853", "radau", "rk4", "rattle", "moreau"])
def test_a_cartesian_pendulum_is_kicked_as_its_angle(method):
    bound = 1e-5 if method in ("rattle", "moreau") else 1e-10  # of their order 2
    kicks = "tick: {every: 0.7, impulse: {x: 0.3, y: -0.2}}"
    words = {"end": 1.5, "step": 0.1, "potential": "9.81*y"}
    cartesian = run(
        kicks, **PLANE | words | {"initial": "x: sin(0.5), y: -cos(0.5)"}, more=ROD,
        method=method,
    )  # fmt: skip
    polar = run(
        kicks, coordinates="q: {}", initial="q: 0.5", kinetic="q_dot^2/2", **words,
        more="definitions: {x: sin(q), y: -cos(q)}",
    )  # fmt: skip
    assert cartesian["x"] == pytest.approx(polar["x"], abs=bound)
    for k in jumps(cartesian):
        n = np.array([cartesian["x"][k], cartesian["y"][k]])
        # Of g = x^2 + y^2 - 1 the row is 2 n, with |n| = 1.
        given = -(n @ [0.3, -0.2]) / 2
        assert cartesian["impulse.rod"][k] == pytest.approx(given, abs=bound)
    others = np.delete(cartesian["impulse.rod"], jumps(cartesian))
    assert not others.any()


@pytest.mark.parametrize("formulation", ["auto", "full", "elimination", "baumgarte"])
def test_a_kick_of_a_constrained_body_by_hand(formulation):
    """Masses 1, 3, 2 of x, z = 2 x + t/10, w = 3 z: (1 + 12 + 72) dx = 2 (1 + 1.5)."""
    result = run(
        "tick: {every: 1, impulse: {z: 1, w: 0.5}}", coordinates="x: {}, z: {}, w: {}",
        kinetic="(x_dot^2 + 3*z_dot^2 + 2*w_dot^2)/2",
        initial="x: 0, z: 0, w: 0, z_dot: 0.1, w_dot: 0.3",
        settings=f", formulation: {formulation}",
        more="constraints: {gear: z = 2*x + t/10, bar: w = 3*z}",
    )  # fmt: skip
    rows, dx = jumps(result), 2 * 2.5 / 85
    bound = 1e-9 if formulation == "baumgarte" else 1e-12
    assert result["x_dot"][rows] == pytest.approx(dx * np.arange(1, 4), abs=bound)
    assert result["w_dot"][rows] == pytest.approx(6 * dx * np.arange(1, 4) + 0.3)
    # x: dx = -2 L_gear; w: 2*6 dx = 0.5 + L_bar.
    assert result["impulse.gear"][rows] == pytest.approx(-dx / 2, abs=bound)
    assert result["impulse.bar"][rows] == pytest.approx(12 * dx - 0.5, abs=bound)
    assert np.ptp(result["energy"] - result["work"]) < 1e-11


@pytest.mark.slow
def test_a_kick_at_the_speed_of_light():
    """The momentum of L = -sqrt(1 - v^2), v/sqrt(1 - v^2), rises by 3 at each kick."""
    model = lagsim.load(
        "coordinates: {x: {}}\nenergy: {lagrangian: -sqrt(1 - x_dot^2)}\n"
        "events: {tick: {every: 1, impulse: {x: 3}}}\ninitial: {x: 0}\n"
        "simulation: {duration: 2.5, output_step: 0.5}\n"
    )
    result = lagsim.simulate(model, error_bar="never")
    v = result["x_dot"][jumps(result)]
    assert v / np.sqrt(1 - v * v) == pytest.approx([3.0, 6.0, 9.0], rel=1e-11)


@pytest.mark.slow
def test_a_kick_turns_a_velocity_of_given_size():
    """A force P along x turns v of size c by c m q' = -P sin(q): tan(q/2) falls."""
    result = run(
        "tick: {every: 1, impulse: {x: 0.7}}", **PLANE | {
            "initial": "x: 0, y: 0, x_dot: 0.1, y_dot: {guess: 1}"},
        more="constraints: {speed: x_dot^2 + y_dot^2 = 1.44}",
    )  # fmt: skip
    half = np.tan(np.arctan2(result["y_dot"], result["x_dot"]) / 2)
    fallen = np.exp(-0.7 / 1.2 * np.arange(4))
    found = [half[0], *half[jumps(result)]]
    assert found == pytest.approx(half[0] * fallen, rel=1e-11)


# A body of mass 2 at rest on a floor.
GROUND = {
    **PLANE, "kinetic": "x_dot^2 + y_dot^2", "potential": "2*9.81*y", "step": 0.05,
    "end": 0.1,
}  # fmt: skip


@pytest.mark.parametrize("mu", [0.0, 0.3, 0.8])
@pytest.mark.parametrize(("e", "down"), [(0.0, 2.0), (0.5, 2.0), (0.5, 0.0)])
def test_a_kick_of_a_body_on_a_floor(mu, e, down):
    """The floor gives (1 + e) times the impulse towards it, friction up to mu of it."""
    result = run(
        f"tick: {{every: 7, impulse: {{x: 3, y: -{down}}}}}", **GROUND,
        more=f"constraints: {{floor: {{relation: y >= 0, restitution: {e}, "
        f"friction: {mu}, slip: x_dot}}}}",
    )  # fmt: skip
    [k] = jumps(result)
    along = max(0.0, 3.0 - mu * (1 + e) * down)
    assert result["x_dot"][k] == pytest.approx(along / 2, abs=JUMP)
    assert result["y_dot"][k] == pytest.approx(e * down / 2, abs=JUMP)
    assert result["impulse.floor"][k] == pytest.approx((1 + e) * down, abs=JUMP)
    assert np.ptp(result["energy"] - result["work"]) < 1e-11


@pytest.mark.parametrize(
    "brake", ["limit: 2", "limit: {static: 3, dynamic: 2}", "force"]
)
@pytest.mark.parametrize("far", [0.0, 1e5])
def test_a_kick_breaks_friction_loose(brake, far):
    """No impulse of friction: a speed of 1 stops by 2 within 0.25."""
    more = f"constraints: {{brake: {{relation: x_dot = 0, {brake}}}}}"
    if brake == "force":
        more = "forces: {x: -2*sign(x_dot)}"
    result = run(
        "tick: {every: 1, impulse: {x: 1}}", initial=f"x: {far}", step=0.125, more=more
    )
    t = result.t
    s = np.minimum(np.mod(t, 1.0), 0.5)
    x = far + 0.25 * np.floor(t) + s - s * s
    assert result["x"] == pytest.approx(x, abs=1e-10 + 1e-14 * far)


HELD = {
    "floor": ("{relation: y >= 0, restitution: 0}", 2 * 9.81, "y"),
    "brake": ("{relation: x_dot = 0, limit: 5}", -1.5, "x"),
    "switch": (None, 1.5, "x"),
}


@pytest.mark.parametrize("held", HELD)
def test_a_kick_at_the_start_has_the_forces_at_rest_in_the_row_before(held):
    # Mass 2; at rest under its weight, and held in x against a force of 1.5.
    relation, force, way = HELD[held]
    friction = " - 4*sign(x_dot)" if held == "switch" else ""
    more = f"forces: {{x: 1.5{friction}}}\n"
    if relation is not None:
        more += f"constraints: {{c: {relation}}}\n"
    result = run(
        "k: {every: 10, impulse: {x: 0.5, y: 3}}", coordinates="x: {}, y: {}",
        initial="x: 0, y: 0", kinetic="x_dot^2 + y_dot^2", potential="2*9.81*y",
        end=0.1, step=0.05, more=more,
    )  # fmt: skip
    assert result.t[:2] == pytest.approx([0.0, 0.0])
    assert result[f"{way}_dot"][0] == 0.0
    assert result[f"{way}_ddot"][0] == pytest.approx(0.0, abs=JUMP)
    if relation is not None:
        assert result["lambda_c"][0] == pytest.approx(force)
    # The kick: 0.5/2 in x and 3/2 in y, but the brake's limit has no impulse.
    kicked = {"x": 0.25, "y": 1.5}
    assert result[f"{way}_dot"][1] == pytest.approx(kicked[way], abs=JUMP)


def test_a_freewheel_answers_and_a_latch_holds():
    result = run(
        "a: {every: 1, impulse: {x: 1, y: 2}}, b: {every: 2, impulse: {x: -3}}",
        **PLANE, more="constraints: {wheel: x_dot >= 0, "
        "latch: {relation: y = 0, when: t < 1.5}}",
    )  # fmt: skip
    rows = jumps(result)
    assert result["x_dot"][rows] == pytest.approx([0.0, 1.0, 0.0], abs=JUMP)
    assert result["impulse.wheel"][rows] == pytest.approx([2.0, 0.0, 1.0], abs=JUMP)
    assert result["y_dot"][rows] == pytest.approx([0.0, 0.0, 2.0], abs=JUMP)
    assert result["impulse.latch"][rows] == pytest.approx([-2.0, -2.0, 0.0], abs=JUMP)


def test_a_constraint_that_the_event_puts_into_force_answers_too():
    result = run(
        "grip: {every: 1, set: {held: if(t >= 1, 1, 0)}, impulse: {x: 1}}",
        initial="x: 0, x_dot: 0.5",
        more="modes: {held: 0}\n"
        "constraints: {hand: {relation: x_dot = 0.25, when: held > 0}}",
    )
    rows = jumps(result)
    assert result["x_dot"][rows] == pytest.approx([1.5, 0.25, 0.25], abs=JUMP)
    assert result["impulse.hand"][rows] == pytest.approx([0.0, -2.25, -1.0], abs=JUMP)
    assert len(rows) == 3


def test_a_massless_coordinate_passes_a_kick_on_or_refuses_it():
    words = {
        "coordinates": "x: {}, z: {}", "initial": "x: 0, z: 0", "kinetic": "x_dot^2/2",
    }  # fmt: skip
    kick = "tick: {every: 1, impulse: {z: 1}}"
    result = run(kick, **words, more="constraints: {bar: z = x}")
    assert result["x_dot"][jumps(result)] == pytest.approx([1, 2, 3], abs=JUMP)
    slider = "constraints: {pad: {relation: z_dot = 0, limit: 1}}"
    with refused("no-inertia", "`tick`", "`z`"):
        run(kick, **words, potential="50*(x - z)^2", more=slider)


@pytest.mark.slow
def test_families_and_vectors_are_kicked_by_members_and_components():
    model = lagsim.load(
        "parameters: {n: 3, m(i = 1..n): i}\n"
        "coordinates: {r(1..n): {components: xy}}\n"
        "definitions: {middle: (r(1) + r(3))/2}\n"
        "energy: {kinetic: 'sum(i = 1..n, m(i)*dot(r_dot(i), r_dot(i))/2)', "
        "potential: 0}\n"
        "events:\n"
        "  e(i = 1..n): {every: i, impulse: {r(i): 'vec(i, 0.5)'}}\n"
        "  all: {every: 9, impulse: {r(i = 1..n).y: m(i), middle: [1, 0]}}\n"
        "initial: {r(1..n): 'vec(0, 0)'}\n"
        "simulation: {duration: 2.5, output_step: 0.5}\n"
    )
    result = lagsim.simulate(model, error_bar="never")
    ends = {
        "r_dot.1.x": 3 + 0.5, "r_dot.1.y": 1.5 + 1, "r_dot.2.x": 2.0,
        "r_dot.2.y": 0.5 + 1, "r_dot.3.x": 1 + 0.5 / 3, "r_dot.3.y": 0.5 / 3 + 1,
    }  # fmt: skip
    for name, value in ends.items():
        assert result[name][-1] == pytest.approx(value, abs=JUMP), name


@pytest.mark.parametrize(
    "frame", ["angles", pytest.param("quaternion", marks=pytest.mark.slow)]
)
def test_a_kick_along_an_angular_velocity(frame):
    """Principal inertias 1, 2, 3: the components of omega rise by J/inertia."""
    names = (
        "p: {}, a: {}, b: {}, c: {}" if frame == "quaternion" else "a: {}, b: {}, c: {}"
    )
    top = "{quaternion: [p, a, b, c]}"
    start = "p: 1, a: 0, b: 0, c: 0"
    if frame == "angles":
        top, start = "{angles: [a, b, c], axes: zxz}", "a: 0.3, b: 1, c: 0.2"
    model = lagsim.load(
        f"coordinates: {{{names}}}\nframes: {{top: {top}}}\n"
        "definitions: {w: omega(top)}\n"
        "energy: {kinetic: 'spin(vec(1, 2, 3), w)', potential: 0}\n"
        "events: {e: {every: 1, impulse: {w: [0.1, 0.2, 0.3]}}}\n"
        f"initial: {{{start}, w: [0.1, 0.2, 0.3]}}\n"
        "simulation: {duration: 1.5, output_step: 0.5}\n"
    )
    result = lagsim.simulate(model, error_bar="never")
    for k in jumps(result):
        for x in ("w.x", "w.y", "w.z"):
            jump = result[x][k] - result[x][k - 1]
            assert jump == pytest.approx(0.1, abs=1e-12)


@pytest.mark.slow
def test_sections_show_the_state_after_a_kick():
    result = run(
        "tick: {every: 1, impulse: {x: 1}}", initial="x: 0, x_dot: -1.5",
        more="output: {sections: {turn: {at: x_dot = 0, direction: up}}}",
    )  # fmt: skip
    assert result.sections["turn"]["t"] == pytest.approx([1.0])
    assert result.sections["turn"]["x_dot"] == pytest.approx([0.5])


@pytest.mark.slow
def test_sensitivities_pass_kicks():
    """Momentum of x = J (1 + ... ): d x/d J is the sum of the times since the kicks."""
    result = run(
        "tick: {every: 1, impulse: {x: J}}",
        more="parameters: {J: 0.5}\noutput: {sensitivities: [J]}",
    )
    d = result["d.x.J"]
    assert np.isnan(d[jumps(result)]).all()
    assert d[-1] == pytest.approx(2.5 + 1.5 + 0.5, abs=1e-9)


def test_a_repeat_confirms_a_run_with_kicks():
    model = scene(
        "tick: {at: q >= 0.1, impulse: {q: 0.02}}", coordinates="q: {}",
        initial="q: 0.3", kinetic="q_dot^2/2", potential="-9.81*cos(q)", end=5.0,
    )  # fmt: skip
    result = lagsim.simulate(model)
    assert not isinstance(result.record["error"], str)
    assert result.record["error"]["relative"] < 1e-9
    assert not result.warnings


def test_an_impulse_without_a_value_ends_the_run_with_its_event():
    model = scene(
        "tick: {at: x >= 0.5, impulse: {x: log(-x)}}", initial="x: 0, x_dot: 1"
    )
    result = lagsim.simulate(model, error_bar="never")
    assert result.record["failure"]["number"] == "E503"
    assert "`tick`" in result.reason
    assert result.t[-1] == pytest.approx(0.5)


@pytest.mark.slow
def test_a_kick_does_not_depend_on_bodies_that_nothing_joins():
    """Beside masses of 1e-20 and 1e20, held by rows of their own."""
    words = {
        "coordinates": "x: {}, a: {}, b: {}, c: {}",
        "kinetic": "(x_dot^2 + 1e20*a_dot^2 + 1e20*b_dot^2 + 1e-20*c_dot^2)/2",
        "initial": "x: 0, a: 0, b: 0, c: 0",
        "more": "constraints: {bar: a = 2*b}",
    }
    result = run("tick: {every: 1, impulse: {x: 1, c: 1e-20, a: 1e20}}", **words)
    rows = jumps(result)
    for name, jump in (("x", 1.0), ("c", 1.0), ("a", 0.8), ("b", 0.4)):
        speeds = jump * np.arange(1, 4)
        assert result[f"{name}_dot"][rows] == pytest.approx(speeds, rel=JUMP), name


@pytest.mark.parametrize(
    ("impulse", "code", "name"),
    [
        ("{v: 1}", "unknown-name", "`v`"),
        ("{x_dot: 1}", "not-a-direction", "`x_dot`"),
        ("{J: 1}", "not-a-direction", "`J`"),
        ("{x: x_ddot}", "output-only", "`x_ddot`"),
        ("{}", "missing-key", "`tick`"),
        ("{x: [1, 2]}", "not-an-expression", "`x`"),
    ],
)
def test_faults_of_impulses_have_a_place(impulse, code, name):
    with refused(code, name, kind=InputError) as caught:
        scene(f"tick: {{every: 1, impulse: {impulse}}}", more="parameters: {J: 2}")
    assert caught.value.problems[0].place is not None


@pytest.mark.parametrize("name", ["x", "x_dot"])
def test_a_velocity_that_is_set_has_an_impulse_as_advice(name):
    with refused("not-a-mode", f"`{name}`", "impulse", kind=InputError):
        scene(f"tick: {{every: 1, set: {{{name}: 1}}}}")


def test_units_of_impulses_are_checked():
    model = lagsim.load(
        "coordinates: {x: {unit: m}, q: {unit: rad}}\n"
        "parameters: {m: {value: 1, unit: kg}, J: {value: 1, unit: N*s}, "
        "F: {value: 1, unit: N}, I: {value: 1, unit: kg*m^2}}\n"
        "energy: {kinetic: m*x_dot^2/2 + I*q_dot^2/2, potential: 0}\n"
        "events: {a: {every: 1, impulse: {x: J, q: I*q_dot}}, "
        "b: {every: 1, impulse: {x: F, q: J}}}\n"
        "initial: {x: 0, q: 0}\nsimulation: {duration: 1}\n"
    )
    found = [w["text"] for w in lagsim.check(model).warnings]
    assert len(found) == 2, found
    assert "the impulse on `x` by the event `b` is in N here" in found[0]
    assert "the impulse on `q` by the event `b` is in N*s here" in found[1]


@pytest.mark.slow
def test_a_golden_has_the_kicks_at_the_start():
    """Variants of a golden, at perturbed values, begin with an equal impulse."""
    text = (
        "coordinates: {x: {}}\nenergy: {kinetic: x_dot^2/2, potential: 0}\n"
        "events: {tick: {every: 0.62, impulse: {x: 1 + x_dot}}}\n"
        "initial: {x: 0.1, x_dot: 0.5}\n"
        "simulation: {duration: 2, output_step: 0.05}\n"
    )
    golden, _ = new_golden(open_case(read(text, "kicks.yaml")))
    first = dict(zip(golden.columns, golden.rows[:2].T, strict=True))
    assert first["x_dot"].tolist() == [0.5, 2.0]
    assert first["t"].tolist() == [0.0, 0.0]
    # A variant without the kick at the start would differ by 1.5.
    assert golden.bounds("x_dot").max() < 1e-9
