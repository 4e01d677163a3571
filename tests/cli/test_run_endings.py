"""Runs that end early, and the files that they leave."""

import math
import os
import resource
import signal
import subprocess
import time
from contextlib import contextmanager
from pathlib import Path

import pytest

from lagsim.outputs.results import Results
from tests.cli._results import manifest, names, started, table, waited
from tests.patience import PATIENCE, finished
from tests.small_scenes import CAPTION, ENDLESS, FALL, PENDULUM

pytestmark = pytest.mark.usefixtures("heeded_signals")


def test_a_failed_integration_keeps_what_was_computed(lagsim, write, monkeypatch):
    from lagsim.outputs import plots

    notes = []

    def noted(record, *_arguments, **_keywords):
        notes.append(record.note)
        yield "energy.png", b"picture"

    monkeypatch.setattr(plots, "pictures", noted)
    called = lagsim("run", write(FALL), "-o", "out", code=3)
    assert called.err.startswith("lagsim: ")
    assert "r_dot" in called.err  # the component that grows
    assert called.out.startswith("failed: model, t = 0 to 1.1107")
    document = manifest("out")
    assert (document["outcome"], document["complete"]) == ("failed", False)
    assert document["end"] == pytest.approx(math.pi / 2**1.5, abs=1e-6)
    _, rows = table("out")
    assert len(rows) == document["rows"] >= 112
    assert rows[-1, 0] == document["end"]
    assert notes == [f"incomplete: {document['reason']}"]
    assert names("out") == ["energy.png", "run.json", "trajectory.csv"]
    quiet = lagsim("run", "model.yaml", "--no-plots", "-q", code=3, out="")
    assert quiet.err == called.err


@pytest.mark.parametrize("kind", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupted_run_keeps_what_was_computed(lagsim, write, at_rows, kind):
    blocks = []

    def interrupt(rows):
        before = sum(blocks)
        blocks.append(len(rows))
        if before < 300 <= sum(blocks):
            signal.raise_signal(kind)

    at_rows(interrupt)
    before = signal.getsignal(kind)
    called = lagsim("run", write(ENDLESS), "--no-plots", "-o", "out", code=128 + kind)
    assert "interrupted" in called.err
    assert signal.getsignal(kind) is before
    document = manifest("out")
    assert (document["outcome"], document["complete"]) == ("interrupted", False)
    _, rows = table("out")
    assert len(rows) == document["rows"] >= 300
    assert rows[-1, 0] == document["end"] < 1e7
    assert names("out") == ["run.json", "trajectory.csv"]


@pytest.mark.parametrize("kind", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupt_before_the_run_leaves_nothing(lagsim, write, monkeypatch, kind):
    monkeypatch.setattr(
        "lagsim.plan.plan.make_plan", lambda *_: signal.raise_signal(kind)
    )
    lagsim("run", write(PENDULUM), "-o", "out", code=128 + kind, out="")
    assert names(".") == ["model.yaml"]


def writing(*words, before=()):
    """Start a run, and wait until it has written rows to `out`."""
    run = started("run", *words, "-o", "out", "--no-plots", before=before)
    parts = Path("out")
    if not waited(lambda: any(p.stat().st_size > 10_000 for p in parts.glob(".*csv*"))):
        run.kill()
        pytest.fail(f"no rows: {run.communicate()}")
    return run


@pytest.mark.slow
@pytest.mark.parametrize("kind", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_from_outside(lagsim, write, kind):
    lagsim("run", write(PENDULUM), "-o", "out", "--no-plots")
    run = writing(write(ENDLESS, "endless.yaml"))
    other = lagsim("run", "model.yaml", "-o", "out", "--no-plots", code=2, out="")
    assert "another run" in other.err
    run.send_signal(kind)
    _, err = finished(run)
    assert run.returncode == 128 + kind
    assert b"interrupted" in err
    document = manifest("out")
    assert document["model"]["file"] == "endless.yaml"
    assert table("out")[1][-1, 0] == document["end"]
    assert names("out") == ["run.json", "trajectory.csv"]


def test_an_ignored_signal_stays_ignored(lagsim, write, at_rows):
    blocks = []

    def interrupt(rows):
        blocks.append(rows)
        if kind := {2: signal.SIGINT, 4: signal.SIGTERM}.get(len(blocks)):
            signal.raise_signal(kind)

    at_rows(interrupt)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    lagsim("run", write(ENDLESS), "--no-plots", "-o", "out", code=128 + signal.SIGTERM)
    assert len(blocks) >= 4
    assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    assert lagsim("methods").code == 0
    assert signal.getsignal(signal.SIGTERM) is signal.SIG_IGN


@pytest.mark.slow
@pytest.mark.usefixtures("lagsim")
def test_a_run_under_a_parent_that_ignores_an_interrupt(write):
    model = write(ENDLESS)
    run = writing(model, before=["sh", "-c", "trap '' INT; exec \"$@\"", "sh"])
    [part] = Path("out").glob(".*csv*")
    run.send_signal(signal.SIGINT)
    size = part.stat().st_size
    # It goes on writing, several blocks more.
    assert waited(lambda: part.stat().st_size > size + 100_000)
    assert run.poll() is None
    run.send_signal(signal.SIGTERM)
    _, err = finished(run)
    assert run.returncode == 128 + signal.SIGTERM
    assert b"interrupted" in err


@contextmanager
def small_disk():
    """Context manager: no file grows beyond 200 kB (EFBIG, as ENOSPC).

    The limit ends with the context, since coverage writes files between tests.
    """
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (200_000, before[1]))
    yield
    resource.setrlimit(resource.RLIMIT_FSIZE, before)


def test_a_table_that_does_not_fit(lagsim, write):
    began = time.process_time()
    model = write(ENDLESS)
    with small_disk():
        called = lagsim("run", model, "-o", "out")
    # Not the whole motion for nothing.
    assert time.process_time() - began < 30 * PATIENCE
    assert called.code == 3
    assert called.reports("E705", "t = ")
    document = manifest("out")
    assert (document["outcome"], document["complete"]) == ("failed", False)
    _, rows = table("out")
    assert len(rows) == document["rows"] > 1000
    assert rows[-1, 0] == document["end"]
    assert 190_000 < Path("out/trajectory.csv").stat().st_size <= 200_000
    assert names("out") == ["run.json", "trajectory.csv"]
    with small_disk():
        lagsim("run", "model.yaml", "-o", "out", "--json", "-q", code=3)


def full(*_):
    raise OSError(28, "No space left on device")


def test_a_picture_that_does_not_fit(lagsim, write, monkeypatch):
    monkeypatch.setattr(Results, "write", full)
    called = lagsim("run", write(PENDULUM), "-o", "out", code=3)
    assert called.reports("E705", "No space left")
    document = manifest("out")
    assert (document["outcome"], document["complete"]) == ("failed", False)
    assert document["files"] == names("out")[::-1] == ["trajectory.csv", "run.json"]
    assert len(table("out")[1]) == document["rows"] == 21


def test_results_that_cannot_be_put_in_their_places(lagsim, write, monkeypatch):
    lagsim("run", write(PENDULUM), "-o", "out", "--no-plots")
    before = Path("out/run.json").read_bytes()

    monkeypatch.setattr(Results, "commit", full)
    called = lagsim("run", "model.yaml", "-o", "out", "--no-plots", code=3, out="")
    told = "lagsim: out cannot be written: No space left on device [E705]\n"
    assert called.err.startswith(told)
    assert Path("out/run.json").read_bytes() == before
    assert names("out") == ["run.json", "trajectory.csv"]


@pytest.mark.skipif(
    not hasattr(os, "geteuid") or os.geteuid() != 0, reason="only root may mount"
)
@pytest.mark.slow
def test_a_disk_that_fills_up(lagsim, write, tmp_path):
    disk = tmp_path / "disk"
    disk.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=1m", "tmpfs", str(disk)]
    if subprocess.run(mount, capture_output=True).returncode:
        pytest.skip("mounting is not allowed here")
    try:
        # A run that may end long before its time is begun, however large its table.
        maybe = ENDLESS.replace("_step: 1", "_step: 1, until: theta >= 9")
        called = lagsim("run", write(maybe), "-o", "disk/out", code=3)
        assert called.reports("E705")
        document = manifest("disk/out")
        _, rows = table("disk/out")
        assert len(rows) == document["rows"]
        assert rows[-1, 0] == document["end"]
        assert names("disk/out") == ["run.json", "trajectory.csv"]
        before = Path("disk/out/run.json").read_bytes()
        called = lagsim("run", "model.yaml", "-o", "disk/out", code=2)
        assert called.reports("E701", "disk/out")
        assert Path("disk/out/run.json").read_bytes() == before
    finally:
        subprocess.run(["umount", str(disk)], check=True)


UNUSABLE = {
    "a file": ("file", "is not a folder"),
    "a file on the way": ("file/out", "cannot be written: Not a directory"),
    "a place where nothing can be made": ("/proc/out", "cannot be written"),
    "a folder named like a result": ("taken", "has a folder where trajectory.csv"),
    "a folder named run.json": ("kept", "has a folder where run.json"),
}


@pytest.mark.parametrize(("folder", "told"), UNUSABLE.values(), ids=UNUSABLE)
def test_an_output_folder_that_is_unusable(lagsim, write, folder, told):
    Path("file").write_text("mine")
    Path("taken/trajectory.csv").mkdir(parents=True)
    Path("kept/run.json").mkdir(parents=True)
    called = lagsim("run", write(PENDULUM), "-o", folder, "--no-plots", code=2, out="")
    assert f"the output folder {folder} {told}" in called.err
    assert Path("file").read_text() == "mine"
    assert names("taken") == ["trajectory.csv"]
    assert names("kept") == ["run.json"]
    [error] = lagsim("run", "model.yaml", "-o", folder, "--json").json["errors"]
    assert (error["code"], error["file"]) == ("output-folder", None)


@pytest.mark.skipif(
    not hasattr(os, "geteuid") or os.geteuid() == 0, reason="root may write anywhere"
)
def test_a_folder_without_permission(lagsim, write):
    Path("out").mkdir(mode=0o500)
    called = lagsim("run", write(PENDULUM), "-o", "out", code=2)
    assert called.reports("E701")


def test_a_run_replaces_its_own_files_only(lagsim, write):
    Path("out").mkdir()
    Path("out/notes.txt").write_text("mine")
    Path("out/constraint_forces.png").write_text("mine too")
    write(PENDULUM)
    assert lagsim("run", "model.yaml", "-o", "out").code == 0
    assert "energy.png" in names("out")
    assert lagsim("run", "model.yaml", "-o", "out", "--no-plots").code == 0
    assert names("out") == [
        "constraint_forces.png", "notes.txt", "run.json", "trajectory.csv",
    ]  # fmt: skip
    assert Path("out/notes.txt").read_text() == "mine"
    assert Path("out/constraint_forces.png").read_text() == "mine too"


def test_a_refused_run_changes_nothing(lagsim, write):
    lagsim("run", write(PENDULUM), "-o", "out", "--no-plots")
    before = {p: (p.read_bytes(), p.stat().st_mtime_ns) for p in Path("out").iterdir()}
    refused = {
        1: write(CAPTION, "inadmissible.yaml"),
        2: write(PENDULUM.replace("theta_dot", "phi_dot"), "unusable.yaml"),
    }
    for code, model in refused.items():
        assert lagsim("run", model, "-o", "out").code == code
    assert lagsim("run", "model.yaml", "-o", "out", "--method", "none").code == 2
    after = {p: (p.read_bytes(), p.stat().st_mtime_ns) for p in Path("out").iterdir()}
    assert after == before
