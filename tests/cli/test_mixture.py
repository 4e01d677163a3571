"""A folder with files of two runs is told: run.json has the sha256 of each."""

import hashlib
import json
from pathlib import Path

import pytest

import lagsim as house
from tests.cli._results import manifest
from tests.support import MODELS

ELASTIC = MODELS / "elastic-pendulum.yaml"


@pytest.fixture
def two(lagsim):
    """Make two runs, `a` and `b`, that differ."""
    for name, value in (("a", "9.8"), ("b", "9.7")):
        line = ("run", ELASTIC, "--no-plots", "--animate", "--duration", "1")
        assert lagsim(*line, "-o", name, "--set", f"g={value}").code == 0
    return lagsim


@pytest.mark.usefixtures("two")
def test_each_file_has_its_sha256():
    record = manifest("a")
    assert [*record["sha256"], "run.json"] == record["files"]
    for name, digest in record["sha256"].items():
        assert hashlib.sha256(Path("a", name).read_bytes()).hexdigest() == digest


def test_so_it_has_where_python_writes_them(tmp_path):
    result = house.simulate(house.load(str(ELASTIC)), duration=0.5)
    result.write(tmp_path / "out", plots=False)
    digests = json.loads((tmp_path / "out/run.json").read_bytes())["sha256"]
    table = (tmp_path / "out/trajectory.csv").read_bytes()
    assert digests["trajectory.csv"] == hashlib.sha256(table).hexdigest()


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
