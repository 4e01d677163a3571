"""Functions of a model for LANES states at once, each with parameters of its own.

What `native.kernels.wide` calls: `void f(ptr t, ptr y, ptr p, ptr out)`, all of it
interleaved, element k of lane l at k*LANES + l. Each lane has the bits of the function
that `straight_line` writes, which prepares the same values at the same places of p.
"""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING

from lagsim.native.graph import keys, order_loop, sincos
from lagsim.native.graph.lines import CIRCULAR, number
from lagsim.native.graph.straight_line import Code, fixed_nodes
from lagsim.native.graph.writer import Writer
from lagsim.native.kernels.lines import LANES
from lagsim.native.kernels.wide_values import VECTOR, WIDEST, symbol

if TYPE_CHECKING:
    from collections.abc import Collection, Sequence

    from lagsim.language.graph import Graph
    from lagsim.native.graph.keys import Functions, Layout

_WIDER = (
    ("double", VECTOR),
    ("i1", f"<{LANES} x i1>"),
    ("true", f"<{', '.join(['i1 true'] * LANES)}>"),
    ("false", f"<{', '.join(['i1 false'] * LANES)}>"),
    (".f64", f".v{LANES}f64"),
)


def generate(
    g: Graph,
    functions: Functions,
    layout: Layout,
    names: Collection[str],
    contracted: Collection[str] = (),
) -> Code:
    """Give the code of those of `functions` that are named, for LANES states.

    functions : all of the system, as they were given to `straight_line.generate`.
    """
    fixed = fixed_nodes(g, keys.nodes_of(functions), layout)
    places = {node: ("p", layout.size + k) for k, node in enumerate(fixed)}
    scratch = layout.size + len(fixed)
    manner = f" nounwind {WIDEST}"
    writers = []
    for name in names:
        writer = _Lanes(g, layout, scratch, contract=name in contracted, wide=True)
        nodes = functions[name]
        if isinstance(nodes, keys.Loop):
            order_loop.write(writer, symbol(name), nodes, places, manner)
        else:
            stores = [(node, ("out", k)) for k, node in enumerate(nodes)]
            writer.function(symbol(name), stores, places, manner=manner)
        writers.append(writer)
    declared = sorted(set().union(*(writer.declared for writer in writers)))
    lines = [line for writer in writers for line in writer.lines]
    used = max(writer.scratch_used for writer in writers)
    return Code("\n".join([*declared, *lines, ""]), scratch + used)


class _Lanes(Writer):
    """Writes one function of LANES states."""

    signature = "ptr %t, ptr %y, ptr %p, ptr %out"
    shared = frozenset(("orders",))
    width = LANES
    time_first = False

    @property
    def kind(self) -> str:
        """The type of a value."""
        return VECTOR if self.wide else "double"

    def literal(self, x: float) -> str:
        """Give the literal of a float."""
        if not self.wide:
            return number(x)
        [bits] = struct.unpack("<Q", struct.pack("<d", x))
        return "<" + ", ".join([f"double 0x{bits:016X}"] * LANES) + ">"

    def widened(self, text: str) -> str:
        """Give an operation on numbers as one on vectors."""
        if self.wide:
            for narrow, wide in _WIDER:
                text = text.replace(narrow, wide)
        return text

    def circular(
        self, angles: Sequence[str], wanted: Sequence[tuple[str, int]]
    ) -> list[str]:
        """Write sines and cosines of several angles: each (op, which angle)."""
        self.declared.update((*sincos.DECLARES, sincos.function()))
        both = [self._halves(angle) for angle in angles]
        found = []
        for op, k in wanted:
            parts = [
                self.line(f"extractvalue {sincos.BOTH} {half}, {CIRCULAR[op]}")
                for half in both[k]
            ]
            places = ", ".join(f"i32 {lane}" for lane in range(LANES))
            halves = ", ".join(f"{sincos.VECTOR} {part}" for part in parts)
            join = f"shufflevector {halves}, <{LANES} x i32> <{places}>"
            found.append(self.line(join))
        return found

    def _halves(self, angles: str) -> list[str]:
        found = []
        for first in range(0, LANES, sincos.LANES):
            places = ", ".join(f"i32 {first + k}" for k in range(sincos.LANES))
            half = self.line(
                f"shufflevector {VECTOR} {angles}, {VECTOR} poison, "
                f"<{sincos.LANES} x i32> <{places}>"
            )
            call = f"call {sincos.BOTH} @{sincos.NAME}({sincos.VECTOR} {half})"
            found.append(self.line(call))
        return found

    def _lane_by_lane(
        self, op: str, exponent: float | None, operands: list[str]
    ) -> str:
        values = []
        for lane in range(LANES):
            one = [
                self.line(f"extractelement {VECTOR} {x}, i32 {lane}") for x in operands
            ]
            self.wide = False
            values.append(self.operation(op, exponent, one))
            self.wide = True
        return self.joined(values)

    def time(self) -> str:
        """Give t."""
        return self._load_own(("t", 0))

    def joined(self, values: Sequence[str]) -> str:
        """Write the vector of numbers."""
        if len(values) < LANES:
            return super().joined(values)
        found = "poison"
        for lane, value in enumerate(values):
            place = f"double {value}, i32 {lane}"
            found = self.line(f"insertelement {VECTOR} {found}, {place}")
        return found
