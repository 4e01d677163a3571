"""The method `taylor`: accuracy, its order, its guard, and what it refuses."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest

from lagsim.errors import InputError
from lagsim.methods import taylor
from lagsim.methods.parts import state as at
from lagsim.methods.parts.constraints import met_part
from lagsim.methods.taylor import sum_bend
from lagsim.plan import making
from lagsim.run.system.runner import FUNCTION
from tests.methods.plain import Plain, fresh_state, linked, state_of
from tests.small_scenes import NEARLY, angle, held_pendulum, pendulum, quarter, swing
from tests.support import run

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
    assert 40 < statistics.steps < 200
    # At loose tolerances the last terms shrink by less than is assumed.
    assert statistics.rejections < (0.3 if rtol > 1e-7 else 0.1) * statistics.steps


def test_the_order_follows_the_tolerance():
    assert taylor.order_for(1e-11) == taylor.ORDER
    # e^(-2 (K - 1)) = a tenth of the tolerance (Jorba and Zou).
    orders = [taylor.order_for(10.0**-k) for k in range(3, 14)]
    assert orders == sorted(orders)
    assert orders[0] == math.ceil(1 + 2 * math.log(10))
    assert orders[-1] <= taylor.order_for(5e-14) == taylor.MOST_ORDER
    # Below, where rounding is all: see test_tight.
    assert taylor.order_for(1e-15) == taylor.order_for(0.0) == taylor.TIGHT_ORDER
    assert taylor.order_for(1.0) == taylor.LEAST_ORDER


@pytest.mark.parametrize("rtol", [1e-3, 1e-5, 1e-7])
def test_a_step_is_of_that_order(rtol):
    found = run(PENDULUM.replace("RTOL", str(rtol)))
    runner = found.system.link("taylor")
    order = taylor.order_for(rtol)
    out = np.zeros(1 + 2 * (order + 1))
    y = np.array([2.0, 0.0])
    series = runner.engine.function("series", *FUNCTION)
    series(0.0, y.ctypes.data, found.system.p.flat.ctypes.data, out.ctypes.data)
    assert out[0] == order
    steps = np.array([0.6, 0.75, 0.9])
    sums = np.zeros((len(steps), 2))
    for h, total in zip(steps, sums, strict=True):
        sum_bend(2, out, h, total)
    sums += out[1:3] + steps[:, None] * out[3:5]
    errors = np.abs(sums[:, 0] - swing(steps, 2.0))
    # From rest the angle is even in t: the first odd term left out is zero.
    first = order + 1 + (order + 1) % 2
    slope = np.polyfit(np.log(steps), np.log(errors), 1)[0]
    assert slope == pytest.approx(first, abs=0.5)


def test_kepler_after_whole_orbits():
    found = run("kepler", method="taylor", rtol="1e-13", duration="20*pi")
    # Ten orbits enlarge an error along the path some 6 pi per orbit and orbit passed.
    assert found["x"][-1] == pytest.approx(0.4, abs=1e-11)
    assert abs(found["y"][-1]) < 1e-10
    assert np.max(np.abs(found["energy"] + 0.5)) < 1e-13


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


@pytest.mark.parametrize("method", ["taylor", "dop853", "radau"])
def test_a_megametre_is_not_another_scene(method):
    found = run(SCALED.format(unit=2.0**20, method=method))
    expected = run(SCALED.format(unit=1.0, method=method))
    # A power of two changes no bit of what is computed, the tolerances included.
    assert np.array_equal(found["theta"], expected["theta"])


def test_until():
    found = run(PENDULUM.replace("rtol: RTOL", 'until: "a <= 0"'))
    assert found["t"][-1] == pytest.approx(quarter(2.0), abs=1e-11)


SYMMETRIC = """
coordinates: {a: {}}
energy: {kinetic: a_dot^2/2, potential: -2*cos(a)}
initial: {a: pi/2}
simulation: {duration: 4, output_step: 0.5, method: taylor, rtol: 1.0e-12}
"""


class Bare:
    """Steps that only the last coefficients bound, in plain Python."""

    def __init__(self):
        found = run(SYMMETRIC)
        runner = found.system.link("taylor")
        call = runner.engine.function("series", *FUNCTION)

        def series(t, y, p, out):
            call(t, y.ctypes.data, p.flat.ctypes.data, out.ctypes.data)

        statics = {"PASSED": math.inf, "SAFETY": 1.0}
        self.p = found.system.p
        self.plain = Plain(taylor, linked(runner) | {"series": series}, **statics)
        self.s = fresh_state(
            taylor, [math.pi / 2, 0],
            n=1, rtol=1e-12, row_step=4.0, row_limit=4.0, end=4.0,
        )  # fmt: skip
        self.plain.kernel("start")(self.s, self.p)

    def coefficients(self):
        """Give those of the start (order + 1, size)."""
        order = int(self.s.series[0])
        return self.s.series[1 : 1 + 2 * (order + 1)].reshape(order + 1, 2)

    def end(self):
        while self.s.t < 4.0:
            assert self.plain.kernel("step")(self.s, self.p) == at.DONE
        return state_of(self.s)


@pytest.mark.slow
def test_a_symmetric_start_needs_four_coefficients():
    # Where a starts at rest at 90 degrees, three in four coefficients vanish: at order
    # 16 those of order 15 and 16 do.
    assert taylor.order_for(1e-12) == 16
    expected = run(SYMMETRIC, method="dop853", rtol="1e-15")
    end = [expected[name][-1] for name in ("a", "a_dot")]
    bare = Bare()
    sizes = np.max(np.abs(bare.coefficients()), axis=1)
    # Two alone would let the first step be as long as half of the run.
    terms = sizes * 2.0 ** np.arange(17)
    assert np.all(terms[15:] < 1e-13)
    assert np.all(terms[13:15] > 1e-5)
    assert np.max(np.abs(bare.end() - end)) < 1e-12
    found = run(SYMMETRIC)
    assert found["a"][-1] == pytest.approx(end[0], abs=1e-12)


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
    monkeypatch.setattr(making, "MOST_OPERATIONS", 1000)
    with pytest.raises(InputError) as raised:
        run("andrews", method="taylor")
    [problem] = raised.value.problems
    assert problem.code == "method-refused"
    assert "operations" in problem.text
    assert "dop853" in problem.hint


def test_loops_are_refused():
    twice = HELD.replace("rod:", 'again: "2*x^2 + 2*y^2 = 2", rod:')
    with pytest.raises(InputError) as raised:
        run(twice.replace("RTOL", "1e-11"))
    assert "loops" in raised.value.problems[0].text


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


def test_amplification():
    for z in (0.1j, -0.5 + 0.8j, 1.0 + 0j):
        # The first term left out: 1/16! = 5e-14.
        assert taylor.amplification(z) == pytest.approx(abs(np.exp(z)), abs=2e-13)
    assert taylor.amplification(1j * taylor.IMAGINARY_LIMIT) <= 1.0 + 1e-15
    assert taylor.amplification(2.5j) > 1.0


@pytest.mark.parametrize("rtol", [1e-6, 1e-11])
def test_rows_meet_the_constraints_projected_or_not(rtol):
    found = run(HELD.replace("RTOL", str(rtol)))
    x, y, vx, vy = (found[name] for name in ("x", "y", "x_dot", "y_dot"))
    # Some roundings of terms of size 1, and of 2 x x' where speeds are below 1.7.
    assert np.max(np.abs(x * x + y * y - 1.0)) < 1e-15
    assert np.max(np.abs(x * vx + y * vy)) < 2e-15


def test_the_part_of_a_step_that_needs_no_projection():
    s = SimpleNamespace(fixed_rows=1.0, missed=0.0)
    assert met_part(s, 16.0) == 1.0
    # (1/2)^16 of what the end is off by is one unit of rounding.
    s.missed = 2.0**-37
    assert met_part(s, 16.0) == 0.5
    s.fixed_rows = 0.0
    assert met_part(s, 16.0) == 0.0


def test_rows_of_constraints_that_move_are_all_projected():
    moved = HELD.replace("x^2 + y^2 = 1", "(x - sin(t)/2)^2 + y^2 = 1")
    moved = moved.replace("y: -cos(2)", "y: -cos(2), x_dot: 1/2")
    for text, fixed in ((HELD, 1.0), (moved, 0.0)):
        found = run(text.replace("RTOL", "1e-9"))
        assert found.system.link("taylor").empty.fixed_rows == fixed
