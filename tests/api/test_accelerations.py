"""`model.rhs`: the accelerations as a function of the state."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import lagsim
from tests.small_scenes import scene
from tests.support import MODELS, refused

PENDULUM = scene(
    "x: 0.3, y: -0.4",
    "m*g*y",
    "m*(x_dot^2 + y_dot^2)/2",
    parameters="m: 2, g: 9.81, L: 0.5",
    constraints="rod: x^2 + y^2 = L^2",
    simulation="duration: 2",
)
DRIVEN = scene(
    "x: 1", "k*x^2/2", parameters="k: 4, c: 0.5", forces="x: cos(t) - c*x_dot"
)


def test_it_is_what_the_equations_say():
    rhs = lagsim.load(DRIVEN).rhs
    assert rhs(0.7, [0.2], [3.0]) == pytest.approx([np.cos(0.7) - 1.5 - 0.8], rel=1e-15)
    assert lagsim.load(DRIVEN, k=9).rhs(0.7, [1], [0])[0] == pytest.approx(
        np.cos(0.7) - 9, rel=1e-15
    )


def test_many_states_at_once():
    rhs, rng = lagsim.load(DRIVEN).rhs, np.random.default_rng(0)
    t, x, v = rng.normal(size=(3, 2, 4))
    found = rhs(t, x[..., None], v[..., None])
    assert found.shape == (2, 4, 1)
    assert found[..., 0] == pytest.approx(np.cos(t) - 0.5 * v - 4 * x, rel=1e-12)
    assert rhs(0.0, np.zeros((5, 1)), np.zeros((5, 1))).shape == (5, 1)
    assert rhs(0.0, np.zeros((0, 1)), np.zeros((0, 1))).shape == (0, 1)


def test_constraints_act_by_their_multipliers():
    # m q'' = -m g e_y + lambda (2 x, 2 y); x x'' + y y'' = -(x'^2 + y'^2).
    q, v = np.array([0.3, -0.4]), np.array([0.8, 0.6])
    found = lagsim.load(PENDULUM).rhs.motion(0.0, q, v)
    force = (-(v @ v) + 9.81 * q[1]) * 2 / 0.25 / 2
    assert found.multipliers == pytest.approx([force], rel=1e-12)
    exact = np.array([0, -9.81]) + force * q
    assert found.accelerations == pytest.approx(exact, rel=1e-12)


def test_rows_that_say_the_same_change_nothing():
    twice = PENDULUM.replace("L^2}", "L^2, again: 3*x^2 + 3*y^2 = 3*L^2}")
    state = 0.0, [0.3, -0.4], [0.8, 0.6]
    one, two = (lagsim.load(text).rhs(*state) for text in (PENDULUM, twice))
    assert two == pytest.approx(one, rel=1e-12)


def test_what_does_not_follow_is_no_number():
    # y has no inertia, and nothing holds it; once it is held, all is known.
    text = scene("x: 1, y: 0", "x", "(x_dot^2 + (x*y_dot)^2)/2")
    rhs = lagsim.load(text).rhs
    assert rhs(0, [1, 0], [0, 0]) == pytest.approx([-1, 0])
    assert np.isnan(rhs(0, [0, 0], [0, 0])).all()
    held = text.replace("initial", "constraints: {line: y = 2*x}\ninitial")
    assert lagsim.load(held).rhs(0, [0, 0], [0, 0]) == pytest.approx([-1, -2])


def test_units_do_not_matter():
    # In kilometres and milligrams, say.
    small = PENDULUM.replace("{m: 2, g: 9.81, L: 0.5}", "{m: 2e6, g: 9.81e-3, L: 5e-4}")
    one = lagsim.load(PENDULUM).rhs(0.0, [0.3, -0.4], [0.8, 0.6])
    two = lagsim.load(small).rhs(0.0, [3e-4, -4e-4], [8e-4, 6e-4])
    assert 1e3 * two == pytest.approx(one, rel=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["pendulum-cartesian", "heavy-top", "rolling-disk"])
def test_they_are_those_of_the_rows(name):
    model = lagsim.load(MODELS / f"{name}.yaml")
    result = lagsim.simulate(model, error_bar="never", duration=1)
    q, v, a = (
        np.array([result[c.name + end] for c in model.coordinates]).T
        for end in ("", "_dot", "_ddot")
    )
    found = model.rhs(result.t, q, v)
    assert np.abs(found - a).max() < 1e-10 * np.abs(a).max()


@pytest.mark.slow
def test_an_integrator_takes_it():
    model = lagsim.load(MODELS / "elastic-pendulum.yaml")
    start = [x.value for x in model.initial]
    rhs = model.rhs
    found = solve_ivp(
        lambda t, y: np.concatenate([y[2:], rhs(t, y[:2], y[2:])]), (0, 2), start,
        method="DOP853", rtol=1e-10, atol=1e-12,
    )  # fmt: skip
    result = lagsim.simulate(model, duration=2, error_bar="never")
    assert found.y[:2, -1] == pytest.approx(result.table[-1, 1:3], abs=1e-8)


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        ((0.0, [1, 2], [0.0]), "q has the shape"),
        ((0.0, [1.0], [[0.0]]), "q_dot"),
        ((0.0, 1.0, 0.0), "one for each of x"),
        (([0.0, 1.0], [1.0], [0.0]), "t has the shape"),
    ],
)
def test_shapes_that_do_not_fit_are_named(arguments, text):
    with pytest.raises(ValueError, match=text):
        lagsim.load(DRIVEN).rhs(*arguments)


def test_what_depends_on_the_past_is_refused():
    floor = PENDULUM.replace("L^2}", "L^2, floor: {relation: y >= -1, restitution: 0}}")
    with refused("failed", "`floor`"):
        _ = lagsim.load(floor).rhs
