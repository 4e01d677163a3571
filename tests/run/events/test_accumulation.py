"""Switches and strikes that come ever faster: by closed forms of geometric series."""

import pytest

from lagsim.run.events.accumulation import Accumulation, History


# The window before the series may be as long as it likes: the limit is never reported
# much too early, and exactly once two windows belong to the series.
@pytest.mark.parametrize("before", [0.03, 1.0, 1e2, 1e5])
@pytest.mark.parametrize("ratio", [0.8, 0.3, 0.05])
def test_a_limit_is_that_of_the_series_alone(before, ratio):
    first, lead = 1e-2, [before * (1.0 + 0.1 * k) for k in range(6)]
    found, time = Accumulation(100.0), 0.0
    exact = sum(lead) + first / (1.0 - ratio)
    for interval in lead + [first * ratio**k for k in range(9)]:
        time += interval
        found.add(time, 0)
        limit = found.limit()
        if limit is not None:
            rounding = 1e-14 * exact
            assert limit - time >= 0.3 * (exact - time) - rounding
    assert limit == pytest.approx(exact, abs=1e-6 * first + 1e-13 * exact)


@pytest.mark.parametrize(("ratio", "span"), [(1.0 - 1e-12, 1e6), (0.9, 4.0)])
def test_a_limit_farther_ahead_than_the_duration_is_none(ratio, span):
    """A motion that is periodic but for rounding, and one that outlasts the run."""
    found, time, interval = Accumulation(span), 0.0, 2.0
    for _ in range(12):
        time, interval = time + interval, interval * ratio
        found.add(time, 0)
    ahead = interval / (1.0 - ratio)
    assert found.end() == pytest.approx(time + ahead, rel=1e-3)
    assert found.limit() is None
    found.span = 2.0 * ahead
    assert found.limit() == found.end()


# What flights that end are, scenes/contact/test_columns.py shows by runs.
def test_flights_that_are_none():
    # As long as each other; longer; too few; two strikes at one time.
    for took in ([1.0, 0.9995, 0.999], [1.0, 1.1, 1.2], [1.0, 0.5], [1.0, 0.0, 0.5]):
        found, time = History(), 3.0
        for more in (0.0, *took):
            time += more
            found.strikes.append((time, 1.0))
        assert found.end(time, 0.0, 1.0) is None
