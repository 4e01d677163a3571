"""A hint names what was likely meant: spellings of elsewhere, keys in a wrong place."""

from __future__ import annotations

import pytest

from lagsim.errors import InputError
from lagsim.model.reader import read
from lagsim.model.reader.faults import MAX_GUESSES
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
    ("duration", "2 s", "write 2: "),
    ("duration", "{value: 2, unit: s}", "write 2: "),
    ("duration", "1,000.5", "write 1000.5"),
    ("initial", "{value: 1, unit: rad}", "write 1: "),
    ("initial", "{value: 30, unit: deg}", "write 30*pi/180"),
    ("initial", "1500 rpm", "write 1500*2*pi/60: rates are in rad/s"),
    ("parameter", "2.7 g/cm^3", "write 2.7*100^3/1000, in kg/m^3"),
    ("parameter", "1/2 kg", "write {value: 1/2, unit: kg}"),
    ("definition", "2*time", "the time is `t`"),
    ("definition", "arctan(sin(x))", "write atan(sin(x))"),
    ("definition", "cot x", "write 1/tan(x)"),
    ("definition", "dx/dt", "the rate is written x_dot"),
    ("definition", "x mod 2", "write x - 2*floor(x/2)"),
    ("definition", "pi()", "write pi"),
    ("definition", "x == 1", "x >= 1 and x <= 1"),
    ("definition", "(x > 0)*l", "write if(x > 0, 1, 0)"),
    ("definition", "e^(-x)", "write exp(-x)"),
    ("parameter", "1 m", "{value: 1, unit: m}"),
    ("parameter", "1m", "{value: 1, unit: m}"),
    ("parameter", '"1 [kg]"', "{value: 1, unit: kg}"),
    ("parameter", "9.81 m/s²", "{value: 9.81, unit: m/s^2}"),
    ("parameter", "9.81 m s^-2", "{value: 9.81, unit: m*s^-2}"),
    ("parameter", "2 kg·m²", "{value: 2, unit: kg*m^2}"),
    ("parameter", "10 cm", "write 10/100, in m"),
    ("parameter", "3 kN", "write 3*1000, in N"),
    ("parameter", "5 %", "write 5/100"),
    ("parameter", "1 000", "write 1000"),
    ("parameter", "½", "write 1/2"),
    ("parameter", "1x10^-3", "write 1e-3"),
    ("parameter", "1.5 × 10^3", "write 1.5e3"),
    ("parameter", "1.5.2", "one decimal point"),
    ("parameter", "0x10", "decimal"),
    ("parameter", "5e", "5e0"),
    ("parameter", "inf", "finite"),
    ("duration", "500 ms", "write 500/1000, in s"),
    ("duration", "2 min", "write 2*60, in s"),
    ("duration", "10s", "write 10"),
    ("duration", "1:30", "one number"),
    ("initial", "30deg", "30*pi/180"),
    ("initial", "30 º", "30*pi/180"),
    ("initial", "30*deg", "pi/180"),
    ("initial", "radians(30)", "30*pi/180"),
    ("initial", "math.radians(30)", "30*pi/180"),
    ("initial", "pi/6 rad", "write pi/6: angles are in radians"),
    ("initial", "3π/4", "3*pi"),
    ("initial", "3pi/4", "3*pi"),
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
    ("definition", "sin 2*theta", "sin(2*theta)"),
    ("definition", "sintheta", "sin(theta)"),
    ("definition", "Sin(theta)", "write sin"),
    ("definition", "SIN(theta)", "write sin"),
    ("definition", "sin[theta]", "sin(theta)"),
    ("definition", "sin²(x)", "sin(x)^2"),
    ("definition", "sin² x", "sin(x)^2"),
    ("definition", "sin^-1(x)", "asin"),
    ("definition", "cos^(-1)(x)", "acos"),
    ("definition", "ln x", "log(x)"),
    ("definition", "lg(x)", "log10(x)"),
    ("definition", "log(x, 2)", "log(x)/log(2)"),
    ("definition", "cot(x)", "1/tan(x)"),
    ("definition", "sh(x)", "sinh(x)"),
    ("definition", "round(x)", "floor(x + 0.5)"),
    ("definition", "mod(x, l)", "x - l*floor(x/l)"),
    ("definition", "atan(x, l)", "atan2(x, l)"),
    ("definition", "max(x, l, 1)", "max(x, max(l, 1))"),
    ("definition", "max(x; l)", "`,`"),
    ("definition", "np.arctan2(x, l)", "`atan2`"),
    ("definition", "numpy.e", "exp(1)"),
    ("definition", "E^x", "exp(x)"),
    ("definition", "x if x > 0 else l", "if(x > 0, x, l)"),
    ("definition", "x > 0 ? x : l", "if(x > 0, x, l)"),
    ("definition", "if x > 0 then x else l", "if(x > 0, x, l)"),
    ("definition", "if(x == 0, 1, 2)", "compared by <"),
    ("definition", "if(x =< 0, 1, 2)", "`<=`"),
    ("definition", "x // 2", "floor(x/2)"),
    ("definition", "x!", "no factorial"),
    ("definition", "x·l", "`*`"),
    ("definition", "x⋅l", "`*`"),
    ("definition", "x^{2}", "^(2)"),
    ("definition", "∛x", "cbrt(x)"),
    ("definition", "2x", "2*x"),
    ("definition", "x if x > 0", "if(condition, a, b)"),
    ("definition", "1-e6", "write 1e-6"),
    ("definition", "stiffness*x", "`stiffness` a value in `parameters`"),
    ("definition", "erf(x)", "definition"),
    ("initial", "guess", "{guess: 0}"),
    ("initial", "none", "such as 0"),
    ("definition", "x l", "x*l"),
    ("definition", "ml", "m*l"),
    ("definition", "x2", "x^2"),
    ("definition", "x(t)", "write x, without `(t)`"),
    ("definition", "x(l + 1)", "x*(l + 1)"),
    ("definition", "0.5m*x_dot^2", "0.5*m"),
    ("definition", "x_dot2", "x_dot^2"),
    ("definition", "v_x", "x_dot"),
    ("definition", "velocity_x", "x_dot"),
    ("definition", "v", "theta_dot"),
    ("definition", "xDot", "x_dot"),
    ("definition", "x.dot", "x_dot"),
    ("definition", "x-dot", "x_dot"),
    ("definition", "d(theta)/dt", "theta_dot"),
    ("definition", "Derivative(x, t)", "x_dot"),
    ("definition", "dot(x)", "x_dot"),
    ("definition", "d^2x/dt^2", "x_ddot"),
    ("definition", "x''", "x_ddot"),
    ("definition", "thetȧ", "theta_dot"),
    ("definition", "θ", "`theta`"),
    ("definition", "θ_dot", "`theta_dot`"),
    ("definition", "l*cos 2", "cos(2)"),
    ("definition", "sin^2(x)", "sin(x)^2"),
    ("definition", "cos**2(x + l)", "cos(x + l)^2"),
    ("definition", "sin^2 x", "sin(x)^2"),
    ("definition", "ln(x)", "log(x)"),
    ("definition", "arctan2(x, l)", "atan2(x, l)"),
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


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("parameters: {m: 1, l: 1}", "parameters: {m: 1, l: 1,5}"),
        ("parameters: {m: 1, l: 1}", "parameters: {m: 1, l: {value: 1,5}}"),
        ("initial: {theta: 0, x: 0}", "initial: {theta: 0,5, x: 0}"),
        ("simulation: {duration: 1}", "simulation: {duration: 1,5}"),
    ],
)
def test_decimal_commas_in_braces(old, new):
    text = SCENE.format(**SOUND)
    assert old in text
    found = problems(text.replace(old, new))
    assert any(p.hint.endswith("5: a decimal point is written `.`") for p in found)


@pytest.mark.parametrize(
    ("old", "new"),
    [("{theta: {}, x: {}}", "{θ: {}, x: {}}"), ("x: {}}", "X: {}}")],
)
def test_names_in_other_letters(old, new):
    text = SCENE.format(**SOUND)
    assert old in text
    name = new.strip("{").partition(":")[0]
    found = problems(text.replace(old, new))
    assert any(f"`{name}" in problem.hint for problem in found)


@pytest.mark.parametrize(
    "text", ["((((" * 5000, "1 " * 5000, "sin " * 5000, "x" * 20000, "?:" * 9999]
)
def test_long_texts_take_no_longer(text):
    # Patterns that backtrack over all of it would take for ever.
    assert problems(SCENE.format(**{**SOUND, "definition": text}))


FILE = """\
parameters:
  l: 1
  g: 9.8
coordinates:
  theta: {unit: rad}
energy:
  kinetic: l^2*theta_dot^2/2
  potential: -g*l*cos(theta)
initial:
  theta: 1
simulation:
  duration: 2
"""
ENERGY = FILE[FILE.index("energy:") : FILE.index("initial:")]


def faults(text):
    """Give the faults of a text to which nothing is added."""
    with pytest.raises(InputError) as raised:
        read(text, "model.yaml")
    return raised.value.problems


def indented(text):
    return "".join(f"  {line}\n" for line in text.splitlines())


@pytest.mark.parametrize(
    ("old", "new", "told", "line"),
    [
        (  # a section in another
            "parameters:\n  l: 1\n  g: 9.8\ncoordinates:\n",
            "coordinates:\n  parameters:\n    l: 1\n    g: 9.8\n",
            "`parameters` stands at the top of the file, without indentation", 2,
        ),
        (ENERGY, indented(ENERGY), "`energy` stands at the top of the file", 6),
        (
            "initial:\n  theta: 1\n", "  initial:\n    theta: 1\n",
            "`initial` stands at the top of the file", 9,
        ),
        (
            "simulation:\n  duration: 2", "  simulation: {duration: 2}",
            "`simulation` stands at the top of the file", 11,
        ),
        # a key of a section beside it
        ("simulation:\n  dur", "simulation:\ndur", "`duration` stands below", 12),
        ("simulation:\n  duration", "duration", "below `simulation:`, indented", 11),
        (ENERGY, "lagrangian: theta_dot^2\n", "below `energy:`, indented", 6),
        # what belongs to an empty section
        ("initial:\n  theta", "initial:\ntheta", "belongs to `initial`", 10),
        ("  l: 1\n  g: 9.8", "l: 1\ng: 9.8", "belongs to `parameters`", 2),
        ("  theta: {", "theta: {", "belongs to `coordinates`", 5),
        # a key that is called otherwise elsewhere
        ("parameters", "constants", "`parameters`", 1),
        ("coordinates", "variables", "`coordinates`", 4),
        ("  kinetic", "  T", "`kinetic`", 7),
        ("  potential", "  U", "`potential`", 8),
        ("  potential", "  potential energy", "`potential`", 8),
        ("initial", "initial_conditions", "`initial`", 9),
        ("  duration", "  time", "`duration`", 12),
        ("  duration: 2", "  duration: 2\n  dt: 0.1", "`output_step`", 13),
        ("unit: rad", "units: rad", "`unit`", 5),
        ("  duration", "  tstop", "`end`", 12),
        ("  theta: 1", "  theta(0): 1", "`theta`", 10),
        ("  theta: 1", "  theta_0: 1", "`theta`", 10),
        # a key and its value
        ("  l: 1", "  l = 1", "write `l: 1`", 2),
        ("  l: 1", "  l=1", "write `l: 1`", 2),
        ("  l: 1\n  g: 9.8\n", "  l = 1\n", "a colon is missing: `l: 1`", 2),
        ("  l: 1", "  l: [1, m]", "write {value: 1, unit: m}", 2),
        ("  theta: 1", "  theta: 1\n  theta': 0", "`theta_dot`", 11),
        ("kinetic: l", "kinetic: T = l", "right of it", 7),
    ],
)  # fmt: skip
def test_keys_that_are_misplaced_or_called_otherwise(old, new, told, line):
    assert FILE.count(old) >= 1
    first, *_ = faults(FILE.replace(old, new, 1))
    assert told in first.hint
    assert first.line == line


@pytest.mark.parametrize(
    "inner",
    [
        "coordinates:\n  parameters:\n    l: 1\n    g: 9.8\n",
        "coordinates:\nparameters:\nl: 1\ng: 9.8\n",
    ],
)
def test_what_is_misplaced_is_told_once(inner):
    text = FILE.replace("parameters:\n  l: 1\n  g: 9.8\ncoordinates:\n", inner)
    assert len(faults(text)) <= 2  # and not that `l` and `g` are unknown


def test_names_may_be_those_of_sections():
    text = FILE.replace("  l: 1", "  l: 1\n  scene: {value: 3, unit: m}\n  output: 2")
    text = text.replace("cos(theta)", "cos(theta) + scene*output")
    assert read(text, "model.yaml").name == "model"


def test_so_many_faults_are_looked_at_and_no_more():
    """Looking costs time: a file full of faults has a hint of its own for the first."""
    count = MAX_GUESSES + 5
    text = "parameters:\n" + "".join(f"  p{k}: sin 2\n" for k in range(count))
    hints = [problem.hint == "write sin(2)" for problem in problems(text)]
    assert MAX_GUESSES == 200
    assert hints == [True] * 200 + [False] * 5
