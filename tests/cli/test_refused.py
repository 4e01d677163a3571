"""Refused command lines: exit 2, every fault with its place, no file written."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from lagsim.codes import errors
from lagsim.studies.sweep.grid import MOST_RUNS
from tests.cli._results import names
from tests.small_scenes import (
    CAPTION,
    CONTACT,
    ON_THE_CURVE,
    PENDULUM,
    TIMELESS,
    spring,
)

OSCILLATOR = spring(
    "duration: 10, output_step: 0.1", parameters="k: 4, step: 1, reason: 1"
)
FILES = {
    "swing.yaml": PENDULUM, "spring.yaml": OSCILLATOR,
    "springs.yaml": OSCILLATOR.replace("{k: 4", "{k: 4, n: 2, m(1..n): 1"),
    "damped.yaml": OSCILLATOR.replace("x^2/2}", "x^2/2, dissipation: x_dot^2/2}"),
    "timeless.yaml": TIMELESS, "contact.yaml": CONTACT, "wrong.yaml": CAPTION,
    "good.csv": "t,x\n0,1\n1,2\n", "torn.json": "{", "list.json": "[]",
    "rows.json": '{"rows": []}', "none.json": "{}",
}  # fmt: skip
KEYS = [
    "file", "line", "column", "length", "source", "code", "number", "text", "expected",
    "hint",
]  # fmt: skip
# Line -> the code of the message, then names and numbers that it has; `·` for a blank.
LINES: dict[str, str] = {}

# Files that are no models, and texts that are none.
UNREADABLE = ("none.yaml", "folder", "swing.yaml/x", "/dev/null", "pipe.yaml")
TEXTS = {
    b"": "empty-file",
    b"# only a comment\n": "empty-file",
    b"name: \xff\n": "not-utf8 0xff",
    b"\x00\x01\x02": "yaml-character U+0000",
    b"- 1\n- 2\n": "not-a-mapping",
    b"just a text": "not-a-mapping `just·a·text`",
    b"energy: {kinetic: (x": "yaml-syntax `{`",
    b"a: 1\n---\nb: 2\n": "several-documents",
}
LINES |= {
    f"{command} {file}": f"unreadable {file}"
    for file in UNREADABLE
    for command in ("run", "check", "derive", "golden", "bench", "stability")
}
LINES |= {f"check text-{k}.yaml": told for k, told in enumerate(TEXTS.values())}

# Key of `simulation`, its value; what is said of it, at its place.
ASKED = {
    ("method", "rk5"): "unknown-method `rk5` `rk4`",
    ("method", "RK45"): "unknown-method `RK45` `dopri5`",
    ("method", "ode15s"): "unknown-method `ode15s` `radau`",
    ("method", "foo"): "unknown-method `foo` auto dop853",
    ("method", "Generalized_Alpha"): "unknown-method `generalized-alpha`",
    ("formulation", "elimnation"): "unknown-formulation `elimnation`",
    ("formulation", "none"): "formulation-refused `none` `drift`",
    ("formulation", "velocity projection"): (
        "formulation-refused `velocity·projection` 1·of·1"
    ),
}  # fmt: skip
FREE = ("projection", "baumgarte", "elimination")
POSED = [
    *((ON_THE_CURVE, *asked, told) for asked, told in ASKED.items()),
    *((PENDULUM, "formulation", x, f"formulation-refused `{x}`") for x in FREE),
]
LINES |= {
    f"{command} posed-{k}.yaml": posed[-1]
    for k, posed in enumerate(POSED)
    for command in ("run", "check")
}

SETS = {
    "gg=1": "unknown-parameter `gg` `g`",
    "g=1+": "expression-syntax `+`",
    "g=1/0": "not-finite `g` inf",
    "g=2*zz": "unknown-name `zz` `parameters`",
    "g=": "expression-syntax",
    "g": "usage --set·g: --set·g=1.62",
    "=1": "usage --set·=1: --set·g=1.62",
    "g=1 --set g=2": "usage --set·g",
    "a.b=1": "unknown-parameter `a.b`",
    "theta_ddot=1": "unknown-parameter `theta_ddot`",
    "thta=1": "unknown-parameter `thta` `theta`",
    "theta=1/0": "not-finite `theta` inf",
}
LINES |= {
    f"{command} swing.yaml --set {text}": told
    for text, told in SETS.items()
    for command in ("run", "check")
}
OPTIONS = {
    "--rtol=x": "unknown-name `x`",
    "--rtol=1e-3*": "expression-syntax `*`",
    "--rtol=-1": "out-of-range `rtol` -1",
    "--rtol=0": "out-of-range `rtol` `atol`",
    "--atol=nan": "unknown-name `nan`",
    "--step=0": "out-of-range `step`",
    "--duration=0": "out-of-range `duration`",
    "--duration=1/0": "not-finite `duration` inf",
    "--output-step=3": "out-of-range `output_step`",
    "--output-step=1e-12": "too-many-rows `output_step` 2000000000001",
    "--method=nope": "unknown-method `nope` auto dop853",
}
LINES |= {f"run swing.yaml {option}": told for option, told in OPTIONS.items()}

GARBLED = {
    "": "",
    "1,2\n1,2\n": "line·1",
    "t,x\n0,1\n1,a\n": "line·3 x `a`",
    "x,y\n1,2\n": "line·1 `t`",
    "t,x\n0,1\n1,\n": "line·3 x",
    "t,x\n0,1\n\n1,2\n": "line·3",
    "t,x,x\n0,1,1\n": "line·1 `x`",
    "".join(map(chr, range(256))): "",
}
LINES |= {
    f"compare good.csv garbled-{k}.csv": f"bad-table garbled-{k}.csv: {told}"
    for k, told in enumerate(GARBLED.values())
}

PAIR = "--sample -N --seed"
SWEPT = {
    "": "usage NAME=A:B:N --points --sample",
    "g": "usage g: K=10,20",
    "=1,2": "usage =1,2: K=10,20",
    "g=1 g=2": "usage g",
    "g=1,2 theta=1 --set g=3": "usage g: --set",
    **{
        g: f"usage {g}: K=10:40:7" for g in ("g=1:2:1", "g=1:2", "g=1:2:x", "g=1:2:3:4")
    },
    "gg=1": "unknown-name `gg` `g`",
    "g=1,nothing": "unknown-name `nothing`",
    "g=1,": "expression-syntax",
    "g=1/0,1": "not-finite `g` inf",
    "g=0:1:123456789": f"usage 123456789 {MOST_RUNS}",
    "g=0:1:2000 l=0:1:2000": f"usage 4000000 {MOST_RUNS}",
    # All faults at once.
    "thetta=1 g=+": "unknown-name `thetta` `theta`",
    "theta=1 g=+": "expression-syntax",
    "L=1,2": "unknown-name `L` l,·g",
    "l=1+": "expression-syntax `+`",
    "l=1 --method no": "unknown-method `no`",
    "l=1 --ends --keep": "usage --ends --keep",
    "l=1 --ends --error-bar always": "usage --ends --error-bar",
    "l=1,2 -o good.csv": "output-folder good.csv",
    "l=1,2 -o good.csv/x": "output-folder good.csv/x",
    "g=1,2 --points p.csv": "usage NAME=A:B:N --points --sample",
    "--points none.csv": "bad-points none.csv:",
    "--sample g=normal(1,1)": f"usage {PAIR}",
    "g=1,2 -N 5": f"usage {PAIR}",
    "g=1,2 --seed 5": f"usage {PAIR}",
    "--sample g=normal(1) -N 2": "usage g=normal(1):",
    "--sample g=uniform(2,1) -N 2": "usage g=uniform(2,1):",
    "--sample g=normal(1,0) -N 2": "usage g=normal(1,0):",
    "--sample g=normal(1,1) --sample g=normal(1,1) -N 2": "usage g --sample",
    "--sample G=normal(1,1) -N 2": "unknown-name `G`",
    "--sample g=normal(1,1) -N 2000000": f"usage 2000000 {MOST_RUNS}",
}
LINES |= {f"sweep swing.yaml {words}".strip(): told for words, told in SWEPT.items()}
LINES["sweep spring.yaml reason=1,2"] = "usage `reason` sweep.csv"
SPRING, SWING = "stability spring.yaml", "bench swing.yaml"
LINES |= {
    f"{SWING} --methods dop853,dop54": "unknown-method `dop54`",
    f"{SWING} --methods scipy:Euler": "unknown-method `scipy:Euler`",
    f"{SWING} --tolerances 1e-3": "usage --tolerances·1e-3: --tolerances·1e-3:1e-9",
    f"{SWING} --tolerances 0:1e-3": "usage --tolerances·0:1e-3:",
    f"{SWING} --steps a:b": "usage --steps·a:b:",
    f"{SWING} --budget 0": "usage --budget·0:",
    f"{SWING} --set l": "usage --set·l:",
    "bench timeless.yaml": "missing-key `bench` `simulation.duration`",
    "bench torn.json": "not-json torn.json:",
    "bench list.json": "not-a-bench list.json `lagsim`",
    "bench rows.json": "not-a-bench rows.json `lagsim`",
    "bench none.json --set g=1": "usage none.json --methods",
    "bench none.json --steps 1:0.1": "usage none.json --methods",
    "bench missing.json": "unreadable missing.json",
    f"{SPRING} --methods verlet,leapfrog": "unknown-method `leapfrog`",
    f"{SPRING} --methods dop853": "adaptive-method `dop853`",
    f"{SPRING} --steps 0.1": "usage --steps·0.1:",
    f"{SPRING} --steps 0:1": "usage --steps·0:1:",
    f"{SPRING} --steps nan:1": "usage --steps·nan:1:",
    f"{SPRING} --vary k": "usage --vary·k",
    f"{SPRING} --vary m=1:2": "unknown-parameter --vary·m:",
    "stability springs.yaml --vary n=1:2": "usage --vary·n: --set·n=3",
    "stability springs.yaml --vary m(2)=1:2": "unknown-parameter --vary·m(2): `m.2`",
    f"{SPRING} --vary k=1:2 --vary k=2:3": "usage --vary",
    f"{SPRING} --vary step=1:2": "usage `step` stability.csv",
    f"{SPRING} --set l": "usage --set·l:",
    "stability damped.yaml --methods verlet": "method-refused `verlet`",
    "stability timeless.yaml": "missing-key `stability` `simulation.duration`",
    "stability contact.yaml": "no-stability",
    "derive swing.yaml --format maple": "usage 'maple' 'latex'",
    "derive swing.yaml --format python --gauss": "usage --gauss python",
    "derive swing.yaml --format latex --ascii": "usage --ascii latex",
    "derive swing.yaml --set q_ddot=1": "unknown-parameter `q_ddot`",
    "derive swing.yaml -o no/such/folder/file": "output-file no/such/folder/file",
    "derive swing.yaml -o .": "output-file",
    "derive swing.yaml -o swing.yaml": "output-file swing.yaml",
    "run contact.yaml --method taylor": "method-refused `taylor`",
    "run timeless.yaml -o out": "missing-key `run` --duration",
    "run swing.yaml --table npz --resume": "usage --resume --table",
    "spectrum out x -o x.txt": "usage x.txt:",
    "overlay one -o it.doc": "usage it.doc: .png .svg .pdf .html",
    **{
        f"compare one two {option} {value}": f"usage {option}·{value}:"
        for option in ("--rtol", "--atol")
        for value in ("-1e-9", "nan", "inf", "small")
    },
    "compare good.csv missing.csv": "bad-table missing.csv",
    "compare good.csv folder": "bad-table folder",
    "methods rk44": "unknown-method `rk44`",
    "methods auto": "unknown-method `auto`",
    "methods ": "unknown-method `` dop853",
    "new": "usage 'NAME'",
    "new mine --template pendulm": "unknown-template `pendulm` pendulum",
    "new nowhere/mine": "unwritable nowhere/mine.yaml",
    "new .yaml": "usage `.yaml`",
    "new a\0b": "unwritable",
    "run": "usage 'MODEL...'",
    "golden swing.yaml": "no-golden swing --update",
    "golden swing.yaml --update --dir good.csv": "output-folder good.csv",
    "stability a.yaml b.yaml": "usage b.yaml",
    "run a.yaml --bogus": "usage --bogus",
    "simulate": "usage 'simulate'",
    "run a.yaml --format gif": "usage 'gif' 'png'",
    "run a.yaml --error-bar sometimes": "usage 'sometimes' 'never'",
}
# A name longer than any system takes, and a link to itself.
LINES |= {
    line.replace("PATH", path): f"{code} {path}"
    for line, codes in {
        "run PATH": "unreadable unreadable",
        "derive PATH": "unreadable unreadable",
        "run swing.yaml -o PATH": "output-folder output-folder",
        "spectrum PATH x": "usage bad-table",
        "derive swing.yaml --output PATH": "usage usage",
        "golden swing.yaml --dir PATH": "bad-golden usage",
        "sweep swing.yaml g=1:2:2 -o PATH": "output-folder output-folder",
        "compare PATH good.csv": "usage bad-table",
    }.items()
    for path, code in zip(("x" * 300, "loop"), codes.split(), strict=True)
}
NO_JSON = ("derive", "new", "overlay")


@pytest.fixture
def files(write):
    """Write all files; return the names in the folder."""
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
    code, *told = LINES[line].split()
    told = [name.replace("·", " ") for name in told]
    words, command = line.split(" "), line.split(" ")[0]
    called = lagsim(*words, code=2)
    assert called.out == ""
    assert f"[{errors()[code].number}]" in called.err
    assert all(name in called.err for name in told)
    assert "Traceback" not in called.err
    if command not in NO_JSON:
        as_json = lagsim(*words, "--json", code=2)
        assert as_json.err == ""
        for error in (found := as_json.json.pop("errors")):
            assert list(error) == KEYS
        assert all(error["hint"] for error in found)
        [one, *_] = [error for error in found if error["code"] == code]
        said = f"{one['file']}: {one['text']} {one['hint']}"
        assert all(name in said for name in told)
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


@pytest.mark.slow
@pytest.mark.parametrize("command", ["bench", "stability"])
def test_a_start_is_refused(lagsim, files, command):
    called = lagsim(command, "wrong.yaml", code=1)
    assert called.reports("E301", "`path`", " 1")
    assert names(".") == files
