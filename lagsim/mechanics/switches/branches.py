"""Branches of `if` past the surface that ends them.

`if(x > 0, -x^1.5, (-x)^1.5)` is written with roots that each have a value on their own
side alone. A stage past the surface would take the one where there is none: there the
expression counts as written.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from lagsim.language.functions import OPERATIONS

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from lagsim.language.graph import Graph


def with_values(
    g: Graph, n: int, args: Sequence[int], as_written: Callable[[], int]
) -> int:
    """Give `if` n on frozen `args`; as written where the branch has no value.

    Parameters
    ----------
    as_written
        Gives it frozen by time alone.
    """
    condition, *branches = args
    decides = g.depends([g.args[n][0]])
    inside = [_has_value(g, branch, decides) for branch in branches]
    if inside == [None, None]:
        return g.call("if", *args)
    plain = as_written()
    if g.ops[plain] != "if" or g.args[plain][0] == condition:
        return g.call("if", *args)
    apart = [
        branch if there is None else g.call("if", there, branch, plain)
        for there, branch in zip(inside, branches, strict=True)
    ]
    return g.call("if", condition, *apart)


def _has_value(g: Graph, branch: int, decides: frozenset[str]) -> int | None:
    """Give the condition that all roots and logarithms of a branch have a value.

    Of those that hang on what decides the branch; nested branches look after their own.
    """
    found = None
    seen: set[int] = set()
    stack = [branch]
    while stack:
        n = stack.pop()
        if n in seen or g.ops[n] == "if":
            continue
        seen.add(n)
        stack += g.args[n]
        operation = OPERATIONS.get(g.ops[n])
        if operation is None or operation.domain is None:
            continue
        inside = operation.domain(g, g.args[n])
        if inside is not None and decides & g.depends([g.args[n][0]]):
            found = inside if found is None else g.call("and", found, inside)
    return found
