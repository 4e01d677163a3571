"""Each pair of physical features moves as each feature does alone."""

import numpy as np
import pytest

import lagsim
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

BOUND = 1e-9
# Of places and times that are so much larger than the motion.
ROUNDING = 300 * 2.0**-52
TOLD = {"redundant", "multipliers-not-unique"}


def _cases():
    for pair in PAIRS:
        for way in WAYS:
            name = f"{pair[0]} {way} {pair[1]}"
            marks = [] if part_of(name, 12) else [pytest.mark.slow]
            yield pytest.param(*pair, way, id=name, marks=marks)


def moves(*fragments, **words):
    """Compare a scene with its closed form: all rows, its end, its energy."""
    model = lagsim.load(scene(*fragments, **words))
    result = lagsim.simulate(model, error_bar="never")
    assert result.complete, result.reason
    told = TOLD if any(f.name == "redundant" for f in fragments) else set()
    three = len(fragments) > 2  # of which a start may change, by rounding
    warned = {w.code for w in result.warnings}
    assert warned - ({"start-changed"} if three else set()) == told
    far, speed, later = (words.get(x, 0.0) for x in ("far", "speed", "later"))
    bound = BOUND + ROUNDING * max(far, 2 * speed, later)
    t = result.t - later
    end = min(f.end for f in fragments)
    assert t[-1] == pytest.approx(end, abs=bound)
    for name, x in motion(*fragments, t=t).items():
        assert result[name] == pytest.approx(x, abs=bound), name
    holds_sections(result, *fragments, bound=bound, shift=later)
    work = result["work"] if "work" in result.columns else 0.0
    size = 10.0 * max(1.0, float(np.max(result["kinetic"]))) if three else 1.0
    assert np.ptp(result["energy"] - work) < bound * size


@pytest.mark.parametrize("name", list(BY_NAME))
def test_a_feature_alone(name):
    moves(BY_NAME[name])


@pytest.mark.slow
@pytest.mark.parametrize(("first", "second", "way"), list(_cases()))
def test_features_in_pairs(first, second, way):
    pair = BY_NAME[first], BY_NAME[second]
    if (first, second) in REFUSED:
        with REFUSED[first, second].expected():
            moves(*pair, coupled=way == "coupled")
    else:
        moves(*pair, coupled=way == "coupled")


def _needs_no_repeat(*fragments, **words):
    """Compare rows with the repeat that estimates the error to rows without it."""
    model = lagsim.load(scene(*fragments, **words))
    once, again = (lagsim.simulate(model, error_bar=x) for x in ("never", "auto"))
    assert not isinstance(again.record["error"], str)
    choices = [x["choice"] for x in again.record["plan"]]
    assert not [x for x in choices if x.startswith("repeated")]
    for name in once.columns:
        assert np.array_equal(once[name], again[name]), name


@pytest.mark.parametrize("name", list(BY_NAME))
def test_no_repeat_replaces_a_feature(name):
    _needs_no_repeat(BY_NAME[name])


@pytest.mark.nightly
@pytest.mark.parametrize(("first", "second"), [x for x in PAIRS if x not in REFUSED])
def test_no_repeat_replaces_a_pair(first, second):
    _needs_no_repeat(BY_NAME[first], BY_NAME[second], coupled=True)
