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
        if key not in g.remembered:
            g.remembered[key] = function(g, *args, **keywords)
        found: Found = g.remembered[key]
        return found

    return known
