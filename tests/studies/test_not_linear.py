"""Warnings of modes about rests at which the motion is not linear."""

import numpy as np
import pytest

import lagsim

# A mass on springs k along x and 9 m along y, whose rest is (a, 0); lengths are in
# units of 1/c metres, so that forces of the file are times c.
SCENE = """
coordinates: {{x: {{}}, y: {{}}}}
parameters: {{k: 4, a: {a}, c: {c}}}
tables: {{bent: {{points: [[-1, -2], [0, 0], [1, 1]], outside: extend}},
         flat: {{points: [[-1, -1], [0, 0], [1, 1]], outside: extend}}}}
definitions: {{u: (x - a)/c, w: y/c, up: x_dot/c, b: bent(u), f: flat(u)}}
energy: {{kinetic: (x_dot^2 + y_dot^2)/2, potential: k*(x - a)^2/2 + 9*y^2/2}}
initial: {{x: a, y: 0}}
"""
UNITS = [(0, 1), (0, 1000), (1e5, 1), (-37.3, 1e-3)]


def scene(more: str, a: float = 0.0, c: float = 1.0) -> str:
    text = SCENE.format(a=a, c=c) + more
    return text.replace("y: 0}", "y: 0, s: 0}") if "states:" in more else text


def warned(text: str, at: str = "rest") -> list[str]:
    record = lagsim.modes(lagsim.load(text), at=at).record
    own = [x for x in record.get("warnings", []) if x["code"] == "not-linear"]
    return [x["text"] for x in own]


def rates(text: str) -> np.ndarray:
    found = lagsim.modes(lagsim.load(text)).modes
    return np.array([2.0 * np.pi * x["frequency"] for x in found])


# force or constraint, and parts of the text of its warning.
SWITCHED = [
    ("forces: {x: -3*c*max(u, 0)}", "max(", "side on which"),
    ("forces: {x: 3*c*min(u, 0)}", "min(", "side on which"),
    ("forces: {x: -c*abs(u)}", "abs(", "neither side"),
    ("forces: {x: -c*sign(up)}", "sign(", "neither side"),
    ("forces: {x: -c*up*heaviside(u)}", "heaviside(", "side on which"),
    ("forces: {x: 'if(u > 0, -3*c*u, -c*u)'}", "if(", "side on which"),
    ("forces: {x: -c*bent(u)}", "bent(", "its argument is"),
    ("forces: {y: -3*c*max(w, 0)}", "max(", "side on which"),
    ("states: {s: {rate: 'if(u > 0, u, 2*u) - s'}}", "if(", "side on which"),
    ("forces: {x: 'if(u > 0 and w > 0, -c*u, 0)'}", "if(", "side on which"),
]
SMOOTH = [
    "forces: {x: -c*abs(u)*u}",
    "forces: {x: -c*u*max(u, 0)}",
    "forces: {x: -3*c*max(u - 0.5, 0)}",
    "forces: {x: -3*c*max(u + 0.5, 0)}",
    "forces: {x: -c*abs(up)*up}",
    "forces: {x: -c*flat(u)}",
    "forces: {x: -c*max(abs(u) - 0.1, 0)}",
    "forces: {x: 'if(u > 0, -3*c*u, -3*c*u)'}",
    "forces: {x: -c*max(u, 0) - c*min(u, 0)}",
    # A row holds x on the surface.
    "forces: {x: -3*c*max(u, 0)}\nconstraints: {held: x = a}",
]


@pytest.mark.parametrize("units", UNITS)
@pytest.mark.parametrize("case", SWITCHED)
def test_a_switch_at_its_level_is_named(case, units):
    force, *parts = case
    for text in (said := warned(scene(force, *units))):
        assert all(part in text for part in parts), text
    assert len(said) == 1 + (" and " in force)


@pytest.mark.parametrize("units", UNITS)
@pytest.mark.parametrize("force", SMOOTH)
def test_where_both_sides_have_equal_slopes_nothing_is_said(force, units):
    assert not warned(scene(force, *units))


def test_the_modes_belong_to_the_side_that_is_named():
    # Stiffness 4 below and 7 above.
    text = scene("forces: {x: -3*max(x, 0)}")
    (said,) = warned(text)
    side = 7.0 if "positive" in said else 4.0
    np.testing.assert_allclose(np.sort(rates(text)), np.sort([side**0.5, 3.0]), 1e-9)


LAWS = [
    ("floor: {relation: y >= 0, restitution: 0}", "contact `floor`"),
    ("roof: {relation: y <= 0, restitution: 0.5}", "contact `roof`"),
    ("floor: {relation: y >= 0, restitution: 0, friction: 0.3, slip: x_dot}", "floor"),
    ("wheel: y_dot >= x_dot", "`wheel`"),
    ("drag: {relation: x_dot = 0, limit: 0}", "`drag`"),
    ("drag: {relation: x_dot = 0, limit: 2*c}", "`drag`"),
]


@pytest.mark.parametrize("units", UNITS)
@pytest.mark.parametrize("law", LAWS)
def test_a_law_at_its_bound_is_named(law, units):
    law, part = law
    force = "forces: {x: 2*c}\n" if "2*c" in law else ""
    (text,) = warned(scene(f"{force}constraints: {{{law}}}", *units))
    assert part in text, text


FLOOR = """
forces: {y: -9*c, x: 2*c}
constraints: {floor: {relation: y >= 0, restitution: 0, friction: 0.3, slip: x_dot}}
"""


@pytest.mark.parametrize("units", UNITS)
@pytest.mark.parametrize(
    "more",
    [
        "forces: {y: -9*c}\nconstraints: {floor: {relation: y >= 0, restitution: 0}}",
        FLOOR,
        "forces: {x: 1*c}\nconstraints: {drag: {relation: x_dot = 0, limit: 2*c}}",
        "constraints: {drag: {relation: x_dot = 0, limit: 2*c}}",
        "constraints: {floor: {relation: y >= -c, restitution: 0}}",
        "constraints: {on: y = 0, floor: {relation: y >= 0, restitution: 0}}",
    ],
)
def test_of_laws_inside_of_their_bounds_nothing_is_said(more, units):
    assert not warned(scene(more, *units))


@pytest.mark.slow
def test_of_several_rests_the_warning_names_one():
    # Rests at x = -1, 0, 1 and, from (x - 1)*(5*x - 1)*x = 0, at 1/5.
    found = lagsim.equilibrium("""
coordinates: {x: {}}
energy: {kinetic: x_dot^2/2, potential: x^4/4 - x^2/2 + max(x, 0)^2*(x - 1)^2}
initial: {x: 0}
""")
    own = [x for x in found.record["warnings"] if x["code"] == "not-linear"]
    (number,) = (
        k
        for k, x in enumerate(found.equilibria, 1)
        if abs(x["coordinates"]["x"]) < 1e-9
    )
    assert len(found.equilibria) == 4
    assert [x["text"].split(":")[0] for x in own] == [f"equilibrium {number}"]
