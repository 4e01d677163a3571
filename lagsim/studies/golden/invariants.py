"""What a motion keeps, whatever becomes of it: the ledger, the constraints, momenta."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lagsim.language.evaluate import evaluate
from lagsim.mechanics.laws import Kind
from lagsim.mechanics.reduction.ignorable import conserved, momentum_of

if TYPE_CHECKING:
    from collections.abc import Mapping

    from lagsim.language.arrays import Floats
    from lagsim.mechanics.equations import Equations
    from lagsim.studies.golden.motion import Motion

LEDGER = "energy - work"
RESIDUAL = "residual_"


def invariants(equations: Equations, motion: Motion) -> dict[str, Floats]:
    """Give what should be constant, in the rows of a motion (rows,).

    That is the energy (less the work), each residual, and the momentum of each
    coordinate that neither the Lagrangian nor a force nor a constraint knows. Of what
    stays >= 0 it is what lies below.
    """
    column = {name: motion.rows[:, k] for k, name in enumerate(motion.columns)}
    found = {}
    if "work" in column:
        found[LEDGER] = column["energy"] - column["work"]
    else:
        found["energy"] = column["energy"]
    found |= _residuals(equations, column)
    free = conserved(equations)
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
            found[momentum_of(equations.q[k])] = values[:, place]
    return found


def _residuals(equations: Equations, column: Mapping[str, Floats]) -> dict[str, Floats]:
    """Give what is zero in every row; nothing of what may be out of force."""
    found = {}
    kinds = {law.row.name: law for law in equations.laws}
    for name, values in column.items():
        law = kinds.get(name.removeprefix(RESIDUAL))
        if not name.startswith(RESIDUAL):
            continue
        if law is None:
            found[name] = values
        elif law.kind in (Kind.CONTACT, Kind.FREEWHEEL) and law.when is None:
            found[name] = np.minimum(values, 0.0)
    return found
