"""Times within 4 units in the last place are one instant, with one time."""

import math

import pytest

from lagsim import simulate
from lagsim.model.model import Settings
from lagsim.run.instants import instant
from tests.run.test_events import acts, scene


def beside(time, places):
    """Give the double that is so many units in the last place from a time."""
    return time + places * math.ulp(time)


def test_an_instant_has_the_time_of_a_row_or_of_the_first_in_the_file():
    settings = Settings(end=2.0, output_step=0.25)
    for times, expected in (
        ((beside(0.3, 3), 0.3), beside(0.3, 3)),  # the first of the file, not in time
        ((0.3, beside(0.3, 3)), 0.3),
        ((0.35, beside(0.3, 2)), beside(0.3, 2)),  # the earliest instant
        ((beside(0.5, 2), beside(0.5, -2)), 0.5),  # a row's
        ((math.inf, 1.0 - 2.0**-50), 1.0),
        ((), math.inf),
    ):
        assert instant(settings, times) == expected


# Of multiples of 0.1 and of 0.3 some are not the same doubles; nor are rows'.
PERIODS = """
modes: {n: 1, z: 0}
events:
  a: {every: 0.1, set: {n: 2*n}}
  b: {every: 0.3, set: {n: n + 1}}
  tick: {every: 0.3, set: {z: 1 - z}}
"""


@pytest.mark.parametrize(("start", "step"), [(0, 0.1), (0, 0.07), (1000, 0.1)])
def test_events_at_one_time_have_one_time_in_rows_lists_and_answers(start, step):
    text = scene(PERIODS, "x: 0, x_dot: 1", 1, start=start, output_step=step)
    found = simulate(text, error_bar="never")
    n, expected, times = 1, [], []
    for k in range(11):
        of = ["a", "b", "tick"] if k % 3 == 0 else ["a"]
        n = 2 * n + (k % 3 == 0)
        expected += [(name, n, (k // 3 + 1) % 2) for name in of]
        times += [start + k * 0.1] * len(of)
    assert [name for name, _ in acts(found)] == [name for name, *_ in expected]
    listed = [t for _, t in acts(found)]
    assert listed == pytest.approx(times, rel=1e-15, abs=1e-15)
    assert len(set(listed)) == 11
    at = found.at(listed)
    assert at["n"].tolist() == [n for _, n, _ in expected]
    assert at["z"].tolist() == [z for *_, z in expected]
    # Rows at these times have these doubles, and show what holds after.
    rows = {t: (n, z) for t, (_, n, z) in zip(listed, expected, strict=True)}
    for t, n, z in zip(found.t, found["n"], found["z"], strict=True):
        near = min(rows, key=lambda x: abs(x - t))
        if abs(near - t) < 1e-9:
            assert (t, n, z) == (near, *rows[near])
