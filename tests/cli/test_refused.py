"""What no command takes: exit 2, every fault with its place, nothing written."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from lagsim.codes import errors
from lagsim.studies.sweep.runs import MOST_RUNS
from tests.cli._results import names
from tests.small_scenes import CAPTION, CONTACT, ON_THE_CURVE, PENDULUM, TIMELESS

OSCILLATOR = """\
parameters: {k: 4, step: 1, reason: 1}
coordinates: {x: }
energy: {kinetic: x_dot^2/2, potential: k*x^2/2DAMPED}
initial: {x: 1}
simulation: {duration: 10, output_step: 0.1}
"""
FILES = {
    "swing.yaml": PENDULUM, "spring.yaml": OSCILLATOR.replace("DAMPED", ""),
    "springs.yaml": OSCILLATOR.replace("DAMPED", "")
    .replace("{k: 4", "{k: 4, n: 2, m(1..n): 1"),
    "damped.yaml": OSCILLATOR.replace("DAMPED", ", dissipation: x_dot^2/2"),
    "timeless.yaml": TIMELESS, "contact.yaml": CONTACT, "wrong.yaml": CAPTION,
    "good.csv": "t,x\n0,1\n1,2\n", "torn.json": "{", "list.json": "[]",
    "rows.json": '{"rows": []}', "none.json": "{}",
}  # fmt: skip
KEYS = [
    "file", "line", "column", "length", "source", "code", "number", "text", "expected",
    "hint",
]  # fmt: skip
# Line -> what is said; and the hint, where it is the fault's own.
LINES: dict[str, str | tuple[str, str]] = {}

# Files that are no models, and texts that are none.
UNREADABLE = {
    "none.yaml": "none.yaml: cannot be read: No such file or directory",
    "folder": "folder: cannot be read: Is a directory",
    "swing.yaml/x": "swing.yaml/x: cannot be read: Not a directory",
    "/dev/null": "/dev/null: cannot be read: it is a pipe or a device, and no regular",
    "pipe.yaml": "pipe.yaml: cannot be read: it is a pipe",
}
TEXTS = {
    b"": "the file is empty",
    b"# only a comment\n": "the file is empty",
    b"name: \xff\n": "not UTF-8: byte 0xff in line 1",
    b"\x00\x01\x02": "the character U+0000 is not allowed in YAML",
    b"- 1\n- 2\n": "must be a mapping",
    b"just a text": "must be a mapping",
    b"energy: {kinetic: (x": "",
    b"a: 1\n---\nb: 2\n": "",
}
LINES |= {
    f"{command} {file}": told
    for file, told in UNREADABLE.items()
    for command in ("run", "check", "derive", "golden", "bench", "stability")
}
LINES |= {f"check text-{k}.yaml": told for k, told in enumerate(TEXTS.values())}

# Key of `simulation`, its value; what is said of it, at its place.
ASKED = {
    ("method", "rk5"): ("there is no method `rk5`", "did you mean `rk4`?"),
    ("method", "RK45"): ("there is no method `RK45`", "did you mean `dopri5`?"),
    ("method", "ode15s"): ("there is no method `ode15s`", "did you mean `radau`?"),
    ("method", "foo"): ("there is no method `foo`", "one of auto, dop853, "),
    ("method", "Generalized_Alpha"): (
        "there is no method", "did you mean `generalized-alpha`?",
    ),
    ("formulation", "elimnation"): "there is no formulation `elimnation`",
    ("formulation", "none"): "the model has constraints",
    ("formulation", "velocity projection"): "1 of 1 constraints are on positions",
    ("formulation", "ignorable"): "no coordinate is ignorable",
}  # fmt: skip
FREE = ("projection", "baumgarte", "elimination")
POSED = [
    *((ON_THE_CURVE, *asked, told) for asked, told in ASKED.items()),
    *((PENDULUM, "formulation", x, "the model has no constraints") for x in FREE),
]
LINES |= {
    f"{command} posed-{k}.yaml": posed[-1]
    for k, posed in enumerate(POSED)
    for command in ("run", "check")
}

SETS: dict[str, str | tuple[str, str]] = {
    "gg=1": ("there is no parameter or start value `gg`", "did you mean `g`?"),
    "g=1+": ("a value is expected", "leave `+` out, or write the operand after it"),
    "g=1/0": "not a finite number",
    "g=2*zz": ("unknown name `zz`", "give `zz` a value in `parameters`"),
    "g=": "found nothing",
    "g": ("a name and an expression", "such as --set g=1.62"),
    "=1": ("a name and an expression", "such as --set g=1.62"),
    "g=1 --set g=2": "--set g is given twice",
    "a.b=1": "names with a dot are reserved",
    "theta_ddot=1": "others are given to parameters and start",
    "thta=1": ("start value `thta`", "did you mean `theta`?"),
    "theta=1/0": "of `theta` is inf",
}
LINES |= {
    f"{command} swing.yaml --set {text}": told
    for text, told in SETS.items()
    for command in ("run", "check")
}
OPTIONS = {
    "--rtol=x": "unknown name `x`",
    "--rtol=1e-3*": "a value is expected",
    "--rtol=-1": "must not be negative",
    "--rtol=0": "without an `atol`",
    "--atol=nan": "nan",
    "--step=0": "must be positive",
    "--duration=0": "must be positive",
    "--duration=1/0": "inf",
    "--output-step=3": "longer than the run",
    "--output-step=1e-12": "2000000000001 rows",
    "--method=nope": ("there is no method `nope`", "one of auto, dop853, "),
}
LINES |= {f"run swing.yaml {option}": told for option, told in OPTIONS.items()}

GARBLED = {
    "": "the file is empty",
    "1,2\n1,2\n": "line 1 is no header",
    "t,x\n0,1\n1,a\n": "line 3: x is `a`, and not a number",
    "x,y\n1,2\n": "line 1: there is no column `t`",
    "t,x\n0,1\n1,\n": "line 3: x is empty, and not a number",
    "t,x\n0,1\n\n1,2\n": "line 3 is blank",
    "t,x,x\n0,1,1\n": "line 1: the column `x` is given twice",
    "".join(map(chr, range(256))): "",
}
LINES |= {
    f"compare good.csv garbled-{k}.csv": f"garbled-{k}.csv: {told}"
    for k, told in enumerate(GARBLED.values())
}

SWEPT: dict[str, str | tuple[str, str]] = {
    "": "NAME=A:B:N",
    **dict.fromkeys(("g", "=1,2"), "a name and its values"),
    "g=1 g=2": "g is given twice",
    "g=1,2 theta=1 --set g=3": "g: both swept and given by --set",
    **dict.fromkeys(
        ("g=1:2:1", "g=1:2", "g=1:2:x", "g=1:2:3:4"), "two ends and how many"
    ),
    "gg=1": "`gg` is no parameter of",
    "g=1,nothing": "nothing",
    "g=1,": "",
    "g=1/0,1": "not a finite number",
    "g=0:1:123456789": f"more than {MOST_RUNS}",
    "g=0:1:2000 l=0:1:2000": f"more than {MOST_RUNS}",
    # All faults at once: the hint is that of the first.
    "thetta=1 g=+": ("a value is expected", "did you mean `theta`?"),
    "L=1,2": "`L`",
    "l=1+": "a value is expected",
    "l=1 --method no": "there is no method `no`",
    "l=1 --ends --keep": "--ends stores no rows, which --keep",
    "l=1 --ends --error-bar always": "--ends stores no rows",
    "l=1,2 -o good.csv": "the output folder good.csv is not a folder",
    "l=1,2 -o good.csv/x": "the output folder good.csv/x ",
    "g=1,2 --points p.csv": "one of NAME",
    "--points none.csv": "none.csv: No such file",
    "--sample g=normal(1,1)": "-N is used with --sample",
    "g=1,2 -N 5": "-N is used with",
    "g=1,2 --seed 5": "--seed with both",
    "--sample g=normal(1) -N 2": "normal(mean, deviation)",
    "--sample g=uniform(2,1) -N 2": "low is less than high",
    "--sample g=normal(1,0) -N 2": "more than 0",
    "--sample g=normal(1,1) --sample g=normal(1,1) -N 2": "given twice",
    "--sample G=normal(1,1) -N 2": "`G` is no parameter",
    "--sample g=normal(1,1) -N 2000000": "more than 1000000",
}
LINES |= {f"sweep swing.yaml {words}".strip(): told for words, told in SWEPT.items()}
LINES["sweep spring.yaml reason=1,2"] = "sweep.csv has a column of that name"
SPRING, SWING = "stability spring.yaml", "bench swing.yaml"
LINES |= {
    f"{SWING} --methods dop853,dop54": "there is no method `dop54`",
    f"{SWING} --methods scipy:Euler": "there is no method `scipy:Euler`",
    f"{SWING} --tolerances 1e-3": "--tolerances 1e-3: two numbers above 0",
    f"{SWING} --tolerances 0:1e-3": "two numbers above 0",
    f"{SWING} --steps a:b": "--steps a:b: two numbers above 0",
    f"{SWING} --budget 0": "--budget 0: a number of seconds above 0",
    f"{SWING} --set l": "--set l: a name and an expression",
    "bench timeless.yaml": "`bench` needs a duration",
    "bench torn.json": "torn.json: ",
    "bench list.json": "not a document of `lagsim bench`",
    "bench rows.json": "`lagsim` is missing",
    "bench none.json --set g=1": "only --methods",
    "bench none.json --steps 1:0.1": "only --methods",
    "bench missing.json": "cannot be read",
    f"{SPRING} --methods verlet,leapfrog": "there is no method `leapfrog`",
    f"{SPRING} --methods dop853": "`dop853` chooses its steps",
    f"{SPRING} --steps 0.1": "--steps 0.1: two different numbers",
    f"{SPRING} --steps 0:1": "--steps 0:1: steps are above 0",
    f"{SPRING} --steps nan:1": "two different numbers",
    f"{SPRING} --vary k": "--vary k : two different numbers",
    f"{SPRING} --vary m=1:2": "--vary m: the model has no such parameter",
    "stability springs.yaml --vary n=1:2": "members of families are counted or named",
    "stability springs.yaml --vary m(2)=1:2": (
        "--vary m(2): the model has no such",
        "its name outside of the file is `m.2`",
    ),
    f"{SPRING} --vary k=1:2 --vary k=2:3": "one parameter varies at a time",
    f"{SPRING} --vary step=1:2": "`step` cannot be varied: stability.csv has a column",
    f"{SPRING} --set l": "--set l: a name and an expression",
    "stability damped.yaml --methods verlet": (
        "`verlet` cannot handle this model: its forces depend"
    ),
    "stability timeless.yaml": "`stability` needs a duration",
    "stability contact.yaml": "constraints that hold at times",
    "derive swing.yaml --format maple": "maple",
    "derive swing.yaml --format python --gauss": "--gauss means nothing",
    "derive swing.yaml --format latex --ascii": "--ascii means nothing",
    "derive swing.yaml --set q_ddot=1": "q_ddot",
    "derive swing.yaml -o no/such/folder/file": "cannot be written",
    "derive swing.yaml -o .": "cannot be written",
    "derive swing.yaml -o swing.yaml": "it is the model",
    "run contact.yaml --method taylor": "`taylor` cannot",
    "run timeless.yaml -o out": ("`run` needs a duration", "--duration"),
    "run swing.yaml --table npz --resume": "--resume",
    "spectrum out x -o x.txt": "x.txt: no such format",
    "overlay one -o it.doc": "ends in .png, .svg, .pdf or .html",
    **{
        f"compare one two {option} {value}": f"{option} {value}: a number of at least 0"
        for option in ("--rtol", "--atol")
        for value in ("-1e-9", "nan", "inf", "small")
    },
    "compare good.csv missing.csv": "missing.csv",
    "compare good.csv folder": "folder",
    "methods rk44": "no method `rk44`",
    "methods auto": "no method `auto`",
    "methods ": ("no method ``", "one of dop853, "),
    "new": "NAME",
    "new mine --template pendulm": "pendulum",
    "new nowhere/mine": "nowhere/mine.yaml cannot be written: No such file",
    "new .yaml": "names no file",
    "new a\0b": "cannot be written",
    "run": "MODEL",
    "golden swing.yaml": (
        "there is no golden of swing in golden",
        "`lagsim golden --update",
    ),
    "golden swing.yaml --update --dir good.csv": (
        "the output folder good.csv is not a folder"
    ),
    "stability a.yaml b.yaml": "b.yaml",
    "run a.yaml --bogus": "--bogus",
    "simulate": "simulate",
    "run a.yaml --format gif": "png",
    "run a.yaml --error-bar sometimes": "sometimes",
}
# A name longer than any system takes, and a link to itself.
LINES |= {
    line.replace("PATH", path): path
    for path in ("x" * 300, "loop")
    for line in (
        "run PATH", "derive PATH", "run swing.yaml -o PATH", "spectrum PATH x",
        "derive swing.yaml --output PATH", "golden swing.yaml --dir PATH",
        "sweep swing.yaml g=1:2:2 -o PATH", "compare PATH good.csv",
    )
}  # fmt: skip
NO_JSON = ("derive", "new", "overlay")


@pytest.fixture
def files(write):
    """Write all files; give the names of what is there."""
    for name, text in FILES.items():
        write(text, name)
    for k, content in enumerate(TEXTS):
        Path(f"text-{k}.yaml").write_bytes(content)
    for k, (scene, key, value, _) in enumerate(POSED):
        text = scene.replace("simulation: {", f"simulation: {{{key}: {value}, ")
        write(text, f"posed-{k}.yaml")
    for k, text in enumerate(GARBLED):
        write(text, f"garbled-{k}.csv")
    Path("folder").mkdir()
    os.mkfifo("pipe.yaml")
    Path("loop").symlink_to("loop")
    return names(".")


@pytest.mark.parametrize("line", LINES)
def test_a_line_is_refused(lagsim, files, line):
    told, hint = LINES[line], ""
    if isinstance(told, tuple):
        told, hint = told
    words, command = line.split(" "), line.split(" ")[0]
    called = lagsim(*words, code=2)
    assert called.out == ""
    assert told in called.err
    assert "Traceback" not in called.err
    if command not in NO_JSON:
        as_json = lagsim(*words, "--json", code=2)
        assert as_json.err == ""
        for error in (found := as_json.json.pop("errors")):
            assert list(error) == KEYS
        assert any(told in f"{e['file']}:{e['line']}: {e['text']}" for e in found)
        if hint:
            assert hint in found[0]["hint"]
        elif command in ("run", "check") and "--set" in words:
            # Where there is no hint of its own, that of all such faults.
            assert found[0]["hint"] == errors()[found[0]["code"]].hint
        if "=" in words[-1] and command == "run" and words[-1].startswith("--"):
            assert found[0]["file"] == words[-1].replace("=", " ", 1)
            assert called.err.startswith(f"{found[0]['file']}:1:")
    if words[1:] in ([f"text-{k}.yaml"] for k in (2, 3, 6, 7)):
        places = {2: "1:7", 3: "1:1", 6: "1", 7: "2"}
        assert f"{words[1]}:{places[int(words[1][5])]}" in called.err
    if "posed" in line:
        scene, key, *_ = POSED[int(words[1][6:-5])]
        at = 1 + scene[: scene.index("simulation:")].count("\n")
        column = len(f"simulation: {{{key}: ") + 1
        assert called.err.startswith(f"{words[1]}:{at}:{column}: ")
    assert names(".") == files


@pytest.mark.parametrize("command", ["bench", "stability"])
def test_a_start_is_refused(lagsim, files, command):
    called = lagsim(command, "wrong.yaml", code=1)
    assert "constraint `path` has the residual 1" in called.err
    assert names(".") == files
