"""Warnings of `stability` where the motion about the start or a rest is not linear."""

import pytest

from lagsim.model.reader import read
from lagsim.run.session import open_case
from lagsim.studies.bench.stability import Subject, _equilibrium
from tests.run.switching.scenes import one_quick, scene

START, REST = "at the start", "about the nearest rest"
# Potential, force, start, velocity; and the states about which slopes are not unique.
CASES = one_quick(
    ("x^2/2", "-3*max(x, 0)", 0, 0.1, [START, REST]),
    ("x^2/2", "-3*max(x, 0)", 0.5, 0.1, [REST]),
    ("x^2/2", "-3*max(x - 0.5, 0)", 0.5, 0.1, [START]),
    ("x^2/2", "-sign(x_dot)", 0.5, 0.1, [REST]),
    ("abs(x)*x/2 + x^2", "0", 0, 0.1, [START, REST]),
    # Both sides have one slope, or there is no switch.
    ("x^2/2", "-abs(x)*x", 0, 0.1, []),
    ("x^2/2", "-x", 0, 0.1, []),
)


@pytest.mark.parametrize(("potential", "force", "x", "v", "where"), CASES)
def test_stability_names_the_switch_at_which_it_linearises(
    potential, force, x, v, where
):
    text = scene(potential, force, x=x, v=v, duration=3)
    subject = Subject(open_case(read(text, "model.yaml")))
    found = _equilibrium(subject).get("warnings", [])
    assert [w["text"].split(",")[0] for w in found] == where
    assert {w["number"] for w in found} <= {"W409"}
