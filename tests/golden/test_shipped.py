"""The goldens of the shipped models: made by

    lagsim golden models/*.yaml --dir tests/golden --update

and to be looked at before they are stored anew: a model that differs has changed.
"""

from __future__ import annotations

import pytest

from tests.golden.scenes import GOLDENS, SHIPPED, judged, scene, told


@pytest.mark.parametrize("name", SHIPPED)
def test_the_motion_is_still_the_same(name):
    found = judged(name, scene(name))
    assert found.passed, told(found)
    assert not found.extra


def test_every_golden_has_a_model_and_is_small():
    for ending in ("csv", "json"):
        assert sorted(path.stem for path in GOLDENS.glob(f"*.{ending}")) == SHIPPED
    sizes = [path.stat().st_size for path in GOLDENS.iterdir() if path.is_file()]
    assert max(sizes) < 50_000
