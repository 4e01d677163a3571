"""`lagsim compare`: verdicts, exit codes, reports."""

import json
from pathlib import Path

import numpy as np
import pytest

from tests.cli._results import manifest
from tests.small_scenes import ON_THE_CURVE

HEAD = "t,x,x_dot,x_ddot,kinetic,energy"
ROWS = [
    [0.0, 1.0, 0.0, -1.0, 0.0, 0.5],
    [0.1, 0.995, -0.1, -0.995, 0.005, 0.5],
    [0.2, 0.98, -0.2, -0.98, 0.02, 0.5],
]


def csv(rows, head=HEAD, end="\r\n"):
    return end.join([head, *(",".join(map(repr, row)) for row in rows), ""])


@pytest.fixture
def pair(tmp_path, lagsim):
    """Return a function that compares two texts."""

    def pair(golden, new, *options):
        (tmp_path / "golden.csv").write_bytes(golden.encode())
        (tmp_path / "new.csv").write_bytes(new.encode())
        return lagsim("compare", "golden.csv", "new.csv", *options)

    return pair


def changed(row, column, value):
    rows = [list(r) for r in ROWS]
    rows[row][column] = value
    return csv(rows)


def test_a_table_is_itself(pair):
    called = pair(csv(ROWS), csv(ROWS, end="\n"))
    assert (called.code, called.err) == (0, "")
    assert called.out.startswith("same: golden.csv and new.csv, 3 rows, 6 columns")
    assert pair(csv(ROWS), csv(ROWS), "--rtol", "0", "--atol", "0").code == 0


def test_one_unit_in_the_last_place_is_forgiven_and_two_are_not(pair):
    one = float(np.nextafter(0.995, 1))
    two = float(np.nextafter(one, 1))
    assert pair(csv(ROWS), changed(1, 1, one)).code == 0
    assert pair(csv(ROWS), changed(1, 1, two)).code == 1
    assert pair(csv(ROWS), changed(1, 1, one), "--rtol", "0", "--atol", "0").code == 1
    assert pair(csv(ROWS), changed(0, 4, -0.0)).code == 0
    zeros = ("--rtol", "0", "--atol", "0")
    assert pair(csv(ROWS), changed(0, 4, -0.0), *zeros).code == 1


def test_tolerances_are_parts_of_a_scale(pair):
    # x ranges over 0.02, the kinetic energy over 0.02 and the constant energy over 0.
    for column, value in ((1, 0.995), (5, 0.5)):
        within, beyond = value + 0.9e-4 * 0.02, value + 1.1e-4 * 0.02
        assert pair(csv(ROWS), changed(1, column, within), "--rtol", "1e-4").code == 0
        assert pair(csv(ROWS), changed(1, column, beyond), "--rtol", "1e-4").code == 1
        both = ("--rtol", "1e-4", "--atol", "1e-6")
        assert pair(csv(ROWS), changed(1, column, beyond), *both).code == 0


def test_the_report_has_the_worst_first(pair):
    rows = [list(r) for r in ROWS]
    rows[1][2] += 1e-6
    rows[2][1] += 1e-3
    called = pair(csv(ROWS), csv(rows), "--rtol", "1e-9", "--json")
    assert called.code == 1
    document = called.json
    assert document["pass"] is False
    worst = document["worst"][0]
    assert worst["column"] == "x"
    assert (worst["t"], worst["golden"], worst["new"]) == (0.2, 0.98, rows[2][1])
    assert worst["difference"] == pytest.approx(1e-3)
    assert worst["tolerance"] == pytest.approx(1e-9 * 0.02)
    assert document["first"] == {"column": "x_dot", "t": 0.1}
    text = pair(csv(ROWS), csv(rows), "--rtol", "1e-9").out.splitlines()
    assert text[0].startswith("differ: ")
    assert "x_dot, t = 0.1" in text[1]
    assert text[3].split()[:3] == ["x", "0.2", "0.98"]


@pytest.mark.parametrize("value", ["nan", "inf"])
def test_nan_never_passes(pair, value):
    rows = csv(ROWS).replace("0.995,", f"{value},", 1)
    called = pair(csv(ROWS), rows, "--rtol", "1e9", "--atol", "1e9")
    assert called.code == 1
    again = pair(rows, rows, "--rtol", "1", "--atol", "1")
    assert again.code == (1 if value == "nan" else 0)
    assert again.err == ""


def test_columns_in_any_order_missing_and_extra(pair):
    order = [0, 3, 1, 2, 5, 4]
    names = HEAD.split(",")
    other = csv(
        [[r[k] for k in order] for r in ROWS], ",".join(names[k] for k in order)
    )
    assert pair(csv(ROWS), other).code == 0
    fewer = csv([r[:5] for r in ROWS], HEAD.rsplit(",", 1)[0])
    called = pair(csv(ROWS), fewer)
    assert called.code == 1
    assert "missing: energy" in called.out
    called = pair(fewer, csv(ROWS))
    assert called.code == 0
    assert "extra: energy" in called.out


def test_other_times_differ(pair):
    for golden, new, what in (
        (ROWS, ROWS[:2], "only golden has 1 row, the first at t = 0.2"),
        (ROWS[:2], ROWS, "only new has 1 row, the first at t = 0.2"),
    ):
        called = pair(csv(golden), csv(new), "--rtol", "1")
        assert called.code == 1
        assert what in called.out


def test_an_impacts_rows_are_before_and_after(pair):
    head = "t,y"
    golden = [[0.0, 1.0], [0.1, 0.5], [0.15, 0.0], [0.15, 7.0], [0.2, 8.0]]
    # Located a little later: the rows still belong together.
    late = 0.15 + 1e-12
    new = [[0.0, 1.0], [0.1, 0.5], [late, 0.0], [late, 7.0], [0.2, 8.0]]
    assert pair(csv(golden, head), csv(new, head), "--rtol", "1e-9").code == 0
    new[2], new[3] = new[3], new[2]
    assert pair(csv(golden, head), csv(new, head), "--rtol", "1e-9").code == 1


@pytest.mark.slow
@pytest.mark.drawn
def test_two_folders_and_a_picture(lagsim, write):
    file = write(ON_THE_CURVE)
    for folder, rtol in (("a", "1e-11"), ("b", "1e-6")):
        lagsim("run", file, "-o", folder, "--rtol", rtol, "--no-plots", "-q", code=0)
    assert lagsim("compare", "a", "b").code == 1
    assert lagsim("compare", "a", "b/trajectory.csv", "--rtol", "1e-3").code == 0
    lagsim(
        "compare", "a", "b", "--rtol", "1e-9", "--plot", "c.png", "-q", code=1, out=""
    )
    assert Path("c.png").read_bytes().startswith(b"\x89PNG")
    # Of what should be zero the noise is compared with the largest coordinate.
    [residual] = [
        d
        for d in lagsim("compare", "a", "b", "--rtol", "1e-9", "--json").json["worst"]
        if d["column"] == "residual_path"
    ]
    assert residual["tolerance"] == pytest.approx(1e-9, rel=0.2)
    lost = manifest("b") | {"complete": False, "reason": "the power went"}
    Path("b/run.json").write_text(json.dumps(lost))
    called = lagsim("compare", "a", "b", "--rtol", "1e-3")
    assert "b is incomplete: the power went" in called.out
    called = lagsim("compare", "a", "b", "--plot", "no/such/folder.png", code=3)
    assert called.reports("E705", "no/such")
