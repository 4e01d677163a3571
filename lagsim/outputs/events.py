"""events.csv: what happened on the way, one line per event, like trajectory.csv."""

from __future__ import annotations

from operator import attrgetter
from typing import TYPE_CHECKING

from lagsim.outputs.table import table_of

if TYPE_CHECKING:
    from collections.abc import Iterable

    from lagsim.notes import Event

NAME = "events.csv"
COLUMNS = ("time", "kind", "constraint", "rate_before", "rate_after", "energy")


def table(events: Iterable[Event]) -> bytes:
    """Give the file: what does not go with a kind of event is empty."""
    return table_of(COLUMNS, map(attrgetter(*COLUMNS), events))


def marked(events: Iterable[Event]) -> dict[str, list[float]]:
    """Give the times that pictures mark, by the attributes of their `Record`.

    What happens at an impact is marked by it.
    """
    times: dict[str, set[float]] = {
        name: set() for name in ("impacts", "rests", "events")
    }
    for e in events:
        if e.kind == "impact":
            times["impacts"].add(e.time)
        elif e.kind == "zeno" and e.constraint is not None:
            times["rests"].add(e.time)
        elif e.kind != "until":
            times["events"].add(e.time)
    times["events"] -= times["impacts"] | times["rests"]
    return {name: sorted(found) for name, found in times.items()}
