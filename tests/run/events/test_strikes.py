"""What a strike costs: evaluations of the field, and matrices that are factored.

Counts, as clocks tell nothing on a machine that others use.
"""

from __future__ import annotations

from collections import Counter

import pytest

from lagsim.run.events import touching
from lagsim.run.system.runner import Runner
from tests.support import ready


@pytest.fixture
def counted(monkeypatch):
    """Count calls of `delassus`, and of the model's functions from Python."""
    counts = Counter()
    factored, made = touching.delassus, Runner._function

    def delassus(*args):
        counts["delassus"] += 1
        return factored(*args)

    def function(self, name, length):
        call = made(self, name, length)

        def noted(t, y):
            counts[name] += 1
            return call(t, y)

        return noted

    monkeypatch.setattr(touching, "delassus", delassus)
    monkeypatch.setattr(Runner, "_function", function)
    return counts


def strikes(model):
    result = ready(model).run([])
    return result.event_counts["impact"]


# Before a strike and after it the field is looked at; where a contact holds from then
# on, also what rounding does to it, and where it might come to rest, what holds it now.
# The matrix of a place serves before the strike and after it, unless what lies a
# rounding below the ground is raised, and as long as nothing changes it. A few more are
# asked for at the start and the end.
@pytest.mark.parametrize(
    ("model", "field", "factored"),
    [
        ("bouncing-ball", 2, 0),
        ("ball-on-a-vibrating-table", 2, 0),
        ("newtons-cradle", 3, 1),
        pytest.param("rocking-block", 3, 1.5, marks=pytest.mark.slow),
    ],
)
def test_a_strike_costs_few_evaluations(model, field, factored, counted):
    count = strikes(model)
    assert count >= 16
    assert counted["field"] <= field * count + 6
    assert counted["geometry"] <= 2 * count + 4
    assert counted["delassus"] <= factored * count + 4
