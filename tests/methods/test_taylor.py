"""The method `taylor`: accuracy, its order, its guard, and its refusals."""

import ctypes
import math

import numpy as np
import pytest
from scipy.optimize import brentq

from lagsim.methods import taylor
from lagsim.plan import method_choice
from lagsim.studies.sweep.batches import Ensemble
from tests.small_scenes import NEARLY, angle, held_pendulum, pendulum, swing
from tests.support import MODELS, refused, run

SIMULATION = "duration: 20, output_step: 0.1, method: taylor, rtol: RTOL"
PENDULUM, HELD = pendulum(2, SIMULATION), held_pendulum(2, SIMULATION)


def off(text, rtol):
    found = run(text.replace("RTOL", str(rtol)))
    return np.max(np.abs(angle(found) - swing(found["t"], 2.0))), found


@pytest.mark.parametrize("text", [PENDULUM, HELD])
@pytest.mark.parametrize("rtol", [1e-6, 1e-8, 1e-11, 1e-13])
def test_a_pendulum(text, rtol):
    # Three swings of amplitude 2 enlarge what a step is off by less than 30 times; the
    # rows in between are the series itself. Below, 40 units of rounding in each swing.
    error, found = off(text, rtol)
    assert error < 3 * rtol + 3e-14
    assert found.drift < 3 * rtol + 3e-14
    statistics = found.trajectory.statistics
    # The order grows with the tolerance, the number of steps hardly does.
    assert 30 < statistics.steps < 200
    # At loose tolerances the last terms shrink by less than is assumed.
    assert statistics.rejections < (0.3 if rtol > 1e-7 else 0.1) * statistics.steps


@pytest.mark.slow
@pytest.mark.parametrize("rtol", [1e-6, 1e-7, 1e-8])
def test_few_steps_of_a_mechanism_are_repeated(rtol):
    text = (MODELS / "andrews.yaml").read_text()
    found = run(text, method="taylor", rtol=rtol)
    statistics = found.trajectory.statistics
    assert statistics.rejections <= 0.05 * statistics.steps
    # The angle of the crank, of range 16, at the end: the test set's value, 12 digits.
    assert abs(found["beta"][-1] - 15.8107711952) < 16 * rtol


def test_the_order_follows_the_tolerance():
    assert taylor.order_for(1e-11) == taylor.ORDER
    # e^(-2 (K - 3)) = a tenth of the tolerance: two orders more than Jorba and Zou.
    orders = [taylor.order_for(10.0**-k) for k in range(3, 14)]
    assert orders == sorted(orders)
    assert orders[0] == math.ceil(3 + 2 * math.log(10))
    assert orders[-1] <= taylor.order_for(5e-14) == taylor.MOST_ORDER
    # Below, where rounding is all: see test_tight.
    assert taylor.order_for(1e-15) == taylor.order_for(0.0) == taylor.TIGHT_ORDER
    assert taylor.order_for(100.0) == taylor.LEAST_ORDER


@pytest.mark.parametrize("order", [8, 13, 18])
def test_the_error_at_the_bound_of_stability(order):
    """It is that of y' = -y, whose steps settle where |R(-h)| = 1."""

    def growth(h):
        return abs(sum((-h) ** k / math.factorial(k) for k in range(order + 1)))

    h = brentq(lambda h: growth(h) - 1.0, 0.3 * order, order)
    last = math.exp(2) * 0.8**order
    expected = last * h / (order + 1)
    # K/e + 1.4 is the bound of stability within 1 %.
    assert taylor.error_at_bound(order, 0.8) == pytest.approx(expected, rel=0.01)


MISSILE = """
coordinates: {x: {}}
energy: {kinetic: x_dot^2/2, potential: 0}
forces: {x: "FORCE"}
initial: {x: 0}
simulation: {duration: 4, output_step: 0.03, method: taylor}
"""


def test_a_force_in_time():
    found = run(MISSILE.replace("FORCE", "cos(3*t)*exp(-t)"))
    t = found["t"]
    # x'' = Re exp(w t), w = -1 + 3i, from rest.
    w = -1 + 3j
    x = ((np.exp(w * t) - 1) / w**2 - t / w).real
    assert np.max(np.abs(found["x"] - x)) < 1e-11  # the tolerance, of |x| < 1
    assert found.drift < 1e-11


@pytest.mark.parametrize(
    ("force", "after"),
    [
        ("if(t < 1, 1, -1)", lambda t: t - 0.5 - (t - 1.0) ** 2 / 2),
        ("2*heaviside(1 - t) - 1", lambda t: t - 0.5 - (t - 1.0) ** 2 / 2),
        ("abs(t - 1)", lambda t: (t - 1.0) ** 3 / 6 + t / 2 - 1 / 6),
        ("max(1 - t, 0)", lambda t: t / 2 - 1 / 6),
    ],
)
def test_breaks_in_time(force, after):
    found = run(MISSILE.replace("FORCE", force))
    t, x = found["t"], found["x"]
    late = t >= 1.0
    # Polynomials: each arc is one step, exact to rounding on |x| < 4.
    assert np.max(np.abs(x[late] - after(t[late]))) < 1e-14
    assert found.trajectory.statistics.steps <= 4
    assert [event.kind for event in found.trajectory.events] == ["switch"]


SCALED = """
parameters: {{g: 9.8*{unit}, k: 25.6, l: {unit}}}
coordinates: {{theta: {{}}, u: {{}}}}
energy:
  kinetic: ((l + u)*theta_dot)^2/2 + u_dot^2/2
  potential: g*(l - (l + u)*cos(theta)) + k*u^2/2
initial: {{theta: 1, u: 0}}
simulation: {{duration: 10, output_step: 0.1, method: {method}}}
"""


SLOW = [pytest.param(name, marks=pytest.mark.slow) for name in ("dop853", "radau")]


@pytest.mark.slow
@pytest.mark.parametrize("method", ["taylor", *SLOW])
def test_a_megametre_is_not_another_scene(method):
    found = run(SCALED.format(unit=2.0**20, method=method))
    expected = run(SCALED.format(unit=1.0, method=method))
    # A power of two changes no bit of what is computed, the tolerances included.
    assert np.array_equal(found["theta"], expected["theta"])


SYMMETRIC = """
coordinates: {a: {}}
energy: {kinetic: a_dot^2/2, potential: -2*cos(a)}
initial: {a: pi/2}
simulation: {duration: 4, output_step: 0.5, method: taylor, rtol: 1.0e-11}
"""


@pytest.mark.parametrize("rtol", [1e-9, 1e-11])
def test_a_symmetric_start_needs_four_coefficients(rtol):
    # Where a starts at rest at 90 degrees, three in four coefficients vanish: at order
    # 17 those of order 15 to 17 do, and a step would be as long as half of the run.
    assert taylor.order_for(1e-11) == 17
    expected = run(SYMMETRIC, method="dop853", rtol="1e-15")
    found = run(SYMMETRIC, rtol=str(rtol))
    assert found["a"][-1] == pytest.approx(expected["a"][-1], abs=rtol)
    assert found.trajectory.statistics.rejections == 0


@pytest.mark.slow
@pytest.mark.parametrize(
    "model",
    [
        "chain-cartesian",
        pytest.param("andrews", marks=pytest.mark.slow),
        pytest.param("chain-angles", marks=pytest.mark.slow),
    ],
)
def test_a_long_series(model):
    # Two methods that have nothing in common but the equations.
    one, other = (
        run(model, method=method, rtol=1e-12, duration=0.02)
        for method in ("taylor", "dop853")
    )
    choices = [c.choice for c in one.plan.choices]
    assert "series: a loop over the order" in choices
    assert one.trajectory.statistics.rejections <= 1
    for name in one.system.equations.q:
        size = np.max(np.abs(other[name]))
        assert np.max(np.abs(one[name] - other[name])) < 1e-10 * max(size, 1e-3), name


def test_what_is_too_long_is_refused(monkeypatch):
    monkeypatch.setattr(method_choice, "MOST_OPERATIONS", 1000)
    with refused("method-refused", "`taylor`", "dop853"):
        run("andrews", method="taylor")


def test_loops_are_refused():
    twice = HELD.replace("rod:", 'again: "2*x^2 + 2*y^2 = 2", rod:')
    with refused("method-refused", "`taylor`"):
        run(twice.replace("RTOL", "1e-11"))


@pytest.mark.slow
def test_where_loops_take_over_another_method_goes_on():
    # The angle between the rows falls to 0.002, slowly; a loss of rank that is passed
    # in one step would need no loops.
    text = NEARLY.replace("x: 0", "x: 1").replace("x_dot: 1", "x_dot: 0.049")
    text = text.replace("METHOD", ", method: taylor, formulation: full")
    found = run(text.replace("DURATION", "2"))
    assert "nearly-dependent" in [w.code for w in found.trajectory.warnings]
    assert found.trajectory.outcome.word == "done"
    assert len(found.rows) == 201
    assert np.max(np.abs(found["x"] - 1 - 0.049 * found["t"])) < 1e-12
    clock = found["clock"] - np.cos(20.0 * found["t"])
    assert np.max(np.abs(clock)) < 1e-9  # as for dop853 alone


@pytest.mark.slow
def test_rows_meet_the_constraints_projected_or_not():
    for rtol in (1e-6, 1e-8, 1e-11):
        found = run(HELD.replace("RTOL", str(rtol)))
        x, y, vx, vy = (found[name] for name in ("x", "y", "x_dot", "y_dot"))
        # A row without projection has a residual of at most STATE_ROUNDOFF of x^2 + y^2
        # + 1, or 9e-16, and the rounding of x, y and of the sum, 4e-16. Speeds are
        # below 1.7.
        assert np.max(np.abs(x * x + y * y - 1.0)) < 1.4e-15, rtol
        assert np.max(np.abs(x * vx + y * vy)) < 2e-15, rtol


@pytest.mark.slow
@pytest.mark.parametrize("x", [0.01, 0.9, 0.97, 0.999])
def test_dense_output_comes_from_the_nearer_end_of_a_step(x):
    found = run(HELD.replace("RTOL", "1e-3"))
    several = Ensemble(found.session)
    several.begin(0, np.zeros(0))
    arc = several.arc
    arc.runner.advance(arc.state, 1000, 5)
    out, pointer = np.zeros(len(arc.y)), ctypes.c_void_p
    at = arc.runner.engine.function(
        "interpolate", None, (pointer, pointer, ctypes.c_double, pointer)
    )
    at(arc.state.address, several.session.system.p.address, x, out.ctypes.data)
    # At this tolerance steps of order 6 leave 3e-6 before their projection, and a
    # series the part x^7 of that at the fraction x of the step from its own end.
    near = min(x, 1.0 - x)
    assert abs(out[0] ** 2 + out[1] ** 2 - 1.0) < 1e-3 * near**5 + 1e-15
    assert abs(out[0] * out[2] + out[1] * out[3]) < 1e-2 * near**5 + 2e-15


@pytest.mark.slow
def test_rows_between_the_ends_are_on_the_constraints_by_terms_beyond_the_order():
    found = run(HELD.replace("RTOL", "1e-7"))
    several = Ensemble(found.session)
    several.begin(0, np.zeros(0))
    arc = several.arc
    out, pointer = np.zeros(len(arc.y)), ctypes.c_void_p
    at = arc.runner.engine.function(
        "interpolate", None, (pointer, pointer, ctypes.c_double, pointer)
    )
    p, continued = several.session.system.p.address, 0
    for _ in range(20):
        arc.runner.advance(arc.state, 1000, 1)
        alone = arc.state.alone
        at(arc.state.address, p, 0.5, out.ctypes.data)
        continued += arc.state.satisfied >= 0.5 > alone
        # Unprojected. Without these terms 1e-7 x^14 is left at the fraction x, and
        # where this is rounding, its rate is 14/(x h) times as large.
        for x in np.linspace(alone, 1.0 - alone, 9):
            far = min(x, 1.0 - x)
            at(arc.state.address, p, x, out.ctypes.data)
            if 0.0 < far <= arc.state.satisfied:
                # The rounding of a sum of 14 terms, and of the rates of these.
                assert abs(out[0] ** 2 + out[1] ** 2 - 1.0) < 14 * 2.2e-16
                rounding = 2.2e-16 * (3 + 14 / (far * arc.state.step_h))
                assert abs(out[0] * out[2] + out[1] * out[3]) < rounding
    assert continued > 5


@pytest.mark.slow
def test_rows_of_constraints_that_move_are_all_projected():
    moved = HELD.replace("x^2 + y^2 = 1", "(x - sin(t)/2)^2 + y^2 = 1")
    moved = moved.replace("y: -cos(2)", "y: -cos(2), x_dot: 1/2")
    for text, fixed in ((HELD, 1.0), (moved, 0.0)):
        found = run(text.replace("RTOL", "1e-9"))
        assert found.system.link("taylor").empty.fixed_rows == fixed


def test_rounding_costs_one_evaluation_a_step_where_that_is_enough():
    text = (MODELS / "failing" / "relaxation.yaml").read_text()
    text = text.replace("duration: 20", "duration: 0.3")
    statistics = run(text, method="taylor").trajectory.statistics
    # A step evaluates its series and, nearby, the rates, once each. A rejected one
    # evaluates in two directions, again as it is repeated.
    assert statistics.steps > 300
    most = 2 * statistics.steps + 8 * statistics.rejections + 20
    assert statistics.evaluations < most


PIECES = """
coordinates: {x: {}, y: {}}
energy: {kinetic: 0.73*x_dot^2/2 + y_dot^2/2, potential: 0.6*x^2 + 0.97*y^2}
modes: {u: -0.6}
events:
  e: {at: "if(2*y - 1.4 < 0, 0, 1) + y_dot <= 2*x - 0.34", set: {u: u - 0.4}}
definitions:
  d: -0.17*mod(1.77*t - 2, 2.5)
  s: 0.73*if(not (0.78*y >= 0.73), -0.9, -0.97) - u
forces:
  y: d + -1.125*(s - mod(s, 1))
  x: -0.67*(-max(-(y_dot - 1.3*(-max(-(2*t + 1.36), 0.23))), -0.5*x))
initial: {x: -0.14, y: 0, x_dot: 1, y_dot: 0}
"""


@pytest.mark.slow
def test_a_series_reads_values_of_branches_that_memory_holds():
    # The rates of a branch of `mod` stand in memory, and occur in no order alone.
    series, stages = (
        run(f"{PIECES}simulation: {{duration: 3, method: {name}}}")
        for name in ("taylor", "dop853")
    )
    for name in ("x", "y", "x_dot", "y_dot"):
        assert series[name] == pytest.approx(stages[name], abs=1e-9)
