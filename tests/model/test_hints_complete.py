"""Every hint of the reader is brought about by a test, and advice leads to a model."""

from __future__ import annotations

import ast
import re

import pytest

from lagsim.errors import InputError
from lagsim.model.reader import read
from tests.model._files import completed
from tests.model.test_faults import CASES as FAULTS
from tests.model.test_hints_followed import CASES, FILE, FILES, admitted, text_with
from tests.support import ROOT

# What is replaced, the mistake, what its hint says, what follows from that by hand.
ADVISED = [
    ("c: l*cos(theta)", "c: erf(x)", "your own is a definition", "c: cos(x)"),
    (
        "c: l*cos(theta)",
        "c: 2*(sin(x) > 0)",
        "write if(condition, a, b)",
        "c: if(sin(x) > 0, 2, 0)",
    ),
    (
        "c: l*cos(theta)",
        "c: d/dt(l*x)",
        "write r_dot, with `r: l*x` in `definitions`",
        "r: l*x\n  c: r_dot",
    ),
    (
        "s: x + l*sin(theta)",
        "s: x) + 1",
        "count the parentheses",
        "s: x + l*sin(theta)",
    ),
    ("columns: [s]", "columns: [s, x) + 1]", "define it in", "columns: [s]"),
    ("bob: [s, c]", "bob: [s, c", "something else where", "bob: [s, c]"),
    ("  end: 2", "\tend: 2", "indent with spaces", "  end: 2"),
    (
        "  end: 2",
        "  end: 2\n   start: 0",
        "begin in the same column",
        "  end: 2\n  start: 0",
    ),
    (
        "  end: 2",
        "  end: 2\n start: 0",
        "begin in the same column",
        "  end: 2\n  start: 0",
    ),
    ("  theta: {unit: rad}", "  theta", "write `theta:`", "  theta:"),
    (
        "c: l*cos(theta)",
        "c: 'l'*cos(theta)",
        "quote the whole value",
        "c: 'l*cos(theta)'",
    ),
    ("c: l*cos(theta)", 'c: "\\cos(theta)"', "", "c: l*cos(theta)"),
    ("  theta: 1\n", "", "write `theta: 0`", "  theta: 0\n"),
    (
        "  theta: 1\n",
        "  s: 1\n",
        "write `theta: {guess: 0}`",
        "  theta: {guess: 0}\n  s: 1\n",
    ),
    ("  end: 2", "end: 2", "belongs below `simulation:`, indented", "  end: 2"),
    (
        "[[pivot, bob]]",
        "[[pivot, ball]]",
        "the points are `bob`, `pivot`",
        "[[pivot, bob]]",
    ),
    (
        "  points:\n    bob: [s, c]\n    pivot: [0, 0]\n",
        "",
        "give it a place: points: ",
        "  points: {bob: [s, c], pivot: [0, 0]}\n",
    ),
    (
        "  s: x + l*sin(theta)",
        "  s: x + l*sin(theta)\n  d: lagrangian",
        "write kinetic - potential",
        "  s: x + l*sin(theta)\n  d: kinetic - potential",
    ),
    (
        "  x: -x_dot\n",
        "  bob: -x_dot\n",
        "a force acts along one of `theta`, `x`, `s`",
        "  x: -x_dot\n",
    ),
    ("c: l*cos(theta)", "c: sin()", "`sin` takes 1 argument", "c: sin(theta)"),
    (
        "c: l*cos(theta)",
        "c: if(0 < x < 1, 1, 2)",
        "write a < b and b < c",
        "c: if(0 < x and x < 1, 1, 2)",
    ),
    ("c: l*cos(theta)", "c: l*（theta)", "write its plain form, '('", "c: l*(theta)"),
    ("  x: 0\n", "  g: 1\n  x: 0\n", "its value belongs in `parameters`", "  x: 0\n"),
]


@pytest.mark.parametrize(("old", "new", "told", "followed"), ADVISED)
def test_advice_that_is_followed(old, new, told, followed):
    assert FILE.count(old) == 1
    with pytest.raises(InputError) as raised:
        read(FILE.replace(old, new), "model.yaml")
    assert any(told in p.whole.hint for p in raised.value.problems)
    admitted(read(FILE.replace(old, followed), "model.yaml"))


# Hints of the reader that no table of these tests brings about, and where they are.
ELSEWHERE = {
    "a model file holds one document", "an expression in braces is best quoted",
    "numbers are decimal", "each coordinate needs a start value",
    "two blanks before each line that belongs to `*`",
    "give a `name`: results are called by it",
    "give `kinetic` and `potential`, or `lagrangian`",
    "parts of it may be definitions", "write the relation with a simple zero",
}  # fmt: skip


def texts(node):
    """Give the texts that a node of the source may be, `*` for what is filled in."""
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        return [node.value] if node.value else []
    if isinstance(node, ast.JoinedStr):
        parts = (v.value if isinstance(v, ast.Constant) else "*" for v in node.values)
        return ["".join(map(str, parts))]
    if isinstance(node, ast.IfExp):
        return texts(node.body) + texts(node.orelse)
    if isinstance(node, ast.BoolOp):
        return [text for part in node.values for text in texts(part)]
    return []


# Calls that take a hint, and as which of their arguments.
HINTED = {"add": 3, "Problem": 3, "_fault": 3, "ExpressionError": 3, "fault": 2}


def hints_of_the_source():
    """Give the hints that stand in the reader, the nodes and the parser."""
    files = [*(ROOT / "lagsim/model").rglob("*.py")]
    files.append(ROOT / "lagsim/language/parser.py")
    for file in sorted(files):
        for node in ast.walk(ast.parse(file.read_text("utf-8"))):
            if isinstance(node, ast.Assign):
                if any(getattr(name, "id", "") == "hint" for name in node.targets):
                    yield from texts(node.value)
            elif isinstance(node, ast.Call):
                called = getattr(node.func, "attr", getattr(node.func, "id", ""))
                if len(node.args) > HINTED.get(called, 99):
                    yield from texts(node.args[HINTED[called]])


@pytest.mark.slow  # it reads four hundred models
def test_every_hint_of_the_reader_is_brought_about():
    given = [text_with(where, text) for where, text, *_ in CASES]
    given += [FILE.replace(old, new, 1) for old, new, *_ in [*FILES, *ADVISED]]
    given += [completed(re.sub("[⟪⟫]", "", case[2])) for case in FAULTS.values()]
    found = set()
    for text in given:
        try:
            read(text, "model.yaml")
        except InputError as error:
            found |= {p.whole.hint for p in error.problems}
    left = []
    for text in hints_of_the_source():
        pattern = ".*".join(map(re.escape, text.split("*")))
        if not any(re.search(pattern, hint) for hint in found):
            left.append(text)
    assert set(left) == ELSEWHERE
