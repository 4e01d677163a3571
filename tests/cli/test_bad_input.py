"""Unusable input: exit 2, every fault with its place, no traceback, nothing written."""

from __future__ import annotations

import math
import time
from pathlib import Path

import pytest

from lagsim.codes import errors
from tests.cli._results import table
from tests.patience import PATIENCE
from tests.small_scenes import ON_THE_CURVE, PENDULUM

KEYS = [
    "file", "line", "column", "length", "source", "code", "number", "text", "expected",
    "hint",
]  # fmt: skip


def refused(lagsim, *arguments):
    """Give the messages and the errors of a call that is refused, by both commands."""
    called = lagsim(*arguments)
    assert (called.code, called.out) == (2, "")
    assert "Traceback" not in called.err
    as_json = lagsim(*arguments, "--json")
    assert (as_json.code, as_json.err) == (2, "")
    errors = as_json.json.pop("errors")
    assert errors
    assert all(list(error) == KEYS for error in errors)
    assert not Path("results").exists()
    return called.err, errors


@pytest.mark.parametrize("command", ["run", "check"])
@pytest.mark.parametrize(
    ("path", "told"),
    [
        ("none.yaml", "none.yaml: cannot be read: No such file or directory"),
        ("folder", "folder: cannot be read: Is a directory"),
        ("model.yaml/x", "model.yaml/x: cannot be read: Not a directory"),
        (
            "/dev/null",
            "/dev/null: cannot be read: it is a pipe or a device, and no regular file",
        ),
    ],
)
def test_a_file_that_cannot_be_read(lagsim, write, command, path, told):
    write(PENDULUM)
    Path("folder").mkdir()
    err, [error] = refused(lagsim, command, path)
    assert err.startswith(f"{told} [{error['number']}]\n  hint: ")
    assert error["file"] == path
    assert error["text"] == told


@pytest.mark.parametrize(
    ("content", "told"),
    [
        (b"", "the file is empty"),
        (b"# only a comment\n", "the file is empty"),
        (b"name: \xff\n", "model.yaml:1:7: not UTF-8: byte 0xff in line 1"),
        (b"\x00\x01\x02", "model.yaml:1:1: "),
        (b"- 1\n- 2\n", "must be a mapping"),
        (b"just a text", "must be a mapping"),
        (b"energy: {kinetic: (x", "model.yaml:1"),
        (b"a: 1\n---\nb: 2\n", "model.yaml:2"),
    ],
)
def test_what_is_no_model_at_all(lagsim, content, told):
    Path("model.yaml").write_bytes(content)
    err, _ = refused(lagsim, "check", "model.yaml")
    assert told in err


def test_every_fault_at_once_with_its_place(lagsim, write):
    model = write("""\
parameters: {l: 1, k: 2*zz}
coordinates: {theta: {unit: rad}}
energy: {kinetic: theta_dot^2/2, potential: cos(thta)}
forces: {phi: 1}
initial: {theta: 0, theta_dot: 1 +}
simulation: {duration: -1}
colour: red
""")
    err, errors = refused(lagsim, "run", model, "--set", "m=1", "--atol", "(")
    places = [(e["file"], e["line"], e["column"]) for e in errors]
    assert places == [
        ("--set m=1", 1, 7), ("--atol (", 1, 9), (model, 1, 25), (model, 3, 49),
        (model, 4, 10), (model, 5, 35), (model, 6, 24), (model, 7, 1),
    ]  # fmt: skip
    assert "8 problems" in err
    for file, line, column in places:
        assert f"{file}:{line}:{column}: " in err
    assert "  energy: {kinetic: theta_dot^2/2, potential: cos(thta)}\n" in err
    assert " " * 50 + "^^^^\n  hint: did you mean `theta`?" in err


SETS = {
    "unknown": (
        ["gg=1"],
        "there is no parameter or start value `gg`",
        "did you mean `g`?",
    ),
    "faulty expression": (
        ["g=1+"],
        "a value is expected",
        "leave `+` out, or write what follows it",
    ),
    "not finite": (["g=1/0"], "not a finite number", ""),
    "unknown name": (
        ["g=2*zz"],
        "unknown name `zz`",
        "give `zz` a value in `parameters`",
    ),
    "no expression": (["g="], "found nothing", ""),
    "no equals sign": (["g"], "a name and an expression", "such as --set g=1.62"),
    "no name": (["=1"], "a name and an expression", "such as --set g=1.62"),
    "twice": (["g=1", "g=2"], "--set g is given twice", ""),
    "dotted": (["a.b=1"], "names with a dot are reserved", ""),
    "an acceleration": (["theta_ddot=1"], "--set takes parameters and start", ""),
    "a start value's name": (["thta=1"], "start value `thta`", "did you mean `theta`?"),
    "not finite at the start": (["theta=1/0"], "of `theta` is inf", ""),
}


@pytest.mark.parametrize("command", ["run", "check"])
@pytest.mark.parametrize(("sets", "told", "hint"), SETS.values(), ids=SETS)
def test_set(lagsim, write, command, sets, told, hint):
    options = [part for text in sets for part in ("--set", text)]
    err, [error] = refused(lagsim, command, write(PENDULUM), *options)
    assert told in err
    assert told in error["text"]
    # Where there is no hint of its own, that of all such faults.
    assert error["hint"] == (hint or errors()[error["code"]].hint)


OPTIONS = {
    "--rtol x": "unknown name `x`",
    "--rtol 1e-3*": "a value is expected",
    "--rtol -1": "must not be negative",
    "--rtol 0": "without an `atol`",
    "--atol nan": "nan",
    "--step 0": "must be positive",
    "--duration 0": "must be positive",
    "--duration 1/0": "inf",
    "--output-step 3": "longer than the run",
    "--output-step 1e-12": "2000000000001 rows",
    "--method nope": "one of auto, dop853, ",
}


@pytest.mark.parametrize(("option", "told"), OPTIONS.items(), ids=OPTIONS)
def test_options_of_a_run(lagsim, write, option, told):
    name, value = option.split()
    err, [error] = refused(lagsim, "run", write(PENDULUM), f"{name}={value}")
    assert told in err
    assert err.startswith(f"{option}:1:")
    assert error["file"] == option


def test_physics_that_cannot_be_at_the_start(lagsim, write):
    massless = """\
coordinates: {x: , y: }
energy: {kinetic: x_dot^2/2, potential: x*y}
initial: {x: 0, y: 1}
simulation: {duration: 1}
"""
    err, [error] = refused(lagsim, "run", write(massless))
    assert error["code"] == "no-inertia"
    assert "coordinate y " in err
    infinite = PENDULUM.replace("-g*l*cos(theta)", "1/(theta - 1)")
    for command in ("run", "check"):
        err, errors = refused(lagsim, command, write(infinite))
        assert "in `potential` is inf at the start, where theta - 1 is 0" in err
        assert {error["code"] for error in errors} == {"not-finite"}
        assert {error["file"] for error in errors} == {"model.yaml"}


def long_sum():
    return PENDULUM.replace("-g*l*cos(theta)", " + ".join(["theta^2/2e4"] * 20_000))


HUGE = {
    "a sum of 20,000 terms": (long_sum(), {0}),
    "5,000 parentheses": (
        PENDULUM.replace("cos(theta)", "(" * 5000 + "cos(theta)" + ")" * 5000),
        {0, 2},
    ),
    "5,000 signs": (PENDULUM.replace("-g*l", "-" * 5001 + "g*l"), {0, 2}),
    "a tower of powers": (PENDULUM.replace("l: 1", "l: 9^9^9^9^9"), {2}),
    "50,000 lists": (PENDULUM + "x-deep: " + "[" * 50_000 + "]" * 50_000, {0, 2}),
    "50,000 open lists": (PENDULUM + "x-deep: " + "[" * 50_000, {2}),
    "10^6 unknown keys": ("".join(f"k{i}: 1\n" for i in range(10_000)), {2}),
    "a line of 10^6 letters": (PENDULUM + "y: " + "y" * 10**6, {2}),
}


@pytest.mark.parametrize(("text", "codes"), HUGE.values(), ids=HUGE)
def test_deep_and_huge_input(lagsim, write, text, codes):
    began = time.process_time()
    called = lagsim("check", write(text))
    assert called.code in codes
    assert "Traceback" not in called.err
    assert len(called.err) < 5e6
    assert time.process_time() - began < 20 * PATIENCE


def test_a_fault_within_a_long_line_is_shown_in_a_window(lagsim, write):
    err, _ = refused(lagsim, "check", write(ON_THE_CURVE + "y: " + "y" * 10**6))
    assert max(map(len, err.splitlines())) < 300


def test_start_values_are_set_as_parameters_are(lagsim, write):
    """The rows begin with them, and the energy is theirs; `check` takes them too."""
    model, sets = write(PENDULUM), ("--set", "theta=pi/3", "--set", "theta_dot=0.5")
    assert lagsim("check", model, *sets).code == 0
    assert lagsim("run", model, *sets, "--no-plots", "-o", "out").code == 0
    header, rows = table("out")
    row = dict(zip(header, rows[0], strict=True))
    assert row["theta"] == pytest.approx(math.pi / 3, rel=1e-15)
    assert row["theta_dot"] == 0.5
