"""Pairs of features in other words: far away, moving, in other units, later, beside."""

import zlib

import pytest

import lagsim
from tests.choosing import tonight, turn
from tests.invariance.same import CHANGES, Sizes
from tests.invariance.transforms import document
from tests.scenes.pairs.physical import BY_NAME
from tests.scenes.pairs.scene import (
    PAIRS,
    REFUSED,
    WAYS,
    holds_sections,
    motion,
    part_of,
    scene,
)
from tests.scenes.pairs.test_physical import BOUND, TOLD
from tests.support import refused

SIZES = Sizes(length=1.0, speed=2.0, time=2.0)


WORDS = tuple(CHANGES)
POSED = [(*pair, way) for pair in PAIRS for way in WAYS if pair not in REFUSED]


def _cases():
    """Return each pair in the form that its name selects, a few of them not slow."""
    for first, second, way in POSED:
        name = f"{first} {way} {second}"
        change = WORDS[zlib.crc32(name.encode()) % len(WORDS)]
        marks = [] if part_of(name, 44) else [pytest.mark.slow]
        yield pytest.param(
            first, second, way, change, id=f"{name} {change}", marks=marks
        )


def _quantised(change):
    """Return the rounding of positions, and of times by the speeds."""
    return 100.0 * 2.0**-52 * CHANGES[change].rounding


def moves(first, second, way, change):
    """Compare a pair in another form with the closed form."""
    pair = BY_NAME[first], BY_NAME[second]
    plain = document(scene(*pair, coupled=way == "coupled"))
    changed = CHANGES[change].put(plain, SIZES)
    if change == "boosted" and "freewheel" in (first, second):
        # Nothing turns one way only on a moving floor; `b_dot >= a_dot` does.
        with refused("not-homogeneous"):
            lagsim.load(changed.text())
        return
    result = lagsim.simulate(lagsim.load(changed.text()), error_bar="never")
    assert result.complete, result.reason
    told = TOLD if "redundant" in (first, second) else set()
    assert {w.code for w in result.warnings} == told
    t = (result.t - changed.shift) * changed.scale
    bound = BOUND + _quantised(change)
    assert t[-1] == pytest.approx(min(f.end for f in pair), abs=bound)
    for name, x in motion(*pair, t=t).items():
        assert result[name] == pytest.approx(x, abs=bound), name
    shown = {"scale": changed.scale, "shift": changed.shift}
    holds_sections(result, *pair, bound=bound, **shown)


@pytest.mark.parametrize(("first", "second", "way", "change"), list(_cases()))
def test_features_in_pairs_in_other_words(first, second, way, change):
    moves(first, second, way, change)


@pytest.mark.nightly
@pytest.mark.parametrize(("first", "second", "way"), POSED)
def test_features_in_pairs_in_the_words_of_a_commit(first, second, way):
    words = turn(f"{first} {way} {second}", tonight(), WORDS)
    moves(first, second, way, words)
