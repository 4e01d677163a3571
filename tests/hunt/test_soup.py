"""No expression, file, command line or kill has an unexpected effect."""

import json
import os
import secrets
import subprocess
import sys

import pytest

from tests.hunt import kills, soup_runs
from tests.support import ROOT

SEED = 16
# A case takes about 10 ms: 10^4 of them would be most of the slow suite.
QUICK, SLOW, CHUNK = 30, 2000, 1000
# Three minutes of one core; LAGSIM_HUNT=1000000 for three hours.
NIGHTLY = int(os.environ.get("LAGSIM_HUNT", "20000"))


def hunted(tmp_path, monkeypatch, seed, numbers):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", [])
    monkeypatch.delenv("GITHUB_ACTIONS", raising=False)
    soup_runs.prepared(tmp_path)
    told = soup_runs.hunt(seed, numbers, tmp_path)
    files = [path.read_text("utf-8") for path in tmp_path.glob("found-*")]
    assert not told["found"], "\n\n".join([str(told), *files])
    return told["cases"]


def test_a_few_cases(tmp_path, monkeypatch):
    assert hunted(tmp_path, monkeypatch, SEED, range(QUICK)) == QUICK


@pytest.mark.slow
@pytest.mark.parametrize("first", range(0, SLOW, CHUNK))
def test_thousands_of_cases(tmp_path, monkeypatch, first):
    assert hunted(tmp_path, monkeypatch, SEED, range(first, first + CHUNK)) == CHUNK


@pytest.mark.nightly
@pytest.mark.timeout(36000)
def test_very_many_cases(tmp_path, monkeypatch, record_property):
    seed = int(os.environ.get("LAGSIM_SEED", secrets.randbits(32)))
    record_property("seed", seed)
    assert hunted(tmp_path, monkeypatch, seed, range(NIGHTLY)) == NIGHTLY


# --- kills ----------------------------------------------------------------------------


def killed(count, folder, seed):
    """Kill in a process of its own: forks want one without threads."""
    done = subprocess.run(
        [sys.executable, "-m", "tests.hunt.kills", str(seed), str(count), folder],
        cwd=ROOT, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    told = json.loads(done.stdout)
    assert told["faults"] == [], told["seed"]
    assert told["died"] > count / 2


forks = pytest.mark.skipif(not hasattr(os, "fork"), reason="processes of another kind")


@forks
@pytest.mark.slow
def test_kills(tmp_path):
    killed(100, tmp_path, SEED)


@forks
@pytest.mark.nightly
@pytest.mark.timeout(7200)
def test_very_many_kills(tmp_path, record_property):
    seed = secrets.randbits(32)
    record_property("seed", seed)
    killed(500, tmp_path, seed)


def test_what_is_torn_is_noticed(tmp_path):
    (tmp_path / "run.json").write_text('{"files": ["trajectory.csv"], "rows": 2}')
    assert "without" in kills.wrong(tmp_path, b"")
    (tmp_path / "trajectory.csv").write_text("t\n0\n")
    assert "1 rows" in kills.wrong(tmp_path, b"")
    (tmp_path / "trajectory.csv").write_text("t\n0\n1\n")
    assert kills.wrong(tmp_path, b"") == ""
    (tmp_path / "equations.txt").write_text("half")
    assert "of 5 bytes" in kills.wrong(tmp_path, b"whole")
