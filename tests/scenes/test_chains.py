"""Chains of balls whose contacts are written as forces, against an integration.

The reference moves by displacements, in which touching balls have gaps of exactly 0,
by scipy's DOP853 at a tolerance of 1e-13, in steps of a 2000th of the run.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from tests.support import run

LAWS = {
    "max": "k*max(0, {g})^{p}",
    "min": "k*(-min(0, -({g})))^{p}",
    "if": "if({g} > 0, k*({g})^{p}, 0)",
    "else": "if({g} <= 0, 0, k*({g})^{p})",
    "both": "if({g} > 0, k*({g})^{p}, -k*(-({g}))^{p})",
}
CHAIN = """
parameters: {{k: {k!r}, m: {m!r}, d: {d!r}, at: {at!r}, gap: {gap!r}}}
coordinates: {{{coordinates}}}
energy: {{kinetic: "{kinetic}", potential: 0}}
forces: {{{forces}}}
initial: {{{initial}}}
simulation: {{start: {start!r}, duration: {duration!r}, output_step: {step!r}}}
"""


def chain(n, p, law, *, v, duration, beside, **numbers):
    """Give balls at `at` + i d, the first `gap` before that and with speed v."""
    laws = [LAWS[law].format(g=f"x{i} + d - x{i + 1}", p=p) for i in range(n - 1)]
    pushes = [f"- {laws[0]}", *(f"{a} - {b}" for a, b in pairwise(laws)), laws[-1]]
    forces = [f'x{i}: "{x}"' for i, x in enumerate(pushes)]
    initial = [f'x{i}: "at + {i}*d"' for i in range(1, n)]
    more = ", z: {}" if beside else ""
    return CHAIN.format(
        coordinates=", ".join(f"x{i}: {{}}" for i in range(n)) + more,
        kinetic=" + ".join(f"m*x{i}_dot^2/2" for i in range(n))
        + (" + 1e6*z_dot^2/2" if beside else ""),
        forces=", ".join(forces),
        initial=", ".join(["x0: at - gap", f"x0_dot: {v!r}", *initial])
        + (", z: 0, z_dot: 3" if beside else ""),
        duration=duration,
        step=duration / 20.0,
        **numbers,
    )


def velocities(n, p, law, t, *, k, m, v, gap):
    """Give those of all balls (n, rows)."""

    def rates(_t, y):
        u = y[:n]
        c = u[:-1] - u[1:]
        push = k * np.abs(c) ** p
        push = np.where(c > 0.0, push, -push if law == "both" else 0.0)
        force = np.zeros(n)
        force[:-1] -= push
        force[1:] += push
        return np.concatenate([y[n:], force / m])

    start = np.zeros(2 * n)
    start[0], start[n] = -gap, v
    size = abs(v) * min(1.0, t[-1])
    found = solve_ivp(
        rates, (0.0, t[-1]), start, method="DOP853", t_eval=t, rtol=1e-13,
        atol=1e-16 * size, max_step=t[-1] / 2000.0,
    )  # fmt: skip
    return found.y[n:]


def check(n, p, law, *, within=1e-9, method="auto", **other):
    numbers = {"k": 1.0, "m": 1.0, "d": 1.0, "at": 0.0, "gap": 0.0, "start": 0.0}
    numbers |= {"v": 1.0, "duration": 4.0, "beside": False} | other
    found = run(chain(n, p, law, **numbers), method=method)
    assert found.trajectory.outcome.complete
    t = np.clip(found["t"] - numbers["start"], 0.0, numbers["duration"])
    moved = {name: numbers[name] for name in ("k", "m", "v", "gap")}
    expected = velocities(n, p, law, t, **moved)
    got = np.array([found[f"x{i}_dot"] for i in range(n)])
    assert got == pytest.approx(expected, abs=within * abs(numbers["v"]))


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize(("n", "p"), [(3, 1.5), (4, 1.5), (4, 2.5), (5, 1), (8, 1.5)])
def test_balls_that_touch(n, p, law):
    """Each begins to move by a higher power of the time than the one before."""
    check(n, p, law)


@pytest.mark.parametrize("n", [3, 4])
@pytest.mark.parametrize("p", [1.5, 2.5])
@pytest.mark.parametrize("law", ["max", "if"])
def test_balls_that_touch_and_are_struck_on_the_way(law, p, n):
    """The first one strikes at t = 0.1."""
    check(n, p, law, gap=0.1)


@pytest.mark.parametrize(
    "other",
    [
        {"at": -1.3, "d": 0.3},
        {"at": 1000.0, "d": 0.3, "within": 1e-8},
        {"at": 1e6, "d": 0.3, "within": 1e-7},
        {"start": 50.0},
        {"beside": True},
        {"v": 1e-3, "duration": 15.9},
        {"k": 1e9, "m": 1e-3, "d": 0.02, "duration": 6.3e-5},
        {"k": 1e9, "m": 1e3, "d": 0.02, "v": 1e-2, "duration": 4e-2},
        {"method": "dop853"},
    ],
    ids=str,
)
@pytest.mark.parametrize("law", ["max", "both"])
def test_in_other_words(law, other):
    """Shifted, later, slower, in other units, or beside a heavy body."""
    check(4, 1.5, law, **other)
