"""Generalized forces, and generalized impulses of events, as graph nodes."""

from __future__ import annotations

from typing import TYPE_CHECKING

from lagsim.codes.known import NO_INERTIA
from lagsim.errors import Problem
from lagsim.model.model import Level

if TYPE_CHECKING:
    from collections.abc import Iterable

    from lagsim.language.graph import Graph
    from lagsim.mechanics.constraints import Flow
    from lagsim.mechanics.equations import Equations
    from lagsim.model.model import Force, Model


def generalized_forces(g: Graph, model: Model, flow: Flow) -> list[int]:
    """Return the generalized forces Q (n,): nodes.

    Q_j is the virtual work of the applied forces per unit of q_j, less dF/dq_j' for a
    dissipation function F.

    flow : the variables of the motion and their rates.
    """
    Q = _components(g, model.forces, flow)
    if model.dissipation is not None:
        losses = flow.gradient(g, model.dissipation, by_rates=True)
        for j, loss in losses.entries.items():
            Q[j] = g.call("sub", Q[j], loss)
    return Q


def generalized_impulses(e: Equations) -> list[list[int]]:
    """Return the generalized impulses (events, n) of the events of the file: nodes.

    The momentum of q_j jumps by sum_i J_i d r_i/d q_j.
    """
    return [_components(e.graph, x.impulses, e.flow) for x in e.model.events]


def without_momentum(e: Equations) -> list[int]:
    """Return the indices of coordinates that no impulse can move.

    These coordinates have no momentum, and no equality determines their velocities.
    """
    constrained = {j for x in e.relations if x.equal for j in x.row.A.entries}
    return [
        j for j, p in enumerate(e.momenta) if p == e.graph.zero and j not in constrained
    ]


def lost_impulses(e: Equations) -> list[Problem]:
    """Return a problem for each event with an impulse on a massless coordinate.

    No equality determines the velocity of that coordinate, see `without_momentum`.
    """
    still, found = without_momentum(e) if e.model.kicks else [], []
    for event in e.model.events if still else ():
        kick = _components(e.graph, event.impulses, e.flow)
        for j in (j for j in still if kick[j] != e.graph.zero):
            text = f"the event `{event.name}` gives an impulse to `{e.q[j]}`, which "
            text += "has no inertia, and no equality determines its velocity"
            hint = "give it a mass in `kinetic`, or the impulse another direction"
            found.append(Problem(NO_INERTIA, text, event.impulses[0].place, hint))
    return found


def _components(g: Graph, forces: Iterable[Force], flow: Flow) -> list[int]:
    """Return the components (n,) of forces, or impulses, along the coordinates.

    Component j is the sum, over all forces, of the force times dr/dq_j, where r is the
    expression of its direction (dr/dq_j' if r depends on velocities).

    flow : the variables of the motion and their rates.
    """
    Q = [g.zero] * len(flow.rates)
    for force in forces:
        by_rates = force.level is not Level.POSITION
        gradient = flow.gradient(g, force.direction, by_rates=by_rates)
        for j, slope in gradient.entries.items():
            Q[j] = g.call("add", Q[j], g.call("mul", force.node, slope))
    return Q
