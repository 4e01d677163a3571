"""YAML texts: line ends, repairs, both parsers. Places and faults: test_faults."""

import re

import pytest
import yaml

import lagsim.model.loading
from lagsim.model.loading import load
from lagsim.model.nodes import Broken
from tests.model._files import problems
from tests.model.test_faults import CASES


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
@pytest.mark.parametrize("mark", ["", "\ufeff"])
def test_line_ends_and_the_byte_order_mark(end, mark):
    text = f"{mark}name: a\n\ndefinitions: {{a: zz}}\n".replace("\n", end)
    [problem] = problems(text)
    assert problem.place == ("model.yaml", 3, 18, 2, "definitions: {a: zz}")
    [problem] = problems(f"{mark}name: ''")
    assert problem.place.column == 7


def test_a_token_over_two_lines_is_marked_in_its_first():
    [problem] = problems("scene: {points: {p: [x,\n  y, x, y]}}")
    assert problem.place[1:4] == (1, 21, 3)


def test_sections_given_twice_are_read_together():
    text = "parameters: {b: 1}\nparameters: {c: 1}\nforces: {x: b + c}"
    [problem] = problems(text)
    assert (problem.code, problem.hint) == ("duplicate-key", "the first is in line 1")


@pytest.mark.parametrize(
    "text", ["atan2(y, x) = 0", "if(x > 0,\n  max(x, min(1, y)), 2) + 1"]
)
def test_a_comma_within_parentheses_ends_no_value(text):
    """Unquoted text between braces and brackets is read as quoted text."""
    root, faults = load(f"a: {{b: {text}, c: {text}}}\nd: [{text}, [{text}]]", "f")
    values = {key.text: value for key, value in root.entries}
    read = [value for _, value in values["a"].entries]
    read += [values["d"].items[0], *values["d"].items[1].items]
    assert {x.text for x in read} == {" ".join(text.split())}
    assert (faults, [key.text for key, _ in values["a"].entries]) == ((), ["b", "c"])


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


READ = [
    re.sub("[⟪⟫]", "", text)
    for code, _, text in CASES.values()
    if code in ("yaml-syntax", "yaml-tab", "missing-space") or "⟪zz⟫" in text
]


@pytest.mark.parametrize("text", [*READ, 'x-a: "\\U00110000"\n'])
def test_the_python_parser_reports_the_same(text, monkeypatch):
    """Where there is no libyaml; of an escape both name another column."""
    known = slice(2) if "\\U" in text or "\\q" in text else slice(3)
    expected = [(p.code, p.place[known]) for p in problems(text)]
    monkeypatch.setattr(lagsim.model.loading, "_LOADER", yaml.Loader)
    assert [(p.code, p.place[known]) for p in problems(text)] == expected != []
