"""`lagsim run --animate`: the page among the results."""

from __future__ import annotations

import pytest

from lagsim.outputs.animation import recorded
from tests.cli._results import manifest, names
from tests.small_scenes import FALL, ON_THE_CURVE, PENDULUM

PAGE = "animation.html"


def test_a_page_is_one_of_the_files(lagsim, write, tmp_path):
    model = write(ON_THE_CURVE)
    assert lagsim("run", model, "--no-plots", "-o", "plain").code == 0
    told = lagsim("run", model, "--no-plots", "--animate", "-o", "moving")
    assert told.code == 0
    assert PAGE in told.out
    assert PAGE in manifest("moving")["files"]
    assert set(names("moving")) - set(names("plain")) == {PAGE}
    # The motion is the same to the last bit.
    table = "trajectory.csv"
    assert (tmp_path / "moving" / table).read_bytes() == (
        tmp_path / "plain" / table
    ).read_bytes()
    [run] = recorded((tmp_path / "moving" / PAGE).read_text("utf-8"))
    assert [point["name"] for point in run["points"]] == ["point"]
    # The next run without one takes it away.
    assert lagsim("run", model, "--no-plots", "-o", "moving").code == 0
    assert PAGE not in names("moving")


def test_nothing_to_draw_is_said(lagsim, write):
    told = lagsim("run", write(PENDULUM), "--no-plots", "--animate", "-o", "results")
    assert told.code == 0
    assert "nothing to draw" in told.err
    assert PAGE not in names("results")
    [caution] = manifest("results")["warnings"]
    assert caution["code"] == "nothing-to-draw"


@pytest.mark.slow
def test_a_run_that_fails_shows_how_far_it_came(lagsim, write, tmp_path):
    text = FALL + "scene: {points: {mass: [r, 0]}}\n"
    told = lagsim("run", write(text), "--no-plots", "--animate", "-o", "results")
    assert told.code == 3
    [run] = recorded((tmp_path / "results" / PAGE).read_text("utf-8"))
    assert run["notes"][0].startswith("incomplete")
