"""Data shared by the pictures of one run: rows, names, units, events."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from lagsim.language.columns import DEVIATION
from lagsim.outputs.letters import Letters, raised_powers

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from lagsim.notes import Event
    from lagsim.run.observers.appended import Appended
    from lagsim.run.observers.thinning import Array, Thinning

    # Times, lower and upper ordinates, each (k,).
    Band: TypeAlias = tuple[Array, Array, Array]

# Kinds of events that absorb other events at the same time.
IMPACTS = ("impact", "corner", "zeno")


@dataclass(frozen=True, slots=True)
class PlotData:
    """Data shared by the pictures of one run.

    Attributes
    ----------
    title : str
        The model's name; plain text, as all texts of pictures.
    rows : Thinning
        The thinned rows of the run.
    units : mapping of str to str
        Unit of each column that has a unit, `t` included.
    events : mapping of str to sequence of float
        Times to mark, by kind of event.
    note : str
        Written below the title: the reason why a run is incomplete; else empty.
    horizon : float
        Time past which rows are no forecast; inf if all rows are.
    letters : Letters
        Typesetting of names.
    form : str
        png, svg or pdf.
    is_sum : bool
        Whether the energy is the sum of kinetic and potential energy, and not another
        energy function.
    appended : Appended or None
        Columns of sensitivities and standard deviations, beside the rows.
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
    appended: Appended | None = None

    def unit(self, column: str) -> str:
        """Return the unit of a column; "" if it is unknown."""
        return raised_powers(self.units.get(column, ""))

    def named(self, column: str) -> tuple[str, str]:
        """Return the typeset name of a column, and its unit."""
        return self.letters.name(column), self.unit(column)

    def has_band(self, columns: Iterable[str]) -> bool:
        """Whether at least one of some columns has a standard deviation."""
        known = self.appended.names if self.appended else ()
        return any(DEVIATION.of(name) in known for name in columns)

    def band(self, column: str, t: Array, values: Array) -> Band | None:
        """Return the band of one standard deviation of a column; None if it has none.

        The band consists of the times, and of the values less and plus one standard
        deviation, each of shape (k,). These are nan where the deviation is not known:
        off the output times, and where the motion is not differentiable.

        Parameters
        ----------
        column : str
        t, values : ndarray, shape (k,)
            Times of rows, and the values of the column there.
        """
        if self.appended is None or not self.has_band([column]):
            return None
        place = self.appended.names.index(DEVIATION.of(column))
        deviation = self.appended.at(t)[:, place]
        return t, values - deviation, values + deviation

    def trusted(self) -> int:
        """Return the number of points of a drawn path that lie before the horizon."""
        return int(np.searchsorted(self.rows.sampled("t"), self.horizon, side="right"))


def merged(events: Iterable[Event]) -> list[Event]:
    """Return the events that pictures mark.

    `until` is omitted; `zeno` of switches counts as `switch`; other events at the time
    of an impact, corner or `zeno` are omitted.
    """
    own = [
        e._replace(kind="switch") if e.kind == "zeno" and e.constraint is None else e
        for e in events
        if e.kind != "until"
    ]
    impacts = {e.time for e in own if e.kind in IMPACTS}
    return [e for e in own if e.kind in IMPACTS or e.time not in impacts]


def marked(events: Iterable[Event]) -> dict[str, list[float]]:
    """Return the times that pictures mark, by kind of event."""
    times: dict[str, set[float]] = {}
    for e in merged(events):
        times.setdefault(e.kind, set()).add(e.time)
    return {kind: sorted(own) for kind, own in times.items()}
