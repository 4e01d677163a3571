"""The Python interface: its page, its bytes, its faults, and its imports."""

import doctest
import json
import re
import shutil
import subprocess
import sys

import matplotlib as mpl  # noqa: F401 -- run.json lists it once it has been imported
import numpy as np
import pytest

import lagsim
from tests.cli.conftest import lagsim as command  # noqa: F401
from tests.small_scenes import escape
from tests.support import MODELS, ROOT

PAGE = (ROOT / "docs" / "python.md").read_text(encoding="utf-8")
EXAMPLES = re.findall(r"```pycon\n(.*?)```", PAGE, re.DOTALL)


@pytest.fixture
def models(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "models").mkdir()
    for name in ("bouncing-ball", "elastic-pendulum", "pendulum-cartesian"):
        shutil.copy(MODELS / f"{name}.yaml", tmp_path / "models")
    return tmp_path


@pytest.mark.slow
@pytest.mark.usefixtures("models")
def test_the_page_says_what_happens():
    parser, runner = doctest.DocTestParser(), doctest.DocTestRunner()
    test = parser.get_doctest("\n".join(EXAMPLES), {}, "docs/python.md", None, 0)
    assert len(test.examples) > 20
    told = []
    runner.run(test, out=told.append)
    assert runner.failures == 0, "".join(told)


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", ["elastic-pendulum", pytest.param("bouncing-ball", marks=pytest.mark.slow)]
)
def test_a_result_is_written_as_the_command_writes_it(models, command, capsys, name):  # noqa: F811
    path = f"models/{name}.yaml"
    assert command("run", path, "-o", "run", "--duration", "2").code == 0
    capsys.readouterr()
    result = lagsim.simulate(lagsim.load(path), duration=2)
    result.write("python")
    assert capsys.readouterr() == ("", "")
    ours, theirs = (
        {p.name: p.read_bytes() for p in (models / folder).iterdir()}
        for folder in ("python", "run")
    )
    documents = [json.loads(found.pop("run.json")) for found in (ours, theirs)]
    assert ours == theirs
    for document in documents:
        del document["timings"]
    assert documents[0] == documents[1]
    header, *rows = ours["trajectory.csv"].decode().split("\r\n")
    assert tuple(header.split(",")) == result.columns
    read = np.array([row.split(",") for row in rows[:-1]], dtype=float)
    assert np.array_equal(read, result.table)


def test_nothing_is_written_unless_asked(models):
    lagsim.simulate(lagsim.load("models/elastic-pendulum.yaml"), duration=1)
    assert [path.name for path in models.iterdir()] == ["models"]


FALL = """
parameters: {h: 2.5, g: 10}
coordinates: {y: {}}
energy: {kinetic: y_dot^2/2, potential: g*y}
initial: {y: h}
simulation: {duration: 5, until: "y = 0"}
"""


def test_other_values_by_their_names():
    # From rest at h: y = h - g t^2/2; and up at v first: (v + sqrt(v^2 + 2 g h))/g.
    plain = lagsim.simulate(lagsim.load(FALL))
    assert plain.outcome == "until"
    assert plain.t[-1] == pytest.approx(0.5**0.5, rel=1e-12)
    assert [event.kind for event in plain.events] == ["until"]
    higher = lagsim.simulate(lagsim.load(FALL, h="4*5"))
    assert higher.t[-1] == pytest.approx(2.0, rel=1e-12)
    up = lagsim.simulate(lagsim.load(FALL).bind(g=4, h=0.5, y_dot="3*h"))
    assert up.t[-1] == pytest.approx((1.5 + 6.25**0.5) / 4, rel=1e-12)


def test_names_that_are_none_are_told():
    with pytest.raises(lagsim.InputError) as told:
        lagsim.load(FALL, height=3)
    assert "height" in str(told.value)
    with pytest.raises(KeyError, match="theta"):
        lagsim.simulate(lagsim.load(FALL))["theta"]
    with pytest.raises(lagsim.InputError) as told:
        lagsim.simulate(lagsim.load(FALL), method="rk5")
    assert [p.code for p in told.value.problems] == ["unknown-method"]


def test_a_duration_is_asked_for():
    timeless = lagsim.load(
        FALL.replace('simulation: {duration: 5, until: "y = 0"}', "")
    )
    with pytest.raises(lagsim.InputError) as told:
        lagsim.simulate(timeless)
    [problem] = told.value.problems
    assert (problem.code, problem.file) == ("missing-key", None)
    assert "`duration`" in problem.hint
    assert lagsim.simulate(timeless, duration=0.5).t[-1] == 0.5


def test_a_run_that_cannot_finish_returns_what_it_has():
    result = lagsim.simulate(escape("duration: 2, output_step: 0.05"))
    assert (result.outcome, result.complete) == ("failed", False)
    assert result.reason
    assert result.t[-1] == pytest.approx(1.0, abs=1e-6)
    early = result.t < 0.9
    assert result["x"][early] == pytest.approx(1 / (1 - result.t[early]), rel=1e-7)
    assert result.record["complete"] is False


def test_importing_it_loads_nothing_heavy():
    heavy = ("numpy", "yaml", "llvmlite", "typer", "scipy", "sympy", "matplotlib")
    code = f"import sys, lagsim; print([m for m in {heavy} if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.stdout == "[]\n"
