"""Runs that begin where a smooth wall is flat and its divisor overflows."""

from __future__ import annotations

import pytest

from tests.support import run

WALL = """name: wall
coordinates: {{x: {{}}}}
energy: {{kinetic: "x_dot^2/2", potential: "{V}"}}
initial: {{x: -10, x_dot: {speed}}}
simulation: {{duration: 4, output_step: 0.1, method: {method}}}
"""


@pytest.mark.parametrize("method", ["auto", "dop853", "taylor"])
@pytest.mark.parametrize(
    ("V", "speed", "after"),
    [
        ("5/(1 + exp(-1000*(x - 1)))", 1.0, 1.0),  # does not get there
        ("5/(1 + exp(-1000*(x - 1)))", 4.0, 6.0**0.5),  # 8 J, of which 5 are left up
        ("5/(1 + exp(-1000*(x + 1)))", 3.0, -3.0),  # 4.5 J: thrown back
        ("1/cosh(100*x)^2", 3.0, 3.0),
        ("1/(cosh(100*x)*cosh(90*x))", 3.0, 3.0),
    ],
)
def test_the_wall_is_met_from_far(
    V: str, speed: float, after: float, method: str
) -> None:
    result = run(WALL.format(V=V, speed=speed, method=method))
    assert result.trajectory.outcome.complete
    assert result["x_dot"][-1] == pytest.approx(after, rel=1e-9)
    assert result.drift < 1e-9
