"""Rows on an edge of their law, and which of those that hold do it by themselves."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lagsim.mechanics.contact.closed import Mode
from lagsim.mechanics.contact.independent import Span
from lagsim.mechanics.contact.problem import Problem, Role, Solution, bounds

if TYPE_CHECKING:
    from lagsim.language.arrays import Floats
    from lagsim.mechanics.contact.closed import Closed

# Accelerations are known to this part of the terms in them, at best.
ROUNDING = 256 * float(np.finfo(float).eps)
# Slips on a disc that Newton's method leaves rest, where dependent rows slow it down.
CONVERGED = 1e-10


def known_to(
    closed: Closed, problem: Problem, solution: Solution, noise: Floats
) -> Floats:
    """Give how well the accelerations of rows are known (r,).

    Against all that could push: what rests without a force has its friction's scale.
    """
    pushes = np.maximum(np.abs(solution.p), bounds(problem, solution.p))
    terms = np.abs(closed.D) @ pushes + np.abs(problem.c)
    shared = np.asarray(problem.pairs) >= 0
    known: Floats = np.where(shared, CONVERGED, ROUNDING) * terms
    return np.maximum(noise, known)


def on_edges(
    closed: Closed,
    problem: Problem,
    solution: Solution,
    noise: Floats,
    lean: Floats,
) -> tuple[list[Mode], list[float]]:
    """Give the modes and ways where ties are decided and held rows are independent."""
    quiet = known_to(closed, problem, solution, noise)
    small = quiet / np.where(closed.D.diagonal() > 0.0, closed.D.diagonal(), 1.0)
    modes, ways = list(solution.modes), list(solution.ways)
    tied, apart = _tied_contacts(problem, solution, modes, quiet, small, lean)
    p, w = solution.p, solution.w
    for k, bound in enumerate(bounds(problem, p)):
        n = problem.normals[k]
        if n >= 0 and modes[n] is Mode.OFF and n not in tied:
            modes[k], ways[k] = Mode.OFF, 0.0
            continue
        if problem.roles[k] is not Role.BOXED:
            continue
        rows = [k] if problem.pairs[k] < 0 else [k, problem.pairs[k]]
        slip, force = np.linalg.norm(w[rows]), np.linalg.norm(p[rows])
        if slip > quiet[rows].max():
            modes[k], ways[k] = Mode.DRIVEN, ways[k] or -float(w[k] / slip)
        elif lean[rows].any() and bound > small[k] and force >= bound - small[k]:
            modes[k], ways[k] = Mode.DRIVEN, float(p[k] / force)
        elif modes[k] is not Mode.HELD:
            tied.append(k)
    return _independent(closed, problem, solution, modes, ways, tied, apart)


def is_plain(problem: Problem, found: Solution, noise: Floats) -> bool:
    """Tell that of one or two rows, which are independent, none is near an edge."""
    D: list[list[float]] = problem.D.tolist()
    p, w = found.p.tolist(), found.w.tolist()
    limits = bounds(problem, found.p)
    pushes = [max(abs(x), y) for x, y in zip(p, limits, strict=True)]
    for k, (role, mode) in enumerate(zip(problem.roles, found.modes, strict=True)):
        terms = sum(abs(x) * y for x, y in zip(D[k], pushes, strict=True))
        quiet = max(noise.item(k), ROUNDING * (terms + abs(problem.c[k])))
        n = problem.normals[k]
        if n >= 0 and found.modes[n] is Mode.OFF:
            return False
        if role is Role.SIGNED:
            inside = p[k] * D[k][k] if mode is Mode.HELD else w[k]
        elif role is Role.BOXED and mode is Mode.HELD:
            inside = (limits[k] - abs(p[k])) * D[k][k]
        elif role is Role.BOXED:
            inside = -w[k] * found.ways[k]
        else:
            continue
        if inside <= quiet:
            return False
    return True


def _tied_contacts(
    problem: Problem,
    solution: Solution,
    modes: list[Mode],
    quiet: Floats,
    small: Floats,
    lean: Floats,
) -> tuple[list[int], list[int]]:
    """Let go of what has no force and leans away.

    Give what touches without force and does not lean away, and what does.
    """
    tied: list[int] = []
    apart: list[int] = []
    for k, role in enumerate(problem.roles):
        if role is not Role.SIGNED:
            continue
        if modes[k] is Mode.HELD and solution.p[k] <= small[k] and lean[k] > 0.0:
            modes[k] = Mode.OFF
        elif modes[k] is Mode.OFF and solution.w[k] <= quiet[k]:
            (tied if lean[k] <= 0.0 else apart).append(k)
    return tied, apart


def _independent(
    closed: Closed,
    problem: Problem,
    solution: Solution,
    modes: list[Mode],
    ways: list[float],
    tied: list[int],
    apart: list[int],
) -> tuple[list[Mode], list[float]]:
    """Let rows that others hold be implied, with the share of their bound they bear.

    Slips of contacts without force are off; what others hold cannot lean away.
    """
    span = Span(closed)
    limits = bounds(problem, solution.p)
    held = [k for k, mode in enumerate(modes) if mode is Mode.HELD]
    for k in sorted(held, key=lambda k: problem.roles[k] is not Role.FREE) + tied:
        n = problem.normals[k]
        if n >= 0 and modes[n] is not Mode.HELD:
            modes[k], ways[k] = Mode.OFF, 0.0
        elif span.takes(k):
            modes[k], ways[k] = Mode.HELD, 0.0
        else:
            modes[k] = Mode.IMPLIED
            if n >= 0 or problem.roles[k] is Role.BOXED:
                ways[k] = float(solution.p[k]) / limits[k] if limits[k] else 0.0
    for k in apart:
        if span.has(k):
            modes[k] = Mode.IMPLIED
    return modes, ways
