"""The same table and the same pictures, byte by byte, whatever goes on around a run."""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys

import pytest

from tests.support import MODELS

USUAL = {"PYTHONHASHSEED": "0"}
AROUND = {
    "hash seed": {"PYTHONHASHSEED": "12345", "LAGSIM_CACHE": "/nowhere/that/exists"},
    "threads": {
        "OMP_NUM_THREADS": "7",
        "OPENBLAS_NUM_THREADS": "7",
        "MKL_NUM_THREADS": "7",
    },
    "one thread": {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"},
    "locale": {"LC_ALL": "de_DE.UTF-8", "LANG": "de_DE.UTF-8", "TZ": "Asia/Tokyo"},
    "plain locale": {"LC_ALL": "C", "PYTHONUTF8": "0"},
    "no cache": {"LAGSIM_CACHE": "/nowhere/that/exists"},
    "other folder": {"MPLBACKEND": "svg", "HOME": "/"},
}


def digests(folder, model, **around):
    """Run a model in a process of its own; give a digest of each file but run.json."""
    command = [sys.executable, "-m", "lagsim", "run", MODELS / f"{model}.yaml"]
    environment = os.environ | USUAL | around
    subprocess.run([*command, "-o", folder, "-q"], env=environment, check=True)
    return {
        path.name: hashlib.sha256(path.read_bytes()).hexdigest()
        for path in folder.iterdir()
        if path.name != "run.json"
    }


@pytest.mark.parametrize(
    "model",
    [
        pytest.param("elastic-pendulum-steered", marks=pytest.mark.nightly),
        pytest.param("dry-friction", marks=pytest.mark.nightly),
    ],
)
def test_whatever_is_set_around_it(tmp_path, model):
    usual = digests(tmp_path / "usual", model)
    assert len(usual) > 3
    for what, around in AROUND.items():
        assert digests(tmp_path / what, model, **around) == usual, what


@pytest.mark.slow
def test_whatever_else_runs(tmp_path):
    usual = digests(tmp_path / "usual", "double-pendulum")
    busy = [sys.executable, "-c", "while True: sum(range(10**6))"]
    others = [subprocess.Popen(busy) for _ in range(2 * (os.cpu_count() or 1))]
    try:
        assert digests(tmp_path / "loaded", "double-pendulum") == usual
    finally:
        for other in others:
            other.kill()
            other.wait()


@pytest.mark.slow
def test_goldens_are_the_same_bytes_too(tmp_path):
    found = []
    for seed in ("1", "2"):
        folder = tmp_path / seed
        command = [sys.executable, "-m", "lagsim", "golden", "--update", "-q"]
        command += [MODELS / "pendulum-cartesian.yaml", "--dir", folder]
        environment = os.environ | {"PYTHONHASHSEED": seed}
        subprocess.run(command, env=environment, check=True)
        found.append({path.name: path.read_bytes() for path in folder.iterdir()})
    assert found[0] == found[1]
