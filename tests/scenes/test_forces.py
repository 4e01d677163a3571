"""Laws written with `if` on both sides, and impacts of moving constraints in rows."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import beta

from tests.support import run

SIDES = """
parameters: {{m: {m}, k: 4, at: {at}}}
coordinates: {{x: {{}}{others}}}
energy: {{kinetic: "m*x_dot^2/2{more}", potential: 0}}
forces: {{x: "{force}"}}
initial: {{x: at + 1{starts}}}
simulation: {{start: {start}, duration: {duration!r}, output_step: {step!r}}}
"""


def period(m, k, p):
    """Give the period under -k |x|^p sign(x) from rest at x = 1.

    x'^2/2 = k (1 - x^(p + 1))/(m (p + 1)), and x^(p + 1) = s in the quadrature.
    """
    n = p + 1.0
    return float(4.0 * np.sqrt(m * n / (2.0 * k)) * beta(1.0 / n, 0.5) / n)


@pytest.mark.parametrize(
    ("at", "m", "start", "beside"),
    [(0, 1, 0, False), (30, 1, 0, False), (0, 1e-6, 5, False), (-2, 1, 0, True)],
)
@pytest.mark.parametrize(
    ("p", "force"),
    [
        (1.5, "if(x > at, -k*(x - at)^1.5, k*(at - x)^1.5)"),
        (1.5, "if(x < at, k*(at - x)^1.5, -k*(x - at)^1.5)"),
        (2.5, "if(x >= at, -k*(x - at)^2*sqrt(x - at), k*(at - x)^2*sqrt(at - x))"),
    ],
)
def test_a_law_with_a_root_on_each_side(p, force, at, m, start, beside):
    """It swings with the period of the power, and comes back to where it began."""
    T = period(m, 4.0, p)
    others = ", z: {}" if beside else ""
    more = " + 1e6*z_dot^2/2" if beside else ""
    starts = ", z: 0, z_dot: 1" if beside else ""
    found = run(
        SIDES.format(
            m=m, at=at, start=start, force=force, others=others, more=more,
            starts=starts, duration=2.0 * T, step=T / 4.0,
        )
    )  # fmt: skip
    assert found.trajectory.outcome.complete
    expected = [1.0, 0.0, -1.0, 0.0, 1.0, 0.0, -1.0, 0.0, 1.0]
    assert found["x"] - at == pytest.approx(expected, abs=1e-8)


MOVED = """
coordinates: {{x: {{}}, y: {{}}}}
energy: {{kinetic: (x_dot^2 + y_dot^2)/2, potential: (x - y)^2/2}}
constraints: {{a: "x = {v}*abs(t - {at})"}}
initial: {{x: {{guess: 1}}, y: 0, x_dot: {{guess: -1}}}}
simulation: {{start: {start}, duration: 1, output_step: 0.1}}
"""


@pytest.mark.parametrize("v", [1.0, 3e-3, 2e4])
@pytest.mark.parametrize(
    ("start", "at", "on_a_row"),
    [
        (0, "0.3", True), (0, "0.7", True), (0, "0.6", True), (0, "(0.1 + 0.2)", True),
        (0, "(1 - 0.7)", True), (2, "2.3", True), (2, "(2 + 0.1*7)", True),
        (0, "0.35", False), (0, "0.301", False),
    ],
)  # fmt: skip
def test_an_impact_of_a_moving_constraint_has_two_rows(start, at, on_a_row, v):
    """Before and after at one time; where that is an output time, these are its rows.

    Times of rows are start + k*0.1, off 0.3 by its last digit.
    """
    found = run(MOVED.format(start=start, at=at, v=v))
    t, struck = found["t"], start + float(eval(at)) - start  # noqa: S307
    near = np.flatnonzero(np.abs(t - struck) < 1e-9)
    assert len(near) == 2
    assert t[near[0]] == t[near[1]]
    assert found["x_dot"][near] == pytest.approx([-v, v])
    assert len(t) == 11 + (1 if on_a_row else 2)
    assert np.all(np.diff(t)[np.arange(len(t) - 1) != near[0]] > 1e-9)
