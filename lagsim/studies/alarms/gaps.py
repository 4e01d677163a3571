"""Columns of the table that are not finite everywhere."""

from __future__ import annotations

from typing import TYPE_CHECKING

from lagsim.notes import Caution

if TYPE_CHECKING:
    from collections.abc import Mapping

    from lagsim.run.overflow import Gap

# So many columns are named one by one; the others are counted.
MOST = 12


def about_gaps(found: Mapping[str, Gap]) -> Caution:
    """Name them, in the order of the table, with the first value and its time."""
    named = list(found.items())
    told = [
        f"`{name}` is {gap.value} at t = {gap.time:.9g}"
        + (f", the first of {gap.rows} rows" if gap.rows > 1 else "")
        for name, gap in named[:MOST]
    ]
    text = f"not all values of the table are finite: {'; '.join(told)}"
    if len(named) > MOST:
        text += f"; and {len(named) - MOST} more columns"
    if "energy" in found or "work" in found:
        text += "; so the energy drift is not known"
    return Caution("column-not-finite", text)
