"""Surfaces beside accumulating switches, which the accumulation does not concern."""

import math

import numpy as np
import pytest
from scipy.optimize import brentq

import lagsim
from lagsim.model.reader import read
from lagsim.run.events.accumulation import Accumulation
from tests.run.switching.scenes import one_quick

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
    sequence = Accumulation(1.0)
    t = 0.0
    for interval in (0.1, 0.1, 0.1, 0.1, 1e-15, 2e-15, 4e-15, 8e-15):
        sequence.add(t, 0)
        t += interval
    sequence.add(t, 0)
    assert sequence.ratio() < 1e-12
    assert sequence.limit() is None


def test_shrinking_intervals_accumulate_at_their_limit():
    sequence = Accumulation(1.0)
    for n in range(40):
        sequence.add(1.0 - 0.5**n, n % 2)
    assert sequence.limit() == pytest.approx(1.0, rel=1e-12)


# A bead on a bent wire: it comes to rest in the corner, is driven out, returns after
# 95 s, and rests again. Mass, weight, spring, slopes, and the forces from their times.
M, W, C = 1.5855773466719028, 1.831460932408977, 2 * 0.0006513617035942781
SLOPES = (-0.3807621222276607, 1.46417327386189)
PUSHES = ((147.6, 2.748775417316293), (220.8, 1.599932163124946))
BEAD = f"""
coordinates: {{{{x: {{{{}}}}, y: {{{{}}}}}}}}
energy:
  kinetic: {M}*(x_dot^2 + y_dot^2)/2
  potential: {W}*y + {C}*x^2/2
forces: {{{{x: "if(t < 147.6, 0, if(t < 220.8, {PUSHES[0][1]}, {PUSHES[1][1]}))"}}}}
constraints: {{{{wire: "y = {{wire}}"}}}}
initial:
  x: 0
  x_dot: -2.824931791618209
  y: {{{{guess: 0}}}}
  y_dot: {{{{guess: 0}}}}
simulation: {{{{duration: 294, output_step: 6{{more}}}}}}
"""


def swung(side, force, x, v):
    """Return x and x' as functions of time on one side of the corner."""
    k = SLOPES[side]
    w = math.sqrt(C / (M * (1.0 + k * k)))
    middle = (force - W * k) / C

    def after(t):
        c, s = math.cos(w * t), math.sin(w * t)
        return middle + (x - middle) * c + v / w * s, v * c - (x - middle) * w * s

    return after


def rest_in_the_corner():
    """Return the time at which the bead rests again, by closed forms of its flights."""
    (start, first), (later, force) = PUSHES
    x, v = swung(1, first, 0.0, 0.0)(later - start)
    path, side = swung(1, force, x, v), 1
    took = brentq(lambda t: path(t)[0], 0.0, 60.0)
    t, v = later + took, path(took)[1]
    while abs(v) > 1e-12:
        k, other = SLOPES[side], SLOPES[1 - side]
        v *= (1.0 + k * other) / (1.0 + other * other)
        side = 1 - side
        path = swung(side, force, 0.0, v)
        a = (force - W * other) / (M * (1.0 + other * other))
        took = -2.0 * v / a  # the spring adds v^2 of this at most
        if abs(v) > 1e-3:
            took = brentq(lambda t, of=path: of(t)[0], 0.5 * took, 2.0 * took)
        t, v = t + took, (path(took)[1] if abs(v) > 1e-3 else -v)
    return t


@pytest.mark.slow
@pytest.mark.parametrize("method", one_quick("auto", "dopri5", "rk4, step: 0.01"))
@pytest.mark.parametrize(
    "wire",
    one_quick(
        f"if(x <= 0, {SLOPES[0]}*x, {SLOPES[1]}*x)",
        f"max({SLOPES[0]}*x, {SLOPES[1]}*x)",
        f"{sum(SLOPES) / 2}*x + {(SLOPES[1] - SLOPES[0]) / 2}*abs(x)",
    ),
)
def test_a_bead_rests_in_its_corner_after_flights_of_very_different_length(
    wire, method
):
    # Four flights after the one of 95 s counted as an accumulation, at x' = 6e-4.
    model = BEAD.format(wire=wire, more=f", method: {method}")
    result = lagsim.simulate(read(model, "bead.yaml"), error_bar="never")
    assert result.complete
    last = max(e.time for e in result.events if e.kind == "zeno")
    assert last == pytest.approx(rest_in_the_corner(), abs=1e-6)
    rest = result["t"] > last
    assert np.all(np.abs(result["x"][rest]) < 1e-12)
    assert np.all(np.abs(result["x_dot"][rest]) < 1e-12)


NESTED_STEPS = """
definitions:
  d0: max(x_dot + 0.34375, -x - 0.5)
  d1: 0.984375*sign(floor(-z - 1.21875*d0) - 0.09375)
  d2: if(mod(2*u + 1.921875, 1.546875) - 0.8125 <= 1.203125, -0.09375, -0.0625)
  d3: min(z - 0.859375 - max(-1.609375*u - 1, -t), 0.6875)
  d4: sin(1.703125*x) - 0.5*z
coordinates: {x: {}}
states:
  z: {rate: 1.1875*sign(0.5*u + 0.78125*d3)*floor(0.5*x - 1.609375) + d4}
modes: {u: 1}
energy: {kinetic: x_dot^2/2, potential: 0}
forces: {x: d1 + 0.03955078125*d2}
events:
  e: {every: 1.28125, set: {u: '-0.390625*max(u - 1.046875, 0.5*z - 0.875)'}}
initial: {x: 0.671875, x_dot: 0.171875, z: -0.5}
simulation: {duration: 4, output_step: 0.1}
"""


@pytest.mark.slow
def test_a_held_surface_does_not_rest_with_another_that_switches():
    # The floor switches at 3.92 while the sign is held: they have no limit at 4.83.
    found = lagsim.simulate(lagsim.load(NESTED_STEPS), error_bar="never")
    assert max(event.time for event in found.events) <= 4
    # z by the referee of tests/hunt/flights.py, which two motions confirm to 2e-9.
    assert found["z"][-1] == pytest.approx(-0.8306603509685146, abs=1e-8)
