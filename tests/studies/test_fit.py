"""Fits against closed forms: values, standard errors, intervals, identifiability."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from scipy.optimize import least_squares
from scipy.special import stdtrit

from lagsim.errors import InputError
from lagsim.model.reader import read
from lagsim.run.interrupt import Interrupt
from lagsim.studies.fit.data import record_of
from lagsim.studies.fit.fitting import INTERRUPTED, Fit
from lagsim.studies.fit.names import parse_names
from lagsim.studies.fit.report import document_of, tables, with_values
from lagsim.studies.fit.restarts import has_pattern
from tests.studies.test_sensitivities import BALL, ROD
from tests.support import refused

OSCILLATOR = """
parameters: {m: 1, k: 9, c: 0.2}
coordinates: {x: {unit: m}}
energy: {kinetic: m*x_dot^2/2, potential: k*x^2/2}
forces: {x: -c*x_dot}
initial: {x: 1}  # released
simulation: {duration: 10}
"""
# Relative accuracy of values from data without noise, as the contract states it.
EXACT = 1e-7
TIMES = np.linspace(0.1, 5, 60)


def damped(t, k, c, x0, v0=0.0):
    """Return the motion of the oscillator of mass 1."""
    half = c / 2
    w = math.sqrt(k - half**2)
    rest = (v0 + half * x0) / w
    return np.exp(-half * t) * (x0 * np.cos(w * t) + rest * np.sin(w * t))


def fitted(text, data, vary, match=None, starts=0, **more):
    """Return the fit, and its document."""
    tables = data if isinstance(data, list) else [data]
    records = [record_of(f"data {k}", x) for k, x in enumerate(tables, 1)]
    fit = Fit(read(text, "<model>"), records, vary, match, **more)
    return fit, document_of(fit, fit.found(starts))


def values(document):
    return {name: x["value"] for name, x in document["parameters"].items()}


def close(document, exact):
    assert values(document) == pytest.approx(exact, rel=EXACT)
    assert document["outcome"] == "converged"
    assert document["identifiable"] is True


@pytest.mark.slow
def test_values_of_an_oscillator():
    data = {"t": TIMES, "x": damped(TIMES, 10, 0.3, 1.2)}
    _, found = fitted(OSCILLATOR, data, ["k", "c", "x"])
    close(found, {"k": 10, "c": 0.3, "x": 1.2})
    assert found["degrees_of_freedom"] == 57


@pytest.mark.slow
def test_a_quantity_in_other_units_and_a_clock_that_is_late():
    late = 0.25
    data = {"t": TIMES + late, "mm": 1e3 * damped(TIMES, 10, 0.3, 1.2)}
    vary = ["k", "c", "x", "t0=0:1"]
    _, found = fitted(OSCILLATOR, data, vary, {"mm": "1000*x"})
    close(found, {"k": 10, "c": 0.3, "x": 1.2, "t0": late})


@pytest.mark.slow
def test_files_with_starts_of_their_own():
    other = TIMES[::3] + 0.05
    data = [
        {"t": TIMES, "x": damped(TIMES, 10, 0.3, 1.2)},
        {"t": other, "x": damped(other, 10, 0.3, -0.5, 2.0)},
        {"t": other, "x": damped(other, 10, 0.3, 1.2)},
    ]
    vary = ["k", "c", "x", "x@2=-1:1", "x_dot@2"]
    fit, found = fitted(OSCILLATOR, data, vary)
    close(found, {"k": 10, "c": 0.3, "x": 1.2, "x@2": -0.5, "x_dot@2": 2.0})
    rows = tables(fit, fit.found())["fit.csv"].decode().split()
    assert len(rows) == 1 + 60 + 20 + 20
    assert rows[0] == "data,t,x,x.model,x.residual"


@pytest.mark.slow
def test_gaps_are_left_out():
    x = damped(TIMES, 10, 0.3, 1.2)
    x[::4] = np.nan
    speed = np.where(np.arange(60) % 7 == 0, 0.0, np.nan)  # never 0: of no weight
    data = {"t": TIMES, "x": x, "other": speed}
    fit, found = fitted(OSCILLATOR, data, ["k", "c", "x"])
    close(found, {"k": 10, "c": 0.3, "x": 1.2})
    assert found["degrees_of_freedom"] == 45 - 3
    assert fit.unused(fit.records[0]) == ["other"]


@pytest.mark.slow
def test_values_that_one_file_has_of_its_own():
    # The second record is of another mass, a known start, and a clock that is late.
    other = TIMES[::3]
    data = [
        {"t": TIMES, "x": damped(TIMES, 10, 0.3, 1.2)},
        {"t": other + 0.5, "x": damped(other, 5, 0.15, -0.5, 2.0)},
        {"t": other, "x": damped(other, 10, 0.3, 0.7)},
    ]
    own = {"m@2": "2", "x@2": "-1/2", "t0@2": "0.5", "x_dot@2": "1.5", "x@3": "0.5"}
    vary = ["k", "c", "x", "x_dot@2", "x@3"]
    fit, found = fitted(OSCILLATOR, data, vary, own=own)
    close(found, {"k": 10, "c": 0.3, "x": 1.2, "x_dot@2": 2, "x@3": 0.7})
    starts = [one["start"] for one in found["parameters"].values()]
    assert starts == [9, 0.2, 1, 1.5, 0.5]
    assert fit.of_file(fit.found()) == pytest.approx({"k": 10, "c": 0.3, "x": 1.2})


@pytest.mark.parametrize(
    ("own", "code", "name"),
    [
        ({"x@3": "1"}, "usage", "x@3"),
        ({"x@": "1"}, "usage", "x@"),
        ({"z@1": "1"}, "unknown-name", "`z`"),
        ({"x@1": "1+"}, "expression-syntax", ""),
        ({"t0@1": "soon"}, "usage", "soon"),
        ({"k@1": "1", "k@2": "2"}, "usage", " k:"),
        ({"t0@2": "6"}, "bad-data", "data 2"),
    ],
)
def test_values_of_one_file_that_cannot_be_used(own, code, name):
    data = {"t": TIMES, "x": damped(TIMES, 10, 0.3, 1.2)}
    with refused(code, name, kind=InputError):
        fitted(OSCILLATOR, [data, data], ["k"], own=own)


@pytest.mark.slow
def test_several_processes_find_the_same_values():
    data = [{"t": TIMES, "x": damped(TIMES, 10, 0.3, x0)} for x0 in (1.2, 0.8)]
    vary = ["k", "c", "x@1", "x@2"]
    _, alone = fitted(OSCILLATOR, data, vary, jobs=1)
    _, shared = fitted(OSCILLATOR, data, vary, jobs=2)
    assert shared == alone


def bounces(t, e, g, h):
    """Return the height of a ball, and the times of its first ten impacts."""
    begin, speed, y = math.sqrt(2 * h / g), math.sqrt(2 * g * h), h - g * t**2 / 2
    impacts = []
    for _ in range(10):
        impacts.append(begin)
        speed *= e
        s = t - begin
        y = np.where(s >= 0, speed * s - g * s**2 / 2, y)
        begin += 2 * speed / g
    return y, impacts


@pytest.mark.slow
def test_a_restitution_from_heights():
    t = np.linspace(0.013, 2.6, 60)
    y, _ = bounces(t, 0.72, 9.81, 1.1)
    _, found = fitted(BALL, {"t": t, "y": y}, ["e=0:1", "h"])
    close(found, {"e": 0.72, "h": 1.1})


PUCK = """
parameters: {m: 0.3, mu: 0.2, e: 0.5, g: 9.81, wall: 2}
coordinates: {x: {}}
energy: {kinetic: m*x_dot^2/2, potential: 0}
constraints:
  floor: {relation: x_dot = 0, limit: mu*m*g}
  side: {relation: x <= wall, restitution: e}
initial: {x: 0, x_dot: 4}
simulation: {duration: 4}
"""


@pytest.mark.slow
@pytest.mark.parametrize("unit", [1, 1000])
def test_friction_of_a_puck_that_strikes_a_wall_and_comes_to_rest(unit):
    # In m, or mm; measured at the impact itself, too.
    mu, e, v = 0.15, 0.7, 3.5
    a = mu * 9.81
    fast = math.sqrt(v**2 - 4 * a)
    struck = (v - fast) / a
    t = np.sort([struck, *np.linspace(0.05, 3, 44)])
    s = np.clip(t - struck, 0, e * fast / a)
    x = np.where(t < struck, v * t - a * t**2 / 2, 2 - (e * fast * s - a * s**2 / 2))
    text = PUCK.replace("g: 9.81, wall: 2", f"g: {9.81 * unit}, wall: {2 * unit}")
    text = text.replace("x_dot: 4", f"x_dot: {4 * unit}")
    _, found = fitted(text, {"t": t, "x": x * unit}, ["mu=0:1", "e=0:1", "x_dot"])
    close(found, {"mu": mu, "e": e, "x_dot": v * unit})


CHAIN = """
parameters: {n: 3, k(1..n): 5, c: 0.1}
coordinates: {q(1..n): {}}
definitions: {d(0): 0, d(i=1..n): q(i)}
energy:
  kinetic: sum(i=1..n, q_dot(i)^2/2)
  potential: "sum(i=1..n, k(i)*(d(i) - d(i-1))^2/2)"
  dissipation: sum(i=1..n, c*q_dot(i)^2/2)
initial: {q(1..n): [0, 0, 1]}
simulation: {duration: 6}
"""


@pytest.mark.slow
def test_members_of_families_are_columns_and_names():
    # Columns are named as those of a run; the motion is that of expm.
    k, t = np.array([6, 4, 5.5]), np.linspace(0.1, 6, 40)
    K = np.diag(k) + np.diag([*k[1:], 0]) - np.diag(k[1:], 1) - np.diag(k[1:], -1)
    A = np.block([[np.zeros((3, 3)), np.eye(3)], [-K, -0.1 * np.eye(3)]])
    rows = np.array([expm(A * s) @ [0, 0, 1.2, 0, 0, 0] for s in t])
    data = {"t": t, "q.1": rows[:, 0], "q_dot.3": rows[:, 5], "end": rows[:, 2]}
    vary = ["k.1", "k.2", "k.3", "q.3"]
    fit, found = fitted(CHAIN, data, vary, {"end": "q.3"})
    close(found, {"k.1": 6, "k.2": 4, "k.3": 5.5, "q.3": 1.2})
    assert found["match"] == {"q.1": "q.1", "q_dot.3": "q_dot.3", "end": "q.3"}
    text = with_values(fit, fit.found(), {})
    assert read(text, "<m>").parameter_values["k.2"] == pytest.approx(4, rel=EXACT)


@pytest.mark.slow
def test_an_orbit_in_kilometres_and_seconds():
    year, au, t = 365.25 * 86400, 1.495978707e8, np.linspace(0.05, 2, 50)
    mass, speed = 4 * math.pi**2 * au**3 / year**2, 2 * math.pi * au / year
    text = f"""
parameters: {{GM: {0.96 * mass}}}
coordinates: {{x: {{}}, y: {{}}}}
energy: {{kinetic: (x_dot^2 + y_dot^2)/2, potential: -GM/hypot(x, y)}}
initial: {{x: {au}, y: 0, y_dot: {1.03 * speed}}}
simulation: {{duration: {3 * year}}}
"""
    x, y = au * np.cos(2 * math.pi * t), au * np.sin(2 * math.pi * t)
    _, found = fitted(text, {"t": t * year, "x": x, "y": y}, ["GM", "y_dot"])
    close(found, {"GM": mass, "y_dot": speed})


@pytest.mark.slow
def test_a_start_value_that_others_follow():
    # A pendulum at rest at x, and y by the rod: the data are those of the angle.
    angle = read(ROD, "<model>").bind(x=0.5, y=-math.sqrt(0.75))
    fit = Fit(angle, [record_of("d", {"t": [0.0], "x": [0.5]})], ["g"])
    t = np.linspace(0, 2, 30)
    _, rows = fit.curve(np.array([9.81]), 0, 1)
    assert rows[0, 0] == 0.5
    run = Fit(angle, [record_of("d", {"t": t, "x": t, "y": t})], ["g"])
    _, rows = run.curve(np.array([9.81]), 0, 30)
    data = {"t": t, "x": rows[:, 0], "y": rows[:, 1]}
    fit, found = fitted(ROD, data, ["g", "x"])
    assert {*fit.setup.guesses} == {"y", "x_dot", "y_dot"}
    close(found, {"g": 9.81, "x": 0.5})


@pytest.mark.slow
@pytest.mark.parametrize("deviation", [0.0, 0.02])
def test_standard_errors_of_a_linear_model(deviation):
    # The start enters x as a(t) x(0) + b(t) x'(0).
    noise = np.random.default_rng(5).normal(0, 0.02, len(TIMES))
    data = {"t": TIMES, "x": damped(TIMES, 9, 0.2, 1.2) + noise}
    match = {"x": f"x:{deviation}"} if deviation else None
    _, found = fitted(OSCILLATOR, data, ["x", "x_dot"], match)
    A = np.column_stack([damped(TIMES, 9, 0.2, 1), damped(TIMES, 9, 0.2, 0, 1)])
    best, *_ = np.linalg.lstsq(A, data["x"])
    left = data["x"] - A @ best
    free = len(TIMES) - 2
    size = deviation or math.sqrt(left @ left / free)
    cov = size**2 * np.linalg.inv(A.T @ A)
    wide = 1.959963984540054 if deviation else stdtrit(free, 0.975)
    for k, name in enumerate(("x", "x_dot")):
        one, error = found["parameters"][name], math.sqrt(cov[k, k])
        assert one["value"] == pytest.approx(best[k], abs=1e-7 * error)
        # Derivatives are right to 1e-9.
        assert one["standard_error"] == pytest.approx(error, rel=1e-8)
        ends = best[k] - wide * error, best[k] + wide * error
        assert one["interval"] == pytest.approx(ends, rel=1e-8)
    apart = cov[0, 1] / math.sqrt(cov[0, 0] * cov[1, 1])
    assert found["correlation"]["x"]["x_dot"] == pytest.approx(apart, rel=1e-7)
    assert found["chi2"] == pytest.approx(left @ left / size**2, rel=1e-7)
    assert found["rms"]["x"] == pytest.approx(math.sqrt(left @ left / 60), rel=1e-9)
    assert found["noise"]["x"] == pytest.approx(size, rel=1e-8)


@pytest.mark.slow
def test_columns_count_in_their_own_noise():
    # Two columns of unequal noise: weighted linear least squares.
    random = np.random.default_rng(8)
    x = damped(TIMES, 9, 0.2, 1.2) + random.normal(0, 0.001, 60)
    big = 50 * damped(TIMES, 9, 0.2, 1.2) + random.normal(0, 2.0, 60)
    data = {"t": TIMES, "x": x, "big": big}
    _, found = fitted(OSCILLATOR, data, ["x"], {"big": "50*x"})
    assert found["noise"] == pytest.approx({"x": 0.001, "big": 2.0}, rel=0.3)
    a = damped(TIMES, 9, 0.2, 1)
    weights = 1 / found["noise"]["x"] ** 2, 1 / found["noise"]["big"] ** 2
    right = weights[0] * a @ x + weights[1] * 50 * a @ big
    both = (weights[0] + 2500 * weights[1]) * a @ a
    one = found["parameters"]["x"]
    # The weights of the last iteration are those of the noise before it.
    assert one["value"] == pytest.approx(right / both, abs=1e-2 * both**-0.5)
    assert one["standard_error"] == pytest.approx(both**-0.5, rel=1e-6)


@pytest.mark.slow
def test_a_pair_that_the_data_do_not_determine():
    data = {"t": TIMES, "x": damped(TIMES, 10, 0, 1.2)}
    text = OSCILLATOR.replace("c: 0.2", "c: 0")
    _, found = fitted(text, data, ["m", "k", "x"])
    assert found["identifiable"] is False
    [pair] = found["combinations"]
    assert pair == pytest.approx({"m": 1, "k": 1}, rel=1e-6)
    numbers = values(found)
    assert numbers["k"] / numbers["m"] == pytest.approx(10, rel=EXACT)
    assert numbers["x"] == pytest.approx(1.2, rel=EXACT)
    one = found["parameters"]
    assert one["m"]["standard_error"] is one["k"]["interval"] is None
    assert one["x"]["standard_error"] > 0
    assert found["correlation"]["m"]["k"] is None
    [caution] = [x["code"] for x in found["warnings"]]
    assert caution == "not-identifiable"


def nearest_on_a_ray(start, ratios):
    """Return the multiple of `ratios` that is nearest to `start`, in relative changes.

    start, ratios : dicts by name.
    """
    r = np.array([ratios[name] / start[name] for name in ratios])
    return {name: x * np.sum(r) / (r @ r) for name, x in ratios.items()}


@pytest.mark.slow
@pytest.mark.parametrize(
    "start", [{}, {"m": 1.5}, {"m": 0.5}, {"k": 30}, {"c": 3}, {"x": -3}]
)
@pytest.mark.parametrize("noise", [0.0, 0.02])
def test_undetermined_names_stay_nearest_to_their_start(start, noise):
    # m, k, c of a free oscillation have a common factor. Some starts lead far away
    # before the minimum is found, others to a second fit with the noise.
    random = np.random.default_rng(4).normal(0, noise, 60) if noise else 0.0
    data = {"t": TIMES, "x": damped(TIMES, 10, 0.3, 1.2) + random}
    begin = {"m": 1, "k": 9, "c": 0.2, "x": 1} | start
    sets = ", ".join(f"{name}: {x}" for name, x in begin.items() if name != "x")
    text = OSCILLATOR.replace("m: 1, k: 9, c: 0.2", sets)
    text = text.replace("x: 1}  #", f"x: {begin['x']}}}  #")
    _, found = fitted(text, data, [*begin])
    numbers = values(found)
    k, c = (numbers[name] / numbers["m"] for name in ("k", "c"))
    # The noise of 60 measurements moves k by less than 1 %, c by less than 30 %.
    assert k == pytest.approx(10, rel=1e-2 if noise else EXACT)
    assert c == pytest.approx(0.3, rel=0.3 if noise else EXACT)
    del begin["x"], numbers["x"]
    near = nearest_on_a_ray(begin, {"m": 1, "k": k, "c": c})
    assert numbers == pytest.approx(near, rel=1e-4)


@pytest.mark.slow
def test_a_product_stays_nearest_to_its_start():
    # Only the product a*b counts: of a*b = 10, the nearest to a = b = 3, whose kernel
    # turns along the hyperbola. A name of its own beside it is found.
    text = OSCILLATOR.replace("k: 9", "a: 3, b: 3").replace("k*x^2", "a*b*x^2")
    data = {"t": TIMES, "x": damped(TIMES, 10, 0.3, 1.2)}
    _, found = fitted(text, data, ["a", "b", "c", "x"])
    side = math.sqrt(10)
    exact = {"a": side, "b": side, "c": 0.3, "x": 1.2}
    assert values(found) == pytest.approx(exact, rel=1e-6)
    [pair] = found["combinations"]
    # A direction, of either sign.
    assert math.copysign(1, pair["a"]) * pair["a"] == pytest.approx(1, rel=1e-6)
    assert pair["b"] == pytest.approx(-pair["a"], rel=1e-6)


@pytest.mark.slow
def test_fewer_measurements_than_names():
    data = {"t": [1.0, 2.0], "x": damped(np.array([1.0, 2.0]), 10, 0.3, 1.2)}
    _, found = fitted(OSCILLATOR, data, ["k", "c", "x"])
    assert found["identifiable"] is False
    assert len(found["combinations"]) == 1


@pytest.mark.slow
@pytest.mark.parametrize("loss", ["soft_l1", "huber"])
def test_robust_losses_resist_outliers(loss):
    noise = np.random.default_rng(3).normal(0, 0.01, 60)
    noise[[7, 20, 41]] = 3.0
    data = {"t": TIMES, "x": damped(TIMES, 10, 0.3, 1.2) + noise}
    exact = {"k": 10, "c": 0.3, "x": 1.2}
    _, plain = fitted(OSCILLATOR, data, [*exact])
    _, found = fitted(OSCILLATOR, data, [*exact], loss=loss)
    for name, value in exact.items():
        one = found["parameters"][name]
        assert abs(one["value"] - value) < 4 * one["standard_error"]
        wide = plain["parameters"][name]["standard_error"]
        assert one["standard_error"] < wide / 10


@pytest.mark.slow
def test_a_bound_is_kept():
    data = {"t": TIMES, "x": damped(TIMES, 10, 0.3, 1.2)}
    _, found = fitted(OSCILLATOR, data, ["k=8:9.5", "x"])
    assert found["parameters"]["k"]["bound"] == "upper"
    assert found["parameters"]["k"]["value"] == pytest.approx(9.5)
    assert found["parameters"]["k"]["interval"] is None
    assert found["parameters"]["x"]["standard_error"] > 0


@pytest.mark.slow
def test_other_starts_find_the_least_minimum():
    # From k = 9 alone a fit of the whole record ends in a local minimum.
    data = {"t": TIMES, "x": damped(TIMES, 100, 0.2, 1)}
    _, found = fitted(OSCILLATOR, data, ["k=1:200"], starts=8)
    close(found, {"k": 100})
    assert found["starts"] >= 9
    assert 1 <= found["reached"] < 9


@pytest.mark.slow
@pytest.mark.parametrize("noise", [0, 0.05])
@pytest.mark.parametrize("factor", [0.1, 0.3, 3])
def test_a_frequency_out_of_step_with_the_data(factor, noise):
    # Sixteen periods: the whole record leads from k = 300 to a local minimum.
    t = np.linspace(0.05, 10, 200)
    x = damped(t, 100, 0.2, 1) + np.random.default_rng(48).normal(0, noise, 200)
    text = OSCILLATOR.replace("k: 9", f"k: {100 * factor}")
    _, found = fitted(text, {"t": t, "x": x}, ["k", "c", "x"])
    one = found["parameters"]["k"]
    assert one["value"] == pytest.approx(100, rel=EXACT, abs=5 * one["standard_error"])
    assert one["standard_error"] < 0.2
    assert found["starts"] > 1 or factor < 3
    assert "warnings" not in found


@pytest.mark.slow
@pytest.mark.parametrize("duration", [10, 100])
def test_a_long_record_has_the_least_squares_of_its_closed_form(duration):
    # Rough derivatives of late rows once counted as not differentiable.
    t = np.linspace(duration / 200, duration, 200)
    noise = np.random.default_rng(48).normal(0, 0.05, 200)
    x = damped(t, 100, 0.02, 1) + noise
    exact = least_squares(
        lambda p: damped(t, *p) - x, [100, 0.02, 1], x_scale="jac", xtol=1e-15
    )
    text = OSCILLATOR.replace("k: 9, c: 0.2", "k: 101, c: 0.03")
    text = text.replace("duration: 10", f"duration: {duration}")
    _, found = fitted(text, {"t": t, "x": x}, ["k", "c", "x"])
    for value, one in zip(exact.x, found["parameters"].values(), strict=True):
        # Within a thousandth of a standard error.
        assert one["value"] == pytest.approx(value, abs=1e-3 * one["standard_error"])
    errors = 0.05 * np.sqrt(np.diag(np.linalg.inv(exact.jac.T @ exact.jac)))
    found_errors = [one["standard_error"] for one in found["parameters"].values()]
    assert found_errors == pytest.approx(errors, rel=0.2)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(6))
def test_velocities_through_an_impact(seed):
    # The cost jumps where the impact passes a measurement.
    random = np.random.default_rng(seed)
    mu, e, v = random.uniform(0.1, 0.2), random.uniform(0.4, 0.9), 3.5
    a, t = mu * 9.81, np.linspace(0.05, 3, 60)
    fast = math.sqrt(v**2 - 4 * a)
    s = t - (v - fast) / a
    exact = np.where(s < 0, v - a * t, np.minimum(a * s - e * fast, 0))
    x = exact + random.normal(0, 0.02, 60)
    text = PUCK.replace("x_dot: 4", f"x_dot: {v}")
    _, found = fitted(text, {"t": t, "x_dot": x}, ["mu=0:1", "e=0:1"])
    for name, value in {"mu": mu, "e": e}.items():
        one = found["parameters"][name]
        assert abs(one["value"] - value) < 5 * one["standard_error"] < 0.05
    assert found["noise"]["x_dot"] == pytest.approx(0.02, rel=0.4)


@pytest.mark.slow
def test_a_model_that_lacks_an_effect_is_named():
    t = np.linspace(0.05, 10, 200)
    drag = solve_ivp(
        lambda _, y: [y[1], -9 * y[0] - 0.3 * y[1] * abs(y[1])], (0, 10), [1, 0],
        t_eval=t, rtol=1e-9,
    )  # fmt: skip
    x = drag.y[0] + np.random.default_rng(1).normal(0, 0.003, 200)
    _, found = fitted(OSCILLATOR, {"t": t, "x": x}, ["k", "c", "x"])
    assert [one["code"] for one in found["warnings"]] == ["residual-pattern"]
    assert "`x`" in found["warnings"][0]["text"]
    # All starts lead to the same values.
    assert found["reached"] == found["starts"] > 1


def test_noise_has_no_pattern_and_a_wave_has_one():
    random, t = np.random.default_rng(5), np.linspace(0, 1, 100)
    noise = random.normal(0, 1, (2000, 100))
    # 3.5 standard deviations of two correlations leave at most 5e-4.
    assert sum(has_pattern(x, 10 + x) for x in noise) <= 5
    wave = np.sin(12 * t)
    assert has_pattern(wave + 0.3 * noise[0], t)
    # A large residual beside an impact does not hide it.
    assert has_pattern(wave + 0.3 * noise[0] + 30 * (np.arange(100) == 40), t)
    # Rounding does not count, nor do a few residuals.
    assert not has_pattern(1e-9 * wave, 1 + t)
    assert not has_pattern(wave[:7], t[:7])


@pytest.mark.slow
def test_the_file_keeps_its_comments_and_gets_new_entries():
    data = {"t": TIMES, "x": damped(TIMES, 10, 0.3, 1.2, 0.5)}
    fit, found = fitted(OSCILLATOR, data, ["k", "c", "x", "x_dot"])
    text = with_values(fit, fit.found(), {})
    assert text.startswith("\nparameters: {m: 1, k: ")
    assert "}  # released\n" in text
    start = {x.name: x.value for x in read(text, "<model>").initial}
    assert start == pytest.approx({"x": 1.2, "x_dot": 0.5}, rel=EXACT)
    assert values(found)["x_dot"] == start["x_dot"]


@pytest.mark.slow
def test_an_interrupt_keeps_the_best_values():
    noise = np.random.default_rng(3).normal(0, 0.01, 60)
    data = {"t": TIMES, "x": damped(TIMES, 10, 0.3, 1.2) + noise}
    records = [record_of("data 1", data)]
    interrupt = Interrupt()
    fit = Fit(read(OSCILLATOR, "<m>"), records, ["k", "c", "x"], interrupt=interrupt)

    def progress(_fraction):
        if fit.iterations == 3:
            interrupt.stop()

    found = document_of(fit, fit.found(progress=progress))
    assert found["outcome"] == INTERRUPTED
    assert found["complete"] is False
    assert found["identifiable"] is None
    assert found["parameters"]["k"]["standard_error"] is None
    assert abs(values(found)["k"] - 10) < 0.5
    assert found["rms"]["x"] < 0.5


@pytest.mark.parametrize(
    ("vary", "code", "name"),
    [
        (["m"], "changes-nothing", "`m`"),
        (["k", "K"], "unknown-name", "`K`"),
        (["k=3"], "usage", "k=3"),
        (["k=3:1"], "usage", "k=3:1"),
        (["k=a:b"], "usage", "k=a:b"),
        (["k", "k"], "usage", " k "),
        (["x@2"], "usage", "x@2"),
        (["x@0"], "usage", "x@0"),
        (["x@"], "usage", "x@"),
        (["x", "x@1"], "usage", " x:"),
        ([], "usage", ""),
    ],
)
def test_names_that_cannot_be_varied(vary, code, name):
    # A mass alone changes nothing without a spring of its own.
    free = OSCILLATOR.replace("k*x^2/2", "m*k*x^2/2").replace("-c*x_dot", "-m*c*x_dot")
    data = {"t": TIMES, "x": damped(TIMES, 10, 0.3, 1.2)}
    with refused(code, name, kind=InputError):
        fitted(free, data, vary)


def test_names_with_bounds():
    one, two = parse_names(["k = 1:2", "x@2 = :3"], [{}, {}])
    assert (one.label, one.low, one.high) == ("k", 1, 2)
    assert (two.label, two.record, two.low, two.high) == ("x@2", 1, -math.inf, 3)


def test_a_clock_has_no_room_in_a_run_that_the_data_fill():
    t = np.linspace(0, 10, 20)
    data = {"t": t, "x": damped(t, 10, 0.3, 1.2)}
    with refused("usage", "t0", kind=InputError):
        fitted(OSCILLATOR, data, ["k", "t0"])


@pytest.mark.slow
def test_a_parameter_named_t0_is_no_clock():
    text = OSCILLATOR.replace("c: 0.2", "c: 0.2, t0: 2").replace("k*x^2", "t0*k*x^2")
    data = {"t": TIMES, "x": damped(TIMES, 21, 0.2, 1)}
    _, found = fitted(text, data, ["t0"])
    close(found, {"t0": 21 / 9})


@pytest.mark.slow
@pytest.mark.timeout(900)  # a minute where the machine is idle
def test_intervals_hold_the_values():
    # 200 records: the share of intervals at 95 % that hold the value of k, c, x.
    random, inside = np.random.default_rng(2026), np.zeros(3)
    exact = np.array([10, 0.3, 1.2])
    model = read(OSCILLATOR, "<model>")
    for _ in range(200):
        x = damped(TIMES, *exact) + random.normal(0, 0.05, 60)
        fit = Fit(model, [record_of("d", {"t": TIMES, "x": x})], ["k", "c", "x"])
        found = document_of(fit, fit.found())["parameters"].values()
        ends = np.array([one["interval"] for one in found])
        inside += (ends[:, 0] <= exact) & (exact <= ends[:, 1])
    assert np.all(inside >= 180), inside
    assert np.all(inside <= 198), inside
