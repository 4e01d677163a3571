"""Tables in NumPy's and Parquet's formats: to the bit, in blocks, and never half."""

from __future__ import annotations

import numpy as np
import pytest

from lagsim.outputs import Format, packed
from lagsim.outputs.packed import table_writer
from tests.outputs.test_table import Full

UNITS = {"t": "s", "theta": "rad", "reaction.x": "", "u": "m"}
ROWS = np.random.default_rng(3).standard_normal((100, 6))
ROWS[5, 1:4] = np.nan, -0.0, 5e-324


def written(path, form, *, again=False):
    writer = table_writer(form, path, UNITS, show_units=False)
    if again:
        writer.add(ROWS[::-1])
        writer.begin_anew()
    for start in range(0, 100, 13):
        writer.add(ROWS[start : start + 13])
    writer.finish()
    writer.close()
    assert (writer.rows, writer.last) == (100, ROWS[-1, 0])
    return path


def columns_of(path):
    if path.suffix == ".npz":
        with np.load(path, allow_pickle=False) as found:
            return {name: found[name] for name in found.files}
    parquet = pytest.importorskip("pyarrow.parquet", reason="needs pyarrow")
    table = parquet.read_table(path)
    assert [f.metadata for f in table.schema] == [
        {b"unit": b"s"}, {b"unit": b"rad"}, None, {b"unit": b"m"},
    ]  # fmt: skip
    return {name: table[name].to_numpy() for name in table.column_names}


@pytest.mark.parametrize("form", [Format.NPZ, Format.PARQUET])
def test_columns_come_back_to_the_bit(tmp_path, monkeypatch, form):
    if form is Format.PARQUET:
        pytest.importorskip("pyarrow.parquet", reason="needs pyarrow")
    paths = [tmp_path / f"{k}.{form}" for k in range(3)]
    written(paths[0], form)
    monkeypatch.setattr(packed, "BLOCK", 30)  # seven rows
    written(paths[1], form)
    written(paths[2], form, again=True)
    for path in paths:
        found = columns_of(path)
        assert list(found) == list(UNITS)
        for k, values in enumerate(found.values()):
            assert values.tobytes() == ROWS[:, k].tobytes()
    assert paths[1].read_bytes() == paths[2].read_bytes()
    # What it was spooled to is gone.
    assert sorted(tmp_path.iterdir()) == paths


def test_no_rows_are_no_fault(tmp_path):
    writer = table_writer(Format.NPZ, tmp_path / "t.npz", UNITS, show_units=False)
    writer.add(ROWS[:0])
    writer.finish()
    writer.close()
    assert [x.shape for x in columns_of(tmp_path / "t.npz").values()] == [(0,)] * 4


def test_a_full_disk_leaves_whole_rows(tmp_path):
    path = tmp_path / "t.npz"
    writer = table_writer(Format.NPZ, path, UNITS, show_units=False)
    writer.add(ROWS[:2])
    writer._file = Full(writer._file, 3 * 8 * len(UNITS) + 17)
    with pytest.raises(OSError, match="No space left"):
        writer.add(ROWS[2:])
    assert (writer.rows, writer.last) == (5, ROWS[4, 0])
    writer.finish()
    writer.close()
    assert np.array_equal(columns_of(path)["u"], ROWS[:5, 3])
