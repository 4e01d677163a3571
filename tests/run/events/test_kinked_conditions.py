"""Conditions with a kink at 0 that an impact reaches: `abs(x) <= 0` at a wall x >= 0.

The event acts first, by the motion before the impact, and its impulse changes the
approach. At the kink the slopes of the value are those of neither side, or of the side
on which rounding leaves x.
"""

import re

import numpy as np
import pytest

import lagsim

G, E, KICK = 9.81, 0.5, 1.0
MODEL = """
coordinates: {{x: {{}}}}
energy: {{kinetic: x_dot^2/2, potential: {g!r}*x}}
modes: {{n: 0}}
definitions: {{kick: "{kick!r}*if(n < 0.5, 1, 0)"}}
events: {{e: {{at: "{at}", set: {{n: n + 1}}, impulse: {{x: kick}}}}}}
constraints: {{wall: {{relation: x >= {X!r}, restitution: 0.5}}}}
initial: {{x: {X!r} + {height!r}}}
simulation: {{duration: 1.1, output_step: 0.1{method}}}
"""
SPELLINGS = (
    "x <= 0", "abs(x) <= 0", "abs(x) = 0", "-abs(x) >= 0", "hypot(x, 0) <= 0",
    "max(x, -2*x) <= 0", "min(x, 2*x) <= 0", "if(x > 0, x, -x) <= 0",
    "if(x >= 0, x, -3*x) = 0", "sqrt(x^2) <= 0", "abs(x) + x <= 0", "x^2 <= 0",
)  # fmt: skip
SLOW = pytest.mark.slow


PLACES = {
    "plain": (0.0, 1.0, ""), "millimetres": (0.0, 1e3, ""),
    "dopri5": (0.0, 1.0, ", method: dopri5"), "shifted": (3.1, 1.0, ""),
    "rk4": (0.0, 1.0, ", method: rk4, step: 0.01"),
    "rattle": (0.0, 1.0, ", method: rattle, step: 0.01"),
}  # fmt: skip


@pytest.mark.parametrize("at", SPELLINGS)
@pytest.mark.parametrize(
    "place", ["plain", *(pytest.param(x, marks=SLOW) for x in [*PLACES][1:])]
)
def test_an_event_at_a_kink_acts_before_the_impact(at, place):
    X, length, method = PLACES[place]
    text = MODEL.format(
        g=G * length, at=re.sub(r"\bx\b", f"(x - {X!r})", at) if X else at,
        kick=KICK * length, X=X, height=length, method=method,
    )  # fmt: skip
    found = lagsim.simulate(lagsim.load(text), error_bar="never")
    # A fall of 1 m, the kick, and a rebound with half of the remaining speed.
    first = np.sqrt(2.0 / G)
    speed = E * (np.sqrt(2.0 * G) - KICK)
    second = first + 2.0 * speed / G
    third = second + 2.0 * E * speed / G
    times = [(e.kind, e.time) for e in found.events][:6]
    assert [kind for kind, _ in times] == ["event", "impact"] * 3
    expected = np.repeat([first, second, third], 2)
    assert [time for _, time in times] == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize("X", [1e6, 1e5, 0.0])
@pytest.mark.parametrize(
    "at", ["floor(q) + q <= 0", "if(q < 0, -1, 0) + q <= -t", "ceil(q) - 1 <= -q"]
)
@pytest.mark.parametrize("method", ["dop853", "taylor"])
def test_a_value_that_leaves_0_by_steps_of_rounding_does_not_return(method, at, X):
    """Far from the origin q stays 0 at first, and leaves it by a step of rounding."""
    found = lagsim.simulate(
        f"""
coordinates: {{x: {{}}}}
definitions: {{q: x - {X!r}}}
energy: {{kinetic: x_dot^2/2, potential: 0}}
initial: {{x: {X!r}, x_dot: 1}}
simulation: {{duration: 0.7, output_step: 0.1, until: "{at}", method: {method}}}
""",
        error_bar="never",
    )
    assert (found.outcome, found.t[-1]) == ("done", 0.7)
