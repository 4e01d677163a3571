"""Translation of a model to sympy: symbols, named definitions, expressions.

Each row of the functions table has a sympy function, so no text is parsed again.

A definition of positions keeps its name if that is easier to read: if it is a length
(a root) or another function's value, if it is a sum inside a function (the angle in
`sin(p)`), or if it contains only parameters. Other definitions are written out. A named
definition still depends on the coordinates: derivatives follow the chain rule.

Expressions that are too long for sympy are refused, by their size and finally by time:
sympy writes everything out and keeps numbers exactly, so (x/2)^(10^10) would be
2^(10^10), with three thousand million digits.
"""

from __future__ import annotations

import functools
import math
import re
from fractions import Fraction
from functools import partial, reduce
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import sympy as sp

from lagsim import limits
from lagsim.language.elements import payload
from lagsim.language.functions import FUNCTIONS, OPERATIONS, PART
from lagsim.language.graph import CONSTANT, TRUTH, VARIABLE
from lagsim.language.names import rate_of
from lagsim.language.tables import arguments, written
from lagsim.model.model import APPROACH_SPEED, Level
from lagsim.show.names import PrintedName, indexed
from lagsim.show.tidy import Tidier, not_finite, too_long

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable, Mapping

    from lagsim.language.functions import Function
    from lagsim.language.graph import Graph
    from lagsim.mechanics.equations import Equations
    from lagsim.model.model import Model, Parameter


# Constants with a denominator up to this (1/2, 3/4: often made by differentiation and
# folding) are shown as fractions, others as decimals.
LARGEST_DENOMINATOR = 16


def symbol(name: str) -> Any:
    """Return the real sympy symbol of a name, which is not parsed for subscripts."""
    return sp.Symbol(name, real=True)


class Spelled(sp.Function):  # type: ignore[misc]
    """A real function; `spelled` is its name in the model language."""

    spelled: ClassVar[str]

    def _eval_is_extended_real(self) -> bool:
        return True


def _power(base: Any, exponent: Any) -> Any:
    _refuse_digits(base, exponent)
    return base**exponent


def _exp(x: Any) -> Any:
    for term in sp.Add.make_args(x):  # sympy writes exp(n log x) as x^n
        factor, rest = term.as_coeff_Mul()
        if rest.has(sp.log):
            _refuse_digits(rest, factor)
    return sp.exp(x)


def _refuse_digits(base: Any, exponent: Any) -> None:
    """Raise an InputError for a power whose numbers would have too many digits."""
    numbers = base.atoms(sp.Rational) if exponent.is_Rational else ()
    over = math.lcm(*(int(x.q) for x in numbers))
    digits = math.log10(over) + math.log10(max(1, *(abs(int(x.p)) for x in numbers), 1))
    digits *= abs(float(exponent)) if digits else 0.0
    if digits > limits.EXACT_DIGITS:
        about = f"about {digits:.2g} digits" if digits < 1e12 else "no end of digits"
        raise too_long(
            "the energies, written out, have numbers to the power of numbers with "
            f"{about}, and the limit is {limits.EXACT_DIGITS}"
        )


@functools.cache
def _table(name: str, orders: tuple[int, ...]) -> type[Spelled]:
    """Return the sympy function of a table or of a derivative of it: f', or ∂₁f.

    name : the name of the table.
    orders : the orders of the derivative, by each argument.
    """
    signs = (f"∂{'₁₂'[k]}" * order for k, order in enumerate(orders))
    spelled = name + "'" * orders[0] if len(orders) == 1 else "".join(signs) + name
    known = {"spelled": spelled, "orders": orders, "table": name}
    return type(f"Table{spelled}", (Spelled,), known)


def _twin(row: Function) -> Callable[..., Any]:
    if row.sympy is not None:
        return partial(row.sympy, sp)
    name = row.name.capitalize()
    if row.step:
        name += "Step"
    else:
        name = f"{name}Branch" if row.branches else f"Real{name}"
    # sympy has none of these names; its simplifiers and its order depend on names.
    return type(name, (Spelled,), {"spelled": row.name})


TWINS = {name: _twin(row) for name, row in OPERATIONS.items()}
TWINS |= {"pow": _power, "exp": _exp}


def to_sympy(
    g: Graph,
    nodes: Iterable[int],
    *,
    known: dict[int, Any] | None = None,
) -> list[Any]:
    """Return `nodes` as sympy expressions.

    sympy simplifies as it builds, so that an expression without a finite value may
    become its `zoo` or `nan`.

    Parameters
    ----------
    g, nodes
        Nodes of the graph `g`.
    known
        Expressions of some nodes, whose arguments are not visited; expressions of
        further nodes are added.

    Raises
    ------
    TypeError, ValueError
        If a condition compares expressions that are not real.
    InputError
        If numbers would have too many digits.
    """
    nodes, found = list(nodes), {} if known is None else known
    for n in _above(g, nodes, found):
        op = g.ops[n]
        if op == VARIABLE:
            found[n] = symbol(str(g.payload(n)))
        elif op == TRUTH:
            found[n] = sp.true if g.payload(n) else sp.false
        elif op == CONSTANT:
            found[n] = number(float(g.payload(n)))
        elif op in _CHAINS:  # sympy would sort the arguments each time
            signed = _operands(g, n, found)
            args = [-found[a] if negative else found[a] for a, negative in signed]
            found[n] = (sp.Mul if op == "mul" else sp.Add)(*args)
        elif OPERATIONS[op].data:
            called = written(g, n)
            table = _table(called.name, called.orders)
            found[n] = table(*(found[a] for a in called.args))
        else:
            found[n] = TWINS[op](*(found[a] for a in g.args[n]))
    return [found[n] for n in nodes]


def _above(g: Graph, nodes: Iterable[int], known: Collection[int]) -> list[int]:
    """Return the nodes that must be translated for `nodes`, arguments before results.

    known : nodes whose expressions are known, below which none is visited.
    """
    seen = set(nodes).difference(known)
    stack = list(seen)
    while stack:
        for a, _ in _operands(g, stack.pop(), known):
            if a not in seen and a not in known:
                seen.add(a)
                stack.append(a)
    return sorted(seen)


def _operands(g: Graph, n: int, known: Collection[int]) -> list[tuple[int, bool]]:
    """Return the operands of a node: pairs (operand, whether it is subtracted).

    Nested sums, and nested products, are flattened to one.

    known : nodes that are not flattened, since their expressions are known.
    """
    chain = _CHAINS.get(g.ops[n])
    if chain is None:
        return [(a, False) for a in arguments(g, n)]
    found, stack = [], [(n, False)]
    while stack:
        a, negative = stack.pop()
        if a == n or (g.ops[a] in chain and a not in known):
            first, second = g.args[a]
            stack += [(first, negative), (second, negative ^ (g.ops[a] == "sub"))]
        else:
            found.append((a, negative))
    return found


_CHAINS = {"mul": ("mul",), "add": ("add", "sub"), "sub": ("add", "sub")}


# Multiples of pi up to this many, in parts up to this small, are shown as such.
_PARTS_OF_PI = 12

_ROOTS = frozenset(FUNCTIONS) - {"if", "abs", "sign", "min", "max", "floor", "ceil"}


class Translation:
    """A model's expressions in sympy.

    Parameters
    ----------
    equations
        The model and its graph.
    substitute
        Whether the values of parameters are inserted.
    named
        Names of nodes, instead of names of definitions that are selected here.

    Attributes
    ----------
    q, v, a, states, multipliers : list of Symbol
    t : Symbol
    substitute : bool
        Whether parameters are numbers.
    known : dict
        Node of the graph -> expression: names of definitions, numbers.
    definitions : dict
        Definitions that keep their names, symbol -> expression, ordered so that each
        depends on earlier ones only.
    names : dict
        Symbol -> its name as displayed.
    rank : dict
        Symbol -> its position in products and sums; see `printers.Printer`.
    sums : dict
        Symbol -> node of a sum of elements, for which it stands, see `members`.
    tidy : Tidier
    """

    def __init__(
        self,
        equations: Equations,
        *,
        substitute: bool = False,
        named: Mapping[int, PrintedName] | None = None,
    ) -> None:
        model, g = equations.model, equations.graph
        self.equations, self.g = equations, g
        self.substitute = substitute
        self.t = symbol("t")
        self.q = [symbol(c.name) for c in model.coordinates]
        self.v = [symbol(rate_of(q)) for q in equations.q]
        self.a = [symbol(rate_of(q, 2)) for q in equations.q]
        self.states = [symbol(x.name) for x in model.states]
        self.multipliers = [symbol(f"lambda_{c.name}") for c in model.constraints]
        physics = physics_of(model)
        parameters = [symbol(p.name) for p in model.parameters]
        speeds = {APPROACH_SPEED} & g.depends(physics)
        self.speeds = [symbol(name) for name in speeds]  # speeds of an impact
        self._parameters = frozenset(parameters)
        self.known = {
            g.variable(p.name): number(p.value)
            for p in model.parameters
            if substitute and p.name not in model.modes
        }
        named_nodes = self._well_read(physics) if named is None else named
        self.sums: dict[Any, int] = {}
        self.definitions = {}
        for n, name in sorted(named_nodes.items()):
            s = symbol(rate_of(name.base, name.order))
            self.definitions[s] = self._value(n)
            self.known[n] = s
        self._nodes = {x: n for n, x in self.known.items() if x.is_Symbol}
        self.names, self.rank = self._shown(parameters, named_nodes)
        rates = (self.known[n] for n, name in named_nodes.items() if name.order)
        moving = {*self.v, *self.a, *self.multipliers, *rates}
        moving_names = {*self.q, *moving, *self.states, self.t}
        constants = {*parameters}
        for s, e in self.definitions.items():  # each depends on earlier ones only
            if e.free_symbols & moving_names:
                moving_names.add(s)
            else:
                constants.add(s)
        self.tidy = Tidier(frozenset(constants), frozenset(moving))
        self._extents = dict.fromkeys(named or (), Extent(1, 1))
        self._operations = 0

    def _well_read(self, physics: list[int]) -> dict[int, PrintedName]:
        """Return the definitions that keep their names, as node -> name.

        These are easier to read by name, see the docstring of the module.

        physics : nodes of energies, forces and constraints.
        """
        g = self.g
        used = set(g.cone(physics))
        arguments = {
            a
            for n in used
            if g.ops[n] in _ROOTS and g.ops[n] != "hypot"
            for a in g.args[n]
        }
        variables = {*self.equations.moving}
        found: dict[int, PrintedName] = {}
        for d in self.equations.model.definitions:
            n = d.node
            if d.level is not Level.POSITION or n not in used or n in found:
                continue
            if g.ops[n] in (CONSTANT, VARIABLE):
                continue
            constant = not g.depends([n]) & variables
            sum_inside = n in arguments and g.ops[n] in ("add", "sub")
            named = constant and not self.substitute
            if named or g.ops[n] in _ROOTS or sum_inside:
                found[n] = PrintedName(d.name)
        return found

    def name_sums(self) -> None:
        """Let a symbol stand for each sum of elements in the graph."""
        for n in self.g.of((PART,)):
            if n not in self.known:
                self.known[n] = symbol(f"sum.{n}")
                self.sums[self.known[n]] = n

    def _value(self, node: int) -> Any:
        self.name_sums()
        try:
            return to_sympy(self.g, [node], known=self.known)[0]
        except TypeError as fault:  # sympy compares numbers that are not real
            raise not_finite() from fault

    def free(self, e: Any) -> set[Any]:
        """Return the symbols in `e`, including symbols of its named definitions."""
        found = set(e.free_symbols)
        for s, e in reversed(self.definitions.items()):
            if s in found:
                found |= e.free_symbols
        for s in found & self.sums.keys():
            found |= {symbol(x) for x in self.g.depends([self.sums[s]])}
        return found

    # Symbols

    def _shown(
        self, parameters: list[Any], named_nodes: Mapping[int, PrintedName]
    ) -> tuple[dict[Any, PrintedName], dict[Any, tuple[int, int]]]:
        model = self.equations.model
        named = {self.known[n]: name for n, name in sorted(named_nodes.items())}
        values = {s: name for s, name in named.items() if not name.order}
        names = {s: PrintedName(s.name) for s in parameters} | named
        names |= {s: PrintedName(s.name) for s in (*self.states, *self.speeds, self.t)}
        for order, group in enumerate((self.q, self.v, self.a)):
            shown = (PrintedName(q.name, order) for q in self.q)
            names |= dict(zip(group, shown, strict=True))
        shown = (PrintedName(c.name, 0, "multiplier") for c in model.constraints)
        names |= dict(zip(self.multipliers, shown, strict=True))
        groups = [
            _as_people_order(model.parameters), values,
            [self.t, *self.q, *self.states, *self.speeds],
            [*self.v, *(s for s in named if s not in values)], self.a,
            self.multipliers,
        ]  # fmt: skip
        rank = {
            s: (k, i) for k, group in enumerate(groups) for i, s in enumerate(group)
        }
        return names, rank

    def add(self, s: Any, name: PrintedName, rank: tuple[int, int]) -> Any:
        """Store the displayed name and the rank of a symbol s, and return s."""
        self.names[s], self.rank[s] = name, rank
        return s

    @property
    def own_names(self) -> list[str]:
        """Displayed names of symbols, each once, time and coordinates first."""
        found = [self.t.name, *(q.name for q in self.q)]
        own = (n.base for n in self.names.values() if not n.kind)
        found += [base for base in own if indexed(base) == base]
        return list(dict.fromkeys(found))

    # Expressions

    def sympy(self, nodes: Iterable[int | None], *, written: bool = False) -> list[Any]:
        """Return simplified sympy expressions of nodes; None in the place of None.

        written : whether the expressions are written so in the file, see `tidy.Tidier`.

        Raises
        ------
        InputError
            If the expressions requested so far, written out, exceed the limit.
        """
        nodes = list(nodes)
        self._operations = self.operations(n for n in nodes if n is not None)
        return [
            None if n is None else self.tidy(self._value(n), written=written)
            for n in nodes
        ]

    def operations(self, nodes: Iterable[int]) -> int:
        """Return the count of operations of nodes and of expressions requested so far.

        Raises
        ------
        InputError
            If this number exceeds the limit.
        """
        extents = written_out(self.g, nodes, self._extents)
        found = self._operations + together(extents).operations
        if found > limits.DERIVED_OPERATIONS:
            most = f"{limits.DERIVED_OPERATIONS:,} operations, which is the limit"
            raise too_long(f"the equations, written out, have more than {most}")
        return found

    def node(self, e: Any, original: int) -> int:
        """Return a node for the expression `e`, which equals the node `original`.

        It is `original` itself if doubles cannot represent the numbers in `e`.
        """
        try:
            node = _built(self.g, e, self._nodes)
        except _NotExactError:
            return original
        self.known[node] = e
        return node


class _NotExactError(Exception):
    """Signal that doubles cannot represent a number in an expression."""


def _built(g: Graph, e: Any, found: dict[Any, int]) -> int:
    """Return the node of the graph for a sympy expression, which is added if new.

    found : nodes of known expressions; updated.

    Raises
    ------
    _NotExactError
        If doubles cannot represent a number in the expression.
    """
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
    """Return the symbols of parameters: masses first, then gravity, as in m g l."""

    def place(p: Parameter) -> int:
        if p.unit.startswith("kg") or (not p.unit and _MASS.match(p.name)):
            return 0
        return 1 if p.name == "g" else 2

    return [symbol(p.name) for p in sorted(parameters, key=place)]


def number(x: float) -> Any:
    """Return a constant as a sympy number: 9.81 is 981/100, 1.5707... is pi/2."""
    if not math.isfinite(x):
        return sp.Float(x)
    if x == 0 or abs(x) > 1e15:
        return sp.Rational(Fraction(x))
    part = Fraction(x / math.pi).limit_denominator(_PARTS_OF_PI)
    multiple = part != 0 and abs(part.numerator) <= _PARTS_OF_PI
    if multiple and part.numerator * math.pi / part.denominator == x:
        return sp.Rational(part) * sp.pi
    part = Fraction(x).limit_denominator(LARGEST_DENOMINATOR)
    if part.numerator / part.denominator == x:
        return sp.Rational(part)
    return _LOGARITHMS.get(x) or sp.Rational(repr(x))


_WHOLE = range(2, 17)
_LOGARITHMS = {math.log(k): sp.log(k) for k in _WHOLE}
_LOGARITHMS |= {1 / math.log(k): 1 / sp.log(k) for k in _WHOLE}


def physics_of(model: Model) -> list[int]:
    """Return the nodes of energies, forces, relations, rates and laws of a model."""
    nodes = [model.kinetic, model.potential, model.lagrangian, model.dissipation]
    nodes += [x for f in model.forces for x in (f.node, f.direction)]
    nodes += [c.relation.node for c in model.constraints]
    nodes += [s.rate for s in model.states]
    nodes += [node for event in model.events for _, node in event.sets]
    kicks = (one for event in model.events for one in event.impulses)
    nodes += [node for one in kicks for node in (one.node, one.direction)]
    for c in model.constraints:
        nodes += [c.limit, c.static, c.when]
        if c.law is not None:
            nodes += [c.law.friction, c.law.static, c.law.bounce, *c.law.slips]
    return [n for n in nodes if n is not None]


class Extent(NamedTuple):
    """Size of an expression when written out, without shared subexpressions.

    Attributes
    ----------
    operations : int
        Number of operations.
    depth : int
        Depth of nesting; a sum within a sum, or a product within a product, adds none.
    terms : int
        Number of terms of the sum, or factors of the product, at the top.
    most : int
        Largest number of terms or factors of any sum or product in the expression.
    """

    operations: int
    depth: int
    terms: int = 1
    most: int = 1

    @property
    def refused(self) -> bool:
        """Whether the expression exceeds a limit for written-out expressions."""
        return (
            self.operations > limits.WRITTEN_OPERATIONS
            or self.depth > limits.WRITTEN_DEPTH
            or self.most > limits.WRITTEN_TERMS
        )


def together(extents: Iterable[Extent]) -> Extent:
    """Return the extent of several expressions as a whole."""
    found = Extent(0, 0)
    for e in extents:
        operations = found.operations + e.operations
        depth, most = max(found.depth, e.depth), max(found.most, e.most)
        found = Extent(operations, depth, 1, most)
    return found


def written_out(
    g: Graph, nodes: Iterable[int], found: dict[int, Extent]
) -> list[Extent]:
    """Return the extent of each node.

    found : extents of nodes known before; updated with all nodes below `nodes`.
    """
    nodes = list(nodes)
    for n in g.cone(nodes, ends=found):
        if n not in found:
            found[n] = extent_of(g, n, found)
    return [found[n] for n in nodes]


def extent_of(g: Graph, n: int, found: Mapping[int, Extent]) -> Extent:
    """Return the extent of a node from the extents of its arguments."""
    if g.ops[n] == PART:  # is shown once
        return Extent(len(payload(g, g.args[n][0]).cone), 2)
    chained = _CHAINS.get(g.ops[n], ())
    below = [(found[a], g.ops[a] in chained) for a in g.args[n]]
    depth = max((e.depth - same for e, same in below), default=0)
    terms = sum(e.terms if same else 1 for e, same in below) if chained else 1
    most = max((terms, *(e.most for e, _ in below)))
    return Extent(1 + sum(e.operations for e, _ in below), 1 + depth, terms, most)
