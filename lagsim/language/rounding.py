"""Bounds of the rounding of expressions, as expressions: running error analysis.

In units of the unit roundoff, and of what is rounded on the way alone: variables count
as exact, and so does all that depends on none that moves, which is rounded the same way
each time. N. J. Higham, Accuracy and Stability of Numerical Algorithms, 2nd ed.,
section 3.3.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from lagsim.language.evaluate import UNIT_ROUNDOFF
from lagsim.language.functions import OPERATIONS

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Sequence

    from lagsim.language.graph import Graph

# Forces balance to this part of what each of them could do: rounding is the rest.
BALANCED = 2.0**-46


def roundings(g: Graph, nodes: Iterable[int], moving: Collection[str]) -> list[int]:
    """Give the bound of each of `nodes`, 0 where nothing of it is `moving`."""
    nodes = list(nodes)
    varying = g.dependent(nodes, moving)
    errors: dict[int, int] = {}
    for n in g.cone(nodes):
        if n in varying and g.args[n]:
            errors[n] = _bound(g, n, [errors.get(a, g.zero) for a in g.args[n]])
    return [errors.get(n, g.zero) for n in nodes]


def addends(g: Graph, node: int) -> list[int]:
    """Give what `node` is a sum of, through differences and signs."""
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
        return g.call("if", row.branches(g, args), errors[-2], errors[-1])
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
            some = g.call("gt", error, g.zero)
            part = g.call("if", some, part, g.zero)
        inherited = g.call("add", inherited, part)
    return g.call("add", fresh, inherited)


def _of_root(g: Graph, root: int, error: int) -> int:
    """Give what the error of its argument does to a root: at 0 its own root."""
    if error == g.zero:
        return g.zero
    linear = g.call("div", error, g.call("add", root, root))
    largest = g.call("sqrt", g.call("div", error, g.constant(UNIT_ROUNDOFF)))
    some = g.call("gt", error, g.zero)
    return g.call("if", some, g.call("min", linear, largest), g.zero)
