"""Branches of rests over a parameter: pseudo-arclength continuation, special points.

With the unknowns y of a rest (positions, first-order states, multipliers) and the
parameter p, F(y, p) = 0 is a curve. A step goes along its tangent, and Newton's method
returns to the curve within the plane normal to the tangent. At a fold the tangent's
p-component changes its sign, at a branch point the determinant of F' with the tangent
as its last row; at a Hopf point a pair of eigenvalues begins to grow. Each is located
along the arc between two points.

Source: H. B. Keller, Numerical solution of bifurcation and nonlinear eigenvalue
problems, in: Applications of Bifurcation Theory (1977); E. L. Allgower and K. Georg,
Introduction to Numerical Continuation Methods (2003), chapters 2, 8.
"""

from __future__ import annotations

import copy
import math
from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from lagsim.admissibility.balance import Rest
from lagsim.admissibility.point import Point
from lagsim.codes.known import UNKNOWN_NAME, USAGE
from lagsim.errors import did_you_mean, unusable
from lagsim.language.names import member_hint
from lagsim.mechanics.equations import Instant
from lagsim.mechanics.linearisation import Linearisation, eigenvalues_of
from lagsim.outputs.table import table_of
from lagsim.studies.rest import NoRestError, Search, Steady, stability_of
from lagsim.studies.setting import setting_of
from lagsim.tolerances import COMPUTED_ZERO

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from lagsim.language.arrays import Floats
    from lagsim.mechanics.constraints import Law, Row
    from lagsim.model.model import Model
    from lagsim.run.interrupt import Interrupt
    from lagsim.studies.rest import Equilibrium

    Progress = Callable[[float], None] | None

FOLD, BRANCH, HOPF, CONTACT = "fold", "branch", "hopf", "contact"
# Step lengths relative to the ranges: the first, the least and the greatest.
FIRST, LEAST, GREATEST = 0.005, 1e-7, 0.02
# Largest numbers of points of a branch, of branches, and of iterations of a step;
# number of iterations that counts as few.
MOST, MOST_BRANCHES, ITERATIONS, FEW = 3000, 24, 12, 3
# Increment of the parameter for differences, relative to its range; length of a step
# aside.
STEP, ASIDE = 1e-6, 0.01
# Least cosine of the angle between the tangents of two points.
TURNED = 0.9
# Parts of an interval at which it is divided, the second where the first fails.
PARTS = (0.5, 0.41)
# Bisections that locate a point, and the end of Newton's method.
BISECTIONS, CONVERGED = 48, 1e-12
# Distance at which a point lies on a branch, in parts of the ranges.
NEAR = 0.02
# Distance, relative to the range and to coordinates, of points that are one.
SAME_PLACE = 1e-6


class BranchPoint(NamedTuple):
    """Point of a branch.

    Attributes
    ----------
    y : ndarray, shape (k + 1,)
        Scaled unknowns, and last the parameter.
    tangent : ndarray, shape (k + 1,)
        Tangent of the branch, of length 1.
    sign : float
        Sign of the determinant of F' with the tangent.
    steady : Steady
        The rest, with the motion linearised about it.
    stable : bool or None
        Whether the rest is stable; None if that is undecided.
    """

    y: Floats
    tangent: Floats
    sign: float
    steady: Steady
    stable: bool | None

    @property
    def has_growing_oscillation(self) -> bool:
        """Whether a mode that oscillates grows, as past a Hopf point."""
        found = self.steady.spectrum
        return bool(np.any(found.growing & (np.abs(found.values.imag) > found.errors)))

    @property
    def begins_to_grow(self) -> bool:
        """Whether a growing oscillation, at such a point, has left the imaginary axis.

        Otherwise it has left the real axis, where two real eigenvalues have met.
        """
        found = self.steady.spectrum
        growing = found.growing & (np.abs(found.values.imag) > found.errors)
        own = found.values[growing]
        return bool(np.any(own.real < np.abs(own.imag)))


class Special(NamedTuple):
    """Special point: its kind, its place, and the law of a contact that changes.

    `law` is None unless a contact opens or closes at the point.
    """

    kind: str
    place: BranchPoint
    law: Law | None = None


class RestCurve:
    """Curve of rests over a parameter, with given active rows, through one rest.

    Points of the curve are vectors y of k scaled unknowns (positions, first-order
    states and multipliers) and, last, the scaled parameter. The parameter can be a
    start value.

    Parameters
    ----------
    model : Model
    name : str
        The parameter, or start value.
    ends : (float, float)
        The range of the parameter.
    search : Search
        The search at the value of the parameter where the rest is.
    steady : Steady
        The rest through which the curve goes.
    value : float
        The value of the parameter at this rest. (The method `value` returns the
        value at any point.)
    """

    def __init__(
        self,
        model: Model,
        name: str,
        ends: tuple[float, float],
        search: Search,
        steady: Steady,
        value: float,
    ) -> None:
        self.model, self.name, self.ends = model, name, ends
        self._e = search.setting.equations
        free, states = search.unknowns
        active = steady.equations.rows[len(self._e.rows) :]
        self._active = active
        at = steady.state
        point = Point(self._e, Instant(at.t, at.q, np.zeros_like(at.v), at.s))
        self._rest = Rest(point, (), active, (free, states))
        self._free, self._linear = free, Linearisation(steady.equations)
        lam = [steady.values[f"lambda_{row.name}"] for row in self._rest.rows]
        x = np.concatenate([at.q[free], at.s, lam])
        sizes = np.where(search.angles, 1.0, np.maximum(search.extent, np.abs(at.q)))
        self._sizes = np.concatenate([
            sizes[free], np.maximum(1.0, np.abs(at.s)), np.ones(len(lam)),
            [ends[1] - ends[0]],
        ])  # fmt: skip
        self._bound: dict[float, Any] = {}
        self._search = search
        # Points at which a contact opens or closes.
        self.edges: list[Special] = []
        # Multipliers have the size of the forces that change over the range.
        change = self._at(np.append(x, value) / self._sizes)[1][:, -1]
        force = float(np.max(np.abs([*lam, *change]), initial=0.0)) or 1.0
        self._sizes[len(x) - len(lam) : -1] = force
        self.start = np.append(x, value) / self._sizes
        _, J = self._at(self.start)
        lengths = np.linalg.norm(J, axis=1)
        self._rows = np.flatnonzero(lengths > COMPUTED_ZERO * np.max(lengths))
        self._weights = 1.0 / lengths[self._rows]
        self.is_regular = len(self._rows) == J.shape[1] - 1

    @property
    def active(self) -> list[str]:
        """Names of the rows in force."""
        return [row.name for row in self._active]

    def visible(self, y: Floats) -> Floats:
        """Return the positions, states and parameter of a point, without multipliers.

        The values stay scaled; distances of points are measured by these.

        y : (k + 1,), the scaled unknowns.
        """
        count = len(y) - 1 - len(self._rest.rows)
        return np.append(y[:count], y[-1])

    def scaled(self, other: RestCurve, y: Floats) -> Floats:
        """Return a point y (k + 1,) of another curve in the scales of this curve.

        Both curves have equal active rows.
        """
        return np.asarray(y * other._sizes / self._sizes)

    def value(self, y: Floats) -> float:
        """Return the value of the parameter at scaled unknowns y (k + 1,)."""
        return float(y[-1] * self._sizes[-1])

    def _model_at(self, value: float) -> Any:
        """Return the equations, and residuals of a rest, at a value of the parameter.

        Both are objects (`Equations`, `Rest`) bound to that value.
        """
        if value not in self._bound:
            if len(self._bound) > 8:
                self._bound.clear()
            model = self.model.bind({}, None, **{self.name: value})
            e, old = self._e.of(model), self._rest.point.state
            q, own = old.q.copy(), {x.name: x.value for x in model.initial}
            for j in set(range(len(q))).difference(self._free):
                q[j] = own[e.q[j]]
            rest = copy.copy(self._rest)
            rest.point = Point(e, Instant(old.t, q, old.v, old.s))
            self._bound[value] = e, rest
        return self._bound[value]

    def _at(self, y: Floats) -> tuple[Floats, Floats]:
        """Return the residuals F (k,) at scaled unknowns y (k + 1,), and dF/dy.

        dF/dy has shape (k, k + 1).
        """
        value = self.value(y)
        x = (y * self._sizes)[:-1]
        r, J = self._model_at(value)[1].evaluated(x)
        step = STEP * self._sizes[-1]
        sides = [self._model_at(value + s)[1].evaluated(x)[0] for s in (-step, step)]
        by_value = (sides[1] - sides[0]) / (2.0 * step)
        return r, np.column_stack([J, by_value]) * self._sizes

    def _scaled(self, y: Floats) -> tuple[Floats, Floats]:
        r, J = self._at(y)
        return r[self._rows] * self._weights, J[self._rows] * self._weights[:, None]

    def returned(self, y: Floats, normal: Floats) -> tuple[Floats, int] | None:
        """Return the point of the curve in the plane through y, by Newton's method.

        Parameters
        ----------
        y, normal : ndarray, shape (k + 1,)
            A point near the curve, and the normal of the plane.

        Returns
        -------
        tuple of (ndarray, int), or None
            The point (k + 1,), and the number of iterations; None without convergence.
        """
        first = y
        for k in range(ITERATIONS):
            r, J = self._scaled(y)
            if not (np.all(np.isfinite(r)) and np.all(np.isfinite(J))):
                return None
            right = np.append(-r, normal @ (first - y))
            try:
                step = np.linalg.solve(np.vstack([J, normal]), right)
            except np.linalg.LinAlgError:
                return None
            y = y + step
            if np.linalg.norm(step) <= CONVERGED:
                return y, k
        return None

    def place(self, y: Floats, along: Floats) -> BranchPoint:
        """Return y, a point of the curve, as `BranchPoint` with its tangent.

        along : (k + 1,), a direction, whose product with the tangent is positive.
        """
        _, J = self._scaled(y)
        _, _, V = np.linalg.svd(J)
        tangent = V[-1] * (1.0 if V[-1] @ along >= 0.0 else -1.0)
        sign, _ = np.linalg.slogdet(np.vstack([J, tangent]))
        steady = self._steady(y)
        return BranchPoint(y, tangent, float(sign), steady, stability_of(steady)[0])

    def second_direction(self, place: BranchPoint) -> Floats:
        """Return the direction (k + 1,) of the second branch at a branch point.

        place : the branch point.
        """
        _, J = self._scaled(place.y)
        _, _, V = np.linalg.svd(J)
        plane = V[-2:]
        other = plane[0] - (plane[0] @ place.tangent) * place.tangent
        if np.linalg.norm(other) < 0.5:
            other = plane[1] - (plane[1] @ place.tangent) * place.tangent
        return np.asarray(other / np.linalg.norm(other))

    def beyond(self, edge: Special) -> RestCurve | None:
        """Return the curve of rests beyond a point `edge` where a contact changes.

        It is None if friction of that contact then holds a range of positions.
        """
        assert edge.law is not None
        own = self._e.laws.index(edge.law)
        slips = [law.row.name for law in self._e.laws if law.normal == own]
        gone = {edge.law.row.name, *slips}
        active = [row for row in self._active if row.name not in gone]
        if edge.law.row.name not in self.active:
            if slips:
                return None
            active.append(edge.law.row)
        steady, value = self._steady(edge.place.y, active), self.value(edge.place.y)
        return RestCurve(self.model, self.name, self.ends, self._search, steady, value)

    def _steady(self, y: Floats, active: Sequence[Row] | None = None) -> Steady:
        """Return the rest at scaled unknowns y (k + 1,), with the motion about it.

        active : rows in force in place of the active rows of the curve, if given.
        """
        e, rest = self._model_at(self.value(y))
        state = rest.at((y * self._sizes)[:-1]).state
        rows = self._active if active is None else active
        whole = replace(e, rows=(*e.rows, *rows), laws=())
        linear = self._linear.bound(whole) if active is None else Linearisation(whole)
        x = linear.values(state.t, state.q, state.v, state.s)
        errors = Point(whole, state).solved_errors()
        found = linear.linear(x, linear.noise(x, errors))
        free = [q for j, q in enumerate(e.q) if j not in self._free]
        bounded = {law.row.name for law in self._e.laws if law.bounded}
        sticks = any(row.name in bounded for row in rows)
        return Steady(
            whole,
            state,
            linear,
            found,
            eigenvalues_of(found.R),
            x.values,
            tuple(free),
            sticks,
        )

    def _margins(self, place: BranchPoint) -> list[float]:
        """Return the distance of each contact from a change, at a point of the curve.

        It is the multiplier of a contact in force, else the gap. The result has an
        entry for each law; inf for laws that are no contacts.
        """
        values, names = place.steady.values, {row.name for row in self._active}
        found = []
        for law in self._e.laws:
            if not law.gapped:
                found.append(math.inf)
            elif law.row.name in names:
                found.append(values[f"lambda_{law.row.name}"])
            else:
                point = Point(place.steady.equations, place.steady.state)
                found.append(float(point.array([law.row.residual])[0]))
        return found

    def holds(self, place: BranchPoint) -> bool:
        """Whether the contacts admit a point of the curve.

        Contacts in force push, and no other contact is penetrated.

        place : the point.
        """
        return min(self._margins(place), default=0.0) >= 0.0

    def _edge(self, here: BranchPoint, there: BranchPoint) -> Special | None:
        """Return the point between two points at which a contact opens or closes.

        None if no contact does so, or if the curve leaves the range of the parameter
        before.
        """
        # At the first point a contact may open or close by its rounding.
        begins = not self.holds(here)
        place = here if begins else self._located(here, there, self.holds)
        low, high = self.ends
        if not low <= self.value(place.y) <= high:
            return None
        after, at = self._margins(there), self._margins(place)
        # Of several contacts within the step, the first.
        pairs = zip(at, after, strict=True)
        parts = [abs(x / y) if y < 0.0 else math.inf for x, y in pairs]
        return Special(CONTACT, place, self._e.laws[int(np.argmin(parts))])

    # Along the curve

    def followed(
        self, first: BranchPoint, interrupt: Interrupt | None = None
    ) -> Iterator[BranchPoint]:
        """Generate the points of the curve from `first` on, along its tangent.

        The last point is at an end of the range, or where a contact opens or closes.
        After an interrupt no further points are generated.
        """
        here, step = first, FIRST
        if self._leaves(first):
            return
        for count in range(MOST):
            if interrupt is not None and interrupt.requested:
                return
            there, iterations = self._next(here, step)
            if there is None:
                step /= 2.0
                if step < LEAST:
                    return
                continue
            ended = self._end(here, there)
            if ended is not here:
                yield ended or there
            if ended:
                return
            closed = np.linalg.norm(there.y - first.y) < step
            if count > FEW and closed and there.tangent @ first.tangent > 0.0:
                return
            here = there
            if iterations <= FEW:
                step = min(GREATEST, 1.5 * step)

    def _end(self, here: BranchPoint, there: BranchPoint) -> BranchPoint | None:
        """Return the point between two points at which the curve ends, or None.

        A curve ends where a contact opens or closes, and at the ends of the range.
        """
        edge = None if self.holds(there) else self._edge(here, there)
        if edge is None:
            return self._at_end(here, there)
        self.edges.append(edge)
        return edge.place

    def _leaves(self, first: BranchPoint) -> bool:
        """Whether the curve leaves the range at once, from `first` at an end of it."""
        value, rate = self.value(first.y), float(first.tangent[-1])
        low, high = self.ends
        return (value >= high and rate > 0.0) or (value <= low and rate < 0.0)

    def _next(self, here: BranchPoint, step: float) -> tuple[BranchPoint | None, int]:
        """Return the point of the curve after a step, and the number of iterations.

        The point is None if Newton's method fails.

        here : the point before.
        step : length along the tangent.
        """
        found = self.returned(here.y + step * here.tangent, here.tangent)
        if found is None:
            return None, ITERATIONS
        there = self.place(found[0], here.tangent)
        return (there if there.tangent @ here.tangent > TURNED else None), found[1]

    def _at_end(self, here: BranchPoint, there: BranchPoint) -> BranchPoint | None:
        """Return the point at the end of the parameter's range that a step has passed.

        None if the step ends within the range.

        here, there : the ends of the step.
        """
        low, high = self.ends
        value = self.value(there.y)
        if low <= value <= high:
            return None
        end = (high if value > high else low) / self._sizes[-1]
        part = (end - here.y[-1]) / (there.y[-1] - here.y[-1])
        y = here.y + part * (there.y - here.y)
        y[-1] = end
        found = self.returned(y, np.eye(len(y))[-1])
        return self.place(found[0] if found else y, here.tangent)

    def specials(self, here: BranchPoint, there: BranchPoint) -> Iterator[Special]:
        """Generate the special points between two neighbouring points of the curve."""
        tests: list[tuple[str, Callable[[BranchPoint], bool]]] = [
            (FOLD, lambda x: x.tangent[-1] > 0.0),
            (BRANCH, lambda x: x.sign > 0.0),
            (HOPF, lambda x: x.has_growing_oscillation),
        ]
        for kind, test in tests:
            if test(here) is test(there):
                continue
            place, past = self._bracket(here, there, test)
            if kind == HOPF and not past.begins_to_grow:
                continue  # two real eigenvalues have become a pair, or a pair two
            yield Special(kind, place)

    def _located(
        self, here: BranchPoint, there: BranchPoint, test: Callable[[BranchPoint], bool]
    ) -> BranchPoint:
        """Return the point between two points at which a test changes."""
        return self._bracket(here, there, test)[0]

    def _bracket(
        self, here: BranchPoint, there: BranchPoint, test: Callable[[BranchPoint], bool]
    ) -> tuple[BranchPoint, BranchPoint]:
        """Locate the point between two points at which a test changes, by bisection.

        The second point returned is the nearest one found at which the test is true.

        test : point -> whether it is past the change.
        """
        low, high, before = 0.0, float((there.y - here.y) @ here.tangent), test(here)
        best, past = there, here if before else there
        for _ in range(BISECTIONS):
            for part in PARTS:  # F' is singular at a branch point itself
                middle = low + part * (high - low)
                found = self.returned(here.y + middle * here.tangent, here.tangent)
                if found is not None:
                    break
            else:
                return best, past
            best = self.place(found[0], here.tangent)
            is_past = test(best)
            past = best if is_past else past
            if is_past is before:
                low = middle
            else:
                high = middle
            if high - low <= CONVERGED:
                break
        return best, past


class Branches:
    """All branches of rests of a model over a parameter.

    Attributes
    ----------
    name : str
    ends : (float, float)
    branches : list of list of BranchPoint
        Points of each branch; `curves` has its RestCurve.
    points : list of (RestCurve, Special)
        The special points.
    skipped : int
        The number of rests in continuous families, which are not followed.
    """

    def __init__(self, model: Model, name: str, ends: tuple[float, float]) -> None:
        self.model, self.name, self.ends = model.written_out(), name, ends
        self.branches: list[list[BranchPoint]] = []
        self.curves: list[RestCurve] = []
        self.points: list[tuple[RestCurve, Special]] = []
        self.skipped = 0
        self._waiting: list[tuple[RestCurve, BranchPoint, Floats]] = []

    def follow(
        self,
        starts: int,
        interrupt: Interrupt | None = None,
        progress: Progress = None,
    ) -> list[Equilibrium]:
        """Follow the branches through the rests, and return the rests of the file.

        Rests are searched at the value of the file, and at both ends of the range.

        starts : number of other starts of each search.
        """
        own = {p.name: p.value for p in self.model.parameters}
        own |= {x.name: x.value for x in self.model.initial}
        low, high = self.ends
        values = dict.fromkeys([min(max(own[self.name], low), high), low, high])
        rests: list[Equilibrium] = []
        for k, value in enumerate(values):
            if interrupt is not None and interrupt.requested:
                break
            model = self.model.bind({}, None, **{self.name: value})
            search = Search(setting_of(model))
            try:
                found = search.all(starts, interrupt)
            except NoRestError:
                if k == 0:
                    raise
                continue
            rests = rests or found
            for one in found:
                if one.steady.in_corner:  # its shares change along a branch
                    self.skipped += 1
                    continue
                curve = RestCurve(
                    self.model, self.name, self.ends, search, one.steady, value
                )
                self.skipped += not curve.is_regular
                if curve.is_regular and not self._is_known(curve, curve.start):
                    self._both_ways(curve, curve.start, interrupt)
            if progress is not None:
                progress((k + 1) / len(values))
        return rests

    def _both_ways(
        self, curve: RestCurve, y: Floats, interrupt: Interrupt | None
    ) -> None:
        """Follow a curve from the point y to both ends, and curves that branch off."""
        along = np.eye(len(y))[-1]
        first = curve.place(y, along)
        back = first._replace(tangent=-first.tangent)
        ways = [list(curve.followed(x, interrupt)) for x in (back, first)]
        places = [*ways[0][::-1], first, *ways[1]]
        if len(places) > 1:
            self._add(curve, places)
            self._cross(curve, interrupt)
        while self._waiting and len(self.branches) < MOST_BRANCHES:
            if interrupt is not None and interrupt.requested:
                return
            curve, place, aside = self._waiting.pop(0)
            for way in (aside, -aside):
                found = curve.returned(place.y + ASIDE * way, way)
                if found is None or self._is_known(curve, found[0]):
                    continue
                started = curve.place(found[0], way)
                more = curve.followed(started, interrupt)
                self._add(curve, [place, started, *more], begins=1)
                self._cross(curve, interrupt)

    def _cross(self, curve: RestCurve, interrupt: Interrupt | None) -> None:
        """Follow the curves that begin where contacts open or close along `curve`.

        New curves are added to `branches`; points without a regular rest beyond are
        counted in `skipped`.
        """
        edges, curve.edges = curve.edges, []
        for edge in edges:
            if not self._is_new_contact(curve, edge):
                continue
            self.points.append((curve, edge))
            other = curve.beyond(edge)
            if other is None or not other.is_regular:
                self.skipped += 1
            elif len(self.branches) < MOST_BRANCHES and not self._is_known(
                other, other.start
            ):
                self._both_ways(other, other.start, interrupt)

    def _is_new_contact(self, curve: RestCurve, edge: Special) -> bool:
        """Whether no branch but that of `curve` ends at the point `edge`.

        A contact opens or closes at that point.
        """
        at, value = edge.place.steady.state, curve.value(edge.place.y)
        room = SAME_PLACE * (self.ends[1] - self.ends[0])
        for own, other in self.points:
            if _described(other) != _described(edge):
                continue
            q = other.place.steady.state.q
            distance = np.max(
                np.abs(q - at.q) / np.maximum(1.0, np.abs(q)), initial=0.0
            )
            if abs(own.value(other.place.y) - value) <= room and distance <= SAME_PLACE:
                return False
        return True

    def _add(
        self, curve: RestCurve, places: list[BranchPoint], begins: int = 0
    ) -> None:
        self.branches.append(places)
        self.curves.append(curve)
        # The first step aside from a branch point is no part of a smooth curve.
        for here, there in pairwise(places[begins:]):
            turned = there
            if there.tangent @ (there.y - here.y) < 0.0:  # the way back, reversed
                turned = there._replace(tangent=-there.tangent, sign=-there.sign)
            if here.tangent @ (there.y - here.y) < 0.0:
                here = here._replace(tangent=-here.tangent, sign=-here.sign)  # noqa: PLW2901
            for special in _alone(list(curve.specials(here, turned))):
                if self._is_new(curve, special):
                    self.points.append((curve, special))
                    if special.kind == BRANCH:
                        aside = curve.second_direction(special.place)
                        self._waiting.append((curve, special.place, aside))

    def _is_new(self, curve: RestCurve, special: Special) -> bool:
        y = curve.visible(special.place.y)
        return not any(
            other.kind == special.kind
            and own.active == curve.active
            and np.linalg.norm(own.visible(other.place.y) - y) < ASIDE / 4.0
            for own, other in self.points
        )

    def _is_known(self, curve: RestCurve, y: Floats) -> bool:
        """Whether a point y of a curve lies on a branch that has been followed."""
        given = y
        for places, own in zip(self.branches, self.curves, strict=True):
            if own.active != curve.active:
                continue
            y = own.visible(own.scaled(curve, given))
            for here, there in pairwise([own.visible(x.y) for x in places]):
                chord = there - here
                square = float(chord @ chord) or 1.0
                part = min(1.0, max(0.0, float(chord @ (y - here)) / square))
                if np.linalg.norm(y - here - part * chord) < ASIDE / 5.0:
                    return True
        return False

    @property
    def record(self) -> dict[str, Any]:
        """The entries `vary`, `branches` and `points` of the document of equilibria."""
        pairs = zip(self.branches, self.curves, strict=True)
        return {
            "vary": {"name": self.name, "from": self.ends[0], "to": self.ends[1]},
            "skipped": self.skipped,
            "branches": [[_entry(c, x) for x in places] for places, c in pairs],
            "points": [
                _described(special) | _entry(curve, special.place)
                for curve, special in sorted(
                    self.points, key=lambda x: x[0].value(x[1].place.y)
                )
            ],
        }


def _alone(found: Sequence[Special]) -> list[Special]:
    """Return the special points, less each fold that is also a branch point.

    The branch points stay in the list.
    """
    meets = [x.place.y for x in found if x.kind == BRANCH]
    return [
        x
        for x in found
        if x.kind != FOLD
        or all(np.linalg.norm(x.place.y - y) > ASIDE / 4.0 for y in meets)
    ]


def _described(special: Special) -> dict[str, Any]:
    """Return the entries of a special point in documents: its kind, and a contact.

    The contact is left out unless one opens or closes.
    """
    found = {"kind": special.kind}
    return found | ({"constraint": special.law.constraint} if special.law else {})


def _entry(curve: RestCurve, place: BranchPoint) -> dict[str, Any]:
    e, at = place.steady.equations, place.steady.state
    found: dict[str, Any] = {
        "value": curve.value(place.y),
        "coordinates": dict(zip(e.q, (at.q + 0.0).tolist(), strict=True)),
    }
    if e.states:
        names = [x.name for x in e.states]
        found["states"] = dict(zip(names, at.s.tolist(), strict=True))
    return found | {"stable": place.stable}


def varied(model: Model, name: str, ends: tuple[float, float]) -> Branches:
    """Return the branches over a parameter or a start value, not yet followed.

    Raises
    ------
    InputError
        If there is no such name, or if the ranges or subscripts of families depend on
        it.
    """
    known = [*(p.name for p in model.parameters), *(x.name for x in model.initial)]
    if name not in known:
        hint = member_hint(name, known) or did_you_mean(name, known)
        hint = hint or f"one of {', '.join(known[:20])}"
        text = f"`{name}` is no parameter and no start value"
        raise unusable(UNKNOWN_NAME, text, hint=hint)
    if name in model.stated.structural():
        text = f"`{name}` cannot be varied: members of families are counted by it"
        raise unusable(USAGE, text, hint=f"take each of its values: --set {name}=3")
    return Branches(model, name, ends)


def tables(record: dict[str, Any]) -> dict[str, bytes]:
    """Return {"equilibrium.csv": content}, with a row for each point of each branch.

    record : the result of `Branches.record`.
    """
    rows, names = [], list[str]()
    for number, places in enumerate(record["branches"], 1):
        for x in places:
            values = {**x["coordinates"], **x.get("states", {})}
            names = names or list(values)
            stable = "" if x["stable"] is None else x["stable"]
            rows.append([number, x["value"], *values.values(), stable])
    header = ("branch", record["vary"]["name"], *names, "stable")
    return {"equilibrium.csv": table_of(header, rows)}
