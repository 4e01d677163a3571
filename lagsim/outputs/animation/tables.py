"""The motion of one point, from the columns x and y (and z) of a table."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from lagsim.outputs.animation.film import ENERGIES, MOST_FRAMES, ONLY, Film, Track
from lagsim.run.observers.frames import Frames

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from lagsim.language.arrays import Floats
    from lagsim.notes import Event


def film_of_columns(
    name: str, columns: Mapping[str, Floats], events: Sequence[Event], **more: Any
) -> Film | None:
    """Give the motion of the point (x, y) or (x, y, z); None without these columns.

    Its rate is that of the columns x_dot, y_dot, ... where there are all of them; else
    it follows from the rows, on each side of an impact by itself.

    Parameters
    ----------
    more
        Further attributes of the film.
    """
    if not {"t", "x", "y"} <= columns.keys():
        return None
    axes = [axis for axis in "xyz" if axis in columns]
    rates = [f"{axis}_dot" for axis in axes]
    known = set(rates) <= columns.keys()
    names = ["t", *axes, *(rates if known else ())]
    names += [energy for energy in ENERGIES if energy in columns]
    frames = Frames(names, names, MOST_FRAMES)
    frames.add(np.stack([columns[name] for name in names], axis=1))
    kept = dict(zip(names, frames.table.T, strict=True))
    place = np.stack([kept[axis] for axis in axes], axis=1)
    if known:
        rate = np.stack([kept[name] for name in rates], axis=1)
    else:
        rate = _slopes(kept["t"], place)
    return Film(
        name, "", kept["t"], frames.broken | ~np.isfinite(rate).all(axis=1),
        {ONLY: Track(place, rate)},
        energies={k: kept[k] for k in ENERGIES if k in kept}, events=events, **more,
    )  # fmt: skip


def _slopes(t: Floats, place: Floats) -> Floats:
    """Give the rates of rows, by parabolas; nan where a row stands alone."""
    rate = np.full_like(place, np.nan)
    ends = [*(np.flatnonzero(np.diff(t) == 0.0) + 1), len(t)]
    first = 0
    for end in ends:
        rows = slice(first, end)
        if end - first > 1:
            edge: Literal[1, 2] = 2 if end - first > 2 else 1
            rate[rows] = np.gradient(place[rows], t[rows], axis=0, edge_order=edge)
        first = end
    return rate
