"""The initial state: guesses solved, residuals judged, the nearest state found.

A relation, or its rate, is satisfied when its residual is at most TOLERANCE of the
largest of its terms and of |q_i dg/dq_i|, or within the rounding error of the
expressions that gave the start.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from lagsim.admissibility.newton import RANK, Found, nearest, null_space, relative
from lagsim.admissibility.point import Point
from lagsim.errors import InputError, Problem
from lagsim.expressions.derivatives import gradient

if TYPE_CHECKING:
    from collections.abc import Sequence

    from lagsim.equations import Equations
    from lagsim.native.kernel_types import Floats
    from lagsim.trajectory import Caution

TOLERANCE = 1e-6
# The bound of rounding errors is to first order; this keeps it a bound.
CAUTION = 4.0
# What differs by less than this from what was stated is not reported as a change.
REPORTED = 1e-13
EXACT = 2.0**-51
CONTRADICTION = 1e-8


@dataclass(frozen=True, slots=True)
class Verdict:
    """One relation at the start.

    `bound` and `velocity_bound` are what the residuals may be; `velocity_residual` is
    None for a relation between velocities, whose residual is the velocities' own.
    """

    name: str
    kind: str
    scleronomic: bool
    pfaffian: bool | None
    residual: float
    bound: float
    velocity_residual: float | None
    velocity_bound: float
    redundant: bool

    @property
    def satisfied(self) -> bool:
        """Whether position and velocity meet the relation."""
        held = abs(self.residual) <= self.bound
        if self.velocity_residual is None:
            return held
        return held and abs(self.velocity_residual) <= self.velocity_bound


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
    contradiction : float
        The relative residual of A q'' = b at its best; 0 where it is solvable.
    conditioning : float
        The smallest singular value of the equilibrated constraint rows (1 if none).
    augmented : bool
        M alone is singular, but with the constraints every acceleration is determined.
    repair : dict or None
        The initial names that would change, and to what, where the start is not
        admissible and a nearest admissible state was found.
    changes : dict
        What the exact state changes by more than rounding: name -> (stated, exact).
    """

    t: float
    q: Floats
    v: Floats
    verdicts: tuple[Verdict, ...]
    contradiction: float
    degrees_of_freedom: int
    rank: int
    conditioning: float
    augmented: bool
    repair: dict[str, float] | None
    changes: dict[str, tuple[float, float]]
    warnings: tuple[Caution, ...]

    @property
    def admissible(self) -> bool:
        """Whether a run may begin here."""
        return self.contradiction == 0.0 and all(v.satisfied for v in self.verdicts)


def examine(equations: Equations) -> Start:
    """Judge the initial state of a model.

    Raises
    ------
    InputError
        Where energies or forces are not finite, or a coordinate has no inertia that no
        constraint determines (exit 2).
    """
    return _Examination(equations).start()


class _Examination:
    def __init__(self, equations: Equations) -> None:
        self.e = equations
        self.point = Point(equations)
        self.initial = {value.name: value for value in equations.model.initial}
        stated = [
            self.initial[name].value for name in (*equations.q, *equations.velocities)
        ]
        n = self.n = len(equations.q)
        self.q0, self.v0 = np.array(stated[:n]), np.array(stated[n:])
        self.free_q = [j for j, q in enumerate(equations.q) if self.initial[q].guess]
        self.free_v = [
            j for j, v in enumerate(equations.velocities) if self.initial[v].guess
        ]
        self.holonomic = [row for row in equations.rows if row.holonomic]
        self.warnings: list[Caution] = []

    def start(self) -> Start:
        point = self.point
        self._finite()
        M = point.mass(self.q0, self.v0)
        q, v = self._guessed(M)
        rows = self._equilibrated(q, v)
        verdicts = self._verdicts(q, v, _redundant(rows))
        sizes = np.linalg.svd(rows, compute_uv=False) if len(rows) else np.ones(1)
        rank = int(np.sum(sizes > RANK)) if len(rows) else 0
        admissible = all(verdict.satisfied for verdict in verdicts)
        repair = None
        stated = (q, v)
        if admissible:
            q, v = self._exact(q, v, M)
        else:
            repair = self._repair(M)
        augmented = self._check_inertia(q, v)
        contradiction = self._contradiction(q, v) if admissible else 0.0
        return Start(
            t=point.t,
            q=q,
            v=v,
            verdicts=tuple(verdicts),
            contradiction=contradiction,
            degrees_of_freedom=self.n - rank,
            rank=rank,
            conditioning=float(sizes[rank - 1]) if rank else 1.0,
            augmented=augmented,
            repair=repair,
            changes=self._changes(stated, (q, v)),
            warnings=tuple(self.warnings),
        )

    # What is asked of positions and of velocities: nodes and their values.
    def _position_equations(self) -> tuple[list[int], Floats]:
        return self._asked([r.residual for r in self.holonomic], velocities=False)

    def _velocity_equations(self) -> tuple[list[int], Floats]:
        return self._asked([r.rate for r in self.e.rows], velocities=True)

    def _asked(self, nodes: list[int], *, velocities: bool) -> tuple[list[int], Floats]:
        """Add the start values of definitions on this level to the constraints."""
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
        model = e.model
        named = [("kinetic", model.kinetic), ("potential", model.potential)]
        named += [("the energy function", e.energy)]
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

    def _guessed(self, M: Floats) -> tuple[Floats, Floats]:
        """Solve the guesses: positions first, then velocities."""
        q, v = self.q0.copy(), self.v0.copy()
        if self.free_q:
            found = self._nearest(self.free_q, q, v, M, velocities=False)
            q[self.free_q] = found.x
        if self.free_v:
            found = self._nearest(self.free_v, q, v, M, velocities=True)
            v[self.free_v] = found.x
        return q, v

    def _nearest(
        self, free: Sequence[int], q: Floats, v: Floats, M: Floats, *, velocities: bool
    ) -> Found:
        nodes, targets = (
            self._velocity_equations() if velocities else self._position_equations()
        )
        equations = self.point.equations_for(
            nodes, targets, free, q, v, velocities=velocities
        )
        x = (v if velocities else q)[list(free)]
        if not nodes:
            return Found(x, met=True)
        return nearest(equations, x, metric_of(M, free))

    def _equilibrated(self, q: Floats, v: Floats) -> Floats:
        """Give the constraint rows in the metric of M, scaled to length 1."""
        A = self.point.jacobian(self.e.rows, q, v)
        if not np.all(np.isfinite(A)):
            return np.zeros_like(A)
        L = np.linalg.cholesky(metric_of(self.point.mass(q, v), range(self.n)))
        Y = np.linalg.solve(L, A.T).T
        lengths = np.linalg.norm(Y, axis=1)
        lengths[lengths == 0] = 1.0
        return np.asarray(Y / lengths[:, None])

    def _verdicts(
        self, q: Floats, v: Floats, redundant: Sequence[bool]
    ) -> list[Verdict]:
        point, rows = self.point, self.e.rows
        errors = {value.name: value.error for value in self.initial.values()}
        residuals = [row.residual for row in rows]
        rates = [row.rate for row in rows]
        g = point.array(residuals, q, v)
        bounds = self._bounds(residuals, [r.residual_scale for r in rows], q, v, errors)
        rate = point.array(rates, q, v)
        rate_bounds = self._bounds(rates, [r.rate_scale for r in rows], q, v, errors)
        verdicts = [
            Verdict(
                name=row.name,
                kind="holonomic" if row.holonomic else "nonholonomic",
                scleronomic=row.scleronomic,
                pfaffian=None if row.holonomic else row.pfaffian,
                residual=float(g[i]),
                bound=float(bounds[i]),
                velocity_residual=float(rate[i]) if row.holonomic else None,
                velocity_bound=float(rate_bounds[i]),
                redundant=redundant[i],
            )
            for i, row in enumerate(rows)
        ]
        return verdicts + self._unmet(q, v, errors)

    def _bounds(
        self,
        nodes: Sequence[int],
        scales: Sequence[int],
        q: Floats,
        v: Floats,
        errors: dict[str, float],
    ) -> Floats:
        scale = self.point.array(scales, q, v)
        rounding = self.point.rounding(nodes, q, v, errors)
        return np.maximum(TOLERANCE * scale, CAUTION * rounding)

    def _unmet(self, q: Floats, v: Floats, errors: dict[str, float]) -> list[Verdict]:
        """Judge the start values of definitions; give those that are not met."""
        unmet = []
        for wanted in self.e.model.initial:
            if wanted.node is None:
                continue
            value = self.point.array([wanted.node], q, v)[0]
            rounding = self.point.rounding([wanted.node], q, v, errors)[0]
            slopes = self.point.array(self._slopes(wanted.node), q, v)
            levers = np.abs(slopes) * np.abs(np.concatenate([q, v]))
            scale = max(abs(value), abs(wanted.value), np.max(levers, initial=0.0))
            bound = max(TOLERANCE * scale, CAUTION * (rounding + wanted.error))
            if not abs(value - wanted.value) <= bound:
                unmet.append(
                    Verdict(
                        name=f"{wanted.name}: {wanted.text}",
                        kind="start value",
                        scleronomic=True,
                        pfaffian=None,
                        residual=float(value - wanted.value),
                        bound=float(bound),
                        velocity_residual=None,
                        velocity_bound=0.0,
                        redundant=False,
                    )
                )
        return unmet

    def _slopes(self, node: int) -> list[int]:
        g = self.e.graph
        names = (*self.e.q, *self.e.velocities)
        return gradient(g, node, [g.variable(name) for name in names])

    def _exact(self, q: Floats, v: Floats, M: Floats) -> tuple[Floats, Floats]:
        """Give the nearest exact state; one that is exact to rounding stays."""
        everything = range(self.n)
        for velocities in (False, True):
            x = v if velocities else q
            nodes = (
                [row.rate for row in self.e.rows]
                if velocities
                else [row.residual for row in self.holonomic]
            )
            if not nodes:
                continue
            equations = self.point.equations_for(
                nodes, np.zeros(len(nodes)), everything, q, v, velocities=velocities
            )
            r, J = equations(x)
            if relative(r, J, x) > EXACT:
                found = nearest(equations, x, metric_of(M, everything))
                if found.met:
                    x[:] = found.x
        return q, v

    def _repair(self, M: Floats) -> dict[str, float] | None:
        """Give the nearest admissible state over all values, as initial names."""
        everything = range(self.n)
        q, v = self.q0.copy(), self.v0.copy()
        found = self._nearest(everything, q, v, M, velocities=False)
        if not found.met:
            return None
        q = found.x
        found = self._nearest(everything, q, v, M, velocities=True)
        if not found.met:
            return None
        changed = self._changes((self.q0, self.v0), (q, found.x))
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

    def _check_inertia(self, q: Floats, v: Floats) -> bool:
        """Refuse directions without inertia; tell whether M needs the constraints."""
        M = self.point.mass(q, v)
        size = np.sqrt(np.abs(np.diag(M)))
        size[size == 0] = np.max(size, initial=0.0) or 1.0
        scaled = M / np.outer(size, size)
        if np.linalg.eigvalsh(scaled)[0] > RANK:
            return False
        kernel = null_space(self.point.jacobian(self.e.rows, q, v) / size)
        if not kernel.shape[1]:
            return True
        inertia, directions = np.linalg.eigh(kernel.T @ scaled @ kernel)
        if inertia[0] > RANK:
            return True
        direction = (kernel @ directions[:, 0]) / size
        raise InputError([self._no_inertia(direction, negative=inertia[0] < -RANK)])

    def _no_inertia(self, direction: Floats, *, negative: bool) -> Problem:
        direction = direction / direction[np.argmax(np.abs(direction))]
        parts = [
            name if abs(c - 1) < 1e-6 else f"{c:.4g} {name}"
            for name, c in zip(self.e.q, direction, strict=True)
            if abs(c) > 1e-6
        ]
        along = " + ".join(parts).replace("+ -", "- ")
        what = "coordinate" if len(parts) == 1 else "combination of coordinates"
        if negative:
            return Problem(
                "negative-inertia",
                f"the kinetic energy falls with the speed of the {what} {along} at the "
                "start: the mass matrix is indefinite",
                hint="look for a negative mass or a wrong sign in `kinetic`",
            )
        return Problem(
            "no-inertia",
            f"the {what} {along} has no inertia at the start, and no constraint "
            "determines its acceleration",
            hint="give it a mass in `kinetic`, a constraint, or make it a definition",
        )

    def _contradiction(self, q: Floats, v: Floats) -> float:
        """Give how far A q'' = b is from solvable, relative to b; 0 where it is."""
        rows = self.e.rows
        if not rows:
            return 0.0
        A = self.point.jacobian(rows, q, v)
        b = self.point.array([row.b for row in rows], q, v)
        lengths = np.linalg.norm(A, axis=1)
        lengths[lengths == 0] = 1.0
        A, b = A / lengths[:, None], b / lengths
        left = b - A @ np.linalg.lstsq(A, b, rcond=RANK)[0]
        size = np.max(np.abs(b), initial=0.0)
        worst = float(np.max(np.abs(left), initial=0.0))
        return worst / size if size and worst > CONTRADICTION * size else 0.0


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


def _redundant(rows: Floats) -> list[bool]:
    """Tell of each row whether the earlier ones already span it."""
    basis: list[Floats] = []
    flags = []
    for row in rows:
        left = row.copy()
        for _ in range(2):  # twice is enough (Kahan)
            for b in basis:
                left -= (b @ left) * b
        length = np.linalg.norm(left)
        flags.append(bool(length <= RANK))
        if not flags[-1]:
            basis.append(left / length)
    return flags
