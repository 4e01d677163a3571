"""Calls in kernels: Python's own, of `math`, of kernels and externals; `total`."""

from __future__ import annotations

import ast
import builtins
import math
from types import FunctionType
from typing import TYPE_CHECKING, Any, Final

from lagsim.native.kernels import words
from lagsim.native.kernels.expressions import Expressions
from lagsim.native.kernels.lines import LLVM, PASSED, RETURNED, Program, Value
from lagsim.native.kernels.source import Source, unsupported

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

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
