"""The lines of a graph's LLVM IR: operations on numbers, or on LANES at once."""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING

from lagsim.language.functions import OPERATIONS
from lagsim.native.graph import sincos

if TYPE_CHECKING:
    from collections.abc import Sequence

    from lagsim.language.graph import Graph

# Which result of `sincos` they are.
CIRCULAR = {"sin": 0, "cos": 1}

# Twice the exponents that are written out: products are exact to an ulp or two up to
# the 6th power, and faster than `pow`.
_HALVES = frozenset(k for k in range(-12, 13) if k not in (0, 2))

_FUSED = "declare double @llvm.fmuladd.f64(double, double, double)"

_WIDER = (
    ("double", sincos.VECTOR),
    ("i1", f"<{sincos.LANES} x i1>"),
    ("true", f"<{', '.join(['i1 true'] * sincos.LANES)}>"),
    ("false", f"<{', '.join(['i1 false'] * sincos.LANES)}>"),
    (".f64", f".v{sincos.LANES}f64"),
)


def exponent_of(g: Graph, n: int) -> float | None:
    """Give the exponent of a power where it is a number; None for all else."""
    return g.value(g.args[n][1]) if g.ops[n] == "pow" else None


def number(x: float) -> str:
    """Give the LLVM literal of a float, bit for bit."""
    return f"0x{struct.unpack('<Q', struct.pack('<d', x))[0]:016X}"


class Lines:
    """Lines of IR with fresh names."""

    def __init__(self, *, wide: bool = False) -> None:
        self.lines: list[str] = []
        self.declared: set[str] = set()
        self.wide = wide
        self._fresh = 0

    @property
    def kind(self) -> str:
        """The type of a value."""
        return sincos.VECTOR if self.wide else "double"

    def literal(self, x: float) -> str:
        """Give the literal of a float."""
        return sincos.spread(x) if self.wide else number(x)

    def operation(self, op: str, exponent: float | None, operands: list[str]) -> str:
        """Write an operation, of a power the `exponent` where it is a number."""
        if op == "pow" and exponent is not None and exponent * 2 in _HALVES:
            return self._power(operands[0], exponent)
        if op in CIRCULAR:
            return self.circular(operands, [(op, 0)])[0]
        row = OPERATIONS[op]
        if self.wide and not row.wide:
            return self._lane_by_lane(op, exponent, operands)
        self.declared.update(map(self.widened, row.declares))
        fresh = {key: self._name() for key in "abcdef"}
        *before, last = self.widened(row.native).format(*operands, **fresh).split("\n")
        self.lines += before
        return self.line(last)

    def fused(self, x: str, y: str, z: str) -> str:
        """Write x*y + z, rounded once where the processor can."""
        self.declared.add(self.widened(_FUSED))
        operands = ", ".join(f"{self.kind} {value}" for value in (x, y, z))
        call = self.widened("@llvm.fmuladd.f64")
        return self.line(f"call {self.kind} {call}({operands})")

    def negated(self, x: str) -> str:
        """Write -x."""
        return self.line(f"fneg {self.kind} {x}")

    def circular(
        self, angles: Sequence[str], wanted: Sequence[tuple[str, int]]
    ) -> list[str]:
        """Write sines and cosines of up to LANES angles: each (op, which angle)."""
        self.declared.update((*sincos.DECLARES, sincos.function()))
        if self.wide:
            both = [self._both(angle) for angle in angles]
            return [
                self.line(f"extractvalue {sincos.BOTH} {both[k]}, {CIRCULAR[op]}")
                for op, k in wanted
            ]
        pair = self._both(self.joined(angles))
        values = []
        for op, lane in wanted:
            part = self.line(f"extractvalue {sincos.BOTH} {pair}, {CIRCULAR[op]}")
            one = f"extractelement {sincos.VECTOR} {part}, i32 {lane}"
            values.append(self.line(one))
        return values

    def _both(self, angles: str) -> str:
        vector = f"{sincos.VECTOR} {angles}"
        return self.line(f"call {sincos.BOTH} @{sincos.NAME}({vector})")

    def _lane_by_lane(
        self, op: str, exponent: float | None, operands: list[str]
    ) -> str:
        """Write an operation that there is for one number only."""
        results = []
        for lane in range(sincos.LANES):
            one = [
                self.line(f"extractelement {sincos.VECTOR} {x}, i32 {lane}")
                for x in operands
            ]
            self.wide = False
            results.append(self.operation(op, exponent, one))
            self.wide = True
        return self.joined(results)

    def joined(self, values: Sequence[str]) -> str:
        """Write the vector of up to LANES numbers."""
        vector = "zeroinitializer"
        for lane, value in enumerate(values):
            place = f"double {value}, i32 {lane}"
            vector = self.line(f"insertelement {sincos.VECTOR} {vector}, {place}")
        return vector

    def widened(self, text: str) -> str:
        """Give an operation on numbers as one on vectors, where they are wide."""
        if not self.wide:
            return text
        for narrow, wide in _WIDER:
            text = text.replace(narrow, wide)
        return text

    def _power(self, x: str, exponent: float) -> str:
        """Write x to a small whole or half power as products and a root."""
        whole = int(abs(exponent))
        result = ""
        if abs(exponent) != whole:
            result = self.operation("sqrt", None, [x])
        while whole:
            if whole % 2:
                result = self.line(f"fmul {self.kind} {result}, {x}") if result else x
            whole //= 2
            if whole:
                x = self.line(f"fmul {self.kind} {x}, {x}")
        if exponent < 0:
            return self.line(f"fdiv {self.kind} {self.literal(1.0)}, {result}")
        return result

    def line(self, text: str) -> str:
        """Write an instruction; give the name of its value."""
        name = self._name()
        self.lines.append(f"{name} = {text}")
        return name

    def _name(self) -> str:
        self._fresh += 1
        return f"%v{self._fresh}"
