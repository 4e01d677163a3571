"""Bodies on a sheet w = f(x, z) with nested kinks, kicked at the kinks or passing them.

On the piece with the gradient g an impulse P = (P_x, P_z, P_w) leads to the velocity v
of (M + m_w g g^T) v = (P_x, P_z) + P_w g, if v points into this piece: f(v) = g.v. A
body that passes has its momentum before as P.
"""

import numpy as np
import pytest

import lagsim

MASSES = (0.75, 1.25, 0.5)
# The sheet, the gradient of a piece, and an impulse that leads onto this piece.
KICKS = [
    ("abs(x - abs(z))", (1, -1), (1, 1, 0)),
    ("abs(x - abs(z))", (-1, 1), (-0.5, 0.75, 0.25)),
    ("abs(x - abs(z))", (-1, -1), (-0.5, -0.75, 0)),
    ("0.5*abs(abs(x) - 0.5*z)", (-0.5, -0.25), (-1, 0.25, 0)),
    ("0.5*abs(abs(x) - 0.5*z)", (-0.5, 0.25), (0.125, 1, 0)),
    ("max(x, 0.5*abs(z))", (0, 0.5), (-1, 0.5, 0)),
    ("max(x, 0.5*abs(z))", (1, 0), (1, 0.25, 0)),
    ("0.75*min(abs(x), 0.5*abs(z))", (0, 0.375), (1, 0.25, 0)),
    ("0.75*min(abs(x), 0.5*abs(z))", (-0.75, 0), (-0.25, -1, 0)),
    ("0.5*abs(x) + 0.25*abs(z)", (0.5, -0.25), (1, -0.5, 0.25)),
    ("0.5*abs(x + z) + 0.25*abs(x - z)", (0.25, 0.75), (0.25, 1, 0)),
    ("abs(x + 0.5*max(z, 0))", (-1, -0.5), (-1, 0.5, 0)),
    ("abs(x + 0.5*max(z, 0))", (1, 0), (0.5, -1, 0)),
    ("max(0, abs(x) + 0.5*z)", (-1, 0.5), (-1, 0.25, 0)),
    ("max(0, abs(x) + 0.5*z)", (0, 0), (0.125, -1, 0)),
]


@pytest.mark.parametrize(("sheet", "gradient", "kick"), KICKS)
@pytest.mark.parametrize("far", [(0.0, 0.0), (2.5, -1e4)])
@pytest.mark.parametrize("order", [1, -1])
def test_a_kick_leads_onto_a_piece_of_nested_kinks(order, far, sheet, gradient, kick):
    x, z, w = MASSES
    g = np.array(gradient, dtype=float)
    v = np.linalg.solve(np.diag([x, z]) + w * np.outer(g, g), kick[:2] + kick[2] * g)
    kinks = {"abs": abs, "max": max, "min": min, "x": v[0], "z": v[1]}
    on = eval(sheet, kinks)  # noqa: S307
    assert on == pytest.approx(g @ v, abs=1e-12)  # v is on the piece
    for name, place in zip("xz", far, strict=True):
        if place:
            sheet = sheet.replace("max", "M").replace(name, f"({name} - {place})")
            sheet = sheet.replace("M", "max")
    names = ["x: {}", "z: {}", "w: {}", "s: {}"]
    text = f"""
coordinates: {{{", ".join(names[::order])}}}
energy: {{kinetic: ({x}*x_dot^2 + {z}*z_dot^2 + {w}*w_dot^2 + s_dot^2)/2, potential: 0}}
constraints: {{sheet: "w = {sheet}"}}
events:
  kick: {{at: s = 0, impulse: {{x: {kick[0]}, z: {kick[1]}, w: {kick[2]}}}}}
initial:
  {{x: {far[0]}, x_dot: 0, z: {far[1]}, z_dot: 0, w: {{guess: 0}}, w_dot: {{guess: 0}},
  s: -1, s_dot: 1}}
simulation: {{duration: 1.25, output_step: 0.25}}
"""
    found = lagsim.simulate(text, error_bar="never")
    assert found.outcome == "done", found.reason
    got = [found["x_dot"][-1], found["z_dot"][-1], found["w_dot"][-1]]
    assert got == pytest.approx([*v, g @ v], abs=1e-9)


# The sheet, the gradient of the piece onto which a velocity leads, and the velocity.
PASSED = [
    ("0.5*abs(abs(x) - 0.5*z)", (-0.5, -0.25), (-1, 0.25)),
    ("max(x, abs(z))", (0, 1), (-0.7, 0.93)),
    ("0.5*abs(x) + 0.25*abs(z)", (0.5, -0.25), (1, -0.5)),
    ("0.25*abs(x + z) + 0.25*abs(x - z)", (0, 0.5), (0.25, 1)),
    ("0.5*abs(x + 0.5*max(z, 0))", (0.5, 0.25), (1, 0.5)),
]


@pytest.mark.slow
@pytest.mark.parametrize(("sheet", "gradient", "speed"), PASSED)
@pytest.mark.parametrize("order", [1, -1])
@pytest.mark.parametrize("unit", [1.0, 1000.0])
def test_a_body_passes_a_place_of_nested_kinks(unit, order, sheet, gradient, speed):
    x, z, w = MASSES
    g, before = np.array(gradient, dtype=float), np.array(speed)
    kinks = {"abs": abs, "max": max, "min": min}
    start = eval(sheet, {**kinks, "x": -before[0], "z": -before[1]})  # noqa: S307
    P = np.array([x, z]) * before - w * start * g
    v = np.linalg.solve(np.diag([x, z]) + w * np.outer(g, g), P)
    on = eval(sheet, {**kinks, "x": v[0], "z": v[1]})  # noqa: S307
    assert on == pytest.approx(g @ v, abs=1e-12)  # v is on the piece
    a, b = (unit * float(each) for each in before)
    names = ["x: {}", "z: {}", "w: {}"]
    text = f"""
coordinates: {{{", ".join(names[::order])}}}
energy: {{kinetic: ({x}*x_dot^2 + {z}*z_dot^2 + {w}*w_dot^2)/2, potential: 0}}
constraints: {{sheet: "w = {sheet}"}}
initial:
  {{x: {-a}, x_dot: {a}, z: {-b}, z_dot: {b},
  w: {{guess: {start * unit}}}, w_dot: {{guess: {-start * unit}}}}}
simulation: {{duration: 1.25, output_step: 0.25}}
"""
    found = lagsim.simulate(text, error_bar="never")
    assert found.outcome == "done", found.reason
    got = [found["x_dot"][-1], found["z_dot"][-1], found["w_dot"][-1]]
    assert got == pytest.approx(unit * np.array([*v, g @ v]), abs=1e-9 * unit)
