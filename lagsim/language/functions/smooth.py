"""The rows of functions that are differentiated as they are."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from lagsim.language.functions import recurrences
from lagsim.language.functions.row import TRANSCENDENTAL, Function, intrinsic, libm

if TYPE_CHECKING:
    from collections.abc import Callable

    from lagsim.language.builder import Builder


def _unary(
    name: str,
    value: Callable[[float], float],
    slope: Callable[[Builder, int, int], int],
    **more: Any,
) -> Function:
    """Give the row of f(x); `slope` is (graph, x, f) -> df/dx."""
    usual = {
        "sympy": lambda s, x: getattr(s, name)(x),
        "python": f"np.{name}({{0}})",
        "cost": TRANSCENDENTAL,
    }
    return Function(
        name=name,
        arity=1,
        value=value,
        partials=lambda g, a, f: (slope(g, a[0], f),),
        **{**usual, **more},
    )


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


def _atan2_partials(g: Builder, a: tuple[int, ...], _: int) -> tuple[int, ...]:
    y, x = a
    r2 = g.call("add", _square(g, x), _square(g, y))
    return g.call("div", x, r2), g.call("neg", g.call("div", y, r2))


def _within_one(g: Builder, a: tuple[int, ...]) -> int:
    return g.call("le", g.call("abs", a[0]), g.one)


def _not_below_zero(g: Builder, a: tuple[int, ...]) -> int:
    return g.call("ge", a[0], g.zero)


def _sinh(x: float) -> float:
    try:
        return math.sinh(x)
    except OverflowError:
        return math.copysign(math.inf, x)


TRIGONOMETRIC = (
    _unary(
        "sin", math.sin, lambda g, x, f: g.call("cos", x), **intrinsic("sin"),
        latex=r"\sin", interval=lambda r: r.wave(r.np.sin, math.pi / 2, -math.pi / 2),
    ),
    _unary(
        "cos", math.cos, lambda g, x, f: g.call("neg", g.call("sin", x)),
        **intrinsic("cos"), latex=r"\cos",
        interval=lambda r: r.wave(r.np.cos, 0.0, math.pi),
    ),
    _unary(
        "tan", math.tan, lambda g, x, f: _one_plus(g, f), **libm("tan"), latex=r"\tan",
        interval=lambda r: r.tan,
    ),
    _unary(
        "asin", math.asin, lambda g, x, f: _over_root(g, _one_minus(g, x)),
        **libm("asin"), latex=r"\arcsin", python="np.arcsin({0})",
        interval=lambda r: r.on(r.np.arcsin, -1.0, 1.0), steep=True, domain=_within_one,
    ),
    _unary(
        "acos", math.acos,
        lambda g, x, f: g.call("neg", _over_root(g, _one_minus(g, x))), **libm("acos"),
        latex=r"\arccos", python="np.arccos({0})", interval=lambda r: r.acos,
        steep=True, domain=_within_one,
    ),
    _unary(
        "atan", math.atan, lambda g, x, f: _over(g, _one_plus(g, x)), **libm("atan"),
        latex=r"\arctan", python="np.arctan({0})",
        interval=lambda r: r.increasing(r.np.arctan),
    ),
    Function(
        name="atan2", arity=2, value=math.atan2, partials=_atan2_partials,
        **libm("atan2", 2), sympy=lambda s, y, x: s.atan2(y, x),
        python="np.arctan2({0}, {1})", interval=lambda r: r.atan2, cost=TRANSCENDENTAL,
    ),
)  # fmt: skip

HYPERBOLIC = (
    _unary(
        "sinh", _sinh, lambda g, x, f: g.call("cosh", x), **libm("sinh"),
        latex=r"\sinh", interval=lambda r: r.increasing(r.np.sinh),
    ),
    _unary(
        "cosh", math.cosh, lambda g, x, f: g.call("sinh", x), **libm("cosh"),
        latex=r"\cosh", interval=lambda r: r.cosh,
    ),
    _unary(
        "tanh", math.tanh, lambda g, x, f: _one_minus(g, f), **libm("tanh"),
        latex=r"\tanh", interval=lambda r: r.increasing(r.np.tanh),
    ),
    _unary(
        "asinh", math.asinh, lambda g, x, f: _over_root(g, _one_plus(g, x)),
        **libm("asinh"), python="np.arcsinh({0})",
        interval=lambda r: r.increasing(r.np.arcsinh),
    ),
    _unary(
        "acosh", math.acosh,
        lambda g, x, f: _over_root(g, g.call("sub", _square(g, x), g.one)),
        **libm("acosh"), python="np.arccosh({0})",
        interval=lambda r: r.on(r.np.arccosh, 1.0),
        domain=lambda g, a: g.call("ge", a[0], g.one),
    ),
    _unary(
        "atanh", lambda x: math.copysign(math.inf, x) if abs(x) == 1 else math.atanh(x),
        lambda g, x, f: _over(g, _one_minus(g, x)), **libm("atanh"),
        python="np.arctanh({0})",
        interval=lambda r: r.on(r.np.arctanh, -1.0, 1.0, open_end=True),
        domain=_within_one,
    ),
)  # fmt: skip

POWERS = (
    _unary(
        "exp", math.exp, lambda g, x, f: f, **intrinsic("exp"), latex=r"\exp",
        interval=lambda r: r.exp,
    ),
    _unary(
        "log", lambda x: -math.inf if x == 0 else math.log(x),
        lambda g, x, f: _over(g, x), **intrinsic("log"), text="ln", latex=r"\ln",
        interval=lambda r: r.on(r.np.log, 0.0, open_end=True), steep=True,
        domain=_not_below_zero,
    ),
    _unary(
        "log10", lambda x: -math.inf if x == 0 else math.log10(x),
        lambda g, x, f: _over(g, g.call("mul", g.constant(math.log(10.0)), x)),
        **intrinsic("log10"), sympy=lambda s, x: s.log(x, 10), spelled=True,
        text="log₁₀", latex=r"\log_{10}",
        interval=lambda r: r.on(r.np.log10, 0.0, open_end=True), steep=True,
        domain=_not_below_zero,
    ),
    _unary(
        "sqrt", math.sqrt, lambda g, x, f: g.call("div", g.constant(0.5), f),
        **intrinsic("sqrt"), interval=lambda r: r.sqrt,
        series=recurrences.sqrt, convolutions=0.5, cost=4, domain=_not_below_zero,
    ),
    _unary(
        "cbrt", math.cbrt,
        lambda g, x, f: _over(g, g.call("mul", g.constant(3.0), _square(g, f))),
        **libm("cbrt"), sympy=lambda s, x: s.real_root(x, 3), spelled=True,
        latex=(r"\sqrt[3]{", "}"), interval=lambda r: r.increasing(r.np.cbrt),
        steep=True, decided_by="sign",
    ),
    Function(
        name="hypot", arity=2, value=math.hypot,
        partials=lambda g, a, f: (g.call("div", a[0], f), g.call("div", a[1], f)),
        commutes=True, **libm("hypot", 2), sympy=lambda s, x, y: s.sqrt(x**2 + y**2),
        python="np.hypot({0}, {1})", interval=lambda r: r.hypot,
        series=recurrences.hypot, convolutions=1.5, cost=TRANSCENDENTAL, steep=True,
    ),
)  # fmt: skip
