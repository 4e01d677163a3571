"""Runs with tables, against closed forms and scipy's integration of its own curves."""

import functools
import itertools
import json
import math
import re

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline, PchipInterpolator, RectBivariateSpline

from lagsim import check, derive, load, sweep
from lagsim.errors import InputError
from lagsim.methods import method, names
from tests.support import MODELS, run, simulate

ADAPTIVE = [name for name in names() if method(name).ADAPTIVE]
solved = functools.partial(solve_ivp, method="DOP853", rtol=1e-13, atol=1e-14)


def table(x, y, **more):
    return {"points": np.stack([x, y], axis=1).tolist()} | more


def scene(tables, forces, initial, *, potential="0", duration=1, step=None, **more):
    """Return the text of unit masses under forces that call tables."""
    q = [name for name in initial if not name.endswith("_dot")]
    squares = " + ".join(f"{name}_dot^2/2" for name in q)
    asked = {"duration": duration} | ({"output_step": step} if step else {})
    asked |= {k: more.pop(k) for k in ("start", "until") if k in more}
    document = {
        "coordinates": {name: {} for name in q}, "tables": tables,
        "energy": {"kinetic": squares, "potential": potential}, "forces": forces,
        "initial": initial, "simulation": asked, **more,
    }  # fmt: skip
    return "".join(f"{name}: {json.dumps(entry)}\n" for name, entry in document.items())


def steps(name, step):
    """Return the step for a method with fixed steps."""
    return {} if method(name).ADAPTIVE else {"step": step}


def happened(found, kind="switch"):
    return [e.time for e in found.events if e.kind == kind]


def ground(call="ground(t)", **more):
    tables = {"ground": {"points": [[0, 0], [10, 1]]} | more}
    return scene(
        tables, {"x": f"-0.1*{call}"}, {"x": 0}, potential="(2*pi*x)^2/2", duration=10,
        step=0.1,
    )  # fmt: skip


KINKS = [[-3, -9], [-1, -1], [1, 1], [3, 9]]


def spring(points=KINKS, x=2, duration=8, more="", **tables):
    spring = {"points": points, "outside": "extend"}
    return scene(
        {"spring": spring} | tables, {"x": f"-scale*spring(x){more}"}, {"x": x},
        duration=duration, step=0.1, parameters={"scale": 1},
    )  # fmt: skip


@pytest.mark.parametrize("name", ["auto", *ADAPTIVE])
def test_a_linear_table_of_the_time_is_exact(name):
    found = simulate(load(ground()), method=name)
    w = 2.0 * math.pi
    exact = -(found.t - np.sin(w * found.t) / w) * 0.01 / w**2
    assert found["x"] == pytest.approx(exact, abs=1e-10)
    assert not found.events


def quarter():
    """Time of a quarter of the motion from x = 2, and when x = 1 is passed."""
    outer = math.acos(0.2) / 2.0  # x = 0.75 + 1.25 cos(2 t)
    speed = 2.5 * math.sin(2.0 * outer)
    return outer + math.atan2(1.0, speed), outer


@pytest.mark.slow
@pytest.mark.parametrize("name", ["dop853", "radau"])
def test_kinks_in_positions_are_located(name):
    """Passed in both directions as often as they are met, in one arc."""
    period, first = 4.0 * quarter()[0], quarter()[1]
    found = simulate(load(spring()), method=name)
    assert {(e.kind, e.switch) for e in found.events} == {("switch", "spring(x)")}
    times = [first, period / 2 - first, period / 2 + first, period - first]
    assert happened(found)[:4] == pytest.approx(times, abs=1e-9)
    assert found.at(period)["x"] == pytest.approx(2.0, abs=1e-9)
    assert found.at(period / 4.0)["x"] == pytest.approx(0.0, abs=1e-9)
    long = run(spring(duration=80), method=name).trajectory
    assert long.statistics.arcs == 1
    turns = period / 2 * np.arange(100)
    times = np.stack([turns + first, turns + period / 2 - first], axis=1).ravel()
    times = times[times < 80.0]
    assert [e.time for e in long.events] == pytest.approx(times, abs=1e-7)


@pytest.mark.slow
@pytest.mark.parametrize("name", [n for n in names() if n != "dop853"])
def test_every_method_goes_through_kinks(name):
    model = load(spring())
    found = simulate(model, method=name, **steps(name, 0.0005))
    exact = simulate(model, method="dop853")
    assert found.complete
    near = 1e-9 if method(name).ADAPTIVE else 2e-2
    assert found["x"] == pytest.approx(exact["x"], abs=near)


@pytest.mark.parametrize(
    "name", [n for n in names() if method(n).ORDER > 1 and not method(n).ADAPTIVE]
)
def test_a_steep_stretch_of_a_table_of_t_is_exact_by_fixed_steps(name):
    """The stretch is much shorter than a step; beside it the force is constant.

    A parabola is exact for each of these methods, and the velocity after a linear
    force, too. The position on the stretch is off by at most its length squared.
    """
    a, b, end = 0.37, 0.3701, 3.0
    points = [[0, 1], [a, 1], [b, -1], [end, -1]]
    text = scene(
        {"f": {"points": points}}, {"x": "f(t)"}, {"x": 0, "x_dot": 1}, duration=end
    )
    found = simulate(text, method=name, step=0.1)
    speed = 1.0 + a
    final = speed - (end - b)
    assert found["x_dot"][-1] == pytest.approx(final, abs=1e-13)
    assert found["work"][-1] == pytest.approx((final**2 - 1.0) / 2.0, abs=1e-12)
    place = a + a**2 / 2 + speed * (b - a) + speed * (end - b) - (end - b) ** 2 / 2
    assert found["x"][-1] == pytest.approx(place, abs=(b - a) ** 2)


def test_a_kink_of_a_potential_is_a_jump_of_the_force():
    """In the notch |x| the energy falls as exp(-2 t/3): two thirds of it are |x|."""
    notch = {"points": [[-1, 1], [0, 0], [1, 1]], "outside": "extend"}
    found, exact = (
        simulate(load(scene(
            tables, {"x": "-x_dot"}, {"x": 1}, potential=potential, duration=8
        )))
        for tables, potential in (({"V": notch}, "V(x)"), ({}, "abs(x)"))
    )  # fmt: skip
    assert found["x"] == pytest.approx(exact["x"], abs=1e-8)
    half, end = found["energy"][[500, 1000]]
    assert end / half == pytest.approx(math.exp(-8 / 3), rel=0.1)


X, Y = np.array([0.0, 0.7, 1.1, 2.5, 3.0, 4.4]), np.array([0.0, 2, -1, 1, 0.5, 0])
CURVES = {"cubic": CubicSpline, "monotone": PchipInterpolator}


@pytest.mark.slow
@pytest.mark.parametrize("how", CURVES)
@pytest.mark.parametrize("name", ["dop853", "radau", "gauss4"])
def test_smooth_tables_are_those_of_scipy(how, name):
    curve = CURVES[how](X, Y)
    text = scene(
        {"f": table(X, Y, interpolation=how)}, {"x": "f(t) - f(x + 1)"},
        {"x": 1, "x_dot": 0.5}, duration=4, step=0.05,
    )  # fmt: skip
    found = simulate(load(text), method=name, **steps(name, 0.005))
    exact = solved(
        lambda t, z: [z[1], curve(t) - curve(z[0] + 1.0)], (0, 4), [1.0, 0.5],
        t_eval=found.t, max_step=0.01,
    )  # fmt: skip
    near = 1e-10 if method(name).ADAPTIVE else 1e-6
    assert found["x"] == pytest.approx(exact.y[0], abs=near)


@pytest.mark.slow
def test_a_smooth_table_of_two_arguments_is_that_of_scipy():
    a, b = np.linspace(-3.0, 3.0, 7), np.linspace(-2.0, 4.0, 5)
    z = np.sin(np.add.outer(a, b))
    rows = [[p, q, z[i, j]] for j, q in enumerate(b) for i, p in enumerate(a)]
    tables = {"f": {"points": rows[::-1], "interpolation": "cubic"}}
    forces = {"x": "f(x, x_dot + 1) - x"}
    found = simulate(load(scene(tables, forces, {"x": 1}, duration=4)))
    spline = RectBivariateSpline(a, b, z, s=0)
    exact = solved(
        lambda _, y: [y[1], float(spline.ev(y[0], y[1] + 1.0)) - y[0]], (0, 4),
        [1.0, 0.0], t_eval=found.t, max_step=0.01,
    )  # fmt: skip
    assert found["x"] == pytest.approx(exact.y[0], abs=1e-10)


def beyond(how, outside):
    """Return a table's function of s, on the piece that contains a middle point."""
    period, ends = X[-1], {"bc_type": "periodic"}
    if outside != "repeat":
        inner = CURVES[how](X, Y)
    elif how == "cubic":
        inner = CubicSpline(X, Y, **ends)
    else:
        turns = [X[:-1] + k * period for k in (-2, -1, 0, 1, 2)]
        inner = PchipInterpolator(np.concatenate(turns), np.tile(Y[:-1], 5))

    def value(s, middle):
        if outside == "repeat":
            return inner(s - np.floor(middle / period) * period)
        if X[0] < middle < period:
            return inner(s)
        end = X[0] if middle < X[0] else period
        slope = inner(end, 1) if outside == "extend" else 0.0
        return inner(end) + slope * (s - end)

    return value


@pytest.mark.parametrize("how", CURVES)
@pytest.mark.parametrize("outside", ["hold", "extend", "repeat"])
@pytest.mark.parametrize("name", ["dop853", "taylor", "radau"])
@pytest.mark.parametrize("argument", ["rate*t - 1", "s", "s - sin(t)^2 - cos(t)^2 + 1"])
def test_steps_end_at_the_points_of_a_smooth_table(how, outside, name, argument):
    """Each piece is a polynomial: so are the motion under it, and the work.

    s moves uniformly. The error estimate of dop853 alone left 1e-9 where s is the
    argument.
    """
    text = scene(
        {"f": table(X, Y, interpolation=how, outside=outside)},
        {"x": f"f({argument})"},
        {"x": 0.3, "x_dot": 0.5, "s": -1, "s_dot": 1.7}, duration=4, step=0.05,
        parameters={"rate": 1.7},
    )  # fmt: skip
    found, value = simulate(load(text), method=name), beyond(how, outside)
    ends = np.array([-1.0, *X, *(X[1:] + X[-1]), 5.8])
    speed, place, t0 = 0.5, 0.3, 0.0
    for low, high in itertools.pairwise(ends[ends <= 5.8]):
        # A polynomial of degree 3 through four points, integrated twice.
        s = np.linspace(low, high, 4)
        forces = value(s, (low + high) / 2)
        force = np.polynomial.Polynomial.fit((s + 1.0) / 1.7, forces, 3)
        once = force.integ(lbnd=t0) + speed
        twice = once.integ(lbnd=t0) + place
        t0 = (high + 1.0) / 1.7
        speed, place = once(t0), twice(t0)
    assert found["x"][-1] == pytest.approx(place, abs=1e-12)
    assert found["x_dot"][-1] == pytest.approx(speed, abs=1e-12)
    assert not found.events
    balance = found["energy"] - found["work"]
    near = 1e-11 * np.max(np.abs(found["energy"]))
    assert balance == pytest.approx(balance[0], abs=near)


# --- points that are passed within an arc


@pytest.mark.slow
@pytest.mark.parametrize("name", ["dop853", "taylor", "rk4"])
def test_kinks_in_time_are_passed_in_one_arc(name):
    """Four thousand, each where it is: the motion is that of numpy's own pieces."""
    t, h = np.linspace(0.0, 10.0, 4001), 10.0 / 4000 / 2
    f = np.round(np.random.default_rng(8).normal(size=t.size), 3)
    text = scene(
        {"f": table(t, f)}, {"x": "f(2*t)"}, {"x": 0}, duration=5, step=0.05
    )  # fmt: skip
    speed = np.concatenate([[0.0], np.cumsum(0.5 * h * (f[:-1] + f[1:]))])
    moved = h * speed[:-1] + h**2 * (2.0 * f[:-1] + f[1:]) / 6.0
    place = np.concatenate([[0.0], np.cumsum(moved)])
    found = run(text, method=name, **steps(name, 0.01))
    assert found.trajectory.statistics.arcs == 1
    assert found.trajectory.statistics.steps < 4100
    assert found["x"] == pytest.approx(place[::40], abs=1e-12)
    assert found["x_dot"] == pytest.approx(speed[::40], abs=1e-12)
    times = [e.time for e in found.trajectory.events]
    assert times == pytest.approx(t[1:-1] / 2.0, abs=1e-14)


@pytest.mark.slow
@pytest.mark.parametrize("outside", ["hold", "repeat"])
@pytest.mark.parametrize("start", [0, 1_000_000])
def test_rows_in_a_block_have_the_pieces_of_their_own_times(outside, start):
    """In contact, where rows are solved by loops; in both directions of the time."""
    x, y = [0.0, 0.3, 0.4, 1.0], [0.0, 2.0, -1.0, 0.0]
    text = scene(
        {"f": table(x, y, outside=outside)},
        {"x": f"f(t - {start}) + 2*f(1.5 - (t - {start}))"}, {"x": 0, "y": 0.4},
        potential="10*y", start=start, duration=2, step=0.01,
        constraints={"floor": {"relation": "y >= 0", "restitution": 0.5}},
    )  # fmt: skip
    found = simulate(load(text))
    t, period = found.t - start, 1.0 if outside == "repeat" else None
    force = np.interp(t, x, y, period=period)
    force += 2.0 * np.interp(1.5 - t, x, y, period=period)
    near = 1e-13 if start == 0 else 1e-8
    assert found["x_ddot"] == pytest.approx(force, abs=near)
    first = happened(found, "impact")[0] - start
    assert first == pytest.approx(math.sqrt(0.08), abs=max(near, 1e-12))


@pytest.mark.slow
def test_the_power_of_a_kinked_ground_jumps_and_its_work_does_not():
    """A spring stands on it: the rate of `work` has its slope, y' but that has not."""
    x = np.array([0.0, 0.4, 0.5, 1.3, 2.0])
    y = np.array([0.0, 0.3, -0.2, 0.1, 0.0])
    text = scene(
        {"road": table(x, y, outside="repeat")}, {"z": "-z_dot"}, {"z": 0},
        potential="30*(z - road(1.7*t))^2", duration=4,
    )  # fmt: skip
    found = run(text)
    assert found.trajectory.statistics.arcs == 1
    assert found["energy"] - found["work"] == pytest.approx(0.0, abs=1e-10)
    times = np.sort(np.add.outer(2.0 * np.arange(4), x[:-1]).ravel() / 1.7)
    times = [*times[times < 4.0], 4.0]
    passed = [e.time for e in found.trajectory.events]
    assert passed == pytest.approx(times[1:-1], abs=1e-14)
    state = [0.0, 0.0]
    for low, high in itertools.pairwise(times):
        ends = np.interp([low, high], x / 1.7, y, period=2.0 / 1.7)
        rise = (ends[1] - ends[0]) / (high - low)

        def rates(t, q, low=low, first=ends[0], rise=rise):
            return [q[1], -60.0 * (q[0] - first - (t - low) * rise) - q[1]]

        state = solved(rates, (low, high), state).y[:, -1]
    assert [found["z"][-1], found["z_dot"][-1]] == pytest.approx(state, abs=1e-9)


@pytest.mark.slow
def test_points_that_tables_share_are_one_event():
    tables = {
        "f": {"points": [[0, 0], [1, 1], [3, 0]]},
        "g": {"points": [[0, 0], [1, 2], [2, 1], [3, 0]]},
    }
    forces = {"x": "f(t) + g(t) + g(3 - t)"}
    found = simulate(load(scene(tables, forces, {"x": 0}, duration=3)))
    assert [e.time for e in found.events] == pytest.approx([1.0, 2.0], abs=1e-14)
    x, y = [0.0, 1.0, 2.0, 3.0], [0.0, 3.0, 1.5, 0.0]
    expected = np.interp(found.t, x, y) + np.interp(3 - found.t, x, [0, 2, 1, 0])
    assert found["x_ddot"] == pytest.approx(expected, abs=1e-13)


def test_knots_follow_a_mode_that_an_event_sets():
    x, y = [0.0, 1.0, 2.0, 3.0, 4.0], [0.0, 1.0, -1.0, 5.0, 0.0]
    found = simulate(load(scene(
        {"f": table(x, y, outside="repeat")}, {"x": "f(pace*t)"}, {"x": 0}, duration=2,
        step=0.01, modes={"pace": 1},
        events={"faster": {"every": 0.75, "set": {"pace": "2*pace"}}},
    )))  # fmt: skip
    pace = 2.0 ** np.floor(found.t / 0.75 + 1.0)
    inside = np.abs(found.t / 0.75 - np.round(found.t / 0.75)) > 1e-6
    expected = np.interp(pace * found.t, x, y, period=4.0)
    assert found["x_ddot"][inside] == pytest.approx(expected[inside], abs=1e-13)
    # The second pace begins at the knot 4*0.75, and the third at the knot 8*1.5.
    times = [0.5, 1.0, 1.25, 1.625, 1.75, 1.875]
    assert happened(found) == pytest.approx(times, abs=1e-13)


def over_a_ground(place, height, speed, w):
    """End of z'' = w^2 (ground - z) at the last point, from 0: a vibration apiece."""
    z = rate = 0.0
    for dx, low, high in zip(np.diff(place), height[:-1], height[1:], strict=True):
        slope, t = (high - low) / dx * speed, dx / speed
        off, v = z - low, rate - slope
        c, s = math.cos(w * t), math.sin(w * t)
        z, rate = high + off * c + v * s / w, slope - w * off * s + v * c
    return z, rate


@pytest.mark.parametrize(
    "name", ["dop853", "radau", pytest.param("rk4", marks=pytest.mark.slow)]
)
def test_kinks_in_positions_are_passed_in_one_arc(name):
    """However many there are; and every row of a block has its own piece."""
    place, w = np.linspace(0.0, 10.0, 2001), 3.0
    height = np.round(np.cumsum(np.random.default_rng(4).normal(size=2001)) * 0.05, 4)
    text = scene(
        {"ground": table(place, height, outside="extend")}, {"z": f"{w}^2*ground(x)"},
        {"x": 0, "z": 0, "x_dot": 2}, potential=f"{w}^2*z^2/2", duration=5, step=0.01,
    )  # fmt: skip
    found = run(text, method=name, **steps(name, 0.001))
    assert found.trajectory.statistics.arcs == 1
    times = [e.time for e in found.trajectory.events]
    assert times == pytest.approx(place[1:-1] / 2.0, abs=1e-10)
    near = 1e-9 if method(name).ADAPTIVE else 1e-5
    exact = over_a_ground(place, height, 2.0, w)
    assert [found["z"][-1], found["z_dot"][-1]] == pytest.approx(exact, abs=near)
    force = w**2 * (np.interp(found["x"], place, height) - found["z"])
    assert found["z_ddot"] == pytest.approx(force, abs=1e-9)


@pytest.mark.slow
def test_a_force_that_jumps_at_points_is_passed_by_the_rate_they_are_met_at():
    """A potential has steps in its slope: the energy stays, and no point is decided."""
    y = 0.05 * np.random.default_rng(9).normal(size=501)
    y[-1] = y[0]
    found = run(scene(
        {"ground": table(np.linspace(0.0, 10.0, 501), y, outside="repeat")}, {},
        {"x": 0.01, "z": 0, "x_dot": 3}, potential="2*(z - ground(x))^2", duration=5,
        step=0.05,
    ))  # fmt: skip
    assert found.trajectory.statistics.arcs == 1
    assert found["energy"] == pytest.approx(found["energy"][0], abs=1e-9)
    assert len(found.trajectory.events) == math.floor(found["x"][-1] / 0.02)


@pytest.mark.parametrize("name", ["dop853", "taylor", "rk4"])
def test_a_stair_of_whole_numbers_is_passed_by_the_rate_it_is_met_at(name):
    """Series that end have no error, and their steps cross many levels to and fro."""
    text = scene({}, {"x": "-floor(10*x)/5"}, {"x": 0.55, "x_dot": 3}, duration=30)
    found = run(text, method=name, **steps(name, 0.01))
    k, part = np.divmod(10 * found["x"], 1)
    below = (k * (k - 1) / 2 + k * part) / 50  # the potential of the stair
    assert found["x_dot"] ** 2 / 2 + below == pytest.approx(4.5 + 0.25, abs=1e-12)
    assert np.max(found["x"]) > 2.0
    assert found["x_ddot"] == pytest.approx(-k / 5)
    # Where it turns the level passed last is met again, which is decided.
    assert found.trajectory.statistics.arcs < len(found.trajectory.events) / 10


@pytest.mark.parametrize("name", ["dop853", "radau", "taylor"])
def test_a_kink_that_is_touched_or_rested_on_is_none(name):
    tables = {
        "f": {"points": [[-1, -1], [1, 1], [2, 9]], "outside": "extend"},
        "g": {"points": [[-1, -3], [0, 0], [1, 7]], "outside": "extend"},
    }
    forces, start = {"x": "-f(x)", "y": "-g(y)"}, {"x": 1, "y": 0}
    text = scene(tables, forces, start, duration=30, step=0.1)
    found = simulate(load(text), method=name)
    assert found.complete
    assert found["x"] == pytest.approx(np.cos(found.t), abs=1e-8)
    assert not found["y"].any()


@pytest.mark.slow
def test_many_points_cost_no_steps():
    x = np.linspace(-3.0, 3.0, 5001)
    found = [
        simulate(load(spring(points, x=1e-6)), method="dop853")
        for points in ([[-3, -9], [0, 0], [3, 9]], table(x, 3.0 * x)["points"])
    ]
    assert found[0].record["steps"] == found[1].record["steps"]
    assert found[0]["x"] == pytest.approx(found[1]["x"], abs=1e-13)


# --- ends of tables, and tables beside others


@pytest.mark.slow
@pytest.mark.parametrize("how", ["linear", "cubic"])
def test_a_run_ends_with_its_table(how):
    points = [[-1, 1], [0, 1], [2, 1]]

    def ended(call, duration=9, **options):
        tables, start = {"f": {"points": points, "interpolation": how}}, {"x": 0}
        text = scene(tables, {"x": call}, start | {"x_dot": 1}, duration=duration)
        return simulate(load(text), **options)

    found = ended("f(x)")
    end = math.sqrt(5.0) - 1.0  # t + t^2/2 = 2
    assert not found.complete
    assert found.record["failure"]["code"] == "table-ends"
    assert "`f` ends at 2, which `x` has reached" in found.record["reason"]
    reached = float(re.search(r"at t = ([0-9.]+)", found.record["reason"])[1])
    assert reached == pytest.approx(end, abs=1e-12)
    assert np.isfinite(found["x_ddot"]).all()
    assert found.t[-1] == pytest.approx(end, abs=9e-3)
    assert ended("f(2*t)").t[-1] == pytest.approx(1.0, abs=9e-3)
    whole = ended("f(t)", duration=2, error_bar="auto")
    assert whole.complete
    assert whole.error.relative < 1e-12


@pytest.mark.slow
@pytest.mark.parametrize("method", ["dop853", "radau", "taylor"])
@pytest.mark.parametrize("end", [4.5, 5])
def test_a_table_in_the_branch_not_taken_does_not_end_the_run(end, method):
    points = {"f": {"points": [[0, 1], [4, 0.9], [5, 0.5]]}}
    given = 3.8 + (0.7 if end == 5 else 0.4)  # the integral of f up to `end`
    start = {"x": 0, "x_dot": 1}
    text = scene(points, {"x": f"if(x < {end}, f(x), 0)"}, start, duration=6)
    found = simulate(load(text), method=method)
    assert found.complete
    assert found["x_dot"][-1] == pytest.approx(math.sqrt(1 + 2 * given), abs=1e-10)
    text = scene(points, {"x": f"if(t < {end}, f(t), 0)"}, start, duration=6)
    found = simulate(load(text), method=method)
    assert found.complete
    assert found["x_dot"][-1] == pytest.approx(1 + given, abs=1e-10)
    again = f"if(x < {end}, f(x), if(x < 6, 0, f(x)))"
    found = simulate(
        load(scene(points, {"x": again}, start, duration=9)), method=method
    )
    assert "`f` ends at 5, which `x` has reached" in found.record["reason"]
    assert found.t[-1] < 9
    assert found["x"][-1] == pytest.approx(6, abs=0.05)


@pytest.mark.slow
def test_a_table_that_a_mode_or_a_parameter_leaves_out_does_not_end_the_run():
    points = {"f": {"points": [[0, 1], [4, 0.9], [5, 0.5]]}}
    start = {"x": 0, "x_dot": 1}
    off = {"modes": {"n": 0}, "events": {"end": {"at": "x >= 4.5", "set": {"n": 1}}}}
    text = scene(points, {"x": "if(n < 1, f(x), 0)"}, start, duration=6, **off)
    found = simulate(load(text))
    assert found.complete
    assert found["x_dot"][-1] == pytest.approx(math.sqrt(1 + 2 * 4.2), abs=1e-10)
    text = scene(points, {"x": "if(k > 0, f(t), 0)"}, start, duration=6)
    found = simulate(load(f"parameters: {{k: 0, unused: 2*k}}\n{text}"))
    assert found.complete
    assert found["x"][-1] == pytest.approx(6, abs=1e-10)
    found = simulate(load(f"parameters: {{k: 1, unused: 2*k}}\n{text}"))
    assert found.record["failure"]["code"] == "table-ends"


@pytest.mark.slow
@pytest.mark.parametrize("how", ["linear", "cubic"])
@pytest.mark.parametrize("condition", ["f(x) >= 9", "f(x) <= 0.5", "1/f(x) <= 0"])
def test_a_run_ends_with_a_table_that_a_condition_alone_contains(how, condition):
    tables = {"f": {"points": [[0, 1], [1, 2], [3, 1]], "interpolation": how}}
    event = {"modes": {"n": 0}, "events": {"act": {"at": condition, "set": {"n": 1}}}}
    text = scene(tables, {}, {"x": 0, "x_dot": 1}, duration=7, **event)
    found = simulate(load(text))
    assert found.record["failure"]["code"] == "table-ends"
    reached = float(re.search(r"at t = ([0-9.]+)", found.record["reason"])[1])
    assert reached == pytest.approx(3, abs=1e-12)
    assert not [e for e in found.events if e.name == "act"]
    event["events"]["act"]["at"] = f"if(x < 2.5, f(x), 0) {condition[4:]}"
    if condition.startswith("f"):
        found = simulate(
            load(scene(tables, {}, {"x": 0, "x_dot": 1}, duration=7, **event))
        )
        assert found.complete


@pytest.mark.slow
def test_a_table_of_friction_ends_no_run_in_flight():
    floor = {"relation": "y >= 0", "restitution": 0, "friction": "f(slip_speed)"}
    text = scene(
        {"f": {"points": [[0, 0.1], [5, 0.3]]}}, {"x": 8}, {"x": 0, "y": 5},
        potential="10*y", constraints={"floor": floor | {"slip": "x_dot"}},
    )  # fmt: skip
    found = simulate(load(text), duration=0.9)
    assert found.complete
    assert found["x"][-1] == pytest.approx(4 * 0.9**2, abs=1e-12)
    found = simulate(load(text), duration=2)
    assert found.record["failure"]["code"] == "table-ends"
    assert found.t[-1] == pytest.approx(1, abs=2.1e-3)


@pytest.mark.parametrize("outside", ["error", "hold"])
def test_a_table_of_restitution_is_compared_at_impacts_only(outside):
    points = [[0, 1], [4, 0.9], [20, 0.5]]
    floor = {"relation": "y >= 0", "restitution": "f(approach_speed)"}

    def falling(height):
        return simulate(load(scene(
            {"f": {"points": points, "outside": outside}}, {}, {"y": height},
            potential="10*y", duration=3, constraints={"floor": floor},
        )))  # fmt: skip

    found = falling(5)  # 10 m/s, then 7.5 m/s
    assert found.complete
    assert happened(found, "impact") == pytest.approx([1.0, 2.5], abs=1e-12)
    found = falling(25)
    assert found.complete == (outside == "hold")
    if not found.complete:
        assert "`f` ends at 20" in found.record["reason"]


@pytest.mark.parametrize("every", [0.4, 0.5])
def test_an_event_at_the_end_of_a_run_where_a_table_ends(every):
    found = simulate(scene(
        {"f": {"points": [[0, 0], [1, 1], [2, 0]], "interpolation": "linear"}},
        {"x": "f(t)"}, {"x": 0}, duration=2, modes={"k": 0},
        events={"tick": {"every": every, "set": {"k": "k + 1"}}},
        definitions={"ticks": "k"},
    ))  # fmt: skip
    assert found.outcome == "done"
    assert found["x"][-1] == pytest.approx(1.0, abs=1e-12)
    assert found["ticks"][-1] == round(2.0 / every) + 1


@pytest.mark.slow
def test_a_table_beside_everything_else():
    """Starts, events, contact, friction, `until`, sweeps and other values."""
    floor = {"relation": "y >= 0", "restitution": 0.5, "friction": 0.1, "slip": "x_dot"}
    model = load(scene(
        {"bump": {"points": [[0, 0], [0.5, 1], [1, 0]], "outside": "repeat"},
         "wind": {"points": [[0, 0], [1, 1], [2, 0]], "outside": "hold",
                  "interpolation": "monotone"}},
        {"x": "k*wind(t) + if(bump(t) > d, 1, 0)"},
        {"x": "bump(0.5) - 1", "y": "2*bump(0.5)"}, potential="9.81*y", duration=3,
        until="x >= 1.2*bump(0.5)", parameters={"k": 1, "d": "bump(0.25)"},
        constraints={"floor": floor},
    ))  # fmt: skip
    found = simulate(model)
    assert found.record["parameters"]["d"] == 0.5
    assert (found["x"][0], found["y"][0]) == (0.0, 2.0)
    assert {"switch", "impact", "until"} <= {e.kind for e in found.events}
    falls = happened(found, "impact")
    assert falls[0] == pytest.approx(math.sqrt(4.0 / 9.81), abs=1e-12)
    assert {0.25, 0.75, 1.25} <= {round(t, 12) for t in happened(found)}
    ledger = found["energy"] - found["work"]
    assert ledger == pytest.approx(ledger[0], abs=1e-9)
    swept = sweep(model, {"k": [0.5, 1.0]}, jobs=1)
    other = simulate(model.bind(k=0.5))
    ends = [other["x"][-1], found["x"][-1]]
    assert swept["x.end"] == pytest.approx(ends, abs=1e-12)


def test_accelerations_derivations_and_the_module_know_tables():
    corners = [[0, -9, 0], [0, 9, 1], [9, -9, 3], [9, 9, 7]]
    model = load(spring(more=" + V(t, x)", V={"points": corners}))
    found, module = derive(model), {}
    assert "spring(x)" in found.text
    assert "V(t, x)" in found.text
    assert r"\mathrm{spring}\left(x\right)" in found.latex
    exec(found.python, module)
    for t, x in ((0.5, 0.3), (3.0, 2.9), (8.0, -7.0)):
        V = (9 - t) * (9 + x) / 162 + t * (3 * (9 - x) + 7 * (9 + x)) / 162
        expected = V - np.interp(x, [-3, -1, 1, 3], [-9, -1, 1, 9]) - 4 * min(x + 3, 0)
        for force in (module["force"], model.rhs):
            assert force(t, [x], [0.0]) == pytest.approx([expected], abs=1e-12)


@pytest.mark.slow
def test_the_shipped_car_is_that_of_scipy():
    path = str(MODELS / "car-on-a-road.yaml")
    found = simulate(path, duration=2)
    road = CubicSpline(*np.loadtxt(MODELS / "road.csv", delimiter=",", skiprows=1).T)
    m = np.array([420.0, 1100.0, 53.0, 76.0])
    front, rear = np.array([1, 1.4, -1, 0]), np.array([1, -1.47, 0, -1])
    C = [np.outer(front, front), np.outer(rear, rear)]
    K = 1e4 * C[0] + 1.3e4 * C[1] + np.diag([0, 0, 2e5, 2e5])
    C = 1e3 * (C[0] + C[1])

    def rates(t, z):
        h = road([20 * t + 2.87, 20 * t])
        return [*z[4:], *((2e5 * np.array([0, 0, *h]) - K @ z[:4] - C @ z[4:]) / m)]

    exact = solved(rates, (0, 2), np.zeros(8), t_eval=[1, 2], rtol=1e-12, max_step=0.02)
    ends = [[found[name][k] for k in (200, 400)] for name in ("z", "pitch", "z1", "z2")]
    assert np.array(ends) == pytest.approx(exact.y[:4], abs=1e-10)
    assert found.record["model"]["tables"]["road"]["file"] == "road.csv"
    assert check(path).admissible


FAMILY = """
parameters: {n: 2, k(i = 1..n): stiff(i)}
coordinates: {x(1..n): {}}
tables:
  stiff: {points: [[1, 1], [2, 4]]}
  pull: {points: [[0, 0, 0], [0, 9, 9], [9, 0, 0], [9, 9, 9]], outside: extend}
energy:
  kinetic: sum(i = 1..n, x_dot(i)^2)/2
  potential: sum(i = 1..n, k(i)*x(i)^2)/2
forces: {x(i = 1..n): "pull(x(3 - i), 0*i)"}
initial: {x(i = 1..n): stiff(i)}
simulation: {duration: 2}
"""


def test_members_of_families_call_tables():
    found = simulate(load(FAMILY))
    assert found["x.1"] == pytest.approx(np.cos(found.t), abs=1e-9)
    assert found["x.2"] == pytest.approx(4.0 * np.cos(2.0 * found.t), abs=1e-9)
    for old, new, code in (
        ("pull(x(3 - i), 0*i)", "pull(x(1))", "expression-arity"),
        ("stiff(i)}\nsim", "stif(i)}\nsim", "expression-unknown-function"),
    ):
        with pytest.raises(InputError) as fault:
            load(FAMILY.replace(old, new))
        assert {p.code for p in fault.value.problems} == {code}


BESIDE = """
coordinates: {x: , y: }
tables: {f: {points: POINTS, interpolation: linear, outside: extend}}
energy: {kinetic: (x_dot^2 + y_dot^2)/2, potential: "9.81*y + f(ARGUMENT)"}
constraints: {ground: {relation: y >= 0, restitution: 0.5LAW}}
initial: {x: 0, y: 0, x_dot: 1}
simulation: {start: START, duration: 8, output_step: 0.05}
"""


def beside(points, argument="x", law="", start=0):
    text = BESIDE.replace("POINTS", str(points)).replace("ARGUMENT", argument)
    return run(text.replace("LAW", law).replace("START", str(start)))


@pytest.mark.parametrize("start", [0, 1000])
@pytest.mark.parametrize("mu", [0, 0.004])
def test_forces_that_jump_beside_a_contact_end_no_arc(mu, start):
    """By the energy v^2 = 1 - 2 f(x) - 2 mu g x, over 300 points and more."""
    points = [[k / 50, (-1) ** k * 0.001 - 0.001] for k in range(-5, 500)]
    law = f", friction: {mu}, slip: x_dot" if mu else ""
    found = beside(points, "x", law, start)
    x, statistics = found["x"], found.trajectory.statistics
    f = np.interp(x, *np.transpose(points))
    speed = np.sqrt(1 - 2 * f - 2 * mu * 9.81 * x)
    assert np.max(np.abs(found["x_dot"] - speed)) < 1e-10
    assert x[-1] > 6
    passed = found.trajectory.event_counts["switch"]
    assert passed == math.floor(50 * x[-1])
    assert statistics.arcs < 10
    assert found.drift < 1e-12


def test_a_force_that_jumps_lifts_a_body_off():
    # Past x + y = 1 the slope is -20: x'' = 20, y'' = 20 - 9.81.
    found = beside([[-1, 0], [1, 0], [2, -20]], "x + y")
    t, late = found["t"], np.maximum(found["t"] - 1, 0)
    assert [e.kind for e in found.trajectory.events if e.constraint] == ["release"]
    assert np.max(np.abs(found["x"] - t - 10 * late**2)) < 1e-9
    assert np.max(np.abs(found["y"] - 10.19 / 2 * late**2)) < 1e-9


@pytest.mark.slow
def test_what_a_table_holds_has_the_energy_of_its_level():
    """Friction brings it to rest in a valley, whose level it keeps."""
    points = [[-1, 3], [0, 0], [0.5, 4], [1, 0]]
    found = beside(points, "x", ", friction: 0.2, slip: x_dot")
    assert found["x"][-1] == pytest.approx(0, abs=1e-12)
    assert found["x_dot"][-1] == 0
    assert found["potential"][-1] == pytest.approx(0, abs=1e-12)
    assert found.drift < 1e-12
