"""What the pictures of one run have in common: its rows, names, units, events."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from lagsim.outputs.letters import Letters, raised

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from lagsim.run.observers.thinning import Thinning


@dataclass(frozen=True, slots=True)
class Record:
    """What the pictures of one run have in common.

    Attributes
    ----------
    title : the model's name; plain text, as everything that is written here.
    rows : the thinned rows of the run.
    units : unit of each column that has one; that of `t` too.
    events : times to mark, by the kind of what happens.
    note : below the title: that and why a run is incomplete; else empty.
    horizon : rows past this time are no forecast; infinite where all are.
    letters : how names are written.
    form : png, svg or pdf.
    is_sum : whether the energy is T + V, and not another energy function.
    """

    title: str
    rows: Thinning
    units: Mapping[str, str] = field(default_factory=dict)
    events: Mapping[str, Sequence[float]] = field(default_factory=dict)
    note: str = ""
    horizon: float = math.inf
    letters: Letters = field(default_factory=Letters)
    form: str = "png"
    is_sum: bool = True

    def unit(self, column: str) -> str:
        """Return the unit of a column, empty where none is known."""
        return raised(self.units.get(column, ""))

    def named(self, column: str) -> tuple[str, str]:
        """Return a column's name, as it is written, and its unit."""
        return self.letters.name(column), self.unit(column)

    def trusted(self) -> int:
        """Return how many of the points that paths show lie before the horizon."""
        return int(np.searchsorted(self.rows.sampled("t"), self.horizon, side="right"))
