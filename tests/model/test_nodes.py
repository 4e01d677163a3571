"""YAML texts as nodes: places, and what is not accepted."""

import pytest
import yaml

import lagsim.model.loading
from lagsim.model.loading import Document, load
from lagsim.model.nodes import Broken, Mapping, Node, Scalar, Sequence


def root_of(text: str) -> Mapping:
    document = load(text, "f.yaml")
    assert document.problems == ()
    assert isinstance(document.root, Mapping)
    return document.root


def value_of(text: str, key: str = "a") -> Node:
    return {k.text: v for k, v in root_of(text).entries}[key]


def scalar_of(text: str, key: str = "a") -> Scalar:
    value = value_of(text, key)
    assert isinstance(value, Scalar)
    return value


def only_problem(document: Document):
    assert len(document.problems) == 1, document.problems
    return document.problems[0]


class TestValues:
    @pytest.mark.parametrize(
        "text", ["on", "yes", "no", "y", "010", "1e-3", "~", "0x1"]
    )
    def test_every_plain_scalar_is_its_text(self, text):
        scalar = scalar_of(f"a: {text}\n")
        assert (scalar.text, scalar.quoted) == (text, False)

    def test_quoted(self):
        assert scalar_of("a: '1'\n").quoted
        assert scalar_of('a: "1"\n').quoted
        assert scalar_of("a: >\n  1\n").quoted

    def test_empty(self):
        assert scalar_of("a:\n").empty
        assert not scalar_of("a: ''\n").empty
        assert scalar_of("a: null\n").empty
        assert not scalar_of("a: nil\n").empty

    def test_collections(self):
        a = value_of("a: {b: [1, 2], c: {}}\n")
        assert isinstance(a, Mapping)
        b, c = (value for _, value in a.entries)
        assert isinstance(b, Sequence)
        assert [i.text for i in b.items if isinstance(i, Scalar)] == ["1", "2"]
        assert isinstance(c, Mapping)

    def test_places(self):
        root = root_of("# c\na:\n  bc: [1, 22]\n")
        key, value = root.entries[0]
        assert (key.place.line, key.place.column, key.place.length) == (2, 1, 1)
        assert isinstance(value, Mapping)
        inner, items = value.entries[0]
        assert (inner.place.line, inner.place.column, inner.place.length) == (3, 3, 2)
        assert inner.place.source == "  bc: [1, 22]"
        assert isinstance(items, Sequence)
        assert (items.place.column, items.place.length) == (7, 7)
        assert (items.items[1].place.column, items.items[1].place.length) == (11, 2)

    @pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
    def test_line_ends(self, end):
        b = scalar_of(f"a: 1{end}{end}b: xyz{end}", "b")
        assert (b.place.line, b.place.column, b.place.source) == (3, 4, "b: xyz")

    def test_byte_order_mark_has_no_column(self):
        assert scalar_of("\ufeffa: 1\n").place.column == 4

    @pytest.mark.parametrize("text", ["", "\n", "# only a comment\n", "--- \n...\n"])
    def test_nothing(self, text):
        document = load(text, "f")
        assert document.problems == ()
        assert document.root is None or (
            isinstance(document.root, Scalar) and document.root.empty
        )


def place_of(text: str, token: str) -> tuple[int, int, int]:
    scalar = scalar_of(text)
    place = scalar.place_of(scalar.text.index(token), len(token))
    return place.line, place.column, place.length


class TestPlacesInside:
    """Each expected line and column is counted by hand in the text."""

    @pytest.mark.parametrize(
        ("text", "expected"),
        [
            ("a: 1 + zz\n", (1, 8, 2)),
            ("a:   1 +   zz\n", (1, 12, 2)),
            ("a: 'zz'\n", (1, 5, 2)),
            ('a: "1 + zz"\n', (1, 9, 2)),
            ("a: 'it''s zz'\n", (1, 11, 2)),
            ('a: "\\t\\x41\\u00e9 zz"\n', (1, 18, 2)),
            ('a: "\\" zz"\n', (1, 8, 2)),
            # folded plain, single and double quoted: the line break is one blank
            ("a: 1 +\n   zz\n", (2, 4, 2)),
            ("a: 1 +\n\n     2 + zz\n", (3, 10, 2)),
            ("a: '1 +\n  zz'\n", (2, 3, 2)),
            ('a: "1 + \\\n   zz"\n', (2, 4, 2)),
            # block scalars
            ("a: |\n  1 +\n  zz\n", (3, 3, 2)),
            ("a: >-\n  1 +\n  zz\n", (3, 3, 2)),
            ("a: >2 # comment\n   1 +\n\n  2 + zz\n", (4, 7, 2)),
            ("b: 0\na:\n  1 + zz\n", (3, 7, 2)),
            ("a: é∂ + zz\n", (1, 9, 2)),
        ],
    )
    def test_token(self, text, expected):
        assert place_of(text, "zz") == expected

    def test_the_end_is_after_the_last_character(self):
        scalar = scalar_of("a: 1 +\n")
        place = scalar.place_of(len(scalar.text), 1)
        assert (place.line, place.column) == (1, 7)

    def test_a_token_over_two_lines_is_marked_in_its_first(self):
        scalar = scalar_of("a: xx(1,\n  2)\n")
        place = scalar.place_of(0, len(scalar.text))
        assert (place.line, place.column, place.length) == (1, 4, 5)

    def test_a_block_begins_below_its_header(self):
        assert scalar_of("a: >\n  12\n").place.line == 2

    def test_every_offset_has_a_place_in_the_text(self):
        text = "a: \"x\\\n  \\ty \\u00e9\n\n  z''\"\n"
        scalar = scalar_of(text)
        lines = text.split("\n")
        for offset in range(len(scalar.text) + 3):
            place = scalar.place_of(offset)
            assert place.column <= len(lines[place.line - 1]) + 1


class TestRefused:
    @pytest.mark.parametrize(
        ("text", "code", "line", "column"),
        [
            ("a: 1\nb: 2\na: 3\n", "duplicate-key", 3, 1),
            ("a: &x 1\n", "anchor", 1, 4),
            ("a: {b: &x }\n", "anchor", 1, 8),
            ("a: *x\n", "alias", 1, 4),
            ("a: !x 1\n", "tag", 1, 4),
            ("a: !!float 1\n", "tag", 1, 4),
            ("<<: {a: 1}\n", "merge-key", 1, 1),
            ("a: 1\n---\nb: 1\n", "several-documents", 2, 1),
            ("{a: b}: c\n", "complex-key", 1, 1),
            ("[a, b]: c\n", "complex-key", 1, 1),
            ("a: 1\nb: \x01\n", "yaml-character", 2, 4),
            ("a: " + "[" * 200, "too-deep", 1, 103),
        ],
    )
    def test_yaml_that_models_do_not_use(self, text, code, line, column):
        problem = only_problem(load(text, "f"))
        assert (problem.code, problem.place.line, problem.place.column) == (
            code, line, column,
        )  # fmt: skip

    def test_quoted_merge_sign_is_a_key(self):
        assert root_of("'<<': 1\n").entries[0][0].text == "<<"

    def test_a_duplicate_names_the_line_of_the_first(self):
        assert "line 1" in only_problem(load("a: 1\na: 2\n", "f")).hint

    def test_sections_given_twice_are_read_together(self):
        document = load("a: {b: 1}\na: {c: 1}\n", "f")
        assert only_problem(document).code == "duplicate-key"
        assert isinstance(document.root, Mapping)
        (entry,) = document.root.entries
        assert isinstance(entry[1], Mapping)
        assert [key.text for key, _ in entry[1].entries] == ["b", "c"]


class TestAccidents:
    """What a person writes by mistake: where it is told, and how to mend it."""

    @pytest.mark.parametrize(
        ("text", "code", "line", "column", "text_part", "hint_part"),
        [
            ("x: -y: 3\n", "yaml-syntax", 1, 6, "a second `:`", "quoted"),
            ("x: a: b\n", "yaml-syntax", 1, 5, "a second `:`", "quoted"),
            ("a: {b: c: d}\n", "yaml-syntax", 1, 9, "a second `:`", "comma"),
            ("a: {x: 1 y: 2}\n", "yaml-syntax", 1, 11, "a second `:`", "comma"),
            ("a: {r: atan2(y, x) = 0}\n", "split-by-comma", 1, 8, "the comma",
             '"atan2(y, x) = 0"'),
            ("a: [if(x > 0, 1, 2), 3]\n", "split-by-comma", 1, 5, "the comma",
             '"if(x > 0, 1, 2)"'),
            ("a: {r: max(1, min(x, 2)), s: 3}\n", "split-by-comma", 1, 8, "the comma",
             '"max(1, min(x, 2))"'),
            ("i:\n  theta:1\n  u: 2\n", "missing-space", 2, 3, "`theta:1`",
             "`theta: 1`"),
            ("i:\n  u: 2\n  theta:1\n", "missing-space", 3, 3, "`theta:1`",
             "`theta: 1`"),
            ("i: {u: 2, theta:1}\n", "missing-space", 1, 11, "`theta:1`", "`theta: 1`"),
            ("a: *x + 1\n", "yaml-syntax", 1, 4, "`*`", '"*x + 1"'),
            ("a: * x\n", "yaml-syntax", 1, 4, "`*`", '"* x"'),
            ("a: %x\n", "yaml-syntax", 1, 4, "`%`", '"%x"'),
            ("a: @x\n", "yaml-syntax", 1, 4, "`@`", '"@x"'),
            ("a: `x`\n", "yaml-syntax", 1, 4, "backquote", "quote"),
            ("a: >= 3\n", "yaml-syntax", 1, 4, "`>`", '">= 3"'),
            ("a: |x|\n", "yaml-syntax", 1, 4, "`|`", "write abs(x)"),
            ("a: |x| + |y|\n", "yaml-syntax", 1, 4, "`|`", "write abs(x) + abs(y)"),
            ("a: - y\n", "yaml-syntax", 1, 4, "`- `", '"- y"'),
            ("a: ,x\n", "yaml-syntax", 1, 4, "`,`", "quote"),
            ("a:\n\tb: 1\n", "yaml-tab", 2, 1, "tab", "spaces"),
            ("a:\n  b: 1\n\tc: 2\n", "yaml-tab", 3, 1, "tab", "spaces"),
            ("a: {b: 1\nc: 2\n", "yaml-syntax", 1, 4, "`{` is not closed", "line 2"),
            ("a: [1, 2\n", "yaml-syntax", 1, 4, "`[` is not closed", "`]`"),
            ("a: 'x\nb: 1\n", "yaml-syntax", 1, 4, "never closed", ""),
            ("a: 'x' + y\n", "yaml-syntax", 1, 8, "closing quote", "whole"),
            ('a: "\\q"\n', "yaml-syntax", 1, 5, "no escape", "single quotes"),
            ("a: {x}}\n", "yaml-syntax", 1, 7, "`}` closes nothing", ""),
            ("a: 1\n  b: 2\n", "yaml-syntax", 2, 3, "belonged to `a: 1`", "column"),
            ("  a: 1\nb: 2\n", "yaml-syntax", 2, 1, "fits no section", "column"),
            ("a: 1\n<<<<<<< HEAD\n", "yaml-syntax", 2, 1, "<<<<<<< HEAD", ""),
            ("a: 1\nb\n", "yaml-syntax", 2, 1, "expected `key: value`", ""),
        ],
    )  # fmt: skip
    def test_told(self, text, code, line, column, text_part, hint_part):
        problem = only_problem(load(text, "f"))
        place = problem.place
        assert (problem.code, place.line, place.column) == (code, line, column)
        assert text_part in problem.text
        assert hint_part in problem.hint

    def test_an_expression_without_commas_is_left_to_its_parser(self):
        a = value_of("a: {relation: (x = 0}\n")
        assert isinstance(a, Mapping)
        ((_, value),) = a.entries
        assert isinstance(value, Scalar)
        assert value.text == "(x = 0"

    def test_the_rest_is_still_read(self):
        document = load("a: -y: 3\nb: * x\n   + 1\nc: {d: e: f}\ng: 1\n", "f")
        assert [p.place.line for p in document.problems] == [1, 2, 4]
        assert isinstance(document.root, Mapping)
        values = {key.text: value for key, value in document.root.entries}
        assert list(values) == ["a", "b", "c", "g"]
        assert all(isinstance(values[key], Broken) for key in "abc")
        assert isinstance(values["g"], Scalar)
        assert values["g"].place.line == 5

    def test_places_show_the_line_of_the_file(self):
        problems = load("a: -y: 3\nb: &x 1\n", "f").problems
        assert [p.place.source for p in problems] == ["a: -y: 3", "b: &x 1"]

    def test_a_value_in_braces_over_lines_is_not_torn(self):
        document = load("a: {b: c: d,\n  e: 1}\nf: 2\n", "f")
        assert only_problem(document).place.line == 1

    def test_many_accidents_end(self):
        document = load("".join(f"k{i}: -y: 3\n" for i in range(100)), "f")
        assert 1 < len(document.problems) < 100


class TestWithoutTheCParser:
    @pytest.fixture(autouse=True)
    def _python_parser(self, monkeypatch):
        monkeypatch.setattr(lagsim.model.loading, "_LOADER", yaml.Loader)

    @pytest.mark.parametrize(
        ("text", "code", "line", "column"),
        [
            ("x: -y: 3\n", "yaml-syntax", 1, 6),
            ("a: {b: c: d}\n", "yaml-syntax", 1, 9),
            ("a: %x\n", "yaml-syntax", 1, 4),
            ("a: >= 3\n", "yaml-syntax", 1, 4),
            ("a: - y\n", "yaml-syntax", 1, 4),
            ("i:\n  theta:1\n  u: 2\n", "missing-space", 2, 3),
            ("a:\n\tb: 1\n", "yaml-tab", 2, 1),
            ("a: [1, 2\n", "yaml-syntax", 1, 4),
            ('a: "\\U00110000"\n', "yaml-syntax", 1, 1),
            ("a: 'x' + y\n", "yaml-syntax", 1, 8),
        ],
    )
    def test_accidents_are_told_alike(self, text, code, line, column):
        problem = only_problem(load(text, "f"))
        assert (problem.code, problem.place.line, problem.place.column) == (
            code, line, column,
        )  # fmt: skip

    def test_places_are_alike(self):
        assert place_of("a: >-\n  1 +\n  zz\n", "zz") == (3, 3, 2)
