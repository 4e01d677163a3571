"""Operation counts of an evaluation of the rates, and of a step."""

from __future__ import annotations

from typing import TYPE_CHECKING

from lagsim.mechanics.ldl import dense_operations, eliminated

if TYPE_CHECKING:
    from collections.abc import Sequence

    from lagsim.mechanics.equations import Equations
    from lagsim.mechanics.ldl import Elimination

# Evaluations in a step of order 8, and solves for its projection.
STAGES = 12
SOLVES = 4
# Operations of a step on each component of the state, per evaluation.
PER_COMPONENT = 16


def evaluation_cost(equations: Equations, nodes: Sequence[int], *, loops: bool) -> int:
    """Operations of an evaluation of `nodes`, with those of a solve by `loops`.

    What depends on parameters alone is computed once.
    """
    moving = {*equations.moving}
    solve = dense_operations(len(equations.q), len(equations.rows)) if loops else 0
    return solve + equations.graph.cost(nodes, moving)


def step_cost(equations: Equations) -> float:
    """Operations of a step, projection included."""
    solved = eliminated(equations)
    if solved is not None:
        return sum(step_parts(equations, solved))
    nodes = [*equations.mass_nodes, *equations.f, *_rates(equations)]
    nodes += [a for row in equations.rows for a in row.A.entries.values()]
    return sum(_parts(equations, evaluation_cost(equations, nodes, loops=True)))


def step_parts(equations: Equations, solved: Elimination) -> tuple[float, float]:
    """Operations of a step of order 8: of its projection, and of its stages."""
    q, lam = solved.motion()
    nodes = [*q, *lam, *_rates(equations)]
    return _parts(equations, evaluation_cost(equations, nodes, loops=False))


def _parts(equations: Equations, evaluation: float) -> tuple[float, float]:
    size = len(equations.state) + len(equations.quadratures)
    solves = SOLVES if equations.rows else 0
    return solves * evaluation, STAGES * (evaluation + PER_COMPONENT * size)


def _rates(equations: Equations) -> list[int]:
    first = [x.rate for x in equations.states]
    return first + [x.rate for x in equations.quadratures]
