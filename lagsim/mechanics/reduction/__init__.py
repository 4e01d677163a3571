"""Fewer equations for the same motion: what is left out is recovered for the rows."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lagsim.language.evaluate import evaluate
from lagsim.mechanics.reduction.elimination import eliminated
from lagsim.mechanics.reduction.ignorable import ignored, momentum_of
from lagsim.model.model import Parameter

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from lagsim.language.arrays import Floats
    from lagsim.mechanics.equations import Equations
    from lagsim.mechanics.instant import Instant
    from lagsim.mechanics.reduction.elimination import Pair


class Reduction(NamedTuple):
    """The equations that are integrated, and what they leave out.

    Attributes
    ----------
    equations : Equations
        On the graph of the full ones.
    recovered : dict of int to int
        Variables that are left out (q_e, its rates, its multiplier) -> expressions of
        those that are integrated, their accelerations and multipliers.
    eliminated : tuple of (str, str)
        Coordinates, and the constraints that give them.
    ignored : tuple of str
        The ignorable coordinates.
    momenta : dict of str to int
        The parameter that each of their momenta is -> its node in the full state.
    """

    equations: Equations
    recovered: Mapping[int, int] = {}
    eliminated: tuple[tuple[str, str], ...] = ()
    ignored: tuple[str, ...] = ()
    momenta: Mapping[str, int] = {}

    def eliminate(self, found: Sequence[Pair]) -> Reduction:
        """Express coordinates by the others; of `elimination.pairs`."""
        e = self.equations
        equations, recovered = eliminated(e, found)
        names = [(e.q[pair.coordinate], e.rows[pair.row].name) for pair in found]
        return self._followed_by(equations, recovered)._replace(eliminated=tuple(names))

    def ignore(
        self, coordinates: Sequence[int], start: Instant, limit: float = math.inf
    ) -> Reduction:
        """Integrate `coordinates`, which are `ignorable`, by quadrature.

        Of the full equations only: first of all.

        Raises
        ------
        TooLongError
            Where solving for them takes more than `limit` multiplications.
        """
        e = self.equations
        momenta = {momentum_of(e.q[c]): e.momenta[c] for c in coordinates}
        equations, recovered = ignored(e, coordinates, limit)
        reduction = self._followed_by(equations, recovered)._replace(
            ignored=tuple(e.q[c] for c in coordinates),
            momenta=momenta,
        )
        model = equations.model
        added = tuple(Parameter(*x) for x in reduction.constants(start).items())
        model = replace(model, parameters=(*model.parameters, *added))
        return reduction._replace(equations=replace(equations, model=model))

    def kept(self, full: Floats) -> Floats:
        """Give the values (n,) of the coordinates left, or of their rates."""
        if len(full) == len(self.equations.q):
            return full
        names = (c.name for c in self.equations.model.coordinates)
        places = {name: k for k, name in enumerate(names)}
        return full[[places[name] for name in self.equations.q]]

    def constants(self, start: Instant) -> dict[str, float]:
        """Give the values of the momenta at a full start."""
        if not self.momenta:
            return {}
        model = self.equations.model
        values = {p.name: p.value for p in model.parameters} | {"t": start.t}
        for k, c in enumerate(model.coordinates):
            values[c.name] = float(start.q[k])
            values[f"{c.name}_dot"] = float(start.v[k])
        found = evaluate(model.graph, list(self.momenta.values()), values)
        return dict(zip(self.momenta, found, strict=True))

    def state(self, start: Instant, size: int) -> Floats:
        """Give y (size,) at a full start: q, q', the quadratures; all else from 0."""
        e, n = self.equations, len(self.equations.q)
        y = np.zeros(size)
        y[:n], y[n : 2 * n] = self.kept(start.q), self.kept(start.v)
        if e.quadratures:
            first = 2 * n + len(e.works)
            names = (c.name for c in e.model.coordinates)
            values = dict(zip(names, start.q, strict=True))
            for k, x in enumerate(e.quadratures, first):
                y[k] = values.get(x.name, 0.0)
        return y

    def _followed_by(
        self, equations: Equations, recovered: Mapping[int, int]
    ) -> Reduction:
        g = equations.graph
        earlier = g.substitute(self.recovered.values(), recovered)
        whole = dict(zip(self.recovered, earlier, strict=True)) | dict(recovered)
        return self._replace(equations=equations, recovered=whole)
