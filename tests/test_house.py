"""The modules in no room of the house, and names with one meaning each."""

import functools
import re
from collections import Counter

import pytest

from tests.support import ROOT

HOUSE = ROOT / "lagsim"
LOOSE = {"__init__", "__main__", "errors", "files", "limits", "notes", "tolerances"}
LOOSE |= {"version"}
GLOSSARY = (ROOT / "docs" / "glossary.md").read_text(encoding="utf-8")
# Rows of the tables: the word, and the last cell.
WORDS = re.findall(r"(?m)^\| ([^|]+) \|.*\| (`[^|]+) \|$", GLOSSARY)


@functools.cache
def classes_of(path):
    """Return the names of the classes that a module defines."""
    found = re.findall(r"(?m)^class (\w+)", path.read_text(encoding="utf-8"))
    return [name for name in found if not name.startswith("_")]


def test_every_file_is_in_a_room():
    assert {f.stem for f in HOUSE.glob("*.py")} == LOOSE


@pytest.mark.parametrize(("word", "where"), WORDS)
def test_the_glossary_names_classes_that_exist(word, where):
    path, *classes = re.findall(r"`([^`]+)`", where)
    assert (HOUSE / path).exists(), word
    if classes:
        file = HOUSE / path
        file = file / "__init__.py" if file.is_dir() else file
        assert {*classes} <= {*classes_of(file)}, word


def test_a_class_name_has_one_meaning():
    counts = Counter(name for f in HOUSE.rglob("*.py") for name in classes_of(f))
    # `lagsim.Model` holds a `model.model.Model`.
    assert {name for name, count in counts.items() if count > 1} == {"Model"}


def test_studies_run_sessions_by_one_function():
    calls = re.compile(r"\.run\(\s*\[")  # `Session.run` with its list of observers
    found = {
        str(f.relative_to(HOUSE))
        for room in ("studies", "api", "cli")
        for f in (HOUSE / room).rglob("*.py")
        if calls.search(f.read_text(encoding="utf-8"))
    }
    assert found == {"studies/trial.py"}


def test_the_glossary_has_rows():
    assert len(WORDS) > 50
