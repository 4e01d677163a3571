"""Starts at rest: guesses for which velocities and accelerations vanish.

The equations, and their solution from a guess, are in `balance`.

Contacts that are closed at the guess are active, with their friction. A contact that is
penetrated is added, one whose force pulls is removed, and friction beyond its limit is
removed. If no rest is found, the next contact is tried, finally each beside the earlier
ones. The laws of the contacts decide elsewhere whether they hold.

A rest in a corner, where forces step or rows of equalities turn, is found by a walk: on
one side of each surface Newton's method, or where this fails the acceleration, leads to
the first surface, on which the state is then held with the share of the upper side as
an unknown. A share outside of [0, 1] releases the state to the side beyond; see
`kinks`.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lagsim.admissibility.balance import Rest, Way, solved
from lagsim.admissibility.kinks import ROUNDED, Kinks, Pin, Step, drift
from lagsim.admissibility.verdict import (
    acting,
    judge_laws,
    judge_rest,
    one_sided,
    verdicts_on,
)
from lagsim.mechanics.algebra import (
    least_squares,
)
from lagsim.mechanics.constraints import Drag
from lagsim.mechanics.rows import Mode
from lagsim.tolerances import (
    CLEAR_OF_ROUNDING,
    SAME_RESULT,
    SATISFIED,
    STATE_ROUNDOFF,
    TINY,
)

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence

    from lagsim.admissibility.point import Condition, Point
    from lagsim.language.arrays import Floats
    from lagsim.mechanics.constraints import Law, Row
    from lagsim.mechanics.equations import Equations

# Number of combinations that are tried for each contact.
TRIES = 4
# Most surfaces that a walk to a corner reaches or leaves.
MOST_MET = 200


class AtRest(NamedTuple):
    """State at rest.

    Attributes
    ----------
    point : Point
    touching : set of str
        The contacts that are active there.
    undetermined : list of str
        Guesses that keep their values, since no equation determines them.
    active : list of Row
        The rows of the active laws.
    multipliers : ndarray, shape (m + k,)
        The multipliers of the m rows that always hold, then of the k rows `active`.
    corner : RestCorner or None
        The surfaces on which the state rests; the equations of `point` are then those
        of both sides, with shares as variables.
    on_ridge : bool
        Whether the state lies on a surface from which the forces of a side drive it
        away.
    """

    point: Point
    touching: set[str]
    undetermined: list[str]
    active: list[Row]
    multipliers: Floats
    corner: RestCorner | None = None
    on_ridge: bool = False


class RestCorner(NamedTuple):
    """Surfaces on which a state rests.

    Attributes
    ----------
    equations : Equations
        The equations as a combination of both sides of each surface. The shares are
        numbers: the numbers with which the forces balance.
    rows : tuple of Row
        Equalities that hold the state on the surfaces.
    """

    equations: Equations
    rows: tuple[Row, ...]


class _Balance(NamedTuple):
    """State at which forces balance.

    Attributes
    ----------
    rest : Rest
        The equations of the balance.
    x : ndarray, shape (k,)
        Their solution.
    there : Point
        The state.
    corner : RestCorner or None
        The surfaces that hold the state, if any.
    on_ridge : bool
        Whether forces of one side of a surface drive the state away from the surface.
    """

    rest: Rest
    x: Floats
    there: Point
    corner: RestCorner | None = None
    on_ridge: bool = False


def _balance(
    point: Point,
    stated: Sequence[Condition],
    active: Sequence[Row],
    free: tuple[Sequence[int], Sequence[int]],
    way: Way,
) -> _Balance | None:
    """Return a balance of forces with active rows; None if none is found.

    point, stated, active, free : see `balance.Rest`.
    way : see `balance.Way`.
    """
    if way is Way.CORNER:
        return _Walk(point, stated, active, free).found()
    rest = Rest(point, stated, active, free)
    end = solved(rest, way)
    if not end.converged:
        return None
    there = rest.at(end.x).at(errors=rest.errors(end.x))
    there.multipliers = {}
    found = _Balance(rest, end.x, there)
    return _beside_kinks(found, stated, active, free, near=way is Way.NEAR)


def _beside_kinks(
    found: _Balance,
    stated: Sequence[Condition],
    active: Sequence[Row],
    free: tuple[Sequence[int], Sequence[int]],
    *,
    near: bool,
) -> _Balance:
    """Return the rest in a corner in which a balance lies; else the balance itself.

    A corner is a set of surfaces at which forces step or equalities turn.

    Parameters
    ----------
    found : _Balance
        A balance of the equations as written. It is returned where no corner is found.
    stated, active, free
        See `balance.Rest`.
    near : bool
        Whether a nearer corner between the guess and the balance is searched for.
    """
    rest, point = found.rest, found.rest.point
    walk = _Walk(found.there, stated, active, free)
    if walk.levels:
        own = walk.found()
        if own is not None and own.corner is not None:
            far = np.abs(own.there.q - found.there.q)
            errors = [own.there.errors.get(name, 0.0) for name in point.e.q]
            if np.all(far <= errors):
                return own
        if walk.on_ridge:
            found = found._replace(on_ridge=True)
    if not near or not walk.kinks.sides:
        return found
    before = _Walk(point, stated, active, free)
    if before.sides == walk.sides:
        return found
    other = before.found()
    if other is None or other.corner is None:
        return found
    size = np.diag(rest.metric)[: len(rest.positions)]
    far, close = (
        size @ (x.there.q - point.q)[rest.positions] ** 2 for x in (found, other)
    )
    return other if close < far else found


class _Walk:
    """Walk from a guess from surface to surface, to a rest in a corner.

    Parameters
    ----------
    point, stated, active, free
        See `balance.Rest`.

    Attributes
    ----------
    here : Point
        The state that the walk has reached; at first the guess.
    sides : dict of int to float
        By the index of a surface, the side on which `here` lies: the value of the
        surface's mode variable, see `kinks.Kinks.frozen`.
    levels : dict of int to float
        By the index of a surface, the level on which the state is held, if it is.
    on_ridge : bool
        Whether the guess is a balance from which the forces of a side drive the state
        away.
    """

    def __init__(
        self,
        point: Point,
        stated: Sequence[Condition],
        active: Sequence[Row],
        free: tuple[Sequence[int], Sequence[int]],
    ) -> None:
        self.guess, self.here, self.stated, self.free = point, point, stated, free
        self.kinks, self.active = Kinks(point.e), active
        self.sides, self.levels = self.kinks.at(point)
        self.on_ridge, self.tried = False, set[object]()

    def found(self) -> _Balance | None:
        """Walk from surface to surface; return the balance at the end, or None."""
        for _ in range(MOST_MET if self.kinks.sides else 0):
            mode = _mode(self.levels, self.sides)
            if mode in self.tried:
                return None
            self.tried.add(mode)
            rest = self._rest()
            if self._move_to_surface(self._unbalanced(rest), beyond=True):
                continue
            end = solved(rest)
            if end.converged:
                if self._move_to_surface([self._at(rest, end.x)], beyond=False):
                    continue
                found = self._decided(rest, end.x, first=len(self.tried) == 1)
                if found is not None:
                    return found
            elif not self._move_to_surface(self._driven(rest), beyond=True):
                if not self.levels:
                    return None
                self._cross([*self.levels][-1])
        return None

    def _decided(self, rest: Rest, x: Floats, *, first: bool) -> _Balance | None:
        """Return the balance at x (k,) if the forces hold the state there; else None.

        Without a balance the walk leaves a surface.

        rest : the equations that x solves.
        first : whether no surface was met or left before.
        """
        own = self._shares(rest, x)
        off = [max(-w, w - 1.0) for w in own]
        if max(off, default=0.0) > ROUNDED and self._meet_in_a_point(rest, x):
            x = self._with_bounds(rest, x)
            own = self._shares(rest, x)
            off = [max(-w, w - 1.0) for w in own]
        shares: dict[int, float] = dict(zip(self.levels, own, strict=True))
        if max(off, default=0.0) > ROUNDED:
            worst = sorted(zip(off, shares, strict=True), reverse=True)
            out = [k for w, k in worst if w > ROUNDED]
            ends = {k: shares[k] > 1.0 for k in out}
            new = (k for k in out if self._without(k, above=ends[k]) not in self.tried)
            k = next(new, out[0])
            self._release(k, above=ends[k])
            self.here = self._at(rest, x)
            return None
        found = self._balance(rest, x, shares)
        actual, near = self.kinks.at(found.there)
        passed = [k for k in actual if k not in near and k not in self.levels]
        if any(actual[k] != self.sides[k] for k in passed):
            self.sides |= {k: actual[k] for k in passed}
            self.here = self._at(rest, x)
            return None
        steps = self.kinks.steps(found.there, self.sides, self._pins(), self.active)
        diverging = [k for k, step in steps.items() if step is not Step.TOWARDS]
        if not diverging:
            return found
        self.on_ridge |= first and Step.AWAY in steps.values()
        self._cross(diverging[0])
        self.here = self._at(rest, x)
        return None

    def _pins(self, shares: Mapping[int, float] | None = None) -> dict[int, Pin]:
        """Return the pin of each surface that holds the state, by the surface's index.

        shares : the values of the shares by the index of the surface; without it the
            shares are variables.
        """
        g, kinks = self.guess.g, self.kinks
        return {
            k: Pin(
                level,
                g.variable(kinks.share(k)) if shares is None else g.constant(shares[k]),
            )
            for k, level in self.levels.items()
        }

    def _rest(self) -> Rest:
        """Return the balance to be solved with the present sides and levels.

        The iteration starts from the state `here`.
        """
        kinks, pins = self.kinks, self._pins()
        e = kinks.on(self.sides, pins)
        pinned = {
            kinks.share(k): kinks.distance(k, level, self.sides)
            for k, level in self.levels.items()
        }
        active = kinks.rows(self.active, self.sides, pins)
        return Rest(self.here.of(e), self.stated, active, self.free, pinned)

    def _at(self, rest: Rest, x: Floats) -> Point:
        """Return the state with the unknowns x (k,), with the equations as written."""
        at = rest.at(x).state
        return self.guess.at(at.q, s=at.s)

    def _shares(self, rest: Rest, x: Floats) -> list[float]:
        first = len(rest.positions) + len(rest.states)
        return [float(w) for w in x[first : first + len(rest.shares)]]

    def _meet_in_a_point(self, rest: Rest, x: Floats) -> bool:
        """Whether gradients of surfaces and relations are linearly dependent at x (k,).

        rest : the equations of the balance.
        """
        J = rest(x)[1][: rest.relations] / np.sqrt(np.diag(rest.metric))
        lengths = np.linalg.norm(J, axis=1)
        J /= np.where(lengths > 0.0, lengths, 1.0)[:, None]
        return bool(np.linalg.matrix_rank(J, tol=SAME_RESULT) < rest.relations)

    def _with_bounds(self, rest: Rest, x: Floats) -> Floats:
        """Return unknowns x (k,) of rest whose shares of sides are in [0, 1].

        On switching surfaces the force is a mean of the forces on their sides, weighted
        by the shares. With more surfaces than directions of motion the shares at
        equilibrium are not unique, and the given x may have shares outside [0, 1]. It
        is returned if no other solution is found.
        """
        from scipy.optimize import least_squares as bounded  # slow to load

        first, m = len(rest.positions) + len(rest.states), rest.relations
        weights = np.ones(len(rest.targets))
        weights[m : m + self.here.n] = self.here.sizes
        size = np.sqrt(np.diag(rest.metric))[first:]
        n = len(rest.shares)
        size[:n] = 1.0

        def of(z: Floats) -> Floats:
            return np.concatenate([x[:first], z / size])

        low, high = np.full(len(size), -np.inf), np.full(len(size), np.inf)
        low[:n], high[:n] = 0.0, 1.0
        begun = x[first:] * size
        begun[:n] = 0.5
        fit = bounded(
            lambda z: (rest.evaluated(of(z))[0] / weights)[m:],
            begun,
            jac=lambda z: (rest.evaluated(of(z))[1] / weights[:, None])[m:, first:]
            / size,
            bounds=(low, high),
            xtol=1e-15, ftol=1e-15, gtol=1e-15,
        )  # fmt: skip
        found = of(np.asarray(fit.x, dtype=float))
        return found if rest.are_satisfied(found, STATE_ROUNDOFF * np.abs(found)) else x

    def _move_to_surface(self, ways: Iterable[Point], *, beyond: bool) -> bool:
        """Move the state to the first surface on one of the ways, and hold it there.

        Return whether there is such a surface.

        Parameters
        ----------
        ways : iterable of Point
            The ends of straight ways from `here`, in the order in which they are tried.
        beyond : bool
            Whether the ways continue beyond their ends.
        """
        here = self.here
        for there in ways:
            crossing = self.kinks.first_crossing(
                (here, there), self.sides, self.levels, beyond=beyond
            )
            if crossing is None:
                continue
            self.levels[crossing.side] = crossing.level
            self.here = here.at(
                here.q + crossing.part * (there.q - here.q),
                s=here.state.s + crossing.part * (there.state.s - here.state.s),
            )
            return True
        return False

    def _unbalanced(self, rest: Rest) -> Iterator[Point]:
        """Yield the state displaced along the forces that no displacement balances.

        Yield no state if there are no such forces.

        rest : the equations of the balance, whose solution failed.
        """
        n, m = self.here.n, rest.relations
        r, J = rest(rest.x0)
        if not (np.all(np.isfinite(r)) and np.all(np.isfinite(J))):
            return
        weights = np.ones(len(r))
        weights[:m] = np.linalg.norm(J[:m], axis=1)
        weights[m : m + n] = self.here.sizes
        weights = 1.0 / np.where(weights > 0.0, weights, 1.0)
        r, J = weights * r, weights[:, None] * J
        columns = np.linalg.norm(J, axis=0)
        J /= np.where(columns > 0.0, columns, 1.0)
        left = r + J @ least_squares(J, -r)
        if np.linalg.norm(left[m:]) > SAME_RESULT * np.linalg.norm(r[m:]):
            left *= weights
            yield self._moved(rest, left[m : m + n], left[m + n :])

    def _driven(self, rest: Rest) -> Iterator[Point]:
        """Yield the state displaced along its acceleration on the present surfaces.

        rest : the equations of the balance.
        """
        rows = [*rest.rows[len(self.here.e.rows) :]]
        rows += [self.kinks.row(k, x, self.sides) for k, x in self.levels.items()]
        a, rates = drift(rest.at(rest.x0), rows)
        yield self._moved(rest, a, rates[rest.states])

    def _moved(self, rest: Rest, a: Floats, rates: Floats) -> Point:
        """Return the state `here` with its unknown positions and states displaced.

        rest : names the unknowns.
        a : (n,), the displacement of q.
        rates : the displacement of the first-order states that are unknowns.
        """
        q, s = self.here.q.copy(), self.here.state.s.copy()
        q[rest.positions] += a[rest.positions]
        s[rest.states] += rates
        return self.here.at(q, s=s)

    def _without(self, k: int, *, above: bool) -> object:
        """Return the key of the position that the walk reaches by leaving surface k.

        The key (see `_mode`) shows whether the walk has been at that position before.

        above : whether the walk leaves to the upper side.
        """
        end = self.kinks.ends(k, self.levels[k])[above]
        levels = {i: x for i, x in self.levels.items() if i != k}
        return _mode(levels, {**self.sides, k: end})

    def _cross(self, k: int) -> None:
        """Leave surface k to the side opposite to that from which the state came."""
        low, _ = self.kinks.ends(k, self.levels[k])
        self._release(k, above=self.sides[k] == low)

    def _release(self, k: int, *, above: bool) -> None:
        """Leave surface k, to its upper side (`above`) or its lower side."""
        self.sides[k] = self.kinks.ends(k, self.levels.pop(k))[above]

    def _balance(self, rest: Rest, x: Floats, shares: Mapping[int, float]) -> _Balance:
        """Return the record of a balance: its solution, its state and its corner.

        Without surfaces, the equations of the state are those of the model.

        x : (k,), the solution of `rest`.
        shares : shares of the upper sides, by the index of the surface.
        """
        there, corner = rest.at(x).of(self.guess.e), None
        there.multipliers = dict(zip(rest.shares, shares.values(), strict=True))
        if shares:
            kinks, sides = self.kinks, self.sides
            there = there.of(kinks.on(sides, self._pins()))
            rows = (kinks.row(k, level, sides) for k, level in self.levels.items())
            corner = RestCorner(kinks.on(sides, self._pins(shares)), tuple(rows))
        found = there.solved_errors((self.guess.q, self.guess.v))
        errors = {name: found[name] for name in rest.names if name in found}
        if corner is not None:
            # A zero within rounding is one: a run begins exactly in the corner.
            own = np.array([errors.get(name, 0.0) for name in rest.names])
            x = np.where(np.abs(x) <= own, 0.0, x)
            at = rest.at(x).state
            there = there.at(at.q, s=at.s)
        there = there.at(errors={**self.guess.errors, **errors})
        return _Balance(rest, x, there, corner)


def _mode(levels: Mapping[int, float], sides: Mapping[int, float]) -> object:
    """Return a hashable key of a walk's position among the surfaces.

    levels : the levels of the surfaces that hold the state.
    sides : the sides of all surfaces, see `_Walk`.
    """
    return frozenset(levels.items()), frozenset(sides.items())


def find_rest(
    point: Point,
    stated: Sequence[Condition],
    free: tuple[Sequence[int], Sequence[int]],
    off: Collection[str],
    ways: Sequence[Way] = (Way.NEAR, Way.CORNER, Way.FAR),
) -> AtRest | None:
    """Return a state at rest; None if there is none near the guess.

    Parameters
    ----------
    point : Point
        The guess, with velocities of zero.
    stated : sequence of Condition
        Equations for positions beside the rows.
    free : tuple of sequence of int
        Indices of the positions, and of the first-order states, that are guesses.
    off : collection of str
        Constraints that are out of force.
    ways : sequence of Way
        The ways that are tried, in order. If FAR is among the ways, NEAR is tried again
        at last, with each contact in turn in force.
    """
    laws, own_rows = point.e.laws, acting_rows(point)
    slides = set(range(len(laws))) - own_rows.keys()
    apart = [k for k in _by_gap(point) if laws[k].constraint not in off]
    judged_active = _of(laws, {x.name for x in judge_laws(point, off) if x.active})
    # The force of a slider without mass is known; a row keeps it at its limit.
    begun = {k for k in judged_active if not laws[k].slider} - slides
    limits = one_sided(point, {law.constraint for law in laws if law.slider})
    rows = {k: limits.get(laws[k].constraint, row) for k, row in own_rows.items()}
    rounds = [(way, False) for way in ways]
    for way, wide in rounds + [(Way.NEAR, True)] * (Way.FAR in ways):
        active, bases, tried = begun, list[set[int]](), set[frozenset[int]]()
        while frozenset(active) not in tried and len(tried) <= TRIES * (1 + len(apart)):
            tried.add(frozenset(active))
            own = [rows[k] for k in sorted(active)]
            end = _balance(point, stated, own, free, way)
            if end is not None:
                rest, there = end.rest, end.there
                changes = _changes(rest, end.x, there, active, off)
                if not all(x.satisfied for x in verdicts_on(there)):
                    return None  # a relation with a nonzero rate
                if not changes:
                    left = judge_rest(there, judge_laws(there, off)) if laws else ()
                    if not all(x.satisfied for x in left):
                        return None  # a wall that appears or disappears
                    sided = {k for k in active if laws[k].one_sided}
                    touching = {laws[k].constraint for k in sided}
                    own = rest.rows[len(point.e.rows) :]
                    lam = end.x[len(end.x) - len(rest.rows) :]
                    loose = rest.undetermined(end.x)
                    return AtRest(there, touching, loose, own, lam, *end[3:])
            else:
                more = [laws[k].constraint for k in apart if k not in active]
                changes = _of(laws, more[:1])
                bases.append(active)
            active = (active ^ changes) - slides
            if wide and frozenset(active) in tried:
                each = [_of(laws, {laws[k].constraint}) - slides for k in apart]
                beside = (base | x for base in bases for x in each)
                active = next((x for x in beside if frozenset(x) not in tried), active)
    return None


class SlidingLimits(NamedTuple):
    """Equations in which limited equalities that slide at rest are forces.

    Attributes
    ----------
    equations : Equations
    off : frozenset of str
        The constraints out of force, and the limited equalities that slide.
    multipliers : dict of str to int
        The multipliers (nodes) of the limited equalities that slide, by row.
    """

    equations: Equations
    off: frozenset[str]
    multipliers: dict[str, int]


def sliding_limits(point: Point, off: Collection[str]) -> SlidingLimits:
    """Return the equations with limited equalities that slide at rest as forces.

    A body at rest on a moving belt slides (x_dot = 3 is off by -3): the limit acts
    against the slip. For friction of contacts, which depends on multipliers, see
    `acting_rows`.

    point : a state with velocities 0.
    off : the constraints that are out of force.
    """
    e, g = point.e, point.g
    own: dict[int, list[Law]] = {}
    for k, law in enumerate(e.laws):
        limited = law.bounded and not (law.slips or law.slider or law.row.holonomic)
        if limited and law.constraint not in off:
            own.setdefault(min(k, law.pair) if law.pair >= 0 else k, []).append(law)
    f, multipliers, slides = list(e.f), dict[str, int](), set(off)
    for laws in own.values():
        rates = [law.row.rate for law in laws]
        slips, rounding = point.array(rates), point.rounding(rates)
        if np.linalg.norm(slips) <= CLEAR_OF_ROUNDING * np.max(rounding):
            continue
        slides |= {law.constraint for law in laws}
        size = g.call("sqrt", g.product_sum((x, x) for x in rates))
        for law, rate in zip(laws, rates, strict=True):
            push = g.call("div", g.call("mul", law.bound, rate), size)
            multipliers[law.row.name] = push = g.call("neg", push)
            for j, entry in law.row.A.entries.items():
                f[j] = g.call("add", f[j], g.call("mul", push, entry))
    with_forces = replace(e, f=tuple(f)) if multipliers else e
    return SlidingLimits(with_forces, frozenset(slides), multipliers)


def acting_rows(point: Point) -> dict[int, Row]:
    """Return the rows of laws that may act at a steady state, by the index of the law.

    Where a contact slides, as at rest on a moving belt (x_dot - 3 is -3), the row of
    the contact has the friction as drags, and the rows of its slips are left out.
    """
    drags = _sliding_friction(point)
    return {
        k: law.row._replace(drags=drags.get(k, ()))
        for k, law in enumerate(point.e.laws)
        if not (law.slips and law.normal in drags)
    }


def _sliding_friction(point: Point) -> dict[int, tuple[Drag, ...]]:
    """Return the friction of the contacts that slide at a state.

    The result has the index of each such contact among the laws -> the friction along
    its slips.
    """
    laws, g = point.e.laws, point.g
    slips: dict[int, list[Law]] = {}
    for law in laws:
        if law.slips:
            slips.setdefault(law.normal, []).append(law)
    found = {}
    for k, own in slips.items():
        rates = [law.row.rate for law in own]
        speeds, rounding = point.array(rates), point.rounding(rates)
        if not np.linalg.norm(speeds) > CLEAR_OF_ROUNDING * np.max(rounding):
            continue
        if len(rates) == 1:
            along = [g.call("sign", rates[0])]
        else:
            size = g.call("sqrt", g.product_sum((x, x) for x in rates))
            along = [g.call("div", x, size) for x in rates]
        found[k] = tuple(
            Drag(law.row, g.call("neg", g.call("mul", law.bound, x)))
            for law, x in zip(own, along, strict=True)
        )
    return found


def _changes(
    rest: Rest, x: Floats, there: Point, active: set[int], off: Collection[str]
) -> set[int]:
    """Return the indices of laws whose rows are to be added to the rest, or removed.

    rest, x, there : the equations, the solution (k,), and the state at rest.
    active : indices of the laws in force there.
    off : constraints out of force.
    """
    laws, verdicts = there.e.laws, judge_laws(there, off)
    if passed := _of(laws, {x.name for x in verdicts if not x.satisfied}):
        return passed - active
    pulls = dict(
        zip(sorted(active), rest.pulls(x)[len(rest.rows) - len(active) :], strict=True)
    )
    pulling = [k for k in active if laws[k].one_sided and pulls[k] > 0.0]
    if pulling:
        most = max(pulling, key=lambda k: pulls[k])
        return _of(laws, {laws[most].constraint}) & active
    laws_there = acting(there, verdicts)
    sliding = active - laws_there.holding
    loads = dict(zip(sorted(active), x[len(x) - len(active) :].tolist(), strict=True))
    for k in active & laws_there.holding:
        # Other rows can bear the load of a redundant slip.
        if laws_there.modes[k] is Mode.REDUNDANT and laws[k].slips:
            (bound,) = there.array([laws[k].static or laws[k].bound])
            bound *= loads.get(laws[k].normal, 0.0)
            own = np.hypot(loads[k], loads.get(laws[k].pair, 0.0))
            sliding |= {k} if own > bound * (1.0 + SATISFIED) else set()
    return {k for k in sliding if laws[k].bounded}


def _of(laws: Sequence[Law], names: Collection[str]) -> set[int]:
    """Return the indices of the laws whose constraints have the given names."""
    return {k for k, law in enumerate(laws) if law.constraint in names}


def _by_gap(point: Point) -> list[int]:
    """Return the indices of the laws that are contacts, by increasing scaled gap."""
    contacts = [k for k, x in enumerate(point.e.laws) if x.gapped]
    rows = [point.e.laws[k].row for k in contacts]
    lengths = np.linalg.norm(point.jacobian(rows) / point.sizes, axis=1)
    gaps = point.array([row.residual for row in rows]) / np.maximum(lengths, TINY)
    return [contacts[k] for k in np.argsort(gaps, kind="stable")]
