"""Small scenes with closed forms, as text, and the times of their rows."""

from __future__ import annotations

import itertools

OSCILLATOR = """
coordinates: {{x: {{}}}}
energy: {{kinetic: x_dot^2/2, potential: x^2/2}}
{forces}
initial: {{x: {x}, x_dot: {v}}}
simulation: {{{simulation}}}
"""
FALL = """
parameters: {{g: 9.81, h: 2.5}}
coordinates: {{y: {{}}}}
energy: {{kinetic: y_dot^2/2, potential: g*y}}
initial: {{y: {y}, y_dot: {v}}}
simulation: {{duration: {duration}, output_step: 0.1, until: "{until}"{more}}}
"""


def oscillator(simulation, *, x=1, v=0, force=None):
    forces = f'forces: {{x: "{force}"}}' if force else ""
    return OSCILLATOR.format(simulation=simulation, x=x, v=v, forces=forces)


def fall(until, *, y="h", v=0, duration=5, more=""):
    return FALL.format(until=until, y=y, v=v, duration=duration, more=more)


def expected_times(start, end, step):
    rows = itertools.takewhile(
        lambda t: t < end - 1e-9 * step, (start + k * step for k in itertools.count())
    )
    return [*rows, end]
