"""Runs do not depend on where their kernels pause: all columns, events and counts."""

import math

import numpy as np
import pytest

from lagsim.errors import InputError
from lagsim.methods import names
from lagsim.program import system
from lagsim.run import arcs
from lagsim.run.interrupt import Horizon
from lagsim.run.observers import Keep
from tests.support import SHIPPED, ready, run

# Loops over rows that depend, impacts, events; the others wait for the slow suite.
FEW = [
    pytest.param("heavy-top-quaternion", "radau", marks=pytest.mark.slow),
    ("newtons-cradle", "auto"),
    ("hopper", "dop853"),
]
# Of each call: its steps, and the rows it may write at most.
LONG, SHORT = (1000, 128_000), [(1, 3), (7, 40)]


class Regular:
    """Pace of calls that are as long as each other."""

    def __init__(self, steps, rows):
        self.steps, self.rows = steps, rows

    def lasted(self, seconds):
        """Ignore the clock."""


# Steps shrink with the distance to t = 0.6: no number of them passes it.
CONVERGING = """
coordinates: {x: {}}
energy: {kinetic: x_dot^2/2, potential: 0}
forces: {x: sin(1/(t - 0.6))}
initial: {x: 0}
simulation: {duration: 1, output_step: 0.01, method: dop853}
"""


def moved(monkeypatch, model, method, pace):
    monkeypatch.setattr(system, "Pace", lambda: Regular(*pace))
    return run(model, method=method)


def equal_runs(monkeypatch, model, method):
    whole = moved(monkeypatch, model, method, LONG)
    for pace in SHORT:
        parts = moved(monkeypatch, model, method, pace)
        assert parts.rows.shape == whole.rows.shape
        different = parts.rows.view(np.int64) != whole.rows.view(np.int64)
        columns = np.array(whole.system.columns.names)[different.any(axis=0)]
        assert not len(columns), (method, pace, columns)
        assert repr(parts.trajectory) == repr(whole.trajectory), (method, pace)


@pytest.mark.slow
@pytest.mark.parametrize(("model", "method"), FEW)
def test_a_run_is_the_same_however_often_its_kernels_pause(monkeypatch, model, method):
    equal_runs(monkeypatch, model, method)


class Blocks(Keep):
    """Rows, with the number of rows of each block."""

    def begin_anew(self):
        super().begin_anew()
        self.counts = []

    def add(self, rows):
        super().add(rows)
        self.counts.append(len(rows))


def test_rows_of_short_arcs_are_passed_on_together(monkeypatch):
    """Observers receive all rows in order, in blocks that the pool bounds."""
    found, session = [], ready("bouncing-ball", duration=1.0)
    for pooled in (1, 40, 10**9):
        monkeypatch.setattr(arcs, "POOLED_ROWS", pooled)
        monkeypatch.setattr(arcs, "POOLED_SECONDS", math.inf)
        blocks = Blocks()
        made = session.run([blocks])
        assert blocks.rows == made.rows == sum(blocks.counts)
        found.append(blocks)
    alone, some, whole = found
    assert len(whole.counts) == 1 < len(some.counts) < len(alone.counts)
    assert min(some.counts[:-1]) >= 40
    for other in (some, whole):
        assert other.table.tobytes() == alone.table.tobytes()


@pytest.mark.slow
def test_a_run_ends_at_the_same_step_however_often_its_kernels_pause(monkeypatch):
    ends = [
        moved(monkeypatch, CONVERGING, "dop853", pace).trajectory
        for pace in ((1000, 1000), (4001, 4001))
    ]
    assert "would not pass t = 0.6" in ends[0].reason
    assert repr(ends[0]) == repr(ends[1])


@pytest.mark.parametrize(
    ("rejected", "found"), [(1.0, pytest.approx(1e-8 * 2**23)), (0.5, None)]
)
def test_steps_that_are_rejected_once_each_end_a_run(rejected, found):
    # Equal steps of 1e-8: 2^23 of these do not reach the end.
    horizon, ends = Horizon(), []
    for _ in range(8):
        n = horizon.pause_at
        ends.append(horizon.before(1.0, 1e-8 * n, n, int(rejected * n), 2**23))
    assert ends[-1] == found
    assert ends[0] is None


# All methods take minutes for the contacts of four feet.
SHORT_RUNS = [name for name in SHIPPED if name != "quadruped"]


@pytest.mark.slow
@pytest.mark.parametrize("model", SHORT_RUNS)
def test_runs_by_all_methods_are_the_same_however_often_they_pause(monkeypatch, model):
    for method in ("auto", *names()):
        try:
            equal_runs(monkeypatch, model, method)
        except InputError:
            continue  # it cannot handle the model
