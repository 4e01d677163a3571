"""Conditions that have no value on a part of the motion: they are false there.

The motion is free, x = x0 + t, so that steps are far longer than the part.
"""

import math

import pytest

import lagsim

MODEL = """
coordinates: {x: {}}
energy: {kinetic: x_dot^2/2, potential: 0}
modes: {n: 0}
events: {e: {at: "CONDITION", set: {n: n + 1}}}
initial: {x: 0, x_dot: 1}
simulation: {duration: 7, output_step: 0.5}
"""
UNTIL = """
coordinates: {x: {}}
energy: {kinetic: x_dot^2/2, potential: 0}
initial: {x: 0, x_dot: 1}
simulation: {duration: 7, output_step: 0.5, until: "CONDITION"}
"""

# Steps whose arguments have no value on a part of the motion, x = t.
STEPS = {
    "floor(3*sqrt(1 - x)) <= -1": [],
    "floor(3*sqrt(1 - x)) <= 1": [5 / 9],
    "mod(sqrt(1 - x), 0.4) >= 0.3": [0.36, 0.84],
    "sign(log(x - 1)) >= 0.5": [2],
    "sign(log(x - 1)) <= -0.5": [1],
    "floor(sqrt(x - 2)) >= 1": [3],
    "mod(sqrt(x - 1), 1) <= 0.5": [1, 2, 5],
    "mod(sqrt(abs(x - 3.2)), 1) <= 0.5": [0.95, 2.95, 4.2],
    "ceil(asin(x - 4)) >= 1": [4],
}


@pytest.mark.parametrize("method", ["auto", "dop853", "rk4"])
@pytest.mark.parametrize("condition", STEPS)
def test_a_step_without_a_value_is_false(condition, method):
    found = simulated(MODEL, condition, method)
    assert found.t[-1] == 7
    assert times_of(found) == pytest.approx(STEPS[condition], abs=1e-9)


FIRST = 1.5 + math.asin(0.25) / math.pi


def simulated(model, condition, method):
    fixed = {"step": 0.1} if method == "rk4" else {}
    text = model.replace("CONDITION", condition)
    return lagsim.simulate(lagsim.load(text), error_bar="never", method=method, **fixed)


def times_of(found):
    return [e.time for e in found.events if e.kind == "event"]


@pytest.mark.parametrize("method", ["auto", "rk4"])
@pytest.mark.parametrize(
    ("condition", "times"),
    [
        ("sqrt(4.5 - x) <= 0.5", [4.25]),
        ("sqrt(4.5 - x) = 0.5", [4.25]),
        ("sqrt(4.5 - x) <= 1e-5", [4.5]),
        ("sqrt(4.5 - x) >= 9", []),
        ("sqrt(2 - x) + x >= 2.2", [2 - (1 + math.sqrt(0.2)) ** 2 / 4]),
        ("log(4.5 - x) <= -9", [4.5 - math.exp(-9)]),
        ("asin(x - 4) >= 1.57", [4 + math.sin(1.57)]),
        ("acos(x - 4) <= 0.5", [4 + math.cos(0.5)]),
        ("(4.5 - x)^1.5 <= 1", [3.5]),
        ("(4.5 - x)^1.5 <= -1", []),
        ("sqrt(x - 2) >= 0", [2]),
        ("sqrt(x - 2) >= 0.5", [2.25]),
        ("sqrt(x - 2) = 0.5", [2.25]),
        ("sqrt(x - 2) <= 1", [2]),
        ("sqrt((x - 2)*(x - 4)) >= 0.5", [3 + math.sqrt(1.25)]),
        ("sqrt((x - 2)*(x - 4)) <= 0.5", [3 - math.sqrt(1.25), 4]),
        ("sqrt(cos(pi*x)) >= 0.5", [FIRST, FIRST + 2, FIRST + 4]),
    ],
)  # fmt: skip
def test_a_condition_is_false_where_it_has_no_value(condition, times, method):
    found = simulated(MODEL, condition, method)
    assert found.complete
    assert times_of(found) == pytest.approx(times, abs=1e-9)


@pytest.mark.parametrize("method", ["dop853", "radau", "taylor"])
def test_a_run_ends_for_every_method(method):
    found = simulated(MODEL, "sqrt(4.5 - x) <= 0.5", method)
    assert found.complete
    assert times_of(found) == pytest.approx([4.25], abs=1e-9)


@pytest.mark.parametrize(
    ("condition", "end"),
    [("sqrt(4.5 - x) >= 9", 7), ("sqrt(4.5 - x) <= 0.5", 4.25), ("sqrt(x - 5) = 1", 6)],
)  # fmt: skip
def test_until_is_not_met_where_it_has_no_value(condition, end):
    found = simulated(UNTIL, condition, "auto")
    assert found.t[-1] == pytest.approx(end, abs=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("method", ["auto", "rk4", "dop853"])
@pytest.mark.parametrize(
    ("relation", "times"),
    [
        ("sqrt(4.5 - x) = 0.5", [4.25]),
        ("sqrt(4.5 - x) = 9", []),
        ("sqrt(x - 2) = 0.5", [2.25]),
        ("asin(x - 4) = 1.5", [4 + math.sin(1.5)]),
        ("sqrt((x - 2)*(x - 4)) = 0.5", [3 - math.sqrt(1.25), 3 + math.sqrt(1.25)]),
    ],
)
def test_sections_have_no_row_where_their_relation_has_no_value(
    relation, times, method
):
    section = f'output: {{sections: {{s: {{at: "{relation}", direction: both}}}}}}\n'
    model = UNTIL.replace(', until: "CONDITION"', "") + section
    found = simulated(model, "", method)
    assert found.complete
    assert list(found.sections["s"]["t"]) == pytest.approx(times, abs=1e-9)


BESIDE_A_BALL = """
coordinates: {x: {}, z: {}}
energy: {kinetic: (x_dot^2 + z_dot^2)/2, potential: z}
modes: {n: 0}
constraints: {floor: {relation: z >= 0, restitution: 0.5}}
events: {e: {at: "CONDITION", set: {n: n + 1}}}
initial: {x: 0, x_dot: 1, z: 0.5}
simulation: {duration: 3.3, output_step: 0.5}
"""


@pytest.mark.slow
@pytest.mark.parametrize("method", ["auto", "rk4"])
@pytest.mark.parametrize(
    ("condition", "times"),
    [
        ("log10(abs(x - 1.2) - 0.3) <= -1", [0.8, 1.5]),
        ("log(x^2 - 0.3) <= -1", [math.sqrt(0.3)]),
    ],
)
def test_impacts_satisfy_no_condition_that_began_at_a_pole(condition, times, method):
    # The ball strikes the floor at 1, 2, 2.5, 2.75, ...: after each condition's end.
    found = simulated(BESIDE_A_BALL, condition, method)
    assert found.complete
    assert times_of(found) == pytest.approx(times, abs=1e-8)


@pytest.mark.slow
@pytest.mark.parametrize("method", ["dop853", "taylor", "radau"])
@pytest.mark.parametrize(
    ("relation", "event"),
    [
        ("log(x) - 0.3*x", "log(x) - 0.3*x <= -0.357"),
        ("-1/sqrt(x)", "-1/sqrt(x) <= -0.8"), ("log10(2*x)", "log10(2*x) <= 0.5"),
        ("log(x)", "log(x) <= 0.1"),
    ],
)  # fmt: skip
def test_a_section_that_begins_at_a_pole_is_crossed_at_its_value(
    relation, event, method
):
    # x = 2 sin(t) passes 0.14 upwards, where the relation has a value again, and the
    # event acts at the pole.
    level = relation.replace("x", "0.14")
    result = lagsim.simulate(
        "coordinates: {x: {}}\nenergy: {kinetic: x_dot^2/2, potential: x^2/2}\n"
        "initial: {x: 0, x_dot: 2}\nmodes: {n: 0}\n"
        f"events: {{e: {{at: '{event}', set: {{n: n + 1}}}}}}\n"
        f"output: {{sections: {{up: {{at: '{relation} = {level}', direction: up}}}}}}\n"
        f"simulation: {{duration: 20, output_step: 0.5, method: {method}}}\n",
        error_bar="never",
    )
    first = math.asin(0.07)
    expected = [first + 2.0 * math.pi * k for k in range(4)]
    assert list(result.sections["up"]["t"]) == pytest.approx(expected, abs=1e-7)
