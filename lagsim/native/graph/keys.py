"""Digest of the sources of a graph's code, found without generating it.

Writing the IR of a model takes longer than all else that a warm run does to it. Two
graphs with the same digest have the same code: it covers the operations, how they hang
together and in which order they stand, the layout, and the text of what writes code.
"""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Mapping, Sequence
from itertools import chain
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lagsim.language.functions import OPERATIONS
from lagsim.native.graph.lines import LANES
from lagsim.native.kernels.keys import text_beside

if TYPE_CHECKING:
    from lagsim.language.graph import Graph
    from lagsim.language.series import Recurrence


# Nodes in one piece: LLVM's time per instruction grows with the length of a function
# (a 40-link chain: 0.9 s at 800, 0.7 s at 400, and little less below).
PIECE = 400


class Layout(NamedTuple):
    """Index of each variable by name, in y and in p.

    `fixed` names those in p that do not change while a kernel runs (parameters,
    modes); `size` is how much of p is used before what the code adds.
    """

    y: Mapping[str, int]
    p: Mapping[str, int]
    fixed: frozenset[str]
    size: int


class Loop(NamedTuple):
    """A function that writes a series, order K, then y_0 ... y_K, order by order.

    operations : about how many it takes, as straight-line code would
    """

    recurrence: Recurrence
    order: int
    operations: int = 0


class Manner(NamedTuple):
    """Names of functions that are written in another way.

    Attributes
    ----------
    contracted
        A product may be added without being rounded first, where the processor can:
        last digits then depend on it.
    once
        Called once in a step, or less.
    rare
        Called in few steps.
    """

    contracted: tuple[str, ...] = ()
    once: tuple[str, ...] = ()
    rare: tuple[str, ...] = ()


PLAIN = Manner()
# Name -> what it writes to out[0], out[1], ...
Functions = Mapping[str, Sequence[int] | Loop]


def nodes_of(functions: Functions) -> dict[str, list[int]]:
    """Nodes that each is made from, of a loop's before and within it."""
    found: dict[str, list[int]] = {}
    for name, made in functions.items():
        if isinstance(made, Loop):
            found[f"{name}.start"], found[f"{name}.order"] = made.recurrence.nodes
        else:
            found[name] = list(made)
    return found


def fingerprint(g: Graph, functions: Functions, layout: Layout, *manner: object) -> str:
    """Digest of all that the code of `functions` is made from.

    Numbers of nodes say nothing but which comes first. manner : what else is told to
    those who write the code.
    """
    made = nodes_of(functions)
    orders = [(name, f.order) for name, f in functions.items() if isinstance(f, Loop)]
    cone = g.cone(chain.from_iterable(made.values()))
    place = np.full(len(g), -1)
    place[cone] = range(len(cone))
    leaves = [(k, g.payload(n)) for k, n in enumerate(cone) if not g.args[n]]
    ops, args = [g.ops[n] for n in cone], [g.args[n] for n in cone]
    kinds = {op: k for k, op in enumerate(dict.fromkeys(ops))}
    rows = [OPERATIONS[op] for op in kinds if op in OPERATIONS]
    parts = [
        repr(sys.version_info[:2]),
        text_beside(__file__),
        repr([(x.native, x.declares, x.condition) for x in rows]),
        repr((PIECE, LANES, orders, manner)),
        repr([*kinds]),
        repr(leaves),
        repr([(name, place[nodes].tolist()) for name, nodes in made.items()]),
        repr((int(place[g.zero]), layout.size, sorted(layout.fixed))),
        repr((list(layout.y.items()), list(layout.p.items()))),
    ]
    digest = hashlib.sha256("\n".join(parts).encode())
    digest.update(bytes(map(kinds.__getitem__, ops)))
    digest.update(bytes(map(len, args)))
    digest.update(place[list(chain.from_iterable(args))].tobytes())
    return digest.hexdigest()
