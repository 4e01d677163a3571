"""A model in sympy: its symbols, the definitions that keep their names, derivatives.

A definition of positions keeps its name where that reads better: where it is a length
(a root) or another function's value, where it is a sum inside a function (the angle in
`sin(p)`), or where it is made of parameters only. Others are written out. What keeps
its name still depends on the coordinates: derivatives follow the chain rule.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from fractions import Fraction
from functools import partial, reduce
from typing import TYPE_CHECKING, Any

import sympy as sp

from lagsim.derivation.endless import refuse_endless
from lagsim.derivation.functions import TWINS
from lagsim.derivation.names import Name
from lagsim.derivation.tidy import Roles, Tidier
from lagsim.language.functions import FUNCTIONS, OPERATIONS
from lagsim.language.graph import CONSTANT, VARIABLE
from lagsim.language.symbolic import symbol, to_sympy
from lagsim.model.model import Level

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from lagsim.language.graph import Graph
    from lagsim.mechanics.equations import Equations
    from lagsim.model.model import Parameter

# Multiples of pi up to this many, in parts up to this small, are shown as such.
_PARTS_OF_PI = 12

_ROOTS = frozenset(FUNCTIONS) - {"if", "abs", "sign", "min", "max", "floor", "ceil"}


@dataclass(frozen=True)
class Kept:
    """A definition that keeps its name."""

    name: str
    symbol: Any
    value: Any


class Translation:
    """A model's expressions in sympy.

    Parameters
    ----------
    equations
        The model and its graph.
    substitute
        Put the numbers of the parameters in.

    Attributes
    ----------
    q, v, a, multipliers : list of Symbol
    t : Symbol
    substitute : bool
        The parameters are numbers.
    known : dict
        What stands for nodes of the graph: names of definitions, numbers.
    kept : list of Kept
        In an order in which each needs earlier ones only.
    names : dict
        What each symbol shows.
    rank : dict
        Where each stands in products and sums; see `Writer`.
    tidy : Tidier
    """

    def __init__(self, equations: Equations, *, substitute: bool = False) -> None:
        model, g = equations.model, equations.graph
        self.equations, self.g = equations, g
        self.substitute = substitute
        self.t = symbol("t")
        self.q = [symbol(c.name) for c in model.coordinates]
        self.v = [symbol(f"{q}_dot") for q in equations.q]
        self.a = [symbol(f"{q}_ddot") for q in equations.q]
        self.multipliers = [symbol(f"lambda_{c.name}") for c in model.constraints]
        physics = self._physics()
        values = {g.variable(p.name): p.value for p in model.parameters if substitute}
        refuse_endless(g, physics, values)
        parameters = [symbol(p.name) for p in model.parameters]
        self._parameters = frozenset(parameters)
        self.known = {n: number(x) for n, x in values.items()}
        self.kept = self._keep(physics, substitute=substitute)
        self._nodes = {x: n for n, x in self.known.items() if x.is_Symbol}
        self.names, self.rank = self._shown(parameters)
        moving = {*self.v, *self.a, *self.multipliers}
        moving_names = {*self.q, *moving, self.t}
        still = [k.symbol for k in self.kept if not self.free(k.value) & moving_names]
        constants = frozenset((*parameters, *still))
        self.tidy = Tidier(Roles(constants, frozenset(moving)))

    def _physics(self) -> list[int]:
        """Give the nodes of what the derivation begins with."""
        model = self.equations.model
        nodes = [model.kinetic, model.potential, model.lagrangian, model.dissipation]
        nodes += [x for f in model.forces for x in (f.node, f.direction)]
        nodes += [c.relation.node for c in model.constraints]
        for c in model.constraints:
            nodes += [c.limit, c.when]
            if c.law is not None:
                nodes += [c.law.friction, c.law.static, *c.law.slips]
        return [n for n in nodes if n is not None]

    # Definitions

    def _keep(self, physics: list[int], *, substitute: bool) -> list[Kept]:
        g = self.g
        used = set(g.cone(physics))
        arguments = {
            a
            for n in used
            if g.ops[n] in _ROOTS and g.ops[n] != "hypot"
            for a in g.args[n]
        }
        variables = {*self.equations.q, "t"}
        wanted = {}
        for d in self.equations.model.definitions:
            n = d.node
            if d.level is not Level.POSITION or n not in used or n in wanted:
                continue
            if g.ops[n] in (CONSTANT, VARIABLE):
                continue
            constant = not g.depends([n]) & variables
            sum_inside = n in arguments and g.ops[n] in ("add", "sub")
            if (constant and not substitute) or g.ops[n] in _ROOTS or sum_inside:
                wanted[n] = d.name
        kept = []
        for n, name in sorted(wanted.items()):
            kept.append(Kept(name, symbol(name), self._value(n)))
            self.known[n] = symbol(name)
        return kept

    def _value(self, node: int) -> Any:
        twins: dict[str, Callable[..., Any]] = {**TWINS, "if": self._choice}
        return to_sympy(self.g, [node], known=self.known, twins=twins, number=number)[0]

    def _choice(self, asked: Any, then: Any, other: Any) -> Any:
        """Give a choice; that of the slope of x^y, 0 where x^y = 0, is for moving x."""
        if then == 0 and isinstance(asked, sp.Le):
            power = asked.lhs.args[0] if isinstance(asked.lhs, TWINS["abs"]) else then
            if power.is_Pow and power.base.free_symbols <= self._parameters:
                return other
        return OPERATIONS["if"].sympy(sp, asked, then, other)

    def free(self, e: Any) -> set[Any]:
        """Give the symbols in `e`, those behind names of definitions too."""
        found = set(e.free_symbols)
        for k in reversed(self.kept):
            if k.symbol in found:
                found |= k.value.free_symbols
        return found

    def in_full(self, e: Any) -> Any:
        """Give `e` with all definitions written out."""
        for k in reversed(self.kept):
            e = e.xreplace({k.symbol: k.value})
        return e

    # Symbols

    def _shown(
        self, parameters: list[Any]
    ) -> tuple[dict[Any, Name], dict[Any, tuple[int, int]]]:
        plain = [p.name for p in self.equations.model.parameters]
        names = {s: Name(n) for s, n in zip(parameters, plain, strict=True)}
        names |= {k.symbol: Name(k.name) for k in self.kept}
        names[self.t] = Name("t")
        for order, group in enumerate((self.q, self.v, self.a)):
            names |= {
                s: Name(q.name, order) for s, q in zip(group, self.q, strict=True)
            }
        constraints = self.equations.model.constraints
        names |= {
            s: Name(c.name, 0, "multiplier")
            for s, c in zip(self.multipliers, constraints, strict=True)
        }
        kept = [k.symbol for k in self.kept]
        parameters = _as_people_order(self.equations.model.parameters)
        positions = [self.t, *self.q]
        groups = [parameters, kept, positions, self.v, self.a, self.multipliers]
        rank = {
            s: (k, i) for k, group in enumerate(groups) for i, s in enumerate(group)
        }
        return names, rank

    @property
    def own_names(self) -> list[str]:
        """The names that symbols show, once each, the time and coordinates first."""
        found = [self.t.name, *(q.name for q in self.q)]
        found += [n.base for n in self.names.values() if not n.kind]
        return list(dict.fromkeys(found))

    # Expressions

    def sympy(self, nodes: Iterable[int | None], *, written: bool = False) -> list[Any]:
        """Give nodes as tidy sympy expressions; None stays None."""
        return [
            None if n is None else self.tidy(self._value(n), written=written)
            for n in nodes
        ]

    def node(self, e: Any, original: int) -> int:
        """Give a node for `e`, the tidy form of `original`.

        That is `original` itself where the graph would hold other numbers than `e`.
        """
        try:
            node = _built(self.g, e, self._nodes)
        except _NotExactError:
            return original
        self.known[node] = e
        return node


class _NotExactError(Exception):
    """An expression that the graph would hold with other numbers."""


def _built(g: Graph, e: Any, found: dict[Any, int]) -> int:
    """Give the node of an expression; `found` has those of some symbols."""
    if e in found:
        return found[e]
    if e.is_Symbol:
        node = g.variable(e.name)
    elif e.is_number and not e.args:
        try:
            value = float(e)
        except OverflowError:
            raise _NotExactError from None
        if number(value) != e:
            raise _NotExactError
        node = g.constant(value)
    else:
        args = [_built(g, a, found) for a in e.args]
        if e.is_Add:
            node = g.sum(args)
        elif e.is_Mul:
            node = reduce(partial(g.call, "mul"), args)
        else:
            name = "pow" if e.is_Pow else getattr(e, "spelled", type(e).__name__)
            if name not in OPERATIONS:
                raise _NotExactError
            node = g.call(name, *args)
    found[e] = node
    return node


_MASS = re.compile(r"[mM][0-9]*\Z")


def _as_people_order(parameters: Iterable[Parameter]) -> list[Any]:
    """Give the symbols of parameters: masses first, then gravity, as in m g l."""

    def place(p: Parameter) -> int:
        if p.unit.startswith("kg") or (not p.unit and _MASS.match(p.name)):
            return 0
        return 1 if p.name == "g" else 2

    return [symbol(p.name) for p in sorted(parameters, key=place)]


def number(x: float) -> Any:
    """Give a constant as a person writes it: 9.81 is 981/100, and pi/2 is seen."""
    if not math.isfinite(x):
        return sp.Float(x)
    if x == 0 or abs(x) > 1e15:
        return sp.Rational(Fraction(x))
    part = Fraction(x / math.pi).limit_denominator(_PARTS_OF_PI)
    multiple = part != 0 and abs(part.numerator) <= _PARTS_OF_PI
    if multiple and part.numerator * math.pi / part.denominator == x:
        return sp.Rational(part) * sp.pi
    part = Fraction(x).limit_denominator(LARGEST_PART)
    if part.numerator / part.denominator == x:
        return sp.Rational(part)
    return _LOGARITHMS.get(x) or sp.Rational(repr(x))


_WHOLE = range(2, 17)
_LOGARITHMS = {math.log(k): sp.log(k) for k in _WHOLE}
_LOGARITHMS |= {1 / math.log(k): 1 / sp.log(k) for k in _WHOLE}
LARGEST_PART = 16
