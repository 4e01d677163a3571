"""Tables are read exactly; a message names the first cell that is not a number."""

import subprocess
import sys

import numpy as np
import pytest

from lagsim.errors import InputError
from lagsim.studies.tables import read_table
from tests.support import refused

# Values whose texts have every form: signs, exponents, no point, no digits before it.
FORMS = (
    "0 -0 -0.0 -0e5 1 -1.5 1e5 -1.5e-7 2.5e+300 .5 5. 123456789.123456789 4.9e-324 "
    "1e-400"
)


def bits(values):
    return np.asarray(values, dtype=float).view(np.int64).tolist()


def table_of(folder, text):
    path = folder / "t.csv"
    path.write_bytes(text.encode())
    return read_table(path)


def fault(folder, text):
    with pytest.raises(InputError) as raised:
        table_of(folder, text)
    return raised.value.problems[0].text.partition("t.csv: ")[2]


def test_numbers_are_read_to_the_bit(tmp_path):
    random = np.random.default_rng(1)
    numbers = random.standard_normal(4000) * 10.0 ** random.integers(-300, 300, 4000)
    texts = [*FORMS.split(), *(repr(float(x)) for x in numbers)]
    lines = [f"{k},{text}\r\n" for k, text in enumerate(texts)]
    found = table_of(tmp_path, "t,a\n" + "".join(lines))
    assert bits(found["a"]) == bits([float(text) for text in texts])
    for text in FORMS.split():
        for k, end in enumerate(("\n", "\r\n", "")):  # each alone in its file
            folder = tmp_path / f"{text}{k}"
            folder.mkdir()
            for row in (f"1,{text}", f"{text},1"):
                found = table_of(folder, f"t,a\n{row}{end}")
                assert bits(found.data) == bits([[float(x)] for x in row.split(",")])


@pytest.mark.parametrize(
    "cell",
    [
        "1.2.3", "1-2", "1e", "e5", "1e5e5", "--1", "1e-5.2", "1e-5e3", "abc", "#1",
        "0x1", "1_0", "'1'", "1 2", "1j", "null", "true", "[1]",
    ],
)  # fmt: skip
def test_what_is_no_number_is_named(tmp_path, cell):
    for column, row in (("a", f"1,{cell}"), ("t", f"{cell},1")):
        told = fault(tmp_path, f"t,a\n1,1\r\n{row}\n2,2\n")
        assert told == f"line 3: {column} is `{cell}`, and not a number"


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("1,2,1\n2\n", "line 2 has 3 cells, and the header 2 columns"),
        ("1,2\n1,2,1\n2\n", "line 3 has 3 cells, and the header 2 columns"),
        ("1,2\n \n1,2", "line 3 has 1 cell, and the header 2 columns"),
        ("\n\n", "there are no rows after the header"),
    ],
)
def test_what_is_no_row_is_named(tmp_path, text, why):
    assert fault(tmp_path, "t,a\n" + text) == why


def test_the_last_line_needs_no_break(tmp_path):
    for end in ("\r\n", "\n"):
        found = table_of(tmp_path, end.join(["t,a,b", "0,1,2", "3,4,5"]))
        assert found.columns == ("t", "a", "b")
        assert found.data.tolist() == [[0, 3], [1, 4], [2, 5]]


def test_quotes_spaces_and_a_byte_order_mark(tmp_path):
    path = tmp_path / "t.csv"
    path.write_bytes(b'\xef\xbb\xbf"t","a"\r\n0,"1.5"\r\n1, 2\r\n2,+1\r\n\r\n')
    table = read_table(path)
    assert table.columns == ("t", "a")
    assert table["a"].tolist() == [1.5, 2.0, 1.0]


def test_a_line_of_units_is_no_row(tmp_path):
    found = table_of(tmp_path, 't,a,"b"\r\ns,m/s^2,\r\n0,1,2\r\n1,2,3\r\n')
    assert found.units == {"t": "s", "a": "m/s^2", "b": ""}
    assert found.data.tolist() == [[0, 1], [1, 2], [2, 3]]
    # Where anything in it is a number, or time has no unit, it is a row with a fault.
    assert fault(tmp_path, "t,a\ns,1\n1,1\n") == "line 2: t is `s`, and not a number"
    assert fault(tmp_path, "t,a\n,m\n1,1\n").startswith("line 2: t is empty")
    assert fault(tmp_path, "t,a\ns,m\n1,x\n") == "line 3: a is `x`, and not a number"
    assert fault(tmp_path, "t,a\ns,m\n") == "there are no rows after the header"


def packed(path, **arrays):
    np.savez(path, **arrays)
    return path


def test_archives_of_others_are_read(tmp_path):
    path = packed(tmp_path / "a.npz", a=np.arange(3), t=np.array([0, 0.5, 1], "f4"))
    found = read_table(path)
    assert found.columns == ("a", "t")
    assert found.data.tolist() == [[0, 1, 2], [0, 0.5, 1]]
    assert found.data.dtype == np.float64


@pytest.mark.parametrize(
    ("arrays", "column"),
    [
        ({"a": np.ones(3)}, "`t`"),
        ({"t": np.ones(3), "a": np.ones(2)}, " a "),
        ({"t": np.ones(3), "a": np.array(["x"] * 3)}, " a "),
        ({"t": np.ones((2, 2))}, " t "),
        ({"t": np.ones(0)}, ""),
        ({"t": np.ones(1), "a": np.array([None])}, ""),
    ],
)
def test_archives_that_are_no_tables(tmp_path, arrays, column):
    with refused("bad-table", "a.npz:", column):
        read_table(packed(tmp_path / "a.npz", **arrays))


def test_what_is_not_what_its_name_says(tmp_path):
    for name in ("a.npz", "a.parquet"):
        if name == "a.parquet":
            pytest.importorskip("pyarrow", reason="needs pyarrow")
        for content in (b"", b"t,a\n0,1\n", b"PK\x03\x04 and no more", b"PAR1"):
            (tmp_path / name).write_bytes(content)
            with refused("bad-table", f"{name}:"):
                read_table(tmp_path / name)
    np.save(tmp_path / "one.npy", np.ones(3))
    (tmp_path / "one.npy").rename(tmp_path / "one.npz")
    with refused("bad-table", "one.npz:"):
        read_table(tmp_path / "one.npz")


COMPARE = """
import sys
from pathlib import Path
from lagsim.cli import main
sys.argv = ["lagsim", "compare", *sys.argv[1:], "--rtol", "1e-9", "-q"]
code = main()
# Of this program alone: ru_maxrss begins with what the parent had.
status = Path("/proc/self/status").read_text()
print(code, status.split("VmHWM:")[1].split()[0])
"""


@pytest.mark.nightly
@pytest.mark.skipif(sys.platform != "linux", reason="looks into /proc")
def test_a_million_rows_fit_into_memory(tmp_path):
    from lagsim.outputs.table import TableWriter

    for name, factor in (("a.csv", 1.0), ("b.csv", 1.0 + 1e-12)):
        random = np.random.default_rng(1)
        names = ["t", *(f"c{k}" for k in range(14))]
        writer = TableWriter(tmp_path / name, names)
        for k in range(500):
            rows = random.standard_normal((2000, 15)) * factor
            rows[:, 0] = np.arange(2000 * k, 2000 * (k + 1))
            writer.add(rows)
        writer.close()
    files = [tmp_path / "a.csv", tmp_path / "b.csv"]
    command = [sys.executable, "-c", COMPARE, *files]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    code, kilobytes = map(int, done.stdout.split())
    assert code == 0
    assert kilobytes < 500_000
