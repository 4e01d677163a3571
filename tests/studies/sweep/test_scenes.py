"""Runs that share what is compiled give the bits of runs alone: all kinds of scenes."""

from __future__ import annotations

import numpy as np
import pytest

import lagsim
from tests.small_scenes import CONTACT, PENDULUM
from tests.support import MODELS

# Derived parameters, a start that follows them, `if` in the time and in the state.
SWITCHED = """
parameters: {k: 20, m: 1.5, w: sqrt(k/m), on: 1/w, low: -0.5}
coordinates: {x: {}, y: {}}
energy: {kinetic: m*(x_dot^2 + y_dot^2)/2, potential: k*x^2/2 + y^2*x^2 + y^2}
forces: {x: "if(t < on, m, 0) - if(x < low, w*(x - low), 0)", y: -0.1*y_dot}
initial: {x: 1, y: 0.2, x_dot: 0.1*w}
simulation: {}
"""
HELD = """
parameters: {l: 1, g: 9.8, a: 0.3, w: 2*sqrt(g/l)}
coordinates: {x: {}, y: {}}
energy: {kinetic: (x_dot^2 + y_dot^2)/2, potential: g*y}
constraints: {rod: (x - a*sin(w*t))^2 + y^2 = l^2}
initial: {x: l*sin(0.4), y: {guess: -l}, x_dot: 0.1, y_dot: {guess: 0}}
simulation: {until: y >= 0}
"""
# A power is a form: what is localized in it, and whether the motion is linear.
POWER = """
parameters: {n: 2}
coordinates: {x: }
energy: {kinetic: x_dot^2/2, potential: abs(x)^n/n}
initial: {x: 1}
simulation: {}
"""
BOUNCE = "parameters: {e: 0.5}\n" + CONTACT.replace(
    "restitution: 0.5", "restitution: e"
)
# Integrated apart, sparse, with contacts, by impulses, with limits, held velocities.
SCENES = [
    ("coupled-oscillators", {}),
    ("chain-cartesian", {}),
    ("newtons-cradle", {}),
    ("ball-on-a-vibrating-table", {"method": "moreau", "step": 1e-3}),
    ("stick-slip", {"method": "radau"}),
    ("rolling-disk", {}),
    ("pendulum-cartesian", {"formulation": "baumgarte"}),
    ("elastic-pendulum-curve", {"formulation": "elimination"}),
    ("heavy-top", {"formulation": "ignorable"}),
    ("kepler", {"method": "kahan-li8", "step": 0.01}),
    ("forced-oscillator", {"error_bar": "always"}),
    *((SWITCHED, {"name": name, "duration": 2}) for name in ("k", "m", "w")),
    *((HELD, {"name": name, "duration": 2}) for name in ("l", "g")),
    (POWER, {"values": (2, 8, 3, 8), "duration": 2}),
    (BOUNCE, {"values": (0, 0.5, 1), "duration": 2}),
    # Start values: one that the file gives, and one that it leaves at 0.
    *((PENDULUM, {"name": x, "values": (0.5, 1)}) for x in ("theta", "theta_dot")),
]
# Of last values alone, by kernels of all kinds, and with many blocks of rows.
ENDS = [
    ("elastic-pendulum", {"rtol": 1e-15, "method": "taylor"}),
    ("elastic-pendulum", {"method": "dop853"}),
    ("kepler", {"rtol": 1e-7, "method": "taylor"}),
    ("kepler", {"method": "verlet", "step": 0.01}),
    ("double-pendulum", {"output_step": 0.001}),
    ("elastic-pendulum-forced", {"method": "radau"}),
]


def assert_those_of_runs_alone(scene, asked, *, ends=False):
    source = scene if "\n" in scene else str(MODELS / f"{scene}.yaml")
    model = lagsim.load(source)
    usual = {p.name: p.value for p in model.parameters}
    name = asked.pop("name", next(iter(usual)))
    values = asked.pop("values", None) or [usual[name], 1.02 * usual[name]]
    swept = lagsim.sweep(model, {name: values}, jobs=1, ends=ends, **asked)
    for k, value in enumerate(values):
        single = {"error_bar": "never"} | asked
        alone = lagsim.simulate(lagsim.load(source, **{name: repr(value)}), **single)
        assert swept["outcome"][k] == alone.outcome
        for column in alone.columns[1:]:
            rows = alone[column]
            own = {"end": rows[-1]}
            if not ends:
                own |= {"min": np.fmin.reduce(rows), "max": np.fmax.reduce(rows)}
            told = [swept[f"{column}.{x}"][k] for x in own]
            assert np.array_equal(told, list(own.values()), equal_nan=True), column


@pytest.mark.slow
@pytest.mark.parametrize(("scene", "options"), SCENES)
def test_rows_are_those_of_runs_alone(scene, options):
    asked = {"duration": 0.5, "output_step": 0.05, "error_bar": "never"} | options
    assert_those_of_runs_alone(scene, asked)


@pytest.mark.parametrize(("scene", "options"), ENDS)
def test_ends_are_those_of_runs_alone(scene, options):
    assert_those_of_runs_alone(scene, {"duration": 6} | options, ends=True)
