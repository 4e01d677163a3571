"""Stretches of a sequence that repeat themselves."""

from __future__ import annotations

from itertools import pairwise

from hypothesis import given, settings
from hypothesis import strategies as st

from lagsim.native.graph.repeats import LEAST_LENGTH, LEAST_TIMES, Repeat, repeats

LINK = [5, 1, 1, 1, 2]


def test_what_stands_between_is_left_out() -> None:
    sequence = [7, 8, 9, *LINK * 6, 3, *[4] * 20, 9]
    assert repeats(sequence) == [Repeat(3, 5, 6), Repeat(34, 1, 20)]


def test_the_longest_wins_and_then_the_shortest_period() -> None:
    # Three equal steps of a link are no stretch, and ten links not five pairs.
    assert repeats(LINK * 10) == [Repeat(0, 5, 10)]
    # What is left of a shorter one beside a longer one is kept where it is enough.
    sequence = [1] * 30 + [1, 2] * 40
    assert repeats(sequence) == [Repeat(0, 1, 30), Repeat(30, 2, 40)]


def test_little_is_no_loop() -> None:
    assert repeats([]) == []
    assert repeats([1] * (LEAST_LENGTH - 1)) == []
    assert repeats(list(range(50)) * (LEAST_TIMES - 1)) == []


@given(st.lists(st.sampled_from([[1], [2], [1, 2], LINK, [3] * 9]), max_size=60))
@settings(max_examples=60, deadline=None, derandomize=True)
def test_all_that_is_found_repeats_itself_apart(parts: list[list[int]]) -> None:
    sequence = [x for part in parts for x in part]
    found = repeats(sequence)
    for start, period, times in found:
        whole = sequence[start : start + period * times]
        assert whole == whole[:period] * times
    for one, other in pairwise(found):
        assert one.start + one.length <= other.start
    # None of these is left.
    covered = [False] * len(sequence)
    for x in found:
        covered[x.start : x.start + x.length] = [True] * x.length
    for start in range(len(sequence) - LEAST_LENGTH):
        same = set(sequence[start : start + LEAST_LENGTH])
        if len(same) == 1:
            assert any(covered[start : start + LEAST_LENGTH])
