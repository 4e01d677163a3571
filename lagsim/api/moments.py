"""The state at any time of a run: the run again, asked for more times."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from lagsim.language.arrays import Floats
    from lagsim.studies.attempts import Attempt


def rows_at(made: Attempt, times: Floats) -> Floats:
    """Give the rows (times, columns) of a run at any times of it.

    The run is repeated with the same steps, up to the last of the times. What a method
    gives between its steps is then what it gives for a row.

    Raises
    ------
    ValueError
        Where a time lies outside the run.
    """
    from lagsim.run.interrupt import Interrupt
    from lagsim.run.observers.moments import Moments

    first, last = made.trajectory.start, made.trajectory.end
    outside = ~((times >= first) & (times <= last))
    if outside.any():
        text = f"t = {float(times[outside][0])!r} lies outside the run, which goes"
        raise ValueError(f"{text} from {first!r} to {last!r}")
    different, places = np.unique(times, return_inverse=True)
    session, interrupt = made.session, Interrupt()
    moments = Moments(different, len(session.system.columns.names), interrupt)
    if len(different):
        asked = session.asking(moments=tuple(different.tolist()))
        asked.run([moments], interrupt=interrupt)
    return moments.rows[places.ravel()]
