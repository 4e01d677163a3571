"""Kinks in equalities and gaps: grooves, ridges, wires with corners, and rest there.

Closed forms: a bead on a wire y = k*abs(x) slides with g k/(1 + k^2) along x towards
the corner; there its velocity is projected onto the other side, (1 - k^2)/(1 + k^2) of
it along x. So passages shrink by that factor, and end after finite time where k < 1.
Grooves are compared with the relations that they are the least of, each a contact.
"""

import itertools

import numpy as np
import pytest
import yaml

import lagsim
from tests.scenes.contact.motions import G

STEP = 0.02
# Other methods need kernels that no other quick test has compiled.
SLOW = [pytest.param(x, marks=pytest.mark.slow) for x in ("radau", "rk4", "dopri5")]
# The table of abs(x)/2.
V = "tables: {v: {points: [[-1, 0.5], [0, 0], [1, 0.5]], outside: extend}}"


def simulated(text, **options):
    return lagsim.simulate(lagsim.load(text), error_bar="never", **options)


def wire(relation="y = k*abs(x)", k=0.5, **changes):
    """Return the model of a bead on a wire, in other units, and shifted by X."""
    c = {
        "x": 1.0,
        "length": 1.0,
        "time": 1.0,
        "X": 0.0,
        "end": 4.0,
        "more": "",
    } | changes
    length, time, X = c["length"], c["time"], c["X"]
    y = c.get("y", k * abs(c["x"]))
    return f"""
    parameters: {{k: {k!r}, X: {X!r}, g: {G * length / time**2!r}}}
    {V if "v(" in relation else ""}
    coordinates: {{x: {{}}, y: {{}}}}
    energy: {{kinetic: (x_dot^2 + y_dot^2)/2, potential: g*y}}
    constraints: {{wire: "{relation}"}}
    initial: {{x: {X!r} + {c["x"] * length!r}, y: {y * length!r}{c.get("start", "")}}}
    simulation: {{duration: {c["end"] * time!r}, output_step: {STEP * time!r}}}
    {c["more"]}
    """


def passages(k, x, count):
    """Return the times of passages of the corner from rest at x, and speeds before."""
    a, r = G * k / (1 + k * k), (1 - k * k) / (1 + k * k)
    speeds = [np.sqrt(2 * a * abs(x)) * r**i for i in range(count)]
    first = [speeds[0] / a, *(2 * v / a for v in speeds[1:])]
    return list(itertools.accumulate(first)), speeds


def bead(t, k, x):
    """Return x (rows,) of a bead on y = k*abs(x) that is released at x."""
    a = G * k / (1 + k * k)
    times, speeds = passages(k, x, 60)
    found, side = np.where(t < times[0], abs(x) - a * t**2 / 2, 0.0), np.sign(x)
    found *= side
    for at, end, v in zip(times, times[1:], speeds[1:], strict=False):
        side = -side
        here = (t >= at) & (t < end)
        found[here] = side * (v * (t[here] - at) - a * (t[here] - at) ** 2 / 2)
    return found


SPELLINGS = (
    "y = k*abs(x)", "k*abs(x) - y = 0", "y = k*sqrt(x^2)", "y = k*hypot(x, 0)",
    "y = max(k*x, -k*x)", "y = -min(k*x, -k*x)", "y = if(x > 0, k*x, -k*x)",
    "y = if(x < 0, -k*x, k*x)", "y = (k*x + sqrt(x^2)*2*k - k*x)/2",
    # The kink is where mod jumps, and the argument of abs, min or if with it.
    "y = k*(2 - abs(mod(x, 4) - 2))", "y = k*min(mod(x, 4), 4 - mod(x, 4))",
    "y = k*if(mod(x, 4) < 2, mod(x, 4), 4 - mod(x, 4))",
    # Products of a step and a factor that is 0 there.
    "y = k*(x/3)*sign(x/3)*3", "y = k*x*(2*heaviside(x) - 1)",
    # Several kinks at one place, of which one is located.
    "y = k*(4*v(x) - 2*v(-abs(x)))", "y = 4*k*v(x) - k*abs(x)", "y = 2*k*v(x)",
)  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("relation", SPELLINGS)
def test_a_bead_passes_the_corner_ever_shorter_and_rests(relation):
    found = simulated(wire(relation))
    assert found.complete
    assert found["x"] == pytest.approx(bead(found.t, 0.5, 1.0), abs=1e-9)
    assert found["y"] == pytest.approx(0.5 * np.abs(found["x"]), abs=1e-12)
    corners = [e for e in found.events if e.kind == "corner"]
    times, speeds = passages(0.5, 1.0, len(corners))
    assert len(corners) > 10
    assert [e.time for e in corners] == pytest.approx(times, abs=1e-9)
    # Of (1 + k^2) v^2/2 the part 1 - r^2 is lost.
    lost = [-1.25 * v * v / 2 * (1 - 0.36) for v in speeds]
    assert [e.energy for e in corners] == pytest.approx(lost, rel=1e-8, abs=1e-12)
    assert {e.constraint for e in corners} == {"wire"}
    (end,) = [e.time for e in found.events if e.kind == "zeno"]
    assert end == pytest.approx(passages(0.5, 1.0, 60)[0][-1], abs=1e-8)
    rest = found.t > end
    assert np.max(np.abs(found["x_dot"][rest])) < 1e-9
    assert np.abs(found["lambda_wire"][rest]) == pytest.approx(G, rel=1e-9)
    assert found["Qc_x"][rest] == pytest.approx(0.0, abs=1e-9)
    assert found["energy"] - found["work"] == pytest.approx(G / 2, rel=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("method", ["taylor", *SLOW[:2]])
def test_by_other_methods(method):
    options = {"step": 0.005} if method == "rk4" else {}
    found = simulated(wire(), method=method, **options)
    assert found["x"] == pytest.approx(bead(found.t, 0.5, 1.0), abs=1e-8)


ELSEWHERE = {
    "millimetres": {"length": 1e3},
    "years": {"time": 1 / 3.15e7},
    "far": {"X": 1e3},
}


@pytest.mark.slow
@pytest.mark.parametrize("method", ["taylor", SLOW[2]])
def test_a_pole_of_the_relation_beyond_the_corner_has_no_effect(method):
    # Beyond x = 0 the side of x > 0 has a pole at x = -1/k, which a step passes before
    # the corner is located in it: its rates there are no magnitudes of the motion.
    text = wire("y/(1 + k*abs(x)) = 1", y=1.5)
    found = simulated(text, method=method)
    assert found.complete
    assert found["x"] == pytest.approx(bead(found.t, 0.5, 1.0), abs=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("where", ELSEWHERE)
def test_elsewhere(where):
    c = {"length": 1.0, "time": 1.0, "X": 0.0} | ELSEWHERE[where]
    found = simulated(wire("y = k*abs(x - X)", **c))
    x = (found["x"] - c["X"]) / c["length"]
    assert x == pytest.approx(bead(found.t / c["time"], 0.5, 1.0), abs=3e-7)


@pytest.mark.slow
def test_beside_a_heavy_body():
    text = (
        wire()
        .replace("y: {}}", "y: {}, z: {}}")
        .replace("y_dot^2)/2", "y_dot^2)/2 + 1e9*z_dot^2/2")
    )
    text = text.replace("g*y}", "g*y + 1e9*z^2}").replace(
        "initial: {", "initial: {z: 3, "
    )
    found = simulated(text)
    assert found["x"] == pytest.approx(bead(found.t, 0.5, 1.0), abs=1e-9)
    assert found["z"] == pytest.approx(3 * np.cos(np.sqrt(2) * found.t), abs=1e-8)


@pytest.mark.parametrize("k", [1.0, 1.5, 3.0])
def test_a_steep_corner_stops_at_once(k):
    found = simulated(wire(k=k, end=1.5))
    (corner,) = [e for e in found.events if e.kind == "corner"]
    end = np.sqrt(2 * (1 + k * k) / (G * k))
    assert corner.time == pytest.approx(end, rel=1e-9)
    assert corner.energy == pytest.approx(-G * k, rel=1e-9)
    rest = found.t > end
    assert np.max(np.abs(found["x"][rest])) < 1e-12


def test_rest_in_the_corner_ends_where_one_side_leads_away():
    # On the right side x'' (1 + k^2) = F - g k: it leaves where F = 3 t is g k.
    found = simulated(wire(x=0.0, more="forces: {x: 3*t}", end=3.0))
    end = G * 0.5 / 3
    s = np.maximum(found.t - end, 0.0)
    assert found["x"] == pytest.approx(3 * s**3 / 6 / 1.25, abs=1e-9)
    held = found.t < end
    assert found["Qc_x"][held] == pytest.approx(-3 * found.t[held], abs=1e-9)


def test_a_start_in_the_corner_with_a_speed_is_projected():
    found = simulated(wire(x=0.0, start=", x_dot: 1", end=0.2))
    first = next(e for e in found.events if e.kind == "corner")
    assert first.time == 0.0
    # Along the side (1, k): (1, 0).(1, k)/(1 + k^2) = 0.8.
    assert found["x_dot"][1] == pytest.approx(0.8, rel=1e-12)
    assert found["y_dot"][1] == pytest.approx(0.4, rel=1e-12)
    t = found.t
    assert found["x"] == pytest.approx(0.8 * t - G * 0.4 * t**2 / 2, abs=1e-9)


def test_rest_on_a_ridge_is_not_decided():
    found = simulated(wire("y = -k*abs(x)", x=0.0, y=0.0, end=0.5))
    assert "unresolved-switch" in [w.code for w in found.warnings]


@pytest.mark.slow
def test_a_yo_yo_turns_at_the_end_of_its_string():
    m, J, r, length = 0.05, 2e-5, 0.005, 0.8
    text = f"""
    coordinates: {{z: {{}}, phi: {{}}}}
    energy: {{kinetic: {m}*z_dot^2/2 + {J}*phi_dot^2/2, potential: {m}*{G}*z}}
    constraints: {{string: z = -{length} + {r}*abs(phi)}}
    initial: {{phi: {-length / r}, z: 0}}
    simulation: {{duration: 30, output_step: 0.1}}
    """
    found = simulated(text)
    a = m * G / (m + J / r**2)
    part = (J / r**2 - m) / (J / r**2 + m)
    first = np.sqrt(2 * length / a)
    corners = [e.time for e in found.events if e.kind == "corner"]
    expected = [first, first * (1 + 2 * part), first * (1 + 2 * part + 2 * part**2)]
    assert corners[:3] == pytest.approx(expected, rel=1e-9)
    end = first * (1 + 2 * part / (1 - part))
    assert found.complete
    assert [e.time for e in found.events if e.kind == "zeno"] == pytest.approx(
        [end], rel=1e-8
    )
    rest = found.t > end
    assert found["z"][rest] == pytest.approx(-length, abs=1e-9)
    assert found["lambda_string"][rest] == pytest.approx(m * G, rel=1e-9)


FREEDOM = {
    "at rest in the corner": (wire(x=0.0), 0),
    "beside the corner": (wire(), 1),
    "on a ridge": (wire("y = -k*abs(x)", x=0.0), 1),
    "leaving": (wire(x=0.0, start=", x_dot: 1"), 1),
    "pulled away": (wire(x=0.0, more="forces: {x: 10}"), 1),
    "pulled, but held": (wire(x=0.0, more="forces: {x: 3}"), 0),
}


@pytest.mark.parametrize("start", FREEDOM)
def test_a_corner_that_holds_takes_a_degree_of_freedom(start):
    text, expected = FREEDOM[start]
    assert lagsim.check(lagsim.load(text)).degrees_of_freedom == expected


# --- Gaps


def ball(relations, x=0.7, y=1.0, v=0.0, end=1.5, law="restitution: e", **more):
    """Return the model of a ball above some relations, each a contact."""
    constraints = "".join(
        f'\n      c{k}: {{relation: "{text}", {law}}}'
        for k, text in enumerate(relations)
    )
    return f"""
    parameters: {{k: 0.5, e: 0.5}}
    coordinates: {{x: {{}}, y: {{}}}}
    energy: {{kinetic: (x_dot^2 + y_dot^2)/2, potential: {G}*y}}
    constraints: {constraints}
    initial: {{x: {x}, y: {y}, x_dot: {v}}}
    simulation: {{duration: {end}, output_step: 0.01}}
    {more.get("more", "")}
    """


TABLE = "tables: {h: {points: [[-2, 2], [-1, 0.5], [0, 0], [1, 0.4], [2, 2]]}}"
GROOVES = {
    "y >= k*abs(x)": ("y >= k*x", "y >= -k*x"),
    "k*sqrt(x^2) <= y": ("y >= k*x", "y >= -k*x"),
    "min(y - k*x, y + k*x) >= 0": ("y >= k*x", "y >= -k*x"),
    "y >= max(max(-x - 0.5, -0.1*x), 0.6*x)": (
        "y >= -x - 0.5", "y >= -0.1*x", "y >= 0.6*x",
    ),
    "y >= if(x > 0, k*x, -0.2*x)": ("y >= k*x", "y >= -0.2*x"),
    "y >= 0.5*abs(x) + 0.3*abs(x - 1)": (
        "y >= -0.8*x + 0.3", "y >= 0.2*x + 0.3", "y >= 0.8*x - 0.3",
    ),
    "y >= k*abs(x - 0.1*t)": ("y >= k*(x - 0.1*t)", "y >= -k*(x - 0.1*t)"),
    "y >= k*abs(sin(x))": ("y >= k*sin(x)", "y >= -k*sin(x)"),
    "y >= (1 + x^2)*abs(x)/2": ("y >= (1 + x^2)*x/2", "y >= -(1 + x^2)*x/2"),
    "y >= exp(k*abs(x)) - 1": ("y >= exp(k*x) - 1", "y >= exp(-k*x) - 1"),
    "y >= 2*x*k*sign(x/2)/2": ("y >= k*x", "y >= -k*x"),
    "y >= x*if(x < 0, -k, k)": ("y >= k*x", "y >= -k*x"),
    "y >= (1 + x^2)*x*(heaviside(x) - 1/2)": (
        "y >= (1 + x^2)*x/2", "y >= -(1 + x^2)*x/2",
    ),
    "y >= h(x)": ("y >= -1.5*x - 1", "y >= -0.5*x", "y >= 0.4*x", "y >= 1.6*x - 1.2"),
}  # fmt: skip
LAWS = (
    "restitution: e",
    "restitution: 0",
    "restitution: 0.3, friction: 0.2, slip: x_dot",
)


@pytest.mark.slow
@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("relation", GROOVES)
def test_a_groove_is_its_sides(relation, law):
    more = TABLE if "h(x)" in relation else ""
    for start in ({}, {"x": -0.4, "y": 0.9, "v": 0.3}):
        found = simulated(ball([relation], law=law, more=more, **start))
        other = simulated(ball(GROOVES[relation], law=law, **start))
        assert found.complete
        t = np.arange(0.0033, 1.5, 0.01)
        one, two = found.at(t), other.at(t)
        for name in ("x", "y", "x_dot", "y_dot"):
            assert one[name] == pytest.approx(two[name], abs=1e-6)
        parts = [two[f"lambda_c{k}"] for k in range(len(GROOVES[relation]))]
        assert one["lambda_c0"] == pytest.approx(sum(parts), abs=1e-6)
        assert np.min(found["residual_c0"]) > -1e-9


@pytest.mark.parametrize("groove", [
    "k*abs(x)", "1000*(k*(x/1000)*sign(x/1000))", "k*x*(2*heaviside(x/k) - 1)",
    "x*if(x > 0, k, -k)", "k*x*(heaviside(x) - heaviside(-x))",
])  # fmt: skip
def test_a_ball_comes_to_rest_in_a_groove(groove):
    found = simulated(
        ball([f"y >= {groove}"], x=0.1, y=0.2, law="restitution: 0", end=3.0)
    )
    assert found.complete
    rest = found.t > 2.5
    assert np.max(np.abs(found["x"][rest])) < 1e-9
    assert found["lambda_c0"][rest] == pytest.approx(G, rel=1e-9)
    assert found["Qc_y"][rest] == pytest.approx(G, rel=1e-9)
    assert found["residual_c0"][rest] == pytest.approx(0.0, abs=1e-12)


def test_a_ball_flies_off_a_ridge():
    # On the flat with 1 m/s, then free until 2 x = g t^2/2 on the slope.
    text = ball(
        ["y >= -2*max(x, 0)"], x=-0.5, y=0.0, v=1.0, end=0.8, law="restitution: 0"
    )
    found = simulated(text)
    t = found.t
    s = np.maximum(t - 0.5, 0.0)
    flies = s < 2 * 2 / G
    assert found["x"][flies] == pytest.approx(t[flies] - 0.5, abs=1e-9)
    assert found["y"][flies] == pytest.approx(-G * s[flies] ** 2 / 2, abs=1e-9)
    release = [e.time for e in found.events if e.kind == "release"]
    assert release == pytest.approx([0.5], abs=1e-9)


@pytest.mark.slow
def test_a_table_that_is_repeated_has_grooves_and_ridges():
    more = "tables: {h: {points: [[0, 0], [0.5, 0.3], [1, 0]], outside: repeat}}"
    sides = [f"0.3 - 0.6*abs(x - {k + 0.5})" for k in (-2, -1, 0, 1)]
    both = f"max(max({sides[0]}, {sides[1]}), max({sides[2]}, {sides[3]}))"
    start = {"x": 0.2, "v": 0.7}
    found = simulated(ball(["y >= h(x)"], more=more, **start))
    other = simulated(ball([f"y >= {both}"], **start))
    t = np.arange(0.0033, 1.5, 0.01)
    for name in ("x", "y", "x_dot", "y_dot"):
        one, two = found.at(t)[name], other.at(t)[name]
        assert one == pytest.approx(two, abs=1e-7)


@pytest.mark.slow
def test_a_corner_that_moves_takes_the_bead_along():
    # Seen from the wire, which moves with 0.2, the bead begins with that speed.
    start = ", x_dot: {guess: 0}, y_dot: {guess: 0}"
    found = simulated(wire("y = k*abs(x - 0.2*t)", start=start))
    assert found["energy"] - found["work"] == pytest.approx(
        found["energy"][0], abs=1e-9
    )
    rest = found.t > 3.0
    assert found["x"][rest] == pytest.approx(0.2 * found.t[rest], abs=1e-9)
    assert found["Qc_y"][rest] == pytest.approx(G, rel=1e-9)


def test_two_corners_of_one_wire_in_space():
    # z = |x|/2 - y/10: at rest across the valley, x = 0, it goes on along it.
    text = f"""
    coordinates: {{x: {{}}, y: {{}}, z: {{}}}}
    energy: {{kinetic: (x_dot^2 + y_dot^2 + z_dot^2)/2, potential: {G}*z}}
    constraints: {{c: z = abs(x)/2 - y/10}}
    initial: {{x: 0, y: 0, z: 0}}
    simulation: {{duration: 2, output_step: 0.02}}
    """
    found = simulated(text)
    # Down the line (0, 1, -1/10): y'' (1 + 1/100) = g/10.
    assert found["y"] == pytest.approx(G / 10 / 1.01 * found.t**2 / 2, abs=1e-9)
    assert found["x"] == pytest.approx(0.0, abs=1e-12)


@pytest.mark.slow
def test_the_sign_of_a_parameter_makes_a_groove_or_a_ridge():
    model = lagsim.load(
        ball(["y >= k*abs(x)"], x=0.0, y=0.0, v=0.1, end=0.3, law="restitution: 0")
    )
    ridge = lagsim.simulate(model.bind(k=-0.5), error_bar="never")
    groove = lagsim.simulate(model, error_bar="never")
    again = lagsim.simulate(model.bind(k=-0.5), error_bar="never")
    # Down the ridge, from the speed that is left along it.
    assert ridge["y"][-1] < -0.1
    assert np.array_equal(ridge["y"], again["y"])
    assert np.min(groove["y"]) > -1e-12


@pytest.mark.slow
def test_a_sweep_over_the_sign_has_the_ends_of_single_runs():
    words = {"x": 0.3, "y": 0.5, "end": 1.0}
    model = lagsim.load(ball(["y >= k*abs(x)"], **words))
    values = [-0.4, 0.3]
    swept = lagsim.sweep(model, {"k": values}, jobs=1)
    ends = [simulated_end(model.bind(k=k)) for k in values]
    assert swept["y.end"] == pytest.approx(ends, rel=1e-9)


def simulated_end(model):
    """Return the last y of a run."""
    return lagsim.simulate(model, error_bar="never")["y"][-1]


@pytest.mark.parametrize(
    ("relations", "instants"),
    [
        (["y = tl(abs(x))"], 1),
        (["y = tl(x) + abs(x)/4"], 1),
        (["y = abs(x)/4 + max(0, x)"], 1),
        (["y = abs(x)/4", "z = abs(x)/2"], 2),
    ],
)
def test_an_instant_has_one_corner_of_a_constraint_and_takes_its_energy_once(
    relations, instants
):
    names = "cd"[: len(relations)]
    constraints = dict(zip(names, relations, strict=True))
    document = {
        "coordinates": {"x": {}, "y": {}, "z": {}},
        "energy": {"kinetic": "(x_dot^2 + y_dot^2 + z_dot^2)/2", "potential": "y"},
        "tables": {
            "tl": {"points": [[-2, 1], [0, 0], [2, 1]], "interpolation": "linear"}
        },
        "constraints": constraints,
        "initial": {
            "x": -0.5, "x_dot": 2, "y": {"guess": 0.2}, "y_dot": {"guess": 0},
            "z": {"guess": 0.2}, "z_dot": {"guess": 0},
        },
        "simulation": {"duration": 0.3, "output_step": 0.1},
    }  # fmt: skip
    if "tl" not in relations[0]:
        del document["tables"]
    found = lagsim.simulate(yaml.safe_dump(document), error_bar="never")
    corners = [e for e in found.events if e.kind == "corner"]
    assert [e.constraint for e in corners] == [*names]
    assert len({e.time for e in corners}) == 1
    assert len(corners) == instants
    # Nothing but the corner changes the energy.
    lost = found["energy"][-1] - found["energy"][0]
    assert lost < -0.01
    assert sum(e.energy or 0.0 for e in corners) == pytest.approx(lost, rel=1e-9)


CORNERS = ["y = k*abs(x)", "y = 2*k*v(x)", "y = k*(4*v(x) - 2*v(-abs(x)))"]
CORNERS += ["y = k*abs(x) + 2*k*v(x) - 2*k*v(-x)", "y = k*abs(x)/2 + k*abs(3*x)/6"]


@pytest.mark.parametrize("relation", CORNERS)
@pytest.mark.parametrize("way", [1, -1])
def test_a_pushed_bead_stays_in_the_corner_up_to_the_weight_of_one_side(relation, way):
    # The reaction is between those of both sides, -g k to g k along x: F = t up to g k.
    text = wire(relation, x=0.0, end=5.5, more=f"forces: {{x: {way}*t}}")
    found = simulated(text)
    assert found.complete
    end = 0.5 * G
    rest = found.t < end - 1e-9
    assert np.max(np.abs(found["x"][rest])) < 1e-12
    assert found["Qc_x"][rest] == pytest.approx(-way * found.t[rest], abs=1e-9)
    assert found["lambda_wire"][rest] == pytest.approx(G, rel=1e-9)
    # Then (1 + k^2) x'' = t - g k.
    x = way * np.maximum(found.t - end, 0) ** 3 / 6 / 1.25
    assert found["x"] == pytest.approx(x, abs=1e-8)


@pytest.mark.slow
@pytest.mark.parametrize("method", ["taylor", "radau", "rk4"])
@pytest.mark.parametrize("where", [*ELSEWHERE, "beyond"])
def test_a_pushed_bead_stays_in_the_corner_of_a_table_elsewhere(where, method):
    c = {"length": 1.0, "time": 1.0, "X": 0.0}
    c |= ELSEWHERE.get(where, {"X": -3.7})
    length, time, X = c["length"], c["time"], c["X"]
    u, push = f"(x - X)/{length!r}", f"t*{length / time**3!r}"
    relation = f"y = k*(4*v({u}) - 2*v(-abs({u})))*{length!r}"
    text = wire(relation, x=0.0, end=5.5, more=f"forces: {{x: {push}}}", **c)
    options = {"step": 0.01 * time} if method == "rk4" else {}
    found = simulated(text, method=method, **options)
    t, end = found.t / time, 0.5 * G
    rest = t < end - 1e-6
    pull = found["Qc_x"][rest] * time**2 / length
    assert pull == pytest.approx(-t[rest], abs=1e-8)
    x = np.maximum(t - end, 0) ** 3 / 6 / 1.25
    # Far from the origin positions have a rounding of 1e-13.
    assert (found["x"] - X) / length == pytest.approx(x, abs=1e-7)


def test_a_floor_of_nested_conditions_moves_as_its_polygon():
    # A slide on a slope of 0.04, a parabola off the ridge at 0.54, and the last line.
    result = simulated(
        """
        coordinates: {x: {}, y: {}}
        energy: {kinetic: (x_dot^2 + y_dot^2)/2, potential: 9.81*y}
        constraints:
          floor:
            relation: "y >= if(x <= 0.54, 0.04*(x - 0.54), if(x <= 0.93,
              -0.775*(x - 0.93) - 0.30225, 0.011*(x - 0.93) - 0.30225))"
            restitution: 0
        initial: {x: 0.2, x_dot: 1.5, y: -0.0136, y_dot: 0.06}
        simulation: {duration: 0.4, output_step: 0.01}
        """
    )
    assert not result.warnings
    slope = 0.04
    a = G * slope / (1 + slope**2)
    off = (1.5 - np.sqrt(1.5**2 - 2 * a * 0.34)) / a
    t, v = result.t, 1.5 - a * off
    flown = np.maximum(t - off, 0.0)
    along = np.minimum(t, off)
    x = 0.2 + 1.5 * along - a * along**2 / 2 + v * flown
    y = slope * (np.minimum(x, 0.54) - 0.54) + slope * v * flown - G * flown**2 / 2
    steep = -0.775 * (x - 0.93) - 0.30225
    flies = y > np.where(x > 0.54, steep, -1.0)
    assert flies[t < 0.35].all()
    assert result["x"][flies] == pytest.approx(x[flies], abs=1e-9)
    assert result["y"][flies] == pytest.approx(y[flies], abs=1e-9)


@pytest.mark.parametrize("groove", [-1.0, 0.4])
def test_a_ball_rests_in_each_groove_of_nested_conditions(groove):
    result = simulated(
        f"""
        coordinates: {{x: {{}}, y: {{}}}}
        energy: {{kinetic: (x_dot^2 + y_dot^2)/2, potential: 9.81*y}}
        constraints:
          floor:
            relation: "y >= if(x <= -1, -0.6*(x + 1), if(x <= -0.3, 0.5*(x + 0.3)
              + 0.35, if(x <= 0.4, -0.4*(x - 0.4) + 0.07, if(x <= 1.1, 0.7*(x - 1.1)
              + 0.56, 0.2*(x - 1.1) + 0.56))))"
            restitution: 0
        initial: {{x: {groove}, y: {0.0 if groove < 0 else 0.07}}}
        simulation: {{duration: 1, output_step: 0.1}}
        """
    )
    assert result.complete
    assert abs(result["x"] - groove).max() < 1e-12
    assert result["lambda_floor"] == pytest.approx(G, rel=1e-9)


# Two grooves, of which the one at 0 has the condition x <= 0 of a joint of the other.
@pytest.mark.parametrize("groove", [0.0, 0.8])
@pytest.mark.parametrize("push", [0.0, -0.5, 0.5])
def test_a_ball_rests_in_each_of_two_grooves_beside_each_other(groove, push):
    steep = {0.0: (0.6, 0.29), 0.8: (0.12, 0.78)}[groove]
    force = push * G * steep[push > 0.0]
    result = simulated(
        f"""
        coordinates: {{x: {{}}, y: {{}}}}
        energy: {{kinetic: (x_dot^2 + y_dot^2)/2, potential: 9.81*y}}
        forces: {{x: {force!r}}}
        constraints:
          floor:
            relation: "y >= if(x <= 0, -0.6*x, if(x <= 0.5, 0.29*(x - 0.5) + 0.145,
              if(x < 0.8, -0.12*(x - 0.8) + 0.109, 0.78*(x - 0.8) + 0.109)))"
            restitution: 0.5
        initial: {{x: {groove}, y: {0.109 if groove else 0.0}}}
        simulation: {{duration: 1, output_step: 0.1}}
        """
    )
    assert result.complete
    assert abs(result["x"] - groove).max() < 1e-12
    assert result["lambda_floor"] == pytest.approx(G, rel=1e-9)
    assert result["Qc_x"] == pytest.approx(-force, abs=1e-9)


@pytest.mark.parametrize(
    "relation",
    [
        "if(x - X < 0.7, -0.5*(x - X - 0.7), 0.6*(x - X - 0.7))",
        "0.2*(x - X - 0.7) + 0.36*max(x - X - 0.7, X + 0.7 - x)",
    ],
)
@pytest.mark.parametrize("X", [1, 3, 10, 100, 1e5])
def test_a_bead_rests_in_a_corner_whose_place_is_rounded(relation, X):
    # Both sides differ there by the rounding of x, which is no jump of y.
    found = simulated(
        f"""
        parameters: {{X: {X!r}}}
        coordinates: {{x: {{}}, y: {{}}}}
        energy: {{kinetic: (x_dot^2 + y_dot^2)/2, potential: 9.81*y}}
        constraints: {{wire: "y = {relation}"}}
        initial: {{x: {X + 0.7!r}, y: {{guess: 0}}}}
        simulation: {{duration: 1, output_step: 0.1}}
        """
    )
    assert found.complete, found.reason
    assert abs(found["x"] - X - 0.7).max() < 1e-15 * X
    assert abs(found["x_dot"]).max() < 1e-12


@pytest.mark.slow
@pytest.mark.parametrize("e", [0, 0.5])
def test_a_ball_comes_to_rest_in_a_cusp(e):
    """A groove below a nonlinear function, y = -1/(1 + abs(x)), is lowest at -1."""
    found = lagsim.simulate(f"""
coordinates: {{x: {{}}, y: {{}}}}
energy: {{kinetic: (x_dot^2 + y_dot^2)/2, potential: 9.81*y}}
constraints: {{floor: {{relation: y >= -1/(1 + abs(x)), restitution: {e}}}}}
initial: {{x: 0.3, y: 0}}
simulation: {{duration: 3, output_step: 0.5}}
""", error_bar="never")  # fmt: skip
    assert found.outcome == "done", found.reason
    assert found["x"][-1] == pytest.approx(0.0, abs=1e-12)
    assert found["y"][-1] == pytest.approx(-1.0, abs=1e-12)
    assert not found.warnings


@pytest.mark.parametrize(("relation", "start"), [
    ("y = 0.5*abs(x)", "x: -1, y: 0.5, x_dot: 0.3, y_dot: -0.15"),
    ("y = if(x < 0, -0.5*x, 0.3*x)", "x: -1, y: 0.5"),
    ("y = max(-x, 0.2*x)", "x: 1, y: 0.2"),
    ("y = -0.5*abs(x)", "x: -1, y: -0.5, x_dot: 6, y_dot: 3"),
])  # fmt: skip
@pytest.mark.parametrize("when", ["t < 9", "on > 0"])
def test_corners_of_relations_with_when_are_those_without(relation, start, when):
    text = f"""
coordinates: {{x: {{}}, y: {{}}}}
modes: {{on: 1}}
energy: {{kinetic: (x_dot^2 + 2*y_dot^2)/2, potential: 9.81*y}}
constraints: {{wire: {{relation: "{relation}"}}}}
events: {{never: {{at: y >= 50, impulse: {{y: 1}}}}}}
initial: {{{start}}}
simulation: {{duration: 2.5, output_step: 0.1}}
"""
    always = simulated(text)
    timed = simulated(text.replace('"}}', f'", when: {when}}}}}'))
    listed = [
        [(x.time, x.energy) for x in run.events if x.kind == "corner"]
        for run in (always, timed)
    ]
    assert len(listed[0]) > 0
    assert np.array(listed[1]) == pytest.approx(np.array(listed[0]), abs=1e-9)
    assert timed.t == pytest.approx(always.t, abs=1e-9)
    for name in ("x", "x_dot", "y_dot", "work", "impulse.wire"):
        assert timed[name] == pytest.approx(always[name], abs=1e-8)


# Parts of the radius of the table, from its centre, at which a point lies.
TURNS = np.linspace(-1, 1, 31)


@pytest.mark.slow
def test_a_corner_and_a_point_of_a_table_that_a_rod_joins_are_one_corner():
    # A bead on y = 0.3 |x - X| + T(x), where T rises by 0.2 before X and by 0.7 after
    # it. A rod gives the sum 1e5 + x the rounding of 1e5, the table that of its radius:
    # its point is located where the argument of abs is still off 0 by more than its own
    # rounding. One impact onto the slope 1 from the slope -0.1; two in turn would leave
    # 0.73 of the speed.
    X, radius, speed = 7.77, 23.164145156627626, 1.2889537870930932
    points = np.column_stack([X + radius * TURNS, np.zeros(31)])
    points[15, 0] = X
    points[:, 1] = np.where(TURNS < 0, 0.2, 0.7) * (points[:, 0] - X)
    found = simulated(f"""
    tables: {{T: {{points: {points.tolist()}, outside: hold}}}}
    coordinates: {{x: {{}}, y: {{}}, u: {{}}}}
    energy: {{kinetic: (x_dot^2 + y_dot^2)/2, potential: 0}}
    constraints:
      wire: y = 0.3*abs(u - 1e5 - {X}) + T(x)
      rod: u - x = 1e5
    initial:
      {{x: {X - 0.5}, x_dot: {speed}, y: {{guess: 0}}, y_dot: {{guess: 0}},
      u: {{guess: 0}}, u_dot: {{guess: 0}}}}
    simulation: {{duration: 3}}
    """)
    assert [e.kind for e in found.events].count("corner") == 1
    left = (1 - 0.1 * 1.0) / (1 + 1.0**2)
    assert found["x_dot"][-1] == pytest.approx(left * speed, rel=1e-9)
