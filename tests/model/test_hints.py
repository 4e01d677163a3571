"""A hint names the intended form; a file that follows the hint is right.

The advice of a hint replaces the mistake by a rule, not by hand; then the file must
have no fault, an admissible start, and the intended value. The mistake is marked ⟪so⟫
where it is not the whole text; ¶ is a line break, and three blanks separate texts of
equal meaning.
"""

import functools
import math
import re

import pytest

from lagsim.admissibility.examination import examine
from lagsim.errors import InputError
from lagsim.language.evaluate import evaluate
from lagsim.mechanics.derivation import derive
from lagsim.model.reader import read
from lagsim.model.reader.fields import MAX_GUESSES
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
    """Return the advice in a hint: the text to write."""
    for pattern in SAYS:
        if found := re.search(pattern, hint):
            text = next((g for g in found.groups() if g is not None), "")
            text = "\n  ".join(re.findall("`([^`]+)`", text)) or text
            return f"if({text})" if r"write if\(" in pattern else text
    raise AssertionError(f"this says nothing to write: {hint}")


# Where, the value that is meant, and texts for it.
CASES = [
    ("rate", 100 * PI, "3000 min^-1   3000 1/min   3000 U/min   3000/min"),
    ("initial", 0.0012, "1,2e-3"),
    ("initial", -0.5, "−0.5"),
    ("parameter", 5.0, "{⟪val⟫: 5}   5kg*m^2   5 Ns/m   [5 kg]   5 kg"),
    ("parameter", 6.67e-11, "6.67e-11 m^3/(kg s^2)"),
    ("parameter", 1000.0, "1000e−0   1·10³   1d3"),
    ("parameter", 9.81, "9.81 m s^-2   9.81 m/s**2   9.81 m/s²   9.81 m/s^{-2}"),
    ("parameter", 9.81, "9.81 m·s⁻²   9.81 ms⁻²   {value: 9,81}"),
    ("rate", 1500 * 2 * PI / 60, "{value: 1500, unit: rpm}   1500 rpm   1500rpm"),
    ("rate", PI / 6, "30 deg/s   30°/s"),
    ("definition", 4 * L, "2 m l"),
    ("rate", 4 * PI, "2 Hz"),
    ("initial", PI / 6, "{value: 30, unit: deg}   radians(30)   deg(30)   30°"),
    ("initial", PI / 6, "pi/6 rad"),
    ("initial", -PI / 6, "-30 degrees"),
    ("initial", PI / 4, "50 grad   π/4   np.pi/4   45*π/180   45 Deg   45º"),
    ("initial", 1.0, "{value: 1, unit: rad}   1 rad   [1]"),
    ("initial", 2 * PI, "2 pi"),
    ("duration", 2.0, "{value: 2, unit: s}   2;   2,   2 s   [2]"),
    ("duration", 1000.5, "1,000.5   1.000,5   1 000.5"),
    ("duration", 1000.0, "1'000   1_000"),
    ("parameter", 1.0, "[1, N]   1 [m]"),
    ("parameter", 7.0, "{value: 7 kg}"),
    ("parameter", 0.5, "1/2 kg"),
    ("parameter", 3000.0, "3 kN/m"),
    ("parameter", 1.5, "1.5f   1½"),
    ("parameter", 1e-06, "1-e6"),
    ("parameter", 2.0, "2.0 ± 0.1   ~2.0   mm"),
    ("definition", -1.1, "-x_dot N"),
    ("definition", math.cos(T), "\\cos\\theta   Cos[theta]   COS theta   cosθ"),
    ("definition", L * math.sin(T), "lsin(theta)"),
    ("definition", X / 2, "x*Rational(1,2)   0,5*x   if x > 0 then 0,5*x else l"),
    ("definition", X / 2, "max(0,5*x, -l)"),
    ("definition", 1.1, "diff(x, t)   x.diff()   \\dot{x}   d/dt(x)   d/dt x   Dot(x)"),
    ("definition", 1.1, "∂x/∂t   x.dot   X_DOT   x.dt   x'   x′   ẋ   x.diff(t)"),
    ("definition", 1.1, "dot x   xDot"),
    ("definition", 0.9, "d^2x/dt^2   \\ddot{x}   d²x/dt²   d2x/dt2   xdotdot   x.ddot"),
    ("definition", 0.9, "x''   a_x   ẍ"),
    ("definition", X, "if x > 0 then x else l   np.where(x > 0, x, l)   x ⟪+⟫   = x"),
    ("definition", X, "x if x > 0 else l   ite(x > 0, x, l)   x(t)   x[t]   [x]"),
    ("definition", L * X, "l*(x if x > 0 else l)"),
    ("definition", X, "fmod(x, l)   x mod 2   \\lvert x \\rvert   \\left|x\\right|"),
    ("definition", -X, "fmod(-x, l)   rem(-x, l)   fmod(-x, -l)"),
    ("definition", X, "float(x)   x.   y = x"),
    ("definition", math.asin(X), "sin^-1(x)   sin⁻¹(x)"),
    ("definition", math.sin(math.radians(T)), "sin(theta°)"),
    ("definition", math.sin(T), "SIN(theta)   sin[theta]   sin theta   sintheta"),
    ("definition", math.sin(2 * T), "sin 2*theta   sin 2θ   \\sin 2\\theta"),
    ("definition", math.sin(2 * X), "sin2x"),
    ("definition", math.sin(X) ** 2, "sin^2(x)   sin²(x)   sin^2 x   sin2(x)"),
    ("definition", math.sin(T) ** 2, "sin²θ"),
    ("definition", math.tan(X) ** (-2), "cot^2(x)"),
    ("definition", math.cos(X + L) ** 2, "cos**2(x + l)"),
    ("definition", 1.21, "x_dot2   ½mẋ²   ½·m·x'^2   \\tfrac{1}{2}m\\dot{x}^{2}"),
    ("definition", X ** 0.5, "\\sqrt{x}   sqrt x   x^½   √x"),
    ("definition", X ** 2, "\\frac{1}{2} m x^2   np.power(x, 2)   power(x,2)   x²"),
    ("definition", X ** 2, "x^{2}   0.5mx^2   x2"),
    ("definition", (X + L) ** 2, "\\left(x + l\\right)^{2}   pow(x + l, 2)"),
    ("definition", math.log10(X), "log_10(x)   log(x, 10)   lg(x)"),
    ("definition", 1.0, "l % 2   if(x > 0 && x < 1, 1, 2)"),
    ("definition", 1.0, "if(x > 9 || x < 1, 1, 2)   if(x > 0 & x < 1, 1, 2)"),
    ("definition", 1.0, "if(x != 0, 1, 2)   l div 2   if(l == 3, 1, 2)"),
    ("definition", 1.0, "if(x => 0, 1, 2)   if(l = 3, 1, 2)   if(x ≥ 0, 1, 2)"),
    ("definition", 1.0, "l // 2   t > 1   if(x≠0, 1, 2)"),
    ("definition", 0.0, "cos(x) > 2   round(x)"),
    ("definition", math.atan2(X, L), "np.arctan2(x, l)   atan(x, l)   atan2(x/l)"),
    ("definition", 3.0, 'max(x, l, 1)   max(x; l)   "x > 0 ? l : x"   l when t > 1'),
    ("definition", 3.0, "(t > 1)*l   l if t > 1"),
    ("definition", math.sin(X), "math.sin(x)   \\mathrm{sin}(x)"),
    ("definition", math.sin(X), "Modelica.Math.sin(x)   sin x"),
    ("definition", PI, "math.pi   pi()   PI"),
    ("definition", math.exp(X), "exp^x   e^x"),
    ("definition", 2 * math.exp(-X), "2*e^(-x)"),
    ("definition", 2 * abs(X - L), "2*|x - l|   |x - l|*2"),
    ("definition", (X + 1) ** 0.5, "sqrt(x + 1,0)   √(x+1)"),
    ("definition", -1.21 - X**2, "-x\u0307² − x²   -ẋ² - x²"),
    ("definition", X * L, "x\u200b*l   x \\cdot l   x.*l   x·l   x×l   x⋅l   x l"),
    ("definition", X * L, "l × x   m·l·x/2   x∙l"),
    ("definition", X / L, "\\frac{x}{l}   x÷l   \\frac{\\frac{x}{2}}{l}*m   $x/l$"),
    ("definition", 2 * X, "2x"),
    ("definition", X * (L + 1), "x(l + 1)"),
    ("definition", T, "\\theta   Theta   θ"),
    ("definition", 0.6, "θ\u0308"),
    ("definition", None, "\\frac{m}{2}\\dot{x}^2 + \\sin^2\\theta"),
    ("definition", math.sin(math.cos(X)) ** 2, "sin^2(cos(x))"),
    ("definition", -0.4, "d(theta)/dt   dot(theta)   θ\u0307   thetȧ   θ'"),
    ("definition", 2.0, "if(!(x > 0), 1, 2)   if(x =< 0, 1, 2)   if(x ≤ 0, 1, 2)"),
    ("definition", 4.0, "2*⟪time⟫"),
    ("definition", L * 1.21, "l*x'**2"),
    ("definition", 2.2, "2*⟪dx/dt⟫"),
    ("energy", None, "{x}   [x]"),
    ("definition", 4 * PI, "2πt   2·π·t"),
    ("definition", 9 * 0.16, "½·m·l²·θ\u0307²   ½ m l² θ\u0307²"),
    ("definition", 9 * 0.16, "\\frac12 m l^2 \\dot\\theta^2"),
    ("definition", L * 2**0.5, "√2*l   l·√2   l√2"),
    ("definition", 9.09**0.5, "√(l² + x²)   \\sqrt{l^2+x^{2}}"),
    ("definition", 6 * (1 - math.cos(T)), "m·l·(1 − cos θ)   ml(1-cosθ)"),
    ("definition", 6 * math.cos(T), "mlcosθ   m l \\cos\\left(\\theta\\right)"),
    ("definition", math.exp(-X), "e^{-x}   e^{-\\frac{3x}{l}}   np.exp(-x)"),
    ("definition", math.cos(PI * X), "np.cos(np.pi*x)   Math.cos(Math.PI*x)"),
    ("definition", 3 * math.sin(X), "3sinx   3 sin x   params['l']*sin x"),
    ("parameter", 2.4, "{value: 0,4*m*l}   {value: m*0,4*l}   0,4*m*l"),
    ("parameter", 5e-6, "5 µm"),
    ("parameter", 12345678.5, "{value: 12,345,678.5}   12,345,678.5"),
    ("rate", 10.0, "10 1/s   10 s⁻¹   36 kph   10 rad·s^{-1}"),
    ("relation", None, "ẋ = 0   xdot² = 0   x² − x² = x_dot   x_dot = 0 m"),
    ("relation", None, "x_dot == 0   x_dot := 0   x_dot ≈ 0   x_dot =   x_dot > 0"),
]  # fmt: skip
SPELT = [(where, text, x) for where, x, texts in CASES for text in texts.split("   ")]


def text_with(where, text):
    return MODEL.format(**{**SOUND, where: text})


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


@functools.cache
def admitted(text):
    """Read a text; fail where `check` would not accept the start."""
    model = read(text, "model.yaml")
    assert examine(derive(model), model.settings({}).start).admissible
    return model


@pytest.mark.parametrize(("where", "text", "meant"), SPELT)
def test_a_hint_that_is_followed_gives_what_was_meant(where, text, meant):
    before, part, after = re.split("[⟪⟫]", text if "⟪" in text else f"⟪{text}⟫")
    [problem] = problems(text_with(where, before + part + after))
    followed = before + said(problem.whole.hint) + after
    try:
        model = admitted(text_with(where, followed))
    except InputError as error:
        pytest.fail(f"{problem.hint!r} gave {followed!r}: {error}")
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

# What is replaced in the file, and mistakes there.
FILES = {
    "kinetic:": "⟪T⟫:",
    "initial:": "⟪x0⟫:",
    "g: 9.8": "g: ⟪9,8⟫",
    "simulation:": "⟪sim⟫:",
    "coordinates:": "⟪dof⟫:",
    "scene:": "⟪visualization⟫:",
    "links:": "⟪edges⟫:   ⟪lines⟫:",
    "x: -x": "⟪X⟫: -x   ⟪x_dot⟫: -x",
    "potential:": "⟪Potential⟫:   ⟪V⟫:",
    "definitions:": "⟪define⟫:   ⟪positions⟫:",
    "end": "⟪to⟫   ⟪t_end⟫   ⟪stop_time⟫   ⟪End⟫",
    "forces:": "⟪generalized_forces⟫:   ⟪damping⟫:",
    "¶    - {x: t, y: theta}": " ⟪{x: t, y: theta}⟫",
    "simulation:¶  end: 2": "simulation: {end: ⟪2,0⟫}",
    "theta: {unit: rad}¶  x: {unit: m}": "⟪- theta¶  - x⟫",
    "initial:¶  theta: 1¶  x: 0": "initial: {theta: ⟪1,0⟫, x: 0}",
    "parameters:¶  l: 1¶  g: 9.8": "parameters: {l: 1, g: ⟪9,8⟫}",
    "l: 1¶": "l: {⟪default⟫: 1}¶   ⟪l (m)⟫: 1¶   ⟪l=1⟫¶   l: ⟪{1, m}⟫¶",
    "¶  theta: {unit: rad}¶  x: {unit: m}": " ⟪[theta, x]⟫    ⟪theta, x⟫",
    "columns: [s]": "columns: ⟪s⟫   columns: [⟪S⟫]   ⟪variables⟫: [s]   columns: ⟪{s}⟫",
    "[[pivot, bob]]": "[[pivot, ⟪bop⟫]]   ⟪[pivot, bob]⟫   ⟪pivot, bob⟫   "
        "[⟪pivot-bob⟫]   [⟪[pivot bob]⟫]   ⟪{pivot: bob}⟫   ⟪pivot -> bob⟫",
    "end: 2": "⟪tspan: [0, 2]⟫   ⟪t_span: (0, 2)⟫   ⟪end: [0, 2]⟫   "
        "⟪end: linspace(0, 2, 101)⟫   end: 2¶  ⟪steps: 1000⟫   "
        "start: 0¶  end: 2¶  ⟪points: 1000⟫   end: 2¶  ⟪fps: 500⟫   ⟪end=2⟫   "
        "⟪end:2⟫   ⟪end 2⟫   ⟪end: 0:2⟫   ⟪end: 0 to 2⟫   "
        "end: 2¶  output_step: ⟪500 Hz⟫   ⟪from⟫: 0¶  end: 2",
    "bob: [s, c]": "bob: ⟪\"[s, c]\"⟫   bob: ⟪{pos: [s, c]}⟫   bob: ⟪(s, c)⟫   "
        "bob: ⟪s, c⟫   bob: ⟪[s c]⟫   bob: ⟪{x: s, y: c}⟫   bob: [s⟪;⟫ c]",
    "- {x: t, y: theta}": "- ⟪theta vs t⟫   - {x: ⟪time⟫, y: theta}   - ⟪theta⟫   "
        "- ⟪[t, theta]⟫   ⟪-{x: t, y: theta}⟫   - ⟪{t, theta}⟫",
    "theta: {unit: rad}": "⟪theta: unit: rad⟫   theta: {⟪unit rad⟫}   "
        "theta: ⟪unit rad⟫   theta: ⟪[rad]⟫   theta: ⟪rad⟫   theta: ⟪1⟫   "
        "theta: {⟪units⟫: rad}",
    "theta: 1¶": "⟪theta: [1, 0]⟫¶   ⟪theta: 1, 0⟫¶   ⟪- theta: 1⟫¶   "
        "⟪theta: {value: 1, rate: 0}⟫¶   theta: 1¶  ⟪d/dt theta⟫: 0¶   "
        "theta: 1¶  ⟪\\dot{theta}⟫: 0¶   theta: 1¶  ⟪theta'⟫: 0¶   "
        "theta: 1¶  ⟪dtheta/dt⟫: 0¶   ⟪theta(0)⟫: 1¶   ⟪theta0⟫: 1¶   ⟪Theta⟫: 1¶   "
        "⟪θ⟫: 1¶   ⟪theta = 1⟫¶   ⟪theta:1⟫¶",
    "rod: x_dot = 0": "rod: {⟪contact⟫: x_dot = 0}   rod: {⟪relation = x_dot = 0⟫}   "
        "rod: {⟪eq⟫: x_dot = 0}   rod: ⟪x_dot == 0⟫",
    "forces:¶  x: -x_dot": "forces: ⟪{x, -x_dot}⟫   forces: ⟪[x, -x_dot]⟫   "
        "forces: ⟪[x -x_dot]⟫   forces: ⟪x, -x_dot⟫   forces:¶  ⟪- [x, -x_dot]⟫   "
        "forces:¶  x: ⟪{force: -x_dot}⟫",
    "kinetic: (l^2*theta_dot^2 + x_dot^2)/2": "kinetic: ⟪½(l²θ̇² + ẋ²)⟫   "
        "kinetic: ⟪0.5(l^2 thetadot^2 + xdot^2)⟫   "
        "⟪kinetic:(l^2*theta_dot^2 + x_dot^2)/2⟫",
    "parameters:¶  l: 1¶  g: 9.8¶": "parameters:¶  ⟪l := 1⟫¶  g: 9.8¶   "
        "parameters:¶  ⟪l 1⟫¶  g: 9.8¶   parameters:¶  ⟪l = 1;⟫¶  g: 9.8¶   "
        "parameters:¶  l: ⟪{1 m}⟫¶  g: 9.8¶   "
        "parameters:¶  l: ⟪[{value: 1}]⟫¶  g: 9.8¶",
    "coordinates:¶  theta: {unit: rad}¶  x: {unit: m}": "coordinates: ⟪theta x⟫   "
        "coordinates:¶  ⟪theta¶  x⟫   coordinates:¶  theta: {⟪rad⟫}¶  x: {unit: m}",
    "theta: 1¶  x: 0": "⟪\\dot{x}⟫: 0¶  theta: 1¶  x: 0   "
        "⟪der(x)⟫: 0¶  theta: 1¶  x: 0",
    "constraints:¶  rod: x_dot = 0":
        "constraints:¶  rod: {relation: x_dot = 0, limit: ⟪0,4*g⟫}",
    "potential: -g*c¶": "potential: ⟪−g·c⟫¶   potential: ⟪-gc⟫¶   "
        "potential: ⟪-g·(l·cos θ)⟫¶   potential: ⟪-g c⟫¶   potential: ⟪-g*c\"⟫¶",
    "potential: -g*c": "potential: -⟪G⟫*c   potential: ⟪- g*c⟫   potential: ⟪[-g*c]⟫   "
        "potential: -g*c⟪;⟫",
}  # fmt: skip
MISTAKES = [
    (old.replace("¶", "\n"), new.replace("¶", "\n"))
    for old, texts in FILES.items()
    for new in texts.split("   ")
]


def meaning(model):
    """Return the content of a file, as far as the mistakes here can change it."""
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


def faults_of(old, new):
    """Return the faults of the file with `old` replaced by `new`."""
    assert FILE.count(old) >= 1
    with pytest.raises(InputError) as raised:
        read(FILE.replace(old, new, 1), "model.yaml")
    return raised.value.problems


@pytest.mark.parametrize(("old", "new"), MISTAKES)
def test_a_hint_for_a_file_that_is_followed(old, new):
    before, part, after = re.split("[⟪⟫]", new)
    found = [p.whole.hint for p in faults_of(old, before + part + after)]
    hint = next(h for h in found if "..." not in h.partition(";")[0])
    followed = before + said(hint) + after
    try:
        model = admitted(FILE.replace(old, followed, 1))
    except InputError as error:
        pytest.fail(f"{hint!r} gave {followed!r}: {error}")
    assert meaning(model) == meaning(admitted(FILE))


# What is replaced in the file, the mistake, a part of the hint, and what a person makes
# of it; nothing where that is what stood there before.
C, ROD, LINK = "c: l*cos(theta)", "rod: x_dot = 0", "[[pivot, bob]]"
ADVISED = [
    (C, "c: erf(x)", "name an expression in `definitions`", "c: cos(x)"),
    (C, "c: spring(x)", "name an expression in `definitions`", "c: x"),
    # what no file can have
    (C, "c: x(t - 0.1)", "there are no delays", "c: x"),
    (C, "c: 2*theta_dot(t - l)", "there are no delays", "c: 2*theta_dot"),
    (C, "c: rand()", "there are no random numbers", "c: 0.5"),
    (C, "c: randn(1)*x", "there are no random numbers", "c: x"),
    (C, "c: sqr(x)", "write x^2 for the square, sqrt(x) for the root", "c: x^2"),
    (C, "c: x(0) + x", "give the start value of x a name in `parameters`", "c: l + x"),
    (C, "c: sum(x)", "a sum over a family is written sum(i = 1..n, x(i))",
     "c: 'sum(i = 1..2, i*x)'"),
    (C, "c: 'if(x>0,1)'", "write if(x>0,1, 0)", "c: 'if(x>0,1, 0)'"),
    (C, "c(v): v^2", "write `c`: a definition has no arguments", "c: x^2"),
    (C, "c: delay(x, 0.1)", "there are no delays", "c: x"),
    (C, "c: integral(x)", "an integral over time is a first-order state", "c: x"),
    (C, "c: dirac(t)", "an impulse is given by an event", "c: 0"),
    (C, "c: interp1(x)", "a curve is given in `tables`", "c: x"),
    (C, "c: dot(x, 2)", "its arguments are vectors, vec(a, b)",
     "c: 'dot(vec(x, 0), vec(2, 0))'"),
    (C, "c: omega(arm)", "this file has no `frames`", "c: x_dot"),
    (C, C + "\n  d(1:3): x", "write d(1..3): a range contains both ends",
     C + "\n  d(1..3): x"),
    (C, "c: .nan", "every number is finite", "c: 1"),
    (C, "c: 0x1F*x", "write 31", "c: 31*x"),
    (C, "c: 2*(sin(x) > 0)", "write if(condition, a, b)", "c: if(sin(x) > 0, 2, 0)"),
    (C, "c: d/dt(l*x)", "write r_dot, with `r: l*x` in `definitions`",
     "r: l*x\n  c: r_dot"),
    ("s: x + l*sin(theta)", "s: x) + 1", "count the parentheses", ""),
    ("columns: [s]", "columns: [s, x) + 1]", "define it in", ""),
    ("bob: [s, c]", "bob: [s, c", "something else where", ""),
    ("  end: 2", "\tend: 2", "indent with spaces", ""),
    ("  end: 2", "  end: 2\n   start: 0", "begin in the same column",
     "  end: 2\n  start: 0"),
    ("  end: 2", "  end: 2\n start: 0", "begin in the same column",
     "  end: 2\n  start: 0"),
    ("  theta: {unit: rad}", "  theta", "write `theta:`", "  theta:"),
    (C, "c: 'l'*cos(theta)", "quote the whole value", "c: 'l*cos(theta)'"),
    (C, 'c: "\\cos(theta)"', "", ""),
    ("  theta: 1\n", "", "write `theta: 0`", "  theta: 0\n"),
    ("  theta: 1\n", "  s: 1\n", "write `theta: {guess: 0}`",
     "  theta: {guess: 0}\n  s: 1\n"),
    ("  end: 2", "end: 2", "belongs below `simulation:`, indented", ""),
    ("  end: 2", "  end: 2\nfriction: 0.1",
     "belongs to an entry of `constraints`: constraints: {name: {friction: ...}}", ""),
    ("forces:\n  x: -x_dot\n", "damping: x_dot^2/2\n",
     "`dissipation` belongs below `energy:`, indented", "  dissipation: x_dot^2/2\n"),
    (LINK, "[[pivot, ball]]", "the points are `bob`, `pivot`", ""),
    ("  points:\n    bob: [s, c]\n    pivot: [0, 0]\n", "",
     "give it a place: points: ", "  points: {bob: [s, c], pivot: [0, 0]}\n"),
    ("  s:", "  d: lagrangian\n  s:", "write kinetic - potential",
     "  d: kinetic - potential\n  s:"),
    ("  x: -x_dot\n", "  bob: -x_dot\n", "a force acts along one of `theta`, `x`, `s`",
     ""),
    (C, "c: sin()", "`sin` takes 1 argument", "c: sin(theta)"),
    (C, "c: if(0 < x < 1, 1, 2)", "write a < b and b < c",
     "c: if(0 < x and x < 1, 1, 2)"),
    (C, "c: l*（theta)", "write its plain form, '('", "c: l*(theta)"),
    (ROD, "rod = x_dot", "a colon is missing: `rod: x_dot`", "rod: x_dot"),
    (ROD, "rod: x_dot >= 0, restitution: 0", "write `rod: {relation: x_dot >", ""),
    ("bob: [s, c]", "bob: s", "write [s, 0]", "bob: [s, 0]"),
    ("    bob: [s, c]\n    pivot", "  bob: [s, c]\n  pivot", "below `points:`, i", ""),
    ("{x: t, y: theta}", "{y: theta}", "write `x: t`", "{x: t, y: theta}"),
    ("y: theta}", "y: theta, label: a}", "`title`", "y: theta, title: a}"),
    ("y: theta}", "y: theta, s}", "write `y: [theta, s]`", "y: [theta, s]}"),
    ("y: theta}", "y: x, title: A, or b}", 'write `title: "A, or b"`', ""),
    ("y: theta}", "y: angle}", "define `angle` in `definitions`", ""),
    ("  theta: {unit: rad}\n", "", "write `theta: {}` in `coordinates`", ""),
    ("definitions:\n  s", "sizes:\n  s", "known are `lagsim`", "definitions:\n  s"),
    ("kinetic: (", "kinetic: y_dot^2 + (", "define `y` in `coordinates` or", ""),
    ("  end: 2", "  end: 2\n  stop: x = 1", "`until`", "  end: 2\n  until: x = 1"),
    ("  x: 0\n", "  g: 1\n  x: 0\n", "its value belongs in `parameters`", ""),
    # sections in others, keys of sections beside them, lines that are not indented
    ("initial:\n  theta: 1\n  x: 0", "  initial:\n    theta: 1\n    x: 0",
     "`initial` belongs at the top of the file", ""),
    ("simulation:\n  end", "  simulation:\n    end",
     "`simulation` belongs at the top of the file", ""),
    ("parameters:\n  l: 1\n  g: 9.8\ncoordinates:\n",
     "coordinates:\n  parameters:\n    l: 1\n    g: 9.8\n",
     "`parameters` belongs at the top of the file, without indentation", ""),
    ("simulation:\n  end", "simulation:\nend", "`end` belongs below `simulation:`", ""),
    ("simulation:\n  end", "end", "`end` belongs below `simulation:`, indented", ""),
    ("  theta: 1\n  x: 0\n", "theta: 1\nx: 0\n",
     "two blanks before each line that belongs to `initial`", ""),
    ("  l: 1\n  g: 9.8\n", "l: 1\ng: 9.8\n", "line that belongs to `parameters`", ""),
    ("  l: 1\n  g: 9.8\n", "  l = 1\n  g: 9.8\n", "write `l: 1`", ""),
    ("energy:", "plots: []\nenergy:", "`plots` belongs below `output:`, indented",
     "energy:"),
    ("scene:", "scene:\n  plots: []", "`plots` belongs below `output:`, indented",
     "scene:"),
    # what is no expression
    ("  l: 1", "  l: 1.5.2", "one decimal point", ""),
    ("  l: 1", "  l: inf", "finite", ""),
    ("  l: 1", "  l: 3i", "every number is real", ""),
    (C, "c: x[1]", "is written q(1)", "c: x"),
    (C, "c: ‘x’", "an expression contains no quotes", "c: x"),
    ("  end: 2", "  end: 1:30", "one number", "  end: 90"),
    ("  theta: 1", "  theta: guess", "{guess: 0}", "  theta: {guess: 0}"),
    ("  theta: 1", "  theta: none", "such as 0", "  theta: 0"),
    (C, "c: x!", "no factorial", ""),
    (C, "c: stiffness*x", "`stiffness` a value in `parameters`", ""),
    (C, "c: v", "theta_dot", "c: theta_dot"),
]  # fmt: skip


@pytest.mark.parametrize(("old", "new", "part", "followed"), ADVISED)
def test_advice_that_is_followed(old, new, part, followed):
    found = faults_of(old, new)
    assert any(part in p.whole.hint for p in found)
    assert len(found) <= 3  # what is misplaced is reported once, not missing too
    admitted(FILE.replace(old, followed or old, 1))


def test_names_may_be_those_of_sections():
    text = FILE.replace("  l: 1", "  l: 1\n  scene: {value: 3, unit: m}\n  output: 2")
    text = text.replace("l*cos(theta)", "l*cos(theta) + scene*output")
    assert read(text, "model.yaml").name == "model"


@pytest.mark.parametrize(
    "text", ["((((" * 5000, "1 " * 5000, "sin " * 5000, "x" * 20000, "?:" * 9999]
)
def test_long_texts_take_no_longer(text):
    # Patterns that backtrack over all of it would take for ever.
    assert problems(text_with("definition", text))


def test_so_many_faults_are_looked_at_and_no_more():
    """Looking costs time: a file full of faults has a hint of its own for the first."""
    count = MAX_GUESSES + 5
    text = "parameters:\n" + "".join(f"  p{k}: sin 2\n" for k in range(count))
    found = [problem.hint == "write sin(2)" for problem in problems(text)]
    assert MAX_GUESSES == 200
    assert found == [True] * 200 + [False] * 5
