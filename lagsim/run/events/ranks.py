"""Losses of rank on the way: which constraints are in them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lagsim.admissibility.point import Point
from lagsim.admissibility.rank import weakest_rows
from lagsim.mechanics.ldl import dense_operations
from lagsim.methods.parts import state as at
from lagsim.notes import Caution, Event
from lagsim.plan.lengths import usual_lengths
from lagsim.plan.making import by_loops
from lagsim.run.decisions import Decision, Source
from lagsim.run.system import System

if TYPE_CHECKING:
    from collections.abc import Sequence

    from lagsim.language.arrays import Floats
    from lagsim.mechanics.equations import Equations
    from lagsim.run.arc import Arc


# Beyond so many multiplications, about a second, the loops are not gone on with.
MOST_DENSE = 10**9


class Dependence(Source):
    """Goes on with the QR decomposition where the rows lose their independence."""

    def decide(self, arc: Arc, code: int) -> Decision | None:
        """Go on with it, unless that is too much."""
        if code != at.DEGENERATE:
            return None
        found = f"at t = {arc.t:.9g} the constraints become nearly dependent"
        if dense_operations(arc.system.n, arc.system.m) > MOST_DENSE:
            text = (
                f"{found}, and there are too many for a QR decomposition: from there "
                "on multipliers may lose digits"
            )
            caution = Caution("nearly-dependent", text)
            return Decision(cautions=(caution,), numbers={"degenerate_below": 0.0})
        text = f"{found}; from there on they are solved by a QR decomposition"
        plan = by_loops(arc.plan)
        return Decision(
            cautions=(Caution("nearly-dependent", text),),
            arc=arc.by(plan, System(arc.equations, plan)),
        )


class RankLosses(Source):
    """The losses of rank of a run, and of which constraints it has been told."""

    def __init__(self) -> None:
        self._told: set[tuple[str, ...]] = set()
        self._usual: tuple[float, ...] | None = None  # lengths of all constraint rows

    def decide(self, arc: Arc, code: int) -> Decision | None:
        """Tell of a loss of rank on the way, with the constraints in it."""
        if code != at.RANK_LOST:
            return None
        time = arc.state.lost_at
        at_loss = arc.state.work[: arc.system.size]
        full = len(arc.equations.q)
        row = arc.runner.tabulate(np.array([[time, *at_loss]]))[0]
        q, v = row[1 : 1 + full], row[1 + full : 1 + 2 * full]
        if self._usual is None:
            self._usual = usual_lengths(
                arc.equations, arc.start, arc.settings.output_step
            )
        rank = arc.plan.rank + len(arc.plan.reduction.eliminated)
        names, smallest = weakest(arc.equations, rank, self._usual, time, q, v)
        events = tuple(Event(time, "rank", name, smallest) for name in names)
        if names in self._told:
            return Decision(events)
        self._told.add(names)
        return Decision(events, (rank_caution(time, names, smallest),))


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
    point = Point(equations, t)
    left, smallest = weakest_rows(point, q, v, rank, usual)
    heavy = np.abs(left) > 1e-3
    rows = zip(equations.rows, heavy, strict=True)
    return tuple(row.name for row, is_in in rows if is_in), smallest


def rank_caution(time: float, names: tuple[str, ...], smallest: float) -> Caution:
    """Say what a loss of rank means."""
    text = (
        f"at t = {time:.9g} the constraints {', '.join(names)} become dependent "
        f"(smallest singular value {smallest:.1e}): a singular configuration, "
        "where motions branch; their multipliers are large around it"
    )
    return Caution("rank", text)
