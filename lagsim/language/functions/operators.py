"""The rows of operators, on numbers and on conditions."""

from __future__ import annotations

import math
import operator
from typing import TYPE_CHECKING

from lagsim.language.functions import recurrences, simpler
from lagsim.language.functions.row import CHAIN, Function, intrinsic

if TYPE_CHECKING:
    from collections.abc import Callable

    from lagsim.language.builder import Builder


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
    slope = g.call("mul", y, g.call("pow", x, g.call("sub", y, g.constant(1.0))))
    if g.value(y) is not None:
        return slope, g.zero
    # x^y log(x) tends to 0 with x for every y > 0.
    zero = g.call("le", g.call("abs", itself), g.zero)
    log = g.call("mul", itself, g.call("log", x))
    return slope, g.call("if", zero, g.zero, log)


def _power_domain(g: Builder, a: tuple[int, ...]) -> int | None:
    exponent = g.value(a[1])
    if exponent is not None and exponent == math.floor(exponent):
        return None
    return g.call("ge", a[0], g.zero)


NUMBERS = (
    Function(
        name="add", arity=2, binds=5, sign=" + ", value=operator.add,
        partials=lambda g, a, _: (g.one, g.one), simpler=simpler.add, commutes=True,
        native="fadd double {0}, {1}",
        sympy=lambda _, x, y: x + y, python="{0} + {1}", interval=lambda r: r.add,
        series=recurrences.add, convolutions=0.0,
    ),
    Function(
        name="sub", arity=2, binds=5, sign=" - ", value=operator.sub,
        partials=lambda g, a, _: (g.one, g.call("neg", g.one)), simpler=simpler.sub,
        native="fsub double {0}, {1}",
        sympy=lambda _, x, y: x - y, python="{0} - {1}", interval=lambda r: r.sub,
        series=recurrences.sub, convolutions=0.0,
    ),
    Function(
        name="mul", arity=2, binds=6, sign="*", value=operator.mul,
        partials=lambda g, a, _: (a[1], a[0]), simpler=simpler.mul, commutes=True,
        native="fmul double {0}, {1}",
        sympy=lambda _, x, y: x * y, python="{0} * {1}", interval=lambda r: r.mul,
        series=recurrences.mul, convolutions=1.0,
    ),
    Function(
        name="div", arity=2, binds=6, sign="/", value=_quotient,
        partials=lambda g, a, f: (
            g.call("div", g.one, a[1]),
            g.call("neg", g.call("div", f, a[1])),
        ),
        simpler=simpler.div, native="fdiv double {0}, {1}",
        sympy=lambda _, x, y: x / y, python="{0} / {1}", interval=lambda r: r.div,
        series=recurrences.div, convolutions=1.0, cost=4, steep=True,
    ),
    Function(
        name="neg", arity=1, binds=7, sign="-", value=operator.neg,
        partials=lambda g, a, _: (g.call("neg", g.one),), simpler=simpler.neg,
        native="fneg double {0}", sympy=lambda _, x: -x, python="-{0}",
        interval=lambda r: r.neg, series=recurrences.neg, convolutions=0.0, exact=True,
    ),
    Function(
        name="pow", arity=2, binds=8, sign="^", value=_power, partials=_power_partials,
        simpler=simpler.power, **intrinsic("pow", 2), sympy=lambda _, x, y: x**y,
        python="{0} ** {1}", interval=lambda r: r.power, series=recurrences.power,
        convolutions=CHAIN, cost=3, steep=True, domain=_power_domain,
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
        interval=lambda r: getattr(r, name),
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
        interval=lambda r: r.both,
    ),
    Function(
        name="or", arity=2, condition=True, binds=1, sign=" or ",
        value=lambda x, y: x or y, commutes=True, native="or i1 {0}, {1}",
        sympy=lambda s, x, y: s.Or(x, y), python="{0} or {1}",
        interval=lambda r: r.either,
    ),
    Function(
        name="not", arity=1, condition=True, binds=3, sign="not ", value=operator.not_,
        native="xor i1 {0}, true", sympy=lambda s, x: s.Not(x),
        python="not {0}", interval=lambda r: r.contrary,
    ),
)  # fmt: skip
