"""Pages: `lagsim run --animate`; `lagsim overlay`: several results in one picture."""

import shutil
from pathlib import Path

import numpy as np
import pytest

import lagsim as house
from lagsim.outputs.animation import recorded
from tests.cli._results import manifest, names
from tests.outputs.browser import needs_browser, shown
from tests.outputs.drawn import noted
from tests.small_scenes import FALL, ON_THE_CURVE, PENDULUM

PAGE = "animation.html"


@pytest.mark.slow
def test_a_page_is_one_of_the_files(lagsim, write, tmp_path):
    model = write(ON_THE_CURVE)
    assert lagsim("run", model, "--no-plots", "-o", "plain").code == 0
    told = lagsim("run", model, "--no-plots", "--animate", "-o", "moving", code=0)
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
    told = lagsim(
        "run", write(PENDULUM), "--no-plots", "--animate", "-o", "results", code=0
    )
    assert "nothing to draw" in told.err
    assert PAGE not in names("results")
    [caution] = manifest("results")["warnings"]
    assert caution["code"] == "nothing-to-draw"


@pytest.mark.slow
@pytest.mark.drawn
def test_a_run_that_fails_shows_how_far_it_came(lagsim, write, tmp_path):
    text = FALL + "scene: {points: {mass: [r, 0]}}\n"
    lagsim("run", write(text), "--no-plots", "--animate", "-o", "results", code=3)
    [run] = recorded((tmp_path / "results" / PAGE).read_text("utf-8"))
    assert run["notes"][0].startswith("incomplete")


# Its angle: x = cos t, y = sin t; it has no scene, and its rates are no columns.
ROUND = """\
coordinates: {a: }
definitions: {x: cos(a), y: sin(a)}
energy: {kinetic: a_dot^2/2, potential: 0}
initial: {a: 0, a_dot: 1}
simulation: {duration: 3, output_step: 0.1}
"""
BALL = """\
coordinates: {x: {unit: m}, y: {unit: m}}
energy: {kinetic: (x_dot^2 + y_dot^2)/2, potential: 9.8*y}
constraints: {floor: {relation: y >= 0, restitution: 0.5}}
initial: {x: 0, y: 4.9, x_dot: 1}
simulation: {duration: 1.9, output_step: 0.3}
"""


RUNS = {
    "soft": (ON_THE_CURVE, {}, True),
    "hard": (ON_THE_CURVE, {"K": 40}, True),
    "round": (ROUND, {}, False),
    "ball": (BALL, {}, False),
    "angle": (PENDULUM, {}, False),
}


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    """Create the results, once."""
    made = tmp_path_factory.mktemp("made")
    for name, (text, values, animate) in RUNS.items():
        result = house.simulate(house.load(text, **values), error_bar="never")
        result.write(made / name, plots=False, animate=animate)
    return made


@pytest.fixture
def overlay(results, lagsim, tmp_path):
    """Return a function that calls the command in a folder with results."""
    shutil.copytree(results, tmp_path, dirs_exist_ok=True)
    return lambda *words: lagsim("overlay", *words)


def page_of(path):
    return recorded(path.read_text("utf-8"))


@pytest.mark.slow
@pytest.mark.drawn
def test_a_picture_and_a_page(overlay, tmp_path):
    told = overlay("soft", "hard")
    assert (told.code, told.err) == (0, "")
    assert told.out == "2 runs: results/overlay.png, results/overlay.html\n"
    results = tmp_path / "results"
    assert (results / "overlay.png").read_bytes().startswith(b"\x89PNG")
    runs = page_of(results / "overlay.html")
    assert [r["name"] for r in runs] == ["soft (K = 25.6)", "hard (K = 40)"]
    # What a page of one run plays, it plays.
    [own] = page_of(tmp_path / "hard/animation.html")
    assert {**runs[1], "name": own["name"]} == own


def test_o_says_what_is_made(overlay, tmp_path):
    assert overlay("round", "-o", "here/it.html", "-q").out == ""
    assert [r["name"] for r in page_of(tmp_path / "here/it.html")] == ["round"]
    assert overlay("round", "-o", "it.PNG", "--columns", "x, y").code == 0
    assert not (tmp_path / "results").exists()


@pytest.mark.slow
@pytest.mark.drawn
@pytest.mark.parametrize(
    ("name", "begins"), [("it.svg", b"<?xml"), ("it.pdf", b"%PDF")]
)
def test_a_picture_for_print(overlay, tmp_path, name, begins):
    assert overlay("round", "-o", name).code == 0
    assert (tmp_path / name).read_bytes().startswith(begins)


def test_a_folder_that_is_given_twice_has_two_names(overlay, tmp_path):
    assert overlay("round", "round", "-o", "it.html").code == 0
    assert [r["name"] for r in page_of(tmp_path / "it.html")] == ["round", "round #2"]


def test_a_run_with_nothing_to_draw_is_named(overlay, tmp_path):
    told = overlay("round", "angle", "-o", "it.html")
    assert told.code == 0
    assert told.reports("W401", "angle")
    assert [r["name"] for r in page_of(tmp_path / "it.html")] == ["round"]
    # Both kinds are made where there is no -o; a page that nothing stands on is not.
    told = overlay("angle")
    assert (told.code, told.out) == (0, "1 run: results/overlay.png\n")
    assert told.reports("W401")


FAULTS = {
    "no folder": (["round", "two"], "two is not there"),
    "no results": (["round", "empty"], "there is no run.json in it"),
    "no run.json of ours": (["foreign"], "is not a run.json of lagsim"),
    "no such column": (["round", "--columns", "x,yy"], "round has no column `yy`"),
    "only the time": (["round", "--columns", "t"], "is the axis of the others"),
    "no columns": (["round", "--columns", ","], "names of columns are expected"),
    "nothing in common": (["round", "angle"], "no coordinate in common"),
    "nothing to draw": (["angle", "-o", "it.html"], "angle has nothing to draw"),
}


@pytest.mark.parametrize(("words", "text"), FAULTS.values(), ids=FAULTS)
def test_what_cannot_be_used_is_told(overlay, tmp_path, words, text):
    (tmp_path / "empty").mkdir()
    (tmp_path / "foreign").mkdir()
    (tmp_path / "foreign/run.json").write_text("[1]")
    told = overlay(*words)
    assert told.code == 2
    assert text in told.err
    assert told.out == ""
    assert not (tmp_path / "results").exists()
    assert not (tmp_path / "it.html").exists()


def test_a_misspelt_column_is_guessed(overlay):
    told = overlay("round", "--columns", "kinetik")
    assert told.reports("E607", "`kinetic`")


@pytest.mark.slow
@needs_browser
def test_side_by_side_in_a_browser(overlay, tmp_path):
    assert overlay("round", "ball", "-o", "it.html").code == 0
    t, points = shown(tmp_path / "it.html", tmp_path / "home", "#t=2.05")
    assert t == 2.05
    # Rates from parabolas through rows 0.1 apart are off by 0.1^2/6 of the third
    # derivative at most (0.1^2/3 at the ends), and count by an eighth of 0.1 each.
    place = points["round/point"]
    expected = [np.cos(2.05), np.sin(2.05)]
    assert np.allclose(place, expected, atol=2 * 0.1**3 / 48 + 0.1**4 / 384)
    # It is over at 1.9, 0.9 s after the floor was struck at 4.9 m/s.
    expected = [1.9, 4.9 * 0.9 - 4.9 * 0.9**2]
    assert np.allclose(points["ball/point"], expected, atol=1e-6)


@pytest.mark.drawn
def test_the_title_is_the_model(overlay, tmp_path):
    # Models that are read from a text have no other name.
    with noted() as drawing:
        assert overlay("soft", "hard", "-o", "o.png", "--columns", "x").code == 0
    assert drawing.title == "<model>: x of 2 runs"
    assert overlay("soft", "hard", "-o", "o.html").code == 0
    assert "<title>&lt;model&gt;: 2 runs</title>" in (tmp_path / "o.html").read_text(
        "utf-8"
    )


@pytest.mark.slow
@pytest.mark.drawn
def test_many_runs_are_told_by_what_was_swept(lagsim, write):
    file = write(PENDULUM, "pendulum.yaml")
    for name, wanted in (("g", "colour: g"), ("theta", "colour: θ at the start (rad)")):
        folder = f"sweep-{name}"
        quick = ("--no-plots", "--error-bar", "never", "-q", "-o", folder)
        lagsim("sweep", file, f"{name}=1:2:13", "--keep", *quick, code=0)
        runs = sorted(str(path) for path in Path(folder).glob("run-*"))
        with noted() as drawing:
            assert lagsim("overlay", *runs, "-o", "o.png").code == 0
        assert wanted in drawing.written()
        assert drawing.title.startswith("pendulum: ")
        assert not any("…" in text for text in drawing.written())
