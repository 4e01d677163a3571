"""A step held by stability: the stiff method takes over where that is cheaper."""

import numpy as np
import pytest

from tests.choosing import tonight, turn
from tests.small_scenes import elastic_pendulum, stiff
from tests.support import MODELS, SHIPPED, run

VAN_DER_POL = """
parameters: {mu: 1000}
coordinates: {x: {}}
energy: {kinetic: x_dot^2/2, potential: x^2/2}
forces: {x: mu*(1 - x^2)*x_dot}
initial: {x: 2, x_dot: 0}
simulation: {duration: 2000, output_step: 10, rtol: 1e-7}
"""
DAMPED = stiff("duration: 1, output_step: 0.05, rtol: 1e-7")
SPRING = elastic_pendulum(
    "theta: 1, u: STRETCHED", "duration: 3, output_step: 0.05, rtol: TOLERANCE", K=1e8
)
QUIET = SPRING.replace("STRETCHED", "g*cos(1)/K")
EXCITED = SPRING.replace("STRETCHED", "1e-4")
HELD = """
parameters: {K: 1e8, c: 2e5}
coordinates: {x: {}, y: {}, z: {}}
energy: {kinetic: (x_dot^2 + y_dot^2 + z_dot^2)/2, potential: 9.8*y + K*(z - x)^2/2}
forces: {z: -c*(z_dot - x_dot), x: c*(z_dot - x_dot)}
constraints: {rod: x^2 + y^2 = 1}
initial: {x: sin(1), y: -cos(1), z: sin(1)}
simulation: {duration: 1, output_step: 0.05, rtol: 1e-7}
"""


def codes(found):
    return [caution.code for caution in found.trajectory.warnings]


@pytest.mark.slow
@pytest.mark.parametrize("text", [VAN_DER_POL, DAMPED, HELD])
def test_a_damped_fast_mode_is_passed_over(text):
    found = run(text)
    [choice] = found.trajectory.choices
    assert choice.choice.startswith("method: radau from t = ")
    assert not codes(found)
    explicit = run(text, method="dop853")
    assert codes(explicit) == ["step-at-stability-bound"]
    assert not explicit.trajectory.choices
    few, many = found.trajectory.statistics, explicit.trajectory.statistics
    assert 5 * few.steps < many.steps
    q = found.equations.q
    size = max(np.ptp(explicit[name]) for name in q)
    late = found["t"] < 0.35 * found["t"][-1]  # of van der Pol's: before it jumps
    for name in q:
        # The global error of either is some ten times its tolerance, more where the
        # order is reduced.
        assert np.max(np.abs(found[name] - explicit[name])[late]) < 1e-5 * size
    assert found.drift < 1e-2 * np.ptp(found["potential"])


@pytest.mark.parametrize(
    "law",
    [
        "stop: {relation: w <= 2, restitution: 0.5}",
        "rub: {relation: w_dot = 0, limit: 0.1}",
    ],
)
def test_a_law_elsewhere_leaves_the_warning_as_it_is(law):
    found = run(f"""
parameters: {{K: 1e8, c: 2e5}}
coordinates: {{x: {{}}, z: {{}}, w: {{}}}}
energy:
  kinetic: (x_dot^2 + z_dot^2 + w_dot^2)/2
  potential: x^2/2 + K*(z - x)^2/2
forces: {{z: -c*(z_dot - x_dot), x: c*(z_dot - x_dot)}}
constraints: {{{law}}}
initial: {{x: 1, z: 1, w: 0, w_dot: 1}}
simulation: {{duration: 0.1, output_step: 0.05, rtol: 1e-7, method: dop853}}
""")
    assert codes(found) == ["step-at-stability-bound"]


@pytest.mark.slow
@pytest.mark.parametrize("rtol", [1e-5, 1e-6, 1e-7, 1e-8, 1e-9])
def test_a_series_finds_a_damped_fast_mode_within_its_first_steps(rtol):
    text = DAMPED.replace("rtol: 1e-7", f"rtol: {rtol}")
    found = run(text.replace("duration: 1, output_step: 0.05", "duration: 0.01"))
    [choice] = found.trajectory.choices
    assert choice.choice.startswith("method: radau from t = ")
    # A check after 20,000 steps finds it at the latest.
    assert found.trajectory.statistics.steps < 1000


def test_a_quiet_oscillation_is_passed_over_and_what_follows_stays():
    found = run(QUIET.replace("TOLERANCE", "1e-5"))
    assert found.trajectory.choices
    theta = run(QUIET.replace("TOLERANCE", "1e-9"), method="dop853")["theta"]
    assert np.max(np.abs(found["theta"] - theta)) < 1e-5
    # Quasi-static: K u = g cos(theta) + theta_dot^2, to some u''/K = 1e-7 of it.
    force = 9.8 * np.cos(found["theta"]) + found["theta_dot"] ** 2
    assert np.max(np.abs(1e8 * found["u"] - force)) < 1e-4 * 9.8


# A body of 8e30 J says nothing about it; nor does what that leaves in a spring of
# stiffness K, which is its pull over K, no more.
HEAVY = {
    "u: {}": "u: {}, b: {}",
    "u: 1e-4": "u: 1e-4, b: 0, b_dot: 4e3",
    "u_dot^2/2": "u_dot^2/2 + 1e24*b_dot^2/2",
}
BESIDE = {"nothing": {}, "another body": HEAVY}
for pull in ("1e-3", "10.0"):
    tied = f"potential: 1e24*50*b^2 - {pull}*u*cos(b/1e3) + "
    BESIDE[f"one that pulls with {pull}"] = HEAVY | {"potential: ": tied}


@pytest.mark.parametrize("beside", BESIDE)
def test_an_excited_oscillation_is_not_damped_away(beside):
    text = EXCITED.replace("TOLERANCE", "1e-2")
    for old, new in BESIDE[beside].items():
        text = text.replace(old, new)
    found = run(text)
    assert not found.trajectory.choices
    assert codes(found) == ["step-at-stability-bound"]
    [caution] = found.trajectory.warnings
    assert beside != "nothing" or "`u`" in caution.text


@pytest.mark.slow
@pytest.mark.parametrize("method", ["auto", "dop853"])
def test_accuracy_holds_the_step_of_an_excited_oscillation_at_tight_tolerance(method):
    found = run(EXCITED.replace("TOLERANCE", "1e-7"), method=method, duration=0.1)
    assert not codes(found)
    assert not found.trajectory.choices


QUICKLY_RUN = [x for x in SHIPPED if "chain" not in x and x != "quadruped"]


@pytest.mark.parametrize(
    "name",
    [*QUICKLY_RUN,
     pytest.param("quadruped", marks=pytest.mark.slow)],
)  # fmt: skip
def test_no_shipped_model_is_stiff(name):
    found = run(name, rtol=turn(name, tonight(), ("1e-3", "1e-8")))
    assert not found.trajectory.choices
    assert "step-at-stability-bound" not in codes(found)


RUBBING = """
parameters: {K: 1e8, c: 2e5}
coordinates: {x: {}, y: {}}
energy: {kinetic: (x_dot^2 + y_dot^2)/2, potential: K*(x - sin(y))^2/2 + 20*y^2/2}
forces:
  x: -c*(x_dot - y_dot*cos(y))
  y: "c*(x_dot - y_dot*cos(y))*cos(y) - 2*sign(y_dot)"
initial: {x: sin(1), y: 1}
simulation: {duration: 2, output_step: 0.05, rtol: 1e-7}
"""


@pytest.mark.slow
def test_switches_are_located_by_the_stiff_method_too():
    found, explicit = run(RUBBING), run(RUBBING, method="dop853")
    assert found.trajectory.choices
    few, many = found.trajectory.statistics, explicit.trajectory.statistics
    assert 100 * few.steps < many.steps
    times = [[e.time for e in r.trajectory.events] for r in (found, explicit)]
    assert len(times[0]) == 2
    assert times[0] == pytest.approx(times[1], abs=1e-6)
    assert np.max(np.abs(found["y"] - explicit["y"])) < 1e-6


@pytest.mark.slow
@pytest.mark.parametrize("rtol", [1e-5, 1e-6, 1e-7])
def test_rows_within_the_first_step_after_a_switch(rtol):
    """A fast motion begins at the switch at 1.8404; the row at 1.85 is in that step.

    The errors of velocities are those of the tolerance with the motion's frequency, and
    the local error adds up over some tens of steps.
    """
    found = run(RUBBING, method="radau", rtol=rtol)
    explicit = run(RUBBING, method="dop853", rtol=1e-9)
    for name in ("x_dot", "y_dot"):
        assert (
            np.max(np.abs(found[name] - explicit[name])) < 1e-4 * (rtol / 1e-5) ** 0.5
        )


@pytest.mark.slow
def test_steps_that_shrink_for_another_reason_are_no_stiffness():
    # At rest the rows of this relation vanish: y' is rounding divided by rounding.
    text = """
    coordinates: {x: {}, y: {}, z: {}}
    energy: {kinetic: (x_dot^2 + y_dot^2 + z_dot^2)/2, potential: 9.81*z}
    constraints: {ratio: x_dot^2 + y_dot^2 = 4*z_dot^2}
    initial: {x: 0, y: 0, z: 0}
    simulation: {duration: 1e-3, output_step: 1e-4}
    """
    found = run(text)
    assert not found.trajectory.choices
    assert "step-at-stability-bound" not in codes(found)


# A damper that lets go: what it held then moves freely.
LETTING_GO = """
parameters: {c: 1e6}
definitions: {held: c*(1 - tanh(20*(t - 1)))/2}
coordinates: {x: {}, y: {}}
energy: {kinetic: (x_dot^2 + y_dot^2)/2, potential: 50*x^2 + 50*y^4}
forces: {x: -held*(x_dot - y_dot), y: held*(x_dot - y_dot)}
initial: {x: 1, y: 1}
simulation: {duration: 20, output_step: 0.1, rtol: 2e-6}
"""


@pytest.mark.slow
def test_the_explicit_method_comes_back_where_nothing_is_stiff_any_more():
    found = run(LETTING_GO)
    there, back = found.trajectory.choices
    assert there.choice.startswith("method: radau from t = ")
    assert back.choice.startswith("method: dop853 from t = ")
    assert not codes(found)
    # The damper has fallen to 1 per unit of time at t = 1 + ln(1e6)/40 = 1.35.
    time = float(back.choice.split()[5])
    assert 1.1 < time < 4
    stiff = run(LETTING_GO, method="radau")
    few, many = found.trajectory.statistics, stiff.trajectory.statistics
    assert few.evaluations < many.evaluations
    assert 3 * few.factorisations < many.factorisations
    # The error is that of the stiff part, at the same tolerance by the same method.
    accurate = run(LETTING_GO, method="radau", rtol="1e-11")
    for name in ("x", "y"):
        errors = [np.max(np.abs(r[name] - accurate[name])) for r in (found, stiff)]
        assert errors[0] < 3 * errors[1]


@pytest.mark.slow
def test_a_series_gives_way_where_fast_motion_is_damped():
    text = (MODELS / "failing" / "relaxation.yaml").read_text(encoding="utf-8")
    found = run(text, duration="60")
    assert found.plan.method == "taylor"
    [choice] = found.trajectory.choices
    assert choice.choice.startswith("method: radau from t = ")
    alone = run(text, duration="60", method="taylor")
    assert not alone.trajectory.choices
    # Radau's steps are four times as long as those which stability allows; the error
    # estimate of y_dot, of order 3, limits them.
    few = found.trajectory.statistics.steps
    many = alone.trajectory.statistics.steps
    assert few - 20_000 < 0.25 * (many - 20_000)
    # Radau keeps to the tolerance too, up to some hundred times for a minute's steps.
    assert np.max(np.abs(found["x"] - alone["x"])) < 1e-7


@pytest.mark.slow  # nearly all of it compiles
def test_a_trial_of_another_method_leaves_the_cells_of_tables():
    # The trial integrates past points of the table, whose cells the kernel passes.
    points = ", ".join(f"[{k}/100, {k % 2}]" for k in range(101))
    text = f"tables: {{push: {{points: [{points}]}}}}\n{DAMPED}"
    for section, added in (
        ("coordinates: {", "w: {}, "), ("kinetic: (", "w_dot^2 + "),
        ("forces: {", "w: push(t), "), ("initial: {", "w: 0, "),
    ):  # fmt: skip
        text = text.replace(section, section + added)
    found = run(text)
    assert found.trajectory.choices  # radau, after a trial
    assert found["w_dot"][-1] == pytest.approx(0.5, abs=1e-12)
