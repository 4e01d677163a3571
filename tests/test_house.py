"""The modules that stand in no room of the house."""

from tests.support import ROOT

HOUSE = ROOT / "lagsim"
LOOSE = {"__init__", "__main__", "errors", "files", "limits", "notes", "tolerances"}
LOOSE |= {"version"}


def test_every_file_is_in_a_room():
    assert {f.stem for f in HOUSE.glob("*.py")} == LOOSE
