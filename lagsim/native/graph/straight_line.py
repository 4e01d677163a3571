"""Graph -> LLVM IR: each function of a model as straight-line code, or as a loop.

Every function is `void f(double t, ptr y, ptr p, ptr out)`. The function `prepare`
evaluates expressions of parameters alone once, and stores their values in the tail of
`p`. Long functions are cut into pieces that pass values through scratch memory in p, so
that compile time grows in proportion to length.

A Taylor series is written out if it is short, see `orders`, else as a `loop`.
"""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING

from lagsim.native.graph import keys, loop, orders, tapes
from lagsim.native.graph.lanes import LaneWriter
from lagsim.native.graph.lines import Code, fixed_nodes
from lagsim.native.graph.writer import LONG, FunctionWriter, Place

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from lagsim.language.graph import Graph
    from lagsim.native.graph.keys import Functions, Layout, Manner

# Least number of common nodes of several functions that become a function of their own.
# Fewer nodes are evaluated in each function: a call would take as much code.
FEW_COMMON = 48


class CommonNodes:
    """Functions that evaluate the nodes which several long functions share.

    The nodes that are used by one set of functions, and by no other function, form a
    class; each class becomes a function of its own, which the others call first and
    which stores its values in p. Every function that uses a node also uses its
    operands, so that the classes with more users come first.

    Only functions that are called at most once in a step share code: stored values cost
    the derivative of an arm of seven joints 20 % of its time. The page that a browser
    runs for the bicycle has 244 kB in place of 272 kB.

    Attributes
    ----------
    writers : list of FunctionWriter
        The code of each class.
    places : dict of node to place
        Where the classes store the values of nodes.
    """

    def __init__(
        self,
        g: Graph,
        layout: Layout,
        first: int,
        functions: Mapping[str, Sequence[int]],
        known: Mapping[int, Place],
    ) -> None:
        users = dict[int, frozenset[str]]()
        for name, roots in functions.items():
            own = frozenset([name])
            for n in g.cone(roots, known):
                if g.args[n] and n not in known:
                    users[n] = users.get(n, frozenset()) | own
        counts = Counter(users.values())
        self._classes = [
            x for x, count in counts.items() if len(x) > 1 and count >= FEW_COMMON
        ]
        self._classes.sort(key=len, reverse=True)
        used = {n for roots in functions.values() for n in roots}
        used |= {
            a for n, own in users.items() for a in g.args[n] if users.get(a) != own
        }
        self.places: dict[int, Place] = {}
        self.writers = []
        made = {x: sorted(n for n in used if users.get(n) == x) for x in self._classes}
        total = sum(map(len, made.values()))
        for k, nodes in enumerate(made.values()):
            writer = FunctionWriter(g, layout, first + total)
            self.writers.append(writer)
            at = first + len(self.places)
            stores = [(n, ("p", at + i)) for i, n in enumerate(nodes)]
            writer.function(
                f"common.{k}", stores, {**known, **self.places}, linkage="internal ",
                longest=1,
            )  # fmt: skip
            self.places |= stores

    def calls(self, name: str) -> list[str]:
        """Return the names of the shared functions that the function `name` calls."""
        return [f"common.{k}" for k, x in enumerate(self._classes) if name in x]


def _longest(name: str, manner: Manner) -> int:
    """Return the number of pieces above which a function is not optimised.

    name : the name of the function.
    manner : lists functions that are called rarely; these are optimised only where they
        are a single piece.
    """
    return 1 if name in (*manner.once, *manner.rare) else LONG


# If more results of a function are identically zero, all results are cleared at once,
# since each single store takes time to compile.
FEW_ZEROS = 100
# A rare function of more nodes runs from a tape. An arm of seven joints: the 23,000 of
# its roundoff take 0.1 s instead of 0.7 s to be made, and 56 us instead of 7 us a call.
LONG_TAPE = 2000


def generate(
    g: Graph, functions: Functions, layout: Layout, manner: Manner = keys.PLAIN
) -> Code:
    """Return the IR of functions of graph nodes, as straight-line code or loops.

    Parameters
    ----------
    g : Graph
    functions : mapping of str to sequence of node, or to Loop
        By name: the nodes written to out[0], out[1], ..., or a Taylor series.
    layout : Layout
        Indices of the variables in y and p.
    manner : Manner
        Names of functions whose code is special; long ones among `manner.rare` become
        tapes.
    """
    interpreted = {
        name: made
        for name, made in keys.nodes_of(functions).items()
        if name in manner.rare and len(g.cone(made)) > LONG_TAPE
    }
    functions = {k: x for k, x in functions.items() if k not in interpreted}
    fixed = fixed_nodes(g, keys.nodes_of(functions), layout.fixed)
    places = {node: ("p", layout.size + k) for k, node in enumerate(fixed)}
    scratch = layout.size + len(fixed)
    writers = [FunctionWriter(g, layout, scratch)]
    writers[0].function("prepare", [*places.items()], {})
    blank = dict(manner.blank)
    long = {
        name: [*nodes]
        for name, nodes in functions.items()
        if not isinstance(nodes, keys.Loop)
        and name in (*manner.once, *manner.rare)
        and name not in manner.together
        and len(g.cone(nodes, places)) > _longest(name, manner) * keys.PIECE
    }
    common = CommonNodes(g, layout, scratch, {**long, **interpreted}, places)
    writers += common.writers
    scratch += len(common.places)
    for name, nodes in functions.items():
        if name in manner.together and not isinstance(nodes, keys.Loop):
            lanes = LaneWriter(g, layout, scratch)
            writers.append(lanes)
            lanes.write(name, nodes, places, len(layout.y))
            continue
        writer = FunctionWriter(g, layout, scratch, contract=name in manner.contracted)
        writers.append(writer)
        if isinstance(nodes, keys.Loop):
            by = orders.write if nodes.unrolled else loop.write
            by(writer, name, nodes, places)
            continue
        stores = [(node, ("out", k)) for k, node in enumerate(nodes)]
        cleared = 0
        if name in blank:
            stores = [x for x in stores if x[0] != g.zero or x[1][1] >= blank[name]]
        elif nodes.count(g.zero) > FEW_ZEROS:
            cleared = len(nodes)
            stores = [store for store in stores if store[0] != g.zero]
        longest, first = _longest(name, manner), common.calls(name)
        known = {**places, **common.places} if first else places
        writer.function(
            name, stores, known, cleared=cleared, longest=longest, first=first
        )
    size = max(writer.scratch + writer.scratch_used for writer in writers)
    declared = set().union(*(x.declared for x in writers))
    lines = [line for x in writers for line in x.lines]
    if interpreted:
        stored = {n: k for n, (_, k) in {**places, **common.places}.items()}
        calls = {name: common.calls(name) for name in interpreted}
        more, tape, size = tapes.tape_functions(
            g, interpreted, layout._replace(size=size), stored, calls
        )
        declared |= more
        lines += tape
    return Code("\n".join([*sorted(declared), *lines, ""]), size)
