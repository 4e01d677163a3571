"""The text of kernels: its location, the meaning of its names, its static values.

Static values are known at translation: numbers and tuples of numbers among the
module's globals; variables of loops over `unrolled`; values computed from static ones
alone.
"""

from __future__ import annotations

import ast
import builtins
import functools
import inspect
import math
from types import FunctionType, ModuleType
from typing import TYPE_CHECKING, Any, Final

from lagsim.native.kernels import words
from lagsim.native.kernels.keys import KernelError, is_static, memories

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence
    from types import CodeType

    from lagsim.native.kernels.keys import Static
    from lagsim.native.layout import Field

KINDS: Final = ("int", "float", "bool", "Floats", "None")


def parameters(function: FunctionType) -> list[str]:
    """Return the names of the parameters of a kernel."""
    code = inspect.unwrap(function).__code__
    return [*code.co_varnames[: code.co_argcount]]


def static_parameters(function: FunctionType) -> list[str]:
    """Return the names of the parameters that are known at translation."""
    kinds = inspect.unwrap(function).__annotations__.items()
    return [name for name, kind in kinds if kind == "Static"]


@functools.cache
def parsed(function: Callable[..., Any]) -> ast.stmt:
    """Return the definition of a function, with the line numbers of its file.

    It is shared by all translations of the function, and must not be changed.
    """
    lines, _ = inspect.findsource(function)
    return _definitions("".join(lines))[function.__code__.co_firstlineno]


@functools.cache
def _definitions(text: str) -> dict[int, ast.stmt]:
    """Return the statements of a module by their first lines, decorators included."""
    found: dict[int, ast.stmt] = {}
    for node in _statements(ast.parse(text)):
        above = [x.lineno for x in getattr(node, "decorator_list", [])]
        found.setdefault(min([node.lineno, *above]), node)
    return found


def _statements(node: ast.AST) -> Iterator[ast.stmt]:
    """Yield the statements within a module or a statement, each before those in it."""
    for name in ("body", "handlers", "orelse", "finalbody", "cases"):
        for part in getattr(node, name, ()):
            if isinstance(part, ast.stmt):
                yield part
            yield from _statements(part)


@functools.cache
def _names(node: ast.AST) -> tuple[ast.Name, ...]:
    """Return the names in a node of a parsed function."""
    if isinstance(node, ast.Name):
        return (node,)
    found: list[ast.Name] = []
    for field in node._fields:
        part = getattr(node, field, None)
        for x in part if isinstance(part, list) else (part,):
            if isinstance(x, ast.AST) and x._fields:
                found += _names(x)
    return tuple(found)


class KernelText:
    """Text and signature of one kernel.

    Attributes
    ----------
    name : str
        The symbol.
    parameters : dict of str to str
        Kind of each parameter that is not static; the kind of a `Memory` is Floats.
    memories : dict
        The `Memory` classes of parameters.
    result : str
        Kind of the result.
    node : ast.FunctionDef
        The function, with the line numbers of the file.
    variables : frozenset of str
        All local names: parameters, and names assigned anywhere.
    """

    def __init__(
        self,
        function: FunctionType,
        statics: Mapping[str, object],
        known: Sequence[int] = (),
    ) -> None:
        names = static_parameters(function)
        self.function = function
        self.statics = {**statics, **dict(zip(names, known, strict=True))}
        self.name = function.__name__
        plain = inspect.unwrap(function)
        self.file = plain.__code__.co_filename
        node = parsed(plain)
        if not isinstance(node, ast.FunctionDef):
            raise self.error(node, "a kernel is a function made by `def`")
        self.node = node
        self.memories = memories(function)
        kinds = {
            name: "Floats"
            if name in self.memories
            else getattr(kind, "__name__", str(kind))
            for name, kind in plain.__annotations__.items()
        }
        self.result = kinds.pop("return", "?")
        code = plain.__code__
        self.parameters = {
            name: kinds.get(name, "?")
            for name in parameters(function)
            if name not in names
        }
        for name, kind in [*self.parameters.items(), ("the result", self.result)]:
            if kind not in KINDS or (name == "the result" and kind == "Floats"):
                text = f"{name} has {kind}; annotate with int, float, bool, Floats or "
                text += "a Memory that is imported for more than types; a result is no "
                raise self.error(node, text + "array")
        self.variables = frozenset(code.co_varnames + code.co_cellvars) - {*names}

    def error(self, node: ast.AST, text: str) -> KernelError:
        """Return an error that names file and line of `node`."""
        line = getattr(node, "lineno", 1)
        return KernelError(f"{self.file}:{line}: in `{self.name}`: {text}")

    def field(self, node: ast.expr) -> tuple[str, Field] | None:
        """Return the parameter and the field that `s.t` denotes; None for other nodes.

        Raises
        ------
        KernelError
            If the memory of the parameter has no such field.
        """
        if not isinstance(node, ast.Attribute) or not isinstance(node.value, ast.Name):
            return None
        memory = self.memories.get(node.value.id)
        if memory is None:
            return None
        if node.attr not in memory.fields:
            raise self.error(node, f"{memory.__name__} has no `{node.attr}`")
        return node.value.id, memory.fields[node.attr]

    def meaning(self, node: ast.expr) -> object:
        """Return the value that a global name, or an attribute of a module, has."""
        if isinstance(node, ast.Attribute):
            return getattr(self.meaning(node.value), node.attr, None)
        name = getattr(node, "id", "")
        for names in (self.statics, self.function.__globals__, vars(builtins)):
            if name in names:
                return names[name]
        raise self.error(node, f"`{ast.unparse(node)}` is not defined")


_STATIC_CALLS: Final = frozenset({abs, min, max, int, float, len, bool}) | {
    f for f in vars(math).values() if callable(f)
}


class Folding:
    """Evaluation of static expressions at the current position in a kernel.

    Attributes
    ----------
    unrolled : dict
        Values of the variables of the enclosing `unrolled` loops.
    """

    def __init__(self, source: KernelText) -> None:
        self.source = source
        self.unrolled: dict[str, int] = {}
        self._globals: dict[str, object] = {}
        self._compiled: dict[ast.expr, CodeType] = {}

    def error(self, node: ast.AST, text: str = "is not of the subset") -> KernelError:
        """Return an error that quotes the source of `node`."""
        first = ast.unparse(node).partition("\n")[0]
        return self.source.error(node, f"`{first}` {text}")

    def fold(self, node: ast.expr) -> Static | None:
        """Return the value of an expression, None where the expression varies."""
        if isinstance(node, ast.Constant):
            return node.value if is_static(node.value) else None
        if isinstance(node, ast.BoolOp):
            return self._decided(node)
        if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not):
            known = self.fold(node.operand)
            return None if known is None else not known
        names: dict[str, object] = {}
        for part in _names(node):
            found = self._static_value(part)
            if found is None:
                return None
            names[part.id] = found
        if isinstance(node, ast.Name):
            return found if is_static(found) else None
        if node not in self._compiled:
            text = ast.Expression(node)
            self._compiled[node] = compile(text, self.source.file, "eval")
        try:
            # A part of a module of lagsim, of names that are numbers and functions.
            value = eval(self._compiled[node], {"__builtins__": {}}, names)  # noqa: S307
        except Exception as fault:
            raise self.error(node, f": {fault}") from fault
        return value if is_static(value) else None

    def _static_value(self, node: ast.Name) -> object | None:
        """Return the static value of a name; None if it has none.

        Modules and functions of static values count as static.
        """
        name = node.id
        if name in self.unrolled:
            return self.unrolled[name]
        if name in self.source.variables:
            return None
        if name not in self._globals:
            value = self.source.meaning(node)
            is_known = isinstance(value, ModuleType) or is_static(value)
            is_known = is_known or (callable(value) and value in _STATIC_CALLS)
            self._globals[name] = value if is_known else None
        return self._globals[name]

    def _decided(self, node: ast.BoolOp) -> bool | None:
        """Return the static value of `and` or `or`; None if it is not static.

        One operand may decide the value, if the operands before contain no call.
        """
        decisive = isinstance(node.op, ast.Or)
        values = []
        for operand in node.values:
            value = self.fold(operand)
            if value is decisive:
                return decisive
            if value is None and any(
                isinstance(n, ast.Call) for n in ast.walk(operand)
            ):
                return None
            values.append(value)
        return None if None in values else not decisive

    def integer(self, node: ast.expr) -> int:
        """Return the value of an expression that must be a static integer.

        Raises
        ------
        KernelError
            If it is not static.
        """
        value = self.fold(node)
        if not isinstance(value, int):
            raise self.error(node, "is not known at translation")
        return value

    def vanishes(self, node: ast.expr) -> bool:
        """Whether a term has a static factor of zero."""
        if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Mult):
            return self.vanishes(node.left) or self.vanishes(node.right)
        return self.fold(node) == 0

    def values(self, target: ast.expr, iterable: ast.expr) -> Iterator[int]:
        """Yield the values of an `unrolled(...)`; each sets the loop's variable.

        target, iterable : the variable and the `unrolled(...)`.
        """
        if not isinstance(target, ast.Name) or not self.is_call_of(
            iterable, words.unrolled
        ):
            raise self.error(iterable, "is no unrolled(...) of one name")
        assert isinstance(iterable, ast.Call)
        before = self.unrolled.copy()
        for value in range(*map(self.integer, iterable.args)):
            self.unrolled[target.id] = value
            yield value
        self.unrolled = before

    def is_call_of(self, node: ast.expr, *functions: object) -> bool:
        """Whether an iterable is a call of one of `functions`."""
        return isinstance(node, ast.Call) and (
            self.source.meaning(node.func) in functions
        )
