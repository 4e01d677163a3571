"""Coordinates that holonomic constraints give, expressed by the others.

A constraint a q_e + r(q, t) = 0 with a constant a gives q_e = Q(q, t) of the others;
another one may be of that kind only after that. In all, q_E = Q(q, t) of those left,
q_E' = J q' + Q_t and q_E'' = J q'' + c. With B = (1, J) the full q'' is B q'' + (0, c),
and the equations left are

    B^T M B q'' = B^T (f - M (0, c)) + (A B)^T lambda,      A B q'' = b - A (0, c)

Rows E of the full ones give the multipliers: A_EE^T lambda_E = M q'' - f - A^T lambda.

Source: E. Hairer and G. Wanner, Solving Ordinary Differential Equations II, section
VII.1 (state-space form).
"""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

from lagsim.language.derivatives import tangent
from lagsim.language.evaluate import evaluate
from lagsim.language.functions import OPERATIONS
from lagsim.mechanics.constraints import Flow
from lagsim.mechanics.reduction._equations import (
    minus,
    of_those_left,
    plus,
    substituted,
    vector,
)

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from lagsim.language.arrays import Floats
    from lagsim.language.graph import Graph
    from lagsim.mechanics.constraints import Row
    from lagsim.mechanics.equations import Equations

# A coordinate is given by a constraint only if it does not move much more, in the
# metric of M, than those that it is expressed by: their errors are its own.
STEEPEST = 1e3


class Pair(NamedTuple):
    """A constraint and the coordinate it gives: indices, and the expression."""

    row: int
    coordinate: int
    value: int


def pairs(e: Equations, values: Mapping[str, float], sizes: Floats) -> list[Pair]:
    """Find what can be eliminated, one after the other, sparse constraints first.

    Parameters
    ----------
    values
        Of all variables at the start. Whether a factor is zero depends on them.
    sizes : (n,)
        The square roots of the diagonal of M, or what stands in their place.
    """
    return _Search(e, values, sizes).run()


class _Search:
    def __init__(
        self, e: Equations, values: Mapping[str, float], sizes: Floats
    ) -> None:
        self.e, self.g, self.values, self.sizes = e, e.graph, values, sizes
        self.flow = Flow(e.graph, e.q, e.velocities)
        self.moving = frozenset((*e.q, *e.velocities, "t"))
        self.mass = Counter(j for row in e.M for j in row.entries)
        self.A = {k: row.A.entries for k, row in enumerate(e.rows)}
        self.residuals = {
            k: row.residual for k, row in enumerate(e.rows) if usable(e.graph, row)
        }
        self.slopes = {k: self._candidates(k) for k in self.residuals}

    def run(self) -> list[Pair]:
        found: list[Pair] = []
        while len(found) < len(self.e.q) - 1:  # one coordinate is always left
            best = self._best()
            if best is None:
                break
            found.append(self._solve(*best))
        return found

    def _candidates(self, k: int) -> dict[int, float]:
        """Give the coordinates that row k gives, and how steep it is in each."""
        A = self.A[k]
        numbers = evaluate(self.g, A.values(), self.values)
        steep = {c: abs(x) / self.sizes[c] for c, x in zip(A, numbers, strict=True)}
        most = max(steep.values(), default=0.0)
        return {
            c: steepness / most
            for c, steepness in steep.items()
            if steepness * STEEPEST > most
            and math.isfinite(most)
            and not self.g.depends([A[c]]) & self.moving
        }

    def _best(self) -> tuple[int, int] | None:
        """Give the row and the coordinate that make the least fill."""
        held = Counter(c for A in self.A.values() for c in A)
        keys = [
            # What stands in one relation only leaves the others as they are.
            (
                held[c],
                (len(self.A[k]) - 1) * (held[c] + self.mass[c] - 2),
                -steepness,
                k,
                c,
            )
            for k, steep in self.slopes.items()
            for c, steepness in steep.items()
        ]
        return min(keys)[3:] if keys else None

    def _solve(self, k: int, c: int) -> Pair:
        """Take row k for coordinate c, and c out of the other rows."""
        g = self.g
        q = g.variable(self.e.q[c])
        rest = g.substitute([self.residuals.pop(k)], {q: g.zero})[0]
        value = g.call("neg", g.call("div", rest, self.A[k][c]))
        del self.A[k], self.slopes[k]
        for other in [i for i, A in self.A.items() if c in A]:
            if other not in self.residuals:
                continue
            [found] = g.substitute([self.residuals[other]], {q: value})
            self.residuals[other] = found
            self.A[other] = self.flow.gradient(g, found, by_rates=False).entries
            self.slopes[other] = self._candidates(other)
        return Pair(k, c, value)


def usable(g: Graph, row: Row) -> bool:
    """Tell whether a row may give a coordinate: it is holonomic, without switches.

    Where the rate of a relation jumps, all velocities do: that is an impact.
    """
    rows = (OPERATIONS.get(g.ops[n]) for n in g.cone([row.residual]))
    switches = any(x is not None and (x.switch or x.condition) for x in rows)
    return row.holonomic and not switches


def eliminated(e: Equations, found: Sequence[Pair]) -> tuple[Equations, dict[int, int]]:
    """Give the equations without the pairs, and what stands for their variables."""
    g = e.graph
    gone = {pair.coordinate for pair in found}
    left = [j for j in range(len(e.q)) if j not in gone]
    flow = Flow(g, [e.q[j] for j in left], [e.velocities[j] for j in left])
    given: dict[int, int] = {}
    for pair in reversed(found):
        [value] = g.substitute([pair.value], given)
        given[g.variable(e.q[pair.coordinate])] = value
    ends = [given[g.variable(e.q[pair.coordinate])] for pair in found]
    rates = tangent(g, ends, flow.forward)
    numbers = [pair.coordinate for pair in found]
    bends = dict(zip(numbers, tangent(g, rates, flow.forward), strict=True))
    J = {
        c: {
            left[i]: x for i, x in flow.gradient(g, end, by_rates=False).entries.items()
        }
        for c, end in zip(numbers, ends, strict=True)
    }
    given |= {
        g.variable(e.velocities[c]): rate
        for c, rate in zip(numbers, rates, strict=True)
    }
    full = substituted(e, given)
    accelerations = dict(bends)
    for c, along in J.items():
        for j, slope in along.items():
            moved = g.variable(f"{e.q[j]}_ddot")
            accelerations[c] = plus(g, accelerations[c], slope, moved)
    recovered = given | {
        g.variable(f"{e.q[c]}_ddot"): node for c, node in accelerations.items()
    }
    recovered |= _multipliers(full, found, accelerations)
    powers = g.substitute(full.powers, recovered)
    works = (x._replace(rate=rate) for x, rate in zip(full.works, powers, strict=True))
    reduced = replace(_projected(full, left, J, bends), works=tuple(works))
    used = {pair.row for pair in found}
    rows = [
        _row(g, row, left, J, bends) for k, row in enumerate(full.rows) if k not in used
    ]
    return replace(reduced, rows=tuple(rows)), recovered


def _projected(
    full: Equations,
    left: Sequence[int],
    J: Mapping[int, Mapping[int, int]],
    bends: Mapping[int, int],
) -> Equations:
    """Give B^T M B, B^T (f - M (0, c)) and the momenta, for the coordinates left."""
    g = full.graph
    f, momenta = list(full.f), list(full.momenta)
    M = {
        (i, j): x
        for (i, j), x in full.mass_entries.items()
        if i not in J and j not in J
    }
    for c in J:
        for j, x in full.M[c].entries.items():
            f[j] = minus(g, f[j], x, bends[c])
    for c, along in J.items():
        across = {j: x for j, x in full.M[c].entries.items() if j not in J}
        _add_products(g, M, across, along)
        for d in sorted(full.M[c].entries.keys() & J.keys()):
            for j, slope in J[d].items():
                across[j] = plus(g, across.get(j, g.zero), full.M[c][d], slope)
        _add_products(g, M, along, across)
        for i, slope in along.items():
            f[i] = plus(g, f[i], f[c], slope)
            momenta[i] = plus(g, momenta[i], momenta[c], slope)
    moved = {full.q[i] for along in J.values() for i in along}
    full = replace(full, unforced=full.unforced - moved)
    return of_those_left(full, left, M, f, momenta)


def _add_products(
    g: Graph,
    M: dict[tuple[int, int], int],
    x: Mapping[int, int],
    y: Mapping[int, int],
) -> None:
    """Add x y^T to the lower triangle of M, and what stands there to the upper one."""
    for i, a in x.items():
        for j, b in y.items():
            if j <= i:
                M[i, j] = M[j, i] = plus(g, M.get((i, j), g.zero), a, b)


def _row(
    g: Graph,
    row: Row,
    left: Sequence[int],
    J: Mapping[int, Mapping[int, int]],
    bends: Mapping[int, int],
) -> Row:
    """Give A B and b - A (0, c) of a row that is left."""
    A, b = dict(row.A.entries), row.b
    for c in sorted(A.keys() & J.keys()):
        factor = A.pop(c)
        b = minus(g, b, factor, bends[c])
        for j, slope in J[c].items():
            A[j] = plus(g, A.get(j, g.zero), factor, slope)
    return row._replace(A=vector(g, left, A), b=b)


def _multipliers(
    full: Equations, found: Sequence[Pair], accelerations: Mapping[int, int]
) -> dict[int, int]:
    """Solve A_EE^T lambda_E = M q'' - f - A^T lambda."""
    g = full.graph
    right, columns = {}, {}
    for pair in found:
        c = pair.coordinate
        node = g.call("neg", full.f[c])
        for j, entry in full.M[c].entries.items():
            moved = accelerations.get(j, g.variable(f"{full.q[j]}_ddot"))
            node = plus(g, node, entry, moved)
        right[c] = node
        columns[c] = {k: row.A[c] for k, row in enumerate(full.rows)}
    used = {pair.row for pair in found}
    for k, row in enumerate(full.rows):
        if k not in used:
            lam = g.variable(f"lambda_{row.name}")
            for c, column in columns.items():
                right[c] = minus(g, right[c], column[k], lam)
    solved = _solved(g, found, columns, right)
    return {g.variable(f"lambda_{full.rows[k].name}"): x for k, x in solved.items()}


def _solved(
    g: Graph,
    found: Sequence[Pair],
    columns: dict[int, dict[int, int]],
    right: dict[int, int],
) -> dict[int, int]:
    """Give x_k with sum of columns[c][k] x_k = right[c], the pairs as pivots."""
    for at, pair in enumerate(found):
        pivots = columns[pair.coordinate]
        for c in (p.coordinate for p in found[at + 1 :]):
            factor = columns[c][pair.row]
            if factor == g.zero:
                continue
            share = g.call("div", factor, pivots[pair.row])
            right[c] = minus(g, right[c], share, right[pair.coordinate])
            for later in (p.row for p in found[at + 1 :]):
                columns[c][later] = minus(g, columns[c][later], share, pivots[later])
    x: dict[int, int] = {}
    for pair in reversed(found):
        node = right[pair.coordinate]
        for k, value in x.items():
            node = minus(g, node, columns[pair.coordinate][k], value)
        x[pair.row] = g.call("div", node, columns[pair.coordinate][pair.row])
    return x
