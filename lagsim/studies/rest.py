"""Positions of rest of a model, their stability, and branches of them over a parameter.

Constraints that move stand still at the time of the start; energies and forces have
their values at this time. Rests are searched from the start of the file and from other
starts, the same ones every time.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cached_property
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from lagsim.admissibility.balance import Rest, Way
from lagsim.admissibility.kinks import CORNER, Kinks
from lagsim.admissibility.point import Point
from lagsim.admissibility.rest import AtRest, RestCorner, acting_rows, find_rest
from lagsim.admissibility.verdict import (
    RelationResiduals,
    acting,
    at_rest,
    judge_laws,
    judge_rest,
)
from lagsim.codes.known import NO_REST
from lagsim.errors import LagsimError
from lagsim.language.evaluate import addends, evaluate
from lagsim.language.graph import TooMuchError
from lagsim.language.names import rate_of
from lagsim.mechanics.linearisation import (
    BoundedEigenvalues,
    Linear,
    Linearisation,
    eigenvalues_of,
)
from lagsim.mechanics.pieces import whole
from lagsim.mechanics.rows import Mode
from lagsim.notes import Caution
from lagsim.outputs.manifest import head
from lagsim.outputs.table import table_of
from lagsim.run.session import StartError
from lagsim.studies.continuum import Continuum
from lagsim.studies.nonlinear import Linearised, not_linear
from lagsim.studies.setting import Setting, with_sliding
from lagsim.tolerances import (
    COMPUTED_ZERO,
    HALF_OF_DIGITS,
    SAME_RESULT,
    SATISFIED,
    STATE_ROUNDOFF,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

    from lagsim.language.arrays import Flags, Floats
    from lagsim.mechanics.constraints import Row
    from lagsim.mechanics.equations import Equations, Instant
    from lagsim.run.interrupt import Interrupt

    Progress = Callable[[float], None] | None

MANIFEST = "equilibrium.json"
# Number of other starts, and the seed of their positions.
STARTS, SEED = 20, 7
# Where a coordinate is tested for a period, beside the start, in radians.
BESIDE = (0.37, 1.13)
TURN = 2.0 * math.pi
# Displacements along a motion at which the equations must be those of its start.
ALONG = (0.73, 1.9)


class NoRestError(LagsimError):
    """Error raised where no rest, or no steady motion, is found (exit code 1)."""

    exit_code = 1
    code = NO_REST


# --- Steady states with their linearised motion


class Steady(NamedTuple):
    """State at rest or in steady motion, with the linearised motion about it.

    Attributes
    ----------
    equations : Equations
        The equations, with the rows that hold at the state as equality rows, and
        without laws.
    state : Instant
    linearisation : Linearisation
        Derivatives of `equations`, for linearisation at any state.
    linear : Linear
        The linearised motion about the state.
    spectrum : BoundedEigenvalues
        Eigenvalues of `linear`, with bounds of their rounding errors.
    values : dict of str to float
        The values of all variables, with accelerations and multipliers.
    free : tuple of str
        Coordinates that no force depends on, and which the constraints do not fix.
    sticks : bool
        Whether friction, or a limited equality, holds the state.
    in_corner : bool
        Whether the rest is in a corner of forces or equalities. The equations are then
        those of all sides of the corner, with their shares, and rows hold the state in
        the corner.
    on_ridge : bool
        Whether the forces of one side of a surface drive the state away from it.
    sliding : mapping of str to float
        Multipliers of limited equalities that slide, by the name of the row.
    """

    equations: Equations
    state: Instant
    linearisation: Linearisation
    linear: Linear
    spectrum: BoundedEigenvalues
    values: dict[str, float]
    free: tuple[str, ...] = ()
    sticks: bool = False
    in_corner: bool = False
    on_ridge: bool = False
    sliding: Mapping[str, float] = MappingProxyType({})

    def cautions(self, setting: Setting) -> list[Caution]:
        """Return warnings where the motion about the state is not linear."""
        origin, laws = (setting.point.q, setting.start.v), setting.equations.laws
        known = self.equations, self.state, self.linearisation, self.values
        return not_linear(Linearised(*known, laws, origin))

    @property
    def energy(self) -> float:
        """The value of the energy function at the state."""
        e = self.equations
        return float(evaluate(e.graph, [e.energy], self.values)[0])

    @property
    def record(self) -> dict[str, float]:
        """The state by name: t, coordinates, rates and first-order states."""
        e, at = self.equations, self.state
        numbers = [at.t, *at.q.tolist(), *at.v.tolist(), *at.s.tolist()]
        return dict(zip(("t", *e.state), (x + 0.0 for x in numbers), strict=True))


def _steady(
    setting: Setting,
    state: Instant,
    active: Sequence[Row],
    free: Sequence[str] = (),
    *,
    sticks: bool = False,
    corner: RestCorner | None = None,
) -> Steady:
    """Return a state at rest, or in steady motion, with the motion linearised about it.

    Parameters
    ----------
    setting : Setting
    state : Instant
    active : sequence of Row
        Rows of active laws, see `admissibility.rest.AtRest`.
    free : sequence of str
        Coordinates that no force depends on.
    sticks : bool
        Whether friction, or a limited equality, holds the state.
    corner : RestCorner or None
        See `admissibility.rest.AtRest`.
    """
    e, edges = corner or (setting.equations, ())
    e = replace(e, rows=(*e.rows, *active, *edges), laws=())
    linearisation = Linearisation(e)
    x = linearisation.values(state.t, state.q, state.v, state.s)
    errors = Point(e, state).solved_errors((setting.point.q, setting.start.v))
    linear = linearisation.linear(x, linearisation.noise(x, errors))
    pushes = evaluate(e.graph, setting.sliding.values(), x.values)
    sliding = dict(zip(setting.sliding, map(float, pushes), strict=True))
    return Steady(
        e, state, linearisation, linear, eigenvalues_of(linear.R), x.values,
        tuple(free), sticks, bool(edges), sliding=sliding,
    )  # fmt: skip


def steady_rest(setting: Setting, found: AtRest) -> Steady:
    """Return a rest with the motion linearised about it."""
    point = found.point
    laws = point.e.laws
    active = {row.name: row for row in found.active}
    if laws:
        own = acting(point, judge_laws(point, setting.off))
        for k in sorted(own.holding):
            if not (laws[k].slips and own.modes[k] is Mode.REDUNDANT):
                active.setdefault(laws[k].row.name, laws[k].row)
    bounded = {x.row.name for x in laws if x.bounded}
    free = found.undetermined
    sticks = not bounded.isdisjoint(active)
    rows, at = [*active.values()], point.state
    steady = _steady(setting, at, rows, free, sticks=sticks, corner=found.corner)
    return steady._replace(on_ridge=found.on_ridge)


def steady_start(setting: Setting) -> Steady:
    """Return the start, which is at rest or in steady motion, linearised.

    Raises
    ------
    StartError
        If the start is not admissible.
    NoRestError
        If the start has accelerations, or its rates change the equations.
    """
    e, state = setting.equations, setting.start
    if not setting.report.admissible:
        raise StartError(e, setting.report)
    point = Point(e, state)
    verdicts = judge_laws(point, setting.off)
    own = acting(point, verdicts)
    rows = acting_rows(point)
    modes = {k: e.laws[k] for k in own.modes if k in rows}
    sliding = [x for k, x in modes.items() if x.bounded and k not in own.holding]
    if sliding or own.struck:
        names = ", ".join(dict.fromkeys(f"`{x.name}`" for x in sliding))
        why = f"{names} slides there" if sliding else "an impact begins there"
        text = (
            f"the start is no steady motion: {why}, and small motions about it would "
        )
        raise NoRestError(text + "not be linear")
    active = [rows[k] for k in sorted(own.holding & rows.keys())]
    found = _steady(setting, state, active)
    x = found.linearisation.values(state.t, state.q, state.v, state.s)
    moving = _unsteady(Point(found.equations, state))
    if moving:
        listed = ", ".join(f"{v.name} = {v.position.value:.6g}" for v in moving)
        text = f"the start is neither at rest nor in steady motion: {listed}"
        raise NoRestError(text)
    fastest = float(np.max(np.abs(state.v), initial=0.0))
    for part in ALONG if fastest else ():
        moved = replace(state, q=state.q + part / fastest * state.v)
        try:
            y = found.linearisation.values(moved.t, moved.q, moved.v, moved.s)
        except ValueError:
            y = None
        changes = y is None or not all(_same(a, b) for a, b in _compared(x, y))
        if changes or _unsteady(Point(found.equations, moved)):
            rates = zip(e.velocities, state.v.tolist(), strict=True)
            listed = ", ".join(f"{name} = {v:.6g}" for name, v in rates if v)
            raise NoRestError(
                "the start is in no steady motion: the equations change along it, "
                f"with {listed}"
            )
    return found


def _unsteady(point: Point) -> list[RelationResiduals]:
    """Return verdicts on accelerations, and on rates of states, that are not zero."""
    point = point.at(errors=point.solved_errors())
    verdicts = judge_rest(point, (), velocities=False) + _judged_states(point)
    return [v for v in verdicts if not v.satisfied]


def _judged_states(point: Point) -> list[RelationResiduals]:
    """Return verdicts on whether the rates of first-order states are 0."""
    found = []
    for state in point.e.states:
        value, *terms = point.array([state.rate, *addends(point.g, state.rate)])
        bound = SATISFIED * float(np.sum(np.abs(terms)))
        found.append(at_rest(rate_of(state.name), float(value), bound))
    return found


def _compared(x: Any, y: Any) -> Iterator[tuple[Floats, Floats]]:
    """Yield the matrices of the linearised motion x, each with that of y.

    The matrices are the mass matrix, the constraint rows, and the slopes. x and y
    belong to two states of one motion; if the motion is steady, both matrices of each
    pair are equal.
    """
    yield x.M, y.M
    yield x.A, y.A
    yield x.slopes, y.slopes


def _same(a: Floats, b: Floats) -> bool:
    size = float(np.max(np.abs(a), initial=0.0))
    return bool(np.max(np.abs(a - b), initial=0.0) <= COMPUTED_ZERO * size)


# --- Positions of rest


class Equilibrium(NamedTuple):
    """Position of rest.

    Attributes
    ----------
    steady : Steady
        The rest, with the motion linearised about it.
    distance : float
        The largest change of a coordinate from the start, relative to max(1, |start|);
        of an angle in radians.
    from_start : bool
        Whether the search from the start of the file leads there.
    stable : bool or None
        Whether the rest is stable; None where that is not decided.
    reason : str
        What determines `stable`, or why it is None.
    """

    steady: Steady
    distance: float
    from_start: bool
    stable: bool | None
    reason: str

    @property
    def record(self) -> dict[str, Any]:
        """The entry of `equilibria` in the document."""
        x = self.steady
        e, g, values = x.equations, x.equations.graph, x.values
        model, spectrum = e.model, x.spectrum
        nodes = [*(d.node for d in model.definitions), e.energy]
        known = dict.fromkeys(g.depends(nodes), 0.0) | values
        *defined, energy = evaluate(g, nodes, known)
        names = [c.called for c in model.constraints]
        forces = dict.fromkeys(names, 0.0)
        more: dict[str, float] = {}
        for row in (x for x in e.rows if not x.name.startswith(CORNER)):
            own, value = whole(row.name), values[f"lambda_{row.name}"]
            into = more if own.startswith("friction.") else forces
            into[own] = into.get(own, 0.0) + value + 0.0
            for drag in row.drags:
                (part,) = evaluate(g, [drag.part], values)
                more[drag.slip.name] = part * value + 0.0
        forces |= x.sliding
        # A relation between vectors has a multiplier for each component.
        parts = {name.rpartition(".")[0] for name in forces}
        forces = {name: y for name, y in forces.items() if name not in parts}
        eigenvalues = [*spectrum.values, *[0j] * spectrum.zero]
        found: dict[str, Any] = {
            "coordinates": _named(e.q, x.state.q),
            "states": _named([s.name for s in e.states], x.state.s),
            "definitions": {
                d.name: value + 0.0
                for d, value in zip(model.definitions, defined, strict=True)
            },
            "lambda": forces,
            "friction": more,
            "energy": energy,
            "stable": self.stable,
            "reason": self.reason,
            "eigenvalues": [
                [float(v.real) + 0.0, float(v.imag) + 0.0] for v in eigenvalues
            ],
            "distance": self.distance,
            "from_start": self.from_start,
            "free": list(x.free),
            "continuum": x.sticks,
        }
        for key in ("states", "friction"):
            if not found[key]:
                del found[key]
        return found


def _named(names: Sequence[str], values: Floats) -> dict[str, float]:
    return dict(zip(names, (values + 0.0).tolist(), strict=True))


def full_turn_angles(point: Point, others: Sequence[int] = ()) -> Flags:
    """Return a mask of the coordinates that are angles of period 2 pi, shape (n,).

    A whole turn of an angle changes no equation, and none of the nodes `others`, at the
    start and beside it.
    """
    e = point.e
    nodes = [*e.mass_nodes, *e.f, *(row.residual for row in e.every_row), *others]
    # forces that are constant on one side have no zero there
    nodes += Kinks(e).positions
    found = np.zeros(point.n, bool)
    here = [point.q + np.array(x * (1 + np.arange(point.n)) % 1.0) for x in BESIDE]
    before = [point.at(q).array(nodes) for q in here]
    for j in range(point.n):
        turn = TURN * np.eye(point.n)[j]
        found[j] = all(
            _same(np.nan_to_num(x), np.nan_to_num(point.at(q + turn).array(nodes)))
            for q, x in zip(here, before, strict=True)
        )
    return found


class Search:
    """Search for the positions of rest of a model.

    Attributes
    ----------
    setting : Setting
    unknowns : tuple of sequence of int
        The positions and the first-order states that are searched for.
    tried : int
        The number of other starts from which the last search began.
    """

    tried = 0

    def __init__(self, setting: Setting) -> None:
        self.setting = setting = with_sliding(setting)
        self._point = setting.point
        self._every = range(self._point.n), range(len(setting.equations.states))
        self._spent = False
        # Coordinates on which no force depends keep their start values.
        self._moves = ~self._without_force()
        self.unknowns = np.flatnonzero(self._moves).tolist(), self._every[1]

    @cached_property
    def angles(self) -> Flags:
        """Mask (n,) of the coordinates that are angles."""
        return full_turn_angles(self._point)

    def nearby(self, *ways: Way) -> AtRest | None:
        """Return the rest to which a search from the start leads, or None.

        ways : the ways of the search, see `admissibility.rest.find_rest`; by default
            all.
        """
        return self._found(self._point, ways or (Way.NEAR, Way.CORNER, Way.FAR))

    def _found(self, point: Point, ways: Sequence[Way]) -> AtRest | None:
        try:
            with np.errstate(all="ignore"):
                return find_rest(point, (), self.unknowns, self.setting.off, ways)
        except np.linalg.LinAlgError:
            return None
        except TooMuchError:  # more operations than a file of this size permits
            self._spent = True
            self._point.g.unbind()
            return None

    def others(self, count: int) -> Iterator[AtRest | None]:
        """Generate the rests found from `count` random starts, by two searches each.

        None takes the place of a rest where a search fails.
        """
        q0, random = self._point.q, np.random.default_rng(SEED)
        sizes = np.where(self.angles, math.pi, self.extent)
        for _ in range(count):
            drawn = random.uniform(-1.0, 1.0, len(q0))
            start = self._point.at(q0 + sizes * drawn * self._moves)
            yield self._found(start, (Way.ROOT,))
            yield self._found(start, (Way.DOWN, Way.CORNER))

    def _without_force(self) -> Flags:
        """Return a mask (n,) of the coordinates on which no force depends."""
        point, random = self._point, np.random.default_rng(SEED)
        rest = Rest(point, (), [*acting_rows(point).values()], self._every)
        found = np.ones(point.n, bool)
        for part in (0.0, *BESIDE):
            x = rest.x0 + part * random.standard_normal(len(rest.x0))
            J = np.nan_to_num(rest.evaluated(x)[1], nan=1.0)
            found &= np.all(J[:, : point.n] == 0.0, axis=0)
        # Forces that are constant beside a surface still depend on its side.
        stepped = point.g.depends(Kinks(point.e).surfaces.values())
        return np.array([
            not own and q not in stepped
            for own, q in zip(~found, point.e.q, strict=True)
        ])  # fmt: skip

    @cached_property
    def extent(self) -> float:
        """Return the length scale of the search, in the unit of the coordinates.

        It is the largest less the smallest component of all points of the scene, or, if
        that is 0, twice the largest |coordinate| of the start that is no angle; 1 if
        both are 0.
        """
        point, model = self._point, self.setting.model
        nodes = [x for parts in model.scene.points.values() for x in parts]
        g = point.g
        known = dict.fromkeys(g.depends(nodes), 0.0) | point.values
        places = [x for x in evaluate(g, nodes, known) if math.isfinite(x)]
        size = float(np.ptp(places)) if places else 0.0
        far = float(np.max(np.abs(point.q[~self.angles]), initial=0.0))
        return size or 2.0 * far or 1.0

    def distance(self, q: Floats) -> float:
        """Return the largest change of a coordinate from the start, at q (n,)."""
        q0 = self._point.q
        sizes = np.where(self.angles, 1.0, np.maximum(1.0, np.abs(q0)))
        return float(np.max(np.abs(self.unwound(q) - q0) / sizes, initial=0.0))

    def unwound(self, q: Floats) -> Floats:
        """Return positions q (n,) whose angles are within half a turn of the start."""
        turns = np.rint((q - self._point.q) / TURN) * self.angles
        return np.asarray(q - TURN * turns)

    def equilibrium(self, found: AtRest, *, from_start: bool) -> Equilibrium | None:
        """Return a rest with its stability; None where slopes are not finite.

        from_start : whether the search from the start of the file led to it.
        """
        at = found.point.state
        moved = found.point.at(self.unwound(at.q))
        found = found._replace(point=moved)
        try:
            steady = self.steady(found)
            verdict = stability_of(steady)
        except (ValueError, np.linalg.LinAlgError):
            return None
        far = self.distance(steady.state.q)
        return Equilibrium(steady, far, from_start, *verdict)

    def steady(self, found: AtRest) -> Steady:
        """Return a rest with the motion linearised about it."""
        still = np.flatnonzero(~self._moves).tolist()
        free = [self._point.e.q[j] for j in still]
        return steady_rest(self.setting, found._replace(undetermined=free))

    def _nearest_sticking(self, steady: Steady) -> Steady:
        """Return the rest nearest to the start among all rests that friction holds.

        If no friction sticks, `steady` is returned.
        """
        if not steady.sticks or self.distance(steady.state.q) <= SAME_RESULT:
            return steady
        forces = {
            row.name: steady.values[f"lambda_{row.name}"]
            for row in steady.equations.rows
        }
        return self._held(steady.state, forces, steady.free) or steady

    def _held(
        self, state: Instant, forces: Mapping[str, float], free: Sequence[str]
    ) -> Steady | None:
        """Return the nearest rest that friction holds; None if none is found.

        state : a rest that friction holds.
        forces : multiplier of each row in force there, by the name of the row.
        free : coordinates that no force depends on.
        """
        q0 = self._point.q
        sizes = np.where(self.angles, 1.0, np.maximum(1.0, np.abs(q0)))
        e = self.setting.equations
        try:
            region = Continuum(e, state, forces, q0, sizes, self.unknowns)
            found = region.nearest()
            if found is not None:
                return _steady(self.setting, found, region.active, free, sticks=True)
        except (ValueError, np.linalg.LinAlgError):
            pass
        return None

    def _sticking_at_start(self) -> Equilibrium | None:
        """Return the nearest rest that friction in force at the start holds.

        None if no friction or limit is in force, or no such rest exists.
        """
        point = self._point
        active = {v.name for v in judge_laws(point, self.setting.off) if v.active}
        laws, rows = point.e.laws, acting_rows(point)
        own = [k for k in rows if laws[k].constraint in active and laws[k].by_forces]
        if not any(laws[k].bounded for k in own):
            return None
        rest = Rest(point, (), [rows[k] for k in own], self.unknowns)
        lam = rest.first(point)[len(rest.x0) - len(rest.rows) :]
        names = [row.name for row in rest.rows]
        forces = dict(zip(names, lam.tolist(), strict=True))
        free = [point.e.q[j] for j in np.flatnonzero(~self._moves).tolist()]
        steady = self._held(point.state, forces, free)
        if steady is None:
            return None
        far = self.distance(steady.state.q)
        return Equilibrium(steady, far, False, *stability_of(steady))

    def nearest(self, starts: int = STARTS) -> Steady:
        """Return the nearest rest, linearised.

        Where Newton's method from the start contracts, it is the limit of that method;
        else it is the nearest rest found from all starts.

        Raises
        ------
        NoRestError
            If no rest is found.
        """
        found = self.nearby(Way.CONTRACTED)
        if found is not None:
            return self._nearest_sticking(self.steady(found))
        return self.all(starts)[0].steady

    def all(
        self,
        starts: int = STARTS,
        interrupt: Interrupt | None = None,
        progress: Progress = None,
    ) -> list[Equilibrium]:
        """Return the rests that are found, the nearest to the start first.

        Of rests at equal distances the stable ones come first.

        Raises
        ------
        NoRestError
            If no rest is found.
        """
        kept: list[Equilibrium] = []
        self.tried = 0
        for k, found in enumerate(self._each(starts)):
            if found is not None:
                other = self.equilibrium(found, from_start=k == 0)
                if other is not None:
                    self._add(kept, other)
            self.tried = (k + 1) // 2
            if progress is not None:
                progress((k + 1) / (2 * starts + 1))
            if self._spent or (interrupt is not None and interrupt.requested):
                break
        sticking = self._sticking_at_start()
        if sticking is not None:
            self._add(kept, sticking)
        if not kept:
            raise NoRestError(self._remaining(self.tried))
        nearest = (self._nearer(x) for x in kept)
        return sorted(nearest, key=_rank)

    def _nearer(self, one: Equilibrium) -> Equilibrium:
        """Return the rest nearest to the start in the continuum of rests around `one`.

        The result is `one` itself if it is an isolated rest.
        """
        steady = self._nearest_sticking(one.steady)
        if steady is one.steady:
            return one
        far = self.distance(steady.state.q)
        return Equilibrium(steady, far, one.from_start, *stability_of(steady))

    def _each(self, starts: int) -> Iterator[AtRest | None]:
        yield self.nearby()
        yield from self.others(starts)

    def _remaining(self, starts: int) -> str:
        """Return the text that no rest was found, with the rates that remain.

        starts : the number of other starts that were tried.
        """
        verdicts = judge_rest(self._point, judge_laws(self._point, self.setting.off))
        verdicts += _judged_states(self._point)
        verdicts = [v for v in verdicts if not v.satisfied] or verdicts
        left = [f"{v.name} = {v.position.value:.6g}" for v in verdicts]
        text = "no position of rest was found, from the start"
        text += f" and from {starts} others" if starts else ""
        return f"{text}: {', '.join(left[:8])} remain at the start"

    def _add(self, rests: list[Equilibrium], other: Equilibrium) -> None:
        """Add a rest to `rests`, unless `rests` has it or a rest of its family.

        Rests are of one family if they are connected by rests. Of two such rests the
        one nearer to the start is kept.
        """
        for k, one in enumerate(rests):
            if self._is_same(one.steady, other.steady):
                nearer = min(one, other, key=_rank)
                from_start = one.from_start or other.from_start
                rests[k] = nearer._replace(from_start=from_start)
                return
        rests.append(other)

    def _is_same(self, one: Steady, other: Steady) -> bool:
        """Whether two rests are equal, or belong to one continuous family of rests."""
        a, b = one.state, other.state
        difference = np.abs(np.concatenate([a.q - b.q, a.s - b.s]))
        sizes = np.maximum(np.abs(np.concatenate([a.q, a.s])), 1.0)
        if np.all(difference <= HALF_OF_DIGITS * sizes):
            return True
        active = ({x.name for x in steady.equations.rows} for steady in (one, other))
        if next(active) != next(active):
            return False
        if one.sticks or other.sticks:
            return one.sticks == other.sticks
        values = [x.spectrum.values for x in (one, other)]
        zero = one.spectrum.zero
        if not zero or zero != other.spectrum.zero or len(values[0]) != len(values[1]):
            return False
        size = max(float(np.max(np.abs(x), initial=0.0)) for x in values)
        squares = [np.sort(np.real(x * x)) for x in values]
        same = np.abs(squares[0] - squares[1]) <= HALF_OF_DIGITS * size * size
        energies = [x.energy for x in (one, other)]
        difference = abs(energies[0] - energies[1])
        return bool(np.all(same)) and difference <= HALF_OF_DIGITS * max(
            map(abs, energies)
        )


# --- Stability


def stability_of(x: Steady) -> tuple[bool | None, str]:
    """Return whether a rest is stable (None if undecided), and the reason as text.

    Where eigenvalues lie on the imaginary axis, the second variation of the energy on
    the constraints decides, if no force does work against it.
    """
    found, linear, e = x.spectrum, x.linear, x.equations
    if x.on_ridge:
        return False, "ridge"
    if found.growing.any():
        return False, "eigenvalues"
    k, d = linear.Zh.shape[1], linear.Z.shape[1]
    neutral = found.zero <= k - d + 2 * len(x.free)
    if found.decaying.all() and neutral and len(found.values):
        return True, "eigenvalues"
    if len(linear.first_order):
        return None, "not decided: eigenvalues on the imaginary axis"
    if _is_rough(e):
        return None, "not decided: forces are not linear in the velocities"
    # w' = -K a - D w in directions that are orthonormal in the metric of M.
    K, D = -linear.R[k:, :k], -linear.R[k:, k:]
    K = K @ (linear.Zh.T @ linear.lengths.T @ linear.lengths @ linear.Z)
    size = float(np.max(np.abs(K), initial=0.0))
    if np.any(np.abs(K - K.T) > SAME_RESULT * size):
        return None, "not decided: undamped, and forces without an energy act"
    losses = np.linalg.eigvalsh(D + D.T)
    if np.min(losses, initial=0.0) < -COMPUTED_ZERO * np.max(np.abs(D), initial=0.0):
        return None, "not decided: forces may add energy to the undamped motion"
    curvatures = np.linalg.eigvalsh(K + K.T)
    small = COMPUTED_ZERO * np.max(np.abs(curvatures), initial=0.0)
    if np.any(curvatures < -small):
        return None, "not decided: gyroscopic forces alone stabilise it"
    if np.sum(curvatures <= small) > len(x.free):
        return None, "not decided: the energy is level to second order"
    return True, "energy minimum"


def _is_rough(e: Equations) -> bool:
    """Whether a force of the file is not linear in the velocities, as dry friction."""
    velocities = e.flow.velocities
    degrees = [e.graph.degree(x.node, velocities) for x in e.model.forces]
    return any(x is None or x.most > 1 for x in degrees)


# --- Document, table and model file


def document_of(
    setting: Setting, found: Sequence[Equilibrium], tried: int
) -> dict[str, Any]:
    """Return the content of equilibrium.json.

    found : the rests.
    tried : the number of starts that were tried.
    """
    free = dict.fromkeys(name for x in found for name in x.steady.free)
    document = head(setting.model) | {
        "starts": tried,
        "equilibria": [x.record for x in found],
        "free": list(free),
        "continuum": any(x.steady.sticks for x in found),
    }
    if cautions := [*setting.cautions, *not_linear_about(setting, found)]:
        document["warnings"] = [c.record for c in cautions]
    return document


def not_linear_about(setting: Setting, found: Sequence[Equilibrium]) -> list[Caution]:
    """Return warnings on rests about which motions are not linear."""
    cautions = list[Caution]()
    for number, one in enumerate(found, 1):
        where = f"equilibrium {number}: " if len(found) > 1 else ""
        own = one.steady.cautions(setting)
        cautions += [x._replace(text=where + x.text) for x in own]
    return cautions


def tables(found: Sequence[Equilibrium]) -> dict[str, bytes]:
    """Return equilibrium.csv, with a row for each rest."""
    rows = []
    for number, one in enumerate(found, 1):
        x = one.record
        row = {"equilibrium": number, **x["coordinates"], **x.get("states", {})}
        row |= x["definitions"]
        row |= {f"lambda_{name}": value for name, value in x["lambda"].items()}
        keys = "energy", "stable", "reason", "distance", "from_start"
        rows.append(row | {key: x[key] for key in keys})
    cells = (["" if x is None else x for x in row.values()] for row in rows)
    return {"equilibrium.csv": table_of(tuple(rows[0]), cells)}


def _rank(one: Equilibrium) -> tuple[float, int]:
    """Return the sort key of rests: the distance, then stable before unstable."""
    stability = {True: 0, None: 1, False: 2}
    return float(f"{one.distance:.9g}"), stability[one.stable]


def with_start(
    setting: Setting, found: Sequence[Equilibrium], given: Mapping[str, Any]
) -> str:
    """Return the text of the model file with the nearest stable rest as its start.

    Without a stable rest it is the nearest rest. Comments are kept.

    found : the rests.
    given : values that replace values of parameters in the file.

    Raises
    ------
    InputError
        If a value of a family has no place of its own in the file.
    """
    one = next((x for x in found if x.stable), found[0])
    model, record = setting.model, one.record
    size = STATE_ROUNDOFF * max(1.0, float(np.max(np.abs(one.steady.state.q))))
    values = {**record["coordinates"], **record.get("states", {})}
    known = {**record["definitions"], **values}
    new = {x.name: known.get(x.name, 0.0) for x in model.initial if x.text}
    new = {name: x if abs(x) > size else 0.0 for name, x in new.items()}
    set_here = {p.name: p.value for p in model.parameters if p.name in given}
    return model.stated.rewritten(new | set_here)
