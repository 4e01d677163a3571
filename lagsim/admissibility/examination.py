"""The initial state: guesses solved, residuals judged, the nearest state found.

A relation, or its rate, is satisfied when its residual is at most TOLERANCE of the
largest of its terms and of |q_i dg/dq_i|, wherever it stands (see `verdict`), or within
the rounding error of the expressions that gave the start.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lagsim.admissibility import advice
from lagsim.admissibility.dependence import LEVELS
from lagsim.admissibility.finite import out_of_scale, refuse_infinite
from lagsim.admissibility.inertia import needs_constraints
from lagsim.admissibility.laws import (
    in_force,
    judge_laws,
    one_sided,
    waiting,
    with_timed,
)
from lagsim.admissibility.point import Point
from lagsim.admissibility.rank import analyse
from lagsim.admissibility.report import RankReport, StartReport
from lagsim.admissibility.sets import ThinSet, thin_set
from lagsim.admissibility.solving import Solver
from lagsim.admissibility.verdict import Verdict, judge, judge_starts
from lagsim.mechanics.instant import Instant

if TYPE_CHECKING:
    from collections.abc import Sequence

    from lagsim.admissibility.dependence import Dependence
    from lagsim.admissibility.integrability import Reach
    from lagsim.language.arrays import Floats
    from lagsim.mechanics.equations import Equations

# What differs from what was stated by less than so many rounding errors is not reported
# as a change.
REPORTED = 225.0
SIMPLE = "write the equivalent simple relations, each with a gradient that is not 0"


def examine(
    equations: Equations, time: float = 0.0, *, classify: bool = False
) -> StartReport:
    """Judge the initial state of a model.

    Parameters
    ----------
    time
        When the run begins.
    classify
        Also decide which velocity constraints are integrable, and what contacts,
        freewheels and limited equalities do.

    Raises
    ------
    InputError
        Where energies or forces are not finite, numbers lie too far apart to be
        computed with, or a coordinate has no inertia that no constraint determines.
    """
    try:
        return _Examiner(equations, time).report(classify=classify)
    except np.linalg.LinAlgError:
        raise out_of_scale(Point(equations, time)) from None


class _Judged(NamedTuple):
    """Where the rows are looked at, what is met there, and what contradicts."""

    q: Floats
    v: Floats
    ranks: RankReport
    contradictions: tuple[Dependence, ...]
    repair: dict[str, float] | None = None
    thin: ThinSet | None = None
    unsolved: str = ""


class _Examiner:
    def __init__(self, equations: Equations, time: float) -> None:
        self.always, self.off = equations, waiting(equations, time)
        self.e = with_timed(equations, self.off)
        self.point = Point(self.e, time)
        self.initial = {value.name: value for value in equations.model.initial}
        self.errors = {value.name: value.error for value in equations.model.initial}
        names = (*equations.q, *equations.velocities)
        stated = [self.initial[name].value for name in names]
        guessed = [self.initial[name].guess for name in names]
        n = self.n = len(equations.q)
        self.q0, self.v0 = np.array(stated[:n]), np.array(stated[n:])
        self.free_q = [j for j in range(n) if guessed[j]]
        self.free_v = [j for j in range(n) if guessed[n + j]]

    def report(self, *, classify: bool) -> StartReport:
        point = self.point
        guessed = bool(self.free_q or self.free_v)
        refuse_infinite(point, self.q0, self.v0, self.off, rows=not guessed)
        self.solver = Solver(point, self.q0, self.v0, self.errors)
        q, v, unsolved = self._guessed()
        if guessed:
            refuse_infinite(point, q, v, self.off, rows=True)
        verdicts = judge(point, q, v, self.errors)
        laws = judge_laws(point, self.off, (q, v), self.errors)
        starts = judge_starts(point, q, v, self.errors)
        unmet = [x for x in starts if not x.satisfied]
        warnings = self.solver.warnings
        stated = (q.copy(), v.copy())
        met = all(verdict.satisfied for verdict in (*verdicts, *laws, *unmet))
        if met:
            warnings += advice.rough_starts(self.e, verdicts, starts)
            judged = self._exact(q, v, laws)
            q, v = judged.q, judged.v
        else:
            judged = self._repaired(q, v)
        errors = self._errors(judged)
        always = Point(self.always, point.t)
        augmented = needs_constraints(always, judged.q, judged.v, errors)
        warnings += advice.about_names(self.e.model)
        warnings += advice.multiple_roots(self.e)
        warnings += advice.about_reactions(self.e)
        thin = judged.thin.names if judged.thin else ()
        sound = not judged.contradictions and not thin
        warnings += advice.about_ranks(self.e, judged.ranks, thin, sound=sound)
        reach: Reach | None = None
        redundant = {d.name for d in judged.ranks.dependences}
        verdicts = [x._replace(redundant=x.name in redundant) for x in verdicts]
        if classify and not all(row.holonomic for row in self.e.rows):
            from lagsim.admissibility.integrability import classified

            verdicts, reach = classified(point, verdicts, judged.q)
        lasting, sticking = judged.ranks, 0
        if self.e is not self.always:
            lasting = analyse(always, judged.q, judged.v, errors)
        if classify and laws:
            from lagsim.admissibility.standing import standing

            told = standing(point, laws, judged, errors, sound=sound and met)
            warnings += told.warnings
            laws, sticking = told.verdicts, told.raised
        if self.e.laws:
            place = {c.name: k for k, c in enumerate(self.e.model.constraints)}
            whole = [*in_force(verdicts, self.e), *laws]
            verdicts = sorted(whole, key=lambda x: place[x.name])
        return StartReport(
            state=Instant(point.t, q, v),
            verdicts=(*verdicts, *unmet),
            ranks=judged.ranks,
            lasting=lasting,
            sticking=sticking,
            augmented=augmented,
            reach=reach,
            repair=judged.repair,
            contradictions=judged.contradictions,
            unsolved=judged.unsolved or unsolved,
            changes=self._changes(stated, (q, v)),
            warnings=tuple(warnings),
            thin=judged.thin,
        )

    def _guessed(self) -> tuple[Floats, Floats, str]:
        """Solve the guesses, positions first, then velocities; say why they fail."""
        q, v = self.q0.copy(), self.v0.copy()
        for free, x, velocities in ((self.free_q, q, False), (self.free_v, v, True)):
            if not free:
                continue
            before, said = x[free], len(self.solver.warnings)
            found = self.solver.guesses(free, q, v, velocities=velocities)
            while found.met:
                x[free] = found.x
                if not self._touch(q, v, velocities=velocities, free=free):
                    break
                x[free] = before
                del self.solver.warnings[said:]
                found = self.solver.guesses(free, q, v, velocities=velocities)
            if not found.met:
                return q, v, found.reason
            errors = self.point.solved_errors(q, v, (self.q0, self.v0))
            names = self.solver.names(free, velocities=velocities)
            moved = zip(names, x[free] != before, strict=True)
            self.errors.update({name: errors[name] for name, far in moved if far})
        return q, v, ""

    def _errors(self, judged: _Judged) -> dict[str, float]:
        """Give the errors of a state: as stated, or of values solved for."""
        values = self.point.values(judged.q, judged.v)
        names = (*self.e.q, *self.e.velocities)
        if all(values[name] == self.initial[name].value for name in names):
            return dict(self.errors)
        errors = self.point.solved_errors(judged.q, judged.v, (self.q0, self.v0))
        for name, value in values.items():
            if name in errors and value == self.initial[name].value:
                errors[name] = self.errors[name]
        return errors

    def _analysed(self, q: Floats, v: Floats, levels: Sequence[str]) -> _Judged:
        judged = _Judged(q, v, RankReport(0, 1.0, 0, 1.0), ())
        sizes, both = self.point.sizes(q, v), ((q, self.q0), (v, self.v0))
        way_q, way_v = (
            np.asarray(np.linalg.norm(sizes * (x - x0)) / sizes) for x, x0 in both
        )
        double = way_q if self.solver.double else None
        errors = self._errors(judged)
        ranks = analyse(self.point, q, v, errors, levels, double=double)
        thin = None
        if levels == LEVELS:
            ways = (np.zeros_like(q) if double is None else double, way_v)
            thin, real = thin_set(self.point, q, v, ranks.dependences, ways)
            ranks = ranks._replace(
                dependences=tuple(
                    # It is not one too many, though no state nearby was found.
                    d._replace(everywhere=False)
                    if d.name in real and d.everywhere is None
                    else d
                    for d in ranks.dependences
                ),
            )
        against = tuple(d for d in ranks.dependences if d.contradictions)
        return judged._replace(ranks=ranks, contradictions=against, thin=thin)

    def _exact(self, q: Floats, v: Floats, laws: Sequence[Verdict]) -> _Judged:
        """Give the nearest exact state; one that is exact to rounding stays."""
        everything = range(self.n)
        passed = {
            x.name
            for x in laws
            if x.judged and x.position.value < 0 and not x.position.exact
        }
        self.solver.touch(one_sided(self.e, passed))
        q = self.solver.exact(everything, q, v, velocities=False)
        v = self.solver.exact(everything, q, v, velocities=True)
        judged = self._analysed(q, v, LEVELS)
        if judged.contradictions:
            unsolved = f"{_told(judged.contradictions)}: no motion can begin here"
            return judged._replace(unsolved=unsolved)
        if judged.thin:
            return judged._replace(unsolved=f"{judged.thin}: {SIMPLE}")
        return judged

    def _repaired(self, q: Floats, v: Floats) -> _Judged:
        """Give the nearest admissible state over all values, and the names to change.

        Where there is none, what contradicts at the point of least residuals.
        """
        everything = range(self.n)
        state = [self.q0.copy(), self.v0.copy()]
        for k, velocities in enumerate((False, True)):
            found = self.solver.nearest(
                everything, state[0], state[1], velocities=velocities
            )
            state[k] = found.x
            if not found.met:
                least = self._analysed(state[0], state[1], LEVELS[: k + 1])
                against = least.contradictions
                told = f"{_told(against)}; {found.least}" if against else found.reason
                judged = self._analysed(q, v, ())
                return judged._replace(contradictions=against, unsolved=told)
            if self._touch(state[0], state[1], velocities=velocities):
                return self._repaired(q, v)
        changed = self._changes((self.q0, self.v0), (state[0], state[1]))
        judged = self._analysed(state[0], state[1], LEVELS)
        if judged.contradictions:
            return judged
        if judged.thin:
            return judged._replace(unsolved=f"{judged.thin}: {SIMPLE}")
        repair = {name: new for name, (_, new) in changed.items()}
        return judged._replace(repair=repair)

    def _touch(
        self,
        q: Floats,
        v: Floats,
        *,
        velocities: bool,
        free: Sequence[int] | None = None,
    ) -> bool:
        """Ask of what is violated that it just holds; tell if any of that is new.

        Of positions, or of velocities; with `free`, only where these values matter.
        """
        if not self.e.laws:
            return False
        errors = self.point.solved_errors(q, v, (self.q0, self.v0))
        missed = {
            x.name
            for x in judge_laws(self.point, self.off, (q, v), errors)
            if not x.satisfied and x.name not in self.solver.touching
        }
        new = {
            name: row
            for name, row in one_sided(self.e, missed).items()
            if row.holonomic is not velocities
            and (free is None or not row.A.entries.keys().isdisjoint(free))
        }
        self.solver.touch(new)
        return bool(new)

    def _changes(
        self, old: tuple[Floats, Floats], new: tuple[Floats, Floats]
    ) -> dict[str, tuple[float, float]]:
        names = (*self.e.q, *self.e.velocities)
        before, after = np.concatenate(old), np.concatenate(new)
        errors = self.point.solved_errors(*new, old)
        bounds = [REPORTED * errors[name] for name in names]
        moved = np.abs(after - before) > bounds
        return {
            name: (float(before[i]), float(after[i]))
            for i, name in enumerate(names)
            if moved[i]
        }


def _told(against: tuple[Dependence, ...]) -> str:
    return "; ".join(d.contradiction() for d in against)
