"""Expressions of the graph as text for a message, roughly as written."""

from __future__ import annotations

from typing import TYPE_CHECKING

from lagsim.language.graph import CONSTANT, TRUTH, VARIABLE

if TYPE_CHECKING:
    from lagsim.language.graph import Graph

_SYMBOLS = {
    "or": (1, " or "),
    "and": (2, " and "),
    "lt": (4, " < "),
    "le": (4, " <= "),
    "gt": (4, " > "),
    "ge": (4, " >= "),
    "add": (5, " + "),
    "sub": (5, " - "),
    "mul": (6, "*"),
    "div": (6, "/"),
    "pow": (8, "^"),
}
_PREFIXES = {"not": (3, "not "), "neg": (7, "-")}


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
    if op in _SYMBOLS or op in _PREFIXES:
        power, symbol = (_SYMBOLS | _PREFIXES)[op]
        parts = [_text(g, a, depth - 1) for a in args]
        # The right operand of -, / and comparisons, and the base of ^, bind tighter.
        least = [power + (op == "pow"), power + (op in ("sub", "div"))][-len(parts) :]
        shown = [
            f"({text})" if p < q else text
            for (p, text), q in zip(parts, least, strict=True)
        ]
        return power, symbol + shown[0] if op in _PREFIXES else symbol.join(shown)
    return 9, f"{op}({expression_text(g, *args, depth=depth - 1)})"
