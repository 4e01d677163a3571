"""A hint names what was likely meant: spellings of elsewhere, keys in a wrong place."""

from __future__ import annotations

import pytest

from lagsim.errors import InputError
from lagsim.model.reader import read
from lagsim.model.reader.fields import MAX_GUESSES
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
    ("parameter", "3 kN", "write 3*1000, in N"),
    ("parameter", "1.5 × 10^3", "write 1.5e3"),
    ("parameter", "1.5.2", "one decimal point"),
    ("parameter", "0x10", "decimal"),
    ("parameter", "inf", "finite"),
    ("duration", "1:30", "one number"),
    ("initial", "3pi/4", "3*pi"),
    ("parameter", "25.6 N/m", "{value: 25.6, unit: N/m}"),
    ("definition", "cos^(-1)(x)", "acos"),
    ("definition", "lg(x)", "log10(x)"),
    ("definition", "sh(x)", "sinh(x)"),
    ("definition", "numpy.e", "exp(1)"),
    ("definition", "x!", "no factorial"),
    ("definition", "stiffness*x", "`stiffness` a value in `parameters`"),
    ("definition", "erf(x)", "definition"),
    ("initial", "guess", "{guess: 0}"),
    ("initial", "none", "such as 0"),
    ("definition", "x_dot2", "x_dot^2"),
    ("definition", "v", "theta_dot"),
    ("definition", "θ_dot", "`theta_dot`"),
    ("definition", "cos**2(x + l)", "cos(x + l)^2"),
    ("definition", "|x|", "abs(x)"),
    ("definition", "dheight", "height_dot"),
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
        ("lagrangian: x", "`lagrangian` belongs below `energy:`, indented"),
        ("kinetic: x", "`kinetic` belongs below `energy:`, indented"),
        ("output_step: 1", "`output_step` belongs below `simulation:`, indented"),
        ("points: {a: [x, y]}", "`points` belongs below `scene:`, indented"),
        ("plots: []", "`plots` belongs below `output:`, indented"),
        ("simulation: {initial: {x: 0}}", "`initial` belongs at the top of the file"),
        ("parameters: {forces: {x: 1}}", "`forces` belongs at the top of the file"),
        ("initial: {x: 0, y: 0, scene: 1}", "`scene` belongs at the top of the file"),
        ("scene: {columns: [x]}", "`columns` belongs below `output:`, indented"),
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
            "`parameters` belongs at the top of the file, without indentation", 2,
        ),
        (ENERGY, indented(ENERGY), "`energy` belongs at the top of the file", 6),
        (
            "initial:\n  theta: 1\n", "  initial:\n    theta: 1\n",
            "`initial` belongs at the top of the file", 9,
        ),
        (
            "simulation:\n  duration: 2", "  simulation: {duration: 2}",
            "`simulation` belongs at the top of the file", 11,
        ),
        # a key of a section beside it
        ("simulation:\n  dur", "simulation:\ndur", "`duration` belongs below", 12),
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
