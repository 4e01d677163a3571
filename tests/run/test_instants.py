"""Times within 4 units in the last place are one instant, with one time."""

import math

import numpy as np
import pytest

from lagsim import simulate
from lagsim.model.model import Settings
from lagsim.run.instants import instant
from tests.run.test_events import FREE, acts, scene


def beside(time, places):
    """Return the double that is `places` units in the last place from a time."""
    return time + places * math.ulp(time)


def test_an_instant_has_the_time_of_a_row_or_of_the_first_in_the_file():
    settings = Settings(end=2.0, output_step=0.25)
    for times, expected in (
        ((beside(0.3, 3), 0.3), beside(0.3, 3)),  # the first of the file, not in time
        ((0.3, beside(0.3, 3)), 0.3),
        ((0.35, beside(0.3, 2)), beside(0.3, 2)),  # the earliest instant
        ((beside(0.5, 2), beside(0.5, -2)), 0.5),  # a row's
        ((math.inf, 1.0 - 2.0**-50), 1.0),
        ((), math.inf),
    ):
        assert instant(settings, times) == expected


# Of multiples of 0.1 and of 0.3 some are not the same doubles; nor are rows'.
PERIODS = """
modes: {n: 1, z: 0}
events:
  a: {every: 0.1, set: {n: 2*n}}
  b: {every: 0.3, set: {n: n + 1}}
  tick: {every: 0.3, set: {z: 1 - z}}
"""


@pytest.mark.parametrize(("start", "step"), [(0, 0.1), (0, 0.07), (1000, 0.1)])
def test_events_at_one_time_have_one_time_in_rows_lists_and_answers(start, step):
    text = scene(PERIODS, "x: 0, x_dot: 1", 1, start=start, output_step=step)
    found = simulate(text, error_bar="never")
    n, expected, times = 1, [], []
    for k in range(11):
        of = ["a", "b", "tick"] if k % 3 == 0 else ["a"]
        n = 2 * n + (k % 3 == 0)
        expected += [(name, n, (k // 3 + 1) % 2) for name in of]
        times += [start + k * 0.1] * len(of)
    assert [name for name, _ in acts(found)] == [name for name, *_ in expected]
    listed = [t for _, t in acts(found)]
    assert listed == pytest.approx(times, rel=1e-15, abs=1e-15)
    assert len(set(listed)) == 11
    at = found.at(listed)
    assert at["n"].tolist() == [n for _, n, _ in expected]
    assert at["z"].tolist() == [z for *_, z in expected]
    # Rows at these times have these doubles, and show what holds after.
    rows = {t: (n, z) for t, (_, n, z) in zip(listed, expected, strict=True)}
    for t, n, z in zip(found.t, found["n"], found["z"], strict=True):
        near = min(rows, key=lambda x: abs(x - t))
        if abs(near - t) < 1e-9:
            assert (t, n, z) == (near, *rows[near])


# --- Sentences of the contract, "Modes and events"


def modes_at(found, time, *names):
    """Return values of modes in the row at a time."""
    row = int(np.argmin(np.abs(found.t - time)))
    return [found[name][row] for name in names]


COMPLEMENTARY = """
modes: {on: 0, n: 0, m: 0}
coordinates: {a: {}, b: {}}
energy: {kinetic: MASS*b_dot^2/2, potential: 0}
constraints:
  drive: a = sin(t)
  couple: {relation: b_dot = a_dot, when: on > 0}
events:
  up: {at: RISES, set: {on: 1, n: n + 1}}
  down: {at: FALLS, set: {on: 0, m: m + 1}}
initial: {a: 0, b: 0, a_dot: 1}
simulation: {duration: 30, output_step: 0.1, METHOD}
"""


@pytest.mark.parametrize(
    "method",
    ["method: auto", "method: dop853", "method: rk4, step: 0.02",
     "method: rattle, step: 0.02", "method: moreau, step: 0.001"],
)  # fmt: skip
@pytest.mark.parametrize(("mass", "level"), [("1", None), ("3", None), ("1", 0.3)])
def test_events_of_complementary_conditions_act_by_turns(mass, level, method):
    """Beside a constraint whose projection leaves rounding in a common argument."""
    a, at = ("a_dot", 0.0) if level is None else ("a", level)
    text = COMPLEMENTARY.replace("MASS", mass).replace("METHOD", method)
    text = text.replace("RISES", f"{a} >= {at}").replace("FALLS", f"{a} <= {at}")
    found = simulate(text, error_bar="never")
    assert found.outcome == "done"
    if level is None:
        times = [("up" if k % 2 else "down", math.pi * (k + 0.5)) for k in range(9)]
        times.append(("up", math.pi * 9.5))
    else:
        first = math.asin(level)
        both = [("up", first), ("down", math.pi - first)]
        times = [(n, t + 2 * math.pi * k) for k in range(5) for n, t in both]
    assert [n for n, _ in acts(found)] == [n for n, _ in times]
    exact = "step" not in method
    bound = 1e-10 if exact else 1e-3
    assert [t for _, t in acts(found)] == pytest.approx(
        [t for _, t in times], abs=bound
    )


@pytest.mark.parametrize("method", ["auto", "rk4, step: 0.01", "moreau, step: 0.01"])
def test_a_toggle_by_the_set_of_another_event_is_no_chatter(method):
    text = """
modes: {phase: 0, valve: 0}
forces: {x: valve}
events:
  tick: {every: 0.1, set: {phase: 'mod(phase + 1, 4)'}}
  toggle: {at: phase >= 3, set: {valve: 1 - valve}}
"""
    found = simulate(scene(text, "x: 1", 2.75, method=method), error_bar="never")
    assert found.outcome == "done"
    expected = [0.2 + 0.4 * k for k in range(7)]
    assert acts(found, "toggle") == pytest.approx(expected, abs=1e-12)
    assert found["valve"][-1] == 1


@pytest.mark.parametrize(
    ("start", "until", "end"),
    [
        ("x: 0.48, y: 0.37, x_dot: 0.29", "x - y >= 0.11", 1.0),
        ("x: 0.48, y: 0.37, x_dot: -0.29", "x - y >= 0.11", 1.0),
        ("x: 0.48, y: 0.37, x_dot: 0.29", "x - y = 0.11", 1.0),
        ("x: 0.37, y: 0.48, x_dot: 0.29", "x - y <= -0.11", 1.0),
        ("x: 0.37, y: 0.48, x_dot: 0.29", "x >= y", 11 / 29),
    ],
)
def test_what_is_true_at_the_start_but_for_rounding_is_true(start, until, end):
    sections = """coordinates: {x: {}, y: {}}
energy: {kinetic: (x_dot^2 + y_dot^2)/2, potential: 0}
"""
    text = scene("", start, 1, sections, until=until)
    found = simulate(text, error_bar="never")
    assert found.t[-1] == pytest.approx(end, abs=1e-13)
    assert found.outcome == ("done" if end == 1.0 else "until")


@pytest.mark.slow
def test_acts_at_the_start_make_conditions_true_there():
    text = """
modes: {n: 0, seen: 0, twice: 0}
events:
  late: {at: seen >= 5, set: {twice: twice + 1}}
  tick: {every: 1, set: {n: n + 1}}
  first: {at: n >= 1, set: {seen: 5}}
"""
    found = simulate(scene(text, "x: 0, x_dot: 1"), error_bar="never")
    assert acts(found)[:3] == [("tick", 0.0), ("first", 0.0), ("late", 0.0)]
    assert modes_at(found, 0.0, "n", "seen", "twice") == [1, 5, 1]
    assert found["twice"][-1] == 1
    ended = simulate(scene(text, "x: 0, x_dot: 1", until="twice >= 1"))
    assert (ended.outcome, ended.t.tolist()) == ("until", [0.0])
    # True there without an act, it counts after it has been false.
    late = simulate(scene(text, "x: 0, x_dot: 1", until="n <= 1"))
    assert late.outcome == "done"


def test_events_that_undo_each_other_at_the_start_end_the_run_there():
    text = """
modes: {u: 0}
events:
  tick: {every: 1, set: {u: 1}}
  on: {at: u >= 1, set: {u: -1}}
  off: {at: u <= -1, set: {u: 1}}
"""
    found = simulate(scene(text, "x: 0, x_dot: 1"), error_bar="never")
    assert found.record["failure"]["number"] == "E512"
    assert "`on`, `off`" in found.record["reason"]
    assert found.record["end"] == 0.0


@pytest.mark.parametrize(
    ("events", "acts", "end"),
    [
        # Both are due at once; the second restores the mode, and no event follows.
        ("a: {at: x >= 0.5, set: {u: 1 - u}}, b: {at: x >= 0.5, set: {u: 1 - u}}",
         ["a", "b"], 1.0),
        ("a: {at: x >= 0.5, set: {u: 1}}, b: {at: x >= 0.5, set: {u: 0}}",
         ["a", "b"], 1.0),
        # The second is due by the first, and restores the mode.
        ("a: {at: x >= 0.5, set: {u: 1}}, b: {at: u >= 1, set: {u: 0}}",
         ["a", "b"], 1.0),
        ("b: {at: u >= 1, set: {u: 0}}, a: {at: x = 0.5, set: {u: 1}}",
         ["a", "b"], 1.0),
        ("a: {at: x - u >= 0.5, set: {u: 1}}, b: {at: x - u <= -0.2, set: {u: 0}}",
         ["a", "b"], 0.5),
    ],
)  # fmt: skip
def test_events_that_restore_a_mode_end_the_run_only_in_a_cycle(events, acts, end):
    text = f"""
coordinates: {{x: {{}}}}
energy: {{kinetic: x_dot^2/2, potential: 0}}
modes: {{u: 0}}
events: {{{events}}}
initial: {{x: 0, x_dot: 1}}
simulation: {{duration: 1, output_step: 0.1}}
"""
    found = simulate(text, error_bar="never")
    assert [event.name for event in found.events] == acts
    assert found.t[-1] == end
    if end < 1.0:
        assert found.record["failure"]["number"] == "E512"
        assert "`a`, `b`" in found.reason


@pytest.mark.slow
def test_a_jump_of_a_mode_through_0_counts_and_one_of_the_relation_does_not():
    text = """
modes: {level: 0, by_mode: 0, by_mod: 0, by_floor: 0, by_if: 0}
events:
  jump: {every: 1, set: {level: level + 10}}
  passed: {at: x + level = 4.7, set: {by_mode: by_mode + 1}}
  wrapped: {at: 'mod(x, 2) = 1.5', set: {by_mod: by_mod + 1}}
  stepped: {at: floor(x) = 2.5, set: {by_floor: by_floor + 1}}
  chosen: {at: 'if(x > 2.25, 1, -1) = 0', set: {by_if: by_if + 1}}
"""
    found = simulate(scene(text, "x: -0.5, x_dot: 2", 4, method="dop853"))
    # x = 2 t - 0.5 is 1.5, 3.5, 5.5, 7.5 (the end) where mod is 1.5; and 10 are added
    # at the start, where x + level passes 4.7 by that.
    assert acts(found, "wrapped") == pytest.approx([1.0, 2.0, 3.0, 4.0], abs=1e-12)
    assert acts(found, "passed") == [0.0]
    assert (found["by_floor"][-1], found["by_if"][-1]) == (0, 0)


@pytest.mark.parametrize("until", ["x >= 1", "2*x >= 2", "x = 1"])
def test_an_event_with_the_condition_of_until_acts_before_the_end(until):
    text = f"""
modes: {{n: 0, k: 0}}
events:
  hit: {{at: {until}, set: {{n: n + 1}}}}
  then: {{at: n >= 1, set: {{k: k + 1}}}}
"""
    found = simulate(scene(text, "x: 0, x_dot: 0.7", until=until), error_bar="never")
    assert found.outcome == "until"
    assert [n for n, _ in acts(found)] == ["hit", "then"]
    assert {t for _, t in acts(found)} == {found.t[-1]}
    assert (found["n"][-1], found["k"][-1]) == (1, 1)


@pytest.mark.slow
@pytest.mark.parametrize("method", ["auto", "rk4, step: 0.01"])
def test_an_event_at_the_ground_acts_by_the_state_before_the_impact(method):
    ball = FREE.replace("potential: 0", "potential: 10*x")
    text = """
modes: {v: 0, n: 0, after: 0}
events:
  hit: {at: x <= 0, set: {v: x_dot, n: n + 1}}
  up: {at: x_dot >= 0, set: {after: x_dot}}
constraints: {floor: {relation: x >= 0, restitution: 0.5}}
"""
    asked = {"method": method, "output_step": 0.1}
    found = simulate(scene(text, "x: 0.2", 0.7, ball, **asked), error_bar="never")
    # Down at 2 m/s at t = 0.2, up at 1, down at 1 at 0.4, up at 0.5, at 0.5.
    impacts = [x.time for x in found.events if x.kind == "impact"]
    assert impacts[:3] == pytest.approx([0.2, 0.4, 0.5], abs=1e-12)
    assert acts(found, "hit") == acts(found, "up") == impacts
    at = found.at(impacts[:2])
    assert at["v"] == pytest.approx([-2, -1], abs=1e-11)
    assert at["x_dot"] == pytest.approx([1, 0.5], abs=1e-11)
    assert at["after"].tolist() == at["x_dot"].tolist()
    before, after = np.flatnonzero(found.t == impacts[0])
    assert (found["n"][before], found["n"][after]) == (0, 1)
    assert found["x_dot"][before] == pytest.approx(-2, abs=1e-11)
    assert found["v"][after] == pytest.approx(-2, abs=1e-11)


@pytest.mark.parametrize("order", [1, -1])
@pytest.mark.parametrize(
    "scale", [(0.0, 1.0, 0.0), (1e6, 1.0, 0.0), (0.0, 1e-3, 0.0), (0.0, 1.0, 1e6)]
)
def test_a_condition_met_at_the_time_of_a_beat_acts_at_it(scale, order):
    """Far from the origin, in other units, late; in either order of the file."""
    far, unit, start = scale
    events = [
        f"hit: {{at: x >= {far + 0.6 * unit!r}, set: {{seen: n, m: 2*m}}}}",
        "beat: {every: 0.2, set: {n: n + 1, m: m + 1}}",
    ][::order]
    text = "modes: {n: 0, m: 1, seen: 0}\nevents:\n  " + "\n  ".join(events)
    begin = f"x: {far!r}, x_dot: {unit!r}"
    found = simulate(scene(text, begin, 1, start=start, output_step=0.1))
    [time] = acts(found, "hit")
    assert time in acts(found, "beat")
    assert time == pytest.approx(start + 0.6, abs=1e-9)
    # The fourth beat is before `hit` or after it: (5, 4) or (4*2 + 1, 3).
    assert modes_at(found, time, "n", "seen") == [4, 4 if order < 0 else 3]
    assert modes_at(found, time, "m") == [10 if order < 0 else 9]


@pytest.mark.parametrize("order", [1, -1])
@pytest.mark.parametrize("method", ["auto", "rk4, step: 0.01", "kahan-li8, step: 0.05"])
@pytest.mark.parametrize("far", [1e3, 1e9])
def test_one_condition_written_in_several_ways_acts_at_one_instant(far, method, order):
    """The rounding of each way is its own; the time is that of the least."""
    ways = {
        "near": "x >= 0.3",
        "far": f"x + {far!r} - {far!r} >= 0.3",
        "scaled": f"x*{far!r} + {far!r} >= 0.3*{far!r} + {far!r}",
        "within": f"sin(x + {far!r}) >= sin(0.3 + {far!r})",
    }
    rises = math.cos(0.3 + far) > 0.0
    if not rises:
        ways["within"] = ways["within"].replace(">=", "<=")
    events = [
        f"{name}: {{at: {at}, set: {{m: 2*m + {k}}}}}"
        for k, (name, at) in enumerate(ways.items())
    ][::order]
    text = "modes: {m: 1}\nevents:\n  " + "\n  ".join(events)
    asked = {"method": method, "output_step": 0.07}
    found = simulate(scene(text, "x: 0.02, x_dot: 0.7", 1, **asked), error_bar="never")
    listed = acts(found)
    assert [name for name, _ in listed] == [*ways][::order]
    assert len({t for _, t in listed}) == 1
    assert listed[0][1] == pytest.approx(0.4, abs=1e-13)
    # 1 -> 2 + 0 -> 4 + 1 -> 10 + 2 -> 24 + 3; and 1 -> 2 + 3 -> 10 + 2 -> 24 + 1 -> 50.
    assert found["m"][-1] == (27 if order > 0 else 50)


# Motions that reach the ground at a speed known in closed form, by energy.
FALLS = [
    ("x^2/2", "x: 2", "2"),
    ("-cos(x)", "x: 1", "sqrt(2*(1 - cos(1)))"),
    ("x^2/2 + x^4/4", "x: 1.3, x_dot: 0.2", "sqrt(0.04 + 1.69 + 1.3^4/2)"),
]


@pytest.mark.parametrize("method", ["auto", "rk4, step: 0.002"])
@pytest.mark.parametrize("e", [0.5, 0.8, 1])
@pytest.mark.parametrize(("potential", "begin", "speed"), FALLS)
def test_a_speed_that_an_impact_leaves_is_reached(potential, begin, speed, e, method):
    """Within the error of the speed, though it falls from there."""
    body = FREE.replace("potential: 0", f"potential: {potential}")
    text = f"""
modes: {{n: 0, m: 0, none: 0}}
events:
  up: {{at: "x_dot >= {e}*{speed}", set: {{n: n + 1}}}}
  scaled: {{at: "x_dot/({speed}) >= {e}", set: {{m: m + 1}}}}
  less: {{at: "x_dot >= {e}*{speed}*(1 + 1e-6)", set: {{none: none + 1}}}}
constraints: {{floor: {{relation: x >= 0, restitution: {e}}}}}
"""
    asked = {"method": method, "output_step": 0.1}
    found = simulate(scene(text, begin, 2, body, **asked), error_bar="never")
    hit = next(x.time for x in found.events if x.kind == "impact")
    assert acts(found, "up")[0] == acts(found, "scaled")[0] == hit
    assert not acts(found, "less")


@pytest.mark.parametrize(
    "start", ["l*cos(pi/2)", "l*sin(pi)", "l*(0.1 + 0.2 - 0.3)", "-l*sin(pi)"]
)
@pytest.mark.parametrize(
    ("until", "speed", "end"),
    [
        # x = speed*sin(t) to rounding: true at the start, it counts once it was false.
        ("x <= 0", 1, math.pi),
        ("x <= 0", -1, 2 * math.pi),
        ("x >= 0", -1, math.pi),
        ("x >= 0", 1, 2 * math.pi),
        ("x = 0", 1, math.pi),
    ],
)
def test_a_start_value_that_is_0_but_for_rounding_is_0(start, until, speed, end):
    body = FREE.replace("potential: 0", "potential: x^2/2")
    body = f"parameters: {{l: 1.1}}\n{body}"
    begin = f'x: "{start}", x_dot: {speed}'
    found = simulate(scene("", begin, 10, body, until=until), error_bar="never")
    assert found.outcome == "until"
    assert found.t[-1] == pytest.approx(end, abs=1e-10)


JUMPS = [
    # (x at the start, condition, whether it becomes true just after)
    (0, "mod(-x, 2) >= 1", True),
    (4, "mod(-x, 2) >= 1", True),
    (-6, "mod(-x, 2) >= 1", True),
    (0, "sign(x) >= 1", True),
    (0, "-ceil(x) <= -1", True),
    (0, "if(x <= 0, -1, 2) >= 0", True),
    (0.3, "mod(-x, 2) >= 1.9", False),
    (0, "sin(x) >= 1e-9", False),
    (0, "x >= 1e-9", False),
]


@pytest.mark.parametrize(("start", "at", "jumps"), JUMPS)
def test_a_jump_just_after_the_start_is_at_its_instant(start, at, jumps):
    text = f'modes: {{u: 0}}\nevents: {{up: {{at: "{at}", set: {{u: u + 1}}}}}}\n'
    begin = f"x: {start}, x_dot: 0.25"
    asked = {"output_step": 0.25}
    found = simulate(scene(text, begin, 1, **asked), error_bar="never")
    assert (acts(found)[:1] == [("up", 0.0)]) == jumps
    assert found["u"][0] == jumps
    ended = simulate(scene("", begin, 1, until=at, **asked), error_bar="never")
    assert (ended.t[-1] == 0.0) == jumps


# From rest x falls through 0, where each condition jumps and is true from then on,
# whatever the event sets; beside it a switch jumps by the event, or a body rebounds.
BEGUN = """
name: scene
coordinates: {x: {}, y: {}}
initial: {x: 0, x_dot: 0, y: 0, y_dot: -1}
energy: {kinetic: x_dot^2 + y_dot^2/2, potential: 0}
modes: {u: 0, n: 0}
"""
BESIDE = {
    "nothing": "forces: {x: -0.25}",
    "switch": "forces: {x: -0.25, y: sign(u - 0.5 - floor(2*y + 0.25))}",
    "impact": """forces: {x: -0.25}
constraints: {ground: {relation: y >= 0, restitution: 0.5}}""",
}


@pytest.mark.parametrize("beside", BESIDE)
@pytest.mark.parametrize(
    "at", ["floor(x/2) + x <= -0.5", "0.01*n + floor(3*x) <= -0.5"]
)
def test_what_acts_at_the_start_acts_once(at, beside):
    found = simulate(
        f"""{BEGUN}{BESIDE[beside]}
events: {{up: {{at: "{at}", set: {{u: 1, n: n + 1}}}}}}
simulation: {{duration: 1, output_step: 0.1}}
""",
        error_bar="never",
    )
    assert acts(found) == [("up", 0.0)]
    assert found["n"][-1] == 1


@pytest.mark.parametrize(
    ("at", "acts_there"),
    [("x_dot >= 0.5", True), ("x_dot >= 1", True), ("x_dot >= 1.1", False)],
)
def test_an_impact_at_the_start_makes_conditions_true(at, acts_there):
    ball = FREE.replace("potential: 0", "potential: 10*x")
    text = f"""
modes: {{n: 0}}
events: {{up: {{at: {at}, set: {{n: n + 1}}}}}}
constraints: {{floor: {{relation: x >= 0, restitution: 0.5}}}}
"""
    begin = "x: 0, x_dot: -2"
    found = simulate(scene(text, begin, 0.15, ball, output_step=0.1), error_bar="never")
    assert found["x_dot"][:2].tolist() == [-2, 1]
    assert found["n"].tolist() == ([0, 1, 1, 1] if acts_there else [0, 0, 0, 0])
    assert acts(found) == ([("up", 0.0)] if acts_there else [])
    floor = text.split("}\n", 2)[2]
    ended = simulate(scene(floor, begin, 0.15, ball, until=at), error_bar="never")
    assert (ended.outcome == "until") == (ended.t[-1] == 0.0) == acts_there


@pytest.mark.parametrize("height", [0, 0.001])
def test_an_impact_makes_an_equation_true_at_the_start_and_later_alike(height):
    # The rebound takes x_dot from -v through 0.2 to v/2, and gravity back through 0.2.
    ball = FREE.replace("potential: 0", "potential: 10*x")
    text = """
modes: {n: 0}
events: {up: {at: x_dot = 0.2, set: {n: n + 1}}}
constraints: {floor: {relation: x >= 0, restitution: 0.5}}
"""
    begin = f"x: {height}, x_dot: -1"
    found = simulate(
        scene(text, begin, 0.06, ball, output_step=0.02), error_bar="never"
    )
    speed = math.sqrt(1 + 20 * height)
    struck = (speed - 1) / 10
    times = [struck, struck + (speed / 2 - 0.2) / 10]
    assert [name for name, _ in acts(found)] == ["up", "up"]
    assert [t for _, t in acts(found)] == pytest.approx(times, abs=1e-12)
