"""Conditions whose values come to rest at 0, since friction stops a body there."""

import pytest

import lagsim

# A block of 1 kg, at 1 m/s, stops after 1/(2 LIMIT) m at 1/LIMIT s; a force of
# PUSH (t - 2) moves it on, or back, once it exceeds the limit.
BLOCK = """\
coordinates: {x: {}}
energy: {kinetic: x_dot^2/2, potential: 0}
FRICTION
modes: {n: 0, m: 0}
events:
EVENTS
OTHER
initial: {x: START, x_dot: 1}
simulation: {duration: 3, output_step: 0.1, method: METHOD}
"""
FRICTION = {
    "limit": "constraints: {rub: {relation: x_dot = 0, limit: LIMIT}}\n"
    "forces: {x: 'if(t > 2, PUSH*(t - 2), 0)'}",
    "force": "forces: {x: 'if(t > 2, PUSH*(t - 2), 0) - LIMIT*sign(x_dot)'}",
}
STOP = "  stop: {at: 'x_dot = 0', set: {m: m + 1}}"


EQUATION = '  place: {at: "x - START = PLACE", set: {n: n + 1}}'
INEQUALITIES = """\
  place: {at: "x >= START + PLACE", set: {n: n + 1}}
  short: {at: "x <= START + PLACE", set: {n: n + 1}}"""


def acts(friction, limit, start, other, method, events=EQUATION, push=4):
    words = {
        "FRICTION": FRICTION[friction], "OTHER": other, "EVENTS": events,
        "PUSH": push, "START": start,
        "PLACE": 1 / (2 * limit), "METHOD": method, "LIMIT": limit,
    }  # fmt: skip
    text = BLOCK
    for word, value in words.items():
        text = text.replace(word, str(value))
    fixed = ", step: 0.01" if method == "rk4" else ""
    text = text.replace(f"method: {method}", f"method: {method}{fixed}")
    result = lagsim.simulate(text, error_bar="never")
    return [(e.name, e.time) for e in result.events if e.kind == "event"]


@pytest.mark.parametrize("other", [STOP, ""], ids=["stop", "alone"])
@pytest.mark.parametrize("friction", FRICTION)
@pytest.mark.parametrize("limit", [0.7, 1, 1.3, 2, 3, 3.7])
@pytest.mark.parametrize("method", ["auto", "dopri5", "dop853", "rk4"])
def test_a_place_at_which_friction_stops_a_body_acts_at_the_stop(
    friction, limit, other, method
):
    found = acts(friction, limit, 0, other, method)
    names = ["place", "stop"] if other else ["place"]
    assert [name for name, _ in found] == names
    assert [time for _, time in found] == pytest.approx([1 / limit] * len(names))


@pytest.mark.parametrize("push", [4, -4])
@pytest.mark.parametrize("start", [0, 0.3, -1.7])
@pytest.mark.parametrize("friction", FRICTION)
@pytest.mark.parametrize("limit", [0.7, 1, 1.3, 3])
@pytest.mark.parametrize("method", ["auto", "dop853", "rk4"])
def test_inequalities_at_the_place_of_a_stop(friction, limit, start, push, method):
    """A block that stops at d fulfils `x >= d` there, and `x <= d` from the start on.

    Whether it is short of d or past it by rounding, and goes on or back, is no matter.
    """
    found = acts(friction, limit, start, "", method, INEQUALITIES, push)
    assert [name for name, _ in found] == ["place"]
    # The last rounding of x is the motion of the last sqrt(2^-52/LIMIT) s.
    assert found[0][1] == pytest.approx(1 / limit, abs=1e-7)
