"""Which rows hold, slide or let go: from accelerations at rates that are known.

What slides is driven by a force of known direction. What rests holds if a multiplier
within its bound does it, and otherwise begins to slide against it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from lagsim.mechanics.contact.closed import Mode
from lagsim.mechanics.contact.edges import ROUNDING, is_plain, on_edges
from lagsim.mechanics.contact.polish import expressed, polished
from lagsim.mechanics.contact.problem import Problem, Role, Solution, residual, scaled
from lagsim.mechanics.contact.solving import solve
from lagsim.mechanics.laws import Kind

if TYPE_CHECKING:
    from lagsim.language.arrays import Floats
    from lagsim.mechanics.contact.closed import Closed


@dataclass(frozen=True, slots=True)
class Modes:
    """What all rows do, r of them.

    Attributes
    ----------
    mode : tuple of Mode
        Held rows are independent of each other.
    way : ndarray, shape (r,)
        Of a driven row: its multiplier is way times its bound. An implied row
        without a way has none; with a way, it stays at its (static) bound.
    multipliers, accelerations : ndarray, shape (r,)
    paradox : bool
        Painlevé's: no solution, or a sliding contact whose effective mass is not
        positive, so that more than one may be.
    unique : bool
        The multipliers are determined.
    residual : float
        Of the laws, relative to the accelerations.
    """

    mode: tuple[Mode, ...]
    way: Floats
    multipliers: Floats
    accelerations: Floats
    paradox: bool
    unique: bool
    residual: float


def modes(
    closed: Closed,
    accelerations: Floats,
    rates: Floats,
    noise: Floats,
    slip_noise: Floats,
    leaning: Floats | None = None,
) -> Modes:
    """Decide what the rows do.

    Parameters
    ----------
    accelerations : ndarray, shape (r,)
        Of the rows, with no multiplier of theirs.
    rates : ndarray, shape (r,)
        Of slips and limited rows; those larger than slip_noise (r,) slide.
    noise : ndarray, shape (r,)
        Accelerations that are smaller count as 0.
    leaning : ndarray, shape (r,), optional
        What decides about rows on an edge, which would hold: a contact with neither
        force nor acceleration is let go where this is > 0, and a row that rests at its
        bound begins to slide where this is not 0.
    """
    problem = _problem(closed, accelerations, rates, slip_noise)
    solution = solve(problem)
    begin = _begins(closed, problem, solution.modes)
    if solution.apart and not begin and is_plain(problem, solution, noise):
        return _at_once(solution)
    lean = np.zeros(len(noise)) if leaning is None else leaning
    begun: list[int] = []
    while solution.found:
        what, ways = on_edges(closed, problem, solution, noise, lean)
        begin = _begins(closed, problem, what)
        if not begin:
            found = _decided(closed, problem, what, ways)
            if not (found.way * found.accelerations > noise)[begun].any():
                return found
            # With less friction of others it would be pushed back: so it rests.
            less = replace(closed, statics=closed.bounds)
            return modes(less, accelerations, rates, noise, slip_noise, leaning)
        begun += begin
        problem = _sliding(closed, problem, begin, ways)
        solution = solve(problem)
    nothing, off = np.zeros(len(noise)), (Mode.OFF,) * len(noise)
    return Modes(off, nothing, nothing, solution.w, True, False, solution.residual)


def _at_once(solution: Solution) -> Modes:
    """Give what one or two rows do, where there is nothing to decide about."""
    return Modes(
        tuple(solution.modes),
        np.array(solution.ways),
        solution.p,
        solution.w,
        paradox=False,
        unique=True,
        residual=solution.residual,
    )


def _decided(
    closed: Closed, problem: Problem, modes: list[Mode], ways: list[float]
) -> Modes:
    """Solve once more, for the rows that hold by themselves."""
    p = polished(problem, modes, ways, closed.factor)
    unit, s = scaled(problem)
    return Modes(
        tuple(modes),
        np.array(ways),
        p,
        closed.D @ p + problem.c,
        _jams(closed, problem, modes, ways),
        Mode.IMPLIED not in modes,
        residual(unit, p / s),
    )


def _jams(
    closed: Closed, problem: Problem, modes: list[Mode], ways: list[float]
) -> bool:
    """Tell whether a contact that slides has an effective mass that is not positive.

    Pressing on it then does not push it away: each alone, and those that hold together.
    """
    if Role.GIVEN not in problem.roles and Mode.DRIVEN not in modes:
        return False
    touching = [_TOUCHING.get(r, m) for r, m in zip(problem.roles, modes, strict=True)]
    along = [
        given if role is Role.GIVEN else way
        for role, given, way in zip(problem.roles, problem.ways, ways, strict=True)
    ]
    free = [k for k, role in enumerate(problem.roles) if role is Role.FREE]
    G = closed.D @ expressed(problem, touching, along)[0]
    masses = G.diagonal()
    if free:
        X = np.linalg.lstsq(G[np.ix_(free, free)], G[free], rcond=None)[0]
        masses = masses - np.einsum("ij,ji->i", G[:, free], X)
    for k, role in enumerate(problem.roles):
        if role is Role.SIGNED and masses[k] <= ROUNDING * closed.D[k, k]:
            return bool(closed.D[k, k])
    held = [k for k, mode in enumerate(modes) if mode is Mode.HELD]
    B = (closed.D @ expressed(problem, modes, ways)[0])[np.ix_(held, held)]
    s = np.sqrt(closed.D.diagonal()[held])
    return bool(np.linalg.det(B / np.outer(s, s)) < 0.0)


_TOUCHING = {
    Role.SIGNED: Mode.HELD,
    Role.FREE: Mode.HELD,
    Role.GIVEN: Mode.DRIVEN,
}


def _begins(closed: Closed, problem: Problem, modes: list[Mode]) -> list[int]:
    """Give the rows that begin to slide under a bound that is not the one at rest."""
    return [
        k
        for k, mode in enumerate(modes)
        if mode is Mode.DRIVEN
        and problem.roles[k] is Role.BOXED
        and closed.statics[k] != closed.bounds[k]
    ]


def _problem(
    closed: Closed, accelerations: Floats, rates: Floats, slip_noise: Floats
) -> Problem:
    """Make what slides a given force against its slip, what rests a bounded one."""
    ways, roles, sizes = [], [], []
    quiet, speeds = slip_noise.tolist(), rates.tolist()
    while_sliding, at_rest = closed.bounds.tolist(), closed.statics.tolist()
    for k, kind in enumerate(closed.kinds):
        role, way = _ROLES[kind], 0.0
        if role is Role.BOXED:
            j = closed.pairs[k]
            slip = abs(speeds[k]) if j < 0 else math.hypot(speeds[k], speeds[j])
            if slip > quiet[k]:
                role, way = Role.GIVEN, -speeds[k] / slip
        ways.append(way)
        roles.append(role)
        sizes.append(at_rest[k] if role is Role.BOXED else while_sliding[k])
    touching = closed.normals
    return Problem(
        closed.D,
        accelerations.tolist(),
        roles,
        [x if n < 0 else 0.0 for x, n in zip(sizes, touching, strict=True)],
        [x if n >= 0 else 0.0 for x, n in zip(sizes, touching, strict=True)],
        ways,
        touching,
        closed.pairs,
    )


_ROLES = {
    Kind.CONTACT: Role.SIGNED,
    Kind.FREEWHEEL: Role.SIGNED,
    Kind.SLIP: Role.BOXED,
    Kind.LIMITED: Role.BOXED,
    Kind.TIMED: Role.FREE,
}


def _sliding(
    closed: Closed, problem: Problem, rows: list[int], ways: list[float]
) -> Problem:
    """Give the problem where boxed rows have begun to slide."""
    changed = replace(
        problem,
        roles=list(problem.roles),
        ways=list(problem.ways),
        limits=list(problem.limits),
        mus=list(problem.mus),
    )
    for k in rows:
        changed.roles[k], changed.ways[k] = Role.GIVEN, ways[k]
        sizes = changed.limits if problem.normals[k] < 0 else changed.mus
        sizes[k] = float(closed.bounds[k])
    return changed
