"""The initial state: guesses solved, residuals judged, the nearest state found.

A relation, or its rate, is satisfied when its residual is at most TOLERANCE of the
largest of its terms and of |q_i dg/dq_i|, or within the rounding error of the
expressions that gave the start.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from lagsim.admissibility.inertia import needs_constraints
from lagsim.admissibility.integrability import Reach, reach_of
from lagsim.admissibility.newton import RANK, Found, Trouble, nearest, reach, relative
from lagsim.admissibility.point import Point
from lagsim.admissibility.rank import RankReport, analyse
from lagsim.admissibility.verdict import (
    Verdict,
    judge,
    judge_gaps,
    suggestion,
    unmet_starts,
)
from lagsim.errors import InputError, Problem
from lagsim.trajectory import Caution

if TYPE_CHECKING:
    from collections.abc import Sequence

    from lagsim.equations import Equations
    from lagsim.native.kernel_types import Floats

# What differs by less than this from what was stated is not reported as a change.
REPORTED = 1e-13
EXACT = 2.0**-51
# Other roots are looked for from this many starts around the guess, this far away.
OTHER_STARTS = 8
AROUND = 1.0


@dataclass(frozen=True, slots=True)
class Start:
    """The initial state, judged.

    Attributes
    ----------
    q, v : ndarray, shape (n,)
        The nearest exact state where the start is admissible, else the stated one.
    verdicts : tuple of Verdict
        The two-sided constraints, then the start values of definitions that are not
        met.
    ranks : RankReport
        Which rows depend on others, and whether they contradict them.
    augmented : bool
        M alone is singular, but with the constraints every acceleration is determined.
    reach : Reach or None
        What velocity constraints let the motion reach; None without any.
    repair : dict or None
        The initial names that would change, and to what, where the start is not
        admissible and a nearest admissible state was found.
    unsolved : str
        Why no admissible state was found, where none was.
    changes : dict
        What the exact state changes by more than rounding: name -> (stated, exact).
    """

    t: float
    q: Floats
    v: Floats
    verdicts: tuple[Verdict, ...]
    ranks: RankReport
    augmented: bool
    reach: Reach | None
    repair: dict[str, float] | None
    unsolved: str
    changes: dict[str, tuple[float, float]]
    warnings: tuple[Caution, ...]

    @property
    def admissible(self) -> bool:
        """Whether a run may begin here."""
        return not self.ranks.contradictory and all(v.satisfied for v in self.verdicts)

    @property
    def degrees_of_freedom(self) -> int:
        """Coordinates minus the rank of the two-sided rows."""
        return len(self.q) - self.ranks.rank


def examine(equations: Equations, *, classify: bool = False) -> Start:
    """Judge the initial state of a model.

    Parameters
    ----------
    classify
        Also decide which velocity constraints are integrable.

    Raises
    ------
    InputError
        Where energies or forces are not finite, or a coordinate has no inertia that no
        constraint determines (exit 2).
    """
    return _Examination(equations).start(classify=classify)


class _Examination:
    def __init__(self, equations: Equations) -> None:
        self.e = equations
        self.point = Point(equations)
        self.initial = {value.name: value for value in equations.model.initial}
        self.errors = {value.name: value.error for value in equations.model.initial}
        names = (*equations.q, *equations.velocities)
        stated = [self.initial[name].value for name in names]
        guessed = [self.initial[name].guess for name in names]
        n = self.n = len(equations.q)
        self.q0, self.v0 = np.array(stated[:n]), np.array(stated[n:])
        self.free_q = [j for j in range(n) if guessed[j]]
        self.free_v = [j for j in range(n) if guessed[n + j]]
        self.held = [row for row in equations.rows if row.holonomic]
        self.warnings: list[Caution] = []
        self.unsolved = ""

    def start(self, *, classify: bool) -> Start:
        point = self.point
        self._finite()
        self.metric = metric_of(point.mass(self.q0, self.v0), range(self.n))
        q, v = self._guessed()
        verdicts = judge(point, q, v, self.errors)
        unmet = judge_gaps(point, q, v, self.errors)
        unmet += unmet_starts(point, q, v, self.errors)
        repair = None
        stated = (q.copy(), v.copy())
        if all(verdict.satisfied for verdict in (*verdicts, *unmet)):
            self._note_digits(verdicts)
            q, v = self._exact(q, v)
        else:
            repair = self._repair()
        ranks = analyse(point, q, v, self.metric)
        augmented = needs_constraints(point, q, v)
        self._note_ranks(ranks)
        reachable = self._reach(q) if classify else None
        redundant = {d.name for d in ranks.dependences}
        verdicts = [replace(x, redundant=x.name in redundant) for x in verdicts]
        if reachable is not None:
            verdicts = [self._classified(x, q) for x in verdicts]
        return Start(
            t=point.t,
            q=q,
            v=v,
            verdicts=(*verdicts, *unmet),
            ranks=ranks,
            augmented=augmented,
            reach=reachable,
            repair=repair,
            unsolved=self.unsolved,
            changes=self._changes(stated, (q, v)),
            warnings=tuple(self.warnings),
        )

    def _warn(self, code: str, text: str) -> None:
        self.warnings.append(Caution(code, text))

    # What is asked of positions and of velocities: nodes and their values.
    def _asked(self, *, velocities: bool) -> tuple[list[int], Floats]:
        rows = self.e.rows if velocities else self.held
        nodes = [row.rate if velocities else row.residual for row in rows]
        values = [0.0] * len(nodes)
        names = frozenset(self.e.velocities)
        for wanted in self.e.model.initial:
            if wanted.node is None:
                continue
            if bool(self.e.graph.depends([wanted.node]) & names) is velocities:
                nodes.append(wanted.node)
                values.append(wanted.value)
        return nodes, np.array(values)

    def _finite(self) -> None:
        """Refuse a start at which energies, forces or constraints are not finite."""
        e = self.e
        named: list[tuple[str, int | None]] = [
            ("kinetic", e.model.kinetic),
            ("potential", e.model.potential),
            ("the energy function", e.energy),
        ]
        named += [(f"the force on {q}", f) for q, f in zip(e.q, e.f, strict=True)]
        named += [(f"constraint {row.name}", row.residual) for row in e.rows]
        named += [(f"the rate of {row.name}", row.rate) for row in e.rows]
        named += [(f"the inertia of {q}", e.M[j][j]) for j, q in enumerate(e.q)]
        found = [(name, node) for name, node in named if node is not None]
        values = self.point.array([node for _, node in found], self.q0, self.v0)
        problems = [
            Problem(
                "not-finite",
                f"{name} is {value} at the start, not finite",
                hint="check the initial values against what it divides by and the "
                "arguments of its roots and logarithms",
            )
            for (name, _), value in zip(found, values, strict=True)
            if not np.isfinite(value)
        ]
        if problems:
            raise InputError(problems)

    def _guessed(self) -> tuple[Floats, Floats]:
        """Solve the guesses: positions first, then velocities."""
        q, v = self.q0.copy(), self.v0.copy()
        for free, x, velocities in ((self.free_q, q, False), (self.free_v, v, True)):
            if not free:
                continue
            found = self._nearest(free, q, v, velocities=velocities)
            if found.met:
                found = self._closest_root(free, q, v, found, velocities=velocities)
                self._note_undetermined(free, q, v, velocities=velocities)
            x[free] = found.x
        return q, v

    def _nearest(
        self,
        free: Sequence[int],
        q: Floats,
        v: Floats,
        *,
        velocities: bool,
    ) -> Found:
        """Solve for the values `free`, from where they are."""
        nodes, targets = self._asked(velocities=velocities)
        x = (v if velocities else q)[list(free)]
        if not nodes:
            return Found(x, met=True)
        equations = self.point.equations_for(
            nodes, targets, free, q, v, velocities=velocities
        )
        metric = metric_of(self.metric, free)
        found = nearest(equations, x, metric)
        residual = equations(found.x)[0]
        self._note_trouble(found, residual, free, velocities=velocities)
        return found

    def _note_trouble(
        self,
        found: Found,
        residual: Floats,
        free: Sequence[int],
        *,
        velocities: bool,
    ) -> None:
        names = self.e.velocities if velocities else self.e.q
        where = ", ".join(
            f"{names[j]} = {x:.6g}" for j, x in zip(free, found.x, strict=True)
        )
        worst = int(np.argmax(np.abs(residual)))
        rows = self.e.rows if velocities else self.held
        name = rows[worst].name if worst < len(rows) else "a start value"
        if found.met and found.trouble is Trouble.DOUBLE_ROOT:
            self._warn(
                "double-root",
                f"Newton's method halves its way to {where}: a double root of "
                f"`{name}`, or a singular configuration; its multiplier means little",
            )
        if found.met:
            return
        least = f"the least |residual| is {abs(residual[worst]):.6g}, at {where}"
        if found.trouble is Trouble.MINIMUM:
            self.unsolved = f"`{name}` cannot be satisfied near there: {least}"
        elif found.trouble is Trouble.RANK_LOSS:
            self.unsolved = (
                f"the constraints lose their independence on the way to meeting "
                f"`{name}`: {least}"
            )
        else:
            self.unsolved = f"`{name}` has no finite value on the way, near {where}"

    def _closest_root(
        self,
        free: Sequence[int],
        q: Floats,
        v: Floats,
        found: Found,
        *,
        velocities: bool,
    ) -> Found:
        """Look for other roots around a guess; take the nearest, and say so."""
        nodes, targets = self._asked(velocities=velocities)
        x0 = (v if velocities else q)[list(free)]
        if not nodes or found.trouble is Trouble.DOUBLE_ROOT:
            return found
        equations = self.point.equations_for(
            nodes, targets, free, q, v, velocities=velocities
        )
        if np.linalg.matrix_rank(equations(found.x)[1]) < len(free):
            return found  # a family of roots: the nearest of them has been found
        random = np.random.default_rng(3)  # the same starts each time
        size = np.maximum(np.abs(found.x), np.max(np.abs(found.x), initial=0.0))
        size[size == 0] = 1.0
        metric = metric_of(self.metric, free)
        roots = [found.x]
        for _ in range(OTHER_STARTS):
            start = x0 + AROUND * size * random.standard_normal(len(free))
            other = reach(equations, start, metric)
            apart = [np.max(np.abs(other.x - r) / size) > 1e-6 for r in roots]
            if other.met and all(apart):
                roots.append(other.x)
        if len(roots) == 1:
            return found
        roots.sort(key=lambda r: float((r - x0) @ metric @ (r - x0)))
        names = [(self.e.velocities if velocities else self.e.q)[j] for j in free]
        listed = "; ".join(
            ", ".join(f"{n} = {x:.6g}" for n, x in zip(names, root, strict=True))
            for root in roots[1:3]
        )
        self._warn(
            "other-roots",
            f"the guesses have other solutions too, such as {listed}; the nearest to "
            "the guess is taken",
        )
        return Found(roots[0], met=True)

    def _note_undetermined(
        self, free: Sequence[int], q: Floats, v: Floats, *, velocities: bool
    ) -> None:
        nodes, targets = self._asked(velocities=velocities)
        names = [(self.e.velocities if velocities else self.e.q)[j] for j in free]
        loose = list(names)
        if nodes:
            equations = self.point.equations_for(
                nodes, targets, free, q, v, velocities=velocities
            )
            slopes = equations((v if velocities else q)[list(free)])[1]
            loose = [n for n, s in zip(names, slopes.T, strict=True) if not np.any(s)]
        for name in loose:
            self._warn(
                "undetermined-guess",
                f"nothing determines the guess `{name}`: it stays as given",
            )

    def _exact(self, q: Floats, v: Floats) -> tuple[Floats, Floats]:
        """Give the nearest exact state; one that is exact to rounding stays."""
        everything = range(self.n)
        for velocities in (False, True):
            x = v if velocities else q
            rows = self.e.rows if velocities else self.held
            if not rows:
                continue
            nodes = [row.rate if velocities else row.residual for row in rows]
            equations = self.point.equations_for(
                nodes, np.zeros(len(nodes)), everything, q, v, velocities=velocities
            )
            r, J = equations(x)
            if relative(r, J, x) > EXACT:
                found = nearest(equations, x, self.metric)
                if found.met:
                    x[:] = found.x
        return q, v

    def _repair(self) -> dict[str, float] | None:
        """Give the nearest admissible state over all values, as initial names."""
        everything = range(self.n)
        q, v = self.q0.copy(), self.v0.copy()
        for x, velocities in ((q, False), (v, True)):
            found = self._nearest(everything, q, v, velocities=velocities)
            if not found.met:
                return None
            x[:] = found.x
        changed = self._changes((self.q0, self.v0), (q, v))
        return {name: new for name, (_, new) in changed.items()}

    def _changes(
        self, old: tuple[Floats, Floats], new: tuple[Floats, Floats]
    ) -> dict[str, tuple[float, float]]:
        names = (*self.e.q, *self.e.velocities)
        before, after = np.concatenate(old), np.concatenate(new)
        size = np.repeat([np.max(np.abs(x), initial=0.0) for x in new], self.n)
        moved = np.abs(after - before) > REPORTED * np.maximum(np.abs(after), size)
        return {
            name: (float(before[i]), float(after[i]))
            for i, name in enumerate(names)
            if moved[i]
        }

    def _note_digits(self, verdicts: Sequence[Verdict]) -> None:
        """Say of relations that are met only roughly how the start could be exact."""
        by_name = {c.name: c for c in self.e.model.constraints}
        for verdict in verdicts:
            residual = verdict.position
            digits = residual.digits
            if digits is None:
                continue
            line = suggestion(by_name[verdict.name], self.e.q)
            advice = f"write {line}" if line else "mark a value as {guess: ...}"
            self._warn(
                "rough-start",
                f"`{verdict.name}` is off by {abs(residual.value):.1g}, as if the "
                f"start had been typed with {digits} digits; {advice}",
            )

    def _note_ranks(self, ranks: RankReport) -> None:
        for d in ranks.dependences:
            if not d.combination:
                self._warn(
                    "vanishing-gradient",
                    f"the gradient of `{d.name}` vanishes at the start: it constrains "
                    "nothing here, and its multiplier is not unique",
                )
                continue
            where = "everywhere: one relation too many"
            if d.everywhere is False:
                where = "only here: a singular configuration, where motions branch"
            elif d.everywhere is None:
                where = "here"
            self._warn("redundant", f"{d}, {where}")
        if ranks.not_unique and not ranks.contradictory:
            unique = [r.name for r in self.e.rows if r.name not in ranks.not_unique]
            rest = f"; unique are those of {', '.join(unique)}" if unique else ""
            self._warn(
                "multipliers-not-unique",
                f"the multipliers of {', '.join(ranks.not_unique)} are not unique (the "
                f"least are given){rest}; the constraint forces Qc are",
            )

    def _reach(self, q: Floats) -> Reach | None:
        rows = self.e.rows
        if all(row.holonomic for row in rows):
            return None
        return reach_of(self.point, rows, q)

    def _classified(self, verdict: Verdict, q: Floats) -> Verdict:
        """Decide whether a Pfaffian relation alone is integrable."""
        if not verdict.pfaffian:
            return verdict
        row = next(r for r in self.e.rows if r.name == verdict.name)
        alone = reach_of(self.point, [row], q)
        if alone.hidden is None:
            return replace(verdict, undecided=alone.reason)
        return replace(verdict, integrable=alone.hidden == 1)


def metric_of(M: Floats, free: Sequence[int]) -> Floats:
    """Give the metric of least change on the values `free`: M, or Euclid's.

    Euclid's where M is not positive definite on them.
    """
    part = M[np.ix_(list(free), list(free))]
    size = np.sqrt(np.abs(np.diag(part)))
    usable = bool(np.all(size > 0)) and bool(np.all(np.isfinite(part)))
    if usable and np.linalg.eigvalsh(part / np.outer(size, size))[0] > RANK:
        return part
    return np.eye(len(free))
