"""Needs of continuous integration: strictness, JUnit's XML, annotations."""

import re
from pathlib import Path
from xml.etree import ElementTree as ET

import pytest

from tests.cli._results import manifest, names
from tests.small_scenes import CAPTION, PENDULUM

# `zeta` is used nowhere, which is a warning.
WARNED = PENDULUM.replace("g: 9.8}", "g: 9.8, zeta: 3}")


def annotations(text):
    """Read workflow commands as the runner does: level, properties, text."""

    def plain(text):
        for code, letter in (("0A", "\n"), ("0D", "\r"), ("3A", ":"), ("2C", ",")):
            text = text.replace(f"%{code}", letter)
        return text.replace("%25", "%")

    found = []
    for line in text.splitlines():
        if match := re.fullmatch(r"::(\w+)(?: ([^:]*))?::(.*)", line):
            level, properties, told = match.groups()
            pairs = (p.split("=", 1) for p in (properties or "").split(",") if p)
            found.append((level, {k: plain(v) for k, v in pairs}, plain(told)))
    return found


@pytest.mark.slow
def test_strict_runs(lagsim, write):
    file = write(WARNED)
    assert lagsim("run", file, "--no-plots").code == 0
    for more in ([], ["-q"], ["--json"]):
        called = lagsim(
            "run", file, "--no-plots", "--strict", "-o", "strict", *more, code=1
        )
        assert "1 warning (unused-parameter), and --strict" in called.err
        # What was computed stays, and says so.
        assert names("strict") == ["run.json", "trajectory.csv"]
        assert manifest("strict")["complete"]
    assert lagsim("run", write(PENDULUM), "--no-plots", "--strict").code == 0


def test_strict_checks(lagsim, write):
    files = write(PENDULUM, "good.yaml"), write(WARNED, "warned.yaml")
    assert lagsim("check", *files).code == 0
    called = lagsim("check", "-q", "--strict", *files, code=1)
    assert called.out.startswith("admissible: warned")
    assert called.err.count("--strict") == 1
    assert lagsim("check", "--strict", files[0]).code == 0
    called = lagsim("check", "--strict", "--json", *files, code=1)
    assert [len(found["warnings"]) for found in called.json] == [0, 1]


@pytest.mark.slow
def test_another_result_is_not_replaced_without_a_word(lagsim, write):
    file = write(PENDULUM, "pendulum.yaml")
    quiet = ["run", file, "--no-plots"]
    assert lagsim(*quiet).err == ""
    assert lagsim(*quiet).err == ""  # the same again
    called = lagsim(*quiet, "--set", "l=2", code=0)
    assert called.reports("W402", "l = 1.0")
    warnings = manifest("results/pendulum")["warnings"]
    assert [w["code"] for w in warnings] == ["result-replaced"]
    assert lagsim(*quiet, "-q").err == ""
    called = lagsim(*quiet, "--step", "0.1", "--method", "rk4", code=0)
    assert called.reports("W402", "method taylor", "rtol 1e-11")
    # Where the folder is named, it is meant.
    for length in ("1", "2"):
        assert lagsim(*quiet, "--set", f"l={length}", "-o", "here").err == ""
    Path("results/pendulum/run.json").write_text("[1]")
    assert lagsim(*quiet, "--set", "l=3").err == ""


@pytest.mark.usefixtures("actions")
def test_annotations_of_faults(lagsim, write):
    write(PENDULUM.replace("theta: 1}", "theta: 1*unknown}"), "a,b:c.yaml")
    called = lagsim("check", "a,b:c.yaml", code=2)
    [(level, place, text)] = annotations(called.err)
    assert level == "error"
    column = 1 + "initial: {theta: 1*unknown}".index("unknown")
    assert place == {"file": "a,b:c.yaml", "line": "4", "col": str(column),
                         "title": "E209"}  # fmt: skip
    assert "`unknown`" in text
    assert annotations(lagsim("check", "missing.yaml").err)[0][1] == {
        "title": "E101",
        "file": "missing.yaml",
    }


@pytest.mark.slow
@pytest.mark.usefixtures("actions")
def test_annotations_of_starts_and_warnings(lagsim, write):
    line = 1 + CAPTION.split("constraints:")[0].count("\n")
    for command in ("check", "run"):
        called = lagsim(command, write(CAPTION), code=1)
        [(level, place, text)] = annotations(called.err)
        assert (level, place["file"], place["line"]) == (
            "error", "model.yaml", str(line),
        )  # fmt: skip
        assert "`path`" in text
    [(level, place, text)] = annotations(lagsim("check", write(WARNED)).err)
    assert (level, place) == ("warning", {"file": "model.yaml", "title": "W101"})
    assert "`zeta`" in text
    [(level, _, text)] = annotations(
        lagsim("run", "model.yaml", "--no-plots", "--strict").err
    )
    assert (level, "unused-parameter" in text) == ("error", True)


@pytest.mark.usefixtures("actions")
def test_annotations_name_files_in_the_repository(lagsim, write, monkeypatch, tmp_path):
    (tmp_path / "sub").mkdir()
    write("nonsense: 1\n", "sub/model.yaml")
    monkeypatch.chdir(tmp_path / "sub")
    [*_, (_, place, _)] = annotations(lagsim("check", "model.yaml").err)
    assert place["file"] == "sub/model.yaml"


def test_no_annotations_anywhere_else(lagsim, write):
    assert annotations(lagsim("check", write(CAPTION)).err) == []


@pytest.fixture
def differing(stored, write):  # noqa: ARG001  it comes before
    """Store a golden and change its model; return the file."""
    return write(PENDULUM.replace("9.8", "9.800001"), "pendulum.yaml")


@pytest.mark.slow
@pytest.mark.usefixtures("actions")
def test_goldens_that_differ(lagsim, write, differing):
    same = write(PENDULUM, "same.yaml")
    assert lagsim("golden", same, "--update").code == 0
    lost = write("coordinates: 3\n", "lost.yaml")
    started = write(CAPTION, "caption.yaml")
    called = lagsim(
        "golden", differing, same, lost, started, "new.yaml",
        "--junit", "reports/golden.xml", "--plots", "pictures",
        code=2,
    )  # fmt: skip
    [suite] = ET.parse("reports/golden.xml").getroot()
    found = {case.get("name"): [child.tag for child in case] for case in suite}
    assert found == {
        "pendulum": ["failure"], "same": [], "lost": ["error"], "caption": ["error"],
        "new": ["error"],
    }  # fmt: skip
    assert all(float(case.get("time")) >= 0.0 for case in suite)
    [failure] = suite[0]
    assert "beyond the bound" in failure.get("message")
    assert "difference  bound" in failure.text
    [error] = suite[2]
    assert error.text.startswith("lost.yaml:1:")
    assert names("pictures") == ["pendulum.png"]
    picture = Path("pictures/pendulum.png").read_bytes()
    assert picture.startswith(b"\x89PNG")
    level, place, text = annotations(called.err)[0]
    assert (level, place.pop("title")) == ("error", "E601")
    assert place == {"file": "pendulum.yaml", "line": "1", "col": "20"}
    assert text.startswith("pendulum differs from its golden: ")


@pytest.mark.slow
def test_a_picture_where_only_an_invariant_differs(lagsim, stored):
    path = Path("golden/pendulum.json")
    text = re.sub(r'("value": ?)-5\.\d+', r"\g<1>-5.4", path.read_text())
    assert text != path.read_text()
    path.write_text(text)
    called = lagsim("golden", stored, "--plots", "p", "--json", code=1)
    [found] = called.json["models"]
    assert [d["column"] for d in found["worst"] if not d["pass"]] == [
        "energy (constant)"
    ]
    assert found["picture"] == str(Path("p/pendulum.png"))
    assert Path(found["picture"]).read_bytes().startswith(b"\x89PNG")


@pytest.mark.slow
def test_reports_that_cannot_be_written(lagsim, differing):
    Path("taken").write_text("a file")
    for option in ("--junit", "--plots"):
        called = lagsim("golden", differing, option, "taken/x.xml", code=3)
        assert "taken" in called.err
        assert called.reports("E705")


@pytest.mark.slow
def test_two_models_of_one_name_share_no_golden(lagsim, write, tmp_path):
    named = "name: one\n" + PENDULUM
    files = [write(named, "a.yaml"), write(named + "x-other: 1\n", "b.yaml")]
    for more in ([], ["--update"], ["--json"]):
        called = lagsim("golden", *files, *more, code=2)
        told = called.json["errors"][0]["text"] if more == ["--json"] else called.err
        assert "a.yaml" in told
        assert "b.yaml" in told
        assert "`one`" in told
    assert not (tmp_path / "golden").exists()
    # The same file twice is no other model; nor does one folder know of another.
    assert lagsim("golden", "a.yaml", "./a.yaml", "--update").code == 0
    (tmp_path / "other").mkdir()
    write(named, "other/b.yaml")
    assert lagsim("golden", "a.yaml", "other/b.yaml", "--update").code == 0
    assert lagsim("golden", "a.yaml", "other/b.yaml", "--dir", "all").code == 2


@pytest.mark.slow
def test_strictness_of_several(lagsim, write):
    files = write(PENDULUM, "good.yaml"), write(WARNED, "warned.yaml")
    options = ["--no-plots", "-j", "1"]
    assert lagsim("run", *files, *options).code == 0
    called = lagsim("run", *files, *options, "--strict", code=1)
    assert called.err.count("--strict") == 1
    assert names("results/warned") == ["run.json", "trajectory.csv"]
    called = lagsim("run", *files, *options, "--set", "l=2")
    assert called.err.count("this replaces the result with l = 1.0") == 2
