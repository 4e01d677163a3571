"""Switches whose arguments step at a rate that rests at 0.

A block slides at 1/8 against a limit 1/2 and rests from t = 1/4 on. A lorry beside it
has the velocity t. An argument such as `1 - t - 0.6*sign(x_dot)` is 1.6 - t or 0.4 - t
beside the rest and 1 - t at rest, where it passes 0 at t = 1 and at no other time.
"""

import numpy as np
import pytest

import lagsim

BLOCK = """\
parameters: {{c: {far}, u: {unit}}}
coordinates: {{x: {{}}, y: {{}}}}
definitions:
  {{v: x_dot*u, w: y_dot*u, s: t/u, late: "{late}", slow: floor(abs(v) - 0.1)}}
energy: {{kinetic: x_dot^2/2 + {beside}*y_dot^2/2, potential: 0}}
initial: {{x: c, x_dot: 0.125/u, y: 0, y_dot: 0}}
forces: {{x: 0.25*late/u^2, y: {beside}/u^2}}
constraints: {{rub: {{relation: x_dot = 0, limit: 0.5/u^2}}}}
simulation: {{duration: 2*u, output_step: u/16}}
"""
STEPS = (
    "heaviside({})",
    "if({} > 0, 1, 0)",
    "(1 + sign({}))/2",
    "1 + max(-1, floor(({})/4))",
    "1 - heaviside(-({}))",
)
ARGUMENTS = (
    "1 - s - 0.6*sign(v)",
    "if(x > c - 10, -0.6*sign(v), v) + 1 - s",
    "1 - w - 0.6*sign(v)",
    "if(x > c - 10, -0.6*sign(v), v) + 1 - 2*y",
    "if(x > c - 10, 0.6*slow*sign(v), v) + 1 - w*s",
    "1 - w + v - 0.6*sign(v)",
)


def check(argument, step="heaviside({})", **other):
    """Compare the step at rest with that of 1 - t, and its switches."""
    given = {"far": 0.0, "unit": 1.0, "beside": 1.0}
    given |= {"late": step.format(argument)} | other
    model = lagsim.load(BLOCK.format(**given))
    result = lagsim.simulate(model, error_bar="never")
    time, unit = result["t"] / given["unit"], given["unit"]
    rests = time > 0.5
    clear = rests & (abs(time - 1.0) > 1e-9)
    assert result["late"][clear] == pytest.approx(1.0 * (time[clear] < 1.0))
    assert np.all(result["slow"][rests] == -1.0)
    assert np.all(result["x_dot"][rests] == 0.0)
    switches = [e.time / unit for e in result.events if e.time > 0.5 * unit]
    assert switches == pytest.approx([1.0], rel=1e-9)


@pytest.mark.parametrize("argument", ARGUMENTS)
@pytest.mark.parametrize("step", STEPS)
def test_a_switch_at_rest_is_passed_once(argument, step):
    check(argument, step)


@pytest.mark.slow
@pytest.mark.parametrize(
    "other",
    [
        {"far": 1e3},
        {"unit": 31560000.0},
        {"beside": 1e9},
        {"beside": 1e-3},
    ],
)
@pytest.mark.parametrize("argument", [ARGUMENTS[k] for k in (1, 2, 5)])
def test_in_other_units_and_places(argument, other):
    check(argument, **other)


@pytest.mark.slow
@pytest.mark.parametrize("speed", [0, 1.3])
@pytest.mark.parametrize("push", ["0", "1.5*max(t - 1, 0)", "if(t > 1.5, 3, 0)"])
def test_a_column_does_not_change_the_events_of_a_body_that_comes_to_rest(push, speed):
    # A definition has the value at the level where the body rests.
    def events(definition):
        text = f"""coordinates: {{x: {{}}, y: {{}}}}
energy: {{kinetic: (x_dot^2 + y_dot^2)/2, potential: 0}}
definitions: {{d: '{definition}'}}
forces: {{x: '-2*sign(x_dot) + {push}', y: -2*sign(y_dot) + 0.5*sign(x_dot)}}
initial: {{x: 0, y: 0, x_dot: 1, y_dot: {speed}}}
simulation: {{duration: 3}}
"""
        found = lagsim.simulate(lagsim.load(text), error_bar="never")
        return [(e.time, e.kind, e.switch) for e in found.events]

    known = events("x")
    # x decelerates by 2; y by 1.5, and by 2 once x rests.
    rest = 0.5 + (speed - 0.75) / 2 if speed else 0.0
    sticks = [time for time, kind, _ in known if kind == "stick"]
    assert sticks == pytest.approx(sorted([0.5, rest]), abs=1e-9)
    ends = {"0": 0, "1.5*max(t - 1, 0)": 1, "if(t > 1.5, 3, 0)": 1}
    assert [kind for _, kind, _ in known].count("slip") == ends[push]
    for other in ("heaviside(x_dot)", "if(y_dot > 0, 1, 0)", "sign(x_dot)^2*y"):
        found = events(other)
        assert [x[1:] for x in found] == [x[1:] for x in known]
        assert [x[0] for x in found] == pytest.approx([x[0] for x in known], abs=1e-9)
