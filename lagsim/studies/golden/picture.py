"""A picture of what differs from a golden: its worst columns and invariants."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lagsim.outputs.letters import letters_of
from lagsim.outputs.units import of_table
from lagsim.studies.comparison.picture import Curve, drawn, shown, thinned, told
from lagsim.studies.golden.invariants import invariants
from lagsim.studies.golden.judging import CONSTANT, aligned

if TYPE_CHECKING:
    from lagsim.language.arrays import Floats
    from lagsim.run.session import Case
    from lagsim.studies.golden.judging import Judgement
    from lagsim.studies.golden.motion import Motion
    from lagsim.studies.golden.storing import Stored


def picture(case: Case, motion: Motion, stored: Stored, judgement: Judgement) -> bytes:
    """Draw the worst columns of a judgement; give a PNG."""
    golden = stored.golden
    rows, t = aligned(motion, stored), golden.rows[:, 0]
    now = invariants(case.equations, motion)

    def values(column: str) -> tuple[Floats, Floats, Floats, Floats]:
        """Give times, golden, new and bound (k,)."""
        name = column.removesuffix(CONSTANT)
        if name == column:
            old = golden.rows[:, golden.columns.index(name)]
            new = rows[:, motion.columns.index(name)]
            return t, old, new, golden.bounds(name)
        kept, times = golden.invariants[name], motion.rows[:, 0]
        old, bound = (np.full(len(times), x) for x in (kept.value, kept.bound))
        return times, old, now[name], bound

    model = case.equations.model
    letters = letters_of(model)
    of = of_table(case.equations, golden.columns)
    curves = []
    for deviation in shown(judgement.worst):
        times, old, new, bound = values(deviation.column)
        kept = thinned()
        with np.errstate(invalid="ignore"):
            kept.add(np.stack((times, old, new, np.abs(new - old), bound), 1))
        name = deviation.column.removesuffix(CONSTANT)
        constant = CONSTANT if name != deviation.column else ""
        named = f"{letters.name(name)}{constant}", of.get(name, "")
        curves.append(Curve(deviation, named, kept))
    subject = ", ".join(told(judgement.worst, letters))
    title = f"{model.name} differs from its golden"
    return drawn(title, subject, curves, judgement.changed)
