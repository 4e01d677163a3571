"""What a motion keeps, whatever becomes of it: the ledger, the constraints, momenta."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lagsim.language.evaluate import evaluate

if TYPE_CHECKING:
    from lagsim.language.arrays import Floats
    from lagsim.mechanics.equations import Equations
    from lagsim.studies.golden.motion import Motion

LEDGER = "energy - work"
MOMENTUM = "momentum."


def invariants(equations: Equations, motion: Motion) -> dict[str, Floats]:
    """Give what should be constant, in the rows of a motion (rows,).

    That is the energy (less the work), each residual, and the momentum of each
    coordinate that neither the Lagrangian nor a force nor a constraint knows.
    """
    column = {name: motion.rows[:, k] for k, name in enumerate(motion.columns)}
    found = {}
    if "work" in column:
        found[LEDGER] = column["energy"] - column["work"]
    else:
        found["energy"] = column["energy"]
    found |= {n: values for n, values in column.items() if n.startswith("residual_")}
    free = _ignorable(equations)
    if free:
        states = [
            {"t": row[0]} | dict(zip(motion.columns[1:], row[1:], strict=True))
            for row in motion.rows
        ]
        parameters = {p.name: p.value for p in equations.model.parameters}
        nodes = [equations.momenta[k] for k in free]
        values = np.array(
            [evaluate(equations.graph, nodes, parameters | s) for s in states]
        )
        for place, k in enumerate(free):
            found[MOMENTUM + equations.q[k]] = values[:, place]
    return found


def _ignorable(equations: Equations) -> list[int]:
    """Give the numbers of the coordinates whose momenta are constant."""
    e, g = equations, equations.graph
    directions = [force.direction for force in e.model.forces]
    lost = [] if e.model.dissipation is None else [e.model.dissipation]
    # A force may act on a coordinate that only its direction names.
    pushed = g.depends([*directions, *lost])
    known = g.depends([e.model.lagrangian])
    held = {k for row in e.rows for k, node in enumerate(row.A) if node != g.zero}
    return [
        k
        for k, (q, v) in enumerate(zip(e.q, e.velocities, strict=True))
        if k not in held and q not in known and not pushed & {q, v}
    ]
