"""A picture that cannot be drawn is left out; the rest of a run is unchanged."""

import errno
from pathlib import Path

import pytest

from lagsim.outputs import plots, results
from tests.cli._results import document as read
from tests.cli._results import manifest, names, table
from tests.small_scenes import ON_THE_CURVE, PENDULUM

DRAWN = ["constraint_forces.png", "energy.png", "trajectory.png"]


def broken(*_arguments, **_keywords):
    raise ZeroDivisionError("float division by zero")


@pytest.mark.parametrize(
    "name", ["energy", pytest.param("constraint_forces", marks=pytest.mark.slow)]
)
def test_one_that_fails_leaves_rows_record_and_the_others(
    lagsim, write, monkeypatch, name
):
    monkeypatch.setattr(plots, name, broken)
    called = lagsim("run", write(ON_THE_CURVE), "-o", "out", code=0)
    document = manifest("out")
    told = [w for w in document["warnings"] if w["code"] == "not-drawn"]
    assert [w["number"] for w in told] == ["W403"]
    assert f"`{name}.png`" in told[0]["text"]
    assert "ZeroDivisionError: float division by zero" in told[0]["text"]
    assert "test_undrawn.py, line" in told[0]["text"]
    assert f"`{name}.png`" in called.err
    assert "[W403]" in called.err
    assert document["complete"]
    _, rows = table("out")
    assert len(rows) == document["rows"]
    drawn = [file for file in DRAWN if file != f"{name}.png"]
    assert names("out") == sorted([*drawn, "run.json", "trajectory.csv"])
    assert sorted(document["files"]) == names("out")
    assert set(document["sha256"]) == set(document["files"]) - {"run.json"}


def test_a_page_that_fails_is_one_too(lagsim, write, monkeypatch):
    monkeypatch.setattr("lagsim.outputs.animation.page", broken)
    scene = "scene: {points: {bob: [sin(theta), -cos(theta)]}}\n"
    called = lagsim(
        "run", write(PENDULUM + scene), "-o", "out", "--animate", "--strict", code=1
    )
    assert called.reports("W403", "`animation.html`")
    assert names("out") == ["energy.png", "run.json", "trajectory.csv", DRAWN[2]]


@pytest.mark.skipif(results.fcntl is None, reason="no such locks")
@pytest.mark.parametrize("kind", ["ENOLCK", "ENOTSUP", "ENOSYS", "EBADF"])
@pytest.mark.parametrize(
    ("call", "record"), [("run --no-plots", "run"), ("sweep l=1,2 -j 1", "sweep")]
)
def test_a_folder_that_cannot_be_locked_is_reported(
    lagsim, write, monkeypatch, call, record, kind
):
    def flock(*_):
        raise OSError(getattr(errno, kind), "no locks")

    monkeypatch.setattr(results.fcntl, "flock", flock)
    command, *more = call.split()
    called = lagsim(command, write(PENDULUM), "-o", "out", *more, code=0)
    assert called.reports("W404", "no locks")
    told = [w["number"] for w in read(f"out/{record}.json")["warnings"]]
    assert told.count("W404") == called.err.count("[W404]") == 1
    assert lagsim("golden", "--update", "model.yaml", code=0).err.count("[W404]") == 1


class Killed(BaseException):
    """Drawing that kills the process."""


@pytest.mark.parametrize("before", [False, True])
def test_rows_are_in_their_place_before_anything_is_drawn(
    lagsim, write, monkeypatch, before
):
    """Pictures of an earlier run are removed, since they show other rows."""
    write(PENDULUM)
    if before:
        assert lagsim("run", "model.yaml", "-o", "out", "--set", "l=2").code == 0

    def killed(*_arguments, **_keywords):
        there = [name for name in names("out") if not name.startswith(".")]
        assert there == ["run.json", "trajectory.csv"]
        raise Killed

    monkeypatch.setattr(plots, "pictures", killed)
    with pytest.raises(Killed):
        lagsim("run", "model.yaml", "-o", "out")
    document = manifest("out")
    assert document["files"] == ["trajectory.csv", "run.json"]
    assert len(table("out")[1]) == document["rows"] == 21
    assert document["parameters"]["l"] == 1.0


def test_a_sweep_keeps_its_rows(lagsim, write, monkeypatch):
    monkeypatch.setattr("lagsim.studies.sweep.chart.chart", broken)
    call = ("sweep", write(PENDULUM), "l=1,2", "-o", "out", "--jobs", "1")
    assert lagsim(*call, code=0).reports("W403", "`sweep.png`")
    assert names("out") == ["sweep.csv", "sweep.json"]
    document = read("out/sweep.json")
    assert [w["code"] for w in document["warnings"]] == ["not-drawn"]
    assert sorted(document["files"]) == names("out")


STORED = {
    "lagsim.studies.comparison_chart.picture": "compare out out --plot seen.png",
    "lagsim.studies.overlay.picture": "overlay out out -o seen.png",
    "lagsim.studies.spectrum.Spectrum.plot": "spectrum out theta -o seen.png",
}


def test_what_is_drawn_of_stored_rows_may_fail_too(lagsim, write, monkeypatch):
    lagsim("run", write(PENDULUM), "-o", "out", "--no-plots", code=0)
    for place, line in STORED.items():
        monkeypatch.setattr(place, broken)
        called = lagsim(*line.split(), code=0)
        assert called.reports("W403", "`seen.png`")
        assert "[W403]" in called.err
        assert not Path("seen.png").exists()
