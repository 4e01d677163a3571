"""Nearest point of a continuum of rests that sticking friction holds.

Where friction or a limit sticks, positions of rest fill a region, bounded by the limits
of the multipliers. Its point nearest to the start minimises the squared changes of the
coordinates, relative to their sizes, under the equations of rest and these limits; the
unknowns are positions, first-order states and multipliers.

Source: D. Kraft, A software package for sequential quadratic programming, DFVLR-FB
88-28 (1988): the method SLSQP of scipy.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from lagsim.admissibility.balance import Rest
from lagsim.admissibility.point import Point
from lagsim.admissibility.rest import acting_rows
from lagsim.admissibility.verdict import judge_laws
from lagsim.tolerances import COMPUTED_ZERO

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from lagsim.language.arrays import Floats
    from lagsim.mechanics.equations import Equations, Instant

# Iterations of the minimisation, and of the projection onto active limits.
ITERATIONS, PROJECTIONS = 200, 8
# Distance from a limit, as a part of the squared forces, at which it is active; the
# step of central differences of limits, which are squares.
ACTIVE, STEP = 1e-5, 1e-4


class Continuum:
    """Rests with given rows in force, as points of a region.

    Parameters
    ----------
    equations : Equations
        The equations, with the laws of the model.
    state : Instant
        A rest of the region.
    multipliers : mapping of str to float
        The multiplier of each row that holds at that rest, by the name of the row.
    goal, sizes : ndarray, shape (n,)
        The coordinates of the start, and the sizes to which changes are relative.
    unknowns : tuple of sequence of int
        The positions and the first-order states that may change.

    Attributes
    ----------
    active : list of Row
        The rows in force, of laws.
    """

    def __init__(
        self,
        equations: Equations,
        state: Instant,
        multipliers: Mapping[str, float],
        goal: Floats,
        sizes: Floats,
        unknowns: tuple[Sequence[int], Sequence[int]],
    ) -> None:
        laws, at = equations.laws, Point(equations, state)
        rows = acting_rows(at)
        chosen = [k for k in rows if laws[k].row.name in multipliers]
        self._laws = [laws[k] for k in chosen]
        self._all = laws
        self.active = [rows[k] for k in chosen]
        self._rest = rest = Rest(at, (), self.active, unknowns)
        free, states = (list(x) for x in unknowns)
        lam = np.array([multipliers[row.name] for row in rest.rows])
        self._first = len(lam) - len(self.active)
        self._forces = self._scales(at, lam)
        self._sizes = np.concatenate([
            sizes[free], np.maximum(1.0, np.abs(at.state.s[states])),
            self._forces,
        ])  # fmt: skip
        self._start = np.concatenate([at.q[free], at.state.s[states], lam])
        self._start /= self._sizes
        self._goal, self._count = goal[free] / sizes[free], len(free)
        lengths = np.linalg.norm(self._slopes(self._start), axis=1)
        self._rows = np.flatnonzero(lengths)
        self._weights = 1.0 / lengths[self._rows]

    def _slopes(self, z: Floats) -> Floats:
        """Return the derivatives (m, k) of `_equations` by the unknowns z (k,)."""
        return np.asarray(self._rest.evaluated(z * self._sizes)[1] * self._sizes)

    def _equations(self, z: Floats) -> Floats:
        """Return the scaled residuals (m,) of the equations of rest at z (k,)."""
        r = self._rest.evaluated(z * self._sizes)[0]
        return np.asarray(r[self._rows] * self._weights)

    def _scales(self, at: Point, lam: Floats) -> Floats:
        """Return the scale of each multiplier (m,): the larger of |value| and limit.

        Where both are 0, the largest of all scales is used.

        at : a state of rest.
        lam : (m,), the multipliers of all rows there.
        """
        known = dict(
            zip([row.name for row in self.active], lam[self._first :], strict=True)
        )
        most = [limit for limit, _ in self._pushes(at, known)]
        scales = np.abs(lam)
        scales[self._first :] = np.maximum(scales[self._first :], np.abs(most))
        scales[scales == 0.0] = np.max(scales, initial=0.0) or 1.0
        return scales

    def _pushes(
        self, point: Point, known: Mapping[str, float]
    ) -> Iterator[tuple[float, float]]:
        """Generate, for each law in force, its limit and the size of its multiplier.

        The size is |multiplier|; for one of two laws that share a limit it is the norm
        of both multipliers. The limit is 0 for a multiplier without a limit.

        known : multipliers by the names of the rows.
        """
        bounds = point.array([law.static or law.bound for law in self._laws])
        for law, bound in zip(self._laws, bounds.tolist(), strict=True):
            push, limit = known[law.row.name], 0.0
            if law.bounded:
                limit = bound
                if law.slips:
                    limit *= known.get(self._all[law.normal].row.name, 0.0)
                if law.pair >= 0:
                    push = math.hypot(
                        push, known.get(self._all[law.pair].row.name, 0.0)
                    )
            yield limit, push

    def _limits(self, z: Floats) -> Floats:
        """Return the inequality constraints of the region, which are >= 0 inside.

        These are the distances of the multipliers of laws from their limits and from 0.

        z : scaled unknowns (k,).
        """
        x = z * self._sizes
        own, scales = x[len(x) - len(self.active) :], self._forces[self._first :]
        known = dict(zip([row.name for row in self.active], own.tolist(), strict=True))
        found = []
        pushes = self._pushes(self._rest.at(x), known)
        for law, size, (limit, push) in zip(self._laws, scales, pushes, strict=True):
            if law.one_sided:
                found.append(push / size)
            if law.bounded and not 0 <= law.pair < self._all.index(law):
                # The first limit of a pair represents both.
                found.append((limit * abs(limit) - push**2) / size**2)
        return np.array(found)

    def _limit_slopes(self, z: Floats) -> Floats:
        steps = STEP * np.eye(len(z))
        sides = [self._limits(z + h) - self._limits(z - h) for h in steps]
        return np.array(sides).T / (2.0 * STEP)

    def _far(self, z: Floats) -> float:
        away = z[: self._count] - self._goal
        return float(away @ away)

    def nearest(self) -> Instant | None:
        """Return the rest of the region nearest to the start; None if none is found."""
        from scipy.optimize import minimize

        z = self._start
        with np.errstate(all="ignore"):
            try:
                end = minimize(
                    self._far, z, method="SLSQP",
                    jac=lambda z: np.pad(
                        2.0 * (z[: self._count] - self._goal),
                        (0, len(z) - self._count),
                    ),
                    constraints=[
                        {"type": "eq", "fun": self._equations, "jac": self._eq_slopes},
                        {
                            "type": "ineq",
                            "fun": self._limits,
                            "jac": self._limit_slopes,
                        },
                    ],
                    options={"maxiter": ITERATIONS, "ftol": COMPUTED_ZERO**2},
                )  # fmt: skip
                found = self._projected(end.x)
            except (ValueError, np.linalg.LinAlgError):
                return None
        if found is None or (self._is_inside(z) and self._far(found) >= self._far(z)):
            return None
        x = found * self._sizes
        there = self._rest.at(x).at(errors=self._rest.errors(x))
        satisfied = all(v.satisfied for v in judge_laws(there, ()))
        return there.state if satisfied else None

    def _eq_slopes(self, z: Floats) -> Floats:
        return np.asarray(self._slopes(z)[self._rows] * self._weights[:, None])

    def _projected(self, z: Floats) -> Floats | None:
        """Return the unknowns nearest to z at which equations and active limits hold.

        Both hold to rounding; None if they cannot be solved.

        z : (k,), scaled unknowns.
        """
        active = np.flatnonzero(np.abs(self._limits(z)) <= ACTIVE)
        for _ in range(PROJECTIONS):
            r = np.concatenate([self._equations(z), self._limits(z)[active]])
            J = np.vstack([self._eq_slopes(z), self._limit_slopes(z)[active]])
            if not (np.all(np.isfinite(r)) and np.all(np.isfinite(J))):
                return None
            z = z - np.linalg.lstsq(J, r, rcond=COMPUTED_ZERO)[0]
        return z if self._is_inside(z) else None

    def _is_inside(self, z: Floats) -> bool:
        """Whether unknowns z (k,) satisfy the equations of rest and the limits."""
        left = np.max(np.abs(self._equations(z)), initial=0.0)
        kept = np.all(self._limits(z) >= -COMPUTED_ZERO)
        return bool(left <= COMPUTED_ZERO and kept)
