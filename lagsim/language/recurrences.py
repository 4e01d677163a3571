"""Taylor coefficients of operations that have a recurrence of their own.

Sources: A. Griewank and A. Walther, Evaluating Derivatives, 2nd ed. (2008), chapter 13;
A. Jorba and M. Zou, Experimental Mathematics 14 (2005), proposition 2.1.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from lagsim.language.simpler import UNDONE

if TYPE_CHECKING:
    from lagsim.language.simpler import Coefficients


# Powers up to this are written as products and a root: cheaper than the recurrence,
# which divides by the base and so fails where that passes zero.
LARGEST_PRODUCT = 64


def add(s: Coefficients, n: int) -> int:
    """Give x_k + y_k."""
    x, y = s.g.args[n]
    return s.g.call("add", s(x), s(y))


def sub(s: Coefficients, n: int) -> int:
    """Give x_k - y_k."""
    x, y = s.g.args[n]
    return s.g.call("sub", s(x), s(y))


def neg(s: Coefficients, n: int) -> int:
    """Give -x_k."""
    return s.g.call("neg", s(s.g.args[n][0]))


def mul(s: Coefficients, n: int) -> int:
    """Give the sum of x_j y_(k-j).

    The newest coefficients, those of order k, are added last: whatever does not wait
    for them is ready by then.
    """
    g = s.g
    x, y = g.args[n]
    if x == y:
        newest = g.call("mul", g.call("mul", g.constant(2.0), x), s(x))
        return g.call("add", s.inner(x, x), newest)
    total = g.call("add", s.inner(x, y), g.call("mul", x, s(y)))
    return g.call("add", total, g.call("mul", s(x), y))


def div(s: Coefficients, n: int) -> int:
    """F y = x: y_0 f_k = x_k - sum of y_j f_(k-j), j from 1 to k."""
    g = s.g
    x, y = g.args[n]
    earlier = g.call("add", s.inner(y, n), g.call("mul", s(y), n))
    return g.call("mul", g.call("sub", s(x), earlier), g.call("div", g.one, y))


def sqrt(s: Coefficients, n: int) -> int:
    """F f = x: 2 f_0 f_k = x_k - sum of f_j f_(k-j), j from 1 to k - 1."""
    g = s.g
    rest = g.call("sub", s(g.args[n][0]), s.inner(n, n))
    return g.call("mul", rest, g.call("div", g.constant(0.5), n))


def hypot(s: Coefficients, n: int) -> int:
    """Give the root of x^2 + y^2."""
    g = s.g

    def root() -> int:
        x, y = (g.call("mul", a, a) for a in g.args[n])
        return g.call("sqrt", g.call("add", x, y))

    twin = s.twin(n, root)
    assert twin is not None
    return s(twin)


def integral(s: Coefficients, x: int, slope: int) -> int:
    """F' = slope x': f_k = sum of j/k x_j slope_(k-j), j from 1 to k."""
    g = s.g
    return g.call("add", s.inner_rate(x, slope), g.call("mul", slope, s(x)))


def power(s: Coefficients, n: int) -> int:
    """X f' = p x' f: x_0 f_k = sum of ((p + 1) j/k - 1) x_j f_(k-j), j from 1 to k."""
    g = s.g
    twin = s.twin(n, lambda: _as_products(s, n))
    if twin is not None:
        return s(twin)
    x, p = g.args[n]
    rising = g.call("mul", g.call("add", p, g.one), integral(s, x, n))
    falling = g.call("add", s.inner(x, n), g.call("mul", s(x), n))
    return g.call("mul", g.call("sub", rising, falling), g.call("div", g.one, x))


def _as_products(s: Coefficients, n: int) -> int | None:
    """Give x^p as products and a root, or as an exponential; None: the recurrence."""
    g = s.g
    x, p = g.args[n]
    if s.moves(p):
        return g.call("exp", g.call("mul", p, g.call("log", x)))
    value = g.value(p)
    if value is None or 2.0 * value % 1.0 or abs(value) > LARGEST_PRODUCT:
        return None
    whole = int(abs(value))
    result = g.one if whole == abs(value) else g.call("sqrt", x)
    # Simplified, a product of roots would be the power again.
    root = g.ops[x] in UNDONE

    def times(a: int, b: int) -> int:
        plain = root and a != g.one
        return g.kept("mul", (a, b)) if plain else g.call("mul", a, b)

    while whole:
        if whole % 2:
            result = times(result, x)
        whole //= 2
        x = times(x, x)
    return g.call("div", g.one, result) if value < 0.0 else result
