"""Interpolation of the rows of a step one by one: the default `interpolate_rows`."""

from __future__ import annotations

from lagsim.language.arrays import Floats
from lagsim.methods.parts.parameters import Parameters
from lagsim.methods.parts.state import Clock, interpolate


def interpolate_rows(s: Clock, p: Parameters, rows: Floats, count: int) -> None:
    """Write the states at the times of rows (count, 1 + size) in the last step."""
    width = 1 + s.size
    for k in range(count):
        row = rows[k * width :]
        interpolate(s, p, (row[0] - s.step_t) / s.step_h, row[1:])
