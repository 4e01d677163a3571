"""The estimated error of a run: what people read of it, and its picture."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lagsim.run.error import ErrorBar

if TYPE_CHECKING:
    from collections.abc import Mapping

    from matplotlib.figure import Figure


class Error(ErrorBar):
    """The estimated error of a run, from its difference to a repeat.

    Attributes
    ----------
    relative : float
        The largest error, as a part of the coordinate's range.
    horizon : float or None
        From this time on the error is too large for a forecast.
    coordinates : dict
        Of each coordinate its largest error, `largest` in its unit and `relative`, and
        when.
    method, rtol
        Of the repeat.
    times, errors : ndarray, shapes (k,) and (k, n)
        The errors of all coordinates, in their units, at the times compared.
    """

    units: Mapping[str, str]
    model: str

    @classmethod
    def of(cls, bar: ErrorBar, model: str, units: Mapping[str, str]) -> Error:
        """Give an estimate with the names and units of its model."""
        new = cls(*bar)
        new.model, new.units = model, units
        return new

    def _summary(self) -> list[tuple[str, str]]:
        from lagsim.outputs.notebook import listed

        tight = "" if self.rtol is None else f" at rtol {self.rtol:.2g}"
        found = self.coordinates
        worst = sorted(found, key=lambda name: -found[name].relative)
        each = [f"{q} {self._in_unit(q)} at t = {found[q].time:.4g}" for q in worst]
        ends = "none before the end"
        if self.horizon is not None:
            ends = f"no forecast past t = {self.horizon:.6g}"
        return [
            ("error", f"about {self.relative:.1g} of a coordinate's range"),
            ("largest", listed(each)),
            ("horizon", ends),
            ("from", f"a repeat by {self.method}{tight}"),
        ]

    def _in_unit(self, name: str) -> str:
        number = f"{self.coordinates[name].largest:.2g}"
        return f"{number} {self.units.get(name, '')}".rstrip()

    def __repr__(self) -> str:
        from lagsim.outputs.notebook import block

        return block(f"Error of {self.model}", self._summary())

    def _repr_html_(self) -> str:
        from lagsim.outputs.notebook import heading, picture, table
        from lagsim.outputs.sheet import content

        title = f"Error of {self.model}"
        drawn = picture(content(self.plot(), "png"), title)
        return "\n".join([heading(title), table(self._summary()), drawn])

    def plot(self) -> Figure:
        """Draw the error of each coordinate against time; nothing is shown."""
        from lagsim.outputs.figure import Column, figure
        from lagsim.outputs.letters import Letters, raised

        letters = Letters(self.names)
        columns = [
            Column(letters.name(q), raised(self.units.get(q, "")), errors)
            for q, errors in zip(self.names, np.abs(self.errors).T, strict=True)
        ]
        title = f"{self.model}: estimated errors"
        found = figure(title, Column("t", "s", self.times), columns)
        for axes in found.axes:
            axes.set_yscale("log", nonpositive="mask")
            axes.minorticks_off()
        return found
