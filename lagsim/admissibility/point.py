"""Numerical values of the equations at a state, by the graph; lengths of relations.

Only one state is evaluated, so no code is compiled. From LARGE coordinates on matrices
are sparse: decisions are equal to those of small models as long as the mass matrix M is
safely positive and the rows are safely independent; otherwise dense matrices are used,
at a cost proportional to the cube of the number of coordinates.

The length of a relation is the distance along a coordinate over which its gradient
changes by its own length: of a rod its length, of a curve its radius, of a sine one
radian. It does not change with origin or units, while the terms of the relation and
|q_i dg/dq_i| grow with the distance from the origin. An affine relation has no length
of its own; its coordinates have the lengths of their other relations.
"""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lagsim.language.derivatives import slopes, tangent
from lagsim.language.evaluate import evaluate, evaluate_with_error
from lagsim.language.sparse import Budget
from lagsim.mechanics.algebra import (
    Entries,
    factored,
    largest_eigenvalue,
    least_squares,
    sizes_of,
)
from lagsim.mechanics.equations import Instant
from lagsim.tolerances import (
    DOUBLE_ROOT,
    LOST_RANK,
    SAFELY_INDEPENDENT,
    STATE_ROUNDOFF,
    SURFACE_ROUNDOFF,
    UNIT_ROUNDOFF,
)

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from lagsim.language.arrays import Floats
    from lagsim.language.graph import Graph
    from lagsim.mechanics.constraints import Row
    from lagsim.mechanics.equations import Equations


class Point:
    """Numerical values of the equations at a state (t, q, v, s).

    Parameters
    ----------
    equations : Equations
    state : Instant
    errors : mapping of str to float, optional
        Bounds of the rounding errors of values. Other parameters that are not integers
        have been rounded to doubles, and other values are exact.

    Attributes
    ----------
    multipliers : mapping of str to float
        Multipliers, and shares of sides, that are variables of an expression; else
        empty.
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
        self.multipliers: dict[str, float] = {}
        self.t, self.q, self.v = state.t, state.q, state.v
        self._sizes: list[Floats] = []

    def at(
        self,
        q: Floats | None = None,
        v: Floats | None = None,
        errors: Mapping[str, float] | None = None,
        *,
        t: float | None = None,
        s: Floats | None = None,
    ) -> Point:
        """Return the point of these equations at another state, or with other errors.

        Values that are not given, and `sizes` and `multipliers`, are taken from this
        point.
        """
        state = Instant(
            self.t if t is None else t,
            self.q if q is None else q,
            self.v if v is None else v,
            self.state.s if s is None else s,
        )
        other = Point(self.e, state, self.errors if errors is None else errors)
        other._sizes, other.multipliers = self._sizes, self.multipliers
        return other

    def of(self, equations: Equations) -> Point:
        """Return the point of other equations at this state.

        Errors and multipliers are taken from this point.
        """
        other = Point(equations, self.state, self.errors)
        other._sizes, other.multipliers = self._sizes, self.multipliers
        return other

    @property
    def is_large(self) -> bool:
        """Whether matrices are sparse: from LARGE coordinates on."""
        return self.n >= self.LARGE

    @cached_property
    def values(self) -> dict[str, float]:
        """The value of every variable."""
        values = {p.name: p.value for p in self.e.model.parameters} | {"t": self.t}
        state = np.concatenate([self.q, self.v, self.state.s]).tolist()
        values |= dict(zip(self.e.state, state, strict=True))
        values |= {law.slider.way: 0.0 for law in self.e.laws if law.slider}
        return values | self.multipliers

    @cached_property
    def places(self) -> tuple[dict[int, int], frozenset[int]]:
        """Index of each position and velocity, by its graph node, and all these nodes.

        Indices run from 0 to 2 n - 1, positions first.
        """
        names = (*self.e.q, *self.e.velocities)
        found = {self.g.variable(name): j for j, name in enumerate(names)}
        return found, frozenset(found)

    def array(self, nodes: Sequence[int]) -> Floats:
        """Return the values of graph nodes at the state, shape (nodes,)."""
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
        """Return bounds of the rounding errors of the values of graph nodes, (nodes,).

        The bounds include the effect of the errors of the variables.
        """
        found = evaluate_with_error(self.g, nodes, self._inexact)
        return np.array([error for _, error in found])

    def solved_errors(
        self, origin: tuple[Floats, Floats] | None = None
    ) -> dict[str, float]:
        """Return error bounds of the values that were solved for, by name.

        The bound of a value is a sum: its own rounding error, the rounding of the
        distance of all values from `origin` (positions, velocities), and the effect of
        rounding errors in its relations. A value whose exact value is 0 has the error
        of the values to which relations couple it.
        """
        rows, weights, state = self.e.rows, self.sizes, (self.q, self.v)
        names = self.e.state
        own = [STATE_ROUNDOFF * np.abs(x) for x in state]
        for k, (x, x0) in enumerate(zip(state, origin or state, strict=True)):
            own[k] += STATE_ROUNDOFF * np.linalg.norm(weights * (x - x0)) / weights
        errors = dict(zip(names, np.concatenate(own).tolist(), strict=False))
        if not rows:
            return errors
        near = self.at(errors=errors)
        residuals = [r.residual if r.holonomic else self.g.zero for r in rows]
        entries = self.jacobian_entries(rows)
        columns = np.nan_to_num(np.abs(entries.values)) / weights[entries.j]
        squares = np.bincount(entries.i, columns**2, len(rows))
        for k, nodes in enumerate((residuals, [r.rate for r in rows])):
            rounding = np.nan_to_num(near.rounding(nodes))
            step = rounding / np.where(squares > 0.0, squares, np.inf)
            shares = columns * step[entries.i] / weights[entries.j]
            # At a double root half of the digits are known, independent of the slopes.
            known = DOUBLE_ROOT * (np.abs(state[k]) + own[k] / STATE_ROUNDOFF)
            own[k] += np.minimum(np.bincount(entries.j, shares, self.n), known)
        return dict(zip(names, np.concatenate(own).tolist(), strict=False))

    @property
    def sizes(self) -> Floats:
        """Size of each coordinate (n,): sqrt(M_jj), or a substitute where that is 0.

        The sizes are those at the first state that was evaluated.
        """
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
        return self._entries([x.entries for x in self.e.M]).dense(self.n, self.n)

    @cached_property
    def gradients(self) -> Floats:
        """The constraint Jacobian A (m, n)."""
        return self.jacobian(self.e.rows)

    def mass_entries(self, among: Sequence[int] | None = None) -> Entries:
        """Return nonzero entries of M, or of its rows and columns `among`."""
        chosen = range(self.n) if among is None else among
        place = {j: k for k, j in enumerate(chosen)}
        rows = (self.e.M[j].entries for j in chosen)
        return self._entries(
            [{place[j]: x for j, x in row.items() if j in place} for row in rows]
        )

    def jacobian(self, rows: Sequence[Row], *, rounded: bool = False) -> Floats:
        """Return the gradients (m, n) of rows; if `rounded`, 0 for rounding errors."""
        found = self.jacobian_entries(rows, rounded=rounded)
        return found.dense(len(rows), self.n)

    def forces_of(self, rows: Sequence[Row]) -> Floats:
        """Return the generalized forces (m, n) per unit of the multipliers of rows.

        They are the gradients of the rows, plus their drags.
        """
        return self._entries([row.force(self.g) for row in rows]).dense(
            len(rows), self.n
        )

    def jacobian_entries(
        self, rows: Sequence[Row], *, rounded: bool = False
    ) -> Entries:
        """Return the entries of the rows' gradients A that do not vanish identically.

        rows : the m rows of A (m, n).
        rounded : whether entries within rounding count as 0.
        """
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
        """Whether M is positive definite beyond rounding; False if undecided."""
        if self.e.chains is not None:  # by pivots, against the diagonal
            pivots = self.e.chains.factorisation(self.g, Budget()).pivots
            own = self.array([pivots[k][0] for k in range(self.n)])
            sizes = self.array(self.e.inertias)
            sound = np.all(np.isfinite(own)) and np.all(sizes > 0)
            # For a tree the pivots are sums of the inertias of bodies, known to more
            # digits.
            least = LOST_RANK if self.e.tree else SAFELY_INDEPENDENT
            return bool(sound and np.min(own / sizes) > least)
        entries = self.mass_entries()
        own = entries.values[entries.i == entries.j]
        if len(own) < self.n or not (
            np.all(np.isfinite(entries.values)) and np.all(own > 0)
        ):
            return False
        if len(own) == len(entries.values):
            return True
        from scipy.sparse import diags

        M = entries.sparse(self.n, self.n)
        scale = diags(1.0 / np.sqrt(M.diagonal()))
        factors = factored(scale @ M @ scale, symmetric=True)
        if factors is None or not np.all(factors.U.diagonal() > 0):
            return False
        if not np.array_equal(factors.perm_r, factors.perm_c):
            return False  # with entries off the diagonal, pivots do not decide
        return 1.0 / largest_eigenvalue(factors.solve, self.n)[0] > SAFELY_INDEPENDENT


# --- Lengths

# Number of affine relations through which a length propagates.
LINKS = 3
# A length that exceeds this multiple of the form's shortest does not propagate.
LONG = 1e3
# A least-squares problem takes rows * columns * rank / FITTED operations made.
FITTED = 1000.0


class Condition(NamedTuple):
    """Equation for positions, or for velocities: a node and its target value.

    Attributes
    ----------
    name : str
    node : int
        The expression whose value is prescribed.
    A : mapping of int to int
        The gradient of the node: index of a coordinate, or of its velocity -> node.
    scale : int
        Node of the size of the terms.
    target, error : float
        The target value, and a bound of its rounding error.
    """

    name: str
    node: int
    A: Mapping[int, int]
    scale: int
    target: float = 0.0
    error: float = 0.0


def implied_conditions(rows: Iterable[Row], *, velocities: bool) -> list[Condition]:
    """Return the equations for positions, or for velocities, that `rows` imply.

    Rows between velocities imply no equation for positions.
    """
    if velocities:
        return [Condition(r.name, r.rate, r.A.entries, r.rate_scale) for r in rows]
    return [
        Condition(r.name, r.residual, r.A.entries, r.residual_scale)
        for r in rows
        if r.holonomic
    ]


def gradient_of(point: Point, node: int) -> dict[int, int]:
    """Return the derivatives of a node by positions and velocities, as nodes.

    The result maps an index, of positions first and then velocities, to a derivative
    that does not vanish identically.
    """
    places, variables = point.places
    found = slopes(point.g, node, variables)
    return {places[x]: slope for x, slope in found.items()}


def defined_conditions(point: Point, *, velocities: bool) -> list[Condition]:
    """Return the equations that stated start values of definitions imply.

    velocities : whether these are equations for velocities, or for positions.
    """
    e, g, n = point.e, point.g, point.n
    found = []
    for x in e.model.initial:
        if x.node is None:
            continue
        slopes = gradient_of(point, x.node)
        if bool(g.depends([x.node]) & frozenset(e.velocities)) is velocities:
            A = {
                j - n * velocities: s
                for j, s in slopes.items()
                if (j >= n) is velocities
            }
            size, name = g.call("abs", x.node), f"{x.name}: {x.text}"
            found.append(Condition(name, x.node, A, size, x.value, x.error))
    return found


class _ScaledGradient(NamedTuple):
    """Gradient of a condition with respect to the scaled coordinates sqrt(M_jj) q_j.

    Attributes
    ----------
    columns : list of int
        Coordinates in the gradient.
    table : ndarray, shape (2 k + 1, columns)
        The gradient, then its first and second derivative by each of the k positions
        that it depends on.
    lengths : dict of int to float
        For each of these positions: the distance over which the gradient changes by its
        own length; 0 if the gradient vanishes, inf if it is constant.
    """

    columns: list[int]
    table: Floats
    lengths: dict[int, float]

    @property
    def shortest(self) -> float:
        """The shortest of `lengths`; inf if the condition is affine."""
        return min(self.lengths.values(), default=np.inf)

    def longest(self, lengths: Floats) -> float:
        """Return the largest |gradient_j| times length_j over the coordinates j.

        The result is -inf if no coordinate of the gradient has a known length.

        lengths : (n,), the lengths of all coordinates.
        """
        slopes, own = np.abs(self.table[0]), lengths[self.columns]
        known = np.isfinite(own) & (slopes > 0.0)
        return float(np.max(slopes[known] * own[known], initial=-np.inf))


def positions_of(e: Equations) -> dict[int, int]:
    """Return the index of each position by the node of its variable."""
    return {e.graph.variable(name): j for j, name in enumerate(e.q)}


def shape_of(
    g: Graph, places: Mapping[int, int], nodes: Sequence[int]
) -> tuple[list[int], list[int]]:
    """Return the positions on which a gradient depends, and its derivatives.

    Parameters
    ----------
    places : mapping of int to int
        Node of each position -> its index.
    nodes : sequence of int
        The gradient.

    Returns
    -------
    ways : list of int
        Indices of the positions, ascending, k of them.
    table : list of int
        (2 k + 1) rows of nodes: the gradient, then for each of these positions its
        first and its second derivative.
    """
    found = (x for x in g.cone(nodes) if x in places)
    variables = sorted(found, key=places.__getitem__)
    # Only entries that depend on a coordinate are searched for it.
    entries_of: dict[int, list[int]] = {x: [] for x in variables}
    for i, node in enumerate(nodes):
        for x in g.cone([node]):
            if x in places:
                entries_of[x].append(i)
    table = list(nodes)
    for variable, entries in entries_of.items():
        seed = {variable: g.one}
        slopes_found = [nodes[i] for i in entries]
        for _ in range(2):
            slopes_found = tangent(g, slopes_found, seed)
            row = dict(zip(entries, slopes_found, strict=True))
            table += [row.get(i, g.zero) for i in range(len(nodes))]
    return [places[x] for x in variables], table


class Lengths:
    """Lengths of conditions at a state.

    The length of a condition is the distance over which its gradient changes by its own
    size; see the module docstring.

    Parameters
    ----------
    point : Point
        The state.
    conditions : sequence of Condition
        The m conditions.
    """

    def __init__(self, point: Point, conditions: Sequence[Condition]) -> None:
        self.point, self.conditions = point, conditions
        self.weights = point.sizes
        self.u = self.weights * point.q
        self.forms = self._measured()

    def _measured(self) -> list[_ScaledGradient]:
        if not self.conditions:
            return []
        terms: list[int] = []
        along: list[list[int]] = []
        positions = positions_of(self.point.e)
        for condition in self.conditions:
            gradient = list(condition.A.values())
            ways, nodes = shape_of(self.point.g, positions, gradient)
            terms += nodes
            along.append(ways)
        values, forms = self.point.array(terms), []
        for condition, ways in zip(self.conditions, along, strict=True):
            columns, rows = list(condition.A), 2 * len(ways) + 1
            table, values = np.split(values, [rows * len(columns)])
            scale = 1.0 / self.weights[np.repeat(ways, 2).astype(int)]
            scale[1::2] *= scale[1::2]
            table = table.reshape(rows, len(columns)) / self.weights[columns]
            table[1:] *= scale[:, None]
            size = np.linalg.norm(table, axis=1)
            # A gradient within its rounding at the point of evaluation is 0.
            rounding = STATE_ROUNDOFF * float(size[1::2] @ np.abs(self.u[ways]))
            size[0] = size[0] if size[0] > rounding else 0.0
            pairs = zip(ways, size[1::2], size[2::2], strict=True)
            own = {k: _length(size[0], first, second) for k, first, second in pairs}
            forms.append(_ScaledGradient(columns, table, own))
        return forms

    def _shortest(self, least: float, most: float) -> Floats:
        """Return the shortest length of the conditions at each coordinate, (n,).

        Only lengths that exceed `least` count. A length that exceeds `most` times the
        shortest length of its condition belongs to a special direction, as along a rod,
        and is replaced by the shortest. Affine conditions have no length of their own;
        they propagate the lengths of one coordinate to their other coordinates.
        """
        found = np.full(self.point.n, np.inf)
        for form in self.forms:
            for k, own in form.lengths.items():
                length = form.shortest if own > most * form.shortest else own
                found[k] = min(found[k], length) if length > least else found[k]
        for _ in range(LINKS):
            before = found.copy()
            for form in self.forms:
                scale = form.longest(before) if np.isinf(form.shortest) else -np.inf
                for k, slope in zip(form.columns, np.abs(form.table[0]), strict=True):
                    if scale > 0.0 and slope > 0.0 and np.isinf(found[k]):
                        found[k] = scale / slope
            if np.array_equal(before, found):
                break
        return found

    @cached_property
    def spread(self) -> Floats:
        """Distance by which each coordinate is varied around the state, shape (n,).

        It is the coordinate's length, or 0 if no gradient depends on the coordinate. If
        a length is undetermined at the state (at a double root), it is the greatest of
        the other lengths in the metric of M; without any, the coordinate's own size.
        """
        own = [item for form in self.forms for item in form.lengths.items()]
        known = [length for _, length in own if 0.0 < length < np.inf]
        size = max(known, default=0.0)
        lengths = self._shortest(LOST_RANK * size, 1.0)
        other = np.full(self.point.n, size)
        if not known:
            other[:] = float(np.linalg.norm(self.u)) or 1.0
            other = np.where(self.u != 0.0, np.abs(self.u), other)
        lengths = np.where(np.isinf(lengths), other, lengths)
        moves = np.zeros(self.point.n, dtype=bool)
        moves[[k for k, _ in own]] = True
        return np.asarray(np.where(moves, lengths / self.weights, 0.0))

    def scales(self) -> Floats:
        """Return the size of each condition (m,), slope times length; inf if unknown.

        Unlike the terms of a condition, this size does not grow with the distance from
        the origin.
        """
        values = self.point.array([x.node for x in self.conditions])
        missed = values - np.array([x.target for x in self.conditions])
        pairs = zip(self.forms, missed, strict=True)
        return np.array([self._scale(form, x) for form, x in pairs])

    @cached_property
    def _lengths(self) -> Floats:
        """The shortest length at each coordinate (n,); inf if unknown."""
        return self._shortest(0.0, LONG)

    def _scale(self, form: _ScaledGradient, value: float) -> float:
        slopes = form.table[0]
        if not np.all(np.isfinite(slopes)):
            return np.inf
        if np.isfinite(form.shortest):
            return float(np.linalg.norm(slopes)) * form.shortest
        scale = form.longest(self._lengths)
        if np.isfinite(scale):
            return scale
        own = slopes * self.u[form.columns]
        moved = abs(float(np.sum(own)))
        constant = abs(value - float(np.sum(own)))
        terms = float(np.max(np.abs(own), initial=0.0))
        return np.inf if constant <= SURFACE_ROUNDOFF * terms else max(constant, moved)

    def motions(self) -> Floats:
        """Return the size of the motion in each condition (m,); inf if unknown.

        The size is |A| in the metric of M^-1 times |v| in the metric of M, over the
        coordinates of the condition. Velocities that change neither the condition nor
        its derivatives (equal velocities of both ends of a rod) are projected out.
        """
        return np.array([self._motion(form) for form in self.forms])

    def _motion(self, form: _ScaledGradient) -> float:
        shortest, table = form.shortest, form.table
        square = shortest * shortest
        if np.isinf(square) or not np.all(np.isfinite(table)):
            return np.inf
        # Derivatives are scaled by their contribution to the gradient over the shortest
        # length.
        factors = [1.0, *[shortest, square] * len(form.lengths)]
        seen = table * np.array(factors)[:, None]
        v = (self.weights * self.point.v)[form.columns]
        self.point.g.count(seen.size * min(seen.shape) / FITTED)
        along = seen.T @ least_squares(seen.T, v)
        return float(np.linalg.norm(table[0]) * np.linalg.norm(along))


def of_rows(point: Point, rows: Sequence[Row]) -> Lengths:
    """Return the lengths of constraint rows, see `Lengths`."""
    conditions = [
        Condition(r.name, r.residual, r.A.entries, r.residual_scale) for r in rows
    ]
    return Lengths(point, conditions)


def _length(size: float, first: float, second: float) -> float:
    """Return the distance over which a gradient changes by its own size.

    size : the size of the gradient.
    first, second : sizes of its first and second derivative.
    """
    if not (np.isfinite(size) and np.isfinite(first) and np.isfinite(second)):
        return np.inf
    linear = size / first if first > 0.0 else np.inf
    curved = np.sqrt(size / second) if second > 0.0 else np.inf
    return float(min(linear, curved))
