"""Gauss's principle of least constraint, for equality constraints that always hold.

q'' minimises G = (q'' - a)^T M (q'' - a)/2 subject to A q'' = b, where M a = f. The
constraint forces are Qc = K (A a - b) with the gain K = -A^T (A M^-1 A^T)^-1.
Source: H. P. Gavin, Generalized Coordinates, Lagrange's Equations, and Constraints,
section 13 (eqs 70-73; its multipliers are minus ours).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import sympy as sp

from lagsim.derivation.content import Gauss
from lagsim.derivation.inertia import without_inertia
from lagsim.derivation.names import Name
from lagsim.derivation.solving import READABLE, dot, gram, inverted
from lagsim.derivation.tidy import cost
from lagsim.errors import InputError, Problem
from lagsim.language.symbolic import symbol

if TYPE_CHECKING:
    from collections.abc import Sequence

    from lagsim.derivation.content import Condition
    from lagsim.derivation.translation import Translation


def gauss(
    x: Translation,
    M: list[list[Any]],
    f: list[Any],
    constraints: Sequence[Condition],
    notes: list[str],
) -> Gauss:
    """Give Gauss's principle.

    Raises
    ------
    InputError
        Where M is singular, so that there is no unconstrained acceleration.
    """
    if any(c.law for c in constraints):
        notes.append("Gauss's principle is given for the equality constraints")
    constraints = [c for c in constraints if not c.law]
    lacking = without_inertia(x.equations)
    if lacking is not None:
        raise InputError([singular(lacking)])
    free = [_unconstrained(x, q.name, j) for j, q in enumerate(x.q)]
    apart = [a - b for a, b in zip(x.a, free, strict=True)]
    pairs = (
        M[i][j] * apart[i] * apart[j] * (1 if i == j else 2)
        for i in range(len(M))
        for j in range(i + 1)
    )
    G = sp.Add(*(p / 2 for p in pairs))
    inverse = inverted(x, M)
    a = inverse.times(f) if inverse is not None else None
    a = a if a is not None and _readable(a) else None
    K = Qc = None
    small = gram(x, inverse, constraints) if inverse is not None else None
    if small is not None and constraints:
        K, Qc = _gain(x, small, constraints, free)
    long = [
        *(["a = M^-1 f"] if a is None else []),
        *(["the gain K"] if constraints and K is None else []),
    ]
    if long:
        notes.append(f"left out, for it is too long to be read: {' and '.join(long)}")
    return Gauss(tuple(a) if a else None, G, K, Qc)


def _gain(
    x: Translation, small: Any, constraints: Sequence[Condition], free: list[Any]
) -> tuple[Any, Any]:
    n, m = len(x.q), len(constraints)
    K = tuple(
        tuple(-e for e in small.times([c.A[j] for c in constraints])) for j in range(n)
    )
    if not all(_readable(row) for row in K):
        return None, None
    missed = [x.tidy(dot(c.A, free) - c.b) for c in constraints]
    names = [x.tidy(sp.Add(*(K[j][i] * missed[i] for i in range(m)))) for j in range(n)]
    return K, tuple(names)


def _readable(parts: Sequence[Any]) -> bool:
    return all(cost(e) <= READABLE for e in parts)


def _unconstrained(x: Translation, q: str, j: int) -> Any:
    s = symbol(f"a.{q}")
    x.names[s] = Name(q, 0, "unconstrained")
    x.rank[s] = 4, len(x.q) + j
    return s


def singular(coordinate: str) -> Problem:
    """Give the fault of a model without unconstrained acceleration."""
    return Problem(
        "singular-mass",
        "Gauss's principle needs the acceleration without constraints, M^-1 f, and the "
        "mass matrix of this model is singular: a direction has no inertia",
        hint=f"such as along `{coordinate}`; give every coordinate some mass",
    )
