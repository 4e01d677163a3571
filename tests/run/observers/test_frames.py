"""Rows for moving pictures: an even stride, both rows of each impact, bounded."""

import numpy as np
import pytest

from lagsim.run.observers.thinning import Frames

COLUMNS = ("t", "a", "b")


def rows_of(t):
    t = np.asarray(t, dtype=float)
    return np.stack((t, np.arange(len(t)), -t), axis=1)


def framed(rows, most, cuts=()):
    frames = Frames(COLUMNS, ("t", "a"), most)
    for block in np.split(rows, cuts):
        frames.add(block)
    return frames


def test_few_rows_are_all_kept():
    rows = rows_of(range(10))
    frames = framed(rows, 10, [3, 3, 9])
    assert np.array_equal(frames.table, rows[:, :2])
    assert not frames.broken.any()
    assert frames.stride == 1


def test_without_rows_there_are_no_frames():
    assert framed(rows_of([]), 10).table.shape == (0, 2)


@pytest.mark.parametrize("cuts", [[], [1], [40, 41], range(1, 100)])
def test_of_many_rows_one_of_a_stride_and_the_last(cuts):
    frames = framed(rows_of(range(100)), 30, cuts)
    # Halved until there are at most 30, the last one aside.
    assert frames.stride == 4
    assert frames.table[:, 1].tolist() == [*range(0, 100, 4), 99]


@pytest.mark.parametrize("cuts", [[], [10], [11], [12], [10, 11, 12]])
def test_both_rows_of_an_impact_stay(cuts):
    t = [*range(11), *range(10, 100)]  # the rows 10 and 11 share a time
    frames = framed(rows_of(t), 30, cuts)
    kept = frames.table
    assert {10.0, 11.0} <= set(kept[:, 1])
    assert np.all(np.diff(kept[:, 0]) >= 0)
    assert not frames.broken.any()


@pytest.mark.parametrize("cuts", [[], [500], range(1, 2000, 7)])
def test_where_an_impact_is_missing_the_stretch_is_broken(cuts):
    t = np.repeat(np.arange(1000.0), 2)  # an impact at every time
    frames = framed(rows_of(t), 64, cuts)
    kept, broken = frames.table, frames.broken
    assert len(kept) <= 65
    # A stretch spans impacts that are not shown as soon as it spans a time.
    longer = np.diff(kept[:, 0]) > 1.0
    assert longer.any()
    assert np.all(broken[:-1][longer])
    assert kept[-1].tolist() == [999.0, 1999.0]


def test_what_is_kept_depends_on_the_rows_alone():
    generator = np.random.default_rng(14)
    t = np.sort(generator.integers(0, 4000, 9000)).astype(float)
    rows = rows_of(t)
    whole = framed(rows, 100)
    parts = framed(rows, 100, np.sort(generator.integers(0, 9000, 50)))
    assert np.array_equal(whole.table, parts.table)
    assert np.array_equal(whole.broken, parts.broken)
    assert len(whole.table) <= 101
