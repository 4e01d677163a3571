"""A four-bar linkage through its change points, where two branches of motion cross."""

import numpy as np
import pytest
import sympy as sp
from scipy.integrate import solve_ivp

from lagsim.run.observers import Keep
from tests.support import run

# Crank 1, coupler 2, rocker 1.5 on a base of 2.5: 1 + 2.5 = 2 + 1.5, so that all of it
# can lie in a line. Height is measured from the pivots: the energy in play is no more
# than the weight of both joints falling by 2.5.
LINKAGE = """
parameters: {{o: {offset}}}
coordinates: {{x: {{}}, y: {{}}, u: {{}}, v: {{}}}}
energy:
  kinetic: (x_dot^2 + y_dot^2 + u_dot^2 + v_dot^2)/2
  potential: 9.81*((y - o) + (v - o))
constraints:
  crank: (x - o)^2 + (y - o)^2 = 1
  coupler: (u - x)^2 + (v - y)^2 = 4
  rocker: (u - o - 2.5)^2 + (v - o)^2 = 2.25
initial:
  x: o
  y: 1 + o
  u: {{guess: 1.9 + o}}
  v: {{guess: 1.4 + o}}
  x_dot: 0
  y_dot: 0
simulation: {{duration: 3, output_step: 0.01}}
"""


def truth(times):
    """Return (x, y, u, v) on the smooth branch, by the angle past the line.

    The signed height of the joint of coupler and rocker over the line from the crank's
    tip to the rocker's pivot is analytic through the change point.
    """
    f = sp.Symbol("f")
    x, y = -sp.cos(f), -sp.sin(f)
    squared = sp.Rational(29, 4) + 5 * sp.cos(f)  # of the distance tip to pivot
    along = (squared + sp.Rational(7, 4)) / (2 * squared)
    half = sp.sqrt(10 * (squared - sp.Rational(1, 4))) / (2 * squared)
    across = -half * sp.sin(f / 2)
    dx, dy = sp.Rational(5, 2) - x, -y
    places = [x, y, x + along * dx - across * dy, y + along * dy + across * dx]
    inertia = sum(sp.diff(place, f) ** 2 for place in places)
    weight = 9.81 * sp.diff(places[1] + places[3], f)
    pull = sp.lambdify(f, [inertia, sp.diff(inertia, f) / 2, weight])

    def rates(_t, state):
        i, di, w = pull(state[0])
        return [state[1], -(di * state[1] ** 2 + w) / i]

    solved = solve_ivp(
        rates, (0, times[-1]), [-np.pi / 2, 0.0], method="DOP853", rtol=1e-13,
        atol=1e-13, t_eval=times,
    )  # fmt: skip
    return np.array(sp.lambdify(f, places)(solved.y[0])).T


def deviation(times, places, offset=0.0):
    return np.max(np.abs(places - offset - truth(times)))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("rtol", "allowed"), [("1e-9", 1e-6), ("1e-11", 1e-7), ("1e-13", 1e-7)]
)
def test_it_passes_on_the_smooth_branch(rtol, allowed):
    # A step that passes errs by 1e-10 at the tightest, and errors grow on the way.
    found = run(LINKAGE.format(offset=0), rtol=rtol)
    assert deviation(found["t"], found.rows[:, 1:5]) < allowed
    assert found.drift < 25 * allowed
    passed = [e.time for e in found.trajectory.events if e.kind == "rank"]
    assert passed
    assert all(1.0 < t < 1.05 or 2.0 < t < 2.1 for t in passed)


@pytest.mark.slow
@pytest.mark.parametrize("longest", [0.001, 0.003, 0.01])
def test_steps_that_are_capped_pass_as_well(longest):
    """A cap must not make the step over the loss too short to pass it."""
    found = run(LINKAGE.format(offset=0))
    keep = Keep()
    found.session._replace(longest_step=longest).run([keep])
    rows = keep.table
    assert deviation(rows[:, 0], rows[:, 1:5]) < 1e-7


@pytest.mark.parametrize(
    "rtol", [pytest.param("1e-10", marks=pytest.mark.slow), "1e-11"]
)
def test_a_series_does_not_pass_it_on_rounding(rtol):
    # Places of 1e5 are known to 1e-11, which the passage divides by the independence; a
    # series through it would lie off by high powers of the step, and take a wrong way.
    found = run(LINKAGE.format(offset=1e5), rtol=rtol, method="taylor")
    assert deviation(found["t"], found.rows[:, 1:5], 1e5) < 1e-5
    kinds = [e.kind for e in found.trajectory.events]
    assert kinds.count("rank") == 6  # three constraints, twice
