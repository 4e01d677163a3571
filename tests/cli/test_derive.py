"""`lagsim derive` as it is typed."""

import json
import os
import subprocess
import sys
import time

import pytest

from tests.cli._results import ended
from tests.show.latex_checker import check
from tests.support import MODELS

ELASTIC = str(MODELS / "elastic-pendulum.yaml")


def text_of(done):
    assert (done.code, done.err) == (0, "")
    return done.out


@pytest.mark.slow
def test_text_and_ascii(lagsim):
    text = text_of(lagsim("derive", ELASTIC))
    assert "M (l + u)² θ̈ + 2 M (l + u) θ̇ u̇ + M g (l + u) sin(θ) = 0" in text
    plain = text_of(lagsim("derive", ELASTIC, "--ascii"))
    assert plain.isascii()
    assert "M*(l + u)^2*theta_ddot + 2*M*(l + u)*theta_dot*u_dot" in plain


def test_formats_into_files(lagsim, tmp_path):
    for name, begun in ((".lagsim-1.new", 0), (".lagsim-2.new", time.time())):
        (tmp_path / name).touch()  # of a run that was killed, and of one that goes on
        os.utime(tmp_path / name, (begun, begun))
    for form, option in (("latex", "--gauss"), ("json", "--solve")):
        target = tmp_path / form
        done = lagsim("derive", ELASTIC, "--format", form, option, "-o", target)
        assert text_of(done) == ""
        content = target.read_text(encoding="utf-8")
        if form == "latex":
            check(content)
        else:
            document = json.loads(content)
            assert document["coordinates"] == ["theta", "u"]
            assert document["accelerations"]["q_ddot"][1].startswith(
                "(l + u)*theta_dot^2"
            )
    found = sorted(p.name for p in tmp_path.iterdir())
    assert found == [".lagsim-2.new", "json", "latex"]


@pytest.mark.slow
def test_python_stands_alone_and_needs_no_sympy(tmp_path):
    target = tmp_path / "equations.py"
    code = (
        "import sys; from lagsim.cli import main; "
        f"sys.argv[1:] = ['derive', {ELASTIC!r}, '--format', 'python', '-o'];"
        f"sys.argv.append({str(target)!r});"
        "code = main(); print('sympy' in sys.modules); sys.exit(code)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (0, "False\n")
    code = (
        "import sys, equations as e; "
        "print(e.mass_matrix(0, [0.1, 0.5], [0, 0]).tolist(), e.COORDINATES, "
        "any(m.startswith(('lagsim', 'sympy', 'scipy')) for m in sys.modules))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        cwd=tmp_path,
        env={k: v for k, v in os.environ.items() if k != "PYTHONPATH"},
    )
    assert done.stdout == "[[2.25, 0.0], [0.0, 1.0]] ('theta', 'u') False\n", (
        done.stderr
    )


# Run by itself: reads trajectory.csv and the module beside it, with numpy only.
BALANCE = """
import csv, runpy, sys
import numpy as np

e = runpy.run_path("equations.py")
with open("out/trajectory.csv") as file:
    rows = [{k: float(x) for k, x in row.items()} for row in csv.DictReader(file)]
worst = 0.0


def part(off, size):
    return np.max(np.abs(off), initial=0.0) / (np.max(size, initial=0.0) or 1.0)


for row in rows:
    q, v, a = (
        np.array([row[name + end] for name in e["COORDINATES"]])
        for end in ("", "_dot", "_ddot")
    )
    lam = np.array([row["lambda_" + name] for name in e["CONSTRAINTS"]])
    functions = ("mass_matrix", "force", "constraint_matrix", "constraint_rhs")
    M, f, A, b = (e[name](row["t"], q, v) for name in functions)
    size = np.abs(M) @ np.abs(a) + np.abs(f) + np.abs(A.T) @ np.abs(lam)
    worst = max(worst, part(M @ a - f - A.T @ lam, size))
    worst = max(worst, part(A @ a - b, np.abs(A) @ np.abs(a) + np.abs(b)))
    Qc = np.array([row.get("Qc_" + name, 0.0) for name in e["COORDINATES"]])
    worst = max(worst, part(A.T @ lam - Qc, np.abs(A.T) @ np.abs(lam)))
others = [m for m in sys.modules if m.startswith(("lagsim", "sympy", "scipy"))]
print(len(rows), worst, others)
"""


@pytest.mark.parametrize(
    "name",
    [
        "elastic-pendulum-steered",
        *(
            pytest.param(name, marks=pytest.mark.slow)
            for name in (
                "andrews", "appell-hamel", "bead-hoop-cartesian", "car-axis",
                "chain-cartesian", "charged-particle", "double-pendulum",
                "elastic-pendulum-forced", "heavy-top", "moving-pivot",
                "rolling-disk",
            )
        ),
    ],
)  # fmt: skip
def test_the_module_alone_balances_the_rows_of_a_run(lagsim, name, tmp_path):
    model = MODELS / f"{name}.yaml"
    short = ("--duration", "0.02", "--output-step", "0.002", "--no-plots", "-o", "out")
    assert lagsim("run", model, *short, "-q").code == 0
    text_of(lagsim("derive", model, "--format", "python", "-o", "equations.py"))
    done = subprocess.run(
        [sys.executable, "-I", "-c", BALANCE],
        capture_output=True,
        text=True,
        cwd=tmp_path,
    )
    assert done.stderr == ""
    rows, worst, others = done.stdout.split(maxsplit=2)
    assert (int(rows), others) == (11, "[]\n")
    # Two evaluations of the same formulas, and the backward error of a small solve.
    assert float(worst) < 1e-11


def test_set_changes_the_numbers_that_are_put_in(lagsim):
    text = text_of(lagsim("derive", ELASTIC, "--set", "g=1.62", "--substitute"))
    assert "1.62 cos(θ)" in text
    module = text_of(lagsim("derive", ELASTIC, "--set", "g=1.62", "--format", "python"))
    assert '"g": 1.62,' in module


def test_standard_input(lagsim, monkeypatch):
    with open(ELASTIC, encoding="utf-8") as file:  # noqa: PTH123
        monkeypatch.setattr(sys, "stdin", file)
        assert "Equation of θ" in text_of(lagsim("derive", "-"))


def test_what_is_no_file_is_not_replaced(lagsim):
    assert (
        text_of(lagsim("derive", ELASTIC, "--format", "python", "-o", os.devnull)) == ""
    )
    assert not os.path.isfile(os.devnull)  # noqa: PTH113


@pytest.mark.parametrize(
    ("potential", "options"),
    [
        ("x*log(0)", ()), ("0^x", ()), ("x/a", ("--substitute",)), ("sqrt(-1)*x", ()),
        ("min(x, (-8)^(1/3))", ()), ("if(1/0 < x, 0, x)", ()),
        ("if(sqrt(-1) < 1, 0, x)", ()),
    ],
)  # fmt: skip
@pytest.mark.parametrize("form", ["text", "latex"])
def test_what_is_not_finite_is_told(lagsim, write, potential, options, form):
    text = f"""
parameters: {{a: 0}}
coordinates: {{x: {{}}}}
energy: {{kinetic: x_dot^2/2, potential: "{potential}"}}
initial: {{x: 1}}
"""
    done = lagsim("derive", write(text), "--format", form, *options, code=2, out="")
    assert "not finite" in done.err


def test_faults_are_json_where_json_is_asked_for(lagsim):
    done = lagsim("derive", "no-such-file.yaml", "--format", "json", code=2)
    (problem,) = done.json["errors"]
    assert problem["code"] == "unreadable"


@pytest.mark.slow
def test_letters_that_the_terminal_does_not_know():
    code, out, _ = ended("derive", ELASTIC, PYTHONIOENCODING="ascii")
    assert code == 0
    assert "sin(\\u03b8)" in out
