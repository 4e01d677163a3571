"""What the code of a graph is made from, told without making it.

Writing the IR of a model takes longer than all else that a warm run does to it. Two
graphs with the same digest have the same code: it covers the operations, how they hang
together and in which order they stand, the layout, and the text of what writes code.
"""

from __future__ import annotations

import functools
import hashlib
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from lagsim.language import functions as operations
from lagsim.native.graph import sincos, straight_line

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from lagsim.language.graph import Graph
    from lagsim.native.graph.straight_line import Layout


def fingerprint(
    g: Graph, functions: Mapping[str, Sequence[int]], layout: Layout, *manner: object
) -> str:
    """Give a digest of all that the code of `functions` is made from.

    Numbers of nodes say nothing but which comes first. manner : what else is told to
    those who write the code.
    """
    cone = g.cone(n for nodes in functions.values() for n in nodes)
    place = {n: k for k, n in enumerate(cone)}
    leaves = [(k, g.payload(n)) for k, n in enumerate(cone) if not g.args[n]]
    parts = [
        _writers(),
        repr((straight_line.PIECE, sincos.LANES, manner)),
        repr([g.ops[n] for n in cone]),
        repr([[place[a] for a in g.args[n]] for n in cone]),
        repr(leaves),
        repr([(name, [place[n] for n in nodes]) for name, nodes in functions.items()]),
        repr((place.get(g.zero), layout.size, sorted(layout.fixed))),
        repr((list(layout.y.items()), list(layout.p.items()))),
    ]
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()


@functools.cache
def _writers() -> str:
    """Give a digest of the text of all that writes the code of a graph."""
    digest = hashlib.sha256(repr(sys.version_info[:2]).encode())
    here = Path(__file__).parent
    for file in [*sorted(here.glob("*.py")), Path(operations.__file__)]:
        digest.update(file.read_bytes())
    return digest.hexdigest()
