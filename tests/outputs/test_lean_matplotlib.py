"""matplotlib with stand-ins for what pictures of runs do not use."""

from __future__ import annotations

import json
import subprocess
import sys

import pytest

from tests.support import MODELS

NAMES = sorted(path.stem for path in MODELS.glob("*.yaml"))
CALL = """
import sys
from lagsim.cli import main
{before}
code = main()
from lagsim.outputs import lean_matplotlib as lean
import json
loaded = [name for name in lean.UNUSED if name in sys.modules]
print(json.dumps([code, "matplotlib" in sys.modules, loaded]))
"""
# As the command line draws, where there is no other process; as matplotlib is.
LEAN = (
    "import lagsim.cli.run as run\nrun.is_watched = lambda: True"
    "\nfrom lagsim.native.link import ahead\nahead.is_possible = lambda: False"
)
PLAIN = ""
REFUSED = LEAN + (
    "\nfrom lagsim.outputs import lean_matplotlib as lean"
    "\nlean.StandIn.__getattr__ = lambda self, name: 1 / 0"
)


def drawn(folder, before, name):
    """Draw a run; give its pictures, and the unused modules that were loaded."""
    command = [sys.executable, "-c", CALL.format(before=before), "run"]
    command += [MODELS / f"{name}.yaml", "-q", "-o", folder, "--error-bar", "never"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    code, there, loaded = json.loads(done.stdout.splitlines()[-1])
    assert (code, there, done.stderr) == (0, True, "")
    return {path.name: path.read_bytes() for path in folder.glob("*.png")}, loaded


@pytest.mark.slow
def test_nothing_drawn_changes_and_nothing_unused_is_loaded(tmp_path):
    plain, everything = drawn(tmp_path / "plain", PLAIN, "elastic-pendulum")
    lean, loaded = drawn(tmp_path / "lean", LEAN, "elastic-pendulum")
    assert lean == plain
    assert len(plain) == 3
    # Which of these a version of matplotlib has is its own affair; that it has them, or
    # that the stand-ins no longer serve, is seen here.
    assert len(everything) > 25
    assert loaded == []


@pytest.mark.nightly
@pytest.mark.parametrize("name", NAMES)
def test_nothing_drawn_changes_in_any_model(tmp_path, name):
    plain, _ = drawn(tmp_path / "plain", PLAIN, name)
    lean, loaded = drawn(tmp_path / "lean", LEAN, name)
    assert (lean, loaded) == (plain, [])


@pytest.mark.slow
def test_a_version_that_does_not_go_along_is_loaded_as_it_is(tmp_path):
    refused, everything = drawn(tmp_path / "refused", REFUSED, "kepler")
    assert len(refused) >= 2
    assert len(everything) > 25
