"""Rows of a sweep that tell the ends of its runs alone: made many at a time.

Starts and values of a whole piece are looked at together, the runs are calls of the
kernel in one memory. What is not plain in any of this is made as a run by itself, which
gives the same numbers: a start that needs a closer look, a run that comes to anything
but its end, energy that is not kept, a scene that `run.ensemble` refuses.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lagsim.admissibility.inertia import clear_starts, needs_no_solve
from lagsim.errors import LagsimError
from lagsim.methods.parts.state import DONE
from lagsim.run.ensemble import Ensemble, refusal
from lagsim.run.session import wanted
from lagsim.run.system.sleepers import names_in_exponents
from lagsim.studies.alarms.rows import UNEXPLAINED
from lagsim.studies.sweep.grid import bound, value_of

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from lagsim.language.arrays import Flags, Floats
    from lagsim.model.model import Model
    from lagsim.run.ensemble import Ends
    from lagsim.run.interrupt import Interrupt
    from lagsim.run.session import Session
    from lagsim.studies.sweep.grid import Grid

# A run whose energy less work ends so far from where it began, as a part of what is in
# play at both ends, is looked at by its rows: a tenth of what raises a doubt there.
KEPT = 0.1
TOLD = ("energy", "work", "kinetic", "potential")


class Values(NamedTuple):
    """What the runs of a piece differ in.

    Attributes
    ----------
    parameters : dict of str to ndarray (runs,)
    starts : ndarray, shape (runs, 2 n)
        Positions, then velocities.
    swept : ndarray, shape (runs, axes)
    """

    parameters: dict[str, Floats]
    starts: Floats
    swept: Floats


class EndsOfRuns:
    """Makes ends for the runs of a session's form.

    Attributes
    ----------
    refusal : str
        Why each is made by itself; "" where none needs it.
    """

    def __init__(
        self, session: Session, grid: Grid, options: Mapping[str, str]
    ) -> None:
        self.session, self.grid, self.options = session, grid, options
        self.refusal = refusal(session) or self._refusal()
        if not self.refusal:
            self._ensemble = Ensemble(session)

    def _refusal(self) -> str:
        equations = self.session.case.equations
        if not needs_no_solve(equations):
            return "start values are solved for by the constraints"
        names = {axis.name for axis in self.grid.axes}
        self._follow = equations.model.rests_on(names) or any(
            axis.says(names) for axis in self.grid.axes
        )
        powers = names_in_exponents(equations, ())
        if powers and (self._follow or not powers.isdisjoint(names)):
            return "a swept value is in an exponent"
        return ""

    def made(
        self, numbers: Sequence[int], interrupt: Interrupt
    ) -> tuple[Values, Flags, Ends] | None:
        """Give values of runs, which of them have ended plainly, and their ends.

        None where an end is asked for.
        """
        values = self._followed(numbers) if self._follow else self._plain(numbers)
        clear = self._clear(values)
        ends = self._ensemble.ends(values.parameters, values.starts, interrupt)
        if ends is None:
            return None
        clear &= (ends.codes == DONE) & self._keeps_energy(ends)
        return values, clear, ends

    def _plain(self, numbers: Sequence[int]) -> Values:
        """Give values that nothing else follows."""
        case, grid = self.session.case, self.grid
        start = np.concatenate([case.start.q, case.start.v])
        starts = np.repeat(start[None], len(numbers), 0)
        names = (*case.equations.q, *case.equations.velocities)
        places = np.unravel_index(np.array(numbers), [len(a.texts) for a in grid.axes])
        parameters, swept = {}, []
        for axis, place in zip(grid.axes, places, strict=True):
            values = np.array(axis.values)[place]
            swept.append(values)
            if axis.starts:
                starts[:, names.index(axis.name)] = values
            else:
                parameters[axis.name] = values
        return Values(parameters, starts, np.array(swept).T)

    def _followed(self, numbers: Sequence[int]) -> Values:
        """Give values as each run by itself binds them; nan for what cannot be had."""
        case, grid = self.session.case, self.grid
        equations = case.equations
        n = len(equations.q)
        names = [p.name for p in equations.model.parameters]
        found = np.full((len(numbers), len(names)), np.nan)
        starts = np.full((len(numbers), 2 * n), np.nan)
        swept = np.full((len(numbers), len(grid.axes)), np.nan)
        for k, number in enumerate(numbers):
            model = self._bound(grid.texts(number))
            if model is not None:
                found[k] = [p.value for p in model.parameters]
                starts[k] = [x.value for x in model.initial[: 2 * n]]
                swept[k] = [value_of(model, axis.name) for axis in grid.axes]
        return Values(dict(zip(names, found.T, strict=True)), starts, swept)

    def _bound(self, texts: Mapping[str, str]) -> Model | None:
        """Give the model of a run; None where it cannot be had, or asks otherwise."""
        case = self.session.case
        try:
            model = bound(case.equations.model, texts)
            settings = wanted(model, "sweep", self.options)
        except LagsimError:
            return None
        return model if settings == case.settings else None

    def _clear(self, values: Values) -> Flags:
        case = self.session.case
        equations, runs = case.equations, len(values.starts)
        known: dict[str, float | Floats] = {"t": case.settings.start}
        known |= {p.name: p.value for p in equations.model.parameters}
        known |= values.parameters
        names = (*equations.q, *equations.velocities)
        moved = np.any(values.starts != values.starts[:1], axis=0)
        for name, column, differ in zip(names, values.starts.T, moved, strict=True):
            known[name] = column if differ else float(column[0])
        given: Flags = np.all(np.isfinite(values.starts), axis=1)
        return given & clear_starts(equations, known, runs)

    def _keeps_energy(self, ends: Ends) -> Flags:
        """Tell whose energy less work has not moved, by its first and last row."""
        names = self.session.system.columns.names
        begun, ended = (
            {x: rows[:, names.index(x)] for x in TOLD if x in names}
            for rows in (ends.begun, ends.ended)
        )
        moved = {x: np.abs(ended[x] - begun[x]) for x in ended}
        drift = ended["energy"] - begun["energy"]
        if "work" in ended:
            drift -= ended["work"] - begun["work"]
        play = np.maximum.reduce(
            [*moved.values(), np.abs(ended.get("kinetic", ended["energy"]))]
        )
        kept: Flags = np.abs(drift) <= KEPT * UNEXPLAINED * play
        return kept
