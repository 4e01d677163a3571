"""Conserved quantities that follow from the structure: Noether's theorem, in part.

The energy function, where nothing depends on the time and nothing does work; the
momentum of a coordinate that does not appear in L; the sums of momenta and the angular
momenta that belong to shifts and turns of several coordinates under which L does not
change. The latter are looked for at random states and random parameters, so that none
is found that rests on the parameters' values.
Source: V. I. Arnold, Mathematical Methods of Classical Mechanics, sections 15 and 20.
"""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import combinations
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import sympy as sp

from lagsim.language.derivatives import gradient
from lagsim.language.evaluate import evaluate, evaluate_with_error
from lagsim.model.model import Level
from lagsim.show.content import Conserved
from lagsim.tolerances import UNIT_ROUNDOFF

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from lagsim.language.arrays import Floats
    from lagsim.language.graph import Graph
    from lagsim.mechanics.equations import Equations
    from lagsim.show.content import Condition, Line
    from lagsim.show.symbols import Translation


# More shifts and turns than this are not looked through.
MOST_GENERATORS = 250
# A product is multiplied out to so many terms at most.
MOST_TERMS = 64
# What vanishes at all samples leaves this much against rounding in sums of terms; what
# it is seen to do in them is no more than so many bounds of their rounding.
ROUNDING = 1e-9
LARGER = 4.0
# A term of L by so many times another is tested by itself: beside it, what the other
# changes by is rounding.
BESIDE = 1e4
# States beyond the number of unknowns, and tries for states with finite values.
SPARE, TRIES = 8, 4


def conserved_quantities(
    x: Translation,
    lagrangian: Any,
    dL_dt: Any,
    dL_dq: Sequence[int],
    lines: Sequence[Line],
    constraints: Sequence[Condition],
) -> list[Conserved]:
    """Give what is seen to be conserved; the slopes dL/dq (n,) are nodes."""
    found = _energy(x, lagrangian, dL_dt, lines)
    single = [
        _momentum(x, slope, j, line, constraints)
        for j, (slope, line) in enumerate(zip(dL_dq, lines, strict=True))
    ]
    found += [c for c in single if c is not None]
    ignorable = {j for j, c in enumerate(single) if c is not None}
    samples = _Samples(x.equations)
    found += _symmetries(x, samples, lines, constraints, ignorable)
    return [samples.named(x, c) for c in found]


def _energy(
    x: Translation, lagrangian: Any, dL_dt: Any, lines: Sequence[Line]
) -> list[Conserved]:
    e, g = x.equations, x.g
    if any(row.transport != g.zero for row in e.rows) or e.laws:
        return []
    worked = (line.terms["Q"] * v for line, v in zip(lines, x.v, strict=True))
    if not x.tidy.is_zero(sp.Add(-dL_dt, *worked)):
        return []
    if e.energy_is_sum:
        total = sp.Add(*x.sympy([e.model.kinetic, e.model.potential], written=True))
        return [Conserved("energy", (), x.tidy(total, written=True))]
    moved = (v * line.momentum for v, line in zip(x.v, lines, strict=True))
    value = x.tidy(sp.Add(-lagrangian, *moved))
    return [Conserved("energy function", (), value)]


def _momentum(
    x: Translation,
    dL_dq: int,
    j: int,
    line: Line,
    constraints: Sequence[Condition],
) -> Conserved | None:
    """Give the momentum of coordinate j where it is conserved.

    Where dL/dq is the rate of a linear function of the positions, as in a magnetic
    field, that function is taken off.
    """
    held = any(c.A[j] != 0 or _slips(c, x.v[j]) for c in constraints)
    if held or line.terms["Q"] != 0:
        return None
    (slope,) = x.sympy([dL_dq])
    if x.free(slope) & {*x.q, x.t}:
        return None
    rates = [x.g.variable(v) for v in x.equations.velocities]
    coefficients = x.sympy(gradient(x.g, dL_dq, rates))
    if any(x.free(c) & {*x.q, *x.v, x.t} for c in coefficients):
        return None
    rest = sp.Add(*(c * v for c, v in zip(coefficients, x.v, strict=True)))
    if not x.tidy.is_zero(slope - rest):
        return None
    name = x.q[j].name
    if slope == 0:
        return Conserved("momentum", (name,), line.momentum)
    shift = sp.Add(*(c * q for c, q in zip(coefficients, x.q, strict=True)))
    return Conserved("shifted momentum", (name,), x.tidy(line.momentum - shift))


def _slips(c: Condition, v: Any) -> bool:
    return any(v in s.free_symbols for s in c.law.get("slip", ()))


def _terms_of(g: Graph, L: int) -> list[int]:
    """Give the terms that L is the sum of, products of sums multiplied out.

    So a weak term in a factor is one of them. What makes too many stays a product.
    """
    found = []
    stack = [(L, False)]
    while stack:
        node, negative = stack.pop()
        op, args = g.ops[node], g.args[node]
        if op in ("add", "sub"):
            stack += [(args[1], negative ^ (op == "sub")), (args[0], negative)]
        elif op == "neg":
            stack.append((args[0], not negative))
        else:
            terms = _multiplied_out(g, node)
            found += [g.call("neg", x) for x in terms] if negative else terms
    return found


def _multiplied_out(g: Graph, node: int) -> list[int]:
    op, args = g.ops[node], g.args[node]
    if op not in ("mul", "div"):
        return [node]
    first = _terms_of(g, args[0])
    second = _terms_of(g, args[1]) if op == "mul" else [args[1]]
    if not 1 < len(first) * len(second) <= MOST_TERMS:
        return [node]
    return [g.call(op, a, b) for a in first for b in second]


class Moves(NamedTuple):
    """Generators: coordinates that are shifted, and pairs that are turned."""

    shifts: Sequence[int]
    turns: Sequence[tuple[int, int]]


class _Samples:
    """Random states and parameters, and what the graph gives there.

    Attributes
    ----------
    slopes : list of int
        Of each part of L, its slopes in the coordinates and in the velocities (2 n,);
        of each constraint its row, and zeros.
    """

    def __init__(self, e: Equations) -> None:
        self.e = e
        g = e.graph
        self._random = np.random.default_rng(7)
        parts = self._parts_of_one_size()
        state = [g.variable(name) for name in (*e.q, *e.velocities)]
        self.slopes = [x for part in parts for x in gradient(g, part, state)]
        for row in e.rows:
            self.slopes += [*row.A, *[g.zero] * len(e.q)]

    def _parts_of_one_size(self) -> list[int]:
        """Give sums of terms of L: T and V apart, and what is small beside others.

        Parameters are near 1 here, but numbers in the file are as they are.
        """
        e, g = self.e, self.e.graph
        state = {*e.q, *e.velocities}
        terms = [x for x in _terms_of(g, e.model.lagrangian) if g.depends([x]) & state]
        moving = g.dependent(terms, e.velocities)
        at = self.values()
        sizes = np.abs(evaluate(g, terms, at))
        found: list[int] = []
        for with_velocities in (True, False):
            chosen = [
                k for k, x in enumerate(terms) if (x in moving) == with_velocities
            ]
            before = math.nan
            for k in sorted(chosen, key=lambda k: sizes[k]):
                if sizes[k] <= BESIDE * before:
                    found[-1] = g.call("add", found[-1], terms[k])
                else:
                    found.append(terms[k])
                before = sizes[k]
        return found

    def values(self) -> dict[str, float]:
        """Give a state and parameters, near 1 so that roots and logarithms exist."""
        e, random = self.e, self._random
        names = [p.name for p in e.model.parameters]
        signs = {p.name: math.copysign(1.0, p.value) for p in e.model.parameters}
        values = {n: signs[n] * random.uniform(0.5, 2.0) for n in names}
        state = ("t", *e.q, *e.velocities)
        return values | {n: random.uniform(0.3, 1.5) for n in state}

    def named(self, x: Translation, c: Conserved) -> Conserved:
        """Say which definition of the file it is, if one is."""
        e = self.e
        defined = [d for d in e.model.definitions if d.level is not Level.OUTPUT]
        alike = {d.name for d in defined}
        node = x.node(c.value, x.g.zero)
        seen = 0
        for _ in range(3 * TRIES):
            if not alike or seen == TRIES:
                break
            at = self.values()
            value, *found = evaluate(e.graph, [node, *(d.node for d in defined)], at)
            if not math.isfinite(value):
                continue
            seen += 1
            alike &= {
                d.name
                for d, y in zip(defined, found, strict=True)
                if abs(y - value) <= ROUNDING * (abs(value) + abs(y))
            }
        if not alike or seen < TRIES:
            return c
        name = next(d.name for d in defined if d.name in alike)
        return replace(c, definition=name)


def _symmetries(
    x: Translation,
    samples: _Samples,
    lines: Sequence[Line],
    constraints: Sequence[Condition],
    ignorable: set[int],
) -> list[Conserved]:
    """Give what belongs to shifts of several coordinates, and to turns of pairs."""
    n = len(lines)
    shifts = [j for j in range(n) if j not in ignorable]
    turns = list(combinations(range(n), 2))
    many = len(shifts) + len(turns)
    if n < 2 or many > MOST_GENERATORS or x.equations.laws:
        return []
    moves = Moves(shifts, turns)
    rows = _sampled(x.equations, samples, moves)
    if rows is None:
        return []
    momenta = [line.momentum for line in lines]
    found = []
    for vector in _exact(samples, moves, _simple_null_vectors(rows)):
        change = _generator(x, moves, vector)
        if not _holds(x, lines, constraints, change):
            continue
        moved = {shifts[k] for k in range(len(shifts)) if vector[k]}
        turned = {
            j for k, pair in enumerate(turns) if vector[len(shifts) + k] for j in pair
        }
        kind = "angular momentum" if turned else "total momentum"
        of = tuple(x.q[j].name for j in sorted(moved | turned))
        found.append(Conserved(kind, of, x.tidy(_along(change, momenta))))
    return found


def _sampled(e: Equations, samples: _Samples, moves: Moves) -> Floats | None:
    """Give the change of L and of each constraint under each generator, at samples.

    (k, generators), each row scaled by its largest; None where there are no values.
    """
    wanted = len(moves.shifts) + len(moves.turns) + SPARE
    rows: list[Floats] = []
    for _ in range(TRIES * wanted):
        at = samples.values()
        flat = np.array(evaluate(e.graph, samples.slopes, at))
        if np.all(np.isfinite(flat)):
            of_each = flat.reshape(-1, 2 * len(e.q))
            rows += [np.sum(_changes(e, x, at, moves), axis=1) for x in of_each]
        if 2 * len(e.q) * len(rows) >= wanted * len(samples.slopes):
            break
    else:
        return None
    found = np.array(rows)
    sizes = np.max(np.abs(found), axis=1, initial=0.0)
    return np.asarray(found[sizes > 0] / sizes[sizes > 0][:, None])


def _changes(
    e: Equations, slopes: Floats, at: Mapping[str, float], moves: Moves
) -> Floats:
    """Give what slopes (2 n,) make of each generator, in terms: (generators, 4)."""
    n, shifts = len(e.q), list(moves.shifts)
    first, second = np.array(moves.turns).T
    found = np.zeros((len(shifts) + len(first), 4))
    found[: len(shifts), 0] = slopes[shifts]  # a shift leaves the velocities alone
    for level, names in enumerate((e.q, e.velocities)):
        slope, x = slopes[level * n :][:n], np.array([at[name] for name in names])
        found[len(shifts) :, 2 * level] = slope[second] * x[first]
        found[len(shifts) :, 2 * level + 1] = -slope[first] * x[second]
    return found


def _exact(
    samples: _Samples, moves: Moves, vectors: Sequence[Sequence[int]]
) -> list[Sequence[int]]:
    """Give those vectors along which each part of L changes by its rounding at most.

    However weak what breaks the symmetry is, beside a large force or in the argument of
    a function. All are looked at together: the graph is evaluated TRIES times.
    """
    if not vectors:
        return []
    e, weights, seen = samples.e, np.array(vectors, float), 0
    kept = np.ones(len(vectors), bool)
    for _ in range(TRIES * SPARE):
        at = samples.values()
        exact = {name: (value, 0.0) for name, value in at.items()}
        found = np.array(evaluate_with_error(e.graph, samples.slopes, exact))
        if not np.all(np.isfinite(found)):
            continue
        seen += 1
        for slopes, errors in found.T.reshape(2, -1, 2 * len(e.q)).swapaxes(0, 1):
            terms = _changes(e, slopes, at, moves)
            noise = np.abs(_changes(e, errors, at, moves))
            bounds = np.abs(weights) @ (noise + UNIT_ROUNDOFF * np.abs(terms))
            kept &= np.abs(weights @ terms.sum(1)) <= LARGER * bounds.sum(1)
        if seen == TRIES:
            return [v for v, stays in zip(vectors, kept, strict=True) if stays]
    return []


def _simple_null_vectors(rows: Floats) -> list[list[int]]:
    """Give a basis of the null space, those of its vectors made of -1, 0 and 1."""
    size = rows.shape[1]
    basis = np.eye(size)
    if len(rows):
        # The triangular factor has the same null space, and is small.
        _, sizes, right = np.linalg.svd(np.linalg.qr(rows, mode="r"))
        basis = right[int(np.sum(sizes > ROUNDING * sizes[0])) :].copy()
    pivots: list[int] = []
    for row in range(len(basis)):  # to echelon form, from the first column on
        left = [c for c in range(size) if c not in pivots]
        column = next(c for c in left if np.max(np.abs(basis[row:, c])) > ROUNDING**0.5)
        best = row + int(np.argmax(np.abs(basis[row:, column])))
        basis[[row, best]] = basis[[best, row]]
        basis[row] /= basis[row, column]
        for other in range(len(basis)):
            if other != row:
                basis[other] -= basis[other, column] * basis[row]
        pivots.append(column)
    whole = np.rint(basis)
    return [
        [int(c) for c in w]
        for w, b in zip(whole, basis, strict=True)
        if np.max(np.abs(w - b)) < ROUNDING**0.5 and np.max(np.abs(w)) == 1
    ]


def _generator(x: Translation, moves: Moves, vector: Sequence[int]) -> dict[int, Any]:
    """Give dq, without zeros."""
    change: dict[int, list[Any]] = {}
    for j, c in zip(moves.shifts, vector, strict=False):
        change.setdefault(j, []).append(sp.Integer(c))
    for (i, k), c in zip(moves.turns, vector[len(moves.shifts) :], strict=True):
        if c:
            change.setdefault(k, []).append(c * x.q[i])
            change.setdefault(i, []).append(-c * x.q[k])
    sums = {j: sp.Add(*terms) for j, terms in sorted(change.items())}
    return {j: dq for j, dq in sums.items() if dq != 0}


def _along(change: Mapping[int, Any], row: Sequence[Any]) -> Any:
    """Give the sum of the row's entries times dq."""
    return sp.Add(*(row[j] * dq for j, dq in change.items()))


def _holds(
    x: Translation,
    lines: Sequence[Line],
    constraints: Sequence[Condition],
    change: Mapping[int, Any],
) -> bool:
    """Tell whether forces and constraints are seen to respect the symmetry."""
    rows = [[line.terms["Q"] for line in lines], *(c.A for c in constraints)]
    return all(x.tidy.is_zero(_along(change, row)) for row in rows)
