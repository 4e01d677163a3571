"""Names and units as written in pictures."""

import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from lagsim.outputs.letters import (
    BELOW,
    END,
    Letters,
    mathtext,
    plain_letters,
    raised_powers,
)

DOT, TWO_DOTS = "\u0307", "\u0308"


def below(text):
    """Mark text in brackets as subscripts."""
    return text.replace("[", BELOW).replace("]", END)


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
        ("x_left", "x[left]"),
        ("x_left_dot", f"x{DOT}[left]"),
        ("omega_1_tip_beta", "ω[1,tip,β]"),
        ("speed_dot", f"speed{DOT}"),
        ("Qc_theta", "Qc[θ]"),
        ("Qc_x_left", "Qc[x,left]"),
        ("lambda_path", "λ[path]"),
        ("lambda_c12", "λ[c12]"),
        ("residual_b_x", "residual[b,x]"),
        ("friction.floor.1", "friction.floor₁"),
        ("friction.floor", "friction.floor"),
        ("impulse.rod.3", "impulse.rod₃"),
        ("reaction.q.2", "reaction.q₂"),
        ("gauss.a_x", "gauss.a[x]"),
        # Members of families, with components.
        ("q.1", "q₁"),
        ("q_dot.12", f"q{DOT}₁₂"),
        ("theta_ddot.2", f"θ{TWO_DOTS}₂"),
        ("c.1.20", "c₁,₂₀"),
        ("r.x", "r.x"),
        ("r_dot.2.x", f"r{DOT}₂.x"),
        ("d.1", "d₁"),
        ("lambda_rod.3", "λ[rod3]"),
        ("Qc_q.1", "Qc[q1]"),
        ("thetas", "thetas"),
        ("normal_force", "normal_force"),
        ("wheel_x", "wheel[x]"),
    ],
)
def test_names(name, written):
    assert Letters().name(name) == below(written)


def test_names_that_would_look_alike_stay_apart():
    letters = Letters(["theta_1", "theta1"])
    assert [letters.name(n) for n in ("theta_1", "theta1")] == ["θ₁", "theta1"]


def test_names_in_expressions_but_no_functions():
    text = "beta*sin(alpha_dot) + beta(2) - lambda_c^2"
    expected = f"β*sin(α{DOT}) + beta(2) − λ[c]^2"
    assert Letters().text(text) == below(expected)


MEMBERS = Letters(["q.1", "q.2", "r.1.x", "c.1.2", "x.1", "m.1"])


@pytest.mark.parametrize(
    ("text", "written"),
    [
        ("q(1)", "q₁"),
        ("q_dot(2)", f"q{DOT}₂"),
        ("sin(q(1)) - 2*q( 2 )", "sin(q₁) − 2*q₂"),
        ("r(1).x", "r₁.x"),
        ("r_dot(1).x", f"r{DOT}₁.x"),
        ("c(1, 2)", "c₁,₂"),
        ("x(n) - x(n-1)", "x[n] − x[n−1]"),
        ("q_ddot(n)", f"q{TWO_DOTS}[n]"),
        ("m(1)*q(1)^2", "m₁*q₁^2"),
        ("max(q(1), 2)", "max(q₁, 2)"),
        # Functions of simple arguments, also of one letter, are none of these.
        ("sin(theta)", "sin(θ)"),
        ("f(2)", "f(2)"),
    ],
)
def test_members_of_families_in_expressions(text, written):
    assert MEMBERS.text(text) == below(written)


@pytest.mark.parametrize(
    ("unit", "written"),
    [("m/s^2", "m/s²"), ("kg m**2", "kg m²"), ("s^-1", "s⁻¹"), ("rad", "rad")],
)
def test_powers_of_units_are_raised(unit, written):
    assert raised_powers(unit) == written


@pytest.mark.parametrize(
    ("text", "drawn"),
    [
        ("x_left 10%, θ₁ (m)", "x_left 10%, θ₁ (m)"),
        (f"x{DOT}₁ for 3 $", f"x{DOT}₁ for 3 \\$"),
        ("λ[b,x] (N)", r"λ$_\mathrm{b,x}$ (N)"),
        (f"x{DOT}[left]", r"$\dot{\mathrm{x}}$$_\mathrm{left}$"),
        (f"a_speed{DOT}", r"$\dot{\mathrm{a\_speed}}$"),
        (f"speed{TWO_DOTS} $", r"$\ddot{\mathrm{speed}}$ \$"),
        # Of a title, which may hold what it likes.
        ("[$x{a}] $x$ [", r"\$x{a} \$x\$ "),
    ],
)
def test_only_names_are_formulas(text, drawn):
    assert mathtext(below(text)) == drawn
    figure = Figure()
    figure.text(0, 0, drawn)
    FigureCanvasAgg(figure).draw()


def test_what_is_cut_has_no_subscripts():
    assert plain_letters(below("λ[b,x] (N)")) == "λ_b,x (N)"
