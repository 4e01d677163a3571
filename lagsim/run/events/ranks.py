"""Losses of rank on the way: which constraints are in them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lagsim.admissibility.point import Point
from lagsim.admissibility.rank import weakest_rows
from lagsim.notes import Caution, Event
from lagsim.plan.lengths import usual_lengths

if TYPE_CHECKING:
    from collections.abc import Sequence

    from lagsim.language.arrays import Floats
    from lagsim.mechanics.equations import Equations
    from lagsim.run.arcs import Run


# A mechanism may pass the same dead point for ever: these events are kept up to this
# many, the warning is given once.
MOST_RANK_EVENTS = 10_000


class RankLosses:
    """The losses of rank of a run, and of which constraints it has been told."""

    def __init__(self) -> None:
        self._told: set[tuple[str, ...]] = set()
        self._usual: tuple[float, ...] | None = None  # lengths of all constraint rows

    def note(self, run: Run) -> None:
        """Record a loss of rank on the way, with the constraints in it."""
        time = run.state.lost_at
        size = run.system.size
        at_loss = run.state.work[:size]
        full = len(run.equations.q)
        row = run.runner.tabulate(np.array([[time, *at_loss]]))[0]
        q, v = row[1 : 1 + full], row[1 + full : 1 + 2 * full]
        if self._usual is None:
            self._usual = usual_lengths(run.equations, run.start)
        rank = run.plan.rank + len(run.plan.reduction.eliminated)
        names, smallest = weakest(run.equations, rank, self._usual, time, q, v)
        if len(run.events) < MOST_RANK_EVENTS:
            run.events += [Event(time, "rank", name, smallest) for name in names]
        if names not in self._told:
            self._told.add(names)
            run.warnings.append(rank_caution(time, names, smallest))


def weakest(
    equations: Equations,
    rank: int,
    usual: Sequence[float],
    t: float,
    q: Floats,
    v: Floats,
) -> tuple[tuple[str, ...], float]:
    """Give the constraints closest to dependent at a state, and how close they are.

    Parameters
    ----------
    rank
        Of the rows, in general.
    usual : (m,)
        Their lengths, in general.
    """
    point = Point(equations)
    point.move_to(t)
    left, smallest = weakest_rows(point, q, v, rank, usual)
    heavy = np.abs(left) > 1e-3
    rows = zip(equations.rows, heavy, strict=True)
    return tuple(row.name for row, is_in in rows if is_in), smallest


def rank_caution(time: float, names: tuple[str, ...], smallest: float) -> Caution:
    """Say what a loss of rank means."""
    text = (
        f"at t = {time:.9g} the constraints {', '.join(names)} lose their "
        f"independence (smallest singular value {smallest:.1e}): a singular "
        "configuration, where motions branch; their multipliers are large around it"
    )
    return Caution("rank", text)
