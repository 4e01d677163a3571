"""The equations of a scene, by sympy from its texts, and functions in long double.

Each kink (`sign`, `abs`, `max`, `if`, ...) becomes a number u with a surface s: u = +1
where s > 0 and -1 where s < 0, held while the integrator stays on one side, so that
everything it sees is smooth.

    M q'' = f + A^T lam,    A q'' = b,    M v' along A^T brings a state back onto g = 0
"""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import sympy as sp
from sympy.printing.str import StrPrinter

from tests.sympy_oracle import FUNCTIONS, Oracle, symbol

Long = np.longdouble
# Powers up to this one are written out as products.
MOST_FACTORS = 24


class Mechanics(Oracle):
    """Equations of a scene, as functions of t, y = (q, v), parameters p and sides u.

    acceleration(t, y, p, u) -> list (n,)
    multipliers(t, y, p, u) -> list (m,)
    positions(t, y, p) -> (displacement (n,), residuals (m,))
    velocities(t, y, p) -> (change of velocity (n,), residuals (m,))
    surfaces(t, y, p, u) -> list (k,); their `slopes` take the accelerations too
    """

    number = sp.Rational  # as the double that it is
    pi = sp.Rational(float(sp.pi))

    def __init__(self, scene):
        self.scene = scene
        self.sides: list[sp.Symbol] = []
        self._surfaces: list[sp.Expr] = []
        self.functions = FUNCTIONS | {
            "sign": self._side,
            "abs": lambda x: self._side(x) * x,
            "max": lambda x, y: (x + y + self._side(x - y) * (x - y)) / 2,
            "min": lambda x, y: (x + y - self._side(x - y) * (x - y)) / 2,
            "if": self._if,
        }
        super().__init__(scene.text())
        self.values = [Long(x) for x in scene.gathered("parameters").values()]
        self._compile()

    def _side(self, surface):
        """Give the side of a surface, the same for the same surface."""
        if surface.is_number:
            return sp.sign(surface)
        for side, known in zip(self.sides, self._surfaces, strict=True):
            if sp.expand(known - surface) == 0:
                return side
            if sp.expand(known + surface) == 0:
                return -side
        self.sides.append(sp.Symbol(f"side_{len(self.sides)}", real=True))
        self._surfaces.append(surface)
        return self.sides[-1]

    def _truth(self, condition):
        """Give +1 where a condition holds and -1 where not."""
        if isinstance(condition, (sp.And, sp.Or)):
            sign = -1 if isinstance(condition, sp.And) else 1
            none = sp.Mul(*((1 - sign * self._truth(c)) / 2 for c in condition.args))
            return sign * (1 - 2 * none)
        if isinstance(condition, (sp.Gt, sp.Ge)):
            return self._side(condition.lhs - condition.rhs)
        return self._side(condition.rhs - condition.lhs)

    def _if(self, condition, a, b):
        side = self._truth(condition)
        return (1 + side) / 2 * a + (1 - side) / 2 * b

    def _compile(self):
        sides = self.scene.until.replace(">", "<").split("<=")
        end = [self.read(sides[0]) - self.read(sides[1])] if self.scene.until else []
        self.features = [
            self.read(text) / sp.Rational(width)
            for text, width in self.scene.terms("features")
        ]
        y = [*self.q, *self.v]
        inputs = [[self.t], y, [symbol(name) for name in self.parameter_texts]]
        solve = _Solver(self.M, self.A)
        self.acceleration = function([*inputs, self.sides], *solve(self.f, self.b))
        self.multipliers = function(
            [*inputs, self.sides], *solve(self.f, self.b, multipliers=True)
        )
        zero = [sp.Integer(0)] * len(self.q)
        g = [sp.Integer(0) if g.has(*self.v) else g for g in self.constraints]
        self.positions = function(inputs, *solve(zero, [-x for x in g]), g)
        self.velocities = function(
            inputs, *solve(zero, [-x for x in self.rates]), self.rates
        )
        watched = [*self._surfaces, *end]
        self.surfaces = function([*inputs, self.sides], [], watched)
        self.slopes = function(
            [*inputs, self.sides, self.a], [], [self.rate(s) for s in watched]
        )
        self.jerky = [s.has(*self.v) for s in self._surfaces]
        self.timed = [not s.has(*y) for s in self._surfaces]
        rates = [self.rate(s) for s in self.features]
        self.looks = function([*inputs, self.a], [], [*self.features, *rates])


class _Solver:
    """Writes the elimination of M q'' - A^T lam = f, A q'' = b as steps."""

    def __init__(self, M, A):
        self.M, self.A = M, A

    def __call__(self, f, b, *, multipliers=False):
        """Give the steps (name, value) and the answers in terms of the names."""
        steps = _Steps()
        M = steps.matrix(self.M)
        columns = [steps.row(c) for c in [*self.A, f]]
        A, b = [list(c) for c in columns[:-1]], steps.row(b)
        *X, z = steps.solved(M, columns)
        S = [[steps.dot(row, x) for x in X] for row in A]
        rest = [
            steps.put(right - steps.dot(row, z))
            for right, row in zip(b, A, strict=True)
        ]
        lam = steps.solved(S, [rest])[0] if A else []
        if multipliers:
            return steps.all, lam
        moved = [
            steps.put(z[i] + steps.dot(lam, [x[i] for x in X])) for i in range(len(z))
        ]
        return steps.all, moved


class _Steps:
    def __init__(self):
        self.all: list[tuple[sp.Symbol, sp.Expr]] = []
        self._number = itertools.count()

    def put(self, e):
        if e.is_Atom:
            return e
        self.all.append((sp.Symbol(f"step_{next(self._number)}"), e))
        return self.all[-1][0]

    def row(self, entries):
        return [self.put(e) for e in entries]

    def matrix(self, rows):
        return [self.row(row) for row in rows]

    def dot(self, x, y):
        pairs = zip(x, y, strict=True)
        return self.put(sp.Add(*(a * b for a, b in pairs), evaluate=True))

    def solved(self, S, columns):
        """Solve S x = c for symmetric positive S, by S = L D L^T."""
        n = len(S)
        S, columns = [list(row) for row in S], [list(c) for c in columns]
        for k in range(n):
            for i in range(k + 1, n):
                if S[i][k] == 0:
                    continue
                factor = self.put(S[i][k] / S[k][k])
                for j in range(k + 1, n):
                    S[i][j] = self.put(S[i][j] - factor * S[k][j])
                for c in columns:
                    c[i] = self.put(c[i] - factor * c[k])
        for c in columns:
            for k in reversed(range(n)):
                later = self.dot(S[k][k + 1 :], c[k + 1 :]) if k + 1 < n else 0
                c[k] = self.put((c[k] - later) / S[k][k])
        return columns


class _Printer(StrPrinter):
    """Python text for long double: products for powers, constants by name."""

    def __init__(self, scope):
        super().__init__()
        self.scope = scope
        self._count = itertools.count()

    def _constant(self, value):
        name = "c_" + str(value).replace("-", "m").replace("/", "_")
        if len(name) > 40:
            name = f"c_{next(self._count)}_"
        high = float(value)
        low = float(value - sp.Rational(high)) if np.isfinite(high) else 0.0
        self.scope[name] = Long(high) + Long(low)
        return name

    def _print_Integer(self, e):  # noqa: N802
        return self._constant(e)

    def _print_Rational(self, e):  # noqa: N802
        return self._constant(e)

    _print_Half = _print_One = _print_NegativeOne = _print_Rational  # noqa: N815
    _print_Zero = _print_Rational  # noqa: N815

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

    _print_ExpBase = _print_Function  # noqa: N815
    _print_exp = _print_Function


def _power(base, exponent):
    """Give a power; a base that a step's last bit took below 0 counts as 0."""
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


def function(inputs, steps, *answers):
    """Compile steps and lists of answers to a function of lists of numbers."""
    names = [name for name, _ in steps]
    flat = [value for _, value in steps] + [e for part in answers for e in part]
    shared, reduced = sp.cse(
        flat, symbols=(sp.Symbol(f"cse_{i}") for i in itertools.count())
    )
    scope = dict(_SCOPE)
    printer = _Printer(scope)
    lines = []
    for i, group in enumerate(inputs):
        if group:
            lines.append(", ".join(map(str, group)) + f", = in_{i}")
    # Shared parts hold no step's name that is not made before: steps come in order.
    made: set[sp.Symbol] = {x for x, _ in shared}
    pending = list(shared)
    for name, value in zip(names, reduced, strict=False):
        lines += _ready(pending, made, value, printer)
        lines.append(f"{name} = {printer.doprint(value)}")
    rest = reduced[len(names) :]
    lines += [f"{x} = {printer.doprint(e)}" for x, e in pending]
    parts, at = [], 0
    for part in answers:
        texts = [printer.doprint(e) for e in rest[at : at + len(part)]]
        parts.append("[" + ", ".join(texts) + "]")
        at += len(part)
    arguments = ", ".join(f"in_{i}" for i in range(len(inputs)))
    body = "".join(f"    {line}\n" for line in [*lines, f"return {', '.join(parts)}"])
    exec(f"def made({arguments}):\n{body}", scope)
    return scope["made"]


def _ready(pending, made, value, printer):
    """Give the lines of the shared parts that a value needs, in their order."""
    needed: set[Any] = set()
    for x, e in reversed(pending):
        if x in value.free_symbols or x in needed:
            needed |= {x, *(e.free_symbols & made)}
    lines = [f"{x} = {printer.doprint(e)}" for x, e in pending if x in needed]
    pending[:] = [(x, e) for x, e in pending if x not in needed]
    return lines
