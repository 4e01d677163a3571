"""Thinned rows against all rows."""

import tracemalloc

import numpy as np
import pytest

from lagsim.run.observers.thinning import BUCKETS, POINTS, Thinning


def thinned(rows, columns=("t", "a", "b"), block=1000, **kwargs):
    thinning = Thinning(columns, **kwargs)
    for start in range(0, len(rows), block):
        thinning.add(rows[start : start + block])
    return thinning


def walk(count, seed=0):
    """Rows t, a, b in which values do not repeat."""
    steps = np.random.default_rng(seed).standard_normal((count, 3))
    rows = np.cumsum(steps, axis=0)
    rows[:, 0] = np.arange(count) / 8
    return rows


@pytest.mark.parametrize("count", [1, 2, 1000, BUCKETS])
def test_few_rows_are_all_kept(count):
    rows = walk(count)
    thinning = thinned(rows)
    t, values = thinning.series("b")
    assert np.array_equal(t, rows[:, 0])
    assert np.array_equal(values, rows[:, 2])
    x, y = thinning.path("a", "b")
    assert np.array_equal(x, rows[:, 1])
    assert np.array_equal(y, rows[:, 2])
    assert (thinning.stride, thinning.row_count) == (1, count)
    assert thinning.first("a") == rows[0, 1]
    assert thinning.last("a") == rows[-1, 1]


@pytest.mark.parametrize("count", [BUCKETS + 1, 2 * BUCKETS, 100_003])
def test_every_bucket_keeps_its_extremes(count):
    rows = walk(count)
    t, values = thinned(rows).series("a")
    assert len(t) <= 2 * BUCKETS + 2
    size = 1
    while BUCKETS * size < count:
        size *= 2
    index = np.rint(t * 8).astype(int)
    assert np.array_equal(values, rows[index, 1])
    assert np.all(np.diff(index) >= 0)
    assert (index[0], index[-1]) == (0, count - 1)
    for pair, start in zip(
        index[1:-1].reshape(-1, 2), range(0, count, size), strict=True
    ):
        bucket = rows[start : start + size, 1]
        assert sorted(pair - start) == sorted((bucket.argmin(), bucket.argmax()))


@pytest.mark.slow
@pytest.mark.parametrize("block", [1, 7, 4096, 10_000, 50_000])
def test_blocks_leave_no_trace(block):
    rows = walk(50_000)
    rows[100:400, 1] = np.nan
    rows[20_000:20_500:3, 2] = np.inf
    if block == 1:
        rows = rows[:20_000]
    some, others = thinned(rows, block=block), thinned(rows, block=333)
    for name in "ab":
        for got, expected in zip(some.series(name), others.series(name), strict=True):
            assert np.array_equal(got, expected, equal_nan=True)
    for got, expected in zip(some.path("a", "b"), others.path("a", "b"), strict=True):
        assert np.array_equal(got, expected, equal_nan=True)


def test_what_is_not_finite_is_a_gap_and_hides_nothing():
    rows = walk(16 * BUCKETS)
    rows[10_000:20_000, 1] = np.nan
    odd = rows[30_001::16, 1]
    odd[:] = np.resize([np.inf, -np.inf, np.nan], len(odd))
    t, values = thinned(rows).series("a")
    hidden = (t > 10_016 / 8) & (t < 19_984 / 8)
    assert hidden.sum() > 1000
    assert np.isnan(values[hidden]).all()
    assert np.isfinite(values[~hidden]).mean() > 0.99
    usable = np.isfinite(rows[:, 1])
    assert np.nanmax(values) == rows[usable, 1].max()
    assert np.nanmin(values) == rows[usable, 1].min()


@pytest.mark.slow
def test_a_difference_is_taken_row_by_row():
    t = np.arange(300_000) * 1e-2
    work = 100 * np.sin(40 * t)
    small = 1e-9 * np.sin(t)
    rows = np.stack((t, work + small, work), axis=1)
    exact = rows[:, 1] - rows[:, 2]
    thinning = thinned(rows, differences={"a - b": ("a", "b")})
    _, values = thinning.series("a - b")
    assert values.max() == exact.max()
    assert values.min() == exact.min()
    assert values[0] == exact[0]
    assert "a - b" in thinning
    assert "work" not in thinning


@pytest.mark.slow
def test_a_path_is_made_of_true_rows_in_order():
    rows = walk(1_000_000)
    x, y = thinned(rows, block=9999).path("t", "b")
    index = np.rint(x * 8).astype(int)
    assert POINTS // 2 <= len(x) <= POINTS + 1
    assert np.array_equal(y, rows[index, 2])
    assert np.all(np.diff(index) > 0)
    assert (index[0], index[-1]) == (0, len(rows) - 1)
    assert np.diff(index).max() <= 2 * 64


def test_a_periodic_path_shows_all_its_points_alike():
    turn = np.arange(1_000_000) / 128 * 2 * np.pi
    rows = np.stack((turn, np.cos(turn), np.sin(turn)), axis=1)
    x, y = thinned(rows, block=20_000).path("a", "b")
    places = np.rint(np.arctan2(y, x) / (2 * np.pi) * 128) % 128
    shares = np.bincount(places.astype(int), minlength=128) / len(x) * 128
    assert shares == pytest.approx(1.0, abs=0.1)


@pytest.mark.slow
def test_memory_does_not_grow_with_the_rows():
    block = walk(10_000)
    columns = ("t", "a", "b")

    def peak(blocks):
        tracemalloc.start()
        thinning = Thinning(columns)
        for _ in range(blocks):
            thinning.add(block)
        top = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        return top

    assert peak(100) < 1.1 * peak(5)


def test_only_the_columns_that_are_asked_for_are_kept():
    rows = walk(10)
    thinning = thinned(rows, series={"b"}, paths=())
    assert np.array_equal(thinning.series("b")[1], rows[:, 2])
    with pytest.raises(KeyError):
        thinning.series("a")
    with pytest.raises(KeyError):
        thinning.path("a", "b")


def test_of_two_neighbours_each_is_kept_as_often():
    # Rows that alternate: their mean is 0, and that of those that are kept.
    rows = walk(2 * POINTS)
    rows[:, 1] = np.where(np.arange(len(rows)) % 2, 1.0, -1.0)
    a, _ = thinned(rows).path("a", "b")
    assert len(a) < len(rows) / 3
    assert abs(np.mean(a)) < 1e-2
