"""Angles in degrees where radians are expected: by their units, or by their values."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from lagsim.language.graph import CONSTANT, VARIABLE, Graph
from lagsim.language.parser import parse
from lagsim.language.tokens import ExpressionError
from lagsim.model.model import Target
from lagsim.notes import Caution

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from lagsim.model.model import Definition, Model

DEGREES = ("deg", "degree", "degrees", "°")
RADIANS = ("", "1", "rad", "radian", "radians")
_OF_ANGLES = ("sin", "cos", "tan")
# Values of angles that are written in degrees: multiples of these, from the least to a
# turn. Angles in radians as large as that are those of what has turned several times,
# and seldom whole numbers of these.
_WHOLE = (5.0, 12.0, 22.5)
_LEAST, _TURN = 10.0, 360.0


class _Term(NamedTuple):
    """A term of a sum that seems to be in degrees; `value` is None where its unit is.

    `sure`: its unit is that of an angle.
    """

    name: str
    said: str
    value: float | None
    sure: bool = False

    def text(self, op: str) -> str:
        """Say what is wrong with it in a function."""
        if self.value is None:
            return (
                f"`{self.name}` has the unit deg and enters {op}, which takes radians: "
                f"units never scale numbers; write {self.name}*pi/180 there, or give "
                "it in rad"
            )
        return (
            f"{self.said} {self.value:g} and enters {op}, which takes radians: "
            f"{self.value:g} degrees are written {self.value:g}*pi/180"
        )


def about_angles(model: Model) -> Iterator[Caution]:
    """Say which angles enter sin, cos or tan in degrees, each once.

    Those of the model, and those of the numbers that parameters and starts are given
    by: these are evaluated, and stand in no graph.
    """
    told: set[str] = set()
    defined = {d.node: d for d in model.definitions if d.unit}
    for g, own in ((model.graph, defined), (_of_numbers(model), {})):
        functions = [n for n, op in enumerate(g.ops) if op in _OF_ANGLES]
        terms = _terms(g, [g.args[n][0] for n in functions], model, own)
        for node in functions:
            term = terms.get(g.args[node][0])
            if term and term.name not in told:
                told.add(term.name)
                yield Caution("degrees", term.text(g.ops[node]))


def _terms(
    g: Graph,
    arguments: Sequence[int],
    model: Model,
    defined: Mapping[int, Definition],
) -> dict[int, _Term]:
    """Give a term in degrees of each of these sums, and of each sum below, if any.

    A number that is added to a time or a length is none of degrees.
    """
    cone = g.cone(arguments)  # each after what it is made of
    terms, others = _leaves(g, cone, model)
    for node in defined.keys() & set(cone):
        if defined[node].unit in DEGREES:
            terms[node] = _Term(defined[node].name, "", None, sure=True)
        elif defined[node].unit not in RADIANS:
            others.add(node)
    for node in cone:
        args = _summed(g, node)
        found = [terms[a] for a in args if a in terms]
        if found and node not in terms:
            terms[node] = max(found, key=lambda x: (x.value is None, x.sure))
        if not others.isdisjoint(args):
            others.add(node)
    return {n: term for n, term in terms.items() if term.sure or n not in others}


def _leaves(
    g: Graph, cone: Sequence[int], model: Model
) -> tuple[dict[int, _Term], set[int]]:
    """Give the leaves that seem to be in degrees, and those that are no angles."""
    units = {p.name: p.unit for p in model.parameters}
    units |= {q.name: q.unit for q in model.coordinates} | {"t": "s"}
    values = {p.name: (p.value, "is") for p in model.parameters} | {
        start.name: (start.value, "starts at")
        for start in model.initial
        if start.target is Target.COORDINATE
    }
    terms: dict[int, _Term] = {}
    others: set[int] = set()
    for node in cone:
        if g.ops[node] == CONSTANT:
            value = g.value(node) or 0.0
            if _is_of_degrees(value):
                terms[node] = _Term(f"{value}", "a term is", value)
        elif g.ops[node] == VARIABLE:
            name = str(g.payload(node))
            unit = units.get(name, "")
            value, verb = values.get(name, (0.0, ""))
            if unit in DEGREES:
                terms[node] = _Term(name, "", None, sure=True)
            elif unit not in RADIANS:
                others.add(node)
            elif _is_of_degrees(value):
                terms[node] = _Term(name, f"`{name}` {verb}", value, sure=bool(unit))
    return terms, others


def _is_of_degrees(value: float) -> bool:
    """Tell whether a number looks like one of degrees."""
    size = abs(value)
    return _LEAST <= size <= _TURN and not all(size % whole for whole in _WHOLE)


def _summed(g: Graph, node: int) -> Sequence[int]:
    """Give the terms of a sum; of a multiple by a whole number what is multiplied."""
    op, args = g.ops[node], g.args[node]
    if op == "mul":
        factors = [g.value(a) for a in args]
        whole = any(f is not None and f.is_integer() for f in factors)
        return [a for a, f in zip(args, factors, strict=True) if whole and f is None]
    return args if op in ("add", "sub", "neg") else ()


def _of_numbers(model: Model) -> Graph:
    """Give a graph of the expressions of parameters and start values."""
    g = Graph()
    for text in model.stated.numbers():
        if any(op in text for op in _OF_ANGLES):
            try:
                parse(text).build(g, g.variable)
            except ExpressionError:
                continue  # replaced by what is given instead
    return g
