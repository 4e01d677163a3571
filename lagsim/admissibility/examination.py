"""The initial state: guesses solved, residuals judged, the nearest state found.

A relation, or its rate, is satisfied when its residual is at most TOLERANCE of the
largest of its terms and of |q_i dg/dq_i|, wherever it stands (see `verdict`), or within
the rounding error of the expressions that gave the start.
"""

from __future__ import annotations

import math
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lagsim.admissibility import advice, large
from lagsim.admissibility.dependence import LEVELS, ThinSet, thin_set
from lagsim.admissibility.finite import out_of_scale, refuse_infinite
from lagsim.admissibility.inertia import needs_constraints
from lagsim.admissibility.lengths import Form, Lengths
from lagsim.admissibility.newton import Found, Trouble, metric_of, nearest, reach
from lagsim.admissibility.point import Asked, Point
from lagsim.admissibility.rank import analyse
from lagsim.admissibility.report import RankReport, Start, StartReport
from lagsim.admissibility.unilateral import (
    contact_status,
    in_force,
    judge_laws,
    one_sided,
    out_of_force,
    with_timed,
)
from lagsim.admissibility.verdict import Verdict, judge, judge_starts
from lagsim.language.derivatives import slopes
from lagsim.language.graph import TooMuchError
from lagsim.mechanics.equations import Instant
from lagsim.notes import Caution

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from lagsim.admissibility.dependence import Dependence
    from lagsim.admissibility.integrability import Reach
    from lagsim.admissibility.point import AtState
    from lagsim.language.arrays import Floats
    from lagsim.mechanics.constraints import Row
    from lagsim.mechanics.equations import Equations


# --- Values of the start that are solved for: guesses, exact states, the nearest state

# Other roots are looked for from this many starts around the guess, this far away.
OTHER_STARTS = 16
AROUND = 1.0
# A whole turn of an angle.
TURN = 2.0 * math.pi
# Whether a dense M (n, n) is positive takes n**3 / DECOMPOSED operations.
DECOMPOSED = 2000.0
# The rows that share in a least residual: their distances, against the largest.
SHARES = 1e-6


class Solver:
    """Solves for values of the start, and keeps what there is to say about that."""

    def __init__(
        self, point: Point, q: Floats, v: Floats, errors: Mapping[str, float]
    ) -> None:
        self.point, self.e = point, point.e
        self.stated, self.errors = (q, v), errors
        self.warnings: list[Caution] = []
        # Positions were found as a double root, and are known to half of the digits.
        self.double = False
        # One-sided relations that are to be met as equalities.
        self.touching: dict[str, Row] = {}

    def metric(self, free: Sequence[int]) -> Floats:
        """Give the metric of least change on the values `free`: M as it was stated."""
        self.point.g.count(len(free) ** 3 / DECOMPOSED)
        M = self.point.mass(*self.stated, free)
        return metric_of(M, range(len(free)))

    def _nearest(self, relations: AtState, x: Floats, *, far: bool = True) -> Found:
        """Give the point nearest to x that meets the relations."""
        free = relations.free
        if len(free) >= large.LARGE and self._is_positive:
            entries = self.point.mass_entries(*self.stated, free)
            M = large.matrix(entries, len(free), len(free))
            found = large.nearest(relations, x, M)
            if found is not None:
                return found
        return nearest(relations, x, self.metric(free), far=far)

    @cached_property
    def _is_positive(self) -> bool:
        return large.is_positive(self.point, *self.stated)

    def asked(self, *, velocities: bool, definitions: bool = True) -> Asked:
        """Give what is asked of positions, or of velocities."""
        asked, g = Asked(), self.e.graph
        for row in (*self.e.rows, *self.touching.values()):
            if not velocities and row.holonomic:
                asked.add(row.name, row.residual, row.residual_scale)
            elif velocities and (not row.holonomic or row.name not in self.touching):
                asked.add(row.name, row.rate, row.rate_scale)
        names = frozenset(self.e.velocities)
        for wanted in self.e.model.initial if definitions else ():
            node = wanted.node
            if node is None or bool(g.depends([node]) & names) is not velocities:
                continue
            size = g.call("abs", node)
            asked.add(
                f"{wanted.name}: {wanted.text}", node, size, wanted.value, wanted.error
            )
        return asked

    def touch(self, rows: Mapping[str, Row]) -> None:
        """Ask of one-sided relations that they just hold."""
        self.touching |= rows

    def relations(
        self,
        free: Sequence[int],
        q: Floats,
        v: Floats,
        *,
        velocities: bool,
        definitions: bool = True,
    ) -> AtState:
        """Give what is asked of the values `free`."""
        asked = self.asked(velocities=velocities, definitions=definitions)
        return self.point.relations(
            asked, free, q, v, self.errors, velocities=velocities
        )

    def names(self, free: Sequence[int], *, velocities: bool) -> list[str]:
        """Give the names of the values `free`."""
        return [(self.e.velocities if velocities else self.e.q)[j] for j in free]

    def nearest(
        self, free: Sequence[int], q: Floats, v: Floats, *, velocities: bool
    ) -> Found:
        """Solve for the values `free`, from where they are."""
        asked = self.asked(velocities=velocities)
        x = (v if velocities else q)[list(free)]
        if not asked.nodes:
            return Found(x, met=True)
        relations = self.relations(free, q, v, velocities=velocities)
        found = self._nearest(relations, x)
        return self._noted(found, relations, asked.names, free, velocities)

    def guesses(
        self, free: Sequence[int], q: Floats, v: Floats, *, velocities: bool
    ) -> Found:
        """Solve for guesses: the nearest of several roots, and a hint that there are.

        A guess that nothing determines stays as given.
        """
        found = self.nearest(free, q, v, velocities=velocities)
        if not found.met:
            return found
        x0 = (v if velocities else q)[list(free)]
        names = self.names(free, velocities=velocities)
        if not self.asked(velocities=velocities).nodes:
            self._undetermined(names, "nothing determines")
            return found
        relations = self.relations(free, q, v, velocities=velocities)
        found = self._closest_root(relations, x0, found, free, velocities)
        named = {k for row in relations.slopes for k in row}
        flat, still = (
            np.all(np.nan_to_num(relations(x)[1]) == 0.0, axis=0) for x in (x0, found.x)
        )
        still = flat & still
        stays = [k for k in named if still[k] and found.x[k] == x0[k]]
        self._undetermined(
            [x for k, x in enumerate(names) if k not in named], "nothing determines"
        )
        self._undetermined(
            [names[k] for k in sorted(stays)], "to first order nothing determines"
        )
        moved = found.x != x0
        if np.any(moved) and np.all(flat[moved]):
            self._warn(
                "other-roots",
                "at the guess the relations have no slope: other solutions are as "
                f"near, such as {_listed(names, found.x)}",
            )
        return found

    def _undetermined(self, names: Sequence[str], what: str) -> None:
        for name in names:
            text = f"{what} the guess `{name}`: it stays as given"
            self._warn("undetermined-guess", text)

    def _closest_root(
        self,
        relations: AtState,
        x0: Floats,
        found: Found,
        free: Sequence[int],
        velocities: bool,
    ) -> Found:
        """Look for other roots around a guess; take the nearest, and say so."""
        J = relations(found.x)[1]
        double = found.trouble is Trouble.DOUBLE_ROOT
        if double or not np.all(np.isfinite(J)) or np.linalg.matrix_rank(J) < len(free):
            return found  # a family of roots: the nearest of them has been found
        random = np.random.default_rng(3)  # the same starts each time
        size = self._spread(relations, x0, found.x, velocities=velocities)
        size = np.maximum(size, np.abs(x0 - found.x))
        size[size == 0] = 1.0
        metric = self.metric(free)
        roots = [found.x if velocities else _unwound(relations, found.x, x0)]
        for _ in range(OTHER_STARTS):
            start = x0 + AROUND * size * random.standard_normal(len(free))
            other = reach(relations, start, metric, x0)
            if not other.met:
                continue
            x = other.x if velocities else _unwound(relations, other.x, x0)
            if all(np.max(np.abs(x - r) / size) > 1e-6 for r in roots):
                roots.append(x)
        if len(roots) == 1:
            return found
        roots.sort(key=lambda r: float((r - x0) @ metric @ (r - x0)))
        names = self.names(free, velocities=velocities)
        listed = "; ".join(_listed(names, root) for root in roots[1:3])
        self._warn(
            "other-roots",
            f"the guesses have other solutions too, such as {listed}; the nearest to "
            "the guess is taken",
        )
        return Found(roots[0], met=True)

    def _spread(
        self, relations: AtState, x0: Floats, x: Floats, *, velocities: bool
    ) -> Floats:
        """Give how far around a root x, found from x0, others are looked for."""
        if velocities:  # 0 may be found as 1e-60
            return np.full(len(x), np.max(np.abs([x0, x]), initial=0.0))
        q, v = relations.state(x)
        g, places = self.e.graph, {}
        for j, name in enumerate(self.e.q):
            places[g.variable(name)] = j
        forms = []
        for node in relations.asked.nodes:
            found = slopes(g, node, frozenset(places))
            forms.append(Form(node, {places[x]: slope for x, slope in found.items()}))
        spread = Lengths(self.point, forms, q, v).spread
        return np.asarray(spread[relations.free])

    def _noted(
        self,
        found: Found,
        relations: AtState,
        asked: Sequence[str],
        free: Sequence[int],
        velocities: bool,
    ) -> Found:
        """Say what was odd about a root, or why there is none."""
        where = _listed(self.names(free, velocities=velocities), found.x)
        residual, J = relations(found.x)
        worst = int(np.argmax(np.abs(residual)))
        name = asked[worst]
        if found.met:
            if found.trouble is Trouble.DOUBLE_ROOT:
                self.double |= not velocities
                self._warn(
                    "double-root",
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
            shared = far > SHARES * np.max(far)
            named = [f"`{x}`" for x, is_in in zip(asked, shared, strict=True) if is_in]
            what = " and ".join(named)
            together = " together" if len(named) > 1 else ""
            reason = f"{what} cannot be satisfied{together} near there: {least}"
        elif found.trouble is Trouble.RUNS_AWAY:
            reason = f"the guess diverges: no finite value satisfies `{name}`: {least}"
        elif found.trouble is Trouble.RANK_LOSS:
            reason = (
                f"the constraints become dependent before `{name}` is satisfied: "
                f"{least}"
            )
        else:
            reason = f"`{name}` has no finite value near {where}"
        return found._replace(reason=reason, least=least)

    def _warn(self, code: str, text: str) -> None:
        self.warnings.append(Caution(code, text))

    def exact(
        self, free: Sequence[int], q: Floats, v: Floats, *, velocities: bool
    ) -> Floats:
        """Give the nearest exact values; those that are exact to rounding stay."""
        x = v if velocities else q
        if not self.asked(velocities=velocities, definitions=False).nodes:
            return x
        relations = self.relations(free, q, v, velocities=velocities, definitions=False)
        found = self._nearest(relations, x, far=False)
        return found.x if found.met else x


def _unwound(relations: AtState, x: Floats, near: Floats) -> Floats:
    """Give a root without the whole turns of its angles that lead away from a guess.

    An angle is a component whose turn changes no relation: at the root, and beside it.
    """
    turns = np.rint((x - near) / TURN)
    for k in np.flatnonzero(turns):
        turn = np.zeros(len(x))
        turn[k] = TURN
        for at in (x, near + 0.1 * (x - near)):
            (r, J), (turned, slopes) = relations(at), relations(at + turn)
            size = 1e-9 * (np.abs(r) + TURN * np.linalg.norm(J, axis=1))
            same = np.all(np.abs(turned - r) <= size)
            if not (same and np.all(np.abs(slopes - J) <= size[:, None])):
                turns[k] = 0.0
    return np.asarray(x - TURN * turns)


def _listed(names: Sequence[str], values: Floats) -> str:
    return ", ".join(f"{n} = {x:.6g}" for n, x in zip(names, values, strict=True))


# --- The examination

# What differs from what was stated by less than so many rounding errors is not reported
# as a change.
REPORTED = 225.0
FAR = "to find the nearest admissible start takes too many operations"
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
        self.always, self.off = equations, out_of_force(equations, time)
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
            judged = self._nearby(q, v)
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
            told = contact_status(point, laws, judged, errors, sound=sound and met)
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

    def _nearby(self, q: Floats, v: Floats) -> _Judged:
        """Give what `_repaired` does, or that it takes too much work to find."""
        try:
            return self._repaired(q, v)
        except TooMuchError:
            return self._analysed(q, v, ())._replace(unsolved=FAR)

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


def start_at(equations: Equations, state: Instant) -> Start:
    """Give the ranks of equations at a state that satisfies their constraints.

    Plans are made from that.
    """
    q, v = state.q, state.v
    point = Point(equations, state.t)
    errors = point.solved_errors(q, v)
    ranks = analyse(point, q, v, errors)
    return Start(state.t, q, v, ranks, needs_constraints(point, q, v, errors))
