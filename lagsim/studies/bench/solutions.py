"""Solutions as tight as can be, by different means: what a reference is made of."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from lagsim.errors import InputError
from lagsim.studies.bench.scipy_solvers import PREFIX, Scipy
from lagsim.studies.bench.scipy_solvers import refusal as scipy_refusal
from lagsim.studies.bench.solving import GivenUpError, Own, Patience, Solver

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from lagsim.language.arrays import Floats
    from lagsim.notes import Event
    from lagsim.run.session import Case

# The first of these that a scene lets through makes the reference ...
FIRST = ("taylor", "dop853")
# ... and the one of these that comes closest to it verifies it.
SECOND = ("taylor", "dop853", "kahan-li8", "gauss4", "radau", "rk4")
TOLERANCES = (1e-14, 1e-13, 1e-12, 1e-10, 1e-8, 1e-6)
SCIPY_TOLERANCE = 3e-14
# Fixed steps are halved this often, from a quarter of a row's spacing on, ...
HALVINGS = 10
# Ranges are those of the motion, not of rows that may lie a period apart.
MOMENTS = 4001


@dataclass(frozen=True, slots=True)
class Solution:
    """Rows, what their columns are, and how they were made."""

    how: str
    method: str
    value: float
    columns: tuple[str, ...]
    rows: Floats
    events: Sequence[Event] = ()


def tightest(case: Case, patience: Patience) -> Iterator[Solution]:
    """Give solutions, the tightest first."""
    for name in FIRST:
        if own := _able(case, name):
            yield from _solved(own, TOLERANCES, patience)


def _able(case: Case, name: str) -> Own | None:
    """Give a method that is there and can handle the scene."""
    try:
        return Own(case, name)
    except InputError:
        return None


def others(case: Case, first: Solution, patience: Patience) -> Iterator[Solution]:
    """Give solutions by other methods; where there are none, by its own."""
    found = False
    for solution in _by_others(case, first, patience):
        found = True
        yield solution
    if not found and (own := _able(case, first.method)):
        steps = own.setting == "step"
        values = (
            _steps(own)[:1] if steps else [x for x in TOLERANCES if x > first.value]
        )
        yield from _solved(own, values, patience)


def _by_others(case: Case, first: Solution, patience: Patience) -> Iterator[Solution]:
    for name in SECOND:
        if name != first.method and (own := _able(case, name)):
            values = _steps(own) if own.setting == "step" else TOLERANCES
            yield from _solved(own, values, patience)
    yield from _by_scipy(case, first, patience)


def _by_scipy(case: Case, first: Solution, patience: Patience) -> Iterator[Solution]:
    own = index_one(case)
    if not scipy_refusal(own):
        sizes = state_sizes(own, first.rows)
        solver = Scipy(own, f"{PREFIX}DOP853", first.rows[:, 0], sizes)
        yield from _solved(solver, (SCIPY_TOLERANCE,), patience)


def index_one(case: Case) -> Own:
    """Give what has the right-hand side with lambda solved away, and nothing else."""
    return Own(case, "dop853", "drift" if case.equations.rows else "full")


def state_sizes(own: Own, rows: Floats) -> Floats:
    """Give the largest size of each component of y, none of them 0."""
    wanted = [*own.case.equations.q, *own.case.equations.velocities]
    wanted += [x.name for x in own.system.equations.works]
    sizes = [float(np.max(np.abs(rows[:, own.names.index(name)]))) for name in wanted]
    whole = max(sizes) or 1.0
    return np.array([size or whole for size in sizes])


def _solved(
    solver: Solver, values: Sequence[float], patience: Patience
) -> Iterator[Solution]:
    """Give the solution at the tightest tolerance that can be met, or for each step."""
    left = iter(values)
    for value in left:
        try:
            solved = solver.solve(value, patience)
        except GivenUpError:
            if patience.pressed:
                raise
            if solver.setting == "step":
                return
            # A little looser takes as long.
            next(left, None)
            continue
        if solved.rows is not None:
            how = f"{solver.method} at {solver.setting} {value:.3g}"
            rows, events = solved.rows, solved.events
            yield Solution(how, solver.method, value, solver.names, rows, events)
            if solver.setting == "rtol":
                return


def _steps(own: Own) -> list[float]:
    """Give steps for a method that has no tolerance, each half the one before."""
    return [own.case.settings.output_step / 4 / 2**k for k in range(HALVINGS)]


def between_rows(case: Case, first: Solution, patience: Patience) -> Floats:
    """Give rows between those asked for, too, for the ranges; they are as tight."""
    between = case.asking(output_step=case.settings.duration / MOMENTS)
    if own := _able(between, first.method):
        for solution in _solved(own, (first.value,), patience):
            return np.concatenate((first.rows, solution.rows))
    return first.rows
