"""What the pictures of one run have in common: its rows, names, units, marks."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from lagsim.outputs.curves import LOST, MARKS, OTHERS, Mark, marks, shade
from lagsim.outputs.figure import WIDTH, Picture
from lagsim.outputs.letters import Letters, raised
from lagsim.outputs.scale import Scale, time_scale

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from matplotlib.axes import Axes

    from lagsim.outputs.figure import Pen
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
    note : said below the title: that and why a run is incomplete; else empty.
    horizon : rows past this time are no forecast; infinite where all are.
    letters : how names are written.
    form : png, svg or pdf.
    """

    title: str
    rows: Thinning
    units: Mapping[str, str] = field(default_factory=dict)
    events: Mapping[str, Sequence[float]] = field(default_factory=dict)
    note: str = ""
    horizon: float = math.inf
    letters: Letters = field(default_factory=Letters)
    form: str = "png"

    def picture(
        self,
        height: float,
        subject: str,
        *,
        width: float = WIDTH,
        timed: bool = True,
    ) -> Picture:
        """Return a picture with the model's name, what it shows, and its marks."""
        return Picture(
            height, self.title, subject, width=width, legend=self.legend(timed=timed),
            remarks=[self.note] if self.note else (),
        )  # fmt: skip

    def unit(self, column: str) -> str:
        """Return the unit of a column, empty where none is known."""
        return raised(self.units.get(column, ""))

    def named(self, column: str) -> tuple[str, str]:
        """Return a column's name, as it is written, and its unit."""
        return self.letters.name(column), self.unit(column)

    def marks(self) -> list[tuple[Mark, Sequence[float]]]:
        """Return what there is to mark: how it is called and looks, and its times."""
        known = [(look, self.events.get(kind, ())) for kind, look in MARKS.items()]
        others = [t for k, own in self.events.items() if k not in MARKS for t in own]
        return [(look, times) for look, times in (*known, (OTHERS, others)) if times]

    def mark(self, axes: Axes) -> None:
        """Mark them on Axes against time, and shade what is no forecast."""
        shade(axes, self.horizon)
        for look, times in self.marks():
            marks(axes, times, look)

    def legend(self, *, timed: bool = True) -> list[tuple[str, Pen]]:
        """Return the names of marks and of the shade, and how they look."""
        entries: list[tuple[str, Pen]] = []
        if timed:
            entries += [(mark.name, mark.top) for mark, _ in self.marks()]
        if self.horizon < self.rows.last("t"):
            entries.append(("past the horizon", {"color": LOST, "linewidth": 6.0}))
        return entries

    def trusted(self) -> int:
        """Return how many of the points that paths show lie before the horizon."""
        return int(np.searchsorted(self.rows.sampled("t"), self.horizon, side="right"))

    def time(self) -> Scale:
        """Return the scale of time, from the first row to the last."""
        return time_scale(np.array([self.rows.first("t"), self.rows.last("t")]))
