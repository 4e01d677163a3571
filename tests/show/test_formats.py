"""Text, LaTeX, JSON and Python as people and programs read them."""

import re
import unicodedata

import pytest

from lagsim.language.evaluate import evaluate
from lagsim.language.functions import FUNCTIONS
from lagsim.mechanics.derivation import derive
from lagsim.model.reader import read
from lagsim.show.as_python import as_python
from lagsim.show.lagrange import derived
from lagsim.show.latex import LONGEST_LINE, as_latex
from lagsim.show.latex import _width as as_latex_width
from lagsim.show.printers import as_json
from lagsim.show.text import as_text
from tests.show.cases import EACH, content_of, equations_of, kept, known, numbers, small
from tests.show.latex_checker import check
from tests.show.stored import EVERY_FUNCTION
from tests.small_scenes import scene
from tests.support import MODELS

NAMED = scene(
    "theta1: 0, größe: 0",
    "lambda*cos(theta1) + S*größe^2*beta + N*zoo*theta_1*theta1",
    "I*theta1_dot^2/2 + E*größe_dot^2/2",
    parameters="lambda: 2, I: 3, E: 5, S: 7, beta: 1.5, N: 2, zoo: 1, theta_1: 4",
    constraints="lambda: größe = beta*theta1",
)
FIRST = {"x": 0.43, "y": 1.27, "x_dot": 0.3, "y_dot": -0.7, "a": 0.7, "t": 0.2}
OTHERS = ({"x": 2.3, "y": 0.6}, {"x": 3.7, "y": 7.1})


@pytest.mark.parametrize("name", EACH)
def test_latex_is_read_by_a_strict_reader(name):
    displays = check(as_latex(content_of(name)))
    assert len(displays) >= 3


@pytest.mark.slow
def test_latex_of_everything():
    for text in (EVERY_FUNCTION, NAMED):
        check(as_latex(small(text, with_gauss=True, solve=True)))
        check(as_latex(small(text, substitute=True)))


AWKWARD = """
name: "a_100%"
description: "50% of $x$ & y_1 #3 ~ θ → ∞, 20 °C, ñ, ж"
parameters: {a: 1e-9, b: 2.5e20, x_: 2, w: 3, жук: 4}
coordinates: {x: {}, y: {}}
energy:
  kinetic: (x_dot^2 + y_dot^2)/2
  potential: a^x + (b*x)^1.5 + x_*x*y + 2^(x*y) + жук*log10(x)^2
forces: {x: cos(w*t)}
constraints: {путь: x^2 + y^2 = b}
initial: {x: 1, y: 2}
"""


@pytest.mark.parametrize("substitute", [False, True])
def test_latex_of_what_could_stop_it(substitute):
    latex = as_latex(small(AWKWARD, substitute=substitute))
    check(latex)
    # No letter that the fonts of plain LaTeX lack.
    assert {c for c in latex if not c.isascii()} == {"°", "ñ"}
    assert r"$\theta$ [U+2192] [U+221E], 20 °C, ñ, [U+0436]" in latex
    assert r"\lambda_{\text{[U+043F][U+0443][U+0442][U+044C]}}" in latex
    # The time is t, and no name loses its underscore.
    assert "\\mathrm{t}" not in latex
    if substitute:
        assert r"\left(10^{-9}\right)^{x}" in latex
        assert r"2^{x \, y} \, y \, \ln 2" in latex  # not ln 2 y
    else:
        assert r"\cos\left(w \, t\right)" in latex
        assert r"\mathrm{x\_} \, x \, y" in latex
        assert "x_ x y" in as_text(small(AWKWARD))


def test_names_survive():
    c = small(NAMED)
    latex, text, plain = as_latex(c), as_text(c), as_text(c, ascii_only=True)
    for shown in (r"\lambda \, \cos \theta_{1}", r"\lambda_{\mathrm{lambda}}", r"S \, ",
                  r"\beta", r"I \, \ddot{\theta}_{1}", r"\mathrm{theta\_1}",
                  r"\mathit{zoo}", r"\ddot{\text{größe}}"):  # fmt: skip
        assert shown in latex
    for shown in ("λ cos(θ₁)", "λ_lambda", "β", "θ̈₁", "N zoo theta_1", "E größe_ddot"):
        assert shown in text
    assert "lambda*cos(theta1)" in plain
    assert "lambda_lambda" in plain
    d = as_json(c)
    assert d["kinetic"] == "I*theta1_dot^2/2 + E*größe_dot^2/2"
    assert d["equations"][1]["right"] == "lambda_lambda"
    assert numbers(
        [d["potential"]], {**d["parameters"], "theta1": 0.0, "größe": 2.0}
    ) == [2 + 7 * 4 * 1.5]
    scope = {}
    exec(as_python(derive(read(NAMED, "m.yaml")), "0"), scope)
    assert scope["force"](0.0, [0.3, 0.2], [0, 0])[1] == pytest.approx(
        -2 * 7 * 0.2 * 1.5
    )


@pytest.mark.slow
@pytest.mark.parametrize("substitute", [False, True])
def test_every_function_in_json(substitute):
    equations = derive(read(EVERY_FUNCTION, "m.yaml"))
    d = as_json(derived(equations, substitute=substitute))
    for state in ({}, *OTHERS):
        values = {**FIRST, **state}
        expected = evaluate(equations.graph, equations.f, values)
        # Terms up to 1e3 that come in another order.
        assert numbers(d["f"], known(d, values)) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("name", FUNCTIONS)
def test_every_function_is_derived(name):
    assert f"{name}(" in EVERY_FUNCTION


def test_every_function_in_python():
    force = EVERY_FUNCTION.replace("potential: >-", "potential: 0\nforces:\n  x: >-")
    for text in (EVERY_FUNCTION, force):  # slopes, and the functions themselves
        equations = derive(read(text, "m.yaml"))
        scope = {}
        exec(as_python(equations, "0"), scope)
        for state in ({}, *OTHERS):
            values = {**FIRST, **state}
            expected = evaluate(equations.graph, equations.f, values)
            found = scope["force"](0.2, [values["x"], values["y"]], [0.3, -0.7])
            # The libraries of mathematics differ in the last place, over 100 terms.
            assert found == pytest.approx(expected, rel=1e-13)


def test_python_outside_a_domain_is_not_a_number_and_nothing_else():
    text = scene("x: 1", "sqrt(x)/k + if(x > 0, 0, 1)*x", parameters="k: 0")
    scope = {}
    exec(as_python(derive(read(text, "m.yaml")), "0"), scope)
    assert not (abs(scope["force"](0, [-1.0], [0.0])[0]) < 1e300)


def test_python_keeps_off_names_of_its_own():
    text = scene(
        "class: 1, q_dot_: 1",
        "out*class^2*PARAMETERS + def*q_dot_^2*z1*class*q_dot_",
        "np*class_dot^2 + q*q_dot__dot^2",
        parameters="np: 2, q: 3, out: 5, PARAMETERS: 7, def: 11, z1: 13",
    )
    equations = derive(read(text, "m.yaml"))
    scope = {}
    exec(as_python(equations, "0"), scope)
    values = {"class": 0.3, "q_dot_": 0.7, "class_dot": 0.0, "q_dot__dot": 0.0}
    expected = evaluate(equations.graph, equations.f, {**scope["PARAMETERS"], **values})
    assert list(scope["force"](0, [0.3, 0.7], [0, 0])) == pytest.approx(expected)
    scope["PARAMETERS"]["np"] = 20.0  # read at each call
    assert scope["mass_matrix"](0, [0, 0], [0, 0])[0, 0] == 40.0
    assert scope["constraint_matrix"](0, [0, 0], [0, 0]).shape == (0, 2)
    assert scope["constraint_rhs"](0, [0, 0], [0, 0]).shape == (0,)


@pytest.mark.slow
@pytest.mark.parametrize("name", EACH)
def test_ascii_is_ascii_and_lines_break(name):
    text = as_text(content_of(name), ascii_only=True)
    assert text.isascii()
    lines = as_text(content_of(name)).splitlines()
    # Only products that cannot be broken are longer than a line: in the cradle, seven
    # in the second rate of each of four distances.
    most = 28 if name == "newtons-cradle" else 6
    assert sum(len(line) > 110 for line in lines) <= most
    assert not any(len(line) > 110 and line.startswith("      = ") for line in lines)


@pytest.mark.slow
def test_accelerations_step_by_step():
    c = derived(equations_of("chain-cartesian"), solve=True)
    d = as_json(c)
    e = equations_of("chain-cartesian")
    values = {"m": 1.3, "g": 9.81, "l": 0.4, "t": 0.0}
    values |= {q: 0.1 * (k % 7) + 0.05 * k for k, q in enumerate(e.q)}
    values |= {v: 0.3 - 0.1 * (k % 5) for k, v in enumerate(e.velocities)}
    assert d["accelerations"]["steps"]
    for name, text in d["accelerations"]["steps"].items():
        values[name] = numbers([text], values)[0]
    q_ddot = numbers(d["accelerations"]["q_ddot"], values)
    lam = numbers(d["accelerations"]["lambda"], values)
    for i in range(len(e.q)):
        row = evaluate(e.graph, [e.M[i][i], e.f[i], *(r.A[i] for r in e.rows)], values)
        force = row[1] + sum(a * x for a, x in zip(row[2:], lam, strict=True))
        # Ten multipliers, each from the one before: 1e-9 of the largest force.
        assert row[0] * q_ddot[i] == pytest.approx(force, abs=1e-9 * max(map(abs, lam)))


SINGULAR = scene(
    "x: 1, y: 1",
    "k*x^2/2",
    "m*(x_dot + y_dot)^2/2",
    parameters="m: 2, k: 3",
    constraints="tie: y = x",
)


@pytest.mark.parametrize("kinetic", ["m*(x_dot + y_dot)^2/2", "m*x_dot^2/2"])
def test_without_inertia_there_are_no_accelerations(kinetic):
    text = SINGULAR.replace("m*(x_dot + y_dot)^2/2", kinetic)
    for solve in (False, True):
        c = small(text, solve=solve)
        assert c.document["accelerations"] is None
        assert c.document["notes"] == [
            "M is not positive definite: it is not solved for the accelerations"
        ]
        assert "Note: M is not positive" in as_text(c)
    check(as_latex(c))


@pytest.mark.slow
def test_notes_say_what_was_left_out():
    c = small((MODELS / "car-axis.yaml").read_text(encoding="utf-8"), with_gauss=True)
    assert c.document["gauss"]["a"] is not None
    assert c.document["notes"] == [
        "the accelerations are too long to be read; `--solve` prints them",
        "left out, for it is too long to be read: the gain K",
    ]
    assert r"\texttt{-{}-solve}" in as_latex(c)


def test_the_unconstrained_acceleration_gives_way_to_the_names_of_the_file():
    c = small(
        scene("x: 1", "a_x_*x^2/2", "a_x*x_dot^2/2", parameters="a_x: 2, a_x_: 3"),
        with_gauss=True,
    )
    assert "G = a_x (ẍ − ā_x)²/2" in as_text(c)
    assert "a_x__ = -a_x_*x/a_x" in as_text(c, ascii_only=True)
    latex = as_latex(c)
    check(latex)
    assert r"a_{x} \, \left(\ddot{x} - \bar{a}_{x}\right)^{2}" in latex
    assert as_json(c)["gauss"]["a"] == {"a_x__": "-a_x_*x/a_x"}


@pytest.mark.parametrize("law", ["limit: 1", "when: t < 1"])
def test_what_a_law_may_take_away_is_not_conserved(law):
    text = scene("x: 0, y: 0", constraints="c: {relation: x_dot = 0, LAW}")
    assert kept(small(text.replace("LAW", law))).keys() == {("y",)}
    assert kept(small(text.replace(", LAW", ""))).keys() == {(), ("y",)}


def test_modes_keep_their_names_where_parameters_are_numbers():
    c = small(
        scene("x: 1", "k*u*x^2", parameters="k: 3", modes="u: 1")
        + "events: {turn: {at: x <= 0, set: {u: u + k}, once: true}}\n",
        substitute=True,
    )
    assert as_json(c)["accelerations"]["q_ddot"] == ["-6*u*x"]
    turn = {"at": "x <= 0", "every": None, "once": True, "set": {"u": "3 + u"}}
    assert as_json(c)["events"] == {"turn": turn}
    assert "  turn acts once, at x <= 0\n  u = 3 + u\n" in as_text(c)


def test_impulses_of_events_are_printed_by_their_directions():
    text = scene("x: 1", "x^2", parameters="J: 3")
    c = small(f"{text}events: {{kick: {{every: 2, impulse: {{x: J*x}}}}}}\n")
    assert as_json(c)["events"]["kick"]["impulse"] == {"x": "J*x"}
    words = "  kick acts every 2\n  with the impulses, along each name\n  x = J x\n"
    assert words in as_text(c)


INSIDE = " + ".join(f"{n}*cos({n}*th1 - {n + 1}*b)" for n in range(2, 14))
LONG = """\
name: long
parameters: {m: 1, k: 2}
coordinates: {th1: {unit: rad}, b: {unit: rad}}
energy:
  kinetic: m*th1_dot^2/2 + m*b_dot^2/2
  potential: >-
    k*sqrt(NUMBERS)
initial: {th1: 0, b: 0}
simulation: {duration: 1}
"""


@pytest.mark.slow
@pytest.mark.parametrize("ascii_only", [False, True])
def test_long_equations_break_where_they_are_one_term(ascii_only):
    text = as_text(small(LONG.replace("NUMBERS", f"200 + {INSIDE}")),
                   ascii_only=ascii_only)  # fmt: skip
    for line in text.splitlines():
        shown = [c for c in line if not unicodedata.combining(c)]
        assert len(shown) <= 100, line
    # Nothing is lost where lines break.
    whole = " ".join(text.split())
    assert all(f"{n}{'*' if ascii_only else ' '}cos(" in whole for n in range(2, 14))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["double-pendulum", "chain-cartesian"])
def test_long_terms_of_latex_break(name):
    document = as_latex(
        derived(derive(read((MODELS / f"{name}.yaml").read_text(), "m")), expand=True)
    )
    check(document)
    rows = [x for x in document.splitlines() if "&" in x and "quad" not in x[:9]]
    assert max(map(as_latex_width, rows)) <= LONGEST_LINE + 4
    assert "\\bigl" in document


@pytest.mark.slow
def test_a_denominator_of_latex_longer_than_a_line_is_stacked():
    sought = LONG.replace("sqrt(NUMBERS)", f"th1/(200 + {INSIDE})")
    document = as_latex(small(sought))
    check(document)
    lines = re.split(r"\n|\\\\|\\begin\{gathered\}", document)
    assert max(map(as_latex_width, lines)) <= LONGEST_LINE + 4
    whole = " ".join(document.replace(r"\\ {}", "").split())
    for n in range(2, 14):  # in V, in L, in both slopes, and in both equations
        found = rf"{n} \, \cos\left({n + 1} \, b - {n} \, \mathit{{th}}_{{1}}"
        assert whole.count(found) >= 6


def test_names_longer_than_a_line_of_latex():
    x = "x" * LONGEST_LINE
    check(as_latex(small(scene(f"{x}: 1", f"{x}/(1 + {x}^2)", f"{x}_dot^2/2"))))


@pytest.mark.slow
def test_a_factor_of_latex_longer_than_a_line_keeps_its_power():
    sought = LONG.replace("sqrt(NUMBERS)", f"(200 + {INSIDE})^7.5")
    document = as_latex(small(sought))
    check(document)
    for power in ("15", "13"):  # in V, and in its slopes
        assert rf"\bigr)^{{\frac{{{power}}}{{2}}}}" in document


@pytest.mark.parametrize("name", ["q", "a_longer_name"])
def test_nested_choices_are_broken_within_the_width(name):
    inner = name
    for k in range(15):
        inner = f"{'min' if k % 2 else 'max'}({inner}, {k + 2}*{name}^2)"
    text = as_text(
        small(f"""
coordinates: {{{name}: {{}}}}
energy: {{kinetic: {name}_dot^2, potential: "{inner}"}}
initial: {{{name}: 0.1}}
""")
    )
    row = re.search(r"\n  V = (.*?)\n  L", text, re.DOTALL)[1]
    assert row.count("(") == row.count(")") == 15
    assert max(map(len, row.split("\n"))) <= 100
