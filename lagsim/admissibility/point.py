"""The equations in numbers at a state, from the graph in plain Python.

One state is all that is asked, so nothing is compiled.
"""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from lagsim.admissibility.newton import MET, SOLVED, Relations, sizes_of
from lagsim.language.derivatives import slopes, tangent
from lagsim.language.evaluate import evaluate, evaluate_with_error
from lagsim.tolerances import UNIT_ROUNDOFF

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from lagsim.language.arrays import Floats
    from lagsim.mechanics.chains import Chains
    from lagsim.mechanics.constraints import Row
    from lagsim.mechanics.equations import Equations


# Of a value that was found as a double root.
HALF = 2.0**-26
# A step of m dense equations for k values takes m * k * min(m, k) / STEP operations.
STEP = 350.0


class Point:
    """The equations in numbers, at a time."""

    def __init__(self, equations: Equations, time: float = 0.0) -> None:
        self.e = equations
        self.g = equations.graph
        self.n = len(equations.q)
        self.t = time
        self._fixed = {p.name: p.value for p in equations.model.parameters}
        self._fixed["t"] = self.t
        # As of constants: what is not a whole number has been rounded.
        self._rounded = {
            p.name: UNIT_ROUNDOFF * abs(p.value)
            for p in equations.model.parameters
            if not p.value.is_integer()
        }
        self._sizes: Floats | None = None

    def move_to(self, time: float) -> None:
        """Take another time than that of the start."""
        self.t = time
        self._fixed["t"] = time

    def values(self, q: Floats, v: Floats) -> dict[str, float]:
        """Give the value of every variable at the state."""
        values = self._fixed | dict(zip(self.e.q, map(float, q), strict=True))
        return values | dict(zip(self.e.velocities, map(float, v), strict=True))

    def array(self, nodes: Sequence[int], q: Floats, v: Floats) -> Floats:
        """Give the values of `nodes` at the state."""
        return np.array(evaluate(self.g, nodes, self.values(q, v)), dtype=float)

    def rounding(
        self,
        nodes: Sequence[int],
        q: Floats,
        v: Floats,
        errors: Mapping[str, float],
    ) -> Floats:
        """Give bounds of the rounding errors of `nodes`, from those of the start."""
        values = {
            name: (value, errors.get(name, self._rounded.get(name, 0.0)))
            for name, value in self.values(q, v).items()
        }
        return np.array([e for _, e in evaluate_with_error(self.g, nodes, values)])

    def solved_errors(
        self, q: Floats, v: Floats, origin: tuple[Floats, Floats] | None = None
    ) -> dict[str, float]:
        """Give the errors of values that were solved for.

        Their own rounding; that of the way that all went together from `origin`; and
        what the rounding of the relations in which they stand makes of them: one that
        should be zero is left with that of its neighbours.
        """
        rows, weights = self.e.rows, self.sizes(q, v)
        own = [SOLVED * np.abs(q), SOLVED * np.abs(v)]
        for k, (x, x0) in enumerate(zip((q, v), origin or (q, v), strict=True)):
            own[k] += SOLVED * np.linalg.norm(weights * (x - x0)) / weights
        names = (self.e.q, self.e.velocities)
        errors = self._named(names, own)
        if not rows:
            return errors
        held = [r.residual if r.holonomic else self.g.zero for r in rows]
        left = [self.rounding(x, q, v, errors) for x in (held, [r.rate for r in rows])]
        entries = self.jacobian_entries(rows, q, v)
        columns = np.nan_to_num(np.abs(entries.values)) / weights[entries.j]
        squares = np.bincount(entries.i, columns**2, len(rows))
        for k, rounding in enumerate(left):
            step = np.nan_to_num(rounding) / np.where(squares > 0.0, squares, np.inf)
            shares = columns * step[entries.i] / weights[entries.j]
            # At a double root half of the digits are known, whatever the slopes say.
            known = HALF * (np.abs((q, v)[k]) + own[k] / SOLVED)
            own[k] += np.minimum(np.bincount(entries.j, shares, self.n), known)
        return self._named(names, own)

    def _named(
        self, names: Sequence[Sequence[str]], values: Sequence[Floats]
    ) -> dict[str, float]:
        return {
            name: float(x)
            for group, array in zip(names, values, strict=True)
            for name, x in zip(group, array, strict=True)
        }

    def sizes(self, q: Floats, v: Floats) -> Floats:
        """Give sqrt(M_jj), or what stands in its place, where it was first asked."""
        if self._sizes is None:
            diagonal = self.array(self.e.inertias, q, v)
            self._sizes = np.sqrt(np.abs(diagonal))
            if not self._sizes.all():
                A = np.nan_to_num(self.jacobian(self.e.rows, q, v))
                self._sizes = sizes_of(self._sizes, A)
        return self._sizes

    def mass(self, q: Floats, v: Floats, among: Sequence[int] | None = None) -> Floats:
        """Give M (n, n), or its rows and columns `among`."""
        chosen = range(self.n) if among is None else among
        if self.e.chains is not None:
            return self._chained_mass(self.e.chains, q, v)[np.ix_(chosen, chosen)]
        found = self.mass_entries(q, v, chosen)
        M = np.zeros((len(chosen), len(chosen)))
        M[found.i, found.j] = found.values
        return M

    def _chained_mass(self, chains: Chains, q: Floats, v: Floats) -> Floats:
        """Give M (n, n) without an expression for each entry."""
        nodes = chains.nodes
        values = dict(zip(nodes, self.array(nodes, q, v), strict=True))
        along = np.eye(self.n + len(chains.sums), self.n)
        for k, form in enumerate(chains.sums, self.n):
            for i, node in form.items():
                along[k] += values[node] * along[i]
        pushed = np.zeros_like(along)
        for (i, j), node in chains.squares.items():
            for a, b in {(i, j), (j, i)}:
                pushed[a] += values[node] * along[b]
        return np.asarray(along.T @ pushed)

    def mass_entries(
        self, q: Floats, v: Floats, among: Sequence[int] | None = None
    ) -> Entries:
        """Give the entries of M that do not vanish identically."""
        chosen = range(self.n) if among is None else among
        if self.e.chains is not None:
            M = self.mass(q, v, chosen)
            i, j = np.nonzero(M)
            return Entries(i, j, M[i, j])
        place = {j: k for k, j in enumerate(chosen)}
        rows = (self.e.M[j].entries for j in chosen)
        kept = [{place[j]: x for j, x in row.items() if j in place} for row in rows]
        return self._entries(kept, q, v, None)

    def jacobian(
        self,
        rows: Sequence[Row],
        q: Floats,
        v: Floats,
        errors: Mapping[str, float] | None = None,
    ) -> Floats:
        """Give A (m, n) of `rows`; with `errors` what is only rounding is zero."""
        found = self.jacobian_entries(rows, q, v, errors)
        A = np.zeros((len(rows), self.n))
        A[found.i, found.j] = found.values
        return A

    def jacobian_entries(
        self,
        rows: Sequence[Row],
        q: Floats,
        v: Floats,
        errors: Mapping[str, float] | None = None,
    ) -> Entries:
        """Give the entries of A that do not vanish identically."""
        return self._entries([row.A.entries for row in rows], q, v, errors)

    def _entries(
        self,
        rows: Sequence[Mapping[int, int]],
        q: Floats,
        v: Floats,
        errors: Mapping[str, float] | None,
    ) -> Entries:
        nodes = [node for row in rows for node in row.values()]
        values = self.array(nodes, q, v)
        if errors is not None:
            values[np.abs(values) <= self.rounding(nodes, q, v, errors)] = 0.0
        i = np.repeat(np.arange(len(rows)), [len(row) for row in rows])
        j = np.array([j for row in rows for j in row], dtype=int)
        return Entries(i, j, values)

    def relations(
        self,
        asked: Asked,
        free: Sequence[int],
        q: Floats,
        v: Floats,
        errors: Mapping[str, float],
        *,
        velocities: bool,
    ) -> AtState:
        """Give what is asked of the values `free`, positions or velocities."""
        return AtState(self, asked, free, (q, v), errors, velocities=velocities)


class Entries(NamedTuple):
    """The entries of a matrix that are not zero: rows, columns, values, each (k,)."""

    i: Any
    j: Any
    values: Floats


class Asked:
    """Nodes, the values that they should have, and the sizes of their terms."""

    def __init__(self) -> None:
        self.names: list[str] = []
        self.nodes: list[int] = []
        self.targets: list[float] = []
        self.errors: list[float] = []
        self.scales: list[int] = []

    def add(
        self, name: str, node: int, scale: int, target: float = 0.0, error: float = 0.0
    ) -> None:
        """Ask that `node` be `target`."""
        self.names.append(name)
        self.nodes.append(node)
        self.scales.append(scale)
        self.targets.append(target)
        self.errors.append(error)

    def add_rows(self, rows: Sequence[Row], *, velocities: bool) -> None:
        """Ask that relations hold, or that their rates be 0."""
        for row in rows:
            if velocities:
                self.add(row.name, row.rate, row.rate_scale)
            elif row.holonomic:
                self.add(row.name, row.residual, row.residual_scale)


class AtState(Relations):
    """What is asked of some values of a state, the others given."""

    def __init__(
        self,
        point: Point,
        asked: Asked,
        free: Sequence[int],
        state: tuple[Floats, Floats],
        errors: Mapping[str, float],
        *,
        velocities: bool,
    ) -> None:
        self.point, self.asked = point, asked
        self.free, self.velocities = list(free), velocities
        self.q, self.v = state[0].copy(), state[1].copy()
        self.errors = errors
        self.targets = np.array(asked.targets)
        names = point.e.velocities if velocities else point.e.q
        self.names = [names[j] for j in free]

    @cached_property
    def slopes(self) -> list[dict[int, int]]:
        """The slopes of each node: index among the values -> node."""
        g = self.point.g
        place = {g.variable(name): k for k, name in enumerate(self.names)}
        unknowns = frozenset(place)
        return [
            {place[v]: slope for v, slope in slopes(g, node, unknowns).items()}
            for node in self.asked.nodes
        ]

    @cached_property
    def _bends(self) -> list[tuple[int, int, int, int]]:
        """The second derivatives that do not vanish: row, two values, node."""
        g = self.point.g
        place = {g.variable(name): k for k, name in enumerate(self.names)}
        found = []
        for i, row in enumerate(self.slopes):
            nodes = list(row.values())
            for x in sorted(frozenset(g.cone(nodes)) & frozenset(place)):
                bent = tangent(g, nodes, {x: g.one})
                found += [
                    (i, j, place[x], node)
                    for j, node in zip(row, bent, strict=True)
                    if node != g.zero
                ]
        return found

    def curvature(self, x: Floats, multipliers: Floats) -> Floats:
        """Give the sum of multiplier_i d2r_i/dx dx, (k, k)."""
        found = np.zeros((len(self.free), len(self.free)))
        values = self.point.array([bend[3] for bend in self._bends], *self.state(x))
        for (i, j, k, _), value in zip(self._bends, values, strict=True):
            found[j, k] += multipliers[i] * value
        return (found + found.T) / 2

    def state(self, x: Floats) -> tuple[Floats, Floats]:
        """Give the state (q, v) with these values."""
        state = (self.q.copy(), self.v.copy())
        state[self.velocities][self.free] = x
        return state

    def __call__(self, x: Floats) -> tuple[Floats, Floats]:
        """Give r (m,) and dr/dx (m, k)."""
        m, k = len(self.targets), len(self.free)
        self.point.g.count(m * k * min(m, k) / STEP)
        r, entries = self.sparse(x)
        J = np.zeros((len(r), len(self.free)))
        J[entries.i, entries.j] = entries.values
        return r, J

    def sparse(self, x: Floats) -> tuple[Floats, Entries]:
        """Give r (m,) and the entries of dr/dx that are not zero."""
        nodes, slopes = self.asked.nodes, self.slopes
        every = [*nodes, *(node for row in slopes for node in row.values())]
        found = self.point.array(every, *self.state(x))
        i = np.repeat(np.arange(len(slopes)), [len(row) for row in slopes])
        j = np.array([j for row in slopes for j in row], dtype=int)
        r = found[: len(nodes)] - self.targets
        return r, Entries(i, j, found[len(nodes) :])

    def _residual(self, x: Floats) -> Floats:
        found = self.point.array(self.asked.nodes, *self.state(x))
        return np.asarray(found - self.targets)

    def met(self, x: Floats, errors: Floats) -> bool:
        """Tell whether r is small against its terms, or rounding for these errors."""
        residual, terms = self._against_terms(x)
        far = np.flatnonzero(~(residual <= terms))
        # Bounds of rounding take long: of the row that misses most they mostly suffice.
        far = far[np.argsort((terms - residual)[far])].tolist()
        return not any(
            np.any(self._beyond_rounding(x, errors, residual, some))
            for some in (far[:1], far[1:])
        )

    def missed(self, x: Floats, errors: Floats) -> Any:
        """Tell of each of r whether it is more than that, (m,) of bool."""
        residual, terms = self._against_terms(x)
        found = ~(residual <= terms)
        far = np.flatnonzero(found).tolist()
        found[far] = self._beyond_rounding(x, errors, residual, far)
        return found

    def _against_terms(self, x: Floats) -> tuple[Floats, Floats]:
        """Give |r| (m,), and what of it is small against its terms, (m,)."""
        scale = np.abs(self.point.array(self.asked.scales, *self.state(x)))
        scale = np.maximum(scale, np.abs(self.targets))
        return np.abs(self._residual(x)), MET * scale

    def _beyond_rounding(
        self, x: Floats, errors: Floats, residual: Floats, rows: Sequence[int]
    ) -> Any:
        """Tell of each of some rows whether |r| is more than rounding."""
        named = {
            **self.errors,
            **dict(zip(self.names, map(float, errors), strict=True)),
        }
        return ~(residual[rows] <= self._rounding(x, named, rows))

    def exact(self, x: Floats) -> bool:
        """Tell whether r is within the rounding errors of x as it was stated."""
        residual = self._residual(x)
        every = range(len(residual))
        return bool(np.all(np.abs(residual) <= self._rounding(x, self.errors, every)))

    def _rounding(
        self, x: Floats, errors: Mapping[str, float], rows: Sequence[int]
    ) -> Floats:
        nodes = [self.asked.nodes[i] for i in rows]
        found = self.point.rounding(nodes, *self.state(x), errors)
        return np.asarray(found + [self.asked.errors[i] for i in rows])
