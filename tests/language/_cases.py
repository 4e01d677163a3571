"""Each function of the language by mpmath, with arguments to test, without lagsim."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import mpmath as mp

if TYPE_CHECKING:
    from collections.abc import Callable

DIGITS = 40
EVERYWHERE = (-10.0, 10.0)
POSITIVE = (0.01, 10.0)


@dataclass(frozen=True)
class Case:
    """`exact` by mpmath, the `domain` of each argument, whether it has corners."""

    exact: Callable[..., Any]
    domain: tuple[tuple[float, float], ...]
    smooth: bool = True


def _power(x: Any, y: Any) -> Any:
    return mp.power(x, y)


def _real_root(x: Any) -> Any:
    return mp.sign(x) * mp.cbrt(abs(x))


CASES: dict[str, Case] = {
    "add": Case(lambda x, y: x + y, (EVERYWHERE, EVERYWHERE)),
    "sub": Case(lambda x, y: x - y, (EVERYWHERE, EVERYWHERE)),
    "mul": Case(lambda x, y: x * y, (EVERYWHERE, EVERYWHERE)),
    "div": Case(lambda x, y: x / y, (EVERYWHERE, EVERYWHERE)),
    "neg": Case(lambda x: -x, (EVERYWHERE,)),
    "pow": Case(_power, (POSITIVE, EVERYWHERE)),
    "sin": Case(mp.sin, (EVERYWHERE,)),
    "cos": Case(mp.cos, (EVERYWHERE,)),
    "tan": Case(mp.tan, (EVERYWHERE,)),
    "asin": Case(mp.asin, ((-0.99, 0.99),)),
    "acos": Case(mp.acos, ((-0.99, 0.99),)),
    "atan": Case(mp.atan, (EVERYWHERE,)),
    "atan2": Case(mp.atan2, (EVERYWHERE, EVERYWHERE)),
    "sinh": Case(mp.sinh, (EVERYWHERE,)),
    "cosh": Case(mp.cosh, (EVERYWHERE,)),
    "tanh": Case(mp.tanh, ((-3.0, 3.0),)),
    "asinh": Case(mp.asinh, (EVERYWHERE,)),
    "acosh": Case(mp.acosh, ((1.01, 10.0),)),
    "atanh": Case(mp.atanh, ((-0.99, 0.99),)),
    "exp": Case(mp.exp, (EVERYWHERE,)),
    "log": Case(mp.log, (POSITIVE,)),
    "log10": Case(lambda x: mp.log(x) / mp.log(10), (POSITIVE,)),
    "sqrt": Case(mp.sqrt, (POSITIVE,)),
    "cbrt": Case(_real_root, (EVERYWHERE,)),
    "hypot": Case(lambda x, y: mp.sqrt(x**2 + y**2), (EVERYWHERE, EVERYWHERE)),
    "abs": Case(abs, (EVERYWHERE,), smooth=False),
    "sign": Case(mp.sign, (EVERYWHERE,), smooth=False),
    "heaviside": Case(
        lambda x: mp.mpf(1 if x >= 0 else 0), (EVERYWHERE,), smooth=False
    ),
    "floor": Case(mp.floor, (EVERYWHERE,), smooth=False),
    "ceil": Case(mp.ceil, (EVERYWHERE,), smooth=False),
    "mod": Case(  # to an ulp while the quotient is less than 2
        lambda x, y: x - y * mp.floor(x / y), ((-0.9, 1.9), (1.0, 1.8)), smooth=False
    ),
    "min": Case(min, (EVERYWHERE, EVERYWHERE), smooth=False),
    "max": Case(max, (EVERYWHERE, EVERYWHERE), smooth=False),
    "sinc": Case(lambda x: mp.sin(x) / x if x else mp.mpf(1), (EVERYWHERE,)),
    # The branch of `sinc` away from 0, used for |x| >= 1 only.
    "smooth.sinc": Case(
        lambda x: mp.sin(x) / x if abs(x) > 0.5 else mp.nan, ((0.5, 10.0),)
    ),
}
