"""The work done on each group of coordinates is that of the group alone."""

import numpy as np
import pytest

import lagsim
from lagsim.methods import names
from tests.support import run

PARTS = {
    "x": ("x_dot^2/2", "x^2/2 + x^4/50", "x: {x}"),
    "z": ("1e5*z_dot^2/2", "1e5*(2*z^2)", "z: {z}"),
    "w": ("3*w_dot^2/2", "3*(1 - cos(w))", ""),
}
FORCES = {
    "of time": {"x": "0.3*sin(2*t)", "z": "1e4*cos(t)"},
    "of velocity": {"x": "-0.1*x_dot", "z": "-1e4*z_dot"},
}
# Methods that refuse forces of velocities.
FIXED_BY_TIME = ("verlet", "kahan-li6", "kahan-li8", "rattle")


def scene(coordinates, forces):
    chosen = [PARTS[q] for q in coordinates]
    potential = " + ".join(V for _, V, _ in chosen)
    pushes = ", ".join(Q.format(**FORCES[forces]) for *_, Q in chosen if Q)
    return f"""
coordinates: {{{", ".join(f"{q}: {{}}" for q in coordinates)}}}
energy: {{kinetic: {" + ".join(T for T, *_ in chosen)}, potential: "{potential}"}}
forces: {{{pushes}}}
initial: {{{", ".join(f"{q}: 1" for q in coordinates)}}}
simulation: {{duration: 6, output_step: 0.5}}
"""


def options_of(method):
    return {"method": method, "step": 0.01}


@pytest.mark.slow
@pytest.mark.parametrize("method", sorted(names()))
def test_by_each_method(method):
    forces = "of time" if method in FIXED_BY_TIME else "of velocity"
    options = options_of(method)
    found = run(scene("xzw", forces), **options)
    assert np.allclose(found["work"], found["work.x"] + found["work.z"], rtol=1e-14)
    for q in "xz":
        alone = run(scene(q, forces), **options)
        size = np.max(np.abs(alone["work"]))
        assert np.max(np.abs(found[f"work.{q}"] - alone["work"])) < 1e-8 * size


def test_impacts_of_moving_constraints():
    """An impact at t = 1 costs a body of 1 kg 2 v^2 m, beside a body of 1e15 J."""
    found = run("""
coordinates: {p: {}, s: {}, z: {}}
energy:
  kinetic: (p_dot^2 + s_dot^2)/2 + 1e15*z_dot^2/2
  potential: (p - s)^2/2 + 1e15*z^2/2
constraints: {moved: p = 0.3*abs(t - 1)}
initial: {p: 0.3, s: 0.3, z: 1, p_dot: -0.3}
simulation: {duration: 2, output_step: 0.01}
""")  # fmt: skip
    assert found.trajectory.event_counts["impact"] == 1
    balance = (found["p_dot"] ** 2 + found["s_dot"] ** 2) / 2
    balance = balance + (found["p"] - found["s"]) ** 2 / 2 - found["work"]
    assert np.ptp(balance) < 1e-9


@pytest.mark.parametrize("held", ["", "constraints: {c: x = 5*t}"])
def test_powers_of_a_moving_frame_that_cancel(held):
    # Two bodies fall against each other, seen from a floor that moves: dL/dt of one is
    # that of the other with the other sign, and 0 in all.
    text = f"""
coordinates: {{x: {{}}, y: {{}}}}
energy: {{kinetic: ((x_dot - 5)^2 + (y_dot - 5)^2)/2, potential: (y - 5*t) - (x - 5*t)}}
initial: {{x: 0, x_dot: 5, y: 0, y_dot: 5}}
{held}
simulation: {{duration: 2, output_step: 0.1}}
"""
    result = lagsim.simulate(lagsim.load(text))
    assert result.complete, result.reason
    assert not result.warnings
    t = result.t
    assert result["y"] == pytest.approx(5 * t - t**2 / 2, abs=1e-12)
    assert result["x"] == pytest.approx(5 * t + (0 if held else t**2 / 2), abs=1e-12)


@pytest.mark.parametrize("method", ["midpoint", "gauss4", "verlet", "rk4"])
def test_the_work_of_an_eliminated_drive_beside_a_force(method):
    # x'' = t from rest, and z = sin(2 pi t)/10 whatever it takes.
    text = """
coordinates: {u: {}, w: {}}
definitions: {x: 0.6*u + 0.8*w, z: 0.8*u - 0.6*w}
energy: {kinetic: (x_dot^2 + z_dot^2)/2, potential: 0}
forces: {x: t}
constraints: {drive: z = 0.1*sin(2*pi*t)}
initial: {u: 0, w: 0, u_dot: 0.8*0.2*pi, w_dot: -0.6*0.2*pi}
simulation: {duration: 2, output_step: 0.05}
"""
    found = lagsim.simulate(
        lagsim.load(text), method=method, step=0.001, error_bar="never"
    )
    assert found.record["formulation"] == "elimination"
    t = found.t
    gained = t**4 / 8 - (0.2 * np.pi * np.sin(2 * np.pi * t)) ** 2 / 2
    assert found["work"] == pytest.approx(gained, abs=1e-5)
