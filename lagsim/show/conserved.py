"""Conserved quantities that follow from the structure: Noether's theorem, in part.

The energy function, if no term depends on the time and no force does work; the momentum
of a coordinate that does not appear in the Lagrangian L; sums of momenta and angular
momenta for translations and rotations of several coordinates under which L is
invariant: the null space of the changes of L by each generator, written as sums of
products. Source: V. I. Arnold, Mathematical Methods of Classical Mechanics, sections 15
and 20.
"""

from __future__ import annotations

import decimal
import math
from fractions import Fraction
from itertools import combinations
from typing import TYPE_CHECKING, Any

import numpy as np
import sympy as sp
from sympy.polys.matrices import DomainMatrix

from lagsim.language.derivatives import gradient
from lagsim.language.evaluate import evaluate
from lagsim.language.sparse import Budget, TooLongError
from lagsim.model.model import Level
from lagsim.show.tidy import MOST_PRODUCTS, Sums
from lagsim.tolerances import COMPUTED_ZERO, TERM_ROUNDOFF

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from lagsim.language.forms import Terms
    from lagsim.show.symbols import Translation

    Part = dict[str, Any]  # a part of a document
    # indices of a coordinate that is shifted, or of two that are rotated
    Generator = tuple[int, ...]


# Largest number of shifts and rotations that are tested.
MOST_GENERATORS = 250
# Significant digits of numbers of the file, and of products of such numbers, after
# rounding.
DIGITS = decimal.Context(prec=15)
# Number of states at which a definition of the file is compared with the conserved
# quantity.
STATES = 12


def conserved_quantities(
    x: Translation,
    lagrangian: Any,
    dL_dt: Any,
    dL_dq: Sequence[int],
    lines: Sequence[Part],
    constraints: Sequence[Part],
) -> list[Part]:
    """Return the conserved quantities that are found, as entries of the document.

    Parameters
    ----------
    lagrangian, dL_dt : sympy expressions
        L and its derivative by t.
    dL_dq : sequence of int, length n
        Nodes of the derivatives of L by the coordinates.
    lines, constraints : sequence of dict
        The entries of the document for the equations of motion and the constraints.
    """
    found = _energy(x, lagrangian, dL_dt, lines)
    single = [
        _momentum(x, slope, j, line, constraints)
        for j, (slope, line) in enumerate(zip(dL_dq, lines, strict=True))
    ]
    found += [c for c in single if c is not None]
    shifts = [(j,) for j, c in enumerate(single) if c is None]
    generators = [*shifts, *combinations(range(len(lines)), 2)]
    if len(lines) > 1 and len(generators) <= MOST_GENERATORS and not x.equations.laws:
        momenta = [line["momentum"] for line in lines]
        functions = [
            (x.sympy(dL_dq), momenta),
            *((k["A"], ()) for k in constraints),
            ([line["Q"] for line in lines], ()),
        ]
        found += _symmetries(x, generators, functions, momenta)
    return _named(x, found)


def evident(x: Translation) -> list[Part]:
    """Return the conserved quantities that are found without differentiation.

    They are the energy, and the momenta of coordinates that the Lagrangian does not
    contain; none in a model with laws or events. Each is an entry (dict) of the list
    of conserved quantities in the output of `lagsim derive`.

    x : the equations as sympy expressions.
    """
    e = x.equations
    if e.laws or e.model.events:
        return []
    found = []
    if not e.works:
        kind = "energy" if e.energy_is_sum else "energy function"
        found.append(_part(kind, (), x.sympy([e.energy], written=True)[0]))
    for j, q in enumerate(e.q):
        if q in e.unforced and all(row.A[j] == x.g.zero for row in e.rows):
            found.append(_part("momentum", (q,), x.sympy([e.momenta[j]])[0]))
    return _named(x, found)


def _energy(
    x: Translation, lagrangian: Any, dL_dt: Any, lines: Sequence[Part]
) -> list[Part]:
    e, g = x.equations, x.g
    if any(row.transport != g.zero for row in e.rows) or e.laws:
        return []
    worked = (line["Q"] * v for line, v in zip(lines, x.v, strict=True))
    if x.tidy(sp.Add(-dL_dt, *worked)) != 0:
        return []
    if e.energy_is_sum:
        total = sp.Add(*x.sympy([e.model.kinetic, e.model.potential], written=True))
        return [_part("energy", (), x.tidy(total, written=True))]
    moved = (v * line["momentum"] for v, line in zip(x.v, lines, strict=True))
    value = x.tidy(sp.Add(-lagrangian, *moved))
    return [_part("energy function", (), value)]


def _momentum(
    x: Translation, dL_dq: int, j: int, line: Part, constraints: Sequence[Part]
) -> Part | None:
    """Return the momentum of coordinate j as a conserved quantity; None if it is not.

    Where dL/dq is the rate of a linear function of the positions, as in a magnetic
    field, that function is taken off.

    dL_dq : the node of dL/dq.
    line : the equation of coordinate j in the document.
    constraints : the constraints in the document.
    """
    constrained = any(
        k["A"][j] != 0 or any(x.v[j] in s.free_symbols for s in k["slip"])
        for k in constraints
    )
    if constrained or line["Q"] != 0:
        return None
    (slope,) = x.sympy([dL_dq])
    if x.free(slope) & {*x.q, *x.states, x.t}:
        return None
    rates = [x.g.variable(v) for v in x.equations.velocities]
    coefficients = x.sympy(gradient(x.g, dL_dq, rates))
    if any(x.free(c) & {*x.q, *x.v, *x.states, x.t} for c in coefficients):
        return None
    rest = sp.Add(*(c * v for c, v in zip(coefficients, x.v, strict=True)))
    if x.tidy(slope - rest) != 0:
        return None
    name = x.q[j].name
    if slope == 0:
        return _part("momentum", (name,), line["momentum"])
    shift = sp.Add(*(c * q for c, q in zip(coefficients, x.q, strict=True)))
    return _part("shifted momentum", (name,), x.tidy(line["momentum"] - shift))


def _part(kind: str, of: Sequence[str], value: Any) -> Part:
    """Return a conserved quantity as an entry of the document.

    kind : `energy`, `momentum` and others.
    of : names of coordinates.
    value : expression.
    """
    return {"kind": kind, "of": of, "expression": value, "definition": None}


def _symmetries(
    x: Translation,
    generators: Sequence[Generator],
    functions: Sequence[tuple[Sequence[Any], Sequence[Any]]],
    momenta: Sequence[Any],
) -> list[Part]:
    """Return the momenta that symmetries conserve, as entries of the document.

    A symmetry is a sum of generators that changes none of the functions.

    Parameters
    ----------
    generators : sequence of tuple of int
        Translations (i,) of a coordinate, and rotations (i, j) of two coordinates.
    functions : sequence of (sequence, sequence)
        For each function its derivatives by the coordinates (n,), and by the velocities
        (n,) or ().
    momenta : sequence of sympy expressions, length n
        The momentum of each coordinate.
    """
    sums, changes = Sums(x.tidy.inner, Budget(MOST_PRODUCTS)), list[dict[int, Any]]()
    states = [[sums.power(s) for s in level] for level in (x.q, x.v)]
    try:
        for slopes in functions:
            terms = [[sums.of(_opened(e)) for e in level] for level in _cleared(slopes)]
            changes += _changes(generators, terms, states).values()
    except TooLongError:
        return []
    found = []
    for vector in _null_vectors(changes, len(generators)):
        chosen = {g: c for g, c in zip(generators, vector, strict=True) if c}
        value = sp.Add(
            *(
                c * (x.q[g[0]] * momenta[g[1]] - x.q[g[1]] * momenta[g[0]])
                if g[1:]
                else c * momenta[g[0]]
                for g, c in chosen.items()
            )
        )
        turned = any(g[1:] for g in chosen)
        kind = "angular momentum" if turned else "total momentum"
        of = tuple(x.q[j].name for j in sorted({j for g in chosen for j in g}))
        found.append(_part(kind, of, x.tidy(value)))
    return found


def _cleared(slopes: Sequence[Sequence[Any]]) -> list[list[Any]]:
    """Return the derivatives of a function, multiplied by their common denominator.

    Denominators that are products or powers without sums stay. A rotation changes
    atan2(y, x) by (x^2 + y^2)/(x^2 + y^2), for example.

    slopes : derivatives by coordinates, and by velocities.
    """
    powers: dict[Any, int] = {}
    for e in (e for level in slopes for e in level):
        for term in sp.Add.make_args(e):
            for base, power in term.as_powers_dict().items():
                if base.is_Add and power.is_Integer and power < 0:
                    powers[base] = max(powers.get(base, 0), -int(power))
    D = sp.Mul(*(base**power for base, power in powers.items()))
    if D == 1:
        return [list(level) for level in slopes]
    return [
        [sp.Add(*(D * term for term in sp.Add.make_args(e))) for e in level]
        for level in slopes
    ]


def _opened(e: Any) -> Any:
    """Return an expression with each `if` replaced by a sum over its cases.

    Each case is multiplied by the indicator, 0 or 1, of its condition.
    """

    def opened(choice: Any) -> Any:
        values, conditions = zip(*choice.args, strict=True)
        units = (
            [int(i == k) for i in range(len(conditions))]
            for k in range(len(conditions))
        )
        return sp.Add(
            *(
                value
                * sp.Piecewise(*zip(unit, conditions, strict=True), evaluate=False)
                for value, unit in zip(values, units, strict=True)
            )
        )

    return e.xreplace({choice: opened(choice) for choice in e.atoms(sp.Piecewise)})


def _changes(
    generators: Sequence[Generator],
    slopes: Sequence[Sequence[Terms]],
    states: Sequence[Sequence[int]],
) -> dict[int, dict[int, Any]]:
    """Return the change of a function by each generator, as sums of products.

    The result maps the code of a product to {index of a generator: coefficient}.

    A rotation of coordinates rotates the velocities, too; a translation does not.

    generators : see `_symmetries`.
    slopes : derivatives of the function, as sums of products.
    states : codes of coordinates and velocities.
    """
    found: dict[int, dict[int, Any]] = {}

    def add(k: int, terms: Terms, factor: int, sign: int) -> None:
        for product, number in terms.items():
            row = found.setdefault(product + factor, {})
            row[k] = row.get(k, 0) + sign * number
            if abs(row[k]) <= TERM_ROUNDOFF * abs(number):
                row[k] = 0  # 3*0.1 and 0.3 cancel

    for k, (i, *turned) in enumerate(generators):
        if not turned:
            add(k, slopes[0][i], 0, 1)
        for slope, state in zip(slopes, states, strict=True) if turned else ():
            for j in turned if slope else ():
                add(k, slope[j], state[i], 1)
                add(k, slope[i], state[j], -1)
    return found


def _null_vectors(
    rows: Iterable[Mapping[int, Any]], size: int
) -> Iterable[Sequence[int]]:
    """Yield vectors of a basis of the null space of a matrix.

    Only vectors that consist of -1, 0 and 1 are yielded.

    rows : the rows of the matrix, each as {index of a column: entry}.
    size : number of columns.
    """
    found = ({j: _rounded(c) for j, c in row.items() if c} for row in rows)
    entries = [row for row in found if row]
    shape = len(entries), size
    matrix = DomainMatrix(dict(enumerate(entries)), shape, sp.QQ)
    basis, _ = matrix.nullspace().rref()
    for vector in basis.to_Matrix().tolist():
        if any(vector) and all(abs(c) <= 1 and c.is_Integer for c in vector):
            yield [int(c) for c in vector]


def _rounded(x: int | Fraction) -> Any:
    """Return a number as a rational number of sympy with a short denominator.

    It differs from x by rounding at most.
    """
    x = min(Fraction(DIGITS.divide(x.numerator, x.denominator)), Fraction(x),
            key=lambda c: c.denominator)  # fmt: skip
    return sp.QQ(x.numerator, x.denominator)


def _named(x: Translation, found: list[Part]) -> list[Part]:
    """Set `definition` of conserved quantities that are definitions of the file.

    Quantity and definition are compared at random states, with random parameters. All
    values are near 1, so that roots and logarithms exist.

    found : entries of the document, which are changed and returned.
    """
    model, random = x.equations.model, np.random.default_rng(7)
    defined = [d for d in model.definitions if d.level is not Level.OUTPUT]
    if not (found and defined):
        return found
    nodes = [x.node(c["expression"], x.g.zero) for c in found]
    nodes += [d.node for d in defined]
    state = ("t", *x.equations.state)
    rows = []
    for _ in range(STATES):
        at = {name: random.uniform(0.3, 1.5) for name in state}
        for p in model.parameters:
            at[p.name] = math.copysign(random.uniform(0.5, 2.0), p.value)
        rows.append(evaluate(x.g, nodes, at))
    values = np.array(rows).T
    for c, value in zip(found, values, strict=False):
        finite = np.isfinite(value)
        names = (
            d.name
            for d, other in zip(defined, values[len(found) :], strict=True)
            if any(finite)
            and np.allclose(other[finite], value[finite], rtol=COMPUTED_ZERO, atol=0.0)
        )
        c["definition"] = next(names, None)
    return found
