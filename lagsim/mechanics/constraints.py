"""Equality constraints on the graph: residuals, rates, the rows of A and b.

Holonomic g(q, t) = 0: A = dg/dq, its rate is A q' + g_t, and A q'' = b with
b = -d^2 g/dt^2 at constant q'. Nonholonomic phi(q, q', t) = 0: A = dphi/dq'
(Chetaev's rule where phi is not linear), its rate is phi, b = -(phi_q q' + phi_t).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from lagsim.language.derivatives import gradient, slopes, tangent
from lagsim.language.rounding import addends
from lagsim.language.sparse import SparseVector

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from lagsim.language.graph import Graph


class Row(NamedTuple):
    """One constraint where it holds as an equality, as nodes.

    Attributes
    ----------
    residual : int
        g, or phi.
    rate : int
        What must vanish on the level of velocities: A q' + g_t, or phi.
    A : SparseVector, shape (n,)
    b : int
    transport : int
        A q' on the constraint: -g_t, or A q' for phi not homogeneous in q', else 0.
        Its product with lambda is the constraint's power.
    residual_scale, rate_scale : int
        The largest of the terms and of |q_i dg/dq_i| (of |q'_i d rate/d q'_i|): what a
        residual is compared with, so that units do not matter.
    """

    name: str
    holonomic: bool
    residual: int
    rate: int
    A: SparseVector
    b: int
    transport: int
    residual_scale: int
    rate_scale: int
    scleronomic: bool
    pfaffian: bool


class Flow:
    """The variables of motion, as nodes: what rows are differentiated by.

    Attributes
    ----------
    positions, rates : tuple of int, shape (n,)
    places, velocities : frozenset of str
        The names of what positions depend on, time included; and of the rates.
    forward : dict
        The total time derivative at constant q': variable -> rate.
    """

    def __init__(self, g: Graph, q: Sequence[str], velocities: Sequence[str]) -> None:
        self.positions = tuple(g.variable(name) for name in q)
        self.rates = tuple(g.variable(name) for name in velocities)
        self.places, self.velocities = frozenset((*q, "t")), frozenset(velocities)
        self.forward = dict(zip(self.positions, self.rates, strict=True))
        self.forward[g.variable("t")] = g.one
        self.indices = [
            {v: j for j, v in enumerate(group)}
            for group in (self.positions, self.rates)
        ]

    def gradient(self, g: Graph, node: int, *, by_rates: bool) -> SparseVector:
        """Give d node / d q, or d node / d q'."""
        index = self.indices[by_rates]
        here = frozenset(v for v in g.cone([node]) if v in index)
        found = slopes(g, node, here)
        entries = {index[v]: slope for v, slope in found.items()}
        return SparseVector(g, len(index), entries)


def constraint_row(g: Graph, name: str, node: int, flow: Flow) -> Row:
    """Derive the row of an equality constraint `node` = 0."""
    from lagsim.language.products import slow_factors_first  # of constraints

    names = g.depends([node])
    holonomic = not names & flow.velocities
    A = flow.gradient(g, node, by_rates=not holonomic)
    moved = g.product_sum((slope, flow.rates[j]) for j, slope in A.entries.items())
    if holonomic:
        drift = gradient(g, node, [g.variable("t")])[0]
        # Forward, common differences stay as they are: d^2 + ... has 2*d*d' + ...
        rate = tangent(g, [node], flow.forward)[0]
        transport = g.call("neg", drift)
        residual_scale = scale_of(g, node, flow.positions, A.entries)
    else:
        rate = node
        degrees = g.degree(node, flow.velocities)
        homogeneous = degrees is not None and len(degrees) == 1
        transport = g.zero if homogeneous else moved
        residual_scale = scale_of(g, node, flow.rates, A.entries)
    degrees = g.degree(rate, flow.velocities)
    fall = g.call("neg", tangent(g, [rate], flow.forward)[0])
    return Row(
        name=name,
        holonomic=holonomic,
        residual=node,
        rate=rate,
        A=A,
        b=slow_factors_first(g, [fall], flow.places, flow.velocities)[0],
        transport=transport,
        residual_scale=residual_scale,
        rate_scale=scale_of(g, rate, flow.rates, A.entries),
        scleronomic="t" not in names,
        pfaffian=degrees is not None and degrees <= frozenset((0, 1)),
    )


def scale_of(
    g: Graph, node: int, variables: Sequence[int], entries: Mapping[int, int]
) -> int:
    """Give the largest of the terms of `node` and of |variable * slope|."""
    sizes = [g.call("abs", term) for term in addends(g, node)]
    sizes += [
        g.call("abs", g.call("mul", variables[j], slope))
        for j, slope in entries.items()
    ]
    largest = g.zero
    for size in sizes:
        largest = g.call("max", largest, size)
    return largest
