"""Newton's law of what is squared in L: masses, forces and drifts, each by itself.

With the sums of `chains` as velocities of their own beside q', where L has constant
masses,

    M_u u'' = force_u + what holds u to the others,    s_k'' = sum c_ki u_i'' + drift_k

for sums that are rates of positions, see `bias`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from lagsim.language.derivatives import rate_of, slopes
from lagsim.mechanics.bias import rates_of_places
from lagsim.mechanics.chains import chains
from lagsim.mechanics.constraints import Flow
from lagsim.model.model import Level

if TYPE_CHECKING:
    from lagsim.language.graph import Graph
    from lagsim.mechanics.chains import Chains
    from lagsim.mechanics.equations import Equations

Vector = dict[int, int]  # unknown -> node; what is absent is zero


class Newton(NamedTuple):
    """The law of each unknown: velocities 0 to n - 1, and the sums.

    Attributes
    ----------
    sums : dict
        Sum k: its factor of each unknown in it.
    masses, forces : dict
        Of each unknown that has one.
    drifts : dict
        Of each sum: its rate where all unknowns keep theirs.
    """

    sums: dict[int, Vector]
    masses: Vector
    forces: Vector
    drifts: Vector


def newton(e: Equations) -> Newton | None:
    """Give the laws; None where masses move, couple, or are of no positions."""
    g, model = e.graph, e.model
    if e.q != tuple(c.name for c in model.coordinates):
        return None  # reduced
    flow = Flow(g, e.q, e.velocities)
    moving = (*e.q, "t")
    found = chains(g, model.lagrangian, flow.rates, flow.velocities, moving)
    if found is None:
        return None
    places = rates_of_places(model, flow)
    apart = _Apart(g, flow, found, places)
    forces, dissipation = model.forces, model.dissipation
    nodes = [model.lagrangian, *(force.direction for force in forces)]
    nodes += [] if dissipation is None else [dissipation]
    lagrangian, *directions = g.substitute(nodes, apart.new)

    slope = slopes(g, lagrangian, apart.variables)
    masses = apart.by(slope, rates=True)
    for u, momentum in masses.items():
        mass = slopes(g, momentum, apart.variables)
        variable = apart.rates[u]
        if mass.keys() != {variable} or g.depends([mass[variable]]) & apart.moving:
            return None
        masses[u] = mass[variable]
    if any(k not in apart.places for k in apart.sums.keys() & masses.keys()):
        return None
    total = apart.by(slope, rates=False)
    levels = [force.level is not Level.POSITION for force in forces]
    works = [force.node for force in forces]
    if dissipation is not None:
        levels, works = [*levels, True], [*works, g.constant(-1.0)]
    for direction, by_rates, work in zip(directions, levels, works, strict=True):
        levers = apart.by(slopes(g, direction, apart.variables), rates=by_rates)
        for u, lever in levers.items():
            term = g.call("mul", work, lever)
            total[u] = g.call("add", total.get(u, g.zero), term)
    back = {v: old for old, v in apart.new.items() if v in apart.variables}
    written = g.substitute(total.values(), back)
    total = {u: node for u, node in zip(total, written, strict=True) if node != g.zero}
    sums = dict(enumerate(found.sums, found.size))
    return Newton(sums, masses, total, _drifts(g, flow, apart.sums))


class _Apart:
    """Variables in place of the sums and their positions.

    Attributes
    ----------
    sums : dict
        Sum -> its node.
    new : dict
        The nodes that are variables here.
    rates, places : dict
        Unknown -> the variable of it, and of what it is the rate of.
    """

    def __init__(
        self, g: Graph, flow: Flow, found: Chains, places: dict[int, int]
    ) -> None:
        self.g = g
        self.sums = dict(enumerate(found.rates, found.size))
        self.rates = dict(enumerate(flow.rates))
        self.places = dict(enumerate(flow.positions))
        self.new: dict[int, int] = {}
        for k, rate in self.sums.items():
            self.rates[k] = self.new[rate] = g.variable(f"rate.{k}")
            place = places.get(rate)
            back = places.get(g.call("neg", rate))
            if place is None and back is not None:
                place = g.call("neg", back)  # (-x)^2 is written as x^2
            if place is not None:
                self._place(k, place)
        known = [*self.rates.values(), *self.places.values(), g.variable("t")]
        self.variables = frozenset(known)
        self.moving = g.depends(known)

    def _place(self, k: int, place: int) -> None:
        g = self.g
        self.places[k] = self.new[place] = g.variable(f"place.{k}")
        if g.ops[place] == "neg":  # a + (-b) is written as a - b
            self.new.setdefault(g.args[place][0], g.call("neg", self.places[k]))

    def by(self, found: dict[int, int], *, rates: bool) -> Vector:
        """Give what is found by variable by unknown."""
        variables = self.rates if rates else self.places
        return {u: found[v] for u, v in variables.items() if v in found}


def _drifts(g: Graph, flow: Flow, sums: dict[int, int]) -> Vector:
    """Give the rate of each sum where velocities, and the sums in it, keep theirs."""
    of = {node: k for k, node in sums.items()}
    moving = dict(flow.forward)
    drifts: Vector = {}
    for n in g.cone(of):
        if n in moving or not any(a in moving for a in g.args[n]):
            continue
        rate = rate_of(g, n, moving)
        if n in of:
            drifts[of[n]] = rate
        else:
            moving[n] = rate
    return drifts
