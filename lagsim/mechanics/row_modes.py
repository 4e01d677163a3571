"""Modes of the rows that may be in force, by their accelerations.

The modes of the rows follow from their accelerations at known rates. The friction of a
sliding row has a known direction. A row at rest holds where a multiplier within its
bound suffices, and otherwise begins to slide against that multiplier. Rows whose
multipliers are at their bounds with acceleration 0 are tied: their rates decide. Where
the choice of multipliers is not unique, see `sharing`.

Source: F. Pfeiffer, C. Glocker, Multibody Dynamics with Unilateral Contacts (1996).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lagsim.mechanics.algebra import least_squares
from lagsim.mechanics.complementarity import Solution, solved_regular
from lagsim.mechanics.lemke import RATES_ROUNDOFF, rates_at
from lagsim.mechanics.rows import Mode
from lagsim.mechanics.sharing import (
    ContactRows,
    Independent,
    eased,
    solved_rows,
    supported,
)
from lagsim.tolerances import (
    ACCELERATION_ROUNDOFF,
    DEPENDENT_SQUARE,
    HALF_OF_DIGITS,
    SETTLED_IMPULSE,
    SOLVED_LAWS,
)

if TYPE_CHECKING:
    from collections.abc import Callable

    from lagsim.language.arrays import Flags, Floats, Ints
    from lagsim.mechanics.rows import Closed

    Ahead = Callable[[Floats], tuple[Floats, Floats]]


@dataclass(frozen=True, slots=True)
class RowModes:
    """Modes and multipliers of r rows.

    Attributes
    ----------
    mode : tuple of Mode, length r
        The mode of each row. Held rows are linearly independent.
    direction : ndarray, shape (r,)
        The multiplier of a sliding row divided by its bound (with two slips: a
        component of a unit vector); the multiplier of a redundant row divided by its
        static bound; 0 for other rows.
    multipliers : ndarray, shape (r,)
        The multipliers with which the modes are a solution.
    paradox : bool
        Painlevé's paradox: no solution, or a sliding contact under pressure whose
        effective mass is not positive. A contact that may separate instead is
        released, without a paradox.
    open : bool
        A multiplier that is not unique bounds sliding friction: the motion is not
        unique.
    """

    mode: tuple[Mode, ...]
    direction: Floats
    multipliers: Floats
    paradox: bool
    open: bool = False


def modes(
    closed: Closed,
    accelerations: Floats,
    rates: Floats,
    roundoff: Floats,
    slip_noise: Floats,
    ahead: Ahead | None = None,
    left: Ints | None = None,
) -> RowModes:
    """Determine the modes of the rows and their multipliers.

    Parameters
    ----------
    closed : Closed
        The r rows that may be in force: bounds, and their Delassus matrix D.
    accelerations : ndarray, shape (r,)
        The accelerations of the rows at multipliers 0.
    rates : ndarray, shape (r,)
        The rates of the rows. Bounded rows with larger rates than `slip_noise` slide.
    roundoff : ndarray, shape (r,)
        Accelerations up to this size count as 0.
    slip_noise : ndarray, shape (r,)
        Rates of bounded rows up to this size count as 0.
    ahead : callable, optional
        Maps multipliers (r,) to the rates of the accelerations (r,) with multipliers
        at fixed parts of their bounds, and to the rounding errors of these rates (r,).
        The rates decide ties: contacts without force and acceleration, and rows at
        rest with the multiplier at its bound. Without `ahead` tied rows hold.
    left : ndarray of int, shape (r,), optional
        How often each row has already reached the end of its held mode at this time.
        A row with a positive number does not hold where the rates decide no tie.
    """
    if not len(closed):
        return RowModes((), accelerations, accelerations, paradox=False)
    left = np.zeros(len(rates), dtype=int) if left is None else left
    if len(rates) == 1 and closed.pushes is None:
        numbers = accelerations, rates, roundoff, slip_noise
        single = _of_one(
            closed, *(x.item(0) for x in numbers), left=left.item(0), ahead=ahead
        )
        if single is not None:
            return single
    started = np.zeros(len(rates), dtype=bool)
    given, directions = _sliding(closed, rates, slip_noise)
    while True:
        sizes = np.where(given | started, closed.bounds, closed.statics)
        problem = closed.problem(accelerations, sizes, directions, given=given)
        rows = ContactRows(closed, problem, sizes, given, directions, roundoff)
        solution = solved_rows(rows)
        if not solution.found:
            nothing, off = np.zeros(len(rates)), (Mode.OFF,) * len(rates)
            return RowModes(off, nothing, nothing, paradox=True)
        if problem.discs:
            solution = eased(rows, supported(rows, solution))
        found, directions_found = _Edges(rows, ahead, left).edges(solution)
        begins = np.array([mode is Mode.SLIDING for mode in found], dtype=bool)
        begins &= ~given & (closed.bounds != sizes)
        if begins.any():
            started |= begins
            continue
        decided = _decided(rows, found, directions_found)
        return _farther(rows, decided, directions_found) if problem.discs else decided


def _of_one(
    closed: Closed,
    c: float,
    rate: float,
    roundoff: float,
    slip_noise: float,
    *,
    left: int,
    ahead: Ahead | None,
) -> RowModes | None:
    """Determine the mode of a single row as `modes` does, in closed form.

    None where no multiplier accelerates the row, or where a row at rest begins to slide
    whose static and dynamic bound differ.

    c, rate, roundoff, slip_noise, left : the elements of the arguments of `modes`.
    ahead : see `modes`.
    """
    table, own = closed.table, closed.D.item(0)
    if not (math.isfinite(c) and math.isfinite(own)):
        raise FloatingPointError("forces that are not finite")
    if own <= 0.0:
        return None
    bounded = bool(table.bounded[0])
    given = bounded and abs(rate) > slip_noise
    limit = (closed.bounds if given else closed.statics).item(0) if bounded else 0.0
    direction = math.copysign(1.0, -rate) if given else 0.0
    low, high = (
        float(x[0]) * (limit if bounded else 1.0) for x in (table.low, table.high)
    )
    z = -c / own
    p = direction * limit if given else min(max(z, low), high)
    w = 0.0 if p == z else own * p + c
    limit = abs(high) if bounded else 0.0
    terms = own * max(abs(p), limit) + abs(c)
    rounding = max(roundoff, ACCELERATION_ROUNDOFF * terms)
    small = rounding / own
    if table.equal[0]:
        mode = Mode.HELD
    elif not bounded and w > rounding:
        mode = Mode.OFF
    elif bounded and (given or abs(w) > rounding):
        mode = Mode.SLIDING
        if not given:
            inside = abs(p) < limit - small or limit <= small
            direction = math.copysign(1.0, -w if inside else p)
    elif abs(p) < limit - small if bounded else p > small:
        mode = Mode.HELD
    else:
        mode = Mode.HELD
        way = math.copysign(1.0, p) if bounded else -1.0
        way = 0.0 if bounded and limit <= small else way
        soon = (np.zeros(1), np.zeros(1)) if ahead is None else ahead(np.array([p]))
        if _leaves(own, soon, way, left):
            mode = Mode.SLIDING if limit else Mode.OFF
            direction = p / limit if limit else 0.0
    if mode is Mode.SLIDING and not given and closed.bounds[0] != closed.statics[0]:
        return None
    force = {Mode.HELD: z, Mode.SLIDING: direction * limit}.get(mode, 0.0)
    return RowModes((mode,), np.array([direction]), np.array([force]), paradox=False)


def _leaves(own: float, soon: tuple[Floats, Floats], way: float, left: int) -> bool:
    """Whether a single tied row is released, by the rate of its acceleration.

    This is the closed form of `lemke.rates_at` for one row. The row is also
    released if its multiplier cannot change and it has already reached the end of its
    mode at this time.

    Parameters
    ----------
    own : float
        The element of D, positive.
    soon : tuple of ndarray, shape (1,)
        The rate of the acceleration at a constant multiplier, and its rounding error.
    way : float
        The sign of the bound that the multiplier has reached; 0 without a bound.
    left : int
        How often the row has reached the end of its held mode at this time.
    """
    c, noise = (x.item(0) for x in soon)
    c = c if abs(c) > noise else 0.0
    x = -c / own if way * c > 0.0 else 0.0
    w = own * x + c
    terms = own * abs(x) + abs(c)
    moves = abs(w) > noise + RATES_ROUNDOFF * terms
    return moves or (left > 0 and x == 0.0)


def _sliding(closed: Closed, rates: Floats, slip_noise: Floats) -> tuple[Flags, Floats]:
    """Return a mask (r,) of the rows that slide, and directions (r,) of their friction.

    The direction of a row of a pair is a component of a unit vector; it is 0 for rows
    that do not slide.

    rates : (r,), the rates of the rows.
    slip_noise : (r,), rates up to this size count as 0.
    closed : the r rows.
    """
    bounded, pairs = closed.table.bounded, closed.table.pairs
    if not bounded.any():
        return bounded, np.zeros(len(rates))
    slips = np.where(pairs >= 0, np.hypot(rates, rates[pairs]), np.abs(rates))
    noise = np.where(pairs >= 0, np.maximum(slip_noise, slip_noise[pairs]), slip_noise)
    given: Flags = bounded & (slips > noise)
    return given, np.where(given, -rates / np.where(given, slips, 1.0), 0.0)


# Where a row reaches the end of its mode again at the same time, multipliers in
# problems with discs count as being at their bounds within this part.
EDGE = 1e-8
# At the bound, the force of a disc is known to the square root of rounding only: it
# counts as being along a direction within this angle.
ALONG = 1e-3


class _Edges(NamedTuple):
    """Modes of the rows of a solved contact problem: held, or at a bound.

    Attributes
    ----------
    rows : ContactRows
        The r rows, with the complementarity problem that has been solved.
    ahead, left
        As in `modes`.
    """

    rows: ContactRows
    ahead: Ahead | None
    left: Ints

    @property
    def closed(self) -> Closed:
        """The rows of the problem."""
        return self.rows.closed

    def edges(self, solution: Solution) -> tuple[list[Mode], Floats]:
        """Return the modes (r,) and directions (r,) of all rows, with ties decided.

        A row whose multiplier is strictly between its bounds is held; a row with an
        acceleration is at a bound; any other row is tied. Held rows are independent.

        solution : multipliers and accelerations of the r rows.
        """
        p, own = solution.p, self.closed.D.diagonal()
        problem = self.rows.problem
        limits = problem.limits(p)
        rounding = self.rows.rounding(p, limits)
        small = rounding / np.where(own > 0.0, own, 1.0)
        if problem.discs:  # all forces are known to this part only
            close = EDGE if self.left.max() > 1 else SETTLED_IMPULSE
            small = np.maximum(small, close * limits)
        for disc in problem.discs:  # both of its rows are on its edge, or neither
            small[[*disc]] = small[[*disc]].max()
        modes, directions = [Mode.OFF] * len(p), self.rows.directions.copy()
        held: list[int] = np.flatnonzero(self.closed.table.equal).tolist()
        tied: list[int] = []
        for k in self.rows.one_sided:
            if solution.w[k] <= rounding[k]:
                (held if p[k] > small[k] else tied).append(k)
        touches = {*held, *tied}
        bounded, ways = self._bounded(solution, rounding, limits, small)
        for k, mode in bounded.items():
            n = self.closed.table.normals.item(k)
            if n >= 0 and n not in touches:
                directions[k] = 0.0
            elif mode is Mode.SLIDING:
                modes[k], directions[k] = mode, ways[k]
            else:
                (held if mode is Mode.HELD else tied).append(k)
        self._hold(p, held, tied, modes, directions, limits, limits > small)
        return modes, directions

    def _bounded(
        self, solution: Solution, rounding: Floats, limits: Floats, small: Floats
    ) -> tuple[dict[int, Mode], Floats]:
        """Return the modes of bounded rows by their indices, and directions (r,).

        Tied rows (multiplier at its bound, acceleration 0) have the mode OFF here. The
        directions, see `RowModes`, are valid for rows that slide.

        Parameters
        ----------
        solution : Solution
            Multipliers and accelerations of the r rows.
        rounding : ndarray, shape (r,)
            Roundoff bounds of accelerations.
        limits, small : ndarray, shape (r,)
            Bounds of the multipliers' sizes; sizes up to `small` count as 0.
        """
        p, w = solution.p, solution.w
        force, slip, least = np.abs(p), np.abs(w), rounding.copy()
        for k, pair in enumerate(self.closed.table.pairs.tolist()):
            if pair > k:
                disc = [k, pair]
                force[disc] = np.linalg.norm(p[disc])
                slip[disc] = np.linalg.norm(w[disc])
                least[disc] = rounding[disc].max()
        inside = ~(force >= limits - small)
        slides = (slip > least) | self.rows.given
        at_bound = ~inside & (limits > small)
        known = np.where(at_bound, force, slip)
        ways = np.where(at_bound, p, -w) / np.where(known > 0.0, known, 1.0)
        ways = np.where(self.rows.given, self.rows.directions, ways)
        chosen = np.where(slides, Mode.SLIDING, np.where(inside, Mode.HELD, Mode.OFF))
        modes = chosen.tolist()
        bounded = np.flatnonzero(self.closed.table.bounded).tolist()
        return {k: Mode(modes[k]) for k in bounded}, ways

    def _hold(
        self,
        p: Floats,
        held: list[int],
        tied: list[int],
        modes: list[Mode],
        directions: Floats,
        limits: Floats,
        pressed: Flags,
    ) -> None:
        """Set the modes of held and tied rows, and directions of rows not held.

        A row that depends on held rows is redundant. Slips of contacts without force
        are off. `modes` and `directions` are changed in place.

        Parameters
        ----------
        p, limits : ndarray, shape (r,)
            Multipliers, and their largest sizes.
        held, tied : list of int
            Indices of rows.
        pressed : ndarray of bool, shape (r,)
            The rows whose limit is larger than rounding.
        """
        normals = self.closed.table.normals.tolist()
        span = Independent(self.closed.columns, regular=self.rows.regular)
        turn = self._turned(p, tied, pressed)
        x, rate = self._rates(p, held, tied, pressed, turn)
        none = np.abs(x) <= RATES_ROUNDOFF * np.abs(x).max(initial=0.0)
        may_slip = [
            k
            for k in tied
            for disc in [self.rows.disc(k)]
            if rate[disc].any() or (self.left[disc].any() and none[disc[-1]])
        ]
        forces = x if turn is None else turn @ x
        ranked = sorted(tied, key=lambda k: -abs(forces[k]))
        slipping, firmly = set(may_slip), set(held)
        rests = [k for k in (*held, *ranked) if k not in slipping]
        firm = [k for k in rests if k in firmly or not none[k]]
        may_slip = self._movable(firm, rests, may_slip, turn)
        for k in (*held, *ranked):
            n = normals[k]
            if n >= 0 and modes[n] is not Mode.HELD:
                continue
            if k in may_slip:
                modes[k] = Mode.SLIDING if limits[k] else Mode.OFF
            else:
                modes[k] = Mode.HELD if span.takes(k) else Mode.REDUNDANT
            if modes[k] is not Mode.HELD and limits[k]:
                directions[k] = p[k] / limits[k]
        for k, n in enumerate(normals):
            if n >= 0 and modes[n] is Mode.OFF:
                modes[k], directions[k] = Mode.OFF, 0.0

    def _turned(self, p: Floats, tied: list[int], pressed: Flags) -> Floats | None:
        """Return a rotation (r, r) of the rows to the axes of the forces of tied discs.

        The two rows of each tied disc become one row across and one along the force of
        the disc; other rows are unchanged. None where no disc is tied.

        p : multipliers (r,).
        tied : indices of tied rows.
        pressed : mask (r,) of the rows with a limit.
        """
        discs = [(i, k) for i, k in self.rows.problem.discs if k in tied and pressed[k]]
        if not discs:
            return None
        turn = np.eye(len(p))
        for i, k in discs:
            c, s = p[[i, k]] / np.linalg.norm(p[[i, k]])
            turn[np.ix_([i, k], [i, k])] = [[s, c], [-c, s]]
        return turn

    def _movable(
        self,
        firm: list[int],
        rests: list[int],
        candidates: list[int],
        turn: Floats | None,
    ) -> list[int]:
        """Return the tied rows, of candidates, that can slip while the other rows hold.

        A single bounded row cannot slip if it depends on `firm` rows. A disc can slip
        only along its force. It cannot slip if this direction depends on the rows at
        rest, and on the directions across the forces of discs at their bounds.

        Parameters
        ----------
        firm, rests, candidates : list of int
            Indices of the rows at rest that are held, or whose multipliers vary; of
            all rows at rest; and of the tied rows that would slip by their rates.
        turn : ndarray, shape (r, r), or None
            See `_turned`.
        """
        if not candidates:
            return candidates
        Y = self.closed.factor if turn is None else self.closed.factor @ turn
        span = Independent(Y)
        for k in firm:
            span.takes(k)
        single = self.closed.table.bounded & (self.closed.table.pairs < 0)
        candidates = [k for k in candidates if not single[k] or span.adds(k)]
        discs = [disc for disc in self.rows.problem.discs if disc[1] in candidates]
        if not discs:
            return candidates
        for k in rests:
            span.takes(k)
        for i, k in discs:
            across, along = (np.linalg.norm(span.outside(Y[:, j])) for j in (i, k))
            if across > ALONG * along:
                span.takes(i)
        locked = [disc for disc in discs if not span.adds(disc[1])]
        return [k for k in candidates if self.rows.disc(k) not in locked]

    def _rates(
        self,
        p: Floats,
        held: list[int],
        tied: list[int],
        pressed: Flags,
        turn: Floats | None,
    ) -> tuple[Floats, Floats]:
        """Return d/dt of multipliers less bounds (r,), and d/dt of accelerations (r,).

        Both decide ties, and are given in the axes `turn`. They solve a
        complementarity problem. The multiplier of a held row may have any rate. The
        multiplier of a tied row must move inside its bounds, or along the boundary of
        its disc. The multiplier of a sliding row remains a constant part of its bound.
        Both results are 0 without ties or without `ahead`.

        Parameters
        ----------
        p : ndarray, shape (r,)
            Multipliers.
        held, tied : list of int
            Indices of rows.
        pressed : ndarray of bool, shape (r,)
            The rows whose limit is larger than rounding.
        turn : ndarray, shape (r, r), or None
            See `_turned`.
        """
        r = len(p)
        x, w = np.zeros((2, r))
        if self.ahead is None or not tied:
            return x, w
        span = Independent(self.closed.columns, turn, regular=self.rows.regular)
        edges = [i for i, k in self.rows.problem.discs if k in tied and pressed[k]]
        # Rows that are not coupled with tied rows have no influence.
        turning = sorted(
            k for rows in self.rows.groups if not rows.isdisjoint(tied) for k in rows
        )
        place = {k: i for i, k in enumerate(turning)}
        free = [place[k] for k in (*held, *edges) if k in place and span.takes(k)]
        unit, S = np.eye(len(turning)), np.eye(len(turning))  # p' = S turn x
        for k in turning:
            n = self.closed.table.normals[k]
            if n >= 0 and p[n] > 0.0:
                S[place[k], place[n]] = p[k] / p[n]
        ways = [unit[place[k]] for k in tied if k in self.rows.one_sided]
        inside = [k for k in tied if pressed[k] and k not in edges]
        turned = p if turn is None else p @ turn
        ways += [-turned[k] * unit[place[k]] for k in inside]
        both = np.ix_(turning, turning)
        own = unit if turn is None else turn[both]
        D, (change, noise) = own.T @ self.closed.D[both] @ S @ own, self.ahead(p)
        c, rounding = own.T @ change[turning], np.abs(own.T) @ noise[turning]
        x[turning], w[turning] = rates_at(
            D, c, rounding, free, np.array(ways).reshape(-1, len(turning))
        )
        return x, w


def _expressed(
    rows: ContactRows, modes: list[Mode], directions: Floats
) -> tuple[Floats, Floats]:
    """Express the multipliers p of all rows by those of held rows: p = E x + p0.

    x are the multipliers of the held rows. The multipliers of the other rows are at
    their bounds, in the given directions (r,). Return E (r, r) and p0 (r,).

    modes : the mode of each row.
    """
    r = len(modes)
    E, p0 = np.zeros((r, r)), np.zeros(r)
    for k, mode in enumerate(modes):
        n, part = rows.closed.table.normals[k], directions[k] * rows.sizes[k]
        if mode is Mode.HELD:
            E[k, k] = 1.0
        elif mode is not Mode.OFF and n < 0:
            p0[k] = part
        elif mode is not Mode.OFF and modes[n] is Mode.HELD:
            E[k, n] = part
    return E, p0


def _decided(rows: ContactRows, modes: list[Mode], directions: Floats) -> RowModes:
    """Solve for the multipliers of the held rows, and return all modes.

    modes : the mode of each row.
    directions : (r,), multipliers of rows at their bounds as parts of the bounds.
    """
    closed, c, sizes = rows.closed, rows.problem.c, rows.sizes
    # Returned directions are relative to the bounds in force, not to the bounds of the
    # problem.
    redundant = np.array([mode is Mode.REDUNDANT for mode in modes], dtype=bool)
    known = np.where(redundant, closed.statics, closed.bounds)
    other = (known > 0.0) & (known != sizes)
    parts = np.where(other, sizes, 1.0) / np.where(other, known, 1.0)
    E, p0 = _expressed(rows, modes, directions)
    held = [k for k, mode in enumerate(modes) if mode is Mode.HELD]
    if not held:
        return RowModes(tuple(modes), directions * parts, p0, paradox=False)
    slides = Mode.SLIDING in modes
    h, own = c + closed.D @ p0, closed.D.diagonal()
    p, paradox = p0.copy(), slides and _has_no_effective_mass(rows, E, held)
    alone = [k for k in held if k in rows.alone]
    p[alone] = -h[alone] / own[alone]
    for group in rows.groups:
        coupled = sorted(group.intersection(held)) if len(group) > 1 else []
        if coupled:
            x, ratio = _solved_together(rows, E, h, coupled)
            p += E[:, coupled] @ x
            paradox |= (
                slides and closed.pushes is None and ratio <= ACCELERATION_ROUNDOFF
            )
    least = -ACCELERATION_ROUNDOFF * np.abs(p).max()
    for k in rows.one_sided:
        if least < p[k] < 0.0:
            p[k] = 0.0
    is_open = (
        slides and Mode.REDUNDANT in modes and _is_ambiguous(rows, modes, directions)
    )
    return RowModes(tuple(modes), directions * parts, p, paradox, is_open)


def _solved_together(
    rows: ContactRows, E: Floats, h: Floats, coupled: list[int]
) -> tuple[Floats, float]:
    """Solve for the multipliers (k,) of k held rows that are coupled.

    The matrix B = Y_H^T Y E_H is factored as R^T (Q^T Y E_H), where D = Y^T Y, the
    index H selects the columns of the held rows, and Y_H = Q R. So nearly dependent
    rows lose no more digits than their condition number requires.

    Parameters
    ----------
    rows : ContactRows
        All r rows.
    E : ndarray, shape (r, r)
        As returned by `_expressed`.
    h : ndarray, shape (r,)
        Accelerations of all rows with the multipliers p0.
    coupled : list of int, length k
        Indices of the held rows.

    Returns
    -------
    x : ndarray, shape (k,)
        The multipliers.
    ratio : float
        The determinant of B relative to that without friction, det(R)^2.
    """
    closed = rows.closed
    with_friction = np.count_nonzero(E[:, coupled]) > len(coupled)
    if closed.pushes is None and not with_friction:
        found = solved_regular(closed.D[np.ix_(coupled, coupled)], -h[coupled])
        if found is not None:
            return found, 1.0
    Q, R = np.linalg.qr(closed.factor[:, coupled])
    forces = Q.T @ (closed.columns @ E[:, coupled])
    B, x = closed.D[coupled] @ E[:, coupled], np.zeros(len(coupled))
    for _ in range(2):
        right = np.linalg.solve(R.T, B @ x + h[coupled])
        x -= least_squares(forces, right, DEPENDENT_SQUARE)
    sign, size = np.linalg.slogdet(forces)
    other, plain = np.linalg.slogdet(R)
    return x, float(sign * other * np.exp(size - plain))


# Part of their reserves that redundant rows take over at most, so that the other rows
# do not reach their bounds at the last moment, where forces have no clear direction;
# number of halvings of these loads.
TAKEN = 0.9
TAKEN_OVER = 5


def _farther(rows: ContactRows, decided: RowModes, directions: Floats) -> RowModes:
    """Return modes with the multipliers of redundant limited rows near their bounds.

    The multipliers of redundant rows are constant during an arc, so that only the
    multipliers of held rows change. The smaller the latter are at first, the later they
    reach their bounds. If all forces grow in proportion, the rows then slip only when
    no distribution of multipliers can hold them.

    Parameters
    ----------
    rows : ContactRows
        All r rows.
    decided : RowModes
        The modes, with multipliers that are the least possible parts of their bounds.
    directions : ndarray, shape (r,)
        As for `_decided`.
    """
    own = rows.closed.table.bounded & (rows.closed.table.normals < 0)
    spare, held = (
        [k for k, mode in enumerate(decided.mode) if mode is worst and own[k]]
        for worst in (Mode.REDUNDANT, Mode.HELD)
    )
    most = max((np.linalg.norm(directions[rows.disc(k)]) for k in spare), default=0.0)
    if not (0.0 < most < 1.0 - HALF_OF_DIGITS and held):
        return decided
    more = TAKEN * (1.0 / most - 1.0)
    for _ in range(TAKEN_OVER):
        larger = directions.copy()
        larger[spare] *= 1.0 + more
        found = _decided(rows, list(decided.mode), larger)
        limits = most * rows.problem.limits(found.multipliers)
        sizes = [np.linalg.norm(found.multipliers[rows.disc(k)]) for k in held]
        if all(x < limits[k] for x, k in zip(sizes, held, strict=True)):
            return found
        more *= 0.5
    return decided


def _is_ambiguous(rows: ContactRows, modes: list[Mode], directions: Floats) -> bool:
    """Whether sliding friction depends on a multiplier that is not unique.

    The motion is not unique then. This is tested as follows: there is a change of the
    multipliers of held and redundant rows, and of the friction that these cause, that
    accelerates none of these rows and yet changes the forces.

    modes : the mode of each row.
    directions : (r,), multipliers at bounds as parts of the bounds.
    """
    bears = ~rows.closed.table.bounded | (rows.sizes > 0.0)
    both: list[Mode] = [
        Mode.HELD if mode is Mode.REDUNDANT and bears[k] else mode
        for k, mode in enumerate(modes)
    ]
    rest = [k for k, mode in enumerate(both) if mode is Mode.HELD]
    E, _ = _expressed(rows, both, directions)
    Y = rows.closed.factor
    lengths = np.linalg.norm(Y[:, rest], axis=0)
    units = np.where(lengths > 0.0, lengths, 1.0)
    F = (rows.closed.columns @ E)[:, rest] / units
    _, s, V = np.linalg.svd(Y[:, rest].T @ F / units[:, None])
    free = V[s <= DEPENDENT_SQUARE * s[0]]
    return bool((np.linalg.norm(F @ free.T, axis=0) > SOLVED_LAWS).any())


def _has_no_effective_mass(rows: ContactRows, E: Floats, held: list[int]) -> bool:
    """Whether a held contact with sliding friction has no positive effective mass.

    A force on such a contact does not separate it. Each contact is tested alone; sets
    of coupled contacts are tested by the ratio of determinants in `_solved_together`.

    E : (r, r), the multipliers of all rows per multiplier of held rows.
    held : indices of the held rows.
    """
    D = rows.closed.D
    free = np.flatnonzero(rows.closed.table.equal)
    masses = np.einsum("ij,ji->i", D, E)
    if len(free):
        by_free, G = D @ E[:, free], D[free] @ E
        X = np.linalg.lstsq(G[:, free], G, rcond=None)[0]
        masses = masses - np.einsum("ij,ji->i", by_free, X)
    signed = [k for k in held if k in rows.one_sided]
    least = ACCELERATION_ROUNDOFF * D.diagonal()[signed]
    return bool((masses[signed] <= least).any())
