"""Storage of many events."""

import math
import random

from lagsim.notes import Event
from lagsim.run.arcs import Recorder
from lagsim.run.event_store import EventStore
from lagsim.run.trajectory import Decision


def test_events_come_back_in_order_of_time():
    """Some events are dated later than later entries, as ends of accumulations."""
    rng, recorder = random.Random(29), Recorder([])
    given = [
        Event(k / 7 + 40.0 * (rng.random() < 0.01), "impact", "floor", energy=-1.0 / k)
        for k in range(1, 2501)
    ]
    given[7] = Event(8 / 7, "event", name="kick", rate_before=math.inf)
    for k, event in enumerate(given, 1):
        recorder.store(Decision(events=(event,)))
        if k % 3 == 0:
            recorder.list_events(k / 7)
            passed = len(recorder.listed) + len(recorder.waiting)
            assert passed == k
            assert all(x.time >= k / 7 for x in recorder.waiting)
    recorder.list_events()
    assert list(recorder.listed) == sorted(given, key=lambda x: x.time)
    assert isinstance(recorder.listed, EventStore)
    assert len(recorder.listed) == len(given)
