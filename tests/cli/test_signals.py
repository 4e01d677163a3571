"""Signals end every command at any moment, with whole files and the right code."""

import contextlib
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from lagsim.plan import plan as planning
from lagsim.run.interrupt import AGAIN_SECONDS, Interrupt, Terminated, noting
from tests.cli._results import contents, document, manifest, names, started
from tests.patience import PATIENCE, finished
from tests.small_scenes import ENDLESS, PENDULUM
from tests.support import ROOT

pytestmark = [
    pytest.mark.usefixtures("heeded_signals"),
    pytest.mark.skipif(sys.platform == "win32", reason="signals of another kind"),
]
KINDS = [signal.SIGINT, signal.SIGTERM]
RAISED = (KeyboardInterrupt, Terminated)


@pytest.mark.parametrize("kind", KINDS)
def test_a_second_signal_raises(kind):
    interrupt = Interrupt()
    with interrupt.noted():
        signal.raise_signal(kind)
        signal.raise_signal(kind)  # so soon after the first: `timeout` sends two
        assert interrupt.signal == kind
        time.sleep(2 * AGAIN_SECONDS)
        with pytest.raises(RAISED):
            signal.raise_signal(kind)
        assert noting()
    assert not noting()


@pytest.mark.parametrize("kind", KINDS)
def test_what_is_cut_ends_at_once_and_what_follows_goes_on(kind):
    interrupt, done = Interrupt(), []

    def work():
        done.append("begun")
        signal.raise_signal(kind)
        done.append("ended")

    with interrupt.noted():
        assert interrupt.cut(lambda: done.append("before"))
        assert not interrupt.cut(work)
        assert interrupt.signal == kind
        assert not interrupt.cut(work)
        with pytest.raises(RAISED), interrupt.raised():
            done.append("never")
    assert done == ["before", "begun"]


def test_an_interrupt_that_nobody_notes_is_not_swallowed():
    with pytest.raises(KeyboardInterrupt):
        Interrupt().cut(lambda: signal.raise_signal(signal.SIGINT))


@pytest.mark.parametrize("kind", KINDS)
def test_a_run_that_does_not_heed_the_first_ends_with_the_second(
    lagsim, write, at_rows, kind
):
    lagsim("run", write(PENDULUM), "-o", "out", "--no-plots")
    before = contents("out")

    def stuck(_rows):
        signal.raise_signal(kind)
        time.sleep(2 * AGAIN_SECONDS)
        signal.raise_signal(kind)
        pytest.fail("it went on")

    at_rows(stuck)
    lagsim(
        "run",
        write(ENDLESS, "endless.yaml"),
        "-o",
        "out",
        "--no-plots",
        code=128 + kind,
    )
    assert contents("out") == before


@pytest.mark.parametrize("kind", KINDS)
def test_a_signal_while_pictures_are_drawn_keeps_the_rows(
    lagsim, write, monkeypatch, kind
):
    from lagsim.outputs import plots

    def drawn(*_arguments, **_keywords):
        yield "energy.png", b"picture"
        signal.raise_signal(kind)
        pytest.fail("it went on")

    monkeypatch.setattr(plots, "pictures", drawn)
    called = lagsim("run", write(PENDULUM), "-o", "out", code=128 + kind)
    assert "interrupted" in called.err
    record = manifest("out")
    assert (record["outcome"], record["rows"]) == ("done", 21)
    assert record["files"] == ["trajectory.csv", "energy.png", "run.json"]
    assert names("out") == sorted(record["files"])


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(
    ("command", "name", "figure"),
    [
        ("bench", "work_precision", "work_precision"),
        ("stability", "stability", "stability_figure"),
    ],
)
def test_a_signal_while_a_chart_is_drawn_keeps_the_numbers(
    lagsim, write, monkeypatch, kind, command, name, figure
):
    def chart(*_arguments):
        signal.raise_signal(kind)
        pytest.fail("it went on")

    monkeypatch.setattr(f"lagsim.studies.bench.chart.{figure}", chart)
    short = PENDULUM.replace("duration: 2", "duration: 0.5")
    lagsim(command, write(short), "-o", "out", "--methods", "rk4", code=128 + kind)
    numbers, record = f"{name}.csv", f"{name}.json"
    assert names("out") == [numbers, record]
    assert document("out", record)["files"] == [numbers, record]


# Stands for what loses the exception of a signal, as a callback from C may.
DEAF = """
import sys, time
import lagsim.cli as cli

def deaf():
    print("begun", flush=True)
    while True:
        try:
            time.sleep(1000)
        except BaseException:
            pass

cli._application = deaf
sys.exit(cli.entry())
"""


@pytest.mark.parametrize("kind", KINDS)
def test_a_command_that_loses_its_signal_ends(kind):
    run = subprocess.Popen([sys.executable, "-c", DEAF], stdout=subprocess.PIPE)
    assert run.stdout is not None
    assert run.stdout.readline() == b"begun\n"
    run.send_signal(kind)
    finished(run)
    assert run.returncode == 128 + kind


# A signal raises anywhere, as in a `finally` or before a handle is known.
ENDS = """
import contextlib, os, pathlib, sys
from lagsim import files
from lagsim.outputs import results as module
from lagsim.run.interrupt import Terminated

folder = pathlib.Path(sys.argv[1])
theirs = {files.__file__, module.__file__, contextlib.__file__}
os.fsync = lambda handle: None  # thousands take a minute
close, twice = os.close, []

def closed(handle):
    try:
        close(handle)
    except OSError:
        twice.append(ends)
        raise

os.close = closed
left = ends = 0

def step(frame, event, argument):
    global left
    if frame.f_code.co_filename not in theirs:
        return None
    frame.f_trace_opcodes = True
    left -= event == "opcode"
    if left == 0:
        raise Terminated
    return step

while left <= 0:
    left = ends = ends + 1
    sys.settrace(step)
    try:
        with module.open_results(folder) as results:
            results.write("energy.png", b"1")
            results.commit(b"{}")
            module.write_atomically(folder / "events.csv", b"2")
    except Terminated:
        pass
    finally:
        sys.settrace(None)
    files.remove_passing()  # as every process does at its end
    assert [x.name for x in folder.glob(".*")] == [], ends
    assert not twice
print(ends)
"""


@pytest.mark.slow
def test_an_end_between_any_two_instructions_leaves_nothing(tmp_path):
    # By itself: the process of the tests has threads, and more to be traced.
    command = [sys.executable, "-c", ENDS, str(tmp_path)]
    done = subprocess.run(
        command, cwd=ROOT, capture_output=True, text=True, timeout=120 * PATIENCE
    )
    assert done.returncode == 0, done.stderr
    assert int(done.stdout) > 1000


@pytest.mark.slow
@pytest.mark.parametrize(
    ("command", "options"),
    [
        ("run", ["-o", "out"]), ("run", ["-o", "out", "--animate"]),
        ("bench", ["-o", "out"]), ("stability", ["-o", "out"]),
        ("golden", ["--update", "--dir", "out"]), ("derive", ["-o", "out/equations"]),
        ("check", []),
    ],
)  # fmt: skip
@pytest.mark.usefixtures("lagsim")
def test_a_signal_at_any_moment(write, command, options):
    model = write(PENDULUM)
    Path("out").mkdir()
    random_ = random.Random(command)
    for kind in 3 * KINDS:
        run = started(command, model, *options)
        time.sleep(random_.uniform(0.1, 1.5))
        run.send_signal(kind)
        _, err = finished(run)
        # Before the command has begun Python ends as a shell sees alike; interrupted in
        # the import of `site`, before any code of lagsim, it ends with 1.
        if kind == signal.SIGINT and b"init_import_site" in err:
            continue
        assert run.returncode in (0, 128 + kind, -kind), err
        if run.returncode != -kind:
            assert b"Traceback" not in err
        for path in Path("out").glob("*.json"):
            found = document(path)
            listed = found.get("files", [f"{path.stem}.csv", path.name])
            assert set(listed) <= {file.name for file in Path("out").iterdir()}
        assert list(Path("out").glob(".lagsim*")) == []


@pytest.mark.parametrize("kind", KINDS)
def test_a_signal_that_was_lost_before_is_noted(lagsim, write, monkeypatch, kind):
    """An exception raised in a finalizer, or in a callback from C, is discarded."""

    def lost(*arguments, **options):
        with contextlib.suppress(RAISED):
            signal.raise_signal(kind)
        return plan(*arguments, **options)

    plan = planning.make_plan
    monkeypatch.setattr(planning, "make_plan", lost)
    lagsim("run", write(ENDLESS), "--no-plots", "-o", "out", code=128 + kind)
    assert manifest("out")["outcome"] == "interrupted"
