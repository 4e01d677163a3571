"""Runs by Dask: the rows do not depend on the machine."""

import pytest

from lagsim.model.reader import read
from lagsim.studies.attempts import ErrorBars
from lagsim.studies.sweep.grid import SweepRows, parse_axes
from lagsim.studies.sweep.sweeping import sweep, table
from lagsim.studies.workers import machines
from tests.small_scenes import PENDULUM
from tests.support import refused

distributed = pytest.importorskip("distributed", reason="the extra `dask`")
pytestmark = [pytest.mark.slow, pytest.mark.filterwarnings("ignore")]


@pytest.fixture
def cluster():
    """Return the address of a scheduler with two workers, each a process."""
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, dashboard_address=None
    ) as cluster:
        yield cluster.scheduler_address


def found():
    model = read(PENDULUM, "<model>")
    grid = parse_axes(model, ["g=1:10:9"])
    return SweepRows.of(model, grid, {}, ErrorBars.NEVER)


def test_rows_are_those_of_this_process(cluster):
    there, here = found(), found()
    with machines(cluster) as (hired, cores):
        assert cores == 2
        sweep(there, cores, requested=True, workers=hired)
    sweep(here, 1, requested=False)
    assert table(there) == table(here)
    assert not there.missing


def test_who_does_not_answer_is_told(monkeypatch):
    def client(_address):
        raise OSError("timed out")

    monkeypatch.setattr(distributed, "Client", client)
    with refused("usage", "tcp://nowhere:1"), (
        machines("tcp://nowhere:1")
    ):  # fmt: skip
        pass
