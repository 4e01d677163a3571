"""events.csv: a line for each event of a run, in the format of trajectory.csv."""

from __future__ import annotations

from operator import attrgetter
from typing import TYPE_CHECKING

from lagsim.outputs.table import table_of

if TYPE_CHECKING:
    from collections.abc import Iterable

    from lagsim.notes import Event
    from lagsim.run.trajectory import Trajectory

NAME = "events.csv"
COLUMNS = (
    "time", "kind", "constraint", "rate_before", "rate_after", "energy", "switch",
)  # fmt: skip


def table(events: Iterable[Event]) -> bytes:
    """Return the file: what does not go with a kind of event is empty."""
    return table_of(COLUMNS, map(attrgetter(*COLUMNS), events))


def marked(events: Iterable[Event]) -> dict[str, list[float]]:
    """Return the times that pictures mark, by kind of event.

    Events at the time of an impact are part of it; so are those where bouncing ends.
    """
    times: dict[str, set[float]] = {}
    for e in events:
        kind = e.kind
        if kind == "zeno" and e.constraint is None:
            kind = "switch"
        if kind != "until":
            times.setdefault(kind, set()).add(e.time)
    impacts = times.get("impact", set()) | times.get("zeno", set())
    found = {
        kind: sorted(own if kind in ("impact", "zeno") else own - impacts)
        for kind, own in times.items()
    }
    return {kind: own for kind, own in found.items() if own}


def unmarked(trajectory: Trajectory) -> str:
    """Return the note below a picture that marks only the first events."""
    listed, count = len(trajectory.events), sum(trajectory.event_counts.values())
    return f"marks: the first {listed} of {count} events" if listed < count else ""
