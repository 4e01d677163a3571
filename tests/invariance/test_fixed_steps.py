"""Methods with a fixed step solve each component's equation to its own rounding."""

import functools

import numpy as np
import pytest

from tests.support import run

FREE = """
  kinetic: "(1000*c_dot^2 + (c_dot + a_dot*cos(a))^2 + (a_dot*sin(a))^2
    + (c_dot + a_dot*cos(a) + b_dot*cos(b))^2 + (a_dot*sin(a) + b_dot*sin(b))^2)/2
    {mass}"
  potential: "-{g}*(2*cos(a) + cos(b)) + {k}*(c - {far})^2 {well}"
initial: {{a: 2, b: 1, c: {far} + 0.1, c_dot: 0, a_dot: 0, b_dot: 0{other}}}
"""
HELD = """
  kinetic: "(1000*c_dot^2 + a_dot^2 + b_dot^2)/2 {mass}"
  potential: "{g}*b + {k}*(c - {far})^2 {well}"
constraints: {{rod: (a - c)^2 + b^2 = 1}}
initial: {{c: {far} + 0.1, a: {far} + 0.1 + sin(2), b: -cos(2), c_dot: 0, a_dot: 0,
  b_dot: 0{other}}}
"""
METHODS = {"midpoint": FREE, "gauss4": FREE, "generalized-alpha": FREE, "rattle": HELD}
# Positions that move with the whole scene.
MOVED = {FREE: "c", HELD: "ac"}


@functools.cache
def motion(method, *, bystander=False, far=0.0, unit=1.0):
    """Return a, b and c of a double pendulum on a heavy, sprung cart, or a single one.

    bystander : whether a body of mass 1e24 is 1e6 away.
    unit : inverse unit of time.
    """
    frequency = 0.3 / unit
    parts = {
        "g": 9.81 / unit**2, "k": 200 / unit**2, "far": far,
        "mass": "+ 1e24*X_dot^2/2", "well": f"+ 1e24*{frequency**2}*(X - 1e6)^4/4e12",
        "other": f", X: 2.2e6, X_dot: {1e3 / unit}",
    }  # fmt: skip
    if not bystander:
        parts |= {"mass": "", "well": "", "other": ""}
    names = "{a: {}, b: {}, c: {}" + (", X: {}}" if bystander else "}")
    found = run(
        f"coordinates: {names}\nenergy:{METHODS[method].format(**parts)}"
        f"simulation: {{duration: {2 * unit}, output_step: {0.02 * unit}, "
        f"method: {method}, step: {0.01 * unit}}}\n"
    )
    assert found.trajectory.outcome.complete
    moved = MOVED[METHODS[method]]
    return np.array([found[q] - (far if q in moved else 0.0) for q in "abc"])


# The roundings of 200 steps, that the motion makes some hundred times larger.
@pytest.mark.slow
@pytest.mark.parametrize(("unit", "within"), [(1.0, 0.0), (1e6, 1e-11), (1e-9, 1e-11)])
@pytest.mark.parametrize("method", METHODS)
def test_a_heavy_bystander_changes_nothing(method, unit, within):
    beside = motion(method, bystander=True, unit=unit)
    assert np.max(np.abs(beside - motion(method))) <= within


@pytest.mark.parametrize("method", METHODS)
def test_far_from_the_origin(method):
    # Positions are known to 2e-9 there, over 200 steps.
    off = motion(method, far=1e7, bystander=True) - motion(method)
    assert np.max(np.abs(off)) < 200 * 2e-9


SYMMETRIC = """
coordinates: {a: {}, b: {}, c: {}}
energy:
  kinetic: (a_dot^2 + b_dot^2 + c_dot^2)/2
  potential: 50*((a - b + 1)^2 + (b - c + 1)^2) + (a - b + 1)^4 + (b - c + 1)^4
initial: {a: 1e7 - 1.1, b: 1e7, c: 1e7 + 1.1}
"""


@pytest.mark.parametrize("method", ["midpoint", "gauss4", "generalized-alpha"])
@pytest.mark.parametrize("step", [0.01, 0.1])
def test_what_only_rounding_moves_is_solved_for(method, step):
    found = run(SYMMETRIC, method=method, step=step, duration=5, output_step=0.1)
    assert found.trajectory.outcome.complete
    # The middle one rests between forces that cancel: their rounding, of 100 times
    # 2e-9, moves it like a spring does that is let go from there, time after time.
    assert np.max(np.abs(found["b"] - 1e7)) < 1e-6
