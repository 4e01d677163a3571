"""`run --table` and `--units`: equal numbers in every format."""

import csv
import sys
from pathlib import Path

import numpy as np
import pytest

import lagsim as python
from lagsim.studies.tables import read_results
from tests.cli._results import manifest, names, table
from tests.support import refused

MODEL = """
name: swing
coordinates: {a: {unit: rad}, z: {unit: m}}
definitions: {x: {value: sin(a), unit: "1"}, y: {value: z, unit: "m, up"}}
energy: {kinetic: a_dot^2/2 + z_dot^2, potential: -cos(a)}
initial: {a: 1, z: 0, z_dot: 1}
simulation: {duration: 2, output_step: 0.01}
"""
# For a whole table of which there is no room.
LONG = MODEL.replace("0.01", "1e-4")


def test_all_formats_hold_the_same_numbers(lagsim, write):
    pytest.importorskip("pyarrow", reason="needs pyarrow")
    path = write(MODEL)
    for form in ("csv", "npz", "parquet"):
        options = ("-o", form, "--table", form, "--no-plots")
        assert lagsim("run", path, *options).code == 0
        assert names(form) == sorted(["run.json", f"trajectory.{form}"])
        assert manifest(form)["files"] == [f"trajectory.{form}", "run.json"]
    assert lagsim("run", path, "-o", "units", "--units", "--no-plots").code == 0
    header, rows = table("csv")
    for folder in ("npz", "parquet", "units"):
        found = read_results(Path(folder))
        assert found.columns == tuple(header)
        assert found.data.tobytes() == np.ascontiguousarray(rows.T).tobytes()
        assert found.units["a_dot"] == "rad/s"
        lagsim("compare", "csv", folder, "--rtol", "0", "--atol", "0", code=0)
    with np.load("npz/trajectory.npz") as found:
        assert np.array_equal(found["a_dot"], rows[:, header.index("a_dot")])


def test_a_line_of_units(lagsim, write):
    assert lagsim("run", write(MODEL), "-o", "out", "--units", "--no-plots").code == 0
    with Path("out/trajectory.csv").open(newline="") as file:
        header, line, first = (next(r) for r in [csv.reader(file)] * 3)
    said = dict(zip(header, line, strict=True))
    assert [said[n] for n in ("t", "a", "z_ddot", "y", "x", "energy")] == [
        "s", "rad", "m/s^2", "m, up", "", "",
    ]  # fmt: skip
    assert float(first[0]) == 0.0


def test_what_python_writes_is_the_same(lagsim, write):
    path = write(MODEL)
    result = python.simulate(python.load(path))
    for form, units in (("npz", False), ("csv", True)):
        more = ("--units",) if units else ()
        options = ("-o", "run", "--table", form, "--no-plots", *more)
        assert lagsim("run", path, *options).code == 0
        result.write("python", plots=False, table=form, units=units)
        file = f"trajectory.{form}"
        assert Path("python", file).read_bytes() == Path("run", file).read_bytes()


def test_what_cannot_be_is_refused_before_anything_runs(lagsim, write, monkeypatch):
    path = write(MODEL)
    told = lagsim("run", path, "--table", "npz", "--units", code=2)
    assert told.reports("E801", "npz")
    result = python.simulate(python.load(path), duration=0.1)
    with refused("usage", "npz"):
        result.write("results", table="npz", units=True)
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    monkeypatch.setitem(sys.modules, "pyarrow.parquet", None)
    told = lagsim("run", path, "-o", "out", "--table", "parquet", code=2)
    assert "pip install" in told.err
    assert not Path("out").exists()
    assert not Path("results").exists()


@pytest.mark.skipif(sys.platform == "win32", reason="no resource module")
def test_a_packed_table_that_does_not_fit(lagsim, write):
    import resource

    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (200_000, before[1]))
    try:
        told = lagsim("run", write(LONG), "-o", "out", "--table", "npz", "--no-plots")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert told.code == 3
    assert told.reports("E705")
    assert names("out") == ["run.json"]
    document = manifest("out")
    assert (document["complete"], document["files"]) == (False, ["run.json"])
