"""Storage of the rows of the sections of a run."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lagsim.codes.known import OUT_OF_RANGE
from lagsim.errors import Problem
from lagsim.language.evaluate import evaluate

if TYPE_CHECKING:
    from lagsim.language.arrays import Floats
    from lagsim.model.model import Model, Settings
    from lagsim.run.arc import Arc

# Largest number of rows of one strobe.
STROBES = 1_000_000
DIRECTIONS = {"both": 0.0, "up": 1.0, "down": -1.0}


class Sections:
    """Rows of the sections of a run, located by its compiled kernels.

    Parameters
    ----------
    model : Model
        The model, whose output names the sections and strobes.
    columns : int
        Number of leading columns of a row that are stored.

    Attributes
    ----------
    names : list of str
        Names of the located sections, then of the strobes, in the order of the numbers
        by which the kernels identify sections.
    """

    def __init__(self, model: Model, columns: int) -> None:
        sections = sorted(model.output.sections, key=lambda x: x.at is None)
        self.names = [x.name for x in sections]
        self._columns = columns
        self._blocks: list[list[Floats]] = [[] for _ in sections]
        # By number: the row of a crossing that waits, in the modes of its own time.
        self._waiting: dict[int, Floats] = {}

    def begin(self, arc: Arc) -> None:
        """Start the search for sections in the kernels of the first arc."""
        self._waiting.clear()
        state, model = arc.state, arc.equations.model
        sections = model.output.sections
        state.sought = 1.0
        state.ways[:] = [DIRECTIONS[x.direction] for x in sections if x.at is not None]
        state.periods[:] = periods(model)

    def take(self, arc: Arc, until: float = np.inf) -> None:
        """Store the rows located up to the time `until`, in the modes of the arc.

        States located later than `until` remain in the memory of the kernels.
        """
        state = arc.state
        found, width = int(state.states_found), 2 + arc.system.size
        if not found:
            return
        states = state.crossed_states[: found * width].reshape(found, width)
        now = states[:, 1] <= until
        rows = arc.runner.tabulate(states[now, 1:])[:, : self._columns]
        numbers = states[now, 0]
        for k, number in enumerate(numbers):
            waited = self._waiting.get(int(number))
            if waited is not None and waited[0] == rows[k, 0]:
                rows[k] = waited
        for number in sorted({*numbers.tolist()}):
            self._blocks[int(number)].append(rows[numbers == number])
        later = states[~now].copy()
        state.crossed_states[: later.size] = later.ravel()
        state.states_found = float(len(later))

    def keep_waiting(self, arc: Arc) -> None:
        """Compute the rows of crossings that wait since a time within the arc.

        A crossing waits while the motion is within rounding of the section, and is
        stored later, with this row. The row is computed before the modes change, since
        its columns depend on the modes of the arc.

        arc : the arc at its end, before the next one begins.
        """
        state = arc.state
        for number in np.flatnonzero(state.waits).tolist():
            row = state.waiting.reshape(-1, 1 + arc.system.size)[[number]]
            if state.arc_start <= row[0, 0] < arc.t:
                found = arc.runner.tabulate(row)[0, : self._columns]
                self._waiting[number] = found

    def finish(self, arc: Arc, *, whole: bool) -> None:
        """Store the rows of sections that the end of the run crosses.

        Parameters
        ----------
        arc
            The last arc of the run.
        whole
            Whether the run has reached the end of its duration.
        """
        self.take(arc)
        arc.runner.finish(arc.state, whole=whole)
        self.take(arc)

    def tables(self, order: list[str]) -> dict[str, Floats]:
        """Return the rows of each section, shape (k, columns), by name in `order`."""
        nothing = np.empty((0, self._columns))
        return {
            name: np.concatenate([nothing, *self._blocks[self.names.index(name)]])
            for name in order
        }


def periods(model: Model) -> list[float]:
    """Return the periods of the strobes of a model, in units of time."""
    nodes = [x.every for x in model.output.sections if x.every is not None]
    return evaluate(model.graph, nodes, model.parameter_values)


def too_many_strobes(model: Model, settings: Settings) -> list[Problem]:
    """Return a problem for each strobe whose period is too short or not positive.

    A period is too short where the run has `STROBES` of these periods or more; the list
    is empty if there is no such strobe.
    """
    strobes = [x for x in model.output.sections if x.every is not None]
    return [
        Problem(
            OUT_OF_RANGE,
            f"`every` of the section `{x.name}` is {period:g}; a run has at most "
            f"{STROBES:,} of its periods",
            x.place,
        )
        for x, period in zip(strobes, periods(model), strict=True)
        if not (period > 0.0 and settings.duration / period < STROBES)
    ]
