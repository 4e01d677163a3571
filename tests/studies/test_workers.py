"""Work over processes: all is completed if processes die, and none outlives it."""

import os
import signal
import subprocess
import sys
import time

import pytest

from lagsim.run.interrupt import Interrupt
from lagsim.studies.workers import Died, completed_pieces
from tests.patience import PATIENCE
from tests.support import ROOT

# Longer than anyone waits.
LONG = 100.0 * PATIENCE


def squared(x, _interrupt):
    if x < 0:
        os._exit(1)
    return x * x


def waited(x, interrupt):
    """Wait for a requested end; the first piece does not wait."""
    began = time.monotonic()
    while x and not interrupt.requested and time.monotonic() - began < LONG:
        time.sleep(0.01)
    return x, interrupt.requested


def alive(pid):
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    with open(f"/proc/{pid}/stat") as file:  # noqa: PTH123
        return file.read().rsplit(")", 1)[1].split()[0] != "Z"


def test_one_at_a_time_needs_no_other_process():
    found = dict(completed_pieces(squared, range(7), 1, Interrupt()))
    assert found == {k: k * k for k in range(7)}


@pytest.mark.slow
def test_who_dies_is_told_and_the_others_are_done():
    found = dict(completed_pieces(squared, [1, -1, 2, 3], 2, Interrupt()))
    assert isinstance(found.pop(1), Died)
    assert found == {0: 1, 2: 4, 3: 9}


def first_dies(path, _interrupt):
    if not path.exists():
        path.touch()
        os._exit(1)
    return path.name


@pytest.mark.slow
def test_what_a_process_that_died_had_is_done_again(tmp_path):
    pieces = [tmp_path / name for name in "abc"]
    found = dict(completed_pieces(first_dies, pieces, 2, Interrupt()))
    assert found == {0: "a", 1: "b", 2: "c"}


@pytest.mark.slow
def test_an_interrupt_ends_what_is_under_way_and_begins_nothing():
    interrupt, found = Interrupt(), {}
    for number, result in completed_pieces(waited, range(4), 2, interrupt):
        found[number] = result
        interrupt.stop()
    assert found[0] == (0, False)
    # With it, one piece was under way, or two.
    assert [found[k] for k in range(1, len(found))] == [
        (k, True) for k in range(1, len(found))
    ]
    assert 2 <= len(found) <= 3


SCRIPT = """
import multiprocessing, sys, threading, time
from lagsim.run.interrupt import Interrupt
from lagsim.studies.workers import completed_pieces
from tests.studies.test_workers import waited

def told():
    while len(multiprocessing.active_children()) < 2:
        time.sleep(0.01)
    print(*(c.pid for c in multiprocessing.active_children()), flush=True)

threading.Thread(target=told, daemon=True).start()
list(completed_pieces(waited, [1, 2], 2, Interrupt()))
"""


@pytest.mark.slow
@pytest.mark.skipif(not os.path.isdir("/proc/self"), reason="looks into /proc")  # noqa: PTH112
def test_no_process_outlives_a_parent_that_is_killed():
    parent = subprocess.Popen(
        [sys.executable, "-c", SCRIPT], cwd=ROOT, stdout=subprocess.PIPE, text=True
    )
    workers = [int(pid) for pid in parent.stdout.readline().split()]
    assert len(workers) == 2
    assert all(map(alive, workers))
    parent.send_signal(signal.SIGKILL)
    parent.wait()
    parent.stdout.close()
    end = time.monotonic() + LONG
    while any(map(alive, workers)) and time.monotonic() < end:
        time.sleep(0.02)
    assert not any(map(alive, workers))
