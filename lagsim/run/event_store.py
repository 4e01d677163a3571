"""Storage of many events of a run, packed."""

from __future__ import annotations

import json
import zlib
from operator import attrgetter
from typing import TYPE_CHECKING, Any

import numpy as np

from lagsim.notes import Event

if TYPE_CHECKING:
    from collections.abc import Iterator

# Number of events in a chunk.
CHUNK = 1000


class EventStore:
    """Events in the order in which they were added, compressed in chunks.

    Iteration yields the events in the order of time. The order of addition and the
    order of time differ at accumulations, whose end is dated later than events that are
    added after it.
    """

    def __init__(self) -> None:
        self._chunks: list[np.ndarray[Any, np.dtype[np.uint8]]] = []
        self._last: list[Event] = []
        self._count = 0

    def __repr__(self) -> str:
        """Return the class with the number of events."""
        return f"EventStore({self._count})"

    def __len__(self) -> int:
        """Return the number of events."""
        return self._count

    def add(self, event: Event) -> None:
        """Store an event."""
        self._last.append(event)
        self._count += 1
        if len(self._last) == CHUNK:
            packed = zlib.compress(json.dumps(self._last).encode())
            self._chunks.append(np.frombuffer(packed, np.uint8))
            self._last = []

    def __iter__(self) -> Iterator[Event]:
        """Iterate over all events in the order of time."""
        time, waiting = attrgetter("time"), list[Event]()
        for chunk in self._all_chunks():
            begin = min(map(time, chunk))
            yield from (x for x in waiting if x.time <= begin)
            waiting = [x for x in waiting if x.time > begin]
            waiting = sorted([*waiting, *chunk], key=time)
        yield from waiting

    def _all_chunks(self) -> Iterator[list[Event]]:
        for packed in self._chunks:
            yield [Event(*x) for x in json.loads(zlib.decompress(packed.tobytes()))]
        if self._last:
            yield self._last
