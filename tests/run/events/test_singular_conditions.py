"""Conditions whose slope is not finite: roots at 0, the point of a cone, poles."""

import math

import pytest

from tests.support import run

MOVING = """
modes: {n: 0}
coordinates: {q: {}, r: {}}
energy: {kinetic: (q_dot^2 + r_dot^2)/2, potential: 0}
events: {e: {at: "CONDITION", set: {n: n + 1}}}
initial: {q: Q0, r: 0, q_dot: 1, r_dot: 1}
simulation: {duration: 7, output_step: 0.5}
"""
POLES = [math.pi / 2, 3 * math.pi / 2]


@pytest.mark.parametrize(
    ("condition", "times"),
    [
        ("sqrt(q) >= 0.5", [0.25]),
        ("sqrt(q) = 0.5", [0.25]),
        ("cbrt(q) >= 0.5", [0.125]),
        ("abs(q)^0.25 >= 0.5", [0.0625]),
        ("acosh(1 + q) >= 1", [math.cosh(1) - 1]),
        ("hypot(q, r) >= 1", [math.sqrt(0.5)]),
        ("norm(vec(q, 2*r)) = 1", [math.sqrt(0.2)]),
        ("sqrt(mod(q, 2)) >= 0.5", [0.25, 2.25, 4.25, 6.25]),
        ("sqrt(mod(q, 2)) <= 0.5", [2, 4, 6]),
        ("tan(q) <= -1", POLES),
        ("tan(q) >= 1", [math.pi / 4, 5 * math.pi / 4]),
        ("1/(q - 3) >= 0", [3]),
    ],
)
def test_a_condition_without_a_finite_slope_acts(condition, times):
    found = run(MOVING.replace("CONDITION", condition).replace("Q0", "0"))
    events = [e.time for e in found.trajectory.events if e.kind == "event"]
    assert events == pytest.approx(times, abs=1e-12)


@pytest.mark.parametrize(
    "method", ["auto", "dop853", "dopri5", "radau", "rk4", "gauss4", "kahan-li8"]
)
@pytest.mark.parametrize(
    ("condition", "times"),
    [
        ("floor(q) = 3", [2.7]),
        ("0.1*floor(q) = 0.3", [2.7]),
        ("heaviside(q - 2) = 1", [1.7]),
        ("if(q > 2, 3, 0) = 3", [1.7]),
        ("sign(2 - q) = -1", [1.7]),
        ("mod(floor(q), 2) = 1", [0.7, 2.7, 4.7, 6.7]),
        ("floor(q) - 2*floor(q/2) = 0", [1.7, 3.7, 5.7]),
        ("floor(q)*(floor(q) - 4) = 0", [3.7]),
        ("max(floor(q), 3) - min(floor(q), 5) = 0", [2.7]),
        ("mod(q, 1) = 0", [0.7, 1.7, 2.7, 3.7, 4.7, 5.7, 6.7]),
        ("0 = mod(-2*q, 3)", [1.2, 2.7, 4.2, 5.7]),
        ("q/2 - floor(q/2) = 0", [1.7, 3.7, 5.7]),
        ("floor(q) = 2.5", []),
        ("sign(q - 2) = 0", []),
    ],
)
def test_an_equation_whose_value_jumps_to_0_acts(condition, times, method):
    fixed = method in {"rk4", "gauss4", "kahan-li8"}
    used = f", method: {method}" + (", step: 0.25" if fixed else "")
    model = MOVING.replace("CONDITION", condition).replace("Q0", "0.3")
    found = run(model.replace("output_step: 0.5", "output_step: 0.5" + used))
    events = [e.time for e in found.trajectory.events if e.kind == "event"]
    assert events == pytest.approx(times, abs=1e-12)


# Places at which each relation is 0, on one side of a jump or at a kink.
WHOLE = range(-2, 7)
PLACES = {
    "2*mod(q, 1) = 0": WHOLE,
    "mod(q, -1) = 0": WHOLE,
    "floor(q) - q = 0": WHOLE,
    "sin(pi*mod(q, 1)/2) = 0": WHOLE,
    "mod(q, 1) <= 0": WHOLE,
    "abs(sin(pi*q)) = 0": WHOLE,
    "if(q < 1, 2 - q, 1 - q) = 0": [1],
    "if(q < 1, 1 - q, -2) = 0": [1],
    "if(q < 1, 1 - q, 2) = 0": [1],
    "if(q < 1, 3, q - 1) = 0": [1],
    "abs(q - 1) = 0": [1],
    "hypot(q - 2, 0) <= 0": [2],
    "abs(q - 1) <= -1e-9": [],
    "if(q < 1, -1, 2) = 0": [],
}
STARTS = [(0.3, 1), (5.3, -1), (0.5, 1), (4.5, -1)]  # from 0.5 and 4.5 at ends of steps


@pytest.mark.slow
@pytest.mark.parametrize(
    "method", ["auto", "dop853", "dopri5", "radau", "rk4", "gauss4", "kahan-li8"]
)
@pytest.mark.parametrize("condition", PLACES)
def test_a_condition_that_is_0_at_a_switch_alone_acts(condition, method):
    fixed = method in {"rk4", "gauss4", "kahan-li8"}
    used = f", method: {method}" + (", step: 0.25" if fixed else "")
    for start, speed in STARTS:
        model = MOVING.replace("CONDITION", condition).replace("Q0", str(start))
        model = model.replace("q_dot: 1,", f"q_dot: {speed},").replace("7,", "4.8,")
        found = run(model.replace("output_step: 0.5", "output_step: 0.5" + used))
        events = [e.time for e in found.trajectory.events if e.kind == "event"]
        times = sorted((place - start) / speed for place in PLACES[condition])
        times = [t for t in times if 0 < t < 4.8]
        assert events == pytest.approx(times, abs=1e-12), (start, speed)


def test_two_events_act_at_one_jump():
    events = "{a: {at: 'mod(q, 1) = 0', set: {n: n + 1}}, "
    events += "b: {at: '3*mod(q, 1) = 0', set: {n: 10*n}}}"
    start = MOVING.index("events:")
    end = MOVING.index("initial:")
    model = MOVING[:start] + f"events: {events}\n" + MOVING[end:]
    found = run(model.replace("Q0", "0.5").replace("7,", "2,"))
    events = [(e.name, e.time) for e in found.trajectory.events if e.kind == "event"]
    assert events == [("a", 0.5), ("b", 0.5), ("a", 1.5), ("b", 1.5)]


# Conditions that are true while floor(q) is even (odd), each a sum of steps.
EVEN = [
    "floor(q) - 2*floor(q/2) = 0",
    "mod(floor(q), 2) = 0",
    "2*floor(q/2) - floor(q) >= 0",
    "1 - sign(sin(pi*q)) = 0",
    "sign(sin(pi*q)) >= 1",
]
ODD = ["floor(q) - 2*floor(q/2) = 1", "mod(floor(q), 2) = 1", "sign(sin(pi*q)) + 1 = 0"]


@pytest.mark.parametrize(
    "method", ["auto", "dop853", "dopri5", "radau", "taylor", "rk4", "kahan-li8"]
)
@pytest.mark.parametrize("speed", [-2, -1, 1])
@pytest.mark.parametrize("condition", [*EVEN, *ODD])
def test_a_sum_of_steps_acts_each_time(condition, speed, method):
    # At speed -2 the first step of an arc, 0.5, is from one jump to the next.
    fixed = method in {"rk4", "kahan-li8"}
    used = f", method: {method}" + (", step: 0.25" if fixed else "")
    start = 4.5 if speed < 0 else 0.5
    model = MOVING.replace("CONDITION", condition).replace("Q0", str(start))
    model = model.replace("q_dot: 1,", f"q_dot: {speed},").replace("7,", "4.8,")
    found = run(model.replace("output_step: 0.5", "output_step: 0.5" + used))
    events = [e.time for e in found.trajectory.events if e.kind == "event"]
    # Upwards floor(q) becomes even at even places, downwards at odd ones.
    first = (condition in EVEN) == (speed < 0)
    places = [q for q in range(-6, 6) if q % 2 == first]
    times = sorted((q - start) / speed for q in places)
    assert events == pytest.approx([t for t in times if 0 < t < 4.8], abs=1e-12)
