"""Values of graph nodes in Python, and bounds of their rounding errors.

It evaluates numbers that are needed once (start values, parameters), and is the
reference for native code in tests. It never raises: outside a domain values are nan or
inf. Rounding errors are bounded by running error analysis, as numbers
(`evaluate_with_error`), or as expressions (`roundings`). N. J. Higham, Accuracy and
Stability of Numerical Algorithms, 2nd ed., section 3.3.
"""

from __future__ import annotations

import math
from itertools import product, repeat, starmap
from typing import TYPE_CHECKING, Any

from lagsim.language.functions import ELEMENTS, OPERATIONS, PART
from lagsim.language.graph import CONSTANT, DATA, TRUTH, VARIABLE
from lagsim.tolerances import UNIT_ROUNDOFF

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Mapping, Sequence

    from lagsim.language.arrays import Floats
    from lagsim.language.graph import Graph


# Number of evaluated nodes, without and with errors, whose time is that of creating
# one node.
VALUES = 7
VALUES_WITH_ERRORS = 1.5
# Number of operations on numbers of arrays whose time is that of creating one node, and
# the number of operations of a bound of roundoff for each of a sum.
BY_ARRAYS, BOUNDED = 1000, 4


def _of_vectors(g: Graph, cone: Sequence[int]) -> float:
    """Return the cost of evaluating the elements among the nodes `cone`.

    The unit is the cost of creating a node.
    """
    vectors = g.of((ELEMENTS,))
    found = set(vectors).intersection(cone) if vectors else ()
    return sum(float(g.payload(g.args[n][0]).cost) for n in found) / BY_ARRAYS


def evaluate(
    g: Graph, nodes: Iterable[int], values: Mapping[str, float]
) -> list[float]:
    """Return the value of each of `nodes`, with the variables at `values`.

    Examples
    --------
    >>> from lagsim.language.graph import Graph
    >>> g = Graph()
    >>> node = g.call("mul", g.variable("x"), g.variable("y"))
    >>> evaluate(g, [node], {"x": 3.0, "y": 2.0})
    [6.0]
    """
    nodes = list(nodes)
    found: dict[int, Any] = {}
    cone = g.cone(nodes)
    g.count(len(cone) / VALUES + _of_vectors(g, cone))
    for n in cone:
        op = g.ops[n]
        if op == VARIABLE:
            found[n] = values[str(g.payload(n))]
        elif op in (CONSTANT, TRUTH, DATA):
            found[n] = g.payload(n)
        else:
            row = OPERATIONS[op]
            # without a call of the row's function, which would take a third longer
            try:
                found[n] = row.value(*[found[a] for a in g.args[n]])
            except (ValueError, OverflowError):
                found[n] = row(*[found[a] for a in g.args[n]])
    return [found[n] for n in nodes]


def evaluate_rows(
    g: Graph, nodes: Iterable[int], values: Mapping[str, float | Floats], count: int
) -> Floats:
    """Return the values of `nodes` in each of `count` rows, shape (nodes, count).

    It is meant for some thousand rows after a run, too few to be worth compiling.

    Parameters
    ----------
    g, nodes
        The graph, and the nodes to evaluate.
    values
        The variables by name: numbers, or arrays of shape (count,).
    count
        Number of rows.
    """
    import numpy as np

    nodes = list(nodes)
    fixed: dict[int, Any] = {}
    moving: dict[int, list[Any]] = {}
    for n in g.cone(nodes):
        op, args = g.ops[n], g.args[n]
        if op == VARIABLE:
            value = values[str(g.payload(n))]
            if isinstance(value, np.ndarray):
                moving[n] = value.tolist()
            else:
                fixed[n] = value
        elif op in (CONSTANT, TRUTH, DATA):
            fixed[n] = g.payload(n)
        elif not moving.keys().isdisjoint(args):
            rows = [moving[a] if a in moving else repeat(fixed[a]) for a in args]
            moving[n] = list(starmap(OPERATIONS[op].__call__, zip(*rows, strict=False)))
        else:
            fixed[n] = OPERATIONS[op](*(fixed[a] for a in args))
    found = np.empty((len(nodes), count))
    for row, n in zip(found, nodes, strict=True):
        row[:] = moving[n] if n in moving else fixed[n]
    return found


def evaluate_with_error(
    g: Graph, nodes: Iterable[int], values: Mapping[str, tuple[float, float]]
) -> list[tuple[float, float]]:
    """Return the value and a rounding error bound of each of `nodes`.

    Running error analysis (Higham, Accuracy and Stability of Numerical Algorithms, 2nd
    ed., section 3.3), to first order: the error of a function is its greatest change
    over the corners of its arguments' errors, plus one unit in the last place. A
    constant that is not a whole number counts as rounded to the nearest. The values of
    steps, such as `floor` and the cell of a table, count as exact, as in `roundings`.

    Parameters
    ----------
    g, nodes
        The graph, and the nodes to evaluate.
    values
        Value and error of each variable by name.

    Examples
    --------
    >>> from lagsim.language.graph import Graph
    >>> g = Graph()
    >>> node = g.call("add", g.variable("x"), g.variable("x"))
    >>> [(value, error)] = evaluate_with_error(g, [node], {"x": (1.0, 1e-6)})
    >>> value, 2e-6 <= error < 2.001e-6
    (2.0, True)
    """
    nodes = list(nodes)
    found: dict[int, tuple[Any, float]] = {}
    cone = g.cone(nodes)
    g.count(len(cone) / VALUES_WITH_ERRORS + BOUNDED * _of_vectors(g, cone))
    for n in cone:
        op = g.ops[n]
        if op == VARIABLE:
            found[n] = values[str(g.payload(n))]
        elif op in (TRUTH, DATA):
            found[n] = g.payload(n), 0.0
        elif op == CONSTANT:
            c = g.value(n)
            assert c is not None
            found[n] = c, 0.0 if c.is_integer() else UNIT_ROUNDOFF * abs(c)
        elif op in (ELEMENTS, PART):
            found[n] = _sums_with_error(op, [found[a] for a in g.args[n]])
        else:
            found[n] = _with_error(op, [found[a] for a in g.args[n]])
    return [found[n] for n in nodes]


def _sums_with_error(op: str, args: list[tuple[Any, Any]]) -> tuple[Any, Any]:
    """Return values and errors of a vector of sums, or of one component of it.

    op : `elements.sums` or `elements.part`.
    args : values and errors of the arguments.
    """
    (first, errors), *others = args
    if op == ELEMENTS:
        found: tuple[Any, Any] = first.evaluate_with_error(others, 2.0 * UNIT_ROUNDOFF)
        return found
    k = int(others[0][0])
    return float(first[k]), float(errors[k])


def _with_error(op: str, args: list[tuple[Any, float]]) -> tuple[Any, float]:
    row = OPERATIONS[op]
    value = row(*[x for x, _ in args])
    if row.condition or row.step:
        return value, 0.0
    inherited = 0.0
    if any(e for _, e in args):
        for corner in product(*[(x - e, x + e) if e else (x,) for x, e in args]):
            change = abs(row(*corner) - value)
            inherited = max(inherited, change if change == change else 0.0)
    fresh = 2.0 * UNIT_ROUNDOFF * abs(value) if row.rounds else 0.0
    return value, inherited + (fresh if math.isfinite(fresh) else 0.0)


# A product, a shift, and a moving shift are rounded by this part of a coordinate.
SHIFTED = 3.0


def roundings(
    g: Graph,
    nodes: Iterable[int],
    moving: Collection[str],
    state: Collection[str] = (),
    known: Mapping[int, int] | None = None,
) -> list[int]:
    """Return a node for the rounding error bound of each of `nodes`.

    The bound is 0 for a node that does not depend on `moving`.

    state : variables whose own rounding is accounted for elsewhere. Far from the
        origin, this rounding is the whole error of an expression that is linear in one
        such variable, except for a shift, and it is equal in all uses of the variable.
    known : node -> node of the bound of its error, for variables and other nodes; the
        error of other variables is 0.
    """
    nodes = list(nodes)
    varying, placed = g.dependents(nodes, moving, state)
    known = known or {}
    errors = {n: x for n, x in known.items() if n in varying or not g.args[n]}
    # node a x + b -> its part a x: x of the state, b a function of t
    linear: dict[int, int] = {}
    for n in g.cone(nodes, known):
        if (n not in varying and n not in placed) or n in known:
            continue
        op, args = g.ops[n], g.args[n]
        own = [a for a in args if a in placed]
        if n in placed and not args:
            linear[n] = n
        elif len(own) == 1 and own[0] in linear:
            if op in ("add", "sub", "neg"):
                linear[n] = linear[own[0]]
            elif op == "mul" and sum(a in varying for a in args) == 1:
                linear[n] = g.call("mul", *(linear.get(a, a) for a in args))
        if op in (ELEMENTS, PART) and n in varying:
            errors[n] = _of_sums(g, n, varying, state, errors)
        elif n in varying and args:
            error = _bound(g, n, [errors.get(a, g.zero) for a in args])
            errors[n] = _less_shift(g, error, linear.get(n))
    return [errors.get(n, g.zero) for n in nodes]


def _less_shift(g: Graph, error: int, linear: int | None) -> int:
    """Return the error bound of a x + b less the part that the rounding of x causes.

    error : the bound, a node.
    linear : the node a x; None if the expression has another form, for which the bound
        is returned.
    """
    if linear is None or error == g.zero:
        return error
    magnitude = g.call("abs", linear)
    if magnitude == error:
        return g.zero
    magnitude = g.call("mul", g.constant(SHIFTED), magnitude)
    return g.call("max", g.call("sub", error, magnitude), g.zero)


def _of_sums(
    g: Graph, n: int, varying: set[int], state: Collection[str], errors: dict[int, int]
) -> int:
    """Return the node of the error bound of a vector of sums, or of one component.

    n : the node of the vector or component.
    varying, state : see `roundings`.
    errors : node -> node of its bound.
    """
    first, *others = g.args[n]
    if g.ops[n] == PART:
        return g.unsimplified(PART, (errors[first], *others))
    leaves = {g.variable(name) for name in state}
    bounds: int = g.payload(first).bound(g, n, varying, leaves, errors)
    return bounds


def addends(g: Graph, node: int) -> list[int]:
    """Return the terms, as nodes, of the sum or difference that `node` is.

    Signs are left out; a node that is no sum is its only term.
    """
    stack, found = [node], set()
    while stack:
        n = stack.pop()
        if g.ops[n] in ("add", "sub", "neg"):
            stack.extend(g.args[n])
        else:
            found.add(n)
    return sorted(found)


def _bound(g: Graph, n: int, errors: Sequence[int]) -> int:
    op, args = g.ops[n], g.args[n]
    row = OPERATIONS[op]
    if row.exact:
        return errors[0]
    if row.step or row.condition:
        return g.zero
    if row.branches:
        return row.chosen(g, args, errors[-2], errors[-1])
    fresh = g.call("abs", n)
    if op == "sqrt":
        return g.call("add", fresh, _of_root(g, n, errors[0]))
    assert row.partials is not None
    inherited = g.zero
    for slope, error in zip(row.partials(g, args, n), errors, strict=True):
        if error == g.zero:
            continue
        part = g.call("mul", g.call("abs", slope), error)
        if row.steep:
            inexact = g.call("gt", error, g.zero)
            part = g.call("if", inexact, part, g.zero)
        inherited = g.call("add", inherited, part)
    return g.call("add", fresh, inherited)


def _of_root(g: Graph, root: int, error: int) -> int:
    """Return the node of the error bound of a square root.

    At 0 the bound is the square root of `error`.

    root : node of the root.
    error : node of the error bound of its argument.
    """
    if error == g.zero:
        return g.zero
    linear = g.call("div", error, g.call("add", root, root))
    largest = g.call("sqrt", g.call("div", error, g.constant(UNIT_ROUNDOFF)))
    inexact = g.call("gt", error, g.zero)
    return g.call("if", inexact, g.call("min", linear, largest), g.zero)
