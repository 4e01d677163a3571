"""Roots of velocities: finite and continuous at rest, and steeper than any slope."""

import numpy as np
import pytest
from scipy.special import beta

from tests.run.switching.scenes import events, kinds, one_quick, scene
from tests.support import run


def slowing(v, p, c, t):
    """Return v and x from 0 of v' = -c v^p, which ends at v^(1 - p)/(c (1 - p))."""
    q = 1 - p
    left = np.maximum(v**q - c * q * t, 0)
    return left ** (1 / q), (v ** (2 - p) - left ** ((2 - p) / q)) / (c * (2 - p))


LAWS = {
    "-C*cbrt(x_dot)": 1 / 3,
    "-C*sign(x_dot)*abs(x_dot)^0.3": 0.3,
    "-C*x_dot/abs(x_dot)^0.6": 0.4,
    "-C*x_dot*abs(x_dot)^(-0.5)": 0.5,
    "-C*x_dot/sqrt(abs(x_dot))": 0.5,
    "-C*if(x_dot > 0, x_dot^0.7, -(-x_dot)^0.7)": 0.7,
    "C*(max(0, -x_dot)^0.4 - max(0, x_dot)^0.4)": 0.4,
    "-C*sign(x_dot)*(abs(x_dot)/1)^0.1": 0.1,
}


@pytest.mark.parametrize("law", one_quick(*LAWS))
@pytest.mark.parametrize("unit", [1.0, 1e-6])
def test_a_power_of_the_speed_brings_to_rest(law, unit):
    p = LAWS[law]
    c = 0.7 * unit ** (1 - p)  # the same law where lengths are counted otherwise
    found = run(scene(force=law.replace("C", repr(c)), v=unit, duration=6))
    v, x = slowing(1.0, p, 0.7, found["t"])
    # The floor is 1e-11 of the speed, and the tolerance as much.
    assert np.max(np.abs(found["x_dot"] / unit - v)) < 1e-9
    assert np.max(np.abs(found["x"] / unit - x)) < 1e-9
    assert kinds(found) == (["stick"] if v[-1] == 0.0 else [])
    assert found.trajectory.statistics.steps < 1000


@pytest.mark.parametrize("p", [1 / 3])
def test_a_force_that_grows_from_rest_moves_at_its_own_pace(p):
    # v = a t^r with r = 1/p makes F = r a t^(r - 1) + a^p t, known in closed form.
    r, a = 1 / p, 0.8
    force = f"{r * a!r}*t^{r - 1!r} + {a**p!r}*t - sign(x_dot)*abs(x_dot)^{p!r}"
    found = run(scene(force=force, duration=2, output_step=0.02))
    t = found["t"]
    assert np.max(np.abs(found["x_dot"] - a * t**r)) < 1e-9
    assert np.max(np.abs(found["x"] - a * t ** (r + 1) / (r + 1))) < 1e-9
    assert found.trajectory.statistics.steps < 60_000
    assert kinds(found) == ["stick", "slip"]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("p", "rate"), [(1 / 3, 1e-5), (1 / 3, 1e-2), (0.45, 1e-4), (0.3, 1e-5)]
)
def test_a_force_far_below_the_root_moves_by_what_keeps_it_up(p, rate):
    # v^p = rate*t - v', where v' is that of (rate*t)^(1/p), small beside the force.
    law = f"{rate!r}*t - sign(x_dot)*abs(x_dot)^{p!r}"
    found = run(scene(force=law, duration=10, output_step=0.5))
    t = found["t"][1:]
    lag = rate ** (1 / p) * t ** (1 / p - 1) / p
    v = (rate * t - lag) ** (1 / p)
    # What the lag of the lag is: of the order of its square, seen through the root.
    lost = 4.0 * np.max(lag / (rate * t)) ** 2 / p**2
    assert found["x_dot"][1:] == pytest.approx(v, rel=lost + 1e-6)
    assert found.trajectory.statistics.steps < 10_000
    assert set(kinds(found)) == {"stick", "slip"}


@pytest.mark.parametrize(
    "law",
    one_quick(
        "-cbrt(x_dot)",
        "-sign(x_dot)*abs(x_dot)^0.4",
        "-if(x_dot > 0, x_dot^0.3, -(-x_dot)^0.3)",
        "sqrt(-min(0, x_dot)) - 2*if(x_dot > 0, x_dot, 0)^0.4",
    ),
)
def test_rows_show_the_force_that_acts(law):
    text = scene(force="drag + push", duration=1, output_step=1e-5).replace(
        "duration: 1", "duration: 1e-3"
    )
    words = f'definitions: {{drag: "{law}", push: "t"}}\nenergy:'
    found = run(text.replace("energy:", words))
    assert kinds(found)[0] == "stick"
    # As it sticks, and as it has left: the force is what the acceleration says.
    total = found["drag"] + found["push"] - found["x_ddot"]
    assert np.max(np.abs(total)) < 1e-15
    assert found["x_dot"][-1] > 0


@pytest.mark.parametrize(
    "direction",
    one_quick(
        "0.5*x_dot/abs(x_dot)",
        "abs(x_dot)/x_dot/2",
        "0.5*x_dot/sqrt(x_dot^2)",
        "x_dot/(2*abs(x_dot))",
        "0.5*x_dot*abs(x_dot)^(-1)",
        "x_dot*(0.5/abs(x_dot))",
        "-(-x_dot)/abs(-x_dot)*0.5",
    ),
)
def test_a_velocity_by_its_size_is_its_sign(direction):
    found = run(scene(force=f"2*sin(t) - ({direction})", duration=1))
    # Held until 2 sin t = 1/2, then x'' = 2 sin t - 1/2.
    t = found["t"]
    free = np.arcsin(0.25)
    exact = 2 * (np.cos(free) - np.cos(t)) - (t - free) / 2
    assert np.max(np.abs(found["x_dot"] - np.where(t < free, 0, exact))) < 1e-12
    assert kinds(found) == ["stick", "slip"]
    assert events(found)[1][0] == pytest.approx(free, abs=1e-12)


@pytest.mark.parametrize("method", one_quick("dopri5", "dop853", "radau", "taylor"))
@pytest.mark.parametrize(("force", "right"), [
    ("abs(sin(2*pi*t))^0.3", 0.75 / np.pi * beta(0.65, 0.5)),
    ("abs(t - 0.5)^0.3", (0.5**1.3 + 0.25**1.3) / 1.3),
    ("max(t - 0.5, 0)^0.3", 0.25**1.3 / 1.3),
])  # fmt: skip
def test_a_root_of_time_is_left_by_steps_that_suit_its_slope(method, force, right):
    # Half a lobe of |sin|^p has the integral B((p + 1)/2, 1/2) / (4 pi). At t = 0.5
    # the rounding of a force with an infinite slope is 1e-5, for an instant.
    found = run(scene(force=force, duration=0.75, more=f", method: {method}"))
    assert found["x_dot"][-1] == pytest.approx(right, abs=1e-10)


def root(x):
    return np.sqrt(np.maximum(x, 0.0))


# Forces with a branch that has no value on the other side of its switch, and their work
# from x = 0.5 on.
BRANCHES = {
    "if(x > 1, -1/(x - 1)^0.2, 1)": lambda x: -(root(x - 1) ** 1.6) / 0.8,
    "if(x > 1, -1/(2 + sqrt(x - 1)), 1)": (
        lambda x: 4 * np.log(1 + root(x - 1) / 2) - 2 * root(x - 1)
    ),
    "if(x > 1, -1/(1 + 2*sqrt(x - 1)), 1)": (
        lambda x: np.log(1 + 2 * root(x - 1)) / 2 - root(x - 1)
    ),
    "if(x > 1, -exp(-sqrt(x - 1)), 1)": (
        lambda x: 2 * (1 + root(x - 1)) * np.exp(-root(x - 1)) - 2
    ),
    "if(x > 1, -tanh(3*(x - 1)^1.5)*sqrt(x - 1), 1)": (
        lambda x: -np.log(np.cosh(3 * root(x - 1) ** 3)) / 4.5
    ),
}


@pytest.mark.parametrize("method", ["taylor", "dop853", "dopri5"])
@pytest.mark.parametrize("force", BRANCHES)
def test_a_branch_without_a_value_on_the_other_side_is_reached(force, method):
    more = f", method: {method}"
    found = run(scene(force=force, x=0.5, v=0.5, duration=2, more=more))
    x, v = found["x"], found["x_dot"]
    work = np.minimum(x, 1.0) - 0.5 + BRANCHES[force](x)
    assert np.max(np.abs(v**2 / 2 - 0.125 - work)) < 1e-9
    assert kinds(found) == ["switch"]
    assert found["t"][-1] == 2.0
