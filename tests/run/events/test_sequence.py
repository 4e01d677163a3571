"""Switches and strikes that come ever faster: by closed forms of geometric series."""

from __future__ import annotations

import itertools

import pytest

from lagsim.run.events.sequence import RESTS, SHORT, STUCK, Flights, Sequence


def told(times, start=0.0, span=100.0, surfaces=(0,)):
    """Give the sequence of switches at these times, by turns of surfaces."""
    found = Sequence(start, span)
    for time, surface in zip(times, itertools.cycle(surfaces)):
        found.add(time, surface)
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


def test_a_long_rest_before_is_no_measure():
    # However long nothing has switched: what counts is since they come faster.
    time, limit = first_limit([1e6, *geometric(1e-3, 0.5)])
    assert limit == pytest.approx(1e6 + 2e-3, abs=1e-9)
    assert limit - time <= SHORT * 2e-3


@pytest.mark.parametrize(("start", "span"), [(1000.0, 1.0), (0.0, 1000.0), (-1e3, 1.0)])
def test_switches_in_no_time(start, span):
    """Forty within a few units in the last place of times of that size."""
    assert STUCK == 40
    unit = 2.0**-53 * 1000
    for apart, stuck in ((0.0, True), (unit, True), (8 * unit, False)):
        times = [start + k * apart for k in range(40)]
        assert told(times, start, span).is_stuck() == stuck
        assert not told(times[:39], start, span).is_stuck()


def test_who_switched_lately():
    found = told(range(20), surfaces=(4, 1))
    assert found.lately() == [1, 4]
    for k in range(7):
        found.add(20.0 + k, 2)
    assert found.lately() == [1, 2]
    found.add(27.0, 2)
    assert found.lately() == [2]


def struck(took, speeds=None, start=3.0):
    """Give the flights between strikes so long apart."""
    found, time = Flights(), start
    for k, more in enumerate([0.0, *took]):
        time += more
        found.add(time, 1.0 if speeds is None else speeds[k])
    return found, time


@pytest.mark.parametrize("ratio", [0.1, 0.5, 0.95, 0.998])
def test_when_flights_end(ratio):
    took = [ratio**k for k in range(3)]
    found, time = struck(took)
    least, last = 1e-3, took[-1]
    # A flight as long as the last, at a speed v, goes v last/2 up and down; all that
    # follow go ratio^2, ratio^4, ... of it.
    whole = 0.5 * sum(ratio ** (2 * k) for k in range(1, 20000))
    most = least / last / max(1.0, whole)
    end = time + last * ratio / (1 - ratio)
    assert found.end(time, 0.999 * most, least) == pytest.approx(end)
    assert found.end(time, 1.001 * most, least) is None
    # Ten flights later it has not struck any more.
    late = found.end(time + 9.9 * last, 0.0, least)
    assert late == pytest.approx(max(end, time + 9.9 * last))
    assert found.end(time + 10.1 * last, 0.0, least) is None


def test_the_slower_of_two_ratios_is_theirs():
    for took in ([1.0, 0.5, 0.45], [1.0, 0.9, 0.45]):
        found, time = struck(took)
        last = took[-1]
        assert found.end(time, 0.0, 1.0) == pytest.approx(time + last * 0.9 / 0.1)


def test_flights_that_are_none():
    # As long as each other; longer; too few; two strikes at one time.
    for took in ([1.0, 0.9995, 0.999], [1.0, 1.1, 1.2], [1.0, 0.5], [1.0, 0.0, 0.5]):
        found, time = struck(took)
        assert found.end(time, 0.0, 1.0) is None


@pytest.mark.parametrize("loud", range(6))
def test_by_turns_none_of_the_last_four_went_anywhere(loud):
    took = [1.0, 0.5, 1.0, 0.5]
    speeds = [1e-4] * 5
    if loud < 5:
        speeds[loud] = 1.0
    found, time = struck(took, speeds)
    # The speed of the first strike is that before the flights.
    assert found.end(time, 1e-4, 1e-2) == (time if loud in (0, 5) else None)
    assert found.end(time, 1.0, 1e-2) is None


@pytest.mark.parametrize(("apart", "restless"), [(1e-9, True), (1e-2, False)])
def test_rests_that_do_not_last(apart, restless):
    flights = Flights()
    for k in range(RESTS):
        assert not flights.is_restless(1.0)
        flights.rests.append(1.0 + k * apart)
    assert flights.is_restless(1.0) is restless
