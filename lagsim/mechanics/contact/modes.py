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
from lagsim.mechanics.contact.edges import ROUNDING, is_plain, known_to, on_edges
from lagsim.mechanics.contact.independent import columns
from lagsim.mechanics.contact.polish import expressed, polished
from lagsim.mechanics.contact.problem import Problem, Role, Solution, residual, scaled
from lagsim.mechanics.contact.solving import solve
from lagsim.mechanics.contact.support import on_discs, supported
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
        Of a driven row: its multiplier is way times its bound; with two slips, of each
        its part. Of an implied row that bears a share: the part, at most 1, of its
        bound at rest. Else 0.
    multipliers, accelerations : ndarray, shape (r,)
    paradox : bool
        Painlevé's: no solution, or a sliding contact that presses with an effective
        mass that is not positive. What may part instead is let go.
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
    while solution.found:
        what, ways = on_edges(closed, problem, solution, noise, lean)
        begin = _begins(closed, problem, what)
        if begin:
            problem = _as_sliding(closed, problem, begin)
            solution = solve(problem)
            continue
        if on_discs(problem):
            quiet = known_to(closed, problem, solution, noise)
            solution = supported(closed, problem, solution, quiet)
            what, ways = on_edges(closed, problem, solution, noise, lean)
        return _decided(closed, problem, what, ways)
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
    signed = [role is Role.SIGNED for role in problem.roles]
    p[signed & (p < 0.0) & (p > -ROUNDING * np.abs(p).max(initial=0.0))] = 0.0
    unit, s = scaled(problem)
    return Modes(
        tuple(modes),
        _of_bounds(closed, problem, modes, ways),
        p,
        closed.D @ p + problem.c,
        _jams(closed, problem, modes, ways),
        Mode.IMPLIED not in modes,
        residual(unit, p / s),
    )


def _of_bounds(
    closed: Closed, problem: Problem, modes: list[Mode], ways: list[float]
) -> Floats:
    """Give the ways as parts of the bounds in force, from those of the problem."""
    parts = np.array(ways)
    for k in np.flatnonzero(parts):
        known = closed.statics if modes[k] is Mode.IMPLIED else closed.bounds
        used = problem.limits[k] if problem.normals[k] < 0 else problem.mus[k]
        if known[k] and used != known[k]:
            parts[k] *= used / known[k]
    return parts


def _jams(
    closed: Closed, problem: Problem, modes: list[Mode], ways: list[float]
) -> bool:
    """Tell whether a contact that holds and slides has no positive effective mass.

    Pressing on it then does not push it away: each alone, and those that hold together.
    What need not press may part; that is no paradox.
    """
    if Mode.DRIVEN not in modes:
        return False
    E, _ = expressed(problem, modes, ways)
    free = [k for k, role in enumerate(problem.roles) if role is Role.FREE]
    G = closed.D @ E
    masses = G.diagonal()
    if free:
        X = np.linalg.lstsq(G[np.ix_(free, free)], G[free], rcond=None)[0]
        masses = masses - np.einsum("ij,ji->i", G[:, free], X)
    held = [k for k, mode in enumerate(modes) if mode is Mode.HELD]
    for k in held:
        if problem.roles[k] is Role.SIGNED and masses[k] <= ROUNDING * closed.D[k, k]:
            return True
    # Those that hold together: their mass against the one without friction.
    Y = columns(closed)
    Q, R = np.linalg.qr(Y[:, held])
    sign, size = np.linalg.slogdet(Q.T @ (Y @ E)[:, held])
    other, plain = np.linalg.slogdet(R)
    return bool(sign * other * np.exp(size - plain) <= ROUNDING)


def _begins(closed: Closed, problem: Problem, modes: list[Mode]) -> list[int]:
    """Give the rows that begin to slide with another bound than that of sliding."""
    sizes = zip(problem.limits, problem.mus, problem.normals, strict=True)
    return [
        k
        for k, (limit, mu, n) in enumerate(sizes)
        if modes[k] is Mode.DRIVEN
        and problem.roles[k] is Role.BOXED
        and closed.bounds[k] != (limit if n < 0 else mu)
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


def _as_sliding(closed: Closed, problem: Problem, rows: list[int]) -> Problem:
    """Give the problem where rows have only the bound of what slides."""
    limits, mus = list(problem.limits), list(problem.mus)
    for k in rows:
        sizes = limits if problem.normals[k] < 0 else mus
        sizes[k] = float(closed.bounds[k])
    return replace(problem, limits=limits, mus=mus)
