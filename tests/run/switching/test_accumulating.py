"""Surfaces beside accumulating switches, which the accumulation does not concern."""

import math

import pytest

import lagsim
from lagsim.run.events.accumulation import Accumulation

MODEL = """\
coordinates: {{x: {{}}, y: {{}}, z: {{}}}}
energy: {{kinetic: (x_dot^2 + y_dot^2 + z_dot^2)/2, potential: 0}}
forces:
  x: -sign(x) - {k}*sign(x_dot)
  y: -{brake!r}*sign(y_dot)*heaviside(y)
  z: 0.5 + 0.5*sign(y)
initial: {{x: 1, x_dot: 0, y: {y!r}, y_dot: {speed!r}, z: 0, z_dot: 0}}
simulation: {{duration: {end!r}, output_step: 0.25}}
"""


def switches(k, count=8):
    """Return the times at which x, under -sign(x) - k sign(x_dot) from 1, or x' is 0.

    Towards 0 the acceleration is 1 - k, away from 0 it is 1 + k.
    """
    times, t, x = [], 0.0, 1.0
    for _ in range(count):
        v = math.sqrt(2.0 * x * (1.0 - k))
        times += [t + math.sqrt(2.0 * x / (1.0 - k))]
        times += [times[-1] + v / (1.0 + k)]
        t, x = times[-1], v * v / (2.0 * (1.0 + k))
    return times


@pytest.mark.parametrize("k", [0.9, 0.999, 0.9999])
@pytest.mark.parametrize(("gap", "part"), [(1, 0.5), (3, 0.5), (5, 0.9), (6, 0.5)])
def test_a_body_that_stopped_near_the_limit_stays_beside_its_surface(k, gap, part):
    """The body y passes 0 within the last switches of x, and is braked at 0.09.

    Its surface was taken for one that accumulates, 0.09 off, and the run ended.
    """
    times = switches(k)
    between = times[gap + 1] - times[gap]
    passed, speed = times[gap] + part * between, 0.2 / between
    model = MODEL.format(
        k=k,
        brake=speed**2 / 0.18,
        speed=speed,
        y=-speed * passed,
        end=times[-1] + 1.0,
    )
    result = lagsim.simulate(model, error_bar="never")
    assert result.complete
    # Rounding of y = -speed * passed is up to 1e-16 of it, and moves the passage.
    assert result["y"][-1] == pytest.approx(0.09, abs=1e-6)
    assert result["z"][-1] == pytest.approx(
        (times[-1] + 1.0 - passed) ** 2 / 2, rel=1e-6
    )
    assert abs(result["x"][-1]) < 1e-9


def test_growing_intervals_do_not_accumulate():
    sequence = Accumulation(0.0, 1.0)
    t = 0.0
    for interval in (0.1, 0.1, 0.1, 0.1, 1e-15, 2e-15, 4e-15, 8e-15):
        sequence.add(t, 0)
        t += interval
    sequence.add(t, 0)
    assert sequence.ratio() < 1e-12
    assert sequence.limit() is None


def test_shrinking_intervals_accumulate_at_their_limit():
    sequence = Accumulation(0.0, 1.0)
    for n in range(40):
        sequence.add(1.0 - 0.5**n, n % 2)
    assert sequence.limit() == pytest.approx(1.0, rel=1e-12)
