"""Rates of frames in space by recursion, for trees of bodies.

A frame i with the matrix R_i on a parent p turns with the angular velocity, in space,

    w_i = w_p + R_i e_i,        R_i' = w_i x R_i,

where e_i is its angular velocity relative to p. In these sums each velocity has the
axis of its joint as coefficient, wherever it is in the tree: the energies of bodies are
squares of the w_i and of velocities of points, which are sums along the tree, too, so
that `chains` finds the articulated bodies. R' derived from R = R_p E, with E the
rotation relative to p, would have nine sums for each frame, whose coefficients and
roundoff bounds grow with the depth. The derivative of R with respect to q is that of R'
with respect to q'.

Source: R. Featherstone, Rigid Body Dynamics Algorithms, sections 2.8 and 7.3.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from lagsim.language.derivatives import tangent
from lagsim.language.evaluate import roundings
from lagsim.language.graph import VARIABLE
from lagsim.mechanics.chains import chains

if TYPE_CHECKING:
    from collections.abc import Collection, Sequence

    from lagsim.language.graph import Graph
    from lagsim.mechanics.chains import Chains
    from lagsim.mechanics.constraints import Flow
    from lagsim.model.model import Model, TurningFrame


# Rotations of a body by three angles, or of a wheel on a body: the rates of their
# products are shorter than recursions.
NESTED = 3


# Roundoff of an entry of a product of two rotations, in units of the roundoff: of
# three products and two sums, whose magnitudes add up to at most 1.
ROTATED = 1.0


class TreeOfFrames(NamedTuple):
    """Lagrangian of bodies on frames, written with angular velocities in space.

    Attributes
    ----------
    lagrangian : int
        L with the rates and angular velocities of frames by recursion: a node.
    turned : dict
        Entry of the matrix of a frame -> its rate, nodes.
    chains : Chains
        The kinetic energy as squares of the sums of velocities along the tree.
    frames : tuple of TurningFrame
        The frames, parents first.
    """

    lagrangian: int
    turned: dict[int, int]
    chains: Chains
    frames: tuple[TurningFrame, ...]

    def is_rigid(self, g: Graph, q: Collection[str]) -> bool:
        """Whether the kinetic energy depends on the coordinates q by rotations only."""
        cone = g.cone(self.chains.nodes, self.turned)
        names = {g.payload(n) for n in cone if g.ops[n] == VARIABLE}
        return names.isdisjoint(q)

    def roundings(
        self, g: Graph, moving: Collection[str], state: Collection[str]
    ) -> dict[int, int]:
        """Return bounds of the roundoff of the entries of frames' matrices, as nodes.

        Rotations keep the lengths of vectors, so that errors add up along the tree, and
        independent errors by their squares. Bounds from the magnitudes of entries would
        grow by a factor with each frame.

        moving, state : see `evaluate.roundings`.
        """
        found = list[int]()
        known: dict[int, int] = {}
        for frame in self.frames:
            before = found[frame.parent] if frame.parent >= 0 else g.zero
            turn = [node for row in frame.turn for node in row]
            errors = sorted({*roundings(g, turn, moving, state)})
            own = g.call("add", g.constant(ROTATED), g.sum(errors))
            squares = g.product_sum([(before, before), (own, own)])
            found.append(g.call("sqrt", squares))
            entries = {node for row in frame.rows for node in row}
            entries |= {g.call("neg", node) for node in entries}
            entries &= self.turned.keys()
            known |= dict.fromkeys(entries - known.keys(), found[-1])
        return known


def tree_of_frames(model: Model, flow: Flow) -> TreeOfFrames | None:
    """Return the tree of the frames of a model.

    None where no more than NESTED rotations are composed, or L has no rates of frames.

    flow : the variables of the motion and their rates.
    """
    depths: list[int] = []
    for frame in model.frames:
        depths.append(1 + (depths[frame.parent] if frame.parent >= 0 else 0))
    if max(depths, default=0) <= NESTED:
        return None
    g = model.graph
    angular: list[tuple[int, ...]] = []
    turned: dict[int, int] = {}
    new: dict[int, int] = {}
    for frame in model.frames:
        before = angular[frame.parent] if frame.parent >= 0 else (g.zero,) * 3
        own = [g.product_sum(zip(row, frame.own, strict=True)) for row in frame.rows]
        w = tuple(g.call("add", *pair) for pair in zip(before, own, strict=True))
        angular.append(w)
        columns = list(zip(*frame.rows, strict=True))
        for column in columns:
            for node, rate in zip(column, _crossed(g, w, column), strict=True):
                turned |= _with_negative(g, node, rate) if g.args[node] else {}
        for node, column in zip(frame.omega, columns, strict=True):
            if g.args[node]:
                new[node] = g.product_sum(zip(column, w, strict=True))
    rates = tangent(g, turned, flow.forward)
    pairs = zip(rates, turned.values(), strict=True)
    new |= {old: rate for old, rate in pairs if g.args[old]}
    (lagrangian,) = g.substitute([model.lagrangian], new)
    if lagrangian == model.lagrangian:
        return None
    found = chains(g, lagrangian, flow.rates, flow.velocities)
    if found is None or not found.sums:
        return None
    return TreeOfFrames(lagrangian, turned, found, model.frames)


def _with_negative(g: Graph, node: int, rate: int) -> dict[int, int]:
    """Return a mapping of a node to its rate, and of its negative to the negative rate.

    The negative of a difference a - b is the node b - a, which may exist in the graph.
    """
    found, negative = {node: rate}, g.call("neg", node)
    if g.ops[negative] != "neg" and g.args[negative]:
        found[negative] = g.call("neg", rate)
    return found


def _crossed(g: Graph, a: Sequence[int], b: Sequence[int]) -> list[int]:
    """Return the vector product a x b as nodes, shape (3,)."""
    pairs = ((1, 2), (2, 0), (0, 1))
    return [
        g.call("sub", g.call("mul", a[i], b[j]), g.call("mul", a[j], b[i]))
        for i, j in pairs
    ]
