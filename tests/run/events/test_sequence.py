"""Switches and strikes that come ever faster: by closed forms of geometric series."""

from __future__ import annotations

import pytest

from lagsim.run.events.sequence import RESTS, SHORT, STUCK, Flights, Sequence


def told(times, start=0.0, span=100.0):
    """Give the sequence of switches at these times."""
    found = Sequence(start, span)
    for time in times:
        found.add(time, 0)
    return found


def first_limit(intervals, start=0.0):
    """Give when a limit is told first, and that limit; or None."""
    found, time = Sequence(start, 100.0), start
    for interval in intervals:
        time += interval
        found.add(time, 0)
        if found.limit() is not None:
            return time, found.limit()
    return None


def geometric(first, ratio):
    return [first * ratio**k for k in range(400)]


@pytest.mark.parametrize("ratio", [0.3, 0.5, 0.8])
@pytest.mark.parametrize("unit", [1e-6, 1.0, 1e6])
def test_the_limit_of_a_geometric_series(ratio, unit):
    time, limit = first_limit(geometric(unit, ratio))
    exact = unit / (1 - ratio)
    assert limit == pytest.approx(exact, rel=1e-12)
    # Once what is left is SHORT of the longest stretch, and at most four later.
    left = (exact - time) / unit
    assert SHORT * ratio**5 < left <= SHORT * 1.001
    assert SHORT == 4e-6


def test_no_limit_of_what_does_not_come_faster():
    assert first_limit([1.0] * 100) is None
    assert first_limit(geometric(1e-3, 1.01)) is None
    # Not before it has been seen twice that they do: nine switches.
    assert told([1 - 0.5**k for k in range(8)]).end() is None
    found = told([1 - 0.5**k for k in range(9)])
    assert found.end() == pytest.approx(1.0, rel=1e-12)


@pytest.mark.parametrize(
    ("before", "theirs"),
    [
        # Stretches of a series at 0.8 are 2.44 times as long as what follows; one that
        # is 16 times longer than that is none of theirs. One that has a quarter of what
        # was before, and the rest of the series, is 50 times at 100.
        (10.0, True),
        (35.0, True),
        (100.0, False),
        (300.0, False),
    ],
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


@pytest.mark.parametrize(("start", "span"), [(1000.0, 1.0), (0.0, 1000.0), (-1e3, 1.0)])
def test_switches_in_no_time(start, span):
    """Forty within a few units in the last place of times of that size."""
    assert STUCK == 40
    unit = 2.0**-53 * 1000
    for apart, stuck in ((0.0, True), (unit, True), (8 * unit, False)):
        times = [start + k * apart for k in range(40)]
        assert told(times, start, span).is_stuck() == stuck
        assert not told(times[:39], start, span).is_stuck()


# What flights that end are, scenes/contact/test_columns.py shows by runs.
def test_flights_that_are_none():
    # As long as each other; longer; too few; two strikes at one time.
    for took in ([1.0, 0.9995, 0.999], [1.0, 1.1, 1.2], [1.0, 0.5], [1.0, 0.0, 0.5]):
        found, time = Flights(), 3.0
        for more in (0.0, *took):
            time += more
            found.add(time, 1.0)
        assert found.end(time, 0.0, 1.0) is None


@pytest.mark.parametrize(("apart", "restless"), [(1e-9, True), (1e-2, False)])
def test_rests_that_do_not_last(apart, restless):
    flights = Flights()
    for k in range(RESTS):
        assert not flights.is_restless(1.0)
        flights.rests.append(1.0 + k * apart)
    assert flights.is_restless(1.0) is restless
