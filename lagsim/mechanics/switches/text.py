"""Expressions of the graph as text for a message, roughly as written."""

from __future__ import annotations

from typing import TYPE_CHECKING

from lagsim.language.functions import OPERATIONS
from lagsim.language.graph import CONSTANT, TRUTH, VARIABLE

if TYPE_CHECKING:
    from lagsim.language.graph import Graph


def expression_text(g: Graph, *nodes: int, depth: int = 6) -> str:
    """Give expressions for a message, roughly as written; `...` where they are deep."""
    return ", ".join(_text(g, n, depth)[1] for n in nodes)


def _text(g: Graph, n: int, depth: int) -> tuple[int, str]:
    """Give the binding power and the text; `depth` bounds the recursion."""
    op, args = g.ops[n], g.args[n]
    if op in (VARIABLE, TRUTH):
        return 9, str(g.payload(n))
    if op == CONSTANT:
        x = g.value(n)
        assert x is not None
        return (9 if x >= 0.0 else 7), f"{x:.12g}"
    if depth == 0:
        return 9, "..."
    row = OPERATIONS[op]
    if row.sign:
        power, sign = row.binds, row.sign
        parts = [_text(g, a, depth - 1) for a in args]
        # The right operand of -, / and comparisons, and the base of ^, bind tighter.
        least = [power + (op == "pow"), power + (op in ("sub", "div"))][-len(parts) :]
        shown = [
            f"({text})" if p < q else text
            for (p, text), q in zip(parts, least, strict=True)
        ]
        return power, sign + shown[0] if row.arity == 1 else sign.join(shown)
    return 9, f"{op}({expression_text(g, *args, depth=depth - 1)})"
