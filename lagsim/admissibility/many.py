"""Many starts of one scene at once: those that need no closer look.

Of a scene without constraints a start is admissible where energies and forces are
finite there and every direction has inertia. What may fail that is left to `examine`,
which says why.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lagsim.admissibility.inertia import PASSING
from lagsim.admissibility.metric import RANK
from lagsim.language.evaluate import evaluate_rows

if TYPE_CHECKING:
    from collections.abc import Mapping

    from lagsim.language.arrays import Flags, Floats
    from lagsim.mechanics.equations import Equations

# More than any bound asks for: what is closer to one is looked at by itself.
CLEAR = 2.0 * max(RANK, PASSING)


def needs_no_solve(equations: Equations) -> bool:
    """Tell whether a start is what it is stated to be, and has nothing to meet."""
    values = equations.model.initial
    return not (
        equations.rows
        or equations.laws
        or any(x.guess or x.node is not None for x in values)
    )


def clear_starts(
    equations: Equations, values: Mapping[str, float | Floats], count: int
) -> Flags:
    """Tell which of `count` starts are admissible, as far as that is clear (count,).

    Parameters
    ----------
    values
        t, parameters, coordinates and velocities: numbers, or arrays (count,).
    """
    e, model, n = equations, equations.model, len(equations.q)
    energies = (model.kinetic, model.potential, e.energy)
    named = [node for node in energies if node is not None]
    named += [*e.f, *e.inertias]
    M = [node for row in e.M for node in row]
    found = evaluate_rows(e.graph, [*named, *M], values, count)
    finite = np.all(np.isfinite(found), axis=0)
    mass = found[len(named) :].T.reshape(count, n, n)
    diagonal = np.diagonal(mass, axis1=1, axis2=2)
    clear: Flags = finite & np.all(diagonal > 0.0, axis=1)
    sizes = np.sqrt(diagonal[clear])
    scaled = mass[clear] / (sizes[:, :, None] * sizes[:, None, :])
    # LAPACK fails for what has overflowed on the way.
    sound = np.all(np.isfinite(scaled), axis=(1, 2))
    least = np.zeros(len(scaled))
    least[sound] = np.linalg.eigvalsh(scaled[sound])[:, 0]
    clear[clear] = least > CLEAR
    return clear
