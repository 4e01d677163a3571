"""Ends of tables without values beyond them, in conditions, sections and forces.

The motion is free, x = t, unless a force is given. The table f has points from 0 to 3.
"""

import math
import re

import pytest

from lagsim import InputError, load, simulate

MODEL = """
coordinates: {{x: {{}}}}
energy: {{kinetic: x_dot^2/2, potential: 0}}
tables: {{f: {{points: [[0, 1], [1, 2], [3, 1]], interpolation: {how}}}}}
modes: {{n: 0}}
{more}
initial: {{x: {x}, x_dot: {v}}}
simulation: {{duration: 7, output_step: 0.5}}
"""
EVENT = 'events: {{act: {{at: "{}", set: {{n: n + 1}}}}}}'
SECTION = (
    "events: {{act: {{at: x >= 99, set: {{n: n + 1}}}}}}\n"
    'output: {{sections: {{s: {{at: "{}", direction: both}}}}}}'
)
FORCE = 'forces: {{x: "{}"}}\nevents: {{act: {{at: x >= 99, set: {{n: n + 1}}}}}}'
METHODS = ["auto", "rk4"]


def simulated(more, relation, method="auto", how="linear", x=0, v=1):
    text = MODEL.format(more=more.format(relation), how=how, x=x, v=v)
    fixed = {"step": 0.1} if method == "rk4" else {}
    return simulate(load(text), error_bar="never", method=method, **fixed)


def end_of(found):
    """Return the time at which a run has ended with a table; None if it has not."""
    if found.complete:
        return None
    assert found.record["failure"]["code"] == "table-ends"
    return float(re.search(r"at t = ([0-9.]+)", found.record["reason"])[1])


ENDS = [
    ("x*f(t)", 3),
    ("x*f(mod(t, 4))", 3),
    ("f(mod(x, 4))", 3),
    ("f(mod(x + 2, 4))", 1),
    ("f(1.5*mod(x, 2.5))", 2),
    ("f(1 + 3*heaviside(x - 5))", 5),
    ("x*f(1 + 3*heaviside(t - 5))", 5),
    ("f(1 - 2*floor(x/6))", 6),
    ("f(x - 4*heaviside(t - 2.5))", 2.5),
    ("if(x < 6.5, f(mod(x, 4)), 0)", 3),
    ("if(x > 3.5, f(mod(x, 4)), 0)", 3.5),
    ("f(x)*f(t)", 3),
    ("f(abs(x - 3))", 6),
]
HOLDS = [
    "f(mod(x, 2))",
    "f(mod(x, 3))",
    "x*f(mod(t, 3))",
    "f(3 - mod(x, 3))",
    "f(x - 2*floor(t/2))",
    "f(1 + heaviside(x - 5))",
    "f(min(x, 3))",
    "x*f(min(t, 3))",
    "if(x <= 3, f(x), 0)",
    "if(x < 3, f(x), 0)",
    "if(t <= 3, x*f(t), 0)",
    "if(mod(x, 4) <= 3, f(mod(x, 4)), 0)",
    "if(x < 3 and x > 0.5, f(x), 0)",
    "if(n > 0, x*f(t), 0)",
    "if(x_dot < 0, f(x), 0)",
]


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(("table", "time"), ENDS)
def test_a_run_ends_where_a_table_in_a_condition_does(table, time, method):
    found = simulated(EVENT, f"{table} >= 99", method)
    assert end_of(found) == pytest.approx(time, abs=1e-12)


@pytest.mark.parametrize("how", ["linear", "cubic"])
@pytest.mark.parametrize(("table", "time"), ENDS[:6])
def test_a_run_ends_where_a_table_in_a_section_does(table, time, how):
    found = simulated(SECTION, f"{table} = 99", how=how)
    assert end_of(found) == pytest.approx(time, abs=1e-12)
    assert not len(found.sections["s"]["t"])


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("table", HOLDS)
def test_a_run_does_not_end_within_a_table(table, method):
    assert end_of(simulated(EVENT, f"{table} >= 99", method)) is None


@pytest.mark.parametrize("table", HOLDS)
def test_a_run_does_not_end_within_a_table_of_a_section(table):
    assert end_of(simulated(SECTION, f"{table} = 99")) is None


@pytest.mark.slow
@pytest.mark.parametrize("method", METHODS)
def test_acts_of_conditions_with_a_table_of_a_remainder(method):
    found = simulated(EVENT, "f(mod(x, 2)) >= 1.9", method)
    times = [e.time for e in found.events if e.name == "act"]
    assert times == pytest.approx([0.9, 2.9, 4.9, 6.9], abs=1e-12)
    found = simulated(SECTION, "f(mod(x, 2)) = 1.5", method)
    assert list(found.sections["s"]["t"]) == pytest.approx([0.5, 2.5, 4.5, 6.5])


@pytest.mark.parametrize("method", METHODS)
def test_a_table_has_a_value_at_its_last_point(method):
    # From x = 3, where f is 1, at the speed 1: x_ddot is 1 in all of the run.
    found = simulated(FORCE, "f(min(x, 3))", method, x=3)
    assert end_of(found) is None
    assert found["x"][-1] == pytest.approx(3 + 7 + 7**2 / 2, rel=1e-12)
    assert found["x_ddot"] == pytest.approx(1)


def test_a_body_leaves_the_last_point_of_a_table_inwards():
    # x_ddot = -f(x) = -(5 - x)/2 from t = 1 on, so 5 - x = 2 cosh((t - 1)/sqrt(2)).
    found = simulated(FORCE, "-heaviside(t - 1)*f(x)", x=3, v=0)
    reached = 1 + math.sqrt(2) * math.acosh(2)
    [time] = [e.time for e in found.events if abs(e.time - reached) < 0.1]
    assert time == pytest.approx(reached, abs=1e-9)  # the knot x = 1


@pytest.mark.parametrize(
    ("start", "ends", "text"),
    [
        ("0.1 + 0.2", (-1, 0.3), "x = 0.30000000000000004 is past the end 0.3"),
        ("0.3 - 1e-16", (0.3, 2), "x = 0.2999999999999999 is past the end 0.3"),
    ],
)
def test_a_start_past_an_end_by_rounding_is_named(start, ends, text):
    low, high = ends
    model = f"""
coordinates: {{x: {{}}}}
tables: {{f: {{points: [[{low}, 1], [{high}, 2]], interpolation: linear}}}}
energy: {{kinetic: x_dot^2/2, potential: 0}}
forces: {{x: f(x)}}
initial: {{x: {start}}}
simulation: {{duration: 0.5}}
"""
    with pytest.raises(InputError) as caught:
        simulate(model)
    [problem] = caught.value.problems
    assert problem.code == "not-finite"
    assert text in problem.hint
