"""Switches in the state are met exactly, so that a method keeps its order."""

import math

import numpy as np
import pytest

from lagsim.methods import names
from tests.run.switching.scenes import events, scene
from tests.support import run

BILINEAR = scene("if(x > 0, 4, 1)*x^2/2", v=1, duration=20)


def bilinear(t):
    """Return x of x'' = -4 x above 0 and -x below, from 0 at speed 1."""
    t = np.mod(t, 1.5 * math.pi)
    half = t < math.pi / 2
    return np.where(half, np.sin(2 * t) / 2, -np.sin(t - math.pi / 2))


def test_two_stiffnesses():
    found = run(BILINEAR)
    # 8 switches, and the tolerance of 1e-11 that is met between them.
    assert np.max(np.abs(found["x"] - bilinear(found["t"]))) < 1e-11
    exact = [k * math.pi / 2 for k in (1, 3, 4, 6, 7, 9, 10, 12)]
    assert [t for t, _ in events(found)] == pytest.approx(exact, abs=1e-11)
    assert {kind for _, kind in events(found)} == {"switch"}
    assert {e.switch for e in found.trajectory.events} == {"if(x > 0, ...)"}
    assert found.drift < 1e-11
    # About 20 steps per arc, as from any start, and no more.
    assert found.trajectory.statistics.steps < 9 * 30


# Their orders in the literature, and of their dense outputs: a cubic of Hermite's,
# or what comes with the method.
FIXED = {
    "euler": (1, 1), "gauss4": (4, 3), "generalized-alpha": (2, 2),
    "kahan-li6": (6, 6), "kahan-li8": (8, 6), "midpoint": (2, 2), "rattle": (2, 2),
    "rk4": (4, 3), "verlet": (2, 2),
}  # fmt: skip
# Adaptive, or goes over switches.
NOT_HERE = {"dop853", "dopri5", "radau", "taylor", "moreau"}


def test_each_method_is_tried():
    assert {*FIXED, *NOT_HERE} == set(names())


@pytest.mark.parametrize("name", FIXED)
def test_every_fixed_step_method_keeps_its_order_through_a_switch(name):
    errors = [
        np.max(
            np.abs((f := run(BILINEAR, method=name, step=h))["x"] - bilinear(f["t"]))
        )
        for h in (0.04, 0.02)
    ]
    # Located on the dense output, whose error is of its own order in one step.
    order, dense = FIXED[name]
    order = min(order, dense + 1)
    # Half an order for the steps that arcs end with; past 1e-10 rounding counts.
    assert errors[1] < max(errors[0] / 2 ** (order - 0.5), 1e-10)


def test_order_eight_between_tight_tolerances():
    # The error goes with the tolerance: without location it stops at about 1e-5.
    for rtol in (1e-7, 1e-10):
        found = run(BILINEAR, rtol=rtol)
        assert np.max(np.abs(found["x"] - bilinear(found["t"]))) < rtol


def bounce(t, g=9.81, w=100.0):
    """Return y of a fall from 1 onto a spring below 0, of w^2 per mass."""
    fall = math.sqrt(2 / g)
    speed = g * fall
    rest = g / w**2
    contact = 2 * (math.pi - math.atan2(speed / w, rest)) / w
    t = np.mod(t, 2 * fall + contact)
    s = t - fall
    pressed = rest * (np.cos(w * s) - 1) - speed / w * np.sin(w * s)
    back = 2 * fall + contact - t
    free = 1 - g * np.where(s < 0, t, back) ** 2 / 2
    return np.where((s >= 0) & (s < contact), pressed, free)


def test_a_fall_onto_a_spring():
    text = scene("9.81*x + 1e4*max(0, -x)^2/2", x=1, duration=20)
    found = run(text)
    # 21 bounces with a tolerance of 1e-11 each; times are off by that over 1/speed.
    assert np.max(np.abs(found["x"] - bounce(found["t"]))) < 2e-9
    assert len(found.trajectory.events) == 2 * 21


@pytest.mark.parametrize(
    "options",
    [{}, pytest.param({"method": "rk4", "step": 0.01}, marks=pytest.mark.slow)],
)
def test_a_branch_without_values_past_its_surface(options):
    # x'' = -sqrt(1 - x) up to x = 1: v^2/2 falls by the integral, 2/3.
    found = run(scene(force="if(x < 1, -sqrt(1 - x), 0)", v=2, duration=5), **options)
    assert found.trajectory.outcome.complete
    # RK4 integrates sqrt(v s) from s = h to the end of the root at s = 0 by Simpson's
    # rule, which errs by h sqrt(v h) (2/3 - (1 + 4 sqrt(1/2))/6); the steps before add
    # a tenth of that. The last bit of the location makes that step whole or not.
    exact = math.sqrt(4 - 4 / 3)
    h = options.get("step", 0.0)
    simpson = h * math.sqrt(exact * h) * (2 / 3 - (1 + 4 * math.sqrt(0.5)) / 6)
    assert found["x_dot"][-1] == pytest.approx(exact, rel=1e-10, abs=1.1 * simpson)
    assert len(found.trajectory.events) == 1


@pytest.mark.slow
def test_a_narrow_pulse_in_space_is_not_stepped_over():
    # A push of 1e6 over a micron: its work is 1.
    force = "if(x > 5 and x < 5.000001, 1e6, 0)"
    found = run(scene(force=force, v=1, duration=20))
    # The place of the pulse is known to 1e-16 of 5: the work to 1e-9 of itself.
    assert found["x_dot"][-1] == pytest.approx(math.sqrt(3), rel=2e-9)
    assert len(found.trajectory.events) == 2


def test_a_graze_of_depth_1e_8_is_met():
    found = run(scene("x^2/2", "if(x > 1 - 1e-8, -1000, 0)", v=1, duration=20))
    # It turns at the surface's far side within 3e-7 s, in each of three swings.
    first = math.asin(1 - 1e-8)
    times = [t for t, _ in events(found)]
    assert len(times) == 6
    # The place is flat there: 1e-11 in x is 1e-11 over the speed 1.4e-4 in time.
    assert times[0] == pytest.approx(first, abs=1e-6)
    assert times[1] - times[0] == pytest.approx(2 * math.sqrt(2e-8) / 1000, rel=1e-2)


def test_a_condition_of_time_and_state():
    found = run(scene(force="if(x > 1 and t < 3, 1, 0)", v=1, duration=5))
    assert events(found) == [(pytest.approx(1.0, abs=1e-14), "switch"), (3.0, "switch")]
    assert found["x"][-1] == pytest.approx(1 + 2 + 2 + 2 * 3, abs=1e-13)


def test_steps_at_whole_numbers():
    # Energy v^2/2 + 0 + 1 + 2 on the way up: turns in (3, 4), and comes back.
    found = run(scene(force="-floor(x)", v=3, duration=5))
    times = [t for t, _ in events(found)]
    speeds = [3.0, 3.0, math.sqrt(7), math.sqrt(3)]
    up = [1 / 3, 2 / (3 + speeds[2]), 2 / (speeds[2] + speeds[3])]
    exact = list(np.cumsum([*up, 2 * speeds[3] / 3, *up[::-1]]))
    assert times[: len(exact)] == pytest.approx(exact, abs=1e-12)


def test_switches_of_outputs_alone_cost_nothing():
    text = scene("x^2/2", v=1).replace("energy:", "definitions: {s: sign(x)}\nenergy:")
    found = run(text)
    assert found.trajectory.events == ()
    assert found.system.surfaces == 0
    assert not any("switch" in c.choice for c in found.plan.choices)
    assert found["s"][0] == 0.0
    assert found["s"][1] == 1.0


@pytest.mark.parametrize(("until", "time"), [("x <= 0.1", 1.8**0.5), ("x <= -0.1", 0)])
def test_until_just_before_and_just_after_a_switch(until, time):
    # x = 1 - t^2/2 down to 0 at sqrt(2), then x = -s*sqrt(2) + s^2/2.
    text = scene("abs(x)", x=1).replace("0.05}", f'0.05, until: "{until}"}}')
    found = run(text)
    time = time or math.sqrt(2) + math.sqrt(2) - math.sqrt(1.8)
    assert events(found)[-1] == (pytest.approx(time, abs=1e-12), "until")
    assert len(events(found)) == (1 if "-" not in until else 2)
    assert found["t"][-1] == found.trajectory.end


def test_a_switch_where_all_terms_of_a_constraint_vanish():
    # At x = y = 0 a residual of rounding has no scale of its own: nothing has jumped.
    found = run("""
coordinates: {x: {}, y: {}}
energy: {kinetic: (x_dot^2 + y_dot^2)/2, potential: 9.8*y}
forces: {x: -0.3*sign(x_dot) - 0.2*sign(x)}
constraints: {tie: y = x^2}
initial: {x: 1, y: 1}
simulation: {duration: 3}
""")
    assert found.trajectory.outcome.word == "done"
    where = [found["x"][np.searchsorted(found["t"], t)] for t, _ in events(found)]
    assert sum(abs(x) < 0.05 for x in where) >= 2
    assert found.drift < 1e-9
