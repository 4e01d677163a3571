"""Names and units as pictures write them."""

import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from lagsim.outputs.letters import BELOW, END, Letters, mathtext, plain, raised

DOT, TWO_DOTS = "\u0307", "\u0308"


def below(text):
    """Mark as subscripts what stands in brackets."""
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
        ("friction.floor.1", "friction.floor.1"),
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


@pytest.mark.parametrize(
    ("unit", "written"),
    [("m/s^2", "m/s²"), ("kg m**2", "kg m²"), ("s^-1", "s⁻¹"), ("rad", "rad")],
)
def test_powers_of_units_are_raised(unit, written):
    assert raised(unit) == written


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
    assert plain(below("λ[b,x] (N)")) == "λ_b,x (N)"
