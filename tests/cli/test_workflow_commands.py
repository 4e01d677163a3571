"""No text of a file, and no file name, is a command to GitHub's runner.

The runner takes a line that begins with `::`, after blanks too, for a command, and
`##[` anywhere in a line (actions/runner, ActionCommand.cs, TryParseV2 and TryParse).
"""

import json
import re

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from lagsim.cli._shared import harmless
from tests.small_scenes import PENDULUM

COMMAND = "::set-output name=x::planted"
# What .NET's TrimStart takes away.
BLANKS = " \t\x0b\x0c\x85\xa0\u1680\u2003\u2028\u2029\u202f\u205f\u3000"
pytestmark = pytest.mark.usefixtures("actions")
OWN = re.compile(r"::(error|warning)( [a-z]+=[^:,]*(,[a-z]+=[^:,]*)*)?::")


def commands(text, blanks=BLANKS):
    """Return lines that the runner takes for commands, without our annotations."""
    lines = re.split(r"\r\n|\r|\n", text)
    begun = [line.lstrip(blanks) for line in lines]
    planted = [x for x in begun if x.startswith("::") and not OWN.match(x)]
    return planted + [line for line in lines if "##[" in line]


FAULTY = {
    "a source line": f"{COMMAND}: 1\n" + PENDULUM,
    "a line of an expression": PENDULUM.replace(
        "initial:", f"constraints:\n  c: |\n    theta\n    {COMMAND}\ninitial:"
    ),
    "a line after blanks": PENDULUM + f"\nx:\n\u2003\t  {COMMAND}: [1\n",
    "a key": PENDULUM + '\n"::error file=other::planted": 1\n',
    "an older command": PENDULUM + '\n"##[add-mask]e": 1\n',
    "a name": f"name: '{COMMAND}\n\n  {COMMAND}'\n" + PENDULUM,
    "an unknown name": PENDULUM.replace("theta: 1}", f"theta: '{COMMAND}'}}"),
}


@pytest.mark.parametrize("what", FAULTY)
def test_faults(lagsim, write, what):
    file = write(FAULTY[what])
    for command in ("check", "run", "golden", "derive"):
        called = lagsim(command, file, code=2)
        assert commands(called.out + "\n" + called.err) == []
    # It is still said, and the place is marked below what is wrong.
    shown = called.err.splitlines()
    carets = [
        k for k, line in enumerate(shown) if line.strip(" ^") == "" and "^" in line
    ]
    for k in carets:
        assert len(shown[k - 1]) >= shown[k].index("^")
    called = lagsim("check", file, "--json")
    assert commands(called.out + "\n" + called.err) == []
    assert called.json["errors"]


def test_the_mark_moves_no_column(lagsim, write):
    called = lagsim("check", write(FAULTY["a source line"]))
    shown = called.err.splitlines()
    k = next(i for i, line in enumerate(shown) if line.startswith(f"| {COMMAND}"))
    assert shown[k + 1].index("^") == shown[k].index("::")


def test_documents_read_back(lagsim, write):
    called = lagsim("check", write(FAULTY["an older command"]), "--json")
    [fault] = json.loads(called.out)["errors"]
    assert "##[add-mask]e" in fault["source"]


NAMED = "::warning::x.yaml"


@pytest.mark.slow
def test_what_runs_say(lagsim, write):
    write(f"name: '{COMMAND}'\n" + PENDULUM, NAMED)
    write("nonsense: 1\n", "::error::y.yaml")
    for call in (
        ["run", NAMED, "--no-plots", "-o", "::error::z"], ["golden", NAMED, "--update"],
        ["run", NAMED, "::error::y.yaml", "--no-plots"], ["golden", NAMED],
    ):  # fmt: skip
        called = lagsim(*call)
        assert called.code in (0, 2)
        assert commands(called.out + "\n" + called.err) == [], call


def test_file_names_and_arguments(lagsim, write):
    name = NAMED
    write(PENDULUM, name)
    write("nonsense: 1\n", "::error::y.yaml")
    for call in (
        ["check", name], ["check", name, "::error::y.yaml"], ["run", "::error::y.yaml"],
        ["run", "::error::y.yaml", "missing"], ["golden", "::error::missing"],
        ["check", "::error::missing.yaml"], ["compare", "::error::a", "::error::b"],
        ["run", name, "--set", "::error::x=1"], ["explain", COMMAND], [COMMAND],
        ["run", "-", "--set", f"l=\n{COMMAND}"],
    ):  # fmt: skip
        called = lagsim(*call)
        assert called.code in (0, 1, 2)
        assert commands(called.out + "\n" + called.err) == [], call


def test_annotations_of_several_models_are_kept(lagsim, write):
    files = write("nonsense: 1\n", "a.yaml"), write(FAULTY["a key"], "b.yaml")
    called = lagsim("run", *files, "-j", "1")
    found = [line for line in called.err.splitlines() if OWN.match(line.lstrip())]
    assert len(found) >= 2
    assert "file=a.yaml" in found[0]
    assert commands(called.err) == []


@pytest.mark.slow
def test_what_is_derived(lagsim, write):
    told = f"description: |\n  of a rod\n   {COMMAND}\n"
    for text in (told + PENDULUM, f"name: '{COMMAND}'\n" + PENDULUM):
        for form in ("text", "latex", "python", "json", "markdown"):
            called = lagsim("derive", write(text), "--format", form)
            assert commands(called.out + "\n" + called.err) == []


@pytest.mark.slow
@settings(max_examples=30)
@given(st.text(st.sampled_from([*BLANKS, *":#[|x\r\n\ufeff\u200b"])))
@example("\r::error::x")
@example("x\r\n \u2003::x\n##[x")
@example(" \ufeff ::x")
@example(":\ufeff:")
def test_any_text(text):
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("GITHUB_ACTIONS", "true")
        found = harmless(text)
        assert commands(found, BLANKS + "\ufeff\u200b") == []
        assert harmless(found) == found
        patch.delenv("GITHUB_ACTIONS")
        assert harmless(text) == text
