"""Tables: equal bits are read back, in bounded memory, without partial rows."""

import csv
import errno
import io
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from lagsim.outputs import TableFormat
from lagsim.outputs import table as module
from lagsim.outputs.table import TableWriter, guarded, table_of, table_writer, unguarded
from lagsim.studies.tables import read_table

AWKWARD = [
    0.0, -0.0, 0.1, 1 / 3, 1e-5, 1e-7, 123456789012345680.0, 1e16, 1e22, 1e300,
    5e-324, 2.2250738585072014e-308, 1.7976931348623157e308, -9.007199254740993e15,
    4.35, 0.3 - 0.1, np.nextafter(1.0, 2.0),
]  # fmt: skip


def written(path, blocks, columns):
    writer = TableWriter(path, columns)
    for block in blocks:
        writer.add(np.array(block))
    writer.close()
    return writer, path.read_bytes()


def read(content):
    header, *rows = csv.reader(io.StringIO(content.decode(), newline=""))
    return header, np.array(rows, dtype=float).reshape(-1, len(header))


def bits(values):
    return np.asarray(values, dtype=float).view(np.int64).tolist()


@given(st.lists(st.floats(allow_nan=False), min_size=1, max_size=30))
@example(AWKWARD)
def test_any_bits_come_back(tmp_path_factory, values):
    path = tmp_path_factory.mktemp("t") / "t.csv"
    _, content = written(path, [[[x, -x] for x in values]], ["a", "b"])
    header, rows = read(content)
    assert header == ["a", "b"]
    assert bits(rows) == bits([[x, -x] for x in values])
    assert content.count(b"\r\n") == content.count(b"\n") == len(values) + 1


def test_the_shortest_text_cut_to_the_header_and_counted(tmp_path):
    blocks = [[[0.1, 1.0, 2.5e-9, 3.0]], np.empty((0, 4)), np.arange(8.0).reshape(2, 4)]
    writer, content = written(tmp_path / "t.csv", blocks, ["t", "θ", "c"])
    lines = ["t,θ,c", "0.1,1.0,2.5e-9", "0.0,1.0,2.0", "4.0,5.0,6.0", ""]
    assert content == "\r\n".join(lines).encode()
    assert (writer.rows, writer.last) == (3, 4.0)
    writer, content = written(tmp_path / "t.csv", [], ["t"])
    assert (content, writer.rows, writer.last) == (b"t\r\n", 0, None)


def test_what_is_not_finite_reads_back(tmp_path):
    block = [[1.0, np.nan], [np.inf, -np.inf], [2.0, 3.0]]
    _, content = written(tmp_path / "t.csv", [block], ["a", "b"])
    np.testing.assert_array_equal(read(content)[1], block)
    assert content.count(b"\r\n") == 4


class Full:
    """A file on a disk with `room` bytes left."""

    def __init__(self, file, room):
        self.file, self.room = file, room

    def write(self, content):
        if not self.room:
            raise OSError(errno.ENOSPC, "No space left on device")
        part = bytes(content[: self.room])
        self.room -= len(part)
        return self.file.write(part)

    def __getattr__(self, name):
        return getattr(self.file, name)


@pytest.mark.parametrize("room", range(26))
def test_a_full_disk_leaves_whole_rows(tmp_path, room):
    path = tmp_path / "t.csv"
    writer = TableWriter(path, ["t", "x"])
    writer.add(np.array([[0.0, 1.0]]))
    writer._file = Full(writer._file, room)
    block = np.array([[1.0, 2.0], [2.0, 3.0], [3.0, 4.0]])
    with pytest.raises(OSError, match="No space left"):
        writer.add(block)
    writer.close()
    line = len(b"1.0,2.0\r\n")
    whole = room // line
    content = path.read_bytes()
    assert content.endswith(b"\r\n")
    assert read(content)[1].tolist() == [[0.0, 1.0], *block[:whole].tolist()]
    assert (writer.rows, writer.last) == (1 + whole, float(whole))


PEAK = """
import sys
import numpy as np
from pathlib import Path
from lagsim.outputs import TableFormat
from lagsim.outputs.table import table_writer
blocks, path = int(sys.argv[1]), Path(sys.argv[2])
names = dict.fromkeys([f"c{k}" for k in range(15)], "")
form = TableFormat(path.suffix[1:])
writer = table_writer(form, path, names, show_units=False)
block = np.random.default_rng(1).standard_normal((2000, 15))
for _ in range(blocks):
    writer.add(block)
writer.finish()
writer.close()
# Of this program alone: ru_maxrss begins with what the parent had.
print(Path("/proc/self/status").read_text().split("VmHWM:")[1].split()[0])
"""


@pytest.mark.skipif(sys.platform != "linux", reason="looks into /proc")
@pytest.mark.slow
@pytest.mark.parametrize("name", ["t.csv", "t.npz"])
def test_memory_does_not_grow_with_the_rows(tmp_path, name):
    peaks = []
    for blocks in (5, 500):  # 10^4 and 10^6 rows
        command = [sys.executable, "-c", PEAK, str(blocks), str(tmp_path / name)]
        done = subprocess.run(command, capture_output=True, text=True, check=True)
        peaks.append(int(done.stdout) * 1024)
    assert peaks[1] - peaks[0] < 50e6
    if name == "t.csv":
        with (tmp_path / name).open("rb") as file:
            assert sum(1 for _ in file) == 1_000_001


FORMULAS = [
    "=1+1", "+x", "-", "-x/2", "@SUM(A1)", "\t=1", " =1", "\uff1dx", "=f('a')",
    "\n+1+1", "'=x", "''@y",
]  # fmt: skip


@pytest.mark.parametrize("text", FORMULAS)
def test_a_spreadsheet_takes_texts_for_texts(text):
    content = table_of(["name", text], [[text, -1.5], [-2, "-1e-3"]])
    (_, head), (cell, negative), (whole, number) = csv.reader(
        io.StringIO(content.decode(), newline="")
    )
    assert head == cell == "'" + text
    assert unguarded(cell) == text
    assert [negative, whole, number] == ["-1.5", "-2", "-1e-3"]  # numbers stay numbers


@given(st.text(st.sampled_from([*"=+-@' \t1e.ax"])))
def test_what_is_guarded_comes_back(text):
    cell = guarded(text)
    assert unguarded(cell) == text
    assert not cell.lstrip().startswith(("=", "+", "-", "@")) or float(cell) is not None


def test_units_that_are_formulas_are_read_back(tmp_path):
    path, units = tmp_path / "t.csv", ["s", *FORMULAS[:5]]
    columns = ["t", *"abcde"]
    writer = TableWriter(path, columns, units)
    writer.add(np.arange(12.0).reshape(2, 6))
    writer.close()
    assert b"\r\ns,'=1+1,'+x,'-,'-x/2,'@SUM(A1)\r\n" in path.read_bytes()
    assert list(read_table(path).units.values()) == units


# --- NumPy's and Parquet's formats: to the bit, in blocks

UNITS = {"t": "s", "theta": "rad", "reaction.x": "", "u": "m"}
ROWS = np.random.default_rng(3).standard_normal((100, 6))
ROWS[5, 1:4] = np.nan, -0.0, 5e-324


def packed_rows(path, form, *, again=False):
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


@pytest.mark.parametrize("form", [TableFormat.NPZ, TableFormat.PARQUET])
def test_columns_come_back_to_the_bit(tmp_path, monkeypatch, form):
    if form is TableFormat.PARQUET:
        pytest.importorskip("pyarrow.parquet", reason="needs pyarrow")
    paths = [tmp_path / f"{k}.{form}" for k in range(3)]
    packed_rows(paths[0], form)
    monkeypatch.setattr(module, "BLOCK", 30)  # seven rows
    packed_rows(paths[1], form)
    packed_rows(paths[2], form, again=True)
    for path in paths:
        found = columns_of(path)
        assert list(found) == list(UNITS)
        for k, values in enumerate(found.values()):
            assert values.tobytes() == ROWS[:, k].tobytes()
    assert paths[1].read_bytes() == paths[2].read_bytes()
    # What it was spooled to is gone.
    assert sorted(tmp_path.iterdir()) == paths


def test_no_rows_are_no_fault(tmp_path):
    writer = table_writer(TableFormat.NPZ, tmp_path / "t.npz", UNITS, show_units=False)
    writer.add(ROWS[:0])
    writer.finish()
    writer.close()
    assert [x.shape for x in columns_of(tmp_path / "t.npz").values()] == [(0,)] * 4


def test_a_full_disk_leaves_whole_rows_to_pack(tmp_path):
    path = tmp_path / "t.npz"
    writer = table_writer(TableFormat.NPZ, path, UNITS, show_units=False)
    writer.add(ROWS[:2])
    writer._file = Full(writer._file, 3 * 8 * len(UNITS) + 17)
    with pytest.raises(OSError, match="No space left"):
        writer.add(ROWS[2:])
    assert (writer.rows, writer.last) == (5, ROWS[4, 0])
    writer.finish()
    writer.close()
    assert np.array_equal(columns_of(path)["u"], ROWS[:5, 3])
