"""What no linter holds: how much there is to read, and what is outside the rooms."""

from tests.support import ROOT

HOUSE = ROOT / "lagsim"
LOOSE = {"__init__", "__main__", "errors", "files", "limits", "notes", "tolerances"}
LOOSE |= {"version"}
# What is there today, to ten lines: what adds to it says so here.
FILES = 220
LINES = 75_340
LINES_OF_TESTS = 57_610


def lines(folder):
    """Give the number of lines of each file of Python in a folder."""
    return [len(f.read_text("utf-8").splitlines()) for f in folder.rglob("*.py")]


def test_the_house_is_no_larger_than_it_says():
    counts = lines(HOUSE)
    assert 100 < len(counts) <= FILES
    assert sum(counts) <= LINES
    assert sum(lines(ROOT / "tests")) <= LINES_OF_TESTS


def test_every_file_is_in_a_room():
    assert {f.stem for f in HOUSE.glob("*.py")} == LOOSE
