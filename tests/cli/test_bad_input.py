"""Unusable input: exit 2, every fault with its place, no traceback, nothing written."""

import math
import time
from pathlib import Path

import pytest

from tests.cli._results import table
from tests.patience import PATIENCE
from tests.small_scenes import ON_THE_CURVE, PENDULUM

KEYS = [
    "file", "line", "column", "length", "source", "code", "number", "text", "expected",
    "hint",
]  # fmt: skip


def refused(lagsim, *arguments):
    """Return the messages and the errors of a refused call, by both commands."""
    called = lagsim(*arguments, code=2, out="")
    assert "Traceback" not in called.err
    as_json = lagsim(*arguments, "--json", code=2, err="")
    errors = as_json.json.pop("errors")
    assert errors
    assert all(list(error) == KEYS for error in errors)
    assert not Path("results").exists()
    return called.err, errors


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


LONG = ("a sum of 20,000 terms", "10^6 unknown keys")


@pytest.mark.parametrize(
    ("text", "codes"),
    [
        pytest.param(*case, id=name, marks=[pytest.mark.slow] * (name in LONG))
        for name, case in HUGE.items()
    ],
)
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
    """The first row, the energy and the report of `check` follow from these values."""
    model, sets = write(PENDULUM), ("--set", "theta=pi/3", "--set", "theta_dot=0.5")
    assert lagsim("check", model, *sets).code == 0
    assert lagsim("run", model, *sets, "--no-plots", "-o", "out").code == 0
    header, rows = table("out")
    row = dict(zip(header, rows[0], strict=True))
    assert row["theta"] == pytest.approx(math.pi / 3, rel=1e-15)
    assert row["theta_dot"] == 0.5
