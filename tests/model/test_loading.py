"""YAML texts as nodes: values and places. Faults of YAML are rows of test_faults."""

import re

import pytest
import yaml

import lagsim.model.loading
from lagsim.model.loading import load
from lagsim.model.nodes import Broken, Scalar
from tests.model._files import problems
from tests.model.test_faults import CASES


def entries(text):
    document = load(text, "f.yaml")
    assert document.problems == ()
    return {key.text: value for key, value in document.root.entries}


@pytest.mark.parametrize("text", ["on", "yes", "no", "y", "010", "1e-3", "~", "0x1"])
def test_every_plain_scalar_is_its_text(text):
    scalar = entries(f"a: {text}\n")["a"]
    assert (scalar.text, bool(scalar.style)) == (text, False)


@pytest.mark.parametrize(
    ("text", "quoted", "empty"),
    [
        ("'1'", True, False), ('"1"', True, False), (">\n  1", True, False),
        ("", False, True), ("''", True, False), ("null", False, True),
        ("nil", False, False),
    ],
)  # fmt: skip
def test_quoted_and_empty(text, quoted, empty):
    scalar = entries(f"a: {text}\n")["a"]
    assert (bool(scalar.style), scalar.empty) == (quoted, empty)


def test_collections_and_their_places():
    [(key, value)] = load("# c\na:\n  bc: [1, 22]\n", "f").root.entries
    assert (key.place.line, key.place.column, key.place.length) == (2, 1, 1)
    [(inner, items)] = value.entries
    assert inner.place == ("f", 3, 3, 2, "  bc: [1, 22]")
    assert (items.place.column, items.place.length) == (7, 7)
    assert [i.text for i in items.items] == ["1", "22"]
    assert (items.items[1].place.column, items.items[1].place.length) == (11, 2)


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_line_ends(end):
    b = entries(f"a: 1{end}{end}b: xyz{end}")["b"]
    assert (b.place.line, b.place.column, b.place.source) == (3, 4, "b: xyz")


def test_byte_order_mark_has_no_column():
    assert entries("\ufeffa: 1\n")["a"].place.column == 4


@pytest.mark.parametrize("text", ["", "\n", "# only a comment\n", "--- \n...\n"])
def test_nothing(text):
    root, faults = load(text, "f")
    assert faults == ()
    assert root is None or (isinstance(root, Scalar) and root.empty)


# Line and column of zz, each counted by hand in the text.
PLACES = [
    ("a: 1 + zz\n", 1, 8),
    ("a:   1 +   zz\n", 1, 12),
    ("a: 'zz'\n", 1, 5),
    ('a: "1 + zz"\n', 1, 9),
    ("a: 'it''s zz'\n", 1, 11),
    ('a: "\\t\\x41\\u00e9 zz"\n', 1, 18),
    ('a: "\\" zz"\n', 1, 8),
    # folded plain, single and double quoted: the line break is one blank
    ("a: 1 +\n   zz\n", 2, 4),
    ("a: 1 +\n\n     2 + zz\n", 3, 10),
    ("a: '1 +\n  zz'\n", 2, 3),
    ('a: "1 + \\\n   zz"\n', 2, 4),
    # block scalars
    ("a: |\n  1 +\n  zz\n", 3, 3),
    ("a: >-\n  1 +\n  zz\n", 3, 3),
    ("a: >2 # comment\n   1 +\n\n  2 + zz\n", 4, 7),
    ("b: 0\na:\n  1 + zz\n", 3, 7),
    ("a: é∂ + zz\n", 1, 9),
]


@pytest.mark.parametrize("python", [False, True], ids=["C", "Python"])
@pytest.mark.parametrize(("text", "line", "column"), PLACES)
def test_places_inside_a_scalar(text, line, column, python, monkeypatch):
    if python:
        monkeypatch.setattr(lagsim.model.loading, "_LOADER", yaml.Loader)
    scalar = entries(text)["a"]
    place = scalar.place_of(scalar.text.index("zz"), 2)
    assert (place.line, place.column, place.length) == (line, column, 2)
    lines = text.split("\n")
    for offset in range(len(scalar.text) + 3):
        place = scalar.place_of(offset)
        assert place.column <= len(lines[place.line - 1]) + 1


def test_a_token_over_two_lines_is_marked_in_its_first():
    scalar = entries("a: xx(1,\n  2)\n")["a"]
    assert scalar.place_of(0, len(scalar.text))[1:4] == (1, 4, 5)


def test_sections_given_twice_are_read_together():
    text = "parameters: {b: 1}\nparameters: {c: 1}\nforces: {x: b + c}"
    [problem] = problems(text)
    assert (problem.code, problem.hint) == ("duplicate-key", "the first is in line 1")


def test_the_rest_is_still_read():
    root, faults = load("a: -y: 3\nb: * x\n   + 1\nc: {d: e: f}\ng: 1\n", "f")
    assert [p.place.line for p in faults] == [1, 2, 4]
    assert faults[0].place.source == "a: -y: 3"
    values = {key.text: value for key, value in root.entries}
    assert [k for k, x in values.items() if isinstance(x, Broken)] == ["a", "b", "c"]
    assert values["g"].place.line == 5


def test_many_accidents_end():
    faults = load("".join(f"k{i}: -y: 3\n" for i in range(100)), "f").problems
    assert 1 < len(faults) < 100


ACCIDENTS = [
    re.sub("[⟪⟫]", "", text)
    for code, _, text in CASES.values()
    if code in ("yaml-syntax", "yaml-tab", "missing-space", "split-by-comma")
]


@pytest.mark.parametrize("text", [*ACCIDENTS, 'x-a: "\\U00110000"\n'])
def test_the_python_parser_reports_the_same(text, monkeypatch):
    """Where there is no libyaml; of an escape both name another column."""
    known = slice(2) if "\\" in text else slice(3)
    expected = [(p.code, p.place[known]) for p in problems(text)]
    monkeypatch.setattr(lagsim.model.loading, "_LOADER", yaml.Loader)
    assert [(p.code, p.place[known]) for p in problems(text)] == expected != []
