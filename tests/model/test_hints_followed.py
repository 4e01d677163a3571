"""A hint that is followed to the letter gives a file that `check` accepts.

Each case is a text with one mistake. What its hint says to write is put in its place by
a rule, not by hand; then the file must have no fault, an admissible start, and the
value that was meant.
"""

from __future__ import annotations

import math
import re

import pytest

from lagsim.admissibility.examination import examine
from lagsim.errors import InputError
from lagsim.language.evaluate import evaluate
from lagsim.mechanics.equations import derive
from lagsim.model.reader import hints, read
from tests.model._files import problems

MODEL = """\
parameters:
  m: 2
  l: 3
  k: {parameter}
coordinates: {{theta: {{}}, x: {{}}}}
definitions:
  height: l*cos(theta)
  seen: {definition}
energy:
  kinetic: m*(theta_dot^2 + x_dot^2)/2
  potential: {energy}
constraints: {{hold: "{relation}"}}
initial:
  theta: {initial}
  x: 0
  theta_dot: {rate}
simulation:
  duration: {duration}
"""
SOUND = {
    "parameter": "1", "definition": "x", "energy": "0", "relation": "x_dot = 0",
    "initial": "0.5", "rate": "0", "duration": "1",
}  # fmt: skip
AT = {
    "m": 2.0, "l": 3.0, "k": 1.0, "t": 2.0, "theta": 0.7, "x": 0.3, "theta_dot": -0.4,
    "x_dot": 1.1, "theta_ddot": 0.6, "x_ddot": 0.9,
}  # fmt: skip
X, L, T, PI = AT["x"], AT["l"], AT["theta"], math.pi

# What a hint says to write, in the order in which these are looked for.
SAYS = [
    r"write (`[^`]+` and `[^`]+`)",
    r"quote (?:the value|the expression): (\".*\")",
    r"write (\{[^}]*\}\}|\{\}|\{[^{}]*(?:\{\}[^{}]*)*\})",
    r"(?:write|with) `\*`, (\S+)$",
    r"(?:write|missing:|after the colon:) `([^`]+)`",
    r"leave `[^`]+` out()",
    r"write (\[.*\])",
    r"write if\((.*)\)$",
    r"write (.+?)(?:: [a-z].*|, (?:in|without|or|and) .*|; .*| for .*|)$",
    r"is written (?:`([^`]+)`|(.+))$",
    r"did you mean `([^`]+)`",
    r"the time is `(t)`",
    r"delete it()",
]


def said(hint):
    """Give what a hint says to write."""
    for pattern in SAYS:
        if found := re.search(pattern, hint):
            text = next((g for g in found.groups() if g is not None), "")
            text = "\n  ".join(re.findall("`([^`]+)`", text)) or text
            return f"if({text})" if r"write if\(" in pattern else text
    raise AssertionError(f"this says nothing to write: {hint}")


# Where, the text, the part of it that is replaced ("" for all of it), the value meant.
CASES = [
    # numbers and units
    ("rate", "3000 1/min", "", 100 * PI),
    ("rate", "3000/min", "", 100 * PI),
    ("rate", "3000 min^-1", "", 100 * PI),
    ("rate", "3000 U/min", "", 100 * PI),
    ("rate", "-20 rpm", "", -20 * 2 * PI / 60),
    ("initial", "1,2e-3", "", 1.2e-3),
    ("initial", "−0.5", "−", -0.5),
    ("initial", "np.deg2rad(60)", "", PI / 3),
    ("parameter", "5 Ns/m", "", 5.0),
    ("parameter", "5 inches", "", 0.127),
    ("parameter", "6.67e-11 m^3/(kg s^2)", "", 6.67e-11),
    ("parameter", "2.5 kg·m²", "", 2.5),
    ("parameter", "[5 kg]", "", 5.0),
    ("parameter", "{val: 5}", "val", 5.0),
    ("parameter", "1d3", "", 1000.0),
    ("parameter", "1.5D-2", "", 0.015),
    ("parameter", "9.81 m s^-2", "", 9.81),
    ("rate", "1500 rpm", "", 1500 * 2 * PI / 60),
    ("rate", "1500rpm", "", 1500 * 2 * PI / 60),
    ("rate", "{value: 1500, unit: rpm}", "", 1500 * 2 * PI / 60),
    ("rate", "30 deg/s", "", PI / 6),
    ("rate", "30°/s", "", PI / 6),
    ("rate", "2 Hz", "", 4 * PI),
    ("rate", "5 rad/s", "", 5.0),
    ("rate", "18 km/h", "", 5.0),
    ("initial", "30°", "", PI / 6),
    ("initial", "-30 degrees", "", -PI / 6),
    ("initial", "0.5 turns", "", PI),
    ("initial", "50 grad", "", PI / 4),
    ("initial", "{value: 1, unit: rad}", "", 1.0),
    ("initial", "{value: 30, unit: deg}", "", PI / 6),
    ("initial", "[1]", "", 1.0),
    ("initial", "1 rad", "", 1.0),
    ("initial", "pi/6 rad", "", PI / 6),
    ("initial", "deg(30)", "", PI / 6),
    ("initial", "radians(30)", "", PI / 6),
    ("initial", "3π/4", "3π", 3 * PI / 4),
    ("initial", "2 pi", "2 pi", 2 * PI),
    ("initial", "½", "", 0.5),
    ("initial", "3e", "", 3.0),
    ("duration", "2 s", "", 2.0),
    ("duration", "{value: 2, unit: s}", "", 2.0),
    ("duration", "[2]", "", 2.0),
    ("duration", "2 min", "", 120.0),
    ("duration", "500 ms", "", 0.5),
    ("duration", "1,000.5", "", 1000.5),
    ("duration", "1.000,5", "", 1000.5),
    ("duration", "1 000.5", "", 1000.5),
    ("duration", "1'000", "", 1000.0),
    ("duration", "1_000", "", 1000.0),
    ("duration", "2,5", "", 2.5),
    ("duration", "2;", ";", 2.0),
    ("duration", "2,", ",", 2.0),
    ("parameter", "5 kg", "", 5.0),
    ("parameter", "5kg*m^2", "", 5.0),
    ("parameter", "9.81 m/s²", "", 9.81),
    ("parameter", "9.81 m/s**2", "", 9.81),
    ("parameter", "1 [m]", "", 1.0),
    ("parameter", "[1, m]", "", 1.0),
    ("parameter", "{value: 7 kg}", "7 kg", 7.0),
    ("parameter", "1/2 kg", "", 0.5),
    ("parameter", "10 cm", "", 0.1),
    ("parameter", "3 kN/m", "", 3000.0),
    ("parameter", "2 N/mm", "", 2000.0),
    ("parameter", "7.8 g/cm^3", "", 7800.0),
    ("parameter", "5 g", "", 0.005),
    ("parameter", "20 %", "", 0.2),
    ("parameter", "1500 rpm", "", 1500 * 2 * PI / 60),
    ("parameter", "1.5f", "", 1.5),
    ("parameter", "1x10^-3", "", 1e-3),
    ("parameter", "1-e6", "", 1e-6),
    ("parameter", "2e0.5", "", 2 * 10**0.5),
    ("parameter", "mm", "", 2.0),
    # functions
    ("definition", "-x_dot N", "", -1.1),
    ("definition", "Cos[theta]", "", math.cos(T)),
    ("definition", "COS theta", "", math.cos(T)),
    ("definition", "lsin(theta)", "", L * math.sin(T)),
    ("definition", "x*Rational(1,2)", "Rational(1,2)", X / 2),
    ("definition", "∂x/∂t", "", 1.1),
    ("definition", "d²x/dt²", "", 0.9),
    ("definition", "cosd(30)", "", math.cos(PI / 6)),
    ("definition", "atand(x)", "", math.degrees(math.atan(X))),
    ("definition", "ite(x > 0, x, l)", "", X),
    ("definition", "np.where(x > 0, x, l)", "", X),
    ("definition", "sin⁻¹(x)", "", math.asin(X)),
    ("definition", "sin(theta°)", "theta°", math.sin(math.radians(T))),
    ("definition", "sin theta", "", math.sin(T)),
    ("definition", "sin 2*theta", "", math.sin(2 * T)),
    ("definition", "sintheta", "", math.sin(T)),
    ("definition", "cosθ", "", math.cos(T)),
    ("definition", "sin2x", "", math.sin(2 * X)),
    ("definition", "SIN(theta)", "", math.sin(T)),
    ("definition", "sin[theta]", "", math.sin(T)),
    ("definition", "sin²(x)", "", math.sin(X) ** 2),
    ("definition", "sin²θ", "", math.sin(T) ** 2),
    ("definition", "sin^2(x)", "", math.sin(X) ** 2),
    ("definition", "sin^2 x", "", math.sin(X) ** 2),
    ("definition", "cot^2(x)", "", math.tan(X) ** -2),
    ("definition", "sin^-1(x)", "", math.asin(X)),
    ("definition", "tan^-1 x", "", math.atan(X)),
    ("definition", "ln x", "", math.log(X)),
    ("definition", "arctan(sin(x))", "", math.atan(math.sin(X))),
    ("definition", "cot x", "", 1 / math.tan(X)),
    ("definition", "sqrt x", "", X**0.5),
    ("definition", "power(x,2)", "", X**2),
    ("definition", "pow(x + l, 2)", "", (X + L) ** 2),
    ("definition", "log(x, 10)", "", math.log10(X)),
    ("definition", "log_10(x)", "log_10", math.log10(X)),
    ("definition", "mod(x, l)", "", X % L),
    ("definition", "x mod 2", "", X % 2),
    ("definition", "l % 2", "", L % 2),
    ("definition", "l div 2", "", 1.0),
    ("definition", "l // 2", "", 1.0),
    ("definition", "round(x)", "", 0.0),
    ("definition", "atan(x, l)", "", math.atan2(X, L)),
    ("definition", "atan2(x/l)", "", math.atan2(X, L)),
    ("definition", "max(x, l, 1)", "", 3.0),
    ("definition", "max(x; l)", ";", 3.0),
    ("definition", "np.arctan2(x, l)", "np.arctan2", math.atan2(X, L)),
    ("definition", "math.sin(x)", "math.sin", math.sin(X)),
    ("definition", "np.power(x, 2)", "", X**2),
    ("definition", "math.pi", "", PI),
    ("definition", "sin2(x)", "", math.sin(X) ** 2),
    ("definition", "pi()", "", PI),
    ("definition", "PI", "", PI),
    ("definition", "e^x", "", math.exp(X)),
    ("definition", "2*e^(-x)", "e^(-x)", 2 * math.exp(-X)),
    ("definition", "exp^x", "", math.exp(X)),
    ("definition", "|x - l|*2", "", 2 * abs(X - L)),
    ("definition", "2*|x - l|", "|x - l|", 2 * abs(X - L)),
    ("definition", "√x", "", X**0.5),
    ("definition", "√(x+1)", "", (X + 1) ** 0.5),
    ("definition", "∛x", "", X ** (1 / 3)),
    # signs
    ("definition", "x·l", "·", X * L),
    ("definition", "x×l", "×", X * L),
    ("definition", "x⋅l", "⋅", X * L),
    ("definition", "x÷l", "÷", X / L),
    ("definition", "l−x", "−", L - X),
    ("definition", "x²", "", X**2),
    ("definition", "x^½", "½", X**0.5),
    ("definition", "x^{2}", "^{2}", X**2),
    ("definition", "2x", "", 2 * X),
    ("definition", "x l", "", X * L),
    ("definition", "2*xl", "xl", 2 * X * L),
    ("definition", "x2", "", X**2),
    ("definition", "x(l + 1)", "", X * (L + 1)),
    ("definition", "x(t)", "", X),
    ("definition", "x +", "+", X),
    ("definition", "= x", "=", X),
    ("definition", "x\u200b*l", "\u200b", X * L),
    ("definition", "\\frac{x}{l}", "", X / L),
    ("definition", "\\sqrt{x}", "", X**0.5),
    ("definition", "x \\cdot l", "", X * L),
    ("definition", "\\theta", "", T),
    ("definition", "\\cos\\theta", "", math.cos(T)),
    ("definition", "\\frac{1}{2} m x^2", "", X**2),
    ("definition", "\\frac{m}{2}\\dot{x}^2 + \\sin^2\\theta", "", None),
    ("definition", "\\left(x + l\\right)^{2}", "", (X + L) ** 2),
    ("definition", "x⁻¹", "⁻¹", 1 / X),
    ("definition", "0.5mx^2", "", X**2),
    ("definition", "m*params.l", "params.l", 2 * L),
    ("definition", "sin^2(cos(x))", "", math.sin(math.cos(X)) ** 2),
    ("definition", "√(x + (x))", "", (2 * X) ** 0.5),
    ("definition", "sin(30°)", "30°", 0.5),
    ("definition", "θ\u0307", "", -0.4),
    ("definition", "θ\u0308", "", 0.6),
    # conditions
    ("definition", '"x > 0 ? l : x"', "x > 0 ? l : x", L),
    ("definition", "if(x > 0 && x < 1, 1, 2)", "&&", 1.0),
    ("definition", "if(x > 0 & x < 1, 1, 2)", "&", 1.0),
    ("definition", "if(x > 9 || x < 1, 1, 2)", "||", 1.0),
    ("definition", "if(!(x > 0), 1, 2)", "!", 2.0),
    ("definition", "if(x != 0, 1, 2)", "x != 0", 1.0),
    ("definition", "if(l == 3, 1, 2)", "l == 3", 1.0),
    ("definition", "if(l = 3, 1, 2)", "l = 3", 1.0),
    ("definition", "if(x =< 0, 1, 2)", "=<", 2.0),
    ("definition", "if(x => 0, 1, 2)", "=>", 1.0),
    ("definition", "if(x ≤ 0, 1, 2)", "≤", 2.0),
    ("definition", "if(x ≥ 0, 1, 2)", "≥", 1.0),
    ("definition", "x if x > 0 else l", "", X),
    ("definition", "if x > 0 then x else l", "", X),
    ("definition", "l when t > 1", "", L),
    ("definition", "l if t > 1", "", L),
    ("definition", "t > 1", "", 1.0),
    ("definition", "(t > 1)*l", "(t > 1)", L),
    ("definition", "cos(x) > 2", "", 0.0),
    # names
    ("definition", "2*time", "time", 4.0),
    ("definition", "Theta", "", T),
    ("definition", "θ", "", T),
    ("definition", "x'", "", 1.1),
    ("definition", "x′", "", 1.1),
    ("definition", "θ'", "", -0.4),
    ("definition", "x.dot", "", 1.1),
    ("definition", "x.diff(t)", "", 1.1),
    ("definition", "x.dt", "", 1.1),
    ("definition", "dot x", "", 1.1),
    ("definition", "dot(theta)", "", -0.4),
    ("definition", "\\dot{\\theta}^2", "", 0.16),
    ("definition", "l*x'**2", "x'", L * 1.21),
    ("definition", "xDot", "", 1.1),
    ("definition", "2*dx/dt", "dx/dt", 2.2),
    ("definition", "d(theta)/dt", "", -0.4),
    ("definition", "d/dt(x)", "", 1.1),
    ("definition", "d/dt x", "", 1.1),
    ("definition", "diff(x, t)", "", 1.1),
    ("definition", "\\dot{x}", "", 1.1),
    ("definition", "thetȧ", "", -0.4),
    ("definition", "ẋ", "", 1.1),
    ("definition", "d^2x/dt^2", "", 0.9),
    ("definition", "d2x/dt2", "", 0.9),
    ("definition", "x''", "", 0.9),
    ("definition", "ẍ", "", 0.9),
    ("definition", "xdotdot", "", 0.9),
    ("definition", "x.ddot", "", 0.9),
    ("definition", "x[t]", "", X),
    ("definition", "a_x", "", 0.9),
    ("definition", "\\ddot{x}", "", 0.9),
    # lists, signs of YAML
    ("definition", "[x]", "", X),
    ("energy", "{x}", "", None),
    ("energy", "[x]", "", None),
    ("definition", "- x", "", -X),
    ("relation", "x_dot == 0", "==", None),
    ("relation", "x_dot := 0", ":=", None),
    ("relation", "x_dot ≈ 0", "≈", None),
    ("relation", "x_dot =", "", None),
]


def name(case):
    return f"{case[0]} {case[1]}"


def text_with(where, text):
    return MODEL.format(**{**SOUND, where: text})


def hint_of(where, text):
    found = problems(text_with(where, text))
    assert len(found) == 1
    return found[0].whole.hint


def value(where, model):
    if where == "definition":
        [node] = [d.node for d in model.definitions if d.name == "seen"]
        return evaluate(model.graph, [node], AT)[0]
    if where == "parameter":
        return next(p.value for p in model.parameters if p.name == "k")
    if where == "duration":
        return model.settings({}).end
    named = {"initial": "theta", "rate": "theta_dot"}[where]
    return next(v.value for v in model.initial if v.name == named)


def admitted(model):
    """Fail where `check` would not accept the start."""
    assert examine(derive(model), model.settings({}).start).admissible


@pytest.mark.parametrize(
    ("where", "text", "part", "meant"), CASES, ids=map(name, CASES)
)
def test_a_hint_that_is_followed_gives_what_was_meant(where, text, part, meant):
    hint = hint_of(where, text)
    followed = text.replace(part or text, said(hint), 1)
    try:
        model = read(text_with(where, followed), "model.yaml")
    except InputError as error:
        pytest.fail(f"{hint!r} gave {followed!r}: {error}")
    admitted(model)
    if meant is not None:
        assert value(where, model) == pytest.approx(meant, rel=1e-12)


FILE = """\
parameters:
  l: 1
  g: 9.8
coordinates:
  theta: {unit: rad}
  x: {unit: m}
definitions:
  s: x + l*sin(theta)
  c: l*cos(theta)
energy:
  kinetic: (l^2*theta_dot^2 + x_dot^2)/2
  potential: -g*c
forces:
  x: -x_dot
constraints:
  rod: x_dot = 0
initial:
  theta: 1
  x: 0
simulation:
  end: 2
scene:
  points:
    bob: [s, c]
    pivot: [0, 0]
  links: [[pivot, bob]]
output:
  columns: [s]
  plots:
    - {x: t, y: theta}
"""

# What is replaced in the file, the mistake, the part of it that the hint replaces.
FILES = [
    ("  x: -x", "  X: -x", "X"),
    ("  x: -x", "  x_dot: -x", "x_dot"),
    ("[[pivot, bob]]", "[[pivot, bop]]", "bop"),
    ("[[pivot, bob]]", "[pivot, bob]", "[pivot, bob]"),
    ("[[pivot, bob]]", "pivot, bob", "pivot, bob"),
    ("[[pivot, bob]]", "[pivot-bob]", "pivot-bob"),
    ("columns: [s]", "columns: s", "s"),
    ("columns: [s]", "columns: [S]", "S"),
    ("  end", "  to", "to"),
    ("  end", "  t_end", "t_end"),
    ("  end", "  stop_time", "stop_time"),
    ("  end", "  End", "End"),
    ("  end: 2", "  tspan: [0, 2]", "tspan: [0, 2]"),
    ("  end: 2", "  t_span: (0, 2)", "t_span: (0, 2)"),
    ("  end: 2", "  end: [0, 2]", "end: [0, 2]"),
    ("  end: 2", "  end: linspace(0, 2, 101)", "end: linspace(0, 2, 101)"),
    ("  end: 2", "  end: 2\n  steps: 1000", "steps: 1000"),
    ("  end: 2", "  start: 0\n  end: 2\n  points: 1000", "points: 1000"),
    ("  end: 2", "  end: 2\n  fps: 500", "fps: 500"),
    ("simulation:", "sim:", "sim"),
    ("initial:", "x0:", "x0"),
    ("coordinates:", "states:", "states"),
    ("forces:", "generalized_forces:", "generalized_forces"),
    ("definitions:", "define:", "define"),
    ("scene:", "visualization:", "visualization"),
    ("  columns: [s]", "  variables: [s]", "variables"),
    ("  links:", "  edges:", "edges"),
    ("[[pivot, bob]]", "{pivot: bob}", "{pivot: bob}"),
    ("[[pivot, bob]]", "pivot -> bob", "pivot -> bob"),
    ("columns: [s]", "columns: {s}", "{s}"),
    ("bob: [s, c]", 'bob: "[s, c]"', '"[s, c]"'),
    ("bob: [s, c]", "bob: {pos: [s, c]}", "{pos: [s, c]}"),
    ("- {x: t, y: theta}", "- theta vs t", "theta vs t"),
    ("  theta: {unit: rad}", "  theta: [rad]", "[rad]"),
    ("  theta: 1\n", "  theta: [1, 0]\n", "theta: [1, 0]"),
    ("  theta: 1\n", "  theta: {value: 1, rate: 0}\n", "theta: {value: 1, rate: 0}"),
    ("  theta: 1\n", "  theta: 1\n  d/dt theta: 0\n", "d/dt theta"),
    ("  theta: 1\n", "  theta: 1\n  \\dot{theta}: 0\n", "\\dot{theta}"),
    ("  l: 1\n", "  l: {default: 1}\n", "default"),
    ("rod: x_dot = 0", "rod: {eq: x_dot = 0}", "eq"),
    ("  end: 2", "  end=2", "end=2"),
    ("  end: 2", "  end:2", "end:2"),
    ("  end: 2", "  end 2", "end 2"),
    ("  end: 2", "  from: 0\n  end: 2", "from"),
    ("  theta: {unit: rad}", "  theta: rad", "rad"),
    ("  theta: {unit: rad}", "  theta: 1", "1"),
    ("  theta: {unit: rad}", "  theta: {units: rad}", "units"),
    ("  theta: {unit: rad}\n  x: {unit: m}", "  - theta\n  - x", "- theta\n  - x"),
    ("\n  theta: {unit: rad}\n  x: {unit: m}", " [theta, x]", "[theta, x]"),
    ("\n  theta: {unit: rad}\n  x: {unit: m}", " theta, x", "theta, x"),
    ("  theta: 1\n", "  theta: 1\n  theta': 0\n", "theta'"),
    ("  theta: 1\n", "  theta: 1\n  dtheta/dt: 0\n", "dtheta/dt"),
    ("  theta: 1\n", "  theta(0): 1\n", "theta(0)"),
    ("  theta: 1\n", "  theta0: 1\n", "theta0"),
    ("  theta: 1\n", "  Theta: 1\n", "Theta"),
    ("  theta: 1\n", "  θ: 1\n", "θ"),
    ("  theta: 1\n", "  theta = 1\n", "theta = 1"),
    ("  theta: 1\n", "  theta:1\n", "theta:1"),
    ("potential:", "Potential:", "Potential"),
    ("potential:", "V:", "V"),
    ("kinetic:", "T:", "T"),
    ("potential: -g*c", "potential: -G*c", "G"),
    ("potential: -g*c", "potential: - g*c", "- g*c"),
    ("potential: -g*c", "potential: [-g*c]", "[-g*c]"),
    ("potential: -g*c", "potential: -g*c;", ";"),
    ("rod: x_dot = 0", "rod: x_dot == 0", "=="),
    ("bob: [s, c]", "bob: (s, c)", "(s, c)"),
    ("bob: [s, c]", "bob: s, c", "s, c"),
    ("bob: [s, c]", "bob: {x: s, y: c}", "{x: s, y: c}"),
    ("bob: [s, c]", "bob: [s; c]", ";"),
    ("  links:", "  lines:", "lines"),
    ("- {x: t, y: theta}", "- {x: time, y: theta}", "time"),
    ("- {x: t, y: theta}", "- theta", "theta"),
    ("- {x: t, y: theta}", "- [t, theta]", "[t, theta]"),
    ("\n    - {x: t, y: theta}", " {x: t, y: theta}", "{x: t, y: theta}"),
    ("  l: 1\n", "  l (m): 1\n", "l (m)"),
    ("  l: 1\n", "  l=1\n", "l=1"),
    ("  l: 1\n", "  l: {1, m}\n", "{1, m}"),
    ("  g: 9.8", "  g: 9,8", "9,8"),
    ("parameters:\n  l: 1\n  g: 9.8", "parameters: {l: 1, g: 9,8}", "9,8"),
]


def meaning(model):
    """Give what a file says, as far as mistakes here can change it."""
    settings = model.settings({})
    return (
        {p.name: p.value for p in model.parameters},
        [q.name for q in model.coordinates],
        [(v.name, v.value, v.guess) for v in model.initial],
        [d.name for d in model.definitions],
        [f.on for f in model.forces],
        [c.name for c in model.constraints],
        [*model.scene.points], model.scene.links,
        model.output.columns, [p.y[0].text for p in model.output.plots],
        (settings.start, settings.end, settings.output_step),
    )  # fmt: skip


@pytest.mark.parametrize(("old", "new", "part"), FILES, ids=[f[1] for f in FILES])
def test_a_hint_for_a_file_that_is_followed(old, new, part):
    assert FILE.count(old) >= 1
    with pytest.raises(InputError) as raised:
        read(FILE.replace(old, new, 1), "model.yaml")
    hints = [p.whole.hint for p in raised.value.problems]
    hint = next(h for h in hints if "..." not in h.partition(";")[0])
    start = (
        new.rindex(part) if part in ("T", "V", "X", "G", "s", "1") else new.index(part)
    )
    followed = new[:start] + said(hint) + new[start + len(part) :]
    try:
        model = read(FILE.replace(old, followed, 1), "model.yaml")
    except InputError as error:
        pytest.fail(f"{hint!r} gave {followed!r}: {error}")
    assert meaning(model) == meaning(read(FILE, "model.yaml"))
    admitted(model)


@pytest.mark.parametrize("number", ["12,345,678", "12,345,678.5", "1,000.5"])
def test_thousands_in_braces(number):
    text = FILE.replace("  g: 9.8\n", f"  k: {{value: {number}, unit: m}}\n  g: 9.8\n")
    with pytest.raises(InputError) as raised:
        read(text, "model.yaml")
    assert {said(p.whole.hint) for p in raised.value.problems} == {
        number.replace(",", "")
    }


# What these say is no text to write: the user has to choose, or to delete.
ADVICE = {
    "a number has one decimal point",
    "numbers are decimal",
    "a time is one number, such as 90 for 1:30",
    "every number is finite",
    "every number is real",
    "there is no factorial",
    "there are no indices: each has a name of its own",
    "an expression contains no quotes",
    "write the expression without `$`",
    "write if(condition, a, b)",
    "write r_dot, with `r: {0}` in `definitions`",
    "write < or >: numbers are compared by <, <=, > and >=",
}


def test_every_spelling_of_the_table_has_a_case(monkeypatch):
    used = set()

    def recorded(k, meant):
        def hint(found):
            used.add(k)
            return (
                meant.format(*found.groups())
                if isinstance(meant, str)
                else meant(found)
            )

        return hint

    patterns = hints.patterns()
    table = [(p, recorded(k, meant)) for k, (p, meant) in enumerate(patterns)]
    monkeypatch.setattr(hints, "patterns", lambda: table)
    names = [(p, recorded(p.pattern, meant)) for p, meant in hints.patterns_of_names()]
    monkeypatch.setattr(hints, "patterns_of_names", lambda: names)
    for where, text, *_ in CASES:
        hint_of(where, text)
    left = [
        (p.pattern, meant)
        for k, (p, meant) in enumerate(patterns)
        if k not in used and p.pattern not in used and meant not in ADVICE
    ]
    assert left == []
