"""Positions never jump, velocities only by an impact that is accounted for."""

import math

import numpy as np
import pytest

from lagsim.program.system import Runner
from tests.run.switching.scenes import one_quick, scene
from tests.support import run

FORCES = [
    "-sign(x) - 2*sign(x_dot)",
    "-sign(x_dot + sin(3*x)) - x",
    "-abs(abs(x) - 1)*sign(x_dot) - x",
    "-sign(x^3 + x_dot^3) - 0.3*sign(x_dot)",
    "-sign(abs(x_dot) - 1)*sign(x_dot) + sin(t)",
    "1.5*sin(t) - if(not (x_dot <= 0), 1, -1) - x/(1 + abs(x/3))",
    "-floor(3*x_dot) - ceil(2*x) - x",
    "-sign(x - sin(t)) - 3*sign(x_dot)",
    "-sign(sign(x_dot) + 0.5*sign(x)) - x",
]


@pytest.mark.parametrize("force", one_quick(*FORCES))
def test_no_row_is_farther_than_forces_take_it(force):
    found = run(scene(force=force, x=0.7, v=-1.3, duration=10, output_step=0.01))
    t, x, v = found["t"], found["x"], found["x_dot"]
    steps = np.diff(t)
    largest = 10 + np.max(np.abs(x)) + 8 * np.max(np.abs(v))  # more than any has
    assert np.max(np.abs(x[1:] - x[:-1] - v[:-1] * steps) / steps**2) < largest
    assert np.max(np.abs(np.diff(v)) / steps) < largest
    assert found.drift < 1e-10
    assert found.trajectory.outcome.name == "DONE"


SLIDES = scene("x^2/2", "-0.5*sign(x_dot - 0.2)", v=1, duration=5)


def test_a_jump_ends_the_run(monkeypatch):
    before = Runner.project_sliding

    def far(self, t, y):
        before(self, t, y)
        y[0] += 1e-3 * (t > 0.0)

    monkeypatch.setattr(Runner, "project_sliding", far)
    found = run(SLIDES)
    assert found.trajectory.outcome.name == "STATE_JUMPS"
    assert found.trajectory.outcome.word == "failed"
    monkeypatch.undo()
    whole = run(SLIDES)
    assert whole.trajectory.outcome.name == "DONE"
    # The rows up to there stand.
    kept = len(found.rows) - 1
    assert np.max(np.abs(whole["x"][:kept] - found["x"][:kept])) < 1e-12


CAM = """
coordinates: {{x: {{}}, y: {{}}}}
energy: {{kinetic: (x_dot^2 + y_dot^2)/2, potential: (x - y)^2/2}}
constraints: {{drive: "x = {drive}"}}
initial: {{x: {{guess: 0}}, x_dot: {{guess: 0}}, y: 0.1}}
simulation: {{duration: 3, output_step: 0.1}}
"""
TRACK = """
coordinates: {{x: {{}}, y: {{}}}}
energy: {{kinetic: (x_dot^2 + y_dot^2)/2, potential: 0}}
constraints: {{track: "{track}"}}
initial: {{x: -1, x_dot: 1, y: 0, y_dot: {{guess: 0}}}}
simulation: {{duration: 3, output_step: 0.1}}
"""


def impacts(found):
    return [e.time for e in found.trajectory.events if e.kind == "impact"]


@pytest.mark.parametrize(
    ("text", "lost"),
    one_quick(
        # (1, 0) onto the slope 1: half of the energy.
        (TRACK.format(track="y = max(0, x)"), 0.25),
        (TRACK.format(track="y = (x + abs(x))"), 0.4),
        (TRACK.format(track="y = if(x > 0, sin(x), 0)"), 0.25),
        # The relation of velocities changes: (1, 0) onto y' = 2 x'.
        (TRACK.format(track="y_dot = x_dot*if(x < 0, 0, 2)"), 0.4),
    ),
)
def test_an_impact_stands_in_the_ledger(text, lost):
    found = run(text)
    jumps = [e.time for e in found.trajectory.events if e.kind in ("impact", "corner")]
    assert jumps == pytest.approx([1.0], abs=1e-12)
    assert found["energy"][-1] == pytest.approx(0.5 - lost, abs=1e-10)
    assert found["work"][-1] == pytest.approx(-lost, abs=1e-10)
    assert found.drift < 1e-10
    twice = np.flatnonzero(np.diff(found["t"]) == 0.0)
    assert len(twice) == 1
    assert found["x_dot"][twice[0]] == pytest.approx(1.0, abs=1e-10)
    assert found["x_dot"][twice[0] + 1] < 0.6


@pytest.mark.parametrize(
    "text",
    one_quick(
        TRACK.format(track="y = max(0, x)^2"),
        TRACK.format(track="y = x^3*sign(x) + x^3"),
        TRACK.format(track="y_dot = x_dot*max(0, x)"),
        CAM.format(drive="if(t < 1, 0, (t - 1)^2)"),
        CAM.format(drive="max(0, t - 1)^3 + sin(t)"),
        CAM.format(drive="1e-6*max(0, t - 1)^2"),
    ),
)
def test_a_rate_that_bends_is_no_impact(text):
    found = run(text)
    assert impacts(found) == []
    assert np.min(np.diff(found["t"])) > 0.0
    assert found.drift < 1e-9


@pytest.mark.slow
def test_an_impact_in_time_shows_what_was_before_it():
    text = """
coordinates: {x: {}, y: {}}
energy: {kinetic: (x_dot^2 + 2*y_dot^2)/2, potential: x^2/2}
constraints: {gear: "x_dot - y_dot = if(t < 1, 0, 0.5)"}
initial: {x: 1, y: 0}
simulation: {duration: 2, output_step: 0.25}
"""
    found = run(text)
    assert impacts(found) == [1.0]
    assert np.max(np.abs(found["residual_gear"])) < 1e-14
    before, after = np.flatnonzero(found["t"] == 1.0)
    # Together 3 x'' = -x.
    w = math.sqrt(1 / 3)
    assert found["x_dot"][before] == pytest.approx(-w * math.sin(w), abs=1e-11)
    assert found["lambda_gear"][before] == pytest.approx(2 / 3 * math.cos(w), abs=1e-10)
    # The least change in the metric of M: 0.5 is shared as 2 to 1.
    assert found["x_dot"][after] - found["x_dot"][before] == pytest.approx(1 / 3)
    assert found["y_dot"][after] - found["y_dot"][before] == pytest.approx(-1 / 6)
    assert found.drift < 1e-11


LOOSE = ("drift", "baumgarte")
ROD = """
coordinates: {x: {}, y: {}}
energy: {kinetic: (x_dot^2 + y_dot^2)/2, potential: 9.8*y}
forces: {x: "if(x > 0.3, -0.5, 0.5)"}
constraints: {rod: x^2 + y^2 = 1}
initial: {x: sin(1), y: -cos(1)}
simulation: {duration: 20, output_step: 0.1}
"""


@pytest.mark.parametrize("formulation", LOOSE)
def test_what_is_off_a_constraint_at_a_switch_is_no_impact(formulation):
    found = run(ROD, formulation=formulation, method="rk4", step=0.01)
    assert np.max(np.abs(found["residual_rod"])) > 1e-7  # there is something off
    assert [e.kind for e in found.trajectory.events].count("switch") > 10
    assert impacts(found) == []
    assert found.trajectory.outcome.complete
    assert np.min(np.diff(found["t"])) > 0.0


@pytest.mark.slow
@pytest.mark.parametrize("loops", [False, True])
@pytest.mark.parametrize("formulation", ["full", *LOOSE])
def test_an_impact_is_one_in_every_formulation(formulation, loops):
    asked = {"formulation": formulation, "loops": loops}
    found = run(TRACK.format(track="y = max(0, x)"), **asked)
    corners = [e.time for e in found.trajectory.events if e.kind == "corner"]
    assert corners == pytest.approx([1.0], abs=1e-12)
    assert found["energy"][-1] == pytest.approx(0.25, abs=1e-10)
    for moved in (0.0, 1.0):  # and where nothing has moved before
        drive = f"{moved}*sin(t) + max(0, t - 1)"
        found = run(CAM.format(drive=drive), **asked)
        times = {e.kind: e.time for e in found.trajectory.events}
        assert times == pytest.approx({"impact": 1.0, "switch": 1.0}, abs=1e-15)
        before, after = np.flatnonzero(np.abs(found["t"] - 1.0) < 1e-14)
        # It takes x from a speed to one more, at the price of the energy.
        u = moved * math.cos(1.0)
        assert found["x_dot"][[before, after]] == pytest.approx([u, u + 1], abs=1e-10)
        assert found["y_dot"][before] == pytest.approx(found["y_dot"][after], abs=1e-14)
        gained = found["work"][after] - found["work"][before]
        assert gained == pytest.approx(u + 0.5, abs=1e-10)
        assert found["x"][-1] == pytest.approx(moved * math.sin(3) + 2.0, abs=1e-10)
