"""Graph -> LLVM IR: each function of a model as straight-line code, or as a loop.

Every function is `void f(double t, ptr y, ptr p, ptr out)`. Expressions of parameters
alone are computed once, by the function `prepare`, into the tail of `p`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from lagsim.language.graph import VARIABLE
from lagsim.native.graph import keys, order_loop
from lagsim.native.graph.writer import Writer, hoisted

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping, Sequence

    from lagsim.language.graph import Graph
    from lagsim.native.graph.keys import Functions, Layout

# Where more of what a function gives is zero identically, all of it is cleared at once:
# LLVM takes longer for each number that is written than they take to be written.
FEW_ZEROS = 100


class Code(NamedTuple):
    """LLVM IR of all functions, and the length of p that they need."""

    ir: str
    p_size: int


def generate(
    g: Graph,
    functions: Functions,
    layout: Layout,
    contracted: Collection[str] = (),
    sparse: Collection[str] = (),
) -> Code:
    """Give the code of `functions`.

    In those named in `contracted` a product may be added without being rounded first,
    where the processor can: last digits then depend on it. Those named in `sparse` do
    not write what is zero identically: they find zeros.
    """
    fixed = fixed_nodes(g, keys.nodes_of(functions), layout)
    places = {node: ("p", layout.size + k) for k, node in enumerate(fixed)}
    scratch = layout.size + len(fixed)
    writers = [Writer(g, layout, scratch)]
    writers[0].function("prepare", list(places.items()), {})
    for name, nodes in functions.items():
        writer = Writer(g, layout, scratch, contract=name in contracted)
        writers.append(writer)
        if isinstance(nodes, keys.Loop):
            order_loop.write(writer, name, nodes, places)
            continue
        stores = [(node, ("out", k)) for k, node in enumerate(nodes) if node != g.zero]
        zeros = len(nodes) - len(stores)
        at_once = len(nodes) if zeros > FEW_ZEROS and name not in sparse else 0
        if not at_once and name not in sparse:
            stores = [(node, ("out", k)) for k, node in enumerate(nodes)]
        writer.function(name, stores, places, cleared=at_once)
    declared = sorted(set().union(*(writer.declared for writer in writers)))
    lines = [line for writer in writers for line in writer.lines]
    used = max(writer.scratch_used for writer in writers)
    return Code("\n".join([*declared, *lines, ""]), scratch + used)


def fixed_nodes(
    g: Graph, functions: Mapping[str, Sequence[int]], layout: Layout
) -> list[int]:
    """Give the operations that are done once, by `prepare`."""
    roots = sorted({node for nodes in functions.values() for node in nodes})
    moving = {
        n
        for n in g.cone(roots)
        if g.ops[n] == VARIABLE and g.payload(n) not in layout.fixed
    }
    return hoisted(g, roots, moving)
