"""`result.at`: the state at any time of a run."""

import math

import numpy as np
import pytest

import lagsim
from tests.small_scenes import spring
from tests.support import MODELS

SPRING = spring("duration: 6, output_step: 3", unit="unit: m")
PENDULUM = """
coordinates: {x: {}, y: {}}
energy: {kinetic: (x_dot^2 + y_dot^2)/2, potential: 10*y}
constraints: {rod: x^2 + y^2 = 1}
initial: {x: 0.6, y: -0.8}
simulation: {duration: 2, output_step: 1}
"""
BALL = """
coordinates: {y: {}, z: {}}
energy: {kinetic: (y_dot^2 + z_dot^2)/2, potential: 10*y}
constraints: {floor: {relation: y >= 0, restitution: 0.5}}
initial: {y: 0.45, z: 0, z_dot: 2}
simulation: {start: -1, duration: 1, output_step: 0.4}
"""
TIMES = np.array([[0.123, 5.9], [3.0, 1e-9]])


def run(text, **options):
    return lagsim.simulate(lagsim.load(text), error_bar="never", **options)


@pytest.mark.parametrize(
    ("method", "bound"),
    [
        ("auto", 1e-11), ("taylor", 1e-9), ("dop853", 1e-8), ("radau", 1e-8),
    ],
)  # fmt: skip
def test_a_state_between_far_rows_is_exact(method, bound):
    found = run(SPRING, method=method).at(TIMES)
    assert np.abs(found["x"] - np.cos(2 * TIMES)).max() < bound
    assert np.abs(found["x_ddot"] + 4 * np.cos(2 * TIMES)).max() < 10 * bound
    assert np.array_equal(found["t"], TIMES)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("method", "order"), [("kahan-li6", 6), ("gauss4", 3), ("rk4", 3), ("verlet", 2)]
)
def test_a_state_within_a_fixed_step_has_the_order_of_the_method(method, order):
    # Steps end at multiples of the step: none at these times.
    times = np.array([0.7113, 2.33331, 5.9])
    errors = [
        np.abs(run(SPRING, method=method, step=step).at(times)["x"] - np.cos(2 * times))
        for step in (0.1, 0.05)
    ]
    assert errors[1].max() < errors[0].max() / 2 ** (order - 0.5)


def test_a_number_gives_numbers_and_an_array_arrays():
    result = run(SPRING)
    found = result.at(0.5)
    assert list(found) == list(result.columns)
    assert isinstance(found["x"], float)
    assert found["x"] == pytest.approx(math.cos(1.0), abs=1e-12)
    assert result.at(TIMES)["x"].shape == (2, 2)
    assert result.at([])["x"].shape == (0,)
    assert result.at([1.0, 1.0])["x"].tolist() == [result.at(1)["x"]] * 2


@pytest.mark.slow
def test_a_constraint_is_met_between_rows():
    found = run(PENDULUM).at(np.linspace(0.01, 1.99, 40))
    assert np.abs(found["x"] ** 2 + found["y"] ** 2 - 1).max() < 1e-12
    energy = (found["x_dot"] ** 2 + found["y_dot"] ** 2) / 2 + 10 * found["y"]
    assert np.abs(energy + 8).max() < 1e-9


@pytest.mark.slow
def test_beside_an_impact_each_side_has_its_own_motion():
    # From 0.45 at t = -1: it strikes at -1 + 0.3 with -3, and leaves with 1.5.
    result = run(BALL)
    before, at, after = (result.at(t) for t in (-0.7 - 1e-6, -0.7 + 1e-9, -0.7 + 1e-6))
    assert before["y_dot"] == pytest.approx(-3, abs=2e-5)
    assert at["y_dot"] == pytest.approx(1.5, abs=2e-5)
    assert after["y_dot"] == pytest.approx(1.5, abs=2e-5)
    strike = result.events[0].time
    assert result.at(strike)["y_dot"] == pytest.approx(1.5, abs=1e-9)
    s = np.array([-0.95, -0.45])
    exact = [0.45 - 5 * 0.05**2, 1.5 * 0.25 - 5 * 0.25**2]
    assert result.at(s)["y"] == pytest.approx(exact, abs=1e-9)
    assert result.at(s)["z"] == pytest.approx(2 * (s + 1), abs=1e-12)


@pytest.mark.parametrize("t", [-1e-9, 6 + 1e-9, math.nan, math.inf])
def test_a_time_outside_the_run_is_refused(t):
    with pytest.raises(
        ValueError, match=r"outside the run, which goes from 0.0 to 6.0"
    ):
        run(SPRING).at([1.0, t])


def test_ends_are_part_of_the_run():
    result = run(BALL)
    for k in (0, -1):
        found = result.at(result.t[k])
        assert list(found.values()) == result.table[k].tolist()


NAMES = [
    "elastic-pendulum", "coupled-oscillators", "bouncing-ball", "pendulum-cartesian",
    "failing/relaxation", "stick-slip",
]  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_asking_changes_nothing_of_the_motion(name):
    """At the times of rows the result equals the rows to the bit.

    So it does if other times are requested as well.
    """
    result = lagsim.simulate(
        lagsim.load(str(MODELS / f"{name}.yaml")), error_bar="never"
    )
    last = np.append(np.diff(result.t) > 0, True)
    rows = result.table[last]
    others = np.random.default_rng(1).uniform(rows[0, 0], rows[-1, 0], 50)
    times = np.append(rows[:, 0], others)
    found = np.array(list(result.at(times).values())).T
    assert np.array_equal(found[: len(rows)], rows, equal_nan=True)


ALL = sorted(str(path.relative_to(MODELS)) for path in MODELS.rglob("*.yaml"))


@pytest.mark.slow
@pytest.mark.parametrize("name", ALL)
def test_every_shipped_model_gives_its_rows(name):
    """Rows are projected side by side: beside others, by rounding to another bit."""
    result = lagsim.simulate(MODELS / name, error_bar="never")
    last = np.append(np.diff(result.t) > 0, True)
    rows = result.table[last][::7]
    between = np.random.default_rng(2).uniform(rows[0, 0], rows[-1, 0], 20)
    found = result.at(np.append(rows[:, 0], between))
    for name, column in zip(result.columns, rows.T, strict=True):
        largest = np.nanmax(np.abs(column), initial=0.0)
        off = np.abs(found[name][: len(rows)] - column)
        assert np.nanmax(off, initial=0.0) <= 1e-13 * largest
        assert np.array_equal(np.isnan(found[name][: len(rows)]), np.isnan(column))
