"""Digest of the inputs of code generation from a graph, without generating the code.

Writing the IR of a model takes longer than all other work of a warm run on it. Graphs
with equal digests have equal code: the digest covers the operations, their operands and
order, the memory layout, and the text of the modules that write code.
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
# A function of up to so many nodes is one piece: values passed from piece to piece go
# through memory (Andrews' mechanism: 0.97 of the time of a run).
WHOLE = 800


class Layout(NamedTuple):
    """Indices of the variables, by name, in the arrays y and p of a function.

    Attributes
    ----------
    y, p : mapping of str to int
        Index of each variable in y or in p.
    fixed : frozenset of str
        Names in p that do not change while a kernel runs (parameters, modes).
    size : int
        Length of p before the memory that the generated code adds.
    """

    y: Mapping[str, int]
    p: Mapping[str, int]
    fixed: frozenset[str]
    size: int


class Loop(NamedTuple):
    """A function that writes a Taylor series: the order K, then y_0, ..., y_K.

    Attributes
    ----------
    recurrence : Recurrence
        The recurrence from one order to the next.
    order : int
    operations : int
        Approximate number of operations of equivalent straight-line code.
    unrolled : bool
        Whether the code is straight-line, one order after the other, or a loop.
    """

    recurrence: Recurrence
    order: int
    operations: int = 0
    unrolled: bool = False


class Manner(NamedTuple):
    """Names of functions whose code is generated in a special way.

    Attributes
    ----------
    contracted : tuple of str
        Products may be added without intermediate rounding, where the processor can do
        so; last digits then depend on the processor.
    once : tuple of str
        Called at most once in a step.
    rare : tuple of str
        Called in few steps.
    blank : tuple of (str, int)
        Functions, each with a number of leading results. These results are not stored
        if they are identically 0, since their memory is 0 from the beginning.
    together : tuple of str
        Functions that are evaluated for several rows at once, see `lanes`.
    """

    contracted: tuple[str, ...] = ()
    once: tuple[str, ...] = ()
    rare: tuple[str, ...] = ()
    blank: tuple[tuple[str, int], ...] = ()
    together: tuple[str, ...] = ()


PLAIN = Manner()
# Name -> the nodes written to out[0], out[1], ..., or a loop.
Functions = Mapping[str, Sequence[int] | Loop]


def nodes_of(functions: Functions) -> dict[str, list[int]]:
    """Return the nodes that each function computes, by its name.

    A loop has two entries: the nodes of order 0 as "name.start", and the nodes of its
    body as "name.order".
    """
    found: dict[str, list[int]] = {}
    for name, made in functions.items():
        if isinstance(made, Loop):
            found[f"{name}.start"], found[f"{name}.order"] = made.recurrence.nodes
        else:
            found[name] = list(made)
    return found


def fingerprint(g: Graph, functions: Functions, layout: Layout, *manner: object) -> str:
    """Return a digest of all inputs that determine the code of `functions`.

    Nodes enter by their order, not by their numbers.

    functions : the nodes of the results, or a Loop, by name.
    manner : further arguments of the code generator.
    """
    made = nodes_of(functions)
    orders = [
        (name, f.order, f.unrolled)
        for name, f in functions.items()
        if isinstance(f, Loop)
    ]
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
        repr((PIECE, WHOLE, LANES, orders, manner)),
        repr([*kinds]),
        repr(leaves),
        repr([(name, place[nodes].tolist()) for name, nodes in made.items()]),
        repr((int(place[g.zero]), layout.size, sorted(layout.fixed))),
        repr((list(layout.y.items()), list(layout.p.items()))),
    ]
    digest = hashlib.sha256("\n".join(parts).encode())
    digest.update(bytes(map(kinds.__getitem__, ops)))
    digest.update(np.fromiter(map(len, args), np.int32, len(args)).tobytes())
    digest.update(place[list(chain.from_iterable(args))].tobytes())
    return digest.hexdigest()
