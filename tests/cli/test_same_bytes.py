"""Files are equal byte by byte, whatever the environment of a command."""

import json
import os
import subprocess
import sys

import pytest

from tests.support import MODELS

USUAL = {"PYTHONHASHSEED": "0"}
AROUND = {
    "hash seed": {"PYTHONHASHSEED": "12345", "LAGSIM_CACHE": "/nowhere/that/exists"},
    "threads": dict.fromkeys(
        ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "7"
    ),
    "one thread": {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"},
    "locale": {"LC_ALL": "de_DE.UTF-8", "LANG": "de_DE.UTF-8", "TZ": "Asia/Tokyo"},
    "plain locale": {"LC_ALL": "C", "PYTHONUTF8": "0"},
    "no cache": {"LAGSIM_CACHE": "/nowhere/that/exists"},
    "other folder": {"MPLBACKEND": "svg", "HOME": "/"},
}


def made(folder, line, **around):
    """Call the command in a process of its own; return its files."""
    command, model, *options = line.split()
    folder.mkdir()
    subprocess.run(
        [sys.executable, "-m", "lagsim", command, MODELS / f"{model}.yaml", *options],
        cwd=folder, env=os.environ | USUAL | around, check=True,
    )  # fmt: skip
    files = {p.name: p.read_bytes() for p in folder.rglob("*") if p.is_file()}
    if record := files.get("run.json"):
        files["run.json"] = json.loads(record)
        del files["run.json"]["timings"]
    return files


@pytest.mark.nightly
@pytest.mark.parametrize("model", ["elastic-pendulum-steered", "dry-friction"])
def test_whatever_is_set_around_it(tmp_path, model):
    usual = made(tmp_path / "usual", f"run {model} -q -o out")
    assert len(usual) > 3
    for what, around in AROUND.items():
        found = made(tmp_path / what, f"run {model} -q -o out", **around)
        assert found == usual, what


@pytest.mark.slow
def test_whatever_else_runs(tmp_path):
    line = "run double-pendulum -q -o out"
    usual = made(tmp_path / "usual", line)
    busy = [sys.executable, "-c", "while True: sum(range(10**6))"]
    others = [subprocess.Popen(busy) for _ in range(2 * (os.cpu_count() or 1))]
    try:
        assert made(tmp_path / "loaded", line) == usual
    finally:
        for other in others:
            other.kill()
            other.wait()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("line", "count"),
    [
        ("run elastic-pendulum-curve -q -o out", 7),
        ("golden pendulum-cartesian --update --dir out", 2),
        ("derive chaplygin-sleigh --gauss -o equations", 1),
    ],
)
def test_whatever_the_hash_seed(tmp_path, line, count):
    one, two = (made(tmp_path / x, line, PYTHONHASHSEED=x) for x in ("1", "2"))
    assert one == two
    assert len(one) == count
