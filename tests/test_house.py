"""What no linter holds: how long files are, and what stands outside the rooms."""

from __future__ import annotations

from tests.support import ROOT

HOUSE = ROOT / "lagsim"
MOST_LINES = 400
LOOSE = {"__init__", "__main__", "errors", "files", "limits", "notes", "version"}


def test_files_are_read_in_one_go():
    files = list(HOUSE.rglob("*.py"))
    assert len(files) > 100
    long = [f for f in files if len(f.read_text("utf-8").splitlines()) > MOST_LINES]
    assert long == []


def test_every_file_is_in_a_room():
    assert {f.stem for f in HOUSE.glob("*.py")} == LOOSE
