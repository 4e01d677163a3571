"""RATTLE goes on after an impact of a body that an equality holds.

The state at a located impact has a gap of 0, and velocities that miss the equality by
1e-9 of their size: the forces along the old gradients could not balance it, and the run
ended in the next step.
"""

import math

import pytest

import lagsim

RADIUS, DEPTH = 0.981, 0.95157
MODEL = """
coordinates: {{x: {{}}, y: {{}}}}
energy: {{kinetic: {m}*(x_dot^2 + y_dot^2)/2, potential: {m}*6.2784*y}}
constraints:
  rod: {{relation: x^2 + y^2 - {L}^2*{radius}^2 = 0}}
  floor: {{relation: y + {L}*{depth} >= 0, restitution: {e}}}
initial: {{x: {L}*{x}, y: -{L}*{y}, x_dot: 0, y_dot: 0}}
simulation: {{duration: {duration}, output_step: {duration}/8, method: {method}}}
"""


def run(method, e, L=1.0, m=1.0):
    angle = 0.75
    x, y = RADIUS * math.sin(angle), RADIUS * math.cos(angle)
    return lagsim.simulate(
        MODEL.format(
            m=m, L=L, e=e, x=x, y=y, radius=RADIUS, depth=DEPTH, method=method,
            duration=2.0 * math.sqrt(L),
        ),
        error_bar="never",
    )  # fmt: skip


@pytest.mark.parametrize("step", [0.02, 0.005, 0.001])
@pytest.mark.parametrize("e", [0.0, 0.48, 1.0])
@pytest.mark.parametrize(("L", "m"), [(1.0, 1.0), (1e3, 1e-3)])
def test_a_ball_on_a_rod_strikes_the_floor(L, m, e, step):
    found = run(f"rattle, step: {step * math.sqrt(L)}", e, L, m)
    assert found.outcome == "done"
    near = run("dop853", e, L, m)
    first = [
        next(x.time for x in r.events if x.kind == "impact") for r in (found, near)
    ]
    assert first[0] == pytest.approx(first[1], rel=0.1 * step)
    off = max(abs(found[q][-1] - near[q][-1]) for q in "xy") / L
    assert off < 20.0 * step**2 + 1e-7
