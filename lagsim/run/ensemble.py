"""The ends of many runs of one model, side by side in the lanes of vectors.

Runs of one plan, with other values of parameters and other starts: no rows are made but
that of the start and of the end. Each has the bits that it has alone.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lagsim.methods import method
from lagsim.run.arcs import Run
from lagsim.run.states import LONG
from lagsim.run.system.lanes import Together
from lagsim.run.system.sleepers import timed

if TYPE_CHECKING:
    from collections.abc import Mapping

    from lagsim.language.arrays import Floats
    from lagsim.run.interrupt import Interrupt
    from lagsim.run.session import Session

# Runs whose memory is there at a time: it stays in the cache.
AT_ONCE = 256
# Steps of all lanes between two looks whether somebody wants an end: milliseconds.
STEPS = 10_000


class Ends(NamedTuple):
    """What runs have come to.

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
    """Say why runs cannot be made side by side, or give ""."""
    plan, system = session.plan, session.system
    if not hasattr(method(plan.method), "try_plain"):
        return f"the method {plan.method} integrates runs one by one"
    if plan.parts:
        return "subsystems are integrated apart"
    if system.m or system.watched:
        return "constraints and switches are located in each run separately"
    if plan.reduction.ignored or plan.reduction.eliminated:
        return "the equations are reduced by what is conserved in each run"
    if system.model.until is not None:
        return "`until` is located in each run separately"
    if plan.switches.modes or timed(system.equations):
        return "events at given times are located in each run separately"
    if plan.tape:
        return "the equations are too many to be compiled"
    return ""


class Abreast:
    """Makes runs of a session side by side; `refusal` is to be asked first."""

    def __init__(self, session: Session) -> None:
        case = session.case
        system = self.system = session.system
        run = Run(
            case.equations, case.start, session.plan, system, case.settings, [],
            longest_step=session.longest_step,
        )  # fmt: skip
        run.begin()
        self.state = run.arc.state
        self._together = Together(system, session.plan.method)

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
        starts : (runs, 2 n)
            Positions, then velocities.
        """
        found = []
        for first in range(0, len(starts), AT_ONCE):
            some = slice(first, first + AT_ONCE)
            part = {name: values[some] for name, values in parameters.items()}
            ends = self._some(part, starts[some], interrupt)
            if ends is None:
                return None
            found.append(ends)
        return Ends(*(np.concatenate(x) for x in zip(*found, strict=True)))

    def _some(
        self,
        parameters: Mapping[str, Floats],
        starts: Floats,
        interrupt: Interrupt | None,
    ) -> Ends | None:
        runs, given = starts.shape
        e = self._together.ensemble(self.state, runs)
        y = self.state.place("y")
        e.states.reshape(runs, -1)[:, y : y + given] = starts
        own = e.parameters.reshape(runs, -1)
        for name, values in parameters.items():
            own[:, self._together.places[name]] = values
        e.most = LONG
        while self._together.advance(e, STEPS):
            if interrupt is not None and interrupt.asked:
                return None
        shape = (runs, -1)
        return Ends(
            e.codes.copy(), e.begun.reshape(shape).copy(), e.ended.reshape(shape).copy()
        )
