"""Valid files: what each section becomes. Expected values are worked out by hand."""

import hashlib
import io
import math
import sys

import pytest

from lagsim.errors import InputError
from lagsim.language.evaluate import evaluate
from lagsim.model.model import Level, Sense, Target
from lagsim.model.reader import read, read_file
from tests.model._files import completed, model, problems

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
    friction: 0.3
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


def at_state(m, node):
    return evaluate(m.graph, [node], STATE)[0]


class TestFullFile:
    def test_head(self, full):
        assert full.name == "elastic-pendulum"
        assert full.file == "somewhere/pendulum.yaml"
        assert full.description == "A mass on a spring that swings from a pivot."
        assert full.source == "H. P. Gavin, CEE 541, section 9"
        assert full.sha256 == hashlib.sha256(FULL.encode()).hexdigest()

    def test_parameters(self, full):
        values = {p.name: p.value for p in full.parameters}
        assert values == {"l": 2, "g": 9.8, "K": 20, "M": 1, "c": 10, "min": 3}
        assert list(values) == ["l", "g", "K", "M", "c", "min"]
        g = full.parameters[1]
        assert (g.unit, g.description) == ("m/s^2", "gravity")

    def test_coordinates(self, full):
        assert [(q.name, q.unit) for q in full.coordinates] == [
            ("theta", "rad"), ("u", ""),
        ]  # fmt: skip

    def test_definitions(self, full):
        found = {d.name: d for d in full.definitions}
        assert list(found) == ["tension", "above", "x", "y", "speed", "slide"]
        assert [d.level for d in found.values()] == [
            Level.OUTPUT, Level.OUTPUT, Level.POSITION, Level.POSITION,
            Level.VELOCITY, Level.VELOCITY,
        ]  # fmt: skip
        assert (found["speed"].unit, found["speed"].description) == (
            "m/s", "of the mass",
        )  # fmt: skip
        assert at_state(full, found["x"].node) == 0.0
        assert at_state(full, found["y"].node) == -3.0
        assert at_state(full, found["speed"].node) == pytest.approx(math.sqrt(61))
        assert at_state(full, found["slide"].node) == pytest.approx(6 - 2 + 0.5)

    def test_second_rate(self, full):
        # y = -(l + u) cos(theta) at theta = 0:
        # y'' = -u'' + (l + u) theta'^2 = -0.125 + 12
        tension = 1000 + (12 - 0.125) + KINETIC - POTENTIAL + 0.25
        found = {d.name: d for d in full.definitions}
        assert at_state(full, found["tension"].node) == pytest.approx(tension)
        assert at_state(full, found["above"].node) == pytest.approx(2 * tension)

    def test_energies(self, full):
        assert at_state(full, full.kinetic) == pytest.approx(KINETIC)
        assert at_state(full, full.potential) == pytest.approx(POTENTIAL)
        assert at_state(full, full.lagrangian) == pytest.approx(KINETIC - POTENTIAL)
        assert at_state(full, full.dissipation) == pytest.approx(10 * 25 / 2)

    def test_forces(self, full):
        u, x, slide = full.forces
        assert [f.on for f in full.forces] == ["u", "x", "slide"]
        assert [f.level for f in full.forces] == [
            Level.POSITION, Level.POSITION, Level.VELOCITY,
        ]  # fmt: skip
        assert u.direction == full.graph.variable("u")
        assert at_state(full, u.node) == pytest.approx(3 * math.cos(0.5))
        assert at_state(full, x.node) == pytest.approx(-6)
        assert x.direction == full.definitions[2].node
        assert slide.direction == full.definitions[5].node
        assert at_state(full, slide.node) == 1.0
        assert slide.place.line == line_of("  slide: min")

    def test_constraints(self, full):
        path, top, floor, roll = full.constraints
        assert [c.name for c in full.constraints] == ["path", "top", "floor", "roll"]
        assert (path.relation.sense, path.law) == (Sense.EQUAL, None)
        assert path.relation.text == "u = l - l*theta^2"
        assert at_state(full, path.relation.node) == 1 - 2
        assert top.relation.sense is Sense.AT_LEAST
        assert at_state(full, top.relation.node) == 1.5 - -3.0  # rhs - lhs
        assert (top.law.restitution, top.law.friction, top.law.slips) == (0.8, None, ())
        assert top.description == "the ceiling"
        assert at_state(full, floor.relation.node) == -3.0 - -1.5  # lhs - rhs
        assert floor.law.restitution == 0.5
        assert at_state(full, floor.law.friction) == 0.3
        slips = [at_state(full, s) for s in floor.law.slips]
        assert slips == pytest.approx([6, 9])
        assert (roll.relation.sense, roll.law) == (Sense.EQUAL, None)
        assert at_state(full, roll.relation.node) == pytest.approx(6 - 2)

    def test_initial(self, full):
        found = {v.name: v for v in full.initial}
        assert list(found) == ["theta", "u", "theta_dot", "u_dot", "x", "y_dot"]
        assert [v.target for v in full.initial] == [
            Target.COORDINATE, Target.COORDINATE, Target.VELOCITY, Target.VELOCITY,
            Target.DEFINITION, Target.RATE,
        ]  # fmt: skip
        assert [v.value for v in full.initial] == pytest.approx(
            [0.1, 0.5, 0.0, 3.0, 0.7, 1.2]
        )
        assert [v.guess for v in full.initial] == [
            False, False, False, True, False, False,
        ]  # fmt: skip
        assert found["u"].text == "5*theta"
        assert found["u"].place.line == line_of("  u: 5*theta")
        assert found["x"].node == full.definitions[2].node
        assert at_state(full, found["y_dot"].node) == -5.0
        # A number alone is exact, what is computed is not.
        assert found["u_dot"].error == found["x"].error == 0.0
        assert found["theta_dot"].error == 0.0
        assert 0 < found["u"].error < 1e-15

    def test_simulation(self, full):
        s = full.settings()
        assert (s.start, s.end, s.output_step) == (1, 9, 0.02)
        assert (s.method, s.rtol, s.atol, s.step) == ("rk4", 1e-9, 0, 0.01)
        assert s.method_place.line == line_of("  method:")
        assert full.until.sense is Sense.AT_LEAST
        assert at_state(full, full.until.node) == 3.0

    def test_scene(self, full):
        x, y = (full.definitions[i].node for i in (2, 3))
        assert full.scene.points["bob"] == (x, y)
        assert full.scene.points["high"] == (x, y, full.graph.one)
        assert full.scene.links == (("pivot", "bob"),)

    def test_output(self, full):
        assert full.output.columns == ("y", "x")
        first, second = full.output.plots
        assert (first.x.text, [y.text for y in first.y]) == ("theta", ["u"])
        assert first.title == "Path in configuration space"
        assert second.title == ""
        assert second.x.node == full.graph.variable("t")


class TestDefaults:
    def test_of_a_short_file(self):
        m = read(completed(""), "some/where/two masses.yaml")
        assert m.name == "two masses"
        assert m.settings().duration == 0.0
        assert m.until is None
        assert (m.parameters, m.definitions, m.forces, m.constraints) == ((),) * 4
        assert m.scene.points == {}
        assert m.output.columns == ()
        assert [v.name for v in m.initial] == ["x", "y", "x_dot", "y_dot"]
        assert m.dissipation is None

    def test_simulation(self):
        s = model("simulation: {end: 5}").settings()
        assert (s.start, s.end, s.output_step) == (0, 5, 5 / 1000)
        assert (s.method, s.rtol, s.atol, s.step) == ("auto", None, None, None)

    def test_without_duration_there_is_nothing_to_run(self):
        found = model("simulation: {start: 2, until: x <= 0, rtol: 1e-9}")
        s = found.settings()
        assert (s.start, s.duration, s.rtol) == (2, 0, 1e-9)
        assert found.until is not None

    def test_all_definitions_are_columns(self):
        assert model("definitions: {b: x, a: y}").output.columns == ("b", "a")
        text = "definitions: {b: x, a: y}\noutput: {columns: []}"
        assert model(text).output.columns == ()

    @pytest.mark.parametrize(
        "text",
        [
            "parameters:", "parameters: {}", "definitions: ~", "forces: null",
            "scene:", "output:\n", "simulation:", "constraints: {}",
            "scene: {points: , links: }", "output: {plots: }",
        ],
    )  # fmt: skip
    def test_empty_sections(self, text):
        assert problems(text) == []


class TestAllowed:
    """What a stricter reader would refuse."""

    @pytest.mark.parametrize(
        "text",
        [
            # two namespaces: functions and variables
            "parameters: {min: 1, sin: 2, if: 3}\nforces: {x: min*sin(sin)*if}",
            # names that are names of something elsewhere only
            "parameters: {I: 1, E: 2, S: 3, beta: 4, lambda: 5, e: 6, on: 7, no: 8}",
            "parameters: {lambda_x: 1, residual_y: 2}\nconstraints: {c: x = y}",
            "constraints: {x: x = y}\nscene: {points: {x: [x, y]}}",
            "parameters: {Ω: 1, λ_1: Ω}",
            # velocities in the potential: a magnetic one
            "energy: {kinetic: x_dot^2 + y_dot^2, potential: x*y_dot + t}",
            "energy: {lagrangian: x_dot^2 + y_dot^2 - x, dissipation: x_dot^2}",
            # rows: 10^8 exactly
            "simulation: {duration: 99999999, output_step: 1}",
            "simulation: {start: 0.3, end: 0.4, output_step: 0.1}",
            "simulation: {duration: 1, rtol: 0, atol: 1e-9}",
            # restitution at its ends
            "constraints: {c: {relation: x >= 0, restitution: 0}}",
            (
                "constraints: {c: {relation: x >= 0, restitution: 1, friction: 0, "
                "slip: y_dot*cos(x) + t}}"
            ),
            (
                "constraints: {c: {relation: x >= 0, restitution: 1, slip: y_dot, "
                "friction: {static: 0.3, dynamic: 0.3}}}"
            ),
            "constraints: {c: {relation: x_dot = t, limit: 0, when: t < 1 and t > 0}}",
            "constraints: {c: {relation: x >= 0, restitution: 0, when: t < 1}}",
            "constraints: {c: {relation: x_dot >= y_dot, when: not t < 1}}",
            "constraints: {c: cos(y)*x_dot >= t*y_dot}\ndefinitions: {f: lambda_c}",
            "constraints: {c: 'if(x > 0, x, y) = 0', d: {relation: t*x_dot^2 - 1}}",
            "x-a: 1\nforces: {x: 1, x-b: 2}\nscene: {x-c: [1]}",
            "definitions: {a: 'x +\n    y'}",
        ],
    )
    def test_no_fault(self, text):
        assert problems(text) == []

    def test_sides_of_a_bare_relation(self):
        m = model("constraints: {c: 2*x - y}")
        (c,) = m.constraints
        assert evaluate(m.graph, [c.relation.node], {"x": 3.0, "y": 1.0}) == [5.0]
        assert c.relation.sense is Sense.EQUAL

    def test_a_start_of_velocity_level_is_a_definition(self):
        m = model("definitions: {v: x_dot + y}\ninitial: {x: 0, y: 0, v: 2}")
        assert m.initial[-1].target is Target.DEFINITION
        assert m.graph.depends([m.initial[-1].node]) == {"x_dot", "y"}


class TestLaws:
    """What holds at times: friction of two sizes, limits, freewheels, `when`."""

    def constraint(self, text, **values):
        (found,) = model(f"constraints: {{c: {text}}}", **values).constraints
        return found

    def value(self, text, node, **at):
        m = model(text)
        (c,) = m.constraints
        return evaluate(m.graph, [node(c)], {"t": 0.0, **at})[0]

    def test_friction_of_two_sizes(self):
        text = (
            "parameters: {mu: 0.2}\n"
            "constraints: {c: {relation: x >= 0, restitution: 0, slip: y_dot, "
            "friction: {static: 2*mu, dynamic: mu}}}"
        )
        assert self.value(text, lambda c: c.law.static, mu=0.5) == 1.0
        assert self.value(text, lambda c: c.law.friction, mu=0.5) == 0.5

    def test_one_size_is_that_of_both(self):
        text = "{relation: x >= 0, restitution: 0, slip: y_dot, friction: 0.2}"
        law = self.constraint(text).law
        assert law.static is None
        assert law.friction is not None

    def test_limit(self):
        text = "constraints: {c: {relation: x_dot = y, limit: 2*t + x_dot}}"
        assert self.value(text, lambda c: c.limit, t=1.5, x_dot=4.0) == 7.0
        (c,) = model(text).constraints
        assert (c.relation.sense, c.law, c.when) == (Sense.EQUAL, None, None)
        assert not c.always

    @pytest.mark.parametrize(("t", "holds"), [(0.2, 1.0), (0.3, 0.0), (2.0, 1.0)])
    def test_when(self, t, holds):
        text = (
            "parameters: {T: 0.3}\n"
            "constraints: {c: {relation: x = y, when: t < T or t > 5*T}}"
        )
        assert self.value(text, lambda c: c.when, t=t, T=0.3) == holds
        (c,) = model(text).constraints
        assert (c.law, c.limit, c.always) == (None, None, False)

    def test_when_by_a_definition_of_time(self):
        text = (
            "definitions: {phase: 2*t}\n"
            "constraints: {c: {relation: x_dot, limit: 1, when: phase >= 1}}"
        )
        assert self.value(text, lambda c: c.when, t=0.5) == 1.0

    @pytest.mark.parametrize("text", ["x_dot >= y_dot", "y_dot <= x_dot"])
    def test_freewheel(self, text):
        c = self.constraint(text)
        assert c.relation.sense is Sense.AT_LEAST
        assert (c.law.restitution, c.law.friction, c.law.slips) == (0.0, None, ())
        node = self.value(f"constraints: {{c: {text}}}", lambda c: c.relation.node,
                          x_dot=3.0, y_dot=1.0)  # fmt: skip
        assert node == 2.0


class TestRounding:
    def test_zero_within_the_rounding_of_its_expression(self):
        # cos(pi/2) is 6.1e-17 in floating point, and 0 within the error of pi/2
        m = model("parameters: {l: 2}\ninitial: {x: l*cos(pi/2), y: 0.3 - 3*0.1}")
        x, y = m.initial[:2]
        assert 0 < x.value < 1.3e-16
        assert x.error >= x.value
        assert y.value != 0.0
        assert abs(y.value) <= y.error < 1e-15

    def test_error_of_a_parameter_is_inherited(self):
        text = "parameters: {k: sin(pi), m: 0.1}\ninitial: {x: k, y: m}"
        x, y = model(text).initial[:2]
        assert abs(x.value) <= x.error
        assert y.error == 0.0


class TestOverrides:
    TEXT = """
parameters:
  k: 1
  m: {value: 2*k, unit: kg}
  n: 3
initial: {x: m, y: 0}
"""

    def test_before_anything_is_evaluated(self):
        m = model(self.TEXT, overrides={"k": "2*pi"})
        assert [p.value for p in m.parameters] == [2 * math.pi, 4 * math.pi, 3]
        assert m.initial[0].value == 4 * math.pi
        assert m.parameters[1].unit == "kg"

    def test_of_a_mapping_keeps_its_unit(self):
        m = model(self.TEXT, overrides={"m": "k + 4"})
        assert (m.parameters[1].value, m.parameters[1].unit) == (5, "kg")

    def test_of_start_values(self):
        """What is not stated there is added; others that use it follow."""
        text = """
parameters: {k: 2}
definitions: {s: x + y}
initial: {x: {guess: 1}, y: 2*x, s: 0}
"""
        values = {"x": "k/2 + 1/4", "y_dot": "-3", "s": "5", "k": "4"}
        starts = {s.name: s for s in model(text, overrides=values).initial}
        stated = {name: s.value for name, s in starts.items()}
        assert stated == {"x": 2.25, "y": 4.5, "x_dot": 0, "y_dot": -3, "s": 5}
        assert [name for name, s in starts.items() if s.guess] == ["x"]

    def test_what_the_file_says_there_does_not_matter(self):
        assert model("parameters: {a: 1/0}", overrides={"a": "1"}).parameters

    @pytest.mark.parametrize(
        ("name", "expression", "code", "column", "part"),
        [
            ("kk", "1", "unknown-parameter", 7, "did you mean `k`"),
            ("k.m", "1", "unknown-parameter", 7, "reserved"),
            ("x_ddot", "1", "unknown-parameter", 7, "`x_ddot` is an acceleration"),
            ("", "1", "unknown-parameter", 7, "no parameter"),
            ("k", "2*", "expression-syntax", 11, "ends"),
            ("k", "2 3", "expression-syntax", 11, "write `*`"),
            ("k", "", "expression-syntax", 9, "expected"),
            ("k", "m", "later-parameter", 9, "is below it"),
            ("m", "2*kk", "unknown-name", 11, "did you mean `k`"),
            ("k", "1/0", "not-finite", 9, "inf"),
            ("k", "\udcff", "expression-syntax", 9, "'?'"),
        ],
    )
    def test_faults(self, name, expression, code, column, part):
        (found,) = problems(self.TEXT, overrides={name: expression})
        assert found.code == code
        assert part in f"{found.text} | {found.hint}"
        shown = expression.replace("\udcff", "?")
        assert found.place.file == f"--set {name}={shown}"
        assert (found.place.line, found.place.column) == (1, column)
        str(found).encode()

    def test_they_come_before_those_of_the_file(self):
        found = problems("parameters: {a: zz, k: 1}", overrides={"k": "("})
        assert [p.place.line for p in found] == [1, 1]
        assert found[0].place.file == "--set k=("


class TestOptions:
    TEXT = "parameters: {T: 5}\nsimulation: {start: 1, end: 9, rtol: 1e-3}"

    def test_duration_replaces_end(self):
        s = model(self.TEXT, options={"duration": "2*T"}).settings()
        assert (s.start, s.end, s.output_step) == (1, 11, 0.01)

    def test_others(self):
        options = {
            "output_step": "0.5",
            "method": "rk4",
            "step": "1e-2",
            "rtol": "1e-5",
        }
        s = model(self.TEXT, options=options).settings()
        assert (s.output_step, s.method, s.step, s.rtol) == (0.5, "rk4", 0.01, 1e-5)

    def test_without_a_section(self):
        assert model("", options={"duration": "3"}).settings().end == 3

    def test_faults(self):
        (found,) = problems(self.TEXT, options={"output_step": "-1"})
        assert str(found.place) == "--output-step -1:1:15"
        (found,) = problems(self.TEXT, options={"output_step": "100"})
        assert "longer than the run" in found.text
        (found,) = problems(self.TEXT, options={"duration": "2*TT"})
        assert found.place.column == 14


class TestReadFile:
    def test_reads(self, tmp_path):
        path = tmp_path / "swing.yaml"
        path.write_text(completed("parameters: {k: 1}"), encoding="utf-8")
        m = read_file(str(path), {"k": "2"})
        assert (m.name, m.file, m.parameters[0].value) == ("swing", str(path), 2)
        assert m.sha256 == hashlib.sha256(path.read_bytes()).hexdigest()

    def test_standard_input(self, monkeypatch):
        data = io.BytesIO(completed("").encode())
        monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(data))
        assert read_file("-").name == "stdin"

    @pytest.mark.parametrize(
        ("data", "code", "line", "column"),
        [
            (b"", "empty-file", 0, 0),
            (b"# nothing\n", "empty-file", 0, 0),
            (b"---\n", "missing-key", 2, 1),
            (b"name: a\nunit: \xb0C\n", "not-utf8", 2, 7),
        ],
    )
    def test_unusable(self, tmp_path, data, code, line, column):
        path = tmp_path / "a.yaml"
        path.write_bytes(data)
        with pytest.raises(InputError) as caught:
            read_file(str(path))
        first = caught.value.problems[0]
        assert first.code == code
        assert str(path) in str(caught.value)
        if line:
            assert (first.place.line, first.place.column) == (line, column)

    def test_unreadable(self, tmp_path):
        for path in (tmp_path, tmp_path / "none.yaml", "a\0b"):
            with pytest.raises(InputError) as caught:
                read_file(str(path))
            assert caught.value.problems[0].code == "unreadable"
