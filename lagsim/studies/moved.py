"""What happens in two runs of one motion, at times that are not quite the same.

Where velocities jump, or forces, two runs are apart by the whole jump from the one's
time to the other's, however close these are: that is no error of what jumps, but of
when, and the positions know it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lagsim.run.observers.checkpoints import numbers

if TYPE_CHECKING:
    from collections.abc import Iterable

    from lagsim.language.arrays import Flags, Floats
    from lagsim.model.model import Settings
    from lagsim.notes import Event

IMPACT = "impact"


def moved(events: Iterable[Event], others: Iterable[Event]) -> Floats:
    """Give when the same happened in both runs (k, 2).

    The same is of one kind, to one constraint, and nearest either way: what only one
    run has met with has no partner.
    """
    mine, theirs = _by_what(events), _by_what(others)
    pairs = [
        partners(times, theirs[what]) for what, times in mine.items() if what in theirs
    ]
    return np.concatenate(pairs) if pairs else np.empty((0, 2))


def within(t: Floats, pairs: Floats) -> Flags:
    """Tell which times lie from one of a pair (k, 2) to the other."""
    found = np.zeros(len(t), bool)
    for pair in pairs:
        found |= (np.min(pair) <= t) & (t <= np.max(pair))
    return found


def on_grid(rows: Floats, settings: Settings) -> Floats:
    """Give the rows at output times, and the last: one each, that after an impact."""
    places = numbers(rows[:, 0], settings.start, settings.output_step)
    kept = (places >= 0) & np.append(places[1:] != places[:-1], [True])
    kept[-1:] = True
    return np.asarray(rows[kept])


def _by_what(events: Iterable[Event]) -> dict[tuple[str | None, ...], Floats]:
    found: dict[tuple[str | None, ...], list[float]] = {}
    for e in events:
        found.setdefault((e.kind, e.constraint, e.switch), []).append(e.time)
    return {what: np.unique(times) for what, times in found.items()}


def partners(mine: Floats, theirs: Floats) -> Floats:
    """Give those of two runs' times (k, 2) that are nearest to each other."""
    if not (len(mine) and len(theirs)):
        return np.empty((0, 2))
    there, back = nearest(mine, theirs), nearest(theirs, mine)
    mutual = back[there] == np.arange(len(mine))
    return np.column_stack([mine[mutual], theirs[there[mutual]]])


def nearest(times: Floats, among: Floats) -> Floats:
    """Give the number of the nearest for each time (k,)."""
    middles = (among[1:] + among[:-1]) / 2.0
    return np.asarray(np.searchsorted(middles, times))
