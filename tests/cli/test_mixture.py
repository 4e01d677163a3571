"""A folder with files of two runs is detected by the sha256 in run.json."""

import hashlib
import json
import shutil
from pathlib import Path

import pytest

import lagsim as house
from tests.cli._results import manifest
from tests.support import MODELS

ELASTIC = MODELS / "elastic-pendulum.yaml"


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Create two different runs, `a` and `b`."""
    folder = tmp_path_factory.mktemp("made")
    for name, g in (("a", 9.8), ("b", 9.7)):
        model = house.load(ELASTIC, g=g)
        result = house.simulate(model, duration=0.5, error_bar="never")
        result.write(folder / name, plots=False, animate=True)
    return folder


@pytest.fixture
def two(made, lagsim, tmp_path):
    """Return the command, in a folder with both runs."""
    shutil.copytree(made, tmp_path, dirs_exist_ok=True)
    return lagsim


@pytest.mark.usefixtures("two")
def test_each_file_has_its_sha256():
    record = manifest("a")
    assert [*record["sha256"], "run.json"] == record["files"]
    for name, digest in record["sha256"].items():
        assert hashlib.sha256(Path("a", name).read_bytes()).hexdigest() == digest


def test_a_table_of_another_run_is_told(two):
    said = two("compare", "a", "a").out + two("compare", "a", "a").err
    assert "another run" not in said
    Path("b/trajectory.csv").replace("a/trajectory.csv")
    done = two("compare", "a", "a", code=0)
    assert "a/trajectory.csv is not the file that run.json beside it" in done.out
    done = two("spectrum", "a", "theta")
    assert (done.code, "another run" in done.err) == (0, True)


def test_a_page_of_another_run_is_not_taken_over(two, tmp_path):
    mine = Path("a/animation.html").read_bytes()
    assert two("overlay", "a", "b", "-o", "one.html").code == 0
    Path("b/animation.html").write_bytes(mine)
    assert two("overlay", "a", "b", "-o", "two.html").code == 0

    def runs(name):
        page = (tmp_path / name).read_text()
        return page.count('"name":"a"'), page.count('"name":"b"')

    assert runs("one.html") == runs("two.html")


@pytest.mark.parametrize("digests", [None, 3, [], {"trajectory.csv": 4}])
def test_what_a_stranger_lists_is_no_bug(two, digests):
    record = manifest("a")
    Path("a/run.json").write_text(json.dumps(record | {"sha256": digests}))
    for line in (("compare", "a", "a"), ("overlay", "a", "b", "-o", "x.html")):
        assert two(*line).code == 0
