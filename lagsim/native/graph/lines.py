"""The lines of a graph's LLVM IR: operations on numbers."""

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


def exponent_of(g: Graph, n: int) -> float | None:
    """Give the exponent of a power where it is a number; None for all else."""
    return g.value(g.args[n][1]) if g.ops[n] == "pow" else None


def number(x: float) -> str:
    """Give the LLVM literal of a float, bit for bit."""
    return f"0x{struct.unpack('<Q', struct.pack('<d', x))[0]:016X}"


class Lines:
    """Lines of IR with fresh names."""

    def __init__(self) -> None:
        self.lines: list[str] = []
        self.declared: set[str] = set()
        self._fresh = 0

    def operation(self, op: str, exponent: float | None, operands: list[str]) -> str:
        """Write an operation, of a power the `exponent` where it is a number."""
        if op == "pow" and exponent is not None and exponent * 2 in _HALVES:
            return self._power(operands[0], exponent)
        if op in CIRCULAR:
            return self.circular(operands, [(op, 0)])[0]
        row = OPERATIONS[op]
        self.declared.update(row.declares)
        fresh = {key: self._name() for key in "abcdef"}
        *before, last = row.native.format(*operands, **fresh).split("\n")
        self.lines += before
        return self.line(last)

    def fused(self, x: str, y: str, z: str) -> str:
        """Write x*y + z, rounded once where the processor can."""
        self.declared.add(_FUSED)
        operands = ", ".join(f"double {value}" for value in (x, y, z))
        return self.line(f"call double @llvm.fmuladd.f64({operands})")

    def negated(self, x: str) -> str:
        """Write -x."""
        return self.line(f"fneg double {x}")

    def circular(
        self, angles: Sequence[str], wanted: Sequence[tuple[str, int]]
    ) -> list[str]:
        """Write sines and cosines of up to LANES angles: each (op, which angle)."""
        self.declared.update((*sincos.DECLARES, sincos.function()))
        vector = "zeroinitializer"
        for lane, angle in enumerate(angles):
            place = f"double {angle}, i32 {lane}"
            vector = self.line(f"insertelement {sincos.VECTOR} {vector}, {place}")
        call = f"@{sincos.NAME}({sincos.VECTOR} {vector})"
        pair = self.line(f"call {sincos.BOTH} {call}")
        values = []
        for op, lane in wanted:
            part = self.line(f"extractvalue {sincos.BOTH} {pair}, {CIRCULAR[op]}")
            one = f"extractelement {sincos.VECTOR} {part}, i32 {lane}"
            values.append(self.line(one))
        return values

    def _power(self, x: str, exponent: float) -> str:
        """Write x to a small whole or half power as products and a root."""
        whole = int(abs(exponent))
        result = ""
        if abs(exponent) != whole:
            result = self.operation("sqrt", None, [x])
        while whole:
            if whole % 2:
                result = self.line(f"fmul double {result}, {x}") if result else x
            whole //= 2
            if whole:
                x = self.line(f"fmul double {x}, {x}")
        if exponent < 0:
            return self.line(f"fdiv double {number(1.0)}, {result}")
        return result

    def line(self, text: str) -> str:
        """Write an instruction; give the name of its value."""
        name = self._name()
        self.lines.append(f"{name} = {text}")
        return name

    def _name(self) -> str:
        self._fresh += 1
        return f"%v{self._fresh}"
