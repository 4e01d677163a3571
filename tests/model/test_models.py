"""Valid files: the data of each section, with expected values worked out by hand."""

import hashlib
import math

import pytest

from lagsim.language.evaluate import evaluate
from lagsim.model.model import Level
from lagsim.model.reader import read
from tests.model._files import completed, model, problems
from tests.model.test_faults import table

FULL = """\
# yaml-language-server: $schema=lagsim.schema.json
lagsim: 1
name: elastic-pendulum
description: A mass on a spring that swings from a pivot.
source: H. P. Gavin, CEE 541, section 9
x-note: [{anything: goes}, here]

parameters:
  l: 2
  g: {value: 9.8, unit: m/s^2, description: gravity, x-checked: yes}
  K: 10*l
  M: 1.0
  c: 010
  min: 3

coordinates:
  theta: {unit: rad, description: swing}
  u:

definitions:
  tension: lambda_path + y_ddot + 0*Qc_u + kinetic - potential + 0*energy + theta_ddot
  above: 2*tension
  x: (l + u)*sin(theta)
  y: -(l + u)*cos(theta)
  speed: {value: sqrt(x_dot^2 + y_dot^2), unit: m/s, description: of the mass}
  slide: x_dot - u*theta_dot + t

energy:
  kinetic: M*(x_dot^2 + y_dot^2)/2
  potential: M*g*(l + y) + K*u^2/2
  dissipation: c*u_dot^2/2

forces:
  u: min*cos(t)
  x: -x_dot
  slide: min(slide, 1)

constraints:
  path: u = l - l*theta^2
  top: {relation: y <= 1.5, restitution: 0.8, description: the ceiling}
  floor:
    relation: y >= -1.5
    restitution: c/20
    friction: {static: 0.4, dynamic: 0.3}
    slip: [x_dot, 2*slide]
  roll: x_dot - u*theta_dot

initial:
  u_dot: {guess: 3}
  theta: 1/10
  u: 5*theta
  x: 0.7
  y_dot: x + u

simulation:
  start: 1
  duration: 4*l
  until: y <= 0
  output_step: 0.02
  method: rk4
  rtol: 1e-9
  atol: 0
  step: l/200

scene:
  points: {pivot: [0, 0], bob: [x, y], high: [x, y, 1]}
  links: [[pivot, bob]]

output:
  columns: [y, x]
  plots:
    - {x: theta, y: u, title: Path in configuration space}
    - {x: t, y: tension + lambda_path}
"""

# A state at which everything is easy: theta = 0, u = 1, so x = 0 and y = -(2 + 1),
# x_dot = 3*theta_dot, y_dot = -u_dot.
STATE = {
    "l": 2.0, "g": 9.8, "K": 20.0, "M": 1.0, "c": 10.0, "min": 3.0, "t": 0.5,
    "theta": 0.0, "u": 1.0, "theta_dot": 2.0, "u_dot": 5.0,
    "theta_ddot": 0.25, "u_ddot": 0.125, "lambda_path": 1000.0, "Qc_u": 7.0,
    "energy": 11.0,
}  # fmt: skip
KINETIC = (6.0**2 + 5.0**2) / 2
POTENTIAL = 9.8 * (2.0 - 3.0) + 20.0 / 2


@pytest.fixture(scope="module")
def full():
    return read(FULL, "somewhere/pendulum.yaml")


def line_of(start):
    lines = FULL.split("\n")
    return next(i for i, line in enumerate(lines, 1) if line.startswith(start))


def at_state(m, nodes):
    return evaluate(m.graph, [*nodes], STATE)


def test_names_and_texts(full):
    assert (full.name, full.file) == ("elastic-pendulum", "somewhere/pendulum.yaml")
    assert full.description == "A mass on a spring that swings from a pivot."
    assert full.source == "H. P. Gavin, CEE 541, section 9"
    assert full.sha256 == hashlib.sha256(FULL.encode()).hexdigest()
    assert [(p.name, p.value) for p in full.parameters] == [
        ("l", 2), ("g", 9.8), ("K", 20), ("M", 1), ("c", 10), ("min", 3),
    ]  # fmt: skip
    assert full.parameters[1][2:4] == ("m/s^2", "gravity")
    assert [q[:2] for q in full.coordinates] == [("theta", "rad"), ("u", "")]
    assert [(d.name, d.level) for d in full.definitions] == [
        ("tension", Level.OUTPUT), ("above", Level.OUTPUT), ("x", Level.POSITION),
        ("y", Level.POSITION), ("speed", Level.VELOCITY), ("slide", Level.VELOCITY),
    ]  # fmt: skip
    assert full.definitions[4][3:] == ("m/s", "of the mass")
    assert [(f.on, f.level) for f in full.forces] == [
        ("u", Level.POSITION), ("x", Level.POSITION), ("slide", Level.VELOCITY),
    ]  # fmt: skip
    assert full.forces[2].place.line == line_of("  slide: min")
    assert [(c.name, c.relation.equality, c.description) for c in full.constraints] == [
        ("path", True, ""), ("top", False, "the ceiling"),
        ("floor", False, ""), ("roll", True, ""),
    ]  # fmt: skip
    assert full.constraints[0].relation.text == "u = l - l*theta^2"
    laws = [c.law and (c.law.restitution, len(c.law.slips)) for c in full.constraints]
    assert laws == [None, (0.8, 0), (0.5, 2), None]


def test_expressions(full):
    """At theta = 0: y'' = -u'' + (l + u) theta'^2 = -0.125 + 12."""
    tension = 1000 + (12 - 0.125) + KINETIC - POTENTIAL + 0.25
    u, x, slide = full.forces
    path, top, floor, roll = full.constraints
    values = {d.node: x for d, x in zip(
        full.definitions,
        [tension, 2 * tension, 0.0, -3.0, math.sqrt(61), 6 - 2 + 0.5], strict=True,
    )} | {
        full.kinetic: KINETIC, full.potential: POTENTIAL,
        full.lagrangian: KINETIC - POTENTIAL, full.dissipation: 10 * 25 / 2,
        u.node: 3 * math.cos(0.5), x.node: -6.0, slide.node: 1.0,
        path.relation.node: 1 - 2.0, top.relation.node: 1.5 - -3.0,  # rhs - lhs
        floor.relation.node: -3.0 - -1.5, roll.relation.node: 6 - 2.0,  # lhs - rhs
        floor.law.friction: 0.3, floor.law.slips[0]: 6.0, floor.law.slips[1]: 9.0,
        floor.law.static: 0.4, full.until.node: 3.0,
    }  # fmt: skip
    assert at_state(full, values) == pytest.approx([*values.values()])
    assert u.direction == full.graph.variable("u")
    assert x.direction == full.definitions[2].node
    assert slide.direction == full.definitions[5].node
    assert full.until.equality is False


def test_initial(full):
    u = line_of("  u: 5*theta")
    assert [(v.name, v.node is None, v.guess) for v in full.initial] == [
        ("theta", True, False), ("u", True, False), ("theta_dot", True, False),
        ("u_dot", True, True), ("x", False, False), ("y_dot", False, False),
    ]  # fmt: skip
    values = [v.value for v in full.initial]
    assert values == pytest.approx([0.1, 0.5, 0.0, 3.0, 0.7, 1.2])
    assert (full.initial[1].text, full.initial[1].place.line) == ("5*theta", u)
    assert full.initial[4].node == full.definitions[2].node
    assert at_state(full, [full.initial[5].node]) == [-5.0]
    # A number alone is exact, what is computed is not.
    assert [v.error > 0 for v in full.initial] == [True, True, *3 * [False], True]
    assert full.initial[1].error < 1e-15


def test_simulation_scene_and_output(full):
    s = full.settings()
    assert (s.start, s.end, s.output_step) == (1, 9, 0.02)
    assert (s.method, s.rtol, s.atol, s.step) == ("rk4", 1e-9, 0, 0.01)
    assert s.method_place.line == line_of("  method:")
    x, y = (full.definitions[k].node for k in (2, 3))
    zero, one = full.graph.zero, full.graph.one
    assert full.scene.points == {
        "pivot": (zero, zero), "bob": (x, y), "high": (x, y, one),
    }  # fmt: skip
    assert full.scene.links == (("pivot", "bob"),)
    assert full.output.columns == ("y", "x")
    first, second = full.output.plots
    assert (first.x.text, [y.text for y in first.y]) == ("theta", ["u"])
    assert (first.title, second.title) == ("Path in configuration space", "")
    assert second.x.node == full.graph.variable("t")


def test_defaults():
    m = read(completed(""), "some/where/two masses.yaml")
    assert (m.name, m.until, m.dissipation, m.settings().duration) == (
        "two masses", None, None, 0.0,
    )  # fmt: skip
    assert (m.parameters, m.definitions, m.forces, m.constraints) == ((),) * 4
    assert (m.scene.points, m.output.columns) == ({}, ())
    assert [v.name for v in m.initial] == ["x", "y", "x_dot", "y_dot"]
    s = model("simulation: {end: 5}").settings()
    assert (s.start, s.end, s.output_step) == (0, 5, 5 / 1000)
    assert (s.method, s.rtol, s.atol, s.step) == ("auto", None, None, None)
    found = model("simulation: {start: 2, until: x <= 0, rtol: 1e-9}")
    s = found.settings()
    assert (s.start, s.duration, s.rtol) == (2, 0, 1e-9)  # there is nothing to run
    assert found.until is not None
    assert model("definitions: {b: x, a: y}").output.columns == ("b", "a")
    text = "definitions: {b: x, a: y}\noutput: {columns: []}"
    assert model(text).output.columns == ()


# What a stricter reader would refuse.
ALLOWED = r"""
parameters:
parameters: {}
definitions: ~
forces: null
scene:
output:¶
simulation:
constraints: {}
scene: {points: , links: }
output: {plots: }
parameters: {min: 1, sin: 2, if: 3}¶forces: {x: min*sin(sin)*if}
parameters: {I: 1, E: 2, S: 3, beta: 4, lambda: 5, e: 6, on: 7, no: 8}
parameters: {lambda_x: 1, residual_y: 2}¶constraints: {c: x = y}
constraints: {x: x = y}¶scene: {points: {x: [x, y]}}
parameters: {Ω: 1, λ_1: Ω}
energy: {kinetic: x_dot^2 + y_dot^2, potential: x*y_dot + t}
energy: {lagrangian: x_dot^2 + y_dot^2 - x, dissipation: x_dot^2}
simulation: {duration: 99999999, output_step: 1}
simulation: {start: 0.3, end: 0.4, output_step: 0.1}
simulation: {duration: 1, rtol: 0, atol: 1e-9}
constraints: {c: {relation: x >= 0, restitution: 0}}
constraints: {c: {relation: x >= 0, restitution: 1, friction: 0,
    slip: y_dot*cos(x) + t}}
constraints: {c: {relation: x >= 0, restitution: 1, slip: y_dot,
    friction: {static: 0.3, dynamic: 0.3}}}
constraints: {c: {relation: x_dot = t, limit: 0, when: t < 1 and t > 0}}
constraints: {c: {relation: x >= 0, restitution: 0, when: t < 1}}
constraints: {c: {relation: x_dot >= y_dot, when: not t < 1}}
constraints: {c: cos(y)*x_dot >= t*y_dot}¶definitions: {f: lambda_c}
constraints: {c: 'if(x > 0, x, y) = 0', d: {relation: t*x_dot^2 - 1}}
x-a: 1¶forces: {x: 1, x-b: 2}¶scene: {x-c: [1]}
definitions: {a: 'x +¶    y'}
"""


@pytest.mark.parametrize("text", [row for [row] in table(ALLOWED)])
def test_no_fault(text):
    assert problems(text) == []


def test_a_start_of_velocity_level_is_a_definition():
    m = model("definitions: {v: x_dot + y}\ninitial: {x: 0, y: 0, v: 2}")
    assert m.graph.depends([m.initial[-1].node]) == {"x_dot", "y"}


def test_zero_within_the_rounding_of_its_expression():
    # cos(pi/2) is 6.1e-17 in floating point, and 0 within the error of pi/2
    m = model("parameters: {l: 2}\ninitial: {x: l*cos(pi/2), y: 0.3 - 3*0.1}")
    x, y = m.initial[:2]
    assert 0 < x.value < 1.3e-16
    assert x.error >= x.value
    assert 0.0 < abs(y.value) <= y.error < 1e-15
    assert model("initial: {x: -0.1, y: 0}").initial[0].error == 0.0
    text = "parameters: {k: sin(pi), m: 0.1}\ninitial: {x: k, y: m}"
    x, y = model(text).initial[:2]  # the error of a parameter is inherited
    assert abs(x.value) <= x.error
    assert y.error == 0.0


OVERRIDDEN = """
parameters:
  k: 1
  m: {value: 2*k, unit: kg}
  n: 3
initial: {x: m, y: 0}
"""


def test_overrides_come_before_anything_is_evaluated():
    m = model(OVERRIDDEN, overrides={"k": "2*pi"})
    assert [p.value for p in m.parameters] == [2 * math.pi, 4 * math.pi, 3]
    assert m.initial[0].value == 4 * math.pi
    m = model(OVERRIDDEN, overrides={"m": "k + 4"})
    assert m.parameters[1][1:3] == (5, "kg")
    assert model("parameters: {a: 1/0}", overrides={"a": "1"}).parameters
    # start values: what is not stated there is added; others that use it follow
    text = "parameters: {k: 2}\ndefinitions: {s: x + y}\n"
    text += "initial: {x: {guess: 1}, y: 2*x, s: 0}"
    values = {"x": "k/2 + 1/4", "y_dot": "-3", "s": "5", "k": "4"}
    found = model(text, overrides=values).initial
    stated = {"x": 2.25, "y": 4.5, "x_dot": 0, "y_dot": -3, "s": 5}
    assert {s.name: s.value for s in found} == stated
    assert [s.name for s in found if s.guess] == ["x"]


@pytest.mark.parametrize(
    ("name", "expression", "code", "column", "part"),
    [
        ("kk", "1", "unknown-parameter", 7, "`k`"),
        ("k.m", "1", "unknown-parameter", 7, "`k.m`"),
        ("x_ddot", "1", "unknown-parameter", 7, "`x_ddot`"),
        ("", "1", "unknown-parameter", 7, ""),
        ("k", "2*", "expression-syntax", 11, ""),
        ("k", "2 3", "expression-syntax", 11, "2*3"),
        ("k", "", "expression-syntax", 9, ""),
        ("k", "m", "later-parameter", 9, "`m`"),
        ("m", "2*kk", "unknown-name", 11, "`k`"),
        ("k", "1/0", "not-finite", 9, "inf"),
        ("k", "\udcff", "expression-syntax", 9, "'?'"),
    ],
)
def test_faults_of_overrides(name, expression, code, column, part):
    (found,) = problems(OVERRIDDEN, overrides={name: expression})
    assert found.code == code
    assert part in f"{found.text} | {found.hint}"
    shown = expression.replace("\udcff", "?")
    assert found.place[:3] == (f"--set {name}={shown}", 1, column)
    str(found).encode()


def test_faults_of_overrides_come_first():
    found = problems("parameters: {a: zz, k: 1}", overrides={"k": "("})
    assert [p.place.file for p in found] == ["--set k=(", "model.yaml"]


def test_options():
    text = "parameters: {T: 5}\nsimulation: {start: 1, end: 9, rtol: 1e-3}"
    s = model(text, options={"duration": "2*T"}).settings()
    assert (s.start, s.end, s.output_step) == (1, 11, 0.01)
    options = {"output_step": "0.5", "method": "rk4", "step": "1e-2", "rtol": "1e-5"}
    s = model(text, options=options).settings()
    assert (s.output_step, s.method, s.step, s.rtol) == (0.5, "rk4", 0.01, 1e-5)
    assert model("", options={"duration": "3"}).settings().end == 3
    for option, place in (
        ({"output_step": "-1"}, "--output-step -1:1:15"),
        ({"output_step": "100"}, "--output-step 100:1:15"),
        ({"duration": "2*TT"}, "--duration 2*TT:1:14"),
    ):
        (found,) = problems(text, options=option)
        assert str(found.place) == place
