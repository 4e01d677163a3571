"""How a scene's equations are solved: on the graph, from a tape, or by loops."""

from __future__ import annotations

from typing import TYPE_CHECKING

from lagsim.admissibility.point import Point
from lagsim.language.evaluate import evaluate
from lagsim.language.sparse import TooLongError
from lagsim.mechanics.ldl import BUDGET, Elimination, affordable, dense_operations
from lagsim.methods import method
from lagsim.notes import Choice
from lagsim.plan.newton import newton_of
from lagsim.plan.plan import WELL_CONDITIONED

if TYPE_CHECKING:
    from collections.abc import Sequence

    from lagsim.admissibility.report import Start
    from lagsim.mechanics.equations import Equations, Instant

# Loops of so many multiplications take a millisecond: that is no reason to do without
# their QR decomposition.
CHEAP = 10**6
# Code that fills in more entries of M and A than these compiles for long.
MOST_ENTRIES = 10_000
# Functions of as many slopes as n (n + m), twice: see `system.functions`.
SLOPES = frozenset(("jacobian", "lagrangian"))


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
    reason = f"the constraints are nearly dependent ({start.ranks.smallest:.1e})"
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
    where = (
        ("of entries that are not zero") if equations.chains is None else "along chains"
    )
    if count <= BUDGET:
        told = many if equations.chains is None else f"{many} {where}"
        choices.append(Choice("solve: straight-line code", told))
    else:
        reason = f"{many} {where}; loops would take {dense}"
        choices.append(Choice("solve: sparse elimination", reason))
    return elimination


def from_tape(equations: Equations, elimination: Elimination | None) -> bool:
    """Tell whether compiled code would be too long."""
    if elimination is not None:
        return elimination.operations > BUDGET
    if equations.chains is not None:  # whose M is full, and made where it is read
        return len(equations.q) ** 2 > MOST_ENTRIES
    rows = sum(len(row.A.entries) for row in equations.rows)
    return sum(len(row.entries) for row in equations.M) + rows > MOST_ENTRIES


def many_slopes(
    name: str,
    equations: Equations,
    elimination: Elimination | None,
    choices: list[Choice],
) -> bool:
    """Tell whether the slopes that a method needs would compile for long."""
    n, m = len(equations.q), len(equations.rows)
    sparse = None if elimination is None else newton_of(name, equations)
    slopes = 2 * n * (n + m)
    if sparse is not None:
        slopes = len(sparse.entries)
        reason = f"{slopes} entries; {sparse.operations} multiplications factor them"
        choices.append(Choice("Newton's matrix: sparse", reason))
    if not SLOPES.intersection(method(name).NEEDS) or slopes <= MOST_ENTRIES:
        return False
    choices.append(Choice("tapes", f"{slopes} derivatives would take long to compile"))
    return True


def independence_of(
    equations: Equations,
    start: Instant,
    lengths: Sequence[float],
    elimination: Elimination,
) -> float:
    """Give how independent the rows are at the start by the pivots of `elimination`."""
    values = Point(equations, start.t).values(start.q, start.v)
    for row, length in zip(equations.rows, lengths, strict=True):
        values[f"length.{row.name}"] = length
    return float(evaluate(equations.graph, [elimination.health()], values)[0])


def set_aside(equations: Equations, start: Start) -> tuple[bool, ...]:
    """Tell which rows others imply everywhere, shape (m,)."""
    implied = {d.name for d in start.ranks.dependences if d.everywhere is not False}
    return tuple(row.name in implied for row in equations.rows)
