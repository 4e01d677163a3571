"""Command lines that no command takes: exit 2, what is wrong, and nothing written."""

from __future__ import annotations

import pytest

from tests.cli._results import names
from tests.small_scenes import CAPTION, CONTACT, PENDULUM, TIMELESS

OSCILLATOR = """\
parameters: {k: 4, step: 1}
coordinates: {x: }
energy: {kinetic: x_dot^2/2, potential: k*x^2/2DAMPED}
initial: {x: 1}
simulation: {duration: 10, output_step: 0.1}
"""
FILES = {
    "swing": PENDULUM,
    "spring": OSCILLATOR.replace("DAMPED", ""),
    "damped": OSCILLATOR.replace("DAMPED", ", dissipation: x_dot^2/2"),
    "timeless": TIMELESS,
    "contact": CONTACT,
    "wrong": CAPTION,
}
SPRING, SWING = "stability spring.yaml", "bench swing.yaml"
LINES = {
    f"{SWING} --methods dop853,dop54": "there is no method `dop54`",
    f"{SWING} --methods scipy:Euler": "there is no method `scipy:Euler`",
    f"{SWING} --tolerances 1e-3": "--tolerances 1e-3: two numbers above 0",
    f"{SWING} --tolerances 0:1e-3": "two numbers above 0",
    f"{SWING} --steps a:b": "--steps a:b: two numbers above 0",
    f"{SWING} --budget 0": "--budget 0: a number of seconds above 0",
    f"{SWING} --set l": "--set l: a name and an expression",
    "bench timeless.yaml": "`bench` needs to know how long",
    f"{SPRING} --methods verlet,leapfrog": "there is no method `leapfrog`",
    f"{SPRING} --methods dop853": "`dop853` chooses its steps",
    f"{SPRING} --steps 0.1": "--steps 0.1: two different numbers",
    f"{SPRING} --steps 0:1": "--steps 0:1: steps are above 0",
    f"{SPRING} --steps nan:1": "two different numbers",
    f"{SPRING} --vary k": "--vary k : two different numbers",
    f"{SPRING} --vary m=1:2": "--vary m: the model has no such parameter",
    f"{SPRING} --vary k=1:2 --vary k=2:3": "one parameter varies at a time",
    f"{SPRING} --vary step=1:2": "`step` cannot be varied: stability.csv has a column",
    f"{SPRING} --set l": "--set l: a name and an expression",
    "stability damped.yaml --methods verlet": (
        "`verlet` cannot handle this model: its forces depend"
    ),
    "stability timeless.yaml": "`stability` needs to know how long",
    "stability contact.yaml": "constraints that come and go",
    "derive nowhere.yaml": "nowhere.yaml: cannot be read",
    "derive swing.yaml --format maple": "maple",
    "derive swing.yaml --format python --gauss": "--gauss means nothing",
    "derive swing.yaml --format latex --ascii": "--ascii means nothing",
    "derive swing.yaml --set q_ddot=1": "q_ddot",
    "derive swing.yaml -o no/such/folder/file": "cannot be written",
    "derive swing.yaml -o .": "cannot be written",
    "derive swing.yaml -o swing.yaml": "it is the model",
    "sweep swing.yaml": "NAME=A:B:N",
    "sweep swing.yaml L=1,2": "`L`",
    "sweep swing.yaml l=1:2": "l=1:2",
    "sweep swing.yaml l=1 --method no": "there is no method `no`",
    "sweep swing.yaml l=1+": "a value is expected",
    "sweep swing.yaml l=1 --ends --keep": "--ends makes no rows, which --keep",
    "sweep swing.yaml l=1 --ends --error-bar always": "--ends makes no rows",
    "spectrum out x -o x.txt": "x.txt: no such format",
    "overlay one -o it.doc": "ends in .png, .svg, .pdf or .html",
    **{
        f"compare one two {option} {value}": f"{option} {value}: a number of at least 0"
        for option in ("--rtol", "--atol")
        for value in ("-1e-9", "nan", "inf", "small")
    },
    "methods rk44": "no method `rk44`",
    "methods auto": "no method `auto`",
    "new": "NAME",
    "new mine --template pendulm": "pendulum",
    "new nowhere/mine": "nowhere/mine.yaml cannot be written: No such file",
    "new .yaml": "names no file",
    "new a\0b": "cannot be written",
}
AS_JSON = ("bench", "stability", "sweep", "methods", "spectrum", "compare")


@pytest.fixture
def files(write):
    """Write the models; give their names."""
    return sorted(write(text, f"{name}.yaml") for name, text in FILES.items())


@pytest.mark.parametrize("line", LINES)
def test_a_line_is_refused(lagsim, files, line):
    called = lagsim(*line.split(" "))
    assert (called.code, called.out) == (2, "")
    assert LINES[line] in called.err
    assert "Traceback" not in called.err
    if line.startswith(AS_JSON):
        called = lagsim(*line.split(" "), "--json")
        assert (called.code, called.err) == (2, "")
        assert LINES[line] in called.json["errors"][0]["text"]
    assert names(".") == files


@pytest.mark.parametrize("command", ["bench", "stability"])
def test_a_start_is_refused(lagsim, files, command):
    called = lagsim(command, "wrong.yaml")
    assert called.code == 1
    assert "constraint `path` has the residual 1" in called.err
    assert names(".") == files
