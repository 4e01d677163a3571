"""Runs with tables, against closed forms and scipy's integration of its own curves."""

import itertools
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
GROUND = """
coordinates: {x: {}}
tables: {ground: {points: [[0, 0], [10, 1]]}}
energy: {kinetic: x_dot^2/2, potential: (2*pi*x)^2/2}
forces: {x: -0.1*ground(t)}
initial: {x: 0}
simulation: {duration: 10, output_step: 0.1}
"""
SPRING = """
parameters: {scale: 1}
coordinates: {x: {}}
tables: {spring: {points: [[-3, -9], [-1, -1], [1, 1], [3, 9]], outside: extend}}
energy: {kinetic: x_dot^2/2, potential: 0}
forces: {x: -scale*spring(x)}
initial: {x: 2}
simulation: {duration: 8, output_step: 0.1}
"""
FREE = "energy: {kinetic: x_dot^2/2, potential: 0}\n"


@pytest.mark.parametrize("name", ["auto", *ADAPTIVE])
def test_a_linear_table_of_the_time_is_exact(name):
    if name == "exponential":
        pytest.skip("not of equations that depend on the time")
    found = simulate(load(GROUND), method=name)
    w = 2.0 * math.pi
    exact = -(found.t - np.sin(w * found.t) / w) * 0.01 / w**2
    assert found["x"] == pytest.approx(exact, abs=1e-10)
    assert not found.events


def quarter():
    """Time of a quarter of the motion from x = 2, and when x = 1 is passed."""
    outer = math.acos(0.2) / 2.0  # x = 0.75 + 1.25 cos(2 t)
    speed = 2.5 * math.sin(2.0 * outer)
    return outer + math.atan2(1.0, speed), outer


@pytest.mark.parametrize("name", ["dop853", "radau"])
def test_kinks_in_positions_are_located(name):
    period, first = 4.0 * quarter()[0], quarter()[1]
    found = simulate(load(SPRING), method=name)
    assert [e.kind for e in found.events] == ["switch"] * len(found.events)
    assert found.events[0].switch == "spring(x)"
    times = [first, period / 2 - first, period / 2 + first, period - first]
    assert [e.time for e in found.events][:4] == pytest.approx(times, abs=1e-9)
    assert found.at(period)["x"] == pytest.approx(2.0, abs=1e-9)
    assert found.at(period / 4.0)["x"] == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize(
    "name", [n for n in names() if n not in ("exponential", "dop853")]
)
def test_every_method_goes_through_kinks(name):
    model = load(SPRING)
    options = {} if method(name).ADAPTIVE else {"step": 0.0005}
    found = simulate(model, method=name, **options)
    exact = simulate(model, method="dop853")
    near = 1e-9 if method(name).ADAPTIVE else 2e-2
    assert found.complete
    assert found["x"] == pytest.approx(exact["x"], abs=near)


def test_a_kink_of_a_potential_is_a_jump_of_the_force():
    """In the notch |x| the energy falls as exp(-2 t/3): two thirds of it are |x|."""
    text = """
    coordinates: {x: {}}
    tables: {V: {points: [[-1, 1], [0, 0], [1, 1]], outside: extend}}
    energy: {kinetic: x_dot^2/2, potential: V(x)}
    forces: {x: -x_dot}
    initial: {x: 1}
    simulation: {duration: 8}
    """
    plain = text.replace("V(x)", "abs(x)").replace("tables", "x-tables")
    found, exact = (simulate(load(t.replace("\n    ", "\n"))) for t in (text, plain))
    assert found["x"] == pytest.approx(exact["x"], abs=1e-8)
    half, end = found["energy"][[500, 1000]]
    assert end / half == pytest.approx(math.exp(-8 / 3), rel=0.1)


CURVE = (
    np.array([0.0, 0.7, 1.1, 2.5, 3.0, 4.4]),
    np.array([0.0, 2.0, -1.0, 1.0, 0.5, 0.0]),
)


@pytest.mark.parametrize("how", ["cubic", "monotone"])
@pytest.mark.parametrize("name", ["dop853", "radau", "gauss4"])
def test_smooth_tables_are_those_of_scipy(how, name):
    x, y = CURVE
    curve = CubicSpline(x, y) if how == "cubic" else PchipInterpolator(x, y)
    points = [[float(a), float(b)] for a, b in zip(x, y, strict=True)]
    text = f"coordinates: {{x: {{}}}}\n{FREE}initial: {{x: 1, x_dot: 0.5}}\n"
    text += f"tables: {{f: {{points: {points}, interpolation: {how}}}}}\n"
    text += "forces: {x: f(t) - f(x + 1)}\nsimulation: {duration: 4, output_step: 0.05}"
    options = {} if method(name).ADAPTIVE else {"step": 0.005}
    found = simulate(load(text), method=name, **options)
    exact = solve_ivp(
        lambda t, z: [z[1], curve(t) - curve(z[0] + 1.0)], (0, 4), [1.0, 0.5], "DOP853",
        t_eval=found.t, rtol=1e-13, atol=1e-14, max_step=0.01,
    )  # fmt: skip
    near = 1e-10 if method(name).ADAPTIVE else 1e-6
    assert found["x"] == pytest.approx(exact.y[0], abs=near)


def test_a_smooth_table_of_two_arguments_is_that_of_scipy():
    a, b = np.linspace(-3.0, 3.0, 7), np.linspace(-2.0, 4.0, 5)
    z = np.sin(np.add.outer(a, b))
    rows = [
        [float(p), float(q), float(z[i, j])]
        for j, q in enumerate(b)
        for i, p in enumerate(a)
    ]
    text = f"coordinates: {{x: {{}}}}\n{FREE}initial: {{x: 1}}\n"
    text += f"tables: {{f: {{points: {rows[::-1]}, interpolation: cubic}}}}\n"
    text += "forces: {x: 'f(x, x_dot + 1) - x'}\nsimulation: {duration: 4}"
    found = simulate(load(text))
    spline = RectBivariateSpline(a, b, z, s=0)
    exact = solve_ivp(
        lambda _, y: [y[1], float(spline.ev(y[0], y[1] + 1.0)) - y[0]], (0, 4),
        [1.0, 0.0], "DOP853", t_eval=found.t, rtol=1e-13, atol=1e-14, max_step=0.01,
    )  # fmt: skip
    assert found["x"] == pytest.approx(exact.y[0], abs=1e-10)


def test_taylor_refuses_what_has_no_series_and_auto_does_not_take_it():
    text = GROUND.replace("ground: {", "ground: {interpolation: cubic, ")
    assert simulate(load(text)).record["method"] == "dop853"
    with pytest.raises(Exception, match="the table `ground`"):
        simulate(load(text.replace("ground(t)", "ground(x + 1)")), method="taylor")


@pytest.mark.parametrize("how", ["cubic", "monotone"])
@pytest.mark.parametrize("outside", ["hold", "extend", "repeat"])
@pytest.mark.parametrize("name", ["dop853", "taylor", "radau"])
def test_steps_end_at_the_points_of_a_smooth_table_of_the_time(how, outside, name):
    """Each piece is a polynomial: what it moves is one, too, and so is the work."""
    x, y = CURVE
    points = [[float(a), float(b)] for a, b in zip(x, y, strict=True)]
    text = f"coordinates: {{x: {{}}}}\n{FREE}initial: {{x: 0.3, x_dot: 0.5}}\n"
    text += f"tables: {{f: {{points: {points}, interpolation: {how}, "
    text += f"outside: {outside}}}}}\nparameters: {{rate: 1.7}}\n"
    text += "forces: {x: f(rate*t - 1)}\nsimulation: {duration: 4, output_step: 0.05}"
    found = simulate(load(text), method=name)
    curve = {"cubic": CubicSpline, "monotone": PchipInterpolator}[how]
    again = {"bc_type": "periodic"} if how == "cubic" and outside == "repeat" else {}
    if how == "monotone" and outside == "repeat":
        turns = [x[:-1] + k * x[-1] for k in (-2, -1, 0, 1, 2)]
        inner = curve(np.concatenate(turns), np.tile(y[:-1], 5))
    else:
        inner = curve(x, y, **again)
    ends = np.array([-1.0, *x, *(x[1:] + x[-1]), 5.8])
    speed, place, t0 = 0.5, 0.3, 0.0
    for low, high in itertools.pairwise(ends[ends <= 5.8]):

        def value(s, low=low, high=high):
            middle = 0.5 * (low + high)
            if outside == "repeat":
                return inner(s - np.floor(middle / x[-1]) * x[-1])
            if x[0] < middle < x[-1]:
                return inner(s)
            end = x[0] if middle < x[0] else x[-1]
            slope = inner(end, 1) if outside == "extend" else 0.0
            return inner(end) + slope * (s - end)

        # A polynomial of degree 3 through four points, integrated twice.
        s = np.linspace(low, high, 4)
        force = np.polynomial.Polynomial.fit((s + 1.0) / 1.7, value(s), 3)
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


def test_kinks_in_time_are_passed_in_one_arc():
    """Ten thousand, each where it is: the motion is that of numpy's own pieces."""
    rng = np.random.default_rng(8)
    t = np.linspace(0.0, 10.0, 10_001)
    f = np.round(rng.normal(size=t.size), 3)
    points = np.stack([t, f], axis=1).tolist()
    text = f"coordinates: {{x: {{}}}}\n{FREE}initial: {{x: 0}}\n"
    text += f"tables: {{f: {{points: {points}}}}}\nforces: {{x: f(2*t)}}\n"
    model = load(text + "simulation: {duration: 5, output_step: 0.05}")
    h = 0.0005
    speed = np.concatenate([[0.0], np.cumsum(0.5 * h * (f[:-1] + f[1:]))])
    moved = h * speed[:-1] + h**2 * (2.0 * f[:-1] + f[1:]) / 6.0
    place = np.concatenate([[0.0], np.cumsum(moved)])
    for name in ("dop853", "taylor", "rk4"):
        options = {} if method(name).ADAPTIVE else {"step": 0.01}
        assert run(model, method=name, **options).trajectory.statistics.arcs == 1
        found = simulate(model, method=name, **options)
        assert found.record["steps"] < 10_100
        assert found["x"] == pytest.approx(place[::100], abs=1e-12)
        assert found["x_dot"] == pytest.approx(speed[::100], abs=1e-12)
        assert [e.time for e in found.events] == pytest.approx(t[1:-1] / 2.0, abs=1e-14)


@pytest.mark.parametrize("outside", ["hold", "repeat"])
@pytest.mark.parametrize("start", [0, 1_000_000])
def test_rows_in_a_block_have_the_pieces_of_their_own_times(outside, start):
    """In contact, where rows are solved by loops; in both directions of the time."""
    text = f"""
coordinates: {{x: {{}}, y: {{}}}}
tables:
  f: {{points: [[0, 0], [0.3, 2], [0.4, -1], [1, 0]], outside: {outside}}}
energy: {{kinetic: (x_dot^2 + y_dot^2)/2, potential: 10*y}}
constraints: {{floor: {{relation: y >= 0, restitution: 0.5}}}}
forces: {{x: f(t - {start}) + 2*f(1.5 - (t - {start}))}}
initial: {{x: 0, y: 0.4}}
simulation: {{start: {start}, duration: 2, output_step: 0.01}}
"""
    found = simulate(load(text))
    t = found.t - start
    x, y = [0.0, 0.3, 0.4, 1.0], [0.0, 2.0, -1.0, 0.0]
    period = 1.0 if outside == "repeat" else None
    force = np.interp(t, x, y, period=period)
    force += 2.0 * np.interp(1.5 - t, x, y, period=period)
    near = 1e-13 if start == 0 else 1e-8
    assert found["x_ddot"] == pytest.approx(force, abs=near)
    impacts = [e.time - start for e in found.events if e.kind == "impact"]
    assert impacts[0] == pytest.approx(math.sqrt(0.08), abs=max(near, 1e-12))


def test_the_power_of_a_kinked_ground_jumps_and_its_work_does_not():
    """A spring stands on it: the rate of `work` has its slope, y' but that has not."""
    x = np.array([0.0, 0.4, 0.5, 1.3, 2.0])
    y = np.array([0.0, 0.3, -0.2, 0.1, 0.0])
    points = np.stack([x, y], axis=1).tolist()
    text = f"""
coordinates: {{z: {{}}}}
tables: {{road: {{points: {points}, outside: repeat}}}}
energy: {{kinetic: z_dot^2/2, potential: 30*(z - road(1.7*t))^2}}
forces: {{z: -z_dot}}
initial: {{z: 0}}
simulation: {{duration: 4}}
"""
    found = simulate(load(text))
    assert run(text).trajectory.statistics.arcs == 1
    assert found["energy"] - found["work"] == pytest.approx(0.0, abs=1e-10)
    times = np.sort(np.add.outer(2.0 * np.arange(4), x[:-1]).ravel() / 1.7)
    times = [*times[times < 4.0], 4.0]
    assert [e.time for e in found.events] == pytest.approx(times[1:-1], abs=1e-14)
    state = [0.0, 0.0]
    for low, high in itertools.pairwise(times):
        slope = np.interp([low, high], x / 1.7, y, period=2.0 / 1.7)

        def rates(t, q, low=low, high=high, ends=slope):
            road = ends[0] + (t - low) / (high - low) * (ends[1] - ends[0])
            return [q[1], -60.0 * (q[0] - road) - q[1]]

        state = solve_ivp(
            rates, (low, high), state, "DOP853", rtol=1e-12, atol=1e-14
        ).y[:, -1]
    assert [found["z"][-1], found["z_dot"][-1]] == pytest.approx(state, abs=1e-9)


def test_points_that_tables_share_are_one_event():
    text = f"coordinates: {{x: {{}}}}\n{FREE}initial: {{x: 0}}\n"
    text += "tables: {f: {points: [[0, 0], [1, 1], [3, 0]]}, "
    text += "g: {points: [[0, 0], [1, 2], [2, 1], [3, 0]]}}\n"
    text += "forces: {x: f(t) + g(t) + g(3 - t)}\nsimulation: {duration: 3}"
    found = simulate(load(text))
    assert [e.time for e in found.events] == pytest.approx([1.0, 2.0], abs=1e-14)
    x, y = [0.0, 1.0, 2.0, 3.0], [0.0, 3.0, 1.5, 0.0]
    expected = np.interp(found.t, x, y) + np.interp(3 - found.t, x, [0, 2, 1, 0])
    assert found["x_ddot"] == pytest.approx(expected, abs=1e-13)


def test_knots_follow_a_mode_that_an_event_sets():
    text = """
modes: {pace: 1}
events: {faster: {every: 0.75, set: {pace: 2*pace}}}
coordinates: {x: {}}
tables: {f: {points: [[0, 0], [1, 1], [2, -1], [3, 5], [4, 0]], outside: repeat}}
energy: {kinetic: x_dot^2/2, potential: 0}
forces: {x: f(pace*t)}
initial: {x: 0}
simulation: {duration: 2, output_step: 0.01}
"""
    found = simulate(load(text))
    pace = 2.0 ** np.floor(found.t / 0.75 + 1.0)
    inside = np.abs(found.t / 0.75 - np.round(found.t / 0.75)) > 1e-6
    x, y = [0.0, 1.0, 2.0, 3.0, 4.0], [0.0, 1.0, -1.0, 5.0, 0.0]
    expected = np.interp(pace * found.t, x, y, period=4.0)
    assert found["x_ddot"][inside] == pytest.approx(expected[inside], abs=1e-13)
    # The second pace begins at the knot 4*0.75, and the third at the knot 8*1.5.
    times = [e.time for e in found.events if e.kind == "switch"]
    assert times == pytest.approx([0.5, 1.0, 1.25, 1.625, 1.75, 1.875], abs=1e-13)


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
    points = np.stack([place, height], axis=1).tolist()
    text = f"""
coordinates: {{x: {{}}, z: {{}}}}
tables: {{ground: {{points: {points}, outside: extend}}}}
energy: {{kinetic: (x_dot^2 + z_dot^2)/2, potential: {w}^2*z^2/2}}
forces: {{z: {w}^2*ground(x)}}
initial: {{x: 0, z: 0, x_dot: 2}}
simulation: {{duration: 5, output_step: 0.01}}
"""
    options = {} if method(name).ADAPTIVE else {"step": 0.001}
    found = run(text, method=name, **options)
    assert found.trajectory.statistics.arcs == 1
    times = [e.time for e in found.trajectory.events]
    assert times == pytest.approx(place[1:-1] / 2.0, abs=1e-10)
    found = simulate(load(text), method=name, **options)
    near = 1e-9 if method(name).ADAPTIVE else 1e-5
    exact = over_a_ground(place, height, 2.0, w)
    assert [found["z"][-1], found["z_dot"][-1]] == pytest.approx(exact, abs=near)
    force = w**2 * (np.interp(found["x"], place, height) - found["z"])
    assert found["z_ddot"] == pytest.approx(force, abs=1e-9)


def test_a_force_that_jumps_at_points_is_passed_by_the_rate_they_are_met_at():
    """A potential has steps in its slope: the energy stays, and no point is decided."""
    rng = np.random.default_rng(9)
    x = np.linspace(0.0, 10.0, 501)
    y = 0.05 * rng.normal(size=501)
    y[-1] = y[0]
    points = np.stack([x, y], axis=1).tolist()
    text = f"""
coordinates: {{x: {{}}, z: {{}}}}
tables: {{ground: {{points: {points}, outside: repeat}}}}
energy: {{kinetic: (x_dot^2 + z_dot^2)/2, potential: 2*(z - ground(x))^2}}
initial: {{x: 0.01, z: 0, x_dot: 3}}
simulation: {{duration: 5, output_step: 0.05}}
"""
    found = run(text)
    assert found.trajectory.statistics.arcs == 1
    energy = simulate(load(text))["energy"]
    assert energy == pytest.approx(energy[0], abs=1e-9)
    assert len(found.trajectory.events) == math.floor(found["x"][-1] / 0.02)


@pytest.mark.parametrize("name", ["dop853", "radau"])
def test_a_kink_is_passed_in_both_directions_as_often_as_it_is_met(name):
    quarter_period, first = quarter()
    text = SPRING.replace("duration: 8", "duration: 80")
    found = run(text, method=name)
    assert found.trajectory.statistics.arcs == 1
    half = 2.0 * quarter_period
    turns = half * np.arange(100)
    times = np.stack([turns + first, turns + half - first], axis=1).ravel()
    times = times[times < 80.0]
    found = [e.time for e in found.trajectory.events]
    assert found == pytest.approx(times, abs=1e-7)


def test_a_kink_that_is_touched_or_rested_on_is_none():
    text = """
coordinates: {x: {}, y: {}}
tables: {f: {points: [[-1, -1], [1, 1], [2, 9]], outside: extend},
  g: {points: [[-1, -3], [0, 0], [1, 7]], outside: extend}}
energy: {kinetic: (x_dot^2 + y_dot^2)/2, potential: 0}
forces: {x: -f(x), y: -g(y)}
initial: {x: 1, y: 0}
simulation: {duration: 30, output_step: 0.1}
"""
    for name in ("dop853", "radau", "taylor"):
        found = simulate(load(text), method=name)
        assert found.complete
        assert found["x"] == pytest.approx(np.cos(found.t), abs=1e-8)
        assert not found["y"].any()


@pytest.mark.parametrize("how", ["linear", "cubic"])
def test_a_run_ends_with_its_table(how):
    text = f"coordinates: {{x: {{}}}}\n{FREE}initial: {{x: 0, x_dot: 1}}\n"
    text += (
        f"tables: {{f: {{points: [[-1, 1], [0, 1], [2, 1]], interpolation: {how}}}}}\n"
    )
    found = simulate(load(text + "forces: {x: f(x)}\nsimulation: {duration: 9}"))
    end = math.sqrt(5.0) - 1.0  # t + t^2/2 = 2
    assert not found.complete
    assert found.record["failure"]["code"] == "table-ends"
    assert "`f` ends at 2, which `x` has reached" in found.record["reason"]
    reached = float(re.search(r"at t = ([0-9.]+)", found.record["reason"])[1])
    assert reached == pytest.approx(end, abs=1e-12)
    assert np.isfinite(found["x_ddot"]).all()
    assert found.t[-1] == pytest.approx(end, abs=9e-3)
    found = simulate(load(text + "forces: {x: f(2*t)}\nsimulation: {duration: 9}"))
    assert found.t[-1] == pytest.approx(1.0, abs=9e-3)
    text += "forces: {x: f(t)}\nsimulation: {duration: 2}"
    ends = simulate(load(text), error_bar="auto")
    assert ends.complete
    assert ends.error.relative < 1e-12


def test_many_points_cost_no_steps():
    few = SPRING.replace("-9], [-1, -1], [1, 1], [3", "-9], [3")
    x = np.linspace(-3.0, 3.0, 20_001)
    many = "[" + ", ".join(f"[{a!r}, {3.0 * a!r}]" for a in x.tolist()) + "]"
    still = few.replace("initial: {x: 2}", "initial: {x: 1e-6}")
    found = [
        simulate(
            load(re.sub(r"\[\[.*\]\]", points, still)),
            method="dop853",
            error_bar="never",
        )
        for points in ("[[-3, -9], [0, 0], [3, 9]]", many)
    ]
    assert found[0].record["steps"] == found[1].record["steps"]
    assert found[0]["x"] == pytest.approx(found[1]["x"], abs=1e-13)


def test_a_table_beside_everything_else():
    """Starts, events, contact, friction, `until`, sweeps and other values."""
    text = """
parameters: {k: 1, d: bump(0.25)}
coordinates: {x: {}, y: {}}
tables:
  bump: {points: [[0, 0], [0.5, 1], [1, 0]], outside: repeat}
  wind: {points: [[0, 0], [1, 1], [2, 0]], outside: hold, interpolation: monotone}
energy: {kinetic: (x_dot^2 + y_dot^2)/2, potential: 9.81*y}
constraints: {floor: {relation: y >= 0, restitution: 0.5, friction: 0.1, slip: x_dot}}
forces: {x: k*wind(t) + if(bump(t) > d, 1, 0)}
initial: {x: bump(0.5) - 1, y: 2*bump(0.5)}
simulation: {duration: 3, until: x >= 1.2*bump(0.5)}
"""
    model = load(text)
    found = simulate(model)
    assert found.record["parameters"]["d"] == 0.5
    assert found["x"][0] == 0.0
    assert found["y"][0] == 2.0
    kinds = {e.kind for e in found.events}
    assert {"switch", "impact", "until"} <= kinds
    falls = [e.time for e in found.events if e.kind == "impact"]
    assert falls[0] == pytest.approx(math.sqrt(4.0 / 9.81), abs=1e-12)
    switches = [e.time for e in found.events if e.kind == "switch"]
    assert {0.25, 0.75, 1.25} <= {round(t, 12) for t in switches}
    ledger = found["energy"] - found["work"]
    assert ledger == pytest.approx(ledger[0], abs=1e-9)
    swept = sweep(model, {"k": [0.5, 1.0]})
    assert swept["x.end"][1] == pytest.approx(found["x"][-1], abs=1e-12)
    other = simulate(model.bind(k=0.5))
    assert swept["x.end"][0] == pytest.approx(other["x"][-1], abs=1e-12)


def test_accelerations_derivations_and_the_module_know_tables():
    model = load(
        SPRING.replace("-scale*spring(x)", "-scale*spring(x) + V(t, x)").replace(
            "tables: {",
            "tables: {V: {points: [[0, -9, 0], [0, 9, 1], [9, -9, 3], [9, 9, 7]]}, ",
        )
    )
    found = derive(model)
    text = found.text
    assert "spring(x)" in text
    assert "V(t, x)" in text
    assert r"\mathrm{spring}\left(x\right)" in found.latex
    names_of = {}
    exec(found.python, names_of)
    for t, x in ((0.5, 0.3), (3.0, 2.9), (8.0, -7.0)):
        found = names_of["force"](t, [x], [0.0])
        V = (9 - t) * (9 + x) / 162 + t * (3 * (9 - x) + 7 * (9 + x)) / 162
        expected = V - np.interp(x, [-3, -1, 1, 3], [-9, -1, 1, 9]) - 4 * min(x + 3, 0)
        assert found == pytest.approx([expected], abs=1e-12)
        assert model.rhs(t, [x], [0.0]) == pytest.approx([expected], abs=1e-12)


def test_the_shipped_car_is_that_of_scipy():
    found = simulate(str(MODELS / "car-on-a-road.yaml"))
    data = np.loadtxt(MODELS / "road.csv", delimiter=",", skiprows=1).T
    road = CubicSpline(*data)
    m = np.array([420.0, 1100.0, 53.0, 76.0])
    front, rear = np.array([1, 1.4, -1, 0]), np.array([1, -1.47, 0, -1])
    K = (
        1e4 * np.outer(front, front)
        + 1.3e4 * np.outer(rear, rear)
        + np.diag([0, 0, 2e5, 2e5])
    )
    C = 1e3 * (np.outer(front, front) + np.outer(rear, rear))

    def rates(t, z):
        h = road([20 * t + 2.87, 20 * t])
        return [*z[4:], *((2e5 * np.array([0, 0, *h]) - K @ z[:4] - C @ z[4:]) / m)]

    exact = solve_ivp(
        rates,
        (0, 4),
        np.zeros(8),
        "DOP853",
        t_eval=[2, 4],
        rtol=1e-12,
        atol=1e-14,
        max_step=0.02,
    )
    ends = [[found[name][k] for k in (400, 800)] for name in ("z", "pitch", "z1", "z2")]
    assert np.array(ends) == pytest.approx(exact.y[:4], abs=1e-10)
    assert found.record["model"]["tables"]["road"]["file"] == "road.csv"
    assert check(str(MODELS / "car-on-a-road.yaml")).admissible


def test_members_of_families_call_tables():
    text = """
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
    found = simulate(load(text))
    assert found["x.1"] == pytest.approx(np.cos(found.t), abs=1e-9)
    assert found["x.2"] == pytest.approx(4.0 * np.cos(2.0 * found.t), abs=1e-9)
    for old, new, code in (
        ("pull(x(3 - i), 0*i)", "pull(x(1))", "expression-arity"),
        ("stiff(i)}\nsim", "stif(i)}\nsim", "expression-unknown-function"),
    ):
        with pytest.raises(InputError) as fault:
            load(text.replace(old, new))
        assert {p.code for p in fault.value.problems} == {code}


@pytest.mark.parametrize("every", [0.4, 0.5])
def test_an_event_at_the_end_of_a_run_where_a_table_ends(every):
    text = f"""
coordinates: {{x: {{}}}}
tables: {{f: {{points: [[0, 0], [1, 1], [2, 0]], interpolation: linear}}}}
modes: {{k: 0}}
events: {{tick: {{every: {every}, set: {{k: k + 1}}}}}}
energy: {{kinetic: x_dot^2/2, potential: 0}}
forces: {{x: f(t)}}
initial: {{x: 0}}
definitions: {{ticks: k}}
simulation: {{duration: 2}}
"""
    found = simulate(text)
    assert found.outcome == "done"
    assert found["x"][-1] == pytest.approx(1.0, abs=1e-12)
    assert found["ticks"][-1] == round(2.0 / every) + 1
