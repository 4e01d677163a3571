"""Energies whose expression jumps, as at the cut of an angle: no error."""

from __future__ import annotations

import numpy as np
import pytest

from lagsim.studies.alarms import Energy
from tests.studies.judged import cautions
from tests.support import run

SCENE = """
parameters: {{k: {k}, X: {X}}}
coordinates: {{x: {{}}, y: {{}}}}
energy: {{kinetic: "k*(x_dot^2 + y_dot^2)/2", potential: "{potential}"}}
initial: {{x: X + 1, y: 0.1, y_dot: 1}}
simulation: {{duration: 10}}
"""
PULL = " + k*((x - X)^2 + y^2)/2"
CUT = [
    "k*0.4*atan2(y, x - X)",
    "-k*0.4*atan2(-y, x - X)",
    "k*0.4*atan2(2*y, 2*(x - X))",
    "k*0.4*(atan2(y, x - X) + 3)",
]


def told(found):
    """Give what is said of the energy."""
    return [c.text for c in cautions(found) if c.code.startswith("energy-")]


@pytest.mark.parametrize(("k", "X"), [(1.0, 0.0), (1e6, 0.0), (1e-6, 5.0)])
@pytest.mark.parametrize("potential", CUT)
def test_a_cut_is_no_energy_gained(potential, k, X):
    """Round the cut `energy` changes by k 0.4 2 pi a turn, as a multiple of it."""
    found = run(SCENE.format(k=k, X=X, potential=potential + PULL))
    steps = (found["energy"] - found["energy"][0]) / (0.8 * np.pi * k)
    assert np.max(np.abs(steps)) > 0.5
    assert steps == pytest.approx(np.round(steps), abs=1e-9)
    assert not told(found)


def test_turns_that_rows_do_not_resolve_are_jumps_of_one_size():
    """Some 6 turns from one row to the next; energy changes by whole jumps."""
    potential = "0.4*atan2(y, x)" + PULL
    text = SCENE.format(k=1, X=0, potential=potential)
    found = run(text, duration="400", output_step="40")
    steps = np.diff(found["energy"]) / (0.8 * np.pi)
    assert np.max(np.abs(steps)) > 2.5
    assert steps == pytest.approx(np.round(steps), abs=1e-7)
    assert not told(found)


STEPS = {
    # potential, and its jump at x = X from below to above
    "if(x > X, a*(x - X) + 0.3*k, 2*a*(x - X))": 0.3,
    "if(x < X, -a*(x - X), 0)": 0.0,
    "k*floor(0.5 + (x - X)/4)*0.3 + k*(x - X)^2/2": None,
    "k*(x - X)^2/2 + 0.4*k*atan(1/(x - X))": 0.4 * np.pi,
    "k*(x - X)^2/2 - 0.4*k*atan((x - X)^(-1))": -0.4 * np.pi,
}
LINE = """
parameters: {{k: {k}, X: {X}, a: -k/3}}
coordinates: {{x: {{}}{more}}}
energy: {{kinetic: "k*x_dot^2/2{kinetic}", potential: "{potential}"}}
initial: {{x: X - 1, x_dot: 0.9{starts}}}
simulation: {{duration: 5}}
"""


@pytest.mark.parametrize(("k", "X"), [(1.0, 0.0), (1e6, 3.0), (1e-6, -40.0)])
@pytest.mark.parametrize("beside", [False, True])
@pytest.mark.parametrize("potential", STEPS)
def test_a_step_of_the_potential_is_no_energy_gained(potential, k, X, beside):
    """The velocity goes on through it, and energy changes by the step."""
    words = {
        "more": ", z: {}" if beside else "",
        "kinetic": " + 1e3*k*z_dot^2/2" if beside else "",
        "starts": ", z: 0, z_dot: 1" if beside else "",
    }
    found = run(LINE.format(k=k, X=X, potential=potential, **words))
    jump = STEPS[potential]
    past = found["x"] > X
    if jump is not None:
        assert set(past.tolist()) == {False, True}
        change = found["energy"] - found["energy"][0]
        assert change == pytest.approx(np.where(past, jump * k, 0.0), abs=1e-9 * k)
    assert not told(found)


def test_a_step_that_loses_energy_beside_a_cut_it_never_meets_is_its_own():
    """An angle that is continuous on the way is no excuse for a drift."""
    text = SCENE.format(k=1, X=30, potential="0.4*atan2(y, x)" + PULL)
    found = run(text, method="euler", step="0.05")
    [text] = told(found)
    assert "error of euler" in text


def test_a_step_that_loses_energy_beside_one_that_it_passes_is_told_by_itself():
    """Euler's energy grows by (1 + h^2) a step, whatever the angle adds."""
    text = SCENE.format(k=1, X=0, potential="0.4*atan2(y, x)" + PULL)
    found = run(text, method="euler", step="0.01")
    [code] = [c.code for c in cautions(found) if c.code.startswith("energy-")]
    assert code == "energy-gained"
    [text] = told(found)
    assert "besides jumps of its expression" in text


def test_the_sides_of_an_angle_are_those_of_its_cut():
    found = run(SCENE.format(k=1, X=0, potential="atan2(y, x)"), duration="0.1")
    energy = Energy(found.equations, found.equations.energy)
    above, below = np.array([[0, -1, s, 0, 0] for s in (1e-3, -1e-3)])
    right = np.array([0, 1, 1e-3, 0, 0])
    assert energy.jump(above, below, 1e-9) == pytest.approx(-2.0 * np.pi, abs=3e-3)
    assert energy.jump(below, above, 1e-9) == pytest.approx(2.0 * np.pi, abs=3e-3)
    assert energy.jump(above, right, 1e-9) == 0.0
