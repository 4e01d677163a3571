"""Rows of a run at arbitrary times, by repeating the run with its own steps."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lagsim.run.interrupt import Interrupt
from lagsim.run.observers import Moments

if TYPE_CHECKING:
    from lagsim.language.arrays import Floats
    from lagsim.run.session import Session


def rows_at(session: Session, times: Floats) -> Floats:
    """Return the rows (k, columns) of a run at times (k,), in any order.

    The run is repeated with its own steps, and its dense output is evaluated.
    """
    interrupt = Interrupt()
    different, places = np.unique(times, return_inverse=True)
    moments = Moments(different, len(session.columns.names), interrupt)
    if len(different):
        asked = session.asking(moments=tuple(different.tolist()))
        asked.run([moments], interrupt=interrupt)
    return moments.rows[places]
