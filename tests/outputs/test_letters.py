"""Names and units as pictures write them."""

from __future__ import annotations

import pytest

from lagsim.outputs.letters import Letters, raised

DOT, TWO_DOTS = "\u0307", "\u0308"


@pytest.mark.parametrize(
    ("name", "written"),
    [
        ("theta", "θ"),
        ("Omega", "Ω"),
        ("theta_dot", "θ" + DOT),
        ("theta_ddot", "θ" + TWO_DOTS),
        ("omega_1", "ω₁"),
        ("omega_1_dot", "ω" + DOT + "₁"),
        ("phi12", "φ₁₂"),
        ("x", "x"),
        ("x_dot", "x" + DOT),
        # Dots above a word would stand above its first letter.
        ("speed_dot", "speed_dot"),
        ("Qc_theta", "Qc_θ"),
        ("lambda_path", "λ_path"),
        ("friction.floor.1", "friction.floor.1"),
        ("thetas", "thetas"),
    ],
)
def test_names(name, written):
    assert Letters().name(name) == written


def test_names_that_would_look_alike_stay_apart():
    letters = Letters(["theta_1", "theta1"])
    assert [letters.name(n) for n in ("theta_1", "theta1")] == ["θ₁", "theta1"]


def test_names_in_expressions_but_no_functions():
    text = "beta*sin(alpha_dot) + beta(2) - lambda_c^2"
    expected = f"β*sin(α{DOT}) + beta(2) - λ_c^2"
    assert Letters().text(text) == expected


@pytest.mark.parametrize(
    ("unit", "written"),
    [("m/s^2", "m/s²"), ("kg m**2", "kg m²"), ("s^-1", "s⁻¹"), ("rad", "rad")],
)
def test_powers_of_units_are_raised(unit, written):
    assert raised(unit) == written
