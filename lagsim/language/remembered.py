"""What is found out about nodes of a graph, and stays true: found out once."""

from __future__ import annotations

from functools import wraps
from typing import TYPE_CHECKING, Concatenate, ParamSpec, TypeVar

if TYPE_CHECKING:
    from collections.abc import Callable

    from lagsim.language.graph import Graph

Given = ParamSpec("Given")
Found = TypeVar("Found")


def remembered(
    function: Callable[Concatenate[Graph, Given], Found],
) -> Callable[Concatenate[Graph, Given], Found]:
    """Let a function of a graph, and of what can be hashed, be computed once for each.

    Nodes never change: models that differ in the values of their parameters alone share
    what it gives, which nobody may write into.
    """

    @wraps(function)
    def known(g: Graph, /, *args: Given.args, **keywords: Given.kwargs) -> Found:
        key = (function, args, tuple(keywords.items()))
        return once(g, key, lambda: function(g, *args, **keywords))

    return known


def once(g: Graph, key: object, find: Callable[[], Found]) -> Found:
    """Find something out that rests on the key alone, if it is not known yet."""
    if key not in g.remembered:
        g.remembered[key] = find()
    found: Found = g.remembered[key]
    return found
