"""Coordinates that constraints move: rows that alias it, and impacts at the start.

A free coordinate y hangs on x by a spring of stiffness 1 and mass 1: closed forms.
"""

from __future__ import annotations

import numpy as np
import pytest

import lagsim

DRIVEN = """
parameters: {{A: {A!r}, at: {at!r}, m: {m!r}}}
coordinates: {{x: {{}}, y: {{}}{more}}}
energy: {{kinetic: "m*(x_dot^2 + y_dot^2)/2{kinetic}", potential: "m*(y - x)^2/2"}}
constraints: {{a: "{relation}"{others}}}
initial: {{x: {{guess: {x}}}, x_dot: {{guess: 0}}, y: {y}, y_dot: 0{starts}}}
simulation: {{start: {start!r}, duration: {duration!r}, output_step: {step!r}}}
"""


def simulated(relation, *, beside="", x="at", y="at", **numbers):
    numbers = {"A": 1.0, "at": 0.0, "m": 1.0, "start": 0.0} | numbers
    words = {"more": "", "kinetic": "", "others": "", "starts": ""}
    if beside:
        words["more"] = ", z: {}"
        words["kinetic"] = " + 1e6*z_dot^2/2"
        words["starts"] = ", z: 0, z_dot: 1"
    if beside == "linked":
        words["others"] = ', b: "z = 3*(x - at) + t"'
        words["starts"] = f", z: 3*({x} - at) + {numbers['start']}, z_dot: {{guess: 0}}"
    text = DRIVEN.format(relation=relation, x=x, y=y, **words, **numbers)
    return lagsim.simulate(lagsim.load(text))


@pytest.mark.parametrize("beside", ["", "free", "linked"])
@pytest.mark.parametrize(
    ("A", "at", "m"), [(1.0, 0.0, 1.0), (1e-6, 0.0, 1e-9), (1e3, -40.0, 1.0)]
)
@pytest.mark.parametrize(
    ("relation", "start", "step"),
    [
        ("x = at + A*cos(4*pi*t)", 0.125, 0.25),
        ("(x - at)/A = cos(4*pi*t)", 0.125, 0.5),
        ("x - at - A*cos(4*pi*t) = 0", 7.125, 0.25),
        ("x = at + A*cos(4*pi*t)", 0.0, 0.5),
    ],
)
def test_rows_that_alias_the_motion(relation, start, step, A, at, m, beside):
    """All rows show x at one place; y knows that it moves.

    y = at + P cos(w t) + C cos(t - t0) + D sin(t - t0) with P = A/(1 - w^2).
    """
    found = simulated(
        relation, A=A, at=at, m=m, start=start, step=step, duration=5.0, beside=beside,
        x="at + A" if start == 0.0 else "at", y="at + A",
    )  # fmt: skip
    assert found.complete
    assert not found.warnings
    w, s = 4.0 * np.pi, found.t - start
    P = A / (1.0 - w * w)
    C, D = A - P * np.cos(w * start), P * w * np.sin(w * start)
    expected = P * np.cos(w * found.t) + C * np.cos(s) + D * np.sin(s)
    assert found["x"] - at == pytest.approx(A * np.cos(w * found.t), abs=1e-8 * A)
    assert found["y"] - at == pytest.approx(expected, abs=1e-8 * A)


STRUCK = [
    "x = at + A*max(0, sin(2*pi*(t - {t0})))",
    "x = at + A*if(t > {t0}, sin(2*pi*(t - {t0})), 0)",
    "x = at + A*abs(sin(2*pi*(t - {t0})))",
    "x - at = if(sin(2*pi*(t - {t0})) > 0, A*sin(2*pi*(t - {t0})), 0)",
]


@pytest.mark.parametrize("beside", ["", "free", "linked"])
@pytest.mark.parametrize(
    ("A", "at", "m", "start"),
    [(1.0, 0.0, 1.0, 0.0), (1e-5, 3.0, 1e6, 0.0), (1.0, 0.0, 1.0, 0.3)],
)
@pytest.mark.parametrize("relation", STRUCK)
def test_a_constraint_that_moves_from_the_start_on_strikes_there(
    relation, A, at, m, start, beside
):
    """As written x rests at the start, and moves at w A just after: two rows, one time.

    Then y = A (sin(w s) - w sin(s))/(1 - w^2).
    """
    found = simulated(
        relation.format(t0=start), A=A, at=at, m=m, start=start, step=0.05,
        duration=0.45, beside=beside,
    )  # fmt: skip
    assert found.complete
    assert not found.warnings
    w, s = 2.0 * np.pi, found.t - start
    assert found.t[:3] == pytest.approx([start, start, start + 0.05], abs=1e-12)
    assert len(found.t) == 11
    assert found["x_dot"][:2] == pytest.approx([0.0, w * A], abs=1e-12 * A)
    [event] = found.events
    assert (event.time, event.kind) == (start, "impact")
    expected = A * (np.sin(w * s) - w * np.sin(s)) / (1.0 - w * w)
    assert found["y"] - at == pytest.approx(expected, abs=1e-9 * A)
    balance = found["energy"] - found["work"]
    # What else is moved has energy, too, which is not that of this motion.
    scale = np.max(np.abs(found["energy"]))
    assert balance == pytest.approx(np.full(11, balance[0]), abs=1e-9 * scale)


def test_a_constraint_that_goes_on_as_it_was_strikes_nothing():
    """Its speed is that of its motion before the start: no impact, one row."""
    found = simulated("x = at + A*max(0, t + 1)", step=0.1, duration=1.0, x="1")
    assert found.complete
    assert not found.events
    assert len(found.t) == 11
    assert found["x_dot"] == pytest.approx(np.ones(11))
