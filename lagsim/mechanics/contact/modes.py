"""Which rows hold, slide or let go: from accelerations at rates that are known.

What slides is driven by a force of known direction. What rests holds if a multiplier
within its bound does it, and otherwise begins to slide against it.

A box on four legs can lose any leg on whose side its weight is not. Where discs leave
no corner to pivot to, legs are taken away until those that are left are independent, as
long as friction allows it.
"""

from __future__ import annotations

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
    indices,
    polished,
    solve,
)
from lagsim.tolerances import (
    ACCELERATION_ROUNDOFF,
    DEPENDENT_ROWS,
    DEPENDENT_SQUARED,
    SLIP_CONVERGED,
)

if TYPE_CHECKING:
    from lagsim.language.arrays import Flags, Floats
    from lagsim.mechanics.contact.complementarity import Closed


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
        self.least = DEPENDENT_SQUARED if closed.factor is None else DEPENDENT_ROWS
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


def supported(
    closed: Closed, problem: Problem, solution: Solution, quiet: Floats
) -> Solution:
    """Give a solution in which the contacts that bear are independent, if there is one.

    All rows keep their accelerations within quiet (r,).
    """
    while True:
        for k in _spare(closed, problem, solution):
            away = (np.arange(len(problem.c)) == k) | (problem.normals == k)
            without = replace(problem, roles=np.where(away, Role.ABSENT, problem.roles))
            less = solve(without)
            full = closed.D @ less.p + problem.c
            if less.found and (np.abs(full - solution.w) <= quiet).all():
                solution, problem = replace(less, w=full), without
                break
        else:
            return solution


def _spare(closed: Closed, problem: Problem, solution: Solution) -> list[int]:
    """Give the contacts that end first where forces change along a dependence."""
    p = solution.p
    bear = np.flatnonzero((problem.roles == Role.SIGNED) & (p > 0.0)).tolist()
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


def known_to(
    closed: Closed, problem: Problem, solution: Solution, noise: Floats
) -> Floats:
    """Give how well the accelerations of rows are known (r,).

    Against all that could push: what rests without a force has its friction's scale.
    """
    pushes = np.maximum(np.abs(solution.p), bounds(problem, solution.p))
    terms = np.abs(closed.D) @ pushes + np.abs(problem.c)
    known: Floats = (
        np.where(problem.pairs >= 0, SLIP_CONVERGED, ACCELERATION_ROUNDOFF) * terms
    )
    return np.maximum(noise, known)


def is_plain(problem: Problem, solution: Solution, quiet: Floats) -> bool:
    """Tell that of one or two rows, which are independent, none is near an edge."""
    for k, mode in enumerate(solution.modes):
        p, own, n = solution.p.item(k), problem.D.item(k, k), problem.normals.item(k)
        held, role = mode is Mode.HELD, problem.roles.item(k)
        if n >= 0 and solution.modes[n] is Mode.OFF:
            return False
        if role == Role.SIGNED:
            inside = p * own if held else solution.w.item(k)
        elif role == Role.BOXED and held:
            inside = (bounds(problem, solution.p).item(k) - abs(p)) * own
        elif role == Role.BOXED:
            inside = -solution.w.item(k) * solution.ways.item(k)
        else:
            continue
        if inside <= quiet[k]:
            return False
    return True


def on_edges(
    closed: Closed, problem: Problem, solution: Solution, quiet: Floats, lean: Floats
) -> tuple[list[Mode], Floats]:
    """Give the modes and ways where ties are decided and held rows are independent.

    quiet : (r,), accelerations that are rounding.
    """
    own = closed.D.diagonal()
    small = quiet / np.where(own > 0.0, own, 1.0)
    modes, ways = list(solution.modes), solution.ways.copy()
    p, w = solution.p, solution.w
    tied: list[int] = []  # what touches without force and does not lean away
    apart: list[int] = []  # ... and what does
    for k in np.flatnonzero(problem.roles == Role.SIGNED).tolist():
        if modes[k] is Mode.HELD and p[k] <= small[k] and lean[k] > 0.0:
            modes[k] = Mode.OFF
        elif modes[k] is Mode.OFF and w[k] <= quiet[k]:
            (tied if lean[k] <= 0.0 else apart).append(k)
    for k, bound in enumerate(bounds(problem, p).tolist()):
        n = problem.normals[k]
        if n >= 0 and modes[n] is Mode.OFF and n not in tied:
            modes[k], ways[k] = Mode.OFF, 0.0
            continue
        if problem.roles[k] != Role.BOXED:
            continue
        rows = [k] if problem.pairs[k] < 0 else [k, problem.pairs[k]]
        slip, force = np.linalg.norm(w[rows]), np.linalg.norm(p[rows])
        if slip > quiet[rows].max():
            modes[k], ways[k] = Mode.DRIVEN, ways[k] or -float(w[k] / slip)
        elif lean[rows].any() and bound > small[k] and force >= bound - small[k]:
            modes[k], ways[k] = Mode.DRIVEN, float(p[k] / force)
        elif modes[k] is not Mode.HELD:
            tied.append(k)
    return _independent(closed, problem, p, modes, ways, tied, apart)


def _independent(
    closed: Closed,
    problem: Problem,
    p: Floats,
    modes: list[Mode],
    ways: Floats,
    tied: list[int],
    apart: list[int],
) -> tuple[list[Mode], Floats]:
    """Let rows that others hold be implied, with the share of their bound they bear.

    Slips of contacts without force are off; what others hold cannot lean away.
    """
    span = Span(closed)
    limits = bounds(problem, p)
    held = [k for k, mode in enumerate(modes) if mode is Mode.HELD]
    for k in sorted(held, key=lambda k: problem.roles[k] != Role.FREE) + tied:
        n = problem.normals[k]
        if n >= 0 and modes[n] is not Mode.HELD:
            modes[k], ways[k] = Mode.OFF, 0.0
        elif span.takes(k):
            modes[k], ways[k] = Mode.HELD, 0.0
        else:
            modes[k] = Mode.IMPLIED
            if n >= 0 or problem.roles[k] == Role.BOXED:
                ways[k] = p[k] / limits[k] if limits[k] else 0.0
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
    """

    mode: tuple[Mode, ...]
    way: Floats
    multipliers: Floats
    accelerations: Floats
    paradox: bool

    @property
    def unique(self) -> bool:
        """Whether the multipliers are determined."""
        return Mode.IMPLIED not in self.mode


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
    lean = np.zeros(len(noise)) if leaning is None else leaning
    while (solution := solve(problem)).found:
        quiet = known_to(closed, problem, solution, noise)
        if (
            solution.apart
            and is_plain(problem, solution, quiet)
            and not _begins(closed, problem, solution.modes).any()
        ):
            found = tuple(solution.modes)
            return Modes(found, solution.ways, solution.p, solution.w, paradox=False)
        what, ways = on_edges(closed, problem, solution, quiet, lean)
        begin = _begins(closed, problem, what)
        if begin.any():
            problem = _as_sliding(closed, problem, begin)
            continue
        if (problem.pairs[problem.roles == Role.BOXED] >= 0).any():
            solution = supported(closed, problem, solution, quiet)
            quiet = known_to(closed, problem, solution, noise)
            what, ways = on_edges(closed, problem, solution, quiet, lean)
        return _decided(closed, problem, what, ways)
    nothing, off = np.zeros(len(noise)), (Mode.OFF,) * len(noise)
    return Modes(off, nothing, nothing, solution.w, paradox=True)


def _decided(
    closed: Closed, problem: Problem, modes: list[Mode], ways: Floats
) -> Modes:
    """Solve once more, for the rows that hold by themselves."""
    p = polished(problem, modes, ways, closed.factor)
    signed = problem.roles == Role.SIGNED
    p[
        signed & (p < 0.0) & (p > -ACCELERATION_ROUNDOFF * np.abs(p).max(initial=0.0))
    ] = 0.0
    # Ways are parts of the bounds in force, here of those of the problem.
    implied = np.array([mode is Mode.IMPLIED for mode in modes], dtype=bool)
    known = np.where(implied, closed.statics, closed.bounds)
    used = np.where(problem.normals < 0, problem.limits, problem.mus)
    other = (known > 0.0) & (known != used)
    return Modes(
        tuple(modes),
        ways * np.where(other, used, 1.0) / np.where(other, known, 1.0),
        p,
        closed.D @ p + problem.c,
        _jams(closed, problem, modes, ways),
    )


def _jams(closed: Closed, problem: Problem, modes: list[Mode], ways: Floats) -> bool:
    """Tell whether a contact that holds and slides has no positive effective mass.

    Pressing on it then does not push it away: each alone, and those that hold together.
    What need not press may part; that is no paradox.
    """
    if Mode.DRIVEN not in modes:
        return False
    E, _ = expressed(problem, modes, ways)
    free = np.flatnonzero(problem.roles == Role.FREE)
    G = closed.D @ E
    masses = G.diagonal()
    if len(free):
        X = np.linalg.lstsq(G[np.ix_(free, free)], G[free], rcond=None)[0]
        masses = masses - np.einsum("ij,ji->i", G[:, free], X)
    held = [k for k, mode in enumerate(modes) if mode is Mode.HELD]
    signed = [k for k in held if problem.roles[k] == Role.SIGNED]
    if (masses[signed] <= ACCELERATION_ROUNDOFF * closed.D.diagonal()[signed]).any():
        return True
    # Those that hold together: their mass against the one without friction.
    Y = columns(closed)
    Q, R = np.linalg.qr(Y[:, held])
    sign, size = np.linalg.slogdet(Q.T @ (Y @ E)[:, held])
    other, plain = np.linalg.slogdet(R)
    return bool(sign * other * np.exp(size - plain) <= ACCELERATION_ROUNDOFF)


def _begins(closed: Closed, problem: Problem, modes: list[Mode]) -> Flags:
    """Tell which rows begin to slide with another bound than that of sliding (r,)."""
    driven = np.array([mode is Mode.DRIVEN for mode in modes], dtype=bool)
    used = np.where(problem.normals < 0, problem.limits, problem.mus)
    begin: Flags = driven & (problem.roles == Role.BOXED) & (closed.bounds != used)
    return begin


def _problem(
    closed: Closed, accelerations: Floats, rates: Floats, slip_noise: Floats
) -> Problem:
    """Make what slides a given force against its slip, what rests a bounded one."""
    normals, pairs = indices(closed.normals), indices(closed.pairs)
    roles = indices(tuple([_ROLES[kind] for kind in closed.kinds]))
    slips = np.where(pairs >= 0, np.hypot(rates, rates[pairs]), np.abs(rates))
    sliding = (roles == Role.BOXED) & (slips > slip_noise)
    roles = np.where(sliding, Role.GIVEN, roles)
    sizes = np.where(roles == Role.BOXED, closed.statics, closed.bounds)
    return Problem(
        closed.D,
        accelerations,
        roles,
        np.where(normals < 0, sizes, 0.0),
        np.where(normals >= 0, sizes, 0.0),
        np.where(sliding, -rates / np.where(sliding, slips, 1.0), 0.0),
        normals,
        pairs,
    )


_ROLES = {
    Kind.CONTACT: Role.SIGNED,
    Kind.FREEWHEEL: Role.SIGNED,
    Kind.SLIP: Role.BOXED,
    Kind.LIMITED: Role.BOXED,
    Kind.TIMED: Role.FREE,
}


def _as_sliding(closed: Closed, problem: Problem, rows: Flags) -> Problem:
    """Give the problem where rows have only the bound of what slides."""
    alone = problem.normals < 0
    limits = np.where(rows & alone, closed.bounds, problem.limits)
    mus = np.where(rows & ~alone, closed.bounds, problem.mus)
    return replace(problem, limits=limits, mus=mus)
