"""Storage of many events."""

import math
import random

from lagsim.notes import Event
from lagsim.run.event_store import EventStore
from lagsim.studies.restart import CLASSES, decoded, encoded


def test_events_come_back_in_order_of_time_and_after_a_checkpoint():
    """Some events are dated later than later entries, as ends of accumulations."""
    rng, store = random.Random(29), EventStore()
    given = [
        Event(k / 7 + 40.0 * (rng.random() < 0.01), "impact", "floor", energy=-1.0 / k)
        for k in range(1, 2501)
    ]
    given[7] = Event(math.pi, "event", name="kick", rate_before=math.inf)
    for event in given:
        store.add(event)
    expected = sorted(given, key=lambda x: x.time)
    assert list(store) == expected
    kept = encoded({"store": store}, CLASSES, lambda _: None)
    again = decoded(kept, CLASSES, {}.__getitem__)["store"]
    assert list(again) == expected
    assert len(again) == len(given)
