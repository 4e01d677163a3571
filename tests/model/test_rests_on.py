"""Which numbers of a file follow others."""

from __future__ import annotations

import pytest

from lagsim.model.reader import read

TEXT = """\
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
    assert read(TEXT, "m.yaml").rests_on(names) is rests


def test_what_was_said_instead_counts():
    model = read(TEXT, "m.yaml").bind({"K": "g"}, {"x": "e"})
    assert not model.rests_on({"K"})
    assert model.bind({"K": 1.0, "w": 1.0}).rests_on({"g"}) is False
    assert read(TEXT, "m.yaml").bind(e="l").rests_on({"l"})


def test_expressions_are_found_by_the_keys_that_lead_to_them():
    laws = "constraints: {floor: {relation: y >= 0, restitution: 0.5, friction: 0.3, "
    laws += "slip: [x_dot]}}\nforces: {x: -3*x_dot}\n"
    texts = read(laws + TEXT, "m.yaml").stated.texts()
    assert {name: x.text for name, x in texts.items() if "energy" not in name} == {
        "forces.x": "-3*x_dot",
        "constraints.floor.relation": "y >= 0", "constraints.floor.restitution": "0.5",
        "constraints.floor.friction": "0.3", "constraints.floor.slip.1": "x_dot",
    }  # fmt: skip
    assert texts["forces.x"].place.line == 2
