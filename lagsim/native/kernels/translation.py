"""Kernels: a small typed subset of Python -> LLVM IR.

A kernel is a plain function. Its parameters are annotated with int, float, bool,
`Floats` or a `Memory`, its result with int, float, bool or None. It may contain

- numbers and conditions: `+ - * / **`, comparisons, `and or not`, `a if c else b`,
  `min max abs int float`, sqrt, floor, pow, sin, ... of `math`; `//` and `%` of an
  integer by a positive static integer;
- memory: `s.t`, `s.t = x`, `s.y` of a parameter annotated with a `layout.Memory`;
- arrays: `a[i]`, the view `a[k:]`, tuples of targets (`a, b = b, a`); assignment to a
  slice, element by element, `s.y[:] = s.old + h * a[:n]`, also `+=`: operands on the
  right are numbers, and arrays as long as the slice that either coincide with it or do
  not overlap it;
- blocks that a memory declares: `a[s.half]` is the slice from `s.half.start` to
  `s.half.stop`;
- `if while for break continue return pass`, `for i in range(...)`, or `apart(n)` for
  loops whose passes access disjoint elements, which are then vectorised;
- calls of other kernels and of functions marked `external`, by name or as attributes of
  their modules, `newton.solve(...)`;
- `bits(x)`, the bits of a number, and its inverse `from_bits(k)`;
- static values: numbers and tables (tuples of numbers) among the module's globals,
  parameters that are `Static`, the variables of loops over `unrolled`, and values
  computed from these alone. An `if` on a static value is decided at translation, and
  the other branch is not read; `for j in unrolled(...)` and
  `total(... for j in unrolled(...))` are unrolled, and terms with a factor of zero
  vanish. A table of floats may have an index that is not static.

A variable has the kind of its first assignment: an int stored into a float variable is
converted, the reverse is an error. mypy checks that a variable has a value wherever it
is read (`possibly-undefined`), and that no result is missing.

Native code has the bits of CPython: no fast-math flags and no contraction, every
operation is rounded as CPython rounds it. sqrt, floor, fabs, copysign and fma are exact
in IEEE 754 and become instructions; the other functions are those of the C library that
CPython calls, marked `nobuiltin` so that LLVM does not replace the calls (with glibc
2.36, pow(x, 2.0) differs from x*x for about one x in a thousand). Results differ where
CPython raises or has a larger range: division by zero, sqrt(-1.0), exp(1e3) return inf
or nan; int(nan) is 0, int(1e300) the largest integer; integers wrap at 64 bits; indices
are not checked, and negative ones do not count from the end.
"""

from __future__ import annotations

import ast
import math
import struct
from functools import partial
from types import FunctionType
from typing import TYPE_CHECKING, Any, Final, TypeGuard

from lagsim.native.kernels import words
from lagsim.native.kernels.instructions import (
    LLVM,
    PASSED,
    RETURNED,
    Instructions,
    Value,
)
from lagsim.native.kernels.keys import KernelError, as_kernel
from lagsim.native.kernels.source import (
    Folding,
    KernelText,
    parameters,
    static_parameters,
)
from lagsim.native.layout import BLOCK, NUMBER, SIZE

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from lagsim.native.kernels.keys import Static
    from lagsim.native.layout import Field


def translate(
    functions: Sequence[Callable[..., Any]], statics: Mapping[str, object] | None = None
) -> str:
    """Translate kernels, and the kernels that they call, to LLVM IR.

    Parameters
    ----------
    functions : sequence of functions
        These become symbols under their names; kernels that they call stay internal. A
        call of an external of one of these names is linked to the kernel.
    statics : mapping, optional
        Static values that replace the globals of equal names, in every module.

    Returns
    -------
    str
        The text; a function of the arguments alone.

    Raises
    ------
    KernelError
        If a kernel leaves the subset.
    """
    return _Translation(functions, statics or {}).text()


_ARITHMETIC: Final[dict[type[ast.operator], str]] = {
    ast.Add: "add",
    ast.Sub: "sub",
    ast.Mult: "mul",
    ast.Div: "div",
}
# Of integers, and of floats.
_COMPARISONS: Final[dict[type[ast.cmpop], tuple[str, str]]] = {
    ast.Lt: ("slt", "olt"),
    ast.LtE: ("sle", "ole"),
    ast.Gt: ("sgt", "ogt"),
    ast.GtE: ("sge", "oge"),
    ast.Eq: ("eq", "oeq"),
    ast.NotEq: ("ne", "une"),
}
_LIBM: Final = """
acos asin atan atan2 cos cosh exp expm1 log log1p pow sin sinh tan tanh
"""
# Functions of the C library, and intrinsics of LLVM that are exact in IEEE 754.
_FUNCTIONS: Final[dict[object, str]] = {
    **{getattr(math, name): name for name in _LIBM.split()},
    math.sqrt: "llvm.sqrt.f64",
    math.fabs: "llvm.fabs.f64",
    math.copysign: "llvm.copysign.f64",
    words.fused: "llvm.fma.f64",
}
_ARGUMENTS: Final = {math.pow: 2, math.atan2: 2, math.copysign: 2, words.fused: 3}


class _Function(Folding, Instructions, ast.NodeVisitor):
    """Translation of one function, by a method for each kind of syntax node.

    Attributes
    ----------
    kinds : dict
        Kind of each variable, in the order of their first assignment.
    loops : list of (str, str)
        Labels of the targets of `break` and `continue` of the enclosing loops.
    element : str
        Within an assignment to a slice, the index of the current element.
    """

    def __init__(self, source: KernelText, program: _Translation) -> None:
        Folding.__init__(self, source)
        Instructions.__init__(self)
        self.program = program
        self.kinds: dict[str, str] = {}
        self.loops: list[tuple[str, str]] = []
        self.element = ""
        self._calls: dict[object, Callable[[ast.Call], Value]] = {
            min: partial(self._extremum, ast.Lt()),
            max: partial(self._extremum, ast.Gt()),
            abs: lambda node: self._function("llvm.fabs.f64", *self._floats(node)),
            int: lambda node: self._truncated(*self._floats(node)),
            float: lambda node: self._floats(node)[0],
            math.floor: lambda node: self._truncated(
                self._function("llvm.floor.f64", *self._floats(node))
            ),
            words.total: self._total,
            words.bits: lambda node: self._recast("double", *self._floats(node)),
            words.from_bits: lambda node: self._recast(
                "i64", self._converted(self._arguments(node, 1)[0], "int")
            ),
        }

    def text(self, symbol: str, linkage: str) -> str:
        """Return the IR of the function, named `symbol`, with LLVM's linkage."""
        source = self.source
        for name, kind in source.parameters.items():
            self._store_name(source.node, name, Value(f'%"{name}"', kind))
        self._block(source.node.body)
        if self.live:
            end = "ret void" if source.result == "None" else "unreachable"
            self.lines.append(f"  {end}")
        given = ", ".join(
            f'{PASSED[kind]} %"{name}"' for name, kind in source.parameters.items()
        )
        head = f"define {linkage}{RETURNED[source.result]} @{symbol}({given})"
        body = [*self.allocated, *self.lines]
        return "\n".join([f"{head} nounwind {{", "entry:", *body, "}\n"])

    # Expressions.

    def expression(self, node: ast.expr) -> Value:
        """Translate an expression."""
        known = self.fold(node)
        if known is not None:
            return self._literal(node, known)
        value: Value = self.visit(node)
        return value

    def generic_visit(self, node: ast.AST) -> Any:
        """Raise KernelError for a syntax node that is outside the subset."""
        raise self.error(node)

    def visit_Name(self, node: ast.Name) -> Value:
        if node.id not in self.kinds:
            raise self.error(node, "has no value here; globals are numbers")
        return self._get(self.kinds[node.id], f'%"{node.id}.v"')

    def _literal(self, node: ast.expr, known: Static) -> Value:
        if isinstance(known, bool):
            return Value("true" if known else "false", "bool")
        if isinstance(known, int):
            return Value(str(known), "int")
        if isinstance(known, float):
            [bits] = struct.unpack("<Q", struct.pack("<d", known))
            return Value(f"0x{bits:016X}", "float")
        raise self.error(node, "is a table; take one number of it")

    def _cast(self, value: Value, kind: str, node: ast.AST) -> Value:
        """Convert an int to float, or keep a value of equal kind.

        Raises
        ------
        KernelError
            For other kinds.
        """
        if kind != "Floats":
            value = self._single(value)
        if value.kind == kind:
            return value
        if (value.kind, kind) == ("int", "float"):
            return self._op("float", f"sitofp i64 {value.text} to double")
        raise self.error(node, f"is {value.kind}, not {kind}")

    def _converted(self, node: ast.expr, kind: str) -> Value:
        """Translate an expression, and convert its value to a kind."""
        return self._cast(self.expression(node), kind, node)

    def _number(self, node: ast.expr) -> Value:
        """Translate an expression that must be an int or a float."""
        value = self._single(self.expression(node))
        if value.kind not in ("int", "float"):
            raise self.error(node, f"is {value.kind}, not a number")
        return value

    def _single(self, value: Value) -> Value:
        """Return the current element of an array, within an assignment to a slice.

        A number is returned unchanged.

        value : the array or the number.
        """
        if value.kind == "Floats" and self.element:
            return self._get("float", self._address(value.text, self.element))
        return value

    def _common(self, node: ast.AST, *values: Value) -> tuple[list[Value], str]:
        """Return numbers converted to their common kind, and this kind."""
        kind = "float" if any(v.kind == "float" for v in values) else "int"
        return [self._cast(v, kind, node) for v in values], kind

    def _is_block(self, node: ast.expr) -> bool:
        """Whether an expression is a block that a memory declares."""
        found = self.source.field(node)
        return found is not None and found[1].kind == BLOCK

    def _is_stretch(self, node: ast.expr) -> TypeGuard[ast.Subscript]:
        """Whether an expression is a slice of an array: `a[i:j]`, `a[s.half]`."""
        return isinstance(node, ast.Subscript) and (
            isinstance(node.slice, ast.Slice) or self._is_block(node.slice)
        )

    def _bound(self, block: ast.expr, name: str) -> Value:
        """Return the value of the `start` or `stop` (`name`) of a block."""
        _, place, _ = self._word(block)
        return self._load_size(self._address(place, int(name == "stop")))

    def _element(self, node: ast.Subscript) -> str:
        """Return the address of an element of an array, or of the first of a slice."""
        base = self._converted(node.value, "Floats")
        index = node.slice
        if self._is_block(index):
            return self._address(base.text, self._bound(index, "start").text)
        if isinstance(index, ast.Slice):
            if index.step is not None:
                raise self.error(node, "leaves some elements out")
            index = index.lower or ast.Constant(0)
        known = self.fold(index)
        if isinstance(known, int) and known < 0:
            raise self.error(node, "counts from the end, which is not known")
        return self._address(base.text, self._converted(index, "int").text)

    def visit_Subscript(self, node: ast.Subscript) -> Value:
        """Load an element; for a slice, return the address of its first element."""
        table = self.fold(node.value)
        if isinstance(table, tuple):
            return self._get("float", self._tabulated(node, table))
        place = self._element(node)
        if self._is_stretch(node):
            return Value(place, "Floats")
        return self._get("float", place)

    def _tabulated(self, node: ast.Subscript, table: tuple[Static, ...]) -> str:
        """Return the address of a number in a static table, at a variable index.

        node : the subscript.
        table : the values.
        """
        numbers = [self._literal(node, x) for x in table]
        if any(x.kind != "float" for x in numbers):
            raise self.error(node, "is no table of floats, whose index may vary")
        entries = ", ".join(f"double {x.text}" for x in numbers)
        name = f'@"{ast.unparse(node.value)}"'
        kind = f"[{len(numbers)} x double]"
        self.program.declare(f"{name} = private constant {kind} [{entries}]")
        return self._address(name, self._converted(node.slice, "int").text)

    def _word(self, node: ast.expr) -> tuple[str, str, Field]:
        """Return the address of a memory, the address of its word `s.t`, and its field.

        The field is the declaration of the name `t` in the memory.

        node : the expression `s.t`.
        """
        found = self.source.field(node)
        if found is None:
            raise self.error(node)
        name, field = found
        memory = self._get("Floats", f'%"{name}.v"').text
        return memory, self._address(memory, field.word), field

    def visit_Attribute(self, node: ast.Attribute) -> Value:
        if node.attr in ("start", "stop") and self._is_block(node.value):
            return self._bound(node.value, node.attr)
        memory, place, field = self._word(node)
        if field.kind == NUMBER:
            return self._get("float", place)
        whole = self._load_size(place)
        if field.kind == SIZE:
            return whole
        if field.kind == BLOCK:
            raise self.error(node, "is a block, of which arrays have a stretch")
        return Value(self._address(memory, whole.text), "Floats")

    def _load_size(self, place: str) -> Value:
        # Sizes and indices are constant: stores in between require no second load.
        value = self._op("float", f"load double, ptr {place}, !invariant.load !{{}}")
        return self._op("int", f"fptosi double {value.text} to i64")

    def visit_UnaryOp(self, node: ast.UnaryOp) -> Value:
        if isinstance(node.op, ast.Not):
            test = self._converted(node.operand, "bool")
            return self._op("bool", f"xor i1 {test.text}, true")
        value = self._number(node.operand)
        if not isinstance(node.op, ast.USub):
            raise self.error(node)
        if value.kind == "int":
            return self._op("int", f"sub i64 0, {value.text}")
        return self._op("float", f"fneg double {value.text}")

    def visit_BinOp(self, node: ast.BinOp) -> Value:
        left, right = self._number(node.left), self._number(node.right)
        if isinstance(node.op, ast.FloorDiv | ast.Mod):
            return self._floored(node, left)
        if isinstance(node.op, ast.Pow | ast.Div):
            left = self._cast(left, "float", node)
        (left, right), kind = self._common(node, left, right)
        if isinstance(node.op, ast.Pow):
            return self._function("pow", left, right)
        if type(node.op) not in _ARITHMETIC:
            raise self.error(node)
        name = ("f" if kind == "float" else "") + _ARITHMETIC[type(node.op)]
        return self._op(kind, f"{name} {LLVM[kind]} {left.text}, {right.text}")

    def _floored(self, node: ast.BinOp, left: Value) -> Value:
        """Translate `//` or `%` by a positive static divisor.

        Both operators round towards minus infinity, as in Python.

        left : the dividend.
        """
        divisor = self.integer(node.right)
        a = self._cast(left, "int", node).text
        if divisor <= 0:
            raise self.error(node, "has no positive divisor")
        plain = self._op("int", f"srem i64 {a}, {divisor}").text
        less = self._op("bool", f"icmp slt i64 {plain}, 0").text
        more = self._op("int", f"add i64 {plain}, {divisor}").text
        rest = self._op("int", f"select i1 {less}, i64 {more}, i64 {plain}")
        if isinstance(node.op, ast.Mod):
            return rest
        whole = self._op("int", f"sub i64 {a}, {rest.text}").text
        return self._op("int", f"sdiv i64 {whole}, {divisor}")

    def visit_Compare(self, node: ast.Compare) -> Value:
        """Translate comparisons; a middle operand, never a call, is evaluated twice."""
        (op, *ops), (operand, *operands) = node.ops, node.comparators
        if ops and any(isinstance(x, ast.Call) for x in ast.walk(operand)):
            raise self.error(operand, "is called within a chain of comparisons")
        first = self._compared(node, op, self._number(node.left), self._number(operand))
        if not ops:
            return first
        rest = ast.copy_location(ast.Compare(operand, ops, operands), node)
        return self._chosen(node, first, rest, ast.Constant(False))

    def _compared(
        self, node: ast.AST, op: ast.cmpop, left: Value, right: Value
    ) -> Value:
        if type(op) not in _COMPARISONS:
            raise self.error(node)
        (left, right), kind = self._common(node, left, right)
        name = "icmp" if kind == "int" else "fcmp"
        relation = f"{name} {_COMPARISONS[type(op)][kind == 'float']}"
        text = f"{relation} {LLVM[kind]} {left.text}, {right.text}"
        return self._op("bool", text)

    def visit_BoolOp(self, node: ast.BoolOp) -> Value:
        is_or = isinstance(node.op, ast.Or)
        # Operands whose static value does not decide the result are omitted.
        first, *rest = [v for v in node.values if self.fold(v) is not (not is_or)]
        test = self._converted(first, "bool")
        if not rest:
            return test
        known = ast.Constant(is_or)
        later = ast.copy_location(ast.BoolOp(node.op, rest), node)
        return self._chosen(node, test, *((known, later) if is_or else (later, known)))

    def visit_IfExp(self, node: ast.IfExp) -> Value:
        known = self.fold(node.test)
        if known is not None:
            return self.expression(node.body if known else node.orelse)
        test = self._converted(node.test, "bool")
        return self._chosen(node, test, node.body, node.orelse)

    def _chosen(
        self, node: ast.expr, test: Value, yes: ast.expr, no: ast.expr
    ) -> Value:
        """Translate `yes if test else no`; the result has the kind of `yes`."""
        kept, found = self.lines, []
        for branch in (yes, no):
            self.lines = []
            found.append((self.expression(branch), self.lines))
        self.lines, kind = kept, found[0][0].kind
        place = self._allocate("choice", kind)
        *labels, end = map(self._name, ("yes", "no", "end"))
        self._branch(test, *labels)
        for label, (value, lines) in zip(labels, found, strict=True):
            self._begin(label)
            self.lines += lines
            self._emit_store(self._cast(value, kind, node), place)
            self._jump(end)
        self._begin(end)
        return self._get(kind, place)

    # Calls.

    def visit_Call(self, node: ast.Call) -> Value:
        function: Any = self.source.meaning(node.func)
        if function in self._calls:
            return self._calls[function](node)
        if function in _FUNCTIONS:
            values = self._floats(node, _ARGUMENTS.get(function, 1))
            return self._function(_FUNCTIONS[function], *values)
        own = isinstance(function, FunctionType)
        if not own or function.__module__ == words.__name__:
            raise self.error(node)
        names = parameters(function)
        given = dict(zip(names, self._arguments(node, len(names)), strict=True))
        known = [self.integer(given[x]) for x in static_parameters(function)]
        symbol, source = self.program.callee(function, *known)
        passed = ", ".join(
            f"{PASSED[kind]} {self._converted(given[name], kind).text}"
            for name, kind in source.parameters.items()
        )
        call = f"call {RETURNED[source.result]} @{symbol}({passed})"
        if source.result != "None":
            return self._op(source.result, call)
        self.lines.append(f"  {call}")
        return Value("", "None")

    def _arguments(self, node: ast.Call, count: int) -> list[ast.expr]:
        if node.keywords or len(node.args) != count:
            raise self.error(node, f"takes {count} arguments by position")
        return node.args

    def _floats(self, node: ast.Call, count: int = 1) -> list[Value]:
        return [self._converted(a, "float") for a in self._arguments(node, count)]

    def _function(self, name: str, *values: Value, result: str = "float") -> Value:
        """Append a call of a function of the C library or of LLVM; return its result.

        result : the kind of the result.
        """
        libm = "" if name.startswith("llvm.") else " nounwind memory(none)"
        types = ", ".join("double" for _ in values)
        self.program.declare(f"declare {LLVM[result]} @{name}({types}){libm}")
        passed = ", ".join(f"double {v.text}" for v in values)
        if libm:
            libm = f" nobuiltin{libm}"
        return self._op(result, f"call {LLVM[result]} @{name}({passed}){libm}")

    def _recast(self, kind: str, value: Value) -> Value:
        """Reinterpret the bits of a float as an integer, or the reverse.

        kind : the kind of the result.
        """
        result = "int" if kind == "double" else "float"
        return self._op(result, f"bitcast {kind} {value.text} to {LLVM[result]}")

    def _truncated(self, value: Value) -> Value:
        # Saturating: plain fptosi is undefined for nan or 1e300, where Python raises.
        return self._function("llvm.fptosi.sat.i64.f64", value, result="int")

    def _extremum(self, op: ast.cmpop, node: ast.Call) -> Value:
        values, kind = self._common(node, *map(self._number, node.args))
        best, llvm = values[0], LLVM[kind]
        for value in values[1:]:
            # As in CPython: a later argument is selected only if it is beyond the best,
            # so never for nan.
            better = self._compared(node, op, value, best).text
            text = f"select i1 {better}, {llvm} {value.text}, {llvm} {best.text}"
            best = self._op(kind, text)
        return best

    def _total(self, node: ast.Call) -> Value:
        [terms] = self._arguments(node, 1)
        if not isinstance(terms, ast.GeneratorExp):
            raise self.error(node, "is no total(... for j in unrolled(...))")
        [loop] = terms.generators
        result: Value | None = None
        for _ in self.values(loop.target, loop.iter):
            if self.vanishes(terms.elt):
                continue
            term = self._converted(terms.elt, "float")
            if result is None:
                result = term
            else:
                result = self._op("float", f"fadd double {result.text}, {term.text}")
        return result or self._literal(node, 0.0)

    # Statements.

    def _block(self, body: list[ast.stmt]) -> None:
        """Translate statements, up to the first that is unreachable."""
        for statement in body:
            if not self.live:
                return
            self.visit(statement)

    def visit_Expr(self, node: ast.Expr) -> None:
        if not isinstance(node.value, ast.Constant):
            self.expression(node.value)

    def visit_Assign(self, node: ast.Assign) -> None:
        [first, *others] = node.targets
        if self._is_stretch(first) and not others:
            self._spread(first, node.value)
            return
        sources = [node.value]
        if isinstance(node.value, ast.Tuple):
            sources = node.value.elts
        values = [self.expression(source) for source in sources]
        for target in node.targets:
            targets = target.elts if isinstance(target, ast.Tuple) else [target]
            if len(targets) != len(values):
                raise self.error(node, "has another number of values left and right")
            for single, value in zip(targets, values, strict=True):
                self._store(single, value)

    def visit_AugAssign(self, node: ast.AugAssign) -> None:
        """Translate `a += b` as `a = a + b`."""
        node.target.ctx = ast.Load()
        value = ast.copy_location(ast.BinOp(node.target, node.op, node.value), node)
        self.visit_Assign(ast.Assign([node.target], value))

    def _spread(self, target: ast.Subscript, value: ast.expr) -> None:
        """Translate an assignment to a slice: a loop that stores each element.

        target : the slice.
        value : the expression, whose arrays are as long as the slice.
        """
        begin = self._element(target)
        start, stop = self._bounds(target)
        count = self._op("int", f"sub nsw i64 {stop.text}, {start.text}")

        def store(k: Value, _after: str, following: str) -> None:
            self.element = k.text
            self._emit_store(
                self._converted(value, "float"), self._address(begin, k.text)
            )
            self.element = ""
            self._jump(following)

        self._counted(Value("0", "int"), count, store)

    def _bounds(self, target: ast.Subscript) -> tuple[Value, Value]:
        """Return the first index of the slice `target`, and its end, exclusive."""
        stretch = target.slice
        if not isinstance(stretch, ast.Slice):
            return self._bound(stretch, "start"), self._bound(stretch, "stop")
        start = self._converted(stretch.lower or ast.Constant(0), "int")
        if stretch.upper is not None:
            return start, self._converted(stretch.upper, "int")
        if self.source.field(target.value) is None:
            raise self.error(target, "needs an end: it is no array of a memory")
        memory, _, field = self._word(target.value)
        return start, self._load_size(self._address(memory, field.word + 1))

    def _place(self, target: ast.expr) -> str:
        """Return the address of the target of an assignment.

        target : an element of an array, or a number in a memory.
        """
        if isinstance(target, ast.Subscript):
            return self._element(target)
        found = self.source.field(target)
        if found is None or found[1].kind != NUMBER:
            raise self.error(target, "takes no value")
        return self._word(target)[1]

    def _store(self, target: ast.expr, value: Value) -> None:
        if isinstance(target, ast.Name):
            self._store_name(target, target.id, value)
        else:
            place = self._place(target)
            self._emit_store(self._cast(value, "float", target), place)

    def _store_name(self, node: ast.AST, name: str, value: Value) -> None:
        if name in self.unrolled or value.kind == "None":
            raise self.error(node, f"gives `{name}` no value, or counts a loop")
        if name not in self.kinds:
            self.kinds[name] = value.kind
            self.allocated.append(f'  %"{name}.v" = alloca {LLVM[value.kind]}')
        self._emit_store(self._cast(value, self.kinds[name], node), f'%"{name}.v"')

    def visit_Break(self, _node: ast.Break) -> None:
        self._jump(self.loops[-1][0])

    def visit_Continue(self, _node: ast.Continue) -> None:
        self._jump(self.loops[-1][1])

    def visit_Pass(self, node: ast.Pass) -> None:
        """Translate `pass` to no instruction."""

    def visit_Return(self, node: ast.Return) -> None:
        kind = self.source.result
        if kind == "None":
            self.lines.append("  ret void")
        elif node.value is None:
            raise self.error(node, f"returns no value, not {kind}")
        else:
            value = self._converted(node.value, kind)
            self.lines.append(f"  ret {LLVM[kind]} {value.text}")
        self.live = False

    def visit_If(self, node: ast.If) -> None:
        known = self.fold(node.test)
        if known is not None:
            self._block(node.body if known else node.orelse)
            return
        test = self._converted(node.test, "bool")
        yes, no, end = map(self._name, ("then", "else", "endif"))
        self._branch(test, yes, no)
        for label, body in ((yes, node.body), (no, node.orelse)):
            self._begin(label)
            self._block(body)
            self._jump(end)
        self._begin(end)

    def _body(self, node: ast.While | ast.For, after: str, following: str) -> None:
        """Translate the body of the loop `node`.

        after, following : labels of the loop's exit and of its next pass.
        """
        if node.orelse:
            raise self.error(node, "has an else; use a flag")
        self.loops.append((after, following))
        self._block(node.body)
        self._jump(following)
        self.loops.pop()

    def visit_While(self, node: ast.While) -> None:
        head, body, after = map(self._name, ("while", "do", "endwhile"))
        self._jump(head)
        self._begin(head)
        if self.fold(node.test) is not True:
            self._branch(self._converted(node.test, "bool"), body, after)
            self._begin(body)
        self._body(node, after, head)
        self._begin(after)

    def visit_For(self, node: ast.For) -> None:
        call = node.iter
        if self.is_call_of(call, words.unrolled):
            self._unrolled(node)
            return
        if not self.is_call_of(call, range, words.apart):
            raise self.error(node, "is no loop over range, apart or unrolled")
        assert isinstance(call, ast.Call)
        bounds = [self._converted(a, "int") for a in call.args[:2]]
        start, stop = bounds if len(bounds) == 2 else [Value("0", "int"), *bounds]

        def body(now: Value, after: str, following: str) -> None:
            # The variable is a copy: as in Python, assigning it does not affect the
            # loop, and after the loop it has its last value in the body.
            self._store(node.target, now)
            self._body(node, after, following)

        self._counted(start, stop, body, parallel=self.is_call_of(call, words.apart))

    def _counted(
        self,
        start: Value,
        stop: Value,
        body: Callable[[Value, str, str], None],
        *,
        parallel: bool = False,
    ) -> None:
        """Write a loop whose counter runs from `start` to `stop`, exclusive.

        body : function that writes one pass, from the counter and the labels of exit
            and next pass.
        parallel : whether the passes access disjoint elements.
        """
        counter = self._allocate("counter", "int")
        self._emit_store(start, counter)
        head, inside, advance, after = map(self._name, ("for", "do", "next", "endfor"))
        first = len(self.lines)
        self._jump(head)
        self._begin(head)
        now = self._get("int", counter)
        test = self._op("bool", f"icmp slt i64 {now.text}, {stop.text}")
        self._branch(test, inside, after)
        self._begin(inside)
        body(now, after, advance)
        self._begin(advance)
        if self.live:
            now = self._get("int", counter)
            self._emit_store(self._op("int", f"add nsw i64 {now.text}, 1"), counter)
            self._jump(head)
        if parallel:
            self._mark_parallel(first)
        self._begin(after)

    def _mark_parallel(self, first: int) -> None:
        """Mark a loop over `apart`, from line `first` to its back jump, as parallel."""
        for k in range(first, len(self.lines)):
            line = self.lines[k]
            if line.startswith("  store ") or " = load " in line:
                self.lines[k] += ", !llvm.access.group !0"
        self.lines[-1] += f", !llvm.loop !{self.program.parallel()}"

    def _unrolled(self, node: ast.For) -> None:
        after = self._name("endunrolled")
        for _ in self.values(node.target, node.iter):
            if self.live:
                following = self._name("next")
                self._body(node, after, following)
                self._begin(following)
        self._jump(after)
        self._begin(after)


class _Translation:
    """Translation of kernels, and of the kernels that they call, to one text of IR.

    Attributes
    ----------
    statics : mapping of str to object
        Static values that replace globals of equal names.
    known : dict
        Symbol and text of each function found, by function and static arguments.
    waiting : list of (str, KernelText)
        Functions that are not translated yet.
    declared : dict
        Declarations of the IR text, as keys.
    exported : frozenset of str
        Symbols that are visible outside the text.
    """

    def __init__(
        self, functions: Sequence[Callable[..., Any]], statics: Mapping[str, object]
    ) -> None:
        self.statics = statics
        self.known: dict[tuple[object, ...], tuple[str, KernelText]] = {}
        self.symbols: set[str] = set()
        self.waiting: list[tuple[str, KernelText]] = []
        self.declared: dict[str, None] = {}
        self.loops = 0
        self.exported: frozenset[str] = frozenset()
        for function in functions:
            self._add(as_kernel(function))
        self.exported = frozenset(self.symbols)

    def text(self) -> str:
        """Return the IR of the functions in `waiting`, and of all that they call."""
        defined = []
        used: set[str] = set()
        while self.waiting:
            symbol, source = self.waiting.pop(0)
            linkage = "" if symbol in self.exported else "internal "
            defined.append(_Function(source, self).text(symbol, linkage))
            used |= source.function.__globals__.keys()
        if unknown := self.statics.keys() - used:
            raise KernelError(
                f"statics {', '.join(sorted(unknown))}: no global of that name in the "
                "modules of the kernels"
            )
        return "\n".join([*self.declared, *defined])

    def callee(self, function: FunctionType, *known: int) -> tuple[str, KernelText]:
        """Return symbol and text of a kernel that is called; a new one is queued.

        known : the values of its static parameters.
        """
        if (function, *known) not in self.known:
            self._add(function, *known)
        return self.known[function, *known]

    def declare(self, line: str) -> None:
        """Add a declaration to the text, once."""
        self.declared[line] = None

    def parallel(self) -> int:
        """Return a new number, with which a loop of independent passes is marked."""
        self.declare("!0 = distinct !{}")
        self.loops += 1
        properties = '!{!"llvm.loop.parallel_accesses", !0}, '
        properties += '!{!"llvm.loop.vectorize.enable", i1 true}'
        self.declare(f"!{self.loops} = distinct !{{!{self.loops}, {properties}}}")
        return self.loops

    def _add(self, function: FunctionType, *known: int) -> None:
        source = KernelText(function, self.statics, known)
        symbol, external = source.name, words.is_external(function)
        if external and symbol in self.exported:
            # The name denotes the translated function of this name.
            found = next(x for s, x in self.known.values() if s == symbol)
            signature = [*found.parameters.values(), found.result]
            if signature != [*source.parameters.values(), source.result]:
                text = "the function of this name has other kinds"
                raise source.error(source.node, text)
            self.known[function, *known] = symbol, found
            return
        if symbol in self.symbols:
            symbol = f"{symbol}.{len(self.symbols)}"
        self.symbols.add(symbol)
        self.known[function, *known] = symbol, source
        if external:
            kinds = ", ".join(PASSED[kind] for kind in source.parameters.values())
            result = RETURNED[source.result]
            self.declare(f"declare {result} @{symbol}({kinds}) nounwind")
        else:
            self.waiting.append((symbol, source))
