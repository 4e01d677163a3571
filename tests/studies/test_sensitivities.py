"""Sensitivities against closed forms, impacts and variational equations."""

import math

import mpmath
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import lagsim
from lagsim.model.reader import read
from lagsim.studies.sensitivities import Sensitivities
from lagsim.studies.trials import Trials
from tests.small_scenes import ball
from tests.support import MODELS, refused

OSCILLATOR = """
parameters: {k: 4, z: 0}
coordinates: {x: {}}
energy: {kinetic: x_dot^2/2, potential: k*x^2/2 + z*x}
initial: {x: 1}
simulation: {duration: 10}
"""
BALL = ball("duration: 3")
ELASTIC = """
parameters: {m: 1, l: 1, K: 40, g: 9.81}
coordinates: {r: {}, theta: {}}
energy:
  kinetic: m*(r_dot^2 + (l + r)^2*theta_dot^2)/2
  potential: K*r^2/2 - m*g*(l + r)*cos(theta)
initial: {r: 0.3, theta: 0.6}
simulation: {duration: 10}
"""
ROD = """
parameters: {l: 1, g: 9.81}
coordinates: {x: {}, y: {}}
energy: {kinetic: (x_dot^2 + y_dot^2)/2, potential: g*y}
constraints: {length: sqrt(x^2 + y^2) = l}
initial: {x: 0.6, y: -0.8}
simulation: {duration: 3}
"""
ANGLE = """
parameters: {l: 1, g: 9.81, x0: 0.6}
coordinates: {a: {}}
energy: {kinetic: l^2*a_dot^2/2, potential: -g*l*cos(a)}
initial: {a: asin(x0/l)}
definitions: {x: l*sin(a)}
simulation: {duration: 3}
"""


def study(text, times, columns=None, **more):
    return Sensitivities(read(text, "<model>"), times=times, columns=columns, **more)


def worst(found, exact):
    """Return the largest error over rows, relative to the largest value."""
    kept = ~found.lost
    apart = found.values[kept, 0] - exact[kept]
    return np.max(np.abs(apart)) / np.max(np.abs(exact[kept]))


def honest(found, error):
    """Whether an error is within 30 times of the reported one, or rounding."""
    return error <= 30.0 * found.error


@pytest.mark.parametrize(
    ("name", "exact"),
    [
        ("k", lambda t: -np.sin(2 * t) * t / 4),
        ("x", lambda t: np.cos(2 * t)),
        ("x_dot", lambda t: np.sin(2 * t) / 2),
        ("z", lambda t: (np.cos(2 * t) - 1) / 4),
    ],
)
@pytest.mark.parametrize("method", ["auto", "radau", "dop853"])
def test_an_oscillator_has_its_closed_form(name, exact, method):
    times = np.linspace(0.0, 10.0, 51)
    found = study(OSCILLATOR, times, ("x",), options={"method": method}).by(name)
    error = worst(found, exact(times))
    assert not found.lost.any()
    assert error < 1e-9  # asked for by the contract
    assert honest(found, error)


def height(t, e, g, h):
    """Height of a ball at time t, dropped from the height h."""
    hit = mpmath.sqrt(2 * h / g)
    if t < hit:
        return h - g * t * t / 2
    speed = e * mpmath.sqrt(2 * g * h)
    while t > hit + 2 * speed / g:
        hit, speed = hit + 2 * speed / g, speed * e
    return speed * (t - hit) - g * (t - hit) ** 2 / 2


def slope(times, values, k):
    """Derivative of the height by its k-th parameter, from 50 digits."""
    with mpmath.workdps(50):
        step, exact = mpmath.mpf(10) ** -20, [mpmath.mpf(x) for x in values]
        pair = [
            [x + s * step if j == k else x for j, x in enumerate(exact)]
            for s in (1, -1)
        ]
        ends = [[height(mpmath.mpf(t), *x) for t in times] for x in pair]
        return np.array(
            [float((a - b) / (2 * step)) for a, b in zip(*ends, strict=True)]
        )


@pytest.mark.slow
@pytest.mark.parametrize(("k", "name"), [(0, "e"), (1, "g"), (2, "h")])
def test_a_ball_through_ten_impacts(k, name):
    times = np.linspace(0.013, 3.0, 61)
    found = study(BALL, times, ("y",)).by(name)
    exact = slope(times.tolist(), (0.8, 9.81, 1.0), k)
    error = worst(found, exact)
    assert np.count_nonzero(found.lost) <= 2
    assert error < 1e-9
    assert honest(found, error)


@pytest.mark.slow
def test_at_the_end_of_the_domain_a_difference_is_one_sided():
    times = np.linspace(0.013, 3.0, 61)
    found = study(BALL.replace("e: 0.8", "e: 1"), times, ("y",)).by("e")
    error = worst(found, slope(times.tolist(), (1.0, 9.81, 1.0), 0))
    assert error < 1e-9
    assert honest(found, error)


@pytest.mark.slow
def test_rows_at_a_knot_of_a_table_have_their_derivatives():
    """x_ddot = F(s t): by s, x_ddot alone has a jump where s t = 1 and 3."""
    text = """
parameters: {s: 1}
coordinates: {x: {}}
tables: {F: {interpolation: linear, outside: hold, points: [[0, 0], [1, 1], [3, 0]]}}
energy: {kinetic: x_dot^2/2, potential: 0}
forces: {x: F(s*t)}
initial: {x: 0, x_dot: 0}
simulation: {duration: 4}
"""
    times = np.linspace(0.0, 4.0, 41)
    found = study(text, times).by("s")
    # x_dot = G(s t)/s and x = H(s t)/s^2, with H'' = G' = F.
    up, down, after = (np.clip(times - a, 0, b) for a, b in ((0, 1), (1, 2), (3, 9)))
    F = np.interp(times, [0, 1, 3], [0, 1, 0])
    G = up**2 / 2 + down - down**2 / 4
    H = up**3 / 6 + down / 2 + down**2 / 2 - down**3 / 12 + 1.5 * after
    exact = np.array([G * times - 2 * H, F * times - G]).T
    assert not found.lost.any()
    error = np.max(np.abs(found.values - exact) / np.max(np.abs(exact), axis=0))
    assert error < 1e-5  # half of the small step, 1e-3 of s divided by 81
    assert honest(found, error)


def test_an_event_that_never_acts_takes_no_rows():
    """At rates of 0.1 % more it would act."""
    text = """
parameters: {v: 1}
coordinates: {x: {}}
modes: {a: 0}
energy: {kinetic: x_dot^2/2, potential: x^2/2}
forces: {x: a}
events: {push: {at: x_dot <= -1.001, set: {a: 1}}}
initial: {x: 0, x_dot: v}
simulation: {duration: 6}
"""
    times = np.linspace(0.0, 6.0, 61)
    found = study(text, times, ("x",)).by("v")
    assert not found.lost.any()
    error = worst(found, np.sin(times))
    assert error < 1e-8
    assert honest(found, error)


@pytest.mark.slow
def test_a_row_between_the_impacts_of_two_runs_is_not_differentiable():
    times = np.array([0.2, math.sqrt(2 / 9.81), 0.6])
    found = study(BALL, times, ("y_dot",)).by("h")
    assert found.lost.tolist() == [False, True, False]
    assert np.isnan(found.values[1]).all()


@pytest.mark.slow
@pytest.mark.parametrize(
    "names", [("x", "x0"), pytest.param(("g", "g"), marks=pytest.mark.slow)]
)
def test_start_values_that_constraints_determine_follow(names):
    times = np.linspace(0.0, 3.0, 13)
    held, free = (
        study(text, times, ("x",)).by(name)
        for text, name in zip((ROD, ANGLE), names, strict=True)
    )
    # Two formulations of one motion; each has an error of at most 1e-12 of its range.
    assert held.values == pytest.approx(free.values, abs=1e-11, rel=1e-10)


@pytest.mark.slow
def test_a_length_carries_the_start_with_it():
    """The rod of another length begins at the nearest start: along the rod."""
    times = np.linspace(0.0, 3.0, 13)
    found = study(ROD, times, ("x", "y")).by("l")
    assert found.values[0] == pytest.approx([0.6, -0.8], abs=1e-10)


@pytest.mark.slow
def test_a_name_that_is_not_free_is_refused():
    model = ROD.replace("length: sqrt(x^2 + y^2) = l", "length: x = 0.6")
    with refused("inadmissible", "`x`"):
        study(model, np.array([0.0, 1.0])).by("x")
    with refused("unknown-name", "`nobody`"):
        study(model, np.array([0.0, 1.0])).by("nobody")


@pytest.mark.slow
def test_variational_equations_of_a_chaotic_pendulum():
    K, g, times = 40.0, 9.81, np.linspace(0.0, 10.0, 41)

    def rates(_t, y):
        r, a, v, w, dr, da, dv, dw = y
        x = 1.0 + r
        rr, aa = x * w * w - K * r + g * math.cos(a), -(2 * v * w + g * math.sin(a)) / x
        drr = dr * (w * w - K) + 2 * x * w * dw - g * math.sin(a) * da
        daa = -(2 * dv * w + 2 * v * dw + g * math.cos(a) * da) / x - aa / x * dr
        return [v, w, rr, aa, dv, dw, drr, daa]

    begun = [0.3, 0.6, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0]
    exact = solve_ivp(
        rates, (0.0, 10.0), begun, "DOP853", times, rtol=1e-13, atol=1e-15
    ).y
    found = study(ELASTIC, times, ("r", "theta")).by("theta")
    # The referee itself has errors of about 1e-10 after its growth by 1e3.
    apart = np.abs(found.values.T - exact[4:6])
    assert np.max(apart) < 1e-9 * np.max(np.abs(exact[4:6]))


def test_a_name_costs_eight_runs_where_the_first_step_serves():
    found = [*study(OSCILLATOR, np.linspace(0, 1, 3)).by_each(["k", "x", "z", "x_dot"])]
    assert [x.runs for x in found] == [8, 8, 8, 8]


@pytest.mark.slow
def test_five_names_cost_seventy_runs_at_most():
    times = np.linspace(0.0, 10.0, 11)
    found = [*study(ELASTIC, times).by_each(["K", "theta", "r", "m", "g"])]
    assert 40 < sum(x.runs for x in found) < 70


@pytest.mark.slow
def test_names_share_further_runs_by_their_errors():
    """Five names need further steps: 70 runs in all, in any order of the names."""
    model = read((MODELS / "elastic-pendulum.yaml").read_text(), "<model>")
    names, found = ["l", "g", "K", "theta", "u"], []
    for order in (names, names[::-1]):
        study = Sensitivities(model, times=np.linspace(0.0, 36.0, 19))
        each = {x.name: x for x in study.by_each(order)}
        assert [*each] == order
        found.append({name: (each[name].runs, each[name].error) for name in names})
    assert found[0] == found[1]
    runs, errors = zip(*found[0].values(), strict=True)
    # Each has one further step, of six runs, but for one name: 1 + 5*8 + 4*6 runs.
    assert sorted(runs) == [8, 14, 14, 14, 14]
    assert max(errors) < 10 * min(errors)


@pytest.mark.slow
def test_five_names_cost_41_runs_where_the_first_step_serves(monkeypatch):
    """The run itself, and eight for each name."""
    made = []
    run = Trials.run

    def counted(self, *args, **more):
        made.append(args)
        return run(self, *args, **more)

    monkeypatch.setattr(Trials, "run", counted)
    text = OSCILLATOR.replace("k: 4", "k: 4, m: 2").replace("x_dot^2", "m*x_dot^2")
    found = [*study(text, np.linspace(0, 1, 3)).by_each(["k", "x", "z", "x_dot", "m"])]
    assert max(x.error for x in found) < 1e-9
    assert len(made) == 41


@pytest.mark.slow
@pytest.mark.parametrize("name", [pytest.param("e", marks=pytest.mark.slow), "h"])
def test_columns_that_do_not_depend_on_a_name_lose_no_rows(name):
    """Their differences are rounding errors, of which no two orders agree."""
    text = BALL.replace("{y: {}}", "{y: {}, x: {}, z: {}}")
    text = text.replace("y_dot^2/2,", "(y_dot^2 + x_dot^2 + z_dot^2)/2,")
    text = text.replace("{y: h}", "{y: h, x: 0, x_dot: 0.3, z: 1e6, z_dot: 0.7}")
    times = np.linspace(0.0, 3.0, 61)
    alone = study(BALL, times, ("y",)).by(name)
    found = study(text, times, ("y", "x", "z")).by(name)
    assert np.count_nonzero(found.lost) <= np.count_nonzero(alone.lost) + 1
    kept = ~found.lost & ~alone.lost
    assert found.values[kept, 0] == pytest.approx(alone.values[kept, 0], rel=1e-9)
    assert found.error < 1e-9
    # Rounding of runs at 1e-13 over the step.
    sizes = np.array([0.9, 1e6 + 2.1])
    assert np.all(np.abs(found.values[kept, 1:]) <= 1e-13 * sizes / found.step)


# Standard deviations of samples against those of first order

DAMPED = """
parameters:
  k: {value: 4, uncertainty: 0.02}
  c: {value: 0.2, uncertainty: 0.005}
  w: {value: 1.5}
coordinates: {x: {}}
definitions: {pull: k*x}
energy: {kinetic: x_dot^2/2, potential: k*x^2/2 + x^4/4, dissipation: c*x_dot^2/2}
forces: {x: cos(w*t)}
initial: {x: 1}
simulation: {duration: 5, output_step: 0.5}
"""
UNCERTAIN_BALL = ball(
    "duration: 2, output_step: 0.5",
    e="{value: 0.8, uncertainty: 0.002}",
    h="{value: 1, uncertainty: 0.003}",
)
SLIDER = """
parameters:
  mu: {value: 0.2, uncertainty: 0.002}
  v: {value: 3, uncertainty: 0.02}
coordinates: {x: {}, y: {}}
energy: {kinetic: (x_dot^2 + y_dot^2)/2, potential: 9.81*y}
constraints: {floor: {relation: y >= 0, restitution: 0, friction: mu, slip: x_dot}}
initial: {x: 0, y: 0, x_dot: v}
simulation: {duration: 3, output_step: 0.5}
"""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("text", "columns", "count"),
    [
        (DAMPED, ("x", "x_dot", "pull"), 2000),
        (UNCERTAIN_BALL, ("y", "y_dot"), 500),
        (SLIDER, ("x",), 500),  # it has stopped by then
    ],
)
def test_deviations_are_those_of_a_sample(text, columns, count):
    model = read(text, "<model>")
    rows = lagsim.simulate(text)
    sample = {
        p.name: f"normal({p.value}, {p.uncertainty})"
        for p in model.parameters if p.uncertainty
    }  # fmt: skip
    swept = lagsim.sweep(text, sample=sample, N=count, seed=11, ends=True)
    assert swept["complete"].all()
    for column in columns:
        ends = swept[f"{column}.end"]
        # Four standard errors of the deviation, and of the mean, of a normal sample.
        expected = rows[f"sd.{column}"][-1]
        within = 4.0 / math.sqrt(2 * count)
        assert np.std(ends) == pytest.approx(expected, rel=within), column
        shift = np.mean(ends) - rows[column][-1]
        assert abs(shift) < 4.0 * expected / math.sqrt(count)


@pytest.mark.slow
def test_impacts_of_equal_masses_do_not_depend_on_the_mass():
    """The rounding of collisions grows from one to the next; it is no derivative."""
    model = read((MODELS / "newtons-cradle.yaml").read_text(), "<model>")
    found = Sensitivities(model, times=np.linspace(0.0, 4.0, 81)).by("m")
    assert not found.lost.any()
    assert found.runs == 8
    assert found.error < 1e-9


@pytest.mark.slow
def test_an_accumulation_amplifies_rounding_that_is_no_dependence():
    """The inertia of the block is proportional to its mass: no motion depends on m."""
    model = read((MODELS / "rocking-block.yaml").read_text(), "<model>")
    found = Sensitivities(model, times=np.arange(0.0, 10.0, 0.02)).by("m")
    kept = found.values[~found.lost]
    assert len(kept) > 0.99 * len(found.values)
    assert np.max(np.abs(kept)) < 1e-7
    assert found.error < 1e-9


@pytest.mark.parametrize("name", ["m", "r", "S", "D"])
def test_a_block_that_a_growing_force_sets_sliding(name):
    """It slides from t1 = S/r on, against less friction: m x'' = r t - D."""
    text = """
parameters: {m: 2, r: 3, S: 4, D: 2.5}
coordinates: {x: {}}
energy: {kinetic: m*x_dot^2/2, potential: 0}
forces: {x: r*t}
constraints: {rub: {relation: x_dot = 0, limit: {static: S, dynamic: D}}}
initial: {x: 0}
simulation: {duration: 4}
"""
    times = np.linspace(0.05, 4.0, 30)
    t1 = 4.0 / 3.0
    s = np.maximum(times - t1, 0.0)
    place = (3 * (t1 * s**2 / 2 + s**3 / 6) - 2.5 * s**2 / 2) / 2
    # By r and S with t1 = S/r, whose derivatives are -t1/r and 1/r.
    by_t1 = (-3 * t1 * s + 2.5 * s) / 2
    exact = {
        "m": -place / 2,
        "r": (t1 * s**2 / 2 + s**3 / 6) / 2 - by_t1 * t1 / 3,
        "S": by_t1 / 3,
        "D": -(s**2) / 4,
    }
    found = study(text, times, ("x",)).by(name)
    assert not found.lost.any()
    assert worst(found, exact[name]) < 1e-9
