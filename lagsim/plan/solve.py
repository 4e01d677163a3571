"""How a scene's equations are solved: on the graph, from a tape, or by loops."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lagsim.admissibility.large import is_large, row_lengths
from lagsim.admissibility.point import Point
from lagsim.admissibility.rank import scaled_rows
from lagsim.admissibility.start import metric_of
from lagsim.expressions.evaluate import evaluate
from lagsim.formulation import Choice
from lagsim.kkt.straight import (
    BUDGET,
    Elimination,
    TooLongError,
    affordable,
    dense_operations,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from lagsim.admissibility import Start
    from lagsim.equations import Equations
    from lagsim.native.kernel_types import Floats

# Normal equations square the condition of the rows: below this the loops with their QR
# decomposition take over (numerics: S loses half of the digits of lambda).
WELL_CONDITIONED = 1e-2
# Loops of so many multiplications take a millisecond: that is no reason to do without
# their QR decomposition.
CHEAP = 10**6
# Code that fills in more entries of M and A than these compiles for long.
MOST_ENTRIES = 10_000
# How many states tell how long the rows usually are, and how far around the start.
AROUND = 4
NEARBY = 0.1


def eliminate(
    equations: Equations,
    start: Start,
    lengths: Sequence[float],
    choices: list[Choice],
) -> Elimination | None:
    """Solve on the graph; None, with the reason among the choices, where loops do."""
    if start.augmented:
        return None
    if start.ranks.rank < len(equations.rows):
        reason = f"{len(equations.rows)} constraints have rank {start.ranks.rank}"
        choices.append(Choice("solve: loops with QR, least-norm lambda", reason))
        return None
    n, m = len(equations.q), len(equations.rows)
    dense = dense_operations(n, m)
    close = start.ranks.smallest < WELL_CONDITIONED
    reason = f"the rows are nearly dependent ({start.ranks.smallest:.1e})"
    if close and dense <= CHEAP:
        choices.append(Choice("solve: loops with QR", reason))
        return None
    try:
        elimination = Elimination(equations, affordable(n, m))
    except TooLongError:
        text = f"elimination saves too little of their {dense} multiplications"
        choices.append(Choice("solve: loops", text))
        return None
    if close:
        independence = independence_of(equations, start, lengths, elimination)
        if independence < WELL_CONDITIONED:
            slow = f"{reason}, at the price of {dense} multiplications"
            choices.append(Choice("solve: loops with QR", slow))
            return None
    count = elimination.operations
    many = f"{count} multiplication{'s' * (count != 1)}"
    if count <= BUDGET:
        choices.append(Choice("solve: straight-line code", many))
    else:
        reason = f"{many} on what is not zero; loops would make {dense}"
        choices.append(Choice("solve: sparse elimination", reason))
    return elimination


def from_tape(equations: Equations, elimination: Elimination | None) -> bool:
    """Tell whether compiled code would be too long."""
    if elimination is not None:
        return elimination.operations > BUDGET
    return len(equations.q) * (len(equations.q) + len(equations.rows)) > MOST_ENTRIES


def independence_of(
    equations: Equations,
    start: Start,
    lengths: Sequence[float],
    elimination: Elimination,
) -> float:
    """Give how independent the rows are at the start by the pivots of `elimination`."""
    values = Point(equations).values(start.q, start.v)
    for row, length in zip(equations.rows, lengths, strict=True):
        values[f"length.{row.name}"] = length
    return float(evaluate(equations.graph, [elimination.health()], values)[0])


def set_aside(equations: Equations, start: Start) -> tuple[bool, ...]:
    """Tell which rows others imply everywhere, shape (m,)."""
    implied = {d.name for d in start.ranks.dependences if d.everywhere is not False}
    return tuple(row.name in implied for row in equations.rows)


def usual_lengths(equations: Equations, start: Start) -> tuple[float, ...]:
    """Give the largest length of each row at the start and around it."""
    if not equations.rows:
        return ()
    point = Point(equations)
    random = np.random.default_rng(4)  # the same states each time
    longest = np.zeros(len(equations.rows))
    for nearby in range(AROUND):
        q, v = start.q, start.v
        if nearby:
            q, v = (_kicked(x, random) for x in (start.q, start.v))
        if is_large(point):
            found = row_lengths(point, q, v)
            if np.all(np.isfinite(found)):
                longest = np.fmax(longest, found)
                continue
        M = point.mass(q, v)
        if np.all(np.isfinite(M)):
            metric = metric_of(M, range(len(q)))
            longest = np.fmax(longest, scaled_rows(point, q, v, metric)[1])
    return tuple(map(float, longest))


def _kicked(x: Floats, random: np.random.Generator) -> Floats:
    size = np.abs(x) + (np.max(np.abs(x), initial=0.0) or 1.0)
    return x + NEARBY * size * random.standard_normal(len(x))
