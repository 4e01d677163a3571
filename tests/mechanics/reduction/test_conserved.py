"""Momenta that nothing changes, beside constraints that hold at times."""

from __future__ import annotations

import pytest

from lagsim.mechanics.equations import derive
from lagsim.mechanics.reduction import conserved
from lagsim.model.reader import read
from tests.scenes.contact.motions import contact, scene

FLOOR = contact("y >= 0", 0.5)
ROUGH = contact("y >= 0", 0.5, friction=0.3, slip="x_dot")


@pytest.mark.parametrize(
    ("constraints", "expected"),
    [
        ({}, ["x"]),
        ({"floor": FLOOR}, ["x"]),
        ({"floor": ROUGH}, []),
        ({"floor": FLOOR, "wall": contact("x <= 3", 0.5)}, []),
        ({"floor": FLOOR, "brake": {"relation": "x_dot = 0", "limit": 2}}, []),
        # It pushes y alone, but from another place where x is another.
        ({"hill": {"relation": "y_dot = 0", "limit": "2 + x"}}, []),
    ],
)
def test_a_ball_that_flies_sideways(constraints, expected):
    text = scene(
        "x y", "(x_dot^2 + y_dot^2)/2", "g*y", constraints,
        {"x": 0, "y": 1, "x_dot": 1}, duration=1,
    )  # fmt: skip
    equations = derive(read(text, "m.yaml"))
    assert [equations.q[k] for k in conserved(equations)] == expected
