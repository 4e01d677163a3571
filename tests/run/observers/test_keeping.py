"""Rows that are kept, and rows that a store has no room for."""

import errno
import os

import numpy as np

from lagsim.run.interrupt import Interrupt
from lagsim.run.observers import Keep, Relay
from lagsim.run.trajectory import Outcome
from tests.small_scenes import oscillator
from tests.support import case_of


def table(count, columns=3):
    return np.arange(float(count * columns)).reshape(count, columns)


class Full(Keep):
    """A store with room for a given number of rows."""

    def __init__(self, room):
        super().__init__()
        self.room = room

    def add(self, rows):
        fitting = rows[: self.room - self.rows]
        super().add(fitting)
        if len(fitting) < len(rows):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def test_others_get_the_rows_that_are_stored():
    store, other, interrupt = Full(7), Keep(), Interrupt()
    relay = Relay(store, [other], interrupt)
    rows = table(12)
    for block in np.split(rows, [5, 10]):
        relay.add(block)
    assert np.array_equal(store.table, rows[:7])
    assert np.array_equal(other.table, rows[:7])
    assert relay.fault.errno == errno.ENOSPC
    assert interrupt.requested
    assert interrupt.signal is None  # nobody has sent one
    assert relay.seconds > 0.0


def test_a_run_ends_where_its_store_is_full():
    interrupt = Interrupt()
    session = case_of(oscillator("duration: 1e4, output_step: 0.01")).ready()
    store = Full(10_000)
    relay = Relay(store, [], interrupt)
    made = session.run([relay], interrupt=interrupt)
    assert made.outcome is Outcome.INTERRUPTED
    assert store.rows == 10_000
    assert made.rows < 100_000  # of a million
    # cos(t), the rows of a run that nothing stops.
    assert np.max(np.abs(store.table[:, 1] - np.cos(store.table[:, 0]))) < 1e-9


def test_an_end_may_be_asked_for_before_the_first_row():
    interrupt, keep = Interrupt(), Keep()
    interrupt.stop()
    session = case_of(oscillator("duration: 1e6, output_step: 0.1")).ready()
    made = session.run([keep], interrupt=interrupt)
    assert made.outcome is Outcome.INTERRUPTED
    assert len(keep.table) == made.rows < 100_000
