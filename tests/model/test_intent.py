"""A hint names what was likely meant: spellings of elsewhere, keys in a wrong place."""

from __future__ import annotations

import pytest

from tests.model._files import problems

SCENE = """\
parameters: {{m: 1, l: {parameter}}}
coordinates: {{theta: {{}}, x: {{}}}}
definitions: {{height: l*cos(theta), seen: "{definition}"}}
energy: {{kinetic: m*(theta_dot^2 + x_dot^2)/2, potential: 0}}
initial: {{theta: {initial}, x: 0}}
simulation: {{duration: {duration}}}
"""
SOUND = {"parameter": "1", "definition": "x", "initial": "0", "duration": "1"}
HINTS = [
    ("parameter", "1 m", "{value: 1, unit: m}"),
    ("parameter", "9.81 m/s^2", "{value: 9.81, unit: m/s^2}"),
    ("parameter", "25.6 N/m", "{value: 25.6, unit: N/m}"),
    ("duration", "10 s", "write 10"),
    ("initial", "30 deg", "30*pi/180"),
    ("initial", "-30 deg", "30*pi/180"),
    ("initial", "30°", "30*pi/180"),
    ("initial", "2π", "2*pi"),
    ("parameter", "π/2", "pi"),
    ("parameter", "2 pi", "write `*`"),
    ("definition", "2 m", "a product is written 2*m"),
    ("definition", "3 x", "write `*`"),
    ("definition", "sin theta", "sin(theta)"),
    ("definition", "l*cos 2", "cos(2)"),
    ("definition", "sin^2(x)", "sin(x)^2"),
    ("definition", "cos**2(x + l)", "cos(x + l)^2"),
    ("definition", "sin^2 x", "sin(x)^2"),
    ("definition", "ln(x)", "log(x)"),
    ("definition", "arctan2(x, l)", "atan2(y, x)"),
    ("definition", "np.sin(x)", "write `sin`"),
    ("definition", "2*math.pi", "write `pi`"),
    ("definition", "e^x", "exp(x)"),
    ("definition", "|x|", "abs(x)"),
    ("definition", "√x", "sqrt(x)"),
    ("definition", "dtheta", "theta_dot"),
    ("definition", "xdot", "x_dot"),
    ("definition", "theta_dt", "theta_dot"),
    ("definition", "thetadot", "theta_dot"),
    ("definition", "dx_dt", "x_dot"),
    ("definition", "ẋ", "x_dot"),
    ("definition", "theta'", "theta_dot"),
    ("definition", "diff(theta, t)", "theta_dot"),
    ("definition", "dheight", "height_dot"),
    ("definition", "xddot", "x_ddot"),
    ("definition", "ddtheta", "theta_ddot"),
    ("definition", "ẍ", "x_ddot"),
]  # fmt: skip


@pytest.mark.parametrize(("where", "text", "meant"), HINTS)
def test_a_hint_names_what_was_meant(where, text, meant):
    [problem] = problems(SCENE.format(**{**SOUND, where: text}))
    assert meant in problem.hint


@pytest.mark.parametrize("key", ["dtheta", "thetadot", "theta_dt"])
def test_a_rate_in_initial(key):
    text = SCENE.format(**SOUND).replace("initial: {", f"initial: {{{key}: 1, ")
    [problem] = problems(text)
    assert problem.hint == "did you mean `theta_dot`?"


@pytest.mark.parametrize(
    ("text", "hint"),
    [
        ("lagrangian: x", "`lagrangian` stands below `energy:`, indented"),
        ("kinetic: x", "`kinetic` stands below `energy:`, indented"),
        ("output_step: 1", "`output_step` stands below `simulation:`, indented"),
        ("points: {a: [x, y]}", "`points` stands below `scene:`, indented"),
        ("plots: []", "`plots` stands below `output:`, indented"),
        ("simulation: {initial: {x: 0}}", "`initial` stands at the top of the file"),
        ("parameters: {forces: {x: 1}}", "`forces` stands at the top of the file"),
        ("initial: {x: 0, y: 0, scene: 1}", "`scene` stands at the top of the file"),
        ("scene: {columns: [x]}", "`columns` stands below `output:`, indented"),
    ],
)
def test_a_key_in_a_wrong_place(text, hint):
    assert any(problem.hint.startswith(hint) for problem in problems(text))
