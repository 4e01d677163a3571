"""Kinetic energy of bodies on chains, and the solution of M x = f along the chains.

For links of length l at angles a_k, x_k' = x_{k-1}' + l cos(a_k) a_k' is the velocity
of joint k, and likewise for the other positions. The mass matrix M of the angles is
full, but the kinetic energy as a function of all x_k' and a_k' is a sum of a few
squares per body. Chains are recognized on the graph, where definitions written with
each other and sums shared by expressions are the same nodes.

The x_k' therefore stay unknowns beside the q_k', and L D L^T is computed from the tips
of the chains inward (see `Factorisation`). The pivots are the articulated-body
inertias: the inertia of all bodies outward of a joint with their joints free. The cost
is O(n) operations.

Forces are derived from L as a function of u = d/dt x(q, t), q and q'. Lagrange's
equations are

    d/dt(dL/du) du/dq' + d/dt(dL/dq') - dL/dq = Q

where each derivative of L treats u and q' as independent variables. As d/dt(du/dq') =
du/dq, terms with the derivatives of du/dq', which occur twice and cancel, are never
formed. At q'' = 0 the left-hand side is the bias force of articulated bodies.

Sources: R. Featherstone, Rigid Body Dynamics Algorithms, chapters 5 and 7; A. Griewank
and A. Walther, Evaluating Derivatives, chapter 9 (elimination on a graph of sums);
T. R. Kane and D. A. Levinson, Dynamics: Theory and Applications, section 4.11.
"""

from __future__ import annotations

from collections import Counter
from functools import cached_property
from heapq import heapify, heappop, heappush
from itertools import product
from typing import TYPE_CHECKING, NamedTuple

from lagsim.language.derivatives import local_slopes, pulled, slopes, tangent
from lagsim.language.evaluate import roundings
from lagsim.language.sparse import Budget, SparseVector, TooLongError, minimum_degree
from lagsim.model.model import Level

if TYPE_CHECKING:
    from collections.abc import (
        Callable,
        Collection,
        Container,
        Iterable,
        Iterator,
        Mapping,
        Sequence,
    )

    from lagsim.language.graph import Graph
    from lagsim.mechanics.constraints import Flow
    from lagsim.model.model import Model


# --- L D L^T of symmetric matrices of nodes, in minimum-degree order
#
# Unknowns may be sums of others, with which the matrix has fewer entries. From the
# outside in
#
# - a sum that occurs in no remaining sum is substituted in the rows;
# - an unknown that occurs in no remaining sum is eliminated: the pivots equal those of
#   the matrix without sums, in the same order.

Vector = dict[int, int]  # index -> node; absent entries are zero


def add_to(g: Graph, x: Vector, i: int, term: int) -> None:
    """Add the node `term` to entry i of the sparse vector x, in place."""
    x[i] = g.call("add", x.get(i, g.zero), term)


def symmetric(size: int, entries: Mapping[tuple[int, int], int]) -> list[Vector]:
    """Return the rows of a symmetric matrix (size, size).

    entries : (i, j) -> node, for at least one triangle.
    """
    rows = [Vector() for _ in range(size)]
    for (i, j), node in entries.items():
        rows[i][j] = rows[j][i] = node
    return rows


class Factorisation:
    """Sparse factorisation S = L D L^T of a symmetric matrix of nodes.

    Parameters
    ----------
    g : Graph
        Expression graph in which new nodes are created.
    rows : sequence of Vector
        The rows of S; changed in place. After the elimination of `unknowns` only,
        they hold the remaining Schur complement.
    budget : Budget
        The number of multiplications that are permitted.
    sums : mapping, optional
        Unknown that is a sum -> coefficient of each unknown in the sum, which is either
        no sum or one with a lower number.
    moving : container of int
        Unknowns with a varying diagonal entry, eliminated later than others of equal
        degree.
    unknowns : collection of int, optional
        The unknowns that are eliminated; by default all.

    Attributes
    ----------
    columns : dict
        Unknown k -> column k of L without its unit diagonal, as row -> node, or the
        coefficients of sum k; in the order of elimination.
    inverse : dict
        Unknown k -> 1 / D_k.
    pivots : dict
        Unknown k -> (D_k, the diagonal entry of S before elimination).

    Raises
    ------
    TooLongError
        Where the factorisation takes more multiplications than `budget` has left.
    """

    def __init__(
        self,
        g: Graph,
        rows: Sequence[Vector],
        budget: Budget,
        sums: Mapping[int, Vector] | None = None,
        moving: Container[int] = (),
        unknowns: Collection[int] | None = None,
    ) -> None:
        self.g, self.budget, self.rows = g, budget, rows
        self.sums, self.moving = sums or {}, moving
        self.columns: dict[int, Vector] = {}
        self.inverse: Vector = {}
        self.pivots: dict[int, tuple[int, int]] = {}
        self.depths = [0] * len(rows)
        for k, form in self.sums.items():
            self.depths[k] = 1 + max(self.depths[i] for i in form)
        self._diagonal = [row.get(k, g.zero) for k, row in enumerate(rows)]
        self._eliminate_all(range(len(rows)) if unknowns is None else unknowns)

    def _eliminate_all(self, chosen: Collection[int]) -> None:
        users = Counter(i for form in self.sums.values() for i in form)
        queue = [self._rank(k) for k in chosen if not users[k]]
        heapify(queue)
        while queue:
            rank = heappop(queue)
            k = rank[-1]
            if k in self.columns or rank != self._rank(k):
                continue  # out of date: the queue has a newer entry for k
            users.subtract(self.sums.get(k, {}).keys())
            touched = self._substitute(k) if k in self.sums else self._eliminate(k)
            for i in touched:
                if i in chosen and not users[i]:
                    heappush(queue, self._rank(i))

    def _rank(self, k: int) -> tuple[int, int, int, int]:
        """Return the sort key of unknown k; unknowns are eliminated in ascending order.

        Unknowns that are no sums come first, by degree; sums follow, the outermost
        first.
        """
        if k in self.sums:
            return 1, -self.depths[k], 0, k
        return 0, len(self.rows[k]), k in self.moving, k

    def _removed(self, k: int) -> tuple[int, Vector]:
        """Remove row and column k of S; return the diagonal entry, and the others of k.

        The diagonal entry is a node; the other entries are a mapping unknown -> node.
        """
        row = dict(self.rows[k])
        own = row.pop(k, self.g.zero)
        self.rows[k].clear()
        for i in row:
            del self.rows[i][k]
        return own, row

    def _add(self, i: int, j: int, term: int) -> None:
        add_to(self.g, self.rows[i], j, term)
        self.rows[j][i] = self.rows[i][j]

    def _times(self, a: int, b: int) -> int:
        g = self.g
        self.budget.add(g.zero != a != g.one and g.zero != b != g.one)
        return g.call("mul", a, b)

    def _substitute(self, k: int) -> Iterable[int]:
        """Substitute sum k, an unknown, by the velocities and sums that it consists of.

        All rows of S are changed. Return the unknowns whose rows have changed.
        """
        form = self.columns[k] = self.sums[k]
        own, row = self._removed(k)
        for i, entry in row.items():
            for j, factor in form.items():
                term = self._times(entry, factor)
                self._add(i, j, self.g.call("add", term, term) if i == j else term)
        scaled = [(i, factor, self._times(own, factor)) for i, factor in form.items()]
        for at, (i, _, entry) in enumerate(scaled):
            for j, factor, _ in scaled[at:]:
                self._add(i, j, self._times(entry, factor))
        return row.keys() | form.keys()

    def _eliminate(self, k: int) -> Iterable[int]:
        g = self.g
        pivot, row = self._removed(k)
        self.budget.add(1 + len(row) * (len(row) + 3) // 2)
        self.pivots[k] = pivot, self._diagonal[k]
        inverse = self.inverse[k] = g.call("div", g.one, pivot)
        column = {i: g.call("mul", node, inverse) for i, node in row.items()}
        self.columns[k] = column
        others = sorted(column)
        for at, i in enumerate(others):
            for j in others[at:]:
                self._add(i, j, g.call("neg", g.call("mul", column[i], row[j])))
        return others

    @cached_property
    def _filled(self) -> list[tuple[int, Vector]]:
        """Pairs (k, column k of L) of the columns that are not empty, in their order.

        All unknowns have been eliminated.
        """
        return [(k, column) for k, column in self.columns.items() if column]

    def forward(self, right: Mapping[int, int]) -> Vector:
        """Return L^-1 right, as unknown -> node.

        The entry of an unknown that is a sum is distributed to the unknowns in that
        sum.

        right : unknown -> node.
        """
        z = {i: node for i, node in right.items() if node != self.g.zero}
        for k, column in self._filled:
            if k in z:
                op, value = ("add", z.pop(k)) if k in self.sums else ("sub", z[k])
                for i, entry in column.items():
                    term = self._times(entry, value)
                    z[i] = self.g.call(op, z.get(i, self.g.zero), term)
        return z

    def backward(self, z: Mapping[int, int], given: Vector | None = None) -> Vector:
        """Return L^-T D^-1 z, as unknown -> node.

        z : unknown -> node.
        given : values (nodes) of unknowns that have not been eliminated.
        """
        return self.upward({k: self._over_pivot(z[k], k) for k in z}, given)

    def _over_pivot(self, node: int, k: int) -> int:
        return self.g.call("mul", node, self.inverse.get(k, self.g.zero))

    def upward(self, scaled: Mapping[int, int], given: Vector | None = None) -> Vector:
        """Return L^-T scaled, as unknown -> node.

        scaled : unknown -> node, such as D^-1 z.
        given : values (nodes) of unknowns that have not been eliminated.
        """
        g, x = self.g, dict(given or {})
        for k, column in reversed(self.columns.items()):
            value, op = scaled.get(k, g.zero), "add" if k in self.sums else "sub"
            for i, entry in column.items():
                if i in x:
                    value = g.call(op, value, self._times(entry, x[i]))
            if value != g.zero:
                x[k] = value
        return x

    def solve(self, right: Mapping[int, int]) -> Vector:
        """Return the solution x of S x = right: unknown -> node."""
        return self.backward(self.forward(right))


# Degree of an expression in the velocities: HIGHER where neither constant nor affine.
FLAT, AFFINE, HIGHER = range(3)


class Chains(NamedTuple):
    """Kinetic energy as a quadratic form in velocities and nested sums of velocities.

    Unknowns 0 to n - 1 are the velocities, unknowns from n on are the sums.

    Attributes
    ----------
    size : int
        n.
    sums : tuple of dict
        For sum k, which is unknown n + k: unknown -> its coefficient, a node. Sum k
        contains velocities and sums before k only.
    squares : dict
        (i, j) with i <= j -> the second derivative of L by these two unknowns.
    rates : tuple of int
        The nodes of the sums in L.
    """

    size: int
    sums: tuple[Vector, ...]
    squares: dict[tuple[int, int], int]
    rates: tuple[int, ...]

    @property
    def named(self) -> dict[int, Vector]:
        """The sums by the index of their unknown: n + k -> sum k."""
        return dict(enumerate(self.sums, self.size))

    @property
    def key(self) -> tuple[object, ...]:
        """Hashable key, equal for equal chains."""
        sums = (tuple(form.items()) for form in self.sums)
        return (*sums, tuple(self.squares.items()))

    @property
    def nodes(self) -> list[int]:
        """The coefficients of the sums, and the second derivatives of L."""
        factors = [node for form in self.sums for node in form.values()]
        return [*factors, *self.squares.values()]

    def factorisation(
        self, g: Graph, budget: Budget, kind: type[Factorisation] = Factorisation
    ) -> Factorisation:
        """Factor M as L D L^T along the chains, as for articulated bodies.

        budget : the number of multiplications that are permitted.
        kind : the class of the result.

        Raises
        ------
        TooLongError
            Where the factorisation takes more multiplications than `budget` has left.
        """
        rows = symmetric(self.size + len(self.sums), self.squares)
        return kind(g, rows, budget, self.named)

    def entries(self, g: Graph, budget: Budget) -> tuple[SparseVector, ...]:
        """Return the rows of M, each (n,), by composite rigid bodies.

        Raises
        ------
        TooLongError
            Where they take more multiplications than `budget` has left.
        """
        given = symmetric(self.size + len(self.sums), self.squares)
        found = Composites(g, given, budget, self.named).rows_of_mass
        entries = {(i, j): x for i, row in found.items() for j, x in row.items()}
        rows = symmetric(self.size, entries)
        return tuple(SparseVector(g, self.size, row) for row in rows)

    def product(self, g: Graph, x: Sequence[int]) -> list[int]:
        """Return M x (n,) for nodes x (n,), by sums along the chains and back."""
        found = [*x, *(g.zero for _ in self.sums)]
        for k, form in self.named.items():
            found[k] = g.product_sum((c, found[i]) for i, c in form.items())
        forces: Vector = {}
        for (i, j), weight in self.squares.items():
            for a, b in {(i, j), (j, i)}:
                add_to(g, forces, a, g.call("mul", weight, found[b]))
        for k, form in reversed(self.named.items()):
            for i, c in form.items():
                add_to(g, forces, i, g.call("mul", c, forces.get(k, g.zero)))
        return [forces.get(j, g.zero) for j in range(self.size)]

    def sizes(self, g: Graph, x: Sequence[int], moving: Collection[str]) -> list[int]:
        """Return nodes of the sums over j of |M_ij| x_j (n,): scales of rounding.

        Bounds of the rounding errors of the factors of M are included.

        Parameters
        ----------
        x : sequence of int, length n
            Nodes of nonnegative values.
        moving : collection of str
            The names of the variables that change along a motion.
        """
        bounds = roundings(g, self.nodes, moving, set(moving) - {"t"})
        rounded = dict(zip(self.nodes, bounds, strict=True))

        def size(node: int) -> int:
            return g.call("add", g.call("abs", node), rounded[node])

        sums = ({i: size(c) for i, c in form.items()} for form in self.sums)
        squares = {key: size(weight) for key, weight in self.squares.items()}
        return self._replace(sums=tuple(sums), squares=squares).product(g, x)

    def groups(self) -> list[tuple[list[int], list[int]]]:
        """Return the parts of M: their nodes, and the coordinates that these couple.

        Coordinates are given by their indices. Each coordinate also has a part of its
        own, without nodes.
        """
        found = [(list[int](), [j]) for j in range(self.size)]
        first = [*range(self.size)]  # one coordinate in each unknown
        for form in self.sums:
            coupled = [first[i] for i in form]
            found.append(([*form.values()], coupled))
            first.append(coupled[0])
        pairs = self.squares.items()
        return [*found, *(([node], [first[i], first[j]]) for (i, j), node in pairs)]

    def neighbours(self) -> list[set[int]]:
        """Return the sparsity pattern of M.

        It has, for each velocity, the velocities that are coupled with it.
        """
        reach = [{j} for j in range(self.size)]
        for form in self.sums:
            reach.append(set().union(*(reach[i] for i in form)))
        neighbours = [set[int]() for _ in reach]
        for i, j in self.squares:
            neighbours[i] |= reach[j]
            neighbours[j] |= reach[i]
        for k, form in reversed(self.named.items()):
            for i in form:
                neighbours[i] |= neighbours[k]
        return neighbours[: self.size]


class _NotFoundError(Exception):
    """L is not recognized as quadratic in sums of velocities."""


def chains(
    g: Graph,
    lagrangian: int,
    rates: Sequence[int],
    names: Collection[str],
    moving: Collection[str] = (),
) -> Chains | None:
    """Write the quadratic part of L with nested sums of the velocities.

    Sums become unknowns where they occur more than once, or in a square or product.

    Parameters
    ----------
    g : Graph
    lagrangian : int
        The node of L.
    rates : sequence of int, length n
        The nodes of the velocities.
    names : collection of str
        The names of the velocities.
    moving : collection of str
        The names of variables that vary along a motion. A multiple of a single velocity
        counts as a sum if it occurs in a product and its coefficient depends on one of
        these variables.

    Returns
    -------
    Chains or None
        None where L is not recognized as a polynomial of at most second degree in the
        velocities.
    """
    cone = g.cone([lagrangian])
    found = g.degrees(cone, names)
    if found[-1] is None or found[-1].most > 2:
        return None
    degrees = {
        n: HIGHER if d is None else int(min(HIGHER, max(d.most, FLAT)))
        for n, d in zip(cone, found, strict=True)
    }
    try:
        products = _products(g, cone, degrees)
        uses = Counter(a for pair in products for a in set(pair))
        parts = _parts(g, cone, degrees, uses, set(rates))
    except _NotFoundError:
        return None
    squared, moving = {a for pair in products for a in pair}, frozenset(moving)
    forms = {v: {j: g.one} for j, v in enumerate(rates)}
    sums: dict[int, Vector] = {}
    for n in sorted(parts):
        form = _joined(g, [(s, forms[a]) for a, s in parts[n]])
        several = len(form) > 1 and (uses[n] > 1 or n in squared)
        turning = n in squared and not moving.isdisjoint(g.depends(form.values()))
        if several or turning:
            sums[n], form = form, {len(rates) + len(sums): g.one}
        forms[n] = form
    squares: dict[tuple[int, int], int] = {}
    for (a, b), weight in products.items():
        for (i, one), (j, other) in product(forms[a].items(), forms[b].items()):
            term = g.call("mul", weight, g.call("mul", one, other))
            if i == j:
                term = g.call("mul", g.constant(2.0), term)
            key = min(i, j), max(i, j)
            squares[key] = g.call("add", squares.get(key, g.zero), term)
    return Chains(len(rates), tuple(sums.values()), squares, tuple(sums))


def _joined(g: Graph, parts: Sequence[tuple[int, Vector]]) -> Vector:
    """Return the sum of scale * vector over the pairs (scale, vector) `parts`.

    Entries that are 0 are left out.
    """
    total = Vector()
    for scale, form in parts:
        for i, factor in form.items():
            add_to(g, total, i, g.call("mul", scale, factor))
    return {i: node for i, node in total.items() if node != g.zero}


def _products(
    g: Graph, cone: Sequence[int], degrees: Mapping[int, int]
) -> dict[tuple[int, int], int]:
    """Write L as a sum of products of two affine expressions; return the products.

    cone : the nodes of L, in order of evaluation, L last.
    degrees : node -> its degree in the velocities.

    Returns
    -------
    dict
        (a, b), nodes of the affine factors, a <= b -> the coefficient of a b: a node.
    """
    weights = {cone[-1]: g.one}
    found: dict[tuple[int, int], int] = {}
    for n in reversed(cone):
        weight = weights.pop(n, g.zero)
        if weight == g.zero or degrees[n] < HIGHER:
            continue
        factors = _factors(g, n, degrees)
        if factors is not None:
            found[factors] = g.call("add", found.get(factors, g.zero), weight)
            continue
        for a, scale in _slopes(g, n, degrees):
            add_to(g, weights, a, g.call("mul", weight, scale))
    return found


def _factors(g: Graph, n: int, degrees: Mapping[int, int]) -> tuple[int, int] | None:
    """Return the two nodes, affine in velocities, whose product is `n`, or None.

    degrees : node -> its degree in the velocities.
    """
    args = g.args[n]
    if g.ops[n] == "pow" and g.value(args[1]) == 2.0:
        args = (args[0], args[0])
    elif g.ops[n] != "mul":
        return None
    if all(degrees[a] == AFFINE for a in args):
        return min(args), max(args)
    return None


def _parts(
    g: Graph,
    cone: Sequence[int],
    degrees: Mapping[int, int],
    uses: Counter[int],
    ends: Collection[int],
) -> dict[int, list[tuple[int, int]]]:
    """Return the linear terms of each affine node in use.

    The result maps the node to its pairs (node, coefficient), see `_slopes`.

    cone : the nodes below L, in order of evaluation.
    degrees : node -> its degree in the velocities.
    uses : node -> number of its uses, to which the uses of the terms are added in
        place.
    ends : nodes that are not expanded.
    """
    found = {}
    for n in reversed(cone):
        if uses[n] and n not in ends:
            found[n] = _slopes(g, n, degrees)
            uses.update(a for a, _ in found[n])
    return found


def _slopes(g: Graph, n: int, degrees: Mapping[int, int]) -> list[tuple[int, int]]:
    """Return the terms of an affine node `n`: pairs (node, coefficient).

    Terms without velocities are left out.

    degrees : node -> its degree in the velocities.

    Raises
    ------
    _NotFoundError
        Where `n` is not linear in its arguments that depend on velocities.
    """
    op, args = g.ops[n], g.args[n]
    moving = [a for a in args if degrees[a] != FLAT]
    linear = op in ("add", "sub", "neg") or (op == "mul" and len(moving) == 1)
    if not linear and not (op == "div" and moving == [args[0]]):
        raise _NotFoundError
    return [(a, slope) for a, slope in local_slopes(g, n) if a in moving]


# Operations per velocity and per term of a sum; bodies on chains take some tens.
MOST_OPERATIONS = 100


class Composite(Factorisation):
    """Factorisation whose pivots are composite inertias, the diagonal of M.

    The composite inertia of a joint is that of all bodies beyond it as one rigid body.
    This is the composite-rigid-body algorithm (Featherstone, chapter 6): sums are
    substituted, and unknowns are removed without elimination.
    """

    def _eliminate(self, k: int) -> Collection[int]:
        own, row = self._removed(k)
        self.pivots[k], self.columns[k] = (own, own), {}
        return row


class Composites(Composite):
    """Elimination that yields the rows of M, as momenta of composite rigid bodies.

    Attributes
    ----------
    rows_of_mass : dict
        Velocity k -> the entries of row k of M that no earlier row has, by index.
    """

    def __init__(
        self,
        g: Graph,
        rows: Sequence[Vector],
        budget: Budget,
        sums: Mapping[int, Vector],
    ) -> None:
        self.rows_of_mass: dict[int, Vector] = {}
        super().__init__(g, rows, budget, sums)

    def _eliminate(self, k: int) -> Collection[int]:
        momentum = dict(self.rows[k])
        own = momentum.pop(k, self.g.zero)
        self.rows_of_mass[k] = {k: own, **self._in_velocities(momentum)}
        return super()._eliminate(k)

    def _in_velocities(self, row: Mapping[int, int]) -> Vector:
        """Express a linear form in velocities by substituting all nested sums.

        Sums are substituted from the outermost to the innermost.

        row : unknown (a velocity or a sum) -> node of its coefficient.
        """
        g, left = self.g, dict(row)
        queue = [-i for i in left if i in self.sums]
        heapify(queue)
        while queue:
            k = -heappop(queue)
            value = left.pop(k)
            for i, factor in self.sums[k].items():
                if i in self.sums and i not in left:
                    heappush(queue, -i)
                add_to(g, left, i, self._times(factor, value))
        return left


class ChainedMass:
    """Mass matrix M of bodies on chains, whose n^2 entries are derived on first access.

    Parameters
    ----------
    g : Graph
    found : Chains
        The factors of M, of which there are O(n).
    rows : callable
        Function that derives the rows of M.
    """

    def __init__(
        self, g: Graph, found: Chains, rows: Callable[[], tuple[SparseVector, ...]]
    ) -> None:
        self.chains = found
        self._graph, self._rows = g, rows

    @cached_property
    def diagonal(self) -> list[int]:
        """The diagonal entries M_jj (n,): nodes."""
        found = self.chains.factorisation(self._graph, Budget(), Composite)
        return [found.pivots[k][0] for k in range(self.chains.size)]

    @cached_property
    def rows(self) -> tuple[SparseVector, ...]:
        """The rows of M, each (n,)."""
        return self._rows()

    def __iter__(self) -> Iterator[SparseVector]:
        return iter(self.rows)

    def __getitem__(self, i: int) -> SparseVector:
        return self.rows[i]


def shorter_chains(
    g: Graph, lagrangian: int, rates: Sequence[int], names: Sequence[str]
) -> Chains | None:
    """Return the chains of L where these take fewer operations than the entries of M.

    Parameters
    ----------
    g : Graph
    lagrangian : int
        The node of L.
    rates : sequence of int, length n
        The nodes of the velocities.
    names : sequence of str, length n
        The names of the velocities.

    Returns
    -------
    Chains or None
    """
    degrees = g.degrees_below([lagrangian], names).items()
    if not any(g.args[n] and d is not None and d.most == 1 for n, d in degrees):
        return None  # no sums of velocities
    found = chains(g, lagrangian, rates, names)
    if found is None or not found.sums:
        return None
    terms = len(rates) + sum(map(len, found.sums))
    if sum(len(form) ** 2 for form in found.sums) > MOST_OPERATIONS * terms:
        return None  # one sum of all velocities is no chain
    budget = Budget(MOST_OPERATIONS * terms)
    try:
        found.factorisation(g, budget)
    except TooLongError:
        return None
    try:
        minimum_degree(found.neighbours(), Budget(budget.operations))
    except TooLongError:
        return found
    return None


def shorter_than_entries(g: Graph, found: Chains) -> bool:
    """Whether factors of M along chains take fewer operations than factors of entries.

    The operations for the entries of M, by composite rigid bodies, are counted with
    those for their factors.

    found : the chains.
    """
    along = Budget()
    found.factorisation(g, along)
    budget = Budget(along.operations)
    try:
        minimum_degree(found.neighbours(), budget)
        found.entries(g, budget)
    except TooLongError:
        return True
    return False


def inertial_forces(model: Model, lagrangian: int, flow: Flow) -> list[int]:
    """Return dL/dq - d/dt(dL/dq') at q'' = 0, shape (n,), as nodes.

    L is differentiated as a function of u, q and q', see the module docstring.

    lagrangian : the node of L, in which rates of frames may be written by recursion.
    flow : the variables of the motion and their rates.
    """
    g, turned = model.graph, flow.turned
    places = rates_of_places(model, lagrangian, flow)
    rates = sorted(places.keys() - set(turned.values()))
    variables = frozenset((*rates, *flow.rates, *flow.positions, *turned))
    found = slopes(g, lagrangian, variables)
    moving = [v for v in (*rates, *flow.rates) if v in found]
    changes = tangent(g, [found[v] for v in moving], flow.forward)
    weights = {v: g.call("neg", x) for v, x in zip(moving, changes, strict=True)}
    for node, rate in turned.items():  # dR/dq = dR'/dq'
        if node in found:
            add_to(g, weights, rate, found[node])
    along = pulled(g, weights, frozenset(flow.rates))
    return [
        g.call("add", found.get(q, g.zero), along.get(v, g.zero))
        for q, v in zip(flow.positions, flow.rates, strict=True)
    ]


def rates_of_places(model: Model, lagrangian: int, flow: Flow) -> dict[int, int]:
    """Return the rates of positions that occur in L or in definitions of positions.

    Positions are expressions x(q, t) without velocities, and their rates are the u of
    the module docstring. Rates that are single variables or constants are left out.

    lagrangian : the node of L.
    flow : the variables of the motion and their rates.

    Returns
    -------
    dict
        Node of a rate -> node of one position with this rate.
    """
    g = model.graph
    placed = (d.node for d in model.definitions if d.level is Level.POSITION)
    cone = g.cone([*placed, lagrangian])
    faster = g.dependent(cone, flow.velocities)
    places = [n for n in reversed(cone) if n not in faster]
    found = dict(zip(tangent(g, places, flow.forward), places, strict=True))
    return {rate: place for rate, place in found.items() if g.args[rate]}
