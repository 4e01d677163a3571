"""The text of kernels: where it stands, what its names mean, what is known of it.

Values known at translation are called static: numbers, and tables (tuples) of them,
among the module's globals; variables of loops over `unrolled`; what is computed from
these alone.
"""

from __future__ import annotations

import ast
import builtins
import inspect
import math
import operator
import textwrap
from types import FunctionType, ModuleType
from typing import TYPE_CHECKING, Any, Final, NoReturn

from lagsim.native.kernels.keys import KernelError, Static, is_static, memories
from lagsim.native.kernels.words import is_external

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from lagsim.native.layout import Field

KINDS: Final = ("int", "float", "bool", "Floats", "None")

_OPERATORS: Final[dict[type[ast.AST], Callable[..., Any]]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.FloorDiv: operator.floordiv,
    ast.Mod: operator.mod,
    ast.Pow: operator.pow,
    ast.USub: operator.neg,
    ast.Not: operator.not_,
    ast.Lt: operator.lt,
    ast.LtE: operator.le,
    ast.Gt: operator.gt,
    ast.GtE: operator.ge,
    ast.Eq: operator.eq,
    ast.NotEq: operator.ne,
}

_STATIC_CALLS: Final = frozenset({abs, min, max, int, float, len, bool}) | {
    f for f in vars(math).values() if callable(f)
}


class Source:
    """The text and the signature of one kernel function.

    Parameters
    ----------
    function : function
        A plain Python function, or one marked `external`.
    statics : mapping
        Values that stand before the globals of the same name.

    Attributes
    ----------
    name : str
        The symbol.
    parameters : tuple of (str, str)
        Name and kind of each parameter.
    memories : dict
        The classes of the parameters that are a `Memory`; their kind is Floats.
    result : str
        Kind of the result.
    node : ast.FunctionDef
        The function; line numbers are those of the file.
    """

    def __init__(self, function: FunctionType, statics: Mapping[str, object]) -> None:
        self.function = function
        self.name = function.__name__
        self.external = is_external(function)
        self.statics = statics
        plain = inspect.unwrap(function)
        try:
            self.file = inspect.getsourcefile(plain) or "?"
            lines, first = inspect.getsourcelines(plain)
        except (OSError, TypeError) as fault:
            raise KernelError(f"{self.name}: its source text is not there") from fault
        tree = ast.parse(textwrap.dedent("".join(lines)))
        ast.increment_lineno(tree, first - 1)
        node = tree.body[0]
        if not isinstance(node, ast.FunctionDef):
            raise self.error(node, "a kernel is a function made by `def`")
        self.node = node
        if not self.name.isascii():
            raise self.error(node, "a kernel's name is a symbol: ASCII letters only")
        if plain.__closure__:
            names = ", ".join(plain.__code__.co_freevars)
            raise self.error(
                node, f"{names} of an enclosing function; pass as parameters or statics"
            )
        self.memories = memories(function)
        self.parameters = self._parameters()
        self.result = self.kind(node.returns, node, "the result")
        code = plain.__code__
        self.variables = frozenset(code.co_varnames + code.co_cellvars)
        """Every name that is local: parameters and what is assigned anywhere."""

    def error(self, node: ast.AST, text: str) -> KernelError:
        """Give the error that names file and line of `node`."""
        line = getattr(node, "lineno", 1)
        return KernelError(f"{self.file}:{line}: in `{self.name}`: {text}")

    def _parameters(self) -> tuple[tuple[str, str], ...]:
        arguments = self.node.args
        if arguments.vararg or arguments.kwarg or arguments.kwonlyargs:
            raise self.error(self.node, "parameters are positional, without * and **")
        if arguments.defaults:
            raise self.error(self.node, "a parameter has no default; pass every value")
        return tuple(
            (
                a.arg,
                "Floats"
                if a.arg in self.memories
                else self.kind(a.annotation, a, f"parameter `{a.arg}`"),
            )
            for a in (*arguments.posonlyargs, *arguments.args)
        )

    def kind(self, annotation: ast.expr | None, node: ast.AST, what: str) -> str:
        """Give the kind an annotation names."""
        name = None
        if isinstance(annotation, ast.Constant):
            name = str(annotation.value)
        elif isinstance(annotation, ast.Name):
            name = annotation.id
        if name in KINDS:
            return name
        found = "no annotation" if annotation is None else ast.unparse(annotation)
        raise self.error(
            node,
            f"{what} has {found}; annotate with int, float, bool, Floats or a Memory "
            "that is imported for more than types",
        )

    def field(self, node: ast.expr) -> tuple[str, Field] | None:
        """Give the parameter and the field of its memory that `s.t` stands for."""
        if not isinstance(node, ast.Attribute) or not isinstance(node.value, ast.Name):
            return None
        memory = self.memories.get(node.value.id)
        if memory is None:
            return None
        if node.attr not in memory.fields:
            raise self.error(node, f"{memory.__name__} has no `{node.attr}`")
        return node.value.id, memory.fields[node.attr]

    def meaning(self, node: ast.Name | ast.Attribute) -> object:
        """Give what a global name stands for."""
        if isinstance(node, ast.Attribute):
            if not isinstance(node.value, ast.Name):
                raise self.error(node, f"`{ast.unparse(node)}`; write a plain name")
            module = self.meaning(node.value)
            if not isinstance(module, ModuleType) or not hasattr(module, node.attr):
                raise self.error(
                    node, f"`{ast.unparse(node)}`; only modules have attributes here"
                )
            return getattr(module, node.attr)
        for names in (self.statics, self.function.__globals__, vars(builtins)):
            if node.id in names:
                return names[node.id]
        raise self.error(node, f"`{node.id}` is not defined")


class Folding:
    """What is static in one function, as far as it is translated.

    Attributes
    ----------
    source : Source
        The function.
    loops : dict
        Values of the variables of the `unrolled` loops around the present place.
    """

    def __init__(self, source: Source) -> None:
        self.source = source
        self.loops: dict[str, int] = {}
        # Found once: telling that a large table is static means walking through it.
        self._globals: dict[str, Static | None] = {}
        self._rules: dict[type[ast.AST], Callable[[Any], Static | None]] = {
            ast.Constant: self._constant,
            ast.Name: self._name,
            ast.Attribute: self._global,
            ast.Subscript: self._subscript,
            ast.UnaryOp: self._unary,
            ast.BinOp: self._binary,
            ast.Compare: self._compare,
            ast.BoolOp: self._logical,
            ast.IfExp: self._choice,
            ast.Call: self._call,
        }

    def fold(self, node: ast.expr) -> Static | None:
        """Give the value of a static expression, None where it is not static."""
        rule = self._rules.get(type(node))
        return None if rule is None else rule(node)

    def fold_integers(self, nodes: list[ast.expr], what: str) -> list[int]:
        """Give the values of expressions that must be static integers."""
        values = [self.fold(n) for n in nodes]
        for node, value in zip(nodes, values, strict=True):
            if not isinstance(value, int):
                raise self.source.error(
                    node,
                    f"{what} `{ast.unparse(node)}` is not known at translation; build "
                    "it from constants, static globals and variables of unrolled loops",
                )
        return [v for v in values if isinstance(v, int)]

    def vanishes(self, node: ast.expr) -> bool:
        """Tell whether a term has a static factor of zero."""
        if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Mult):
            return self.vanishes(node.left) or self.vanishes(node.right)
        return self.fold(node) == 0

    def _constant(self, node: ast.Constant) -> Static | None:
        return node.value if isinstance(node.value, bool | int | float) else None

    def _name(self, node: ast.Name) -> Static | None:
        if node.id in self.loops:
            return self.loops[node.id]
        return None if node.id in self.source.variables else self._global(node)

    def _global(self, node: ast.Name | ast.Attribute) -> Static | None:
        if isinstance(node, ast.Attribute) and (
            not isinstance(node.value, ast.Name)
            or node.value.id in self.source.memories
        ):
            return None
        name = ast.unparse(node) if isinstance(node, ast.Attribute) else node.id
        if name not in self._globals:
            value = self.source.meaning(node)
            self._globals[name] = value if is_static(value) else None
        return self._globals[name]

    def _subscript(self, node: ast.Subscript) -> Static | None:
        table = self.fold(node.value)
        if table is None:
            return None
        if not isinstance(table, tuple):
            raise self.source.error(node, f"`{ast.unparse(node.value)}` is no table")
        [index] = self.fold_integers([node.slice], "index of a table")
        if not -len(table) <= index < len(table):
            raise self.source.error(
                node, f"`{ast.unparse(node)}`: index {index} of {len(table)} entries"
            )
        return table[index]

    def _apply(
        self, node: ast.expr, function: Callable[..., Any], *operands: ast.expr
    ) -> Static | None:
        values = []
        for operand in operands:
            value = self.fold(operand)
            if value is None:
                return None
            values.append(value)
        try:
            result: Static = function(*values)
        except (ArithmeticError, TypeError, ValueError) as fault:
            raise self.source.error(node, f"`{ast.unparse(node)}`: {fault}") from fault
        return result

    def _unary(self, node: ast.UnaryOp) -> Static | None:
        rule = _OPERATORS.get(type(node.op))
        return None if rule is None else self._apply(node, rule, node.operand)

    def _binary(self, node: ast.BinOp) -> Static | None:
        rule = _OPERATORS.get(type(node.op))
        return None if rule is None else self._apply(node, rule, node.left, node.right)

    def _compare(self, node: ast.Compare) -> Static | None:
        rules = [_OPERATORS.get(type(op)) for op in node.ops]
        operands = [node.left, *node.comparators]
        if any(self.fold(operand) is None for operand in operands):
            return None
        for rule, left, right in zip(rules, operands, operands[1:], strict=False):
            if rule is None:
                return None
            if not self._apply(node, rule, left, right):
                return False
        return True

    def _logical(self, node: ast.BoolOp) -> Static | None:
        decisive = isinstance(node.op, ast.Or)
        open_ = False
        for operand in node.values:
            value = self.fold(operand)
            if value is not None and not isinstance(value, bool):
                raise self.source.error(
                    operand, f"`{ast.unparse(operand)}` is no condition; compare it"
                )
            if value is decisive:
                return decisive
            if value is None:
                open_ = True
                # What stands before a decided operand may be left out, but a call may
                # do something.
                if any(isinstance(n, ast.Call) for n in ast.walk(operand)):
                    return None
        return None if open_ else not decisive

    def _choice(self, node: ast.IfExp) -> Static | None:
        test = self.fold(node.test)
        return None if test is None else self.fold(node.body if test else node.orelse)

    def _call(self, node: ast.Call) -> Static | None:
        name = node.func
        if node.keywords or not isinstance(name, ast.Name | ast.Attribute):
            return None
        if isinstance(name, ast.Name) and name.id in self.source.variables:
            return None
        if isinstance(name, ast.Attribute) and not isinstance(name.value, ast.Name):
            return None
        function = self.source.meaning(name)
        if not callable(function) or function not in _STATIC_CALLS:
            return None
        return self._apply(node, function, *node.args)


def unsupported(source: Source, node: ast.AST) -> NoReturn:
    """Raise the error for a construct outside the subset, with what to write."""
    advice = _ADVICE.get(type(node), "see `code` for what a kernel may hold")
    first = ast.unparse(node).partition("\n")[0]
    raise source.error(node, f"`{first}` is not of the subset; {advice}")


_ADVICE: Final[dict[type[ast.AST], str]] = {
    ast.Slice: "write at(a, k) for a[k:]",
    ast.ListComp: "write a loop into an array",
    ast.List: "keep numbers in an array that is passed in, tables in global tuples",
    ast.Tuple: "tables are global tuples; tuples stand only left and right of `=`",
    ast.GeneratorExp: "write total(... for j in unrolled(...)), or a loop",
    ast.Lambda: "write a function by `def`",
    ast.AnnAssign: "the first value of a variable gives its kind",
    ast.Assert: "return a status",
    ast.Raise: "return a status",
    ast.Try: "return a status",
    ast.FunctionDef: "put the function beside this one",
    ast.Import: "import at the top of the module",
    ast.ImportFrom: "import at the top of the module",
    ast.Global: "pass an array and store into it",
    ast.JoinedStr: "text belongs to the caller",
}
