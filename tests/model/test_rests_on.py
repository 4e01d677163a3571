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
