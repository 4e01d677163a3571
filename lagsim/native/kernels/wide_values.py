"""Values, masks and conditions of kernels of several states; see `wide`."""

from __future__ import annotations

import ast
import re
from typing import TYPE_CHECKING, Final

from lagsim.native.kernels.lines import LANES, LLVM, Value
from lagsim.native.kernels.statements import Statements
from lagsim.native.layout import NUMBER, SIZE

if TYPE_CHECKING:
    from collections.abc import Callable

    from lagsim.native.kernels.keys import Static
    from lagsim.native.kernels.lines import Program
    from lagsim.native.kernels.source import Source

VECTOR: Final = f"<{LANES} x double>"
WHOLE: Final = f"<{LANES} x i64>"
FLAGS: Final = LLVM["flags"]
ALL: Final = f"<{', '.join(['i1 true'] * LANES)}>"
TYPES: Final = LLVM | {"float": VECTOR, "bool": FLAGS}
# LLVM prefers two registers of half the length on some processors.
WIDEST: Final = '"prefer-vector-width"="512" "min-legal-vector-width"="512"'


# A type, and no part of a vector that is written out.
_NUMBER: Final = re.compile(r"\bdouble\b(?! 0x)")


def _widened(text: str) -> str:
    return _NUMBER.sub(VECTOR, text)


def symbol(name: str) -> str:
    """Give the symbol of a function of a model that takes LANES states at once."""
    return f"{name}.lanes"


def declaration(source: Source) -> str:
    """Give that of an external."""
    pointers = ", ".join("ptr" for _ in source.parameters)
    return f"declare void @{symbol(source.name)}({pointers}) nounwind"


class WideValues(Statements):
    """The expressions of one function, of LANES states.

    A vector has one element, and so is a number.
    """

    vector = "float"
    abreast = 1

    def __init__(self, source: Source, program: Program) -> None:
        super().__init__(source, program)
        self._masks: list[str] = []  # of the conditions around the present place
        self._open = True  # whether its block has no end yet

    # Blocks.

    def start(self, label: str) -> None:
        """Start the block `label`."""
        super().start(label)
        self._open = True

    def jump(self, label: str) -> None:
        """End a block by going to `label`."""
        super().jump(label)
        self._open = False

    def branch(self, test: Value, yes: str, no: str) -> None:
        """End a block by going to one of two labels."""
        super().branch(test, yes, no)
        self._open = False

    def _leave(self, label: str) -> None:
        if self._open:
            self.jump(label)
        self.live = False

    # Values.

    def op(self, kind: str, text: str) -> Value:
        """Add an instruction with a result."""
        if kind == "Floats":
            text = text.replace(
                "getelementptr inbounds double", f"getelementptr inbounds {VECTOR}"
            )
        elif kind == "float":
            align = ", align 8" if text.startswith("load") else ""
            text = text.replace("select i1", f"select {FLAGS}")
            text = _widened(text) + align
        elif text.startswith("fcmp"):
            return super().op("flags", _widened(text))
        return super().op(kind, text)

    def _one(self, kind: str, text: str) -> Value:
        """Add an instruction on one number."""
        return super().op(kind, text)

    def _spread(self, value: Value, kind: str, llvm: str) -> Value:
        """Give all lanes the same."""
        one = f"insertelement <{LANES} x {llvm}> poison, {llvm} {value.text}, i32 0"
        first = self._one(kind, one).text
        vector = f"<{LANES} x {llvm}>"
        rest = f"{vector} poison, <{LANES} x i32> zeroinitializer"
        return self._one(kind, f"shufflevector {vector} {first}, {rest}")

    def _lane(self, value: Value, lane: int) -> Value:
        """Give the number of a lane."""
        return self._one("one", f"extractelement {VECTOR} {value.text}, i32 {lane}")

    def literal(self, node: ast.AST, known: Static) -> Value:
        """Give a number or a condition known at translation."""
        value = super().literal(node, known)
        if value.kind != "float":
            return value
        return Value(f"<{', '.join([f'double {value.text}'] * LANES)}>", "float")

    def cast(self, value: Value, kind: str, node: ast.AST, what: str) -> Value:
        """Convert what is the same in all lanes to what need not be."""
        if (value.kind, kind) == ("int", "float"):
            one = self._one("one", f"sitofp i64 {value.text} to double")
            return self._spread(one, "float", "double")
        if (value.kind, kind) == ("bool", "flags"):
            return self._spread(value, "flags", "i1")
        if (value.kind, kind) == ("flags", "bool"):
            return value
        return super().cast(value, kind, node, what)

    def allocate(self, stem: str, kind: str) -> str:
        """Give a new variable its place on the stack."""
        place = self.name(stem)
        llvm = VECTOR if kind == "float" else LLVM[kind]
        self.allocated.append(f"  {place} = alloca {llvm}")
        return place

    def store(self, value: Value, place: str) -> None:
        """Store a value, in all lanes."""
        llvm = VECTOR if value.kind == "float" else LLVM[value.kind]
        align = ", align 8" if value.kind == "float" else ""
        self.lines.append(f"  store {llvm} {value.text}, ptr {place}{align}")

    def libm(self, name: str, *values: Value) -> Value:
        """Call a function of the C library, lane by lane."""
        found = "poison"
        for lane in range(LANES):
            numbers = [self._lane(value, lane) for value in values]
            types = ", ".join("double" for _ in values)
            self.program.declare(
                f"declare double @{name}({types}) nounwind memory(none)"
            )
            passed = ", ".join(f"double {v.text}" for v in numbers)
            call = f"call double @{name}({passed}) nobuiltin nounwind memory(none)"
            one = self._one("one", call).text
            place = f"insertelement {VECTOR} {found}, double {one}, i32 {lane}"
            found = self._one("float", place).text
        return Value(found, "float")

    def intrinsic(self, name: str, *values: Value) -> Value:
        """Emit a function that is exact in IEEE 754."""
        types = ", ".join(VECTOR for _ in values)
        self.program.declare(f"declare {VECTOR} @llvm.{name}.v{LANES}f64({types})")
        passed = ", ".join(f"{VECTOR} {v.text}" for v in values)
        call = f"call {VECTOR} @llvm.{name}.v{LANES}f64({passed})"
        return self._one("float", call)

    # Vectors.

    def _kept(self, value: Value, place: Value, count: Value) -> Value:  # noqa: ARG002
        self._keep(value, place.text)
        return Value("", "None")

    def _above(self, v: Value, w: Value, yes: Value, no: Value) -> Value:
        test = self.compared(self.source.node, ast.Gt(), v, w)
        return self._one(
            "float",
            f"select {FLAGS} {test.text}, {VECTOR} {yes.text}, {VECTOR} {no.text}",
        )

    def _head(self, count: Value, v: Value, w: Value) -> Value:
        test = self._one("bool", f"icmp sgt i64 {count.text}, 0")
        two = f"{VECTOR} {v.text}, {VECTOR} {w.text}"
        return self._one("float", f"select i1 {test.text}, {two}")

    def _largest(self, value: Value) -> Value:
        zero = self.literal(self.source.node, 0.0)
        return self._above(value, zero, value, zero)

    def bits(self, text: str) -> Value:
        """Add an instruction on the bits of numbers."""
        operation, kind, *operands = text.replace(",", "").split()
        if operation == "bitcast":
            return self._one("bits", _widened(text).replace("i64", WHOLE))
        value, last = operands
        each = ", ".join([f"{kind} {last}"] * LANES)
        return self._one("bits", f"{operation} {WHOLE} {value}, <{each}>")

    def _truncated(self, value: Value) -> Value:
        return super()._truncated(self._lane(value, 0))

    def _load_field(self, node: ast.Attribute) -> Value:
        memory, place, field = self.word(node)
        if field.kind == NUMBER:
            return self.op("float", f"load double, ptr {place}")
        load = f"load double, ptr {place}, align 8, !invariant.load !{{}}"
        value = self._one("one", load)
        whole = self._one("int", f"fptosi double {value.text} to i64")
        if field.kind == SIZE:
            return whole
        text = f"getelementptr inbounds double, ptr {memory}, i64 {whole.text}"
        return self.op("Floats", text)

    # Conditions.

    def condition(self, node: ast.expr) -> Value:
        """Emit an expression that must be a condition."""
        value = self.expression(node)
        return value if value.kind == "flags" else self._plain_condition(node, value)

    def _plain_condition(self, node: ast.expr, value: Value) -> Value:
        if value.kind != "bool":
            text = f"`{ast.unparse(node)}` is {value.kind}, not a condition"
            raise self.source.error(node, text)
        return value

    def _emit_unary(self, node: ast.UnaryOp) -> Value:
        if isinstance(node.op, ast.Not):
            return self._opposite(self.condition(node.operand))
        return super()._emit_unary(node)

    def _opposite(self, test: Value) -> Value:
        if test.kind == "flags":
            return self._one("flags", f"xor {FLAGS} {test.text}, {ALL}")
        return self._one("bool", f"xor i1 {test.text}, true")

    def _both(self, operation: str, left: str, right: str) -> str:
        return self._one("flags", f"{operation} {FLAGS} {left}, {right}").text

    def _mask(self) -> str:
        """Give the lanes that the present place is reached in."""
        alive = self._one("flags", f"load {FLAGS}, ptr %alive").text
        return self._both("and", self._masks[-1], alive) if self._masks else alive

    def _any(self, mask: str) -> Value:
        bits = self._one("bits", f"bitcast {FLAGS} {mask} to i{LANES}").text
        return self._one("bool", f"icmp ne i{LANES} {bits}, 0")

    def _within(self, mask: str, make: Callable[[], Value]) -> Value:
        """Emit what is only wanted in some lanes."""
        self._masks.append(mask)
        value = make()
        self._masks.pop()
        return value

    def _lazily(
        self, first: Value, second: Callable[[], Value], *, until: bool
    ) -> Value:
        if first.kind == "bool":
            return self._lazily_all(first, second, until=until)
        wanted = self._opposite(first).text if until else first.text
        place = self.allocate("b", "flags")
        self.store(first, place)
        more, end = self.name("more"), self.name("end")
        mask = self._both("and", self._mask(), wanted)
        self.branch(self._any(mask), more, end)
        self.start(more)
        value = self._within(mask, second)
        value = self.cast(value, "flags", self.source.node, "a condition")
        either = self._both("or" if until else "and", first.text, value.text)
        self.store(Value(either, "flags"), place)
        self.jump(end)
        self.start(end)
        return self._one("flags", f"load {FLAGS}, ptr {place}")

    def _lazily_all(
        self, first: Value, second: Callable[[], Value], *, until: bool
    ) -> Value:
        """Do it where the first condition is the same in all lanes."""
        with self.aside() as lines:
            value = second()
        kind = value.kind
        place = self.allocate("b", kind)
        more, end = self.name("more"), self.name("end")
        same = self.cast(first, kind, self.source.node, "a condition")
        self.store(same, place)
        self.branch(first, *((end, more) if until else (more, end)))
        self.start(more)
        self.lines += lines
        self.store(value, place)
        self.jump(end)
        self.start(end)
        return self._one(kind, f"load {LLVM[kind]}, ptr {place}")

    def _emit_choice(self, node: ast.IfExp) -> Value:
        known = self.fold(node.test)
        if known is not None:
            return self.expression(node.body if known else node.orelse)
        with self.aside():
            kind = self.condition(node.test).kind
        if kind == "bool":
            return super()._emit_choice(node)
        test = self.condition(node.test)
        mask = self._mask()
        other = self._opposite(test)
        first = self._both("and", mask, test.text)
        second = self._both("and", mask, other.text)
        yes = self._within(first, lambda: self.expression(node.body))
        no = self._within(second, lambda: self.expression(node.orelse))
        if yes.kind == "int":
            yes = self.cast(yes, "float", node, "one of the two values")
        no = self.cast(no, yes.kind, node, "one of the two values")
        llvm = VECTOR if yes.kind == "float" else LLVM[yes.kind]
        text = f"select {FLAGS} {test.text}, {llvm} {yes.text}, {llvm} {no.text}"
        return self._one(yes.kind, text)
