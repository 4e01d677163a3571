"""Conditions that step where a rate is 0, at the time at which friction stops it.

A block slides at 1/8 against a limit 1/2 and stops at t = 1/4 for good: its rate is
never negative, so a condition on `x_dot < 0` stays false, one on `x_dot > 0` is false
from then on.
"""

import itertools

import pytest

import lagsim

STOP, SPEED, FORCE = 0.25, 0.125, 0.5
BLOCK = """\
parameters: {{c: {far}}}
coordinates: {{x: {{}}, heavy: {{}}}}
energy: {{kinetic: {m}*x_dot^2/2 + {beside}*heavy_dot^2/2, potential: {pull}*x}}
initial: {{x: c, x_dot: {speed}, heavy: 0, heavy_dot: {speed}}}
constraints:
  rub: {{relation: {row} = 0, {law}}}
modes: {{u: 0}}
events:
  e: {{at: "{at}", set: {{u: u + 1}}}}
simulation: {{duration: {duration}, output_step: 0.1}}
"""
NEVER = (
    "if(x_dot >= 0, 1, 0) <= 0.5",
    "if(x_dot < 0, 1, 0) >= 0.5",
    "sign(x_dot) <= -0.5",
    "if(not (x_dot < 0), 2, -3) + x - c <= 0",
    "floor(x_dot) <= -0.5",
    "if(3*x_dot - 0.2*u >= 0, 1, 0) <= 0.5",
    "max(sign(x_dot), -1) + t <= 0",
)
ONCE = ("if(x_dot > 0, 1, 0) <= 0.5", "sign(x_dot) <= 0.5", "x_dot <= 0")
LIMITS = (
    f"limit: {FORCE}",
    f"limit: {{static: {2 * FORCE}, dynamic: {FORCE}}}",
    f"limit: {FORCE} + 0*abs(mod(2*t, 2))",
)


def acts(at, **other):
    """Return the times at which the event acts, and the last mode."""
    given = {"m": 1.0, "speed": SPEED, "row": "x_dot", "law": LIMITS[0], "far": 0.0}
    given |= {"beside": 1.0, "pull": 0.0, "duration": 2.0, "at": at}
    result = lagsim.simulate(
        lagsim.load(BLOCK.format(**given | other)), error_bar="never"
    )
    times = [e.time for e in result.events if e.kind == "event"]
    return times, result["u"][-1]


@pytest.mark.slow
@pytest.mark.parametrize(("at", "law"), [*itertools.product(NEVER, LIMITS)])
def test_a_rate_that_friction_stops_is_never_negative(at, law):
    assert acts(at, law=law) == ([], 0.0)


@pytest.mark.slow
@pytest.mark.parametrize(("at", "law"), [*itertools.product(ONCE, LIMITS)])
def test_a_rate_that_friction_stops_is_no_more_positive(at, law):
    times, mode = acts(at, law=law)
    assert times == pytest.approx([STOP], rel=1e-12)
    assert mode == 1.0


@pytest.mark.parametrize(
    "other",
    [
        {"far": 1e6},
        {"beside": 1e9},
        {"row": "-3*x_dot", "law": f"limit: {FORCE / 3}"},
        {"m": 1e-3, "law": f"limit: {FORCE / 1e3}"},
        {"speed": SPEED / 3, "law": f"limit: {FORCE / 3}"},
        {"speed": SPEED / 7, "law": f"limit: {FORCE / 7}"},
    ],
)
@pytest.mark.parametrize("at", NEVER[:3])
def test_in_other_units_and_places(at, other):
    assert acts(at, **other) == ([], 0.0)


# As a force, whose jump holds the rate at 0, too.
@pytest.mark.slow
@pytest.mark.parametrize(
    ("at", "count"),
    [*((at, 0) for at in NEVER), *((at, 1) for at in ONCE)],
)
def test_a_force_that_jumps_stops_a_rate_as_well(at, count):
    times = acts_by_force(at)
    assert times == pytest.approx([STOP] * count, rel=1e-12)


def acts_by_force(at):
    text = (
        BLOCK.partition("constraints:")[0]
        + BLOCK.partition("rub:")[2].partition("\n")[2]
    )
    text += f"forces: {{{{x: -{FORCE}*sign(x_dot)}}}}\n"
    given = {"m": 1.0, "speed": SPEED, "far": 0.0, "beside": 1.0, "pull": 0.0}
    model = lagsim.load(text.format(**given, at=at, duration=2.0))
    result = lagsim.simulate(model, error_bar="never")
    return [e.time for e in result.events if e.kind == "event"]


# The value of a step at its level: sign(0) = 0, heaviside(0) = 1.
@pytest.mark.parametrize(
    ("at", "count"),
    [
        ("sign(-x_dot) >= -0.5", 1),
        ("sign(-x_dot) >= 0.5", 0),
        ("heaviside(x_dot) <= 0.5", 0),
        ("heaviside(-x_dot) >= 0.5", 1),
        ("ceil(x_dot) <= 0.5", 1),
        ("sign(x_dot)*sign(1 - t) <= -0.5", 0),
        ("sign(x_dot) = 0", 1),
        ("sign(x_dot) = -0.5", 0),
        ("heaviside(x_dot) = 0.5", 0),
    ],
)
def test_a_step_has_the_value_of_its_level_at_rest(at, count):
    assert acts_by_force(at) == pytest.approx([STOP] * count, rel=1e-12)
    assert acts(at) == (pytest.approx([STOP] * count, rel=1e-12), count)


@pytest.mark.slow
def test_a_mode_is_set_by_the_value_at_the_level():
    result = lagsim.simulate(
        """\
coordinates: {x: {}}
energy: {kinetic: x_dot^2/2, potential: 0}
forces: {x: -0.5*sign(x_dot)}
initial: {x: 0, x_dot: 0.125}
modes: {u: 7}
events: {e: {at: x + t >= 1, set: {u: sign(x_dot)}}}
simulation: {duration: 2, output_step: 0.5}
""",
        error_bar="never",
    )
    assert result["u"][-1] == 0.0


@pytest.mark.parametrize("at", ["sign(x_dot) = 0", "sign(x_dot) >= 0.5"])
def test_a_slip_that_stops_where_a_condition_steps_takes_few_steps(at):
    """The run took 34,000 steps, and slid back and forth by 6e-9 after the stop."""
    text = BLOCK.format(
        at=at, m=1.0, speed=SPEED, row="x_dot", law=LIMITS[0], far=0.0, beside=1.0,
        pull=0.0, duration=2.0,
    )  # fmt: skip
    result = lagsim.simulate(text, error_bar="never")
    assert result["x_dot"][-1] == 0.0
    assert result.record["steps"] < 60


def test_a_rate_that_passes_0_becomes_negative():
    # Up a slope with pull 1 > limit 1/2: it stops at 1/12 and slides back.
    stop = SPEED / 1.5
    times, mode = acts("if(x_dot < 0, 1, 0) >= 0.5", pull=1.0)
    assert times == pytest.approx([stop], rel=1e-9)
    assert mode == 1.0


@pytest.mark.parametrize(
    "method",
    ["rk4", "verlet", "rattle", "midpoint", "gauss4", "kahan-li6", "kahan-li8",
     "generalized-alpha"],
)  # fmt: skip
@pytest.mark.parametrize("force", ["t", "t^2", "t^3", "t - abs(x)"])
def test_no_condition_acts_in_the_first_fixed_step_from_rest(force, method):
    """All are true at the start, and become false for ever as the body moves off."""
    found = lagsim.simulate(
        f"""
coordinates: {{x: {{}}}}
energy: {{kinetic: x_dot^2/2, potential: 0}}
forces: {{x: "{force}"}}
initial: {{x: 0, x_dot: 0}}
modes: {{n: 0}}
events:
  place: {{at: x = 0, set: {{n: n + 1}}}}
  below: {{at: x <= 0, set: {{n: n + 10}}}}
  rate: {{at: x_dot = 0, set: {{n: n + 100}}}}
simulation: {{duration: 2, output_step: 0.5, method: {method}, step: 0.1}}
""",
        error_bar="never",
    )
    # Those that are true at the start have acted there: neither equations nor `x <= 0`.
    assert [e.name for e in found.events] == []
    assert found["n"][-1] == found["n"][0]
