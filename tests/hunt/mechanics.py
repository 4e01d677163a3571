"""The equations of a scene, by sympy from its texts, and functions in long double.

M q'' = f + A^T lam,    A q'' = b,    M v' along A^T brings a state back onto g = 0
"""

from __future__ import annotations

import itertools
import operator
from typing import Any

import numpy as np
import sympy as sp
from sympy.printing.str import StrPrinter

from tests.sympy_oracle import FUNCTIONS, Oracle, symbol

Long = np.longdouble
# Powers up to this one are written out as products.
MOST_FACTORS = 24


class Sided(Oracle):
    """An oracle in which each kink (`sign`, `abs`, `max`, `if`, ...) is a number.

    The side u of a surface s is 1 where s > 0 and -1 where s < 0, held while the
    integrator stays on one side, so that everything it sees is smooth.
    """

    def __init__(self, text, more=None):
        self.sides: list[sp.Symbol] = []
        self.kinks: list[sp.Expr] = []
        self.functions = FUNCTIONS | {
            "sign": self._side,
            "abs": lambda x: self._side(x) * x,
            "max": lambda x, y: (x + y + self._side(x - y) * (x - y)) / 2,
            "min": lambda x, y: (x + y - self._side(x - y) * (x - y)) / 2,
            "if": self._if,
            **(more or {}),
        }
        super().__init__(text)

    def _side(self, surface):
        """Return the side of a surface; equal surfaces have one side."""
        if surface.is_number:
            return sp.sign(surface)
        for side, known in zip(self.sides, self.kinks, strict=True):
            if sp.expand(known - surface) == 0:
                return side
            if sp.expand(known + surface) == 0:
                return -side
        self.sides.append(sp.Symbol(f"side_{len(self.sides)}", real=True))
        self.kinks.append(surface)
        return self.sides[-1]

    def _truth(self, condition):
        """Return 1 where a condition is true, and -1 where it is false."""
        if isinstance(condition, (sp.And, sp.Or)):
            sign = -1 if isinstance(condition, sp.And) else 1
            none = sp.Mul(*((1 - sign * self._truth(c)) / 2 for c in condition.args))
            return sign * (1 - 2 * none)
        return self._side(condition.gts - condition.lts)

    def _if(self, condition, a, b):
        side = self._truth(condition)
        return (1 + side) / 2 * a + (1 - side) / 2 * b


class Mechanics(Sided):
    """Equations of a scene, as functions of t, y = (q, v), parameters p and sides u.

    surfaces(t, y, p, u) -> list (k,); their `slopes` take the accelerations too
    looks(t, y, p, a) -> features over their widths, then their rates
    """

    number = sp.Rational  # as the double that it is
    pi = sp.Rational(float(sp.pi))

    def __init__(self, scene):
        self.scene = scene
        super().__init__(scene.text())
        self.values = [Long(x) for x in scene.gathered("parameters").values()]
        sides = scene.until.replace(">", "<").split("<=")
        end = [self.read(sides[0]) - self.read(sides[1])] if scene.until else []
        self.features = [
            self.read(text) / sp.Rational(width)
            for text, width in scene.terms("features")
        ]
        y = [*self.q, *self.v]
        state = [[self.t], y, [symbol(name) for name in self.parameter_texts]]
        terms = [*sp.flatten(self.M), *sp.flatten(self.A)]
        g = [sp.Integer(0) if g.has(*self.v) else -g for g in self.constraints]
        self._forces = function([*state, self.sides], [*terms, *self.b, *self.f])
        self._off = function(state, [*terms, *g])
        self._drift = function(state, [*terms, *(-x for x in self.rates)])
        watched = [*self.kinks, *end]
        self.surfaces = function([*state, self.sides], watched)
        rates = [self.rate(s) for s in watched]
        self.slopes = function([*state, self.sides, self.a], rates)
        self.jerky = [s.has(*self.v) for s in self.kinks]
        self.timed = [not s.has(*y) for s in self.kinks]
        rates = [self.rate(s) for s in self.features]
        self.looks = function([*state, self.a], [*self.features, *rates])

    def motion(self, t, y, p, u):
        """Return q'' (n,) and lam (m,)."""
        return self._solved(self._forces([t], y, p, u))

    def positions(self, t, y, p):
        """Return the displacement (n,) that moves a state onto its constraints."""
        return self._solved(self._off([t], y, p))[0]

    def velocities(self, t, y, p):
        """Return the least change of velocity (n,) that satisfies the constraints."""
        return self._solved(self._drift([t], y, p))[0]

    def _solved(self, x):
        """Solve M a = f + A^T lam, A a = b; x lists M, A, b and perhaps f."""
        n, m = len(self.q), len(self.constraints)
        A = [x[n * (n + k) : n * (n + k + 1)] for k in range(m)]
        b, f = x[n * (n + m) :][:m], x[n * (n + m) + m :] or [Long(0)] * n
        X = [[*x[n * i : n * (i + 1)], *(row[i] for row in A), f[i]] for i in range(n)]
        *moved, a = eliminated(X)
        if not m:
            return np.array(a), np.zeros(0, Long)
        S = [[*(dot(row, y) for y in moved), b[k] - dot(row, a)]
             for k, row in enumerate(A)]  # fmt: skip
        (lam,) = eliminated(S)
        a = [z + dot(lam, pushes) for z, *pushes in zip(a, *moved, strict=True)]
        return np.array(a), np.array(lam)


def dot(x, y):
    return sum(map(operator.mul, x, y))


def eliminated(rows):
    """Solve n rows (n + k) of a positive matrix and its right sides: k columns (n,).

    By Gauss without exchanges, as L D L^T would; in place.
    """
    n = len(rows)
    if n == 1:
        return [[x / rows[0][0]] for x in rows[0][1:]]
    for k, pivot in enumerate(rows):
        for row in rows[k + 1 :]:
            if row[k]:
                factor = row[k] / pivot[k]
                for j in range(k + 1, len(row)):
                    row[j] -= factor * pivot[j]
    columns = []
    for j in range(n, len(rows[0])):
        found: list[Any] = []
        for k in range(n - 1, -1, -1):
            row = rows[k]
            found.insert(0, (row[j] - dot(row[k + 1 : n], found)) / row[k])
        columns.append(found)
    return columns


class _Printer(StrPrinter):
    """Python text for long double: products for powers, constants by number."""

    def __init__(self):
        super().__init__()
        self.constants: dict[str, Any] = {}
        self._count = itertools.count()

    def _print_Rational(self, e):  # noqa: N802
        high = float(e)
        low = float(e - sp.Rational(high)) if np.isfinite(high) else 0.0
        self.constants[str(e)] = Long(high) + Long(low)
        return f"constants[{str(e)!r}]"

    _print_Integer = _print_Half = _print_One = _print_Rational  # noqa: N815
    _print_NegativeOne = _print_Zero = _print_Rational  # noqa: N815

    def _print_Mul(self, e):  # noqa: N802
        below = [x for x in e.args if x.is_Pow and x.exp.is_number and x.exp < 0]
        above = [self._print(x) for x in e.args if x not in below]
        if e.args[0] == -1:
            above = [f"-{above[1]}", *above[2:]] if len(above) > 1 else above
        text = "*".join(above) or self._print(sp.Integer(1))
        under = "*".join(self._print(sp.Pow(x.base, -x.exp)) for x in below)
        return f"({text}/({under}))" if below else f"({text})"

    def _print_Add(self, e, order=None):  # noqa: ARG002, N802
        return "(" + " + ".join(self._print(x) for x in e.args) + ")"

    def _print_Pow(self, e, rational=False):  # noqa: ARG002, N802
        base, exponent = self._print(e.base), e.exp
        if exponent == sp.Rational(1, 2):
            return f"root({base})"
        if exponent.is_Integer and 1 < abs(exponent) <= MOST_FACTORS:
            w = f"factor_{next(self._count)}"
            text = f"({w} := {base})" + f"*{w}" * (abs(int(exponent)) - 1)
            return f"({text})" if exponent > 0 else f"(one/({text}))"
        if exponent == -1:
            return f"(one/{base})"
        return f"power({base}, {self._print(exponent)})"

    def _print_Function(self, e):  # noqa: N802
        arguments = ", ".join(self._print(x) for x in e.args)
        return f"{type(e).__name__}({arguments})"

    _print_ExpBase = _print_exp = _print_Function  # noqa: N815


def _power(base, exponent):
    """Return a power; a base that rounding made negative counts as 0."""
    if exponent == int(exponent):
        return base ** int(exponent)
    return base**exponent if base > 0 else Long(0)


_SCOPE = {
    name: getattr(np, name)
    for name in ["sin", "cos", "tan", "exp", "log", "tanh", "sinh", "cosh"]
} | {
    "atan": np.arctan, "atan2": np.arctan2, "asin": np.arcsin, "acos": np.arccos,
    "power": _power, "one": Long(1),
    "root": lambda x: np.sqrt(x) if x > 0 else Long(0),
}  # fmt: skip


def function(inputs, answers):
    """Compile a list of answers to a function of lists of numbers."""
    printer = _Printer()
    scope = _SCOPE | {"constants": printer.constants}
    return sp.lambdify(inputs, answers, [scope], printer, cse=True)
