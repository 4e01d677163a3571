"""The command line itself: help, usage, streams, colours, bugs."""

import contextlib
import os
import re
import subprocess
import sys

import pytest

from lagsim.cli import COMMANDS
from tests.cli._results import Terminal, names
from tests.small_scenes import CAPTION, ON_THE_CURVE, PENDULUM
from tests.support import ROOT

COMMAND = f"{sys.executable} -m lagsim"


# Whatever whoever runs the tests has set: what is left in a buffer counts.
BUFFERED = {"PYTHONUNBUFFERED": ""}


def shell(line, folder, **environment):
    """Run a line of a shell, with `lagsim` for the command."""
    return subprocess.run(
        ["sh", "-c", line.replace("lagsim", COMMAND)],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(ROOT), **BUFFERED, **environment},
        capture_output=True,
    )


@pytest.mark.parametrize("flag", ["-h", "--help"])
def test_help(lagsim, flag):
    called = lagsim(flag, code=0, err="")
    for command in ("run", "check", "bench", "methods"):
        assert f"\n  {command} " in called.out
        page = lagsim(command, flag, code=0, err="")
        assert "--json" in page.out
    options = (
        "--output DIR", "--set NAME=EXPR", "--method M", "--rtol X", "--atol X",
        "--step H", "--duration T", "--output-step H", "--no-plots", "-q, --quiet",
    )  # fmt: skip
    page = lagsim("run", flag).out
    assert [o for o in options if o not in page] == []


@pytest.mark.slow
@pytest.mark.parametrize("columns", ["60", "80", "100"])
def test_no_summary_is_cut(lagsim, monkeypatch, columns):
    monkeypatch.setenv("COLUMNS", columns)
    page = lagsim("--help").out
    assert max(map(len, page.splitlines())) <= int(columns)
    # The summary of each command, as its own page has it.
    listed = " ".join(page.partition("Commands:")[2].split())
    for command in COMMANDS:
        own = lagsim(command, "--help").out
        assert max(map(len, own.splitlines())) <= int(columns)
        told = own.split("\n\n")[1]
        assert " ".join(told.split()) in listed


def test_no_command_shows_the_help(lagsim):
    called = lagsim(code=2, out="")
    assert called.err == lagsim("--help").out


# By the letters that differ: one is wrong, missing, doubled; the end is missing.
NEAREST = {
    "--metod": "--method", "--methods": "--method", "--sett": "--set",
    "--outputstep": "--output-step",
    "--rtoll": "--rtol", "--dur": "--duration", "--hlp": "--help",
}  # fmt: skip


@pytest.mark.parametrize(("given", "nearest"), NEAREST.items())
def test_of_an_unknown_option_the_nearest_is_suggested(lagsim, given, nearest):
    text = lagsim("run", "a.yaml", given, "1", "--json").json["errors"][0]["text"]
    first = text.partition("Did you mean ")[2].strip("?").split(" or ")[0]
    assert first == nearest
    assert text in lagsim("run", "a.yaml", given, "1").err


def test_an_option_without_its_value(lagsim):
    called = lagsim("run", "a.yaml", "--rtol", code=2)
    assert called.out == ""
    assert "--rtol" in called.err


def test_version(lagsim):
    called = lagsim("--version", code=0, err="")
    assert called.out.split()[0] == "lagsim"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("variable", "value", "coloured"),
    [("NO_COLOR", "", True), ("NO_COLOR", "1", False), ("TERM", "dumb", False)],
)
def test_colours(lagsim, write, monkeypatch, variable, value, coloured):
    for name in ("NO_COLOR", "TERM"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv(variable, value)
    terminal = Terminal()
    with contextlib.redirect_stdout(terminal):
        lagsim("check", write(ON_THE_CURVE))
        lagsim("run", "model.yaml", "--no-plots")
    assert ("\x1b[32madmissible\x1b[0m" in terminal.shown) is coloured
    assert ("\x1b[32mdone\x1b[0m" in terminal.shown) is coloured
    assert ("\x1b" in terminal.shown) is coloured
    assert "\x1b" not in lagsim("check", "model.yaml").out


@pytest.mark.parametrize(
    "words", ["check A\nb.yaml", "run A -o o\no", "golden A --dir g\r", "new n\nn"]
)
def test_a_line_break_in_an_argument_is_refused(lagsim, write, words):
    write(PENDULUM, "A\nb.yaml")
    write(PENDULUM, "A")
    called = lagsim(*words.split(" "), code=2)
    assert called.reports("E801")
    assert names(".") == ["A", "A\nb.yaml"]


@pytest.mark.slow
def test_a_progress_bar_on_a_terminal_only(lagsim, write, monkeypatch):
    monkeypatch.setattr("lagsim.cli._shared.PATIENCE_SECONDS", 0.0)
    long = PENDULUM.replace("duration: 2,", "duration: 2000,")
    model = write(long)
    assert lagsim("run", model, "--no-plots").err == ""
    terminal = Terminal()
    with contextlib.redirect_stderr(terminal):
        lagsim("run", model, "--no-plots", "-q")
        assert terminal.shown == ""
        called = lagsim("run", model, "--no-plots", "--json")
    assert percentages(terminal.shown, "run")[-1] == 100
    assert called.json["outcome"] == "done"


def percentages(shown, label):
    return [int(x) for x in re.findall(rf"{label}  \[[#-]*\] +(\d+)%", shown)]


GROWS = "forces: {theta: 0.01*theta_dot}\n"


@pytest.mark.parametrize(
    ("line", "model", "last"),
    [
        ("run --no-plots", (GROWS, ", until: theta >= 2"), 100),
        ("run --no-plots", ("forces: {theta: 0.01*sqrt(150 - t)}\n", ""), 0),
        ("sweep l=1,2,3 --jobs 1", ("", ""), 100),
        ("bench --methods dop853", ("", ""), 100),
        ("stability --methods rk4", ("", ""), 100),
    ],
)
@pytest.mark.slow
def test_progress_bars_end_at_the_end(lagsim, write, monkeypatch, line, model, last):
    monkeypatch.setattr("lagsim.cli._shared.PATIENCE_SECONDS", 0.0)
    command, *options = line.split()
    force, until = model
    duration = "duration: 400" if command == "run" else "duration: 2"
    text = force + PENDULUM.replace("duration: 2", duration + until)
    terminal = Terminal()
    with contextlib.redirect_stderr(terminal):
        lagsim(command, write(text), *options)
    found = percentages(terminal.shown, command)
    assert found == sorted(found)
    if last:
        assert found[-1] == last
    else:
        assert 0 < found[-1] < 100


# Lines of a shell; the exit code, and what standard error has.
FULL = b"standard output cannot be written: No space left"
# Its reader ends before the command begins to write.
GONE = "{ sleep 0.2; COMMAND; echo $? >&2; } | true"
STREAMS = [
    ("lagsim run --no-plots m.yaml >&- 2>&- <&-", 0, b""),
    ("lagsim check --json m.yaml >&- 2>&- <&-", 0, b""),
    ("lagsim check - <&-", 2, b"<stdin>: the file is empty"),
    ("lagsim check --json m.yaml >/dev/full", 3, FULL),
    ("lagsim --help >/dev/full", 3, FULL),
    ("lagsim check none.yaml 2>/dev/full", 2, b""),
    (
        "GITHUB_ACTIONS=true lagsim check --json wrong.yaml >/dev/null 2>/dev/full",
        1,
        b"",
    ),
    (GONE.replace("COMMAND", "lagsim methods"), 0, b"0\n"),
    (GONE.replace("COMMAND", "lagsim check --json wrong.yaml"), 0, b"1\n"),
]


@pytest.mark.slow
@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="no /dev/full")  # noqa: PTH110
@pytest.mark.parametrize(("line", "code", "told"), STREAMS)
def test_streams_that_are_closed_full_or_unread(tmp_path, write, line, code, told):
    write(PENDULUM, "m.yaml")
    write(CAPTION, "wrong.yaml")
    done = shell(line, tmp_path)
    assert (done.returncode, done.stdout) == (code, b"")
    assert told in done.stderr if told.isascii() and code else done.stderr == told
    assert b"Traceback" not in done.stderr
    assert told != FULL or done.stderr.count(b"\n") == 1


@pytest.mark.slow
def test_names_that_stdout_cannot_spell(tmp_path, write):
    write(PENDULUM.replace("theta", "θ"), "m.yaml")
    done = shell(
        "lagsim check m.yaml; lagsim run m.yaml --no-plots --method θ",
        tmp_path,
        PYTHONIOENCODING="ascii",
    )
    assert done.returncode == 2
    assert b"Traceback" not in done.stderr
    assert b"\\u03b8" in done.stderr


@pytest.mark.skipif(sys.platform in ("win32", "darwin"), reason="names are Unicode")
def test_a_file_name_that_is_not_unicode(lagsim):
    name = os.fsdecode(b"a\xff.yaml")
    with open(os.fsencode(name), "w") as file:  # noqa: PTH123
        file.write(PENDULUM)
    assert lagsim("check", name, "--json").json["model"]["file"] == "a?.yaml"
    assert lagsim("run", name, "--no-plots").code == 0
    missing = lagsim("run", "b" + name, "--json")
    assert missing.json["errors"][0]["file"] == "ba?.yaml"


@pytest.mark.parametrize("width", [60, 80])
def test_lines_fit_a_terminal(lagsim, write, monkeypatch, width):
    monkeypatch.setenv("COLUMNS", str(width))
    monkeypatch.setenv("NO_COLOR", "1")
    model = write(ON_THE_CURVE, "on-the-curve.yaml")
    plain = lagsim("check", model).out
    assert max(map(len, plain.splitlines())) > 60, "or nothing is tested"
    terminal = Terminal()
    with contextlib.redirect_stdout(terminal):
        lagsim("check", model)
    shown = terminal.shown
    assert max(map(len, shown.splitlines())) <= width
    assert shown.split() == plain.split()


def test_the_caret_stays_under_its_token_on_a_terminal(lagsim, write, monkeypatch):
    monkeypatch.setenv("COLUMNS", "50")
    line = "theta_dot^2/2" + " + 0*theta" * 9 + " + wrong" + " + 0*theta" * 9
    model = write(PENDULUM.replace("kinetic: ", f"kinetic: {line} + "))
    terminal = Terminal()
    with contextlib.redirect_stderr(terminal):
        assert lagsim("check", model).code == 2
    lines = terminal.shown.splitlines()
    assert max(map(len, lines)) <= 50
    [k] = [k for k, text in enumerate(lines) if "^^" in text]
    at = lines[k].index("^")
    assert lines[k - 1][at : at + 5] == "wrong"


SHELLS = {
    "bash": "complete -o default -F _lagsim_completion lagsim",
    "zsh": "compdef _lagsim_completion lagsim",
    "fish": "complete --command lagsim",
}


@pytest.mark.parametrize("name", SHELLS)
def test_a_shell_gets_a_script_for_completion(lagsim, monkeypatch, name):
    monkeypatch.setenv("_LAGSIM_COMPLETE", f"source_{name}")
    called = lagsim(code=0, err="")
    assert SHELLS[name] in called.out


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("lagsim ", {"run", "check", "new", "schema"}),
        ("lagsim sta", {"stability"}),
        ("lagsim new mine --template ", {"pendulum", "rigid-body"}),
        ("lagsim run --out", {"--output", "--output-step"}),
        ("lagsim run model.yaml --method ", {"auto", "rattle"}),
        ("lagsim methods r", {"radau", "rattle", "rk4"}),
    ],
)
def test_a_line_is_completed(lagsim, monkeypatch, line, words):
    monkeypatch.setenv("_LAGSIM_COMPLETE", "complete_bash")
    monkeypatch.setenv("COMP_WORDS", line)
    monkeypatch.setenv("COMP_CWORD", str(len(line.split(" ")) - 1))
    called = lagsim(code=0, err="")
    found = called.out.split()
    assert words <= set(found)
    begun = line.split(" ")[-1]
    assert [w for w in found if not w.startswith(begun)] == []


def test_what_nobody_has_foreseen_is_kept_in_a_file(
    lagsim, write, monkeypatch, tmp_path
):
    def broken(*_arguments, **_keywords):
        raise RuntimeError("unforeseen")

    monkeypatch.setenv("LAGSIM_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr("lagsim.cli.check.check", broken)
    model = write(PENDULUM)
    called = lagsim("check", model, code=70, out="")
    assert called.err.startswith("lagsim: RuntimeError: unforeseen [E901]\n")
    [report] = (tmp_path / "cache/reports").iterdir()
    assert str(report) in called.err
    text = report.read_text("utf-8")
    assert "'check' 'model.yaml'" in text
    assert "in broken\n" in text
    # The same with the way to it, and where nothing can be kept.
    again = lagsim("check", model, "--traceback")
    assert again.err.startswith("Traceback (most recent call last):\n")
    assert "in broken\n" in again.err
    monkeypatch.setenv("LAGSIM_CACHE", str(tmp_path / model / "no"))
    assert "in broken\n" in lagsim("check", model).err
