"""`run --resume`: a continued run has the bytes of an uninterrupted one."""

import hmac
import importlib
import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from lagsim.cli import run
from lagsim.native.link import cache
from lagsim.outputs.results import LOCK
from lagsim.program import pace
from lagsim.studies import restart
from tests.cli._results import manifest
from tests.support import MODELS

pytestmark = [
    pytest.mark.skipif(os.name == "nt", reason="processes are killed"),
    pytest.mark.usefixtures("heeded_signals"),
]

# Keeps the run between any two calls of its kernels, which are short, and after some of
# these kills itself.
KILLED = """
import os, sys
from lagsim.cli import main, run
from lagsim.program import pace
from lagsim.studies import restart
run.KEPT_AFTER_SECONDS = restart.EVERY_SECONDS = 0.0
restart.MOST_OF_THE_TIME = 1e9
pace.MOST = 16
left, kind = int(sys.argv.pop(1)), int(sys.argv.pop(1))
keep = restart.Restart._store_run
def kept(self, *given):
    global left
    keep(self, *given)
    left -= 1
    if left == 0:
        os.kill(os.getpid(), kind)
restart.Restart._store_run = kept
sys.exit(main())
"""


def ended(line, after, kind):
    """Run a command in a process that ends itself after the run was kept so often."""
    command = [sys.executable, "-c", KILLED, str(after), str(int(kind)), *line]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode in (-kind, 128 + kind), done.stderr
    return done


def content(folder):
    """Return the files of a folder, without measured times."""
    found = {path.name: path.read_bytes() for path in Path(folder).iterdir()}
    record = json.loads(found["run.json"])
    del record["timings"]
    return {**found, "run.json": record}


@pytest.fixture
def begun(monkeypatch):
    """Return the times at which resumed runs have continued."""
    # A record names the versions of what is loaded: the first run's as the second's.
    importlib.import_module("matplotlib")
    times = []
    join = restart.Restart.join

    def joined(self, run, *others):
        goes_on = self.stand is not None
        join(self, run, *others)
        if goes_on:
            times.append(run.t)

    monkeypatch.setattr(restart.Restart, "join", joined)
    return times


def line(model, folder, *more):
    return ("run", str(MODELS / f"{model}.yaml"), "-o", folder, "-q", *more)


def gone_on(lagsim, begun, model, after, kind, *more):
    """Continue an interrupted run; return its files and those expected."""
    assert lagsim(*line(model, "whole", *more)).code == 0
    ended(line(model, "cut", *more), after, kind)
    assert Path("cut", restart.RESTART).exists()
    assert lagsim(*line(model, "cut", "--resume", *more)).code == 0
    assert len(begun) == 1
    assert begun[0] > 0.0
    return content("cut"), content("whole")


@pytest.mark.slow
def test_an_interrupted_run_says_that_it_can_go_on(lagsim, begun):
    more = ("--no-plots", "--error-bar", "never")
    ended(line("stick-slip", "cut", *more), 4, signal.SIGINT)
    record = manifest("cut")
    assert (record["outcome"], record["complete"]) == ("interrupted", False)
    found, whole = gone_on(lagsim, begun, "stick-slip", 4, signal.SIGINT, *more)
    assert found == whole
    done = ended(line("stick-slip", "again", *more), 2, signal.SIGTERM)
    assert "--resume continues the run" in done.stderr


@pytest.mark.slow
@pytest.mark.parametrize(("after", "kind"), [(2, signal.SIGKILL), (3, signal.SIGTERM)])
@pytest.mark.parametrize(
    ("model", "more"),
    [
        ("elastic-pendulum", ("--animate",)),
        ("kepler", ("--method", "kahan-li8", "--step", "0.01")),
        ("elastic-pendulum-steered", ("--no-plots", "--units")),
        ("bouncing-ball", ("--no-plots",)),
        ("slack-string", ("--no-plots",)),
        ("rocking-block", ("--no-plots",)),
        ("dry-friction", ("--no-plots",)),
        ("dc-motor", ("--no-plots",)),
        ("hopper", ("--no-plots",)),
        ("car-on-a-road", ("--no-plots",)),
    ],
)
def test_every_kind_of_scene_goes_on(lagsim, begun, model, more, kind, after):
    found, whole = gone_on(lagsim, begun, model, after, kind, *more)
    assert found == whole


# Steps of the state in conditions, off their levels and at them.
STEPS = """
coordinates: {x: {}, y: {}}
energy: {kinetic: (x_dot^2 + y_dot^2)/2, potential: 9*x^2/2}
forces: {x: "if(t > 6, -3*x_dot, 0)"}
modes: {n: 0, k: 0}
events:
  stairs: {at: "floor(3*x) >= 2", set: {n: n + 1}}
  signs: {at: "sign(x) + sign(x_dot) + sign(y) >= 1.5", set: {k: k + 1}}
initial: {x: 1.2, x_dot: 0, y: 0, y_dot: 0}
simulation: {duration: 9, output_step: 0.01}
"""


@pytest.mark.slow
@pytest.mark.parametrize("after", [2, 5, 8])
def test_a_run_with_steps_in_conditions_goes_on(lagsim, begun, write, after):
    asked = ("run", write(STEPS), "-q", "--no-plots", "-o")
    assert lagsim(*asked, "whole").code == 0
    ended((*asked, "cut"), after, signal.SIGKILL)
    assert lagsim(*asked, "cut", "--resume").code == 0
    assert len(begun) == 1
    assert begun[0] > 0.0
    assert content("cut") == content("whole")


@pytest.mark.slow
def test_of_another_run_nothing_is_taken_and_nothing_is_lost(
    lagsim, begun, write, monkeypatch
):
    text = (MODELS / "bouncing-ball.yaml").read_text("utf-8")
    model = write(text)
    asked = ("run", model, "-q", "--no-plots", "-o", "cut")
    ended(asked, 3, signal.SIGKILL)
    before = {path.name: path.read_bytes() for path in Path("cut").iterdir()}
    assert before.pop(LOCK) == b""  # the next one takes it over, and takes it away

    def refused(word, *more):
        done = lagsim(*asked, "--resume", *more, code=2)
        assert word in done.err
        assert done.reports("E613", "--resume")
        assert begun == []
        after = {path.name: path.read_bytes() for path in Path("cut").iterdir()}
        assert before.items() >= after.items()
        assert after.keys() >= before.keys()

    refused("another set of options", "--rtol", "1e-8")
    write(f"{text}# more\n")
    refused("another model text")
    write(text)
    with monkeypatch.context() as other:
        other.setattr(restart, "__version__", "0.0.1")
        refused("another version of lagsim")
    assert lagsim(*asked, "--resume").code == 0
    assert len(begun) == 1


def test_what_a_stranger_has_put_there_is_not_opened(lagsim):
    Path("out").mkdir()
    Path("out", restart.RESTART).write_bytes(sealed(b"0" * 32))
    asked = line("kepler", "out", "--no-plots", "--duration", "1")
    done = lagsim(*asked, "--resume")
    assert (done.code, done.reports("E613")) == (2, True)
    assert lagsim(*asked).code == 0
    assert not Path("out", restart.RESTART).exists()


def sealed(key):
    """Return a checkpoint that anybody with the key could write."""
    rest = json.dumps([{}, [0, None, 0, ""]]).encode() + b"\n[[0],[[]]]\n"
    return hmac.new(key, rest, "sha256").hexdigest().encode() + b"\n" + rest


@pytest.mark.usefixtures("lagsim")
@pytest.mark.parametrize("kind", ["open", "a link", "another name"])
def test_a_key_that_a_stranger_may_know_is_replaced(monkeypatch, kind):
    """Such a key can be read by others, or is a symbolic or a hard link."""
    monkeypatch.setenv("LAGSIM_CACHE", str(Path("cache").absolute()))
    keys = cache.folder("keys")
    path, known = keys / "restart.key", b"k" * 32
    if kind == "open":
        path.write_bytes(known)
        path.chmod(0o644)
    else:
        Path("elsewhere").write_bytes(known)
        Path("elsewhere").chmod(0o600)
        target = Path("elsewhere").absolute()
        path.symlink_to(target) if kind == "a link" else path.hardlink_to(target)
    found = restart._key()
    assert found is not None
    assert found != known
    assert path.read_bytes() == found == restart._key()
    assert (path.lstat().st_mode & 0o777, path.lstat().st_nlink) == (0o600, 1)


@pytest.mark.usefixtures("lagsim")
def test_where_others_may_write_there_is_no_key(monkeypatch):
    Path("shared").mkdir()
    Path("shared").chmod(0o777)
    for where in ("shared", "shared/more/cache"):
        monkeypatch.setenv("LAGSIM_CACHE", str(Path(where).absolute()))
        assert cache.folder("keys") is None
        assert restart._key() is None
    Path("shared").chmod(0o1777)  # as /tmp is: what is another's stays there
    assert restart._key() is not None
    made = [p for p in Path("shared").rglob("*") if p.is_dir()]
    assert {p.stat().st_mode & 0o777 for p in made} == {0o700}


METHODS = "rk4 euler verlet kahan-li6 kahan-li8 midpoint gauss4 generalized-alpha"
METHODS = f"{METHODS} rattle moreau radau dop853 taylor"
KEPT = "ball-on-a-vibrating-table bouncing-ball car-axis dry-friction newtons-cradle"
KEPT = f"{KEPT} rocking-block slack-string sliding-ladder stick-slip cart-pole hopper"
KEPT = f"{KEPT} failing/pulse failing/square-wave failing/graze"


BY_METHODS = [
    ("kepler", ("--method", name, "--duration", "3", *step))
    for name in METHODS.split()
    for step in [() if name in ("radau", "dop853", "taylor") else ("--step", "0.005")]
]


@pytest.mark.parametrize(
    ("name", "more"),
    [
        *((name, ()) for name in KEPT.split()),
        *(pytest.param(*case, marks=pytest.mark.slow) for case in BY_METHODS),
    ],
)
def test_runs_with_every_kind_of_event_by_every_method_can_be_kept(
    lagsim, monkeypatch, name, more
):
    """With a class that is not declared the run would begin anew, and the test fail."""
    kept = []

    class Never(Exception):  # noqa: N818 (stands for one that is suppressed)
        pass

    def encoded(*given):
        kept.append(original(*given))
        if len(kept) == 10:
            monkeypatch.setattr(restart, "EVERY_SECONDS", 1e9)
        return kept[-1]

    original = restart.encoded
    monkeypatch.setattr(restart, "encoded", encoded)
    monkeypatch.setattr(restart, "UndeclaredError", Never)
    monkeypatch.setattr(restart, "EVERY_SECONDS", 0.0)
    monkeypatch.setattr(restart, "MOST_OF_THE_TIME", 1e9)
    monkeypatch.setattr(run, "KEPT_AFTER_SECONDS", -1.0)
    monkeypatch.setattr(pace, "MOST", 16)
    more = (*more, "--error-bar", "never", "--no-plots")
    assert lagsim(*line(name, "out", *more)).code == 0
    assert kept


@pytest.mark.slow
def test_rows_that_were_changed_are_made_anew(lagsim, begun):
    more = ("--no-plots", "--error-bar", "never")
    assert lagsim(*line("bouncing-ball", "whole", *more)).code == 0
    ended(line("bouncing-ball", "cut", *more), 3, signal.SIGKILL)
    part = Path("cut", restart.PART.format("trajectory.csv"))
    part.write_bytes(part.read_bytes().replace(b"1", b"2", 1))
    asked = ("run", str(MODELS / "bouncing-ball.yaml"), "-o", "cut", "--resume", *more)
    done = lagsim(*asked)
    assert (done.code, "cut holds no interrupted run" in done.err) == (0, True)
    assert begun == []
    assert content("cut") == content("whole")


def test_what_cannot_be_kept_is_not(lagsim, monkeypatch):
    """A run with a state that cannot be stored completes without a checkpoint."""

    def unable(*_):
        raise TypeError("cannot pickle 'generator' object")

    monkeypatch.setattr(restart.Restart, "_store_run", unable)
    monkeypatch.setattr(run, "KEPT_AFTER_SECONDS", -1.0)
    assert lagsim(*line("kepler", "out", "--no-plots", "--duration", "1")).code == 0
    assert not Path("out", restart.RESTART).exists()


def test_short_runs_keep_nothing(lagsim, monkeypatch):
    def kept(*_):
        pytest.fail("it was kept")

    monkeypatch.setattr(restart.Restart, "__init__", kept)
    assert lagsim(*line("kepler", "out", "--no-plots", "--duration", "1")).code == 0
    assert run.KEPT_AFTER_SECONDS >= 1.0
