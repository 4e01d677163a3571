"""Folders prepared by somebody else: with pipes, links, modules and settings."""

import ast
import os
import subprocess
import sys
from pathlib import Path

import pytest

from lagsim.outputs.results import is_own
from tests.cli._results import contents, document, ended, manifest, names
from tests.small_scenes import CONTACT, PENDULUM
from tests.support import ROOT

pytestmark = pytest.mark.skipif(
    sys.platform == "win32", reason="no pipes that have names, no links without rights"
)


@pytest.mark.usefixtures("lagsim")
def test_what_a_shell_gives_as_a_file_is_read(write):
    line = f"{sys.executable} -m lagsim check -q <(cat {write(PENDULUM)})"
    run = subprocess.run(["bash", "-c", line], capture_output=True, text=True)
    assert (run.returncode, run.stderr) == (0, "")


def test_a_pipe_is_no_table_and_no_golden(lagsim, stored):
    model = stored
    lagsim("run", model, "-o", "out", "--no-plots")
    os.mkfifo("pipe.csv")
    called = lagsim("compare", "out/trajectory.csv", "pipe.csv")
    assert (called.code, called.reports("E602")) == (2, True)
    os.mkfifo("pipe.json")
    called = lagsim("bench", "pipe.json")
    assert (called.code, called.reports("E101")) == (2, True)
    for name, number in (("pendulum.csv", "E602"), ("pendulum.json", "E604")):
        kept = Path("golden", name).read_bytes()
        Path("golden", name).unlink()
        os.mkfifo(Path("golden", name))
        called = lagsim("golden", model)
        assert (called.code, called.reports(number)) == (2, True)
        Path("golden", name).unlink()
        Path("golden", name).write_bytes(kept)
    Path("out/run.json").unlink()
    os.mkfifo("out/run.json")
    assert lagsim("compare", "out", "out/trajectory.csv").code == 0
    called = lagsim("overlay", "out")
    assert (called.code, called.reports("E606")) == (2, True)
    assert lagsim("run", model, "-o", "out", "--no-plots").code == 0
    assert manifest("out")["complete"]


def test_a_golden_is_not_written_through_links(lagsim, write):
    Path("golden").mkdir()
    planted = [
        ".model.csv.part", ".lagsim-model.csv.part", ".lagsim-model.json.part",
        "model.csv", "model.json",
    ]  # fmt: skip
    for name in planted:
        Path("golden", name).symlink_to("../outside")
    assert lagsim("golden", write(PENDULUM), "--update").code == 0
    assert not Path("outside").exists()
    assert lagsim("golden", "model.yaml").code == 0
    assert names("golden") == [".model.csv.part", "model.csv", "model.json"]


@pytest.mark.parametrize("call", ["write", "fsync"])
def test_a_golden_is_replaced_whole_or_not_at_all(
    lagsim, write, stored, monkeypatch, call
):
    before = contents("golden")
    write(PENDULUM.replace("g: 9.8", "g: 1.6"), stored)

    def full(*_):
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(os, call, full)
        called = lagsim("golden", stored, "--update")
    assert called.code == 2
    assert called.reports("E701"), called.err
    assert contents("golden") == before


def test_no_name_can_put_something_into_a_golden(lagsim, write):
    model = write(f'name: "@0@"\n{PENDULUM}')
    assert lagsim("golden", model, "--update").code == 0
    found = document("golden/@0@.json")
    assert found["model"] == "@0@"
    assert next(iter(found["bounds"])) == "t"
    assert lagsim("golden", model).code == 0


def test_what_a_run_writes_is_known_as_its_own(lagsim, write):
    model = write(CONTACT + "output: {plots: [{x: t, y: y}]}\n")
    lagsim("run", model, "-o", "out", "--animate", code=0)
    written = set(manifest("out")["files"])
    assert {"animation.html", "events.csv", "plot_1.png"} < written
    assert all(is_own(name) for name in written - {"run.json"})
    lagsim("run", model, "-o", "out", "--no-plots", "--table", "npz", code=0)
    assert is_own("trajectory.npz")
    assert names("out") == ["events.csv", "run.json", "trajectory.npz"]


def prepared(folder):
    """Write files that Python and matplotlib look for in the working directory."""
    for name in ("typer", "numpy", "yaml", "matplotlib", "orjson", "multiprocessing"):
        Path(folder, f"{name}.py").write_text('print("a stranger was here")\n')


@pytest.mark.slow
@pytest.mark.usefixtures("lagsim")
def test_nothing_of_the_working_directory_is_read(write):
    model = write(PENDULUM)
    prepared(".")
    os.mkfifo("matplotlibrc")
    code, out, err = ended("run", model, "-o", "out", MPLBACKEND="nonsense")
    assert (code, err) == (0, "")
    assert "stranger" not in out
    assert "energy.png" in names("out")


@pytest.mark.slow
@pytest.mark.usefixtures("lagsim")
def test_processes_that_a_command_starts_read_nothing_there_either(write):
    models = [write(PENDULUM), write(f"name: other\n{PENDULUM}", "other.yaml")]
    prepared(".")
    code, out, err = ended("run", *models, "-j", "2", "--no-plots")
    assert (code, err) == (0, "")
    assert "stranger" not in out


@pytest.mark.slow
def test_matplotlib_is_loaded_with_nobodys_settings():
    first = "lagsim.outputs.bare_matplotlib"
    files = []
    for file in (ROOT / "lagsim").rglob("*.py"):
        body = ast.parse(file.read_text("utf-8")).body
        loaded = [
            alias.name if isinstance(node, ast.Import) else node.module or ""
            for node in body
            if isinstance(node, ast.Import | ast.ImportFrom)
            for alias in node.names
        ]
        of_it = [k for k, name in enumerate(loaded) if name.startswith("matplotlib")]
        if of_it:
            files.append(file)
            assert first in loaded[: of_it[0]], file
    assert len(files) > 3
