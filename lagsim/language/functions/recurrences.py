"""Taylor coefficients of operations that have a recurrence of their own.

Sources: A. Griewank and A. Walther, Evaluating Derivatives, 2nd ed. (2008), chapter 13;
A. Jorba and M. Zou, Experimental Mathematics 14 (2005), proposition 2.1.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from lagsim.language.sizes import UNDONE

if TYPE_CHECKING:
    from collections.abc import Iterable

    from lagsim.language.builder import Coefficients

# Powers up to this are written as products and a root: cheaper than the recurrence,
# which divides by the base and so fails where that passes zero.
LARGEST_PRODUCT = 64


def scaled(s: Coefficients, factor: float, node: int) -> int:
    """Give factor * node."""
    return s.g.call("mul", s.g.constant(factor), node)


def convolution(s: Coefficients, a: int, b: int, k: int, js: Iterable[int]) -> int:
    """Give the sum of a_j b_(k-j).

    The newest coefficients, those of the highest order, are added last: whatever
    does not wait for them is ready by then.
    """
    js = sorted(js, key=lambda j: (-min(j, k - j), j))
    return s.g.product_sum((s(a, j), s(b, k - j)) for j in js)


def square(s: Coefficients, a: int, k: int, least: int = 0) -> int:
    """Give the sum of a_j a_(k-j), j from `least` to k - `least`, by halves."""
    g = s.g
    total = convolution(s, a, a, k, range(least, (k + 1) // 2))
    total = scaled(s, 2.0, total)
    if k % 2 == 0 and 2 * least <= k:
        middle = s(a, k // 2)
        total = g.call("add", total, g.call("mul", middle, middle))
    return total


def add(s: Coefficients, n: int, k: int) -> int:
    """Give x_k + y_k."""
    x, y = s.g.args[n]
    return s.g.call("add", s(x, k), s(y, k))


def sub(s: Coefficients, n: int, k: int) -> int:
    """Give x_k - y_k."""
    x, y = s.g.args[n]
    return s.g.call("sub", s(x, k), s(y, k))


def neg(s: Coefficients, n: int, k: int) -> int:
    """Give -x_k."""
    return s.g.call("neg", s(s.g.args[n][0], k))


def mul(s: Coefficients, n: int, k: int) -> int:
    """Give the sum of x_j y_(k-j)."""
    x, y = s.g.args[n]
    return square(s, x, k) if x == y else convolution(s, x, y, k, range(k + 1))


def div(s: Coefficients, n: int, k: int) -> int:
    """F y = x: y_0 f_k = x_k - sum of y_j f_(k-j), j from 1 to k."""
    g = s.g
    x, y = g.args[n]
    earlier = convolution(s, y, n, k, range(1, k + 1)) if s.moves(y) else g.zero
    return g.call("mul", g.call("sub", s(x, k), earlier), g.call("div", g.one, y))


def sqrt(s: Coefficients, n: int, k: int) -> int:
    """F f = x: 2 f_0 f_k = x_k - sum of f_j f_(k-j), j from 1 to k - 1."""
    g = s.g
    rest = g.call("sub", s(g.args[n][0], k), square(s, n, k, 1))
    return g.call("mul", rest, g.call("div", g.constant(0.5), n))


def hypot(s: Coefficients, n: int, k: int) -> int:
    """Give the root of x^2 + y^2."""
    g = s.g

    def root() -> int:
        x, y = (g.call("mul", a, a) for a in g.args[n])
        return g.call("sqrt", g.call("add", x, y))

    twin = s.twin(n, root)
    assert twin is not None
    return s(twin, k)


def power(s: Coefficients, n: int, k: int) -> int:
    """X f' = p x' f: x_0 f_k = sum of ((p + 1) j/k - 1) x_j f_(k-j), j from 1 to k."""
    g = s.g
    twin = s.twin(n, lambda: _as_products(s, n))
    if twin is not None:
        return s(twin, k)
    x, p = g.args[n]
    pairs = [(s(x, j), s(n, k - j)) for j in range(1, k + 1)]
    rates = ((scaled(s, j, a), b) for j, (a, b) in enumerate(pairs, 1))
    more = g.call("add", p, g.one)
    rising = g.call("mul", more, scaled(s, 1.0 / k, g.product_sum(rates)))
    falling = g.product_sum(pairs)
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
