"""Features at places of the motion: hills, walls, gates and gratings.

The motion is free but for a short way on which there is a force; no step that ends
before the force and begins behind it has any sign of the force.
"""

import math

import numpy as np
import pytest
from scipy.integrate import quad

from tests.run.looks.scenes import METHODS, line, plane, stepped
from tests.support import run

# At rtol 1e-11 a reflection multiplies errors by the steepness of what reflects.
SPEED = 1e-8

# Potentials that a body of energy 0.5 cannot pass.
HIGH = {
    "hill": "10*exp(-(x/0.1)^2/2)",
    "thin hill": "10*exp(-(x/0.001)^2/2)",
    "step": "5*(1 + tanh(1000*(x - 1)))",
    "arctangent": "5*(1/2 + atan(1e4*(x - 1))/pi)",
    "short-range wall": "1e-20/x^12",
    "sech": "7/cosh(20*(x - 0.3))^2",
    "product of factors": "30*exp(-(x/0.02)^2)*exp(-((x - 0.01)/0.02)^2)",
    "hills of a lattice": "0.7*exp(-500*(1 - cos(x)))",
    "two hills": "0.3*exp(-((x + 3)/0.01)^2/2) + 10*exp(-((x - 3)/0.02)^2/2)",
    "small denominator": "1e-4/(1e-5 + x^2)",
}


@pytest.mark.slow
@pytest.mark.parametrize("method", METHODS[1:])
@pytest.mark.parametrize("name", HIGH)
def test_what_is_too_high_turns_the_motion_back(name, method):
    found = run(line(HIGH[name], x=-10, v=1, duration=30, method=method))
    back = found["x_dot"][-1]
    # Where the potential reaches far, what is left of it there counts.
    left = found["potential"][-1] - found["potential"][0]
    assert back == pytest.approx(-math.sqrt(1 - 2 * left), abs=SPEED)
    assert np.max(found["x"]) < 5


@pytest.mark.parametrize("step", [0.01, 0.7, 25])
@pytest.mark.parametrize("method", METHODS[1:])
def test_rows_have_no_part_in_it(method, step):
    text = line(HIGH["thin hill"], x=-10, v=1, duration=25, step=step, method=method)
    assert run(text)["x_dot"][-1] == pytest.approx(-1, abs=SPEED)


@pytest.mark.parametrize("method", METHODS[1:])
@pytest.mark.parametrize("width", [0.3, 1e-2, 1e-4])
def test_passing_a_low_hill_takes_its_time(width, method):
    text = line(f"0.4*exp(-(x/{width})^2/2)", x=-10, v=1, method=method)
    found = run(text)

    def lag(z):
        return 1 / math.sqrt(1 - 0.8 * math.exp(-z * z / 2)) - 1

    late = 2 * width * quad(lag, 0, 12, epsabs=1e-13)[0]
    assert found["x"][-1] == pytest.approx(10 - late, abs=1e-8)
    assert found["x_dot"][-1] == pytest.approx(1, abs=SPEED)


@pytest.mark.parametrize("method", METHODS[1:])
def test_a_spring_leads_back_to_a_hill_again_and_again(method):
    # Bouncing between the hill and the spring: half of a free oscillation each time,
    # but for the hill's width.
    text = line("10*exp(-(x/1e-3)^2/2) + x^2/2", x=-3, duration=20, method=method)
    found = run(text)
    assert np.max(found["x"]) < 0
    assert found.drift < 1e-7


def scattered(x, y, width, height):
    return (
        f"{height}*exp(-((x - {x})^2 + (y - {y})^2)/(2*{width}^2))",
        lambda q: (
            height
            * (q - np.array([x, y]))
            / width**2
            * math.exp(-((q[0] - x) ** 2 + (q[1] - y) ** 2) / (2 * width**2))
        ),
    )


@pytest.mark.slow
@pytest.mark.parametrize("method", METHODS[1:])
@pytest.mark.parametrize("seed", range(3))
def test_a_hill_beside_the_way_in_the_plane(seed, method):
    """The closest approach lies anywhere within a step."""
    dice = np.random.default_rng(seed)
    width = 10 ** dice.uniform(-2, -0.5)
    miss, height = dice.uniform(0, 2) * width, dice.uniform(0.1, 5)
    angle, at = dice.uniform(0, 2 * math.pi), dice.uniform(3, 9)
    along = np.array([math.cos(angle), math.sin(angle)])
    place = at * along + miss * np.array([-along[1], along[0]])
    potential, push = scattered(float(place[0]), float(place[1]), width, height)
    start = (0, 0, float(along[0]), float(along[1]))
    found = run(plane(potential, start, duration=12, method=method))

    def field(_t, y):
        return [y[2], y[3], *push(y[:2])]

    end = stepped(field, start, 12, width / 3)
    for name, expected in zip(("x", "y", "x_dot", "y_dot"), end, strict=True):
        assert found[name][-1] == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize("method", METHODS[1:])
def test_a_patch_of_drag(method):
    """The loss of speed is c times the length of the patch, at any speed."""
    c, width = 3.0, 0.01
    force = f"-{c}*exp(-((x - 4)/{width})^2/2)*x_dot"
    found = run(line(force=force, v=1, duration=10, method=method))
    lost = c * width * math.sqrt(2 * math.pi)
    assert found["x_dot"][-1] == pytest.approx(1 - lost, abs=1e-9)


@pytest.mark.parametrize("method", METHODS[1:])
def test_what_wakes_at_a_speed(method):
    """A fall with damping in a narrow range of speeds: the time to pass this range."""
    width, strength = 1e-3, 0.5
    force = f"1 - {strength}*exp(-((x_dot - 5)/{width})^2/2)"
    found = run(line(force=force, duration=10, method=method))

    def lag(z):
        return 1 / (1 - strength * math.exp(-z * z / 2)) - 1

    late = 2 * width * quad(lag, 0, 12, epsabs=1e-13)[0]
    assert found["x_dot"][-1] == pytest.approx(10 - late, abs=1e-9)


@pytest.mark.parametrize("method", METHODS[1:])
def test_a_gate_that_moves(method):
    """In the frame of a hill that moves the body is turned back: v -> 2u - v."""
    text = line("9*exp(-((x + t/2)/0.003)^2/2)", x=-20, v=1, duration=30, method=method)
    assert run(text)["x_dot"][-1] == pytest.approx(-2, abs=SPEED)


# Walls that are flat from where the run begins, and whose divisor overflows there.
FAR = [
    ("5/(1 + exp(-1000*(x - 1)))", 1.0, 1.0),  # does not get there
    ("5/(1 + exp(-1000*(x - 1)))", 4.0, 6.0**0.5),  # 8 J, of which 5 are left up
    ("5/(1 + exp(-1000*(x + 1)))", 3.0, -3.0),  # 4.5 J: thrown back
    ("1/cosh(100*x)^2", 3.0, 3.0),
    ("1/(cosh(100*x)*cosh(90*x))", 3.0, 3.0),
]


@pytest.mark.parametrize("method", ["auto", "dop853", "taylor"])
@pytest.mark.parametrize(("potential", "speed", "after"), FAR)
def test_a_wall_is_met_from_far(potential, speed, after, method):
    found = run(line(potential, x=-10, v=speed, duration=4, method=method))
    assert found.trajectory.outcome.complete
    assert found["x_dot"][-1] == pytest.approx(after, rel=1e-9)
    assert found.drift < 1e-9


@pytest.mark.parametrize("method", METHODS[1:])
@pytest.mark.parametrize("of", ["x", "t"])
@pytest.mark.parametrize("nothing", ["a", "heaviside(t - 9)"])
def test_a_term_of_size_0_beside_a_hill_hides_nothing(nothing, of, method):
    """The level of equal terms was the logarithm of 0: no step could be searched."""
    text = line(
        force=f"{nothing} + exp(-(({of} - 1)/0.1)^2)", v=1, duration=2, method=method
    )
    found = run("parameters: {a: 0}\n" + text)
    # As a force of x it does work, as one of t it is an impulse.
    push = 0.1 * math.sqrt(math.pi)
    after = math.sqrt(1 + 2 * push) if of == "x" else 1 + push
    assert found["x_dot"][-1] == pytest.approx(after, rel=1e-9)


def test_scenes_without_such_functions_are_not_looked_into():
    for name in ("elastic-pendulum", "bead-hoop"):
        assert run(name, duration=0.1).system.indicators == []


def test_looks_cost_nothing_where_nothing_wakes():
    """A series for each step, and a few evaluations at the start."""
    found = run("kepler")
    assert found.system.indicators
    statistics = found.trajectory.statistics
    assert statistics.evaluations <= statistics.steps + statistics.rejections + 8
