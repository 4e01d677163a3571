"""Table of the functions and operators of the expression language, one row each.

A row has all properties of a function (see `Function`): value, derivative, native code,
enclosure, and its counterparts in sympy, Python and LaTeX, so that they cannot diverge.
Values never raise: outside a domain they are nan or inf as in IEEE 754 and native code.
A new function is a new row.
"""

from __future__ import annotations

import math
import operator
from typing import TYPE_CHECKING, Any, NamedTuple

from lagsim.language import simpler, tables

if TYPE_CHECKING:
    from collections.abc import Callable

    from lagsim.language.simpler import Builder

    Arguments = tuple[int, ...]
    Partials = Callable[[Builder, Arguments, int], Arguments]
    Domain = Callable[[Builder, Arguments], tuple[int, int] | None]


# Cost of a library function, in additions (measured: sin 18, exp 15).
TRANSCENDENTAL = 16


class Function(NamedTuple):
    """Row of the table of functions; most functions have the defaults.

    Attributes
    ----------
    value
        The function in Python; may raise ValueError or OverflowError, which
        `Function.__call__` turns into nan and inf.
    partials
        `(graph, arguments, itself) -> one node per argument`. None for functions that
        are differentiated branch by branch (`branches`) or not at all (conditions).
    branches
        For functions that select among their last two arguments: the condition under
        which the first of these is selected, as `(graph, arguments) -> node`.
    condition
        Whether the value is a truth value.
    native
        LLVM IR, one instruction per line, the last one the value. `{0}`, `{1}` are the
        operands, `{a}` to `{f}` fresh names.
    declares
        External symbols that `native` needs, as LLVM declarations.
    sympy
        `(sympy module, *arguments)`. None where the function has no counterpart, or
        sympy would rewrite it.
    python
        The value as Python code with numpy; `{0}`, `{1}` are the arguments.
    text, latex
        The name for people, or the texts before and after the arguments.
    interval
        The rule for enclosures, made from the module `intervals`; by default the rule
        there with the function's name.
    cost
        Cost in additions.
    simpler
        `(graph, *arguments)`: a simpler node of equal value, or None.
    commutes
        Whether two arguments may be exchanged.
    exact
        Whether the value is not rounded (nor is that of a selection or a step).
    steep
        Whether a slope is infinite somewhere.
    domain
        `(graph, arguments)`: the condition on the arguments under which the function
        has a value, and the first argument mirrored at the nearest end of the domain;
        None if the function always has a value.
    switch, step
        Whether the graph of the function has a corner or a jump; whether the function
        is constant between jumps.
    decided_by
        The step function whose value identifies the side of the corner.
    data
        Number of leading arguments that are data, see `tables`.
    binds, sign
        For operators: the binding power, and the sign.
    """

    name: str
    arity: int
    value: Callable[..., Any]
    native: str = ""
    python: str = ""
    interval: Callable[[Any], Callable[..., Any]] | None = None
    partials: Partials | None = None
    branches: Callable[[Builder, Arguments], int] | None = None
    condition: bool = False
    sympy: Callable[..., Any] | None = None
    declares: tuple[str, ...] = ()
    text: str | tuple[str, str] = ""
    latex: str | tuple[str, str] = ""
    cost: int = 1
    simpler: Callable[..., int | None] | None = None
    commutes: bool = False
    exact: bool = False
    steep: bool = False
    domain: Domain | None = None
    switch: bool = False
    step: bool = False
    decided_by: str = ""
    data: int = 0
    binds: int = 0
    sign: str = ""

    def chosen(self, g: Builder, a: Arguments, x: int, y: int) -> int:
        """Return the selection of node x or y by the condition of this function.

        If this function is a smooth selection, one whose value and slope do not jump
        where its condition changes, the result is one too.

        a : arguments of the function, which determine the condition.
        """
        assert self.branches is not None
        kept = self.name if self.name == SMOOTH else "if"
        return g.call(kept, self.branches(g, a), x, y)

    def __call__(self, *arguments: Any) -> Any:
        """Return the value at float arguments, nan or inf as in IEEE 754."""
        try:
            return self.value(*arguments)
        except ValueError:
            return math.nan
        except OverflowError:
            return math.inf

    @property
    def rounds(self) -> bool:
        """Whether the value of the function is rounded.

        It is exact where it equals an argument or is a whole number.
        """
        return not (self.exact or self.step or self.branches or self.condition)


def called(symbol: str, *kinds: str, attributes: str = "") -> dict[str, Any]:
    """Return entries `native` and `declares` of the functions table, for a C function.

    symbol : name of the C function.
    kinds : LLVM types of its operands.
    """
    operands = ", ".join(f"{kind} {{{i}}}" for i, kind in enumerate(kinds))
    declared = f"declare double @{symbol}({', '.join(kinds)}) {attributes}"
    return {
        "native": f"call double @{symbol}({operands})",
        "declares": (declared.rstrip(),),
    }


def _by_llvm(name: str, arity: int = 1) -> dict[str, Any]:
    return called(f"llvm.{name}.f64", *["double"] * arity)


def _by_libm(name: str, arity: int) -> dict[str, Any]:
    return called(name, *["double"] * arity, attributes="nounwind memory(none)")


def _whole(x: float, rounded: Callable[[float], int]) -> float:
    return math.copysign(rounded(x), x) if math.isfinite(x) else x


def _sign(x: float) -> float:
    # numpy's truth values cannot be subtracted.
    return float(x > 0) - float(x < 0) if x == x else math.nan


def _step(name: str, value: Callable[[float], float], **more: Any) -> Function:
    return Function(
        name=name,
        arity=1,
        value=value,
        partials=lambda g, a, _: (g.zero,),
        switch=True,
        step=True,
        **more,
    )


def _rounding(name: str, rounded: Callable[[float], int]) -> Function:
    return _step(
        name, lambda x: _whole(x, rounded), **_by_llvm(name),
        python=f"np.{name}({{0}})", latex=(rf"\left\l{name} ", rf"\right\r{name} "),
        interval=lambda r: r.step(getattr(r.np, name)),
    )  # fmt: skip


JUMPS = (
    _step(
        "sign", _sign,
        # (x > 0) - (x < 0); x + x*0 keeps a nan a nan.
        native="{a} = fcmp ogt double {0}, 0.0\n"
        "{b} = fcmp olt double {0}, 0.0\n"
        "{c} = uitofp i1 {a} to double\n"
        "{d} = uitofp i1 {b} to double\n"
        "{e} = fsub double {c}, {d}\n"
        "{f} = fcmp uno double {0}, {0}\n"
        "select i1 {f}, double {0}, double {e}",
        python="np.sign({0})",
        latex=r"\operatorname{sgn}",
        interval=lambda r: r.step(r.np.sign),
    ),
    _step(
        "heaviside", lambda x: 1.0 if x >= 0 else (0.0 if x < 0 else math.nan),
        native="{a} = fcmp oge double {0}, 0.0\n"
        "{b} = uitofp i1 {a} to double\n"
        "{c} = fcmp uno double {0}, {0}\n"
        "select i1 {c}, double {0}, double {b}",
        python="np.heaviside({0}, 1.0)",
        interval=lambda r: r.step(lambda x: r.np.heaviside(x, 1.0)),
    ),
    _rounding("floor", math.floor),
    _rounding("ceil", math.ceil),
)  # fmt: skip


def _piecewise(s: Any, condition: Any, x: Any, y: Any) -> Any:
    """Return sympy's Piecewise: x where the condition holds, else y.

    Nested conditions are not rewritten, which is costly.

    s : the module sympy.
    """
    if condition in (s.true, s.false) or x == y:
        return x if condition != s.false else y
    return s.Piecewise((x, condition), (y, True), evaluate=False)


REMAINDERS = (
    Function(
        name="mod", arity=2,
        value=lambda x, y: x - y * _whole(_quotient(x, y), math.floor),
        simpler=simpler.remainder,  # the graph has the expression that defines it
    ),
)  # fmt: skip


def _extreme(name: str, value: Callable[..., float], sign: str) -> Function:
    """Return the row of min or max, which is nan if either argument is nan."""
    better, first = ("lt", "le") if sign == "<" else ("gt", "ge")
    return Function(
        name=name, arity=2, value=value, simpler=getattr(simpler, f"{name}imum"),
        branches=lambda g, a: g.call(first, *a),
        native=f"{{a}} = fcmp o{better} double {{1}}, {{0}}\n"
        "{b} = fcmp uno double {1}, {1}\n{c} = or i1 {a}, {b}\n"
        "select i1 {c}, double {1}, double {0}",
        python=f"np.{name}imum({{0}}, {{1}})", latex=rf"\{name}",
        interval=lambda r: r.extreme(getattr(r.np, f"{name}imum")),
        switch=True, decided_by=first,
    )  # fmt: skip


CORNERS = (
    Function(
        name="abs", arity=1, value=math.fabs,
        partials=lambda g, a, _: (g.call("sign", a[0]),), **_by_llvm("fabs"),
        python="np.abs({0})",
        text=("|", "|"), latex=(r"\left|", r"\right|"), interval=lambda r: r.magnitude,
        exact=True, switch=True, decided_by="sign", simpler=simpler.absolute,
    ),
    _extreme("min", lambda x, y: y if y < x or y != y else x, "<"),
    _extreme("max", lambda x, y: y if y > x or y != y else x, ">"),
    Function(
        name="if", arity=3, value=lambda c, x, y: x if c else y,
        branches=lambda g, a: a[0], simpler=simpler.choice,
        native="select i1 {0}, double {1}, double {2}",
        sympy=_piecewise,
        python="{1} if {0} else {2}", interval=lambda r: r.choice, switch=True,
    ),
)  # fmt: skip


# A selection at a removable singularity: its two branches agree to all orders where
# its condition changes, so that it is smooth. Derivatives and series select among those
# of the branches, and nothing is located. People see its last branch, an expression
# that may be undefined at single points. The name has a point: no file can use it.
SMOOTH = "smooth.if"
REMOVABLE = (
    Function(
        name=SMOOTH, arity=3, value=lambda c, x, y: x if c else y,
        branches=lambda g, a: a[0], simpler=simpler.choice,
        native="select i1 {0}, double {1}, double {2}",
        sympy=lambda _, condition, x, y: y,
        python="{1} if {0} else {2}", interval=lambda r: r.smooth_choice,
    ),
    Function(
        name="sinc", arity=1, value=lambda x: math.sin(x) / x if x else 1.0,
        simpler=simpler.cardinal_sine,  # the graph has a smooth selection
    ),
    Function(
        name="smooth.sinc", arity=1, value=lambda x: _quotient(math.sin(x), x),
        partials=lambda g, a, f: (
            g.call("div", g.call("sub", g.call("cos", a[0]), f), a[0]),
        ),
        native="{a} = call double @llvm.sin.f64(double {0})\nfdiv double {a}, {0}",
        declares=("declare double @llvm.sin.f64(double)",),
        sympy=lambda s, x: s.sinc(x), text="sinc", cost=TRANSCENDENTAL + 4, steep=True,
        python="np.sin({0}) / {0}",
        interval=lambda r: r.over_argument(
            r.periodic_rule(r.np.sin, math.pi / 2, -math.pi / 2)
        ),
    ),
)  # fmt: skip


def _quotient(x: float, y: float) -> float:
    try:
        return x / y
    except ZeroDivisionError:
        if x == 0 or math.isnan(x):
            return math.nan
        return math.copysign(math.inf, x) * math.copysign(1.0, y)


def _power(x: float, y: float) -> float:
    if x < 0 and math.isfinite(x) and math.isfinite(y) and y % 1 != 0:
        return math.nan  # Python would give a complex number
    try:
        return float(x**y)
    except (OverflowError, ZeroDivisionError):
        return math.copysign(math.inf, x) if y % 2 == 1 else math.inf


def _power_partials(g: Builder, a: tuple[int, ...], itself: int) -> tuple[int, ...]:
    x, y = a
    exponent = g.value(y)
    if exponent is not None:
        less = g.constant(exponent - 1.0)
        return g.call("mul", y, g.call("pow", x, less)), g.zero
    slope = g.call("mul", y, g.call("pow", x, g.call("sub", y, g.one)))
    # x^y log(x) tends to 0 with x for every y > 0.
    zero = g.call("le", g.call("abs", itself), g.zero)
    log = g.call("mul", itself, g.call("log", x))
    return slope, g.call(SMOOTH, zero, g.zero, log)


def _power_domain(g: Builder, a: Arguments) -> tuple[int, int] | None:
    exponent, inside = g.value(a[1]), g.call("ge", a[0], g.zero)
    if exponent is None:
        inside = g.call("or", inside, g.call("le", a[1], g.call("floor", a[1])))
    elif exponent == math.floor(exponent):
        return None
    return inside, g.call("neg", a[0])


def _operator(
    name: str, sign: str, binds: int, value: Callable[..., Any], **more: Any
) -> Function:
    """Return the table's row of an arithmetic operator of two arguments.

    sign, binds : sign and binding power of the operator.
    value : the function, on floats and on sympy's expressions.
    more : other fields of the row.
    """
    usual = {"sympy": lambda _, x, y: value(x, y)}
    return Function(
        name=name, arity=2, binds=binds, sign=sign, value=value,
        simpler=getattr(simpler, name), native=f"f{name} double {{0}}, {{1}}",
        python=f"{{0}} {sign.strip()} {{1}}", **{**usual, **more},
    )  # fmt: skip


NUMBERS = (
    _operator(
        "add", " + ", 5, operator.add, partials=lambda g, a, _: (g.one, g.one),
        commutes=True,
    ),
    _operator(
        "sub", " - ", 5, operator.sub,
        partials=lambda g, a, _: (g.one, g.call("neg", g.one)),
    ),
    _operator(
        "mul", "*", 6, operator.mul, partials=lambda g, a, _: (a[1], a[0]),
        commutes=True,
    ),
    _operator(
        "div", "/", 6, _quotient, sympy=lambda _, x, y: x / y, cost=4, steep=True,
        partials=lambda g, a, f: (
            g.call("div", g.one, a[1]),
            g.call("neg", g.call("div", f, a[1])),
        ),
    ),
    Function(
        name="neg", arity=1, binds=7, sign="-", value=operator.neg,
        partials=lambda g, a, _: (g.call("neg", g.one),), simpler=simpler.neg,
        native="fneg double {0}", sympy=lambda _, x: -x, python="-{0}",
        exact=True,
    ),
    Function(
        name="pow", arity=2, binds=8, sign="^", value=_power, partials=_power_partials,
        simpler=simpler.power, **_by_llvm("pow", 2), sympy=lambda _, x, y: x**y,
        python="{0} ** {1}", interval=lambda r: r.power,
        cost=3, steep=True, domain=_power_domain,
    ),
)  # fmt: skip


def _comparison(
    name: str, sign: str, value: Callable[..., bool], sympy: str
) -> Function:
    return Function(
        name=name,
        arity=2,
        condition=True,
        binds=4,
        sign=f" {sign} ",
        value=value,
        native=f"fcmp o{name} double {{0}}, {{1}}",
        sympy=lambda s, x, y: getattr(s, sympy)(x, y),
        python=f"{{0}} {sign} {{1}}",
    )


CONDITIONS = (
    _comparison("lt", "<", operator.lt, "Lt"),
    _comparison("le", "<=", operator.le, "Le"),
    _comparison("gt", ">", operator.gt, "Gt"),
    _comparison("ge", ">=", operator.ge, "Ge"),
    Function(
        name="and", arity=2, condition=True, binds=2, sign=" and ",
        value=lambda x, y: x and y, commutes=True, native="and i1 {0}, {1}",
        sympy=lambda s, x, y: s.And(x, y), python="{0} and {1}",
        interval=lambda r: r.ends(r.np.minimum),
    ),
    Function(
        name="or", arity=2, condition=True, binds=1, sign=" or ",
        value=lambda x, y: x or y, commutes=True, native="or i1 {0}, {1}",
        sympy=lambda s, x, y: s.Or(x, y), python="{0} or {1}",
        interval=lambda r: r.ends(r.np.maximum),
    ),
    Function(
        name="not", arity=1, condition=True, binds=3, sign="not ", value=operator.not_,
        native="xor i1 {0}, true", sympy=lambda s, x: s.Not(x),
        python="not {0}", interval=lambda r: r.logical_not,
    ),
)  # fmt: skip


def _smooth(
    name: str,
    value: Callable[..., float],
    *slopes: Callable[..., int],
    numpy: str = "",
    llvm: bool = False,
    within: tuple[float, float] = (-math.inf, math.inf),
    open_end: bool = False,
    **more: Any,
) -> Function:
    """Return the row of a monotone library function of one or more arguments.

    Parameters
    ----------
    name : str
        Its name here, in the C library and in sympy.
    value : function
        The function on floats.
    slopes : functions
        (graph, *arguments, itself) -> node of the derivative, for each argument.
    numpy : str
        Its name in numpy, if that is another.
    llvm : bool
        Whether native code uses LLVM's intrinsic function, not the C library's.
    within : tuple of float
        Ends of the domain.
    open_end : bool
        Whether the function is unbounded at the ends of its domain.
    more
        Other fields of the row.
    """
    arity, own = len(slopes), numpy or name
    operands = ", ".join(f"{{{i}}}" for i in range(arity))
    usual = _by_llvm(name, arity) if llvm else _by_libm(name, arity)
    usual |= {
        "sympy": lambda s, *x: getattr(s, name)(*x),
        "python": f"np.{own}({operands})",
        "cost": TRANSCENDENTAL,
        "interval": lambda r: r.on(getattr(r.np, own), *within, open_end=open_end),
        "domain": _domain(*within),
    }
    return Function(
        name=name,
        arity=arity,
        value=value,
        partials=lambda g, a, f: tuple(slope(g, *a, f) for slope in slopes),
        **{**usual, **more},
    )


def _domain(least: float, most: float) -> Domain | None:
    if most < math.inf:  # and least = -most

        def between(g: Builder, a: Arguments) -> tuple[int, int]:
            inside = g.call("le", g.call("abs", a[0]), g.constant(most))
            ends = (g.call("sub", g.constant(2.0 * x), a[0]) for x in (most, -most))
            return inside, g.call("if", g.call("gt", a[0], g.zero), *ends)

        return between
    if least > -math.inf:
        return lambda g, a: (
            g.call("ge", a[0], g.constant(least)),
            g.call("sub", g.constant(2.0 * least), a[0]),
        )
    return None


def _over(g: Builder, x: int) -> int:
    return g.call("div", g.one, x)


def _square(g: Builder, x: int) -> int:
    return g.call("mul", x, x)


def _one_plus(g: Builder, square_of: int) -> int:
    return g.call("add", g.one, _square(g, square_of))


def _one_minus(g: Builder, square_of: int) -> int:
    return g.call("sub", g.one, _square(g, square_of))


def _over_root(g: Builder, x: int) -> int:
    return _over(g, g.call("sqrt", x))


def _over_squares(g: Builder, top: int, x: int, y: int) -> int:
    return g.call("div", top, g.call("add", _square(g, x), _square(g, y)))


def _sinh(x: float) -> float:
    try:
        return math.sinh(x)
    except OverflowError:
        return math.copysign(math.inf, x)


TRIGONOMETRIC = (
    _smooth(
        "sin", math.sin, lambda g, x, f: g.call("cos", x), llvm=True, latex=r"\sin",
        interval=lambda r: r.periodic_rule(r.np.sin, math.pi / 2, -math.pi / 2),
    ),
    _smooth(
        "cos", math.cos, lambda g, x, f: g.call("neg", g.call("sin", x)), llvm=True,
        latex=r"\cos", interval=lambda r: r.periodic_rule(r.np.cos, 0.0, math.pi),
    ),
    _smooth(
        "tan", math.tan, lambda g, x, f: _one_plus(g, f), latex=r"\tan",
        interval=None,
    ),
    _smooth(
        "asin", math.asin, lambda g, x, f: _over_root(g, _one_minus(g, x)),
        numpy="arcsin", latex=r"\arcsin", within=(-1.0, 1.0), steep=True,
    ),
    _smooth(
        "acos", math.acos,
        lambda g, x, f: g.call("neg", _over_root(g, _one_minus(g, x))),
        numpy="arccos", latex=r"\arccos", within=(-1.0, 1.0), steep=True,
    ),
    _smooth(
        "atan", math.atan, lambda g, x, f: _over(g, _one_plus(g, x)),
        numpy="arctan", latex=r"\arctan",
    ),
    _smooth(
        "atan2", math.atan2,
        lambda g, y, x, f: _over_squares(g, x, x, y),
        lambda g, y, x, f: g.call("neg", _over_squares(g, y, x, y)),
        numpy="arctan2", interval=None,
    ),
)  # fmt: skip

HYPERBOLIC = (
    _smooth("sinh", _sinh, lambda g, x, f: g.call("cosh", x), latex=r"\sinh"),
    _smooth(
        "cosh", math.cosh, lambda g, x, f: g.call("sinh", x), latex=r"\cosh",
        interval=None,
    ),
    _smooth(
        # 1 - tanh(x)^2 would cancel in the tails.
        "tanh", math.tanh, lambda g, x, f: _over(g, simpler.hyperbolic_square(g, x)),
        latex=r"\tanh",
    ),
    _smooth(
        "asinh", math.asinh, lambda g, x, f: _over_root(g, _one_plus(g, x)),
        numpy="arcsinh",
    ),
    _smooth(
        "acosh", math.acosh,
        lambda g, x, f: _over_root(g, g.call("sub", _square(g, x), g.one)),
        numpy="arccosh", within=(1.0, math.inf),
    ),
    _smooth(
        "atanh", lambda x: math.copysign(math.inf, x) if abs(x) == 1 else math.atanh(x),
        lambda g, x, f: _over(g, _one_minus(g, x)),
        numpy="arctanh", within=(-1.0, 1.0), open_end=True,
    ),
)  # fmt: skip

POWERS = (
    _smooth(
        "exp", math.exp, lambda g, x, f: f, llvm=True, latex=r"\exp",
        interval=None,
    ),
    _smooth(
        "log", lambda x: -math.inf if x == 0 else math.log(x),
        lambda g, x, f: _over(g, x), llvm=True, text="ln", latex=r"\ln",
        within=(0.0, math.inf), open_end=True, steep=True,
    ),
    _smooth(
        "log10", lambda x: -math.inf if x == 0 else math.log10(x),
        lambda g, x, f: _over(g, g.call("mul", g.constant(math.log(10.0)), x)),
        llvm=True, sympy=None, text="log₁₀", latex=r"\log_{10}",
        within=(0.0, math.inf), open_end=True, steep=True,
    ),
    _smooth(
        "sqrt", math.sqrt, lambda g, x, f: g.call("div", g.constant(0.5), f),
        llvm=True, within=(0.0, math.inf), cost=4, simpler=simpler.square_root,
    ),
    _smooth(
        "cbrt", math.cbrt,
        lambda g, x, f: _over(g, g.call("mul", g.constant(3.0), _square(g, f))),
        sympy=None, latex=(r"\sqrt[3]{", "}"), steep=True, decided_by="sign",
        simpler=simpler.cube_root,
    ),
    _smooth(
        "hypot", math.hypot, lambda g, x, y, f: g.call("div", x, f),
        lambda g, x, y, f: g.call("div", y, f), commutes=True, steep=True,
        sympy=lambda s, x, y: s.sqrt(x**2 + y**2), interval=None,
        simpler=simpler.hypotenuse,
    ),
)  # fmt: skip


def _of_table(name: str, data: int, numbers: int, **more: Any) -> Function:
    """Return the row of a function of a table.

    data, numbers : how many arguments are arrays of the table, and how many numbers.
    """
    kernel, arity = getattr(tables, f"table_{name}"), data + numbers
    kinds = ["ptr"] * data + ["double"] * numbers
    return Function(
        name=f"table.{name}",
        arity=arity,
        value=tables.on_data(kernel, data),
        **called(kernel.__name__, *kinds, attributes="nounwind memory(argmem: read)"),
        python=f"{kernel.__name__}({', '.join(f'{{{i}}}' for i in range(arity))})",
        cost=TRANSCENDENTAL,
        data=data,
        **more,
    )


def _piece(op: str, count: int) -> Partials:
    """Return the rule `partials` of an operation that evaluates a piece of a table.

    op : the operation.
    count : the number of arguments of the table; only the derivatives by these differ
        from 0.
    """
    return lambda g, a, _: (
        *(g.zero,) * (1 + 2 * count),
        *(tables.differentiated(g, op, a, k) for k in range(count)),
        *(g.zero,) * count,
    )


# Operations of a file's `tables`; their names have a point, so no file can use them.
TABLES = (
    _of_table(
        "knot", 1, 1,
        partials=lambda g, a, _: (g.zero, g.call("table.rate", *a)),
    ),
    _of_table("rate", 1, 1, partials=lambda g, a, _: (g.zero, g.zero)),
    _of_table("piece", 2, 3, partials=_piece("table.piece", 1)),
    _of_table("piece2", 3, 6, partials=_piece("table.piece2", 2)),
)  # fmt: skip


# Sums over the members of a table as a vector, and one number of it, see `elements`.
ELEMENTS, PART = "elements.sums", "elements.part"
SUMS = (
    Function(
        name=ELEMENTS, arity=1, value=lambda of, *z: of.evaluate(z), data=1,
        simpler=lambda g, *args: g.unsimplified(ELEMENTS, args),
    ),
    Function(
        name=PART, arity=2, value=lambda sums, k: float(sums[int(k)]), exact=True,
        simpler=lambda g, *args: g.unsimplified(PART, args),
    ),
)  # fmt: skip


_ROWS = (
    *NUMBERS, *CONDITIONS, *TRIGONOMETRIC, *HYPERBOLIC, *POWERS, *CORNERS, *JUMPS,
    *REMAINDERS,
    *TABLES,
    *REMOVABLE,
    *SUMS,
)  # fmt: skip
OPERATIONS = {row.name: row for row in _ROWS}
FUNCTIONS = {
    name: row for name, row in OPERATIONS.items() if not row.sign and "." not in name
}
# Operators that join conditions, and are words.
JOINING = tuple(name for name, row in OPERATIONS.items() if row.sign.strip() == name)
# Functions that select among their arguments, with a corner or a jump.
CHOOSING = frozenset(
    name for name, row in OPERATIONS.items() if row.branches and row.switch
)
# Functions that are constant between jumps.
STEPS = frozenset(name for name, row in OPERATIONS.items() if row.step)
