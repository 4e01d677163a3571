"""The functions and operators of the expression language, one table row each.

A row gives the value in Python, the partial derivatives on the graph, the LLVM IR and
the sympy twin, so that the four cannot drift apart. Values never raise: outside their
domain they are what IEEE 754 says (nan, inf), as in native code.
"""

from __future__ import annotations

import math
import operator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable

    from lagsim.language.graph import Graph

    Partials = Callable[[Graph, tuple[int, ...], int], tuple[int, ...]]


@dataclass(frozen=True, slots=True)
class Function:
    """One row.

    Attributes
    ----------
    value
        The function in Python; may raise ValueError, OverflowError or
        ZeroDivisionError, which `Function.__call__` turns into IEEE values.
    partials
        `(graph, arguments, itself) -> one node per argument`. None for what is
        differentiated branch by branch (`branches`) or not at all (conditions).
    native
        LLVM IR, one instruction per line, the last one the value. `{0}`, `{1}` are the
        operands, `{a}`, `{b}` fresh names, `{c0}` a condition.
    sympy
        `(sympy module, *arguments)`.
    declares
        External symbols that `native` needs, as LLVM declarations.
    condition
        The value is a truth value.
    branches
        For functions that select among their arguments: the condition under which
        the first of the two is taken, as `(graph, arguments) -> node`.
    symbol
        Only an operator: not callable by name in model text.
    """

    name: str
    arity: int
    value: Callable[..., Any]
    native: str
    sympy: Callable[..., Any]
    partials: Partials | None = None
    declares: tuple[str, ...] = ()
    condition: bool = False
    branches: Callable[[Graph, tuple[int, ...]], int] | None = None
    symbol: bool = False
    switch: bool = False

    def __call__(self, *arguments: Any) -> Any:
        """Give the value at float `arguments`, as IEEE 754 has it."""
        try:
            return self.value(*arguments)
        except ValueError:
            return math.nan
        except OverflowError:
            return self._overflow(*arguments)
        except ZeroDivisionError:
            return _division_by_zero(self.name, *arguments)

    def _overflow(self, *arguments: float) -> float:
        if self.name == "sinh" or (self.name == "pow" and arguments[0] < 0):
            odd = self.name == "sinh" or arguments[1] % 2 == 1
            return math.copysign(math.inf, arguments[0]) if odd else math.inf
        return math.inf


def _division_by_zero(name: str, x: float, y: float) -> float:
    if name == "pow":  # 0 to a negative power
        odd = y % 2 == 1
        return math.copysign(math.inf, x) if odd else math.inf
    if x == 0 or math.isnan(x):
        return math.nan
    return math.copysign(math.inf, x) * math.copysign(1.0, y)


def _libm(name: str, arity: int = 1) -> dict[str, Any]:
    kinds = ", ".join(["double"] * arity)
    operands = ", ".join(f"double {{{i}}}" for i in range(arity))
    return {
        "native": f"call double @{name}({operands})",
        "declares": (f"declare double @{name}({kinds}) nounwind memory(none)",),
    }


def _intrinsic(name: str, arity: int = 1) -> dict[str, Any]:
    kinds = ", ".join(["double"] * arity)
    operands = ", ".join(f"double {{{i}}}" for i in range(arity))
    return {
        "native": f"call double @llvm.{name}.f64({operands})",
        "declares": (f"declare double @llvm.{name}.f64({kinds})",),
    }


def _power(x: float, y: float) -> float:
    if x < 0 and math.isfinite(x) and math.isfinite(y) and y % 1 != 0:
        return math.nan  # Python would give a complex number
    return float(x**y)


def _whole(x: float, rounded: Callable[[float], int]) -> float:
    return math.copysign(rounded(x), x) if math.isfinite(x) else x


def _sign(x: float) -> float:
    # numpy's truth values cannot be subtracted.
    return float(x > 0) - float(x < 0) if x == x else math.nan


def _power_partials(g: Graph, a: tuple[int, ...], itself: int) -> tuple[int, ...]:
    x, y = a
    slope = g.call("mul", y, g.call("pow", x, g.call("sub", y, g.constant(1.0))))
    if g.value(y) is not None:
        return slope, g.zero
    # x^y log(x) tends to 0 with x for every y > 0.
    zero = g.call("le", g.call("abs", itself), g.zero)
    log = g.call("mul", itself, g.call("log", x))
    return slope, g.call("if", zero, g.zero, log)


_COMPARE = {"lt": "olt", "le": "ole", "gt": "ogt", "ge": "oge"}


def _comparison(name: str, value: Callable[..., bool], sympy: str) -> Function:
    return Function(
        name,
        2,
        value,
        f"fcmp {_COMPARE[name]} double {{0}}, {{1}}",
        lambda s, x, y: getattr(s, sympy)(x, y),
        condition=True,
        symbol=True,
    )


def _table() -> tuple[Function, ...]:
    """Give all rows: operators, then functions by family."""
    return (*_operators(), *_conditions(), *_smooth(), *_branched())


def _operators() -> tuple[Function, ...]:
    return (
        Function(
            "add",
            2,
            operator.add,
            "fadd double {0}, {1}",
            lambda _, x, y: x + y,
            lambda g, a, _: (g.one, g.one),
            symbol=True,
        ),
        Function(
            "sub",
            2,
            operator.sub,
            "fsub double {0}, {1}",
            lambda _, x, y: x - y,
            lambda g, a, _: (g.one, g.call("neg", g.one)),
            symbol=True,
        ),
        Function(
            "mul",
            2,
            operator.mul,
            "fmul double {0}, {1}",
            lambda _, x, y: x * y,
            lambda g, a, _: (a[1], a[0]),
            symbol=True,
        ),
        Function(
            "div",
            2,
            operator.truediv,
            "fdiv double {0}, {1}",
            lambda _, x, y: x / y,
            lambda g, a, f: (
                g.call("div", g.one, a[1]),
                g.call("neg", g.call("div", f, a[1])),
            ),
            symbol=True,
        ),
        Function(
            "neg",
            1,
            operator.neg,
            "fneg double {0}",
            lambda _, x: -x,
            lambda g, a, _: (g.call("neg", g.one),),
            symbol=True,
        ),
        Function(
            "pow",
            2,
            _power,
            sympy=lambda _, x, y: x**y,
            partials=_power_partials,
            symbol=True,
            **_intrinsic("pow", 2),
        ),
    )


def _conditions() -> tuple[Function, ...]:
    return (
        _comparison("lt", operator.lt, "Lt"),
        _comparison("le", operator.le, "Le"),
        _comparison("gt", operator.gt, "Gt"),
        _comparison("ge", operator.ge, "Ge"),
        Function(
            "and",
            2,
            lambda x, y: x and y,
            "and i1 {0}, {1}",
            lambda s, x, y: s.And(x, y),
            condition=True,
            symbol=True,
        ),
        Function(
            "or",
            2,
            lambda x, y: x or y,
            "or i1 {0}, {1}",
            lambda s, x, y: s.Or(x, y),
            condition=True,
            symbol=True,
        ),
        Function(
            "not",
            1,
            operator.not_,
            "xor i1 {0}, true",
            lambda s, x: s.Not(x),
            condition=True,
            symbol=True,
        ),
    )


def _unary(
    name: str,
    value: Callable[[float], float],
    slope: Callable[[Graph, int, int], int],
    code: dict[str, Any],
    sympy: Callable[..., Any] | None = None,
) -> Function:
    """Give the row of a smooth f(x); `slope` is (graph, x, f) -> df/dx."""
    return Function(
        name,
        1,
        value,
        sympy=sympy or (lambda s, x: getattr(s, name)(x)),
        partials=lambda g, a, f: (slope(g, a[0], f),),
        **code,
    )


def _over(g: Graph, x: int) -> int:
    return g.call("div", g.one, x)


def _square(g: Graph, x: int) -> int:
    return g.call("mul", x, x)


def _one_plus(g: Graph, square_of: int) -> int:
    return g.call("add", g.one, _square(g, square_of))


def _one_minus(g: Graph, square_of: int) -> int:
    return g.call("sub", g.one, _square(g, square_of))


def _atan2_partials(g: Graph, a: tuple[int, ...], _: int) -> tuple[int, ...]:
    y, x = a
    r2 = g.call("add", _square(g, x), _square(g, y))
    return g.call("div", x, r2), g.call("neg", g.call("div", y, r2))


def _acosh_slope(g: Graph, x: int, _: int) -> int:
    return _over(g, g.call("sqrt", g.call("sub", _square(g, x), g.one)))


def _smooth() -> tuple[Function, ...]:
    def root(g: Graph, x: int) -> int:
        return g.call("sqrt", x)

    def thrice_square(g: Graph, f: int) -> int:
        return g.call("mul", g.constant(3.0), _square(g, f))

    return (
        _unary("sin", math.sin, lambda g, x, f: g.call("cos", x), _intrinsic("sin")),
        _unary(
            "cos",
            math.cos,
            lambda g, x, f: g.call("neg", g.call("sin", x)),
            _intrinsic("cos"),
        ),
        _unary("tan", math.tan, lambda g, x, f: _one_plus(g, f), _libm("tan")),
        _unary(
            "asin",
            math.asin,
            lambda g, x, f: _over(g, root(g, _one_minus(g, x))),
            _libm("asin"),
        ),
        _unary(
            "acos",
            math.acos,
            lambda g, x, f: g.call("neg", _over(g, root(g, _one_minus(g, x)))),
            _libm("acos"),
        ),
        _unary(
            "atan", math.atan, lambda g, x, f: _over(g, _one_plus(g, x)), _libm("atan")
        ),
        Function(
            "atan2",
            2,
            math.atan2,
            sympy=lambda s, y, x: s.atan2(y, x),
            partials=_atan2_partials,
            **_libm("atan2", 2),
        ),
        _unary("sinh", math.sinh, lambda g, x, f: g.call("cosh", x), _libm("sinh")),
        _unary("cosh", math.cosh, lambda g, x, f: g.call("sinh", x), _libm("cosh")),
        _unary("tanh", math.tanh, lambda g, x, f: _one_minus(g, f), _libm("tanh")),
        _unary(
            "asinh",
            math.asinh,
            lambda g, x, f: _over(g, root(g, _one_plus(g, x))),
            _libm("asinh"),
        ),
        _unary("acosh", math.acosh, _acosh_slope, _libm("acosh")),
        _unary(
            "atanh",
            lambda x: math.copysign(math.inf, x) if abs(x) == 1 else math.atanh(x),
            lambda g, x, f: _over(g, _one_minus(g, x)),
            _libm("atanh"),
        ),
        _unary("exp", math.exp, lambda g, x, f: f, _intrinsic("exp")),
        _unary(
            "log",
            lambda x: -math.inf if x == 0 else math.log(x),
            lambda g, x, f: _over(g, x),
            _intrinsic("log"),
        ),
        _unary(
            "log10",
            lambda x: -math.inf if x == 0 else math.log10(x),
            lambda g, x, f: _over(g, g.call("mul", g.constant(math.log(10.0)), x)),
            _intrinsic("log10"),
            sympy=lambda s, x: s.log(x, 10),
        ),
        _unary(
            "sqrt",
            math.sqrt,
            lambda g, x, f: g.call("div", g.constant(0.5), f),
            _intrinsic("sqrt"),
        ),
        _unary(
            "cbrt",
            math.cbrt,
            lambda g, x, f: _over(g, thrice_square(g, f)),
            _libm("cbrt"),
            sympy=lambda s, x: s.real_root(x, 3),
        ),
        Function(
            "hypot",
            2,
            math.hypot,
            sympy=lambda s, x, y: s.sqrt(x**2 + y**2),
            partials=lambda g, a, f: (g.call("div", a[0], f), g.call("div", a[1], f)),
            **_libm("hypot", 2),
        ),
    )


def _branched() -> tuple[Function, ...]:
    """Rows whose graph has corners or jumps: differentiated branch by branch."""
    fabs = _intrinsic("fabs")
    return (
        Function(
            "abs",
            1,
            math.fabs,
            sympy=lambda s, x: s.Abs(x),
            partials=lambda g, a, _: (g.call("sign", a[0]),),
            switch=True,
            **fabs,
        ),
        Function(
            "sign",
            1,
            _sign,
            # (x > 0) - (x < 0); x + x*0 keeps a nan a nan.
            "{a} = fcmp ogt double {0}, 0.0\n"
            "{b} = fcmp olt double {0}, 0.0\n"
            "{c} = uitofp i1 {a} to double\n"
            "{d} = uitofp i1 {b} to double\n"
            "{e} = fsub double {c}, {d}\n"
            "{f} = fcmp uno double {0}, {0}\n"
            "select i1 {f}, double {0}, double {e}",
            lambda s, x: s.sign(x),
            lambda g, a, _: (g.zero,),
            switch=True,
        ),
        Function(
            "heaviside",
            1,
            lambda x: 1.0 if x >= 0 else (0.0 if x < 0 else math.nan),
            "{a} = fcmp oge double {0}, 0.0\n"
            "{b} = uitofp i1 {a} to double\n"
            "{c} = fcmp uno double {0}, {0}\n"
            "select i1 {c}, double {0}, double {b}",
            lambda s, x: s.Heaviside(x, 1),
            lambda g, a, _: (g.zero,),
            switch=True,
        ),
        Function(
            "floor",
            1,
            lambda x: _whole(x, math.floor),
            sympy=lambda s, x: s.floor(x),
            partials=lambda g, a, _: (g.zero,),
            switch=True,
            **_intrinsic("floor"),
        ),
        Function(
            "ceil",
            1,
            lambda x: _whole(x, math.ceil),
            sympy=lambda s, x: s.ceiling(x),
            partials=lambda g, a, _: (g.zero,),
            switch=True,
            **_intrinsic("ceil"),
        ),
        Function(
            "min",
            2,
            lambda x, y: y if y < x else x,
            "{a} = fcmp olt double {1}, {0}\nselect i1 {a}, double {1}, double {0}",
            lambda s, x, y: s.Min(x, y),
            branches=lambda g, a: g.call("le", a[0], a[1]),
            switch=True,
        ),
        Function(
            "max",
            2,
            lambda x, y: y if y > x else x,
            "{a} = fcmp ogt double {1}, {0}\nselect i1 {a}, double {1}, double {0}",
            lambda s, x, y: s.Max(x, y),
            branches=lambda g, a: g.call("ge", a[0], a[1]),
            switch=True,
        ),
        Function(
            "if",
            3,
            lambda c, x, y: x if c else y,
            "select i1 {0}, double {1}, double {2}",
            lambda s, c, x, y: s.Piecewise((x, c), (y, True)),
            branches=lambda g, a: a[0],
            switch=True,
        ),
    )


OPERATIONS: dict[str, Function] = {row.name: row for row in _table()}
FUNCTIONS: dict[str, Function] = {
    name: row for name, row in OPERATIONS.items() if not row.symbol
}
