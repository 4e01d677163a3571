"""What two runs have in common, and when."""

from __future__ import annotations

import numpy as np

from lagsim.model.model import Settings
from lagsim.notes import Event
from lagsim.studies.comparison import moved, on_grid, within


def impacts(*times, constraint="floor"):
    return [Event(t, "impact", constraint) for t in times]


def test_the_same_is_nearest_either_way():
    # The second is missing, and its neighbours are nearer to others.
    found = moved(impacts(1.0, 2.0, 3.0), impacts(1.1, 2.8))
    assert found.tolist() == [[1.0, 1.1], [3.0, 2.8]]


def test_another_constraint_or_kind_is_not_the_same():
    other = [*impacts(1.1, constraint="wall"), Event(1.1, "contact", "floor")]
    assert len(moved(impacts(1.0), other)) == 0
    assert len(moved([], impacts(1.0))) == 0


def test_times_between_a_pair():
    pairs = np.array([[1.0, 1.25], [3.0, 2.5]])
    found = within(np.array([0.9, 1.0, 1.1, 1.3, 2.6, 3.1]), pairs)
    assert found.tolist() == [False, True, True, False, True, False]


def test_rows_of_output_times_are_those_after_an_impact():
    times = [0.0, 0.25, 0.25, 0.5, 0.5, 0.75, 1.0, 1.1]
    rows = np.column_stack([times, np.arange(8.0)])
    settings = Settings(start=0.0, end=1.1, output_step=0.5)
    assert on_grid(rows, settings)[:, 1].tolist() == [0, 4, 6, 7]
