"""One table of messages: all that the code says, each with a number and an example."""

import ast
import functools
import re
import shlex

import pytest

from benchmarks import errors as made
from lagsim.codes import (
    RETIRED,
    cautions,
    errors,
    every,
    known,
    models,
    runs,
    warnings,
)
from lagsim.errors import Place, Problem
from lagsim.model.reader.runs import RETIRED as EARLIER
from lagsim.run.trajectory import Outcome
from tests.cli.conftest import lagsim  # noqa: F401
from tests.pages import text_of
from tests.support import MODELS, ROOT

ALL = every()
PAGE = text_of("docs/errors.md")
SHOWN = made.shown(PAGE)
CHECKED = [r for r in ALL if r.commands == ("lagsim check pendulum.yaml",)]
NAMES_OF_EARLIER_VERSIONS = [name for names in EARLIER.values() for name in names]
# What nobody can bring about in an example of a few lines and seconds, and why not.
WITHOUT = {
    "too-many-steps": "10^8 steps",
    "state-jumps": "a bug",
    "missing-package": "another installation",
    "bug": "a bug",
    "failed": "a process that is killed",
    "not-drawn": "a bug",
    "not-locked": "another file system",
    "starved": "a machine without memory",
    "unsettled-impulses": "hundreds of contacts",
    "events-unlisted": "10^4 events",
    "error-unknown": "a repeat that fails where the run does not",
    "too-large": "a thousand coordinates",
}

# --- the table ------------------------------------------------------------------------


def test_numbers_and_codes_are_given_once():
    assert len({r.number for r in ALL}) == len(ALL) > 150
    for family in (errors(), cautions()):
        assert all(row.code == code for code, row in family.items())
    tables = (models.ROWS + runs.ROWS, "E"), (warnings.ROWS, "W")
    for rows, kind in tables:
        assert len({row.code for row in rows}) == len(rows)
        numbers = [row.number for row in rows]
        assert numbers == sorted(numbers)
        assert {n[0] for n in numbers} == {kind}


def test_each_says_what_is_found_and_expected_and_what_to_try():
    for row in ALL:
        assert re.fullmatch(r"[^ ].*\.", row.happened)
        assert re.fullmatch(r"[^ ].*\.", row.expected) or row.number[0] == "W"
        assert re.fullmatch(r"[^ ].*[^. ]", row.hint) or "model" in row.hint
    assert {row.code for row in ALL if not row.commands} == set(WITHOUT)


# --- the code -------------------------------------------------------------------------


@functools.cache
def _modules():
    """Return path and text of each module outside of `lagsim/codes`."""
    files = (ROOT / "lagsim").rglob("*.py")
    return [(x, x.read_text("utf-8")) for x in files if "codes" not in x.parts]


# The names that a module imports from `known`, or reads from it.
IMPORTED = re.compile(
    r"from lagsim\.codes\.known import (?:\((?P<lines>[^)]*)\)|(?P<line>[^\n(]+))"
    r"|\bknown\.(?P<name>[A-Z_0-9]+)"
)


@pytest.mark.slow
def test_every_message_is_used():
    """An unknown code cannot be imported; here are rows that no module imports."""
    used = set()
    for _, text in _modules():
        for found in IMPORTED.finditer(text):
            used |= {*re.findall(r"\w+", "".join(filter(None, found.groups())))}
    constants = {x for x in vars(known) if x.isupper() and x != "TYPE_CHECKING"}
    assert constants - used == set()
    assert {getattr(known, x) for x in constants} == {*errors(), *cautions()}


def test_codes_are_imported():
    """A code that is written as text would be looked up when its fault is reported."""
    hyphenated = {x for x in (*errors(), *cautions()) if "-" in x}
    quoted = re.compile('"(' + "|".join(hyphenated) + ')"')
    found = [
        (path.name, x.lineno, argument.value)
        for path, text in _modules()
        if quoted.search(text)
        for x in ast.walk(ast.parse(text))
        if isinstance(x, ast.Call)
        for argument in (*x.args, *(k.value for k in x.keywords))
        if isinstance(argument, ast.Constant) and argument.value in hyphenated
    ]
    assert found == []


def test_endings_of_runs_have_rows():
    assert {o.value for o in Outcome if o.failed} <= {*errors()}


# --- messages -------------------------------------------------------------------------


def test_a_message_has_its_number_and_a_hint_in_any_case():
    place = Place("m.yaml", 3, 5, 2, "  a: bc")
    problem = Problem("duplicate-key", "twice", place)
    row = errors()["duplicate-key"]
    assert str(problem.whole) == (
        f"m.yaml:3:5: twice [{row.number}]\n    a: bc\n      ^^\n  hint: {row.hint}"
    )
    assert problem._replace(hint="so").whole.hint == "so"
    assert (problem.number, problem.expected) == (row.number, row.expected)


@pytest.fixture
def example(tmp_path, lagsim):  # noqa: F811
    """Return a function that runs an example; return its last command's output."""
    (tmp_path / "models").symlink_to(MODELS)

    def run(row):
        (tmp_path / "pendulum.yaml").write_text(row.model, encoding="utf-8")
        plain = [re.fullmatch(r"lagsim [\w ./=*,-]+", c) for c in row.commands]
        if not all(plain):
            return made.told(row, tmp_path)
        for command in row.commands:
            called = lagsim(*shlex.split(command)[1:])
        return called.out + called.err

    return run


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.parametrize(
    "row", [r for r in ALL if r.commands and r not in CHECKED], ids=lambda r: r.number
)
def test_other_examples_say_their_numbers(row, example):
    # Their texts have numbers of a motion, which other machines round otherwise.
    assert f"[{row.number}]" in made.line_of(row, example(row))


# --- lagsim explain -------------------------------------------------------------------


def test_explain(lagsim):  # noqa: F811
    called = lagsim("explain", "e116")
    row = errors()["duplicate-key"]
    begins = "E116 duplicate-key\n\nA key appears twice in one section.\nExpected: "
    assert called.out.startswith(begins + row.expected)
    assert f"  hint: {row.hint}\n" in called.out
    assert f"    {row.change}" in called.out
    both = lagsim("explain", "nothing-to-draw", "--json").json
    assert [one["number"][0] for one in both] == ["E", "W"]
    listed = lagsim("explain").out
    assert [line.split()[0] for line in listed.splitlines() if line[2:3] in "EW"] == [
        r.number for r in ALL
    ]
    wrong = lagsim("explain", "duplicat-key", code=2, out="")
    assert "did you mean `duplicate-key`?" in wrong.err


@pytest.mark.parametrize("word", [RETIRED[0].number, RETIRED[0].code.upper()])
def test_explain_says_that_a_message_is_retired(lagsim, word):  # noqa: F811
    row = RETIRED[0]
    called = " ".join(lagsim("explain", word, code=0, err="").out.split())
    assert called.startswith(f"{row.number} {row.code} {row.happened}")
    assert called.endswith(f"This message is retired: {row.instead}.")
    [document] = lagsim("explain", word, "--json", code=0).json
    assert document["retired"] == row.instead


def test_numbers_of_retired_messages_are_not_used_again():
    assert not {r.number for r in RETIRED} & {r.number for r in ALL}
    assert not {(r.number[0], r.code) for r in RETIRED} & {
        (r.number[0], r.code) for r in ALL
    }


@pytest.mark.parametrize("name", NAMES_OF_EARLIER_VERSIONS)
def test_explain_knows_methods_and_formulations_of_earlier_versions(lagsim, name):  # noqa: F811
    called = " ".join(lagsim("explain", name, code=0, err="").out.split())
    assert called.startswith(f"W207 retired `{name}` was a ")
    assert "`auto` takes its place" in called
