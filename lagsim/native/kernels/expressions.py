"""Expressions of kernels in LLVM IR: values, operators, choices, calls.

No fast-math flags and no contraction: every operation is rounded as CPython rounds it.
sqrt, floor, fabs and copysign are exact in IEEE 754 and become instructions; the other
functions are those of the C library that CPython calls, marked `nobuiltin` so that LLVM
does not put its own idea in their place (with glibc 2.36, pow(x, 2.0) differs from x*x
for about one x in a thousand).
"""

from __future__ import annotations

import ast
import builtins
import contextlib
import math
import struct
from types import FunctionType
from typing import TYPE_CHECKING, Any, Final, NamedTuple, Protocol

from lagsim.native.kernels import words
from lagsim.native.kernels.source import Folding, Source, unsupported
from lagsim.native.layout import NUMBER, SIZE

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from lagsim.native.kernels.keys import Static
    from lagsim.native.layout import Field


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


_ARITHMETIC: Final[dict[type[ast.operator], str]] = {
    ast.Add: "add",
    ast.Sub: "sub",
    ast.Mult: "mul",
}
_FLOORED: Final[dict[type[ast.operator], str]] = {
    ast.FloorDiv: "int.floordiv",
    ast.Mod: "int.mod",
}
_COMPARISONS: Final[dict[type[ast.cmpop], tuple[str, str]]] = {
    ast.Lt: ("slt", "olt"),
    ast.LtE: ("sle", "ole"),
    ast.Gt: ("sgt", "ogt"),
    ast.GtE: ("sge", "oge"),
    ast.Eq: ("eq", "oeq"),
    ast.NotEq: ("ne", "une"),
}


class Expressions(Lines):
    """The expressions of one function, but for calls.

    Attributes
    ----------
    kinds : dict
        Kind of each variable, in the order of their first assignment.
    assigned : set
        Variables that certainly have a value at the present place.
    """

    def __init__(self, source: Source, program: Program) -> None:
        super().__init__(source, program)
        self.kinds: dict[str, str] = {}
        self.assigned: set[str] = set()
        self.emitters: dict[type[ast.AST], Callable[[Any], Value]] = {
            ast.Name: self._load_name,
            ast.Subscript: self._load_element,
            ast.Attribute: self._load_field,
            ast.UnaryOp: self._emit_unary,
            ast.BinOp: self._emit_binary,
            ast.Compare: self._emit_compare,
            ast.BoolOp: self._emit_logical,
            ast.IfExp: self._emit_choice,
        }

    def expression(self, node: ast.expr) -> Value:
        """Emit an expression."""
        known = self.fold(node)
        if known is not None:
            return self.literal(node, known)
        emitter = self.emitters.get(type(node))
        if emitter is None:
            unsupported(self.source, node)
        return emitter(node)

    def converted(self, node: ast.expr, kind: str, what: str) -> Value:
        """Emit an expression as a value of `kind`."""
        return self.cast(self.expression(node), kind, node, what)

    def number(self, node: ast.expr) -> Value:
        """Emit an expression that must be an int or a float."""
        value = self.expression(node)
        if value.kind not in ("int", "float"):
            raise self.source.error(
                node, f"`{ast.unparse(node)}` is {value.kind}, not a number"
            )
        return value

    def condition(self, node: ast.expr) -> Value:
        """Emit an expression that must be a condition."""
        value = self.expression(node)
        if value.kind != "bool":
            raise self.source.error(
                node,
                f"`{ast.unparse(node)}` is {value.kind}, not a condition; compare it",
            )
        return value

    def _load_name(self, node: ast.Name) -> Value:
        name = node.id
        if name not in self.source.variables:
            found = type(self.source.meaning(node)).__name__
            raise self.source.error(
                node,
                f"global `{name}` is {found}; globals are int, float, bool or tuples "
                "of them",
            )
        if name not in self.assigned:
            raise self.source.error(
                node,
                f"`{name}` may be without a value here; assign it before the branch or "
                "loop that does",
            )
        kind = self.kinds[name]
        return self.op(kind, f"load {LLVM[kind]}, ptr {stack_place(name)}")

    def element(self, node: ast.Subscript) -> str:
        """Emit the address of an element of an array."""
        if isinstance(node.slice, ast.Slice | ast.Tuple):
            unsupported(self.source, node.slice)
        base = self.converted(
            node.value, "Floats", f"`{ast.unparse(node.value)}`, which is indexed,"
        )
        known = self.fold(node.slice)
        if isinstance(known, int) and known < 0:
            raise self.source.error(
                node, f"index {known}: an array does not know its end; count from 0"
            )
        index = self.converted(node.slice, "int", "an index")
        return self.op(
            "Floats",
            f"getelementptr inbounds double, ptr {base.text}, i64 {index.text}",
        ).text

    def _load_element(self, node: ast.Subscript) -> Value:
        return self.op("float", f"load double, ptr {self.element(node)}")

    def word(self, node: ast.expr) -> tuple[str, str, Field]:
        """Emit the address of a memory's word: the memory, the address, the field."""
        found = self.source.field(node)
        if found is None:
            unsupported(self.source, node)
        name, field = found
        memory = self.op("Floats", f"load ptr, ptr {stack_place(name)}").text
        place = f"getelementptr inbounds double, ptr {memory}, i64 {field.word}"
        return memory, self.op("Floats", place).text, field

    def number_place(self, node: ast.expr) -> str:
        """Emit the address of a number that may be stored."""
        found = self.source.field(node)
        if found is None or found[1].kind != NUMBER:
            raise self.source.error(
                node,
                f"`{ast.unparse(node)}` takes no value; a name, an element or a number "
                "of a memory",
            )
        return self.word(node)[1]

    def _load_field(self, node: ast.Attribute) -> Value:
        memory, place, field = self.word(node)
        if field.kind == NUMBER:
            return self.op("float", f"load double, ptr {place}")
        # Sizes and places stay: what is stored in between is no reason to load again.
        value = self.op("float", f"load double, ptr {place}, !invariant.load !{{}}")
        whole = self.op("int", f"fptosi double {value.text} to i64")
        if field.kind == SIZE:
            return whole
        return self.op(
            "Floats", f"getelementptr inbounds double, ptr {memory}, i64 {whole.text}"
        )

    # Operators.

    def _emit_unary(self, node: ast.UnaryOp) -> Value:
        if isinstance(node.op, ast.Not):
            return self.op("bool", f"xor i1 {self.condition(node.operand).text}, true")
        value = self.number(node.operand)
        if not isinstance(node.op, ast.USub):
            unsupported(self.source, node)
        if value.kind != "int":
            return self.op(value.kind, f"fneg {LLVM[value.kind]} {value.text}")
        return self.op("int", f"sub i64 0, {value.text}")

    def _emit_binary(self, node: ast.BinOp) -> Value:
        left = self.number(node.left)
        return self.arithmetic(node, left, node.op, self.number(node.right))

    def arithmetic(
        self, node: ast.AST, left: Value, op: ast.operator, right: Value
    ) -> Value:
        """Emit `left op right`."""
        if isinstance(op, ast.Pow) and left.kind == right.kind == "int":
            raise self.source.error(
                node, "a power of integers; write the product, or float(...) ** ..."
            )
        if isinstance(op, ast.Pow | ast.Div):
            left = self.cast(left, "float", node, "an operand")
            right = self.cast(right, "float", node, "an operand")
        (left, right), kind = self.together(left, right)
        operands = f"{left.text}, {right.text}"
        if isinstance(op, ast.Div):
            return self.op(kind, f"fdiv {LLVM[kind]} {operands}")
        if isinstance(op, ast.Pow):
            return self.libm("pow", left, right)
        if type(op) in _ARITHMETIC:
            prefix = "" if kind == "int" else "f"
            return self.op(
                kind, f"{prefix}{_ARITHMETIC[type(op)]} {LLVM[kind]} {operands}"
            )
        if type(op) not in _FLOORED:
            unsupported(self.source, node)
        if kind != "int":
            raise self.source.error(
                node, "`//` and `%` are of integers; write floor(...)"
            )
        return self.floored(_FLOORED[type(op)], left, right)

    def _emit_compare(self, node: ast.Compare) -> Value:
        operands = [node.left, *node.comparators]
        left = self.expression(operands[0])
        rest = list(zip(node.ops, operands[1:], strict=True))
        return self._chain(node, left, rest)

    def _chain(
        self, node: ast.Compare, left: Value, rest: list[tuple[ast.cmpop, ast.expr]]
    ) -> Value:
        (op, operand), *later = rest
        right = self.expression(operand)
        first = self.compared(node, op, left, right)
        if not later:
            return first
        return self._lazily(first, lambda: self._chain(node, right, later), until=False)

    def compared(
        self, node: ast.AST, op: ast.cmpop, left: Value, right: Value
    ) -> Value:
        """Emit the comparison of two numbers."""
        if type(op) not in _COMPARISONS:
            unsupported(self.source, node)
        integer, floating = _COMPARISONS[type(op)]
        for value in (left, right):
            if value.kind not in ("int", "float"):
                raise self.source.error(
                    node, f"`{ast.unparse(node)}` compares {value.kind}, not numbers"
                )
        (left, right), kind = self.together(left, right)
        relation = f"fcmp {floating}" if kind == "float" else f"icmp {integer}"
        return self.op("bool", f"{relation} {LLVM[kind]} {left.text}, {right.text}")

    def _lazily(
        self, first: Value, second: Callable[[], Value], *, until: bool
    ) -> Value:
        """Emit `second` only where `first` is not `until`, which else is the result."""
        place = self.allocate("b", "bool")
        more, end = self.name("more"), self.name("end")
        self.store(first, place)
        self.branch(first, *((end, more) if until else (more, end)))
        self.start(more)
        self.store(second(), place)
        self.jump(end)
        self.start(end)
        return self.op("bool", f"load i1, ptr {place}")

    def _emit_logical(self, node: ast.BoolOp) -> Value:
        until = isinstance(node.op, ast.Or)
        # Operands known to decide nothing are left out.
        operands = [v for v in node.values if self.fold(v) is not (not until)]
        return self._operands(operands, until=until)

    def _operands(self, operands: list[ast.expr], *, until: bool) -> Value:
        first = self.condition(operands[0])
        if len(operands) == 1:
            return first
        return self._lazily(
            first, lambda: self._operands(operands[1:], until=until), until=until
        )

    def _emit_choice(self, node: ast.IfExp) -> Value:
        known = self.fold(node.test)
        if known is not None:
            return self.expression(node.body if known else node.orelse)
        test = self.condition(node.test)
        with self.aside() as yes_lines:
            yes = self.expression(node.body)
        with self.aside() as no_lines:
            no = self.expression(node.orelse)
        kind = yes.kind
        place = self.allocate("choice", kind)
        yes_label, no_label, end = map(self.name, ("yes", "no", "end"))
        self.branch(test, yes_label, no_label)
        for label, lines, value in (
            (yes_label, yes_lines, yes),
            (no_label, no_lines, no),
        ):
            self.start(label)
            self.lines += lines
            self.store(self.cast(value, kind, node, "one of the two values"), place)
            self.jump(end)
        self.start(end)
        return self.op(kind, f"load {LLVM[kind]}, ptr {place}")


_LIBM_NAMES: Final = """
acos asin atan atan2 cos cosh exp expm1 log log1p pow sin sinh tan tanh
"""
_LIBM: Final = {getattr(math, name): name for name in _LIBM_NAMES.split()}
_INTRINSICS: Final[dict[object, str]] = {
    math.sqrt: "sqrt",
    math.fabs: "fabs",
    math.copysign: "copysign",
}
_TWO_ARGUMENTS: Final = frozenset({math.pow, math.atan2, math.copysign})


class Calls(Expressions):
    """The expressions of one function, calls too."""

    def __init__(self, source: Source, program: Program) -> None:
        super().__init__(source, program)
        self.emitters[ast.Call] = self._emit_call
        self._calls: dict[object, Callable[[ast.Call], Value]] = {
            min: self._call_extremum,
            max: self._call_extremum,
            abs: self._call_abs,
            int: self._call_int,
            float: self._call_float,
            math.floor: self._call_floor,
            words.at: self._call_at,
            words.total: self._call_total,
            words.fused: lambda node: self.intrinsic("fma", *self._floats(node, 3)),
            words.exponent: lambda node: self.exponent(*self._floats(node, 1)),
            words.mantissa: lambda node: self.mantissa(*self._floats(node, 1)),
            words.two_to: lambda node: self.two_to(*self._floats(node, 1)),
        }

    def _emit_call(self, node: ast.Call) -> Value:
        if not isinstance(node.func, ast.Name | ast.Attribute):
            unsupported(self.source, node)
        if isinstance(node.func, ast.Name) and node.func.id in self.source.variables:
            raise self.source.error(node, f"`{node.func.id}` is a variable here")
        if node.keywords or any(isinstance(a, ast.Starred) for a in node.args):
            raise self.source.error(node, "arguments are positional, without *")
        function = self.source.meaning(node.func)
        if function in self._calls:
            return self._calls[function](node)
        if function in _LIBM or function in _INTRINSICS:
            return self._call_math(node, function)
        if isinstance(function, FunctionType) and (
            function.__module__ != words.__name__
        ):
            return self._call_kernel(node, function)
        advice = _CALL_ADVICE.get(function, "kernels call kernels, externals and math")
        raise self.source.error(
            node, f"`{ast.unparse(node.func)}(...)` is not of the subset; {advice}"
        )

    def _arguments(self, node: ast.Call, count: int) -> list[ast.expr]:
        if len(node.args) != count:
            raise self.source.error(
                node,
                f"`{ast.unparse(node.func)}` takes {count} arguments here, not "
                f"{len(node.args)}",
            )
        return node.args

    def _call_kernel(self, node: ast.Call, function: FunctionType) -> Value:
        symbol, source = self.program.callee(function)
        if not isinstance(node.func, ast.Name):
            raise self.source.error(
                node, f"import `{source.name}` by name, so that bind can replace it"
            )
        arguments = self._arguments(node, len(source.parameters))
        passed = []
        for argument, (name, kind) in zip(arguments, source.parameters, strict=True):
            what = f"argument `{name}` of {source.name}"
            value = self.converted(argument, kind, what)
            passed.append(f"{PASSED[kind]} {value.text}")
        call = f"call {RETURNED[source.result]} @{symbol}({', '.join(passed)})"
        if source.result == "None":
            self.lines.append(f"  {call}")
            return Value("", "None")
        return self.op(source.result, call)

    def _floats(self, node: ast.Call, count: int) -> list[Value]:
        return [
            self.cast(self.number(a), "float", a, "an argument")
            for a in self._arguments(node, count)
        ]

    def _call_math(self, node: ast.Call, function: Any) -> Value:
        values = self._floats(node, 2 if function in _TWO_ARGUMENTS else 1)
        if function in _LIBM:
            return self.libm(_LIBM[function], *values)
        return self.intrinsic(_INTRINSICS[function], *values)

    def _call_extremum(self, node: ast.Call) -> Value:
        if len(node.args) < 2:
            raise self.source.error(node, "min and max take two numbers or more")
        values, kind = self.together(*map(self.number, node.args))
        smallest = self.source.meaning(_callee(node)) is min
        op = ast.Lt() if smallest else ast.Gt()
        best = values[0]
        for value in values[1:]:
            # As CPython: a later one only where it is beyond, so never for nan.
            better = self.compared(node, op, value, best)
            llvm = LLVM[kind]
            best = self.op(
                kind,
                f"select i1 {better.text}, {llvm} {value.text}, {llvm} {best.text}",
            )
        return best

    def _call_abs(self, node: ast.Call) -> Value:
        value = self.number(*self._arguments(node, 1))
        if value.kind != "int":
            return self.intrinsic("fabs", value)
        negative = self.op("bool", f"icmp slt i64 {value.text}, 0")
        opposite = self.op("int", f"sub i64 0, {value.text}")
        return self.op(
            "int",
            f"select i1 {negative.text}, i64 {opposite.text}, i64 {value.text}",
        )

    def _call_int(self, node: ast.Call) -> Value:
        value = self.expression(*self._arguments(node, 1))
        return self._truncated(self.cast(value, "float", node, "the argument"))

    def _truncated(self, value: Value) -> Value:
        # Saturating: plain fptosi of nan or 1e300, where Python raises, is anything.
        self.program.declare("declare i64 @llvm.fptosi.sat.i64.f64(double)")
        return self.op("int", f"call i64 @llvm.fptosi.sat.i64.f64(double {value.text})")

    def _call_float(self, node: ast.Call) -> Value:
        [argument] = self._arguments(node, 1)
        return self.converted(argument, "float", "the argument")

    def _call_floor(self, node: ast.Call) -> Value:
        return self._truncated(self.intrinsic("floor", *self._floats(node, 1)))

    def _call_at(self, node: ast.Call) -> Value:
        array, index = self._arguments(node, 2)
        view = ast.copy_location(ast.Subscript(array, index, ast.Load()), node)
        return Value(self.element(view), "Floats")

    def _call_total(self, node: ast.Call) -> Value:
        [terms] = self._arguments(node, 1)
        if (
            not isinstance(terms, ast.GeneratorExp)
            or len(terms.generators) != 1
            or terms.generators[0].ifs
        ):
            raise self.source.error(
                node, "write total(expression for j in unrolled(...))"
            )
        loop = terms.generators[0]
        result: Value | None = None
        for _ in self.unrolled_values(loop.target, loop.iter):
            if self.vanishes(terms.elt):
                continue
            term = self.cast(self.number(terms.elt), "float", terms.elt, "a term")
            result = (
                term
                if result is None
                else self.op("float", f"fadd double {result.text}, {term.text}")
            )
        return self.literal(node, 0.0) if result is None else result

    def unrolled_values(self, target: ast.expr, iterable: ast.expr) -> Iterator[int]:
        """Go through the values of an `unrolled(...)`, its variable being static."""
        bounds = self.unrolled_bounds(iterable)
        if bounds is None:
            raise self.source.error(
                iterable, "total(...) goes over unrolled(...); write a loop otherwise"
            )
        if not isinstance(target, ast.Name):
            raise self.source.error(target, "the variable of a loop is one name")
        outer = self.loops.pop(target.id, None)
        for value in bounds:
            self.loops[target.id] = value
            yield value
        self.loops.pop(target.id, None)
        if outer is not None:
            self.loops[target.id] = outer

    def unrolled_bounds(self, iterable: ast.expr) -> range | None:
        """Give the range of an `unrolled(...)`, None for anything else."""
        if not isinstance(iterable, ast.Call) or (
            not isinstance(iterable.func, ast.Name | ast.Attribute)
            or self.source.meaning(iterable.func) is not words.unrolled
        ):
            return None
        bounds = self.fold_integers(iterable.args, "bound")
        try:
            return range(*bounds)
        except (TypeError, ValueError) as fault:
            raise self.source.error(iterable, f"unrolled: {fault}") from fault


def _callee(node: ast.Call) -> ast.Name | ast.Attribute:
    assert isinstance(node.func, ast.Name | ast.Attribute)
    return node.func


_CALL_ADVICE: Final[dict[object, str]] = {
    sum: "write total(...): sum is compensated from Python 3.12 on",
    range: "it stands in `for` only",
    words.unrolled: "it stands in `for` and total only",
    len: "pass the length",
    print: "return a status",
    math.hypot: "CPython's differs from the C library's; write sqrt(x*x + y*y)",
    math.fsum: "write total(...)",
    math.fmod: "write %, or what is meant with int(...)",
    math.isinf: "write abs(x) == inf",
    math.isnan: "write x != x",
    math.isfinite: "write abs(x) < inf",
    math.ceil: "write -floor(-x)",
    builtins.round: "write floor(x + 0.5)",
}
