"""The rows of functions with corners or jumps: differentiated branch by branch."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from lagsim.language.functions import simpler
from lagsim.language.functions.row import Function, intrinsic

if TYPE_CHECKING:
    from collections.abc import Callable


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
        spelled=True,
        switch=True,
        step=True,
        **more,
    )


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
        sympy=lambda s, x: s.sign(x),
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
        sympy=lambda s, x: s.Heaviside(x, 1), python="np.heaviside({0}, 1.0)",
        interval=lambda r: r.step(lambda x: r.np.heaviside(x, 1.0)),
    ),
    _step(
        "floor", lambda x: _whole(x, math.floor), **intrinsic("floor"),
        sympy=lambda s, x: s.floor(x), python="np.floor({0})",
        latex=(r"\left\lfloor ", r"\right\rfloor "),
        interval=lambda r: r.step(r.np.floor),
    ),
    _step(
        "ceil", lambda x: _whole(x, math.ceil), **intrinsic("ceil"),
        sympy=lambda s, x: s.ceiling(x), python="np.ceil({0})",
        latex=(r"\left\lceil ", r"\right\rceil "), interval=lambda r: r.step(r.np.ceil),
    ),
)  # fmt: skip

CORNERS = (
    Function(
        name="abs", arity=1, value=math.fabs,
        partials=lambda g, a, _: (g.call("sign", a[0]),), **intrinsic("fabs"),
        sympy=lambda s, x: s.Abs(x), spelled=True, python="np.abs({0})",
        text=("|", "|"), latex=(r"\left|", r"\right|"), interval=lambda r: r.magnitude,
        exact=True, switch=True, decided_by="sign",
    ),
    Function(
        name="min", arity=2, value=lambda x, y: y if y < x else x,
        branches=lambda g, a: g.call("le", a[0], a[1]), simpler=simpler.extreme,
        native="{a} = fcmp olt double {1}, {0}\nselect i1 {a}, double {1}, double {0}",
        sympy=lambda s, x, y: s.Min(x, y), spelled=True,
        python="{1} if {1} < {0} else {0}", latex=r"\min",
        interval=lambda r: r.extreme(r.np.minimum), switch=True, decided_by="le",
    ),
    Function(
        name="max", arity=2, value=lambda x, y: y if y > x else x,
        branches=lambda g, a: g.call("ge", a[0], a[1]), simpler=simpler.extreme,
        native="{a} = fcmp ogt double {1}, {0}\nselect i1 {a}, double {1}, double {0}",
        sympy=lambda s, x, y: s.Max(x, y), spelled=True,
        python="{1} if {1} > {0} else {0}", latex=r"\max",
        interval=lambda r: r.extreme(r.np.maximum), switch=True, decided_by="ge",
    ),
    Function(
        name="if", arity=3, value=lambda c, x, y: x if c else y,
        branches=lambda g, a: a[0], simpler=simpler.choice,
        native="select i1 {0}, double {1}, double {2}",
        sympy=lambda s, c, x, y: s.Piecewise((x, c), (y, True)),
        python="{1} if {0} else {2}", interval=lambda r: r.choice, switch=True,
    ),
)  # fmt: skip
