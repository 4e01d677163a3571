"""Small scenes as text, their exact solutions, and the times of their rows."""

from __future__ import annotations

import itertools
import math

import numpy as np
from scipy.special import ellipj, ellipk

OSCILLATOR = """
coordinates: {{x: {{}}}}
energy: {{kinetic: x_dot^2/2, potential: x^2/2}}
{forces}
initial: {{x: {x}, x_dot: {v}}}
{simulation}
"""
# Length and gravity 1, let go at rest: in its angle, and on a rod.
PENDULUM = """
coordinates: {{a: {{}}}}
energy: {{kinetic: a_dot^2/2, potential: -cos(a)}}
initial: {{a: {amplitude}}}
{simulation}
"""
HELD = """
coordinates: {{x: {{}}, y: {{}}}}
energy: {{kinetic: (x_dot^2 + y_dot^2)/2, potential: y}}
constraints: {{rod: x^2 + y^2 = 1}}
initial: {{x: sin({amplitude}), y: -cos({amplitude})}}
{simulation}
"""
FALL = """
parameters: {{g: 9.81, h: 2.5}}
coordinates: {{y: {{}}}}
energy: {{kinetic: y_dot^2/2, potential: g*y}}
initial: {{y: {y}, y_dot: {v}}}
simulation: {{duration: {duration}, output_step: 0.1, until: "{until}"{more}}}
"""


def oscillator(simulation=None, *, x=1, v=0, force=None):
    """x'' = -x: x cos(t) + v sin(t)."""
    forces = f'forces: {{x: "{force}"}}' if force else ""
    return OSCILLATOR.format(simulation=line(simulation), x=x, v=v, forces=forces)


def pendulum(amplitude=1, simulation=None):
    return PENDULUM.format(amplitude=amplitude, simulation=line(simulation))


def held_pendulum(amplitude=1, simulation=None):
    return HELD.format(amplitude=amplitude, simulation=line(simulation))


def line(simulation):
    return f"simulation: {{{simulation}}}" if simulation else ""


def angle(found):
    """Give the angle of either pendulum."""
    if "a" in found.system.columns.names:
        return found["a"]
    return np.arctan2(found["x"], -found["y"])


def swing(t, amplitude=1.0):
    """Give the angle of a pendulum let go at `amplitude`: Jacobi's elliptic functions.

    sin(a/2) = k sn(K - t, k^2), k = sin(amplitude/2).
    """
    k = math.sin(amplitude / 2.0)
    return 2.0 * np.arcsin(k * ellipj(ellipk(k * k) - t, k * k)[0])


def swing_rate(t, amplitude=1.0):
    """Give the rate of the same: -2 k cn(K - t, k^2)."""
    k = math.sin(amplitude / 2.0)
    return -2.0 * k * ellipj(ellipk(k * k) - t, k * k)[1]


def quarter(amplitude):
    """Give the time at which the same first hangs straight down: K(k)."""
    return ellipk(math.sin(amplitude / 2.0) ** 2)


def fall(until, *, y="h", v=0, duration=5, more=""):
    return FALL.format(until=until, y=y, v=v, duration=duration, more=more)


def expected_times(start, end, step):
    rows = itertools.takewhile(
        lambda t: t < end - 1e-9 * step, (start + k * step for k in itertools.count())
    )
    return [*rows, end]
