"""Pictures are the same whoever draws them."""

from __future__ import annotations

import os
import sys

import pytest

from lagsim.outputs import artist
from lagsim.outputs.letters import Letters
from lagsim.run.observers.thinning import picture_thinning
from tests.support import ready


@pytest.fixture(scope="module")
def ordered():
    """Give an order, and what this process draws of it."""
    session = ready("pendulum-cartesian", duration=0.5)
    model = session.case.equations.model
    rows = picture_thinning(model, session.system.columns.names)
    session.run([rows])
    fields = {"title": model.name, "rows": rows, "letters": Letters(["x", "y"])}
    order = artist.Order(fields, model, energy_is_sum=True)
    return order, dict(artist.drawn(order))


@pytest.mark.skipif(
    sys.platform != "linux" or len(os.sched_getaffinity(0)) < 2,
    reason="nobody is sent without a second core, and elsewhere than on Linux",
)
def test_another_process_draws_the_same(ordered, monkeypatch):
    order, own = ordered
    assert {"energy.png", "trajectory.png", "constraint_forces.png"} <= own.keys()
    with artist.artist() as draw:
        # Whoever is asked here has not done his part.
        monkeypatch.setattr(artist, "drawn", None)
        assert dict(draw(order)) == own


def test_what_another_does_not_bring_is_drawn_here(ordered, monkeypatch):
    order, own = ordered
    monkeypatch.setattr(artist.ahead.Helper, "give", lambda *_: iter(()))
    with artist.artist() as draw:
        assert dict(draw(order)) == own
