"""Laws that are finite and continuous at a switch, and branches that have no value."""

import itertools
import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from lagsim.model.reader import read
from tests.run.switching.scenes import events, one_quick, scene
from tests.support import run


def stop_at(i):
    """Return an event of scipy's where component i vanishes."""

    def value(_, z):
        return z[i]

    value.terminal = True
    return value


def reference(acceleration, x, v, times):
    """Return x of x'' = acceleration(x, v) by scipy, between zeros of v and x.

    Each stretch ends where x or v changes its sign, so that no step meets a kink.
    """
    t, y, found = 0.0, np.array([x, v], dtype=float), np.full(len(times), np.nan)
    end = float(times[-1])
    while t < end:
        stops = [stop_at(i) for i in range(2) if y[i] != 0.0 and abs(y[i]) > 1e-9]
        some = (times >= t) & (times <= end)
        got = solve_ivp(
            lambda _, z: [z[1], acceleration(z[0], z[1])],
            (t, end), y, method="DOP853", rtol=1e-12, atol=1e-14,
            dense_output=True, events=stops or None,
        )  # fmt: skip
        some &= times <= got.t[-1]
        found[some] = got.sol(times[some])[0]
        t, y = got.t[-1], got.y[:, -1]
    return found


SIGNED = {
    "-x - sign(x_dot)*abs(x_dot)^1.8": lambda x, v: (
        -x - math.copysign(abs(v) ** 1.8, v)
    ),
    "-x - 0.3*x_dot*abs(x_dot)^0.2": lambda x, v: -x - 0.3 * v * abs(v) ** 0.2,
    "-sign(x)*abs(x)^1.5": lambda x, _: -math.copysign(abs(x) ** 1.5, x),
    "-sign(x)*abs(x)^(1/3)": lambda x, _: -math.cbrt(x),
    "-cbrt(x) - 0.1*x_dot": lambda x, v: -math.cbrt(x) - 0.1 * v,
    "-x - 0.2*sqrt(abs(x_dot))*sign(x_dot)": lambda x, v: (
        -x - 0.2 * math.copysign(math.sqrt(abs(v)), v)
    ),
    "-if(x > 0, sqrt(x), x)": lambda x, _: -(math.sqrt(x) if x > 0 else x),
    "-x*log(1 + abs(x)^0.5)": lambda x, _: -x * math.log1p(math.sqrt(abs(x))),
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("law", one_quick(*sorted(SIGNED)))
def test_powers_and_roots_of_either_sign(law):
    found = run(scene(force=law, x=1, v=0.1, duration=8))
    exact = reference(SIGNED[law], 1.0, 0.1, found["t"])
    # Roots bend the motion at each crossing; scipy itself is good to about 1e-9 there.
    assert np.max(np.abs(found["x"] - exact)) < 1e-8
    assert found.trajectory.outcome.name == "DONE"
    assert found.trajectory.statistics.steps < 1000


@pytest.mark.parametrize(
    "potential",
    one_quick(
        "abs(x)^2.5/2.5",
        "abs(x)^1.5",
        "sqrt(abs(x))^3",
        "max(0, x)^1.5 + max(0, -x)^2.5",
    ),
)
def test_potentials_of_broken_powers_keep_their_energy(potential):
    found = run(scene(potential, x=1, v=0.1, duration=8))
    assert found.trajectory.outcome.name == "DONE"
    # Roots of 1e-16 are 1e-8 in the force, for as short a time.
    assert found.drift < 1e-9
    assert np.min(found["x"]) < -0.5


def depth_of(k, g):
    """Return the depth by which a fall from 1 presses a contact, by the energy."""
    return brentq(lambda d: g * (1 + d) - k * d**2.5 / 2.5, 1e-6, 1.0, xtol=1e-15)


@pytest.mark.parametrize(
    ("potential", "force"),
    one_quick(
        ("9.81*x + 1e4*max(0, -x)^2.5/2.5", None),
        ("9.81*x", "1e4*max(0, -x)^1.5"),
        ("9.81*x", "if(x < 0, 1e4*(-x)^1.5, 0)"),
        ("9.81*x", "1e4*(max(0, -x)*sqrt(max(0, -x)))"),
        ("9.81*x", "1e4*((abs(x) - x)/2)^1.5"),
    ),
)
def test_a_ball_on_a_hertzian_contact(potential, force):
    text = scene(potential, force, x=1, duration=8, output_step=1e-3)
    found = run(text)
    depth = depth_of(1e4, 9.81)
    # The rows miss the deepest point by half a row, 5e-4 s at 5e3 m/s^2 at most.
    assert np.min(found["x"]) == pytest.approx(-depth, abs=2e-3)
    assert np.min(found["x"]) > -depth - 1e-10
    times = [t for t, _ in events(found)]
    fall = math.sqrt(2 / 9.81)
    assert times[0] == pytest.approx(fall, abs=1e-12)
    # Up and down again, as free as before, after each contact.
    assert times[2] - times[1] == pytest.approx(2 * fall, abs=1e-9)
    if force is None:
        assert found.drift < 1e-8


# Of ten, the sixth moves by the least double at first.
@pytest.mark.slow
@pytest.mark.parametrize("count", one_quick(5, 4, 10))
def test_a_push_along_balls_that_touch(count):
    """They move with t, t^3.5, t^7.25, t^12.9, ... at first: powers have no scale."""
    q = [f"x{k}" for k in range(count)]
    gaps = [f"{a} - {b}" for a, b in itertools.pairwise(q)]
    text = f"""
coordinates: {{{", ".join(f"{x}: {{}}" for x in q)}}}
energy:
  kinetic: ({" + ".join(f"{x}_dot^2" for x in q)})/2
  potential: {" + ".join(f"400*if({d} > 0, ({d})^2.5, 0)" for d in gaps)}
initial: {{{", ".join(f"{x}: 0, {x}_dot: {int(x == 'x0')}" for x in q)}}}
simulation: {{duration: 1, output_step: 0.01}}
"""
    found = run(read(text, "balls.yaml"))

    def rates(_t, y):
        push = 1e3 * np.maximum(-np.diff(y[:count]), 0.0) ** 1.5
        return [*y[count:], *(np.append(0.0, push) - np.append(push, 0.0))]

    y = np.eye(2 * count)[count]
    true = solve_ivp(
        rates, (0, 1), y, method="DOP853", rtol=1e-13, atol=1e-15, max_step=1e-3
    ).y[:count, -1]
    assert [found[x][-1] for x in q] == pytest.approx(true, abs=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("slope", one_quick("1e8", "1e4", "1e10"))
def test_steep_saturation_is_dry_friction(slope):
    force = f"-0.1*max(-1, min(1, {slope}*x_dot))"
    found = run(scene("x^2/2", force, x=1, duration=40))
    # Turning points 1 - 0.2 n, until the spring cannot move it: 0.1 each swing a side.
    turns = [(-1) ** n * (1 - 0.2 * n) for n in range(5)]
    swing = np.minimum((found["t"] // math.pi).astype(int), 4)
    middle = np.where(swing % 2 == 0, 0.1, -0.1)
    start = np.array(turns)[swing]
    moving = middle + (start - middle) * np.cos(found["t"] - math.pi * swing)
    some = found["t"] < 4 * math.pi - 0.1
    # Within |x'| < 1/slope the friction is less, for about so long at each turn.
    near = 20 / float(slope)
    assert np.max(np.abs(found["x"] - moving)[some]) < max(near, 1e-9)
    assert found.trajectory.statistics.steps < 3000


@pytest.mark.parametrize(
    "spring",
    one_quick(
        "if(x > 0, sqrt(x), 0)*0 + x",
        "if(x > -0.5, x + 0*log(x + 0.5), x)",
        "if(x > 0, 1/x, 0)*0 + x",
        "if(abs(x) < 0.9, 0*acos(x), 0) + x",
        "x + 0*asin(max(-1, min(1, 2*x)))",
        "x + 0*sqrt(1 - min(1, abs(2*x)))",
    ),
)
def test_a_branch_without_a_value_spoils_nothing(spring):
    if "1/x" in spring:
        spring = "if(x > 0, 1/(1 + 1/x), 0)*0 + x"
    found = run(scene(force=f"-({spring})", x=1, duration=10))
    assert found.trajectory.outcome.name == "DONE"
    assert np.max(np.abs(found["x"] - np.cos(found["t"]))) < 1e-9


@pytest.mark.slow
@pytest.mark.parametrize("power", ["max(0, x - 1)^2.5", "sqrt(max(0, x - 1))^5"])
@pytest.mark.parametrize("method", ["taylor", "dop853"])
def test_a_power_that_rests_at_zero_leaves_a_series_finite(power, method):
    # Through free space into a wall K (x - 1)^2.5 and back at the speed of the start.
    text = f"""
coordinates: {{x: {{}}}}
energy: {{kinetic: x_dot^2/2, potential: "50*{power}"}}
initial: {{x: 0, x_dot: 1}}
simulation: {{duration: 4, output_step: 0.01, method: {method}}}
"""
    found = run(text)
    assert found.trajectory.outcome.complete
    assert found["x_dot"][-1] == pytest.approx(-1.0, abs=1e-9)
    # The way in is as deep as the energy lets it be.
    deepest = 1.0 + 0.01**0.4
    assert np.max(found["x"]) == pytest.approx(deepest, abs=1e-4)


BALLS = """
coordinates: {a: {}, b: {}, c: {}}
energy: {kinetic: (a_dot^2 + b_dot^2 + c_dot^2)/2, potential: 0}
forces:
  a: -if(a + 1 - b <= 0, 0, (a + 1 - b)^1.5)
  b: if(a + 1 - b <= 0, 0, (a + 1 - b)^1.5) - if(b + 1 - c <= 0, 0, (b + 1 - c)^1.5)
  c: if(b + 1 - c <= 0, 0, (b + 1 - c)^1.5)
initial: {a: 0, a_dot: 51, b: 1, b_dot: 50, c: 2, c_dot: 50}
simulation: {duration: 4, output_step: 0.2}
"""


def test_rows_are_written_where_a_step_ends_as_its_search_takes_too_long():
    found = run(BALLS)
    mean = (found["a"] + found["b"] + found["c"]) / 3
    assert mean == pytest.approx(1.0 + 151.0 / 3.0 * found["t"], abs=1e-10)
