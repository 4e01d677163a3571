"""Scales of columns, and matching of rows."""

import numpy as np
import pytest

from lagsim.model.model import Settings
from lagsim.notes import Event
from lagsim.studies.comparison import kind, match, on_grid, paired_times, scales, within

COLUMNS = (
    "t", "x", "y", "x_dot", "y_dot", "x_ddot", "y_ddot", "tension", "kinetic",
    "potential", "energy", "lambda_rod", "Qc_x", "Qc_y", "residual_rod",
)  # fmt: skip


def test_kinds_are_told_by_names():
    kinds = [kind(c, COLUMNS) for c in COLUMNS]
    assert kinds == [
        "t", "position", "position", "velocity", "velocity", "acceleration",
        "acceleration", "definition", "energy", "energy", "energy", "lambda", "Qc",
        "Qc", "residual",
    ]  # fmt: skip
    assert kind("x_dot", ("t", "x_dot")) == "definition"


def scale_of(column, units=None, **values):
    data = np.zeros((len(COLUMNS), 3))
    for name, row in values.items():
        data[COLUMNS.index(name)] = row
    return scales(COLUMNS, data, units)[COLUMNS.index(column)]


def test_what_stays_zero_is_measured_by_others_of_its_kind():
    assert scale_of("y", x=[0, 2, 1], y=[0, 1e-17, 0]) == 2e-3
    units = {"x": "m", "y": "rad"}
    assert scale_of("y", units, x=[0, 2, 1], y=[0, 1e-17, 0]) == 1e-17
    assert scale_of("Qc_y", Qc_x=[0, 9, 0]) == pytest.approx(9e-3)


def test_nan_is_not_measured():
    assert scale_of("x", x=[1, np.nan, 4]) == 3


# Times of both; numbers of the rows that belong together, times without a partner.
ROWS = {
    "one is missing, one more": ([0, 1, 1, 2, 3], [0, 1, 1, 3, 4], [0, 1, 2, 4],
                                 [0, 1, 2, 3], [2], [4]),
    "an impact with one row": ([0, 1, 1, 2], [0, 1, 2], [0, 1, 3], [0, 1, 2], [1], []),
    "no number": ([0, np.nan, 2], [0, 1, 2], [0, 2], [0, 2], [np.nan], [1]),
    "another order": ([0, 1, 2], [2, 0, 1], [0, 1, 2], [1, 2, 0], [], []),
}  # fmt: skip


@pytest.mark.parametrize(
    ("golden", "new", "mine", "theirs", "missing", "extra"), ROWS.values(), ids=ROWS
)
def test_rows_are_matched_by_time(golden, new, mine, theirs, missing, extra):
    rows = match(np.array(golden, float), np.array(new, float))
    assert (rows.golden.tolist(), rows.new.tolist()) == (mine, theirs)
    assert rows.missing == pytest.approx(missing, nan_ok=True)
    assert rows.extra.tolist() == extra


def impacts(*times, constraint="floor"):
    return [Event(t, "impact", constraint) for t in times]


def test_the_same_is_nearest_either_way():
    # The second is missing, and its neighbours are nearer to others.
    found = paired_times(impacts(1.0, 2.0, 3.0), impacts(1.1, 2.8))
    assert found.tolist() == [[1.0, 1.1], [3.0, 2.8]]


def test_another_constraint_or_kind_is_not_the_same():
    other = [*impacts(1.1, constraint="wall"), Event(1.1, "contact", "floor")]
    assert len(paired_times(impacts(1.0), other)) == 0
    assert len(paired_times([], impacts(1.0))) == 0


def test_times_between_a_pair():
    pairs = np.array([[1.0, 1.25], [3.0, 2.5]])
    found = within(np.array([0.9, 1.0, 1.1, 1.3, 2.6, 3.1]), pairs)
    assert found.tolist() == [False, True, True, False, True, False]


def test_rows_of_output_times_are_those_after_an_impact():
    times = [0.0, 0.25, 0.25, 0.5, 0.5, 0.75, 1.0, 1.1]
    rows = np.column_stack([times, np.arange(8.0)])
    settings = Settings(start=0.0, end=1.1, output_step=0.5)
    assert on_grid(rows, settings)[:, 1].tolist() == [0, 4, 6, 7]
