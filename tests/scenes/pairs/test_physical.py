"""Each pair of physical features moves as each of them does alone."""

import numpy as np
import pytest

import lagsim
from lagsim.errors import InputError
from tests.scenes.pairs.physical import BY_NAME
from tests.scenes.pairs.scene import PAIRS, REFUSED, WAYS, motion, part_of, scene

BOUND = 1e-9
TOLD = {"redundant", "multipliers-not-unique"}


def _cases():
    for pair in PAIRS:
        for way in WAYS:
            name = f"{pair[0]} {way} {pair[1]}"
            marks = [] if part_of(name, 12) else [pytest.mark.slow]
            yield pytest.param(*pair, way, id=name, marks=marks)


def moves(*fragments, **composition):
    """Hold a scene against its closed form: all rows, its end, its energy."""
    model = lagsim.load(scene(*fragments, **composition))
    result = lagsim.simulate(model, error_bar="never")
    assert result.complete, result.reason
    told = TOLD if any(f.name == "redundant" for f in fragments) else set()
    assert {w.code for w in result.warnings} == told
    end = min(f.end for f in fragments)
    assert result.t[-1] == pytest.approx(end, abs=BOUND)
    for name, x in motion(*fragments, t=result.t).items():
        assert result[name] == pytest.approx(x, abs=BOUND), name
    work = result["work"] if "work" in result.columns else 0.0
    assert np.ptp(result["energy"] - work) < BOUND


@pytest.mark.parametrize("name", list(BY_NAME))
def test_a_feature_alone(name):
    moves(BY_NAME[name])


@pytest.mark.parametrize(("first", "second", "way"), list(_cases()))
def test_features_in_pairs(first, second, way):
    pair = BY_NAME[first], BY_NAME[second]
    if (first, second) in REFUSED:
        with pytest.raises(InputError, match=REFUSED[first, second]):
            moves(*pair, coupled=way == "coupled")
    else:
        moves(*pair, coupled=way == "coupled")
