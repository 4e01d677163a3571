"""Reading tables: the fast way gives the same bits as the slow one, or gives way."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

from lagsim.studies.comparison import reading
from lagsim.studies.comparison.reading import read_table

# Values whose texts have every form: signs, exponents, no point, no digits before it.
FORMS = (
    "0 -0 -0.0 -0e5 1 -1.5 1e5 -1.5e-7 2.5e+300 .5 5. 123456789.123456789 4.9e-324 "
    "1e-400"
)


def bits(values):
    return np.asarray(values, dtype=float).view(np.int64).tolist()


def test_plain_blocks_are_read_to_the_bit():
    random = np.random.default_rng(1)
    numbers = random.standard_normal(4000) * 10.0 ** random.integers(-300, 300, 4000)
    texts = [*FORMS.split(), *(repr(float(x)) for x in numbers)]
    lines = [f"{k},{text}\r\n" for k, text in enumerate(texts)]
    found = reading._plain("".join(lines).encode(), 2)
    assert found is not None
    assert bits(found[1]) == bits([float(text) for text in texts])


@pytest.mark.parametrize(
    "cell",
    [
        "1.2.3",
        "1-2",
        "1e",
        "e5",
        "1e5e5",
        "--1",
        "1e-5.2",
        "1e-5e3",
        "abc",
        "nan",
        "inf",
        "0x1",
        "1_0",
        "+1",
        "'1'",
        "1 2",
        "",
    ],
)
def test_what_is_not_plain_is_read_with_care(cell):
    for text in (f"1,{cell}\n", f"1,1\n{cell},1\r\n"):
        assert reading._plain(text.encode(), 2) is None


def test_rows_of_other_lengths_are_not_plain():
    for text in (b"1\n1,2\n", b"1,2,3\n", b"1,2\n\n", b"1,2,1\n2\n", b"1, 2\n", b"1,2"):
        assert reading._plain(text, 2) is None


def test_blocks_that_end_anywhere(tmp_path, monkeypatch):
    rows = np.random.default_rng(2).standard_normal((200, 3))
    path = tmp_path / "t.csv"
    lines = ["t,a,b", *(",".join(map(repr, row)) for row in rows.tolist())]
    for text in ("\r\n".join(lines) + "\r\n", "\n".join(lines)):
        path.write_bytes(text.encode())
        for block in (61, 500, 10**6):
            for large in (0, 10**9):
                monkeypatch.setattr(reading, "BLOCK", block)
                monkeypatch.setattr(reading, "LARGE", large)
                table = read_table(path)
                assert table.columns == ("t", "a", "b")
                assert bits(table.data.T.ravel()) == bits(rows.ravel())


def test_quotes_spaces_and_a_byte_order_mark(tmp_path):
    path = tmp_path / "t.csv"
    path.write_bytes(b'\xef\xbb\xbf"t","a"\r\n0,"1.5"\r\n1, 2\r\n\r\n')
    table = read_table(path)
    assert table.columns == ("t", "a")
    assert table["a"].tolist() == [1.5, 2.0]


COMPARE = """
import resource, sys
from lagsim.cli import main
sys.argv = ["lagsim", "compare", *sys.argv[1:], "--rtol", "1e-9", "-q"]
code = main()
print(code, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
"""


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="ru_maxrss is in other units")
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
