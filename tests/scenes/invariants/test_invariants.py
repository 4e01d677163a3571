"""Invariants: energies, momenta, the motion in other units and tolerances."""

import math

import numpy as np
import pytest

from tests.support import MODELS, SHIPPED, at_outputs, has_laws, run

# Chaotic: the errors of both tolerances grow tenfold in 2 s, to 1e-4 of the angles.
CHAOTIC = {"double-pendulum"}


# Hundreds of impacts, whose energy tests/scenes/contact keeps as well.
LONG = {"rocking-block", "quadruped"}


@pytest.mark.parametrize(
    "name", [pytest.param(x, marks=[pytest.mark.slow] * (x in LONG)) for x in SHIPPED]
)
def test_energy_constraints_and_tolerances_of_every_model(name):
    found = run(name)
    model = found.equations.model
    # The hopper's is a fall, which does not happen.
    ended = model.until is not None and name != "hopper"
    expected = "until" if ended else "done"
    assert found.trajectory.outcome.word == expected
    # The largest energy that moves in the scene, not the free constant of a potential:
    # differences, and the kinetic energy, which has no free constant.
    columns = found.system.columns.names
    parts = [x for x in ("energy", "potential", "work") if x in columns]
    scale = max(float(np.ptp(found[part])) for part in parts)
    scale = max(scale, float(np.max(found["kinetic"])))
    # Ten times the default tolerance: each step's error stays. The largest are those of
    # chaotic motion, a fifth of this.
    assert found.drift < 1e-10 * scale
    # Those that hold at times: tests/scenes/contact.
    assert has_laws(name) == bool(found.equations.laws)
    for row in () if has_laws(name) else found.equations.rows:
        scale = found[f"scale:{row.name}"]
        # Projected to rounding: a few hundred units in the last place of the terms.
        assert np.all(np.abs(found[f"residual_{row.name}"]) <= 1e-13 * scale + 1e-15)
    if name not in CHAOTIC:
        tight_enough(found, run(name, rtol="1e-13"))


def tight_enough(default, tight):
    """Assert errors of default tolerances within 1e-8 of range or scale."""
    settings = default.session.case.settings
    rows, others = (
        at_outputs(found["t"], settings.start, settings.output_step)
        for found in (default, tight)
    )
    groups = [default.equations.q, default.equations.velocities]
    # The length of a quaternion takes no force.
    quaternions = default.equations.model.quaternions
    if any(row.name not in quaternions for row in default.equations.rows):
        groups.append(tuple(f"Qc_{q}" for q in default.equations.q))
    for group in groups:
        for column in group:
            exact = tight[column][others]
            scale = max(np.ptp(exact), np.max(np.abs(exact)))
            if scale < 1e-9 * max(np.max(np.abs(tight[c])) for c in group):
                continue  # it should stay zero and is rounding
            assert np.max(np.abs(default[column][rows] - exact)) < 1e-8 * scale, column


CONSTANTS = ("elastic-pendulum", "kepler", "double-pendulum", "forced-oscillator")


@pytest.mark.slow
@pytest.mark.parametrize("name", CONSTANTS)
@pytest.mark.parametrize("constant", ["1e3", "-1e6"])
def test_a_constant_in_the_potential_changes_nothing(name, constant):
    text = (MODELS / f"{name}.yaml").read_text(encoding="utf-8")
    plain = run(text)
    with_it = run(text.replace("potential: ", f"potential: {constant} + ", 1))
    for column in (*plain.equations.q, *plain.equations.velocities):
        assert np.array_equal(with_it[column], plain[column]), column
    moved = with_it["energy"] - plain["energy"]
    # Rounded to a few units in the last place of the constant.
    assert np.max(np.abs(moved - float(constant))) < 1e-15 * abs(float(constant))


def test_kepler_keeps_momentum_and_perihelion():
    found = run("kepler")
    expected = {"angular_momentum": 0.8, "perihelion_x": 0.6, "perihelion_y": 0.0}
    for column, value in expected.items():
        # Ten orbits at 1e-11, each step's error kept for ever.
        assert np.max(np.abs(found[column] - value)) < 1e-9


def test_heavy_top_keeps_its_momenta():
    found = run("heavy-top")
    for column, value in {"p_phi": 0.0046875, "p_psi": 0.009375}.items():
        assert np.max(np.abs(found[column] - value)) < 1e-9 * value


def test_bead_keeps_jacobis_integral_in_both_forms():
    expected = -(math.sin(0.1) ** 2) - math.cos(0.1)
    angle, cartesian = run("bead-hoop"), run("bead-hoop-cartesian")
    assert np.max(np.abs(angle["energy"] - expected)) < 1e-9
    assert np.max(np.abs(cartesian["jacobi"] - expected)) < 1e-9
    # The work of the hoop is Omega times the change of the angular momentum.
    x, y = cartesian["x"], cartesian["y"]
    momentum = x * cartesian["y_dot"] - y * cartesian["x_dot"]
    work = math.sqrt(2.0) * (momentum - momentum[0])
    assert np.max(np.abs(cartesian["work"] - work)) < 1e-9
    assert np.max(np.abs(cartesian["z"] + np.cos(angle["theta"]))) < 1e-8


@pytest.mark.slow
def test_two_forms_of_the_chain_agree():
    angles, cartesian = run("chain-angles"), run("chain-cartesian")
    for column in "xy":
        # Errors of both runs; the motion enlarges them about a hundredfold.
        tip, other = angles[f"{column}.10"], cartesian[f"{column}10"]
        assert np.max(np.abs(tip - other)) < 1e-8


FREE_PARTICLES = """
coordinates: {x1: {}, y1: {}, x2: {}, y2: {}}
definitions: {stretch: "hypot(x2 - x1, y2 - y1) - 1"}
energy:
  kinetic: (x1_dot^2 + y1_dot^2)/2 + 3*(x2_dot^2 + y2_dot^2)/2
  potential: 20*stretch^2
initial: {x1: 0, y1: 0, x2: 1.2, y2: 0, x1_dot: 1, y1_dot: -1, y2_dot: 2}
simulation: {duration: 20}
"""


@pytest.mark.slow
def test_momentum_and_angular_momentum_without_outer_forces():
    found = run(FREE_PARTICLES)
    p = {k: found[f"{k}_dot"] for k in ("x1", "y1", "x2", "y2")}
    assert np.max(np.abs(p["x1"] + 3 * p["x2"] - 1.0)) < 1e-10
    assert np.max(np.abs(p["y1"] + 3 * p["y2"] - 5.0)) < 1e-10
    spin = found["x1"] * p["y1"] - found["y1"] * p["x1"]
    spin = spin + 3 * (found["x2"] * p["y2"] - found["y2"] * p["x2"])
    # Positions reach 50, where they are right to 1e-11 of that at best.
    assert np.max(np.abs(spin - spin[0])) < 1e-8
