"""Each scene where a method fails raises its alarm; no healthy one raises any."""

from __future__ import annotations

import re

import numpy as np
import pytest

import lagsim
import lagsim.codes
from lagsim.run.observers.monitors import EnergyMonitor
from tests.studies.judged import cautions, codes
from tests.support import MODELS, ROOT, run

BOUND, DAMPED = "step-at-stability-bound", "fast-mode-damped"
GAINED, LOST = "energy-gained", "energy-lost"
SINGULAR, HELD = "coordinate-singularity", "constraint-not-held"

# Scene, options, its alarms, and what one of the texts names.
FAILING = [
    ("oscillator", {"method": "euler", "step": 0.01}, [GAINED, BOUND], "`x`"),
    ("oscillator", {"method": "rk4", "step": 1.0}, [LOST, DAMPED], "`x`"),
    ("oscillator", {"method": "rk4", "step": 2.9}, [GAINED, BOUND], "below 2.3"),
    ("oscillator", {"method": "verlet", "step": 2.01}, [GAINED, BOUND], "below 1.6"),
    ("cubic-well", {"method": "verlet", "step": 3**0.5}, [GAINED, BOUND], "close to"),
    (
        "rod",
        {"formulation": "drift", "method": "rk4", "step": 0.01},
        [HELD, GAINED],
        "`rod`",
    ),
    ("relaxation", {"duration": 2}, [BOUND], "`y`"),
    ("polar-miss", {}, [SINGULAR], "`phi`"),
    ("polar-miss", {"method": "rk4", "step": 1e-4}, [GAINED, SINGULAR], "`phi`"),
    ("gimbal", {}, [SINGULAR], "`phi`"),
    ("gimbal", {"formulation": "full", "method": "dop853"}, [SINGULAR], "`phi`"),
    # Of spin and precession, which are one there, either may be told.
    ("sleeping-top", {}, [SINGULAR], "`phi`"),
    ("parallelogram", {"duration": 6}, ["nearly-dependent", "rank"], "left_x"),
    ("duplicate-row", {}, ["multipliers-not-unique", "redundant"], "twice"),
    # What asks for no alarm, since nothing fails any more.
    ("massless", {}, [], ""),
    ("pulse", {}, [], ""),
    ("square-wave", {}, [], ""),
    ("constant-speed", {}, [], ""),
    ("symmetric-start", {}, [], ""),
    ("oscillator", {}, [], ""),
    ("cubic-well", {}, [], ""),
    ("rod", {"duration": 10}, [], ""),
]


@pytest.mark.parametrize(("name", "options", "expected", "text"), FAILING)
def test_each_failing_scene_raises_its_alarm(name, options, expected, text):
    found = run(f"failing/{name}", **options)
    assert codes(found) == sorted(expected)
    assert text in " ".join(caution.text for caution in cautions(found))


def test_a_gain_that_makes_the_scene_stiff():
    options = {"formulation": "baumgarte", "duration": 0.1, "rtol": 1e-8}
    found = run("failing/rod", gain=1e4, method="dop853", **options)
    assert BOUND in codes(found)
    assert "gain 1e+04" in cautions(found)[-1].text
    options["duration"] = 5
    assert not codes(run("failing/rod", gain=30, **options))
    fixed = {"formulation": "baumgarte", "method": "rk4", "step": 0.01, "duration": 0.1}
    # RK4 on the negative axis: 2.785, so that a gain of 278 is the last.
    assert BOUND in codes(run("failing/rod", gain=290, **fixed))
    assert "is past" not in " ".join(
        c.text for c in cautions(run("failing/rod", gain=270, **fixed))
    )


def excited(duration, **options):
    text = (MODELS / "failing" / "stiff-spring.yaml").read_text(encoding="utf-8")
    changed = text.replace("value: g*cos(1)/K", "value: 1e-4")
    assert changed != text
    return run(changed, duration=duration, output_step=0.005, **options)


@pytest.mark.parametrize(
    "options",
    [
        {"method": "radau", "rtol": 1e-2},
        {"method": "generalized-alpha", "step": 1e-3, "spectral_radius": 0.5},
    ],
)
def test_a_vibration_that_a_stiff_method_damps(options):
    found = excited(3, **options)
    assert codes(found) == [LOST, DAMPED]
    first = next(c for c in cautions(found) if c.code == DAMPED)
    assert "`u`" in first.text
    assert "1e+04 per unit" in first.text
    assert found["vibration"][-1] < 0.03 * found["vibration"][0]


def test_a_vibration_that_is_resolved_raises_none():
    found = excited(0.5, rtol=1e-9)
    assert DAMPED not in codes(found)
    assert LOST not in codes(found)
    # The energy of a fast oscillation over its frequency is constant, but for terms in
    # the ratio of the frequencies, 3e-4; `vibration` leaves out terms of that order.
    assert found["vibration"][-1] == pytest.approx(found["vibration"][0], rel=0.05)


def test_generalized_alpha_without_its_damping_keeps_what_it_resolves():
    found = run(
        "failing/oscillator", method="generalized-alpha", step=0.1, spectral_radius=1,
        duration=100,
    )  # fmt: skip
    assert codes(found) == []


@pytest.mark.parametrize("path", sorted(MODELS.glob("*.yaml")), ids=lambda p: p.stem)
def test_no_healthy_model_raises_any(path):
    # The start of a run says nothing of the rows; what is slow shows within a part.
    assert codes(run(path.stem)) == []


def test_symplectic_swings_of_the_energy_are_no_drift():
    # h w = 0.5: Verlet's energy swings by h^2/4 = 6 % twice a period, for ever.
    found = run("failing/oscillator", method="verlet", step=0.5, output_step=0.5)
    energy = found["energy"]
    assert np.ptp(energy) > 0.02
    assert codes(found) == []


@pytest.mark.parametrize(
    ("balance", "gained"),
    [
        (lambda t: 1 + 0.1 * np.sin(40 * t), 0.0),
        (lambda t: 1 - 0.01 * t, -0.009),
        (lambda t: np.exp(40 * t), np.exp(40) - 1.0),
        (lambda t: 1 + 0.1 * (np.abs(t - 0.8) < 0.01), 0.0),
        (lambda t: 1 + 0.1 * (t > 0.6), 0.1),
    ],
)
def test_what_counts_as_gained(balance, gained):
    t = np.linspace(0.0, 1.0, 401)
    columns = ("t", "x", "x_dot", "x_ddot", "kinetic", "potential", "energy")
    rows = np.zeros((len(t), len(columns)))
    rows[:, 0], rows[:, 4], rows[:, 6] = t, 1.0, balance(t)
    monitor = EnergyMonitor(columns, 1)
    monitor.add(rows)
    # By medians of a tenth at either end: a straight line gains 0.9 of its change.
    assert monitor.energy_gained == pytest.approx(gained, rel=0.02, abs=1e-12)


def test_of_every_code_the_documents_say_what_it_means():
    told = (ROOT / "docs" / "failing.md").read_text(encoding="utf-8")
    said = re.findall(r"^\| `([a-z-]+)` \|", told, re.MULTILINE)
    assert set(lagsim.codes.cautions()) == set(said)


@pytest.mark.parametrize("method", ["auto", "taylor", "dop853"])
def test_rest_on_a_summit_holds_no_step(method):
    # x = 0 for ever; steps grow as they like, past 1 / |eigenvalue| = 1.
    result = lagsim.simulate(
        lagsim.load(
            "name: summit\ncoordinates: {x: {}}\n"
            "energy: {kinetic: x_dot^2/2, potential: cos(x)}\n"
            "initial: {x: 0}\nsimulation: {duration: 50, output_step: 0.5}\n"
        ),
        method=method,
    )
    assert np.all(result["x"] == 0.0)
    assert not result.warnings
