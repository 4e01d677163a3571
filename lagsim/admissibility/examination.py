"""Examination of the initial state: guesses, residuals, nearest admissible state.

A relation g = 0, or its rate, is satisfied if its residual is at most SATISFIED times
the largest of its terms and of |q_i dg/dq_i|, independent of the origin (see
`verdict`), or if it is within the rounding error of the expressions that state the
start.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lagsim.admissibility.advice import about_ranks, beyond_state, rough_starts
from lagsim.admissibility.corners import raised_by_corners
from lagsim.admissibility.newton import (
    NewtonResult,
    Relations,
    Trouble,
    nearest_solution,
    nearest_sparse,
    reach,
    unwound,
    with_zeros,
)
from lagsim.admissibility.point import (
    Condition,
    Lengths,
    Point,
    defined_conditions,
    implied_conditions,
)
from lagsim.admissibility.rank import LEVELS, RankReport, analyse
from lagsim.admissibility.refusal import (
    gimbal_lock,
    needs_constraints,
    out_of_scale,
    refuse_infinite,
    refuse_negative,
)
from lagsim.admissibility.verdict import (
    RelationResiduals,
    contact_status,
    in_force,
    judge_laws,
    judge_rest,
    judge_starts,
    of_gaps,
    one_sided,
    out_of_force,
    verdicts_on,
    with_timed,
)
from lagsim.codes.known import (
    COORDINATE_SINGULARITY,
    DOUBLE_ROOT,
    OTHER_ROOTS,
    UNDETERMINED_GUESS,
)
from lagsim.language.derivatives import gradient
from lagsim.language.graph import TooMuchError
from lagsim.language.names import rate_of
from lagsim.mechanics.algebra import least_change_metric
from lagsim.mechanics.constraints import scale_of
from lagsim.mechanics.equations import Instant
from lagsim.notes import Caution
from lagsim.tolerances import HALF_OF_DIGITS, STATE_ROUNDOFF

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from lagsim.admissibility.integrability import Reach
    from lagsim.admissibility.rank import Dependence, ThinSet
    from lagsim.admissibility.rest import AtRest
    from lagsim.admissibility.verdict import Residual
    from lagsim.codes.known import WarningCode
    from lagsim.language.arrays import Floats
    from lagsim.mechanics.constraints import Row
    from lagsim.mechanics.equations import Equations


@dataclass(frozen=True, slots=True)
class Start(Instant):
    """State of a start, with the rank of its rows; whether its mass matrix is regular.

    Attributes
    ----------
    ranks : RankReport
        Rank and dependences of the equality rows.
    augmented : bool
        Whether the mass matrix M alone is singular, but with the constraints every
        acceleration is determined.
    """

    ranks: RankReport
    augmented: bool


class StartReport(NamedTuple):
    """Verdicts, rank and repair of an initial state.

    Attributes
    ----------
    state : Instant
        The nearest exact state if the start is admissible, else the stated one.
    verdicts : tuple of RelationResiduals
        The constraints, then the start values of definitions that are not satisfied;
        with `rest`, the velocities and accelerations that are not zero.
    ranks : RankReport
        Rank and dependences of the equalities in force; at the nearest admissible state
        if the start is not admissible and such a state was found.
    augmented : bool
        Whether the mass matrix M alone is singular, but with the constraints every
        acceleration is determined.
    reach : Reach or None
        The configurations that velocity constraints let the motion reach; None without
        velocity constraints.
    repair : dict or None
        The initial names to change, with their new values, if the start is not
        admissible and a nearest admissible state was found.
    contradictions : tuple of Dependence
        Rows that contradict others, at the state or, if no admissible state was found,
        at the point of least residuals.
    unsolved : str
        The reason why no admissible state was found, or why the guesses alone did not
        suffice; else empty.
    changes : dict
        Differences between the stated and the exact state beyond rounding: name ->
        (stated, exact).
    warnings : tuple of Caution
    lasting : RankReport
        Rank and dependences of the equalities that are always in force.
    sticking : int
        The rank added by limited equalities that hold.
    rest : dict or None
        The guesses at rest, if requested and found: name -> value.
    """

    state: Instant
    verdicts: tuple[RelationResiduals, ...]
    ranks: RankReport
    augmented: bool
    reach: Reach | None
    repair: dict[str, float] | None
    contradictions: tuple[Dependence, ...]
    unsolved: str
    changes: dict[str, tuple[float, float]]
    warnings: tuple[Caution, ...]
    lasting: RankReport
    sticking: int = 0
    rest: dict[str, float] | None = None

    @property
    def start(self) -> Start:
        """Start of a run: time, state and ranks."""
        at = self.state
        return Start(at.t, at.q, at.v, at.s, self.lasting, self.augmented)

    @property
    def thin(self) -> ThinSet | None:
        """The set of states at which rows lose rank; None if the start is on none."""
        return self.ranks.thin

    @property
    def admissible(self) -> bool:
        """Whether a run may begin at the state."""
        if self.contradictions or self.thin is not None:
            return False
        return all(v.satisfied for v in self.verdicts)

    @property
    def degrees_of_freedom(self) -> int:
        """Number of coordinates minus the rank of the equality rows that hold.

        On a thin set, where all states lose rank, it is `ThinSet.degrees_of_freedom`,
        if that is known.
        """
        if self.thin is not None and self.thin.degrees_of_freedom is not None:
            return self.thin.degrees_of_freedom
        return len(self.state.q) - self.rank

    @property
    def rank(self) -> int:
        """The rank of the equality rows that hold."""
        return self.ranks.rank + self.sticking


# Changes of stated values below this multiple of the rounding error are not reported.
REPORTED = 225.0
FAR = "to find the nearest admissible start takes too many operations"
SIMPLE = "write the equivalent simple relations, each with a gradient that is not 0"
# Number of starts around the guess from which other roots are searched.
OTHER_STARTS = 16
# Roots farther from the guess than this multiple of the nearest are not reported.
AS_NEAR = 1.5
# Distance of the starts relative to the lengths of the relations.
AROUND = 1.0
# Whether a dense M (n, n) is positive takes n**3 / DECOMPOSED operations.
DECOMPOSED = 2000.0


def examine(
    equations: Equations,
    time: float = 0.0,
    *,
    rest: bool = False,
    classify: bool = False,
) -> StartReport:
    """Examine the initial state of a model.

    Parameters
    ----------
    equations : Equations
    time : float
        The start of the run.
    rest : bool
        Whether to solve guesses so that velocities and accelerations vanish, too.
    classify : bool
        Whether to decide which velocity constraints are integrable, and the modes of
        contacts, freewheels and limited equalities.

    Raises
    ------
    InputError
        If energies or forces are not finite, numbers differ by too many orders of
        magnitude, or a coordinate has no inertia and no constraint determines it.

    Examples
    --------
    >>> from lagsim.mechanics.derivation import derive
    >>> from lagsim.model.reader import read
    >>> text = '''
    ... coordinates: {x: {}, y: {}}
    ... parameters: {m: 1, g: 9.81}
    ... energy: {kinetic: m*(x_dot^2 + y_dot^2)/2, potential: m*g*y}
    ... constraints: {rod: x^2 + y^2 = 1}
    ... initial: {x: 0.6, y: -0.8, x_dot: 0, y_dot: 0}
    ... simulation: {duration: 1, output_step: 0.1}
    ... '''
    >>> report = examine(derive(read(text, "bob.yaml")))
    >>> report.admissible, report.rank, report.degrees_of_freedom
    (True, 1, 1)
    """
    examiner = _Examiner(equations, time, rest=rest)
    try:
        return examiner.report(classify=classify)
    except np.linalg.LinAlgError:
        raise out_of_scale(equations) from None


def start_at(equations: Equations, state: Instant) -> Start:
    """Return the `Start` of a run at a state that satisfies the constraints.

    It has the time, q, v and the states of `state`, and the ranks of the constraint
    Jacobian there.
    """
    point = Point(equations, state)
    point = point.at(errors=point.solved_errors())
    at = state.t, state.q, state.v, state.s
    return Start(*at, analyse(point), needs_constraints(point))


class _Judged(NamedTuple):
    """State at which rows were analysed, and the result of the analysis.

    Attributes
    ----------
    point : Point
        The state.
    ranks : RankReport
        Rank and dependences of the rows at the state.
    contradictions : tuple of Dependence
        Rows that contradict other rows.
    repair : dict or None
        Start values to change, with their new values, if the stated start is not
        admissible.
    unsolved : str
        The reason why no admissible state was found; else empty.
    """

    point: Point
    ranks: RankReport
    contradictions: tuple[Dependence, ...]
    repair: dict[str, float] | None = None
    unsolved: str = ""


class _Examiner:
    """Examination of one start: solves guesses, exact values and the nearest state.

    Parameters
    ----------
    equations, time, rest
        See `examine`.

    Attributes
    ----------
    stated : Point
        The state as in the file.
    free : list of list of int
        Indices of the positions, of the velocities, and of the first-order states that
        are guesses; states are solved so that their rates vanish.
    errors : dict of str to float
        Error bounds of the values as stated or, for guesses, as solved.
    touching : dict of str to Row
        Contacts and freewheels to be satisfied as equalities.
    double : bool
        Whether positions are a double root, known to half of the digits.
    """

    def __init__(self, equations: Equations, time: float, *, rest: bool) -> None:
        self.rest = rest
        self.always, self.off = equations, out_of_force(equations, time)
        self.e = with_timed(equations, self.off)
        self.initial = {x.name: x for x in equations.model.initial}
        self.errors = {x.name: x.error for x in equations.model.initial}
        own = [self.initial[x] for x in equations.state]
        n = self.n = len(equations.q)
        values = np.array([x.value for x in own])
        self.origin = values[:n], values[n : 2 * n]
        self.stated = Point(
            self.e, Instant(time, *self.origin, values[2 * n :]), self.errors
        )
        parts = own[:n], own[n : 2 * n], own[2 * n :]
        self.free = [[j for j, x in enumerate(part) if x.guess] for part in parts]
        self.warnings: list[Caution] = []
        self.touching: dict[str, Row] = {}
        self.double = False

    def report(self, *, classify: bool) -> StartReport:
        e, guessed = self.e, any(self.free)
        refuse_infinite(self.stated, self.off, rows=not guessed)
        point, unsolved = self._at_rest() if self.rest else self._guessed()
        if guessed:
            refuse_infinite(point, self.off, rows=True)
        verdicts, laws = self._verdicts(point, e), judge_laws(point, self.off)
        starts = judge_starts(point)
        unmet = [x for x in starts if not x.satisfied]
        if self.rest:
            unmet += [x for x in judge_rest(point, laws) if not x.satisfied]
        rested, point = point, point.of(self.e)
        warnings = self.warnings
        satisfied = all(verdict.satisfied for verdict in (*verdicts, *laws, *unmet))
        if satisfied:
            refuse_negative(point, {x.name for x in laws if x.active})
            warnings += rough_starts(e, verdicts, starts)
            judged = self._exact(point, laws)
        else:
            try:
                judged = self._repaired(point)
            except TooMuchError:
                judged = self._analysed(point, ())._replace(unsolved=FAR)
        here = judged.point
        always = Point(self.always, here.state, here.errors)
        augmented = needs_constraints(always)
        thin = judged.ranks.thin.names if judged.ranks.thin else ()
        sound = not judged.contradictions and not thin
        warnings += beyond_state(e)
        warnings += about_ranks(e, judged.ranks, thin, sound=sound)
        reach: Reach | None = None
        dependent = {d.name for d in judged.ranks.dependences}
        verdicts = [x._replace(redundant=x.name in dependent) for x in verdicts]
        if classify and not all(row.holonomic for row in e.rows):
            from lagsim.admissibility.integrability import classified

            verdicts, reach = classified(here, verdicts)
        lasting = judged.ranks if e is self.always else analyse(always)
        sticking = 0
        if classify and (frame := gimbal_lock(here, e.q)):
            text = f"at the start the angles of the frame `{frame}` are near gimbal "
            text += "lock, where their rates are unbounded; use other `axes`, put it "
            text += "`on` a turned frame, or give a `quaternion`"
            self._warn(COORDINATE_SINGULARITY, text)
        if classify and laws:
            laws, sticking, cautions = contact_status(
                here.of(rested.e), laws, judged.ranks.rank, sound=sound and satisfied
            )
            warnings += cautions
        if classify and satisfied and sound:
            sticking += raised_by_corners(here)
        if e.laws:
            place = {c.name: k for k, c in enumerate(e.model.constraints)}
            every = of_gaps([*in_force(verdicts, e), *laws])
            verdicts = sorted(every, key=lambda x: place[x.name])
        return StartReport(
            state=here.state if satisfied else point.state,
            verdicts=(*verdicts, *unmet),
            ranks=judged.ranks,
            lasting=lasting,
            sticking=sticking,
            augmented=augmented,
            reach=reach,
            repair=judged.repair,
            contradictions=judged.contradictions,
            unsolved=judged.unsolved or unsolved,
            changes=self._changes(point, here) if satisfied else {},
            warnings=tuple(warnings),
            rest=self._guesses_at(here) if self.rest and satisfied else None,
        )

    def _guesses_at(self, point: Point) -> dict[str, float]:
        return {x: point.values[x] for x in self.e.state if self.initial[x].guess}

    def _warn(self, code: WarningCode, text: str) -> None:
        if (caution := Caution(code, text)) not in self.warnings:
            self.warnings.append(caution)

    # Values of the start that are solved for

    def _relations(
        self,
        point: Point,
        free: Sequence[int],
        *,
        velocities: bool,
        definitions: bool = True,
        laws: Sequence[Row] = (),
    ) -> Relations:
        """Return the relations that determine the unknowns with the indices `free`.

        velocities : whether the unknowns are velocities, not positions.
        definitions : whether the relations include stated start values of definitions.
        laws : rows of laws that are equalities here, besides those of `touching`.
        """
        e = self.e
        # Contacts that touch imply no equation for the rate: an impact decides it.
        touching = self.touching.values()
        rows = [*e.rows, *(r for r in touching if not (velocities and r.holonomic))]
        known = {row.name for row in rows}
        rows += [row for row in laws if row.name not in known]
        conditions = implied_conditions(rows, velocities=velocities)
        if definitions:
            conditions += defined_conditions(point, velocities=velocities)
        return Relations(point, conditions, free, velocities=velocities)

    def _metric(self, relations: Relations) -> Floats:
        """Return the metric (k, k) in which changes of the unknowns are measured.

        It is M at the stated start; the identity for first-order states.
        """
        k, free = len(relations.free), relations.free
        if relations.block > 1:
            return np.eye(k)
        M = self.stated.mass_entries(free)
        self.stated.g.count(k**3 / DECOMPOSED)
        return least_change_metric(M.dense(k, k))

    def _nearest(self, relations: Relations, *, far: bool = True) -> NewtonResult:
        """Return the solution of the relations that is nearest to their point.

        far : whether other first iterates are tried, too.
        """
        free = relations.free
        if not relations.conditions:
            return NewtonResult(relations.x0, converged=True)
        large = len(free) >= Point.LARGE and relations.block < 2
        found = None
        if large and self.stated.is_safely_positive:
            M = self.stated.mass_entries(free).sparse(len(free), len(free))
            found = nearest_sparse(relations, M)
        if found is None:
            found = nearest_solution(relations, self._metric(relations), far=far)
        return found._replace(x=with_zeros(relations, found.x))

    def _solved(self, relations: Relations) -> NewtonResult:
        """Solve relations for guesses; add texts on a failure or on a special root."""
        found = self._nearest(relations)
        if not relations.conditions:
            return found
        where = _listed(relations.names, found.x)
        residual, J = relations(found.x)
        worst = int(np.argmax(np.abs(residual)))
        name = relations.conditions[worst].name
        if found.converged:
            if found.trouble is Trouble.DOUBLE_ROOT:
                self.double |= not relations.velocities
                self._warn(
                    DOUBLE_ROOT,
                    f"Newton's method converges only linearly, to {where}: a "
                    f"double root of `{name}`, or a singular configuration; the "
                    "multiplier there is not reliable",
                )
            return found
        least = f"the least |residual| is {abs(residual[worst]):.6g}, at {where}"
        if found.trouble is Trouble.MINIMUM:
            lengths = np.linalg.norm(J, axis=1)
            lengths[lengths == 0] = 1.0
            far = np.abs(residual) / lengths
            shared = zip(
                relations.conditions, far > HALF_OF_DIGITS * np.max(far), strict=True
            )
            named = [f"`{x.name}`" for x, is_in in shared if is_in]
            together = " together" if len(named) > 1 else ""
            reason = f"{' and '.join(named)} cannot be satisfied{together} near there"
            reason = f"{reason}: {least}"
        elif found.trouble is Trouble.DIVERGES:
            reason = f"the guess diverges: no finite value satisfies `{name}`: {least}"
        else:
            reason = f"`{name}` has no finite value near {where}"
        return found._replace(reason=reason, least=least)

    def _exact_values(
        self, point: Point, laws: Sequence[Row], *, velocities: bool
    ) -> Point:
        """Return the nearest point that satisfies the constraints to rounding.

        Values that are exact to rounding stay unchanged. Where laws hold, only the
        rounding of the relations counts, not that of the expressions of the start
        values: a contact with a gap of 1e-16 would begin in free flight, with impacts.

        laws : rows of laws that hold at the start but for rounding.
        velocities : whether velocities are changed, not positions.
        """
        for own in ((), laws) if laws else ((),):
            relations = self._relations(
                point.at(errors={}) if own else point, range(self.n),
                velocities=velocities, definitions=False, laws=own,
            )  # fmt: skip
            found = self._nearest(relations, far=False)
            if found.converged:
                there = relations.at(found.x)
                point = point.at(there.q, there.v)
        return point

    # Guesses

    def _guessed(self) -> tuple[Point, str]:
        """Solve for guesses: first positions, then velocities, then first-order states.

        Return the solved point, and the reason of a failure or "".
        """
        point, warnings = self.stated, self.warnings
        # Velocities that relations determine may depend on states, and these states on
        # velocities.
        again = (1, 2) * OTHER_STARTS if all(self.free[1:]) else ()
        for block in (0, 1, 2, *again):
            free = self.free[block]
            if block == 1:
                self.e = self._on_leaving_sides(point)
                point = point.of(self.e)
            if not free:
                continue
            before = len(warnings)
            while True:
                relations = self._guess_relations(point, block)
                found = self._guesses(relations)
                if not found.converged:
                    return point, found.reason
                solved = relations.at(found.x)
                own = free if block < 2 else []
                if not self._touch(solved, velocities=block > 0, free=own):
                    break
                del warnings[before:]
            errors = solved.solved_errors(self.origin)
            for name, x, x0 in zip(relations.names, found.x, relations.x0, strict=True):
                if x != x0:
                    self.errors[name] = errors.get(name, STATE_ROUNDOFF * abs(x))
            point = solved.at(errors=self.errors)
        return point, ""

    def _verdicts(self, point: Point, written: Equations) -> list[RelationResiduals]:
        """Return verdicts on the equalities at a point.

        If the point does not satisfy the equalities on the sides of corners onto which
        the motion leads, the equalities as written are in force again.

        written : the equations of the model, without a choice of sides.

        """
        found = verdicts_on(point)
        if self.e is written or all(x.satisfied for x in found):
            return found
        self.e = written
        return verdicts_on(point.of(written))

    def _on_leaving_sides(self, point: Point) -> Equations:
        """Return the equations on the sides onto which the stated velocities lead."""
        from lagsim.admissibility.kinks import on_leaving_sides

        return on_leaving_sides(point, self.free[1])

    def _at_rest(self) -> tuple[Point, str]:
        """Solve for guesses such that the state is at rest.

        Return the solved point, and the reason of a failure or "".
        """
        found = self._rest(self.free[0], self.free[2])
        if found is None:
            return self._guessed()[0], "no rest was found near the guesses"
        rates = self.stated.v.copy()
        rates[self.free[1]] = 0.0
        self.touching |= one_sided(found.point.of(self.e), found.touching)
        self._undetermined(found.undetermined, "nothing determines")
        solved, errors = found.point, found.point.solved_errors(self.origin)
        for name in self._guesses_at(solved):
            if solved.values[name] != self.stated.values[name]:
                size = STATE_ROUNDOFF * abs(solved.values[name])
                self.errors[name] = errors.get(name, size)
        return solved.at(v=rates, errors=self.errors), ""

    def _rest(self, positions: Sequence[int], states: Sequence[int]) -> AtRest | None:
        """Return a state of rest, found by variation of the given positions and states.

        None if no rest is found.

        positions, states : indices of the unknowns.
        """
        from lagsim.admissibility.rest import find_rest, sliding_limits

        still = self.stated.at(v=np.zeros(self.n))
        stated = defined_conditions(still, velocities=False)
        slides = sliding_limits(still, self.off)
        at = still.of(slides.equations) if slides.multipliers else still
        found = find_rest(at, stated, (positions, states), slides.off)
        if found is None or not slides.multipliers:
            return found
        return found._replace(point=found.point.of(self.e))

    def _guess_relations(self, point: Point, block: int) -> Relations:
        """Return the relations from which guesses are solved.

        block : 0 for positions, 1 for velocities, 2 for first-order states, whose rates
            are to be 0.
        """
        e, g, free = self.e, self.e.graph, self.free[block]
        if block < 2:
            return self._relations(point, free, velocities=block > 0)
        conditions, every = [], [g.variable(x.name) for x in e.states]
        for k in free:
            name, slope = e.states[k][:2]
            A = dict(enumerate(gradient(g, slope, every)))
            A = {j: a for j, a in A.items() if a != g.zero}
            size = scale_of(g, slope, (), {})
            conditions.append(Condition(rate_of(name), slope, A, size, 0.0, 0.0))
        return Relations(point, conditions, free, velocities=True, states=True)

    def _guesses(self, relations: Relations) -> NewtonResult:
        """Solve relations for guesses; of several roots select the nearest, and warn.

        A guess that no relation determines keeps its value.
        """
        found = self._solved(relations)
        if not found.converged:
            return found
        x0, names = relations.x0, relations.names
        named = {k for row in relations.slopes for k in row}
        unnamed = [x for k, x in enumerate(names) if k not in named]
        self._undetermined(unnamed, "nothing determines")
        if not relations.conditions:
            return found
        found = self._closest_root(relations, found)
        flat, still = (
            np.all(np.nan_to_num(relations(x)[1]) == 0.0, axis=0) for x in (x0, found.x)
        )
        changed = found.x != x0
        stays = [names[k] for k in sorted(named) if flat[k] & still[k] & ~changed[k]]
        self._undetermined(stays, "to first order no relation determines")
        if np.any(changed) and np.all(flat[changed]):
            self._warn(
                OTHER_ROOTS,
                "at the guess the relations have no slope: other solutions are as "
                f"near, such as {_listed(names, found.x)}",
            )
        return found

    def _undetermined(self, names: Sequence[str], label: str) -> None:
        for name in (x for x in names if self.initial[x].text):
            text = f"{label} the guess `{name}`: it stays as given"
            self._warn(UNDETERMINED_GUESS, text)

    def _closest_root(self, relations: Relations, found: NewtonResult) -> NewtonResult:
        """Search other roots of the relations; return the root nearest to the guess.

        A warning is stored if another root is about as near as the nearest.

        found : a first root.
        """
        x0, k = relations.x0, len(relations.free)
        J = relations(found.x)[1]
        double = found.trouble is Trouble.DOUBLE_ROOT
        if double or not np.all(np.isfinite(J)) or np.linalg.matrix_rank(J) < k:
            return found  # a family of roots: its nearest root has been found
        random = np.random.default_rng(3)  # the same starts each time
        size = np.maximum(_spread(relations, found.x), np.abs(x0 - found.x))
        size[size == 0] = 1.0
        metric = self._metric(relations)
        roots = [unwound(relations, found.x)]
        for _ in range(OTHER_STARTS):
            start = x0 + AROUND * size * random.standard_normal(k)
            other = reach(relations, start, metric, x0)
            if not other.converged:
                continue
            x = unwound(relations, other.x)
            least = HALF_OF_DIGITS * size + STATE_ROUNDOFF * np.abs(x)
            if all(np.any(np.abs(x - r) > least) for r in roots):
                roots.append(x)
        if len(roots) == 1:
            return found
        far = [float(np.sqrt((r - x0) @ metric @ (r - x0))) for r in roots]
        nearest, *others = np.argsort(far, kind="stable").tolist()
        near = [roots[k] for k in others if far[k] <= AS_NEAR * far[nearest]]
        if near:
            listed = "; ".join(_listed(relations.names, root) for root in near[:2])
            self._warn(
                OTHER_ROOTS,
                f"other solutions are about as near to the guesses, such as {listed}; "
                "the nearest is used",
            )
        return NewtonResult(with_zeros(relations, roots[nearest]), converged=True)

    # The state that is reported

    def _inexact(self, point: Point) -> Point:
        """Return the point with error bounds of its stated and its solved values."""
        here = {x: point.values[x] for x in self.e.state}
        same = {name for name, x in here.items() if x == self.initial[name].value}
        if same == here.keys():
            return point.at(errors=dict(self.errors))
        errors = point.solved_errors(self.origin)
        return point.at(errors=errors | {name: self.errors[name] for name in same})

    def _analysed(self, point: Point, levels: Sequence[str]) -> _Judged:
        sizes = point.sizes
        corrections = [
            np.asarray(np.linalg.norm(sizes * (x - x0)) / sizes)
            for x, x0 in zip((point.q, point.v), self.origin, strict=True)
        ]
        point = self._inexact(point)
        ranks = analyse(point, levels, corrections, double=self.double)
        against = tuple(d for d in ranks.dependences if d.contradictions)
        unsolved = f"{ranks.thin}: {SIMPLE}" if ranks.thin and not against else ""
        return _Judged(point, ranks, against, unsolved=unsolved)

    def _exact(self, point: Point, laws: Sequence[RelationResiduals]) -> _Judged:
        """Analyse the nearest exact state: its rows, ranks and contradictions.

        Values that are exact to rounding stay unchanged.

        laws : verdicts on the laws.
        """
        passed = {
            x.name
            for x in laws
            if x.judged and x.position.value < 0 and not x.position.exact
        }
        self.touching |= one_sided(point, passed)
        always = {row.name for row in self.always.rows}
        timed = [row for row in self.e.rows if row.name not in always]
        own = {law.constraint: law.row for law in self.e.laws if not law.slips}
        active = [x for x in laws if x.active]
        at_zero = {x.name for x in active if _is_rounding(x.position)}
        gaps = [own[name] for name in own if name in at_zero]
        slips = [own[x.name] for x in active if _is_rounding(x.rate)]
        slips = [x for x in slips if not x.holonomic or x.name in at_zero]
        point = self._exact_values(point, [*timed, *gaps], velocities=False)
        point = self._exact_values(point, [*timed, *slips], velocities=True)
        judged = self._analysed(point, LEVELS)
        if judged.contradictions:
            unsolved = f"{_text(judged.contradictions)}: no motion can begin here"
            return judged._replace(unsolved=unsolved)
        return judged

    def _repaired(self, point: Point) -> _Judged:
        """Analyse the nearest admissible state, with all start values as unknowns.

        The changed values are the `repair` of the result. If no admissible state is
        found, the result has the contradictions at the point of least residuals.
        """
        near, everything = self.stated.at(errors=self.errors), range(self.n)
        if self.rest:
            return self._at_other_rest(point)
        for k, velocities in enumerate((False, True)):
            relations = self._relations(near, everything, velocities=velocities)
            found = self._solved(relations)
            near = relations.at(found.x)
            if not found.converged:
                against = self._analysed(near, LEVELS[: k + 1]).contradictions
                reason = f"{_text(against)}; {found.least}" if against else found.reason
                judged = self._analysed(point, ())
                return judged._replace(contradictions=against, unsolved=reason)
            if self._touch(near, velocities=velocities):
                return self._repaired(point)
        changed = self._changes(self.stated, near)
        judged = self._analysed(near, LEVELS)
        if judged.contradictions or judged.ranks.thin:
            return judged
        return judged._replace(repair={name: new for name, (_, new) in changed.items()})

    def _at_other_rest(self, point: Point) -> _Judged:
        """Search a rest near the start with all start values free, and judge it.

        The result's `repair` has the start values that differ from the file.
        """
        found = self._rest(range(self.n), range(len(self.e.states)))
        if found is None:
            why = (
                "no rest was found near the start, even if all start values may change"
            )
            return self._analysed(point, ())._replace(unsolved=why)
        near = found.point.of(self.e)
        changed = self._changes(self.stated, near)
        repair = {name: new for name, (_, new) in changed.items()}
        return self._analysed(near, LEVELS)._replace(repair=repair)

    def _touch(
        self, point: Point, *, velocities: bool, free: Sequence[int] | None = None
    ) -> bool:
        """Add violated laws to the equalities `touching`; return whether any is new.

        They are contacts and freewheels, and sliders past their limits.

        Parameters
        ----------
        point : Point
            The state at which gaps and their rates are judged.
        velocities : bool
            Whether rows of velocities are added, or rows of positions.
        free : sequence of int, optional
            If given, only rows that depend on the values with these indices are added.
        """
        if not self.e.laws:
            return False
        solved = point.at(errors=point.solved_errors(self.origin))
        missed = {x.name for x in judge_laws(solved, self.off) if not x.satisfied}
        new = {
            name: row
            for name, row in one_sided(solved, missed).items()
            if name not in self.touching
            and row.holonomic is not velocities
            and (free is None or not row.A.entries.keys().isdisjoint(free))
        }
        self.touching |= new
        return bool(new)

    def _changes(self, old: Point, new: Point) -> dict[str, tuple[float, float]]:
        """Return the values that differ by more than rounding: name -> (old, new)."""
        errors = new.solved_errors((old.q, old.v))
        errors = {name: max(x, self.errors[name]) for name, x in errors.items()}
        pairs: Mapping[str, tuple[float, float]] = {
            name: (old.values[name], new.values[name]) for name in errors
        }
        return {
            name: (a, b)
            for name, (a, b) in pairs.items()
            if abs(b - a) > REPORTED * errors[name]
        }


def _is_rounding(found: Residual | None) -> bool:
    """Whether a residual is 0 but for the rounding of the start's expressions."""
    return found is not None and abs(found.value) <= found.rounding


def _spread(relations: Relations, x: Floats) -> Floats:
    """Return distances (k,) from a root x within which further roots are searched."""
    if relations.velocities:  # the exact value 0 may be found as 1e-60
        return np.full(len(x), np.max(np.abs([relations.x0, x]), initial=0.0))
    lengths = Lengths(relations.at(x), relations.conditions)
    return np.asarray(lengths.spread[relations.free])


def _listed(names: Sequence[str], values: Floats) -> str:
    return ", ".join(f"{n} = {x:.6g}" for n, x in zip(names, values, strict=True))


def _text(against: tuple[Dependence, ...]) -> str:
    return "; ".join(d.contradiction() for d in against)
