"""The ends of many runs of one session, with other parameters and other starts.

A loop over calls of the kernel in the memory of one run: no observers, no rows but
those of the start and of the end. Each run has the bits that it has alone.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lagsim.methods.parts.state import BLOCK_FULL
from lagsim.program.localized import is_localized_in_time
from lagsim.run.arc import LONG
from lagsim.run.arcs import Run

if TYPE_CHECKING:
    from collections.abc import Mapping

    from lagsim.language.arrays import Floats
    from lagsim.run.interrupt import Interrupt
    from lagsim.run.session import Session


class Ends(NamedTuple):
    """Results of several runs.

    Attributes
    ----------
    codes : ndarray, shape (runs,)
        What the kernel gave, see `methods.parts.state`: DONE, or one that asks for more
        than it can do, so that the run has to be made alone.
    begun, ended : ndarray, shape (runs, columns)
        The row of the start, and the last one.
    """

    codes: Floats
    begun: Floats
    ended: Floats


def refusal(session: Session) -> str:
    """Say why a run takes more than calls of the kernel, or return ""."""
    plan, system = session.plan, session.system
    if plan.parts:
        return "subsystems are integrated apart"
    if system.m or system.watched:
        return "constraints and switches are located in each run separately"
    if plan.reduction.ignored or plan.reduction.eliminated:
        return "the equations are reduced by what is conserved in each run"
    if system.model.until is not None:
        return "`until` is located in each run separately"
    if system.model.events:
        return "events act in each run separately"
    if plan.switches.modes or is_localized_in_time(system.equations):
        return "events at given times are located in each run separately"
    return ""


class Ensemble:
    """Makes runs of a session in one memory; `refusal` is to be asked first."""

    def __init__(self, session: Session) -> None:
        self._system = session.system.bound(session.system.model, session.plan)
        run = Run(session._replace(system=self._system).first_arc(), [])
        run.begin()
        self._arc = run.arc
        self._start = run.arc.state.copy()

    def ends(
        self,
        parameters: Mapping[str, Floats],
        starts: Floats,
        interrupt: Interrupt | None = None,
    ) -> Ends | None:
        """Make runs; None where an end was asked for.

        Parameters
        ----------
        parameters
            Values (runs,) of those that are not the session's own.
        starts : (runs, 2 n + l)
            Positions, velocities, first-order states.
        """
        arc, p = self._arc, self._system.p
        places = [self._system.place(name) for name in parameters]
        values = np.array(list(parameters.values())).T
        codes = np.empty(len(starts))
        rows = np.empty((len(starts), 2, self._system.rows_observed))
        for k, start in enumerate(starts):
            arc.state.flat[:] = self._start.flat
            arc.y[: len(start)] = start
            if places:
                p.flat[places] = values[k]
            arc.runner.prepare()
            first = arc.row()
            codes[k] = code = arc.runner.advance(arc.state, LONG, LONG)
            while code == BLOCK_FULL:
                codes[k] = code = arc.runner.advance(arc.state, LONG, LONG)
            rows[k] = arc.runner.tabulate(np.concatenate([first, arc.row()]))
            if interrupt is not None and interrupt.asked:
                return None
        return Ends(codes, rows[:, 0], rows[:, 1])
