"""The equations of a model file, derived a second time: by sympy, from the text alone.

Shares nothing with lagsim: its own reading of the YAML, Python's own parser for the
expressions, Lagrange's equations by the chain rule.
"""

from __future__ import annotations

import ast
import itertools
import operator
import re
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import mpmath
import numpy as np
import sympy as sp
import yaml

if TYPE_CHECKING:
    from collections.abc import Mapping

DIGITS = 50

_BINARY = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Pow: operator.pow,
}
_UNARY = {ast.USub: operator.neg, ast.UAdd: operator.pos, ast.Not: sp.Not}
_COMPARE = {ast.Lt: sp.Lt, ast.LtE: sp.Le, ast.Gt: sp.Gt, ast.GtE: sp.Ge}
FUNCTIONS = {
    **{name: getattr(sp, name) for name in ("sin", "cos", "tan", "asin", "acos")},
    **{name: getattr(sp, name) for name in ("atan", "atan2", "sinh", "cosh", "tanh")},
    **{name: getattr(sp, name) for name in ("asinh", "acosh", "atanh", "exp", "log")},
    "log10": lambda x: sp.log(x) / sp.log(10),
    "sqrt": sp.sqrt,
    "cbrt": sp.cbrt,
    "hypot": lambda x, y: sp.sqrt(x**2 + y**2),
    "abs": sp.Abs,
    "sign": sp.sign,
    "min": sp.Min,
    "max": sp.Max,
    "mod": lambda x, y: x - y * sp.floor(x / y),
    "floor": sp.floor,
    "ceil": sp.ceiling,
    "heaviside": lambda x: sp.Heaviside(x, 1),
    "if": lambda condition, a, b: sp.Piecewise((a, condition), (b, True)),
}
_WORD = re.compile(r"(?<![\w.])(?!(?:and|or|not)\b)[^\W\d]\w*")


def symbol(name):
    return sp.Symbol(name, real=True)


def decimal(value):
    """Return a literal as it is written."""
    return sp.Rational(str(value))


def expression(
    text,
    scope,
    functions=FUNCTIONS,
    number=decimal,
):
    """Parse `text`; `scope` maps a name, `number` a literal, to an expression."""
    # `^` binds as Python's `**` does; an underscore keeps names off its keywords.
    python = _WORD.sub(r"\g<0>_", text.replace("^", "**"))

    def build(node):
        match node:
            case ast.Constant(value=value):
                return number(value)
            case ast.Name(id=name):
                return scope(name[:-1])
            case ast.BinOp(left=left, op=op, right=right):
                return _BINARY[type(op)](build(left), build(right))
            case ast.UnaryOp(op=op, operand=operand):
                return _UNARY[type(op)](build(operand))
            case ast.Compare(left=left, ops=[op], comparators=[right]):
                return _COMPARE[type(op)](build(left), build(right))
            case ast.BoolOp(op=op, values=values):
                join = sp.And if isinstance(op, ast.And) else sp.Or
                return join(*map(build, values))
            case ast.Call(func=ast.Name(id=name), args=args):
                return functions[name[:-1]](*map(build, args))
        raise NotImplementedError(ast.dump(node))

    return build(ast.parse(f"({python})", mode="eval").body)


@dataclass(frozen=True)
class Numbers:
    """The equations at one state. M : (n, n), f : (n,), A : (m, n), b : (m,)."""

    M: Any
    f: Any
    A: Any
    b: Any
    energy: float
    kinetic: float
    power_without_constraints: float
    residuals: Any
    rates: Any


def reads(path):
    """Return whether a file has numbers alone: no families, vectors, bodies, tables.

    Frames are permitted for drawn shapes.
    """
    text = path.read_text(encoding="utf-8")
    return not re.search(
        r"^(bodies|tables):|\.\. ?\w|\bcomponents:|relation: \[",
        text,
        re.MULTILINE,
    )


class Oracle:
    """A model's equations.

    M : Matrix (n, n), f : list (n,), A : Matrix (m, n), b : list (m,)
    """

    functions: Mapping[str, Any] = FUNCTIONS
    number = staticmethod(decimal)
    pi: sp.Expr = sp.pi

    def __init__(self, text):
        # BaseLoader keeps all scalars text: `y` and `on` are names.
        document = yaml.load(text, Loader=yaml.BaseLoader)  # noqa: S506
        self.parameter_texts = _texts(document.get("parameters"))
        self.parameter_texts |= _texts(document.get("modes"))
        self.definition_texts = _texts(document.get("definitions"))
        self.state_texts = _texts(document.get("states"), "rate")
        self.s = [symbol(name) for name in self.state_texts]
        self.q = [symbol(name) for name in document["coordinates"]]
        self.v = [symbol(f"{q.name}_dot") for q in self.q]
        self.a = [symbol(f"{q.name}_ddot") for q in self.q]
        self.t = symbol("t")
        self._names: dict[str, sp.Expr] = {"pi": self.pi, "t": self.t}
        self._names |= {s.name: s for s in (*self.q, *self.v, *self.s)}
        self._names |= {name: symbol(name) for name in self.parameter_texts}
        self._lagrangian(document["energy"])
        self._constraints(_texts(document.get("constraints"), "relation"))
        self.Q = [sp.Integer(0)] * len(self.q)
        self._forces(document.get("forces") or {})
        self._dissipation(document["energy"].get("dissipation", "0"))
        self._equations()

    @classmethod
    def of(cls, path):
        return cls(path.read_text(encoding="utf-8"))

    def name(self, name):
        """Return the expression of `name`; definitions are written out."""
        if name not in self._names:
            if name in self.definition_texts:
                value = self.read(self.definition_texts[name])
            elif name.removesuffix("_dot") in self.state_texts:
                value = self.read(self.state_texts[name.removesuffix("_dot")])
            else:
                value = self.rate(self.name(name.removesuffix("_dot")))
            self._names[name] = value
        return self._names[name]

    def read(self, text):
        return expression(text, self.name, self.functions, self.number)

    def rate(self, e):
        """Return d/dt by the chain rule."""
        inertial = (sp.diff(e, v) * a for v, a in zip(self.v, self.a, strict=True))
        return sp.Add(self.drift(e), *inertial)

    def drift(self, e):
        """Return d/dt for vanishing accelerations."""
        moved = (sp.diff(e, q) * v for q, v in zip(self.q, self.v, strict=True))
        return sp.Add(self.in_time(e), *moved)

    def in_time(self, e):
        """Return the part of d/dt by the time and the states."""
        states = (sp.diff(e, s) * self.name(f"{s.name}_dot") for s in self.s)
        return sp.Add(sp.diff(e, self.t), *states)

    def _lagrangian(self, energy):
        if "lagrangian" in energy:
            self.L = self.read(energy["lagrangian"])
            self.kinetic = sp.nan
        else:
            self.kinetic = self.read(energy["kinetic"])
            self.L = self.kinetic - self.read(energy["potential"])
        momenta = [sp.diff(self.L, v) for v in self.v]
        moved = zip(self.v, momenta, strict=True)
        self.energy = sp.Add(*(v * p for v, p in moved)) - self.L

    def _constraints(self, texts):
        self.constraints = []
        both = ([x] if isinstance(x, str) else x for x in texts.values())
        for text in itertools.chain.from_iterable(both):
            left, _, right = text.partition("=")
            node = self.read(left.rstrip("<> ")) - self.read(right or "0")
            self.constraints.append(-node if left.endswith("<") else node)

    def _forces(self, forces):
        for on, text in forces.items():
            force, direction = self.read(text), self.name(on)
            moves = direction.free_symbols & set(self.v)
            for j, x in enumerate(self.v if moves else self.q):
                self.Q[j] += force * sp.diff(direction, x)

    def _dissipation(self, text):
        loss = self.read(text)
        for j, v in enumerate(self.v):
            self.Q[j] -= sp.diff(loss, v)

    def _equations(self):
        momenta = [sp.diff(self.L, v) for v in self.v]
        self.M = [[sp.diff(p, v) for v in self.v] for p in momenta]
        self.f = [
            sp.diff(self.L, q) + Q - self.drift(p)
            for q, Q, p in zip(self.q, self.Q, momenta, strict=True)
        ]
        self.A, self.b, self.rates = [], [], []
        for g in self.constraints:
            holonomic = not g.free_symbols & set(self.v)
            phi = self.rate(g) if holonomic else g
            self.rates.append(phi)
            self.A.append([sp.diff(phi, v) for v in self.v])
            self.b.append(-self.drift(phi))
        self.power_without_constraints = sp.Add(
            *(Q * v for Q, v in zip(self.Q, self.v, strict=True)),
            -self.in_time(self.L),
        )

    @property
    def inputs(self):
        parameters = [symbol(name) for name in self.parameter_texts]
        return [self.t, *self.q, *self.v, *self.s, *parameters]

    @cached_property
    def _compiled(self):
        everything = [
            *sp.flatten(self.M), *self.f, *sp.flatten(self.A), *self.b, self.energy,
            self.kinetic, self.power_without_constraints, *self.constraints,
            *self.rates,
        ]  # fmt: skip
        return sp.lambdify(self.inputs, everything, modules="mpmath", cse=True)

    def at(self, values):
        """Evaluate with DIGITS digits; return doubles."""
        return self._numbers(np.array([float(x) for x in self.digits(values)]))

    def exactly(self, values):
        """Evaluate with DIGITS digits, and store the values."""
        return self._numbers(np.array(self.digits(values), dtype=object))

    def digits(self, values):
        with mpmath.workdps(DIGITS):
            arguments = [mpmath.mpf(values[s.name]) for s in self.inputs]
            return [mpmath.mpf(x) for x in self._compiled(*arguments)]

    def _numbers(self, flat):
        n, m = len(self.q), len(self.constraints)
        sizes = [n * n, n, m * n, m, 1, 1, 1, m, m]
        M, f, A, b, energy, kinetic, power, residuals, rates = np.split(
            flat, np.cumsum(sizes)[:-1]
        )
        return Numbers(
            M.reshape(n, n), f, A.reshape(m, n), b, energy[0], kinetic[0], power[0],
            residuals, rates,
        )  # fmt: skip

    def nominal(self):
        """Return the parameters' values, each from the earlier ones."""
        known: dict[str, sp.Expr] = {"pi": sp.pi}
        for name, text in self.parameter_texts.items():
            known[name] = sp.N(expression(text, known.__getitem__), DIGITS)
        return {name: float(known[name]) for name in self.parameter_texts}


def _texts(section, key="value"):
    """Return name -> text of a section; entries are texts or mappings with `key`."""
    return {
        name: entry if isinstance(entry, str) else entry[key]
        for name, entry in (section or {}).items()
    }


def random_values(oracle, start, seed):
    """Return a state near `start`, and parameters near their own values."""
    random = np.random.default_rng(seed)

    def near(x, part):
        return x + part * random.uniform(-1, 1) * (abs(x) or 1.0)

    values = {name: near(x, 0.2) for name, x in oracle.nominal().items()}
    values |= {x.name: near(start[x.name], 0.3) for x in (*oracle.q, *oracle.s)}
    # Slow ones for what does not depend on the velocities, fast ones for what does.
    speed = 10.0 ** (seed % 3)
    values |= {v.name: speed * float(random.normal()) for v in oracle.v}
    return values | {"t": float(random.uniform(0.1, 3.0))}
