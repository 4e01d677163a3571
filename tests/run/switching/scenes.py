"""Scenes and checks that the tests of switches share."""

import pytest


def one_quick(first, *others):
    """Return values for `parametrize`: the first is quick, the others are slow."""
    many = isinstance(first, tuple)
    slow = pytest.mark.slow
    return [first, *(pytest.param(*(x if many else (x,)), marks=slow) for x in others)]


SCENE = """
coordinates: {{x: {{}}}}
energy: {{kinetic: x_dot^2/2, potential: "{potential}"}}
{forces}
initial: {{x: {x}, x_dot: {v}}}
simulation: {{duration: {duration}, output_step: {output_step}{more}}}
"""


def scene(
    potential="0", force=None, *, x=0, v=0, duration=10, output_step=0.05, more=""
):
    forces = f'forces: {{x: "{force}"}}' if force else ""
    return SCENE.format(
        potential=potential, forces=forces, x=x, v=v, duration=duration,
        output_step=output_step, more=more,
    )  # fmt: skip


def events(found):
    return [(e.time, e.kind) for e in found.trajectory.events]


def kinds(found):
    return [e.kind for e in found.trajectory.events]


def codes(found):
    return [w.code for w in found.trajectory.warnings]
