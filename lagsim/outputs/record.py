"""Data that the pictures of one run share: rows, names, units, events."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from lagsim.outputs.letters import Letters, raised

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from lagsim.notes import Event
    from lagsim.run.observers.thinning import Thinning

# Kinds of events that take in others at their time.
IMPACTS = ("impact", "corner", "zeno")


@dataclass(frozen=True, slots=True)
class Record:
    """Data that the pictures of one run share.

    Attributes
    ----------
    title : the model's name; plain text, as everything that is written here.
    rows : the thinned rows of the run.
    units : unit of each column that has one; that of `t` too.
    events : times to mark, by the kind of what happens.
    note : below the title: that and why a run is incomplete; else empty.
    horizon : rows past this time are no forecast; infinite where all are.
    letters : how names are written.
    form : png, svg or pdf.
    is_sum : whether the energy is T + V, and not another energy function.
    """

    title: str
    rows: Thinning
    units: Mapping[str, str] = field(default_factory=dict)
    events: Mapping[str, Sequence[float]] = field(default_factory=dict)
    note: str = ""
    horizon: float = math.inf
    letters: Letters = field(default_factory=Letters)
    form: str = "png"
    is_sum: bool = True

    def unit(self, column: str) -> str:
        """Return the unit of a column, empty where none is known."""
        return raised(self.units.get(column, ""))

    def named(self, column: str) -> tuple[str, str]:
        """Return a column's name, as it is written, and its unit."""
        return self.letters.name(column), self.unit(column)

    def trusted(self) -> int:
        """Return how many of the points that paths show lie before the horizon."""
        return int(np.searchsorted(self.rows.sampled("t"), self.horizon, side="right"))


def merged(events: Iterable[Event]) -> list[Event]:
    """Return the events that are marked: those at the time of an impact are part of it.

    So are those at which bouncing ends.
    """
    own = [
        e._replace(kind="switch") if e.kind == "zeno" and e.constraint is None else e
        for e in events
        if e.kind != "until"
    ]
    impacts = {e.time for e in own if e.kind in IMPACTS}
    return [e for e in own if e.kind in IMPACTS or e.time not in impacts]


def marked(events: Iterable[Event]) -> dict[str, list[float]]:
    """Return the times that pictures mark, by kind of event."""
    times: dict[str, set[float]] = {}
    for e in merged(events):
        times.setdefault(e.kind, set()).add(e.time)
    return {kind: sorted(own) for kind, own in times.items()}
