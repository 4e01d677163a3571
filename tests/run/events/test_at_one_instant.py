"""Conditions that are true, or false, at one instant alone."""

import pytest

from tests.support import simulate

MODEL = """
coordinates: {{x: {{}}, y: {{}}}}
energy: {{kinetic: x_dot^2/2 + y_dot^2/2, potential: "0"}}
forces: {{y: u}}
initial: {{x: 0, y: 0, x_dot: 1}}
modes: {{u: {u}, k: 0}}
events:
  first: {{every: 1, once: true, set: {{u: {then}}}}}
  acting: {{at: "{condition}", set: {{k: k + 1}}}}
simulation: {{duration: 0.5, output_step: 0.1{more}}}
"""


@pytest.mark.parametrize(
    ("condition", "u", "then", "acts"),
    [
        # False before the act, 0 >= 0 after it, and false once x has grown.
        ("u >= x", -1, 0, 1),
        ("-u <= -x", -1, 0, 1),
        ("u*abs(1 + x) >= x", -1, 0, 1),
        # True before the act, too; or still false after it.
        ("u >= x", 0, 0, 0),
        ("u >= x", -1, -0.5, 0),
        # 0 <= 0 is true at the start, and the force that the act sets keeps it true.
        ("x <= y_dot", 0, 3, 0),
        ("x <= y_dot", 3, 0, 0),
    ],
)
def test_a_condition_that_an_act_makes_true_at_once_acts_once(condition, u, then, acts):
    found = simulate(MODEL.format(condition=condition, u=u, then=then, more=""))
    assert found["k"].tolist() == [acts] * len(found["t"])
    listed = [e for e in found.events if e.name == "acting"]
    assert [e.time for e in listed] == [0.0] * acts


@pytest.mark.slow
@pytest.mark.parametrize(("then", "end"), [(0.5, 0.0), (1.5, 0.5), (-0.5, 0.5)])
def test_until_that_an_act_makes_false_at_the_start_alone_ends_the_run(then, end):
    # u + sign(x) >= 1: true at x = 0 for u = 1.5 alone, after it for u = 0.5, too.
    more = ', until: "u + sign(x) >= 1"'
    found = simulate(MODEL.format(condition="k >= 5", u=1.5, then=then, more=more))
    assert found.record["end"] == end
    assert found.outcome == ("until" if end == 0.0 else "done")


# Conditions that are false at t = 0, x = 0, and jump to true just after it, if x has
# the given velocity.
JUMPS = {
    "atan2(x, -1) <= -3": -1, "0^abs(x) <= 0.5": 1, "sign(t) + x >= 0.5": 1,
    "exp(-abs(x)/1e-300) <= 0.5": -1,
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("method", ["auto", "rk4, step: 0.05"])
@pytest.mark.parametrize("condition", JUMPS)
def test_a_condition_that_jumps_just_after_the_start_acts_at_the_start(
    condition, method
):
    found = simulate(
        "coordinates: {x: {}}\nenergy: {kinetic: x_dot^2/2, potential: 0}\n"
        f"modes: {{n: 0}}\nevents: {{act: {{at: '{condition}', set: {{n: n + 1}}}}}}\n"
        f"initial: {{x: 0, x_dot: {JUMPS[condition]}}}\n"
        f"simulation: {{duration: 1, method: {method}}}\n"
    )
    assert [(e.name, e.time) for e in found.events] == [("act", 0.0)]
