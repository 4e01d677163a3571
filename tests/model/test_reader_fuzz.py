"""Whatever the text: a model or an InputError, soon."""

import time

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lagsim.errors import InputError
from lagsim.model.reader import read
from tests.model._files import SECTIONS, completed, problems
from tests.model.test_models import FULL
from tests.patience import PATIENCE

PIECES = [
    "{", "}", "[", "]", ":", ": ", "- ", "-", "(", ")", ",", "*", "*x", "&x", "!", "%",
    "@", "|", ">", "'", '"', "#", " ", "\n", "  ", "\t", "é", "²", "1e999", "_dot", "x",
    "\\", "?", "<<", "~", "null", "0", "=", "<=", "\n---\n", "\n...\n", "\u2028",
    "\x85", "\ufeff", "\x00", "\r", "lambda_path", "theta", "/0", "\ud800",
    "\U0001f600",
]  # fmt: skip

position = st.floats(0, 1)
change = st.one_of(
    st.tuples(st.just("insert"), position, st.sampled_from(PIECES)),
    st.tuples(st.just("remove"), position, st.integers(1, 30)),
    st.tuples(st.just("copy"), position, position),
    st.tuples(st.just("drop line"), position, st.none()),
)


def changed(text: str, kind: str, where: float, what) -> str:
    at = int(where * len(text))
    if kind == "insert":
        return text[:at] + what + text[at:]
    if kind == "remove":
        return text[:at] + text[at + what :]
    if kind == "copy":
        source = int(what * len(text))
        return text[:at] + text[source : source + 25] + text[at:]
    lines = text.split("\n")
    del lines[int(where * (len(lines) - 1))]
    return "\n".join(lines)


def faults(text: str) -> InputError | None:
    try:
        read(text, "model.yaml")
    except InputError as error:
        return error
    return None


def check(text: str) -> None:
    error = faults(text)
    if error is None:
        return
    assert error.problems
    for problem in error.problems:
        assert problem.code
        if problem.place is not None:
            assert problem.place.line >= 1
            assert 1 <= problem.place.column <= len(problem.place.source) + 1
    str(error).encode()


@pytest.mark.slow
@settings(max_examples=300, deadline=None)
@given(st.lists(change, min_size=1, max_size=5))
def test_changes_of_a_valid_file(changes):
    text = FULL
    for one in changes:
        text = changed(text, *one)
    check(text)


@settings(max_examples=100, deadline=None)
@given(st.lists(st.sampled_from([*PIECES, *SECTIONS.values(), "a", "\n  "])))
def test_random_pieces(pieces):
    check("".join(pieces))


@settings(max_examples=30, deadline=None)
@given(st.text(max_size=40))
def test_random_expressions(text):
    problems("definitions:\n  a: |\n    x\n", overrides={"k": text})
    check(completed("definitions: {a: '" + text.replace("'", "''") + "'}"))


LARGE = {
    "a long sum": "definitions: {a: " + "+".join(["sin(x)"] * 20_000) + "}",
    "parentheses": "definitions: {a: " + "(" * 5_000 + "x" + ")" * 5_000 + "}",
    "signs": "definitions: {a: '" + "-" * 20_000 + "x'}",
    "powers": "definitions: {a: '" + "x^" * 5_000 + "x'}",
    "a chain of definitions": "definitions:\n  p0: x\n"
    + "".join(f"  p{i}: p{i - 1} + sin({i}*x)\n" for i in range(1, 3_000))
    + "  last: p2999_dot + p2999_ddot\n",
    "a chain of parameters": "parameters:\n  p0: 1\n"
    + "".join(f"  p{i}: p{i - 1} + 1\n" for i in range(1, 3_000)),
    "a ring of definitions": "definitions:\n  p0: p2999\n"
    + "".join(f"  p{i}: p{i - 1}\n" for i in range(1, 3_000)),
    "nested braces": "x-a: " + "{a: " * 50_000,
    "nested brackets": "x-a: " + "[" * 50_000,
    "nested items": "- " * 20_000,
    "nested blocks": "".join(" " * i + "a:\n" for i in range(1_000)),
    "unknown names": "forces:\n" + "".join(f"  q{i}: r{i}\n" for i in range(3_000)),
    "unknown names in one line": "forces: {x: "
    + "+".join(f"r{i}" for i in range(3_000)) + "}",
    "commas in parentheses": "x-a: [" + "(," * 30_000 + "]",
    "accidents": "".join(f"k{i}: -y: 3\n" for i in range(2_000)),
    "duplicates": "a: 1\n" * 3_000,
    "tags": "x-a: [" + "!x 1, " * 3_000 + "]",
    "one word": "x" * 1_000_000,
    "one number": "parameters: {a: " + "1" * 200_000 + "}",
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("text", LARGE.values(), ids=LARGE.keys())
def test_size_neither_hangs_nor_exhausts(text):
    began = time.process_time()
    check(completed(text) if not text.startswith("- ") else text)
    # Anything quadratic takes minutes; the slowest of these takes half a second.
    assert time.process_time() - began < 20 * PATIENCE
