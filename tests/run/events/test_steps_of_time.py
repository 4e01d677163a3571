"""Conditions with steps of t, on bodies that laws or forces hold at rest meanwhile."""

import pytest

import lagsim
from lagsim.run.events.records import NOTHING
from lagsim.run.events.transitions import Transitions
from lagsim.run.trajectory import Outcome
from tests.support import run

# A mass of 1 kg slides at 0.875 m/s under 1.25 N of friction, and rests from 0.7 s on.
HOLDS = {
    "static": "constraints: {rub: {relation: x_dot = 0, limit: {static: 1.8, dynamic: "
    "1.25}}}",
    "limit": "constraints: {rub: {relation: x_dot = 0, limit: 1.25}}",
    "force": "forces: {x: -1.25*sign(x_dot)}",
    "relation": "constraints: {hold: {relation: x_dot = 0, when: t >= 0.7}}\n"
    "forces: {x: 'if(t < 0.7, -1.25, 0)'}",
}
# Conditions that become true where U rises through 0, if x_dot is 0 then.
STEPS = (
    "sign(U) + x_dot >= 0.3", "sign(U) + sign(x_dot) >= 0.5 + x_dot",
    "if(U > 0, 1, -1) - x_dot^2 >= 0.9", "x_dot - heaviside(U) <= -0.5",
    "sign(U*exp(x_dot)) >= 0.3 + x_dot",
)  # fmt: skip
ARGUMENTS = {1.4375: "0.5*t - 0.71875", 0.97: "3.1*t - 3.007", 1.3: "t/3 - 1.3/3"}


def scene(holds, condition, step, method="auto"):
    fixed = ", step: 0.01" if method == "rk4" else ""
    return (
        "coordinates: {x: {}}\nenergy: {kinetic: x_dot^2/2, potential: 0}\n"
        "modes: {n: 0}\ninitial: {x: 999.5, x_dot: 0.875}\n"
        f"{holds}\nevents: {{act: {{at: '{condition}', set: {{n: n + 1}}}}}}\n"
        f"simulation: {{duration: 2, output_step: {step}, method: {method}{fixed}}}\n"
    )


@pytest.mark.parametrize("holds", HOLDS)
@pytest.mark.parametrize("time", ARGUMENTS)
@pytest.mark.parametrize("condition", STEPS)
@pytest.mark.parametrize("has_row", [True, False], ids=["row", "between"])
def test_a_step_of_the_time_acts_once_on_a_body_at_rest(
    holds, time, condition, has_row
):
    condition = condition.replace("U", ARGUMENTS[time])
    text = scene(HOLDS[holds], condition, time if has_row else 0.123)
    result = lagsim.simulate(text, error_bar="never")
    acts = [e.time for e in result.events if e.name == "act"]
    assert acts == pytest.approx([time], abs=1e-13)


# radau has no constraints that hold at times.
@pytest.mark.parametrize(
    ("method", "holds"),
    [(m, h) for m in ("radau", "dop853", "rk4") for h in ("static", "force")][1:],
)
def test_a_step_of_the_time_acts_once_by_each_method(method, holds):
    condition = "sign(0.5*t - 0.71875) + x_dot >= 0.3"
    text = scene(HOLDS[holds], condition, 0.0625, method)
    result = lagsim.simulate(text, error_bar="never")
    assert [e.time for e in result.events if e.name == "act"] == pytest.approx([1.4375])


# A clock c = t - 1.5, given by a relation, by its velocity, or as a definition.
CLOCKS = {
    "relation": "coordinates: {y: {}, c: {}}\nconstraints: {p: c = t - 1.5}\n"
    "initial: {y: 0, c: -1.5, c_dot: 1}",
    "velocity": "coordinates: {y: {}, c: {}}\ninitial: {y: 0, c: -1.5, c_dot: 1}",
    "definition": "coordinates: {y: {}}\ndefinitions: {c: t - 1.5}\ninitial: {y: 0}",
}
FALLING = """
modes: {n: 0, m: 1}
energy: {kinetic: KINETIC, potential: 0}
events:
  e: {at: "mod(floor(-c), 2)*m + y <= 0.5*m", set: {n: n + 1, m: 3 - m}}
  f: {at: "mod(floor(-c), 2) + y <= 0.7", set: {n: n + 10}}
  g: {at: n >= 11, set: {n: n + 100}}
simulation: {duration: 6, output_step: 0.25}
"""


@pytest.mark.parametrize("clock", CLOCKS)
@pytest.mark.parametrize("method", ["auto", "dop853", "rk4"])
def test_falling_steps_of_the_time_act_once_at_their_times(clock, method):
    # floor(1.5 - t) is 1 at 0.5, and 0 after it: the step acts by its value after it.
    kinetic = "y_dot^2" if clock == "definition" else "y_dot^2 + c_dot^2"
    text = CLOCKS[clock] + FALLING.replace("KINETIC", kinetic)
    fixed = {"step": 0.1} if method == "rk4" else {}
    result = lagsim.simulate(text, error_bar="never", method=method, **fixed)
    found = [(e.name, e.time) for e in result.events if e.kind == "event"]
    names, times = zip(*found, strict=True)
    assert names == ("e", "f", "g", "e", "f", "e", "f")
    assert times == pytest.approx([0.5, 0.5, 0.5, 2.5, 2.5, 4.5, 4.5], abs=1e-12)
    assert result["n"][-1] == 133.0


def test_a_run_without_progress_ends_with_the_name_of_the_condition(monkeypatch):
    # The condition is located again and again, and its event never acts.
    monkeypatch.setattr(Transitions, "due", lambda *_: NOTHING)
    found = run(scene(HOLDS["limit"], "x >= 999.6", 0.1)).trajectory
    assert found.outcome is Outcome.EVENTS_CHATTER
    assert "`act`" in found.reason
    assert found.statistics.arcs < 500


# Clocks c = t - 1.5 of smooth motions, whose steps may be as long as the run.
SMOOTH = CLOCKS | {
    "state": "coordinates: {y: {}}\nstates: {c: {rate: 1}}\ninitial: {y: 0, c: -1.5}"
}
# Conditions that become true at one part of each period of c, and this part.
PERIODIC = {
    "sign(sin(2*pi*(c + 0.1))) + y >= 0.5": (1.0, 0.9),
    "-sign(cos(pi*c/2)) - y <= 0.3": (4.0, 3.0),
    "mod(floor(c), 2)*mod(floor(2*c), 2) + y <= 0.25": (2.0, 0.0),
    "if(mod(c + 0.2, 0.5) < 0.05, 1, y) >= 0.7": (0.5, 0.3),
    "if(mod(floor(2*c), 3) > 1.5 and mod(c, 0.5) < 0.02, 2, y) >= 0.7": (1.5, 1.0),
    "wave(c) + y >= 2.5": (0.7, 0.35),
}
PERIODIC_SCENE = """
modes: {n: 0}
energy: {kinetic: KINETIC, potential: 0}
events: {e: {at: "CONDITION", set: {n: n + 1}}}
simulation: {duration: 40, output_step: 10}
"""
WAVE = """
tables: {wave: {points: [[0, 0], [0.3, 0], [0.4, 5], [0.5, 0], [0.7, 0]],
                interpolation: linear, outside: repeat}}
"""


@pytest.mark.slow
@pytest.mark.parametrize("clock", SMOOTH)
@pytest.mark.parametrize("condition", PERIODIC)
@pytest.mark.parametrize("method", ["auto", "radau"])
def test_steps_of_the_time_act_in_each_period_of_a_long_step(clock, condition, method):
    period, part = PERIODIC[condition]
    kinetic = "y_dot^2 + c_dot^2" if "c: {}" in SMOOTH[clock] else "y_dot^2"
    text = SMOOTH[clock] + PERIODIC_SCENE.replace("KINETIC", kinetic)
    text = text.replace("CONDITION", condition) + WAVE * ("wave" in condition)
    result = lagsim.simulate(text, error_bar="never", method=method)
    found = [e.time - 1.5 for e in result.events if e.kind == "event"]
    first = -1.5 + (part + 1.5) % period
    expected = [first + k * period for k in range(int((38.5 - first) / period) + 1)]
    assert found == pytest.approx(expected, abs=1e-9)


# Clocks c = 0.25 + 1.75 t on curves: the state after a step is projected onto these.
CURVE = """
coordinates: {y: {}, w: {}}
definitions: {c: EXPRESSION}
constraints: {p: EXPRESSION = 0.25 + 1.75*t}
energy: {kinetic: y_dot^2 + w_dot^2, potential: 0}
modes: {n: 0}
events: {e: {at: "CONDITION", set: {n: n + 1}}}
initial: {y: 0, w: {guess: 0}, w_dot: {guess: 1}}
simulation: {duration: 5, output_step: 0.5}
"""
# Conditions that become true once in each period of c: period, part, method, step.
ON_CURVES = [
    ("mod(floor(1.7*c), 2) + y <= 0.5", 2 / 1.7, 0.0, "radau", None),
    ("if(mod(0.8*c - 0.9, 1) < 0.11, 1, 0) + y >= 0.7", 1.25, 1.125, "radau", None),
    ("mod(floor(c), 2)*mod(floor(2*c), 2) - y <= 0.25", 2.0, 0.0, "rk4", 0.0625),
    ("mod(0.6*c, 1) = 0", 1 / 0.6, 0.0, "rk4", 0.1),
    ("mod(-0.6*c, 1) = 0", 1 / 0.6, 0.0, "euler", 0.002),
    ("sign(sin(pi*c)) + y >= 0.5", 2.0, 0.0, "dop853", None),
]


@pytest.mark.slow
@pytest.mark.parametrize("expression", ["w^3 + w", "sinh(w)", "w + exp(w) - 1"])
@pytest.mark.parametrize(("condition", "period", "part", "method", "step"), ON_CURVES)
def test_steps_act_in_each_period_of_a_projected_drive(
    expression, condition, period, part, method, step
):
    text = CURVE.replace("EXPRESSION", expression).replace("CONDITION", condition)
    fixed = {"step": step} if step else {}
    result = lagsim.simulate(text, error_bar="never", method=method, **fixed)
    found = [e.time for e in result.events if e.kind == "event"]
    first = 0.25 + (part - 0.25) % period
    periods = range(int((9.0 - first) / period) + 1)
    expected = [(first + k * period - 0.25) / 1.75 for k in periods]
    error = {"rk4": 1e-5, "euler": 2e-3}.get(method, 1e-9)
    assert found == pytest.approx(expected, abs=error)
