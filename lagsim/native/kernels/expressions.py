"""Expressions of kernels: variables, elements, operators, comparisons, choices."""

from __future__ import annotations

import ast
from typing import TYPE_CHECKING, Any, Final

from lagsim.native.kernels.lines import LLVM, Lines, Program, Value, stack_place
from lagsim.native.kernels.source import Source, unsupported
from lagsim.native.layout import NUMBER, SIZE

if TYPE_CHECKING:
    from collections.abc import Callable

    from lagsim.native.layout import Field

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
