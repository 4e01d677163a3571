"""Taylor series of the time from an instant, as arrays (ORDER + 1,) of coefficients."""

from __future__ import annotations

import itertools
import math

import numpy as np
from scipy.optimize import brentq

ORDER = 18
COUNTED = np.arange(1, ORDER + 1)
# Coefficients up to the first are rounding; those up to the second nobody knows.
NOTHING, LITTLE = 1e-12, 1e-7
# Of a series whose least distance to 0 is below this, rounding decides about a root.
GRAZES = 1e-9


class UndecidedError(Exception):
    """The referee does not know how a model moves on."""


def constant(value):
    x = np.zeros(ORDER + 1)
    x[0] = value
    return x


def times(a, b):
    return np.correlate(a, b[::-1], "full")[: ORDER + 1]


def over(a, b):
    """Return the quotient of two series."""
    x = np.zeros(ORDER + 1)
    for k in range(ORDER + 1):
        x[k] = (a[k] - x[:k] @ b[k:0:-1]) / b[0]
    return x


def circle(x):
    """Return sine and cosine of a series."""
    s, c = constant(math.sin(x[0])), constant(math.cos(x[0]))
    d = x[1:] * COUNTED
    for k in COUNTED:
        s[k] = d[:k] @ c[k - 1 :: -1][:k] / k
        c[k] = -(d[:k] @ s[k - 1 :: -1][:k]) / k
    return s, c


def integral(start, rate):
    """Return the integral of the series `rate`, with the initial value of `start`."""
    x = start.copy()
    x[1:] = rate[:-1] / COUNTED
    return x


def rate_of(x):
    """Return the series of the derivative; its last coefficient is 0."""
    found = np.zeros(ORDER + 1)
    found[:-1] = x[1:] * COUNTED
    return found


def powers(d):
    return d ** np.arange(ORDER + 1)


def first_sign(x):
    """Return the sign of a series just after its start, or 0 where it is 0."""
    for c in x:
        if abs(c) > LITTLE:
            return 1 if c > 0 else -1
        if abs(c) > NOTHING:
            raise UndecidedError(f"a margin of {c:.1e}")
    return 0


def deflated(x):
    """Return a series without its leading zeros: roots at its start are none."""
    k = 0
    while k < len(x) and abs(x[k]) <= NOTHING:
        k += 1
    return x[k:]


def radius(series):
    """Return a step within which the last coefficients of all series are rounding."""
    h = math.inf
    for x in series.values():
        size = max(1.0, float(np.max(np.abs(x[:2]))))
        for k in (ORDER - 1, ORDER):
            c = abs(float(x[k]))
            if c > 1e-300:
                h = min(h, 0.7 * (1e-16 * size / c) ** (1.0 / k))
    return h


def first_root(x, h, grazes=GRAZES):
    """Return the first root of a series in (0, h], or None.

    grazes : the least distance to 0 without a root

    Raises
    ------
    UndecidedError
        The series comes so near to 0 without a root that rounding decides.
    """
    c = _cut(x * h ** np.arange(len(x)), 1e-18)
    if len(c) < 2 or abs(c[0]) > np.sum(np.abs(c[1:])) * (1 + 1e-9) + grazes:
        return None
    ends = [0.0, *sorted(_roots(c[1:] * np.arange(1, len(c)))), 1.0]
    values = [float(np.polyval(c[::-1], s)) for s in ends]
    for k, (a, b) in enumerate(itertools.pairwise(values)):
        if k + 2 < len(ends) and abs(b) < grazes:
            raise UndecidedError("it grazes")
        if (a > 0) != (b > 0) and a != 0.0:
            p = c[::-1]
            root = brentq(
                lambda s, p=p: np.polyval(p, s), ends[k], ends[k + 1],
                xtol=1e-17, rtol=1e-15,
            )  # fmt: skip
            return h * float(root)
    return None


def _cut(c, part):
    """Return the coefficients without trailing ones below rounding."""
    top, size = len(c), np.max(np.abs(c), initial=0.0)
    while top > 1 and abs(c[top - 1]) < part * size:
        top -= 1
    return c[:top]


def _roots(c):
    """Return the real roots of a polynomial between 0 and 1."""
    c = _cut(c, 1e-14)
    if len(c) < 2:
        return []
    roots = np.roots(c[::-1])
    return [
        float(r.real)
        for r in roots
        if abs(r.imag) < 1e-6 * (1 + abs(r)) and 0.0 < r.real < 1.0
    ]
