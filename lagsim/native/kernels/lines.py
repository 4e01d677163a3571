"""The lines of a kernel in LLVM IR: values, instructions, blocks.

No fast-math flags and no contraction: every operation is rounded as CPython rounds it.
sqrt, floor, fabs and copysign are exact in IEEE 754 and become instructions; the other
functions are those of the C library that CPython calls, marked `nobuiltin` so that LLVM
does not put its own idea in their place (with glibc 2.36, pow(x, 2.0) differs from x*x
for about one x in a thousand).
"""

from __future__ import annotations

import ast
import contextlib
import struct
from typing import TYPE_CHECKING, Final, NamedTuple, Protocol

from lagsim.native.kernels.source import Folding, Source

if TYPE_CHECKING:
    from collections.abc import Iterator
    from types import FunctionType

    from lagsim.native.kernels.keys import Static

LLVM: Final = {
    "int": "i64",
    "float": "double",
    "bool": "i1",
    "Floats": "ptr",
    "None": "void",
}
PASSED: Final = LLVM | {"bool": "i1 zeroext"}
RETURNED: Final = LLVM | {"bool": "zeroext i1"}

# Python rounds quotients down and gives the remainder the divisor's sign. A divisor of
# zero, where Python raises, must not stop the process: it is taken as one.
_HELPERS: Final = {
    "int.floordiv": """
define internal i64 @int.floordiv(i64 %a, i64 %b) alwaysinline {
  %zero = icmp eq i64 %b, 0
  %d = select i1 %zero, i64 1, i64 %b
  %q = sdiv i64 %a, %d
  %p = mul i64 %q, %d
  %r = sub i64 %a, %p
  %inexact = icmp ne i64 %r, 0
  %signs = xor i64 %r, %d
  %differ = icmp slt i64 %signs, 0
  %down = and i1 %inexact, %differ
  %step = sext i1 %down to i64
  %result = add i64 %q, %step
  ret i64 %result
}
""",
    "int.mod": """
define internal i64 @int.mod(i64 %a, i64 %b) alwaysinline {
  %zero = icmp eq i64 %b, 0
  %d = select i1 %zero, i64 1, i64 %b
  %r = srem i64 %a, %d
  %inexact = icmp ne i64 %r, 0
  %signs = xor i64 %r, %d
  %differ = icmp slt i64 %signs, 0
  %other = and i1 %inexact, %differ
  %step = select i1 %other, i64 %d, i64 0
  %result = add i64 %r, %step
  ret i64 %result
}
""",
}


# The bits of a mantissa, and those of 1.
_PLACES: Final = 2**52 - 1
_ONE: Final = 1023 << 52
# 2^52 in the exponent: a whole number in the bits below it is added to 2^52. Less that,
# and less the bias of exponents.
_WHOLE: Final = 0x4330000000000000
_BIASED: Final = 2.0**52 + 1023.0
# Added to a whole number, this leaves it, with the bias, in the last bits.
_ROUNDER: Final = 1.5 * 2.0**52 + 1023.0


class Value(NamedTuple):
    """A value of the IR: its text and its kind."""

    text: str
    kind: str


class Program(Protocol):
    """What an expression needs of the whole translation."""

    def callee(self, function: FunctionType) -> tuple[str, Source]:
        """Give symbol and signature of a kernel function or an external."""

    def declare(self, line: str) -> None:
        """Have a declaration or a definition in the text, once."""

    def parallel(self) -> int:
        """Give the number of a new mark of a loop whose accesses are apart."""


def stack_place(name: str) -> str:
    """Give the address of a variable; quoted, for Greek ones."""
    return f'%"{name}.v"'


class Lines(Folding):
    """The lines of one function.

    Attributes
    ----------
    lines : list of str
        The instructions so far.
    allocated : list of str
        The places of its variables, for the entry block.
    """

    def __init__(self, source: Source, program: Program) -> None:
        super().__init__(source)
        self.program = program
        self.lines: list[str] = []
        self.allocated: list[str] = []
        self._count = 0

    def name(self, stem: str) -> str:
        """Give a new name."""
        self._count += 1
        return f"%{stem}.{self._count}"

    def op(self, kind: str, text: str) -> Value:
        """Add an instruction with a result."""
        name = self.name("x")
        self.lines.append(f"  {name} = {text}")
        return Value(name, kind)

    def allocate(self, stem: str, kind: str) -> str:
        """Give a new variable its place on the stack."""
        place = self.name(stem)
        self.allocated.append(f"  {place} = alloca {LLVM[kind]}")
        return place

    def store(self, value: Value, place: str) -> None:
        """Store a value."""
        self.lines.append(f"  store {LLVM[value.kind]} {value.text}, ptr {place}")

    def jump(self, label: str) -> None:
        """End a block by going to `label`."""
        self.lines.append(f"  br label {label}")

    def branch(self, test: Value, yes: str, no: str) -> None:
        """End a block by going to one of two labels."""
        self.lines.append(f"  br i1 {test.text}, label {yes}, label {no}")

    def start(self, label: str) -> None:
        """Start the block `label`."""
        self.lines.append(f"{label[1:]}:")

    @contextlib.contextmanager
    def aside(self) -> Iterator[list[str]]:
        """Collect lines apart, to be added later."""
        kept, self.lines = self.lines, []
        try:
            yield self.lines
        finally:
            self.lines = kept

    def cast(self, value: Value, kind: str, node: ast.AST, what: str) -> Value:
        """Convert int to float, leave the same kind, refuse the rest."""
        if value.kind == kind:
            return value
        if (value.kind, kind) == ("int", "float"):
            return self.op("float", f"sitofp i64 {value.text} to double")
        advice = ""
        if (value.kind, kind) == ("float", "int"):
            advice = "; write int(...) if that is meant"
        elif kind == "bool":
            advice = "; compare it"
        raise self.source.error(node, f"{what} is {value.kind}, not {kind}{advice}")

    def literal(self, node: ast.AST, known: Static) -> Value:
        """Give a number or a condition known at translation."""
        if isinstance(known, bool):
            return Value("true" if known else "false", "bool")
        if isinstance(known, int):
            if not -(2**63) <= known < 2**63:
                raise self.source.error(node, f"{known} does not fit 64 bits")
            return Value(str(known), "int")
        if isinstance(known, float):
            [bits] = struct.unpack("<Q", struct.pack("<d", known))
            return Value(f"0x{bits:016X}", "float")
        raise self.source.error(
            node, f"`{ast.unparse(node)}` is a table; take one number of it"
        )

    def together(self, *values: Value) -> tuple[list[Value], str]:
        """Give numbers the kind they have in common."""
        found = {v.kind for v in values}
        kind = "float" if "float" in found else "int"
        return [
            self.cast(v, kind, self.source.node, "an operand") for v in values
        ], kind

    def libm(self, name: str, *values: Value) -> Value:
        """Call a function of the C library."""
        types = ", ".join("double" for _ in values)
        self.program.declare(f"declare double @{name}({types}) nounwind memory(none)")
        passed = ", ".join(f"double {v.text}" for v in values)
        return self.op(
            "float", f"call double @{name}({passed}) nobuiltin nounwind memory(none)"
        )

    def intrinsic(self, name: str, *values: Value) -> Value:
        """Emit a function that is exact in IEEE 754."""
        types = ", ".join("double" for _ in values)
        self.program.declare(f"declare double @llvm.{name}.f64({types})")
        passed = ", ".join(f"double {v.text}" for v in values)
        return self.op("float", f"call double @llvm.{name}.f64({passed})")

    def exponent(self, x: Value) -> Value:
        """Emit the exponent of a number, see `words`."""
        bits = self.op("bits", f"bitcast double {x.text} to i64").text
        bits = self.op("bits", f"lshr i64 {bits}, 52").text
        bits = self.op("bits", f"and i64 {bits}, 2047").text
        bits = self.op("bits", f"or i64 {bits}, {_WHOLE}").text
        whole = self.op("bits", f"bitcast i64 {bits} to double").text
        less = self.literal(self.source.node, _BIASED).text
        return self.op("float", f"fsub double {whole}, {less}")

    def mantissa(self, x: Value) -> Value:
        """Emit the mantissa of a number, see `words`."""
        bits = self.op("bits", f"bitcast double {x.text} to i64").text
        bits = self.op("bits", f"and i64 {bits}, {_PLACES}").text
        bits = self.op("bits", f"or i64 {bits}, {_ONE}").text
        return Value(self.op("bits", f"bitcast i64 {bits} to double").text, "float")

    def two_to(self, k: Value) -> Value:
        """Emit a power of two, see `words`."""
        more = self.literal(self.source.node, _ROUNDER).text
        last = self.op("float", f"fadd double {k.text}, {more}").text
        bits = self.op("bits", f"bitcast double {last} to i64").text
        bits = self.op("bits", f"shl i64 {bits}, 52").text
        return Value(self.op("bits", f"bitcast i64 {bits} to double").text, "float")

    def helper(self, kind: str, name: str, *values: Value) -> Value:
        """Emit a call of a function that is part of the text."""
        self.program.declare(_HELPERS[name])
        passed = ", ".join(f"{LLVM[v.kind]} {v.text}" for v in values)
        call = f"call {LLVM[kind]} @{name}({passed})"
        if kind != "None":
            return self.op(kind, call)
        self.lines.append(f"  {call}")
        return Value("", kind)

    def floored(self, helper: str, left: Value, right: Value) -> Value:
        """Emit `//` or `%` of integers."""
        return self.helper("int", helper, left, right)
