"""Switches and strikes that come ever faster: by closed forms of geometric series."""

import pytest

from lagsim.run.events.accumulation import SHORT, Accumulation, History


def first_limit(intervals, start=0.0):
    """Return the first time at which a limit is reported, and the limit; or None."""
    found, time = Accumulation(start, 100.0), start
    for interval in intervals:
        time += interval
        found.add(time, 0)
        if found.limit() is not None:
            return time, found.limit()
    return None


def geometric(first, ratio):
    return [first * ratio**k for k in range(400)]


# Stretches of a series at 0.8 are 2.44 times as long as what follows; one that is 16
# times longer than that is none of theirs. One that has a quarter of what was before,
# and the rest of the series, is 50 times at 100.
@pytest.mark.parametrize(
    ("before", "theirs"), [(10.0, True), (35.0, True), (100.0, False), (300.0, False)]
)
def test_from_when_on_they_come_faster(before, theirs):
    ratio, first = 0.8, 1e-2
    series = geometric(first, ratio)
    whole = sum(series[:4])
    # Stretches are counted from the last switch on: only every fourth has the series'
    # first ones together.
    lefts = []
    for extra in range(4):
        lead = [50.0, *[before * whole / 4] * (4 + extra)]
        time, limit = first_limit(lead + series)
        exact = sum(lead) + first / (1 - ratio)
        assert limit == pytest.approx(exact, rel=1e-9)
        lefts.append((exact - time) / whole)
    assert max(lefts) <= 1.1 * SHORT * before
    assert (min(lefts) > 2.0 * SHORT) == theirs


# What flights that end are, scenes/contact/test_columns.py shows by runs.
def test_flights_that_are_none():
    # As long as each other; longer; too few; two strikes at one time.
    for took in ([1.0, 0.9995, 0.999], [1.0, 1.1, 1.2], [1.0, 0.5], [1.0, 0.0, 0.5]):
        found, time = History(), 3.0
        for more in (0.0, *took):
            time += more
            found.strikes.append((time, 1.0))
        assert found.end(time, 0.0, 1.0) is None
