"""What the columns of a table are measured by.

The scale of a column is its range, but no less than a nominal size of its kind: what is
constant, or should be zero, has no range but its rounding errors. The kinds are told by
the names of the columns.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping, Sequence

    from lagsim.language.arrays import Floats

ENERGIES = ("kinetic", "potential", "lagrangian", "energy", "work")
# A range below this part of the size is that of rounding errors: pictures draw it flat
# there, too.
NOISE = 1e-9
# A column counts as no narrower than this part of the widest of its kind and unit, so
# that a coordinate that should stay zero is not measured by its noise.
SHARE = 1e-3


def kind(column: str, columns: Collection[str]) -> str:
    """Tell what a column holds."""
    for prefix in ("lambda_", "Qc_", "residual_"):
        if column.startswith(prefix):
            return prefix[:-1]
    if column in ENERGIES:
        return "energy"
    if column == "t":
        return "t"
    for level, ending in enumerate(("_ddot", "_dot", "")):
        stem = column.removesuffix(ending) if column.endswith(ending) else ""
        if stem and {stem, f"{stem}_dot", f"{stem}_ddot"} <= set(columns):
            return ("acceleration", "velocity", "position")[level]
    return "definition"


def scales(
    columns: Sequence[str], data: Floats, units: Mapping[str, str] | None = None
) -> Floats:
    """Give the scale of each column (columns,).

    - positions, velocities, accelerations, definitions, multipliers and constraint
      forces: the range, or the size where they do not vary; no less than SHARE of the
      widest of the kind (and unit, where units are known);
    - energies and work: the range, or that of the kinetic energy;
    - residuals: the largest coordinate, since they are to be compared with zero.

    Parameters
    ----------
    data : ndarray, shape (columns, rows)
    """
    low, high = _extremes(data)
    size = np.maximum(np.abs(low), np.abs(high))
    ranges = high - low
    wide = np.where(ranges > NOISE * size, ranges, size)
    present = frozenset(columns)
    kinds = [kind(column, present) for column in columns]
    groups = [
        (k, (units or {}).get(c, "")) for k, c in zip(kinds, columns, strict=True)
    ]
    found = wide.copy()
    for k, group in enumerate(groups):
        if kinds[k] not in ("t", "definition") or group[1]:
            alike = [i for i, other in enumerate(groups) if other == group]
            found[k] = max(found[k], SHARE * np.max(wide[alike]))
    moving = _moving(columns, wide)
    largest = max(
        (size[k] for k, what in enumerate(kinds) if what == "position"), default=0.0
    )
    for k, what in enumerate(kinds):
        if what == "energy":
            found[k] = max(ranges[k], moving) or wide[k]
        elif what == "residual":
            found[k] = max(ranges[k], largest)
    return found


def _moving(columns: Sequence[str], wide: Floats) -> float:
    """Give the range of the kinetic energy, or of what stands for it."""
    for name in ("kinetic", "lagrangian"):
        if name in columns:
            return float(wide[columns.index(name)])
    return 0.0


def _extremes(data: Floats) -> tuple[Floats, Floats]:
    """Give the least and the greatest finite value of each column; 0 without any."""
    low, high = np.zeros(len(data)), np.zeros(len(data))
    for k, values in enumerate(data):
        finite = values if np.isfinite(values).all() else values[np.isfinite(values)]
        if len(finite):
            low[k], high[k] = finite.min(), finite.max()
    return low, high
