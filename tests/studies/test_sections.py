"""Sections: crossings and strobes, against closed forms and scipy's event location."""

import json
import math
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from lagsim import load, simulate
from lagsim.methods import method, names
from lagsim.outputs.sections import section_columns, without_noise
from tests.cli.conftest import lagsim  # noqa: F401
from tests.support import MODELS, refused

OSCILLATOR = """
parameters: {w: 1}
coordinates: {x: {}}
energy: {kinetic: x_dot^2/2, potential: w^2*x^2/2}
initial: {x: 1}
simulation: {duration: 50}
output: {sections: {cut: {SECTION}}}
"""


def sections(section, text=OSCILLATOR, **options):
    model = load(text.replace("SECTION", section))
    return simulate(model, error_bar="never", **options).sections["cut"]


@pytest.mark.slow
def test_henon_and_heiles():
    found = simulate(str(MODELS / "henon-heiles.yaml"), error_bar="never").sections[
        "cut"
    ]
    assert found["energy"] == pytest.approx(1.0 / 12.0, abs=1e-10)
    assert (found["x_dot"] > 0.0).all()
    y, v = 0.1, 0.1
    u = math.sqrt(1.0 / 6.0 - y * y + 2.0 * y**3 / 3.0 - v * v)

    def rates(_, z):
        return [z[2], z[3], -z[0] - 2.0 * z[0] * z[1], -z[1] - z[0] ** 2 + z[1] ** 2]

    def crossing(_, z):
        return z[0]

    crossing.direction = 1.0
    exact = solve_ivp(
        rates, (0, 200), [0.0, y, u, v], "DOP853", events=[crossing], rtol=1e-13,
        atol=1e-15, max_step=0.05,
    )  # fmt: skip
    times, states = exact.t_events[0][1:], exact.y_events[0][1:]
    assert len(times) == np.count_nonzero(found["t"] < 200.0) == 31
    assert found["t"][:31] == pytest.approx(times, abs=1e-10)
    assert found["y"][:31] == pytest.approx(states[:, 1], abs=1e-10)
    assert found["y_dot"][:31] == pytest.approx(states[:, 3], abs=1e-10)


@pytest.mark.parametrize("step", [50, 0.01])
@pytest.mark.parametrize(
    ("section", "first", "period"),
    [
        ("at: x = 0, direction: up", 1.5 * math.pi, 2.0 * math.pi),
        ("at: x = 0, direction: down", 0.5 * math.pi, 2.0 * math.pi),
        ("at: 0 = x, direction: up", 0.5 * math.pi, 2.0 * math.pi),
        ("at: x = 0", 0.5 * math.pi, math.pi),
        ("at: x = 1.000001", math.inf, math.pi),  # it is nearly touched
        ("at: x_dot = 0, direction: up", math.pi, 2.0 * math.pi),  # and at the start
        ("at: x = 0.9999, direction: down", math.acos(0.9999), 2.0 * math.pi),
        ("every: 2*pi/w", 0.0, 2.0 * math.pi),
    ],
)
def test_all_crossings_are_found_however_long_the_steps(section, first, period, step):
    times = np.arange(first, 50.0, period) if first < 50.0 else np.array([])
    found = sections(section, output_step=step)
    assert found["t"] == pytest.approx(times, abs=1e-9)
    assert found["x"] == pytest.approx(np.cos(times), abs=1e-9)


WAVES = """
coordinates: {{x: {{}}, y: {{}}}}
energy: {{kinetic: (x_dot^2 + y_dot^2)/2, potential: (x^2 + {w}^2*y^2)/2}}
initial: {{x: {a}, y: {b}, x_dot: {c}, y_dot: {d}}}
simulation: {{duration: 30, rtol: 1e-11}}
output: {{sections: {{cut: {{at: x + y = {level}}}}}}}
"""


def dips(seed, depth, duration=30.0):
    """Return a sum of two waves that dips below a level, and its crossings."""
    random = np.random.default_rng(seed)
    w, a, b, c, d = map(float, random.uniform([0.5, *4 * [-1.0]], [2.5, *4 * [1.0]]))
    terms = [(1.0, a, c), (w, b, d / w)]

    def height(t):
        return sum(p * math.cos(v * t) + q * math.sin(v * t) for v, p, q in terms)

    def slope(t):
        return sum(v * (q * math.cos(v * t) - p * math.sin(v * t)) for v, p, q in terms)

    grid = np.linspace(0.0, duration, 3001)
    turns = [brentq(slope, *x) for x in pairwise(grid) if slope(x[0]) * slope(x[1]) < 0]
    peaks = [t for t in turns if height(t) > height(t + 1e-3)]
    level = height(peaks[random.integers(len(peaks))]) - depth
    parts = [
        x
        for x in pairwise([0.0, *turns, duration])
        if (height(x[0]) - level) * (height(x[1]) - level) < 0.0
    ]
    crossings = [brentq(lambda t: height(t) - level, *x, xtol=1e-15) for x in parts]
    return WAVES.format(w=w, a=a, b=b, c=c, d=d, level=level), np.array(crossings)


@pytest.mark.slow
@pytest.mark.parametrize("depth", [1e-4, 1e-6, 1e-8, -1e-8])
@pytest.mark.parametrize("seed", range(6))
def test_two_crossings_are_found_however_close_they_are(depth, seed):
    text, times = dips(seed, depth)
    for name in ("taylor", "dop853"):
        found = sections("", text, method=name)["t"]
        assert len(found) == len(times), name
        assert found == pytest.approx(times, abs=1e-10 / math.sqrt(abs(depth)))


@pytest.mark.slow
def test_a_relation_with_many_periods_in_a_step():
    text = """
coordinates: {theta: {}, x: {}}
energy: {kinetic: (theta_dot^2 + x_dot^2)/2, potential: x^2/2}
initial: {theta: 0.1, theta_dot: 1000, x: 1}
simulation: {duration: 10, output_step: 0.1}
output: {sections: {cut: {at: sin(theta) = 0, direction: down}}}
"""
    times = ((2.0 * np.arange(1592) + 1.0) * math.pi - 0.1) / 1000.0
    assert times[-1] < 10.0 < times[-1] + 2e-3 * math.pi
    found = sections("", text)
    assert found["t"] == pytest.approx(times, abs=1e-11)


@pytest.mark.slow
@pytest.mark.parametrize("name", names())
def test_every_method(name):
    adaptive = method(name).ADAPTIVE
    options = {} if adaptive else {"step": 0.01}
    found = sections("at: x = 0, direction: up", method=name, duration=20, **options)
    near = 1e-8 if adaptive else 0.05
    times = np.arange(1.5 * math.pi, 20.0, 2.0 * math.pi)
    assert len(found["t"]) == len(times)
    assert found["t"] == pytest.approx(times, abs=near)
    assert found["x"] == pytest.approx(np.zeros(len(times)), abs=1e-9)


def test_a_section_changes_no_bit_and_follows_other_values():
    plain = load(OSCILLATOR.replace("output: {sections: {cut: {SECTION}}}", ""))
    model = load(OSCILLATOR.replace("SECTION", "every: pi/w"))
    one, other = (simulate(m, error_bar="never") for m in (plain, model))
    assert one.table.tobytes() == other.table.tobytes()
    assert one.sections == {}
    found = simulate(model.bind(w=2), error_bar="never").sections["cut"]
    assert found["t"] == pytest.approx(np.arange(32) * math.pi / 2.0, abs=1e-12)


BALL = """
coordinates: {y: {}, z: {}}
energy: {kinetic: (y_dot^2 + z_dot^2)/2, potential: 9.81*y + z^2/2}
constraints: {floor: {relation: y >= 0, restitution: 0.5}}
forces: {z: "if(z > 0.3, -1, 0)"}
initial: {y: 1, z: 1}
simulation: {duration: 1.2, until: z <= 0.1}
output: {sections: {cut: {SECTION}}}
"""


@pytest.mark.slow
def test_beside_impacts_switches_and_until():
    fall = math.sqrt(2.0 / 9.81)
    found = sections("at: y = 0.1", BALL)
    up, speed = 0.5 * 9.81 * fall, 9.81
    root = math.sqrt(up * up - 2.0 * speed * 0.1)
    times = [
        math.sqrt(1.8 / 9.81),
        fall + (up - root) / 9.81,
        fall + (up + root) / 9.81,
    ]
    times = [t for t in times if t < found["t"][-1] + 1e-9]
    assert found["t"] == pytest.approx(times, abs=1e-10)
    found = sections("at: y_dot = 0, direction: up", BALL)
    assert found["t"] == pytest.approx([fall, 2.0 * fall], abs=1e-12)
    assert found["y_dot"] == pytest.approx([up, up / 2.0], abs=1e-10)  # after impacts
    found = sections("at: y = 0", BALL)
    assert len(found["t"]) == 0


RELAY = """
coordinates: {x: {}}
modes: {u: 1}
energy: {kinetic: x_dot^2/2, potential: 2*x^2}
events: {relay: {at: x <= 0, set: {u: 4 - u}}}
initial: {x: 1}
simulation: {duration: 7}
output: {sections: {cut: {SECTION}}}
"""


@pytest.mark.parametrize(
    ("section", "times", "modes"),
    [
        ("at: u = 2", (math.pi / 4.0, math.pi * 1.25), (3, 1)),
        ("at: u = 2, direction: down", (math.pi * 1.25,), (1,)),
        # It jumps up with u, where x = 0, and down where x = cos(2 t) = -1/2.
        ("at: x + u = 2.5, direction: up", (math.pi / 4, math.pi * 2 / 3), (3, 3)),
        ("at: u = 3", (), ()),  # it is met, and left where it was met from
        ("at: 1/(x - 0.3) = 0", (), ()),  # a pole
    ],
)
def test_modes_that_jump_over_a_section(section, times, modes):
    found = sections(section, RELAY)
    assert found["t"] == pytest.approx(times, abs=1e-12)
    assert tuple(found["u"]) == modes  # after the event


@pytest.mark.slow
def test_files(lagsim, tmp_path):  # noqa: F811
    path = tmp_path / "model.yaml"
    path.write_text(OSCILLATOR.replace("SECTION", "at: x = 0, plot: [x_dot, x_ddot]"))
    assert lagsim("run", str(path), "-o", str(tmp_path / "r"), "-q").code == 0
    folder = tmp_path / "r"
    rows = np.loadtxt(folder / "section_cut.csv", delimiter=",", skiprows=1)
    header = (folder / "trajectory.csv").read_text().splitlines()[0]
    assert (folder / "section_cut.csv").read_text().splitlines()[0] == header
    assert rows.shape == (16, 1 + header.count(","))
    files = json.loads((folder / "run.json").read_text())["files"]
    assert {"section_cut.csv", "section_cut.png"} <= set(files)
    path.write_text(OSCILLATOR.replace("SECTION", "every: 60"))
    assert lagsim("run", str(path), "-o", str(folder), "-q", "--no-plots").code == 0
    assert (folder / "section_cut.csv").read_text().count("\n") == 2
    assert not (folder / "section_cut.png").exists()


NAMES = ["t", "x", "y", "x_dot", "energy", "lambda_c"]
# Of the run, least and largest: y lies far from the origin, and the energy drifts.
RANGES = np.array(
    [
        [0.0, -1.0, 1e6 - 2.0, -3.0, 0.5, -1.0],
        [9.0, 1.0, 1e6 + 2.0, 3.0, 0.5 + 1e-12, 1.0],
    ]
)
FIXED = [1.0, 1e-17, 1e6, 1.0, 0.5, 0.3]


@pytest.mark.parametrize(
    ("changes", "columns"),
    [
        ([1.0, -2e-16, -0.3, 1.0, 1e-12, -0.6], ["y", "x_dot"]),
        ([1.0, 0.1, 1e-10, 0.1, 0.0, 0.0], ["x", "x_dot"]),
        ([1.0, 0.0, 0.0, 0.1, 1e-12, 0.2], ["t", "x_dot"]),
        ([1.0, 2e-17, 1e-10, 0.0, 0.0, 0.0], ["t", "y"]),
    ],
)
def test_pictures_leave_out_what_a_section_fixes(changes, columns):
    rows = np.array([FIXED, np.add(FIXED, changes)])
    assert section_columns(NAMES, rows, RANGES) == columns
    assert list(without_noise("x", NAMES, rows, RANGES)) == pytest.approx(
        [0.0, 0.1] if changes[1] == 0.1 else [0.0, 0.0], abs=1e-16
    )


def test_pictures_leave_out_a_column_that_a_section_fixes_by_another():
    # on 0.5 y + x = 5e5 + 1; x_dot is free
    x = np.linspace(-0.9, 0.9, 9)
    rows = np.array([[t, a, 1e6 + 2 - 2 * a, a**2, 0.5, 0.1] for t, a in enumerate(x)])
    assert section_columns(NAMES, rows, RANGES) == ["x", "x_dot"]
    # Where all columns lie on straight lines, or rows are few, the first two are drawn.
    assert section_columns(NAMES, rows[:3], RANGES) == ["x", "y"]
    rows[:, 3] = 0.2 * x
    assert section_columns(NAMES, rows, RANGES) == ["x", "y"]


def test_a_strobe_without_a_period_is_refused():
    for every in ("w - 1", "-w", "1e-6"):
        with refused("out-of-range", "`every`", "`cut`"):
            sections(f"every: {every}")


@pytest.mark.slow
def test_what_a_constraint_holds_on_a_section_does_not_cross_it():
    text = """
coordinates: {u: {}, w: {}}
definitions: {y: 0.3*u + 0.7*w, x: 0.7*u - 0.3*w}
energy: {kinetic: (x_dot^2 + y_dot^2)/2, potential: 9.81*y + 2*x^2}
constraints: {floor: {relation: y >= 0, restitution: 0}}
initial: {u: 0.7, w: -0.3}
simulation: {duration: 5, output_step: 0.1}
output:
  sections: {cut: {at: y = 0, direction: both}, swing: {at: x = 0, direction: up}}
"""
    found = simulate(load(text), error_bar="never").sections
    assert len(found["cut"]["t"]) == 0
    assert found["swing"]["t"] == pytest.approx([0.75 * math.pi], abs=1e-10)


# Several sections of one motion: x = cos t, and a mode z that events set.
TIMES = """
coordinates: {x: {}}
modes: {z: 0}
energy: {kinetic: x_dot^2/2, potential: x^2/2}
events: {EVENTS}
initial: {x: 1}
simulation: {RUN}
output:
  sections:
"""


def several(run, events, asked, text=TIMES, **options):
    """Return the rows of some sections, given by number."""
    lines = "".join(f"    s{k}: {{{section}}}\n" for k, section in enumerate(asked))
    text = text.replace("RUN", run).replace("EVENTS", events) + lines
    result = simulate(load(text), error_bar="never", **options)
    assert result.complete, result.reason
    return list(result.sections.values())


def halves(*numbers):
    return pytest.approx(math.pi * np.array(numbers), abs=1e-10)


NO_EVENT = "none: {at: x >= 2, set: {z: 1}}"


@pytest.mark.parametrize(
    "name", ["taylor", "dop853", pytest.param("radau", marks=pytest.mark.slow)]
)
def test_touches_and_jumps_of_the_relation_cross_nothing(name):
    asked = [
        "at: x = 1",  # touched at the start, and every period
        "at: x = -1",
        "at: x_dot = 1",
        "at: abs(x) = 0",
        "at: x^2 = 0",
        "at: max(x, 0) = 0",  # on it for half of the time
        "at: sign(x) = 0",
        "at: 1/x = 0",
        'at: "mod(x, 0.5) = 0"',  # jumps from it and to it
        'at: "if(x > 0.3, x, -1) = 0"',
        "at: x^2 = 1e-8",  # dips by 1e-8
        "at: cbrt(x) = 0, direction: down",
        "at: x_dot/x = 0, direction: down",
        'at: "min(x + 0.5, 0) + max(x - 0.5, 0) = 0, direction: up"'.replace(
            ', direction: up"', '", direction: up'
        ),
    ]
    text = TIMES.replace("{EVENTS}", f"{{{NO_EVENT}}}")
    found = [x["t"] for x in several("duration: 12", "", asked, text, method=name)]
    assert [len(x) for x in found[:10]] == 10 * [0]
    near = np.array(
        [k * math.pi + math.pi / 2 + d for k in range(4)[:4] for d in (-1e-4, 1e-4)]
    )
    assert found[10] == pytest.approx(near[near < 12.0], abs=1e-9)
    assert found[11] == halves(0.5, 2.5)
    assert found[12] == halves(1.0, 2.0, 3.0)
    # It is 0 between -0.5 and 0.5, and left upwards at 0.5.
    assert found[13] == halves(5.0 / 3.0, 11.0 / 3.0)


@pytest.mark.slow
def test_until_the_end_and_events_at_a_section():
    asked = ["at: x = 0", "at: x = -0.5", "at: x_dot = 0", "every: pi/3"]
    found = several('duration: 9, until: "x <= -0.5"', NO_EVENT, asked)
    assert found[0]["t"] == halves(0.5)
    assert found[1]["t"] == halves(2.0 / 3.0)  # at the time of `until`
    assert len(found[2]["t"]) == 0
    assert found[3]["t"] == halves(0.0, 1.0 / 3.0, 2.0 / 3.0)
    found = several("duration: 5*pi/2", NO_EVENT, ["at: x = 0", "at: x_dot = 1"])
    assert found[0]["t"] == halves(0.5, 1.5, 2.5)
    assert len(found[1]["t"]) == 0
    found = several("duration: 3*pi/2", NO_EVENT, ["at: x_dot = 1", "at: x = 0"])
    assert len(found[0]["t"]) == 0  # it is touched at the end
    assert found[1]["t"] == halves(0.5, 1.5)
    # The last step is cut very early: a row is at 3, and x is there a rounding later.
    text = TIMES.replace("x^2/2}", "0}").replace("x: 1}", "x: 0, x_dot: 1}")
    asked = ["at: x = 3", "every: 3", "at: x - 3 = 0, direction: down"]
    found = several('duration: 10, until: "x >= 3"', NO_EVENT, asked, text)
    assert [list(x["t"]) for x in found] == [
        [pytest.approx(3.0, abs=1e-12)], [0.0, 3.0], []
    ]  # fmt: skip
    # An event at the section sets z to 1, ...: rows show what holds after it.
    asked = ["at: x = 0", "at: z = 0.5, direction: up", "at: x + z = 1.5"]
    found = several("duration: 9", 'e: {at: "x <= 0", set: {z: 1 - z}}', asked)
    assert found[0]["t"] == halves(0.5, 1.5, 2.5)
    assert list(found[0]["z"]) == [1.0, 1.0, 0.0]
    assert found[1]["t"] == halves(0.5)
    assert list(found[1]["z"]) == [1.0]
    assert found[2]["t"] == halves(5.0 / 3.0, 7.0 / 3.0)


@pytest.mark.parametrize("start", [0.0, -3.0, 1e6])
def test_strobes_and_events_at_one_time_show_the_state_after_all_acts(start):
    run = f"start: {start!r}, duration: 0.7, output_step: 0.1"
    events = "one: {every: 0.1, set: {z: z + 1}}, two: {every: 0.1, set: {z: 3 - z}}"
    asked = ["every: 0.1", "at: z = 1.5", "at: z = 0.5", "at: z = 2.5"]
    found = several(run, events, asked)
    times = start + 0.1 * np.arange(8)
    assert found[0]["t"] == pytest.approx(times, abs=1e-9)
    # z is 2, 0, 2, ...: 3 - (z + 1).
    assert list(found[0]["z"]) == [2.0, 0.0] * 4
    for x in found[1:3]:
        assert list(x["t"]) == list(found[0]["t"][1:])
        assert list(x["z"]) == [0.0, 2.0, 0.0, 2.0, 0.0, 2.0, 0.0]
    assert len(found[3]["t"]) == 0


@pytest.mark.parametrize("name", ["dop853", "taylor", "rk4"])
def test_an_event_and_a_section_of_one_relation_have_one_time(name):
    text = OSCILLATOR + "modes: {u: 0}\nevents: {e: {at: x = 0.3, set: {u: u + 1}}}"
    model = load(text.replace("SECTION", "at: x = 0.3"))
    options = {"method": name, "step": 0.01} if name == "rk4" else {"method": name}
    result = simulate(model, error_bar="never", **options)
    found = result.sections["cut"]
    turns = 2.0 * math.pi * np.arange(9)
    first = math.acos(0.3)
    times = np.sort(np.concatenate([turns + first, turns[1:] - first]))
    # rk4 has an error of h^4 in each unit of time.
    near = 2e-8 if name == "rk4" else 1e-9
    assert found["t"] == pytest.approx(times[times < 50.0], abs=near)
    assert found["t"].tolist() == [e.time for e in result.events]
    assert found["u"].tolist() == list(range(1, len(found["t"]) + 1))


def test_acts_that_undo_each_other_cross_nothing():
    events = "one: {every: 1, set: {z: z + 1}}, two: {every: 1, set: {z: z - 1}}"
    found = several("duration: 5", events, ["at: z = 0.5", "at: z = -0.5"])
    assert [len(x["t"]) for x in found] == [0, 0]


BOUNCES = """
coordinates: {y: {}}
energy: {kinetic: y_dot^2/2, potential: 10*y}
constraints: {floor: {relation: "y >= 0", restitution: EVENTS}}
initial: {y: 1}
simulation: {RUN}
output:
  sections:
"""


@pytest.mark.slow
@pytest.mark.parametrize("name", ["auto", pytest.param("rk4", marks=pytest.mark.slow)])
def test_impacts_on_a_section_and_past_it(name):
    fall = 1.0 / math.sqrt(5.0)
    steps = {} if name != "rk4" else {"step": 0.01}
    asked = [
        "at: y = 0",  # it turns back there
        "at: y_dot = 0, direction: up",
        "at: y_dot = 0, direction: down",
        "at: y_dot = 3",
        "every: 1/sqrt(5)",
    ]
    found = several("duration: 6", "0.5", asked, BOUNCES, method=name, **steps)
    assert len(found[0]["t"]) == 0
    count = len(found[1]["t"])
    assert count > 15  # they accumulate
    left = 0.5 ** np.arange(count)
    times = fall + 2.0 * fall * (1.0 - left)
    assert found[1]["t"] == pytest.approx(times, abs=1e-9)
    assert found[1]["y_dot"] == pytest.approx(math.sqrt(5.0) * left, abs=1e-9)
    falls = 2.0 * math.sqrt(5.0) * np.append(1.0, left[:-1] / 2.0)
    impulses = found[1]["impulse.floor"]
    assert impulses == pytest.approx(falls + found[1]["y_dot"], abs=1e-9)
    apart = times[:-1] + fall * left[:-1] / 2.0
    assert found[2]["t"][: count - 1] == pytest.approx(apart, abs=1e-9)
    assert len(found[3]["t"]) == 0
    strobes = found[4]
    assert strobes["t"] == pytest.approx(fall * np.arange(14), abs=1e-12)
    assert strobes["y_dot"][:3] == pytest.approx([0.0, *found[1]["y_dot"][:2]])
    assert strobes["impulse.floor"][:3] == pytest.approx([0.0, *impulses[:2]])
    (found,) = several(
        "duration: 1", "0", ["at: y_dot = -1"], BOUNCES, method=name, **steps
    )
    assert found["t"] == pytest.approx([0.1, fall], abs=1e-9)
    assert found["y_dot"] == pytest.approx([-1.0, 0.0], abs=1e-9)


def test_impacts_within_the_steps_of_moreau():
    asked = ["at: y = 0", "at: y_dot = 0, direction: up", "at: y = 0.1"]
    found = several("duration: 1.4", "0.5", asked, BOUNCES, method="moreau", step=1e-3)
    fall = 1.0 / math.sqrt(5.0)
    assert len(found[0]["t"]) == 0
    times = fall * (3.0 - 2.0 * 0.5 ** np.arange(5))
    assert found[1]["t"][:5] == pytest.approx(times, abs=5e-3)
    assert (found[1]["y_dot"] > 0.0).all()
    assert len(found[2]["t"]) == 3


SEVERAL = """
coordinates: {a: {}, b: {}}
states: {w: {rate: -w + a}}
definitions: {r(i = 1..2): a + i*b}
energy: {kinetic: (a_dot^2 + b_dot^2)/2, potential: (a^2 + 4*b^2)/2}
initial: {a: 1, b: 0, b_dot: 2, w: 0.5}
simulation: {RUN}
output:
  sections:
"""


def test_relations_of_states_rates_and_members():
    asked = ["at: w = 0", "at: r(2) = 0, direction: up", "at: a_dot + b_dot = 0"]
    found = several("duration: 6", "", asked, SEVERAL)
    # a = cos t, b = sin 2t, w = (cos t + sin t)/2.
    assert found[0]["t"] == halves(0.75, 1.75)
    rises = [brentq(lambda t: math.cos(t) + 2.0 * math.sin(2.0 * t), *x)
             for x in [(3.0, 3.5), (4.5, 4.9)]]  # fmt: skip
    signs = [math.cos(t + 0.1) + 2.0 * math.sin(2.0 * t + 0.2) for t in rises]
    assert found[1]["t"] == pytest.approx(
        [t for t, x in zip(rises, signs, strict=True) if x > 0.0], abs=1e-10
    )
    grid = np.linspace(0.0, 6.0, 601)
    speed = 2.0 * np.cos(2.0 * grid) - np.sin(grid)
    turns = [
        brentq(lambda t: 2.0 * math.cos(2.0 * t) - math.sin(t), grid[k], grid[k + 1])
        for k in np.flatnonzero(speed[:-1] * speed[1:] < 0.0)
    ]
    assert found[2]["t"] == pytest.approx(turns, abs=1e-10)


@pytest.mark.slow
def test_sections_beside_others_have_rows_of_their_own():
    """Far from the origin, from a start on the section: x - 1000 = sin t."""
    result = simulate(load("""
coordinates: {x: {}}
energy: {kinetic: x_dot^2/2, potential: (x - 1000)^2/2}
forces: {x: 1e-300*x_dot*abs(x_dot)}
initial: {x: 1000, x_dot: 1}
simulation: {duration: 7, output_step: 0.125}
output:
  sections:
    s: {at: x = 1000}
    s1: {at: "sign(2*(x - 1000)) + 0.46 = 0"}
    s2: {at: x = 1000.5}
"""), error_bar="never")  # fmt: skip
    assert result.sections["s"]["t"] == pytest.approx([math.pi, 2 * math.pi], abs=1e-9)
    assert result.sections["s"]["x"] == pytest.approx([1000.0] * 2, abs=1e-9)
    assert len(result.sections["s1"]["t"]) == 0
    third = np.array([math.pi / 6, 5 * math.pi / 6, 13 * math.pi / 6])
    assert result.sections["s2"]["t"] == pytest.approx(third, abs=1e-9)


# The relation is 0 at each impact, before it and after it.
STRUCK = """
parameters: {{X0: {far}, v: {boost}}}
coordinates: {{x: {{}}}}
definitions: {{h: x - X0 - v*t}}
energy: {{kinetic: x_dot^2/2, potential: 9.8*x}}
constraints: {{floor: {{relation: x >= X0 + v*t, restitution: 0.8}}}}
initial: {{x: X0 + 1, x_dot: v}}
simulation: {{duration: 1.5, output_step: 0.1, method: {method}}}
output: {{sections: {{hit: {{at: "h*(x_dot - v) = 0", direction: up}}}}}}
"""


@pytest.mark.slow
@pytest.mark.parametrize("method", ["auto", "dopri5"])
@pytest.mark.parametrize("boost", [0.0, -3.0, 1.0])
@pytest.mark.parametrize("far", [0.0, 17.3, 1e3, 1e5])
def test_a_relation_that_is_0_at_an_impact_shows_the_state_after_it(far, boost, method):
    text = STRUCK.format(far=far, boost=boost, method=method)
    found = simulate(load(text), error_bar="never")
    falls = math.sqrt(2 / 9.8) * np.cumsum([1.0, 2 * 0.8])
    rows = found.sections["hit"]
    assert rows["t"] == pytest.approx(falls, abs=1e-13 * max(far, 1.0))
    speeds = math.sqrt(2 * 9.8) * np.array([0.8, 0.8**2])
    assert rows["x_dot"] - boost == pytest.approx(speeds, abs=1e-12 * max(far, 1.0))


BOUNCE = """
coordinates: {x: {}}
energy: {kinetic: x_dot^2/2, potential: 2.73*x}
initial: {x: FAR + 1.49, x_dot: 0.94}
simulation: {duration: 6, METHOD}
output:
  sections: {cut: {at: "RELATION = 0"}, level: {at: "x - (FAR) = 0.7"}}
"""
STEPPED = {
    "wall": "constraints: {wall: {relation: x >= FAR, restitution: 0.9}}",
    "event": 'events: {wall: {at: x <= FAR, impulse: {x: "-1.9*x_dot"}}}',
}


@pytest.mark.parametrize("far", [0.0, pytest.param(1e3, marks=pytest.mark.slow), -3.7])
@pytest.mark.parametrize("method", ["method: dop853", "method: rk4, step: 0.01"])
@pytest.mark.parametrize("at", STEPPED)
@pytest.mark.parametrize(
    "relation",
    [
        "0.4 + floor(x - (FAR)) + (x - (FAR))",
        "0.7 + sign(x - (FAR)) + (x - (FAR))",
        "if(x < FAR, -1, 1 + x - (FAR))",
    ],
)
def test_a_relation_that_jumps_at_a_wall_is_not_crossed_there(
    relation, at, method, far
):
    text = BOUNCE.replace("RELATION", relation) + STEPPED[at]
    text = text.replace("METHOD", method).replace("FAR", repr(far))
    found = simulate(load(text), error_bar="never").sections
    # x is at least FAR, but for rounding: the relation is at least 0.4. The level is
    # passed before the first impact, twice after each of two, and after the third.
    assert len(found["cut"]["t"]) == 0
    assert len(found["level"]["t"]) == 6


def test_an_act_crosses_a_section_where_the_relation_jumps():
    found = sections(
        "at: floor(x) - 2*n - 0.5 = 0",
        """
coordinates: {x: {}}
energy: {kinetic: x_dot^2/2, potential: 0}
modes: {n: 0}
events: {tick: {at: x >= 1, set: {n: 1}}}
initial: {x: 0.25, x_dot: 0.5}
simulation: {duration: 3}
output: {sections: {cut: {SECTION}}}
""",
    )
    # At t = 1.5 the relation jumps from -0.5 to 0.5 by itself, and by the event to
    # -1.5: the event crosses the section downwards.
    assert found["t"] == pytest.approx([1.5], abs=1e-12)
