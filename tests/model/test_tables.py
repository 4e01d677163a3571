"""Files of tables: read below the model's folder alone, each fault with its row."""

import hashlib

import numpy as np
import pytest

from lagsim import limits, load, simulate
from lagsim.errors import InputError
from lagsim.language.evaluate import evaluate
from tests.support import refused

MODEL = """
coordinates: {x: {}}
tables: {f: {file: FILE, x: a, y: b}}
energy: {kinetic: x_dot^2/2, potential: 0}
forces: {x: f(t)}
initial: {x: 0}
simulation: {duration: 1}
"""
GOOD = "a,b\n0,1\n2,5\n"


def faults(path, content=GOOD, name="curve.csv"):
    """Faults of a model whose table has this file, beside it if it has a content."""
    if content is not None:
        (path / "curve.csv").write_bytes(content.encode("latin-1"))
    (path / "model.yaml").write_text(MODEL.replace("FILE", name))
    try:
        load(path / "model.yaml")
    except InputError as error:
        return error.problems
    return ()


@pytest.mark.parametrize(
    ("content", "code", "text", "place"),
    [
        ("a,b\n0,1\n2,x5\n", "table-points", "`x5`", (3, 3, 2)),
        ("a,b\n0,1\n2,\n", "table-points", "``", (3, 3, 1)),
        ("a,b\n0,1\n\n2\n", "table-points", "", (4, 2, 1)),
        ("a,b\n0,nan\n2,3\n", "table-points", "`nan`", (2, 3, 3)),
        ("a,b\n0,inf\n2,3\n", "table-points", "`inf`", (2, 3, 3)),
        ("a,b\n0,1_0\n2,3\n", "table-points", "`1_0`", (2, 3, 3)),
        ("a,b\n0,1\n2,3\n2,4\n", "table-points", "2", (4, 1, 1)),
        ('a,"c,d",b\n0,1,2\n1,"x,y",nan\n', "table-points", "`nan`", (3, 7, 3)),
        ("a,b\n0,0,1,5\n1,2\n", "table-points", "`;`", (2, 1, 1)),
        ("a;b\n0,5;1\n2.5;1\n", "table-points", "`0,5`", (2, 1, 3)),
        ("a;b\n0;1\n2;3;4\n", "table-points", "3", (3, 1, 1)),
        ("# x\na;b\n\n0;1\n# y\n2;z\n", "table-points", "`z`", (6, 3, 1)),
        ("a,b\n0,1\n", "table-points", "1", None),
        ("", "table-file", "`a`", None),
        ("a,c\n0,1\n", "table-file", "`b`", None),
        ("a,b,b\n0,1,2\n", "table-file", "`b`", None),
        ("a,b\n0,\xff\n", "table-file", "UTF-8", None),
    ],
)
def test_a_fault_of_the_file_has_its_row(tmp_path, content, code, text, place):
    found = faults(tmp_path, content)
    assert found[0].code == code
    assert text in found[0].text
    if place is not None:
        assert found[0].file == str(tmp_path / "curve.csv")
        assert tuple(found[0].place)[1:4] == place
        assert found[0].place.source == content.splitlines()[place[0] - 1]
    assert len(found) == 1 + (content == "")
    if code == "table-file" and "UTF" not in text:
        names = content.partition("\n")[0].replace(",", "`, `")
        assert found[0].hint.endswith(names + "`" if names else "has no columns")


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("../curve.csv", "does not lead into"),
        ("/etc/passwd", "does not lead into"),
        ("sub/../curve.csv", "does not lead into"),
        ("''", "does not lead into"),
        ("missing.csv", "No such file"),
        (".", "cannot be read"),
        ("out.csv", "link leads out"),
        ("away/x.csv", "link leads out"),
        ("pipe", "no regular file"),
    ],
)
def test_what_is_not_below_the_model_is_not_read(tmp_path, name, text):
    inner, outer = tmp_path / "model", tmp_path / "other"
    inner.mkdir()
    outer.mkdir()
    (outer / "x.csv").write_text(GOOD)
    (inner / "out.csv").symlink_to(outer / "x.csv")
    (inner / "away").symlink_to(outer)
    __import__("os").mkfifo(inner / "pipe")
    (found,) = faults(inner, None, name)
    assert found.code == "table-file"
    assert text in found.text
    assert found.line == 3


@pytest.mark.slow
@pytest.mark.parametrize(
    "content",
    [
        "a;b\n0;1\n2;5\n",
        "a\tb\n0\t1\n2\t5\n",
        "a;b\n0,0;1,0\n2,0;+5,0e0\n",
        "# measured\na,b\n\n0,1\n  # a break\n2,5\n",
        "a;b;note, of the rig\n0;1;x, y\n2;5;z, u\n",
        "\ufeffa , b\r\n0 , 1\r\n2 , 5\r\n",
        "a,b,\n0,1,\n2,5,\n",
    ],
)
def test_a_file_of_a_spreadsheet_is_read(tmp_path, content):
    (tmp_path / "curve.csv").write_text(content, newline="", encoding="utf-8")
    (tmp_path / "model.yaml").write_text(MODEL.replace("FILE", "curve.csv"))
    found = simulate(tmp_path / "model.yaml", error_bar="never")
    assert found["x_ddot"] == pytest.approx(1 + 2 * found["t"], abs=1e-12)


def test_a_text_has_no_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "curve.csv").write_text(GOOD)
    with refused("table-file", "`curve.csv`"):
        load(MODEL.replace("FILE", "curve.csv"))


def test_a_file_may_be_below_with_other_columns_and_blank_lines(tmp_path):
    (tmp_path / "data").mkdir()
    content = "\ufeffc, a ,b\r\n9,0, 1\r\n\r\n9,2,5.0e0\r\n"
    (tmp_path / "data/curve.csv").write_bytes(content.encode())
    assert not faults(tmp_path, None, "data/curve.csv")
    found = simulate(load(tmp_path / "model.yaml"), error_bar="never")
    assert found["x_ddot"] == pytest.approx(1.0 + 2.0 * found.t, abs=1e-14)
    digest = hashlib.sha256(content.encode()).hexdigest()
    expected = {"f": {"file": "data/curve.csv", "sha256": digest}}
    assert found.record["model"]["tables"] == expected


def test_expressions_of_numbers_are_points():
    text = MODEL.replace("file: FILE, x: a, y: b", "points: [[0, -pi/2], [2*pi, 1e1]]")
    model = load(text)
    (force,) = model.forces
    at = (0.0, 2.0 * np.pi)
    found = [evaluate(model.graph, [force.node], {"t": t})[0] for t in at]
    assert found == [-np.pi / 2.0, 10.0]


def test_a_table_of_too_many_points_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(limits, "TABLE_NUMBERS", 3)
    (found,) = faults(tmp_path)
    assert found.code == "too-large"
    assert all(number in found.text for number in "43")
