"""Pictures are equal whichever process draws, and whichever loaded matplotlib."""

import os
import subprocess
import sys

import pytest

from lagsim.native.link import ahead
from lagsim.outputs import plots
from lagsim.outputs.letters import letters_of
from lagsim.outputs.plot_data import PlotData
from lagsim.run.observers.thinning import picture_thinning
from lagsim.studies.drawing import artist, drawn_here
from tests.small_scenes import PENDULUM
from tests.support import MODELS, ready


@pytest.fixture(scope="module")
def ordered():
    """Return a request for pictures, and the pictures drawn by this process."""
    session = ready(PENDULUM, duration=0.5)
    model = session.case.equations.model
    rows = picture_thinning(model, session.system.columns.names)
    session.run([rows])
    order = PlotData(model.name, rows, letters=letters_of(model)), model
    return order, dict(drawn_here(*order))


@pytest.mark.skipif(
    sys.platform != "linux" or len(os.sched_getaffinity(0)) < 2,
    reason="nobody is sent without a second core, and elsewhere than on Linux",
)
def test_another_process_draws_the_same(ordered, monkeypatch):
    order, own = ordered
    assert own.keys() == {"energy.png", "trajectory.png"}
    with artist(order[1]) as draw:
        # Whoever is asked here has not done his part.
        monkeypatch.setattr(plots, "pictures", None)
        assert dict(draw(*order)) == own


@pytest.mark.slow
def test_what_another_does_not_bring_is_drawn_here(ordered, monkeypatch):
    order, own = ordered
    monkeypatch.setattr(ahead.Helper, "send", lambda *_: iter(()))
    with artist(order[1]) as draw:
        assert dict(draw(*order)) == own


@pytest.mark.slow
def test_what_another_cannot_draw_is_told_here(ordered, monkeypatch):
    order, own = ordered
    monkeypatch.setattr(plots, "trajectory", lambda *_: 1 / 0)
    with artist(order[1]) as draw:
        found = dict(draw(*order))
    assert found.keys() == own.keys()
    assert "ZeroDivisionError" in found.pop("trajectory.png").text
    assert found.items() < own.items()


CALL = """
import sys
from lagsim.cli import main
{before}
code = main()
from matplotlib.axes import Axes
print(code, len(Axes.set.__doc__ or ""))
"""
# As the command line draws, where there is no other process.
LEAN = (
    "import lagsim.cli.run as run\nrun.is_watched = lambda: True"
    "\nfrom lagsim.native.link import ahead\nahead.is_possible = lambda: False"
)


def pictures(folder, before):
    """Draw a run; return its pictures, and how long a docstring of matplotlib is."""
    command = [sys.executable, "-c", CALL.format(before=before), "run"]
    command += [MODELS / "elastic-pendulum.yaml", "-q", "-o", folder]
    command += ["--error-bar", "never"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    code, length = map(int, done.stdout.split())
    assert (code, done.stderr) == (0, "")
    return {path.name: path.read_bytes() for path in folder.glob("*.png")}, length


@pytest.mark.slow
def test_docstrings_are_left_out_and_nothing_drawn_changes(tmp_path):
    plain, whole = pictures(tmp_path / "plain", "")
    lean, short = pictures(tmp_path / "lean", LEAN)
    assert lean == plain
    assert len(plain) == 3
    assert short < whole
