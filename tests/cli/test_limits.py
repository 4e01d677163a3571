"""Input that is too large is refused with the limit, on every way into a command."""

import io
import shutil
import sys
import zipfile
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from lagsim import limits
from lagsim.model.model import Settings
from lagsim.outputs import TableFormat
from lagsim.outputs.results import refuse_without_room

MODEL = """
parameters: {k: 2}
coordinates: {x: {}}
energy: {kinetic: x_dot^2/2, potential: k*x^2}
initial: {x: 1}
simulation: {duration: 1}
"""


class Endless(io.RawIOBase):
    """A stream of zeros, as /dev/zero gives."""

    def readable(self):
        return True

    def readinto(self, buffer):
        buffer[:] = bytes(len(buffer))
        return len(buffer)


def refused(done, *words):
    assert done.code == 2
    for word in words:
        assert word in done.err


def sparse(path, size):
    """Create a file of zeros that occupies no disk space."""
    with path.open("wb") as file:
        file.truncate(size)


# Files that are too large, by how much they may have; and where they are given.
SIZES = [
    ("model.yaml", "MODEL_BYTES", "check model.yaml", "more than 16 MiB, which is the"),
    ("a.csv", "TABLE_BYTES", "compare a.csv a.csv", "the limit of 4 GiB"),
    ("a.npz", "TABLE_BYTES", "compare a.npz a.npz", "the limit of 4 GiB"),
    (
        "run.json",
        "DOCUMENT_BYTES",
        "overlay .",
        "it has more than 256 MiB, which",
    ),
]


@pytest.mark.parametrize(("name", "limit", "line", "told"), SIZES)
def test_a_file_has_a_size(lagsim, tmp_path, name, limit, line, told):
    sparse(tmp_path / name, getattr(limits, limit) + 1)
    refused(lagsim(*line.split()), told)


def test_standard_input_has_an_end(lagsim, monkeypatch):
    monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BufferedReader(Endless())))
    refused(lagsim("check", "-"), "<stdin>", "more than 16 MiB, which is the limit")


@pytest.mark.parametrize(
    ("limit", "most", "word"),
    [
        ("NODES", 10, "more than 10 values and collections"),
        ("EXPRESSION_LETTERS", 4, "the expression has 9 letters, more than 4"),
        ("GRAPH_NODES", 5, "have more than 5 operations"),
    ],
)
def test_what_is_in_a_model_file_has_a_size(
    lagsim, write, monkeypatch, limit, most, word
):
    monkeypatch.setattr(limits, "GRAPH_NODES_PER_BYTE", 0)
    monkeypatch.setattr(limits, limit, most)
    refused(lagsim("check", write(MODEL)), word)


def test_the_mass_matrix_has_a_size(lagsim, write, monkeypatch):
    monkeypatch.setattr(limits, "INERTIAS", 8)
    text = MODEL.replace("x: {}", "x: {}, y: {}, z: {}").replace(
        "x_dot^2/2", "(x_dot + y_dot + z_dot)^2"
    ).replace("x: 1", "x: 1, y: 1, z: 1")  # fmt: skip
    refused(lagsim("check", write(text)), "has 9 entries", "the limit is 8")


@pytest.mark.parametrize("name", ["bomb.npz", "bomb.parquet"])
def test_a_packed_table_has_the_size_of_what_is_in_it(
    lagsim, tmp_path, monkeypatch, name
):
    monkeypatch.setattr(limits, "TABLE_BYTES", 100_000)
    if name == "bomb.npz":
        np.savez_compressed(tmp_path / name, t=np.zeros(20_000))
        assert zipfile.is_zipfile(tmp_path / name)
    else:
        pyarrow = pytest.importorskip("pyarrow")
        parquet = pytest.importorskip("pyarrow.parquet")
        parquet.write_table(pyarrow.table({"t": np.zeros(20_000)}), tmp_path / name)
    assert (tmp_path / name).stat().st_size < 10_000
    refused(lagsim("compare", name, name), "the limit of 97.7 KiB")


def test_a_line_of_a_table_has_a_size(lagsim, tmp_path, monkeypatch):
    from lagsim.studies import tables as reading

    monkeypatch.setattr(reading, "BLOCK", 500)
    monkeypatch.setattr(reading, "LONGEST_LINE", 2000)
    (tmp_path / "long.csv").write_text("t,x\n1,2\n3," + "4" * 5000)
    refused(lagsim("compare", "long.csv", "long.csv"), "a line has more than 1.95 KiB")


LONG = MODEL.replace("duration: 1}", "duration: 1e5, output_step: 0.1}")


def with_free(monkeypatch, amount):
    usage = SimpleNamespace(free=amount)
    monkeypatch.setattr(shutil, "disk_usage", lambda _: usage)


def test_a_table_without_room_is_refused_before_it_is_computed(
    lagsim, write, monkeypatch
):
    with_free(monkeypatch, 1 << 20)
    done = lagsim("run", write(LONG), "--no-plots")
    # t, three of x, three energies
    refused(done, "1,000,001 rows of 7 columns need about 127 MiB", "1 MiB free")
    assert not Path("results").exists()


def test_a_table_that_may_not_fit_is_warned_of(monkeypatch):
    settings = Settings(end=1e5, output_step=0.1)
    needed = (10**6 + 1) * 7 * 19
    ask = partial(refuse_without_room, Path("out"), TableFormat.CSV, settings, 7)
    with_free(monkeypatch, needed)
    assert ask(ends=False) == ""
    with_free(monkeypatch, needed - 1)
    assert "may fill up" in ask(ends=False)
    with_free(monkeypatch, 0)
    assert "may fill up" in ask(ends=True)


def test_short_runs_do_not_ask(lagsim, write, monkeypatch):
    with_free(monkeypatch, 0)
    assert lagsim("run", write(MODEL), "--no-plots").code == 0


@pytest.mark.parametrize(
    ("limit", "line"),
    [
        ("WORK", "check model.yaml"),
        ("GRAPH_NODES", "run model.yaml --no-plots --error-bar never -q"),
        ("MEMBERS", "check model.yaml"),
        ("TERMS", "run model.yaml --no-plots --error-bar never -q"),
    ],
)
def test_a_file_of_ones_own_has_no_limit_where_it_is_told_so(
    lagsim, tmp_path, monkeypatch, limit, line
):
    text = MODEL.replace("x: {}", "x(1..20): {}").replace("{x: 1}", "{x(1..20): 1}")
    text = text.replace("x_dot^2/2", "sum(i = 1..20, x_dot(i)^2)")
    text = text.replace("k*x^2", "sum(i = 1..20, k*x(i)^2)")
    (tmp_path / "model.yaml").write_text(text)
    monkeypatch.setattr(limits, limit, 15)
    monkeypatch.setattr(limits, "GRAPH_NODES_PER_BYTE", 0)
    refused(lagsim(*line.split()), "15", "--no-limits")
    assert lagsim(*line.split(), "--no-limits").code == 0
    assert getattr(limits, limit) == 15
