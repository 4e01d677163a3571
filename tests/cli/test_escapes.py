"""No content of a file or a command line controls the terminal."""

import json
import re
import sys

import pytest

from lagsim.cli import main
from lagsim.errors import Place, Problem, visible
from tests.cli._results import Terminal
from tests.small_scenes import PENDULUM

# What terminals act on: colours, a title, another order of letters, blanks of no width.
HOSTILE = "\x1b[31mred\x1b]0;title\x07\x9b1m\u202egnp\u2066\u200b\rover\x7f"
RAW = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u200b\u202a-\u202e\u2066-\u2069]")
# As YAML's double quotes have it, where the letters themselves are refused.
QUOTED = json.dumps(HOSTILE)


def test_what_is_written_instead():
    assert not RAW.search(visible(HOSTILE))
    assert visible("\x1b[31m\u202e\x9b") == "\\x1b[31m\\u202e\\x9b"
    plain = "a\tb\nc ü θ̇ 数 é́ 😀 \\x1b"
    assert visible(plain) == plain
    # What is escaped for JSON is the same text again.
    assert json.loads(visible(f'"{HOSTILE}"', json=True)) == HOSTILE


def test_the_caret_stays_below_what_it_marks():
    source = "a\x1b[1mb\u202ec: d\x07e"
    place = Place("f.yaml", 1, 1 + source.index("d"), 3, source)
    _, line, carets = str(Problem("usage", "text", place)).split("\n")
    assert line[carets.index("^") :][: carets.count("^")] == "d\\x07e"


BAD = {
    "key": f"{QUOTED}: 1\n" + PENDULUM,
    "name": f"name: {QUOTED}\n" + PENDULUM,
    "coordinate": PENDULUM.replace("coordinates: {", f"coordinates: {{{QUOTED}: , "),
    "start": PENDULUM.replace("initial: {", f"initial: {{{QUOTED}: 1, "),
    "expression": PENDULUM.replace("theta: 1}", f"theta: {QUOTED}}}"),
    "comment": "bad: 1 # \u202e\u200b\n" + PENDULUM,
    "raw": f"# {HOSTILE}\n" + PENDULUM,
    "raw name": "name: a\u202egnp\n" + PENDULUM,
}


@pytest.mark.parametrize("text", BAD.values(), ids=BAD.keys())
@pytest.mark.parametrize("command", ["check", "run", "golden"])
def test_faults_of_files(lagsim, write, tmp_path, command, text):
    called = lagsim(command, write(text), code=2)
    assert not RAW.search(called.out + called.err)
    assert not (tmp_path / "results").exists()
    assert not (tmp_path / "golden").exists()


def test_a_name_of_files_has_only_letters_that_are_seen(lagsim, write):
    for name in ("a\u202egnp", "a\u200bb", "a\u2066b", "\ufeffa"):
        called = lagsim("check", write(f"name: {name}\n" + PENDULUM), code=2)
        assert f"U+{ord(min(name.strip('ab'), key=str.isalpha)):04X}" in called.err
    # The name of the file is the model's where it has none.
    called = lagsim("check", write(PENDULUM, "a\u202eb.yaml"), code=2)
    assert called.reports("E128")
    assert lagsim("check", write("name: good\n" + PENDULUM, "a\u202eb.yaml")).code == 0
    for name in ("größe", "مدل\u200cها", "振り子"):
        assert lagsim("check", write(f"name: {name}\n" + PENDULUM)).code == 0


def test_tables_and_arguments(lagsim, write):
    good = write("t,x\n0,1\n1,2\n", "good.csv")
    cell = write(f"t,x\n0,1\n1,{HOSTILE.replace(chr(13), '')}\n", "cell.csv")
    head = write("t,\x1b[31mx\u202e\n0,1\n1,2\n", "head.csv")
    for line in (
        ["compare", good, cell], ["compare", good, head], ["compare", head, head],
        ["check", f"{HOSTILE}.yaml"], ["check", write(PENDULUM), "--set", HOSTILE],
        ["check", "model.yaml", "--set", f"{HOSTILE}=1"],
        ["run", "model.yaml", "--method", HOSTILE], [HOSTILE], ["run", f"--{HOSTILE}"],
    ):  # fmt: skip
        called = lagsim(*line)
        assert not RAW.search(called.out + called.err), line
        assert called.out + called.err


@pytest.mark.parametrize("command", [["check"], ["check", "--json"], ["derive"]])
def test_on_a_terminal(lagsim, write, monkeypatch, command):
    text = PENDULUM.replace("{unit: rad}", '{unit: "r\\u202ead"}')
    file = write(text.replace("unit: ", 'description: "d\u202e", unit: '))
    assert lagsim("check", file).code == 0
    terminal = Terminal()
    monkeypatch.setattr(sys, "stdout", terminal)
    monkeypatch.setattr(sys, "argv", ["lagsim", *command, file])
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.delenv("NO_COLOR", raising=False)
    assert main() == 0
    told = terminal.shown
    assert not RAW.search(re.sub(r"\x1b\[\d+m", "", told))
    # Colours are lagsim's own: before and after the verdict.
    assert told.count("\x1b") == (2 if command == ["check"] else 0)
