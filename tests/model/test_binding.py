"""A model bound to other values equals the model of a text with these values."""

import pytest

from lagsim.errors import InputError
from lagsim.model.reader import read, read_file
from tests.model._files import model
from tests.support import MODELS

TEXT = """
parameters:
  l: 2
  g: 9.8
  w: sqrt(g/l)
  T: {value: 2*pi/w, unit: s, description: period}
coordinates: {x: {}, y: {}}
definitions: {r: "hypot(x, y)"}
constraints:
  rod: x^2 + y^2 = l^2
  floor:
    relation: y >= -3*l
    restitution: l/4
    slip: x_dot
    friction: {static: l, dynamic: l/2}
  brake: {relation: x_dot = 0, limit: g/10, when: t < l}
  wheel: x_dot >= l*y_dot
initial: {x: l*sin(0.1), y: {guess: -l}, x_dot: w*x, r_dot: 0}
simulation: {duration: 3*T, output_step: T/10, gain: w}
"""
LAWS = """
parameters: {a: 0.4, b: 0.2, F: 1}
constraints:
  floor:
    {relation: y >= 0, restitution: 0, slip: x_dot, friction: {static: a, dynamic: b}}
  brake: {relation: x_dot = 0, limit: F}
"""
STARTS = """
parameters: {l: 2}
coordinates: {x: {}, y: {}}
definitions: {s: x + y}
initial: {x: l, y: {guess: x/2}}
"""
STEP = "parameters: {h: 1}\nsimulation: {duration: 10, output_step: h}"
# Texts, and values that replace theirs: sound ones, and faulty ones.
CHANGES = {
    TEXT: [
        {"l": 3}, {"g": 1.62}, {"l": 0.1, "g": -0.0 + 25},
        {"w": 1.5},  # no longer what it was derived from
        {"w": "2*l + pi", "l": "1/3"}, {"x": 0.3},
        {"q": "1"}, {"L": "1"}, {"a.b": "1"}, {"l": "w"}, {"l": "l"}, {"l": "x"},
        {"l": "1/0"}, {"l": "2 l"}, {"g": "-1"},  # of whose square root w is
        {"l": "5"}, {"l": "0", "q": "2", "g": "("},
    ],
    LAWS: [{"a": "0.1"}, {"b": "-1"}, {"F": "-2"}],
    STARTS: [{"x": 0.3}, {"y": "l*x"}, {"y_dot": -2, "s_dot": "l"}, {"l": "3"},
             {"x": "y"}, {"x": "1/0"}, {"x": "1 +"}],
    STEP: [{"h": 2.0}, {"h": -1}],
}  # fmt: skip
OF_STARTS = ("x", "y", "y_dot", "s_dot")


def texts(values):
    return {k: v if isinstance(v, str) else repr(v) for k, v in values.items()}


def told(make):
    """Return the numbers of a model, or the faults of its text."""
    try:
        found = make()
        starts = [(v.name, v.value, v.error, v.guess) for v in found.initial]
        laws = [c.law for c in found.constraints]
        return found.parameters, starts, laws, found.settings()
    except InputError as error:
        return list(map(str, error.problems))


@pytest.mark.parametrize(
    ("text", "values"),
    [(text, x) for text, several in CHANGES.items() for x in several],
)
def test_a_binding_is_the_model_of_the_text_with_these_values(text, values):
    base = model(text)
    starts = {k: v for k, v in values.items() if k in OF_STARTS}
    rest = {k: v for k, v in values.items() if k not in starts}
    again = told(lambda: model(text, overrides=texts(values)))
    assert told(lambda: base.bind(rest, starts)) == again != told(lambda: base)


@pytest.mark.parametrize("path", sorted(MODELS.glob("*.yaml")), ids=lambda p: p.stem)
def test_shipped_models(path):
    base = read_file(str(path))
    for parameter in base.parameters[-2:]:
        for value in (1.01 * parameter.value, 0.0):
            values = {parameter.name: value}
            again = told(lambda v=values: read_file(str(path), texts(v)))
            assert told(lambda v=values: base.bind(v)) == again
    assert told(base.bind) == told(lambda: base)


def test_nothing_is_built_or_changed_for_a_number():
    base = model(TEXT)
    nodes, before = len(base.graph), told(lambda: base)
    for k in range(1, 20):
        bound = base.bind({"l": 0.1 * k, "g": 10 - 0.3 * k}, {"x": 0.01 * k})
        assert bound.settings() != base.settings()
    assert bound.graph is base.graph
    assert len(base.graph) == nodes
    assert told(lambda: base) == before


def test_bindings_add_up():
    once = model(TEXT).bind({"l": 3}, {"x": 0.5}).bind({"g": 4}, {"x_dot": 1})
    both = model(TEXT).bind({"l": 3, "g": 4}, {"x": 0.5, "x_dot": 1})
    assert told(lambda: once) == told(lambda: both)
    after = model(TEXT, overrides={"l": "3"}, options={"gain": "7"}).bind({"g": 4})
    assert after.parameters == both.parameters
    assert after.settings().gain == 7.0


@pytest.mark.parametrize(
    ("initial", "code"),
    [
        ({"l": 1}, "not-a-start-value"), ({"z": 1}, "unknown-name"),
        ({"duration": 1}, "unknown-name"), ({"x": float("nan")}, "unknown-name"),
    ],
    ids=str,
)  # fmt: skip
def test_faults_of_start_values(initial, code):
    with pytest.raises(InputError) as error:
        model(STARTS).bind({}, initial)
    assert [p.code for p in error.value.problems] == [code]
    assert "belongs below" not in str(error.value)  # as a key of the file would


def test_faults_of_settings_are_reported_when_they_are_asked_for():
    bound = model(STEP).bind({"h": -1})
    assert "must be positive" in told(lambda: bound)[0]
    assert bound.settings({"output_step": 2}).output_step == 2.0


# --- Which numbers of a file follow others

FOLLOWED = """\
parameters: {l: 1, g: 9.8, w: sqrt(g/l), K: {value: 3, description: of l}, e: 2}
coordinates: {x: , y: }
energy: {kinetic: x_dot^2/2 + y_dot^2/2, potential: K*x^2 + g*l*w*y + e*x}
initial: {x: 2*K, y: 1, y_dot: y}
simulation: {duration: 10, output_step: e/100}
"""


@pytest.mark.parametrize(
    ("names", "rests"),
    [
        ({"l"}, True), ({"g"}, True), ({"w"}, False), ({"K"}, True), ({"e"}, True),
        ({"x"}, False), ({"y"}, True), ({"y_dot"}, False), ({"y", "y_dot"}, False),
    ],
)  # fmt: skip
def test_what_is_said_by_a_name(names, rests):
    assert read(FOLLOWED, "m.yaml").stated.depends_on(names) is rests


def test_what_was_said_instead_counts():
    model = read(FOLLOWED, "m.yaml").bind({"K": "g"}, {"x": "e"})
    assert not model.stated.depends_on({"K"})
    assert model.bind({"K": 1.0, "w": 1.0}).stated.depends_on({"g"}) is False
    assert read(FOLLOWED, "m.yaml").bind(e="l").stated.depends_on({"l"})


def test_expressions_are_found_by_the_keys_that_lead_to_them():
    laws = "constraints: {floor: {relation: y >= 0, restitution: 0.5, friction: 0.3, "
    laws += "slip: [x_dot]}}\nforces: {x: -3*x_dot}\n"
    texts = read(laws + FOLLOWED, "m.yaml").stated.texts()
    assert {name: x.text for name, x in texts.items() if "energy" not in name} == {
        "forces.x": "-3*x_dot",
        "constraints.floor.relation": "y >= 0", "constraints.floor.restitution": "0.5",
        "constraints.floor.friction": "0.3", "constraints.floor.slip.1": "x_dot",
    }  # fmt: skip
    assert texts["forces.x"].place.line == 2
