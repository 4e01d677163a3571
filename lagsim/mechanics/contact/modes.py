"""Which rows hold, slide or let go: from accelerations at rates that are known.

What slides is driven by a force of known direction. What rests holds if a multiplier
within its bound does it, and otherwise begins to slide against it.

A box on four legs can lose any leg on whose side its weight is not. Where discs leave
no corner to pivot to, legs are taken away until those that are left are independent, as
long as friction allows it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from lagsim.mechanics.constraints import Kind
from lagsim.mechanics.contact.complementarity import (
    Mode,
    Problem,
    Role,
    Solution,
    bounds,
    expressed,
    polished,
    residual,
    scaled,
    solve,
)

if TYPE_CHECKING:
    from lagsim.language.arrays import Floats
    from lagsim.mechanics.contact.complementarity import Closed


# Rows that leave less than this part of themselves are spanned by the others; where
# all that is known is D, a square, half of the digits are.
DEPENDENT = 1e-10
DEPENDENT_SQUARED = 1e-7


def columns(closed: Closed) -> Floats:
    """Give Y (k, r): D = Y^T Y."""
    if closed.factor is not None:
        return closed.factor
    sizes, V = np.linalg.eigh(closed.D)
    return np.asarray(np.sqrt(np.maximum(sizes, 0.0))[:, None] * V.T)


class Span:
    """What the rows taken so far span."""

    def __init__(self, closed: Closed) -> None:
        Y = columns(closed)
        self.least = DEPENDENT_SQUARED if closed.factor is None else DEPENDENT
        lengths = np.linalg.norm(Y, axis=0)
        self.units = Y / np.where(lengths > 0.0, lengths, 1.0)
        self.taken: list[Floats] = []

    def takes(self, row: int) -> bool:
        """Take a row unless it is spanned already."""
        rest = self._rest(row)
        size = float(np.linalg.norm(rest))
        if size <= self.least:
            return False
        self.taken.append(rest / size)
        return True

    def has(self, row: int) -> bool:
        """Tell whether a row is spanned."""
        return float(np.linalg.norm(self._rest(row))) <= self.least

    def _rest(self, row: int) -> Floats:
        rest = self.units[:, row]
        if self.taken:
            Q = np.array(self.taken)
            for _ in range(2):
                rest = rest - (Q @ rest) @ Q
        return rest


def on_discs(problem: Problem) -> bool:
    """Tell whether slips share a disc and are not known to slide."""
    rows = zip(problem.roles, problem.pairs, strict=True)
    return any(role is Role.BOXED and j >= 0 for role, j in rows)


def supported(
    closed: Closed, problem: Problem, solution: Solution, quiet: Floats
) -> Solution:
    """Give a solution in which the contacts that bear are independent, if there is one.

    All rows keep their accelerations within quiet (r,).
    """
    while True:
        for k in _spare(closed, problem, solution):
            less = solve(_without(problem, k))
            full = closed.D @ less.p + problem.c
            if less.found and (np.abs(full - solution.w) <= quiet).all():
                solution = replace(less, w=full)
                problem = _without(problem, k)
                break
        else:
            return solution


def _spare(closed: Closed, problem: Problem, solution: Solution) -> list[int]:
    """Give the contacts that end first where forces change along a dependence."""
    p = solution.p
    bear = [k for k, r in enumerate(problem.roles) if r is Role.SIGNED and p[k] > 0.0]
    span = Span(closed)
    if all(span.takes(k) for k in bear):
        return []
    s = np.sqrt(closed.D.diagonal()[bear])
    z = np.linalg.svd(span.units[:, bear])[2][-1] / s
    ends = []
    for way in (z, -z):
        falls = way < -np.abs(z).max() * span.least
        parts = np.where(falls, p[bear] / np.where(falls, -way, 1.0), np.inf)
        if np.isfinite(parts.min()):
            ends.append(bear[int(parts.argmin())])
    return sorted(ends, key=lambda k: float(p[k]))


def _without(problem: Problem, normal: int) -> Problem:
    away = [k == normal or n == normal for k, n in enumerate(problem.normals)]
    roles = [
        Role.ABSENT if gone else role
        for gone, role in zip(away, problem.roles, strict=True)
    ]
    return replace(problem, roles=roles)


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
