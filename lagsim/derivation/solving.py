"""Accelerations and multipliers in closed form, where that is short enough to read.

M q'' = f + A^T lambda is solved block by block, each by its adjugate. Where that is too
long and a closed form is insisted on, the elimination is told step by step.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import sympy as sp

from lagsim.derivation.content import Solution
from lagsim.derivation.functions import TWINS
from lagsim.derivation.inertia import without_inertia
from lagsim.derivation.names import Name
from lagsim.derivation.tidy import cost
from lagsim.derivation.translation import number
from lagsim.language.disjoint_sets import DisjointSets
from lagsim.language.sparse import TooLongError
from lagsim.language.symbolic import symbol, to_sympy
from lagsim.mechanics.ldl import Elimination

if TYPE_CHECKING:
    from collections.abc import Sequence

    from lagsim.derivation.content import Condition
    from lagsim.derivation.translation import Translation

Matrix = list[list[Any]]

# Symbols and operations in one acceleration that is still read, not only looked at.
READABLE = 130
# Larger blocks have adjugates that nobody reads.
LARGEST_BLOCK = 3


def solution(
    x: Translation,
    M: Matrix,
    f: list[Any],
    constraints: Sequence[Condition],
    notes: list[str],
    *,
    insist: bool,
) -> Solution | None:
    """Give accelerations and multipliers, or None where they are too long."""
    found = _closed(x, M, f, constraints)
    if found is not None and _short(found):
        return found
    why = _no_steps(x, constraints, insist=insist)
    if not why:
        try:
            return _stepwise(x, M, f, constraints)
        except TooLongError:
            why = (
                "the accelerations in closed form take thousands of steps; "
                "`--format python` gives the functions that are solved for them"
            )
    notes.append(why)
    return None


def _no_steps(x: Translation, constraints: Sequence[Condition], *, insist: bool) -> str:
    """Say why the elimination is not told step by step; nothing where it is."""
    if without_inertia(x.equations) is not None:
        return "M is not positive definite: it is not solved for the accelerations"
    if any(c.law for c in constraints):
        contact = any(c.kind == "one-sided" for c in constraints)
        what = "contacts" if contact else "constraints"
        return f"the accelerations are left out: {what} come and go"
    if not insist:
        return "the accelerations are too long to be read; `--solve` gives them"
    return ""


def _short(found: Solution) -> bool:
    parts = (*found.accelerations, *found.multipliers)
    return all(cost(e) <= READABLE for e in parts)


def _closed(
    x: Translation, M: Matrix, f: list[Any], constraints: Sequence[Condition]
) -> Solution | None:
    inverse = inverted(x, M)
    if inverse is None:
        return None
    right = [
        fj
        + sp.Add(*(c.A[j] * s for c, s in zip(constraints, x.multipliers, strict=True)))
        for j, fj in enumerate(f)
    ]
    accelerations = tuple(inverse.times(right))
    if any(c.law for c in constraints):
        return Solution(accelerations, ())
    multipliers = multipliers_of(x, inverse, f, constraints)
    return None if multipliers is None else Solution(accelerations, tuple(multipliers))


class Inverse:
    """The inverse of a matrix, as adjugates over determinants of its blocks."""

    def __init__(
        self, x: Translation, blocks: list[tuple[list[int], Matrix, Any]], size: int
    ) -> None:
        self.x, self.blocks, self.size = x, blocks, size

    def times(self, right: Sequence[Any]) -> list[Any]:
        """Give the inverse times a vector, each entry as one fraction."""
        out = [sp.S.Zero] * self.size
        for indices, adjugate, determinant in self.blocks:
            for i, row in zip(indices, adjugate, strict=True):
                total = sp.Add(
                    *(a * right[j] for a, j in zip(row, indices, strict=True))
                )
                out[i] = quotient(self.x, total, determinant)
        return out


def quotient(x: Translation, over: Any, under: Any) -> Any:
    """Give a tidy fraction."""
    whole = x.tidy.one_fraction(under)
    if any(part.is_Add for part in sp.Mul.make_args(whole)):
        return x.tidy.one_fraction(over) / whole
    return x.tidy(over / whole, factored=True)


def inverted(x: Translation, M: Matrix) -> Inverse | None:
    """Give the inverse, or None where a block is too large or singular."""
    blocks = []
    for indices in _connected(M):
        if len(indices) > LARGEST_BLOCK:
            return None
        part = [[M[i][j] for j in indices] for i in indices]
        determinant = x.tidy(_determinant(part), factored=True)
        if determinant == 0:
            return None
        tidy = [[x.tidy(e) for e in row] for row in _adjugate(part)]
        blocks.append((indices, tidy, determinant))
    return Inverse(x, blocks, len(M))


def _determinant(M: Matrix) -> Any:
    """Expand by the first row; sympy's own would look for common factors on the way."""
    if not M:
        return sp.S.One
    return sp.Add(*((-1) ** j * e * _determinant(_without(M, 0, j))
                    for j, e in enumerate(M[0])))  # fmt: skip


def _adjugate(M: Matrix) -> Matrix:
    size = range(len(M))
    return [
        [(-1) ** (i + j) * _determinant(_without(M, j, i)) for j in size] for i in size
    ]


def _without(M: Matrix, i: int, j: int) -> Matrix:
    return [row[:j] + row[j + 1 :] for k, row in enumerate(M) if k != i]


def _connected(M: Matrix) -> list[list[int]]:
    """Give the blocks of M: which rows hang together."""
    found = DisjointSets(len(M))
    for i, row in enumerate(M):
        for j in range(i):
            if row[j] != 0:
                found.merge(i, j)
    return found.sets()


def multipliers_of(
    x: Translation, inverse: Inverse, f: list[Any], constraints: Sequence[Condition]
) -> list[Any] | None:
    """Give lambda = (A M^-1 A^T)^-1 (b - A M^-1 f), or None where that is too large."""
    if not constraints:
        return []
    small = gram(x, inverse, constraints)
    if small is None:
        return None
    free = inverse.times(f)
    return small.times(
        [x.tidy(c.b - dot(c.A, free), factored=True) for c in constraints]
    )


def gram(
    x: Translation, inverse: Inverse, constraints: Sequence[Condition]
) -> Inverse | None:
    """Give the inverse of A M^-1 A^T."""
    if len(constraints) > LARGEST_BLOCK:
        return None
    moved = [inverse.times(c.A) for c in constraints]
    return inverted(
        x, [[x.tidy(dot(c.A, z), factored=True) for z in moved] for c in constraints]
    )


def dot(a: Sequence[Any], b: Sequence[Any]) -> Any:
    """Give the sum of products."""
    return sp.Add(*(p * q for p, q in zip(a, b, strict=True)))


def _stepwise(
    x: Translation,
    M: Matrix,
    f: list[Any],
    constraints: Sequence[Condition],
) -> Solution:
    """Tell the elimination step by step: what is used twice has a name."""
    e, g = x.equations, x.g
    elimination = Elimination(e)
    known = dict(x.known)
    for entries, values in zip(e.M, M, strict=True):
        known |= dict(zip(entries, values, strict=True))
    known |= dict(zip(e.f, f, strict=True))
    for row, c in zip(e.rows, constraints, strict=True):
        known |= dict(zip(row.A, c.A, strict=True)) | {row.b: c.b}
    known |= {g.constant(v): number(v) for v in (0.0, 1.0)}
    accelerations, multipliers = elimination.motion()
    steps = _steps(x, known, [*accelerations, *multipliers])
    values = [known[n] for n in (*accelerations, *multipliers)]
    return Solution(tuple(values[: len(f)]), tuple(values[len(f) :]), tuple(steps))


def _steps(
    x: Translation, known: dict[int, Any], wanted: list[int]
) -> list[tuple[Any, Any]]:
    """Name what is used more than once; leave the value of each node in `known`."""
    g = x.g
    seen, uses = set(wanted), dict.fromkeys(wanted, 1)
    stack = list(seen)
    while stack:
        n = stack.pop()
        for a in g.args[n] if n not in known else ():
            uses[a] = uses.get(a, 0) + 1
            if a not in seen:
                seen.add(a)
                stack.append(a)
    prefix = _free_letter(x)
    steps: list[tuple[Any, Any]] = []
    for n in sorted(seen):
        if n not in known:
            known[n] = to_sympy(g, [n], known=known, twins=TWINS, number=number)[0]
        if uses[n] > 1 and cost(known[n]) > 2:
            s = symbol(f"{prefix}{len(steps) + 1}")
            x.names[s] = Name(s.name)
            x.rank[s] = 1, len(x.rank)
            steps.append((s, known[n]))
            known[n] = s
    return steps


def _free_letter(x: Translation) -> str:
    names = {s.name for s in x.names}
    letters = ("s", "k", "z", "step", "step_")
    return next(p for p in letters if not any(n.startswith(p) for n in names))
