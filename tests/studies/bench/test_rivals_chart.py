"""docs/speed.png, drawn as the other charts are: read off what is drawn."""

from __future__ import annotations

import pytest

from benchmarks.rivals_chart import LOOKS, chart
from lagsim.studies.experiment import stamp
from tests.outputs.drawn import assert_legible, drawn


def points(times):
    errors = [10.0**-k for k in range(2, 14)]
    return [{"error": e, "seconds": times * e**-0.1} for e in errors]


def document(scenes):
    names = list(LOOKS)
    every = [
        {
            "title": f"ten rods of scene {k}", "agreement": 1e-15, "rows": 1501,
            "points": {name: points(1e-3 * (1 + j)) for j, name in enumerate(names)},
        }
        for k in range(scenes)
    ]  # fmt: skip
    packages = {"python": "3.13.1", "heyoka": "7.13.2", "scikit-sundae": "1.2.0"}
    machine = {"processor": "Some Processor", "cores": 4, "system": "Linux", "load": 0}
    return {
        "lagsim": "1.2.3", "versions": packages, "machine": machine,
        "date": "2030-04-01", "scenes": every,
    }  # fmt: skip


@pytest.mark.parametrize("scenes", [1, 6])
def test_every_text_is_legible_and_all_is_said(scenes):
    found = document(scenes)
    drawing = drawn(chart, found)
    assert_legible(drawing)
    assert len(drawing.panels) == scenes
    said = drawing.written()
    assert said.count("↙ better") == scenes
    assert stamp(found) in " ".join(said).replace("\n", " ")
    assert set(LOOKS) <= set(said)


def test_curves_are_told_apart_in_grey():
    looks = {(a.line.get("dashes"), a.mark["marker"]) for a in LOOKS.values()}
    assert len(looks) == len(LOOKS)
