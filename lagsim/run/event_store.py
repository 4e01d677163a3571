"""Storage of many events of a run, packed."""

from __future__ import annotations

import json
import zlib
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from lagsim.notes import Event

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

# Number of events in a chunk.
CHUNK = 1000


class EventList(Protocol):
    """Interface of a list that receives all events of a run in the order of time."""

    def extend(self, events: Sequence[Event]) -> None:
        """Append events, none of which is earlier than the events appended before."""


class EventStore:
    """Events in the order in which they were appended, compressed in chunks."""

    def __init__(self) -> None:
        self._chunks: list[np.ndarray[Any, np.dtype[np.uint8]]] = []
        self._last: list[Event] = []

    def __repr__(self) -> str:
        """Return the class with the number of events."""
        return f"EventStore({len(self)})"

    def __len__(self) -> int:
        """Return the number of events."""
        return CHUNK * len(self._chunks) + len(self._last)

    def extend(self, events: Sequence[Event]) -> None:
        """Append events."""
        self._last.extend(events)
        while len(self._last) >= CHUNK:
            packed = zlib.compress(json.dumps(self._last[:CHUNK]).encode())
            self._chunks.append(np.frombuffer(packed, np.uint8))
            del self._last[:CHUNK]

    def __iter__(self) -> Iterator[Event]:
        """Iterate over all events."""
        for packed in self._chunks:
            for x in json.loads(zlib.decompress(packed.tobytes())):
                yield Event(*x)
        yield from self._last
