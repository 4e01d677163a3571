"""`lagsim run` of several models: each as if it were run alone."""

import os
import signal
from pathlib import Path

import pytest

from tests.cli._results import manifest, names, started, table, waited
from tests.patience import finished
from tests.small_scenes import CAPTION, CONTACT, ENDLESS, FALL, PENDULUM


def named(name, text=PENDULUM):
    return f"name: {name}\n{text}"


@pytest.fixture
def three(write):
    """Return three models: two that run, and between them one with an invalid start."""
    for name, text in (("a", PENDULUM), ("b", CAPTION), ("c", CONTACT)):
        write(named(name, text), f"{name}.yaml")
    return "a.yaml", "b.yaml", "c.yaml"


@pytest.mark.slow
@pytest.mark.parametrize("jobs", [1, 2])
def test_each_gives_the_bytes_of_a_run_alone(lagsim, three, jobs):
    called = lagsim(
        "run", *three, "--no-plots", "-o", "all", "-j", jobs, code=1
    )  # the worst
    assert names("all") == ["a", "c"]
    assert called.err.startswith("b.yaml:\n  inadmissible: b: constraint `path`")
    head, _, *rows = called.out.splitlines()
    assert head == "done: 2 of 3 models, in all/NAME"
    assert [row.split()[:2] for row in rows] == [
        ["a", "done"], ["b", "inadmissible"], ["c", "done"],
    ]  # fmt: skip
    for name in ("a", "c"):
        assert lagsim("run", f"{name}.yaml", "--no-plots", "-o", "alone").code == 0
        for file in names("alone"):
            if file != "run.json":
                one, other = (Path(x) / file for x in ("alone", f"all/{name}"))
                assert one.read_bytes() == other.read_bytes()
        differing = {"timings", "versions"}  # these are of what is loaded
        one, other = manifest("alone"), manifest(f"all/{name}")
        assert {k for k in one if one[k] != other[k]} <= differing


def test_by_default_each_has_the_folder_of_its_name(lagsim, write):
    write(named("a"), "1.yaml"), write(named("b"), "2.yaml")
    lagsim(
        "run", "1.yaml", "2.yaml", "--no-plots", "-q", "-j", 1, code=0, out="", err=""
    )
    assert names("results") == ["a", "b"]


@pytest.mark.slow
def test_json_is_a_list_in_the_order_of_the_models(lagsim, three):
    called = lagsim("run", *three, "none.yaml", "--no-plots", "--json", "-j", 1, code=2)
    first, second, third, last = called.json
    assert (first["model"]["name"], third["model"]["name"]) == ("a", "c")
    assert first == manifest("results/a")
    assert second["admissible"] is False
    assert last["errors"][0]["file"] == "none.yaml"


@pytest.mark.slow
def test_a_run_that_cannot_finish_keeps_the_others(lagsim, write):
    write(named("a", FALL), "a.yaml"), write(named("b"), "b.yaml")
    called = lagsim("run", "a.yaml", "b.yaml", "--no-plots", "-j", 1, code=3)
    assert called.err.startswith("a.yaml:\n  lagsim: ")
    assert manifest("results/a")["outcome"] == "failed"
    assert manifest("results/b")["outcome"] == "done"


def test_a_fault_of_the_command_line_is_told_once(lagsim, three):
    called = lagsim("run", *three, "--set", "g", "--no-plots", code=2)
    assert called.err.count("a name and an expression are expected") == 1


@pytest.mark.parametrize("as_json", [False, True])
def test_two_of_one_name_are_refused_before_anything_runs(lagsim, write, as_json):
    (
        write(named("a"), "1.yaml"),
        write(named("b"), "2.yaml"),
        write(named("a"), "3.yaml"),
    )
    more = ["--json"] if as_json else []
    called = lagsim("run", "1.yaml", "2.yaml", "3.yaml", "--no-plots", *more, code=2)
    text = "1.yaml and 3.yaml have one name, `a`"
    assert text in (called.json["errors"][0]["text"] if as_json else called.err)
    assert not Path("results").exists()


@pytest.mark.slow
def test_an_unforeseen_fault_of_one_keeps_the_others(lagsim, three, at_rows):
    def fail(_rows):
        if not names("results/a"):
            return
        raise RuntimeError("unforeseen")

    at_rows(fail)
    called = lagsim("run", *three, "--no-plots", "-j", 1, code=70)
    assert called.reports("E901", "RuntimeError: unforeseen")
    assert "Traceback" not in called.err
    assert "--traceback" in called.err
    assert names("results") == ["a", "c"]  # the folder of the first stays empty
    assert names("results/a") == []
    assert manifest("results/c")["complete"]


@pytest.mark.usefixtures("heeded_signals")
def test_an_interrupt_ends_the_one_that_runs_and_begins_no_other(
    lagsim, write, at_rows
):
    at_rows(lambda _: signal.raise_signal(signal.SIGINT))
    write(named("a", ENDLESS), "a.yaml"), write(named("b"), "b.yaml")
    called = lagsim("run", "a.yaml", "b.yaml", "--no-plots", "-j", 1, code=130)
    assert manifest("results/a")["outcome"] == "interrupted"
    assert names("results") == ["a"]
    assert called.out.splitlines()[-1].split() == ["b", "not", "begun"]


@pytest.mark.slow
@pytest.mark.usefixtures("lagsim", "heeded_signals")
@pytest.mark.skipif(os.name == "nt", reason="pipes of another kind")
def test_what_a_model_prints_is_read_while_the_next_one_runs(write):
    write(named("a", CAPTION), "a.yaml"), write(named("b", ENDLESS), "b.yaml")
    run = started("run", "a.yaml", "b.yaml", "-j", "1", "--no-plots")
    part = Path("results", "b", ".lagsim-trajectory.csv.part")
    assert waited(lambda: part.exists() and part.stat().st_size > 1000)
    os.set_blocking(run.stderr.fileno(), False)
    assert run.stderr.read().startswith(b"a.yaml:\n  inadmissible: a: ")
    os.set_blocking(run.stderr.fileno(), True)
    run.send_signal(signal.SIGTERM)
    finished(run)


@pytest.mark.usefixtures("lagsim", "heeded_signals")
@pytest.mark.slow
@pytest.mark.parametrize("kind", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_all_processes_with_whole_files(write, kind):
    write(named("a", ENDLESS), "a.yaml"), write(named("b", ENDLESS), "b.yaml")
    run = started("run", "a.yaml", "b.yaml", "-j", "2", "--no-plots")
    parts = [Path("results", x, ".lagsim-trajectory.csv.part") for x in "ab"]
    assert waited(lambda: all(x.exists() and x.stat().st_size > 1000 for x in parts))
    run.send_signal(kind)
    _, err = finished(run)
    assert run.returncode == 128 + kind
    assert err.count(b"interrupted") == 2
    for name in "ab":
        folder = Path("results", name)
        assert names(folder) == ["run.json", "trajectory.csv"]
        assert len(table(folder)[1]) == manifest(folder)["rows"]
