"""The equations in numbers at a state, from the graph in plain Python.

One state is all that is asked, so nothing is compiled. From LARGE coordinates on
matrices are sparse: what is decided then is decided as for small scenes, as long as M
is safely positive and the rows are safely independent; where they are not, dense
matrices are used, which take time proportional to the cube of the number of
coordinates.
"""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from lagsim.admissibility.algebra import (
    Entries,
    factored,
    is_diagonal,
    largest_eigenvalue,
    sizes_of,
)
from lagsim.language.evaluate import evaluate, evaluate_with_error
from lagsim.mechanics.equations import Instant
from lagsim.tolerances import SAFELY_INDEPENDENT, STATE_ROUNDOFF, UNIT_ROUNDOFF

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from lagsim.language.arrays import Floats
    from lagsim.mechanics.chains import Chains
    from lagsim.mechanics.constraints import Row
    from lagsim.mechanics.equations import Equations


# Of a value that was found as a double root.
HALF = 2.0**-26


class Point:
    """The equations in numbers at a state (t, q, v).

    Parameters
    ----------
    errors
        Bounds of the rounding errors of values, by name. Without one a parameter that
        is no whole number has been rounded, and all else is exact.
    """

    # Coordinates from which on a dense decomposition takes longer than loading scipy.
    LARGE = 200

    def __init__(
        self,
        equations: Equations,
        state: Instant,
        errors: Mapping[str, float] | None = None,
    ) -> None:
        self.e, self.g, self.n = equations, equations.graph, len(equations.q)
        self.state, self.errors = state, errors or {}
        self.t, self.q, self.v = state.t, state.q, state.v
        self._sizes: list[Floats] = []

    def at(
        self,
        q: Floats | None = None,
        v: Floats | None = None,
        errors: Mapping[str, float] | None = None,
        *,
        t: float | None = None,
    ) -> Point:
        """Give the equations at another state, or with other errors, sizes kept."""
        state = Instant(
            self.t if t is None else t,
            self.q if q is None else q,
            self.v if v is None else v,
        )
        other = Point(self.e, state, self.errors if errors is None else errors)
        other._sizes = self._sizes
        return other

    @property
    def is_large(self) -> bool:
        """Whether matrices are sparse."""
        return self.n >= self.LARGE

    @cached_property
    def values(self) -> dict[str, float]:
        """The value of every variable."""
        values = {p.name: p.value for p in self.e.model.parameters} | {"t": self.t}
        values |= zip(self.e.q, map(float, self.q), strict=True)
        return values | dict(zip(self.e.velocities, map(float, self.v), strict=True))

    def array(self, nodes: Sequence[int]) -> Floats:
        """Give the values of `nodes`."""
        return np.array(evaluate(self.g, nodes, self.values), dtype=float)

    @cached_property
    def _inexact(self) -> dict[str, tuple[float, float]]:
        """The value and the error of every variable."""
        errors = {
            p.name: UNIT_ROUNDOFF * abs(p.value)
            for p in self.e.model.parameters
            if not p.value.is_integer()
        }
        errors |= self.errors
        return {name: (x, errors.get(name, 0.0)) for name, x in self.values.items()}

    def rounding(self, nodes: Sequence[int]) -> Floats:
        """Give bounds of the rounding errors of `nodes`, from those of the values."""
        found = evaluate_with_error(self.g, nodes, self._inexact)
        return np.array([error for _, error in found])

    def solved_errors(
        self, origin: tuple[Floats, Floats] | None = None
    ) -> dict[str, float]:
        """Give the errors of values that were solved for.

        Their own rounding; that of the way that all went together from `origin`; and
        what the rounding of the relations in which they stand makes of them: one that
        should be zero is left with that of its neighbours.
        """
        rows, weights, state = self.e.rows, self.sizes, (self.q, self.v)
        names = (*self.e.q, *self.e.velocities)
        own = [STATE_ROUNDOFF * np.abs(x) for x in state]
        for k, (x, x0) in enumerate(zip(state, origin or state, strict=True)):
            own[k] += STATE_ROUNDOFF * np.linalg.norm(weights * (x - x0)) / weights
        errors = dict(zip(names, np.concatenate(own).tolist(), strict=True))
        if not rows:
            return errors
        near = self.at(errors=errors)
        held = [r.residual if r.holonomic else self.g.zero for r in rows]
        entries = self.jacobian_entries(rows)
        columns = np.nan_to_num(np.abs(entries.values)) / weights[entries.j]
        squares = np.bincount(entries.i, columns**2, len(rows))
        for k, nodes in enumerate((held, [r.rate for r in rows])):
            rounding = np.nan_to_num(near.rounding(nodes))
            step = rounding / np.where(squares > 0.0, squares, np.inf)
            shares = columns * step[entries.i] / weights[entries.j]
            # At a double root half of the digits are known, whatever the slopes say.
            known = HALF * (np.abs(state[k]) + own[k] / STATE_ROUNDOFF)
            own[k] += np.minimum(np.bincount(entries.j, shares, self.n), known)
        return dict(zip(names, np.concatenate(own).tolist(), strict=True))

    @property
    def sizes(self) -> Floats:
        """sqrt(M_jj) (n,), or what stands in its place, where it was first asked."""
        if not self._sizes:
            roots = np.sqrt(np.abs(self.array(self.e.inertias)))
            if not roots.all():
                roots = sizes_of(roots, np.nan_to_num(self.gradients))
            self._sizes.append(roots)
        return self._sizes[0]

    # --- M and A

    @cached_property
    def mass_matrix(self) -> Floats:
        """The mass matrix M (n, n)."""
        if self.e.chains is not None:
            return self._chained_mass(self.e.chains)
        return self._entries([x.entries for x in self.e.M]).dense(self.n, self.n)

    @cached_property
    def gradients(self) -> Floats:
        """The constraint Jacobian A (m, n)."""
        return self.jacobian(self.e.rows)

    def mass(self, among: Sequence[int]) -> Floats:
        """Give the rows and columns `among` of M."""
        return self.mass_entries(among).dense(len(among), len(among))

    def _chained_mass(self, chains: Chains) -> Floats:
        """Give M (n, n) without an expression for each entry."""
        values = dict(zip(chains.nodes, self.array(chains.nodes), strict=True))
        along = np.eye(self.n + len(chains.sums), self.n)
        for k, form in enumerate(chains.sums, self.n):
            for i, node in form.items():
                along[k] += values[node] * along[i]
        pushed = np.zeros_like(along)
        for (i, j), node in chains.squares.items():
            for a, b in {(i, j), (j, i)}:
                pushed[a] += values[node] * along[b]
        return np.asarray(along.T @ pushed)

    def mass_entries(self, among: Sequence[int] | None = None) -> Entries:
        """Give the entries of M, or of rows and columns `among`, that are not zero."""
        chosen = range(self.n) if among is None else among
        if self.e.chains is not None:
            M = self.mass_matrix[np.ix_(chosen, chosen)]
            i, j = np.nonzero(M)
            return Entries(i, j, M[i, j])
        place = {j: k for k, j in enumerate(chosen)}
        rows = (self.e.M[j].entries for j in chosen)
        return self._entries(
            [{place[j]: x for j, x in row.items() if j in place} for row in rows]
        )

    def jacobian(self, rows: Sequence[Row], *, rounded: bool = False) -> Floats:
        """Give A (m, n) of `rows`; with `rounded` what is only rounding is zero."""
        found = self.jacobian_entries(rows, rounded=rounded)
        return found.dense(len(rows), self.n)

    def jacobian_entries(
        self, rows: Sequence[Row], *, rounded: bool = False
    ) -> Entries:
        """Give the entries of A that do not vanish identically."""
        return self._entries([row.A.entries for row in rows], rounded=rounded)

    def _entries(
        self, rows: Sequence[Mapping[int, int]], *, rounded: bool = False
    ) -> Entries:
        nodes = [node for row in rows for node in row.values()]
        values = self.array(nodes)
        if rounded:
            values[np.abs(values) <= self.rounding(nodes)] = 0.0
        i = np.repeat(np.arange(len(rows)), [len(row) for row in rows])
        j = np.array([j for row in rows for j in row], dtype=int)
        return Entries(i, j, values)

    @cached_property
    def is_safely_positive(self) -> bool:
        """Whether M is safely positive definite; False where it is not safe to tell."""
        if self.e.chains is not None:
            return self._is_positive_along(self.e.chains)
        M = self.mass_entries().sparse(self.n, self.n)
        diagonal = M.diagonal()
        if not (np.all(np.isfinite(M.data)) and np.all(diagonal > 0)):
            return False
        if is_diagonal(M):
            return True
        from scipy.sparse import diags

        scale = diags(1.0 / np.sqrt(diagonal))
        factors = factored(scale @ M @ scale, symmetric=True)
        if factors is None or not np.all(factors.U.diagonal() > 0):
            return False
        if not np.array_equal(factors.perm_r, factors.perm_c):
            return False  # pivots off the diagonal say nothing
        return 1.0 / largest_eigenvalue(factors.solve, self.n)[0] > SAFELY_INDEPENDENT

    def _is_positive_along(self, chains: Chains) -> bool:
        """Tell it by the pivots of M, against its diagonal."""
        from lagsim.language.sparse import Meter
        from lagsim.mechanics.chains import Articulated

        pivots = Articulated(self.g, chains, Meter()).pivots
        own = self.array([pivots[k][0] for k in range(self.n)])
        diagonal = self.array(self.e.inertias)
        if not (np.all(np.isfinite(own)) and np.all(diagonal > 0)):
            return False
        return bool(np.min(own / diagonal) > SAFELY_INDEPENDENT)
