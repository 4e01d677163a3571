"""Systems as textbooks have them, conserved quantities included."""

import pytest
import sympy as sp

from lagsim.show.text import as_text
from tests.show.cases import content_of, kept, s, small

sin, cos = sp.sin, sp.cos


def same(found, expected):
    return bool(sp.simplify(sp.expand(found - expected)) == 0)


def energy(kinetic, potential):
    return (), "energy", kinetic + potential, ""


SPIN = s.psi_dot + s.phi_dot * cos(s.theta)
# Shipped models: what each is kept of, of what kind, its value, and its name in the
# file. The equations themselves are those of sympy, see `test_oracle`.
KEPT = {
    # Goldstein, Classical Mechanics, section 5.7.
    "heavy-top": [
        (("phi",), "momentum",
         s.I1 * s.phi_dot * sin(s.theta) ** 2 + s.I3 * SPIN * cos(s.theta), "p_phi"),
        (("psi",), "momentum", s.I3 * SPIN, "p_psi"),
        energy(
            s.I1 * (s.theta_dot**2 + s.phi_dot**2 * sin(s.theta) ** 2) / 2
            + s.I3 * SPIN**2 / 2,
            s.m * s.g * s.l * cos(s.theta),
        ),
    ],
    "kepler": [
        (("x", "y"), "angular momentum", s.x * s.y_dot - s.y * s.x_dot,
         "angular_momentum"),
        energy((s.x_dot**2 + s.y_dot**2) / 2, -s.mu / s.r),
    ],
}  # fmt: skip


@pytest.mark.parametrize("name", KEPT)
def test_what_is_conserved(name):
    found = kept(content_of(name))
    assert found.keys() == {of for of, *_ in KEPT[name]}
    for of, kind, value, called in KEPT[name]:
        assert found[of]["kind"] == kind
        assert same(found[of]["expression"], value)
        assert (found[of]["definition"] or "") == called


def test_a_double_pendulum_reads_as_in_textbooks():
    # With the masses together and the angles' difference.
    assert (
        "(m₁ + m₂) l₁² θ̈₁ + m₂ l₁ l₂ θ̈₂ cos(θ₁ − θ₂) + m₂ l₁ l₂ θ̇₂² sin(θ₁ − θ₂)"
        " + (m₁ + m₂) g l₁ sin(θ₁) = 0"
    ) in " ".join(as_text(content_of("double-pendulum")).split())


TWO_BODIES = """
parameters: {m1: 2, m2: 3, k: 5}
coordinates: {x1: {}, y1: {}, x2: {}, y2: {}}
definitions: {r: "hypot(x1 - x2, y1 - y2)"}
energy:
  kinetic: m1*(x1_dot^2 + y1_dot^2)/2 + m2*(x2_dot^2 + y2_dot^2)/2
  potential: -k/r
initial: {x1: 0, y1: 0, x2: 1, y2: 0}
"""


def test_two_bodies_keep_their_momenta():
    found = {of: k["expression"] for of, k in kept(small(TWO_BODIES)).items()}
    assert same(found["x1", "x2"], s.m1 * s.x1_dot + s.m2 * s.x2_dot)
    assert same(found["y1", "y2"], s.m1 * s.y1_dot + s.m2 * s.y2_dot)
    turning = found["x1", "y1", "x2", "y2"]
    expected = s.m1 * (s.x1 * s.y1_dot - s.y1 * s.x1_dot)
    expected += s.m2 * (s.x2 * s.y2_dot - s.y2 * s.x2_dot)
    assert same(turning, expected)
    assert len(found) == 4  # with the energy


def test_a_potential_of_an_angle_in_cartesian_coordinates_keeps_a_screw():
    # Turned by an angle about z and shifted by it along z, V is what it was.
    text = (
        TWO_BODIES.partition("definitions")[0]
        + """
energy:
  kinetic: m1*(x1_dot^2 + y1_dot^2)/2 + m2*x2_dot^2/2 + y2_dot^2/2
  potential: k*cos(x2 - atan2(y1, x1)) + y2^2
initial: {x1: 1, y1: 0, x2: 1, y2: 0}
"""
    )
    found = {of: k["expression"] for of, k in kept(small(text)).items()}
    turned = s.m1 * (s.x1 * s.y1_dot - s.y1 * s.x1_dot)
    assert same(found["x1", "y1", "x2"], turned + s.m2 * s.x2_dot)
    assert len(found) == 2  # with the energy


@pytest.mark.slow
def test_what_acts_on_a_quantity_keeps_it_from_being_conserved():
    turned = TWO_BODIES + "forces: {x1: k*t}\n"
    assert kept(small(turned)).keys() == {("y1", "y2")}
    held = TWO_BODIES + "constraints: {line: y1 = k*x1}\n"
    assert kept(small(held)).keys() == {()}
    # Free only by the numbers of the file: equal stiffnesses are no symmetry.
    oval = TWO_BODIES.replace("-k/r", "k*x1^2 + m1*y1^2 - k/r").replace("k: 5", "k: 2")
    assert kept(small(oval)).keys() == {()}


# Two bodies whose numbers are literals: masses, and their attraction.
ATTRACTED = """
coordinates: {{x1: {{}}, y1: {{}}, x2: {{}}, y2: {{}}, u: {{}}, w: {{}}}}
energy:
  kinetic: >
    {m1}*(x1_dot^2 + y1_dot^2)/2 + {m2}*(x2_dot^2 + y2_dot^2)/2
    + {beside}*(u_dot^2 + w_dot^2)/2
  potential: -{k}/hypot(x1 - x2, y1 - y2) {more}
initial: {{x1: 0, y1: 0, x2: 1, y2: 0, u: 0, w: 1}}
"""
SUN_AND_EARTH = {"m1": "1.98847e30", "m2": "5.9722e24", "k": "7.926e44"}
PROTON_AND_ELECTRON = {"m1": "1.6726e-27", "m2": "9.1094e-31", "k": "2.3071e-28"}
MOMENTA = {(), ("x1", "x2"), ("y1", "y2"), ("x1", "y1", "x2", "y2")}


@pytest.mark.parametrize("bodies", [SUN_AND_EARTH, PROTON_AND_ELECTRON])
@pytest.mark.parametrize("beside", ["1e-30", "1", "1e40"])
@pytest.mark.parametrize("scale", ["1e-25", "1", "1e35"])
def test_symmetries_in_any_units(bodies, beside, scale):
    # Of six coordinates: the bodies' momenta, and those that a spring leaves the two
    # bystanders. Turns of u and w keep T; a spring between them has no such turn.
    more = f"+ {scale}*(u - w)^2"
    text = ATTRACTED.format(beside=beside, more=more, **bodies)
    found = small(text).document["conserved"]
    assert {tuple(k["of"]) for k in found} == {*MOMENTA, ("u", "w")}
    assert sum(k["kind"] == "angular momentum" for k in found) == 1
    assert len(found) == 5


@pytest.mark.parametrize("bodies", [SUN_AND_EARTH, PROTON_AND_ELECTRON])
@pytest.mark.parametrize("field", ["1e-20", "1", "1e20"])
def test_a_weak_or_strong_field_breaks_a_symmetry(bodies, field):
    text = ATTRACTED.format(beside="1", more=f"+ {field}*x1 + u^2 + 3*w^4", **bodies)
    assert kept(small(text)).keys() == {(), ("y1", "y2")}


FACTORED = """
coordinates: {{x: {{}}, y: {{}}}}
energy: {{kinetic: "{kinetic}", potential: "{potential}"}}
initial: {{x: 1, y: 1}}
"""
FREE = "(x_dot^2 + y_dot^2)/2"
ROUND = [
    "{f}*(x^2 + y^2)",
    "-(x^2 + y^2)*{f}/7",
    "{f}/hypot(x, y)",
    "{f}*exp(-x^2 - y^2)",
    "3*(2*{f})*(x^2 + y^2) + x^2 + y^2",
]


def kinds(text):
    return {k["kind"] for k in small(text).document["conserved"]}


@pytest.mark.parametrize(
    ("potential", "kind"),
    [
        ("3*0.1*x^2 + 0.3*y^2", "angular momentum"),
        ("(0.1 + 0.2)*x^2 + 0.3*y^2", "angular momentum"),
        ("3*0.1*x - 0.3*y", "total momentum"),
    ],
)
def test_rounding_of_numbers_breaks_no_symmetry(potential, kind):
    assert kind in kinds(FACTORED.format(kinetic=FREE, potential=potential))


def turns(factor, potential):
    """Return the conserved quantities with a factor in V, or in T."""
    found = []
    for kinetic, V in (
        (FREE, potential.format(f=factor)),
        (f"{factor}*{FREE}", "x^2 + y^2"),
    ):
        text = FACTORED.format(kinetic=kinetic, potential=V)
        found.append(kinds(text))
    return found


@pytest.mark.parametrize("potential", ROUND)
@pytest.mark.parametrize(
    "factor",
    [
        "(1 + 1e-14*x)",
        "(1 - y*1e-11)",
        "(1e14 + x)",
        "(1e20*2 - 3*y)/5",
        "(x/1e13 - 1)",
    ],
)
def test_a_weak_term_in_a_factor_breaks_a_symmetry(potential, factor):
    for found in turns(factor, potential):
        assert "angular momentum" not in found


@pytest.mark.parametrize("weak", ["0", "1e-7", "1e-10", "1e-13"])
@pytest.mark.parametrize(
    ("kind", "potential"),
    [
        ("angular momentum", "cos(x^2 + y^2 + {weak}*x)"),
        ("angular momentum", "-1/sqrt(x^2 + y^2 + {weak}*x*y)"),
        ("total momentum", "sin(x - y + {weak}*y)"),
        ("total momentum", "1e9*(x - y)^4 - exp(-(x - y + {weak}*y)^2)"),
    ],
)
def test_a_weak_term_in_a_function_breaks_a_symmetry(potential, kind, weak):
    text = FACTORED.format(kinetic=FREE, potential=potential.format(weak=weak))
    assert (kind in kinds(text)) is (weak == "0")


@pytest.mark.parametrize("potential", ROUND)
@pytest.mark.parametrize(
    "factor", ["(1 + 1e-14*(x^2 + y^2))", "(1e9 + x^2 + y^2)", "((x^2 + y^2)/1e13 - 1)"]
)
def test_a_weak_term_that_is_round_breaks_none(potential, factor):
    for found in turns(factor, potential):
        assert "angular momentum" in found
